// The method does not depend on how the Hessian is stored: factored and dense curvature agree.

#include "clothctl/qp/detail/box_method.hpp"

#include "clothctl/qp/box_active_set.hpp"
#include "qp/curvatures.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::FactoredHessian;

TEMPLATE_TEST_CASE(
    "a diagonal plus low-rank Hessian gives the minimiser of the dense problem, cold, warm and "
    "shifted",
    "[qp][box_method]", float, double) {
  using S = TestType;
  using Method = detail::BoxMethod<S, detail::LowRankCurvature<S>>;
  const QpSettings<S> settings;
  for (const Index n : {1, 6, 40, 150}) {
    const Index r = std::max<Index>(1, n / 5);
    const FactoredHessian<S> given(n, r, static_cast<unsigned>(n));
    Method method;
    method.curvature().reserve(n, r);
    method.reserve(n);
    given.fill(method.curvature());
    method.renew();
    BoxActiveSet<S> dense;
    REQUIRE(dense.set_hessian(given.dense()) == QpStatus::Solved);
    QpResult<S> result;
    const VectorX<S> lb = VectorX<S>::Constant(n, S(-0.2)), ub = VectorX<S>::Constant(n, S(0.3));
    VectorX<S> g = S(3) * VectorX<S>::Random(n);
    const S tolerance = std::is_same_v<S, float> ? S(1e-4) : S(1e-9);
    for (int frame = 0; frame < 6; ++frame) {
      g += S(0.3) * VectorX<S>::Random(n);
      const typename Method::Data data{g, lb, ub};
      if (frame == 3) method.shift(std::min<Index>(n, 4));
      int iterations = 0, again = 0;
      const detail::Budget budget(settings, n);
      const long before = clothctl_test::allocations();
      const QpStatus status =
          method.solve(data, settings.stationarity_tolerance, budget, iterations);
      const QpStatus repeated = method.solve(data, settings.stationarity_tolerance, budget, again);
      const long made = clothctl_test::allocations() - before;
      CHECK(status == QpStatus::Solved);
      CHECK(repeated == QpStatus::Solved);
      CHECK(again == 0);
      if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
      REQUIRE(dense.solve(g, lb, ub, result) == QpStatus::Solved);
      CHECK((method.x().head(n) - result.x).cwiseAbs().maxCoeff() < tolerance);
    }
  }
}

TEST_CASE("an iterate that is not finite is discarded", "[qp][box_method]") {
  using Method = detail::BoxMethod<double, detail::LowRankCurvature<double>>;
  const FactoredHessian<double> given(3, 1, 1);
  Method method;
  method.curvature().reserve(3, 1);
  method.reserve(3);
  given.fill(method.curvature());
  method.renew();
  const VectorX<double> g = VectorX<double>::Ones(3), lb = VectorX<double>::Constant(3, 0.5),
                        ub = VectorX<double>::Constant(3, 2.0);
  const Method::Data data{g, lb, ub};
  method.warm_start(VectorX<double>::Constant(3, std::numeric_limits<double>::quiet_NaN()));
  CHECK(method.replace_nonfinite(data));
  CHECK(method.x().head(3) == lb);
  CHECK_FALSE(method.replace_nonfinite(data));
}
