#pragma once

// Dense kernels of the multifrontal factorisation, column major, leading dimension ld.
//
// A front is F = [F_pp .; F_bp F_bb], symmetric, p pivot and b border rows (both multiples of 3). With F_pp = L Lᵀ and
// V = F_bp L⁻ᵀ, elimination leaves L and V in the pivot columns and the Schur complement U = F_bb - V Vᵀ for the parent.
// Columns are taken in panels of at most 12; each panel's diagonal block of L is replaced by its inverse, so that solves
// are products with small dense matrices and nothing else:
//     forward   x_k <- L_kk⁻¹ (x_k - Σ_{j<k} L_kj x_j),     backward   x_k <- L_kk⁻ᵀ (x_k - Σ_{i>k} L_ikᵀ x_i).
// Tiles of registers: lanes run down the rows (factorisation) or over the right-hand sides (solve).

#include <cmath>

#include "clothctl/math/pack.hpp"

namespace clothctl::detail {

/// Columns of a full panel: four vertices.
inline constexpr int kPanel = 12;

/// How `columns` (a multiple of 3) are cut into panels of at most kPanel: as equal as multiples of 3 allow.
struct Panels {
  /// Columns in thirds.
  int vertices;
  /// Number of panels.
  int count;

  explicit Panels(Index columns) : vertices(static_cast<int>(columns / 3)), count((vertices + 3) / 4) {}
  /// First column of panel i; begin(count) is the number of columns.
  int begin(int i) const { return count == 0 ? 0 : i * vertices / count * 3; }
};

/// Calls `function(integral_constant<int, width>)` for a width of 3, 6, 9 or 12.
template <class Function>
CLOTHCTL_INLINE void dispatch_width(int width, Function&& function) {
  switch (width) {
    case 12: function(std::integral_constant<int, 12>{}); break;
    case 9: function(std::integral_constant<int, 9>{}); break;
    case 6: function(std::integral_constant<int, 6>{}); break;
    default: function(std::integral_constant<int, 3>{}); break;
  }
}

/// Inverse of the Cholesky factor of a w×w block (w <= 12; lower triangle of `a`): t[stride·k + i] = (L⁻¹)_ik.
/// Fails when: a pivot is not positive or not finite (returns false).
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
    // Right-looking; what happens above the diagonal is never read.
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
    // Column k of L⁻¹ from the later ones: t_k = (e_k - Σ_{j>k} L_jk t_j) / L_kk.
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

/// kVectors registers of rows by kColumns columns.
template <class Scalar, int kVectors, int kColumns>
struct Tile {
  static constexpr int kLanes = native_lanes<Scalar>();
  static constexpr int kRows = kVectors * kLanes;
  using Rows = Pack<Scalar, kLanes>;
  Rows entry[kColumns][kVectors];

  CLOTHCTL_INLINE void set_zero() {
    unroll<kColumns>([&](auto j) CLOTHCTL_INLINE_LAMBDA {
      unroll<kVectors>([&](auto v) CLOTHCTL_INLINE_LAMBDA { entry[j][v].set_zero(); });
    });
  }
  CLOTHCTL_INLINE void load(const Scalar* from, Index ld) {
    unroll<kColumns>([&](auto j) CLOTHCTL_INLINE_LAMBDA {
      unroll<kVectors>([&](auto v) CLOTHCTL_INLINE_LAMBDA { entry[j][v].load(from + j * ld + v * kLanes); });
    });
  }
  CLOTHCTL_INLINE void store(Scalar* to, Index ld) const {
    unroll<kColumns>([&](auto j) CLOTHCTL_INLINE_LAMBDA {
      unroll<kVectors>([&](auto v) CLOTHCTL_INLINE_LAMBDA { entry[j][v].store(to + j * ld + v * kLanes); });
    });
  }
  /// this -= A Bᵀ; column k of A and B starts k·ld after `a` and `b`.
  CLOTHCTL_INLINE void subtract_outer(const Scalar* a, const Scalar* b, Index ld, Index depth) {
    for (Index k = 0; k < depth; ++k, a += ld, b += ld) {
      Rows rows[kVectors];
      unroll<kVectors>([&](auto v) CLOTHCTL_INLINE_LAMBDA { rows[v].load(a + v * kLanes); });
      unroll<kColumns>([&](auto j) CLOTHCTL_INLINE_LAMBDA {
        const Scalar factor = b[j];
        unroll<kVectors>([&](auto v) CLOTHCTL_INLINE_LAMBDA { entry[j][v].subtract_product(rows[v], factor); });
      });
    }
  }
  /// this <- this · L⁻ᵀ for a triangular inverse stored by columns.
  CLOTHCTL_INLINE void multiply_inverse_transposed(const Scalar* inverse, int stride) {
    unroll<kColumns>([&](auto reversed) CLOTHCTL_INLINE_LAMBDA {
      constexpr int j = kColumns - 1 - decltype(reversed)::value;
      unroll<kVectors>([&](auto v) CLOTHCTL_INLINE_LAMBDA { entry[j][v].scale(inverse[stride * j + j]); });
      unroll<j>([&](auto k) CLOTHCTL_INLINE_LAMBDA {
        const Scalar factor = inverse[stride * k + j];
        unroll<kVectors>([&](auto v) CLOTHCTL_INLINE_LAMBDA { entry[j][v].add_product(entry[k][v], factor); });
      });
    });
  }
};

/// Calls `function(integral_constant<int, vectors>, row)` for tiles of one or more registers over rows [first, last).
template <class Scalar, class Function>
CLOTHCTL_INLINE void for_each_row_tile(Index first, Index last, Function&& function) {
  constexpr int kLanes = native_lanes<Scalar>();
  Index row = first;
  if constexpr (kManyRegisters) {
    for (; row + 2 * kLanes <= last; row += 2 * kLanes) function(std::integral_constant<int, 2>{}, row);
  }
  for (; row < last; row += kLanes) function(std::integral_constant<int, 1>{}, row);
}

/// Finishes kWidth pivot columns from `first` on: updates them by all columns before, replaces the diagonal block by L⁻¹
/// and what lies below by rows of L. Rows up to ld are written. Fails when: the block is not positive definite.
template <int kWidth, class Scalar>
bool eliminate_panel(Scalar* f, Index ld, Index first) {
  constexpr Index kLanes = native_lanes<Scalar>();
  Scalar* panel = f + first * ld;
  const Index begin = first / kLanes * kLanes;
  const Index middle = (first + kWidth + kLanes - 1) / kLanes * kLanes;
  for_each_row_tile<Scalar>(begin, middle, [&](auto vectors, Index row) CLOTHCTL_INLINE_LAMBDA {
    Tile<Scalar, decltype(vectors)::value, kWidth> tile;
    tile.load(panel + row, ld);
    tile.subtract_outer(f + row, f + first, ld, first);
    tile.store(panel + row, ld);
  });
  DiagonalBlock<Scalar> block;
  if (!block.factorize(panel + first, ld, kWidth)) return false;
  constexpr int kStride = DiagonalBlock<Scalar>::kStride;
  if (first + kWidth < middle) {
    for_each_row_tile<Scalar>(begin, middle, [&](auto vectors, Index row) CLOTHCTL_INLINE_LAMBDA {
      Tile<Scalar, decltype(vectors)::value, kWidth> tile;
      tile.load(panel + row, ld);
      tile.multiply_inverse_transposed(block.inverse, kStride);
      tile.store(panel + row, ld);
    });
  }
  for (int j = 0; j < kWidth; ++j) {
    for (int i = j; i < kWidth; ++i) panel[j * ld + first + i] = block.inverse[kStride * j + i];
  }
  for_each_row_tile<Scalar>(middle, ld, [&](auto vectors, Index row) CLOTHCTL_INLINE_LAMBDA {
    Tile<Scalar, decltype(vectors)::value, kWidth> tile;
    tile.load(panel + row, ld);
    tile.subtract_outer(f + row, f + first, ld, first);
    tile.multiply_inverse_transposed(block.inverse, kStride);
    tile.store(panel + row, ld);
  });
  return true;
}

/// Eliminates the `pivots` columns of a front with `pivots + border` rows and subtracts V Vᵀ from its lower border block u.
/// `fresh`: u is taken as zero instead of read. ld and ldu are multiples of native_lanes; rows beyond are padding that may
/// be written; native_lanes numbers after the last column of f must be readable. Fails when: not positive definite.
template <class Scalar>
bool eliminate_front(Scalar* f, Index ld, Index pivots, Index border, Scalar* u, Index ldu, bool fresh) {
  const Panels pivot_panels(pivots);
  for (int panel = 0; panel < pivot_panels.count; ++panel) {
    const int first = pivot_panels.begin(panel);
    bool positive = true;
    dispatch_width(pivot_panels.begin(panel + 1) - first,
                   [&](auto w) { positive = eliminate_panel<decltype(w)::value>(f, ld, first); });
    if (!positive) return false;
  }
  const Scalar* v = f + pivots;
  const Panels border_panels(border);
  for (int panel = 0; panel < border_panels.count; ++panel) {
    const Index first = border_panels.begin(panel);
    dispatch_width(border_panels.begin(panel + 1) - border_panels.begin(panel), [&](auto w) {
      constexpr int kWidth = decltype(w)::value;
      constexpr Index kLanes = native_lanes<Scalar>();
      for_each_row_tile<Scalar>(first / kLanes * kLanes, ldu, [&](auto vectors, Index row) CLOTHCTL_INLINE_LAMBDA {
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

/// target[i] += source[i].
template <class Scalar>
CLOTHCTL_INLINE void add_run(Scalar* target, const Scalar* source, Index count) {
  constexpr int kLanes = native_lanes<Scalar>();
  Index i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    Pack<Scalar, kLanes> a, b;
    a.load(target + i);
    b.load(source + i);
    a.add(b);
    a.store(target + i);
  }
  for (; i < count; ++i) target[i] = target[i] + source[i];
}

/// sum_i = Σ_k f[k·ld + i] x_k for kRows rows i and `depth` columns k; x_k is row k of `x`, kLanes right-hand sides wide.
template <int kRows, int kLanes, class Scalar>
CLOTHCTL_INLINE void row_products(const Scalar* f, Index ld, const Scalar* x, Index depth, Pack<Scalar, kLanes>* sum) {
  unroll<kRows>([&](auto i) CLOTHCTL_INLINE_LAMBDA { sum[i].set_zero(); });
  for (Index k = 0; k < depth; ++k, f += ld, x += kLanes) {
    Pack<Scalar, kLanes> row;
    row.load(x);
    unroll<kRows>([&](auto i) CLOTHCTL_INLINE_LAMBDA { sum[i].add_product(row, f[i]); });
  }
}

/// x_j -= Σ_r f[j·ld + r] y_r for kColumns columns j and `count` rows r of y.
template <int kColumns, int kLanes, class Scalar>
CLOTHCTL_INLINE void subtract_column_products(const Scalar* f, Index ld, const Scalar* y, Index count, Scalar* x) {
  using Row = Pack<Scalar, kLanes>;
  Row even[kColumns], odd[kColumns];
  const Scalar* column[kColumns];
  unroll<kColumns>([&](auto j) CLOTHCTL_INLINE_LAMBDA {
    even[j].load(x + j * kLanes);
    odd[j].set_zero();
    column[j] = f + j * ld;
  });
  Index r = 0;
  for (; r + 2 <= count; r += 2) {
    Row a, b;
    a.load(y + r * kLanes);
    b.load(y + (r + 1) * kLanes);
    unroll<kColumns>([&](auto j) CLOTHCTL_INLINE_LAMBDA { even[j].subtract_product(a, column[j][r]); });
    unroll<kColumns>([&](auto j) CLOTHCTL_INLINE_LAMBDA { odd[j].subtract_product(b, column[j][r + 1]); });
  }
  if (r < count) {
    Row a;
    a.load(y + r * kLanes);
    unroll<kColumns>([&](auto j) CLOTHCTL_INLINE_LAMBDA { even[j].subtract_product(a, column[j][r]); });
  }
  unroll<kColumns>([&](auto j) CLOTHCTL_INLINE_LAMBDA {
    even[j].add(odd[j]);
    even[j].store(x + j * kLanes);
  });
}

/// Forward pass over the pivots of a front: x <- L⁻¹ x for `pivots` rows of kLanes right-hand sides.
template <int kLanes, class Scalar>
void solve_pivots_forward(const Scalar* f, Index ld, Index pivots, Scalar* x) {
  const Panels panels(pivots);
  for (int panel = 0; panel < panels.count; ++panel) {
    const int first = panels.begin(panel);
    dispatch_width(panels.begin(panel + 1) - first, [&](auto w) {
      constexpr int kWidth = decltype(w)::value;
      using Row = Pack<Scalar, kLanes>;
      Row sum[kWidth];
      row_products<kWidth, kLanes>(f + first, ld, x, first, sum);
      const Scalar* inverse = f + first * ld + first;
      unroll<kWidth>([&](auto i) CLOTHCTL_INLINE_LAMBDA {
        Row row;
        row.load(x + (first + i) * kLanes);
        row.subtract(sum[i]);
        sum[i] = row;
      });
      unroll<kWidth>([&](auto reversed) CLOTHCTL_INLINE_LAMBDA {
        constexpr int i = kWidth - 1 - decltype(reversed)::value;
        sum[i].scale(inverse[i * ld + i]);
        unroll<i>([&](auto k) CLOTHCTL_INLINE_LAMBDA { sum[i].add_product(sum[k], inverse[k * ld + i]); });
        sum[i].store(x + (first + i) * kLanes);
      });
    });
  }
}

/// Backward pass over the pivots of a front: x_p <- L⁻ᵀ (x_p - Vᵀ x_b); x holds pivot rows, then border rows.
template <int kLanes, class Scalar>
void solve_pivots_backward(const Scalar* f, Index ld, Index pivots, Index rows, Scalar* x) {
  const Panels panels(pivots);
  for (int panel = panels.count - 1; panel >= 0; --panel) {
    const int first = panels.begin(panel);
    const int below = panels.begin(panel + 1);
    const int width = below - first;
    Scalar* pivot = x + first * kLanes;
    const Scalar* l = f + first * ld + below;
    int j = 0;
    for (; j + 6 <= width; j += 6) {
      subtract_column_products<6, kLanes>(l + j * ld, ld, x + below * kLanes, rows - below, pivot + j * kLanes);
    }
    if (j < width) {
      subtract_column_products<3, kLanes>(l + j * ld, ld, x + below * kLanes, rows - below, pivot + j * kLanes);
    }
    dispatch_width(width, [&](auto w) {
      constexpr int kWidth = decltype(w)::value;
      using Row = Pack<Scalar, kLanes>;
      Row row[kWidth];
      const Scalar* inverse = f + first * ld + first;
      unroll<kWidth>([&](auto i) CLOTHCTL_INLINE_LAMBDA { row[i].load(pivot + i * kLanes); });
      unroll<kWidth>([&](auto k) CLOTHCTL_INLINE_LAMBDA {
        row[k].scale(inverse[k * ld + k]);
        unroll<kWidth - 1 - decltype(k)::value>([&](auto offset) CLOTHCTL_INLINE_LAMBDA {
          constexpr int i = decltype(k)::value + 1 + decltype(offset)::value;
          row[k].add_product(row[i], inverse[k * ld + i]);
        });
        row[k].store(pivot + k * kLanes);
      });
    });
  }
}

}  // namespace clothctl::detail
