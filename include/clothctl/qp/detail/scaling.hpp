#pragma once

// Equilibration by powers of two, so that scaling and unscaling are exact:
//
//   x = D x̂,  Ĥ = D H D,  Â = E A D,  y = E ŷ,  z = D⁻¹ ẑ
//
// A few sweeps make the largest entry of each column of (Ĥ; Â) and of each row of Â close to one.
// Reference: Ruiz, RAL-TR-2001-034 (2001).

#include <algorithm>
#include <cmath>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Computes product_i = a_i b_i for the first n entries.
template <RealScalar Scalar>
void multiply_entries(Index n, const VectorX<Scalar>& a, const VectorX<Scalar>& b,
                      VectorX<Scalar>& product) {
  for (Index i = 0; i < n; ++i) product[i] = a[i] * b[i];
}

/// Computes quotient_i = a_i / b_i for the first n entries.
template <RealScalar Scalar>
void divide_entries(Index n, const VectorX<Scalar>& a, const VectorX<Scalar>& b,
                    VectorX<Scalar>& quotient) {
  for (Index i = 0; i < n; ++i) quotient[i] = a[i] / b[i];
}

/// Returns a power of two p with value/p between 0.71875 and 1.4375, if p is within 2^±60. The
/// value must be positive.
template <RealScalar Scalar>
Scalar nearest_power_of_two(const Scalar& value) {
  Scalar power(1);
  const Scalar up(1.4375);
  const Scalar down(0.71875);
  for (int k = 0; k < 60 && value > power * up; ++k) power *= Scalar(2);
  for (int k = 0; k < 60 && value < power * down; ++k) power *= Scalar(0.5);
  return power;
}

/// Returns the largest |values_i| weights_i of `count` entries, or 0.
template <RealScalar Scalar>
Scalar largest_product(Index count, const Scalar* values, const Scalar* weights) {
  using std::abs;
  Scalar even(0), odd(0);  // two maxima, so that one need not wait for the other
  Index i = 0;
  for (; i + 1 < count; i += 2) {
    even = (std::max)(even, Scalar(abs(values[i]) * weights[i]));
    odd = (std::max)(odd, Scalar(abs(values[i + 1]) * weights[i + 1]));
  }
  if (i < count) even = (std::max)(even, Scalar(abs(values[i]) * weights[i]));
  return (std::max)(even, odd);
}

/// Scales H (n×n) and A (m×n) in place, and writes the scale factors to D (n) and E (m). Never
/// allocates. Complexity: O(n² + mn).
template <RealScalar Scalar>
void equilibrate(Eigen::Ref<MatrixX<Scalar>> H, Eigen::Ref<MatrixX<Scalar>> A,
                 Eigen::Ref<VectorX<Scalar>> D, Eigen::Ref<VectorX<Scalar>> E) {
  using std::abs;
  using std::sqrt;
  const Index n = H.rows();
  const Index m = A.rows();
  D.setConstant(Scalar(1));
  const auto scale_rows = [&] {
    E.setConstant(Scalar(0));
    for (Index j = 0; j < n; ++j) {
      for (Index i = 0; i < m; ++i) E[i] = (std::max)(E[i], Scalar(abs(A(i, j)) * D[j]));
    }
    for (Index i = 0; i < m; ++i) E[i] = E[i] > Scalar(0) ? Scalar(1) / E[i] : Scalar(1);
  };
  constexpr int kSweeps = 4;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    scale_rows();
    for (Index j = 0; j < n; ++j) {
      const Scalar largest =
          (std::max)(largest_product(n, &H.coeffRef(0, j), D.data()),
                     largest_product(m, A.data() + j * A.outerStride(), E.data()));
      if (largest > Scalar(0)) D[j] = sqrt(D[j] / largest);
    }
  }
  for (Index j = 0; j < n; ++j) D[j] = nearest_power_of_two(D[j]);
  scale_rows();
  for (Index i = 0; i < m; ++i) E[i] = nearest_power_of_two(E[i]);
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < n; ++i) H(i, j) *= D[i] * D[j];
    for (Index i = 0; i < m; ++i) A(i, j) *= E[i] * D[j];
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
