#pragma once

// Scalars: what a number type must offer, and tests for finite and unbounded values that hold under -ffast-math, where
// compilers may assume that infinities and NaN do not exist. Built-in types are tested by their bits; any other type
// (autodiff, checked arithmetic) takes part by specialising scalar_traits.

#include <bit>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <limits>

namespace clothctl {

namespace detail {

/// True where the exponent bits of `value` are not all ones, i.e. it is neither infinite nor NaN.
inline bool exponent_is_finite(float value) { return (std::bit_cast<std::uint32_t>(value) & 0x7f800000u) != 0x7f800000u; }
inline bool exponent_is_finite(double value) {
  return (std::bit_cast<std::uint64_t>(value) & 0x7ff0000000000000u) != 0x7ff0000000000000u;
}
inline bool exponent_is_finite(long double value) {
  if constexpr (std::numeric_limits<long double>::digits == std::numeric_limits<double>::digits) {
    return exponent_is_finite(static_cast<double>(value));
  } else {
    // x87 extended keeps sign and exponent in bytes 8-9, IEEE quad in bytes 14-15 (little endian).
    constexpr int offset = std::numeric_limits<long double>::digits == 64 ? 8 : 14;
    std::uint16_t head = 0;
    std::memcpy(&head, reinterpret_cast<const unsigned char*>(&value) + offset, sizeof head);
    return (head & 0x7fffu) != 0x7fffu;
  }
}

}  // namespace detail

/// Describes a scalar type. The primary template is empty ("not a scalar"); specialise it to let a foreign type in.
///
/// A specialisation offers: `epsilon()` (spacing of values at one), `infinity()` (the value that means "no bound"),
/// `is_finite(x)` (neither NaN nor unbounded) and `is_unbounded(x)` (the value that `infinity()` returns, either sign).
template <class Scalar>
struct scalar_traits {};

/// The built-in floating-point types. All tests read bits, so they also hold under -ffast-math.
template <std::floating_point Scalar>
struct scalar_traits<Scalar> {
  /// Spacing of values at one.
  static constexpr Scalar epsilon() { return std::numeric_limits<Scalar>::epsilon(); }
  /// The value that stands for "no bound".
  static constexpr Scalar infinity() { return std::numeric_limits<Scalar>::infinity(); }
  /// Tells whether `value` is neither NaN nor infinite.
  static bool is_finite(Scalar value) { return detail::exponent_is_finite(value); }
  /// Tells whether `value` means "no bound": infinite, or beyond 1e20 (1e30 and the like are common stand-ins).
  static bool is_unbounded(Scalar value) {
    if (!is_finite(value)) return !is_nan(value);
    return value > Scalar(1e20) || value < Scalar(-1e20);
  }
  /// Tells whether `value` is not a number.
  static bool is_nan(Scalar value) {
    if (is_finite(value)) return false;
    if constexpr (sizeof(Scalar) == sizeof(float)) {
      return (std::bit_cast<std::uint32_t>(static_cast<float>(value)) & 0x007fffffu) != 0u;
    } else {
      return (std::bit_cast<std::uint64_t>(static_cast<double>(value)) & 0x000fffffffffffffu) != 0u;
    }
  }
};

/// A real number type: float, double, long double, or any type with `scalar_traits` and ordinary arithmetic.
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

/// Tells whether `value` is an ordinary number: neither NaN nor infinite. Holds under -ffast-math.
template <RealScalar Scalar>
bool is_finite(const Scalar& value) {
  return scalar_traits<Scalar>::is_finite(value);
}

/// Tells whether `value` stands for "no bound". Holds under -ffast-math.
template <RealScalar Scalar>
bool is_unbounded(const Scalar& value) {
  return scalar_traits<Scalar>::is_unbounded(value);
}

}  // namespace clothctl
