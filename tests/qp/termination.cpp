// The status that residuals allow, and the iterate that is kept if none is good.

#include "clothctl/qp/detail/termination.hpp"

#include <limits>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// Residuals of the given multiples of the tolerances.
template <class S>
KktResiduals<S> away(double stationarity, double feasibility, double complementarity) {
  const QpSettings<S> settings;
  KktResiduals<S> r;
  r.relative_stationarity = S(stationarity) * settings.stationarity_tolerance;
  r.relative_feasibility = S(feasibility) * settings.feasibility_tolerance;
  r.relative_complementarity = S(complementarity) * settings.complementarity_tolerance;
  return r;
}

}  // namespace

TEMPLATE_TEST_CASE("residual_ratio is the largest ratio of a residual to its own tolerance", "[qp]",
                   float, double) {
  using S = TestType;
  QpSettings<S> settings;
  CHECK(detail::residual_ratio(away<S>(0.5, 3, 2), settings) == Approx(3).epsilon(1e-5));
  settings.feasibility_tolerance *= S(6);
  CHECK(detail::residual_ratio(away<S>(0.5, 3, 2), settings) == Approx(2).epsilon(1e-5));
  settings.complementarity_tolerance *= S(8);
  CHECK(detail::residual_ratio(away<S>(0.5, 3, 2), settings) == Approx(0.5).epsilon(1e-5));
  KktResiduals<S> infinite;
  infinite.relative_complementarity = std::numeric_limits<S>::infinity();
  CHECK_FALSE(is_finite(detail::residual_ratio(infinite, settings)));
}

TEMPLATE_TEST_CASE("the residuals decide whether the status is Solved", "[qp]", float, double) {
  using S = TestType;
  const auto settled = [](QpStatus claimed, double distance) {
    QpResult<S> result;
    result.status = claimed;
    KktResiduals<S> r = away<S>(0.2 * distance, distance, 0.4 * distance);
    r.objective = S(7);
    detail::conclude(r, QpSettings<S>(), result);
    CHECK(result.feasibility == r.relative_feasibility);
    CHECK(result.stationarity == r.relative_stationarity);
    CHECK(result.complementarity == r.relative_complementarity);
    CHECK(result.objective == S(7));
    return result.status;
  };
  CHECK(settled(QpStatus::Solved, 0.9) == QpStatus::Solved);
  CHECK(settled(QpStatus::Solved, 1.1) == QpStatus::SolvedInaccurate);
  CHECK(settled(QpStatus::Solved, 1100) == QpStatus::IterationLimit);
  CHECK(settled(QpStatus::IterationLimit, 0.5) ==
        QpStatus::Solved);  // although the solver does not claim it
  CHECK(settled(QpStatus::IterationLimit, 900) == QpStatus::SolvedInaccurate);
  CHECK(settled(QpStatus::IterationLimit, 1100) == QpStatus::IterationLimit);
  CHECK(settled(QpStatus::TimeLimit, 900) == QpStatus::SolvedInaccurate);
  CHECK(settled(QpStatus::TimeLimit, 1100) == QpStatus::TimeLimit);
  for (const QpStatus other :
       {QpStatus::PrimalInfeasible, QpStatus::DualInfeasible, QpStatus::NonConvex})
    CHECK(settled(other, 0.5) == other);
}

TEMPLATE_TEST_CASE("the best iterate is nearly solved, or else violates least", "[qp]", float,
                   double) {
  using S = TestType;
  const QpSettings<S> settings;
  detail::BestIterate<S> best;
  best.reserve(3, 2);
  CHECK_FALSE(best.known());
  S next(0);
  const auto offer = [&](const KktResiduals<S>& r) {
    next += S(1);
    best.offer(r, settings, VectorX<S>::Constant(2, next), VectorX<S>::Constant(1, -next));
    return best.x()[0] == next && best.y()[0] == -next;
  };
  CHECK(offer(away<S>(1e5, 1e5, 0)));
  CHECK(offer(away<S>(3e5, 1e4, 0)));        // violates less
  CHECK_FALSE(offer(away<S>(0, 2e4, 0)));    // violates more
  CHECK(offer(away<S>(2e5, 1e4, 0)));        // violates as much, but has smaller residuals
  CHECK(offer(away<S>(900, 900, 0)));        // accurate enough for Inaccurate
  CHECK_FALSE(offer(away<S>(2e3, 0.1, 0)));  // feasible, but not accurate enough
  CHECK(offer(away<S>(20, 800, 0)));
  KktResiduals<S> broken = away<S>(0, 0, 0);
  CHECK(best.known());
  broken.relative_stationarity = std::numeric_limits<S>::infinity();
  CHECK_FALSE(offer(broken));
  best.forget();
  CHECK_FALSE(best.known());
  CHECK_FALSE(offer(broken));
  CHECK_FALSE(best.known());
  CHECK(offer(away<S>(9e4, 0.1, 0)));
  CHECK(offer(
      away<S>(8e4, 0.9, 0)));  // both feasible within the tolerance: the smaller residual wins
  best.forget();
  CHECK(offer(away<S>(1e6, 1e6, 0)));
}
