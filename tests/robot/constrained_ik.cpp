#include "clothctl/robot/constrained_ik.hpp"

#include "clothctl/qp/active_set.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "robot/small_hand.hpp"
#include "support/catch.hpp"

using namespace clothctl_test;
using clothctl::ActiveSet;

namespace {

struct Walled : Reach {
  ConstrainedIk<KinematicTree<double>, ActiveSet<double>> ik{tree, 5, 10};
  std::vector<HalfSpace<double>> planes;

  double missing(const VectorX<double>& q) {
    forward_kinematics<double>(tree, q, body_poses);
    double worst = 0;
    for (const HalfSpace<double>& plane : planes) {
      worst = std::max(
          worst,
          plane.offset - plane.normal.dot(link_pose(tree, body_poses, plane.frame) * plane.point));
    }
    return worst;
  }
  double tip_error(const VectorX<double>& q) {
    forward_kinematics<double>(tree, q, body_poses);
    double worst = 0;
    for (const IkTask<double>& task : tasks) {
      worst = std::max(worst,
                       (task.target - link_pose(tree, body_poses, task.frame) * task.local).norm());
    }
    return worst;
  }
};

}  // namespace

TEST_CASE("tips reach their targets while the knuckles stay above a table", "[robot]") {
  Walled hand;
  int reached = 0;
  for (int round = 0; round < 30; ++round) {
    const VectorX<double> goal = hand.anywhere();
    hand.aim_at(goal);
    // The goal just keeps clear of the table.
    double lowest = 1e9;
    hand.planes.clear();
    for (int f = 0; f < 5; ++f) {
      HalfSpace<double> plane;
      plane.frame = hand.tree.find_link("finger" + std::to_string(f) + "1");
      lowest = std::min(lowest, link_pose(hand.tree, hand.body_poses, plane.frame).p.z());
      hand.planes.push_back(plane);
    }
    for (HalfSpace<double>& plane : hand.planes) plane.offset = lowest - 1e-3;
    VectorX<double> q = goal;
    for (Index i = 0; i < q.size(); ++i) q[i] += 0.3 * (hand.uniform() - 0.5);
    const IkReport<double> report =
        hand.ik.solve(hand.tree, hand.tasks, hand.planes, VectorX<double>(), q);
    if (report.status == IkStatus::Reached) {
      ++reached;
      CHECK(hand.tip_error(q) <= 1e-4);
      CHECK(hand.missing(q) <= 1e-4);
    }
    CHECK(hand.missing(q) <= hand.ik.violation() + 1e-12);
    CHECK(hand.within_limits(q));
  }
  CHECK(reached >= 27);
}

TEST_CASE("a wall before the target is respected, and the tips come as near as it allows",
          "[robot]") {
  Walled hand;
  VectorX<double> q = hand.tree.neutral();
  hand.aim_at(q);
  for (IkTask<double>& task : hand.tasks) {
    task.target.x() += 0.3;
    HalfSpace<double> plane;
    plane.frame = task.frame;
    plane.point = task.local;
    plane.normal = Vector3<double>(-1.0, 0.0, 0.0);
    plane.offset = -(task.target.x() - 0.1);
    hand.planes.push_back(plane);
  }
  VectorX<double> open = q;
  InverseKinematics<KinematicTree<double>> free(hand.tree, 5);
  REQUIRE(free.solve(hand.tree, hand.tasks, VectorX<double>(), open).status == IkStatus::Reached);
  const IkReport<double> report =
      hand.ik.solve(hand.tree, hand.tasks, hand.planes, VectorX<double>(), q);
  CHECK(report.status == IkStatus::LocalMinimum);
  CHECK(hand.missing(q) <= 1e-6);
  CHECK(report.error ==
        Approx(0.1).epsilon(1e-4));  // each tip is on the wall, straight before its target
  CHECK(hand.tip_error(q) == Approx(report.error));

  // Without planes this is ordinary inverse kinematics.
  hand.planes.clear();
  CHECK(hand.ik.solve(hand.tree, hand.tasks, hand.planes, VectorX<double>(), q).status ==
        IkStatus::Reached);
  CHECK(hand.tip_error(q) <= 1e-4);
}

TEST_CASE("contradicting planes are reported, and input that is not finite is refused", "[robot]") {
  Walled hand;
  VectorX<double> q = hand.tree.neutral();
  hand.aim_at(q);
  HalfSpace<double> up, down;
  up.frame = down.frame = hand.tasks[0].frame;
  up.offset = 0.2;
  down.normal = -up.normal;
  down.offset = 0.1;  // z ≥ 0.2 and z ≤ -0.1
  hand.planes = {up, down};
  const IkReport<double> report =
      hand.ik.solve(hand.tree, hand.tasks, hand.planes, VectorX<double>(), q);
  CHECK(report.status != IkStatus::Reached);
  CHECK(hand.ik.violation() == Approx(0.3).epsilon(1e-3));
  const VectorX<double> before = q;
  hand.planes[1].offset = std::nan("");
  CHECK(hand.ik.solve(hand.tree, hand.tasks, hand.planes, VectorX<double>(), q).message ==
        "a plane's point, normal or offset holds NaN or an infinity");
  hand.planes[1].offset = 0.0;
  hand.planes[1].normal *= 2.0;
  CHECK(hand.ik.solve(hand.tree, hand.tasks, hand.planes, VectorX<double>(), q).message ==
        "a plane's normal is not a unit vector");
  hand.planes.resize(11, up);
  CHECK(hand.ik.solve(hand.tree, hand.tasks, hand.planes, VectorX<double>(), q).message ==
        "there are more planes than memory was made for");
  hand.planes.resize(2, up);
  hand.planes[0].frame = -1;
  CHECK(hand.ik.solve(hand.tree, hand.tasks, hand.planes, VectorX<double>(), q).message ==
        "a plane's frame does not exist");
  CHECK(q == before);
}

TEST_CASE("a plane holds even if the start meets every task, and without any task", "[robot]") {
  Walled hand;
  for (const bool with_task : {true, false}) {
    VectorX<double> q = hand.tree.neutral();
    hand.aim_at(q);
    hand.tasks.resize(with_task ? 1 : 0);
    HalfSpace<double> plane;
    plane.frame = hand.tree.find_link("finger43");
    forward_kinematics<double>(hand.tree, q, hand.body_poses);
    plane.offset = link_pose(hand.tree, hand.body_poses, plane.frame).p.z() + 0.02;
    hand.planes = {plane};
    const IkReport<double> report =
        hand.ik.solve(hand.tree, hand.tasks, hand.planes, VectorX<double>(), q);
    CHECK(report.status == IkStatus::Reached);
    CHECK(hand.missing(q) <= 1e-4);
  }
}

TEST_CASE("reserving a negative number of planes reserves none", "[robot]") {
  Reach reach;
  reach.aim_at(reach.tree.neutral());
  const VectorX<double> none;
  VectorX<double> q = reach.tree.neutral();
  ConstrainedIk<KinematicTree<double>, ActiveSet<double>> ik(reach.tree, 5, -1);
  const HalfSpace<double> floor;
  CHECK(ik.solve(reach.tree, reach.tasks, std::span(&floor, 1), none, q).message ==
        "there are more planes than memory was made for");
}
