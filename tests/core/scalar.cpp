// Tests of built-in scalars for finite, unbounded and NaN values. This file is also compiled and
// run under -ffast-math, where the compiler may assume that none of these values exists, so nothing
// here compares with an infinity or a NaN.

#include "clothctl/core/scalar.hpp"

#include <bit>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <type_traits>

#include "support/catch.hpp"

using namespace clothctl;

namespace clothctl_test {

// Values in memory that no compiler knows in advance. They are never passed or returned by value:
// under -ffast-math a compiler may assume that an argument is neither NaN nor infinite.
template <class Scalar>
struct Extremes {
  static Scalar infinity[2];
  static Scalar nan[2];
  static Scalar largest;
  static Scalar subnormal;
};
template <class Scalar>
Scalar Extremes<Scalar>::infinity[2] = {std::numeric_limits<Scalar>::infinity(),
                                        -std::numeric_limits<Scalar>::infinity()};
template <class Scalar>
Scalar Extremes<Scalar>::nan[2] = {std::numeric_limits<Scalar>::quiet_NaN(),
                                   -std::numeric_limits<Scalar>::quiet_NaN()};
template <class Scalar>
Scalar Extremes<Scalar>::largest = (std::numeric_limits<Scalar>::max)();
template <class Scalar>
Scalar Extremes<Scalar>::subnormal = std::numeric_limits<Scalar>::denorm_min();

}  // namespace clothctl_test

using clothctl_test::Extremes;

namespace {

template <class Scalar>
Scalar from_memory(Scalar value) {
  volatile Scalar kept = value;
  return kept;
}

struct Opaque {};

}  // namespace

// Classified in place: a compiler may assume that by-value parameters are ordinary.
static_assert(std::is_same_v<decltype(&scalar_traits<float>::is_finite), bool (*)(const float&)>);
static_assert(
    std::is_same_v<decltype(&scalar_traits<double>::is_unbounded), bool (*)(const double&)>);
static_assert(
    std::is_same_v<decltype(&scalar_traits<long double>::is_nan), bool (*)(const long double&)>);

static_assert(RealScalar<float> && RealScalar<double> && RealScalar<long double>);
static_assert(!RealScalar<int> && !RealScalar<bool> && !RealScalar<std::string> &&
              !RealScalar<Opaque> && !RealScalar<double*>);

TEMPLATE_TEST_CASE("ordinary numbers are finite and bounded", "[scalar]", float, double,
                   long double) {
  for (const double value : {0.0, -0.0, 1.0, -1.0, 1e-30, 3.5e12, -9.9e19}) {
    const TestType x = from_memory(static_cast<TestType>(value));
    CAPTURE(value);
    CHECK(is_finite(x));
    CHECK_FALSE(is_unbounded(x));
    CHECK_FALSE(scalar_traits<TestType>::is_nan(x));
  }
  CHECK(is_finite(Extremes<TestType>::largest));
  CHECK(is_finite(Extremes<TestType>::subnormal));
  CHECK_FALSE(is_unbounded(Extremes<TestType>::subnormal));
}

TEMPLATE_TEST_CASE("infinities are unbounded and not finite", "[scalar]", float, double,
                   long double) {
  for (const TestType& x : Extremes<TestType>::infinity) {
    CHECK_FALSE(is_finite(x));
    CHECK(is_unbounded(x));
    CHECK_FALSE(scalar_traits<TestType>::is_nan(x));
  }
  const TestType no_bound = scalar_traits<TestType>::infinity();
  CHECK(is_unbounded(no_bound));
}

TEMPLATE_TEST_CASE("NaN is neither finite nor unbounded", "[scalar]", float, double, long double) {
  for (const TestType& x : Extremes<TestType>::nan) {
    CHECK_FALSE(is_finite(x));
    CHECK_FALSE(is_unbounded(x));
    CHECK(scalar_traits<TestType>::is_nan(x));
  }
}

TEMPLATE_TEST_CASE("huge numbers that mean infinity count as unbounded", "[scalar]", float, double,
                   long double) {
  for (const double value : {1e30, -1e30, 2e20, -2e20}) {
    const TestType x = from_memory(static_cast<TestType>(value));
    CAPTURE(value);
    CHECK(is_finite(x));
    CHECK(is_unbounded(x));
  }
}

TEST_CASE("any non-zero fraction makes a NaN", "[scalar]") {
  for (int bit = 0; bit < 52; ++bit) {
    const std::uint64_t bits = 0x7ff0000000000000u | std::uint64_t{1} << bit;
    double x = 0;
    std::memcpy(&x, &bits, sizeof x);
    CAPTURE(bit);
    CHECK(scalar_traits<double>::is_nan(x));
  }
  for (int bit = 0; bit < 23; ++bit) {
    const std::uint32_t bits = 0x7f800000u | std::uint32_t{1} << bit;
    float x = 0;
    std::memcpy(&x, &bits, sizeof x);
    CAPTURE(bit);
    CHECK(scalar_traits<float>::is_nan(x));
  }
}

TEST_CASE("every exponent of a double is classified by its bits", "[scalar]") {
  // All exponents, with both signs and a few mantissas.
  for (std::uint64_t exponent = 0; exponent < 2048; ++exponent) {
    for (const std::uint64_t mantissa :
         {std::uint64_t{0}, std::uint64_t{1}, std::uint64_t{1} << 51}) {
      for (const std::uint64_t sign : {std::uint64_t{0}, std::uint64_t{1} << 63}) {
        const double x = std::bit_cast<double>(sign | (exponent << 52) | mantissa);
        const bool ordinary = exponent != 2047;
        if (is_finite(x) != ordinary) FAIL("exponent " << exponent << " is misjudged");
        if (scalar_traits<double>::is_nan(x) != (!ordinary && mantissa != 0))
          FAIL("exponent " << exponent << ", mantissa " << mantissa);
        if (!ordinary && is_unbounded(x) != (mantissa == 0)) FAIL("bound of mantissa " << mantissa);
      }
    }
  }
  SUCCEED();
}

TEMPLATE_TEST_CASE("epsilon is the spacing at one", "[scalar]", float, double) {
  const TestType one = from_memory(TestType(1));
  const TestType next = from_memory(one + scalar_traits<TestType>::epsilon());
  const TestType tie = from_memory(one + scalar_traits<TestType>::epsilon() / TestType(4));
  CHECK(next > one);
  CHECK(tie == one);
}
