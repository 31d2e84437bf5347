#include "clothctl/robot/detail/task_priority.hpp"

#include <Eigen/Dense>

#include "robot/random_tree.hpp"
#include "robot/small_hand.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl_test;

namespace {

MatrixX<double> drawn_matrix(RobotDraws& draws, Index rows, Index columns) {
  return draws.entries<double>(rows * columns).reshaped(rows, columns);
}
/// The pseudo-inverse; singular values below `floor` count as zero.
MatrixX<double> pseudo_inverse(const MatrixX<double>& A, double floor = 1e-9) {
  const Eigen::JacobiSVD<MatrixX<double>> svd(A, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const VectorX<double> sigma = svd.singularValues();
  VectorX<double> inverse = VectorX<double>::Zero(sigma.size());
  for (Index k = 0; k < sigma.size(); ++k) inverse[k] = sigma[k] > floor ? 1.0 / sigma[k] : 0.0;
  return svd.matrixV() * inverse.asDiagonal() * svd.matrixU().transpose();
}

/// The formula at the top of the header, with dense pseudo-inverses.
VectorX<double> by_formula(const std::vector<MatrixX<double>>& J,
                           const std::vector<VectorX<double>>& x) {
  const Index n = J.front().cols();
  VectorX<double> velocity = VectorX<double>::Zero(n);
  MatrixX<double> N = MatrixX<double>::Identity(n, n);
  for (std::size_t k = 0; k < J.size(); ++k) {
    const MatrixX<double> inverse = pseudo_inverse(J[k] * N);
    velocity += inverse * (x[k] - J[k] * velocity);
    N -= inverse * (J[k] * N);
  }
  return velocity;
}

}  // namespace

TEST_CASE("levels follow the recursive formula, also rank-deficient ones and ones with many rows",
          "[robot]") {
  RobotDraws draws(61);
  PrioritySettings<double> exact;
  exact.damping = 0.0;
  for (int round = 0; round < 40; ++round) {
    const Index n = 12;
    std::vector<MatrixX<double>> J = {drawn_matrix(draws, 4, n), drawn_matrix(draws, 3, n),
                                      drawn_matrix(draws, 2, n)};
    if (round % 4 == 1) J[0].row(3) = J[0].row(0) - 2.0 * J[0].row(1);
    if (round % 4 == 2)
      J[1].row(1) = J[0].row(2) + J[0].row(1);  // one row of the second level depends on the first
    if (round % 4 == 3) J[2] = drawn_matrix(draws, 30, 2) * drawn_matrix(draws, 2, n);
    std::vector<VectorX<double>> x;
    for (const MatrixX<double>& level : J) x.push_back(draws.entries<double>(level.rows()));
    detail::TaskPriority<double> priority(n, 30, exact);
    const long before = clothctl_test::allocations();
    priority.start();
    Index ranks = 0;
    for (std::size_t k = 0; k < J.size(); ++k) ranks += priority.add(J[k], x[k]).rank;
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    const VectorX<double> expected = by_formula(J, x);
    CHECK((priority.velocity() - expected).norm() <= 1e-9 * expected.norm());
    CHECK(ranks == (round % 4 == 1 || round % 4 == 2 ? 8 : 9));
    CHECK(priority.freedom() == n - ranks);
  }
}

TEST_CASE("a second level does not affect the first in random configurations of a hand",
          "[robot]") {
  Reach reach;
  RobotDraws draws(62);
  const Index n = reach.tree.nv();
  for (const double damping : {0.0, 0.01, 0.05}) {
    PrioritySettings<double> settings;
    settings.damping = damping;
    detail::TaskPriority<double> priority(n, 15, settings);
    MatrixX<double> J(15, n), twist(6, n);
    for (int round = 0; round < 1000; ++round) {
      reach.aim_at(reach.anywhere());
      for (int f = 0; f < 5; ++f) {
        const IkTask<double>& task = reach.tasks[static_cast<std::size_t>(f)];
        point_jacobian<double>(reach.tree, reach.body_poses, task.frame, task.target, twist);
        J.middleRows(3 * f, 3) = twist.topRows(3);
      }
      link_jacobian<double>(reach.tree, reach.body_poses, reach.tree.find_link("palm5"), twist);
      const VectorX<double> first = draws.entries<double>(15, 0.3),
                            second = draws.entries<double>(3);
      priority.start();
      const detail::PriorityReport<double> tips = priority.add(J, first);
      const VectorX<double> alone = priority.velocity();
      priority.add(twist.bottomRows(3), second);
      CHECK((J * (priority.velocity() - alone)).norm() <= 1e-10 * first.norm());
      CHECK((J * priority.velocity() - first).norm() <= tips.residual + 1e-10 * first.norm());
      if (damping > 0.0) continue;
      if (tips.rank == 15) CHECK((J * priority.velocity() - first).norm() <= 1e-10 * first.norm());
      CHECK((priority.velocity() - alone).norm() > 1e-3);  // the second level has an effect
    }
  }
}

TEST_CASE(
    "constant damping is the papers' pseudo-inverse; damping near singularities meets "
    "well-conditioned tasks",
    "[robot]") {
  RobotDraws draws(63);
  for (const Index rows : {Index(4), Index(20)}) {
    const Index n = 9;
    const MatrixX<double> J = drawn_matrix(draws, rows, n);
    const VectorX<double> x = draws.entries<double>(rows);
    PrioritySettings<double> settings;
    settings.damping = 0.3;
    settings.form = PriorityDamping::Constant;
    detail::TaskPriority<double> constant(n, rows, settings);
    constant.start();
    constant.add(J, x);
    const MatrixX<double> H = J.transpose() * J + 0.09 * MatrixX<double>::Identity(n, n);
    const VectorX<double> expected = H.ldlt().solve(J.transpose() * x);
    CHECK((constant.velocity() - expected).norm() <= 1e-11 * expected.norm());

    settings.form = PriorityDamping::NearSingular;
    detail::TaskPriority<double> near(n, rows, settings);
    near.start();
    near.add(J, x);
    const VectorX<double> exact = pseudo_inverse(J) * x;
    CHECK((near.velocity() - exact).norm() <= 1e-10 * exact.norm());
  }
  // A nearly singular direction causes no large velocity, and later levels still do not affect it.
  MatrixX<double> thin = MatrixX<double>::Zero(2, 3);
  thin(0, 0) = 1.0;
  thin(1, 1) = 1e-4;
  detail::TaskPriority<double> priority(3, 3);
  priority.start();
  const detail::PriorityReport<double> report = priority.add(thin, VectorX<double>::Ones(2));
  CHECK(report.rank == 2);
  CHECK(priority.velocity()[0] == Approx(1.0));
  CHECK(priority.velocity()[1] <= 1.01);
  CHECK(report.residual == Approx(1.0).epsilon(1e-3));
  const VectorX<double> before = priority.velocity();
  priority.add(MatrixX<double>::Identity(3, 3), VectorX<double>::Constant(3, 7.0));
  CHECK((priority.velocity() - before).head(2).norm() < 1e-12);
  CHECK(priority.velocity()[2] == Approx(7.0));
}

TEST_CASE("held coordinates keep their velocity, and a posture uses the remaining freedom",
          "[robot]") {
  RobotDraws draws(64);
  const Index n = 8;
  const MatrixX<double> J = drawn_matrix(draws, 3, n);
  const VectorX<double> x = draws.entries<double>(3), z = draws.entries<double>(n);
  detail::TaskPriority<double> priority(n, 3);
  priority.start();
  priority.hold(2, 0.25);
  priority.hold(7, -1.0);
  const detail::PriorityReport<double> report = priority.add(J, x);
  CHECK(report.residual < 1e-12);
  CHECK(priority.velocity()[2] == Approx(0.25).epsilon(1e-13));
  CHECK(priority.velocity()[7] == Approx(-1.0).epsilon(1e-13));
  CHECK(priority.freedom() == 3);
  priority.add_posture(z);
  CHECK((J * priority.velocity() - x).norm() < 1e-12);
  CHECK(priority.velocity()[2] == Approx(0.25).epsilon(1e-13));
  VectorX<double> rest = z - priority.velocity();
  priority.project(rest);
  CHECK(rest.norm() < 1e-12);  // nothing closer to z remains possible
}

TEST_CASE("a level that is not finite or has a wrong size changes nothing", "[robot]") {
  detail::TaskPriority<double> priority(4, 3);
  priority.start();
  const MatrixX<double> J = MatrixX<double>::Identity(2, 4);
  VectorX<double> x = VectorX<double>::Ones(2);
  CHECK(priority.add(J, x).accepted);
  const VectorX<double> before = priority.velocity();
  MatrixX<double> bad = J;
  bad(1, 3) = std::nan("");
  CHECK_FALSE(priority.add(bad, x).accepted);
  CHECK_FALSE(priority.add(MatrixX<double>::Identity(2, 3), x).accepted);
  CHECK_FALSE(priority.add(MatrixX<double>::Identity(4, 4), VectorX<double>::Ones(4))
                  .accepted);  // more rows than reserved
  x[0] = std::nan("");
  CHECK_FALSE(priority.add(J, x).accepted);
  CHECK(priority.velocity() == before);
  CHECK(priority.freedom() == 2);
  PrioritySettings<double> settings;
  settings.damping = -1.0;
  CHECK(settings.validate() == "damping is negative or not finite");
  settings = PrioritySettings<double>();
  settings.rank_threshold = 0.0;
  CHECK(settings.validate() == "rank_threshold is not between 0 and 1");
  detail::TaskPriority<double> refused(4, 3, settings);
  refused.start();
  CHECK_FALSE(refused.add(J, VectorX<double>::Ones(2)).accepted);
}
