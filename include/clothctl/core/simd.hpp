#pragma once

// Vector registers in portable code: a few numbers side by side, with the arithmetic of one number.
//
// The code uses the vector types of g++ and clang, so that the same source compiles to SSE, AVX,
// AVX-512, NEON or WebAssembly code. Other scalars and compilers use plain arrays. The number of
// lanes never depends on the machine, so neither does the order of operations.
//
// 1/√x is computed from the bits: halving and negating the exponent gives a start that is within 4
// % of the answer; each Newton step y ← y (3/2 - ½ x y²) squares the relative error. So all
// machines give the same bits, which the estimates of processors do not. The constants of the first
// step are those that minimise its largest error. Reference: Kadlec, "Improving the fast inverse
// square root", 2010.

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>

#include "clothctl/config.hpp"

// CLOTHCTL_KERNEL       stands before a function: the compiler must inline it.
// CLOTHCTL_KERNEL_LAMBDA  stands after the parameters of a lambda, for the same purpose.
//
// Kernels consist of many small functions, which are fast only when they are inlined. The
// undefined-behaviour sanitizer is off in them, because its checks would multiply their code, and
// no index depends on data.
#if defined(__GNUC__)
#define CLOTHCTL_KERNEL CLOTHCTL_FORCE_INLINE __attribute__((no_sanitize("undefined")))
#define CLOTHCTL_KERNEL_LAMBDA __attribute__((always_inline, no_sanitize("undefined")))
#else
#define CLOTHCTL_KERNEL CLOTHCTL_FORCE_INLINE
#define CLOTHCTL_KERNEL_LAMBDA
#endif

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Bytes of the widest vector register of the target machine.
#if defined(__AVX512F__)
inline constexpr int kVectorBytes = 64;
#elif defined(__AVX__)
inline constexpr int kVectorBytes = 32;
#else
inline constexpr int kVectorBytes = 16;
#endif

/// Number of scalars in one vector register; 1 for scalar types and compilers without vector types.
template <class Scalar>
constexpr int native_lanes() {
#if defined(__GNUC__)
  if constexpr (std::is_same_v<Scalar, float> || std::is_same_v<Scalar, double>)
    return kVectorBytes / int(sizeof(Scalar));
#endif
  return 1;
}

/// Largest power of two that divides `lanes` and fits a register.
template <class Scalar>
constexpr int chunk_lanes(int lanes) {
  int chunk = 1;
  while (2 * chunk <= native_lanes<Scalar>() && lanes % (2 * chunk) == 0) chunk *= 2;
  return chunk;
}

/// The type of one register of `kCount` numbers.
template <class Scalar, int kCount>
struct Register {
#if defined(__GNUC__)
  typedef Scalar type __attribute__((vector_size(kCount * sizeof(Scalar))));
#else
  typedef Scalar type;
#endif
};
template <class Scalar>
struct Register<Scalar, 1> {
  typedef Scalar type;
};

/// Calls `function(integral_constant<int, i>)` for i = 0 … kCount-1, unrolled at compile time.
template <int kCount, class Function>
CLOTHCTL_KERNEL void unroll(Function&& function) {
  [&]<int... i>(std::integer_sequence<int, i...>) CLOTHCTL_KERNEL_LAMBDA {
    (function(std::integral_constant<int, i>{}), ...);
  }
  (std::make_integer_sequence<int, kCount>{});
}

}  // namespace detail

/// kLanes numbers side by side. Arithmetic acts lane by lane.
template <class Scalar, int kLanes>
struct Simd {
  /// Numbers in one register.
  static constexpr int kChunk = detail::chunk_lanes<Scalar>(kLanes);
  /// Number of registers.
  static constexpr int kChunks = kLanes / kChunk;
  /// One register.
  using Chunk = typename detail::Register<Scalar, kChunk>::type;

  /// The registers.
  Chunk chunk[kChunks];

  /// Returns the numbers at any address.
  static CLOTHCTL_KERNEL Simd load(const Scalar* from) {
    Simd out;
    detail::unroll<kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
      if constexpr (kChunk > 1) {
        std::memcpy(&out.chunk[i], from + i * kChunk, sizeof(Chunk));
      } else {
        out.chunk[i] = from[i];
      }
    });
    return out;
  }

  /// Returns the same number in every lane.
  static CLOTHCTL_KERNEL Simd all(const Scalar& value) {
    Simd out;
    detail::unroll<kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
      if constexpr (kChunk > 1) {
        out.chunk[i] = value - Chunk{};
      } else {
        out.chunk[i] = value;
      }
    });
    return out;
  }

  /// Writes the numbers to any address.
  CLOTHCTL_KERNEL void store(Scalar* to) const {
    detail::unroll<kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
      if constexpr (kChunk > 1) {
        std::memcpy(to + i * kChunk, &chunk[i], sizeof(Chunk));
      } else {
        to[i] = chunk[i];
      }
    });
  }

  /// Returns the sum of the lanes, added in their order.
  CLOTHCTL_KERNEL Scalar sum() const {
    Scalar lanes[kLanes];
    store(lanes);
    Scalar total = lanes[0];
    for (int i = 1; i < kLanes; ++i) total = total + lanes[i];
    return total;
  }

  /// Returns the largest lane; lane 0 if it is NaN.
  CLOTHCTL_KERNEL Scalar largest() const {
    Scalar lanes[kLanes];
    store(lanes);
    Scalar most = lanes[0];
    for (int i = 1; i < kLanes; ++i) most = most < lanes[i] ? lanes[i] : most;
    return most;
  }

  /// Returns `operation` of each register of a and b.
  template <class Operation>
  static CLOTHCTL_KERNEL Simd zip(const Simd& a, const Simd& b, Operation&& operation) {
    Simd out;
    detail::unroll<kChunks>(
        [&](auto i) CLOTHCTL_KERNEL_LAMBDA { out.chunk[i] = operation(a.chunk[i], b.chunk[i]); });
    return out;
  }

  friend CLOTHCTL_KERNEL Simd operator+(const Simd& a, const Simd& b) {
    return zip(
        a, b, [](const Chunk& p, const Chunk& q) CLOTHCTL_KERNEL_LAMBDA -> Chunk { return p + q; });
  }
  friend CLOTHCTL_KERNEL Simd operator-(const Simd& a, const Simd& b) {
    return zip(
        a, b, [](const Chunk& p, const Chunk& q) CLOTHCTL_KERNEL_LAMBDA -> Chunk { return p - q; });
  }
  friend CLOTHCTL_KERNEL Simd operator*(const Simd& a, const Simd& b) {
    return zip(
        a, b, [](const Chunk& p, const Chunk& q) CLOTHCTL_KERNEL_LAMBDA -> Chunk { return p * q; });
  }

  friend CLOTHCTL_KERNEL Simd operator/(const Simd& a, const Simd& b) {
    return zip(
        a, b, [](const Chunk& p, const Chunk& q) CLOTHCTL_KERNEL_LAMBDA -> Chunk { return p / q; });
  }

  /// Returns `value` where `test` is positive, and 0 elsewhere.
  friend CLOTHCTL_KERNEL Simd where_positive(const Simd& test, const Simd& value) {
    return zip(test, value, [](const Chunk& p, const Chunk& q) CLOTHCTL_KERNEL_LAMBDA -> Chunk {
      if constexpr (kChunk > 1) {
        return p > Chunk{} ? q : Chunk{};
      } else {
        return Scalar(0) < p ? q : Scalar(0);
      }
    });
  }

  /// Returns the larger of a and b in each lane; b where one of them is NaN.
  friend CLOTHCTL_KERNEL Simd larger(const Simd& a, const Simd& b) {
    return zip(a, b, [](const Chunk& p, const Chunk& q) CLOTHCTL_KERNEL_LAMBDA -> Chunk {
      if constexpr (kChunk > 1) {
        return p > q ? p : q;
      } else {
        return q < p ? p : q;
      }
    });
  }
};

namespace detail {

/// 1/√x of one register of floats or doubles.
template <class Scalar, class Chunk>
CLOTHCTL_KERNEL Chunk reciprocal_sqrt_by_bits(const Chunk& x) {
  using Bits = std::conditional_t<sizeof(Scalar) == 4, std::uint32_t, std::uint64_t>;
  typedef Bits BitChunk __attribute__((vector_size(sizeof(Chunk))));
  constexpr bool single = sizeof(Scalar) == 4;
  constexpr Bits magic = single ? Bits(0x5f1ffff9u) : Bits(0x5fe3ffff8b4f7a71u);
  const BitChunk bits = magic - (std::bit_cast<BitChunk>(x) >> 1);
  Chunk y = std::bit_cast<Chunk>(bits);
  y = y * (Scalar(0.703952253) * (Scalar(2.38924456) - x * y * y));
  const Chunk half = x * Scalar(0.5);
  unroll<single ? 1 : 3>([&](auto)
                             CLOTHCTL_KERNEL_LAMBDA { y = y * (Scalar(1.5) - half * y * y); });
  return y;
}

}  // namespace detail

/// Returns 1/√x of each lane: relative error below 8·10⁻⁷ in float and 10⁻¹⁵ in double for normal
/// x; a finite number of at least 10¹⁸ for x = 0; an arbitrary number for x < 0, infinity and NaN
/// in float and double.
template <class Scalar, int kLanes>
CLOTHCTL_KERNEL Simd<Scalar, kLanes> reciprocal_sqrt(const Simd<Scalar, kLanes>& x) {
  using Pack = Simd<Scalar, kLanes>;
  Pack out;
  detail::unroll<Pack::kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
    if constexpr (Pack::kChunk > 1) {
      out.chunk[i] = detail::reciprocal_sqrt_by_bits<Scalar>(x.chunk[i]);
    } else {
      using std::sqrt;
      const Scalar least = Scalar(1e-36);
      out.chunk[i] = Scalar(1) / sqrt(x.chunk[i] < least ? least : x.chunk[i]);
    }
  });
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
