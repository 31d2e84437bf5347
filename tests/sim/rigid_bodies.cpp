// Rigid bodies: friction on inclines, stacks, mass ratios, bounces, sliding and rolling, joints,
// sleep, events, groups, what is fast, and random worlds of which some are absurd.

#include "clothctl/sim/rigid_bodies.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

#include "clothctl/collision/collider_union.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/thread_executor.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::allocation_counting_works;
using clothctl_test::allocations;
using clothctl_test::trials;

namespace {

using V = Vector3<double>;
using M = Matrix3<double>;

template <class S>
ConvexShape<S> box(S x, S y, S z) {
  return ConvexShape<S>::box(Vector3<S>(x, y, z)).value();
}
ConvexShape<double> cube() { return box(0.5, 0.5, 0.5); }
ConvexShape<double> ball(double r) { return ConvexShape<double>::sphere(r).value(); }

template <class S>
RigidBodySetup<S> at(const ConvexShape<S>& shape, const Vector3<S>& x) {
  RigidBodySetup<S> out{shape};
  out.motion.position = x;
  return out;
}

/// Bodies on a floor z = 0, never asleep.
template <class S>
struct Floor {
  explicit Floor(S friction, const Vector3<S>& gravity = Vector3<S>(S(0), S(0), S(-9.81)),
                 const Vector3<S>& up = Vector3<S>(S(0), S(0), S(1)))
      : plane(PlaneCollider<S>::create(Vector3<S>::Zero(), up, {friction, 0}).value()),
        bodies(settings(gravity)) {
    bodies.add_obstacle(ColliderRef<S>(plane)).value();
  }
  static RigidBodiesSettings<S> settings(const Vector3<S>& gravity) {
    RigidBodiesSettings<S> out;
    out.gravity = gravity;
    out.sleep_time = S(0);
    if (sizeof(S) == 4) out.velocity_tolerance = S(1e-3);
    return out;
  }
  int add(const RigidBodySetup<S>& setup) { return bodies.add(setup).value(); }
  PlaneCollider<S> plane;
  RigidBodies<S> bodies;
};

template <class S>
bool all_sane(const RigidBodies<S>& w) {
  for (int i = 0; i < w.body_count(); ++i) {
    const RigidMotion<S>& m = w.motion(i);
    if (!all_finite(m.position) || !all_finite(m.velocity) || !all_finite(m.R_world_body) ||
        !all_finite(m.angular_velocity))
      return false;
  }
  return true;
}

double unit(std::mt19937& random) { return static_cast<double>(random()) / 4294967296.0; }
double within(std::mt19937& random, double low, double high) {
  return low + (high - low) * unit(random);
}
V direction(std::mt19937& random) {
  V v;
  do {
    for (int k = 0; k < 3; ++k) v[k] = within(random, -1, 1);
  } while (v.norm() < 0.1 || v.norm() > 1);
  return v.normalized();
}

/// Moves a block on an incline of `share` times the angle of friction; returns the way of the last
/// `seconds`, after one second to settle.
template <class S>
S way_on_incline(const Vector3<S>& half, double mu, double share, double heading, double seconds,
                 const V& up = V(0, 0, 1)) {
  const double angle = std::atan(mu) * share;
  // The frame of the incline: z is its normal.
  const M R = rotation_exp<double>(shortest_rotation<double>(V(0, 0, 1), up));
  const V g = 9.81 * (R * V(std::sin(angle) * std::cos(heading),
                            std::sin(angle) * std::sin(heading), -std::cos(angle)));
  Floor<S> floor(S(mu), g.template cast<S>(), up.template cast<S>());
  RigidBodySetup<S> block =
      at<S>(box<S>(half[0], half[1], half[2]), (R * V(0, 0, double(half[2]))).template cast<S>());
  block.friction = S(mu);
  block.motion.R_world_body = R.template cast<S>();
  floor.add(block);
  Vector3<S> start;
  for (int i = 0; i < int(60 * (seconds + 1)); ++i) {
    if (i == 60) start = floor.bodies.motion(0).position;
    const RigidStepReport<S> report = floor.bodies.step(S(1) / S(60));
    REQUIRE(report.status == StepStatus::Converged);
  }
  return (floor.bodies.motion(0).position - start).norm();
}

}  // namespace

TEST_CASE("a block on an incline slips at the angle of friction, and below it does not creep") {
  const double seconds = trials(10, 60, 2);
  std::mt19937 random(7);
  for (const double mu : {0.2, 0.5, 0.8}) {
    const double heading = within(random, 0, 6);
    const V up = direction(random);
    for (const V& half : {V(0.5, 0.5, 0.5), V(0.5, 0.3, 0.1), V(0.05, 0.08, 0.04)}) {
      CAPTURE(mu, half[0]);
      CHECK(way_on_incline<double>(half, mu, 0.995, heading, seconds) < 1e-4);
      CHECK(way_on_incline<double>(half, mu, 1.005, heading, 10) > 0.1);
      CHECK(way_on_incline<double>(half, mu, 0.995, heading, seconds, up) < 1e-4);
      CHECK(way_on_incline<double>(half, mu, 1.005, heading, 10, up) > 0.1);
    }
  }
}

TEST_CASE("in float the block holds and slips, too") {
  for (const double mu : {0.3, 0.7}) {
    CHECK(way_on_incline<float>(Vector3<float>(0.5f, 0.4f, 0.3f), mu, 0.99, 1, trials(10, 60, 2)) <
          1e-4f);
    CHECK(way_on_incline<float>(Vector3<float>(0.5f, 0.4f, 0.3f), mu, 1.01, 1, 10) > 0.1f);
  }
}

TEST_CASE("stacks of boxes stand") {
  for (const double h : {1.0 / 60, 1.0 / 30, 1.0 / 240}) {
    for (const int kind : {0, 1, 2}) {
      CAPTURE(h, kind);
      Floor<double> floor(0.5);
      std::mt19937 random(11);
      double z = 0;
      for (int i = 0; i < 5; ++i) {
        const double half = kind == 2 ? within(random, 0.3, 0.6) : 0.5;
        RigidBodySetup<double> setup = at<double>(box(half, half, half), V(0, 0, z + half));
        if (kind > 0)
          setup.motion.R_world_body = rotation_exp<double>(V(0, 0, within(random, -3, 3)));
        z += 2 * half;
        floor.add(setup);
      }
      std::vector<V> start;
      for (int i = 0; i < 5; ++i) start.push_back(floor.bodies.motion(i).position);
      double residual = 0;
      const int steps = static_cast<int>(trials(6, 60, 1) / h);
      for (int k = 0; k < steps; ++k) {
        const RigidStepReport<double> report = floor.bodies.step(h);
        REQUIRE(report.status == StepStatus::Converged);
        residual = std::max(residual, report.velocity_residual);
      }
      for (int i = 0; i < 5; ++i)
        CHECK((floor.bodies.motion(i).position - start[static_cast<std::size_t>(i)]).norm() < 1e-3);
      CHECK(residual < 1e-6);
      for (const RigidContact<double>& c : floor.bodies.contacts()) CHECK(c.gap > -5e-4);
    }
  }
}

TEST_CASE("a box of a metre sinks by less than 0.1 mm") {
  Floor<double> floor(0.5);
  floor.add(at<double>(cube(), V(0, 0, 0.5)));
  for (int k = 0; k < 120; ++k) REQUIRE(floor.bodies.step(1.0 / 30).advanced);
  CHECK(std::abs(floor.bodies.motion(0).position[2] - 0.5) < 1e-4);
  CHECK(floor.bodies.motion(0).velocity.norm() < 1e-9);
}

TEST_CASE("mass ratios of 1e5") {
  for (const bool heavy_on_top : {true, false}) {
    CAPTURE(heavy_on_top);
    Floor<double> floor(0.5);
    RigidBodySetup<double> lower = at<double>(cube(), V(0, 0, 0.5));
    RigidBodySetup<double> upper = at<double>(cube(), V(0, 0, 1.5));
    lower.mass = heavy_on_top ? 1 : 1e5;
    upper.mass = heavy_on_top ? 1e5 : 1;
    floor.add(lower);
    floor.add(upper);
    for (int k = 0; k < 600; ++k) REQUIRE(floor.bodies.step(1.0 / 60).advanced);
    CHECK(all_sane(floor.bodies));
    CHECK((floor.bodies.motion(0).position - V(0, 0, 0.5)).norm() < 1e-3);
    CHECK((floor.bodies.motion(1).position - V(0, 0, 1.5)).norm() < 1e-3);
    CHECK(floor.bodies.motion(1).velocity.norm() < 1e-6);
  }
}

TEST_CASE("bounces: the speed after is the restitution times that before") {
  for (const double e : {0.0, 0.3, 0.8, 1.0}) {
    Floor<double> floor(0.5);
    RigidBodySetup<double> setup = at<double>(ball(0.1), V(0, 0, 1));
    setup.restitution = e;
    floor.add(setup);
    double before = 0, after = 0;
    for (int k = 0; k < 240 && after == 0; ++k) {
      const double v = floor.bodies.motion(0).velocity[2];
      REQUIRE(floor.bodies.step(1.0 / 240).advanced);
      const double now = floor.bodies.motion(0).velocity[2];
      if (now > v + 0.1) {
        before = v - 9.81 / 240;
        after = now + 1e-30;
      }
    }
    CAPTURE(e, before, after);
    REQUIRE(before < -3);
    // A contact closes when the gap is closed, so that the first step may end on the surface.
    CHECK(std::abs(after + e * before) < 0.01 * std::abs(before) + (e == 0 ? 4 : 0));
  }
}

TEST_CASE("a box slides as far as its speed and friction say") {
  const double mu = 0.4, v = 3, h = 1.0 / 240;
  Floor<double> floor(mu);
  RigidBodySetup<double> setup = at<double>(box(0.5, 0.5, 0.1), V(0, 0, 0.1));
  setup.friction = mu;
  setup.motion.velocity = V(v, 0, 0);
  floor.add(setup);
  for (int k = 0; k < 480; ++k) REQUIRE(floor.bodies.step(h).advanced);
  // Steps of explicit positions take half a step of the first speed less.
  const double expected = v * v / (2 * mu * 9.81) - 0.5 * h * v;
  CHECK(floor.bodies.motion(0).position[0] == Approx(expected).epsilon(0.005));
}

TEST_CASE("a ball that slides ends up rolling at 5/7 of its speed, and goes on rolling") {
  Floor<double> floor(0.3);
  RigidBodySetup<double> setup = at<double>(ball(0.2), V(0, 0, 0.2));
  setup.friction = 0.3;
  setup.motion.velocity = V(2, 0, 0);
  floor.add(setup);
  for (int k = 0; k < 600; ++k) REQUIRE(floor.bodies.step(1.0 / 120).advanced);
  const RigidMotion<double>& m = floor.bodies.motion(0);
  CHECK(m.velocity[0] == Approx(2 * 5.0 / 7).epsilon(1e-3));
  CHECK(m.angular_velocity[1] == Approx(m.velocity[0] / 0.2).epsilon(1e-3));
}

TEST_CASE("a ball rolls down an incline at 5/7 of g sin") {
  const double angle = 0.2;
  Floor<double> floor(0.5, 9.81 * V(std::sin(angle), 0, -std::cos(angle)));
  floor.add(at<double>(ball(0.2), V(0, 0, 0.2)));
  for (int k = 0; k < 240; ++k) REQUIRE(floor.bodies.step(1.0 / 120).advanced);
  CHECK(floor.bodies.motion(0).velocity[0] ==
        Approx(2 * 5.0 / 7 * 9.81 * std::sin(angle)).epsilon(2e-3));
}

TEST_CASE("a ball joint swings like a pendulum") {
  RigidBodies<double> w;
  const double r = 0.05, length = 1, angle = 0.05;
  const int bob =
      w.add(at<double>(ball(r), length * V(std::sin(angle), 0, -std::cos(angle)))).value();
  RigidJointSetup<double> joint;
  joint.a = bob;
  w.add_joint(joint).value();
  const double I = 0.4 * r * r + length * length, h = 1.0 / 240;  // about the pivot, for 1 kg
  const double period = 2 * std::acos(-1.0) * std::sqrt(I / (9.81 * length));
  double last = 1, first_crossing = 0, crossing = 0;
  int crossings = 0;
  for (int k = 1; k < 240 * 12; ++k) {
    REQUIRE(w.step(h).advanced);
    const double x = w.motion(bob).position[0];
    if (last < 0 && x >= 0) {
      crossing = h * (k - x / (x - last));
      if (crossings++ == 0) first_crossing = crossing;
    }
    last = x;
    CHECK(std::abs(w.motion(bob).position.norm() - length) < 1e-4);
  }
  REQUIRE(crossings >= 5);
  CHECK((crossing - first_crossing) / (crossings - 1) == Approx(period).epsilon(2e-3));
}

TEST_CASE("hinges and fixed joints hold, chains hang") {
  RigidBodies<double> w;
  for (int i = 0; i < 6; ++i) {
    RigidBodySetup<double> link = at<double>(box(0.1, 0.1, 0.2), V(0.4 * i + 0.2, 0, 0));
    link.groups.collides_with = 0;
    w.add(link).value();
  }
  for (int i = 0; i < 6; ++i) {
    RigidJointSetup<double> joint;
    joint.kind = i == 2 ? JointKind::Fixed : (i % 2 == 0 ? JointKind::Hinge : JointKind::Ball);
    joint.axis = V(0, 2, 0);
    joint.a = i;
    joint.b = i - 1;
    joint.anchor = V(0.4 * i, 0, 0);
    w.add_joint(joint).value();
  }
  const M R = w.motion(1).R_world_body.transpose() * w.motion(2).R_world_body;
  for (int k = 0; k < 600; ++k) {
    const RigidStepReport<double> report = w.step(1.0 / 120);
    REQUIRE(report.status == StepStatus::Converged);
    REQUIRE(report.contacts == 0);
  }
  CHECK((w.motion(1).R_world_body.transpose() * w.motion(2).R_world_body - R).norm() < 5e-3);
  // The hinge to the world keeps its axis.
  CHECK((w.motion(0).R_world_body * V(0, 1, 0) - V(0, 1, 0)).norm() < 2e-3);
  for (int i = 1; i < 6; ++i) {
    const V a = w.motion(i).position + w.motion(i).R_world_body * V(-0.2, 0, 0);
    const V b = w.motion(i - 1).position + w.motion(i - 1).R_world_body * V(0.2, 0, 0);
    CHECK((a - b).norm() < 5e-3);
  }
}

TEST_CASE("a soft joint hangs as its compliance says") {
  RigidBodies<double> w;
  RigidBodySetup<double> setup = at<double>(ball(0.1), V(0, 0, 0));
  setup.mass = 2;
  w.add(setup).value();
  RigidJointSetup<double> joint;
  joint.compliance = 1e-3;
  w.add_joint(joint).value();
  for (int k = 0; k < 600; ++k) REQUIRE(w.step(1.0 / 60).advanced);
  CHECK(w.motion(0).position[2] == Approx(-2 * 9.81 * 1e-3).epsilon(1e-4));
}

TEST_CASE("a jointed pair rests on the floor, its contacts in the same solve") {
  Floor<double> floor(0.5);
  floor.add(at<double>(box(0.2, 0.2, 0.2), V(0, 0, 0.2)));
  floor.add(at<double>(box(0.2, 0.2, 0.2), V(0.6, 0, 0.2)));
  RigidJointSetup<double> joint;
  joint.kind = JointKind::Fixed;
  joint.a = 0;
  joint.b = 1;
  joint.anchor = V(0.3, 0, 0.2);
  floor.bodies.add_joint(joint).value();
  for (int k = 0; k < 300; ++k)
    REQUIRE(floor.bodies.step(1.0 / 60).status == StepStatus::Converged);
  CHECK(floor.bodies.motion(0).velocity.norm() < 1e-8);
  CHECK(floor.bodies.motion(1).position[2] == Approx(0.2).margin(1e-4));
}

TEST_CASE("bodies fall asleep, stay as they are to the bit, and wake when touched") {
  RigidBodies<double> w;
  const PlaneCollider<double> plane = PlaneCollider<double>::create(V(0, 0, 0), V(0, 0, 1)).value();
  w.add_obstacle(ColliderRef<double>(plane)).value();
  for (int i = 0; i < 3; ++i) w.add(at<double>(cube(), V(0, 0, 0.5 + i))).value();
  w.add(at<double>(cube(), V(5, 0, 0.5))).value();
  int slept = 0;
  for (int k = 0; k < 120; ++k) {
    REQUIRE(w.step(1.0 / 60).advanced);
    for (const RigidEvent& e : w.events()) slept += e.kind == RigidEventKind::Slept;
  }
  CHECK(slept == 4);
  REQUIRE((w.asleep(0) && w.asleep(1) && w.asleep(2) && w.asleep(3)));
  const RigidBodiesState<double> before = w.state();
  for (int k = 0; k < 100; ++k) {
    const RigidStepReport<double> report = w.step(1.0 / 60);
    CHECK(report.islands == 0);
    CHECK(w.events().empty());
  }
  for (std::size_t i = 0; i < 4; ++i)
    CHECK(std::memcmp(&before.bodies[i].motion, &w.state().bodies[i].motion,
                      sizeof(RigidMotion<double>)) == 0);
  CHECK(w.contacts().size() == before.contacts.size());
  // A ball that falls on the stack wakes it, and not the other box.
  w.add(at<double>(ball(0.3), V(0, 0, 4))).value();
  for (int k = 0; k < 40; ++k) REQUIRE(w.step(1.0 / 60).advanced);
  CHECK((!w.asleep(0) && !w.asleep(2) && w.asleep(3)));
  CHECK(w.apply_impulse(3, V(1000, 0, 0), V(5, 0, 0.5)));
  CHECK(!w.asleep(3));
}

TEST_CASE("a moving platform carries and wakes; what it leaves falls") {
  RigidBodies<double> w;
  RigidBodySetup<double> platform = at<double>(box(1.0, 1.0, 0.1), V(0, 0, -0.1));
  platform.kind = BodyKind::Kinematic;
  const int p = w.add(platform).value();
  const int b = w.add(at<double>(box(0.2, 0.2, 0.2), V(0, 0, 0.2))).value();
  for (int k = 0; k < 120; ++k) REQUIRE(w.step(1.0 / 60).advanced);
  CHECK(w.asleep(b));
  RigidMotion<double> m = w.motion(p);
  m.velocity = V(0.5, 0, 0.2);
  CHECK(w.set_motion(p, m).empty());
  for (int k = 0; k < 60; ++k) REQUIRE(w.step(1.0 / 60).advanced);
  CHECK(!w.asleep(b));
  CHECK((w.motion(b).velocity - V(0.5, 0, 0.2)).norm() < 1e-3);
  CHECK((w.motion(b).position - w.motion(p).position - V(0, 0, 0.3)).norm() < 0.05);
  m = w.motion(p);
  m.position[0] += 10;
  m.velocity.setZero();
  CHECK(w.set_motion(p, m).empty());
  for (int k = 0; k < 60; ++k) REQUIRE(w.step(1.0 / 60).advanced);
  CHECK(w.motion(b).velocity[2] < -5);
}

TEST_CASE(
    "a pinned body that is put into a sleeping one wakes it, and a restored sleeper sleeps on") {
  Floor<double> floor(0.5);
  RigidBodiesSettings<double> settings;
  RigidBodies<double> w(settings);
  w.add_obstacle(ColliderRef<double>(floor.plane)).value();
  const int b = w.add(at<double>(cube(), V(0, 0, 0.5))).value();
  RigidBodySetup<double> post = at<double>(cube(), V(9, 0, 0.5));
  post.kind = BodyKind::Pinned;
  const int p = w.add(post).value();
  for (int k = 0; k < 60; ++k) REQUIRE(w.step(1.0 / 60).advanced);
  REQUIRE(w.asleep(b));
  const RigidBodiesState<double> asleep = w.state();
  RigidMotion<double> m = w.motion(p);
  m.position = V(0.9, 0, 0.5);
  REQUIRE(w.set_motion(p, m).empty());
  for (int k = 0; k < 30; ++k) REQUIRE(w.step(1.0 / 60).advanced);
  CHECK(w.motion(b).position[0] < -0.05);
  REQUIRE(w.restore(asleep));
  for (int k = 0; k < 10; ++k) REQUIRE(w.step(1.0 / 60).advanced);
  CHECK(w.asleep(b));
  CHECK(w.motion(b).position == asleep.bodies[0].motion.position);
  CHECK(w.apply_impulse(b, V(1, 0, 0), V(0, 0, 0.5)));
  REQUIRE(w.events().size() == 1);
  CHECK(w.events()[0].kind == RigidEventKind::Woke);
  REQUIRE(w.step(1.0 / 60).advanced);
  CHECK(w.events().size() == 1);
  REQUIRE(w.step(1.0 / 60).advanced);
  CHECK(w.events().empty());
}

TEST_CASE("events tell when bodies begin and end to touch") {
  Floor<double> floor(0.5);
  RigidBodySetup<double> setup = at<double>(ball(0.1), V(0, 0, 0.3));
  setup.restitution = 0.9;
  floor.add(setup);
  int began = 0, ended = 0;
  for (int k = 0; k < 60; ++k) {
    REQUIRE(floor.bodies.step(1.0 / 120).advanced);
    for (const RigidEvent& e : floor.bodies.events()) {
      CHECK(e.a == 0);
      CHECK(e.b == -1);
      began += e.kind == RigidEventKind::ContactBegan;
      ended += e.kind == RigidEventKind::ContactEnded;
    }
  }
  CHECK(began == 1);
  CHECK(ended == 1);
}

TEST_CASE("groups that do not look for each other pass through") {
  Floor<double> floor(0.5);
  RigidBodySetup<double> setup = at<double>(cube(), V(0, 0, 0.5));
  setup.groups = {2, 1};
  floor.add(setup);
  setup.motion.position[2] = 1.2;
  floor.add(setup);
  for (int k = 0; k < 120; ++k) REQUIRE(floor.bodies.step(1.0 / 60).advanced);
  CHECK(floor.bodies.motion(0).position[2] == Approx(0.5).margin(1e-3));
  CHECK(floor.bodies.motion(1).position[2] == Approx(0.5).margin(1e-3));
}

TEST_CASE("fast small bodies do not pass thin ones") {
  for (const double speed : {50.0, 300.0, 2000.0}) {
    for (const bool pinned : {true, false}) {
      RigidBodies<double> w;
      RigidBodySetup<double> wall = at<double>(box(0.01, 2.0, 2.0), V(0, 0, 0));
      wall.kind = pinned ? BodyKind::Pinned : BodyKind::Free;
      wall.mass = 1000;
      w.add(wall).value();
      for (const int kind : {0, 1}) {
        RigidBodySetup<double> bullet =
            at<double>(kind == 0 ? ball(0.02) : box(0.02, 0.03, 0.02), V(-1, 0.3 * kind, 0.5));
        bullet.motion.velocity = V(speed, 0, 0);
        bullet.mass = 0.01;
        w.add(bullet).value();
      }
      for (int k = 0; k < 60; ++k) REQUIRE(w.step(1.0 / 60).advanced);
      CAPTURE(speed, pinned);
      CHECK(w.motion(1).position[0] < w.motion(0).position[0]);
      CHECK(w.motion(2).position[0] < w.motion(0).position[0]);
    }
  }
}

TEST_CASE("a deep overlap is pushed out at a bounded speed") {
  RigidBodiesSettings<double> settings;
  settings.gravity.setZero();
  settings.push_speed = 0.5;
  RigidBodies<double> w(settings);
  w.add(at<double>(cube(), V(0, 0, 0))).value();
  w.add(at<double>(cube(), V(0.3, 0.1, 0.05))).value();
  for (int k = 0; k < 240; ++k) {
    REQUIRE(w.step(1.0 / 60).advanced);
    CHECK((w.motion(0).velocity - w.motion(1).velocity).norm() < 0.55);
  }
  CHECK((w.motion(0).position - w.motion(1).position).cwiseAbs().maxCoeff() > 0.99);
}

TEST_CASE("a long rod that slides on much friction stays finite") {
  for (const double mu : {1.0, 3.0}) {
    Floor<double> floor(mu);
    RigidBodySetup<double> rod = at<double>(box(1.0, 0.01, 0.01), V(0, 0, 0.8));
    rod.friction = mu;
    rod.motion.R_world_body = rotation_exp<double>(V(0, -0.9, 0));
    rod.motion.velocity = V(10, 0, 0);
    floor.add(rod);
    for (int k = 0; k < 600; ++k) REQUIRE(floor.bodies.step(1.0 / 60).advanced);
    CHECK(all_sane(floor.bodies));
    CHECK(floor.bodies.motion(0).velocity.norm() < 20);
    CHECK(floor.bodies.motion(0).position[2] > 0);
  }
}

TEST_CASE("without gravity, momentum and angular momentum stay") {
  std::mt19937 random(3);
  RigidBodiesSettings<double> settings;
  settings.gravity.setZero();
  settings.sleep_time = 0;
  RigidBodies<double> w(settings);
  for (int i = 0; i < 12; ++i) {
    RigidBodySetup<double> setup = at<double>(
        i % 3 == 0
            ? ball(0.3)
            : (i % 3 == 1 ? box(0.3, 0.2, 0.4) : ConvexShape<double>::capsule(0.3, 0.2).value()),
        V(i % 3, (i / 3) % 2, i / 6));
    setup.motion.velocity = -2 * setup.motion.position + direction(random);
    setup.motion.angular_velocity = 3 * direction(random);
    setup.motion.R_world_body = rotation_exp<double>(2 * direction(random));
    setup.restitution = 0.5;
    w.add(setup).value();
  }
  const auto momenta = [&](V& p, V& L) {
    p.setZero();
    L.setZero();
    for (int i = 0; i < w.body_count(); ++i) {
      const RigidMotion<double>& m = w.motion(i);
      const V mv = w.mass(i) * m.velocity;
      p += mv;
      L += m.position.cross(mv) +
           m.R_world_body * (w.inertia(i) * (m.R_world_body.transpose() * m.angular_velocity));
    }
  };
  V p0, L0, p, L;
  momenta(p0, L0);
  double summed = 0;
  for (int k = 0; k < 240; ++k) {
    REQUIRE(w.step(1.0 / 120).advanced);
    for (const RigidContact<double>& c : w.contacts()) summed += c.sample.impulse.norm();
  }
  momenta(p, L);
  REQUIRE(summed > 1);
  CHECK((p - p0).norm() < 1e-9 * summed);
  CHECK((L - L0).norm() < 1e-9 * summed);
}

namespace {

/// Bodies of all shapes that fall into a corner of a floor and two walls.
struct Pile {
  explicit Pile(unsigned seed, int count, double friction = 0.5) : random(seed) {
    for (const V& n : {V(0, 0, 1), V(1, 0, 0), V(0, 1, 0), V(-1, 0, 0), V(0, -1, 0)}) {
      const V point = -1.5 * n + V(0, 0, 1.5 * n[2]);
      planes.push_back(PlaneCollider<double>::create(point, n, {friction, 0}).value());
    }
    RigidBodiesSettings<double> settings;
    settings.sleep_time = 0;
    bodies = RigidBodies<double>(settings);
    for (const PlaneCollider<double>& p : planes)
      bodies.add_obstacle(ColliderRef<double>(p)).value();
    for (int i = 0; i < count; ++i) {
      RigidBodySetup<double> setup =
          at<double>(shape(i), V(i % 3 - 1 + within(random, -0.1, 0.1),
                                 (i / 3) % 3 - 1 + within(random, -0.1, 0.1), 0.5 + i / 9 * 1.1));
      setup.friction = friction;
      setup.motion.R_world_body = rotation_exp<double>(3 * unit(random) * direction(random));
      setup.motion.velocity = direction(random);
      setup.motion.angular_velocity = direction(random);
      bodies.add(setup).value();
    }
  }
  ConvexShape<double> shape(int i) {
    const double a = within(random, 0.15, 0.3), b = within(random, 0.15, 0.3);
    if (i % 4 == 0) return ball(a);
    if (i % 4 == 1) return box(a, b, within(random, 0.15, 0.3));
    if (i % 4 == 2) return ConvexShape<double>::capsule(a, 0.7 * b).value();
    Points<double> x(3, 10);
    for (int k = 0; k < 10; ++k) x.col(k) = 0.35 * direction(random);
    return ConvexShape<double>::hull(x).value();
  }
  std::mt19937 random;
  std::vector<PlaneCollider<double>> planes;
  RigidBodies<double> bodies;
};

}  // namespace

TEST_CASE("in random piles, energy does not grow") {
  for (int seed = 0; seed < trials(6, 60, 1); ++seed) {
    CAPTURE(seed);
    Pile pile(static_cast<unsigned>(seed), 12 + 6 * (seed % 3), 0.2 + 0.2 * (seed % 4));
    RigidBodies<double>& w = pile.bodies;
    double last = 1e30, scale = 0;
    for (int k = 0; k < 240; ++k) {
      const RigidStepReport<double> report = w.step(1.0 / 120);
      REQUIRE(report.advanced);
      const double now = report.kinetic + report.potential;
      if (k == 0) scale = now;
      // What pushes overlaps out may add to it; friction never does.
      double pushed = 0, friction = 0;
      for (const RigidContact<double>& c : w.contacts()) {
        const RigidMotion<double>& A = w.motion(c.a);
        V u = A.velocity + A.angular_velocity.cross(c.position - A.position);
        if (c.b >= 0) {
          const RigidMotion<double>& B = w.motion(c.b);
          u -= B.velocity + B.angular_velocity.cross(c.position - B.position);
        }
        const V n = c.sample.normal, p = c.sample.impulse;
        if (c.sample.state == ContactState::Slip)
          friction += (p - p.dot(n) * n).dot(u - u.dot(n) * n);
        pushed += std::max(0.0, p.dot(n) * u.dot(n));
      }
      CHECK(friction < 1e-4 * scale);
      CHECK(now < last + pushed + 1e-6 * scale);
      last = now;
    }
    CHECK(all_sane(w));
  }
}

TEST_CASE("large piles come to rest by sweeps") {
  Pile pile(5, trials(60, 100, 12));
  RigidStepReport<double> report;
  for (int k = 0; k < 600; ++k) {
    report = pile.bodies.step(1.0 / 60);
    REQUIRE(report.advanced);
  }
  CHECK(report.kinetic < 1e-3 * report.potential);
  for (const RigidContact<double>& c : pile.bodies.contacts()) CHECK(c.gap > -0.02);
  for (int i = 0; i < pile.bodies.body_count(); ++i) CHECK(pile.bodies.motion(i).position[2] > 0);
}

TEST_CASE("the same bits with any executor, and again from a state") {
  const int n = trials(24, 24, 12);
  Pile serial(9, n), threads(9, n), backward(9, n);
  clothctl_test::ThreadExecutor team{3};
  clothctl_test::BackwardExecutor last_first;
  RigidBodiesState<double> middle;
  for (int k = 0; k < 120; ++k) {
    if (k == 60) middle = serial.bodies.state();
    REQUIRE(serial.bodies.step(1.0 / 60).advanced);
    REQUIRE(threads.bodies.step(1.0 / 60, ExecutorRef(team)).advanced);
    REQUIRE(backward.bodies.step(1.0 / 60, ExecutorRef(last_first)).advanced);
  }
  const auto same = [&](const RigidBodies<double>& other) {
    for (int i = 0; i < n; ++i) {
      if (std::memcmp(&serial.bodies.motion(i), &other.motion(i), sizeof(RigidMotion<double>)) != 0)
        return false;
    }
    return true;
  };
  CHECK(same(threads.bodies));
  CHECK(same(backward.bodies));
  REQUIRE(threads.bodies.restore(middle));
  for (int k = 60; k < 120; ++k) REQUIRE(threads.bodies.step(1.0 / 60).advanced);
  CHECK(same(threads.bodies));
}

TEST_CASE("a step does not allocate") {
  if (!allocation_counting_works()) return;
  Pile pile(2, trials(27, 27, 9));
  RigidBodies<double>& w = pile.bodies;
  w.reserve(2000);
  const long before = allocations();
  bool advanced = true;
  for (int k = 0; k < 200; ++k) advanced = advanced && w.step(1.0 / 60).advanced;
  CHECK(allocations() == before);
  CHECK(advanced);
}

TEST_CASE("set-up refuses what makes no sense") {
  RigidBodies<double> w;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  RigidBodySetup<double> good = at<double>(cube(), V(0, 0, 0));
  const auto refuses = [&](const RigidBodySetup<double>& setup, const char* word) {
    const Result<int> made = w.add(setup);
    REQUIRE(!made);
    CAPTURE(made.error());
    CHECK(made.error().find(word) != std::string::npos);
    CHECK(made.error().find("body 0") == 0);
    CHECK(w.body_count() == 0);
  };
  RigidBodySetup<double> bad = good;
  bad.mass = -1;
  refuses(bad, "mass");
  bad.mass = nan;
  refuses(bad, "mass");
  bad = good;
  bad.density = 0;
  refuses(bad, "density");
  bad = good;
  bad.motion.position[1] = nan;
  refuses(bad, "position");
  bad = good;
  bad.motion.R_world_body *= 2;
  refuses(bad, "orientation");
  bad = good;
  bad.friction = -0.1;
  refuses(bad, "friction");
  bad = good;
  bad.restitution = 1.5;
  refuses(bad, "restitution");
  CHECK(w.add(good).value() == 0);
  RigidJointSetup<double> joint;
  joint.a = 1;
  CHECK(!w.add_joint(joint));
  joint.a = 0;
  joint.b = 0;
  CHECK(!w.add_joint(joint));
  joint.b = -1;
  joint.compliance = nan;
  CHECK(!w.add_joint(joint));
  joint.compliance = 0;
  joint.kind = JointKind::Hinge;
  joint.axis.setZero();
  CHECK(!w.add_joint(joint));
  CHECK(w.step(0).status == StepStatus::InvalidInput);
  CHECK(w.step(nan).status == StepStatus::InvalidInput);
  CHECK(!w.step(-1).advanced);
  CHECK(!w.apply_impulse(0, V(nan, 0, 0), V(0, 0, 0)));
  RigidMotion<double> motion;
  motion.velocity[0] = nan;
  CHECK(!w.set_motion(0, motion).empty());
  CHECK(w.set_motion(99, {}) == "no body 99 (there are " + std::to_string(w.body_count()) + ")");
  CHECK(w.set_motion(-1, {}).find("no body -1 ") == 0);
  RigidBodiesSettings<double> settings;
  settings.relaxation = 0;
  RigidBodies<double> invalid(settings);
  CHECK(invalid.step(0.01).status == StepStatus::InvalidInput);
}

TEST_CASE("random worlds, some of them absurd, stay finite") {
  for (int seed = 0; seed < trials(200, 100000, 20); ++seed) {
    std::mt19937 random(static_cast<unsigned>(seed));
    RigidBodiesSettings<double> settings;
    const bool absurd = seed % 3 == 0;
    if (absurd) settings.gravity = std::pow(10, within(random, -3, 6)) * direction(random);
    if (seed % 5 == 0) settings.newton_contacts = 4;
    RigidBodies<double> w(settings);
    const PlaneCollider<double> plane =
        PlaneCollider<double>::create(V(0, 0, 0), direction(random)).value();
    w.add_obstacle(ColliderRef<double>(plane), unit(random)).value();
    const int count = 1 + static_cast<int>(random() % 8);
    for (int i = 0; i < count; ++i) {
      const double size = absurd ? std::pow(10, within(random, -3, 2)) : within(random, 0.1, 0.5);
      Points<double> x(3, 12);
      for (int k = 0; k < 12; ++k) x.col(k) = size * direction(random);
      const int kind = static_cast<int>(random() % 4);
      const ConvexShape<double> shape =
          kind == 0   ? ball(size)
          : kind == 1 ? box(size, size * within(random, 0.1, 1), size)
          : kind == 2 ? ConvexShape<double>::capsule(size, size * within(random, 0.1, 1)).value()
                      : ConvexShape<double>::hull(x).value();
      RigidBodySetup<double> setup = at<double>(shape, within(random, 0, 2) * direction(random));
      setup.motion.R_world_body = rotation_exp<double>(3 * direction(random));
      const double fast = absurd ? std::pow(10, within(random, -1, 8)) : 3;
      setup.motion.velocity = fast * direction(random);
      setup.motion.angular_velocity = fast * direction(random);
      if (absurd) setup.mass = std::pow(10, within(random, -6, 9));
      setup.friction = absurd ? std::pow(10, within(random, -2, 4)) : unit(random);
      setup.restitution = unit(random);
      setup.kind = random() % 6 == 0 ? BodyKind::Kinematic : BodyKind::Free;
      w.add(setup).value();
    }
    if (count > 1 && random() % 2 == 0) {
      RigidJointSetup<double> joint;
      joint.kind = static_cast<JointKind>(random() % 3);
      joint.a = 0;
      joint.b = random() % 2 == 0 ? 1 : -1;
      joint.anchor = within(random, 0, absurd ? 100 : 1) * direction(random);
      static_cast<void>(w.add_joint(joint));
    }
    const double h = absurd ? std::pow(10, within(random, -5, 1)) : 1.0 / 60;
    bool sane = true;
    for (int k = 0; k < 30; ++k) {
      const RigidStepReport<double> report = w.step(h);
      sane =
          sane && all_sane(w) && (report.advanced || report.status == StepStatus::NumericalFailure);
    }
    CAPTURE(seed);
    CHECK(sane);
  }
}
