#pragma once

// Scalars: what the library needs of a number type, and tests for finite and unbounded values. The
// tests also work under -ffast-math, where a compiler may assume that infinities and NaN do not
// exist: for the built-in types the tests read the bits. Any other type (autodiff, checked
// arithmetic) takes part by a specialisation of scalar_traits.

#include <bit>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <limits>

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

// Arguments are references: under -ffast-math newer clang assumes that a floating-point argument
// passed by value is neither NaN nor infinite, but assumes nothing about a referenced object.

/// Returns true when the exponent bits of `value` are not all ones, i.e. when the value is neither
/// infinite nor NaN.
inline bool exponent_is_finite(const float& value) {
  return (std::bit_cast<std::uint32_t>(value) & 0x7f800000u) != 0x7f800000u;
}
inline bool exponent_is_finite(const double& value) {
  return (std::bit_cast<std::uint64_t>(value) & 0x7ff0000000000000u) != 0x7ff0000000000000u;
}
inline bool exponent_is_finite(const long double& value) {
  if constexpr (std::numeric_limits<long double>::digits == std::numeric_limits<double>::digits) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &value, sizeof bits);
    return (bits & 0x7ff0000000000000u) != 0x7ff0000000000000u;
  } else {
    // x87 extended has its sign and exponent in bytes 8-9, IEEE quad in bytes 14-15 (little
    // endian).
    constexpr int offset = std::numeric_limits<long double>::digits == 64 ? 8 : 14;
    std::uint16_t head = 0;
    std::memcpy(&head, reinterpret_cast<const unsigned char*>(&value) + offset, sizeof head);
    return (head & 0x7fffu) != 0x7fffu;
  }
}

/// Returns true when a bit of the fraction of `value` is set. Among values that are not finite,
/// only NaN has such a bit.
inline bool has_fraction(const float& value) {
  return (std::bit_cast<std::uint32_t>(value) & 0x007fffffu) != 0u;
}
inline bool has_fraction(const double& value) {
  return (std::bit_cast<std::uint64_t>(value) & 0x000fffffffffffffu) != 0u;
}
inline bool has_fraction(const long double& value) {
  std::uint64_t low = 0;
  std::memcpy(&low, &value, sizeof low);
  if constexpr (std::numeric_limits<long double>::digits == std::numeric_limits<double>::digits) {
    return (low & 0x000fffffffffffffu) != 0u;
  } else if constexpr (std::numeric_limits<long double>::digits == 64) {
    return (low & 0x7fffffffffffffffu) != 0u;  // x87 extended stores the leading one
  } else {
    std::uint64_t high = 0;
    std::memcpy(&high, reinterpret_cast<const unsigned char*>(&value) + 8, sizeof high);
    return low != 0u || (high & 0x0000ffffffffffffu) != 0u;
  }
}

}  // namespace detail

/// Describes a scalar type. The primary template is empty and means "not a scalar". Specialise it
/// to use a type of your own.
///
/// A specialisation has four static functions: `epsilon()`, the spacing of values at one;
/// `infinity()`, the value that means "no bound"; `is_finite(x)`, true when x is neither NaN nor
/// unbounded; `is_unbounded(x)`, true when x is plus or minus `infinity()`.
template <class Scalar>
struct scalar_traits {};

/// The built-in floating-point types. All tests read bits, so they also work under -ffast-math.
template <std::floating_point Scalar>
struct scalar_traits<Scalar> {
  /// Spacing of values at one.
  static constexpr Scalar epsilon() { return std::numeric_limits<Scalar>::epsilon(); }
  /// The value that means "no bound".
  static constexpr Scalar infinity() { return std::numeric_limits<Scalar>::infinity(); }
  /// Returns true when `value` is neither NaN nor infinite.
  static bool is_finite(const Scalar& value) { return detail::exponent_is_finite(value); }
  /// Returns true when `value` means "no bound": it is infinite, or its magnitude exceeds 1e20
  /// (many programs write 1e30 for "no bound").
  static bool is_unbounded(const Scalar& value) {
    if (!is_finite(value)) return !is_nan(value);
    return value > Scalar(1e20) || value < Scalar(-1e20);
  }
  /// Returns true when `value` is NaN.
  static bool is_nan(const Scalar& value) {
    return !is_finite(value) && detail::has_fraction(value);
  }
};

/// A real number type: float, double, long double, or any type with `scalar_traits` and ordinary
/// arithmetic.
template <class Scalar>
concept RealScalar = requires(Scalar a, const Scalar b) {
  { scalar_traits<Scalar>::epsilon() } -> std::convertible_to<Scalar>;
  { scalar_traits<Scalar>::infinity() } -> std::convertible_to<Scalar>;
  { scalar_traits<Scalar>::is_finite(b) } -> std::convertible_to<bool>;
  { scalar_traits<Scalar>::is_unbounded(b) } -> std::convertible_to<bool>;
  { b + b } -> std::convertible_to<Scalar>;
  { b - b } -> std::convertible_to<Scalar>;
  { b* b } -> std::convertible_to<Scalar>;
  { b / b } -> std::convertible_to<Scalar>;
  { b < b } -> std::convertible_to<bool>;
  { a += b } -> std::same_as<Scalar&>;
}
&&std::constructible_from<Scalar, double>;

/// Returns true when `value` is neither NaN nor infinite. Works under -ffast-math.
template <RealScalar Scalar>
bool is_finite(const Scalar& value) {
  return scalar_traits<Scalar>::is_finite(value);
}

/// Returns true when `value` means "no bound". Works under -ffast-math.
template <RealScalar Scalar>
bool is_unbounded(const Scalar& value) {
  return scalar_traits<Scalar>::is_unbounded(value);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
