// Forward dynamics with closed loops in Pinocchio: the proximal solver on the sparse Cholesky factor, and the recursion of
// linear cost. Both iterate to 1e-12 of their own residual, at most ten times.
#include "pinocchio.hpp"

#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <pinocchio/algorithm/loop-constrained-aba.hpp>

static std::vector<pin::RigidConstraintModel> constraints;
static std::vector<pin::RigidConstraintData> constraint_data;
static std::unique_ptr<pin::Data> linear;
static bool on_linear;

static void close_all() {
  constraints.clear(), constraint_data.clear();
  for (const Closure &c : closures)
    constraints.emplace_back(c.is_weld ? pin::CONTACT_6D : pin::CONTACT_3D, *model, c.joint[0], c.pose[0], c.joint[1], c.pose[1]);
  for (const auto &constraint : constraints) constraint_data.emplace_back(constraint);
  pin::initConstraintDynamics(*model, *data, constraints, constraint_data);
  linear = std::make_unique<pin::Data>(*model);
  pin::computeJointMinimalOrdering(*model, *linear, constraints);
}

static const bool closing = (close_loops = close_all) != nullptr;

static long result(double *out) { return write(on_linear ? linear->ddq : data->ddq, out); }

static void by_cholesky(int i) {
  on_linear = false;
  pin::ProximalSettings settings(1e-12, 1e-8, 10);
  pin::constraintDynamics(*model, *data, q[i], v[i], tau[i], constraints, constraint_data, settings);
}

static void by_recursion(int i) {
  on_linear = true;
  // The recursion reads the accelerations that the call before it left.
  for (auto &a : linear->oa) a.setZero();
  pin::ProximalSettings settings(1e-12, 1e-6, 10);
  pin::lcaba(*model, *linear, q[i], v[i], tau[i], constraints, constraint_data, settings);
}

extern "C" const Operation operations[] = {
    {"closed_forward_dynamics:cholesky", by_cholesky, result},
    {"closed_forward_dynamics:recursion", by_recursion, result},
    {nullptr, nullptr, nullptr},
};
