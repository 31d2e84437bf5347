#pragma once

// Orientation and circle tests of points with integer coordinates, without rounding. A mesh in the
// plane is built on such a lattice, so that no test contradicts another one.
//
//   orientation(a, b, c)   = det(b - a, c - a), twice the signed area of the triangle
//   in_circle(a, b, c, d)  = sign of Σ_cyclic |a-d|² det(b - d, c - d), positive when d lies inside
//                            the circle through a, b, c (counter-clockwise)
//
// With |coordinate| ≤ 2^28, differences are at most 2^29 and determinants at most 2^59, so 64 bits
// hold them. The circle test multiplies such numbers and adds three products in 128 bits.

#include <cstdint>

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// A point of the lattice.
struct LatticePoint {
  std::int64_t x = 0;
  std::int64_t y = 0;

  bool operator==(const LatticePoint&) const = default;
};

/// The largest magnitude of a coordinate for which the tests are exact.
inline constexpr std::int64_t kLatticeLimit = std::int64_t(1) << 28;

/// Twice the signed area of the triangle abc: positive when it is counter-clockwise.
inline std::int64_t orientation(const LatticePoint& a, const LatticePoint& b,
                                const LatticePoint& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/// A signed integer of 128 bits in two's complement.
struct WideInteger {
  std::uint64_t high = 0;
  std::uint64_t low = 0;

  /// Returns the product of two integers.
  static WideInteger product(std::int64_t a, std::int64_t b) {
    const bool negative = (a < 0) != (b < 0);
    const auto magnitude = [](std::int64_t v) {
      return v < 0 ? std::uint64_t(0) - static_cast<std::uint64_t>(v)
                   : static_cast<std::uint64_t>(v);
    };
    const std::uint64_t p = magnitude(a), q = magnitude(b), half = 0xffffffffu;
    const std::uint64_t p0 = p & half, p1 = p >> 32, q0 = q & half, q1 = q >> 32;
    const std::uint64_t first = p0 * q0, second = p1 * q0 + (first >> 32);
    const std::uint64_t third = p0 * q1 + (second & half);
    WideInteger out{p1 * q1 + (second >> 32) + (third >> 32), (third << 32) | (first & half)};
    if (negative) {
      out.high = ~out.high;
      out.low = ~out.low;
      out += WideInteger{0, 1};
    }
    return out;
  }

  WideInteger& operator+=(const WideInteger& other) {
    low += other.low;
    high += other.high + (low < other.low ? 1u : 0u);
    return *this;
  }

  /// Returns -1, 0 or 1.
  int sign() const {
    if (high >> 63 != 0) return -1;
    return high != 0 || low != 0 ? 1 : 0;
  }
};

/// Returns 1 when d lies inside the circle through the counter-clockwise a, b, c; 0 on it; -1
/// outside.
inline int in_circle(const LatticePoint& a, const LatticePoint& b, const LatticePoint& c,
                     const LatticePoint& d) {
  const LatticePoint p{a.x - d.x, a.y - d.y}, q{b.x - d.x, b.y - d.y}, r{c.x - d.x, c.y - d.y};
  const auto square = [](const LatticePoint& v) { return v.x * v.x + v.y * v.y; };
  const auto cross = [](const LatticePoint& u, const LatticePoint& v) {
    return u.x * v.y - u.y * v.x;
  };
  WideInteger sum = WideInteger::product(square(p), cross(q, r));
  sum += WideInteger::product(square(q), cross(r, p));
  sum += WideInteger::product(square(r), cross(p, q));
  return sum.sign();
}

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
