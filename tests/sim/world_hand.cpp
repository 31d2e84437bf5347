// A hand of a world: its controller, impulses on it, the motion of its frames.

#include "clothctl/sim/detail/world_hand.hpp"

#include <vector>

#include "clothctl/robot/kinematic_tree_model.hpp"
#include "robot/random_tree.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::RobotDraws;

namespace {

using Tree = KinematicTree<double>;
using Vec = Vector3<double>;

detail::WorldHandOf<Tree, double> make_hand(const Tree& tree, RobotDraws& draws) {
  HandSetup<double> setup;
  setup.positions = draws.positions<double>(tree);
  setup.velocities = draws.entries<double>(tree.nv());
  setup.control = StablePdSettings<double>::uniform(tree.nv(), 50, 5);
  setup.control.limit_torques = false;
  StablePd<Tree> pd = StablePd<Tree>::create(tree, setup.control).value();
  return {tree, std::move(pd), setup};
}

}  // namespace

TEST_CASE("an impulse moves a hand as its response does", "[sim]") {
  for (unsigned seed = 1; seed < 6; ++seed) {
    RobotDraws draws(seed);
    const Tree tree = draws.tree<double>(8, seed % 2 == 0, false);
    auto one = make_hand(tree, draws);
    RobotDraws again(seed);
    const Tree same = again.tree<double>(8, seed % 2 == 0, false);
    auto other = make_hand(same, again);
    const VectorX<double> start = one.state.velocities;
    REQUIRE(one.predict(0.01, 0).status == PdStatus::Solved);
    REQUIRE(other.predict(0.01, 0).status == PdStatus::Solved);
    const VectorX<double> before = one.state.velocities;
    REQUIRE(before == other.state.velocities);
    const std::vector<int> frames{3, 8};
    Points<double> at(3, 2);
    VectorX<double> p(6);
    for (Index i = 0; i < 2; ++i) {
      at.col(i) = draws.vector();
      p.segment<3>(3 * i) = draws.vector();
      one.add_impulse(frames[static_cast<std::size_t>(i)], at.col(i), Vec(p.segment<3>(3 * i)));
    }
    one.take_impulses();
    other.reserve(2);
    REQUIRE(other.attach(frames, at) == ArticulatedStatus::Updated);
    other.side().apply(p);
    other.take_side();
    const double change = (one.state.velocities - before).norm();
    CHECK(change > 1e-3);
    CHECK((one.state.velocities - other.state.velocities).norm() < 1e-9 * change);
    one.take_impulses();  // taken once
    CHECK((one.state.velocities - other.state.velocities).norm() < 1e-9 * change);
    // The torques are those of spring and damper at the end of the step (PdForm::Stable):
    // -kp (q + h q̇ - target) - kd q̇⁺ + g, with what the impulses changed in q̇⁺.
    const VectorX<double> zero = VectorX<double>::Zero(tree.nv());
    VectorX<double> gravity = zero, spring = zero;
    KinematicTreeWorkspace<double> work = articulated_traits<Tree>::make_workspace(tree);
    articulated_traits<Tree>::forward_kinematics(tree, one.state.positions, work);
    articulated_traits<Tree>::inverse_dynamics(tree, zero, zero, work, gravity);
    articulated_traits<Tree>::difference(tree, one.state.positions, one.drive.target, spring);
    const VectorX<double> expected =
        50 * (spring - 0.01 * start) - 5 * one.state.velocities + gravity;
    REQUIRE(one.finish(0.01));
    CHECK((one.torques - expected).norm() < 1e-9 * expected.norm());
  }
}

TEST_CASE("frames move as their velocities say", "[sim]") {
  RobotDraws draws(7);
  const Tree tree = draws.tree<double>(8, false, false);
  auto hand = make_hand(tree, draws);
  const RigidMotion<double> before = hand.frame_motion(8);
  REQUIRE(hand.finish(1e-7));
  const RigidMotion<double> after = hand.frame_motion(8);
  CHECK((after.position - before.position - 1e-7 * before.velocity).norm() < 1e-12);
  const Matrix3<double> turn = after.R_world_body * before.R_world_body.transpose();
  const Vec angle(turn(2, 1), turn(0, 2), turn(1, 0));
  CHECK((angle - 1e-7 * before.angular_velocity).norm() < 1e-12);
  CHECK(hand.has_frame(8));
  CHECK(!hand.has_frame(-1));
}

TEST_CASE("in the parts of a step the target moves with its velocity", "[sim]") {
  RobotDraws draws(3);
  const Tree tree = draws.tree<double>(4, false, false);
  HandSetup<double> setup;
  setup.positions = draws.positions<double>(tree);
  setup.control = StablePdSettings<double>::uniform(tree.nv(), 800, 100);
  setup.control.limit_torques = false;
  detail::WorldHandOf<Tree, double> hand(tree, StablePd<Tree>::create(tree, setup.control).value(),
                                         setup);
  // Moving with the target from the start, no spring is stretched.
  hand.drive.target_velocity = 0.1 * draws.entries<double>(tree.nv());
  hand.state.velocities = hand.drive.target_velocity;
  VectorX<double> way = 0.04 * hand.drive.target_velocity;
  articulated_traits<Tree>::advance(tree, setup.positions, way, hand.drive.target);
  for (int part = 0; part < 4; ++part) {
    REQUIRE(hand.predict(0.01, 0.01 * (3 - part)).status == PdStatus::Solved);
    REQUIRE(hand.finish(0.01));
  }
  articulated_traits<Tree>::difference(tree, hand.state.positions, hand.drive.target, way);
  CHECK(way.norm() < 1e-4);
}

TEST_CASE("joints of absurd speed do not move on", "[sim]") {
  RobotDraws draws(1);
  const Tree tree = draws.tree<double>(8, false, false);
  auto hand = make_hand(tree, draws);
  const VectorX<double> q = hand.state.positions;
  for (const double speed : {2e4, -2e4}) {
    hand.state.velocities.setZero();
    hand.state.velocities[3] = speed;
    CHECK_FALSE(hand.finish(1e-6));
    CHECK(hand.state.positions == q);
  }
  hand.state.velocities[3] = 0.9e4;
  CHECK(hand.finish(1e-6));
  CHECK(hand.state.positions != q);
}
