// Derivatives of inverse and forward dynamics in Pinocchio.
#include "pinocchio.hpp"

#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>

extern "C" const Operation operations[] = {
    {"inverse_dynamics_derivatives",
     [](int i) { pin::computeRNEADerivatives(*model, *data, q[i], v[i], acceleration[i]); },
     [](double *out) {
       long n = write(data->dtau_dq, out);
       n += write(data->dtau_dv, out + n);
       return n + write_symmetric(data->M, out + n);
     }},
    {"forward_dynamics_derivatives", [](int i) { pin::computeABADerivatives(*model, *data, q[i], v[i], tau[i]); },
     [](double *out) {
       long n = write(data->ddq_dq, out);
       n += write(data->ddq_dv, out + n);
       return n + write_symmetric(data->Minv, out + n);
     }},
    {nullptr, nullptr, nullptr},
};
