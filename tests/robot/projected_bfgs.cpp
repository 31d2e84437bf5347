#include "clothctl/robot/detail/projected_bfgs.hpp"

#include <Eigen/Dense>

#include "robot/random_tree.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl_test;
using clothctl::MatrixX;

namespace {

MatrixX<double> drawn_square(RobotDraws& draws, Index n) {
  const MatrixX<double> G = draws.entries<double>(n * n).reshaped(n, n);
  return G * G.transpose() + MatrixX<double>::Identity(n, n);
}

}  // namespace

TEST_CASE("exact steps on a quadratic function reach its minimum within a number of steps",
          "[robot]") {
  RobotDraws draws(81);
  const Index n = 8;
  const MatrixX<double> H = drawn_square(draws, n);
  const VectorX<double> goal = draws.entries<double>(n);
  const VectorX<double> far = VectorX<double>::Constant(n, 1e9), near = -far;
  detail::ProjectedBfgs<double> bfgs(n);
  VectorX<double> x = VectorX<double>::Zero(n), step(n);
  bfgs.start(MatrixX<double>::Zero(3, n), 1.0);
  for (Index k = 0; k < n; ++k) {
    const VectorX<double> g = H * (goal - x);
    bfgs.find_step(g, near, far, step);
    CHECK(g.dot(step) > 0.0);
    step *= g.dot(step) / step.dot(H * step);
    x += step;
    bfgs.update(step, H * step);
  }
  CHECK((x - goal).norm() < 1e-8 * goal.norm());
  const VectorX<double> g = H * (goal - x), change = H * step;
  const long start = clothctl_test::allocations();
  bfgs.find_step(g, near, far, step);
  bfgs.update(step, change);
  const long own = clothctl_test::allocations() - start;
  if (clothctl_test::allocation_counting_works()) CHECK(own == 0);
}

TEST_CASE("entries at their limits stay, and negative curvature leaves the matrix unchanged",
          "[robot]") {
  RobotDraws draws(82);
  const Index n = 5;
  detail::ProjectedBfgs<double> bfgs(n);
  const MatrixX<double> J = draws.entries<double>(3 * n).reshaped(3, n);
  bfgs.start(J, 0.5);
  VectorX<double> g = draws.entries<double>(n), step(n), below = VectorX<double>::Constant(n, -1.0),
                  above = -below;
  g[1] = 2.0;
  above[1] = 0.0;
  g[3] = -1.0;
  below[3] = 0.0;
  bfgs.find_step(g, below, above, step);
  CHECK(step[1] == 0.0);
  CHECK(step[3] == 0.0);
  MatrixX<double> H = J.transpose() * J + 0.5 * MatrixX<double>::Identity(n, n);
  const VectorX<double> rest = H * step - g;
  for (const Index i : {0, 2, 4}) CHECK(std::abs(rest[i]) < 1e-12);

  for (int k = 0; k < 50; ++k) {  // with curvature of any sign, steps stay descent directions
    const VectorX<double> s = draws.entries<double>(n), y = draws.entries<double>(n);
    bfgs.update(s, y);
    const VectorX<double> slope = draws.entries<double>(n);
    bfgs.find_step(slope, VectorX<double>::Constant(n, -1.0), VectorX<double>::Constant(n, 1.0),
                   step);
    CHECK(slope.dot(step) > 0.0);
  }
  VectorX<double> bad = VectorX<double>::Constant(n, std::nan(""));
  bfgs.update(VectorX<double>::Ones(n), bad);
  bfgs.find_step(g, below, above, step);
  CHECK(clothctl::all_finite(step));
}
