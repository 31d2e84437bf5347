#include "clothctl/robot/detail/damped_least_squares.hpp"

#include <Eigen/Dense>

#include "robot/random_tree.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl_test;
using clothctl::MatrixX;

namespace {

struct Step {
  MatrixX<double> J;
  VectorX<double> e, pull, damping, below, above, step;

  Step(RobotDraws& draws, Index rows, Index n, double room) {
    J = draws.entries<double>(rows * n).reshaped(rows, n);
    e = draws.entries<double>(rows);
    pull = draws.entries<double>(n, 0.1);
    damping = (draws.entries<double>(n).array().abs() + 0.01).matrix();
    below = -room * (draws.entries<double>(n).array().abs()).matrix();
    above = room * (draws.entries<double>(n).array().abs()).matrix();
    step.setZero(n);
  }
  MatrixX<double> hessian() const {
    MatrixX<double> H = J.transpose() * J;
    H.diagonal() += damping;
    return H;
  }
  VectorX<double> right() const { return J.transpose() * e + pull; }
};

}  // namespace

TEST_CASE("without limits a step solves the damped normal equations with few or many rows",
          "[robot]") {
  RobotDraws draws(51);
  for (const auto& [rows, n] : {std::pair<Index, Index>{3, 20}, {15, 34}, {20, 20}, {60, 12}}) {
    Step s(draws, rows, n, 1e6);
    detail::DampedLeastSquares<double> limited(rows, n);
    limited.solve(s.J, s.e, s.pull, s.damping, s.below, s.above, s.step);
    CHECK((s.hessian() * s.step - s.right()).norm() <= 1e-11 * s.right().norm());
  }
}

TEST_CASE("entries beyond their limits stop there and the others compensate", "[robot]") {
  RobotDraws draws(52);
  int locked_sometimes = 0;
  for (const auto& [rows, n] : {std::pair<Index, Index>{15, 34}, {60, 12}, {6, 6}}) {
    for (int round = 0; round < 30; ++round) {
      Step s(draws, rows, n, 0.3);
      detail::DampedLeastSquares<double> limited(rows, n);
      const long before = clothctl_test::allocations();
      limited.solve(s.J, s.e, s.pull, s.damping, s.below, s.above, s.step);
      const long taken = clothctl_test::allocations() - before;
      if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
      const VectorX<double> rest = s.hessian() * s.step - s.right();
      for (Index i = 0; i < n; ++i) {
        CHECK((s.step[i] >= s.below[i] && s.step[i] <= s.above[i]));
        const bool at_limit = !(s.step[i] > s.below[i]) || !(s.step[i] < s.above[i]);
        if (at_limit) {
          ++locked_sometimes;
        } else {
          CHECK(std::abs(rest[i]) <=
                1e-10 * s.right().norm());  // the best for the values of the others
        }
      }
    }
  }
  CHECK(locked_sometimes > 50);
}
