#pragma once

// How many frames a window needs.
//
// "The window size is selected empirically. We start with the minimum window size and gradually
// increase it until the resulting motion is above the accuracy threshold. … A rough guideline to
// window size selection is based on how energetic the desired cloth motion is and the distance
// between controllable and feature vertices." ([Bai 2016], section 6; in its figure 9 the error
// settles at 12 frames.) `search_horizon` is that procedure, `suggest_horizon` a guess that needs
// no runs.

#include <cmath>
#include <string>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Returns the number of frames of `dt` (s) after which a longer window gains little, for features
/// that hang `hanging_length` (m) below the hands: the time 1.5 √(L/g), three quarters of that in
/// which a swing travels down a hanging chain, 2 √(L/g). Gravity: m/s². 12 frames of 0.02 s for
/// 0.25 m, 17 for 0.5 m, 24 for 1 m, where the error of closed loops settles (docs/planner.md);
/// violent curves gain by more. At least 1. Returns an error when an argument is not positive, or
/// for more than 10⁴ frames.
template <RealScalar Scalar>
Result<Index> suggest_horizon(Scalar hanging_length, Scalar dt, Scalar gravity = Scalar(9.81)) {
  using std::sqrt;
  const auto bad = [](const Scalar& x) { return !is_finite(x) || !(Scalar(0) < x); };
  if (bad(hanging_length))
    return Error{"the hanging length is " + number_text(hanging_length) + " m, must be positive"};
  if (bad(dt)) return Error{"dt is " + number_text(dt) + " s, must be positive"};
  if (bad(gravity)) return Error{"gravity is " + number_text(gravity) + ", must be positive"};
  const Scalar time = Scalar(1.5) * sqrt(hanging_length / gravity);
  Index frames = 1;
  while (Scalar(static_cast<double>(frames)) * dt < time) {
    if (++frames > 10000) return Error{"a window would need over 10000 frames"};
  }
  return frames;
}

/// What a search for a horizon found.
template <RealScalar Scalar>
struct HorizonSearch {
  /// The first horizon that was accurate enough, else the most accurate one; 0 where no run gave a
  /// finite error.
  Index horizon = 0;
  /// Its error, m.
  Scalar error = Scalar(0);
  /// Whether it was accurate enough.
  bool accurate = false;
};

/// Runs `error(horizon)` (m) for horizons from `first` to `last` in steps of `step` until the error
/// is at most `accuracy` (m): the procedure of [Bai 2016]. An error that is not finite counts as a
/// failed run. Allocates what `error` does. Fails when: first or step is below 1, or
/// the accuracy is not finite (nothing is run).
template <RealScalar Scalar, class MeanError>
HorizonSearch<Scalar> search_horizon(Index first, Index last, Index step, Scalar accuracy,
                                     MeanError&& error) {
  HorizonSearch<Scalar> found;
  if (first < 1 || step < 1 || !is_finite(accuracy)) return found;
  for (Index horizon = first; horizon <= last && !found.accurate; horizon += step) {
    const Scalar now = error(horizon);
    if (!is_finite(now) || (found.horizon != 0 && !(now < found.error))) continue;
    found.horizon = horizon;
    found.error = now;
    found.accurate = now <= accuracy;
  }
  return found;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
