// A Pinocchio model built joint by joint from a flat file, and its states.
//
// Line "gravity X Y Z", line "target I" (the joint whose body's Jacobian is taken), then for each joint in Pinocchio's order:
// TYPE PARENT, rotation by rows and translation of its placement, its axis, mass, lever, inertia about the centre of mass
// (xx xy yy xz yz zz). The wheel's URDF parser is not linked: Eigen's alignment differs under -march=native.
#pragma once

#include "protocol.h"

#include <fstream>
#include <memory>
#include <string>
#include <vector>


#include <pinocchio/multibody.hpp>

namespace pin = pinocchio;
using Vector = Eigen::VectorXd;

static std::unique_ptr<pin::Model> model;
static std::unique_ptr<pin::Data> data;
static size_t target;
static std::vector<Vector> q, v, tau, acceleration;

static pin::JointModel joint_of(const std::string &type, const Eigen::Vector3d &axis) {
  if (type == "JointModelRX") return pin::JointModelRX();
  if (type == "JointModelRY") return pin::JointModelRY();
  if (type == "JointModelRZ") return pin::JointModelRZ();
  if (type == "JointModelPX") return pin::JointModelPX();
  if (type == "JointModelPY") return pin::JointModelPY();
  if (type == "JointModelPZ") return pin::JointModelPZ();
  if (type == "JointModelRUBX") return pin::JointModelRUBX();
  if (type == "JointModelRUBY") return pin::JointModelRUBY();
  if (type == "JointModelRUBZ") return pin::JointModelRUBZ();
  if (type == "JointModelFreeFlyer") return pin::JointModelFreeFlyer();
  if (type == "JointModelRevoluteUnaligned") return pin::JointModelRevoluteUnaligned(axis);
  if (type == "JointModelRevoluteUnboundedUnaligned") return pin::JointModelRevoluteUnboundedUnaligned(axis);
  if (type == "JointModelPrismaticUnaligned") return pin::JointModelPrismaticUnaligned(axis);
  throw std::string("unknown joint type ") + type;
}

static const char *load(std::istream &file) {
  static std::string wrong;
  model = std::make_unique<pin::Model>();
  std::string word;
  Eigen::Vector3d gravity;
  if (!(file >> word >> gravity[0] >> gravity[1] >> gravity[2])) return "the model lacks its gravity";
  model->gravity.linear() = gravity;
  if (!(file >> word >> target)) return "the model lacks its target";
  std::string type;
  for (size_t parent; file >> type >> parent;) {
    double x[25];
    for (double &number : x)
      if (!(file >> number)) return "the model ends early";
    Eigen::Matrix3d rotation = Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(x);
    Eigen::Vector3d translation(x + 9), axis(x + 12), lever(x + 16);
    Eigen::Matrix3d inertia;
    inertia << x[19], x[20], x[22], x[20], x[21], x[23], x[22], x[23], x[24];
    try {
      const auto name = "joint" + std::to_string(model->njoints);
      const auto joint = model->addJoint(parent, joint_of(type, axis), pin::SE3(rotation, translation), name);
      model->appendBodyToJoint(joint, pin::Inertia(x[15], lever, inertia), pin::SE3::Identity());
    } catch (const std::string &reason) {
      wrong = reason;
      return wrong.c_str();
    }
  }
  // The last frame: the target's.
  if (target >= (size_t)model->njoints) return "the target is no joint of the model";
  model->addFrame(pin::Frame("target", target, 0, pin::SE3::Identity(), pin::OP_FRAME));
  data = std::make_unique<pin::Data>(*model);
  return nullptr;
}

extern "C" {
const char *open_model(const char *name) {
  std::ifstream file(name);
  return file ? load(file) : "cannot open the model";
}

const char *use_states(const States *s) {
  if (s->nq != model->nq || s->nv != model->nv) return "the states have other dimensions than the model";
  const auto rows = [s](const double *x, int n) {
    std::vector<Vector> all;
    for (int i = 0; i < s->count; i++) all.push_back(Eigen::Map<const Vector>(x + (size_t)i * n, n));
    return all;
  };
  q = rows(s->q, s->nq), v = rows(s->v, s->nv), tau = rows(s->tau, s->nv), acceleration = rows(s->a, s->nv);
  return nullptr;
}

long largest_result(void) { return 3L * model->nv * model->nv + 6L * model->nv * model->njoints; }
}

template <class Matrix>
static long write(const Matrix &m, double *out) {
  for (long i = 0; i < m.rows(); i++)
    for (long j = 0; j < m.cols(); j++) *out++ = m(i, j);
  return m.size();
}

// From the upper triangle, which is all that some algorithms fill.
template <class Matrix>
static long write_symmetric(const Matrix &m, double *out) {
  for (long i = 0; i < m.rows(); i++)
    for (long j = 0; j < m.cols(); j++) *out++ = m(std::min(i, j), std::max(i, j));
  return m.size();
}
