#include "clothctl/qp/detail/entrywise_errors.hpp"

#include "support/catch.hpp"

using namespace clothctl;

namespace {

// Two unknowns without curvature between -1 and 1, and the row x0 ≥ 0.
struct TwoUnknowns {
  detail::ProximalProblem<double> p;
  VectorX<double> gradient = VectorX<double>::Zero(2);

  TwoUnknowns() {
    p.reserve(2, 1);
    p.resize(2, 1);
    p.H().setZero();
    p.A() << 1.0, 0.0;
    p.At() << 1.0, 0.0;
    p.lo.setConstant(-1.0);
    p.hi.setConstant(1.0);
    p.rl[0] = 0.0;
    p.ru[0] = detail::no_bound<double>();
  }

  detail::EntrywiseErrors<double> judge() {
    p.refresh_products();
    p.reduced_gradient(gradient);
    detail::EntrywiseJudge<double> judge;
    judge.reserve(2);
    return judge.judge(p, QpSettings<double>(), gradient);
  }
};

}  // namespace

TEST_CASE("an unknown is judged by its own slope, beside any slope or multiplier of others",
          "[qp]") {
  for (const double large : {1.0, 1e10, 1e20}) {
    TwoUnknowns q;
    q.p.g << large, 1e-3;
    q.p.x << 0.0, -1.0;
    q.p.y[0] = large;
    CHECK(q.judge().met);
    CHECK_FALSE(is_finite(q.judge().least_slope));
    q.p.x[1] = 1.0;
    CHECK_FALSE(q.judge().met);
    CHECK(q.judge().least_slope == 1e-3);
  }
}

TEST_CASE("an error within the tolerance of the unknown's own terms is met", "[qp]") {
  TwoUnknowns q;
  const double tolerance = QpSettings<double>().stationarity_tolerance;
  q.p.H() << 1.0, 0.0, 0.0, 1.0;
  q.p.g << 0.0, 0.5;
  q.p.x << 0.0, -0.5 * (1.0 + 0.5 * tolerance);
  CHECK(q.judge().met);
  q.p.x[1] = -0.5 * (1.0 + 2.0 * tolerance);
  CHECK_FALSE(q.judge().met);
}

TEST_CASE("a violated row, and a multiplier of a slack row, are judged beside huge unknowns",
          "[qp]") {
  TwoUnknowns q;
  q.p.lo[1] = -1e15;
  q.p.x << -1e-3, -1e15;
  q.p.g << 0.0, 1.0;
  CHECK_FALSE(q.judge().met);
  q.p.x[0] = 0.5;
  CHECK(q.judge().met);
  q.p.g[0] = q.p.y[0] = 2.0;
  CHECK_FALSE(q.judge().met);
  q.p.g[0] = 1.0;
  q.p.x[0] = -1.0;
  q.p.rl[0] = -1.0;
  q.p.y[0] = 1e-30;  // too small to matter
  CHECK(q.judge().met);
}
