#pragma once

// A step of damped least squares (the Levenberg-Marquardt step, also known as the damped
// pseudo-inverse) within limits:
//
//   (JᵀJ + D) dq = Jᵀ e + r,   below ≤ dq ≤ above
//
// With fewer rows than joints it is solved by rows,
//
//   dq = D⁻¹ (Jᵀ λ + r),   (1 + J D⁻¹ Jᵀ) λ = e - J D⁻¹ r
//
// so that the matrix is as large as the residual and not as the robot. An entry of dq beyond its
// limit is set to the limit, its contribution is subtracted from the residual, e -= J_i dq_i, and
// the other entries are solved again. By rows that changes the matrix by rank one.
//
// Reference: Wampler, IEEE Trans. SMC 16 (1986) and Nakamura, Hanafusa, J. Dyn. Sys. 108 (1986) for
// damped least squares; Baerlocher, Boulic, The Visual Computer 20 (2004) for the limits.

#include <algorithm>
#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/linalg/small_cholesky.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Solves for damped steps; owns the memory.
template <RealScalar Scalar>
class DampedLeastSquares {
 public:
  /// A read-only view of a vector.
  using View = Eigen::Ref<const VectorX<Scalar>>;
  /// A read-only view of a matrix.
  using MatrixView = Eigen::Ref<const MatrixX<Scalar>, 0, Eigen::OuterStride<>>;

  /// Makes room. Allocates.
  DampedLeastSquares(Index most_rows, Index n) : n_(n) {
    const Index side = (std::min)(most_rows, n);
    factor_.reserve(side);
    columns_.setZero(padded(most_rows) * n);
    sum_.setZero(padded(side) * side);
    left_.setZero(padded(most_rows));
    right_.setZero(padded(most_rows));
    weights_.setZero(n);
    free_.assign(static_cast<std::size_t>(n), 0);
  }

  /// Writes the step (n) for J (rows × n), e (rows) and, of length n each, r = `pull`, D =
  /// `damping` > 0 and `below` ≤ 0 ≤ `above`. Never allocates. Complexity: O(rows² n + rows³), and
  /// one more solve for each round in which entries reach limits, at most n.
  void solve(const MatrixView& J, const View& e, const View& pull, const View& damping,
             const View& below, const View& above, Eigen::Ref<VectorX<Scalar>> step) {
    rows_ = J.rows();
    stride_ = padded(rows_);
    switch (stride_ / 4) {
      case 1: return solve_with<4>(J, e, pull, damping, below, above, step);
      case 2: return solve_with<8>(J, e, pull, damping, below, above, step);
      case 3: return solve_with<12>(J, e, pull, damping, below, above, step);
      case 4: return solve_with<16>(J, e, pull, damping, below, above, step);
      case 5: return solve_with<20>(J, e, pull, damping, below, above, step);
      default: return solve_with<Eigen::Dynamic>(J, e, pull, damping, below, above, step);
    }
  }

 private:
  using Factor = clothctl::SmallCholesky<Scalar>;
  /// A column of J or S, padded to a multiple of four entries. For short columns the length is a
  /// template argument.
  template <int kRows>
  using Column = Eigen::Map<Eigen::Array<Scalar, kRows, 1>>;

  static Index padded(Index rows) { return Factor::padded(rows); }
  template <int kRows>
  Column<kRows> column(Index i) {
    return Column<kRows>(columns_.data() + i * stride_, stride_);
  }

  template <int kRows>
  void solve_with(const MatrixView& J, const View& e, const View& pull, const View& damping,
                  const View& below, const View& above, Eigen::Ref<VectorX<Scalar>> step) {
    for (Index i = 0; i < n_; ++i) {
      Scalar* const own = columns_.data() + i * stride_;
      VectorX<Scalar>::Map(own, rows_) = J.col(i);
      for (Index k = rows_; k < stride_; ++k) own[k] = Scalar(0);
    }
    Column<kRows> left(left_.data(), stride_);
    left.setConstant(Scalar(0));
    left_.head(rows_) = e;
    std::fill(free_.begin(), free_.end(), char(1));
    const bool by_rows = rows_ <= n_;
    if (by_rows) {
      weights_ = damping.cwiseInverse();
      sum_rows<kRows>();
    }
    for (Index round = 0; round <= n_; ++round) {
      if (by_rows) {
        solve_by_rows<kRows>(pull, step);
      } else {
        solve_by_columns<kRows>(pull, damping, step);
      }
      bool beyond = false;
      for (Index i = 0; i < n_; ++i) {
        const Scalar within = (std::min)((std::max)(step[i], below[i]), above[i]);
        if (free_[static_cast<std::size_t>(i)] == 0 || (!(step[i] < within) && !(step[i] > within)))
          continue;
        beyond = true;
        step[i] = within;
        free_[static_cast<std::size_t>(i)] = 0;
        left -= within * column<kRows>(i);
        if (by_rows) remove_from_sum<kRows>(i);
      }
      if (!beyond) return;
    }
  }

  /// Computes S = 1 + J D⁻¹ Jᵀ.
  template <int kRows>
  void sum_rows() {
    for (Index j = 0; j < rows_; ++j) {
      Column<kRows> S(sum_.data() + j * stride_, stride_);
      if constexpr (kRows == Eigen::Dynamic) {
        S.setConstant(Scalar(0));
        for (Index i = 0; i < n_; ++i) S += (weights_[i] * column<kRows>(i)[j]) * column<kRows>(i);
      } else {
        Eigen::Array<Scalar, kRows, 1> sum = Eigen::Array<Scalar, kRows, 1>::Constant(Scalar(0));
        for (Index i = 0; i < n_; ++i)
          sum += (weights_[i] * column<kRows>(i)[j]) * column<kRows>(i);
        S = sum;
      }
      S[j] += Scalar(1);
    }
  }
  /// Subtracts from S the contribution of entry i, which is at its limit. A joint moves few tasks,
  /// so most shares are zero.
  template <int kRows>
  void remove_from_sum(Index i) {
    const Column<kRows> own = column<kRows>(i);
    for (Index j = 0; j < rows_; ++j) {
      const Scalar share = weights_[i] * own[j];
      if (share < Scalar(0) || share > Scalar(0))
        Column<kRows>(sum_.data() + j * stride_, stride_) -= share * own;
    }
  }

  template <int kRows>
  void solve_by_rows(const View& pull, Eigen::Ref<VectorX<Scalar>> step) {
    Column<kRows> right(right_.data(), stride_);
    right = Column<kRows>(left_.data(), stride_);
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] == 0 ||
          (!(pull[i] < Scalar(0)) && !(pull[i] > Scalar(0))))
        continue;
      right -= (pull[i] * weights_[i]) * column<kRows>(i);
    }
    factor_.resize(rows_);
    std::copy(sum_.data(), sum_.data() + rows_ * stride_, factor_.column(0));
    factor_.solve(right_.head(rows_));  // cannot fail: S - 1 is positive semidefinite
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] != 0)
        step[i] = ((column<kRows>(i) * right).sum() + pull[i]) * weights_[i];
    }
  }

  /// Solves (JᵀJ + D) dq = Jᵀ e + r for the free entries, where there are fewer joints than rows.
  template <int kRows>
  void solve_by_columns(const View& pull, const View& damping, Eigen::Ref<VectorX<Scalar>> step) {
    const Index count = std::count(free_.begin(), free_.end(), char(1));
    factor_.resize(count);
    Index at = 0;
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] == 0) continue;
      const Column<kRows> own = column<kRows>(i);
      Index row = at;
      for (Index k = i; k < n_; ++k) {
        if (free_[static_cast<std::size_t>(k)] == 0) continue;
        factor_(row++, at) = (own * column<kRows>(k)).sum() + (k == i ? damping[i] : Scalar(0));
      }
      right_[at++] = (own * Column<kRows>(left_.data(), stride_)).sum() + pull[i];
    }
    factor_.solve(right_.head(count));
    for (Index i = 0, k = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] != 0) step[i] = right_[k++];
    }
  }

  Factor factor_;
  VectorX<Scalar> columns_, sum_, left_, right_, weights_;
  std::vector<char> free_;
  Index n_, rows_ = 0, stride_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
