// Limits of a solve: iterations and the caller's seconds, in the settings and in both solvers.

#include "clothctl/qp/detail/budget.hpp"

#include <limits>

#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// A clock that advances by one second at each reading.
double tick(void* context) { return ++*static_cast<double*>(context); }

QpSettings<double> seconds(double limit, double& now) {
  QpSettings<double> settings;
  settings.time_limit = limit;
  settings.clock = tick;
  settings.clock_context = &now;
  return settings;
}

/// A chain of springs pushed against its bounds from one end, so that bounds change one by one.
struct Chain {
  static constexpr Index n = 40;
  MatrixX<double> H = MatrixX<double>::Zero(n, n), A = MatrixX<double>::Ones(1, n);
  VectorX<double> g = VectorX<double>::LinSpaced(n, -3.0, 2.0),
                  lb = VectorX<double>::Constant(n, -0.5), ub = VectorX<double>::Constant(n, 0.5),
                  rl = VectorX<double>::Constant(1, 0.5), ru = VectorX<double>::Constant(1, 1.5);
  Chain() {
    for (Index i = 0; i < n; ++i) {
      H(i, i) = 2.1;
      if (i > 0) H(i, i - 1) = H(i - 1, i) = -1.0;
    }
  }
};

}  // namespace

TEST_CASE("running out of iterations and running out of time have their own statuses",
          "[qp][budget]") {
  QpSettings<double> settings;
  CHECK(detail::Budget(settings, 3).after(39) == QpStatus::Solved);
  CHECK(detail::Budget(settings, 3).after(40) == QpStatus::IterationLimit);
  settings.max_iterations = 2;
  CHECK(detail::Budget(settings, 3).after(1) == QpStatus::Solved);
  CHECK(detail::Budget(settings, 3).after(2) == QpStatus::IterationLimit);
  double now = 100;
  const detail::Budget budget(seconds(2.5, now), 3);
  CHECK(budget.after(0) == QpStatus::Solved);
  CHECK(budget.after(0) == QpStatus::Solved);
  CHECK(budget.after(0) == QpStatus::TimeLimit);
  CHECK(now == 104);
}

TEST_CASE("a clock that returns NaN ends the solve", "[qp][budget]") {
  QpSettings<double> settings;
  settings.time_limit = 1;
  settings.clock = [](void*) { return std::numeric_limits<double>::quiet_NaN(); };
  CHECK(detail::Budget(settings, 3).after(0) == QpStatus::TimeLimit);
}

TEST_CASE("validate checks the settings of time", "[qp][budget]") {
  double now = 0;
  CHECK(seconds(1.0, now).validate().empty());
  CHECK(seconds(-1.0, now).validate() == "time_limit is negative or not finite");
  CHECK(seconds(std::numeric_limits<double>::quiet_NaN(), now).validate() ==
        "time_limit is negative or not finite");
  QpSettings<double> settings;
  settings.time_limit = 1.0;
  CHECK(settings.validate() == "time_limit is set without a clock");
}

TEST_CASE(
    "a solve that runs out of time returns its best iterate within the bounds, and the next one is "
    "complete",
    "[qp][budget]") {
  const Chain chain;
  double now = 0;
  BoxActiveSet<double> box(seconds(0.5, now));
  REQUIRE(box.set_hessian(chain.H) == QpStatus::Solved);
  QpResult<double> result;
  CHECK(box.solve(chain.g, chain.lb, chain.ub, result) == QpStatus::TimeLimit);
  CHECK(((result.x.array() >= chain.lb.array()).all() &&
         (result.x.array() <= chain.ub.array()).all()));
  CHECK(result.feasibility == 0.0);
  for (int again = 0; again < 100 && result.status != QpStatus::Solved; ++again)
    (void)box.solve(chain.g, chain.lb, chain.ub, result);
  CHECK(result.status == QpStatus::Solved);  // each solve continues from the last one

  ActiveSet<double> rows(seconds(0.5, now));
  REQUIRE(rows.set_hessian(chain.H) == QpStatus::Solved);
  REQUIRE(rows.set_rows(chain.A) == QpStatus::Solved);
  CHECK(rows.solve(chain.g, chain.lb, chain.ub, chain.rl, chain.ru, result) == QpStatus::TimeLimit);
  CHECK(((result.x.array() >= chain.lb.array()).all() &&
         (result.x.array() <= chain.ub.array()).all()));
  ActiveSet<double> patient(seconds(1e6, now));
  REQUIRE(patient.set_hessian(chain.H) == QpStatus::Solved);
  REQUIRE(patient.set_rows(chain.A) == QpStatus::Solved);
  CHECK(patient.solve(chain.g, chain.lb, chain.ub, chain.rl, chain.ru, result) == QpStatus::Solved);
}

TEST_CASE("a time limit also ends steps that change no set", "[qp][budget]") {
  // The rows meet at x = -1e13 (1, 1), far beyond what rounding errors let the solver find.
  MatrixX<double> H = MatrixX<double>::Identity(2, 2), A(2, 2);
  A << 1.0, -1.0, 1.0, -1.0 - 1e-13;
  const VectorX<double> g = VectorX<double>::Zero(2),
                        ub = VectorX<double>::Constant(2, detail::no_bound<double>()), lb = -ub;
  VectorX<double> r(2);
  r << 0.0, 1.0;
  double now = 0;
  QpResult<double> result;
  ActiveSet<double> whole(seconds(1e6, now));
  REQUIRE(whole.set_hessian(H) == QpStatus::Solved);
  REQUIRE(whole.set_rows(A) == QpStatus::Solved);
  CHECK(whole.solve(g, lb, ub, r, r, result) != QpStatus::TimeLimit);
  INFO(to_string(result.status) << " after " << result.iterations << " rounds");
  CHECK(now > result.iterations + 4.0);
  now = 0;
  ActiveSet<double> solver(seconds(2.5, now));
  REQUIRE(solver.set_hessian(H) == QpStatus::Solved);
  REQUIRE(solver.set_rows(A) == QpStatus::Solved);
  CHECK(solver.solve(g, lb, ub, r, r, result) == QpStatus::TimeLimit);
  CHECK(now <= 6.0);
}
