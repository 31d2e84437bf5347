#pragma once

// Dense triangular kernels in tiles, so that every product stays below the size at which Eigen takes its blocking buffers
// from the heap. L is lower triangular; all work in place.
//
//   A = L Lᵀ (left-looking over tile columns),   X ← X L⁻ᵀ for many rows,   C ← C - P Qᵀ

#include <algorithm>
#include <cmath>

#include "clothctl/core/types.hpp"

namespace clothctl::detail {

/// Edge of a tile, and width of a panel within it.
inline constexpr Index kTile = 64, kTilePanel = 4;

/// C -= P Qᵀ for C r×s, P r×k, Q s×k. Never allocates.
template <RealScalar Scalar>
void subtract_outer(Eigen::Ref<MatrixX<Scalar>> C, const Eigen::Ref<const MatrixX<Scalar>>& P,
                    const Eigen::Ref<const MatrixX<Scalar>>& Q) {
  for (Index j = 0; j < C.cols(); j += kTile) {
    const Index nj = (std::min)(kTile, C.cols() - j);
    for (Index k = 0; k < P.cols(); k += kTile) {
      const Index nk = (std::min)(kTile, P.cols() - k);
      for (Index i = 0; i < C.rows(); i += kTile) {
        const Index ni = (std::min)(kTile, C.rows() - i);
        C.block(i, j, ni, nj).noalias() -= P.block(i, k, ni, nk) * Q.block(j, k, nj, nk).transpose();
      }
    }
  }
}

/// Factors the lower triangle of A in place. `scale` holds the diagonal of A beforehand; a pivot not above
/// `relative` · scale stops the work. Returns the index of that pivot, or the size of A. Complexity: n³/3.
template <RealScalar Scalar>
Index cholesky_in_place(Eigen::Ref<MatrixX<Scalar>> A, const Eigen::Ref<const VectorX<Scalar>>& scale, const Scalar& relative) {
  using std::sqrt;
  const Index n = A.rows();
  for (Index j = 0; j < n; j += kTile) {
    const Index nj = (std::min)(kTile, n - j);
    if (j > 0) subtract_outer<Scalar>(A.block(j, j, n - j, nj), A.block(j, 0, n - j, j), A.block(j, 0, nj, j));
    for (Index panel = j; panel < j + nj; panel += kTilePanel) {
      const Index end = (std::min)(panel + kTilePanel, j + nj);
      for (Index c = panel; c < end; ++c) {
        for (Index b = panel; b < c; ++b) A.col(c).tail(n - c) -= A(c, b) * A.col(b).tail(n - c);
        const Scalar pivot = A(c, c);
        if (!(pivot > relative * scale[c])) return c;
        const Scalar root = sqrt(pivot);
        A(c, c) = root;
        A.col(c).tail(n - c - 1) *= Scalar(1) / root;
      }
      for (Index d = end; d < j + nj; ++d) {  // four columns in a pass: alone, each would load and store column d
        A.col(d).tail(n - d) -= A(d, panel) * A.col(panel).tail(n - d) + A(d, panel + 1) * A.col(panel + 1).tail(n - d) +
                                A(d, panel + 2) * A.col(panel + 2).tail(n - d) + A(d, panel + 3) * A.col(panel + 3).tail(n - d);
      }
    }
  }
  return n;
}

/// X ← X L⁻ᵀ for X s×n. Never allocates. Complexity: n² s.
template <RealScalar Scalar>
void right_solve(const Eigen::Ref<const MatrixX<Scalar>>& L, Eigen::Ref<MatrixX<Scalar>> X) {
  for (Index j = 0; j < L.rows(); j += kTile) {
    const Index nj = (std::min)(kTile, L.rows() - j);
    if (j > 0) subtract_outer<Scalar>(X.middleCols(j, nj), X.leftCols(j), L.block(j, 0, nj, j));
    for (Index i = 0; i < X.rows(); i += kTile) {
      const Index ni = (std::min)(kTile, X.rows() - i);
      Eigen::Block<Eigen::Ref<MatrixX<Scalar>>> tile = X.block(i, j, ni, nj);
      L.block(j, j, nj, nj).transpose().template triangularView<Eigen::Upper>().template solveInPlace<Eigen::OnTheRight>(tile);
    }
  }
}

}  // namespace clothctl::detail
