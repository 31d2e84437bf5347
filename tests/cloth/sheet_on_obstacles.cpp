// Sheets of both families on obstacles: laws of contact and friction that hold for any model.

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/contact/obstacle_guard.hpp"
#include "support/allocations.hpp"
#include "support/meshes.hpp"
#include "support/sheet_on_obstacles.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

constexpr double kGravity = 9.81;
using Implicit = MassSpring<double>;
using Xpbd = PositionBased<double>;

template <class Model>
Model make_model(const SpringNetwork<double>& network);

template <>
Implicit make_model<Implicit>(const SpringNetwork<double>& network) {
  return Implicit::create(network).value();
}

template <>
Xpbd make_model<Xpbd>(const SpringNetwork<double>& network) {
  return Xpbd::create(network).value();
}

template <class Model>
SheetOnObstacles<Model> make_rig(int n, double z = 0) {
  return SheetOnObstacles<Model>(make_model<Model>(level_sheet<double>(n, z)));
}

/// Lays the sheet on the slope, a thickness above it.
template <class Rig>
void lay_on_slope(Rig& rig, double angle) {
  const Vector3<double> down(std::cos(angle), 0, -std::sin(angle)), across(0, 1, 0),
      up(std::sin(angle), 0, std::cos(angle));
  const Points<double> flat = rig.model.network().rest_positions;
  for (Index i = 0; i < flat.cols(); ++i) {
    rig.state.positions.col(i) =
        flat(0, i) * down + flat(1, i) * across + rig.contacts.settings().thickness * up;
  }
}

}  // namespace

TEMPLATE_TEST_CASE("a sheet on a slope slips at the angle of friction, and below it stays",
                   "[cloth][obstacles]", Implicit, Xpbd) {
  const double angle = 0.3, h = 1.0 / 60;
  const Vector3<double> down(std::cos(angle), 0, -std::sin(angle));
  {
    auto rig = make_rig<TestType>(9);
    const auto plane = slope<double>(angle, 1.005 * std::tan(angle));
    rig.obstacles.emplace_back(plane);
    lay_on_slope(rig, angle);
    const Points<double> start = rig.state.positions;
    for (int i = 0; i < 600; ++i) rig.advance(h);
    // The sheet settles; then it does not creep.
    CHECK((rig.state.positions - start).colwise().norm().maxCoeff() < 2e-3);
    const Points<double> settled = rig.state.positions;
    for (int i = 0; i < trials(600, 3600, 30); ++i) rig.advance(h);
    CHECK((rig.state.positions - settled).colwise().norm().maxCoeff() < 1e-5);
    CHECK(rig.contacts.report().slipping == 0);
  }
  for (const double friction : {0.995, 0.5, 0.0}) {
    auto rig = make_rig<TestType>(9);
    const double mu = friction * std::tan(angle);
    const auto plane = slope<double>(angle, mu);
    rig.obstacles.emplace_back(plane);
    lay_on_slope(rig, angle);
    const double mass = rig.model.network().mass.sum();
    for (int i = 0; i < 30; ++i) rig.advance(h);
    const double before = down.dot(rig.momentum()) / mass;
    for (int i = 0; i < 30; ++i) rig.advance(h);
    const double gained = down.dot(rig.momentum()) / mass - before;
    const double expected = 0.5 * kGravity * (std::sin(angle) - mu * std::cos(angle));
    CAPTURE(friction, gained, expected);
    CHECK(std::abs(gained - expected) < 0.01 * expected + 1e-4);
  }
}

TEMPLATE_TEST_CASE("a sheet receives the momentum that its contacts tell", "[cloth][obstacles]",
                   Implicit, Xpbd) {
  auto rig = make_rig<TestType>(13, 0.12);
  const auto ball = SphereCollider<double>::create(Vector3<double>(0.03, 0.02, 0), 0.1).value();
  const auto floor = slope<double>(0, 0.4);
  rig.obstacles.emplace_back(ball);
  rig.obstacles.emplace_back(floor);
  const double h = 1.0 / 60, mass = rig.model.network().mass.sum();
  double total = 0, worst = 0;
  for (int i = 0; i < 120; ++i) {
    const Vector3<double> before = rig.momentum();
    rig.advance(h);
    const Vector3<double> gravity(0, 0, -kGravity * mass * h);
    total += rig.impulse().norm();
    worst = std::max(worst, (rig.momentum() - before - gravity - rig.impulse()).norm());
  }
  CHECK(total > kGravity * mass);  // it was held up
  CHECK(worst < 1e-9 * total);
}

TEMPLATE_TEST_CASE("a sheet comes to rest a thickness above the floor", "[cloth][obstacles]",
                   Implicit, Xpbd) {
  auto rig = make_rig<TestType>(9, 0.05);
  const auto floor = slope<double>(0, 0.5);
  rig.obstacles.emplace_back(floor);
  for (int i = 0; i < 240; ++i) rig.advance(1.0 / 60);
  const Vector3<double> weight(0, 0, kGravity * rig.model.network().mass.sum() / 60);
  CHECK((rig.state.positions.row(2).array() - 1e-3).abs().maxCoeff() < 2e-6);
  CHECK((rig.impulse() - weight).norm() < 1e-4 * weight.norm());
  CHECK(rig.state.velocities.colwise().norm().maxCoeff() < 1e-4);
  CHECK(rig.contacts.report().closed == 81);
  for (const auto& c : rig.contacts.contacts()) CHECK(c.age > 60);
  if (std::is_same_v<TestType, Implicit>) CHECK(rig.contacts.report().rounds == 1);
}

TEST_CASE("in single precision a sheet that lands and rests needs few rounds",
          "[cloth][obstacles]") {
  using Model = MassSpring<float>;
  SheetOnObstacles<Model> rig(Model::create(level_sheet<float>(9, 0.05)).value());
  const auto floor = slope<float>(0, 0.5);
  rig.obstacles.emplace_back(floor);
  for (int i = 0; i < 240; ++i) {
    rig.advance(1.0 / 60);
    if (i > 120) CHECK(rig.contacts.report().rounds <= 2);
  }
  CHECK((rig.state.positions.row(2).array() - 1e-3f).abs().maxCoeff() < 1e-5f);
  CHECK(rig.state.velocities.colwise().norm().maxCoeff() < 1e-3f);
}

TEST_CASE("a sheet with a limit of stretch lies still on a ball and on a box",
          "[cloth][obstacles]") {
  auto settings = PositionBasedSettings<double>::of(material_preset<double>("cotton").value());
  settings.substeps = 8;
  settings.stretch_limit = 0.02;
  const auto ball =
      SphereCollider<double>::create(Vector3<double>(0, 0, -0.15), 0.15, {0.4, 0}).value();
  const auto box =
      BoxCollider<double>::create(Vector3<double>(0, 0, -0.1), Vector3<double>(0.12, 0.12, 0.1),
                                  Matrix3<double>::Identity(), {0.4, 0})
          .value();
  for (const bool round : {true, false}) {
    CAPTURE(round);
    SheetOnObstacles<Xpbd> rig(Xpbd::create(level_sheet<double>(17, 0.02), settings).value());
    round ? rig.obstacles.emplace_back(ball) : rig.obstacles.emplace_back(box);
    Points<double> before;
    double deepest = 0;
    for (int i = 0; i < 600; ++i) {
      rig.advance(1.0 / 60);
      if (i == 480) before = rig.state.positions;
      if (i > 480) deepest = std::max(deepest, rig.contacts.report().penetration);
    }
    const Points<double> moved = rig.state.positions - before;
    CAPTURE(moved.rowwise().mean().norm(), deepest);
    CHECK(moved.rowwise().mean().norm() < 4e-4);
    CHECK(deepest < 1e-3);
    for (const auto& c : rig.contacts.contacts()) {
      if (c.state != ContactState::Open && c.point.vertex[1] < 0)
        CHECK(moved.col(c.point.vertex[0]).norm() < 1e-3);
    }
  }
}

TEMPLATE_TEST_CASE("friction takes a sheet along with a moving floor", "[cloth][obstacles]",
                   Implicit, Xpbd) {
  auto rig = make_rig<TestType>(9, 1e-3);
  RigidMotion<double> motion;
  motion.velocity = Vector3<double>(0.3, 0, 0);
  auto floor =
      MovingCollider<double, PlaneCollider<double>>::create(slope<double>(0, 0.5), motion, {0.5, 0})
          .value();
  rig.obstacles.emplace_back(floor);
  for (int i = 0; i < 60; ++i) {
    motion.position += motion.velocity / 60;
    rig.advance(1.0 / 60);
    REQUIRE(floor.set_motion(motion).empty());
  }
  const Vector3<double> mean = rig.momentum() / rig.model.network().mass.sum();
  CHECK((mean - motion.velocity).norm() < 1e-3);
}

TEMPLATE_TEST_CASE("with a guard, nothing passes a needle or a thin plate", "[cloth][obstacles]",
                   Implicit, Xpbd) {
  std::mt19937 random(14);
  int through = 0, left = 0;
  for (int trial = 0; trial < trials(12, 1000, 2); ++trial) {
    auto rig = make_rig<TestType>(9, 0.1);
    const double speed = uniform(random, 0.5, 2);
    rig.state.velocities.row(2).setConstant(-speed);
    const double x = uniform(random, -0.05, 0.05), y = uniform(random, -0.05, 0.05);
    // Vertical, below the middle of the sheet: without contact the sheet would fall past its tip.
    const auto needle =
        CapsuleCollider<double>::create(Vector3<double>(x, y, -1), Vector3<double>(x, y, 0.05),
                                        0.0005, {0.5, 0})
            .value();
    const auto plate =
        BoxCollider<double>::create(Vector3<double>(x, 0, -0.45), Vector3<double>(0.0005, 0.3, 0.5))
            .value();
    const bool thin = trial % 2 == 0;
    if (thin)
      rig.obstacles.emplace_back(needle);
    else
      rig.obstacles.emplace_back(plate);
    const SpringNetwork<double>& network = rig.model.network();
    auto guard = ObstacleGuard<double>::create(network.vertex_count(), network.triangles);
    const VectorX<double> free = network.mass.cwiseInverse();
    for (int i = 0; i < 40; ++i) {
      rig.advance(1.0 / 120);
      left += guard
                  .resolve(rig.obstacles, rig.finder.positions(), free, 1.0 / 120, rig.contacts,
                           rig.state)
                  .left;
    }
    // The axis of the needle crosses no triangle below its tip, and no edge the plate's plane.
    const Points<double>& p = rig.state.positions;
    bool below = false;
    for (const std::array<int, 3>& t : network.triangles) {
      const Vector3<double> a = p.col(t[0]), u = p.col(t[1]) - a, v = p.col(t[2]) - a;
      const double area = u[0] * v[1] - u[1] * v[0];
      const double r = ((x - a[0]) * v[1] - (y - a[1]) * v[0]) / area;
      const double q = ((y - a[1]) * u[0] - (x - a[0]) * u[1]) / area;
      if (thin && std::abs(area) > 1e-12 && r >= 0 && q >= 0 && r + q <= 1)
        below = below || a[2] + r * u[2] + q * v[2] < 0.04;
      for (std::size_t k = 0; !thin && k < 3; ++k) {
        const Vector3<double> from = p.col(t[k]), to = p.col(t[(k + 1) % 3]);
        const double share = (x - from[0]) / (to[0] - from[0]);
        if (share >= 0 && share <= 1) below = below || from[2] + share * (to[2] - from[2]) < 0.04;
      }
    }
    through += below ? 1 : 0;
  }
  CHECK(through == 0);
  CHECK(left == 0);
}

TEMPLATE_TEST_CASE("a start inside is pushed out slowly", "[cloth][obstacles]", Implicit, Xpbd) {
  auto rig = make_rig<TestType>(9, -0.02);
  const auto floor = slope<double>(0, 0.5);
  rig.obstacles.emplace_back(floor);
  double fastest = 0;
  for (int i = 0; i < 60; ++i) {
    const double before = rig.state.positions.row(2).mean();
    rig.advance(1.0 / 60);
    fastest = std::max(fastest, (rig.state.positions.row(2).mean() - before) * 60);
  }
  CHECK(fastest < 0.55);
  CHECK(std::abs(rig.state.positions.row(2).minCoeff() - 1e-3) < 2e-5);
  CHECK(rig.state.positions.row(2).maxCoeff() < 2e-3);  // it does not jump
}

TEMPLATE_TEST_CASE("a step with contacts repeats bit for bit and does not allocate",
                   "[cloth][obstacles]", Implicit, Xpbd) {
  Points<double> first;
  for (int run = 0; run < 2; ++run) {
    auto rig = make_rig<TestType>(13, 0.12);
    const auto ball = SphereCollider<double>::create(Vector3<double>(0, 0, 0), 0.1).value();
    rig.obstacles.emplace_back(ball);
    const long before = allocations();
    for (int i = 0; i < 30; ++i) rig.advance(1.0 / 60);
    const long after = allocations();
    if (run == 0 && allocation_counting_works()) CHECK(after == before);
    CHECK(rig.contacts.report().closed > 0);
    if (run == 0) first = rig.state.positions;
    CHECK(rig.state.positions == first);
  }
}

TEMPLATE_TEST_CASE("contacts of another step are refused", "[cloth][obstacles]", Implicit, Xpbd) {
  auto rig = make_rig<TestType>(9, 0);
  const auto floor = slope<double>(0, 0.5);
  rig.obstacles.emplace_back(floor);
  REQUIRE(rig.contacts.update(rig.obstacles, rig.state.velocities, 0.01, rig.finder) ==
          QueryStatus::Answered);
  const ClothState<double> before = rig.state;
  CHECK(rig.model.step(rig.state, rig.input, rig.contacts, 0.02, rig.ws).status ==
        StepStatus::InvalidInput);
  auto bare = rig.model.make_workspace();
  CHECK(rig.model.step(rig.state, rig.input, rig.contacts, 0.01, bare).status ==
        StepStatus::InvalidWorkspace);
  const TestType other = make_model<TestType>(level_sheet<double>(3));
  auto state = other.rest_state();
  auto ws = other.make_workspace(1000);
  CHECK(other.step(state, rig.input, rig.contacts, 0.01, ws).status == StepStatus::InvalidInput);
  CHECK(rig.state == before);
}

TEST_CASE("a few points that hold up a whole sheet do not make it tremble", "[cloth][obstacles]") {
  // Four vertices carry 441: the case that a contact which carries over all of its force from step
  // to step, as in the method of multipliers, does not damp.
  auto rig = make_rig<Implicit>(21, 0.03);
  const auto ball = SphereCollider<double>::create(Vector3<double>::Zero(), 0.02, {0.9, 0}).value();
  rig.obstacles.emplace_back(ball);
  for (int i = 0; i < 300; ++i) rig.advance(1.0 / 60);
  CHECK(rig.contacts.report().closed > 0);
  CHECK(rig.state.velocities.colwise().norm().maxCoeff() < 5e-3);
}
