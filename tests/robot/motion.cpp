#include "clothctl/robot/motion.hpp"

#include "robot/random_tree.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("accelerations that velocities cause are second derivatives of places", "[robot]") {
  RobotDraws draws(12);
  for (int trial = 0; trial < 10; ++trial) {
    const Tree<double> tree = draws.tree<double>(10, trial % 2 == 0, trial % 3 == 0);
    const Index n = tree.velocities();
    Kinematics<double> here(tree), ahead(tree), behind(tree);
    Motion<double> motion(tree);
    const VectorX<double> q = draws.positions<double>(tree), qd = draws.entries<double>(n);
    VectorX<double> moved(q.size());
    forward_kinematics<double>(tree, q, here);
    const double h = 1e-4;
    tree.advance(q, h * qd, moved);
    forward_kinematics<double>(tree, moved, ahead);
    tree.advance(q, -h * qd, moved);
    forward_kinematics<double>(tree, moved, behind);
    clothctl::robot::detail::place_inertias(tree, here, motion);
    clothctl::robot::detail::place_velocities<double>(tree, here, qd, motion);
    std::vector<Vector3<double>> turn(tree.bodies().size()), move(tree.bodies().size());
    for (std::size_t i = 0; i < tree.bodies().size(); ++i) {
      const int p = tree.bodies()[i].parent;
      const auto& own = motion.bodies[i];
      turn[i] = own.c_turn;
      move[i] = own.c_move;
      if (p >= 0) {
        turn[i] += turn[static_cast<std::size_t>(p)];
        move[i] += move[static_cast<std::size_t>(p)] + turn[static_cast<std::size_t>(p)].cross(here.places[i].from_parent);
      }
      const Vector3<double> second = (ahead.places[i].p - 2 * here.places[i].p + behind.places[i].p) / (h * h);
      CHECK((move[i] - second).norm() < 1e-4 * (1 + second.norm()));
      const Matrix3<double> spin = (ahead.places[i].R - behind.places[i].R) / (2 * h) * here.places[i].R.transpose();
      CHECK((own.w - Vector3<double>(spin(2, 1), spin(0, 2), spin(1, 0))).norm() < 1e-5 * (1 + own.w.norm()));
      CHECK((own.h - tree.bodies()[i].inertia.mass * (here.places[i].R * tree.bodies()[i].inertia.com)).norm() < 1e-14);
    }
  }
}
