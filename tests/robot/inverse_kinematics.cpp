#include "clothctl/robot/inverse_kinematics.hpp"

#include <random>

#include "clothctl/robot/hand34.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "robot/random_tree.hpp"
#include "robot/small_hand.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

struct Hand : Reach {
  InverseKinematics<KinematicTree<double>> ik{tree, 6};
};

}  // namespace

TEST_CASE(
    "five tips reach their targets within the limits from near, and with restarts from anywhere",
    "[robot]") {
  Hand reach;
  int reached = 0;
  for (int k = 0; k < 100; ++k) {
    const VectorX<double> goal = reach.anywhere();
    reach.aim_at(goal);
    VectorX<double> q = goal;
    for (Index i = 0; i < q.size(); ++i) q[i] += 0.1 * (reach.uniform() - 0.5);
    const long before = clothctl_test::allocations();
    const IkReport<double> near = reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK(near.status == IkStatus::Reached);
    CHECK(near.error <= 1e-4);
    CHECK(reach.within_limits(q));
    q = reach.anywhere();
    const IkReport<double> far = reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q, 20,
                                                [&] { return reach.uniform(); });
    reached += far.status == IkStatus::Reached ? 1 : 0;
    CHECK(reach.within_limits(q));
    reach.aim_at(q);  // the report is correct
    if (far.status == IkStatus::Reached) {
      const std::vector<IkTask<double>> there = reach.tasks;
      reach.aim_at(goal);
      for (int f = 0; f < 5; ++f)
        CHECK((there[static_cast<std::size_t>(f)].target -
               reach.tasks[static_cast<std::size_t>(f)].target)
                  .norm() <= 1e-4);
    }
  }
  CHECK(reached >= 99);
}

TEST_CASE("targets out of reach end at a constrained minimum and the status says so", "[robot]") {
  Hand reach;
  for (int k = 0; k < 60; ++k) {
    reach.aim_at(reach.anywhere());
    if (k % 2 == 0) {
      for (IkTask<double>& task : reach.tasks) task.target += Vector3<double>(3.0, 0.0, 0.0);
    } else {
      reach.tasks[2].target += Vector3<double>(10.0, -3.0, 1.0);  // contradicting targets
    }
    VectorX<double> q = reach.anywhere();
    const long before = clothctl_test::allocations();
    const IkReport<double> report = reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK(report.status == IkStatus::LocalMinimum);
    CHECK(report.gradient <= reach.ik.settings().gradient_tolerance);
    CHECK(report.error > 1.0);
    CHECK(reach.within_limits(q));
    // No small step within the limits lowers the cost.
    const auto cost = [&](const VectorX<double>& at) {
      forward_kinematics<double>(reach.tree, at, reach.body_poses);
      double sum = 0;
      for (const IkTask<double>& task : reach.tasks) {
        sum += (task.target - link_pose(reach.tree, reach.body_poses, task.frame) * task.local)
                   .squaredNorm();
      }
      return sum;
    };
    const double best = cost(q);
    for (Index i = 0; i < q.size(); ++i) {
      for (const double step : {-1e-3, 1e-3}) {
        VectorX<double> moved = q;
        moved[i] =
            std::min(std::max(moved[i] + step, reach.tree.lower()[i]), reach.tree.upper()[i]);
        CHECK(cost(moved) >= best * (1 - 1e-8));
      }
    }
  }
}

TEST_CASE("a posture is approached where the tasks allow, also with more rows than joints",
          "[robot]") {
  Hand reach;
  const VectorX<double> goal = reach.anywhere();
  reach.aim_at(goal);
  IkSettings<double> settings;
  settings.posture_weight = 1e-6;
  InverseKinematics<KinematicTree<double>> drawn(reach.tree, 5, settings);
  VectorX<double> free = reach.tree.neutral(), kept = free;
  REQUIRE(reach.ik
              .solve(reach.tree, reach.tasks, VectorX<double>(), free, 20,
                     [&] { return reach.uniform(); })
              .status == IkStatus::Reached);
  kept = free;
  const IkReport<double> report = drawn.solve(reach.tree, reach.tasks, goal, kept);
  CHECK(report.error < 1e-3);
  CHECK((kept - goal).norm() < (free - goal).norm());

  std::vector<IkTask<double>> many;  // twelve points of each fingertip: 180 rows, 26 joints
  forward_kinematics<double>(reach.tree, goal, reach.body_poses);
  RobotDraws draws(18);
  for (const IkTask<double>& task : reach.tasks) {
    for (int k = 0; k < 12; ++k) {
      const Vector3<double> local = 0.01 * draws.vector();
      many.push_back(IkTask<double>::position(
          task.frame, local, link_pose(reach.tree, reach.body_poses, task.frame) * local));
    }
  }
  settings = IkSettings<double>();
  settings.tolerance = 1e-8;
  InverseKinematics<KinematicTree<double>> wide(reach.tree, static_cast<int>(many.size()),
                                                settings);
  VectorX<double> q = goal;
  for (Index i = 0; i < q.size(); ++i) q[i] += 0.1 * (reach.uniform() - 0.5);
  const IkReport<double> matched = wide.solve(reach.tree, many, VectorX<double>(), q);
  CHECK(matched.status == IkStatus::Reached);
  forward_kinematics<double>(reach.tree, q, reach.body_poses);
  for (const IkTask<double>& task : many) {
    CHECK((link_pose(reach.tree, reach.body_poses, task.frame) * task.local - task.target).norm() <=
          1e-8);
  }
}

TEST_CASE("bad input is refused and q stays unchanged", "[robot]") {
  Hand reach;
  reach.aim_at(reach.anywhere());
  VectorX<double> q = reach.tree.neutral();
  const VectorX<double> before = q;
  reach.tasks[2].target[1] = std::nan("");
  CHECK(reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q).status ==
        IkStatus::InvalidInput);
  CHECK(
      reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q, 5, [] { return 0.5; }).status ==
      IkStatus::InvalidInput);
  CHECK(q == before);
  reach.aim_at(before);
  reach.tasks.resize(7, reach.tasks[0]);
  CHECK(reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q).status ==
        IkStatus::InvalidInput);
  reach.tasks.resize(5);
  CHECK(reach.ik.solve(reach.tree, reach.tasks, VectorX<double>::Zero(3), q).status ==
        IkStatus::InvalidInput);
  q[0] = std::nan("");
  CHECK(reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q).status ==
        IkStatus::InvalidInput);
}

TEST_CASE("starts near a local minimum still reach the targets, and the best result is returned",
          "[robot]") {
  Hand reach;
  IkSettings<double> settings;
  settings.fallbacks = false;
  InverseKinematics<KinematicTree<double>> plain(reach.tree, 5, settings);
  int plainly = 0, reached = 0;
  for (int k = 0; k < 300; ++k) {
    reach.aim_at(reach.anywhere());
    const VectorX<double> start = reach.anywhere();
    VectorX<double> q = start, r = start;
    const IkReport<double> without = plain.solve(reach.tree, reach.tasks, VectorX<double>(), q);
    const IkReport<double> with = reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), r);
    plainly += without.status == IkStatus::Reached ? 1 : 0;
    reached += with.status == IkStatus::Reached ? 1 : 0;
    if (without.status == IkStatus::Reached) {
      CHECK(q == r);
    } else {
      CHECK((with.status == IkStatus::Reached || with.cost <= without.cost));
      CHECK(with.iterations > without.iterations);
    }
    // The report describes the returned q.
    forward_kinematics<double>(reach.tree, r, reach.body_poses);
    double error = 0;
    for (const IkTask<double>& task : reach.tasks) {
      error = std::max(
          error,
          (task.target - link_pose(reach.tree, reach.body_poses, task.frame) * task.local).norm());
    }
    CHECK(error == Approx(with.error));
  }
  CHECK(reached > plainly);
}

TEST_CASE(
    "a stretched arm bends towards a target in its own line, and a robot without joints stays",
    "[robot]") {
  KinematicTreeBuilder<double> builder;
  builder.add_link("world");
  for (int k = 0; k < 3; ++k) {
    Joint<double> joint;
    joint.name = "joint" + std::to_string(k);
    joint.parent = k == 0 ? "world" : "rod" + std::to_string(k - 1);
    joint.child = "rod" + std::to_string(k);
    joint.axis << 0.0, 0.0, 1.0;
    joint.origin.p << (k == 0 ? 0.0 : 1.0), 0.0, 0.0;
    builder.add_link(joint.child).add_joint(joint);
  }
  const KinematicTree<double> arm = builder.build().value();
  InverseKinematics<KinematicTree<double>> ik(arm, 1);
  for (const double x : {0.5, -2.5}) {
    VectorX<double> q = arm.neutral();
    const std::vector<IkTask<double>> tasks = {
        IkTask<double>::position(3, Vector3<double>(1.0, 0.0, 0.0), Vector3<double>(x, 0.0, 0.0))};
    CHECK(ik.solve(arm, tasks, VectorX<double>(), q).status == IkStatus::Reached);
  }

  const KinematicTree<double> stone =
      KinematicTreeBuilder<double>().add_link("world").build().value();
  InverseKinematics<KinematicTree<double>> still(stone, 1);
  VectorX<double> none;
  std::vector<IkTask<double>> tasks = {
      IkTask<double>::position(0, Vector3<double>::Zero(), Vector3<double>(1.0, 0.0, 0.0))};
  CHECK(still.solve(stone, tasks, VectorX<double>(), none).status == IkStatus::LocalMinimum);
  tasks[0].target.setZero();
  CHECK(still.solve(stone, tasks, VectorX<double>(), none).status == IkStatus::Reached);
}

TEST_CASE(
    "orientations and directions are reached, even from half a turn away, on free and coupled "
    "robots",
    "[robot]") {
  RobotDraws draws(91);
  int reached = 0;
  for (int round = 0; round < 40; ++round) {
    const KinematicTree<double> tree = draws.tree<double>(12, true, round % 2 == 0);
    const int frame = static_cast<int>(tree.links().size()) - 1;
    InverseKinematics<KinematicTree<double>> ik(tree, 2);
    BodyPoses<double> body_poses(tree);
    const VectorX<double> goal = draws.positions<double>(tree);
    VectorX<double> q = draws.positions<double>(tree);
    forward_kinematics<double>(tree, goal, body_poses);
    const Pose<double> there = link_pose(tree, body_poses, frame);
    const Vector3<double> axis = draws.vector().normalized();
    std::vector<IkTask<double>> tasks = {
        IkTask<double>::position(frame, Vector3<double>::Zero(), there.p),
        round % 3 == 0 ? IkTask<double>::pointing(frame, axis, there.R * axis)
                       : IkTask<double>::orientation(frame, there.R)};
    const IkReport<double> report = ik.solve(tree, tasks, VectorX<double>(), q);
    reached += report.status == IkStatus::Reached ? 1 : 0;
    forward_kinematics<double>(tree, q, body_poses);
    const Pose<double> here = link_pose(tree, body_poses, frame);
    if (report.status != IkStatus::Reached) continue;
    CHECK((here.p - there.p).norm() <= 1e-4);
    if (round % 3 == 0) {
      CHECK((here.R * axis - there.R * axis).norm() <= 1e-3);
    } else {
      CHECK((here.R - there.R).norm() <= 2e-3);
    }
  }
  CHECK(reached >= 38);
}

TEST_CASE("statuses name the reason to stop, and restarts are counted", "[robot]") {
  Hand reach;
  reach.aim_at(reach.anywhere());
  IkSettings<double> settings;
  settings.max_iterations = 1;
  settings.fallbacks = false;
  InverseKinematics<KinematicTree<double>> hasty(reach.tree, 5, settings);
  VectorX<double> q = reach.anywhere();
  CHECK(hasty.solve(reach.tree, reach.tasks, VectorX<double>(), q).status ==
        IkStatus::IterationLimit);
  for (IkTask<double>& task : reach.tasks) task.target.x() += 5.0;
  const IkReport<double> far = reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q, 3,
                                              [&] { return reach.uniform(); });
  CHECK(far.starts == 4);
  CHECK(far.status == IkStatus::LocalMinimum);

  RobotDraws draws(92);
  const KinematicTree<double> tree = draws.tree<double>(6, true, false);
  InverseKinematics<KinematicTree<double>> ik(tree, 1);
  VectorX<double> zero = VectorX<double>::Zero(tree.nq());  // quaternions of zero are no rotations
  const std::vector<IkTask<double>> tasks = {
      IkTask<double>::position(6, Vector3<double>::Zero(), Vector3<double>(5.0, 5.0, 5.0))};
  const IkReport<double> refused = ik.solve(tree, tasks, VectorX<double>(), zero);
  CHECK(refused.status == IkStatus::InvalidInput);
  CHECK_FALSE(refused.message.empty());
}

TEST_CASE("in float, tips reach their targets, and targets out of reach end at a minimum",
          "[robot]") {
  const KinematicTree<float> tree = hand34<float>();
  InverseKinematics<KinematicTree<float>> ik(tree, 5);
  BodyPoses<float> body_poses(tree);
  std::mt19937 random(93);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  int reached = 0, minima = 0;
  for (int round = 0; round < 40; ++round) {
    VectorX<float> goal(tree.nq()), q(tree.nq());
    for (Index i = 0; i < q.size(); ++i) {
      const float range = tree.upper()[i] - tree.lower()[i];
      goal[i] = tree.lower()[i] + uniform(random) * range;
      q[i] = goal[i] + 0.1f * (2 * uniform(random) - 1) * range;
    }
    forward_kinematics<float>(tree, goal, body_poses);
    std::vector<IkTask<float>> tasks;
    for (const FingerTip<float>& tip : hand34_tips<float>()) {
      const int link = tree.find_link(tip.link);
      tasks.push_back(IkTask<float>::position(link, Vector3<float>::Zero(),
                                              link_pose(tree, body_poses, link).p));
    }
    reached += ik.solve(tree, tasks, VectorX<float>(), q).status == IkStatus::Reached ? 1 : 0;
    tasks[0].target.x() += 2.0f;
    minima += ik.solve(tree, tasks, VectorX<float>(), q).status == IkStatus::LocalMinimum ? 1 : 0;
  }
  CHECK(reached == 40);
  CHECK(minima >= 30);  // the others stall because of rounding, and report it
}

TEST_CASE("inverse kinematics refuses another robot and missing frames with a message", "[robot]") {
  Reach reach;
  RobotDraws draws(45);
  reach.aim_at(reach.tree.neutral());
  const VectorX<double> none;
  VectorX<double> q = reach.tree.neutral();
  InverseKinematics<KinematicTree<double>> ik(reach.tree, 5);
  const KinematicTree<double> other = draws.tree<double>(26, false, false);
  VectorX<double> other_q = other.neutral();
  IkReport<double> report = ik.solve(other, reach.tasks, none, other_q);
  CHECK(report.status == IkStatus::InvalidInput);
  CHECK(report.message == "the robot is not the one that memory was made for");
  for (const int frame : {-1, static_cast<int>(reach.tree.links().size()), 1 << 30}) {
    reach.tasks[0].frame = frame;
    report = ik.solve(reach.tree, reach.tasks, none, q);
    CHECK(report.status == IkStatus::InvalidInput);
    CHECK(report.message == "a task's frame does not exist");
  }
}

TEST_CASE("the reference posture may be q itself", "[robot]") {
  const KinematicTree<double> hand = hand34<double>();
  IkSettings<double> settings;
  settings.posture_weight = 1e-3;
  const int tip = hand.find_link("index_tip");
  const std::vector<IkTask<double>> tasks = {IkTask<double>::position(
      tip, Vector3<double>::Zero(), Vector3<double>(2.0, 1.0, -1.0))};  // out of reach
  for (const int restarts : {0, 5}) {
    CAPTURE(restarts);
    InverseKinematics<KinematicTree<double>> ik(hand, 1, settings);
    VectorX<double> q = hand.neutral(), same = q;
    const VectorX<double> reference = q;
    std::mt19937 first(3), second(3);
    std::uniform_real_distribution<double> uniform;
    const auto a = ik.solve(hand, tasks, reference, q, restarts, [&] { return uniform(first); });
    const auto b = ik.solve(hand, tasks, same, same, restarts, [&] { return uniform(second); });
    CHECK(a.cost == b.cost);
    CHECK(a.iterations == b.iterations);
    CHECK(q == same);
  }
}

TEST_CASE("reserving a negative number of tasks reserves none", "[robot]") {
  Reach reach;
  reach.aim_at(reach.tree.neutral());
  const VectorX<double> none;
  VectorX<double> q = reach.tree.neutral();
  InverseKinematics<KinematicTree<double>> ik(reach.tree, -1);
  const IkReport<double> report = ik.solve(reach.tree, reach.tasks, none, q);
  CHECK(report.status == IkStatus::InvalidInput);
  CHECK(report.message == "there are more tasks than memory was made for");
}
