// Stacked, weighted time differences, compared with their definition.

#include "clothctl/mpc/detail/term_stack.hpp"

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

constexpr Index kHorizon = 6, kInputs = 6, kOutputs = 4;

WindowResponse<double> random_window() {
  WindowResponse<double> window;
  window.impulse_response = MatrixX<double>::Random(3 * kOutputs, kInputs * kHorizon);
  window.free_response = MatrixX<double>::Random(3 * kOutputs, kHorizon);
  return window;
}

// Differences by repeated subtraction of neighbours, for a series that starts with the three past
// values, oldest first.
MatrixX<double> differences(MatrixX<double> series, int order) {
  for (int i = 0; i < order; ++i)
    series = (series.rightCols(series.cols() - 1) - series.leftCols(series.cols() - 1)).eval();
  return series;
}

}  // namespace

TEST_CASE("stacked rows are the differences of the point, for the plan and for nearby plans",
          "[mpc]") {
  const WindowResponse<double> window = random_window();
  const std::vector<detail::OutputTerm<double>> point{{1, 0.7}, {3, -1.2}};
  const std::array<Vector3<double>, 3> past{Vector3<double>(0.1, 0.2, 0.3),
                                            Vector3<double>(-0.4, 0.0, 0.9),
                                            Vector3<double>(1.5, -0.5, 0.2)};
  const MatrixX<double> target = MatrixX<double>::Random(3, kHorizon);
  const double scale = 2.5;
  detail::TermStack<double> stack;
  stack.reserve(12, 2, kInputs, kHorizon);
  const long before = clothctl_test::allocations();
  for (int order = 0; order <= 3; ++order) {
    stack.add(window, point, past, order, scale,
              [&](Index k) { return Vector3<double>(target.col(k)); });
  }
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  REQUIRE(stack.rows() == 12);

  for (int trial = 0; trial < 3; ++trial) {
    const MatrixX<double> u = (trial == 0 ? 0.0 : 1.0) * MatrixX<double>::Random(kInputs, kHorizon);
    MatrixX<double> series(3, 3 + kHorizon);
    for (int i = 0; i < 3; ++i) series.col(i) = past[static_cast<std::size_t>(2 - i)];
    for (Index k = 0; k < kHorizon; ++k) {
      Vector3<double> z = Vector3<double>::Zero();
      for (const detail::OutputTerm<double>& t : point) {
        z += t.weight * window.free_response.block<3, 1>(3 * t.output, k);
        for (Index j = 0; j <= k; ++j)
          z += t.weight *
               window.impulse_response.block(3 * t.output, (k - j) * kInputs, 3, kInputs) *
               u.col(j);
      }
      series.col(3 + k) = z;
    }
    for (int order = 0; order <= 3; ++order) {
      const MatrixX<double> expected =
          scale * (differences(series, order).rightCols(kHorizon) - target);
      MatrixX<double> rows = stack.residual().middleRows(3 * order, 3);
      for (Index k = 0; k < kHorizon; ++k) {
        for (Index j = 0; j <= k; ++j)
          rows.col(k) += stack.blocks().block(3 * order, (k - j) * kInputs, 3, kInputs) * u.col(j);
      }
      CHECK((rows - expected).norm() < 1e-13 * expected.norm());
    }
  }
}

TEST_CASE("a term without weight takes no rows, and clear removes all rows", "[mpc]") {
  const WindowResponse<double> window = random_window();
  const std::vector<detail::OutputTerm<double>> point{{0, 1.0}};
  const std::array<Vector3<double>, 3> past{Vector3<double>::Zero(), Vector3<double>::Zero(),
                                            Vector3<double>::Zero()};
  const auto none = [](Index) { return Vector3<double>(Vector3<double>::Zero()); };
  detail::TermStack<double> stack;
  stack.reserve(6, 2, kInputs, kHorizon);
  stack.add(window, point, past, 0, 0.0, none);
  CHECK(stack.rows() == 0);
  stack.add(window, point, past, 0, 1.0, none);
  CHECK(stack.rows() == 3);
  // Rows of an earlier window leave no trace.
  const MatrixX<double> first = stack.blocks();
  stack.clear();
  stack.add(window, point, past, 3, 9.0, none);
  stack.clear();
  stack.add(window, point, past, 0, 1.0, none);
  CHECK(stack.rows() == 3);
  CHECK(stack.blocks() == first);
}
