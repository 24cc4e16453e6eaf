// Simbody on the flat file that Pinocchio's timer reads. Debian's library is compiled with its internal checks.
//
// States have one-axis joints in the file's order; a free joint's q is quaternion w x y z, then position; its u, u' and forces
// are angular first, in the axes of the frame that it hangs on.
#include "protocol.h"

#include <Simbody.h>

#include <fstream>
#include <memory>
#include <string>
#include <vector>

using namespace SimTK;

struct Tree {
  MultibodySystem system;
  SimbodyMatterSubsystem matter{system};
  GeneralForceSubsystem forces{system};
  std::unique_ptr<Force::Gravity> gravity;
  std::unique_ptr<Force::DiscreteForces> applied;
  State state;
  // Where the file's coordinates are in Simbody's.
  std::vector<int> q_at, u_at;
};

static std::unique_ptr<Tree> tree;
static std::vector<Vector> q, u, tau, acceleration;
static Vector residual;
static Matrix matrix;

static Rotation to_z(const Vec3 &axis) { return Rotation(UnitVec3(axis), ZAxis); }

static MobilizedBody add(MobilizedBody &parent, const std::string &type, const Transform &place, const Vec3 &axis,
                         const Body::Rigid &body) {
  const char kind = type.size() > 10 ? type[10] : ' ';
  if (type == "JointModelFreeFlyer") return MobilizedBody::Free(parent, place, body, Transform());
  // The axis of a pin is z, that of a slider x.
  if (kind == 'R') {
    const Rotation turn = to_z(axis);
    return MobilizedBody::Pin(parent, place * Transform(turn), body, Transform(turn));
  }
  const Rotation turn(UnitVec3(axis), XAxis);
  return MobilizedBody::Slider(parent, place * Transform(turn), body, Transform(turn));
}

static const char *load(std::istream &file) {
  tree = std::make_unique<Tree>();
  std::string word;
  Vec3 gravity;
  size_t target;
  if (!(file >> word >> gravity[0] >> gravity[1] >> gravity[2] >> word >> target)) return "the model lacks its head";
  std::vector<MobilizedBody> bodies{tree->matter.Ground()};
  std::string type;
  for (size_t parent; file >> type >> parent;) {
    double x[25];
    for (double &number : x)
      if (!(file >> number)) return "the model ends early";
    if (parent >= bodies.size()) return "a joint comes before its parent";
    const Rotation rotation(Mat33(x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8]));
    const Vec3 lever(x[16], x[17], x[18]);
    const Inertia central(x[19], x[21], x[24], x[20], x[22], x[23]);
    const Body::Rigid body(MassProperties(x[15], lever, central.shiftFromMassCenter(lever, x[15])));
    const Transform place(rotation, Vec3(x[9], x[10], x[11]));
    bodies.push_back(add(bodies[parent], type, place, Vec3(x[12], x[13], x[14]), body));
  }
  const Real size = gravity.norm();
  const UnitVec3 down = size > 0 ? UnitVec3(gravity) : UnitVec3(0, 0, -1);
  tree->gravity = std::make_unique<Force::Gravity>(tree->forces, tree->matter, down, size);
  tree->applied = std::make_unique<Force::DiscreteForces>(tree->forces, tree->matter);
  tree->state = tree->system.realizeTopology();
  tree->system.realizeModel(tree->state);
  for (size_t i = 1; i < bodies.size(); i++) {
    for (int k = 0; k < bodies[i].getNumQ(tree->state); k++)
      tree->q_at.push_back(bodies[i].getFirstQIndex(tree->state) + k);
    for (int k = 0; k < bodies[i].getNumU(tree->state); k++)
      tree->u_at.push_back(bodies[i].getFirstUIndex(tree->state) + k);
  }
  return nullptr;
}

extern "C" {
const char *open_model(const char *name) {
  static std::string wrong;
  std::ifstream file(name);
  if (!file) return "cannot open the model";
  try {
    return load(file);
  } catch (const std::exception &reason) {
    wrong = reason.what();
    for (char &c : wrong)
      if (c == '\n') c = ' ';
    return wrong.c_str();
  }
}

const char *use_states(const States *s) {
  if (s->nq != (int)tree->q_at.size() || s->nv != (int)tree->u_at.size())
    return "the states have other dimensions than the model";
  const auto rows = [s](const double *x, const std::vector<int> &at) {
    std::vector<Vector> all;
    for (int i = 0; i < s->count; i++, x += at.size()) {
      all.emplace_back((int)at.size());
      for (size_t k = 0; k < at.size(); k++) all.back()[at[k]] = x[k];
    }
    return all;
  };
  q = rows(s->q, tree->q_at), u = rows(s->v, tree->u_at), tau = rows(s->tau, tree->u_at);
  acceleration = rows(s->a, tree->u_at);
  return nullptr;
}

long largest_result(void) { return (long)(tree->u_at.size() * tree->u_at.size()); }
}

static void forward_dynamics(int i) {
  State &state = tree->state;
  state.updQ() = q[i];
  state.updU() = u[i];
  tree->applied->setAllMobilityForces(state, tau[i]);
  tree->system.realize(state, Stage::Acceleration);
}

static void inverse_dynamics(int i) {
  State &state = tree->state;
  state.updQ() = q[i];
  state.updU() = u[i];
  tree->system.realize(state, Stage::Velocity);
  const Vector_<SpatialVec> &weight = tree->gravity->getBodyForces(state);
  tree->matter.calcResidualForceIgnoringConstraints(state, Vector(), weight, acceleration[i], residual);
}

static void mass_matrix(int i) {
  State &state = tree->state;
  state.updQ() = q[i];
  tree->system.realize(state, Stage::Position);
  tree->matter.calcM(state, matrix);
}

static long write(const Vector &x, double *out) {
  for (int at : tree->u_at) *out++ = x[at];
  return (long)tree->u_at.size();
}

static long write_matrix(double *out) {
  for (int row : tree->u_at)
    for (int column : tree->u_at) *out++ = matrix(row, column);
  return largest_result();
}

extern "C" const Operation operations[] = {
    {"forward_dynamics", forward_dynamics, [](double *out) { return write(tree->state.getUDot(), out); }},
    {"inverse_dynamics", inverse_dynamics, [](double *out) { return write(residual, out); }},
    {"mass_matrix", mass_matrix, write_matrix},
    {nullptr, nullptr, nullptr},
};
