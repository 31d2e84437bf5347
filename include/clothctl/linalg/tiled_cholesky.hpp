#pragma once

// Dense Cholesky factorisation in tiles, and solves with the factor. All matrices are column-major,
// all work is in place, and nothing allocates.
//
//   cholesky_in_place    A = L Lᵀ           left-looking over tile columns
//   right_solve          X ← X L⁻ᵀ          for a matrix X of many rows
//   solve_lower          v ← L⁻¹ v          for one vector
//   solve_upper          v ← L⁻ᵀ v          for one vector
//   subtract_outer       C ← C - P Qᵀ
//
// Only the lower triangle of L is read. Reference: Golub and Van Loan, Matrix Computations, 4th ed.
// (2013), §3.1 and §4.2.

#include <algorithm>
#include <array>
#include <cmath>

#include "clothctl/core/types.hpp"
#include "clothctl/linalg/vector_kernels.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Edge length of a tile. Two tiles of doubles fit into a first-level cache of 64 KB.
inline constexpr Index kTile = 64;
/// Number of columns that the kernels compute together within a tile.
inline constexpr Index kTilePanel = 4;

namespace detail {

/// Subtracts a register of numbers from the numbers at an address.
template <class Scalar, class Value>
CLOTHCTL_KERNEL void subtract_register(Scalar* to, const Value& sum) {
  store_register(to, load_register(to) - sum);
}

/// C ← C - P Qᵀ for four columns of C and the rows of two registers; P and Q have `depth` columns.
template <class Scalar>
CLOTHCTL_KERNEL void subtract_outer_two_registers(Scalar* c, Index ldc, const Scalar* p, Index ldp,
                                                  const Scalar* q, Index ldq, Index depth) {
  constexpr Index kLanes = native_lanes<Scalar>();
  using Value = typename Register<Scalar, native_lanes<Scalar>()>::type;
  Value a0{}, a1{}, a2{}, a3{}, b0{}, b1{}, b2{}, b3{};
  for (Index k = 0; k < depth; ++k, p += ldp, q += ldq) {
    const Value a = load_register(p), b = load_register(p + kLanes);
    a0 = a0 + a * q[0];
    b0 = b0 + b * q[0];
    a1 = a1 + a * q[1];
    b1 = b1 + b * q[1];
    a2 = a2 + a * q[2];
    b2 = b2 + b * q[2];
    a3 = a3 + a * q[3];
    b3 = b3 + b * q[3];
  }
  subtract_register(c, a0);
  subtract_register(c + kLanes, b0);
  subtract_register(c + ldc, a1);
  subtract_register(c + ldc + kLanes, b1);
  subtract_register(c + 2 * ldc, a2);
  subtract_register(c + 2 * ldc + kLanes, b2);
  subtract_register(c + 3 * ldc, a3);
  subtract_register(c + 3 * ldc + kLanes, b3);
}

/// C ← C - P Qᵀ for four columns of C and the rows of one register.
template <class Scalar>
CLOTHCTL_KERNEL void subtract_outer_one_register(Scalar* c, Index ldc, const Scalar* p, Index ldp,
                                                 const Scalar* q, Index ldq, Index depth) {
  using Value = typename Register<Scalar, native_lanes<Scalar>()>::type;
  Value a0{}, a1{}, a2{}, a3{};
  for (Index k = 0; k < depth; ++k, p += ldp, q += ldq) {
    const Value a = load_register(p);
    a0 = a0 + a * q[0];
    a1 = a1 + a * q[1];
    a2 = a2 + a * q[2];
    a3 = a3 + a * q[3];
  }
  subtract_register(c, a0);
  subtract_register(c + ldc, a1);
  subtract_register(c + 2 * ldc, a2);
  subtract_register(c + 3 * ldc, a3);
}

/// C ← C - P Qᵀ for four columns and one row of C.
template <class Scalar>
CLOTHCTL_KERNEL void subtract_outer_one_row(Scalar* c, Index ldc, const Scalar* p, Index ldp,
                                            const Scalar* q, Index ldq, Index depth) {
  Scalar s0(0), s1(0), s2(0), s3(0);
  for (Index k = 0; k < depth; ++k) {
    const Scalar value = p[k * ldp];
    const Scalar* factor = q + k * ldq;
    s0 += value * factor[0];
    s1 += value * factor[1];
    s2 += value * factor[2];
    s3 += value * factor[3];
  }
  c[0] = c[0] - s0;
  c[ldc] = c[ldc] - s1;
  c[2 * ldc] = c[2 * ldc] - s2;
  c[3 * ldc] = c[3 * ldc] - s3;
}

/// C ← C - P Qᵀ for four columns of C: C and P have `rows` rows, P and Q have `depth` columns.
template <class Scalar>
void subtract_outer_four(Scalar* c, Index ldc, Index rows, const Scalar* p, Index ldp,
                         const Scalar* q, Index ldq, Index depth) {
  constexpr Index kLanes = native_lanes<Scalar>();
  Index i = 0;
  for (; i + 2 * kLanes <= rows; i += 2 * kLanes)
    subtract_outer_two_registers(c + i, ldc, p + i, ldp, q, ldq, depth);
  for (; i + kLanes <= rows; i += kLanes)
    subtract_outer_one_register(c + i, ldc, p + i, ldp, q, ldq, depth);
  for (; i < rows; ++i) subtract_outer_one_row(c + i, ldc, p + i, ldp, q, ldq, depth);
}

/// C ← C - P Qᵀ for one tile.
template <class Scalar>
void subtract_outer_tile(Scalar* c, Index ldc, Index rows, Index columns, const Scalar* p,
                         Index ldp, const Scalar* q, Index ldq, Index depth) {
  Index j = 0;
  for (; j + 4 <= columns; j += 4)
    subtract_outer_four(c + j * ldc, ldc, rows, p, ldp, q + j, ldq, depth);
  for (; j < columns; ++j) {
    for (Index k = 0; k < depth; ++k)
      add_scaled(rows, Scalar(-q[k * ldq + j]), p + k * ldp, c + j * ldc);
  }
}

}  // namespace detail

/// C ← C - P Qᵀ for C r×s, P r×k, Q s×k. C must not overlap P or Q. Complexity: r s k.
template <RealScalar Scalar>
void subtract_outer(Eigen::Ref<MatrixX<Scalar>> C, const Eigen::Ref<const MatrixX<Scalar>>& P,
                    const Eigen::Ref<const MatrixX<Scalar>>& Q) {
  const Index ldc = C.outerStride(), ldp = P.outerStride(), ldq = Q.outerStride();
  for (Index j = 0; j < C.cols(); j += kTile) {
    const Index nj = (std::min)(kTile, C.cols() - j);
    for (Index k = 0; k < P.cols(); k += kTile) {
      const Index nk = (std::min)(kTile, P.cols() - k);
      for (Index i = 0; i < C.rows(); i += kTile) {
        const Index ni = (std::min)(kTile, C.rows() - i);
        detail::subtract_outer_tile(C.data() + j * ldc + i, ldc, ni, nj, P.data() + k * ldp + i,
                                    ldp, Q.data() + k * ldq + j, ldq, nk);
      }
    }
  }
}

/// Factors the lower triangle of A in place. `scale` (n) is the diagonal of A, or other magnitudes
/// to compare pivots with. Stops at the first pivot that is not larger than `relative` times its
/// entry of `scale`. Returns the index of this pivot, or the size of A if there is none.
/// Complexity: n³/3.
template <RealScalar Scalar>
Index cholesky_in_place(Eigen::Ref<MatrixX<Scalar>> A,
                        const Eigen::Ref<const VectorX<Scalar>>& scale, const Scalar& relative) {
  using std::sqrt;
  const Index n = A.rows(), stride = A.outerStride();
  const auto column = [&](Index c) { return A.data() + c * stride; };
  for (Index j = 0; j < n; j += kTile) {
    const Index nj = (std::min)(kTile, n - j);
    if (j > 0)
      subtract_outer<Scalar>(A.block(j, j, n - j, nj), A.block(j, 0, n - j, j),
                             A.block(j, 0, nj, j));
    for (Index panel = j; panel < j + nj; panel += kTilePanel) {
      const Index end = (std::min)(panel + kTilePanel, j + nj);
      for (Index c = panel; c < end; ++c) {
        for (Index b = panel; b < c; ++b)
          add_scaled(n - c, Scalar(-column(b)[c]), column(b) + c, column(c) + c);
        const Scalar pivot = column(c)[c];
        if (!(pivot > relative * scale[c])) return c;
        const Scalar root = sqrt(pivot);
        column(c)[c] = root;
        scale_by(n - c - 1, Scalar(Scalar(1) / root), column(c) + c + 1);
      }
      if (end < j + nj) {  // false for the last panel of a tile, which may be narrower
        detail::subtract_outer_tile(column(end) + end, stride, n - end, j + nj - end,
                                    column(panel) + end, stride, column(panel) + end, stride,
                                    end - panel);
      }
    }
  }
  return n;
}

/// X ← X L⁻ᵀ for X s×n and lower triangular L n×n. Complexity: n² s.
template <RealScalar Scalar>
void right_solve(const Eigen::Ref<const MatrixX<Scalar>>& L, Eigen::Ref<MatrixX<Scalar>> X) {
  const Index n = L.rows(), rows = X.rows(), stride = X.outerStride(), ldl = L.outerStride();
  const auto column = [&](Index c) { return X.data() + c * stride; };
  for (Index j = 0; j < n; j += kTile) {
    const Index end = (std::min)(j + kTile, n);
    if (j > 0)
      subtract_outer<Scalar>(X.middleCols(j, end - j), X.leftCols(j), L.block(j, 0, end - j, j));
    for (Index i = 0; i < rows; i += kTile) {
      const Index ni = (std::min)(kTile, rows - i);
      for (Index panel = j; panel < end; panel += kTilePanel) {
        const Index width = (std::min)(kTilePanel, end - panel);
        detail::subtract_outer_tile(column(panel) + i, stride, ni, width, column(j) + i, stride,
                                    L.data() + j * ldl + panel, ldl, panel - j);
        for (Index c = panel; c < panel + width; ++c) {
          for (Index b = panel; b < c; ++b)
            add_scaled(ni, Scalar(-L(c, b)), column(b) + i, column(c) + i);
          scale_by(ni, Scalar(Scalar(1) / L(c, c)), column(c) + i);
        }
      }
    }
  }
}

/// v ← L⁻¹ v for a lower triangular L n×n whose column k begins at `lower + k * stride`. With
/// `unit_diagonal` the diagonal counts as ones. Complexity: n².
template <RealScalar Scalar>
void solve_lower(const Scalar* lower, Index stride, Index n, Scalar* v,
                 bool unit_diagonal = false) {
  for (Index j = 0; j < n; j += kTilePanel) {
    const Index end = (std::min)(j + kTilePanel, n);
    for (Index c = j; c < end; ++c) {
      const Scalar* column = lower + c * stride;
      if (!unit_diagonal) v[c] /= column[c];
      for (Index i = c + 1; i < end; ++i) v[i] -= v[c] * column[i];
    }
    if (end == n) return;
    const Scalar* first = lower + j * stride + end;
    add_four<Scalar>(n - end, {-v[j], -v[j + 1], -v[j + 2], -v[j + 3]},
                     {first, first + stride, first + 2 * stride, first + 3 * stride}, v + end);
  }
}

/// v ← L⁻ᵀ v for a lower triangular L n×n whose column k begins at `lower + k * stride`. With
/// `unit_diagonal` the diagonal counts as ones. Complexity: n².
template <RealScalar Scalar>
void solve_upper(const Scalar* lower, Index stride, Index n, Scalar* v,
                 bool unit_diagonal = false) {
  for (Index end = n; end > 0;) {
    const Index j = (end - 1) / kTilePanel * kTilePanel;
    if (end < n) {
      const Scalar* first = lower + j * stride + end;
      const std::array<Scalar, 4> sum = dot_four<Scalar>(
          n - end, {first, first + stride, first + 2 * stride, first + 3 * stride}, v + end);
      for (Index k = 0; k < 4; ++k) v[j + k] -= sum[static_cast<std::size_t>(k)];
    }
    for (Index c = end; c-- > j;) {
      const Scalar* column = lower + c * stride;
      for (Index i = c + 1; i < end; ++i) v[c] -= v[i] * column[i];
      if (!unit_diagonal) v[c] /= column[c];
    }
    end = j;
  }
}

/// y ← y + M x for a matrix M rows×columns whose column k begins at `matrix + k * stride`.
template <RealScalar Scalar>
void add_product(const Scalar* matrix, Index stride, Index rows, Index columns, const Scalar* x,
                 Scalar* y) {
  ColumnSum<Scalar> sum(matrix, stride, rows, y);
  for (Index k = 0; k < columns; ++k) sum.add(k, x[k]);
  sum.finish();
}

/// y ← y + Mᵀ x for a matrix M rows×columns whose column k begins at `matrix + k * stride`.
template <RealScalar Scalar>
void add_transposed_product(const Scalar* matrix, Index stride, Index rows, Index columns,
                            const Scalar* x, Scalar* y) {
  Index j = 0;
  for (; j + 4 <= columns; j += 4) {
    const Scalar* first = matrix + j * stride;
    const std::array<Scalar, 4> sum =
        dot_four<Scalar>(rows, {first, first + stride, first + 2 * stride, first + 3 * stride}, x);
    for (Index k = 0; k < 4; ++k) y[j + k] += sum[static_cast<std::size_t>(k)];
  }
  for (; j < columns; ++j) y[j] += dot_product(rows, matrix + j * stride, x);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
