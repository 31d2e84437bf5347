#include "clothctl/robot/detail/motion.hpp"

#include "robot/random_tree.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("accelerations caused by velocities are second derivatives of positions", "[robot]") {
  RobotDraws draws(12);
  for (int trial = 0; trial < 10; ++trial) {
    const KinematicTree<double> tree = draws.tree<double>(10, trial % 2 == 0, trial % 3 == 0);
    const Index n = tree.nv();
    BodyPoses<double> here(tree), ahead(tree), behind(tree);
    detail::BodyMotions<double> motion(tree);
    const VectorX<double> q = draws.positions<double>(tree), qd = draws.entries<double>(n);
    VectorX<double> moved(q.size());
    forward_kinematics<double>(tree, q, here);
    const double h = 1e-4;
    tree.advance(q, h * qd, moved);
    forward_kinematics<double>(tree, moved, ahead);
    tree.advance(q, -h * qd, moved);
    forward_kinematics<double>(tree, moved, behind);
    const Vector3<double> still = Vector3<double>::Zero();
    clothctl::detail::compute_motions<double>(tree, here, qd, VectorX<double>(), still, motion);
    for (std::size_t i = 0; i < tree.bodies().size(); ++i) {
      const auto& own = motion.bodies[i];
      const Vector3<double> second =
          (ahead.poses[i].p - 2 * here.poses[i].p + behind.poses[i].p) / (h * h);
      CHECK((own.a - second).norm() < 1e-4 * (1 + second.norm()));
      const Matrix3<double> spin =
          (ahead.poses[i].R - behind.poses[i].R) / (2 * h) * here.poses[i].R.transpose();
      CHECK((own.w - Vector3<double>(spin(2, 1), spin(0, 2), spin(1, 0))).norm() <
            1e-5 * (1 + own.w.norm()));
      CHECK((own.inertia.h -
             tree.bodies()[i].inertia.mass * (here.poses[i].R * tree.bodies()[i].inertia.com))
                .norm() < 1e-14);
    }
  }
}
