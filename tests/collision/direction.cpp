// Lengths and directions over the whole range of a scalar.

#include "clothctl/collision/detail/direction.hpp"

#include <cmath>
#include <limits>
#include <random>

#include "support/catch.hpp"
#include "support/meshes.hpp"

using namespace clothctl;
using clothctl_test::uniform;

TEMPLATE_TEST_CASE("a vector of any size has a length and a direction", "[contact]", float,
                   double) {
  using S = TestType;
  using Limits = std::numeric_limits<S>;
  const Vector3<S> other(S(0), S(1), S(0));
  std::mt19937 random(121);
  double wrong_length = 0, not_unit = 0, turned = 0;
  for (int i = 0; i < 2000; ++i) {
    // From denormal numbers to a tenth of the largest.
    const double exponent = uniform(random, Limits::min_exponent10 - 5, Limits::max_exponent10 - 1);
    Vector3<S> v;
    for (int k = 0; k < 3; ++k) v[k] = S(uniform(random, -1, 1) * std::pow(10.0, exponent));
    if (v.isZero(S(0))) continue;
    const auto d = detail::direction_of<S>(v, other);
    Eigen::Matrix<long double, 3, 1> exact = v.template cast<long double>();
    const long double most = exact.cwiseAbs().maxCoeff(), length = most * (exact / most).norm();
    exact = exact / most / (exact / most).norm();
    turned =
        std::max(turned, static_cast<double>((d.unit.template cast<long double>() - exact).norm()));
    not_unit = std::max(not_unit, std::abs(static_cast<double>(d.unit.norm()) - 1));
    // A denormal length is rounded to its last place.
    const long double place = static_cast<long double>(Limits::denorm_min());
    wrong_length =
        std::max(wrong_length, static_cast<double>((std::abs(d.length - length) - place) / length));
  }
  const double tolerance = 4 * static_cast<double>(Limits::epsilon());
  CHECK(wrong_length <= tolerance);
  CHECK(not_unit <= tolerance);
  CHECK(turned <= tolerance);
  const auto zero = detail::direction_of<S>(Vector3<S>::Zero(), other);
  CHECK(zero.length == S(0));
  CHECK(zero.unit == other);
  CHECK(detail::length_of<S>(Vector3<S>(S(2), S(-3), S(6))) == S(7));
  CHECK(detail::unit_or_zero<S>(Vector3<S>(S(0), S(0), S(-4))) == Vector3<S>(S(0), S(0), S(-1)));
  CHECK(detail::unit_or_zero<S>(Vector3<S>::Zero()) == Vector3<S>::Zero());
}
