#pragma once

// Proves straight motions in joint space free of collisions. Let reach_i (m per unit of joint i)
// bound how far any point of the robot moves per unit of that joint. On the straight motion from a
// to b no point then goes farther than
//
//   way(a, b) = Σ_i reach_i |a_i - b_i|   (m).
//
// Let room(q) = clearance(q) - margin. A posture whose way from q is at most room(q) thus has at
// least the margin's clearance. On a motion, parametrised by its way, q covers an interval of the
// half length room(q). What the intervals of both ends leave is a gap; the posture in its middle
// covers a part, and leaves two smaller gaps, or has no room, and the motion is not free. Gaps up
// to `resolution` are left: both ends of such a gap have the margin's clearance, so that within it
//
//   clearance ≥ margin - resolution / 2.

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Returns Σ reach_i |a_i - b_i| (m).
template <RealScalar Scalar>
Scalar joint_way(const VectorX<Scalar>& a, const VectorX<Scalar>& b, const VectorX<Scalar>& reach) {
  using std::abs;
  Scalar sum(0);
  for (Index i = 0; i < reach.size(); ++i) sum += reach[i] * abs(a[i] - b[i]);
  return sum;
}

/// A posture of a path or of a tree, and its clearance.
template <RealScalar Scalar>
struct Posture {
  /// Joint positions (m or rad).
  VectorX<Scalar> q;
  /// Distance from obstacles, or a lower bound of it (m, finite).
  Scalar clearance = Scalar(0);
};

/// Asks a clearance, and checks motions by it. Refers to the clearance and to `reach`.
template <RealScalar Scalar, class Clearance>
class MotionCheck {
 public:
  /// Checks with a margin (m), leaving gaps up to `resolution` (m, > 0).
  MotionCheck(Clearance& clearance, const VectorX<Scalar>& reach, const Scalar& margin,
              const Scalar& resolution)
      : clearance_(clearance), reach_(reach), margin_(margin), resolution_(resolution) {}

  /// Returns the posture q with its clearance. A NaN counts as a collision, and is remembered.
  Posture<Scalar> posture(VectorX<Scalar> q) {
    Posture<Scalar> p{std::move(q), Scalar(0)};
    p.clearance = ask(p.q);
    return p;
  }
  /// Returns whether a posture has less clearance than the margin.
  bool collides(const Posture<Scalar>& p) const { return p.clearance < margin_; }
  /// Returns whether the straight motion from a to b is free. Complexity: at most about way /
  /// resolution queries; few where there is much room.
  bool is_free(const Posture<Scalar>& a, const Posture<Scalar>& b) {
    if (collides(a) || collides(b)) return false;
    const Scalar total = way(a.q, b.q);
    gaps_.clear();
    leave(a.clearance - margin_, total - (b.clearance - margin_));
    // The widest gaps first, so that an obstacle is found early.
    for (std::size_t next = 0; next < gaps_.size(); ++next) {
      const Gap gap = gaps_[next];
      const Scalar middle = gap.begin + Scalar(0.5) * (gap.end - gap.begin);
      q_ = a.q + (middle / total) * (b.q - a.q);
      const Scalar half = ask(q_) - margin_;
      if (half < Scalar(0)) return false;
      // Where rounding leaves no posture within a gap there is nothing to check.
      if (!(gap.begin < middle) || !(middle < gap.end)) continue;
      leave(gap.begin, middle - half);
      leave(middle + half, gap.end);
    }
    return true;
  }
  /// Returns way(a, b) (m).
  Scalar way(const VectorX<Scalar>& a, const VectorX<Scalar>& b) const {
    return joint_way(a, b, reach_);
  }

  /// How far a point moves per unit of a joint (m).
  const VectorX<Scalar>& reach() const { return reach_; }
  /// How often the clearance was asked.
  long queries() const { return queries_; }
  /// True when a clearance was NaN.
  bool broken() const { return broken_; }
  /// The first posture whose clearance was NaN.
  const VectorX<Scalar>& broken_at() const { return broken_at_; }

 private:
  /// A part of a motion that is not covered, as ways from its start (m).
  struct Gap {
    Scalar begin, end;
  };

  Scalar ask(const VectorX<Scalar>& q) {
    ++queries_;
    Scalar clearance = static_cast<Scalar>(clearance_(q));
    if (!is_finite(clearance)) {
      if (!is_unbounded(clearance)) {
        if (!broken_) broken_at_ = q;
        broken_ = true;
        return Scalar(-1e20);
      }
      // A large finite number serves as well, and can be added.
      clearance = Scalar(0) < clearance ? Scalar(1e20) : Scalar(-1e20);
    }
    return clearance;
  }
  void leave(const Scalar& begin, const Scalar& end) {
    if (resolution_ < end - begin) gaps_.push_back({begin, end});
  }

  Clearance& clearance_;
  const VectorX<Scalar>& reach_;
  Scalar margin_, resolution_;
  std::vector<Gap> gaps_;
  VectorX<Scalar> q_, broken_at_;
  long queries_ = 0;
  bool broken_ = false;
};

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
