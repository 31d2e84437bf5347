#pragma once

// Solves with a packed front (pack_front in dense_kernels.hpp), one panel of rows after the other.
// x_i are the rows of panel i of the right-hand sides, L_ik the block of L or V in row panel i and
// column panel k:
//     forward   x_i <- L_ii⁻¹ (x_i - Σ_{k<i} L_ik x_k),
//     backward  x_i <- L_ii⁻ᵀ x_i,  then x_k <- x_k - L_ikᵀ x_i for all k < i, last panel first.
// Each pass reads the factor once: the forward pass from begin to end, the backward pass from end
// to begin. For several right-hand sides, each lane is one of them, and entries of the factor are
// broadcast. For one right-hand side, the lanes are the rows of a panel.

#include <cstdint>

#include "clothctl/linalg/detail/dense_kernels.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Prefetches the memory at `base` + `offset` scalars. This address need not be inside an object.
template <class Scalar>
CLOTHCTL_KERNEL void prefetch([[maybe_unused]] const Scalar* base, [[maybe_unused]] Index offset) {
#if defined(__GNUC__)
  const std::intptr_t bytes = offset * static_cast<std::intptr_t>(sizeof(Scalar));
  __builtin_prefetch(reinterpret_cast<const void*>(reinterpret_cast<std::intptr_t>(base) + bytes));
#endif
}

/// kRows rows of kLanes right-hand sides.
template <class Scalar, int kRows, int kLanes>
struct RowBlock {
  /// A single right-hand side is stored in one pack; several right-hand sides have one pack for
  /// each row.
  static constexpr bool kSingle = kLanes == 1;
  static constexpr int kPacks = kSingle ? 1 : kRows;
  /// Prefetch distance of a forward pass, in scalars; found by measurement.
  static constexpr Index kAhead = 2048 / Index(sizeof(Scalar));
  using Row = Pack<Scalar, kSingle ? kRows : kLanes>;
  Row row[kPacks];

  CLOTHCTL_KERNEL void set_zero() {
    unroll<kPacks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA { row[i].set_zero(); });
  }
  /// Loads contiguous rows.
  CLOTHCTL_KERNEL void load(const Scalar* x) {
    unroll<kPacks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA { row[i].load(x + i * kLanes); });
  }
  CLOTHCTL_KERNEL void store(Scalar* x) const {
    unroll<kPacks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA { row[i].store(x + i * kLanes); });
  }
  CLOTHCTL_KERNEL void subtract(const RowBlock& other) {
    unroll<kPacks>([&](auto i) CLOTHCTL_KERNEL_LAMBDA { row[i].subtract(other.row[i]); });
  }
  /// this += block · x; column k of the block starts kRows·k after `block`, row k of x kLanes·k
  /// after `x`.
  CLOTHCTL_KERNEL void add_product(const Scalar* block, Index columns, const Scalar* x) {
    Index k = 0;
    if constexpr (kSingle) {
      // Three sums, so that no addition waits for the one before it; columns come in threes.
      Row second, third;
      second.set_zero();
      third.set_zero();
      for (; k + 3 <= columns; k += 3, block += 3 * kRows, x += 3) {
        prefetch(block, kAhead);
        prefetch(block + 2 * kRows, kAhead);
        Row other;
        other.load(block);
        row[0].add_product(other, x[0]);
        other.load(block + kRows);
        second.add_product(other, x[1]);
        other.load(block + 2 * kRows);
        third.add_product(other, x[2]);
      }
      second.add(third);
      row[0].add(second);
    }
    for (; k < columns; ++k, block += kRows, x += kLanes) {
      prefetch(block, kAhead);
      Row other;
      if constexpr (kSingle) {
        other.load(block);
        row[0].add_product(other, *x);
      } else {
        other.load(x);
        unroll<kRows>([&](auto i) CLOTHCTL_KERNEL_LAMBDA { row[i].add_product(other, block[i]); });
      }
    }
  }
  /// x -= blockᵀ · this.
  CLOTHCTL_KERNEL void subtract_transposed(const Scalar* block, Index columns, Scalar* x) const {
    const Index before = -columns * kRows;  // the panel above comes next
    Index k = 0;
    if constexpr (kSingle && Row::kTransposes) {
      for (; k + 4 <= columns; k += 4, block += 4 * kRows, x += 4) {
        Row product[4];
        for (int c = 0; c < 4; ++c) {
          prefetch(block + c * kRows, before);
          Row other;
          other.load(block + c * kRows);
          product[c].set_zero();
          product[c].add_product(other, row[0]);
        }
        const typename Row::Chunk sums = Row::sums_of_four(product);
        for (int c = 0; c < 4; ++c) x[c] = x[c] - sums[c];
      }
    }
    for (; k < columns; ++k, block += kRows, x += kLanes) {
      prefetch(block, before);
      Row other;
      if constexpr (kSingle) {
        Row product;
        other.load(block);
        product.set_zero();
        product.add_product(other, row[0]);
        *x = *x - product.sum();
      } else {
        other.load(x);
        unroll<kRows>([&](auto i)
                          CLOTHCTL_KERNEL_LAMBDA { other.subtract_product(row[i], block[i]); });
        other.store(x);
      }
    }
  }
  /// this <- T · this for a lower triangular T of kRows columns of kRows.
  CLOTHCTL_KERNEL void multiply_triangular(const Scalar* t) {
    if constexpr (kSingle) {
      Scalar x[kRows];
      store(x);
      set_zero();
      add_product(t, kRows, x);
    } else {
      unroll<kRows>([&](auto reversed) CLOTHCTL_KERNEL_LAMBDA {
        constexpr int i = kRows - 1 - decltype(reversed)::value;
        row[i].scale(t[kRows * i + i]);
        unroll<i>([&](auto k)
                      CLOTHCTL_KERNEL_LAMBDA { row[i].add_product(row[k], t[kRows * k + i]); });
      });
    }
  }
  /// this <- Tᵀ · this.
  CLOTHCTL_KERNEL void multiply_triangular_transposed(const Scalar* t) {
    if constexpr (kSingle) {
      Scalar x[kRows];
      for (int k = 0; k < kRows; ++k) x[k] = Scalar(0);
      subtract_transposed(t, kRows, x);
      load(x);
      row[0].scale(Scalar(-1));
    } else {
      unroll<kRows>([&](auto k) CLOTHCTL_KERNEL_LAMBDA {
        row[k].scale(t[kRows * k + k]);
        unroll<kRows - 1 - decltype(k)::value>([&](auto offset) CLOTHCTL_KERNEL_LAMBDA {
          constexpr int i = decltype(k)::value + 1 + decltype(offset)::value;
          row[k].add_product(row[i], t[kRows * k + i]);
        });
      });
    }
  }
};

/// Forward pass of a front. Solves for the pivot rows x in place. Then calls `subtract(row, block)`
/// for each panel of border rows, where `block` is its product V x and `row` its first border row.
template <int kLanes, class Scalar, class Subtract>
void solve_front_forward(const Scalar* packed, Index pivots, Index border, Scalar* x,
                         Subtract&& subtract) {
  const Panels pivot_panels(pivots), border_panels(border);
  for (int p = 0; p < pivot_panels.count; ++p) {
    const int first = pivot_panels.begin(p);
    dispatch_width(pivot_panels.begin(p + 1) - first, [&](auto w) {
      constexpr int kRows = decltype(w)::value;
      RowBlock<Scalar, kRows, kLanes> sum, rows;
      sum.set_zero();
      sum.add_product(packed, first, x);
      rows.load(x + first * kLanes);
      rows.subtract(sum);
      rows.multiply_triangular(packed + first * kRows);
      rows.store(x + first * kLanes);
      packed += (first + kRows) * kRows;
    });
  }
  for (int p = 0; p < border_panels.count; ++p) {
    const int first = border_panels.begin(p);
    dispatch_width(border_panels.begin(p + 1) - first, [&](auto w) {
      constexpr int kRows = decltype(w)::value;
      RowBlock<Scalar, kRows, kLanes> sum;
      sum.set_zero();
      sum.add_product(packed, pivots, x);
      subtract(first, sum);
      packed += pivots * kRows;
    });
  }
}

/// Backward pass of a front. Solves for the pivot rows x in place. `load(row, block)` must fill
/// `block` with the solution of the border rows from `row` on.
template <int kLanes, class Scalar, class Load>
void solve_front_backward(const Scalar* packed, Index pivots, Index border, Scalar* x,
                          Load&& load) {
  packed += packed_size(pivots, border);
  const Panels pivot_panels(pivots), border_panels(border);
  for (int p = border_panels.count - 1; p >= 0; --p) {
    const int first = border_panels.begin(p);
    dispatch_width(border_panels.begin(p + 1) - first, [&](auto w) {
      constexpr int kRows = decltype(w)::value;
      packed -= pivots * kRows;
      RowBlock<Scalar, kRows, kLanes> rows;
      load(first, rows);
      rows.subtract_transposed(packed, pivots, x);
    });
  }
  for (int p = pivot_panels.count - 1; p >= 0; --p) {
    const int first = pivot_panels.begin(p);
    dispatch_width(pivot_panels.begin(p + 1) - first, [&](auto w) {
      constexpr int kRows = decltype(w)::value;
      packed -= (first + kRows) * kRows;
      RowBlock<Scalar, kRows, kLanes> rows;
      rows.load(x + first * kLanes);
      rows.multiply_triangular_transposed(packed + first * kRows);
      rows.store(x + first * kLanes);
      rows.subtract_transposed(packed, first, x);
    });
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
