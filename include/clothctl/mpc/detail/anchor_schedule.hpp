#pragma once

// The weight on the hand anchor, scheduled by how far ahead the prediction can be trusted.
//
// The planner corrects an error of the features by what its model says will happen over the window.
// If the model is damped more than the plant, it is right for a frame and wrong half a window
// later: corrections then come out of phase with the swing of the sheet and feed it. Without
// corrections, on the path of the anchor, the sheet is only as restless as its own damping lets
// it be. The schedule therefore compares predictions over m = K/2 frames with what came,
//
//   e = |y - ŷ|,  d = |y - y_{m frames before}|      rms over the features
//   agreement = 1 - √(ē² / max(d̄², (m · 1 mm)²))     means over the last second, at least 0
//   w <- w exp(rate h min(1, (a - agreement) / (1 - a)))  while agreement < a,  w <= most
//
// y: features now, ŷ: what was predicted for now m frames ago, h: length of a frame, a: agreement
// that the settings ask for. The weight does not fall again before a reset: a loop that has fed
// the sheet once would do so again.

#include <cmath>
#include <numbers>

#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Remembers the features and their predictions over half a window, and adapts the anchor weight.
template <RealScalar Scalar>
class AnchorSchedule {
 public:
  /// Makes room and starts anew. Allocates.
  void reserve(Index feature_count, Index horizon) {
    frames_ = horizon < 2 ? 1 : horizon / 2;
    predicted_.setZero(3 * feature_count, frames_);
    measured_ = predicted_;
    reset();
  }

  /// Forgets all, also the weight.
  void reset() {
    forget();
    growth_ = Scalar(1);
    error_ = moved_ = Scalar(0);
  }

  /// Forgets the predictions, which the plant did not follow.
  void forget() { known_ = 0; }

  /// Compares the features measured now (3×features, m) with their prediction of half a window ago.
  /// Writes window_agreement, anchor_weight and losing of `result`. Never allocates.
  void measure(const PlannerSettings<Scalar>& settings, const Points<Scalar>& features,
               PlanResult<Scalar>& result) {
    const Index slot = next_ % frames_;
    if (known_ >= frames_) average(settings.dt, features, slot);
    for (Index i = 0; i < features.cols(); ++i)
      measured_.template block<3, 1>(3 * i, slot) = features.col(i);
    result.window_agreement = agreement();
    raise(settings, result.window_agreement);
    result.anchor_weight = growth_ * settings.weights.anchor;
    result.losing =
        result.window_agreement < Scalar(kLost) ||
        (result.window_agreement < Scalar(kLosing) && !(growth_ < most_growth(settings)));
  }

  /// Keeps the features predicted for half a window ahead, of a 3·features × K matrix, m. Call it
  /// once a frame, after `measure`. Never allocates.
  void predict(const MatrixX<Scalar>& predicted) {
    predicted_.col(next_ % frames_) = predicted.col(frames_ - 1);
    ++next_;
    if (known_ < frames_) ++known_;
  }

 private:
  static constexpr double kMemory = 1.0;                    // time over which is averaged, s
  static constexpr double kRate = 4.0 * std::numbers::ln2;  // of growth, 1/s: 16 times in a second
  // Agreement below which the loop is losing: when the weight cannot grow, and in any case.
  static constexpr double kLosing = 0.7, kLost = 0.5;

  /// Returns how far the weight may grow, as a factor.
  static Scalar most_growth(const PlannerSettings<Scalar>& settings) {
    const Scalar given = settings.weights.anchor, most = settings.most_anchor;
    const bool grows = Scalar(0) < settings.least_agreement && Scalar(0) < given && given < most;
    return grows ? most / given : Scalar(1);
  }

  void average(Scalar dt, const Points<Scalar>& features, Index slot) {
    const Scalar number = Scalar(static_cast<double>(features.cols()));
    Scalar error = Scalar(0), moved = Scalar(0);
    for (Index i = 0; i < features.cols(); ++i) {
      error += (features.col(i) - predicted_.template block<3, 1>(3 * i, slot)).squaredNorm();
      moved += (features.col(i) - measured_.template block<3, 1>(3 * i, slot)).squaredNorm();
    }
    const Scalar share = dt < Scalar(kMemory) ? dt / Scalar(kMemory) : Scalar(1);
    error_ += share * (error / number - error_);
    moved_ += share * (moved / number - moved_);
  }

  Scalar agreement() const {
    using std::sqrt;
    const Scalar floor = Scalar(1e-3 * static_cast<double>(frames_));
    const Scalar moved = moved_ < floor * floor ? floor * floor : moved_;
    const Scalar agreement = Scalar(1) - sqrt(error_ / moved);
    return Scalar(0) < agreement ? agreement : Scalar(0);
  }

  void raise(const PlannerSettings<Scalar>& settings, Scalar agreement) {
    using std::exp;
    const Scalar wanted = settings.least_agreement, most = most_growth(settings);
    if (!(agreement < wanted) || !(growth_ < most)) return;
    Scalar lack = (wanted - agreement) / (Scalar(1) - wanted);
    if (Scalar(1) < lack) lack = Scalar(1);
    growth_ *= exp(Scalar(kRate) * settings.dt * lack);
    if (most < growth_) growth_ = most;
  }

  MatrixX<Scalar> predicted_, measured_;  // by frame, modulo their number
  Index frames_ = 1, next_ = 0, known_ = 0;
  Scalar growth_ = Scalar(1), error_ = Scalar(0), moved_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
