#include "clothctl/qp/certificate.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

VectorX<double> vec(double a) { return VectorX<double>::Constant(1, a); }
VectorX<double> vec(double a, double b) { return (VectorX<double>(2) << a, b).finished(); }
MatrixX<double> row(double a, double b) { return vec(a, b).transpose(); }

}  // namespace

TEST_CASE("a Farkas pair is a certificate if it balances and its bound is negative", "[qp]") {
  // x + y ≥ 3 with x, y ≤ 1: the multiplier -1 on the row and (1, 1) give s = -3 + 1 + 1 = -1.
  const auto measure = [](double y, double z0, double z1, double top) {
    return farkas_residuals(row(1, 1), vec(3), vec(inf), vec(-inf, -inf), vec(top, top), vec(y),
                            vec(z0, z1));
  };
  const FarkasResiduals<double> good = measure(-1, 1, 1, 1);
  CHECK(good.holds());
  CHECK(good.balance == 0.0);
  CHECK(good.value == -1.0);
  CHECK(good.relative_value == Approx(-0.2));
  CHECK(good.excluded_radius == inf);
  CHECK(measure(-1e9, 1e9, 1e9, 1).holds());    // scaling does not matter
  CHECK_FALSE(measure(-1, 1, 1, 1.5).holds());  // x = y = 1.5 is feasible
  CHECK_FALSE(measure(-1, 1, 1, inf).holds());  // uses a bound that does not exist
  CHECK_FALSE(measure(1, -1, -1, 1).holds());   // uses the open side of the row
  CHECK_FALSE(measure(0, 0, 0, 1).holds());     // proves nothing
  CHECK_FALSE(measure(-1, 1, 0.5, 1).holds());  // does not balance
  CHECK_FALSE(measure(kNan, 1, 1, 1).holds());
  CHECK_FALSE(measure(-1, 1, kNan, 1).holds());
  CHECK_FALSE(measure(-1, 1, 1, kNan).holds());
  // An imbalance of 1e-6 only allows feasible points far away.
  const FarkasResiduals<double> rough = measure(-1, 1, 1 + 1e-6, 1);
  CHECK_FALSE(rough.holds());
  CHECK(rough.holds(1e-5));
  CHECK(rough.excluded_radius == Approx(1e6).epsilon(1e-3));
}

TEST_CASE("a ray is a certificate if it is flat, falls and meets no bound", "[qp]") {
  const MatrixX<double> H = (MatrixX<double>(2, 2) << 1, 1, 1, 1).finished();
  const auto measure = [&](double d0, double d1, double lower, double top, double a1 = 1) {
    return ray_residuals(H, vec(-1, 0), row(1, a1), vec(-inf), vec(top), vec(lower, -inf),
                         vec(inf, inf), vec(d0, d1));
  };
  CHECK(measure(1, -1, 0, 5).holds());
  CHECK(measure(1, -1, 0, 5).relative_slope == -1.0);
  CHECK(measure(2e9, -2e9, 0, 5).holds());
  CHECK(measure(1, -1, 0, inf, -1).holds());      // A d = 2 towards an open side
  CHECK_FALSE(measure(1, -1, 0, 5, -1).holds());  // A d = 2 towards a finite side
  CHECK_FALSE(measure(1, -0.999, 0, 5).holds());  // curved
  CHECK_FALSE(measure(-1, 1, 0, 5).holds());      // rises, and meets its bound
  CHECK(measure(-1, 1, 0, 5).violation == 1.0);
  CHECK_FALSE(measure(0, 0, 0, 5).holds());
  CHECK_FALSE(measure(kNan, -1, 0, 5).holds());
  CHECK_FALSE(measure(1, -1, 0, 5, kNan).holds());
}

TEST_CASE("vectors of wrong sizes are no certificates, and nothing is read", "[qp]") {
  const MatrixX<double> none(0, 0), H = MatrixX<double>::Zero(2, 2);
  const VectorX<double> empty;
  CHECK(farkas_residuals(none, empty, empty, vec(1, 1), vec(0, 0), empty, vec(-1, 1)).balance ==
        1.0);
  CHECK_FALSE(
      farkas_residuals(row(1, 1), vec(3), vec(inf), vec(-inf), vec(1, 1), vec(-1), vec(1, 1))
          .holds());
  CHECK_FALSE(
      farkas_residuals(row(1, 1), vec(3), vec(inf), vec(-inf, -inf), vec(1, 1), vec(-1), vec(1))
          .holds());
  CHECK_FALSE(
      farkas_residuals(none, vec(3), vec(inf), vec(-inf, -inf), vec(1, 1), vec(-1), vec(1, 1))
          .holds());
  CHECK(ray_residuals(H, vec(-1, 0), none, empty, empty, vec(0, 0), vec(inf, inf), vec(1, 0))
            .holds());
  CHECK_FALSE(
      ray_residuals(H, vec(-1, 0), none, empty, empty, vec(0, 0), vec(inf, inf), vec(1)).holds());
  CHECK_FALSE(
      ray_residuals(none, vec(-1, 0), none, empty, empty, vec(0, 0), vec(inf, inf), vec(1, 0))
          .holds());
}
