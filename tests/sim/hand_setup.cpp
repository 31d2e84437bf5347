// What a hand starts with and is driven by.

#include "clothctl/sim/hand_setup.hpp"

#include <limits>
#include <string>

#include "support/catch.hpp"
#include "support/pads.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("a hand begins where its set-up says, and is driven to stay there", "[sim]") {
  World<double> world;
  HandSetup<double> setup;
  setup.positions = Eigen::Vector3d(0.1, -0.2, 0.3);
  setup.control = StablePdSettings<double>::uniform(3);
  setup.control.dt = 123;  // the world's step counts
  const int hand = world.add_hand(two_fingers(), setup).value();
  CHECK(world.drive(hand).target == setup.positions);
  CHECK(world.drive(hand).target_velocity.isZero());
  CHECK(world.drive(hand).torque.isZero());
  CHECK(world.hand(hand).velocities.isZero());
  for (int i = 0; i < 100; ++i) REQUIRE(world.step(0.01).advanced);
  CHECK((world.hand(hand).positions - setup.positions).norm() < 1e-12);
  HandState<double> thrown = world.hand(hand);
  thrown.velocities = Eigen::Vector3d(1, 0, 0);
  CHECK(world.set_hand(hand, thrown).empty());
  CHECK(world.hand(hand).velocities == thrown.velocities);
  thrown.positions = Eigen::Vector2d(0, 0);
  CHECK(world.set_hand(hand, thrown) == "hand 0 has positions of 2 entries, must be 3");
  thrown = world.hand(hand);
  thrown.velocities[1] = std::numeric_limits<double>::infinity();
  CHECK(world.set_hand(hand, thrown) ==
        "hand 0 has velocities with the entry 1 = inf, must be finite");
  CHECK(world.hand(hand).positions == setup.positions);
  CHECK(world.hand(hand).velocities == Eigen::Vector3d(1, 0, 0));
  for (const int other : {-1, 1, 99})
    CHECK(world.set_hand(other, world.hand(hand)) ==
          "no hand " + std::to_string(other) + " (there are 1)");
}

TEST_CASE("torques of a drive keep the effort limits of the joints", "[sim]") {
  World<double> world;
  HandSetup<double> setup;
  setup.positions = Eigen::Vector3d::Zero();
  setup.control = StablePdSettings<double>::uniform(3, 0, 0);
  const KinematicTree<double> tree = two_fingers();
  const int hand = world.add_hand(tree, setup).value();
  const double most = tree.effort_limits()[1];
  world.drive(hand).torque = Eigen::Vector3d(0, 3 * most, -0.5 * most);
  REQUIRE(world.step(1e-3).advanced);
  CHECK(world.torques(hand)[1] == most);
  CHECK(world.torques(hand)[2] == Approx(-0.5 * most).epsilon(1e-12));
  CHECK(world.hand(hand).velocities[1] == Approx(1e-3 * most / 0.05).epsilon(1e-12));
}
