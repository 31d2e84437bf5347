#pragma once

// What the hand anchors learn of a constant error of the features:
//
//   s <- s + (h / 2 s) (ȳ - y - s)            slow error of each feature
//   o <- o + (h / T) Σ_i w_i s_i              offset of each anchor, w: its weights of the features
//
// y: measured features, ȳ: their targets, h: length of a frame, T: time given by the settings. A
// strong anchor ends the feedback, so that a sheet that hangs beside its targets stays there, as
// one does that has left the fold in which it started. The slow error keeps swings out, which an
// integral alone would feed in a lightly damped sheet. Offsets learn at most a tenth of the hanging
// length along each axis, since targets that cannot be reached leave an error that no offset mends.

#include <vector>

#include "clothctl/mpc/hand_anchor.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Learns offsets of anchors.
template <RealScalar Scalar>
class AnchorOffset {
 public:
  /// Makes room and starts anew. Allocates.
  void reserve(Index features, Index grips) {
    slow_.setZero(3, features);
    learned_.setZero(3, grips);
  }

  /// Forgets what was learned. Never allocates.
  void reset() {
    learned_.setZero();
    slow_.setZero();
  }

  /// Returns what the anchor of grip `g` has learned, to be added to the place of the hand, m.
  Vector3<Scalar> learned(std::size_t g) const { return learned_.col(static_cast<Index>(g)); }

  /// Learns from a frame of length `dt` (s), with features that should be at `wanted` and are at
  /// `measured` (3×features, m). `time`: T, s. Never allocates.
  void learn(Scalar dt, Scalar time, const Points<Scalar>& wanted, const Points<Scalar>& measured,
             const std::vector<HandAnchor<Scalar>>& anchors) {
    const Scalar slowly = dt < Scalar(kMemory) ? dt / Scalar(kMemory) : Scalar(1);
    const Scalar gain = dt < time ? dt / time : Scalar(1);
    for (Index i = 0; i < slow_.cols(); ++i)
      slow_.col(i) += slowly * (wanted.col(i) - measured.col(i) - slow_.col(i));
    for (std::size_t g = 0; g < anchors.size(); ++g) {
      const HandAnchor<Scalar>& anchor = anchors[g];
      auto learned = learned_.col(static_cast<Index>(g));
      const Scalar most = Scalar(kMost) * anchor.hanging_length;
      for (Index c = 0; c < 3; ++c) {
        Scalar next = learned[c];
        for (std::size_t i = 0; i < anchor.feature_weights.size(); ++i)
          next += gain * anchor.feature_weights[i] * slow_(c, static_cast<Index>(i));
        if (most < next) next = most;
        if (next < -most) next = -most;
        learned[c] = next;
      }
    }
  }

 private:
  static constexpr double kMemory = 2.0;  // of the slow error, s
  static constexpr double kMost = 0.1;    // share of the hanging length

  Points<Scalar> slow_, learned_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
