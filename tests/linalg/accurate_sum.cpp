#include "clothctl/linalg/accurate_sum.hpp"

#include <cmath>
#include <cstdint>
#include <random>

#include "support/catch.hpp"

using namespace clothctl;
using clothctl::AccurateSum;

TEMPLATE_TEST_CASE("sums of cancelling products are accurate to the last digit", "[qp]", float,
                   double) {
  using S = TestType;
  REQUIRE(has_accurate_sums<S>());
  const int most = sizeof(S) == sizeof(float)
                       ? 1 << 20
                       : 1 << 30;  // products and sums are exact in 64 bits but not in S
  std::mt19937 random(5);
  std::uniform_int_distribution<int> large(-most, most), small(-9, 9);
  for (int trial = 0; trial < 100; ++trial) {
    AccurateSum<S> sum, other;
    std::int64_t exact = 0;
    S plain(0);
    const auto add = [&](AccurateSum<S>& to, int a, int b, int sign) {
      to.add_product(static_cast<S>(a), static_cast<S>(b));
      exact += std::int64_t{sign} * a * b;
      plain += static_cast<S>(sign) * static_cast<S>(a) * static_cast<S>(b);
    };
    for (int k = 0; k < 7; ++k) {
      const int a = large(random) / 2, b = large(random) / 2;
      add(sum, a, b, 1);
      add(k % 2 == 0 ? other : sum, k % 2 == 0 ? a : -a, b + small(random), k % 2 == 0 ? -1 : 1);
    }
    sum.subtract(other);
    sum.add(S(3));
    exact += 3;
    CHECK(sum.value() == static_cast<S>(exact));
    if (trial == 0) CHECK_FALSE(plain + S(3) == static_cast<S>(exact));
  }
}

TEST_CASE("a sum includes the rounding error of each product", "[qp]") {
  AccurateSum<double> sum;
  const double a = 1.0 + std::ldexp(1.0, -30);
  sum.add_product(a, a);  // 1 + 2^-29 + 2^-60
  sum.add(-1.0 - std::ldexp(1.0, -29));
  CHECK(sum.value() == std::ldexp(1.0, -60));
}

TEST_CASE("a sum that is not finite reports it", "[qp]") {
  AccurateSum<double> sum;
  sum.add_product(1e300, 1e300);
  CHECK_FALSE(is_finite(sum.value()));
}
