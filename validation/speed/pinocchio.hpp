// A Pinocchio model built joint by joint from a flat file, and its states.
//
// Line "gravity X Y Z", line "target I" (the joint whose body's Jacobian is taken), then for each joint in Pinocchio's order:
// TYPE PARENT, rotation by rows and translation of its placement, its axis, mass, lever, inertia about the centre of mass
// (xx xy yy xz yz zz); then "closure KIND" for each closed loop, KIND spherical or weld, and for both of its frames the joint that
// carries it, rotation by rows and translation. The wheel's URDF parser is not linked: Eigen's alignment differs under -march=native.
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

struct Closure {
  bool is_weld;
  size_t joint[2];
  pin::SE3 pose[2];
};
static std::vector<Closure> closures;

// What a timer does once per model with its closures, if anything.
static void (*close_loops)() = nullptr;

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

static pin::SE3 pose_of(const double *x) {
  return pin::SE3(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(x), Eigen::Vector3d(x + 9));
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
  closures.clear();
  while (file >> type) {
    double x[25];
    if (type == "closure") {
      Closure closure;
      file >> word;
      closure.is_weld = word == "weld";
      for (int side = 0; side < 2; side++) {
        file >> closure.joint[side];
        for (int i = 0; i < 12; i++) file >> x[i];
        if (!file || closure.joint[side] >= (size_t)model->njoints) return "a closure ends early or hangs on no joint";
        closure.pose[side] = pose_of(x);
      }
      closures.push_back(closure);
      continue;
    }
    size_t parent;
    if (!(file >> parent)) return "a joint lacks its parent";
    for (double &number : x)
      if (!(file >> number)) return "the model ends early";
    Eigen::Vector3d axis(x + 12), lever(x + 16);
    Eigen::Matrix3d inertia;
    inertia << x[19], x[20], x[22], x[20], x[21], x[23], x[22], x[23], x[24];
    try {
      const auto name = "joint" + std::to_string(model->njoints);
      const auto joint = model->addJoint(parent, joint_of(type, axis), pose_of(x), name);
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
  if (close_loops) close_loops();
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
