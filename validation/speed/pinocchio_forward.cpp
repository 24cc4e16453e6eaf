// Forward dynamics in Pinocchio.
#include "pinocchio.hpp"

#include <pinocchio/algorithm/aba.hpp>

static long result(double *out) { return write(data->ddq, out); }

extern "C" const Operation operations[] = {
    {"forward_dynamics:local",
     [](int i) { pin::aba(*model, *data, q[i], v[i], tau[i], pin::Convention::LOCAL); }, result},
    {"forward_dynamics:world",
     [](int i) { pin::aba(*model, *data, q[i], v[i], tau[i], pin::Convention::WORLD); }, result},
    {nullptr, nullptr, nullptr},
};
