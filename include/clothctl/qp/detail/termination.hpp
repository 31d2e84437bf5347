#pragma once

// Termination tests: the ratio of residuals to tolerances, the status that follows from it, and the
// best iterate of a solve that reaches a limit.

#include <algorithm>

#include "clothctl/qp/kkt.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// An inaccurate solution may exceed the tolerances by this factor.
inline constexpr int kLooseTolerances = 1000;

/// Returns the largest ratio of a residual to its tolerance. At most one means solved. Infinite
/// when a residual is not finite.
template <RealScalar Scalar>
Scalar residual_ratio(const KktResiduals<Scalar>& r, const QpSettings<Scalar>& settings) {
  return (std::max)(
      Scalar(r.relative_stationarity / settings.stationarity_tolerance),
      (std::max)(Scalar(r.relative_feasibility / settings.feasibility_tolerance),
                 Scalar(r.relative_complementarity / settings.complementarity_tolerance)));
}

/// The same ratio for feasibility and complementarity only, the residuals that depend on the rows.
template <RealScalar Scalar>
Scalar row_residual_ratio(const KktResiduals<Scalar>& r, const QpSettings<Scalar>& settings) {
  return (std::max)(Scalar(r.relative_feasibility / settings.feasibility_tolerance),
                    Scalar(r.relative_complementarity / settings.complementarity_tolerance));
}

/// Writes the residuals of the caller's data into the result. If the status of the result is
/// Solved, IterationLimit or TimeLimit, the residuals decide the new status. Other statuses stay.
template <RealScalar Scalar>
void conclude(const KktResiduals<Scalar>& r, const QpSettings<Scalar>& settings,
              QpResult<Scalar>& result) {
  result.stationarity = r.relative_stationarity;
  result.feasibility = r.relative_feasibility;
  result.complementarity = r.relative_complementarity;
  result.objective = r.objective;
  const bool unfinished =
      result.status == QpStatus::IterationLimit || result.status == QpStatus::TimeLimit;
  if (result.status != QpStatus::Solved && !unfinished) return;
  using std::abs;
  bool too_far = false;
  for (Index j = 0; j < result.x.size(); ++j)
    too_far = too_far || !(Scalar(abs(result.x[j])) < largest_bound<Scalar>());
  const Scalar ratio = too_far ? scalar_traits<Scalar>::infinity() : residual_ratio(r, settings);
  if (ratio <= Scalar(1)) {
    result.status = QpStatus::Solved;
  } else if (ratio <= Scalar(kLooseTolerances)) {
    result.status = QpStatus::SolvedInaccurate;
  } else if (!unfinished) {
    result.status = QpStatus::IterationLimit;
  }
}

/// Writes the active set into the result. It follows from x, the multipliers, the loaded bounds lo,
/// hi of the unknowns, and rl, ru of the rows.
template <RealScalar Scalar>
void write_active_set(const VectorX<Scalar>& lo, const VectorX<Scalar>& hi,
                      const VectorX<Scalar>& rl, const VectorX<Scalar>& ru,
                      QpResult<Scalar>& result) {
  const Scalar zero(0);
  for (Index j = 0; j < result.x.size(); ++j) {
    QpSide& side = result.bound_sides[static_cast<std::size_t>(j)];
    const Scalar z = result.bound_multipliers[j];
    if (!(lo[j] < hi[j])) {
      side = z < zero ? QpSide::Upper : QpSide::Lower;
    } else {
      side = !(result.x[j] > lo[j])   ? QpSide::Lower
             : !(result.x[j] < hi[j]) ? QpSide::Upper
                                      : QpSide::Between;
    }
  }
  for (Index i = 0; i < result.row_multipliers.size(); ++i) {
    const Scalar y = result.row_multipliers[i];
    const bool fixed = !(rl[i] < ru[i]);
    result.row_sides[static_cast<std::size_t>(i)] = y < zero            ? QpSide::Upper
                                                    : y > zero || fixed ? QpSide::Lower
                                                                        : QpSide::Between;
  }
}

/// The best iterate of a solve. Iterates whose residual_ratio is at most kLooseTolerances rank
/// first, and are compared by this ratio. Other iterates are compared by violation first;
/// violations within the tolerance count as equal, and the ratio then decides.
template <RealScalar Scalar>
class BestIterate {
 public:
  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    x_.setZero(n);
    y_.setZero(m);
    forget();
  }

  /// Discards the iterate before a new solve.
  void forget() { rank_ = {}; }
  /// Returns true when there is an iterate.
  bool known() const { return is_finite(rank_.residual_ratio); }
  /// The residual_ratio of the best iterate.
  const Scalar& ratio() const { return rank_.residual_ratio; }
  /// The unknowns of the best iterate. As many leading entries are in use as `offer` got.
  const VectorX<Scalar>& x() const { return x_; }
  /// The row multipliers of the best iterate.
  const VectorX<Scalar>& y() const { return y_; }

  /// Keeps a copy of (x, y) with residuals r if it is the best so far. Never allocates.
  void offer(const KktResiduals<Scalar>& r, const QpSettings<Scalar>& settings,
             const Eigen::Ref<const VectorX<Scalar>>& x,
             const Eigen::Ref<const VectorX<Scalar>>& y) {
    Rank rank;
    rank.residual_ratio = residual_ratio(r, settings);
    if (!is_finite(rank.residual_ratio)) return;
    if (rank.residual_ratio <= Scalar(kLooseTolerances)) rank.close = rank.residual_ratio;
    rank.violation =
        (std::max)(Scalar(1), Scalar(r.relative_feasibility / settings.feasibility_tolerance));
    if (!rank.before(rank_)) return;
    rank_ = rank;
    std::copy_n(x.data(), x.size(), x_.data());
    std::copy_n(y.data(), y.size(), y_.data());
  }

 private:
  struct Rank {
    Scalar close = scalar_traits<Scalar>::infinity();
    Scalar violation = scalar_traits<Scalar>::infinity();
    Scalar residual_ratio = scalar_traits<Scalar>::infinity();
    bool before(const Rank& other) const {
      if (close < other.close || other.close < close) return close < other.close;
      if (violation < other.violation || other.violation < violation)
        return violation < other.violation;
      return residual_ratio < other.residual_ratio;
    }
  };

  VectorX<Scalar> x_, y_;
  Rank rank_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
