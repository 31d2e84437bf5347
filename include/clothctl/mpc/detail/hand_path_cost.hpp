#pragma once

// The part of the cost of a whole curve that only the paths of the hands enter. Coordinate by
// coordinate, with the places p_k of a hand at the ends of the frames k = 1..N,
//
//   Σ_k  w_m |ċ_k|² + w_s |ċ_k - ċ_{k-1}|² + w_j |ċ_k - 2 ċ_{k-1} + ċ_{k-2}|² + w_h |p_k - p̄_k|²
//
// ċ_k = (p_k - p_{k-1})/h. Places before the first frame: p_{-i} = p_0 - i h ċ_0. Its Hessian is
// the same banded matrix for every coordinate.

#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Cost of paths, matrices of 3·grips × frames, m.
template <RealScalar Scalar>
class HandPathCost {
 public:
  /// Paths that start at `place` with the velocity `velocity` (3×grips each, m, m/s). `anchors`:
  /// p̄, or no columns without an anchor. `dt`: length of a frame, s. Allocates.
  HandPathCost(const PlannerWeights<Scalar>& weights, Scalar dt, const Points<Scalar>& place,
               const Points<Scalar>& velocity, MatrixX<Scalar> anchors)
      : anchors_(std::move(anchors)), past_(3 * place.cols(), kMostPast) {
    for (Index i = 0; i < kMostPast; ++i) {
      for (Index r = 0; r < past_.rows(); ++r)
        past_(r, i) = place.data()[r] - Scalar(static_cast<double>(i)) * dt * velocity.data()[r];
    }
    const Scalar rate = Scalar(1) / (dt * dt);
    add(weights.velocity * rate, {1.0, -1.0, 0.0, 0.0}, false);
    add(weights.smooth * rate, {1.0, -2.0, 1.0, 0.0}, false);
    add(weights.jerk * rate, {1.0, -3.0, 3.0, -1.0}, false);
    if (anchors_.cols() > 0) add(weights.anchor, {1.0, 0.0, 0.0, 0.0}, true);
  }

  /// Returns the cost of `path`.
  Scalar cost(const MatrixX<Scalar>& path) const {
    Scalar sum = Scalar(0);
    each_row(path, [&](const Term& term, Index r, Index k) {
      const Scalar e = error(term, path, r, k);
      sum += term.weight * e * e;
    });
    return sum;
  }

  /// Adds half the gradient of the cost of `path` to `out` (1/m).
  void add_half_gradient(const MatrixX<Scalar>& path, MatrixX<Scalar>& out) const {
    each_row(path, [&](const Term& term, Index r, Index k) {
      add_transposed(term, error(term, path, r, k), r, k, out);
    });
  }

  /// Adds half the Hessian times `v` to `out`.
  void add_product(const MatrixX<Scalar>& v, MatrixX<Scalar>& out) const {
    each_row(v, [&](const Term& term, Index r, Index k) {
      Scalar e = Scalar(0);
      for (Index i = 0; i < kBand && i <= k; ++i) e += term.b(i) * v(r, k - i);
      add_transposed(term, e, r, k, out);
    });
  }

  /// Factorises half the Hessian of one coordinate plus `shift` (positive, 1/m²) on its diagonal,
  /// for `frames` frames. Allocates when their number changes.
  void factorize(Index frames, const Scalar& shift) {
    using std::sqrt;
    factor_.setZero(kBand, frames);  // entry (i, k): row k, column k - i
    for (Index k = 0; k < frames; ++k) {
      for (const Term& term : terms_) {
        for (Index j = 0; j < kBand && j <= k; ++j) {
          for (Index i = j; i < kBand && i <= k; ++i)
            factor_(i - j, k - j) += term.weight * term.b(i) * term.b(j);
        }
      }
      factor_(0, k) += shift;
    }
    for (Index k = 0; k < frames; ++k) {
      for (Index i = kBand - 1; i >= 0; --i) {
        if (i > k) continue;
        Scalar& entry = factor_(i, k);
        for (Index m = i + 1; m < kBand && m <= k; ++m)
          entry -= factor_(m, k) * factor_(m - i, k - i);
        entry = i > 0 ? Scalar(entry / factor_(0, k - i)) : Scalar(sqrt(entry));
      }
    }
  }

  /// Replaces `v` by the solution of the factorised system, for every coordinate.
  void solve(MatrixX<Scalar>& v) const {
    const Index frames = factor_.cols();
    for (Index k = 0; k < frames; ++k) {
      for (Index i = 1; i < kBand && i <= k; ++i) v.col(k) -= factor_(i, k) * v.col(k - i);
      v.col(k) /= factor_(0, k);
    }
    for (Index k = frames - 1; k >= 0; --k) {
      for (Index i = 1; i < kBand && k + i < frames; ++i)
        v.col(k) -= factor_(i, k + i) * v.col(k + i);
      v.col(k) /= factor_(0, k);
    }
  }

 private:
  static constexpr Index kBand = 4, kMostPast = 3;

  /// Rows e_k = Σ_i b_i p_{k-i}, minus p̄_k where anchored.
  struct Term {
    Scalar weight;
    std::array<double, 4> coefficients;
    bool anchored;
    Scalar b(Index i) const { return Scalar(coefficients[static_cast<std::size_t>(i)]); }
  };

  /// Calls `function(term, r, k)` for each row of each term: coordinate r, frame k.
  template <class Function>
  void each_row(const MatrixX<Scalar>& path, const Function& function) const {
    for (const Term& term : terms_) {
      for (Index k = 0; k < path.cols(); ++k) {
        for (Index r = 0; r < path.rows(); ++r) function(term, r, k);
      }
    }
  }

  Scalar error(const Term& term, const MatrixX<Scalar>& path, Index r, Index k) const {
    Scalar e = term.anchored ? Scalar(-anchors_(r, k)) : Scalar(0);
    for (Index i = 0; i < kBand; ++i)
      e += term.b(i) * (i <= k ? path(r, k - i) : past_(r, i - k - 1));
    return e;
  }

  /// Adds the column of a row, times its weight and `e`.
  static void add_transposed(const Term& term, const Scalar& e, Index r, Index k,
                             MatrixX<Scalar>& out) {
    for (Index i = 0; i < kBand && i <= k; ++i) out(r, k - i) += term.weight * term.b(i) * e;
  }

  void add(const Scalar& weight, const std::array<double, 4>& coefficients, bool anchored) {
    if (Scalar(0) < weight) terms_.push_back({weight, coefficients, anchored});
  }

  std::vector<Term> terms_;
  MatrixX<Scalar> anchors_, past_, factor_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
