#pragma once

// Errors of single unknowns and rows of the proximal problem, each judged on its own scale. The
// residuals of kkt.hpp are relative to the largest terms of all unknowns or rows. One huge entry,
// such as a multiplier that a warm start kept, can therefore hide the error of a small one. Here
// the error of an entry is compared with
//
//   unknown j:  tolerance · max(|Hx|_j, |g|_j) + rounding · (|H||x| + |g| + |Aᵀ||y|)_j
//   row i:      tolerance · max(|Ax|_i, |edge|_i) + rounding · (|A||x|)_i
//
// An unknown whose |Hx|_j and |g|_j are no larger than rounding has no scale of its own. Its error
// is compared with the largest |Hx| and |g| of all unknowns.
//
// The edge of a row is the bound that it violates, or that its multiplier belongs to. Multipliers
// count only with the small factor for rounding. All of this holds in scaled space, and so does not
// depend on the units of unknowns and rows.

#include <algorithm>

#include "clothctl/qp/detail/proximal_problem.hpp"
#include "clothctl/qp/kkt.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The result of the comparison.
template <RealScalar Scalar>
struct EntrywiseErrors {
  /// True when no error is above its own limit.
  bool met = true;
  /// The smallest max(|Hx|_j, |g|_j) of the unknowns whose error is above the limit and at least
  /// half as large as this; infinite when there is none. Such unknowns have hardly moved towards
  /// their minimum yet.
  Scalar least_slope = scalar_traits<Scalar>::infinity();
};

/// Judges the errors of single entries at the iterate of a proximal problem.
template <RealScalar Scalar>
class EntrywiseJudge {
 public:
  using Problem = ProximalProblem<Scalar>;
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) { limit_.setZero(n); }

  /// Compares all errors with their limits. The products in `problem` and its `gradient` Hx + g -
  /// Aᵀy must be up to date. Never allocates. Complexity: O(n + nnz(A)).
  EntrywiseErrors<Scalar> judge(const Problem& problem, const QpSettings<Scalar>& settings,
                                const Vector& gradient) {
    using std::abs;
    EntrywiseErrors<Scalar> errors;
    set_limits(problem, settings);
    for (Index j = 0; j < problem.unknowns(); ++j) {
      const Scalar z = bound_multiplier(gradient[j], problem.x[j], problem.lo[j], problem.hi[j]);
      const Scalar error = abs(gradient[j] - z);
      if (error <= limit_[j]) continue;
      errors.met = false;
      if (error >= Scalar(0.5) * slope(problem, j) && limit_[j] < Scalar(0.5) * slope(problem, j))
        errors.least_slope = (std::min)(errors.least_slope, slope(problem, j));
    }
    for (Index i = 0; errors.met && i < problem.rows(); ++i)
      errors.met = row_is_met(problem, settings, i);
    return errors;
  }

 private:
  /// Times the spacing of numbers: what rounding may add to a sum, relative to its terms.
  static constexpr int kRounding = 256;

  static Scalar rounding() { return Scalar(kRounding) * scalar_traits<Scalar>::epsilon(); }

  static Scalar slope(const Problem& problem, Index j) {
    using std::abs;
    return (std::max)(Scalar(abs(problem.hx[j])), Scalar(abs(problem.g[j])));
  }

  void set_limits(const Problem& problem, const QpSettings<Scalar>& settings) {
    using std::abs;
    const Scalar length = problem.length_of_x();
    Scalar steepest(0);
    for (Index j = 0; j < problem.unknowns(); ++j)
      steepest = (std::max)(steepest, slope(problem, j));
    for (Index j = 0; j < problem.unknowns(); ++j) {
      const Scalar terms = problem.root_of_diagonal(j) * length + abs(problem.g[j]) +
                           problem.columns_of_A().size_of_dot(j, problem.y);
      const Scalar own = slope(problem, j), scale = own > rounding() * terms ? own : steepest;
      limit_[j] = settings.stationarity_tolerance * scale + rounding() * terms;
    }
  }

  /// Returns true when row i is not violated, and its slack is zero if its multiplier is not.
  bool row_is_met(const Problem& problem, const QpSettings<Scalar>& settings, Index i) const {
    using std::abs;
    const Scalar ax = problem.ax[i], y = problem.y[i], rl = problem.rl[i], ru = problem.ru[i];
    const bool low = has_bound(rl) && ax < rl, high = has_bound(ru) && ax > ru;
    const bool pulls = y > Scalar(0) || y < Scalar(0);
    if (!low && !high && !pulls) return true;
    const Scalar edge = low ? rl : high ? ru : y > Scalar(0) ? rl : ru;
    const Scalar error = abs(edge - ax);
    const Scalar size = (std::max)(Scalar(abs(ax)), Scalar(abs(edge)));
    if (error <= settings.feasibility_tolerance * size) return true;
    if (error <= rounding() * (size + problem.columns_of_At().size_of_dot(i, problem.x)))
      return true;
    return !low && !high && is_negligible(problem, i);
  }

  /// Returns true when the multiplier of row i is too small to matter to any unknown.
  bool is_negligible(const Problem& problem, Index i) const {
    using std::abs;
    for (Index j = 0; j < problem.unknowns(); ++j) {
      if (abs(problem.At()(j, i) * problem.y[i]) > limit_[j]) return false;
    }
    return true;
  }

  Vector limit_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
