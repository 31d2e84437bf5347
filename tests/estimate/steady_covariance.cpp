// The closed form against the Riccati recursion of the same filter.

#include "clothctl/estimate/detail/steady_covariance.hpp"

#include <cmath>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("steady covariance: the recursion of the filter ends there", "[estimate]") {
  for (const double acceleration : {0.05, 1.0, 200.0}) {
    const double noise = 0.002, t = 0.02, q = acceleration * acceleration;
    double xx = 1e-4, xv = 0, vv = 1;  // before a measurement
    for (int i = 0; i < 20000; ++i) {
      const double gx = xx / (xx + noise * noise), gv = xv / (xx + noise * noise);
      const double a = (1 - gx) * xx, b = (1 - gx) * xv, c = vv - gv * xv;
      xx = a + 2 * t * b + t * t * c + q * t * t * t * t / 4;
      xv = b + t * c + q * t * t * t / 2;
      vv = c + q * t * t;
    }
    const detail::SteadyCovariance<double> steady(acceleration, noise, t);
    CHECK(std::abs(steady.position - xx) < 1e-9 * xx);
    CHECK(std::abs(steady.cross - xv) < 1e-9 * xv);
  }
}
