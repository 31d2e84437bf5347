#pragma once

// A small source of numbers that look random: splitmix64, a counter whose bits are mixed. It gives
// the same numbers with every compiler and library, which the distributions of <random> do not.
//
// Reference: Steele, Lea, Flood, Fast splittable pseudorandom number generators, OOPSLA 2014.

#include <cstdint>

#include "clothctl/core/scalar.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// A stream of numbers that depends on its seed alone.
class SplitMix {
 public:
  /// Starts the stream of a seed. Neighbouring seeds give streams that look unrelated.
  explicit SplitMix(std::uint64_t seed) : state_(seed) {}

  /// Returns the next 64 bits.
  std::uint64_t next() {
    state_ += 0x9e3779b97f4a7c15u;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
  }
  /// Returns a number in [0, 1): one of 2²⁴, so that every scalar holds it without rounding to 1.
  template <RealScalar Scalar>
  Scalar uniform() {
    return Scalar(static_cast<double>(next() >> 40)) / Scalar(16777216.0);
  }

 private:
  std::uint64_t state_;
};

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
