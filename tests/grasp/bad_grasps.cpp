// What cannot be grasped: places out of reach, a posture inside of a table, a hand without
// fingertips, a sheet that is elsewhere, fingertips without friction. Each is told by a status or
// in words, and the hand comes to rest.

#include <string>
#include <vector>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/grasp/grasp_controller.hpp"
#include "clothctl/grasp/joint_path_planner.hpp"
#include "clothctl/grasp/robot_clearance.hpp"
#include "support/catch.hpp"
#include "support/grasping.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Vec = Vector3<double>;

/// Poses of a pinch by thumb and index, with places of their own.
GraspPoses<double> pinch_between(const PinchingHand& hand, const Vec& thumb, const Vec& index) {
  const std::vector<FingerPad<double>> two{hand.geometry.fingers[0], hand.geometry.fingers[1]};
  const std::vector<GraspContact<double>> places{{thumb, Vec(0, 1, 0)}, {index, Vec(0, -1, 0)}};
  return find_grasp_poses<Hand34, double>(hand.tree, two, places, hand.poses.wait, hand.poses.wait);
}

/// Grasps until it fails, for at most 12 s, and checks that the hand then comes to rest.
GraspReport<double> fail_and_rest(PinchingHand& hand, GraspController<Hand34>& controller) {
  REQUIRE(controller.begin(hand.grasp) == "");
  GraspReport<double> report;
  for (int i = 0; i < 600 && report.phase != GraspPhase::Failed; ++i)
    report = hand.step(controller);
  REQUIRE(report.phase == GraspPhase::Failed);
  CHECK(hand.world.drive(0).target_velocity.isZero(0));
  CHECK(hand.world.drive(0).torque.isZero(0));
  const VectorX<double> target = hand.world.drive(0).target;
  for (int i = 0; i < 50; ++i) (void)hand.step(controller);
  CHECK(hand.world.drive(0).target == target);
  CHECK(hand.world.hand(0).velocities.norm() < 1e-3);
  CHECK(hand.advanced);
  return report;
}

}  // namespace

TEST_CASE("places that fingers cannot reach are told, and so is a grasp there all the same",
          "[grasp]") {
  PinchingHand hand(9);
  const Vec apart(0, 0.5, 0);
  const auto poses = pinch_between(hand, hand.at - apart, hand.at + apart);
  CHECK(poses.status == GraspPoseStatus::Unreachable);
  CHECK(poses.message.find("finger 1 (index) ends 0.") == 0);
  CHECK(poses.message.find(" m from its place at (") != std::string::npos);
  hand.grasp.keyframes = {poses.touch};  // the pose that comes closest
  GraspController<Hand34> controller = hand.controller();
  const auto report = fail_and_rest(hand, controller);
  CHECK(report.fault == GraspFault::NoTouch);
  CHECK(controller.describe(report).find("finger 0 (thumb) closed by 0.015 m and touched") == 0);
}

TEST_CASE("a sheet out of reach is told before the hand goes, and after it", "[grasp]") {
  PinchingHand hand(9);
  // The base slides by 1.5 m to each side.
  for (const double way : {3.0, 100.0, 1e12}) {
    const Vec place = hand.at + Vec(way, 0, 0);
    const auto poses = pinch_between(hand, place, place);
    CHECK(poses.status == GraspPoseStatus::Unreachable);
    CHECK(poses.message.find("finger ") == 0);
    CHECK(poses.touch_errors.maxCoeff() == Approx(way).epsilon(0.7));
    for (const VectorX<double>* q : {&poses.touch, &poses.wait}) {
      CHECK((*q - hand.tree.lower()).minCoeff() >= 0);
      CHECK((hand.tree.upper() - *q).minCoeff() >= 0);
    }
  }
  // The sheet is carried away before the hand is there.
  ClothState<double> away = hand.world.state(0);
  away.positions.colwise() += Vec(1, 0, 0);
  hand.world.input(0).driven_positions.colwise() += Vec(1, 0, 0);
  REQUIRE(hand.world.set_state(0, away) == "");
  GraspController<Hand34> controller = hand.controller();
  const auto report = fail_and_rest(hand, controller);
  CHECK(report.fault == GraspFault::NoTouch);
  CHECK(controller.describe(report) == "finger 0 (thumb) closed by 0.015 m and touched nothing");
}

TEST_CASE("a posture inside of a table is told, with what is in it", "[grasp]") {
  const Hand34 tree = hand34<double>();
  const auto geometry = hand34_geometry(tree);
  const VectorX<double> home = hand34_home(tree);
  auto clearance = RobotClearance<Hand34>::create(tree, geometry.capsules).value();
  (void)clearance.ignore_pairs(home, 1e-3);
  const auto table = BoxCollider<double>::create(Vec(0, 0, -0.05), Vec(1, 1, 0.05)).value();
  const std::vector<ColliderRef<double>> obstacles{ColliderRef<double>(table)};
  clearance.set_obstacles(obstacles);
  const VectorX<double> reach = joint_reach<double>(tree, geometry.capsules).value();
  const auto plan = [&](const VectorX<double>& from, const VectorX<double>& to) {
    return plan_joint_path<double>(from, to, tree.lower(), tree.upper(), reach, clearance);
  };
  const VectorX<double> inside =
      hand34_pinch_at<double>(tree, Vec(0, 0, -0.01), Vec(0, 1, 0), Vec(0, 0, -1));
  const auto into = plan(home, inside), out_of = plan(inside, home);
  CHECK(into.status == JointPathStatus::GoalCollides);
  CHECK(into.message.find("the goal has a clearance of -0.0") == 0);
  CHECK(out_of.status == JointPathStatus::StartCollides);
  CHECK(out_of.message.find("the start has a clearance of -0.0") == 0);
  CHECK(into.positions.empty());
  const ClosestPart<double> part = clearance.closest(inside);
  REQUIRE(part.capsule >= 0);
  CHECK(part.obstacle == 0);
  const int frame = geometry.capsules[static_cast<std::size_t>(part.capsule)].frame;
  CHECK(tree.links()[static_cast<std::size_t>(frame)].name == "thumb_distal");
  const VectorX<double> above =
      hand34_pinch_at<double>(tree, Vec(0, 0, 0.05), Vec(0, 1, 0), Vec(0, 0, -1));
  CHECK(plan(home, above).status == JointPathStatus::Found);
}

TEST_CASE("a hand without fingertips is told wherever it is given", "[grasp]") {
  PinchingHand hand(5);
  const std::string words = "the hand has no finger pads";
  CHECK(FingertipTracker<Hand34>::create(hand.tree, {}).error() == words);
  CHECK(GraspController<Hand34>::create(hand.tree, {}, hand.poses.wait).error() == words);
  HandGeometry<double> bare = hand.geometry;
  bare.fingers.clear();
  CHECK(add_hand_geometry<double>(hand.world, 0, bare).error() == words);
  const std::vector<FingerPad<double>> none;
  const std::vector<GraspContact<double>> nowhere;
  const auto poses =
      find_grasp_poses<Hand34, double>(hand.tree, none, nowhere, hand.poses.wait, hand.poses.wait);
  CHECK(poses.status == GraspPoseStatus::InvalidInput);
  CHECK(poses.message == words);
}

TEST_CASE("a finger whose pad feels nothing is named", "[grasp]") {
  PinchingHand hand(9);
  GraspController<Hand34> controller = hand.controller();
  REQUIRE(controller.begin(hand.grasp) == "");
  GraspReport<double> report;
  for (int i = 0; i < 600 && report.phase != GraspPhase::Failed; ++i) {
    auto felt = hand.touches();
    felt[1] = {};
    report = controller.update(hand.dt, hand.world.hand(0), felt, hand.world.drive(0));
    REQUIRE(hand.world.step(hand.dt).advanced);
  }
  CHECK(report.fault == GraspFault::NoTouch);
  CHECK(controller.describe(report).find("finger 1 (index) closed by ") == 0);
  CHECK(hand.world.drive(0).target_velocity.isZero(0));
}

TEST_CASE("fingertips without friction do not hold, and it is told that they slide", "[grasp]") {
  for (const double friction : {0.0, 1e-9}) {
    if (clothctl_test::kSanitized && friction > 0) continue;
    PinchingHand hand(17, 0.02, friction);
    GraspController<Hand34> controller = hand.controller();
    const auto report = fail_and_rest(hand, controller);
    CHECK(report.fault == GraspFault::NotFirm);
    CHECK(report.slides);
    CHECK(report.finger >= 0);
    CHECK(controller.describe(report).find(" did not hold firmly in time") != std::string::npos);
    CHECK(controller.describe(report).find(" contacts stick, and it slides") != std::string::npos);
  }
  // As much friction as one likes holds.
  PinchingHand sticky(9, 0.02, 1e6);
  GraspController<Hand34> controller = sticky.controller();
  REQUIRE(controller.begin(sticky.grasp) == "");
  for (int i = 0; i < 150; ++i) (void)sticky.step(controller);
  CHECK(controller.phase() == GraspPhase::Hold);
  CHECK(sticky.advanced);
}
