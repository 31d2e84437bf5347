#pragma once

// A pack: a few numbers in as many vector registers as they need (core/simd.hpp), with the
// operations of dense kernels. A chunk is one register of a pack, the widest one whose length
// divides the length of the pack.

#include <cstring>
#include <type_traits>

#include "clothctl/core/simd.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Leading dimensions are multiples of this number of scalars, those of the widest register of any
/// machine. So the layout of the memory is the same in all units of a program, even if their
/// compiler flags differ.
template <class Scalar>
constexpr int padded_lanes() {
  return std::is_same_v<Scalar, float> || std::is_same_v<Scalar, double> ? 64 / int(sizeof(Scalar))
                                                                         : 1;
}

/// True if the machine has 32 vector registers. Otherwise 16 are assumed.
#if defined(__AVX512F__) || defined(__aarch64__)
inline constexpr bool kManyRegisters = true;
#else
inline constexpr bool kManyRegisters = false;
#endif

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
