#pragma once

// Projected BFGS: quasi-Newton steps within limits. They serve minima at which residuals stay
// large. Damped least squares approximates the Hessian by JᵀJ and converges slowly where the
// neglected part, Σ e_i ∂²e_i/∂q², is as large as JᵀJ.
//
//   B_FF dq_F = g_F,   F: the entries that are not at a limit
//   B ← B - B s sᵀB / sᵀB s + y yᵀ / sᵀy,   y ← θ y + (1 - θ) B s so that sᵀy ≥ 0.2 sᵀB s
//
// Reference: Nocedal, Wright, Numerical Optimization (2006) §6.1, procedure 18.2.

#include <vector>

#include "clothctl/linalg/small_cholesky.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The approximate Hessian B; owns the memory.
template <RealScalar Scalar>
class ProjectedBfgs {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;

  /// Makes room for n entries. Allocates.
  explicit ProjectedBfgs(Index n) : factor_(n) {
    B_.setZero(n, n);
    Bs_.setZero(n);
    y_.setZero(n);
    right_.setZero(n);
    free_.reserve(static_cast<std::size_t>(n));
  }

  /// Sets B = JᵀJ + shift · 1, with shift > 0. Never allocates.
  void start(const Eigen::Ref<const MatrixX<Scalar>, 0, Eigen::OuterStride<>>& J,
             const Scalar& shift) {
    for (Index j = 0; j < B_.cols(); ++j) {
      for (Index i = j; i < B_.rows(); ++i)
        B_(i, j) = B_(j, i) = J.col(i).dot(J.col(j)) + (i == j ? shift : Scalar(0));
    }
  }

  /// Writes the step (n) for the descent direction g (n, minus the gradient). `below` ≤ 0 ≤ `above`
  /// are the distances to the limits; entries at a limit that g pushes against do not move. Other
  /// entries may go beyond their limits. A short enough part of the step, clamped to the limits,
  /// lowers the cost. Never allocates. Complexity: O(n³).
  void find_step(const View& g, const View& below, const View& above,
                 Eigen::Ref<VectorX<Scalar>> step) {
    const Scalar still = Scalar(64) * scalar_traits<Scalar>::epsilon();
    free_.clear();
    step.setConstant(Scalar(0));
    for (Index i = 0; i < g.size(); ++i) {
      if (g[i] > Scalar(0) ? above[i] > still : below[i] < -still) free_.push_back(i);
    }
    const Index count = static_cast<Index>(free_.size());
    factor_.resize(count);
    for (Index j = 0; j < count; ++j) {
      for (Index i = j; i < count; ++i)
        factor_(i, j) = B_(free_[static_cast<std::size_t>(i)], free_[static_cast<std::size_t>(j)]);
      right_[j] = g[free_[static_cast<std::size_t>(j)]];
    }
    const bool solved = factor_.solve(right_.head(count)) < 0;
    for (Index j = 0; j < count; ++j) {
      const Index i = free_[static_cast<std::size_t>(j)];
      step[i] = solved ? right_[j] : Scalar(g[i] / B_(i, i));
    }
  }

  /// Updates B after a step s along which the gradient changed by `change`. Never allocates.
  /// Complexity: O(n²).
  void update(const View& s, const View& change) {
    Bs_.noalias() = B_.lazyProduct(s);
    const Scalar curvature = s.dot(Bs_), seen = s.dot(change);
    if (!(curvature > Scalar(0))) return;
    Scalar theta(1);
    if (seen < Scalar(0.2) * curvature) theta = Scalar(0.8) * curvature / (curvature - seen);
    y_ = theta * change + (Scalar(1) - theta) * Bs_;
    const Scalar along = s.dot(y_);
    if (!(along > Scalar(0)) || !is_finite(along)) return;
    for (Index j = 0; j < B_.cols(); ++j) {
      const Scalar taken = Bs_[j] / curvature, given = y_[j] / along;
      B_.col(j) += given * y_ - taken * Bs_;
    }
  }

 private:
  clothctl::SmallCholesky<Scalar> factor_;
  MatrixX<Scalar> B_;
  VectorX<Scalar> Bs_, y_, right_;
  std::vector<Index> free_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
