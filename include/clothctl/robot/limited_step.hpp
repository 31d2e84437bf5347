#pragma once

// The damped step of least squares within limits:
//
//   (JᵀJ + D) dq = Jᵀ e + r,   below ≤ dq ≤ above
//
// by rows: dq = D⁻¹ (Jᵀ λ + r), (1 + J D⁻¹ Jᵀ) λ = e - J D⁻¹ r: the matrix is as large as the residual, not as the robot.
// Entries beyond their limits are put there, their share leaves the residual, e -= J_i dq_i, and the others are solved again
// ("lock, limit, redistribute"); by rows that is a rank-one change. Reference: Baerlocher, Boulic, The Visual Computer 20
// (2004).

#include <algorithm>
#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/math/small_cholesky.hpp"

namespace clothctl::robot {

/// Finds damped steps; holds the memory.
template <RealScalar Scalar>
class LimitedStep {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// A read-only view of a matrix.
  using MatrixView = Eigen::Ref<const MatrixX<Scalar>, 0, Eigen::OuterStride<>>;

  /// Makes room. Allocates.
  LimitedStep(Index most_rows, Index n) : n_(n) {
    const Index side = (std::min)(most_rows, n);
    S_.setZero(side, side);
    L_.setZero(side, side);
    left_.setZero(most_rows);
    right_.setZero(side);
    free_.assign(static_cast<std::size_t>(n), 0);
  }

  /// Writes the step for J (rows × n), e (rows), r, D > 0, below ≤ 0 ≤ above (n each). Never allocates. Complexity: O(rows² n +
  /// rows³) and one solve more for each round of locking, at most n.
  void solve(const MatrixView& J, const View& e, const View& pull, const View& damping, const View& below, const View& above,
             Eigen::Ref<VectorX<Scalar>> step) {
    rows_ = J.rows();
    left_.head(rows_) = e;
    std::fill(free_.begin(), free_.end(), char(1));
    const bool by_rows = rows_ <= n_;
    if (by_rows) sum_rows(J, damping);
    for (Index round = 0; round <= n_; ++round) {
      if (by_rows) {
        solve_by_rows(J, pull, damping, step);
      } else {
        solve_by_columns(J, pull, damping, step);
      }
      bool beyond = false;
      for (Index i = 0; i < n_; ++i) {
        if (free_[static_cast<std::size_t>(i)] == 0) continue;
        const Scalar within = (std::min)((std::max)(step[i], below[i]), above[i]);
        if (!(step[i] < within) && !(step[i] > within)) continue;
        beyond = true;
        step[i] = within;
        free_[static_cast<std::size_t>(i)] = 0;
        left_.head(rows_) -= within * J.col(i);
        if (by_rows) add_column(J, i, Scalar(-1) / damping[i]);
      }
      if (!beyond) return;
    }
  }

 private:
  /// S = 1 + J D⁻¹ Jᵀ, lower triangle.
  void sum_rows(const MatrixView& J, const View& damping) {
    auto S = S_.topLeftCorner(rows_, rows_);
    S.setIdentity();
    for (Index i = 0; i < n_; ++i) add_column(J, i, Scalar(1) / damping[i]);
  }
  /// S += weight · J_i J_iᵀ; a joint moves few tasks, so most entries are zero.
  void add_column(const MatrixView& J, Index i, const Scalar& weight) {
    for (Index k = 0; k < rows_; ++k) {
      const Scalar share = weight * J(k, i);
      if (share < Scalar(0) || share > Scalar(0)) {
        S_.col(k).segment(k, rows_ - k) += share * J.col(i).segment(k, rows_ - k);
      }
    }
  }

  void solve_by_rows(const MatrixView& J, const View& pull, const View& damping, Eigen::Ref<VectorX<Scalar>> step) {
    right_.head(rows_) = left_.head(rows_);
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] == 0) continue;
      if (pull[i] < Scalar(0) || pull[i] > Scalar(0)) right_.head(rows_) -= (pull[i] / damping[i]) * J.col(i);
    }
    L_.topLeftCorner(rows_, rows_) = S_.topLeftCorner(rows_, rows_);
    clothctl::detail::factor_small<Scalar>(L_.topLeftCorner(rows_, rows_));  // S ≥ 1
    clothctl::detail::solve_small<Scalar>(L_.topLeftCorner(rows_, rows_), right_.head(rows_));
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] == 0) continue;
      step[i] = (J.col(i).dot(right_.head(rows_)) + pull[i]) / damping[i];
    }
  }

  /// The same from (JᵀJ + D) dq = Jᵀ e + r on the free entries: fewer than rows.
  void solve_by_columns(const MatrixView& J, const View& pull, const View& damping, Eigen::Ref<VectorX<Scalar>> step) {
    Index count = 0;
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] == 0) continue;
      Index row = count;
      for (Index k = i; k < n_; ++k) {
        if (free_[static_cast<std::size_t>(k)] == 0) continue;
        L_(row++, count) = J.col(i).dot(J.col(k)) + (k == i ? damping[i] : Scalar(0));
      }
      right_[count++] = J.col(i).dot(left_.head(rows_)) + pull[i];
    }
    clothctl::detail::factor_small<Scalar>(L_.topLeftCorner(count, count));
    clothctl::detail::solve_small<Scalar>(L_.topLeftCorner(count, count), right_.head(count));
    for (Index i = 0, k = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] != 0) step[i] = right_[k++];
    }
  }

  MatrixX<Scalar> S_, L_;
  VectorX<Scalar> left_, right_;
  std::vector<char> free_;
  Index n_, rows_ = 0;
};

}  // namespace clothctl::robot
