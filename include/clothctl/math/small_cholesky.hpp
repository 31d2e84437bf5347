#pragma once

// Cholesky of small dense matrices in place, without a heap: A = L Lᵀ by columns of the lower triangle. For a few dozen rows;
// the upper triangle is neither read nor written.

#include <cmath>

#include "clothctl/core/types.hpp"

namespace clothctl::detail {

/// Overwrites the lower triangle of A with L. Answers -1, or the first column whose pivot is not positive: L is then of no use
/// from there on.
template <RealScalar Scalar>
Index factor_small(Eigen::Ref<MatrixX<Scalar>> A) {
  using std::sqrt;
  const Index n = A.rows();
  for (Index j = 0; j < n; ++j) {
    const Scalar pivot = A(j, j);
    if (!(pivot > Scalar(0))) return j;
    const Scalar root = sqrt(pivot);
    A(j, j) = root;
    A.col(j).segment(j + 1, n - j - 1) *= Scalar(1) / root;
    for (Index k = j + 1; k < n; ++k) A.col(k).segment(k, n - k) -= A(k, j) * A.col(j).segment(k, n - k);
  }
  return -1;
}

/// x ← A⁻¹ x with the L of `factor_small`.
template <RealScalar Scalar>
void solve_small(const Eigen::Ref<const MatrixX<Scalar>>& L, Eigen::Ref<VectorX<Scalar>> x) {
  const Index n = L.rows();
  for (Index j = 0; j < n; ++j) {
    x[j] /= L(j, j);
    x.segment(j + 1, n - j - 1) -= x[j] * L.col(j).segment(j + 1, n - j - 1);
  }
  for (Index j = n; j-- > 0;) {
    x[j] = (x[j] - L.col(j).segment(j + 1, n - j - 1).dot(x.segment(j + 1, n - j - 1))) / L(j, j);
  }
}

}  // namespace clothctl::detail
