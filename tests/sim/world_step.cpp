// The order of a world's step, and what it goes back to.

#include "clothctl/sim/detail/world_step.hpp"

#include <cmath>
#include <limits>

#include "support/catch.hpp"
#include "support/pads.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

/// A tray of 200 g that moves up and down.
KinematicTree<double> tray_on_a_lift() {
  KinematicTreeBuilder<double> robot;
  Inertia<double> body;
  body.mass = 0.2;
  body.about_com.diagonal().setConstant(1e-4);
  Joint<double> joint;
  joint.name = "lift";
  joint.type = JointType::Prismatic;
  joint.parent = "world";
  joint.child = "tray";
  joint.axis = Vector3<double>(0, 0, 1);
  joint.limits = {-10, 10, 100, 1e4};
  robot.add_link("world").add_link("tray", body).add_joint(joint);
  return robot.build().value();
}

}  // namespace

TEST_CASE("a sheet on the palm of a hand weighs on its controller", "[sim]") {
  // A floor that a soft controller holds up: it sags by weight over stiffness.
  const KinematicTree<double> tree = tray_on_a_lift();
  World<double> world;
  HandSetup<double> setup;
  setup.positions = VectorX<double>::Zero(1);
  setup.control = StablePdSettings<double>::uniform(1, 100, 10);
  (void)world.add_hand(tree, setup).value();
  const auto plane =
      PlaneCollider<double>::create(Vector3<double>::Zero(), Vector3<double>(0, 0, 1)).value();
  (void)world.add_link_shape(0, tree.find_link("tray"), plane).value();
  MassSpring<double> model = hanging_sheet(6);
  ClothState<double> state = model.rest_state();
  state.positions.row(1) = state.positions.row(2);
  state.positions.row(2).setConstant(0.002);
  const double weight = 9.81 * model.network().mass.sum();
  (void)world.add_sheet(std::move(model), state).value();
  for (int i = 0; i < 1000; ++i) {
    if (!world.step(0.01).advanced) FAIL("step " << i);
  }
  CHECK(world.hand(0).positions[0] == Approx(-weight / 100).epsilon(1e-3));
  CHECK(world.torques(0)[0] == Approx(weight + 0.2 * 9.81).epsilon(1e-3));
}

TEST_CASE("a step that fails leaves hands, pads and sheets as they were", "[sim]") {
  GrippedSheet held(5, 3), same(5, 3);
  for (int i = 0; i < 10; ++i) {
    REQUIRE(held.world.step(0.02).advanced);
    REQUIRE(same.world.step(0.02).advanced);
  }
  ClothInput<double>& input = held.world.input(0);
  input.force_vertices = {0};
  input.forces = Vector3<double>::Constant(std::numeric_limits<double>::infinity());
  const WorldReport<double> report = held.world.step(0.02);
  CHECK(!report.advanced);
  CHECK(report.sheet == 0);
  input.clear();
  for (int i = 0; i < 10; ++i) {
    REQUIRE(held.world.step(0.02).advanced);
    REQUIRE(same.world.step(0.02).advanced);
  }
  CHECK(held.world.state(0).positions == same.world.state(0).positions);
  CHECK(held.world.hand(0).positions == same.world.hand(0).positions);
}

TEST_CASE("what sheets pressed on a hand in a step that fails is forgotten", "[sim]") {
  const KinematicTree<double> tree = tray_on_a_lift();
  const auto plane =
      PlaneCollider<double>::create(Vector3<double>::Zero(), Vector3<double>(0, 0, 1)).value();
  // The sheet that is refused comes before the one that lies on the tray, or after it.
  for (const int refused : {0, 1}) {
    CAPTURE(refused);
    const auto make = [&](World<double>& world) {
      HandSetup<double> setup;
      setup.positions = VectorX<double>::Zero(1);
      setup.control = StablePdSettings<double>::uniform(1, 100, 10);
      (void)world.add_hand(tree, setup).value();
      (void)world.add_link_shape(0, tree.find_link("tray"), plane).value();
      for (const int k : {0, 1}) {
        ClothState<double> state = hanging_sheet(6).rest_state();
        const Points<double> hanging = state.positions;
        state.positions.row(1) = hanging.row(2);  // level
        state.positions.row(2).setConstant(k == refused ? 1.0 : 0.002);
        (void)world.add_sheet(hanging_sheet(6), std::move(state)).value();
      }
    };
    World<double> failed, other;
    make(failed);
    make(other);
    for (int i = 0; i < 50; ++i) {
      REQUIRE(failed.step(0.01).advanced);
      REQUIRE(other.step(0.01).advanced);
    }
    const VectorX<double> torques = failed.torques(0);
    failed.input(refused).driven_vertices = {999};
    failed.input(refused).driven_positions = Points<double>::Zero(3, 1);
    failed.drive(0).target[0] = 0.01;
    CHECK(!failed.step(0.01).advanced);
    CHECK(failed.torques(0) == torques);
    failed.input(refused).clear();
    failed.drive(0).target[0] = 0;
    // The failed step forgets contacts.
    for (const int k : {0, 1}) REQUIRE(other.set_state(k, other.state(k)).empty());
    for (int i = 0; i < 3; ++i) {
      REQUIRE(failed.step(0.01).advanced);
      REQUIRE(other.step(0.01).advanced);
      CHECK(failed.hand(0).velocities == other.hand(0).velocities);
    }
  }
}

TEST_CASE("a body that was added elsewhere after a step is refused", "[sim]") {
  World<double> world;
  REQUIRE(world.step(0.01).advanced);
  RigidBodySetup<double> ball{ConvexShape<double>::sphere(0.05).value()};
  (void)world.bodies().add(ball).value();
  CHECK(world.check_setup() == "a body was added elsewhere");
  CHECK(!world.step(0.01).advanced);
}
