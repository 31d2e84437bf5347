#include "clothctl/robot/mass_matrix.hpp"

#include <Eigen/Dense>

#include "clothctl/robot/inverse_dynamics.hpp"
#include "robot/random_tree.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("the mass matrix is what accelerations take, symmetric and definite", "[robot]") {
  RobotDraws draws(6);
  for (int trial = 0; trial < 40; ++trial) {
    const Tree<double> tree = draws.tree<double>(12, trial % 2 == 0, trial % 3 == 0);
    const Index n = tree.velocities();
    Kinematics<double> kinematics(tree);
    InverseDynamicsWorkspace<double> inverse(tree);
    MassMatrixWorkspace<double> work(tree);
    forward_kinematics<double>(tree, draws.positions<double>(tree), kinematics);
    MatrixX<double> M(n, n);
    const long before = clothctl_test::allocations();
    mass_matrix<double>(tree, kinematics, work, M);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK((M - M.transpose()).norm() <= 1e-14 * M.norm());
    CHECK(M.llt().info() == Eigen::Success);
    VectorX<double> zero = VectorX<double>::Zero(n), column(n);
    for (Index k = 0; k < n; ++k) {
      const VectorX<double> unit = VectorX<double>::Unit(n, k);
      inverse_dynamics<double>(tree, kinematics, zero, unit, Vector3<double>(zero.head<3>()), inverse, column);
      CHECK((M.col(k) - column).norm() <= 1e-13 * M.norm());
    }
  }
}
