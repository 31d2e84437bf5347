// Sums of small changes of an objective, where the objective's values themselves cannot tell.

#include "clothctl/qp/detail/descent_monitor.hpp"

#include "support/catch.hpp"

using namespace clothctl;

namespace {

// Reports the steps of ½ Σ h_i x_i².
struct Bowl {
  VectorX<double> h = VectorX<double>::LinSpaced(3, 1.0, 3.0);
  detail::DescentMonitor<double> monitor;

  Bowl() { monitor.reserve(3); }

  bool lowest_at(const VectorX<double>& x) {
    monitor.add_quadratic(
        3, x, [&](Index i) { return h[i] * x[i]; }, [&](Index i) { return h[i] * std::abs(x[i]); });
    return monitor.is_lowest();
  }
};

}  // namespace

TEST_CASE("a descent is seen however small, and a rise is not one", "[qp]") {
  Bowl bowl;
  VectorX<double> x = VectorX<double>::Constant(3, 1.0);
  CHECK(bowl.lowest_at(x));  // the first is always the lowest
  for (int k = 0; k < 5; ++k) {
    x *= 1.0 - 1e-12;
    CHECK(bowl.lowest_at(x));
  }
  const VectorX<double> best = x;
  x *= 1.1;
  CHECK_FALSE(bowl.lowest_at(x));
  x = best * 1.05;  // lower than the last, not than the best
  CHECK_FALSE(bowl.lowest_at(x));
  x = best * 0.99;
  CHECK(bowl.lowest_at(x));
}

TEST_CASE("standing still is no descent until the monitor restarts", "[qp]") {
  Bowl bowl;
  const VectorX<double> x = VectorX<double>::Constant(3, 0.5);
  CHECK(bowl.lowest_at(x));
  CHECK_FALSE(bowl.lowest_at(x));
  CHECK_FALSE(bowl.lowest_at(x));
  bowl.monitor.restart();
  CHECK(bowl.lowest_at(2.0 * x));
  CHECK(bowl.lowest_at(x));
}

TEST_CASE("another term joins the quadratic one, and a change within rounding counts as none",
          "[qp]") {
  Bowl bowl;
  const VectorX<double> x = VectorX<double>::Constant(3, 1.0);
  CHECK(bowl.lowest_at(x));
  const auto still = [](Index) { return 0.0; };
  bowl.monitor.add_quadratic(3, x, still, still);
  bowl.monitor.add_term(-1e-17, 1.0);  // less than ε times its magnitude
  CHECK_FALSE(bowl.monitor.is_lowest());
  bowl.monitor.add_quadratic(3, x, still, still);
  bowl.monitor.add_term(-1e-3, 1.0);
  CHECK(bowl.monitor.is_lowest());
}

TEST_CASE("a descent that is small beside the terms of its gradient is rounding", "[qp]") {
  for (const double size : {1.0, 1e20}) {
    Bowl bowl;
    VectorX<double> x = VectorX<double>::Constant(3, 1.0);
    CHECK(bowl.lowest_at(x));
    x *= 0.9;
    bowl.monitor.add_quadratic(
        3, x, [&](Index i) { return bowl.h[i] * x[i]; }, [&](Index) { return size; });
    CHECK(bowl.monitor.is_lowest() == (size < 2.0));
  }
}

TEST_CASE("a slope that is not a number is no descent", "[qp]") {
  Bowl bowl;
  VectorX<double> x = VectorX<double>::Constant(3, 1.0);
  CHECK(bowl.lowest_at(x));
  x[1] = std::numeric_limits<double>::quiet_NaN();
  CHECK_FALSE(bowl.lowest_at(x));
}
