#include "clothctl/qp/detail/scaled_certificate.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

VectorX<double> vec(double a) { return VectorX<double>::Constant(1, a); }
VectorX<double> vec(double a, double b) { return (VectorX<double>(2) << a, b).finished(); }

}  // namespace

TEST_CASE("a Farkas pair is accepted only if every number is right", "[qp]") {
  // x + y ≥ 3 with x, y ≤ 1. The multiplier -1 of the row gives z = (1, 1) and the support -3 + 1 +
  // 1 = -1.
  const double none = detail::no_bound<double>();
  const VectorX<double> rl = vec(3.0), ru = vec(none), lo = vec(-none, -none), size = vec(1.0, 1.0);
  const auto proves = [&](double y, double z0, double z1, double top) {
    VectorX<double> z = vec(z0, z1);
    return detail::check_farkas<double>(vec(y), z, size, rl, ru, lo, vec(top, top), 10.0).holds;
  };
  CHECK(proves(-1.0, 1.0, 1.0, 1.0));
  CHECK(proves(-1.0, 1.0, 1.0, 1.499));
  CHECK_FALSE(proves(-1.0, 1.0, 1.0, 1.5));   // feasible: x = y = 1.5
  CHECK_FALSE(proves(-1.0, 1.0, 1.0, none));  // uses a bound that does not exist
  CHECK_FALSE(proves(1.0, -1.0, -1.0, 1.0));  // uses the open side of the row
  CHECK_FALSE(proves(0.0, 0.0, 0.0, 1.0));    // proves nothing
  CHECK_FALSE(proves(std::numeric_limits<double>::quiet_NaN(), 1.0, 1.0, 1.0));
  CHECK_FALSE(proves(-1.0, std::numeric_limits<double>::quiet_NaN(), 1.0, 1.0));
  VectorX<double> z =
      vec(1.0, 2e-16);  // a rounding error towards an open side is tolerated and set to zero
  CHECK(detail::check_farkas<double>(vec(-1.0), z, size, rl, ru, lo, vec(1.0, none), 10.0).holds);
  CHECK(z[1] == 0.0);
  z = vec(1.0, 1e-14);  // a larger value is a coefficient: far away, points are feasible
  const detail::CertificateCheck<double> close =
      detail::check_farkas<double>(vec(-1.0), z, size, rl, ru, lo, vec(1.0, none), 10.0);
  CHECK_FALSE(close.holds);
  CHECK(close.promising);
  CHECK(close.error > 10.0);
}

TEST_CASE("a ray is accepted only if it is flat, falls and leaves no bound", "[qp]") {
  const double none = detail::no_bound<double>();
  const VectorX<double> zero = vec(0.0, 0.0), one = vec(1.0, 1.0);
  const auto proves = [&](double d0, double d1, double Hd, double Ad, double lower,
                          double row_top) {
    return detail::check_ray<double>(vec(d0, d1), vec(Hd, 0.0), vec(Ad), one, vec(1.0),
                                     vec(-1.0, 0.0), vec(-none), vec(row_top), vec(lower, -none),
                                     vec(none, none))
        .holds;
  };
  CHECK(proves(1.0, -1.0, 0.0, 0.0, 0.0, 1.0));
  CHECK(proves(1.0, -1.0, 0.0, 2.0, 0.0, none));
  CHECK(proves(1.0, -1.0, 4e-16, -1.0, 0.0, 1.0));
  CHECK_FALSE(proves(1.0, -1.0, 1e-13, 0.0, 0.0, 1.0));  // curved
  CHECK_FALSE(proves(1.0, -1.0, 0.0, 1e-13, 0.0, 1.0));  // meets a row
  CHECK_FALSE(proves(-1.0, 0.0, 0.0, 0.0, 0.0, 1.0));    // rises and meets a bound
  CHECK_FALSE(proves(0.0, -1.0, 0.0, 0.0, 0.0, 1.0));    // does not fall
  CHECK_FALSE(proves(1.0, std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0, 0.0, 1.0));
  CHECK_FALSE(proves(1.0, 0.0, std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0, 1.0));
  CHECK_FALSE(detail::check_ray<double>(zero, zero, vec(0.0), one, vec(1.0), one, vec(-none),
                                        vec(none), zero, one)
                  .holds);
}
