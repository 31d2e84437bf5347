#pragma once

// Solves A x = r for a square A without symmetry by elimination with row exchanges, without
// allocation. Columns are eliminated in panels of eight, so that the rest of the matrix is read
// once for eight columns: [A_11 A_12; A_21 A_22] with P [A_11; A_21] = [L_11; L_21] U_11 gives
//
//   U_12 = L_11⁻¹ A_12,     A_22 ← A_22 - L_21 U_12

#include <cmath>
#include <utility>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A square matrix and its elimination.
template <RealScalar Scalar>
class PivotedLu {
 public:
  using Matrix = Eigen::Map<MatrixX<Scalar>>;

  /// Makes room for n rows. Allocates.
  void reserve(Index n) { entries_.setConstant(n * n, Scalar(0)); }
  /// Sets the size, at most the reserved one. The entries are then arbitrary.
  void resize(Index n) { n_ = n; }
  /// The matrix A.
  Matrix matrix() { return Matrix(entries_.data(), n_, n_); }

  /// x ← A⁻¹ x for the first n entries of x; overwrites A. Returns false, and leaves x arbitrary,
  /// when a pivot is zero or not finite. Complexity: 2/3 n³.
  bool solve(VectorX<Scalar>& x) {
    Matrix A = matrix();
    for (Index first = 0; first < n_; first += kPanel) {
      const Index width = n_ - first < kPanel ? n_ - first : kPanel;
      if (!factor_panel(A, x, first, width)) return false;
      const Index next = first + width, rest = n_ - next;
      if (rest == 0) break;
      for (Index k = first; k < next; ++k) {
        for (Index j = next; j < n_; ++j) {
          const Scalar a = A(k, j);
          A.col(j).segment(k + 1, next - k - 1) -= a * A.col(k).segment(k + 1, next - k - 1);
        }
      }
      A.bottomRightCorner(rest, rest).noalias() -=
          A.block(next, first, rest, width).lazyProduct(A.block(first, next, width, rest));
    }
    for (Index k = n_; k-- > 0;) {
      x[k] /= A(k, k);
      const Scalar x_k = x[k];
      x.head(k) -= x_k * A.col(k).head(k);
    }
    return true;
  }

 private:
  static constexpr Index kPanel = 8;

  bool factor_panel(Matrix& A, VectorX<Scalar>& x, Index first, Index width) {
    using std::abs;
    for (Index k = first; k < first + width; ++k) {
      Index pivot = k;
      for (Index i = k + 1; i < n_; ++i) {
        if (abs(A(pivot, k)) < abs(A(i, k))) pivot = i;
      }
      const Scalar value = A(pivot, k);
      if (!is_finite(value) || !(Scalar(0) < abs(value))) return false;
      if (pivot != k) {
        for (Index j = 0; j < n_; ++j) std::swap(A(k, j), A(pivot, j));
        std::swap(x[k], x[pivot]);
      }
      const Index below = n_ - k - 1;
      A.col(k).tail(below) *= Scalar(1) / value;
      const Scalar x_k = x[k];
      x.segment(k + 1, below) -= x_k * A.col(k).tail(below);
      for (Index j = k + 1; j < first + width; ++j) {
        const Scalar a = A(k, j);
        A.col(j).tail(below) -= a * A.col(k).tail(below);
      }
    }
    return true;
  }

  VectorX<Scalar> entries_;
  Index n_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
