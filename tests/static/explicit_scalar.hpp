#pragma once

// A number without implicit conversions. Code that compiles with it writes every constant as
// Scalar(0.5), calls sqrt and the like by argument-dependent lookup, and never mixes in a double by
// accident. It therefore also compiles with dual numbers, intervals and the like.

#include <Eigen/Core>
#include <cmath>
#include <compare>
#include <concepts>
#include <limits>

#include "clothctl/core/scalar.hpp"

namespace clothctl_test {

/// A double in a class, with an explicit constructor and a named accessor.
class ExplicitDouble {
 public:
  ExplicitDouble() = default;
  constexpr explicit ExplicitDouble(double value) : value_(value) {}
  template <std::integral Integer>
  constexpr explicit ExplicitDouble(Integer value) : value_(static_cast<double>(value)) {}

  constexpr double unboxed() const { return value_; }

  constexpr ExplicitDouble operator-() const { return ExplicitDouble(-value_); }
  constexpr ExplicitDouble operator+() const { return *this; }
  constexpr ExplicitDouble& operator+=(ExplicitDouble b) {
    return *this = ExplicitDouble(value_ + b.value_);
  }
  constexpr ExplicitDouble& operator-=(ExplicitDouble b) {
    return *this = ExplicitDouble(value_ - b.value_);
  }
  constexpr ExplicitDouble& operator*=(ExplicitDouble b) {
    return *this = ExplicitDouble(value_ * b.value_);
  }
  constexpr ExplicitDouble& operator/=(ExplicitDouble b) {
    return *this = ExplicitDouble(value_ / b.value_);
  }

  friend constexpr ExplicitDouble operator+(ExplicitDouble a, ExplicitDouble b) { return a += b; }
  friend constexpr ExplicitDouble operator-(ExplicitDouble a, ExplicitDouble b) { return a -= b; }
  friend constexpr ExplicitDouble operator*(ExplicitDouble a, ExplicitDouble b) { return a *= b; }
  friend constexpr ExplicitDouble operator/(ExplicitDouble a, ExplicitDouble b) { return a /= b; }
  friend constexpr bool operator==(ExplicitDouble a, ExplicitDouble b) = default;
  friend constexpr std::partial_ordering operator<=>(ExplicitDouble a, ExplicitDouble b) = default;

 private:
  double value_ = 0.0;
};

// Mathematics found by argument-dependent lookup.
#define CLOTHCTL_TEST_UNARY(name) \
  inline ExplicitDouble name(ExplicitDouble x) { return ExplicitDouble(std::name(x.unboxed())); }
CLOTHCTL_TEST_UNARY(abs)
CLOTHCTL_TEST_UNARY(sqrt)
CLOTHCTL_TEST_UNARY(cbrt)
CLOTHCTL_TEST_UNARY(exp)
CLOTHCTL_TEST_UNARY(log)
CLOTHCTL_TEST_UNARY(sin)
CLOTHCTL_TEST_UNARY(cos)
CLOTHCTL_TEST_UNARY(tan)
CLOTHCTL_TEST_UNARY(asin)
CLOTHCTL_TEST_UNARY(acos)
CLOTHCTL_TEST_UNARY(atan)
CLOTHCTL_TEST_UNARY(tanh)
CLOTHCTL_TEST_UNARY(floor)
CLOTHCTL_TEST_UNARY(ceil)
CLOTHCTL_TEST_UNARY(round)
#undef CLOTHCTL_TEST_UNARY
inline ExplicitDouble atan2(ExplicitDouble y, ExplicitDouble x) {
  return ExplicitDouble(std::atan2(y.unboxed(), x.unboxed()));
}
inline ExplicitDouble hypot(ExplicitDouble x, ExplicitDouble y) {
  return ExplicitDouble(std::hypot(x.unboxed(), y.unboxed()));
}
inline ExplicitDouble pow(ExplicitDouble x, ExplicitDouble y) {
  return ExplicitDouble(std::pow(x.unboxed(), y.unboxed()));
}
inline ExplicitDouble copysign(ExplicitDouble x, ExplicitDouble y) {
  return ExplicitDouble(std::copysign(x.unboxed(), y.unboxed()));
}
inline bool(isnan)(ExplicitDouble x) {
  return clothctl::scalar_traits<double>::is_nan(x.unboxed());
}
inline bool(isfinite)(ExplicitDouble x) {
  return clothctl::scalar_traits<double>::is_finite(x.unboxed());
}
inline bool(isinf)(ExplicitDouble x) { return !(isnan)(x) && !(isfinite)(x); }
inline ExplicitDouble abs2(ExplicitDouble x) { return x * x; }
inline const ExplicitDouble& conj(const ExplicitDouble& x) { return x; }
inline const ExplicitDouble& real(const ExplicitDouble& x) { return x; }
inline ExplicitDouble imag(const ExplicitDouble&) { return ExplicitDouble(0.0); }

}  // namespace clothctl_test

namespace clothctl {

/// Declares the class a real scalar.
template <>
struct scalar_traits<clothctl_test::ExplicitDouble> {
  using Scalar = clothctl_test::ExplicitDouble;
  static constexpr Scalar epsilon() { return Scalar(std::numeric_limits<double>::epsilon()); }
  static constexpr Scalar infinity() { return Scalar(std::numeric_limits<double>::infinity()); }
  static bool is_finite(Scalar value) { return scalar_traits<double>::is_finite(value.unboxed()); }
  static bool is_unbounded(Scalar value) {
    return scalar_traits<double>::is_unbounded(value.unboxed());
  }
  static bool is_nan(Scalar value) { return scalar_traits<double>::is_nan(value.unboxed()); }
};

}  // namespace clothctl

namespace Eigen {

template <>
struct NumTraits<clothctl_test::ExplicitDouble> {
  using Real = clothctl_test::ExplicitDouble;
  using NonInteger = clothctl_test::ExplicitDouble;
  using Nested = clothctl_test::ExplicitDouble;
  using Literal = clothctl_test::ExplicitDouble;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = 1,
    AddCost = 3,
    MulCost = 3
  };
  static Real epsilon() { return Real(std::numeric_limits<double>::epsilon()); }
  static Real dummy_precision() { return Real(1e-12); }
  static Real highest() { return Real(std::numeric_limits<double>::max()); }
  static Real lowest() { return Real(std::numeric_limits<double>::lowest()); }
  static Real infinity() { return Real(std::numeric_limits<double>::infinity()); }
  static Real quiet_NaN() { return Real(std::numeric_limits<double>::quiet_NaN()); }
  static int digits10() { return std::numeric_limits<double>::digits10; }
  static int max_digits10() { return std::numeric_limits<double>::max_digits10; }
};

}  // namespace Eigen

// It is a real scalar without implicit conversions.
namespace clothctl_test {

template <class A, class B>
concept Adds = requires(A a, B b) {
  a + b;
};
template <class A, class B>
concept Multiplies = requires(A a, B b) {
  a* b;
};
template <class A, class B>
concept Compares = requires(A a, B b) {
  a < b;
};

static_assert(clothctl::RealScalar<ExplicitDouble>);
static_assert(!std::convertible_to<double, ExplicitDouble> &&
              !std::convertible_to<int, ExplicitDouble>);
static_assert(!std::convertible_to<ExplicitDouble, double> &&
              !std::constructible_from<double, ExplicitDouble>);
static_assert(!std::convertible_to<ExplicitDouble, bool> &&
              !std::assignable_from<ExplicitDouble&, double>);
static_assert(Adds<ExplicitDouble, ExplicitDouble> && !Adds<ExplicitDouble, double> &&
              !Adds<int, ExplicitDouble>);
static_assert(!Multiplies<double, ExplicitDouble> && !Multiplies<ExplicitDouble, int>);
static_assert(!Compares<ExplicitDouble, double> && !Compares<ExplicitDouble, int>);

}  // namespace clothctl_test
