#pragma once

// The weight of the change from the last plan. Plans of forces that change the motion of the hands
// too much are made again with a larger weight, which then fades from frame to frame. It stays
// bounded: a weight without bound stops the hands, which then have to make up for more and more.

#include "clothctl/core/scalar.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Weight of the term `step`, s²/m².
template <RealScalar Scalar>
class StepDamping {
 public:
  /// The weight of the next attempt.
  const Scalar& weight() const { return weight_; }

  /// Starts a frame whose settings ask for the weight `given`; without a last plan it is zero.
  void start(const Scalar& given, bool has_plan) {
    attempts_ = 0;
    given_ = given;
    weight_ *= Scalar(0.5);
    if (weight_ < least() || weight_ < given) weight_ = given;
    if (!has_plan) weight_ = Scalar(0);
  }

  /// Makes the weight four times as large. Returns false and changes nothing when there were enough
  /// attempts or the weight is as large as it may be.
  bool raise() {
    const Scalar base = given_ < least() ? least() : given_, most = Scalar(kMostGrowth) * base;
    if (attempts_ == kMostAttempts || !(weight_ < most)) return false;
    ++attempts_;
    weight_ *= Scalar(4);
    if (weight_ < base) weight_ = base;
    if (most < weight_) weight_ = most;
    return true;
  }

  /// Forgets earlier frames.
  void reset() { weight_ = Scalar(0); }

 private:
  static constexpr int kMostAttempts = 4;
  static constexpr double kMostGrowth = 64;
  /// Where damping starts when the settings ask for less.
  static Scalar least() { return Scalar(1e-4); }

  Scalar weight_ = Scalar(0), given_ = Scalar(0);
  int attempts_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
