#include "clothctl/robot/ik_task.hpp"

#include "clothctl/robot/tree_model.hpp"
#include "robot/random_tree.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("a rotation's vector turns back into it, up to half a turn", "[robot]") {
  RobotDraws draws(14);
  const double pi = std::acos(-1.0);
  for (const double angle : {0.0, 1e-12, 1e-5, 0.7, 2.0, 3.1, pi - 1e-7, pi}) {
    for (int k = 0; k < 10; ++k) {
      const Vector3<double> axis =
          k < 3 ? Vector3<double>(Vector3<double>::Unit(k)) : Vector3<double>(draws.vector().normalized());
      const Matrix3<double> R = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
      const Vector3<double> w = clothctl::robot::detail::rotation_vector<double>(R);
      CHECK(w.norm() == Approx(angle).margin(1e-15));
      const Matrix3<double> back = w.norm() > 0
                                       ? Matrix3<double>(Eigen::AngleAxisd(w.norm(), w.normalized()).toRotationMatrix())
                                       : Matrix3<double>::Identity();
      CHECK((back - R).norm() < 1e-14);
    }
  }
}

TEST_CASE("a turn from one direction to another arrives, also where they are opposite", "[robot]") {
  RobotDraws draws(15);
  for (int k = 0; k < 30; ++k) {
    const Vector3<double> from = draws.vector().normalized();
    const Vector3<double> to = k % 3 == 0   ? Vector3<double>(-from)
                               : k % 3 == 1 ? from
                                            : Vector3<double>(draws.vector().normalized());
    const Vector3<double> w = clothctl::robot::detail::turn_from_to<double>(from, to);
    const Vector3<double> moved = w.norm() > 0 ? Vector3<double>(Eigen::AngleAxisd(w.norm(), w.normalized()) * from) : from;
    CHECK((moved - to).norm() < 1e-13);
  }
}

TEST_CASE("a task's Jacobian is how a step lowers its residual", "[robot]") {
  using Model = Tree<double>;
  RobotDraws draws(16);
  for (int trial = 0; trial < 30; ++trial) {
    const Model tree = draws.tree<double>(10, trial % 2 == 0, trial % 3 == 0);
    const Index n = tree.velocities();
    auto work = articulated_traits<Model>::make_workspace(tree);
    const VectorX<double> q = draws.positions<double>(tree), step = draws.entries<double>(n, 1e-6);
    VectorX<double> moved(q.size());
    const int link = static_cast<int>(tree.links().size()) - 1;
    articulated_traits<Model>::place(tree, q, work);
    const Pose<double> here = link_pose(tree, work.kinematics, link);
    const Vector3<double> axis = draws.vector().normalized(), near = (here.R * axis + 1e-3 * draws.vector()).normalized();
    const Matrix3<double> turned = Eigen::AngleAxisd(1e-3, axis) * here.R;
    for (IkTask<double> task : {IkTask<double>::position(link, draws.vector(), draws.vector()),
                                IkTask<double>::orientation(link, turned), IkTask<double>::pointing(link, axis, near)}) {
      task.weight = 2.0;
      MatrixX<double> twist(6, n), J(3, n);
      Vector3<double> before, after;
      articulated_traits<Model>::place(tree, q, work);
      task_residual<Model, double>(tree, work, task, before);
      task_jacobian<Model, double>(tree, work, task, twist, J);
      tree.advance(q, step, moved);
      articulated_traits<Model>::place(tree, moved, work);
      task_residual<Model, double>(tree, work, task, after);
      const Vector3<double> change = J * step;
      CHECK((before - after - change).norm() < 3e-3 * change.norm() + 1e-11);
    }
  }
}
