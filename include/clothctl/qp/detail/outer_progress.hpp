#pragma once

// Tells whether the outer steps of the proximal method still lead anywhere. Each step costs time,
// but the budget counts only rounds that change a set. So a solve that rounding errors keep from
// its tolerances would go on for as many steps as the method allows.

#include <algorithm>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns true when the first n entries moved by more than rounding.
template <RealScalar Scalar>
bool has_moved(Index n, const VectorX<Scalar>& from, const VectorX<Scalar>& to) {
  using std::abs;
  Scalar step(0), size(0);
  for (Index j = 0; j < n; ++j) {
    step = (std::max)(step, Scalar(abs(to[j] - from[j])));
    size = (std::max)(size, Scalar(abs(to[j])));
  }
  return step > Scalar(4) * scalar_traits<Scalar>::epsilon() * size;
}

/// Counts successive outer steps without progress: no set changed, and neither of the two ratios
/// fell.
template <RealScalar Scalar>
class OuterProgress {
 public:
  /// Begins a run.
  void restart() {
    least_dual_ = least_primal_ = last_dual_ = scalar_traits<Scalar>::infinity();
    still_ = 0;
    slow_ = 0;
    lowered_ = spoilt_ = false;
  }

  /// Adds a step. `dual` and `primal` are the stationarity residual and the residual of the rows,
  /// both divided by their tolerances. `changed`: a set changed; `moved`: x did.
  void add(const Scalar& dual, const Scalar& primal, bool changed, bool moved) {
    const bool dual_falls = fall(least_dual_, dual), primal_falls = fall(least_primal_, primal);
    still_ = dual_falls || primal_falls || changed ? 0 : still_ + (moved ? 1 : kUnmoved);
    const bool limited = dual > Scalar(1) && !(primal > Scalar(1));
    slow_ = limited && !(dual < Scalar(0.5) * last_dual_) ? slow_ + 1 : 0;
    last_dual_ = dual;
  }

  /// Returns true when the last steps made no progress.
  bool stalled() const { return still_ > kStill; }
  /// Returns true when the rows are met, and several steps in a row did not halve the stationarity
  /// residual: the proximal term limits them.
  bool slow() const { return slow_ > kSlow && !spoilt_; }

  /// Notes that ρ was lowered because steps were slow.
  void set_lowered() { lowered_ = true; }
  /// Adds the stationarity residual of a step before it is refined. Returns true when ρ was lowered
  /// before the step, and the residual is far larger than in the step before: rounding errors of
  /// the factor count with such a ρ. Steps are not called slow any more in this run.
  bool is_spoilt_by(const Scalar& stationarity) {
    const bool spoilt = lowered_ && stationarity > Scalar(10) * last_stationarity_;
    spoilt_ = spoilt_ || spoilt;
    lowered_ = false;
    last_stationarity_ = stationarity;
    return spoilt;
  }

 private:
  /// Steps that do not move x count kUnmoved times: rounding errors decide what they find.
  static constexpr int kStill = 40, kUnmoved = 5, kSlow = 4;

  /// Lowers `least` to `value`, and returns true if it fell by more than a hundredth. What is
  /// within the tolerance need not fall.
  static bool fall(Scalar& least, const Scalar& value) {
    const Scalar now = (std::max)(Scalar(1), value);
    if (!(now < Scalar(0.99) * least)) return false;
    least = now;
    return true;
  }

  Scalar least_dual_ = scalar_traits<Scalar>::infinity();
  Scalar least_primal_ = scalar_traits<Scalar>::infinity();
  Scalar last_dual_ = scalar_traits<Scalar>::infinity();
  Scalar last_stationarity_ = scalar_traits<Scalar>::infinity();
  int still_ = 0;
  int slow_ = 0;
  bool lowered_ = false, spoilt_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
