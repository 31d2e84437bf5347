// Sheets and bodies that are lighter than what they touch.

#include "clothctl/sim/detail/body_coupling.hpp"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "clothctl/sim/world.hpp"
#include "support/allocations.hpp"
#include "support/sheet_on_obstacles.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Implicit = MassSpring<double>;
using Xpbd = PositionBased<double>;
using Vec = Vector3<double>;

template <class Model>
int add_sheet(World<double>& world, int n, double z, const Vec& gravity) {
  std::conditional_t<std::is_same_v<Model, Implicit>, MassSpringSettings<double>,
                     PositionBasedSettings<double>>
      settings;
  settings.gravity = gravity;
  Model model = Model::create(level_sheet<double>(n, z), settings).value();
  ClothState<double> state = model.rest_state();
  return world.add_sheet(std::move(model), std::move(state)).value();
}

RigidBodySetup<double> ball(double mass, const Vec& at, const Vec& velocity) {
  RigidBodySetup<double> setup{ConvexShape<double>::sphere(0.03).value()};
  setup.mass = mass;
  setup.motion.position = at;
  setup.motion.velocity = velocity;
  return setup;
}

}  // namespace

TEMPLATE_TEST_CASE("a light body that falls on a sheet over an obstacle is not thrown back",
                   "[sim]", Implicit, Xpbd) {
  for (const double mass : {1e-4, 2e-3, 0.02, 0.2, 2.0}) {
    if (clothctl_test::kSanitized && mass > 1e-4) continue;
    CAPTURE(mass);
    World<double> world;
    ColliderSurface<double> rough;
    rough.friction = 0.5;
    const auto floor = PlaneCollider<double>::create(Vec::Zero(), Vec::UnitZ()).value();
    (void)world.add_obstacle(floor, {}, rough).value();
    (void)add_sheet<TestType>(world, 13, 1.5e-3, Vec(0, 0, -9.81));
    (void)world.add_body(ball(mass, Vec(0.013, 0.021, 0.3), Vec(0, 0, -3))).value();
    bool landed = false;
    double most = 0, highest = 0;
    const double start = 0.5 * 9 + 9.81 * 0.3;
    for (int i = 0; i < 300; ++i) {
      REQUIRE(world.step(1.0 / 60).advanced);
      const RigidMotion<double>& m = world.bodies().motion(0);
      landed = landed || m.position[2] < 0.04;
      if (!landed) continue;
      most = std::max(most, 0.5 * m.velocity.squaredNorm() + 9.81 * (m.position[2] - 0.03));
      if (240 < i) highest = std::max(highest, m.position[2]);
    }
    CHECK(landed);
    CHECK(most < 0.95 * start);
    CHECK(world.bodies().motion(0).position[2] > 0.02);
    CHECK(highest < 0.06);
  }
}

TEMPLATE_TEST_CASE("a sheet between an obstacle and a light body carries the body", "[sim]",
                   Implicit, Xpbd) {
  for (const double mass : {1e-3, 2e-3, 5e-3}) {
    CAPTURE(mass);
    World<double> world;
    CollisionGroups floor_groups, ball_groups;
    floor_groups.groups = 2;
    ball_groups.collides_with = 1;  // the sheet alone holds the ball
    ColliderSurface<double> surface;
    surface.friction = 0.5;
    const auto floor = PlaneCollider<double>::create(Vec::Zero(), Vec::UnitZ()).value();
    (void)world.add_obstacle(floor, {}, surface, floor_groups).value();
    const int sheet = add_sheet<TestType>(world, 13, 1.5e-3, Vec(0, 0, -9.81));
    RigidBodySetup<double> setup = ball(mass, Vec(0.013, 0.021, 0.05), Vec(0, 0, -0.5));
    setup.groups = ball_groups;
    (void)world.add_body(setup).value();
    double pressed = 0, highest = 0;
    int count = 0;
    for (int i = 0; i < 90; ++i) {
      REQUIRE(world.step(1.0 / 60).advanced);
      highest = std::max(highest, world.bodies().motion(0).position[2]);
      if (i < 60) continue;
      ++count;
      for (const auto& c : world.contacts(sheet)) pressed -= c.obstacle < 0 ? c.impulse[2] : 0;
    }
    CHECK(highest < 0.08);
    CHECK(world.bodies().motion(0).position[2] > 0.015);
    CHECK(pressed / (count * mass * 9.81 / 60) == Approx(1).epsilon(0.2));
  }
}

TEMPLATE_TEST_CASE("a light body that is held carries a sheet", "[sim]", Implicit, Xpbd) {
  for (const double mass : {1e-2, 0.1, 1.0}) {
    for (const bool hung : {false, true}) {
      CAPTURE(mass, hung);
      World<double> world;
      const auto floor = PlaneCollider<double>::create(Vec::Zero(), Vec::UnitZ()).value();
      (void)world.add_obstacle(floor).value();
      const double height = hung ? 0.2 : 0.03;
      (void)world.add_body(ball(mass, Vec(0.013, 0.021, height), Vec::Zero())).value();
      RigidJointSetup<double> joint;
      joint.a = 0;
      joint.anchor = Vec(0.013, 0.021, height);
      if (hung) (void)world.bodies().add_joint(joint).value();
      const int sheet = add_sheet<TestType>(world, 13, height + 0.05, Vec(0, 0, -9.81));
      double highest = 0;
      for (int i = 0; i < 90; ++i) {
        REQUIRE(world.step(1.0 / 60).advanced);
        highest = std::max(highest, world.state(sheet).positions.row(2).maxCoeff());
      }
      CHECK(highest < height + 0.1);
      CHECK(world.state(sheet).positions.row(2).maxCoeff() > height + 0.02);
      CHECK(world.bodies().motion(0).position[2] > height - 0.02);
    }
  }
}

TEMPLATE_TEST_CASE("a light body and a free sheet keep their momentum and add no energy", "[sim]",
                   Implicit, Xpbd) {
  for (const double mass : {1e-4, 1e-3, 0.01}) {
    CAPTURE(mass);
    WorldSettings<double> settings;
    settings.bodies.gravity.setZero();
    World<double> world(settings);
    const int sheet = add_sheet<TestType>(world, 9, 0, Vec::Zero());
    (void)world.add_body(ball(mass, Vec(0.01, 0.02, 0.05), Vec(0, 0, -2))).value();
    const VectorX<double> masses = level_sheet<double>(9).mass;
    const auto momentum = [&] {
      return Vec(world.state(sheet).velocities * masses + mass * world.bodies().motion(0).velocity);
    };
    const Vec start = momentum();
    double summed = 0;
    for (int i = 0; i < 60; ++i) {
      REQUIRE(world.step(1.0 / 60).advanced);
      for (const auto& c : world.contacts(sheet)) summed += c.impulse.norm();
    }
    CHECK(summed > 0.5 * mass);
    CHECK((momentum() - start).norm() < 1e-9 * summed);
    const double energy =
        0.5 * mass * world.bodies().motion(0).velocity.squaredNorm() +
        0.5 * world.state(sheet).velocities.colwise().squaredNorm().dot(masses.transpose());
    CHECK(energy < 0.5 * mass * 4);
  }
}

TEMPLATE_TEST_CASE("steps that are made again repeat their bits and do not allocate", "[sim]",
                   Implicit, Xpbd) {
  const auto make = [] {
    World<double> world;
    const auto floor = PlaneCollider<double>::create(Vec::Zero(), Vec::UnitZ()).value();
    (void)world.add_obstacle(floor).value();
    (void)add_sheet<TestType>(world, 9, 1.5e-3, Vec(0, 0, -9.81));
    for (const double x : {-0.07, 0.06})
      (void)world.add_body(ball(5e-3, Vec(x, 0.011, 0.08), Vec(0, 0, -2))).value();
    return world;
  };
  World<double> one = make(), two = make();
  for (int i = 0; i < 30; ++i) {
    const long before = allocations();
    REQUIRE(one.step(1.0 / 60).advanced);
    const long made = allocations() - before;
    if (i > 0 && allocation_counting_works()) CHECK(made == 0);
    REQUIRE(two.step(1.0 / 60).advanced);
  }
  CHECK(one.state(0) == two.state(0));
  CHECK(one.bodies().motion(1).position == two.bodies().motion(1).position);
}
