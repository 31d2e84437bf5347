#pragma once

// Reading and writing a batch of points that lie anywhere in memory.
//
// A vertex is four numbers side by side: x, y, z and the inverse mass w. A batch takes one vertex a
// lane; its four packs are the transposed block, made by register shuffles instead of single loads.

#include <cstddef>
#include <cstring>
#include <type_traits>

#include "clothctl/core/simd.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Vertices in a batch; 1 for other scalars than float and double.
template <class Scalar>
constexpr int batch_lanes() {
  return std::is_same_v<Scalar, float> ? 16 : std::is_same_v<Scalar, double> ? 8 : 1;
}

#if defined(__GNUC__)
/// Transposes the 4×4 blocks of four registers of 4 or 8 numbers (two blocks side by side).
template <class Chunk>
CLOTHCTL_KERNEL void transpose_blocks(Chunk& a, Chunk& b, Chunk& c, Chunk& d) {
  if constexpr (sizeof(Chunk) / sizeof(a[0]) == 4) {
    const Chunk ab_low = __builtin_shufflevector(a, b, 0, 4, 1, 5);
    const Chunk ab_high = __builtin_shufflevector(a, b, 2, 6, 3, 7);
    const Chunk cd_low = __builtin_shufflevector(c, d, 0, 4, 1, 5);
    const Chunk cd_high = __builtin_shufflevector(c, d, 2, 6, 3, 7);
    a = __builtin_shufflevector(ab_low, cd_low, 0, 1, 4, 5);
    b = __builtin_shufflevector(ab_low, cd_low, 2, 3, 6, 7);
    c = __builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5);
    d = __builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7);
  } else if constexpr (sizeof(Chunk) / sizeof(a[0]) == 16) {
    const Chunk ab_low =
        __builtin_shufflevector(a, b, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
    const Chunk ab_high =
        __builtin_shufflevector(a, b, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
    const Chunk cd_low =
        __builtin_shufflevector(c, d, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
    const Chunk cd_high =
        __builtin_shufflevector(c, d, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
    a = __builtin_shufflevector(ab_low, cd_low, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13,
                                28, 29);
    b = __builtin_shufflevector(ab_low, cd_low, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15,
                                30, 31);
    c = __builtin_shufflevector(ab_high, cd_high, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13,
                                28, 29);
    d = __builtin_shufflevector(ab_high, cd_high, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14,
                                15, 30, 31);
  } else {
    const Chunk ab_low = __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13);
    const Chunk ab_high = __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15);
    const Chunk cd_low = __builtin_shufflevector(c, d, 0, 8, 1, 9, 4, 12, 5, 13);
    const Chunk cd_high = __builtin_shufflevector(c, d, 2, 10, 3, 11, 6, 14, 7, 15);
    a = __builtin_shufflevector(ab_low, cd_low, 0, 1, 8, 9, 4, 5, 12, 13);
    b = __builtin_shufflevector(ab_low, cd_low, 2, 3, 10, 11, 6, 7, 14, 15);
    c = __builtin_shufflevector(ab_high, cd_high, 0, 1, 8, 9, 4, 5, 12, 13);
    d = __builtin_shufflevector(ab_high, cd_high, 2, 3, 10, 11, 6, 7, 14, 15);
  }
}
#endif

/// The points of a batch and their inverse masses.
template <class Scalar>
struct PointBatch {
  static constexpr int kLanes = batch_lanes<Scalar>();
  using Pack = Simd<Scalar, kLanes>;
  /// Lanes of a register if the transposition serves them, else 0.
  static constexpr int kBlock = Pack::kChunk >= 4 ? Pack::kChunk : 0;

  Pack x, y, z, w;

  /// Reads the vertices whose first numbers are at `offset[lane]`.
  static CLOTHCTL_KERNEL PointBatch load(const Scalar* points, const int* offset) {
    PointBatch out;
#if defined(__GNUC__)
    if constexpr (kBlock > 0) {
      using Chunk = typename Pack::Chunk;
      unroll<Pack::kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
        Chunk row[4];
        unroll<4>([&](auto r) CLOTHCTL_KERNEL_LAMBDA {
          row[r] = read_row(points, offset + i * kBlock + r);
        });
        transpose_blocks(row[0], row[1], row[2], row[3]);
        out.x.chunk[i] = row[0];
        out.y.chunk[i] = row[1];
        out.z.chunk[i] = row[2];
        out.w.chunk[i] = row[3];
      });
      return out;
    }
#endif
    Scalar value[4][kLanes];
    for (int lane = 0; lane < kLanes; ++lane) {
      for (int c = 0; c < 4; ++c) value[c][lane] = points[offset[lane] + c];
    }
    return {Pack::load(value[0]), Pack::load(value[1]), Pack::load(value[2]), Pack::load(value[3])};
  }

  /// Writes the vertices back. Lanes of the same vertex must hold the same numbers.
  CLOTHCTL_KERNEL void store(Scalar* points, const int* offset) const {
#if defined(__GNUC__)
    if constexpr (kBlock > 0) {
      using Chunk = typename Pack::Chunk;
      unroll<Pack::kChunks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA {
        Chunk row[4] = {x.chunk[i], y.chunk[i], z.chunk[i], w.chunk[i]};
        transpose_blocks(row[0], row[1], row[2], row[3]);
        unroll<4>([&](auto r) CLOTHCTL_KERNEL_LAMBDA {
          write_row(row[r], points, offset + i * kBlock + r);
        });
      });
      return;
    }
#endif
    Scalar value[4][kLanes];
    x.store(value[0]);
    y.store(value[1]);
    z.store(value[2]);
    w.store(value[3]);
    for (int lane = 0; lane < kLanes; ++lane) {
      for (int c = 0; c < 4; ++c) points[offset[lane] + c] = value[c][lane];
    }
  }

 private:
#if defined(__GNUC__)
  using Vertex = typename Register<Scalar, kBlock == 0 ? 1 : 4>::type;

  /// Reads lane 0 of `offset`, or lanes 0 and 4 side by side.
  template <class Chunk = typename Pack::Chunk>
  static CLOTHCTL_KERNEL Chunk read_row(const Scalar* points, const int* offset) {
    Vertex first;
    std::memcpy(&first, points + offset[0], sizeof first);
    if constexpr (kBlock == 16) {
      Vertex second, third, fourth;
      std::memcpy(&second, points + offset[4], sizeof second);
      std::memcpy(&third, points + offset[8], sizeof third);
      std::memcpy(&fourth, points + offset[12], sizeof fourth);
      const auto low = __builtin_shufflevector(first, second, 0, 1, 2, 3, 4, 5, 6, 7);
      const auto high = __builtin_shufflevector(third, fourth, 0, 1, 2, 3, 4, 5, 6, 7);
      return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14,
                                     15);
    } else if constexpr (kBlock == 8) {
      Vertex second;
      std::memcpy(&second, points + offset[4], sizeof second);
      return __builtin_shufflevector(first, second, 0, 1, 2, 3, 4, 5, 6, 7);
    } else {
      return first;
    }
  }
  template <class Chunk>
  static CLOTHCTL_KERNEL void write_row(const Chunk& row, Scalar* points, const int* offset) {
    if constexpr (kBlock == 16) {
      const Vertex first = __builtin_shufflevector(row, row, 0, 1, 2, 3);
      const Vertex second = __builtin_shufflevector(row, row, 4, 5, 6, 7);
      const Vertex third = __builtin_shufflevector(row, row, 8, 9, 10, 11);
      const Vertex fourth = __builtin_shufflevector(row, row, 12, 13, 14, 15);
      std::memcpy(points + offset[0], &first, sizeof first);
      std::memcpy(points + offset[4], &second, sizeof second);
      std::memcpy(points + offset[8], &third, sizeof third);
      std::memcpy(points + offset[12], &fourth, sizeof fourth);
    } else if constexpr (kBlock == 8) {
      const Vertex first = __builtin_shufflevector(row, row, 0, 1, 2, 3);
      const Vertex second = __builtin_shufflevector(row, row, 4, 5, 6, 7);
      std::memcpy(points + offset[0], &first, sizeof first);
      std::memcpy(points + offset[4], &second, sizeof second);
    } else {
      std::memcpy(points + offset[0], &row, sizeof row);
    }
  }
#endif
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
