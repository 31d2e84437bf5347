// Free vertices that fly at thin obstacles: no triangle passes, whatever the speed.

#include "clothctl/contact/obstacle_guard.hpp"

#include <cmath>
#include <random>
#include <vector>

#include "clothctl/collision/shapes.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/folded_sheets.hpp"
#include "support/throws.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

constexpr double kStep = 0.01;

/// Free vertices, and one obstacle.
template <class C>
struct Flight {
  Flight(int n, C shape, const RigidMotion<double>& motion)
      : mesh(layer(n, 0.1)),
        moving(MovingCollider<double, C>::create(shape, motion).value()),
        finder(SheetContactFinder<double>::create(mesh.positions, mesh.triangles).value()),
        contacts(ObstacleContacts<double>::create(1000, settings()).value()),
        guard(ObstacleGuard<double>::create(mesh.positions.cols(), mesh.triangles)),
        inverse_mass(VectorX<double>::Constant(mesh.positions.cols(), 1000)),
        state{mesh.positions, Points<double>::Zero(3, mesh.positions.cols())},
        drift(Points<double>::Zero(3, mesh.positions.cols())) {
    obstacles.emplace_back(moving);
  }
  static ObstacleContactSettings<double> settings() {
    ObstacleContactSettings<double> out;
    out.thickness = 0.5e-3;
    return out;
  }
  /// Flies for a step.
  ObstacleGuardReport step() {
    before = state.positions;
    REQUIRE(finder.update(before) == QueryStatus::Answered);
    REQUIRE(contacts.update(obstacles, state.velocities, kStep, finder) == QueryStatus::Answered);
    // No model makes the step.
    for (ObstacleContact<double>& c : contacts.contacts()) {
      c.impulse.setZero();
      c.state = ContactState::Open;
    }
    state.positions += kStep * state.velocities;
    state.velocities += drift;
    return guard.resolve(obstacles, before, inverse_mass, kStep, contacts, state);
  }
  Vector3<double> momentum() const { return state.velocities * inverse_mass.cwiseInverse(); }
  Vector3<double> impulse() const {
    Vector3<double> sum = Vector3<double>::Zero();
    for (const auto& c : contacts.contacts()) sum += c.impulse;
    return sum;
  }

  PlainMesh mesh;
  MovingCollider<double, C> moving;
  std::vector<ColliderRef<double>> obstacles;
  SheetContactFinder<double> finder;
  ObstacleContacts<double> contacts;
  ObstacleGuard<double> guard;
  VectorX<double> inverse_mass;
  ClothState<double> state;
  /// What the velocities at the end of a step differ by from the displacements.
  Points<double> drift;
  Points<double> before;
};

CapsuleCollider<double> needle(double half = 0.05, double radius = 0.5e-3) {
  return CapsuleCollider<double>::create(Vec3(0, 0, -half), Vec3(0, 0, half), radius).value();
}

/// Flies for some steps in random directions; returns how many impacts there were.
template <class C>
int fly(std::mt19937& random, const Throw& thrown, C shape, double speed, bool held) {
  Flight<C> flight(4, shape, thrown.motion);
  const Points<double> flat = flight.state.positions;
  flight.state.positions.row(0).array() -= 0.05;
  flight.state.positions.row(1).array() -= 0.05;
  RigidMotion<double> motion = thrown.motion;
  if (held) flight.inverse_mass[0] = 0;
  int impacts = 0;
  for (int k = 0; k < 12; ++k) {
    for (Index i = 0; i < flat.size(); ++i)
      flight.state.velocities.data()[i] += speed * uniform(random, -0.3, 0.3);
    if (held) flight.state.velocities.col(0).setZero();
    const Vec3 momentum = flight.momentum();
    const ObstacleGuardReport report = flight.step();
    impacts += report.impacts;
    const Points<double> from = placed(thrown, motion);
    motion.position += kStep * motion.velocity;
    motion.R_world_body =
        rotation_exp<double>(Vec3(kStep * motion.angular_velocity)) * motion.R_world_body;
    REQUIRE(flight.moving.set_motion(motion).empty());
    CHECK(flight.state.positions.allFinite());
    if (held) {
      CHECK(flight.state.positions.col(0) == flight.before.col(0));
    } else {
      CHECK(report.left == 0);
      const double size = flight.impulse().norm() + momentum.norm();
      CHECK((flight.momentum() - momentum - flight.impulse()).norm() < 1e-9 * size);
    }
    if (report.left == 0) {
      CHECK(!passes(thrown.skeleton, from, placed(thrown, motion), flight.mesh.triangles,
                    flight.before, flight.state.positions));
    } else {
      break;  // forced through
    }
  }
  return impacts;
}

}  // namespace

TEST_CASE("free vertices do not pass thin obstacles", "[contact]") {
  int impacts = 0;
  for (int trial = 0; trial < trials(20, 10000, 10); ++trial) {
    CAPTURE(trial);
    std::mt19937 random(static_cast<unsigned>(trial));
    const double speed = std::pow(10.0, uniform(random, -1, 1.3));
    const Throw thrown = random_throw(random, static_cast<Thrown>(trial % 3), speed);
    const bool held = trial % 5 == 4;
    if (thrown.what == Thrown::Plate) {
      const Vec3 half(thrown.radius, thrown.half, thrown.half);
      const auto plate = BoxCollider<double>::create(Vec3::Zero(), half).value();
      impacts += fly(random, thrown, plate, speed, held);
    } else {
      impacts += fly(random, thrown, needle(thrown.half, thrown.radius), speed, held);
    }
  }
  CHECK(impacts > 20);
}

TEST_CASE("a guard leaves alone what does not pass, and what is thick", "[contact]") {
  RigidMotion<double> motion;
  motion.position = Vec3(0.03, 0.04, -0.06);
  Flight<CapsuleCollider<double>> past(4, needle(), motion);
  past.state.velocities.row(2).setConstant(-0.8);  // ends above the tip
  past.state.velocities.row(0).setConstant(5);
  CHECK(past.step().impacts == 0);
  CHECK(past.state.positions == past.before + kStep * past.state.velocities);
  CHECK(past.contacts.contacts().size() > 0);
  const auto ball = SphereCollider<double>::create(Vec3::Zero(), 0.05).value();
  Flight<SphereCollider<double>> onto(4, ball, motion);
  onto.state.velocities.row(2).setConstant(-1);
  CHECK(onto.step().impacts == 0);
  // Fast, the same ball is thin.
  Flight<SphereCollider<double>> fast(4, ball, motion);
  fast.state.velocities.row(2).setConstant(-10);
  CHECK(fast.step().impacts > 0);
  CHECK(fast.state.positions.row(2).maxCoeff() > -0.02);
}

TEST_CASE("a guard does not allocate, repeats, and refuses other sizes", "[contact]") {
  RigidMotion<double> motion;
  motion.position = Vec3(0.03, 0.04, -0.06);
  Points<double> first;
  for (int run = 0; run < 2; ++run) {
    Flight<CapsuleCollider<double>> flight(4, needle(), motion);
    flight.state.velocities.row(2).setConstant(-5);
    flight.state.velocities(0, 3) = 4;
    const long before = allocations();
    const ObstacleGuardReport report = flight.step();
    const long after = allocations();
    if (allocation_counting_works()) CHECK(after - before <= 1);  // `before` of the flight
    CHECK(report.impacts > 0);
    if (run == 0) first = flight.state.positions;
    CHECK(flight.state.positions == first);
    ClothState<double> other{Points<double>::Zero(3, 2), Points<double>::Zero(3, 2)};
    CHECK(flight.guard
              .resolve(flight.obstacles, flight.before, flight.inverse_mass, kStep, flight.contacts,
                       other)
              .impacts == 0);
    CHECK(other.positions.isZero());
  }
}

TEST_CASE("what goes with an obstacle has its velocity", "[contact]") {
  // A bar turns fast under a sheet whose vertices are flung at it.
  int zones = 0;
  for (int trial = 0; trial < 300 && zones < 20; ++trial) {
    CAPTURE(trial);
    std::mt19937 random(static_cast<unsigned>(trial));
    const Throw thrown = random_throw(random, Thrown::Plate, 20);
    const Vec3 half(thrown.radius, thrown.half, thrown.half);
    Flight<BoxCollider<double>> flight(6, BoxCollider<double>::create(Vec3::Zero(), half).value(),
                                       thrown.motion);
    flight.state.positions.topRows(2).array() -= 0.05;
    for (Index i = 0; i < flight.drift.size(); ++i) {
      flight.state.velocities.data()[i] = uniform(random, -20, 20);
      flight.drift.data()[i] = uniform(random, -1, 1);
    }
    const Vec3 momentum = flight.momentum() + flight.drift * flight.inverse_mass.cwiseInverse();
    const ObstacleGuardReport report = flight.step();
    zones += report.zones;
    const double size = flight.impulse().norm() + momentum.norm();
    CHECK((flight.momentum() - momentum - flight.impulse()).norm() < 1e-9 * size);
    const Points<double> way = flight.state.positions - flight.before;
    const auto error = (flight.state.velocities - way / kStep).colwise().norm().array();
    CHECK((error < 1e-9).count() >= report.zones);
  }
  CHECK(zones > 0);
}
