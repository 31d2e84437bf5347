#pragma once

// Σ_k w_k M_k over chosen columns of a matrix, four in a pass: alone, each column would load and store the whole sum.

#include <array>

#include "clothctl/core/types.hpp"

namespace clothctl::detail {

/// Adds weighted columns of M (n×any) to `sum` (n). Columns wait until there are four; the sum is complete after `finish`.
/// Weights of zero cost nothing. Never allocates.
template <RealScalar Scalar>
class ColumnSum {
 public:
  using Matrix = Eigen::Ref<const MatrixX<Scalar>>;
  using Vector = Eigen::Ref<VectorX<Scalar>>;

  /// Works on M and `sum`, which must outlive this.
  ColumnSum(const Matrix& M, const Vector& sum) : M_(M), sum_(sum) {}

  /// Adds w M_i.
  void add(Index i, const Scalar& w) {
    if (!(w < Scalar(0)) && !(w > Scalar(0))) return;
    column_[waiting_] = i;
    weight_[waiting_] = w;
    if (++waiting_ < kWidth) return;
    waiting_ = 0;
    sum_ += weight_[0] * M_.col(column_[0]) + weight_[1] * M_.col(column_[1]) + weight_[2] * M_.col(column_[2]) +
            weight_[3] * M_.col(column_[3]);
  }

  /// Adds what still waits.
  void finish() {
    for (std::size_t k = 0; k < waiting_; ++k) sum_ += weight_[k] * M_.col(column_[k]);
    waiting_ = 0;
  }

 private:
  static constexpr std::size_t kWidth = 4;

  Matrix M_;
  Vector sum_;
  std::array<Index, kWidth> column_{};
  std::array<Scalar, kWidth> weight_{};
  std::size_t waiting_ = 0;
};

}  // namespace clothctl::detail
