#pragma once

// Incomplete factorisation of a step matrix by blocks of 3×3, without fill:
//
//   P = L D Lᵀ ≈ A,       L unit lower triangular with the blocks of A below the diagonal
//   U_ij = A_ij - Σ_{k<j} U_ik L_jkᵀ,   L_ij = U_ij D_j⁻¹,   D_i = A_ii - Σ_{k<i} U_ik L_ikᵀ
//
// Sums over k are over the blocks that A has. When a pivot D_i is not clearly positive definite,
// all U_ij = A_ij and D_i = A_ii instead (symmetric Gauss-Seidel). So P is positive definite
// whenever all diagonal blocks of A are. A factorisation and a solve cost O(blocks), which makes P
// a preconditioner for sheets whose complete factor is too large. Reference: Meijerink and van der
// Vorst, Math. Comp. 31 (1977).

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
      : lower_(pattern), inverse_(static_cast<std::size_t>(pattern.rows()), Zero()) {}

  /// Factorises a matrix of the pattern. Vertices with held[i] ≠ 0 get the rows and columns of the
  /// identity. Returns false when a diagonal block of a free vertex is not positive definite. Never
  /// allocates. Complexity: O(blocks · blocks in a row).
  [[nodiscard]] bool factorize(const BlockSymmetric<Scalar>& matrix,
                               std::span<const unsigned char> held) {
    return eliminate(matrix, held, true) || eliminate(matrix, held, false);
  }

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
      set_point(x, i, times(inverse_[static_cast<std::size_t>(i)], point(x, i)));
    for (Index i = n; i-- > 0;) {
      const Triple<Scalar> value = point(x, i);
      for (int s = lower_.row_begin(i); s < lower_.row_begin(i + 1); ++s) {
        const Index j = lower_.column(s);
        set_point(x, j, point(x, j) - transposed_times(lower_.lower(s), value));
      }
    }
  }

 private:
  static Matrix3<Scalar> Zero() { return Matrix3<Scalar>::Zero(); }
  Matrix3<Scalar>& inverse(Index i) { return inverse_[static_cast<std::size_t>(i)]; }

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

  /// Computes L and D. Without `update`, U_ij = A_ij and D_i = A_ii.
  bool eliminate(const BlockSymmetric<Scalar>& matrix, std::span<const unsigned char> held,
                 bool update) {
    const auto is_held = [&](Index i) { return held[static_cast<std::size_t>(i)] != 0; };
    for (Index i = 0; i < matrix.rows(); ++i) {
      const int begin = matrix.row_begin(i), end = matrix.row_begin(i + 1);
      if (is_held(i)) {
        for (int s = begin; s < end; ++s) lower_.lower(s).setZero();
        inverse(i).setIdentity();
        continue;
      }
      for (int s = begin; s < end; ++s) {
        const bool coupled = !is_held(matrix.column(s));
        lower_.lower(s) = coupled ? matrix.lower(s) : Zero();
      }
      Matrix3<Scalar> pivot = matrix.diagonal(i);
      for (int s = begin; update && s < end; ++s) subtract_earlier(i, s);
      for (int s = begin; s < end; ++s) {
        const Matrix3<Scalar> u = lower_.lower(s);
        lower_.lower(s).noalias() = u * inverse(matrix.column(s));
        if (update) pivot.noalias() -= u * lower_.lower(s).transpose();
      }
      const Matrix3<Scalar>& own = matrix.diagonal(i);
      const Scalar least = update ? Scalar(1e-6) : scalar_traits<Scalar>::epsilon();
      if (!invert(pivot, own, least, inverse(i))) return false;
    }
    return true;
  }

  /// Subtracts Σ_{k<j} U_ik L_jkᵀ from the block of slot s, row i and column j. Row i holds U,
  /// earlier rows hold L.
  void subtract_earlier(Index i, int s) {
    const Index j = lower_.column(s);
    int a = lower_.row_begin(i), b = lower_.row_begin(j);
    const int end = lower_.row_begin(j + 1);
    while (a < s && b < end) {
      const int ka = lower_.column(a), kb = lower_.column(b);
      if (ka == kb) lower_.lower(s).noalias() -= lower_.lower(a) * lower_.lower(b).transpose();
      if (ka <= kb) ++a;
      if (kb <= ka) ++b;
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

  BlockSymmetric<Scalar> lower_;          // L; its diagonal blocks are not used
  std::vector<Matrix3<Scalar>> inverse_;  // D⁻¹
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
