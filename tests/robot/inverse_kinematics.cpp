#include "clothctl/robot/inverse_kinematics.hpp"

#include "clothctl/robot/tree_model.hpp"
#include "robot/random_tree.hpp"
#include "robot/small_hand.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

struct Hand : Reach {
  InverseKinematics<Tree<double>> ik{tree, 6};
};

}  // namespace

TEST_CASE("five tips at once are reached within the limits, from near and with restarts from anywhere", "[robot]") {
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
    const IkReport<double> far =
        reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q, 20, [&] { return reach.uniform(); });
    reached += far.status == IkStatus::Reached ? 1 : 0;
    CHECK(reach.within_limits(q));
    reach.aim_at(q);  // what is reported is so
    if (far.status == IkStatus::Reached) {
      const std::vector<IkTask<double>> there = reach.tasks;
      reach.aim_at(goal);
      for (int f = 0; f < 5; ++f)
        CHECK((there[static_cast<std::size_t>(f)].target - reach.tasks[static_cast<std::size_t>(f)].target).norm() <= 1e-4);
    }
  }
  CHECK(reached >= 99);
}

TEST_CASE("out of reach ends at a minimum that the limits hold, and says so", "[robot]") {
  Hand reach;
  for (int k = 0; k < 60; ++k) {
    reach.aim_at(reach.anywhere());
    if (k % 2 == 0) {
      for (IkTask<double>& task : reach.tasks) task.target += Vector3<double>(3.0, 0.0, 0.0);
    } else {
      reach.tasks[2].target += Vector3<double>(10.0, -3.0, 1.0);  // torn apart
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
      forward_kinematics<double>(reach.tree, at, reach.kinematics);
      double sum = 0;
      for (const IkTask<double>& task : reach.tasks) {
        sum += (task.target - link_pose(reach.tree, reach.kinematics, task.frame) * task.local).squaredNorm();
      }
      return sum;
    };
    const double best = cost(q);
    for (Index i = 0; i < q.size(); ++i) {
      for (const double step : {-1e-3, 1e-3}) {
        VectorX<double> moved = q;
        moved[i] = std::min(std::max(moved[i] + step, reach.tree.lower()[i]), reach.tree.upper()[i]);
        CHECK(cost(moved) >= best * (1 - 1e-8));
      }
    }
  }
}

TEST_CASE("a posture is kept where the tasks leave room, and more rows than joints are solved too", "[robot]") {
  Hand reach;
  const VectorX<double> goal = reach.anywhere();
  reach.aim_at(goal);
  IkSettings<double> settings;
  settings.posture_weight = 1e-6;
  InverseKinematics<Tree<double>> drawn(reach.tree, 5, settings);
  VectorX<double> free = reach.tree.neutral(), kept = free;
  REQUIRE(reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), free, 20, [&] { return reach.uniform(); }).status ==
          IkStatus::Reached);
  kept = free;
  const IkReport<double> report = drawn.solve(reach.tree, reach.tasks, goal, kept);
  CHECK(report.error < 1e-3);
  CHECK((kept - goal).norm() < (free - goal).norm());

  std::vector<IkTask<double>> many;  // twelve points of each finger tip: 180 rows, 26 joints
  forward_kinematics<double>(reach.tree, goal, reach.kinematics);
  RobotDraws draws(18);
  for (const IkTask<double>& task : reach.tasks) {
    for (int k = 0; k < 12; ++k) {
      const Vector3<double> local = 0.01 * draws.vector();
      many.push_back(IkTask<double>::position(task.frame, local, link_pose(reach.tree, reach.kinematics, task.frame) * local));
    }
  }
  settings = IkSettings<double>();
  settings.tolerance = 1e-8;
  InverseKinematics<Tree<double>> wide(reach.tree, static_cast<int>(many.size()), settings);
  VectorX<double> q = goal;
  for (Index i = 0; i < q.size(); ++i) q[i] += 0.1 * (reach.uniform() - 0.5);
  const IkReport<double> matched = wide.solve(reach.tree, many, VectorX<double>(), q);
  CHECK(matched.status == IkStatus::Reached);
  forward_kinematics<double>(reach.tree, q, reach.kinematics);
  for (const IkTask<double>& task : many) {
    CHECK((link_pose(reach.tree, reach.kinematics, task.frame) * task.local - task.target).norm() <= 1e-8);
  }
}

TEST_CASE("bad input is refused and q is left alone", "[robot]") {
  Hand reach;
  reach.aim_at(reach.anywhere());
  VectorX<double> q = reach.tree.neutral();
  const VectorX<double> before = q;
  reach.tasks[2].target[1] = std::nan("");
  CHECK(reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q).status == IkStatus::InvalidInput);
  CHECK(reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q, 5, [] { return 0.5; }).status == IkStatus::InvalidInput);
  CHECK(q == before);
  reach.aim_at(before);
  reach.tasks.resize(7, reach.tasks[0]);
  CHECK(reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q).status == IkStatus::InvalidInput);
  reach.tasks.resize(5);
  CHECK(reach.ik.solve(reach.tree, reach.tasks, VectorX<double>::Zero(3), q).status == IkStatus::InvalidInput);
  q[0] = std::nan("");
  CHECK(reach.ik.solve(reach.tree, reach.tasks, VectorX<double>(), q).status == IkStatus::InvalidInput);
}

TEST_CASE("starts near a local minimum are led to the targets all the same, and the answer is the best met", "[robot]") {
  Hand reach;
  IkSettings<double> settings;
  settings.fallbacks = false;
  InverseKinematics<Tree<double>> plain(reach.tree, 5, settings);
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
    // The report is of the q that is answered.
    forward_kinematics<double>(reach.tree, r, reach.kinematics);
    double error = 0;
    for (const IkTask<double>& task : reach.tasks) {
      error = std::max(error, (task.target - link_pose(reach.tree, reach.kinematics, task.frame) * task.local).norm());
    }
    CHECK(error == Approx(with.error));
  }
  CHECK(reached > plainly);
}
