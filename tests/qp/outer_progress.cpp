#include "clothctl/qp/detail/outer_progress.hpp"

#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// Adds the same step until the progress has stalled, at most 1000 times. Returns the count.
int steps_until_stalled(detail::OuterProgress<double>& progress, double dual, double primal,
                        bool changed, bool moved) {
  int steps = 0;
  for (; steps < 1000 && !progress.stalled(); ++steps) progress.add(dual, primal, changed, moved);
  return steps;
}

}  // namespace

TEST_CASE("steps that change nothing end a solve, soonest where x does not move", "[qp]") {
  detail::OuterProgress<double> progress;
  progress.restart();
  const int moving = steps_until_stalled(progress, 50.0, 3.0, false, true);
  progress.restart();
  CHECK_FALSE(progress.stalled());
  const int still = steps_until_stalled(progress, 50.0, 3.0, false, false);
  CHECK(moving < 50);
  CHECK(still < 12);
  progress.restart();
  CHECK(steps_until_stalled(progress, 50.0, 3.0, true, false) == 1000);
}

TEST_CASE("a residual that falls is progress, one within its tolerance is not", "[qp]") {
  detail::OuterProgress<double> progress;
  progress.restart();
  double residual = 1e9;
  for (int k = 0; k < 500; ++k) progress.add(1e20, residual *= 0.97, false, false);
  CHECK_FALSE(progress.stalled());
  for (int k = 0; k < 500; ++k) progress.add(1e20, residual *= 0.97, false, false);
  CHECK(progress.stalled());
}

TEST_CASE("steps are slow when the rows are met and the gradient is not halved", "[qp]") {
  detail::OuterProgress<double> progress;
  progress.restart();
  for (int k = 0; k < 10; ++k) progress.add(100.0, 5.0, true, true);
  CHECK_FALSE(progress.slow());
  for (int k = 0; k < 10; ++k) progress.add(100.0, 0.5, true, true);
  CHECK(progress.slow());
  progress.add(40.0, 0.5, true, true);
  CHECK_FALSE(progress.slow());
  for (int k = 0; k < 10; ++k) progress.add(0.9, 0.5, true, true);
  CHECK_FALSE(progress.slow());
}

TEST_CASE("a lower weight that makes steps far worse is spoilt by rounding", "[qp]") {
  detail::OuterProgress<double> progress;
  progress.restart();
  CHECK_FALSE(progress.is_spoilt_by(1.0));
  CHECK_FALSE(progress.is_spoilt_by(100.0));  // nothing was lowered
  progress.set_lowered();
  CHECK_FALSE(progress.is_spoilt_by(150.0));
  for (int k = 0; k < 10; ++k) progress.add(100.0, 0.5, true, true);
  CHECK(progress.slow());
  progress.set_lowered();
  CHECK(progress.is_spoilt_by(1e4));
  CHECK_FALSE(progress.slow());
  progress.restart();
  for (int k = 0; k < 10; ++k) progress.add(100.0, 0.5, true, true);
  CHECK(progress.slow());
}

TEST_CASE("a step of a rounding error is no motion", "[qp]") {
  const VectorX<double> from = VectorX<double>::Constant(3, 1e6);
  VectorX<double> to = from;
  to[1] += 1e-10;
  CHECK_FALSE(detail::has_moved<double>(3, from, to));
  to[1] += 1e-3;
  CHECK(detail::has_moved<double>(3, from, to));
  CHECK_FALSE(detail::has_moved<double>(1, from, to));
}
