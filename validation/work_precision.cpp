// Simbody on the flat scene that work_precision.py writes: integrates it at several accuracies and prints values and times.
//
// Names have no blanks; a pose is its rotation by rows, then its translation. Debian's library has its internal checks compiled in.
#include <Simbody.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <string>
#include <vector>

using namespace SimTK;

// asin(0.1 sin 10 t), the road of the car axis.
class Road : public Function {
 public:
  Real calcValue(const Vector &x) const override { return std::asin(0.1 * std::sin(10 * x[0])); }
  Real calcDerivative(const Array_<int> &order, const Vector &x) const override {
    const Real s = 0.1 * std::sin(10 * x[0]), c = std::cos(10 * x[0]), w = 1 - s * s;
    if (order.size() == 1) return c / std::sqrt(w);
    return -10 * std::sin(10 * x[0]) / std::sqrt(w) + c * s * c / (w * std::sqrt(w));
  }
  int getArgumentSize() const override { return 1; }
  int getMaxDerivativeOrder() const override { return 2; }
};

static Vec3 vector(std::istream &in) {
  Vec3 x;
  in >> x[0] >> x[1] >> x[2];
  return x;
}

static Transform pose(std::istream &in) {
  Mat33 r;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) in >> r(i, j);
  const Vec3 p = vector(in);
  return Transform(Rotation(r), p);
}

static MobilizedBody add(MobilizedBody &parent, const std::string &kind, const Vec3 &axis, const Transform &at,
                         const Body::Rigid &body) {
  if (kind == "floating") return MobilizedBody::Ball(parent, at, body, Transform());
  if (kind == "translation") return MobilizedBody::Translation(parent, at, body, Transform());
  // The axis of a pin is z, that of a slider x.
  const bool slides = kind == "prismatic";
  const Rotation turn(UnitVec3(axis), slides ? CoordinateAxis(XAxis) : CoordinateAxis(ZAxis));
  if (slides) return MobilizedBody::Slider(parent, at * Transform(turn), body, Transform(turn));
  return MobilizedBody::Pin(parent, at * Transform(turn), body, Transform(turn));
}

static double run(const std::string &method, double accuracy, const MultibodySystem &system, const State &start, double end,
                  State &last, long &steps) {
  std::unique_ptr<Integrator> integrator;
  if (method == "Merson") integrator.reset(new RungeKuttaMersonIntegrator(system));
  if (method == "BDF") integrator.reset(new CPodesIntegrator(system, CPodes::BDF));
  integrator->setAccuracy(accuracy);
  integrator->setFinalTime(end);
  const auto begun = std::chrono::steady_clock::now();
  integrator->initialize(start);
  while (integrator->getTime() < end) integrator->stepTo(end);
  const auto wall = std::chrono::steady_clock::now() - begun;
  last = integrator->getState();
  steps = integrator->getNumStepsTaken();
  return std::chrono::duration<double>(wall).count();
}

int main(int, char **arguments) try {
  std::ifstream file(arguments[1]);
  MultibodySystem system;
  SimbodyMatterSubsystem matter(system);
  GeneralForceSubsystem forces(system);
  std::map<std::string, MobilizedBody> bodies{{"world", matter.Ground()}};
  std::map<std::string, std::string> kinds;
  std::vector<std::function<void(State &)>> starts;
  std::vector<std::function<double(const State &)>> outputs;
  double end = 0;
  for (std::string word; file >> word;) {
    std::string a, b, kind;
    if (word == "gravity") {
      Force::Gravity(forces, matter, vector(file));
    } else if (word == "body") {
      file >> a >> b >> kind;
      const Vec3 axis = vector(file);
      const Transform at = pose(file);
      double mass;
      file >> mass;
      const Vec3 center = vector(file), diagonal = vector(file), products = vector(file);
      const Inertia about_center(diagonal, products);
      const Body::Rigid body(MassProperties(mass, center, about_center.shiftFromMassCenter(center, mass)));
      bodies[a] = add(bodies[b], kind, axis, at, body);
      kinds[a] = kind;
    } else if (word == "closure") {
      file >> kind >> a;
      const Transform x = pose(file);
      file >> b;
      const Transform y = pose(file);
      double length;
      file >> length;
      if (kind == "distance") {
        Constraint::Rod(bodies[a], x.p(), bodies[b], y.p(), length);
      } else if (kind == "point_on_plane") {
        Constraint::PointInPlane(bodies[a], UnitVec3(x.z()), dot(x.p(), x.z()), bodies[b], y.p());
      } else {
        Constraint::Ball(bodies[a], x.p(), bodies[b], y.p());
        if (kind == "revolute") {
          Constraint::ConstantAngle(bodies[a], UnitVec3(x.z()), bodies[b], UnitVec3(y.x()));
          Constraint::ConstantAngle(bodies[a], UnitVec3(x.z()), bodies[b], UnitVec3(y.y()));
        }
      }
    } else if (word == "spring" || word == "damper") {
      file >> a;
      const Vec3 p = vector(file);
      file >> b;
      const Vec3 q = vector(file);
      double k, rest;
      file >> k >> rest;
      if (word == "spring") Force::TwoPointLinearSpring(forces, bodies[a], p, bodies[b], q, k, rest);
      else Force::TwoPointLinearDamper(forces, bodies[a], p, bodies[b], q, k);
    } else if (word == "torque") {
      double value;
      file >> a >> value;
      Force::MobilityConstantForce(forces, bodies[a], MobilizerUIndex(0), value);
    } else if (word == "road") {
      file >> a;
      Constraint::PrescribedMotion(matter, new Road, bodies[a], MobilizerQIndex(0));
    } else if (word == "q" || word == "v") {
      int i;
      double x;
      file >> a >> i >> x;
      const MobilizedBody body = bodies[a];
      const bool position = word == "q";
      starts.push_back([=](State &s) { position ? body.setOneQ(s, i, x) : body.setOneU(s, i, x); });
    } else if (word == "end") {
      file >> end;
    } else if (word == "coordinates") {
      int count;
      file >> kind >> count;
      std::vector<MobilizedBody> summed;
      for (; count > 0; --count) {
        file >> a;
        summed.push_back(bodies[a]);
      }
      const bool position = kind == "q";
      outputs.push_back([=](const State &s) {
        double sum = 0;
        for (const auto &body : summed) sum += position ? body.getOneQ(s, 0) : body.getOneU(s, 0);
        return sum;
      });
    } else if (word == "rate") {
      int i;
      file >> a >> i;
      const MobilizedBody body = bodies[a];
      outputs.push_back([=](const State &s) { return (~body.getBodyRotation(s) * body.getBodyAngularVelocity(s))[i]; });
    } else if (word == "point") {
      int i;
      file >> a;
      const Vec3 p = vector(file);
      file >> i;
      const MobilizedBody body = bodies[a];
      outputs.push_back([=](const State &s) { return body.findStationLocationInGround(s, p)[i]; });
    } else {
      throw std::runtime_error("unknown word " + word);
    }
  }
  State start = system.realizeTopology();
  matter.setUseEulerAngles(start, false);
  system.realizeModel(start);
  for (const auto &set : starts) set(start);
  system.realize(start, Stage::Velocity);
  system.project(start, 1e-13);
  const std::string method = arguments[2];
  std::cout.precision(17);
  for (int i = 3; arguments[i]; ++i) {
    State last;
    long steps = 0;
    std::vector<double> times;
    try {
      do {
        times.push_back(run(method, std::stod(arguments[i]), system, start, end, last, steps));
      } while (times.size() < 5 && times[0] < 0.5);
    } catch (const std::exception &e) {
      std::cerr << arguments[i] << ": " << e.what() << "\n";
      continue;
    }
    system.realize(last, Stage::Velocity);
    std::cout << arguments[i] << " " << *std::min_element(times.begin(), times.end()) << " " << steps;
    for (const auto &output : outputs) std::cout << " " << output(last);
    std::cout << std::endl;
  }
} catch (const std::exception &e) {
  std::cerr << e.what() << "\n";
  return 1;
}
