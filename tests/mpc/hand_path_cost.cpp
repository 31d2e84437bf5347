#include "clothctl/mpc/detail/hand_path_cost.hpp"

#include <cmath>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

constexpr Index kFrames = 9;
constexpr double kStep = 0.02;  // s

PlannerWeights<double> some_weights() {
  PlannerWeights<double> w;
  w.velocity = 0.02;
  w.smooth = 0.003;
  w.jerk = 0.01;
  w.anchor = 3;
  return w;
}

Points<double> places() { return Points<double>{{0.1, 0.4}, {0.2, 0.5}, {0.3, 0.6}}; }
Points<double> speeds() { return Points<double>{{0.5, -0.2}, {0.0, 0.3}, {0.1, 0.4}}; }

MatrixX<double> wave(double phase) {
  MatrixX<double> out(6, kFrames);
  for (Index i = 0; i < out.size(); ++i) out(i) = std::sin(0.7 * static_cast<double>(i) + phase);
  return out;
}

}  // namespace

TEST_CASE("a path that goes on evenly costs its velocity alone", "[mpc]") {
  PlannerWeights<double> w = some_weights();
  MatrixX<double> path(6, kFrames);
  for (Index k = 0; k < kFrames; ++k) {
    const Points<double> there = places() + kStep * static_cast<double>(k + 1) * speeds();
    path.col(k) = there.reshaped();
  }
  const detail::HandPathCost<double> cost(w, kStep, places(), speeds(), MatrixX<double>(6, 0));
  CHECK(cost.cost(path) == Approx(w.velocity * kFrames * speeds().squaredNorm()).epsilon(1e-9));
  // At its anchor it costs no more.
  const detail::HandPathCost<double> held(w, kStep, places(), speeds(), path);
  CHECK(held.cost(path) == Approx(cost.cost(path)).epsilon(1e-12));
}

TEST_CASE("gradient, Hessian and solves of the cost of paths agree", "[mpc]") {
  detail::HandPathCost<double> cost(some_weights(), kStep, places(), speeds(), wave(2));
  MatrixX<double> gradient = MatrixX<double>::Zero(6, kFrames), other = gradient;
  const MatrixX<double> path = wave(0), way = wave(1);
  cost.add_half_gradient(path, gradient);
  cost.add_half_gradient(path + way, other);
  MatrixX<double> product = MatrixX<double>::Zero(6, kFrames);
  cost.add_product(way, product);
  CHECK((other - gradient - product).norm() < 1e-9 * product.norm());
  CHECK(cost.cost(path + way) == Approx(cost.cost(path) + 2 * gradient.cwiseProduct(way).sum() +
                                        product.cwiseProduct(way).sum()));

  cost.factorize(kFrames, 5.0);
  MatrixX<double> solved = product + 5.0 * way;
  cost.solve(solved);
  CHECK((solved - way).norm() < 1e-11 * way.norm());
}
