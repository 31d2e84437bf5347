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
    factor_.reserve(side);
    columns_.setZero(padded(most_rows) * n);
    sum_.setZero(padded(side) * side);
    left_.setZero(padded(most_rows));
    right_.setZero(padded(most_rows));
    weights_.setZero(n);
    free_.assign(static_cast<std::size_t>(n), 0);
  }

  /// Writes the step for J (rows × n), e (rows), r, D > 0, below ≤ 0 ≤ above (n each). Never allocates. Complexity: O(rows² n +
  /// rows³) and one solve more for each round of locking, at most n.
  void solve(const MatrixView& J, const View& e, const View& pull, const View& damping, const View& below, const View& above,
             Eigen::Ref<VectorX<Scalar>> step) {
    rows_ = J.rows();
    stride_ = padded(rows_);
    switch (stride_ / 4) {
      case 1: return find<4>(J, e, pull, damping, below, above, step);
      case 2: return find<8>(J, e, pull, damping, below, above, step);
      case 3: return find<12>(J, e, pull, damping, below, above, step);
      case 4: return find<16>(J, e, pull, damping, below, above, step);
      case 5: return find<20>(J, e, pull, damping, below, above, step);
      default: return find<Eigen::Dynamic>(J, e, pull, damping, below, above, step);
    }
  }

 private:
  using Factor = clothctl::detail::SmallCholesky<Scalar>;
  /// A column of J or S in whole groups of four entries, whose length the compiler knows where it is short.
  template <int kRows>
  using Column = Eigen::Map<Eigen::Array<Scalar, kRows, 1>>;

  static Index padded(Index rows) { return Factor::padded(rows); }
  template <int kRows>
  Column<kRows> column(Index i) {
    return Column<kRows>(columns_.data() + i * stride_, stride_);
  }

  template <int kRows>
  void find(const MatrixView& J, const View& e, const View& pull, const View& damping, const View& below, const View& above,
            Eigen::Ref<VectorX<Scalar>> step) {
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
        if (free_[static_cast<std::size_t>(i)] == 0 || (!(step[i] < within) && !(step[i] > within))) continue;
        beyond = true;
        step[i] = within;
        free_[static_cast<std::size_t>(i)] = 0;
        left -= within * column<kRows>(i);
        if (by_rows) take_out<kRows>(i);
      }
      if (!beyond) return;
    }
  }

  /// S = 1 + J D⁻¹ Jᵀ.
  template <int kRows>
  void sum_rows() {
    for (Index j = 0; j < rows_; ++j) {
      Column<kRows> S(sum_.data() + j * stride_, stride_);
      if constexpr (kRows == Eigen::Dynamic) {
        S.setConstant(Scalar(0));
        for (Index i = 0; i < n_; ++i) S += (weights_[i] * column<kRows>(i)[j]) * column<kRows>(i);
      } else {
        Eigen::Array<Scalar, kRows, 1> sum = Eigen::Array<Scalar, kRows, 1>::Constant(Scalar(0));
        for (Index i = 0; i < n_; ++i) sum += (weights_[i] * column<kRows>(i)[j]) * column<kRows>(i);
        S = sum;
      }
      S[j] += Scalar(1);
    }
  }
  /// Takes a locked entry's share out of S; a joint moves few tasks.
  template <int kRows>
  void take_out(Index i) {
    const Column<kRows> own = column<kRows>(i);
    for (Index j = 0; j < rows_; ++j) {
      const Scalar share = weights_[i] * own[j];
      if (share < Scalar(0) || share > Scalar(0)) Column<kRows>(sum_.data() + j * stride_, stride_) -= share * own;
    }
  }

  template <int kRows>
  void solve_by_rows(const View& pull, Eigen::Ref<VectorX<Scalar>> step) {
    Column<kRows> right(right_.data(), stride_);
    right = Column<kRows>(left_.data(), stride_);
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] == 0 || (!(pull[i] < Scalar(0)) && !(pull[i] > Scalar(0)))) continue;
      right -= (pull[i] * weights_[i]) * column<kRows>(i);
    }
    factor_.resize(rows_);
    std::copy(sum_.data(), sum_.data() + rows_ * stride_, factor_.column(0));
    factor_.solve(right_.head(rows_));  // S ≥ 1
    for (Index i = 0; i < n_; ++i) {
      if (free_[static_cast<std::size_t>(i)] != 0) step[i] = ((column<kRows>(i) * right).sum() + pull[i]) * weights_[i];
    }
  }

  /// The same from (JᵀJ + D) dq = Jᵀ e + r on the free entries: fewer than rows.
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

}  // namespace clothctl::robot
