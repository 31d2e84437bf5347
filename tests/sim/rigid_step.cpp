// The parts of a step one by one: what each changes, impulses in between, failures, and coupling
// with other solvers through the colliders of bodies.

#include "clothctl/sim/detail/rigid_step.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <span>

#include "clothctl/sim/rigid_bodies.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;

namespace {

struct Drop {
  Drop() {
    w.add_obstacle(ColliderRef<double>(plane)).value();
    RigidBodySetup<double> setup{ConvexShape<double>::box(V(0.5, 0.5, 0.5)).value()};
    setup.mass = 1;
    setup.motion.position = V(0, 0, 0.5);
    w.add(setup).value();
  }
  PlaneCollider<double> plane = PlaneCollider<double>::create(V(0, 0, 0), V(0, 0, 1)).value();
  RigidBodies<double> w;
};

}  // namespace

TEST_CASE("predict changes velocities by gravity, solve by contacts, finish moves") {
  Drop d;
  const double h = 1.0 / 60;
  REQUIRE(d.w.predict(h) == StepStatus::Converged);
  CHECK(d.w.motion(0).velocity[2] == Approx(-9.81 * h));
  CHECK(d.w.contacts().size() == 4);
  d.w.solve();
  CHECK(std::abs(d.w.motion(0).velocity[2]) < 1e-3);
  CHECK(d.w.motion(0).position[2] == 0.5);
  const RigidStepReport<double> report = d.w.finish();
  CHECK(report.advanced);
  CHECK(report.contacts == 4);
  CHECK(report.islands == 1);
}

TEST_CASE("an impulse between the parts counts in the solve") {
  Drop d;
  const double h = 1.0 / 60;
  REQUIRE(d.w.predict(h) == StepStatus::Converged);
  CHECK(d.w.apply_impulse(0, V(0, 0, -2), V(0, 0, 0.5)));
  d.w.solve();
  double sum = 0;
  for (const RigidContact<double>& c : d.w.contacts()) sum += c.sample.impulse[2];
  CHECK(sum == Approx(2 + 9.81 * h).epsilon(2e-3));
  CHECK(d.w.finish().advanced);
}

TEST_CASE("an impulse wakes a body between the parts") {
  Drop d;
  for (int k = 0; k < 60; ++k) REQUIRE(d.w.step(1.0 / 60).advanced);
  REQUIRE(d.w.asleep(0));
  REQUIRE(d.w.predict(1.0 / 60) == StepStatus::Converged);
  CHECK(d.w.apply_impulse(0, V(0, 0, -5), V(0, 0, 0.5)));
  d.w.solve();
  CHECK(d.w.finish().advanced);
  CHECK(std::abs(d.w.motion(0).velocity[2]) < 0.02);
  CHECK(d.w.motion(0).position[2] == Approx(0.5).margin(1e-3));
}

TEST_CASE("a step that cannot be computed leaves the bodies as they were") {
  Drop d;
  RigidMotion<double> m = d.w.motion(0);
  m.position[2] = 9.9e19;
  m.velocity = V(0, 0, 9.9e19);
  REQUIRE(d.w.set_motion(0, m).empty());
  const RigidStepReport<double> report = d.w.step(1000);
  CHECK(report.status == StepStatus::NumericalFailure);
  CHECK(!report.advanced);
  CHECK(d.w.motion(0).velocity == m.velocity);
  CHECK(d.w.motion(0).position == m.position);
}

TEST_CASE("the collider of a body has its pose, velocity and number") {
  Drop d;
  RigidMotion<double> m = d.w.motion(0);
  m.position = V(0, 0, 5);
  m.velocity = V(1, 0, 0);
  m.angular_velocity = V(0, 0, 2);
  REQUIRE(d.w.set_motion(0, m).empty());
  Points<double> x(3, 1);
  x.col(0) = V(0.7, 0, 5);
  SurfacePoint<double> s;
  REQUIRE(d.w.collider(0).closest(x, std::span<SurfacePoint<double>>(&s, 1)) ==
          QueryStatus::Answered);
  CHECK(s.distance == Approx(0.2));
  CHECK((s.velocity - V(1, 1, 0)).norm() < 1e-12);
  CHECK(s.body == 0);
}
