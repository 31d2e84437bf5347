#pragma once

// Dense kernels of the multifrontal factorisation, column major, leading dimension ld.
//
// A front is a symmetric matrix F = [F_pp .; F_bp F_bb] with p pivot rows and b border rows (both
// multiples of 3). With F_pp = L Lᵀ and V = F_bp L⁻ᵀ, the elimination replaces the pivot columns by
// L and V, and computes the Schur complement U = F_bb - V Vᵀ for the parent. The elimination works
// on panels of at most 12 columns, and stores the inverse of the diagonal block of L of each panel
// in place of the block. Solves (solve_kernels.hpp) then consist only of products with small dense
// matrices. The kernels work on tiles of vector registers, whose lanes are successive rows.

#include <algorithm>
#include <cmath>

#include "clothctl/linalg/detail/pack.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Number of columns of a full panel: those of four vertices.
inline constexpr int kPanel = 12;

/// The division of `columns` (a multiple of 3) into panels of at most kPanel columns. The widths
/// are multiples of 3, and as equal as possible.
struct Panels {
  /// Number of columns divided by 3.
  int vertices;
  /// Number of panels.
  int count;

  explicit Panels(Index columns)
      : vertices(static_cast<int>(columns / 3)), count((vertices + 3) / 4) {}
  /// First column of panel i; begin(count) is the number of columns.
  int begin(int i) const { return count == 0 ? 0 : i * vertices / count * 3; }
};

/// Number of scalars that pack_front writes.
inline Index packed_size(Index pivots, Index border) {
  Index size = pivots * border;
  const Panels panels(pivots);
  for (int p = 0; p < panels.count; ++p)
    size += Index(panels.begin(p + 1)) * (panels.begin(p + 1) - panels.begin(p));
  return size;
}

/// Calls `function(integral_constant<int, width>)` for a width of 3, 6, 9 or 12.
template <class Function>
CLOTHCTL_KERNEL void dispatch_width(int width, Function&& function) {
  switch (width) {
    case 12: function(std::integral_constant<int, 12>{}); break;
    case 9: function(std::integral_constant<int, 9>{}); break;
    case 6: function(std::integral_constant<int, 6>{}); break;
    default: function(std::integral_constant<int, 3>{}); break;
  }
}

/// Inverse of the Cholesky factor L of a w×w block (w = `width` <= 12; lower triangle of `a`):
/// inverse[kStride·k + i] = (L⁻¹)_ik. `factorize` returns false when a pivot is not positive or not
/// finite.
template <class Scalar>
struct DiagonalBlock {
  static constexpr int kStride = native_lanes<Scalar>() >= 8 ? 16 : kPanel;
  Scalar inverse[kPanel * kStride];

  bool factorize(const Scalar* a, Index lda, int width) {
    using std::sqrt;
    using Column = Pack<Scalar, kStride>;
    Scalar l[kPanel * kStride];
    Scalar reciprocal[kPanel];
    for (int j = 0; j < width; ++j) {
      for (int i = 0; i < kStride; ++i) l[kStride * j + i] = i < width ? a[lda * j + i] : Scalar(0);
    }
    // Right-looking. The values above the diagonal are not used.
    for (int j = 0; j < width; ++j) {
      const Scalar pivot = l[kStride * j + j];
      if (!is_finite(pivot) || !(Scalar(0) < pivot)) return false;
      reciprocal[j] = Scalar(1) / sqrt(pivot);
      Column column;
      column.load(l + kStride * j);
      column.scale(reciprocal[j]);
      column.store(l + kStride * j);
      for (int i = j + 1; i < width; ++i) {
        Column other;
        other.load(l + kStride * i);
        other.subtract_product(column, l[kStride * j + i]);
        other.store(l + kStride * i);
      }
    }
    // Column k of L⁻¹ follows from the later columns: t_k = (e_k - Σ_{j>k} L_jk t_j) / L_kk.
    for (int k = width - 1; k >= 0; --k) {
      Scalar* t = inverse + kStride * k;
      for (int i = 0; i < kStride; ++i) t[i] = Scalar(0);
      t[k] = Scalar(1);
      Column column;
      column.load(t);
      for (int j = k + 1; j < width; ++j) {
        Column other;
        other.load(inverse + kStride * j);
        column.subtract_product(other, l[kStride * k + j]);
      }
      column.scale(reciprocal[k]);
      column.store(t);
    }
    return true;
  }
};

/// A tile of a matrix in registers: kVectors registers of rows by kColumns columns.
template <class Scalar, int kVectors, int kColumns>
struct Tile {
  static constexpr int kLanes = native_lanes<Scalar>();
  static constexpr int kRows = kVectors * kLanes;
  using Rows = Pack<Scalar, kLanes>;
  Rows entry[kColumns][kVectors];

  CLOTHCTL_KERNEL void set_zero() {
    unroll<kColumns>([&](auto j) CLOTHCTL_KERNEL_LAMBDA {
      unroll<kVectors>([&](auto v) CLOTHCTL_KERNEL_LAMBDA { entry[j][v].set_zero(); });
    });
  }
  CLOTHCTL_KERNEL void load(const Scalar* from, Index ld) {
    unroll<kColumns>([&](auto j) CLOTHCTL_KERNEL_LAMBDA {
      unroll<kVectors>(
          [&](auto v) CLOTHCTL_KERNEL_LAMBDA { entry[j][v].load(from + j * ld + v * kLanes); });
    });
  }
  CLOTHCTL_KERNEL void store(Scalar* to, Index ld) const {
    unroll<kColumns>([&](auto j) CLOTHCTL_KERNEL_LAMBDA {
      unroll<kVectors>([&](auto v)
                           CLOTHCTL_KERNEL_LAMBDA { entry[j][v].store(to + j * ld + v * kLanes); });
    });
  }
  /// this -= A Bᵀ; column k of A and B starts k·ld after `a` and `b`.
  CLOTHCTL_KERNEL void subtract_outer(const Scalar* a, const Scalar* b, Index ld, Index depth) {
    for (Index k = 0; k < depth; ++k, a += ld, b += ld) {
      Rows rows[kVectors];
      unroll<kVectors>([&](auto v) CLOTHCTL_KERNEL_LAMBDA { rows[v].load(a + v * kLanes); });
      unroll<kColumns>([&](auto j) CLOTHCTL_KERNEL_LAMBDA {
        const Scalar factor = b[j];
        unroll<kVectors>(
            [&](auto v) CLOTHCTL_KERNEL_LAMBDA { entry[j][v].subtract_product(rows[v], factor); });
      });
    }
  }
  /// this <- this · L⁻ᵀ for a triangular inverse stored by columns.
  CLOTHCTL_KERNEL void multiply_inverse_transposed(const Scalar* inverse, int stride) {
    unroll<kColumns>([&](auto reversed) CLOTHCTL_KERNEL_LAMBDA {
      constexpr int j = kColumns - 1 - decltype(reversed)::value;
      unroll<kVectors>([&](auto v)
                           CLOTHCTL_KERNEL_LAMBDA { entry[j][v].scale(inverse[stride * j + j]); });
      unroll<j>([&](auto k) CLOTHCTL_KERNEL_LAMBDA {
        const Scalar factor = inverse[stride * k + j];
        unroll<kVectors>(
            [&](auto v) CLOTHCTL_KERNEL_LAMBDA { entry[j][v].add_product(entry[k][v], factor); });
      });
    });
  }
};

/// Calls `function(integral_constant<int, vectors>, row)` for tiles that cover rows [first, last);
/// a tile has `vectors` whole registers of rows and begins at `row`.
template <class Scalar, class Function>
CLOTHCTL_KERNEL void for_each_row_tile(Index first, Index last, Function&& function) {
  constexpr int kLanes = native_lanes<Scalar>();
  last = (last + kLanes - 1) / kLanes * kLanes;
  Index row = first;
  if constexpr (kManyRegisters) {
    for (; row + 2 * kLanes <= last; row += 2 * kLanes)
      function(std::integral_constant<int, 2>{}, row);
  }
  for (; row < last; row += kLanes) function(std::integral_constant<int, 1>{}, row);
}

/// Eliminates kWidth pivot columns from `first` on: subtracts the products with all earlier
/// columns, replaces the diagonal block by the inverse of its Cholesky factor, and the rows below
/// by those of L. Writes `rows` rows, rounded up to whole registers. Returns false when the
/// diagonal block is not positive definite.
template <int kWidth, class Scalar>
bool eliminate_panel(Scalar* f, Index ld, Index rows, Index first) {
  constexpr Index kLanes = native_lanes<Scalar>();
  Scalar* panel = f + first * ld;
  const Index begin = first / kLanes * kLanes;
  const Index middle = (first + kWidth + kLanes - 1) / kLanes * kLanes;
  for_each_row_tile<Scalar>(begin, middle, [&](auto vectors, Index row) CLOTHCTL_KERNEL_LAMBDA {
    Tile<Scalar, decltype(vectors)::value, kWidth> tile;
    tile.load(panel + row, ld);
    tile.subtract_outer(f + row, f + first, ld, first);
    tile.store(panel + row, ld);
  });
  DiagonalBlock<Scalar> block;
  if (!block.factorize(panel + first, ld, kWidth)) return false;
  constexpr int kStride = DiagonalBlock<Scalar>::kStride;
  if (first + kWidth < middle) {
    for_each_row_tile<Scalar>(begin, middle, [&](auto vectors, Index row) CLOTHCTL_KERNEL_LAMBDA {
      Tile<Scalar, decltype(vectors)::value, kWidth> tile;
      tile.load(panel + row, ld);
      tile.multiply_inverse_transposed(block.inverse, kStride);
      tile.store(panel + row, ld);
    });
  }
  for (int j = 0; j < kWidth; ++j) {
    std::copy_n(block.inverse + kStride * j, kWidth, panel + j * ld + first);
  }
  for_each_row_tile<Scalar>(middle, rows, [&](auto vectors, Index row) CLOTHCTL_KERNEL_LAMBDA {
    Tile<Scalar, decltype(vectors)::value, kWidth> tile;
    tile.load(panel + row, ld);
    tile.subtract_outer(f + row, f + first, ld, first);
    tile.multiply_inverse_transposed(block.inverse, kStride);
    tile.store(panel + row, ld);
  });
  return true;
}

/// Eliminates the `pivots` columns of a front with `pivots + border` rows, and subtracts V Vᵀ from
/// the lower triangle of its border block u. If `fresh`, u counts as zero and is not read. ld and
/// ldu are multiples of native_lanes. Padding rows may be overwritten. After the last column of f,
/// native_lanes more numbers must be readable. Returns false when the pivot block is not positive
/// definite.
template <class Scalar>
bool eliminate_front(Scalar* f, Index ld, Index pivots, Index border, Scalar* u, Index ldu,
                     bool fresh) {
  const Panels pivot_panels(pivots);
  for (int panel = 0; panel < pivot_panels.count; ++panel) {
    const int first = pivot_panels.begin(panel);
    bool positive = true;
    dispatch_width(pivot_panels.begin(panel + 1) - first, [&](auto w) {
      positive = eliminate_panel<decltype(w)::value>(f, ld, pivots + border, first);
    });
    if (!positive) return false;
  }
  const Scalar* v = f + pivots;
  const Panels border_panels(border);
  for (int panel = 0; panel < border_panels.count; ++panel) {
    const Index first = border_panels.begin(panel);
    dispatch_width(border_panels.begin(panel + 1) - border_panels.begin(panel), [&](auto w) {
      constexpr int kWidth = decltype(w)::value;
      constexpr Index kLanes = native_lanes<Scalar>();
      for_each_row_tile<Scalar>(first / kLanes * kLanes, border,
                                [&](auto vectors, Index row) CLOTHCTL_KERNEL_LAMBDA {
                                  Tile<Scalar, decltype(vectors)::value, kWidth> tile;
                                  if (fresh) {
                                    tile.set_zero();
                                  } else {
                                    tile.load(u + first * ldu + row, ldu);
                                  }
                                  tile.subtract_outer(v + row, v + first, ld, pivots);
                                  tile.store(u + first * ldu + row, ldu);
                                });
    });
  }
  return true;
}

/// Copies the pivot columns of an eliminated front in the order in which solves read them: one
/// panel of rows after the other (pivots, then border). Each panel is stored column by column; a
/// pivot panel ends with its diagonal block.
template <class Scalar>
void pack_front(const Scalar* f, Index ld, Index pivots, Index border, Scalar* to) {
  const auto pack_rows = [&](Index first, int width, Index columns) {
    dispatch_width(width, [&](auto w) {
      constexpr int kWidth = decltype(w)::value;
      const Scalar* from = f + first;
      for (Index k = 0; k < columns; ++k, from += ld, to += kWidth) {
        Pack<Scalar, kWidth> rows;
        rows.load(from);
        rows.store(to);
      }
    });
  };
  const Panels pivot_panels(pivots), border_panels(border);
  for (int p = 0; p < pivot_panels.count; ++p) {
    const int first = pivot_panels.begin(p), last = pivot_panels.begin(p + 1);
    pack_rows(first, last - first, last);
  }
  for (int p = 0; p < border_panels.count; ++p) {
    const int first = border_panels.begin(p);
    pack_rows(pivots + first, border_panels.begin(p + 1) - first, pivots);
  }
}

/// target[i] += source[i] for the first kLanes numbers.
template <int kLanes, class Scalar>
CLOTHCTL_KERNEL void add_lanes(Scalar* target, const Scalar* source) {
  Pack<Scalar, kLanes> a, b;
  a.load(target);
  b.load(source);
  a.add(b);
  a.store(target);
}

/// target[i] += source[i] for i < count.
template <class Scalar>
CLOTHCTL_KERNEL void add_run(Scalar* target, const Scalar* source, Index count) {
  constexpr int kLanes = native_lanes<Scalar>();
  Index i = 0;
  for (; i + kLanes <= count; i += kLanes) add_lanes<kLanes>(target + i, source + i);
  if constexpr (kLanes >= 16) {
    if (i + 8 <= count) {
      add_lanes<8>(target + i, source + i);
      i += 8;
    }
  }
  if constexpr (kLanes >= 8) {
    if (i + 4 <= count) {
      add_lanes<4>(target + i, source + i);
      i += 4;
    }
  }
  for (; i < count; ++i) target[i] = target[i] + source[i];
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
