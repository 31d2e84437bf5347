#include "clothctl/robot/detail/ik_problem.hpp"

#include "robot/random_tree.hpp"
#include "robot/small_hand.hpp"
#include "support/catch.hpp"

using namespace clothctl_test;

namespace {

/// Tasks of each kind, with targets that are not met.
std::vector<IkTask<double>> mixed_tasks(RobotDraws& draws, int frames) {
  std::vector<IkTask<double>> tasks;
  for (int k = 0; k < 6; ++k) {
    const int frame = draws.below(frames);
    if (k % 3 == 0) {
      tasks.push_back(IkTask<double>::position(frame, draws.vector(), draws.vector()));
    } else if (k % 3 == 1) {
      tasks.push_back(IkTask<double>::orientation(frame, draws.rotation(), 0.3));
    } else {
      tasks.push_back(IkTask<double>::pointing(frame, draws.vector().normalized(),
                                               draws.vector().normalized(), 0.2));
    }
  }
  return tasks;
}

}  // namespace

TEST_CASE("the direction is the cost's steepest descent for every kind of task and joint",
          "[robot]") {
  RobotDraws draws(41);
  for (int round = 0; round < 10; ++round) {
    const KinematicTree<double> tree = draws.tree<double>(12, round % 2 == 0, round % 3 == 0);
    const std::vector<IkTask<double>> tasks =
        mixed_tasks(draws, static_cast<int>(tree.links().size()));
    const VectorX<double> q = draws.positions<double>(tree), reference = draws.positions(tree);
    detail::IkProblem<KinematicTree<double>> problem(tree, 6);
    problem.start(tasks, reference, 0.0);
    problem.evaluate(tree, tasks, q);
    problem.linearise(tree, tasks, q);
    const double h = 1e-6;
    VectorX<double> step = VectorX<double>::Zero(tree.nv()), moved = q;
    for (Index i = 0; i < tree.nv(); ++i) {
      step.setZero();
      step[i] = h;
      tree.advance(q, step, moved);
      const double above = problem.evaluate(tree, tasks, moved);
      step[i] = -h;
      tree.advance(q, step, moved);
      const double below = problem.evaluate(tree, tasks, moved);
      // To first order, a pointing residual shrinks along its own rotation only, and an orientation
      // residual along the shorter one.
      CHECK(problem.direction()[i] ==
            Approx(-(above - below) / (2 * h)).margin(2e-7 * problem.residuals().norm()));
    }
    CHECK(problem.jacobian().rows() == 18);
    const VectorX<double> direction = problem.jacobian().transpose() * problem.residuals();
    CHECK((direction - problem.direction()).norm() <= 1e-12 * direction.norm());
  }
}

TEST_CASE("a step stays within the limits, and the posture is a part of the cost", "[robot]") {
  Reach reach;
  const VectorX<double> goal = reach.anywhere(), q = reach.anywhere();
  reach.aim_at(goal);
  detail::IkProblem<KinematicTree<double>> problem(reach.tree, 5);
  problem.start(reach.tasks, goal, 0.25);
  const double cost = problem.evaluate(reach.tree, reach.tasks, q);
  problem.linearise(reach.tree, reach.tasks, q);
  CHECK(cost == Approx(0.5 * problem.residuals().squaredNorm() + 0.125 * (goal - q).squaredNorm()));
  CHECK((problem.pull() - 0.25 * (goal - q)).norm() < 1e-12);
  CHECK((q + problem.below() - reach.tree.lower()).norm() < 1e-12);
  CHECK((q + problem.above() - reach.tree.upper()).norm() < 1e-12);

  // Subtracting the residuals at a configuration makes it the solution.
  problem.start(reach.tasks, goal, 0.0);
  problem.evaluate(reach.tree, reach.tasks, q);
  const VectorX<double> there = problem.current_residuals();
  problem.lead(there, 1.0);
  CHECK(problem.evaluate(reach.tree, reach.tasks, q) < 1e-28);

  // A gradient that only limits block counts as zero.
  VectorX<double> low = reach.tree.lower();
  for (IkTask<double>& task : reach.tasks) task.target = Vector3<double>(-100.0, -100.0, -100.0);
  problem.start(reach.tasks, goal, 0.0);
  problem.evaluate(reach.tree, reach.tasks, low);
  problem.linearise(reach.tree, reach.tasks, low);
  for (Index i = 0; i < 3; ++i)
    CHECK(problem.direction()[i] < 0.0);  // the sliding joints would move further
  CHECK(problem.below().head(3).norm() < 1e-12);
}

TEST_CASE("validate names the error of a problem", "[robot]") {
  Reach reach;
  const VectorX<double> q = reach.anywhere();
  reach.aim_at(q);
  const detail::IkProblem<KinematicTree<double>> problem(reach.tree, 5);
  const VectorX<double> none;
  CHECK(problem.validate(reach.tree, reach.tasks, none, q).empty());
  CHECK(problem.validate(reach.tree, reach.tasks, none, none) == "q is not of the robot's size");
  CHECK(problem.validate(reach.tree, reach.tasks, q.head(3), q) ==
        "the reference is not of the robot's size");
  VectorX<double> bad = q;
  bad[4] = std::nan("");
  CHECK(problem.validate(reach.tree, reach.tasks, none, bad) == "q holds NaN or an infinity");
  CHECK(problem.validate(reach.tree, reach.tasks, bad, q) ==
        "the reference holds NaN or an infinity");
  CHECK(problem.validate(RobotDraws(3).tree<double>(4, false, false), reach.tasks, none, q) ==
        "the robot is not the one that memory was made for");
  std::vector<IkTask<double>> tasks = reach.tasks;
  tasks[1].target[0] = std::nan("");
  CHECK(problem.validate(reach.tree, tasks, none, q) ==
        "a task's point, target or rotation holds NaN or an infinity");
  tasks = reach.tasks;
  tasks[0].weight = -1.0;
  CHECK(problem.validate(reach.tree, tasks, none, q) ==
        "a task's weight is negative or not finite");
  tasks = reach.tasks;
  tasks[0] = IkTask<double>::pointing(3, Vector3<double>(0, 0, 2), Vector3<double>(0, 0, 1));
  CHECK(problem.validate(reach.tree, tasks, none, q) ==
        "a pointing task's axis or direction is not a unit vector");
  for (const Matrix3<double>& bad_rotation :
       {Matrix3<double>(Matrix3<double>::Zero()), Matrix3<double>(5 * Matrix3<double>::Identity()),
        Matrix3<double>(-Matrix3<double>::Identity())}) {
    tasks[0] = IkTask<double>::orientation(3, bad_rotation);
    CHECK(problem.validate(reach.tree, tasks, none, q) ==
          "an orientation task's target is not a rotation matrix");
  }
  for (const int frame : {-1, static_cast<int>(reach.tree.links().size())}) {
    tasks = reach.tasks;
    tasks[4].frame = frame;
    CHECK(problem.validate(reach.tree, tasks, none, q) == "a task's frame does not exist");
  }
  tasks = reach.tasks;
  tasks[4].target[2] = 1e160;
  CHECK(problem.validate(reach.tree, tasks, none, q) ==
        "a task's point or target holds a value beyond 1e15");
  tasks = reach.tasks;
  tasks.push_back(tasks[0]);
  CHECK(problem.validate(reach.tree, tasks, none, q) ==
        "there are more tasks than memory was made for");
}
