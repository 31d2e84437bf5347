#pragma once

// A pack: a few numbers in as many vector registers as they need. The code uses the vector types of
// g++ and clang, so that the same source compiles to SSE, AVX, AVX-512, NEON or WebAssembly code.
// Other scalars and compilers use plain arrays. A chunk is one register of a pack, the widest one
// whose length divides the length of the pack.

#include <cstring>
#include <type_traits>
#include <utility>

#include "clothctl/config.hpp"
#include "clothctl/core/types.hpp"

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

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Leading dimensions are multiples of this number of scalars, those of the widest register of any
/// machine. So the layout of the memory is the same in all units of a program, even if their
/// compiler flags differ.
template <class Scalar>
constexpr int padded_lanes() {
  return std::is_same_v<Scalar, float> || std::is_same_v<Scalar, double> ? 64 / int(sizeof(Scalar))
                                                                         : 1;
}

/// Bytes of the widest vector register of the target machine.
#if defined(__AVX512F__)
inline constexpr int kVectorBytes = 64;
#elif defined(__AVX__)
inline constexpr int kVectorBytes = 32;
#else
inline constexpr int kVectorBytes = 16;
#endif

/// True if the machine has 32 vector registers. Otherwise 16 are assumed.
#if defined(__AVX512F__) || defined(__aarch64__)
inline constexpr bool kManyRegisters = true;
#else
inline constexpr bool kManyRegisters = false;
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

/// kLanes numbers side by side.
template <class Scalar, int kLanes>
struct Pack {
  static constexpr int kChunk = chunk_lanes<Scalar>(kLanes);
  static constexpr int kChunks = kLanes / kChunk;
  using Chunk = typename Register<Scalar, kChunk>::type;

  Chunk chunk[kChunks];

  /// Reads kLanes numbers from any address.
  CLOTHCTL_KERNEL void load(const Scalar* from) {
    if constexpr (kChunk > 1) {
      unroll<kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
        std::memcpy(&chunk[i], from + i * kChunk, sizeof(Chunk));
      });
    } else {
      for (int i = 0; i < kLanes; ++i) chunk[i] = from[i];
    }
  }
  /// Writes kLanes numbers to any address.
  CLOTHCTL_KERNEL void store(Scalar* to) const {
    if constexpr (kChunk > 1) {
      unroll<kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
        std::memcpy(to + i * kChunk, &chunk[i], sizeof(Chunk));
      });
    } else {
      for (int i = 0; i < kLanes; ++i) to[i] = chunk[i];
    }
  }
  /// Sets every lane to zero.
  CLOTHCTL_KERNEL void set_zero() {
    unroll<kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
      if constexpr (kChunk > 1) {
        chunk[i] = Chunk{};
      } else {
        chunk[i] = Scalar(0);
      }
    });
  }
  /// this += other.
  CLOTHCTL_KERNEL void add(const Pack& other) {
    unroll<kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA { chunk[i] = chunk[i] + other.chunk[i]; });
  }
  /// this -= other.
  CLOTHCTL_KERNEL void subtract(const Pack& other) {
    unroll<kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA { chunk[i] = chunk[i] - other.chunk[i]; });
  }
  /// this *= factor.
  CLOTHCTL_KERNEL void scale(const Scalar& factor) {
    unroll<kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA { chunk[i] = chunk[i] * factor; });
  }
  /// this += a · factor.
  CLOTHCTL_KERNEL void add_product(const Pack& a, const Scalar& factor) {
    unroll<kChunks>([&](auto i)
                        CLOTHCTL_KERNEL_LAMBDA { chunk[i] = chunk[i] + a.chunk[i] * factor; });
  }
  /// this -= a · factor.
  CLOTHCTL_KERNEL void subtract_product(const Pack& a, const Scalar& factor) {
    unroll<kChunks>([&](auto i)
                        CLOTHCTL_KERNEL_LAMBDA { chunk[i] = chunk[i] - a.chunk[i] * factor; });
  }
  /// this += a · b, lane by lane.
  CLOTHCTL_KERNEL void add_product(const Pack& a, const Pack& b) {
    unroll<kChunks>([&](auto i)
                        CLOTHCTL_KERNEL_LAMBDA { chunk[i] = chunk[i] + a.chunk[i] * b.chunk[i]; });
  }
  /// Sum of the lanes. Adds the chunks first, and then the lanes of the result pairwise.
  CLOTHCTL_KERNEL Scalar sum() const {
    Chunk total = chunk[0];
    unroll<kChunks - 1>([&](auto i) CLOTHCTL_KERNEL_LAMBDA { total = total + chunk[i + 1]; });
    if constexpr (kChunk > 1) {
      return sum_of<0, kChunk>(total);
    } else {
      return total;
    }
  }

  /// True if sums_of_four works on registers.
  static constexpr bool kTransposes = kChunk == 4 && native_lanes<Scalar>() >= 4;

  /// Returns the sums of the lanes of four packs in one register, each added as `sum` adds it.
  static CLOTHCTL_KERNEL Chunk sums_of_four(const Pack (&packs)[4]) requires kTransposes {
    Chunk total[4];
    for (int p = 0; p < 4; ++p) {
      total[p] = packs[p].chunk[0];
      unroll<kChunks - 1>(
          [&](auto i) CLOTHCTL_KERNEL_LAMBDA { total[p] = total[p] + packs[p].chunk[i + 1]; });
    }
    // Lanes 0 and 1, and 2 and 3, of each pack; then the two sums.
    const Chunk a = __builtin_shufflevector(total[0], total[1], 0, 4, 2, 6) +
                    __builtin_shufflevector(total[0], total[1], 1, 5, 3, 7);
    const Chunk b = __builtin_shufflevector(total[2], total[3], 0, 4, 2, 6) +
                    __builtin_shufflevector(total[2], total[3], 1, 5, 3, 7);
    return __builtin_shufflevector(a, b, 0, 1, 4, 5) + __builtin_shufflevector(a, b, 2, 3, 6, 7);
  }

 private:
  template <int kFirst, int kCount>
  static CLOTHCTL_KERNEL Scalar sum_of(const Chunk& values) {
    if constexpr (kCount == 1) {
      return values[kFirst];
    } else {
      return sum_of<kFirst, kCount / 2>(values) + sum_of<kFirst + kCount / 2, kCount / 2>(values);
    }
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
