// Inverse dynamics, mass matrix, its inverse, Jacobians and centroidal quantities in Pinocchio.
#include "pinocchio.hpp"

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/centroidal.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/rnea.hpp>

static long mass_matrix(double *out) { return write_symmetric(data->M, out); }

static pin::Data::Matrix6x jacobian;
static long write_jacobian(double *out) { return write(jacobian, out); }

// World axes, at the body's origin.
static const auto ALIGNED = pin::LOCAL_WORLD_ALIGNED;

static void jacobian_of_all(int i) {
  pin::computeJointJacobians(*model, *data, q[i]);
  jacobian.setZero(6, model->nv);
  pin::getJointJacobian(*model, *data, target, ALIGNED, jacobian);
}

static void jacobian_along_path(int i) {
  jacobian.setZero(6, model->nv);
  pin::computeFrameJacobian(*model, *data, q[i], model->frames.size() - 1, ALIGNED, jacobian);
}

extern "C" const Operation operations[] = {
    {"inverse_dynamics", [](int i) { pin::rnea(*model, *data, q[i], v[i], acceleration[i]); },
     [](double *out) { return write(data->tau, out); }},
    {"mass_matrix:local", [](int i) { pin::crba(*model, *data, q[i], pin::Convention::LOCAL); }, mass_matrix},
    {"mass_matrix:world", [](int i) { pin::crba(*model, *data, q[i], pin::Convention::WORLD); }, mass_matrix},
    {"mass_matrix_inverse", [](int i) { pin::computeMinverse(*model, *data, q[i]); },
     [](double *out) { return write_symmetric(data->Minv, out); }},
    {"jacobian:all", jacobian_of_all, write_jacobian},
    {"jacobian:path", jacobian_along_path, write_jacobian},
    {"centroidal", [](int i) { pin::ccrba(*model, *data, q[i], v[i]); },
     [](double *out) { return write(data->Ag, out); }},
    {nullptr, nullptr, nullptr},
};
