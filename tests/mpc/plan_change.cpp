// From the solution of a window's QP to its plan and the change of the outputs.

#include "clothctl/mpc/detail/plan_change.hpp"

#include "mpc/small_window.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::kWindow;
using clothctl_test::small_settings;
using clothctl_test::SmallWindow;

namespace {

// A solution that is given instead of solved for.
struct Solution {
  VectorX<double> u;
  auto frame(Index k, Index unknowns) const { return u.segment(k * unknowns, unknowns); }
};

struct Changed {
  SmallWindow window;
  detail::PlanChange<double> change;
  PlanResult<double> result;
  Solution solution;

  explicit Changed(const PlannerSettings<double>& settings) : window(settings) {
    change.reserve(window.problem);
    result.plan.setZero(window.problem.basis.inputs(), kWindow);
    solution.u = VectorX<double>::Random(window.problem.basis.unknowns() * kWindow);
  }
  void take(bool has_previous) { change.take(window.problem, solution, has_previous, result); }

  // B u_k + r0.
  MatrixX<double> raw() const {
    MatrixX<double> plan(result.plan.rows(), kWindow);
    const auto& basis = window.problem.basis;
    for (Index k = 0; k < kWindow; ++k)
      plan.col(k) = basis.matrix() * solution.frame(k, basis.unknowns()) + basis.offset();
    return plan;
  }
  // The convolution of the impulse response with the change of the plan.
  MatrixX<double> convolved() const {
    const auto& problem = window.problem;
    const Index m = problem.basis.inputs();
    MatrixX<double> y = MatrixX<double>::Zero(problem.request.output_rows(), kWindow);
    for (Index j = 0; j < kWindow; ++j) {
      for (Index k = j; k < kWindow; ++k)
        y.col(k) += problem.response.impulse_response.middleCols((k - j) * m, m) *
                    (result.plan.col(j) - problem.response.plan.col(j));
    }
    return y;
  }
};

}  // namespace

TEST_CASE("a plan is the basis times the solution, and its outputs are a convolution", "[mpc]") {
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    Changed c(small_settings(input));
    const long before = clothctl_test::allocations();
    c.take(true);
    const long made = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
    CHECK((c.result.plan - c.raw()).norm() <= 1e-13);
    CHECK((c.change.outputs() - c.convolved()).norm() <= 1e-12);
    CHECK_FALSE(c.change.too_large(c.window.problem, true));  // max_change is off
  }
}

TEST_CASE("planned velocities are scaled back towards the previous plan", "[mpc]") {
  PlannerSettings<double> settings = small_settings(GripInput::Pose);
  settings.max_change = 0.05;
  Changed c(settings);
  c.take(false);  // no previous plan to keep to
  CHECK((c.result.plan - c.raw()).norm() <= 1e-13);
  c.take(true);
  const MatrixX<double> step = c.result.plan - c.window.problem.response.plan;
  CHECK(step.cwiseAbs().maxCoeff() == Approx(0.05));
  const MatrixX<double> asked = c.raw() - c.window.problem.response.plan;
  const double scale = 0.05 / asked.cwiseAbs().maxCoeff();
  CHECK((step - scale * asked).norm() <= 1e-13);
  CHECK((c.change.outputs() - c.convolved()).norm() <= 1e-12);
  CHECK_FALSE(c.change.too_large(c.window.problem, true));
}

TEST_CASE("planned forces are not scaled, but a jump of a held vertex is too large", "[mpc]") {
  PlannerSettings<double> settings = small_settings(GripInput::Force);
  settings.max_change = 0.05;
  Changed c(settings);
  c.take(true);
  CHECK((c.result.plan - c.raw()).norm() <= 1e-13);
  const auto largest_jump = [&] {
    const MatrixX<double> y = c.change.outputs().bottomRows(3 * c.window.held_count());
    MatrixX<double> step = y;
    step.rightCols(kWindow - 1) -= y.leftCols(kWindow - 1);
    return step.cwiseAbs().maxCoeff() / settings.dt;
  };
  // The change grows with the impulse response. Features may jump.
  MatrixX<double>& R = c.window.problem.response.impulse_response;
  R.bottomRows(3 * c.window.held_count()) *= 0.0499 / largest_jump();
  c.take(true);
  CHECK(largest_jump() == Approx(0.0499));
  CHECK_FALSE(c.change.too_large(c.window.problem, true));
  R.bottomRows(3 * c.window.held_count()) *= 1.01;
  c.take(true);
  CHECK(c.change.too_large(c.window.problem, true));
  CHECK_FALSE(c.change.too_large(c.window.problem, false));
}

TEST_CASE("a jump of the first frame alone is too large", "[mpc]") {
  PlannerSettings<double> settings = small_settings(GripInput::Force);
  settings.max_change = 0.05;
  Changed c(settings);
  // An impulse that moves the outputs at once and for good, from a change of the first input only.
  auto& response = c.window.problem.response;
  const Index m = c.window.problem.basis.inputs();
  for (Index k = 1; k < kWindow; ++k)
    response.impulse_response.middleCols(k * m, m) = response.impulse_response.leftCols(m);
  response.plan = c.raw();
  response.plan(0, 0) += 1.0;
  c.take(true);
  const Index last = c.change.outputs().rows() - 1;
  const double jump = std::abs(c.change.outputs()(last, 0));
  REQUIRE(jump > settings.max_change * settings.dt);
  for (Index k = 1; k < kWindow; ++k)
    CHECK(std::abs(c.change.outputs()(last, k) - c.change.outputs()(last, k - 1)) <= 1e-12);
  CHECK(c.change.too_large(c.window.problem, true));
}

TEST_CASE("features with a Jacobian change by it, other outputs by the impulse response", "[mpc]") {
  Changed c(small_settings(GripInput::Pose));
  auto& problem = c.window.problem;
  const Index p = 3 * problem.feature_count, m = problem.request.inputs();
  problem.response.has_jacobian = true;
  problem.response.jacobian = MatrixX<double>::Random(p * kWindow, m * kWindow);
  for (Index k = 0; k < kWindow; ++k)
    problem.response.jacobian.middleRows(p * k, p).rightCols(m * (kWindow - k - 1)).setZero();
  c.take(true);
  const MatrixX<double> convolved = c.convolved();
  const VectorX<double> change = (c.result.plan - problem.response.plan).reshaped();
  const VectorX<double> expected = problem.response.jacobian * change;
  CHECK((c.change.outputs().topRows(p).reshaped() - expected).norm() < 1e-12 * expected.norm());
  CHECK((c.change.outputs() - convolved).bottomRows(convolved.rows() - p).norm() <
        1e-12 * convolved.norm());
}
