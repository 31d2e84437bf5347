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

/// Returns the message about a target that is not finite. Allocates.
template <RealScalar Scalar>
std::string bad_target_line(Index feature, const Scalar& t) {
  return "the target of feature " + std::to_string(feature) + " at " + number_text(t) +
         " s is not finite";
}

/// Counts the frames of `dt` (s) from `start` to `end` (s), both included. Returns an empty string,
/// or what is wrong with the times. Allocates only for that.
template <RealScalar Scalar>
std::string count_reach_frames(const Scalar& start, const Scalar& end, const Scalar& dt,
                               Index& frames) {
  if (!is_finite(start) || !is_finite(end) || !(start < end))
    return "the curve goes from " + number_text(start) + " s to " + number_text(end) + " s";
  if (!(end - start < Scalar(1e6) * dt)) return "the curve has over a million frames";
  const Scalar last = end + Scalar(1e-3) * dt;  // times are rounded
  for (frames = 0; !(last < start + dt * Scalar(static_cast<double>(frames))); ++frames) {
  }
  return {};
}

/// Counts the `frames` of a curve. Returns an empty string, or what is wrong with the limits, the
/// times or a target, at one of these frames or a frame before or after them. Allocates only for
/// that. `Limits`: ReachLimits.
template <class Limits, class Target, RealScalar Scalar>
std::string open_reach_curve(const Limits& limits, const Target& target, const Scalar& start,
                             const Scalar& end, Index& frames) {
  std::string problem = limits.validate();
  if (problem.empty()) problem = count_reach_frames(start, end, limits.dt, frames);
  if (!problem.empty()) return problem;
  for (Index k = -1; k <= frames; ++k) {
    const Scalar t = start + limits.dt * Scalar(static_cast<double>(k));
    for (Index i = 0; i < limits.count(); ++i) {
      const Vector3<Scalar> place = target(i, t);
      if (!all_finite(place)) return bad_target_line(i, t);
    }
  }
  return {};
}

/// Returns how far `place` (m) is from where a limit of the grips lets a feature be, m; not
/// positive where it does. `Limits`: ReachLimits.
template <RealScalar Scalar, class Limits>
Scalar beyond_grip_limit(const Limits& limits, const GripLimit<Scalar>& limit, Index feature,
                         const Vector3<Scalar>& place) {
  const Scalar& way = limits.grip_lengths(feature, limit.grip);
  if (limit.other != -1 || is_unbounded(way)) return Scalar(0);
  return limit.normal.dot(place) - limit.most - way * (Scalar(1) + limits.stretch);
}

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

/// Weights of a predicted error. They are fitted to seeds 1 to 800 of `examples/reachability` on
/// 9×9 vertices and 1 to 196 on 17×17, each size with equal weight: the likelihood of the successes
/// that the score predicts is largest, less 0.03 of the mean square of the logarithms of errors.
template <RealScalar Scalar>
struct ReachWeights {
  Scalar excess, hand, feature, close, tilt;

  /// Returns the weights of the mean error.
  static ReachWeights mean() {
    return {Scalar(1.57), Scalar(0.183), Scalar(0.0285), Scalar(0.172), Scalar(0.018)};
  }
  /// Returns the weights of the largest error.
  static ReachWeights largest() {
    return {Scalar(2.6), Scalar(0.71), Scalar(0.042), Scalar(0.39), Scalar(0.125)};
  }
  /// Returns the error of causes beyond what is known to be out of reach by `beyond` (m), m.
  /// `Causes`: ReachCauses.
  template <class Causes>
  Scalar error(const Scalar& beyond, const Causes& causes) const {
    using std::sqrt;
    const auto square = [](const Scalar& x) { return Scalar(x * x); };
    return excess * beyond + sqrt(square(hand * causes.hand) + square(feature * causes.feature) +
                                  square(close * causes.close) + square(tilt * causes.tilt));
  }
};

/// Collects the figures of a curve. `Limits`: ReachLimits, `Report`: ReachabilityReport.
template <class Limits, class Report>
class ReachStatistics {
 public:
  using Scalar = decltype(Limits::dt);

  /// Prepares for a curve within `limits`, which are good and stay alive. Allocates.
  explicit ReachStatistics(const Limits& limits)
      : limits_(limits), features_(Scalar(static_cast<double>(limits.count()))) {
    targets_.reserve(limits.count());
    hands_.reserve(static_cast<Index>(limits.anchors.size()));
    lag_.setZero(3, static_cast<Index>(limits.anchors.size()));
  }

  /// Adds the frame at time `t` (s); frames come one after the other. Targets at frames are
  /// finite; returns an empty string, or where one between them is not. Allocates only for that.
  template <class Target>
  std::string add(const Target& target, const Scalar& t) {
    for (int k = frames_ == 0 ? -1 : 1; k <= 1; ++k) {
      targets_.shift();
      hands_.shift();
      std::string problem = sample(target, t + Scalar(static_cast<double>(k)) * limits_.dt);
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
  template <class Tolerance>
  Report judge(const Tolerance& tolerance) const;

 private:
  static Scalar positive(const Scalar& x) { return Scalar(0) < x ? x : Scalar(0); }
  static Scalar length(const Vector3<Scalar>& v) {
    using std::sqrt;
    return sqrt(v.squaredNorm());
  }

  /// Fills the last of the three frames with targets and hands of time `t`.
  template <class Target>
  std::string sample(const Target& target, const Scalar& t) {
    for (Index i = 0; i < limits_.count(); ++i) targets_.after.col(i) = target(i, t);
    for (std::size_t g = 0; g < limits_.anchors.size(); ++g) {
      const Vector3<Scalar> hand =
          anchor_position(limits_.anchors[g], limits_.heavy_chain_axes, limits_.gravity, target, t);
      hands_.after.col(static_cast<Index>(g)) = hand;
      if (!all_finite(hand))
        return "a target is not finite less than a swing of the sheet from " + number_text(t) +
               " s";
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
      feature_.add(length(acceleration));
      report_.fall_excess.raise(-acceleration[2] - limits_.gravity, t, static_cast<int>(i));
      report_.speed.raise(length(targets_.velocity(i, limits_.dt)), t, static_cast<int>(i));
      report_.acceleration.raise(length(acceleration), t, static_cast<int>(i));
    }
  }

  void add_hands(const Scalar& t) {
    const Vector3<Scalar> across = targets_.now.col(limits_.count() - 1) - targets_.now.col(0);
    for (std::size_t g = 0; g < limits_.anchors.size(); ++g) {
      const Index i = static_cast<Index>(g);
      const Vector3<Scalar> velocity = hands_.velocity(i, limits_.dt);
      Scalar lag = Scalar(0);
      for (int axis = 0; axis < 3; ++axis) {
        const Scalar speed = velocity[axis] < Scalar(0) ? Scalar(-velocity[axis]) : velocity[axis];
        report_.hand_speed.raise(speed, t, static_cast<int>(g));
        const Scalar excess = speed - limits_.max_hand_speed;
        report_.hand_speed_excess.raise(excess, t, static_cast<int>(g));
        lag_(axis, i) = positive(lag_(axis, i) + limits_.dt * excess);
        lag = (std::max)(lag, lag_(axis, i));
      }
      report_.hand_lag.raise(lag, t, static_cast<int>(g));
      total_lag_ += lag / Scalar(static_cast<double>(limits_.anchors.size()));
      const Scalar acceleration = length(swing_part(limits_.anchors[g], limits_.heavy_chain_axes,
                                                    across, hands_.acceleration(i, limits_.dt)));
      hand_.add(acceleration);
      report_.hand_acceleration.raise(acceleration, t, static_cast<int>(g));
    }
  }

  const Limits& limits_;
  const Scalar features_;  // their number
  ThreeFrames<Scalar> targets_, hands_;
  MeanSquare<Scalar> hand_, feature_, close_, tilt_;
  Points<Scalar> lag_;  // of the hands along each axis, 3×grips, m
  Scalar total_excess_ = Scalar(0), most_excess_ = Scalar(0), total_least_ = Scalar(0),
         total_lag_ = Scalar(0);
  Index frames_ = 0;
  Report report_;
};

template <class Limits, class Report>
auto ReachStatistics<Limits, Report>::add_distances(const Scalar& t) -> Scalar {
  Scalar excess = Scalar(0), least = Scalar(0), close = Scalar(0), tilt = Scalar(0);
  for (Index i = 0; i < limits_.count(); ++i) {
    for (Index j = i + 1; j < limits_.count(); ++j) {
      const Scalar& way = limits_.feature_lengths(i, j);
      const Vector3<Scalar> across = targets_.now.col(i) - targets_.now.col(j);
      const Vector3<Scalar> at_start = limits_.features.col(i) - limits_.features.col(j);
      const Scalar apart = length(across), rise = across[2] - at_start[2];
      close = (std::max)(close, length(at_start) - apart);
      tilt = (std::max)(tilt, rise < Scalar(0) ? Scalar(-rise) : rise);
      if (is_unbounded(way)) continue;
      const Scalar beyond = apart - way * (Scalar(1) + limits_.stretch);
      excess = (std::max)(excess, apart - way);
      least = (std::max)(least, beyond);
      report_.distance_excess.raise(beyond, t, static_cast<int>(i));
    }
  }
  close_.add(close);
  tilt_.add(tilt);
  total_excess_ += excess / features_;
  most_excess_ = (std::max)(most_excess_, Scalar(excess / features_));
  return least / features_;
}

template <class Limits, class Report>
auto ReachStatistics<Limits, Report>::add_places(const Scalar& t) -> Scalar {
  Scalar total = Scalar(0);
  for (Index i = 0; i < limits_.count(); ++i) {
    Scalar beyond = positive(limits_.floor - targets_.now(2, i));
    for (const GripLimit<Scalar>& limit : limits_.grip_limits) {
      const Vector3<Scalar> place = targets_.now.col(i);
      beyond = (std::max)(beyond, beyond_grip_limit<Scalar>(limits_, limit, i, place));
    }
    report_.place_excess.raise(beyond, t, static_cast<int>(i));
    total += beyond;
  }
  return total / features_;
}

template <class Limits, class Report>
template <class Tolerance>
auto ReachStatistics<Limits, Report>::judge(const Tolerance& tolerance) const -> Report {
  using std::sqrt;
  const Scalar frames = Scalar(static_cast<double>(frames_ < 1 ? 1 : frames_));
  const Scalar swing = limits_.size() / limits_.gravity;  // L/g, s²
  Report report = report_;
  auto& causes = report.causes;
  causes.excess = total_excess_ / frames;
  causes.largest_excess = most_excess_;
  causes.hand = swing * hand_.root();
  causes.feature = swing * feature_.root();
  causes.close = close_.root();
  causes.tilt = tilt_.root();
  // A gap at the start closes within about the time τ in which a swing goes down the sheet.
  const Scalar settles = Scalar(2) * sqrt(swing) / (frames * limits_.dt);
  const Scalar& gap = report_.start_gap.value;
  report.least_error = total_least_ / frames;
  report.predicted_error =
      (std::max)(report.least_error,
                 Scalar(total_lag_ / frames + gap * (settles < Scalar(1) ? settles : Scalar(1)) +
                        ReachWeights<Scalar>::mean().error(causes.excess, causes)));
  // Of two features that are too far apart, one errs by half of that at least.
  const Scalar known =
      (std::max)(report.place_excess.value, Scalar(report.distance_excess.value / Scalar(2)));
  report.predicted_largest_error = (std::max)(
      (std::max)(gap, known), Scalar(report.hand_lag.value + ReachWeights<Scalar>::largest().error(
                                                                 causes.largest_excess, causes)));
  const Scalar ratio = (std::max)(Scalar(report.predicted_error / tolerance.mean),
                                  Scalar(report.predicted_largest_error / tolerance.largest));
  report.score = report.least_error > tolerance.mean || known > tolerance.largest
                     ? Scalar(0)
                     : Scalar(1) / (Scalar(1) + ratio * ratio * ratio * ratio);
  return report;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
