#pragma once

// Incomplete factorisation of a step matrix by blocks of 3×3, without fill:
//
//   P = L D Lᵀ ≈ A,       L unit lower triangular with the blocks of A below the diagonal
//
// Elimination of vertex k subtracts U_ik D_k⁻¹ U_jkᵀ from block (i, j) for all later neighbours i
// and j of k. Where A has no block (i, j), the product is left out. That alone can make a later
// pivot indefinite, so the diagonal blocks of i and j are compensated:
//
//   D_i += α |U_jk|/|U_ik| U_ik D_k⁻¹ U_ikᵀ,   and the same of j with i and j exchanged.
//
// |U| is the sum of the magnitudes of the entries. With α = 1, P - A is positive semidefinite, so
// pivots of a positive definite A cannot fail, up to rounding. But P is nearer to A with small α.
// The factorisation starts with α = 0, and begins again with a larger one where a pivot fails or is
// hardly above rounding. (A small pivot may be exact, as that of a stiff link between two layers.)
// It costs O(blocks · blocks in a row). Reference: Ajiz and Jennings, A robust incomplete
// Choleski-conjugate gradient algorithm, Int. J. Numer. Meth. Eng. 20 (1984), who compensate
// scalars.

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/linalg/block_symmetric.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The incomplete factor of a BlockSymmetric.
template <RealScalar Scalar>
class IncompleteCholesky {
 public:
  /// The factor of a matrix without rows.
  IncompleteCholesky() = default;

  /// Makes room for matrices of a pattern. Allocates.
  explicit IncompleteCholesky(const BlockSymmetric<Scalar>& pattern)
      : lower_(pattern),
        pivot_(static_cast<std::size_t>(pattern.rows()), Zero()),
        column_begin_(pivot_.size() + 1, 0),
        column_(static_cast<std::size_t>(pattern.lower_count())) {
    for (Index s = 0; s < pattern.lower_count(); ++s)
      ++column_begin_[static_cast<std::size_t>(pattern.column(s)) + 1];
    for (std::size_t k = 1; k < column_begin_.size(); ++k) column_begin_[k] += column_begin_[k - 1];
    std::vector<std::size_t> next(column_begin_.begin(), column_begin_.end());
    for (Index i = 0; i < pattern.rows(); ++i) {
      for (int s = pattern.row_begin(i); s < pattern.row_begin(i + 1); ++s)
        column_[next[static_cast<std::size_t>(pattern.column(s))]++] = {static_cast<int>(i), s};
    }
    std::size_t longest = 0;
    for (std::size_t k = 0; k + 1 < column_begin_.size(); ++k)
      longest = (std::max)(longest, column_begin_[k + 1] - column_begin_[k]);
    parts_.resize(longest);
  }

  /// Factorises a matrix of the pattern. Vertices with held[i] ≠ 0 get the rows and columns of the
  /// identity. Returns false when a pivot is not positive definite even with α = 1; then the free
  /// part of the matrix is not, up to rounding. Never allocates.
  [[nodiscard]] bool factorize(const BlockSymmetric<Scalar>& matrix,
                               std::span<const unsigned char> held) {
    for (const double alpha : {0.0, 0.02, 0.1, 0.3, 1.0}) {
      if (factorize(matrix, held, Scalar(alpha))) return true;
    }
    return false;
  }

  /// The same with one α.
  [[nodiscard]] bool factorize(const BlockSymmetric<Scalar>& matrix,
                               std::span<const unsigned char> held, const Scalar& alpha) {
    const Scalar rounding = scalar_traits<Scalar>::epsilon();
    const bool last = !(alpha < Scalar(1));
    return eliminate(matrix, held, alpha, last ? rounding : Scalar(1000) * rounding);
  }

  /// Returns α of the last factorisation.
  const Scalar& compensation() const { return compensation_; }

  /// Replaces x (1×3n) by P⁻¹ x. Entries of held vertices do not change. Never allocates.
  void solve(Lanes<Scalar, 1>& x) const {
    const Index n = lower_.rows();
    for (Index i = 0; i < n; ++i) {
      Triple<Scalar> sum = point(x, i);
      for (int s = lower_.row_begin(i); s < lower_.row_begin(i + 1); ++s)
        sum = sum - times(lower_.lower(s), point(x, lower_.column(s)));
      set_point(x, i, sum);
    }
    for (Index i = 0; i < n; ++i)
      set_point(x, i, times(pivot_[static_cast<std::size_t>(i)], point(x, i)));
    for (Index i = n; i-- > 0;) {
      const Triple<Scalar> value = point(x, i);
      for (int s = lower_.row_begin(i); s < lower_.row_begin(i + 1); ++s) {
        const Index j = lower_.column(s);
        set_point(x, j, point(x, j) - transposed_times(lower_.lower(s), value));
      }
    }
  }

 private:
  /// A block of a column of L: its row, and its slot in `lower_`.
  struct ColumnEntry {
    int row, slot;
  };
  /// The block U of an entry before it is divided by the pivot, its norm, and the sum of the norms
  /// in the column whose products with it have a place, its own among them.
  struct Part {
    Matrix3<Scalar> upper;
    Scalar size, kept;
  };

  static Matrix3<Scalar> Zero() { return Matrix3<Scalar>::Zero(); }
  Matrix3<Scalar>& pivot(Index i) { return pivot_[static_cast<std::size_t>(i)]; }

  static CLOTHCTL_FORCE_INLINE Triple<Scalar> times(const Matrix3<Scalar>& m,
                                                    const Triple<Scalar>& a) {
    const Scalar* e = m.data();
    return {e[0] * a.x + e[3] * a.y + e[6] * a.z, e[1] * a.x + e[4] * a.y + e[7] * a.z,
            e[2] * a.x + e[5] * a.y + e[8] * a.z};
  }
  static CLOTHCTL_FORCE_INLINE Triple<Scalar> transposed_times(const Matrix3<Scalar>& m,
                                                               const Triple<Scalar>& a) {
    const Scalar* e = m.data();
    return {e[0] * a.x + e[1] * a.y + e[2] * a.z, e[3] * a.x + e[4] * a.y + e[5] * a.z,
            e[6] * a.x + e[7] * a.y + e[8] * a.z};
  }

  /// Computes L and D. Returns false at the first pivot that `invert` refuses, or number that is
  /// not finite.
  bool eliminate(const BlockSymmetric<Scalar>& matrix, std::span<const unsigned char> held,
                 const Scalar& alpha, const Scalar& least) {
    compensation_ = alpha;
    const auto is_held = [&](Index i) { return held[static_cast<std::size_t>(i)] != 0; };
    for (Index i = 0; i < matrix.rows(); ++i) {
      pivot(i) = matrix.diagonal(i);
      // `invert` reads the lower triangle only.
      if (!is_held(i) && !is_finite(Scalar(pivot(i).sum()))) return false;
      for (int s = matrix.row_begin(i); s < matrix.row_begin(i + 1); ++s) {
        const bool coupled = !is_held(i) && !is_held(matrix.column(s));
        lower_.lower(s) = coupled ? matrix.lower(s) : Zero();
      }
    }
    for (Index k = 0; k < matrix.rows(); ++k) {
      if (is_held(k)) {
        pivot(k).setIdentity();
        continue;
      }
      const Matrix3<Scalar> own = pivot(k);
      if (!invert(own, matrix.diagonal(k), least, pivot(k))) return false;
      const std::size_t begin = column_begin_[static_cast<std::size_t>(k)];
      const std::size_t end = column_begin_[static_cast<std::size_t>(k) + 1];
      if (!eliminate_column({column_.data() + begin, end - begin}, pivot(k), alpha)) return false;
    }
    return true;
  }

  /// Subtracts the products of the blocks U of a column, compensates for those left out, and turns
  /// U into L. Returns false when U is not finite.
  bool eliminate_column(std::span<const ColumnEntry> column, const Matrix3<Scalar>& inverse,
                        const Scalar& alpha) {
    Scalar total = Scalar(0);
    for (std::size_t e = 0; e < column.size(); ++e) {
      Part& part = parts_[e];
      part.upper = lower_.lower(column[e].slot);
      part.size = part.upper.cwiseAbs().sum();
      part.kept = part.size;
      total += part.size;
      lower_.lower(column[e].slot).noalias() = part.upper * inverse;
    }
    if (!is_finite(total)) return false;
    for (std::size_t e = 0; e < column.size(); ++e) {
      if (Scalar(0) < parts_[e].size) subtract_products(column, e);
    }
    for (std::size_t e = 0; e < column.size(); ++e) {
      const Part& part = parts_[e];
      if (!(Scalar(0) < part.size)) continue;
      const Scalar left_out = part.kept < total ? total - part.kept : Scalar(0);
      const Scalar share = Scalar(1) - alpha * left_out / part.size;
      pivot(column[e].row).noalias() -=
          share * part.upper * lower_.lower(column[e].slot).transpose();
    }
    return true;
  }

  /// Subtracts the products of entry e of a column and the earlier ones from the blocks of its row.
  void subtract_products(std::span<const ColumnEntry> column, std::size_t e) {
    // Rows of the column and columns of the row ascend. The shorter list is searched for in the
    // other, since a hub has thousands of blocks.
    const int begin = column[e].slot + 1, end = lower_.row_begin(column[e].row + 1);
    const auto subtract = [&](std::size_t f, int s) {
      lower_.lower(s).noalias() -= parts_[e].upper * lower_.lower(column[f].slot).transpose();
      parts_[e].kept += parts_[f].size;
      parts_[f].kept += parts_[e].size;
    };
    if (static_cast<std::size_t>(end - begin) <= e) {
      for (int s = begin; s < end; ++s) {
        const auto found = std::lower_bound(
            column.begin(), column.begin() + static_cast<std::ptrdiff_t>(e), lower_.column(s),
            [](const ColumnEntry& entry, Index row) { return entry.row < row; });
        const std::size_t f = static_cast<std::size_t>(found - column.begin());
        if (f < e && found->row == lower_.column(s)) subtract(f, s);
      }
    } else {
      for (std::size_t f = 0; f < e; ++f) {
        const int s = lower_.find(column[e].row, column[f].row);
        if (0 <= s) subtract(f, s);
      }
    }
  }

  /// Writes the inverse of a symmetric block to `out`. Returns false, and writes nothing, when a
  /// pivot of the block is not above `least` times the same entry of `size`.
  static bool invert(const Matrix3<Scalar>& m, const Matrix3<Scalar>& size, const Scalar& least,
                     Matrix3<Scalar>& out) {
    const Scalar a = m(0, 0);
    if (!is_finite(a) || !(least * size(0, 0) < a)) return false;
    const Scalar b = m(1, 0) / a, c = m(2, 0) / a;
    const Scalar d = m(1, 1) - b * m(1, 0), e = m(2, 1) - b * m(2, 0);
    if (!is_finite(d) || !(least * size(1, 1) < d)) return false;
    const Scalar f = e / d, g = m(2, 2) - c * m(2, 0) - f * e;
    if (!is_finite(g) || !(least * size(2, 2) < g)) return false;
    // Solves L diag(a, d, g) Lᵀ x = e_k with L = [1; b 1; c f 1].
    for (Index k = 0; k < 3; ++k) {
      const Scalar y0 = Scalar(k == 0 ? 1 : 0);
      const Scalar y1 = Scalar(k == 1 ? 1 : 0) - b * y0;
      const Scalar y2 = Scalar(k == 2 ? 1 : 0) - c * y0 - f * y1;
      out(2, k) = y2 / g;
      out(1, k) = y1 / d - f * out(2, k);
      out(0, k) = y0 / a - b * out(1, k) - c * out(2, k);
    }
    return true;
  }

  BlockSymmetric<Scalar> lower_;        // L; its diagonal blocks are not used
  std::vector<Matrix3<Scalar>> pivot_;  // D, from its elimination on D⁻¹
  std::vector<std::size_t> column_begin_;
  std::vector<ColumnEntry> column_;  // the blocks by columns; rows ascend
  std::vector<Part> parts_;          // memory of one column
  Scalar compensation_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
