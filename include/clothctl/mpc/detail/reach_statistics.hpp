#pragma once

// What a target asks of a sheet and its hands, frame by frame: the figures from which reachability
// is judged.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>

#include "clothctl/contact/grip.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/mpc/hand_anchor.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A running mean of squares.
template <RealScalar Scalar>
class MeanSquare {
 public:
  /// Adds a value.
  void add(const Scalar& value) {
    sum_ += value * value;
    count_ += Scalar(1);
  }
  /// Returns the root of the mean; 0 without values.
  Scalar root() const {
    using std::sqrt;
    return Scalar(0) < count_ ? Scalar(sqrt(sum_ / count_)) : Scalar(0);
  }

 private:
  Scalar sum_ = Scalar(0), count_ = Scalar(0);
};

/// Points at three times, a frame apart.
template <RealScalar Scalar>
struct ThreeFrames {
  /// Points at t - h, t and t + h, 3×n, m.
  Points<Scalar> before, now, after;

  /// Makes room for `count` points. Allocates.
  void reserve(Index count) {
    before.setZero(3, count);
    now.setZero(3, count);
    after.setZero(3, count);
  }
  /// Moves on by a frame; `after` is then to be filled.
  void shift() {
    before.swap(now);
    now.swap(after);
  }
  /// Returns the velocity of a point over `dt` on each side, m/s.
  Vector3<Scalar> velocity(Index i, const Scalar& dt) const {
    return (after.col(i) - before.col(i)) / (Scalar(2) * dt);
  }
  /// Returns the acceleration of a point, m/s².
  Vector3<Scalar> acceleration(Index i, const Scalar& dt) const {
    return (after.col(i) - Scalar(2) * now.col(i) + before.col(i)) / (dt * dt);
  }
};

/// Weights of the predicted error, fitted by `examples/reachability --seeds 800` (reachability.hpp).
template <RealScalar Scalar>
struct ReachWeights {
  Scalar excess = Scalar(1.34), hand = Scalar(0.23), close = Scalar(0.23), fall = Scalar(0.05);
};

/// Collects the figures of a curve. `Limits`: ReachLimits, `Report`: ReachabilityReport.
template <class Limits, class Report>
class ReachStatistics {
 public:
  using Scalar = decltype(Limits::dt);

  /// Prepares for a curve within `limits`, which are good and stay alive. Allocates.
  explicit ReachStatistics(const Limits& limits)
      : limits_(limits),
        features_(static_cast<double>(limits.count())) {
    targets_.reserve(limits.count());
    hands_.reserve(static_cast<Index>(limits.anchors.size()));
  }

  /// Adds the frame at time `t` (s); frames come one after the other. Returns an empty string, or
  /// which target is not finite. Allocates only for that.
  template <class Target>
  std::string add(const Target& target, const Scalar& t) {
    for (int k = frames_ == 0 ? -1 : 1; k <= 1; ++k) {
      targets_.shift();
      hands_.shift();
      const std::string problem = sample(target, t + Scalar(static_cast<double>(k)) * limits_.dt);
      if (!problem.empty()) return problem;
    }
    if (frames_ == 0) add_start(t);
    ++frames_;
    const Scalar apart = add_distances(t), away = add_places(t);
    total_least_ += apart < away ? away : apart;
    add_features(t);
    add_hands(t);
    return {};
  }

  /// Returns the figures and the predicted error for the curve so far, without the verdict.
  Report judge(const Scalar& tolerance) const;

 private:
  static Scalar positive(const Scalar& x) { return Scalar(0) < x ? x : Scalar(0); }
  static Scalar length(const Vector3<Scalar>& v) {
    using std::sqrt;
    return sqrt(v.squaredNorm());
  }

  /// Fills the last of the three frames with targets and hands of time `t`.
  template <class Target>
  std::string sample(const Target& target, const Scalar& t) {
    for (Index i = 0; i < limits_.count(); ++i) {
      targets_.after.col(i) = target(i, t);
      if (!all_finite(targets_.after.col(i)))
        return "the target of feature " + std::to_string(i) + " at " + number_text(t) +
               " s is not finite";
    }
    for (std::size_t g = 0; g < limits_.anchors.size(); ++g) {
      const Vector3<Scalar> hand = anchor_position(limits_.anchors[g], limits_.heavy_chain_axes,
                                                   limits_.gravity, target, t);
      hands_.after.col(static_cast<Index>(g)) = hand;
      if (!all_finite(hand))
        return "a target within " + number_text(t) + " s and a swing of the sheet is not finite";
    }
    return {};
  }

  void add_start(const Scalar& t) {
    for (Index i = 0; i < limits_.count(); ++i)
      report_.start_gap.raise(length(targets_.now.col(i) - limits_.features.col(i)), t,
                              static_cast<int>(i));
  }

  /// Judges the distances of features. Returns the least mean error of this frame.
  Scalar add_distances(const Scalar& t);
  /// Judges where features are. Returns the least mean error of this frame.
  Scalar add_places(const Scalar& t);

  void add_features(const Scalar& t) {
    for (Index i = 0; i < limits_.count(); ++i) {
      const Vector3<Scalar> acceleration = targets_.acceleration(i, limits_.dt);
      const Scalar fall = positive(-acceleration[2] - limits_.gravity);
      fall_.add(fall);
      report_.fall_excess.raise(fall, t, static_cast<int>(i));
      report_.speed.raise(length(targets_.velocity(i, limits_.dt)), t, static_cast<int>(i));
      report_.acceleration.raise(length(acceleration), t, static_cast<int>(i));
    }
  }

  void add_hands(const Scalar& t) {
    const Vector3<Scalar> across = targets_.now.col(limits_.count() - 1) - targets_.now.col(0);
    for (std::size_t g = 0; g < limits_.anchors.size(); ++g) {
      const Index i = static_cast<Index>(g);
      const Vector3<Scalar> velocity = hands_.velocity(i, limits_.dt);
      for (int axis = 0; axis < 3; ++axis) {
        const Scalar speed = velocity[axis] < Scalar(0) ? Scalar(-velocity[axis]) : velocity[axis];
        report_.hand_speed.raise(speed, t, static_cast<int>(g));
        report_.hand_speed_excess.raise(speed - limits_.max_hand_speed, t, static_cast<int>(g));
      }
      const Scalar acceleration =
          length(swing_part(limits_.anchors[g], limits_.heavy_chain_axes, across,
                            hands_.acceleration(i, limits_.dt)));
      hand_.add(acceleration);
      report_.hand_acceleration.raise(acceleration, t, static_cast<int>(g));
    }
  }

  const Limits& limits_;
  const Scalar features_;  // their number
  ThreeFrames<Scalar> targets_, hands_;
  MeanSquare<Scalar> hand_, close_, fall_;
  Scalar total_excess_ = Scalar(0), total_least_ = Scalar(0);
  Index frames_ = 0;
  Report report_;
};

template <class Limits, class Report>
auto ReachStatistics<Limits, Report>::add_distances(const Scalar& t) -> Scalar {
  Scalar excess = Scalar(0), least = Scalar(0), close = Scalar(0);
  for (Index i = 0; i < limits_.count(); ++i) {
    for (Index j = i + 1; j < limits_.count(); ++j) {
      const Scalar& way = limits_.feature_lengths(i, j);
      const Scalar apart = length(targets_.now.col(i) - targets_.now.col(j));
      const Scalar first = length(limits_.features.col(i) - limits_.features.col(j));
      close = (std::max)(close, first - apart);
      if (is_unbounded(way)) continue;
      const Scalar beyond = apart - way * (Scalar(1) + limits_.stretch);
      excess = (std::max)(excess, apart - way);
      least = (std::max)(least, beyond);
      report_.distance_excess.raise(beyond, t, static_cast<int>(i));
    }
  }
  close_.add(close);
  total_excess_ += excess / features_;
  return least / features_;
}

template <class Limits, class Report>
auto ReachStatistics<Limits, Report>::add_places(const Scalar& t) -> Scalar {
  Scalar total = Scalar(0);
  for (Index i = 0; i < limits_.count(); ++i) {
    Scalar beyond = positive(limits_.floor - targets_.now(2, i));
    for (const GripLimit<Scalar>& limit : limits_.grip_limits) {
      const Scalar& way = limits_.grip_lengths(i, limit.grip);
      if (limit.other != -1 || is_unbounded(way)) continue;
      const Scalar most = limit.most + way * (Scalar(1) + limits_.stretch);
      beyond = (std::max)(beyond, limit.normal.dot(targets_.now.col(i)) - most);
    }
    report_.place_excess.raise(beyond, t, static_cast<int>(i));
    total += beyond;
  }
  return total / features_;
}

template <class Limits, class Report>
auto ReachStatistics<Limits, Report>::judge(const Scalar& tolerance) const -> Report {
  using std::sqrt;
  const ReachWeights<Scalar> w;
  const Scalar frames = Scalar(static_cast<double>(frames_ < 1 ? 1 : frames_));
  const Scalar swing = limits_.size() / limits_.gravity;  // L/g, s²
  const Scalar hand = w.hand * swing * hand_.root(), close = w.close * close_.root();
  const Scalar fall = w.fall * swing * fall_.root();
  // A gap at the start closes within about the time τ in which a swing goes down the sheet.
  const Scalar settles = Scalar(2) * sqrt(swing) / (frames * limits_.dt);
  const Scalar gap =
      report_.start_gap.value * (settles < Scalar(1) ? settles : Scalar(1));
  Report report = report_;
  report.least_error = total_least_ / frames;
  report.predicted_error = gap + w.excess * total_excess_ / frames +
                           sqrt(hand * hand + close * close + fall * fall);
  report.predicted_error = (std::max)(report.predicted_error, report.least_error);
  const Scalar ratio = report.predicted_error / tolerance, square = ratio * ratio;
  report.score = report.least_error > tolerance ? Scalar(0)
                                                : Scalar(1) / (Scalar(1) + square * square);
  return report;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
