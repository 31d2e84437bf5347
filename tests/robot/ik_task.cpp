#include "clothctl/robot/ik_task.hpp"

#include <cmath>

#include "clothctl/robot/kinematic_tree_model.hpp"
#include "robot/random_tree.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("a task's Jacobian is minus the derivative of its residual", "[robot]") {
  using Model = KinematicTree<double>;
  RobotDraws draws(16);
  for (int trial = 0; trial < 30; ++trial) {
    const Model tree = draws.tree<double>(10, trial % 2 == 0, trial % 3 == 0);
    const Index n = tree.nv();
    auto work = articulated_traits<Model>::make_workspace(tree);
    const VectorX<double> q = draws.positions<double>(tree), step = draws.entries<double>(n, 1e-6);
    VectorX<double> moved(q.size());
    const int link = static_cast<int>(tree.links().size()) - 1;
    articulated_traits<Model>::forward_kinematics(tree, q, work);
    const Pose<double> here = link_pose(tree, work.body_poses, link);
    const Vector3<double> axis = draws.vector().normalized(),
                          near = (here.R * axis + 1e-3 * draws.vector()).normalized();
    const Matrix3<double> turned = Eigen::AngleAxisd(1e-3, axis) * here.R;
    for (IkTask<double> task :
         {IkTask<double>::position(link, draws.vector(), draws.vector()),
          IkTask<double>::orientation(link, turned), IkTask<double>::pointing(link, axis, near)}) {
      task.weight = 2.0;
      MatrixX<double> twist(6, n), J(3, n);
      Vector3<double> before, after;
      articulated_traits<Model>::forward_kinematics(tree, q, work);
      task_residual<Model, double>(tree, work, task, before);
      task_jacobian<Model, double>(tree, work, task, twist, J);
      tree.advance(q, step, moved);
      articulated_traits<Model>::forward_kinematics(tree, moved, work);
      task_residual<Model, double>(tree, work, task, after);
      const Vector3<double> change = J * step;
      CHECK((before - after - change).norm() < 3e-3 * change.norm() + 1e-11);
    }
  }
}

TEST_CASE("validate names the first bad setting of inverse kinematics", "[robot]") {
  const IkSettings<double> good;
  CHECK(good.validate().empty());
  IkSettings<double> settings = good;
  settings.tolerance = -1.0;
  CHECK(settings.validate() == "tolerance is not a positive length");
  settings = good;
  settings.gradient_tolerance = std::nan("");
  CHECK(settings.validate() == "gradient_tolerance is not a positive number");
  settings = good;
  settings.posture_weight = -1e-9;
  CHECK(settings.validate() == "posture_weight is negative or not finite");
  settings = good;
  settings.damping = 0.0;
  CHECK(settings.validate() == "damping is not a positive number");
  settings = good;
  settings.max_iterations = 0;
  CHECK(settings.validate() == "max_iterations is less than 1");
}

TEST_CASE("the tolerance of the gradient leaves room for rounding", "[robot]") {
  CHECK(IkSettings<double>().gradient_tolerance == 1e-6);
  CHECK(IkSettings<float>().gradient_tolerance ==
        Approx(4 * std::sqrt(clothctl::scalar_traits<float>::epsilon())));
}

TEST_CASE("every reason to stop has its own name", "[robot]") {
  CHECK(to_string(IkStatus::Reached) == "reached");
  CHECK(to_string(IkStatus::LocalMinimum) == "local_minimum");
  CHECK(to_string(IkStatus::Stalled) == "stalled");
  CHECK(to_string(IkStatus::IterationLimit) == "iteration_limit");
  CHECK(to_string(IkStatus::InvalidInput) == "invalid_input");
}
