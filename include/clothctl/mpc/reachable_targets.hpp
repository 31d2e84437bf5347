#pragma once

// Targets nearby that a sheet can reach: as far apart as it is long, above the floor, where limits
// of the grips let features be, and no faster than hands. They are the nearest where one limit is
// exceeded. Violence within these limits stays
// (reachability.hpp judges it).
//
// Of two features that are too far apart, both move by half of what is too much, along the line
// between them: the least squared change. A speed limit v along each axis is met by the mean of two
// envelopes,
//
//   z(t) = ½ max_s (y(s) - v |t - s|) + ½ min_s (y(s) + v |t - s|),
//
// the curve of that speed whose largest distance from y is least. Both are repeated until nothing
// changes. Limiting the features to the speed of hands suffices, since a hand follows a moving
// average of features; along the directions in which a sheet swings it is more than needed.

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "clothctl/mpc/reachability.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Targets of features, moved to where a sheet can reach. Pass it on in place of the target:
///
///   const auto nearest =
///       ReachableTargets<double, decltype(target)>::create(limits, target, 0.0, 5.0).value();
///   if (!run_frame(planner, plant, t, nearest, plan).advanced()) return 1;
///
/// Changes are found once, at all frames, and interpolated linearly between them: where nothing has
/// to change, targets keep every bit.
template <RealScalar S, class Target>
class ReachableTargets {
 public:
  /// The scalar type.
  using Scalar = S;

  /// Finds the nearest targets from `start` to `end` (s). Returns an error that names a bad limit,
  /// bad times, or a target that is not finite. Allocates. Complexity: O(features² frames) for each
  /// round, of which there are at most 100.
  static Result<ReachableTargets> create(const ReachLimits<Scalar>& limits, Target target,
                                         Scalar start, Scalar end);

  /// Returns the nearest target of a feature at time `t` (s), m. Before the first and after the
  /// last frame, targets keep the change of that frame. Never allocates.
  Vector3<Scalar> operator()(Index feature, const Scalar& t) const {
    Vector3<Scalar> wanted = target_(feature, t);
    if (!moved_) return wanted;
    return wanted + change(feature, t);
  }

  /// Returns by how much the target of a feature is moved at time `t` (s), m. Never allocates.
  Vector3<Scalar> change(Index feature, const Scalar& t) const;

  /// Returns true when any target is moved.
  bool moved() const { return moved_; }
  /// Returns the largest distance by which a target is moved, m, when, and of which feature.
  const ReachPeak<Scalar>& largest_change() const { return largest_; }
  /// Returns the mean of that distance over features and frames, m.
  const Scalar& mean_change() const { return mean_; }
  /// Returns the largest motion of a target in the last round, m: below 1e-6 of the sheet's size
  /// but where limits contradict each other.
  const Scalar& last_motion() const { return remaining_; }

 private:
  static constexpr int kRounds = 100;

  ReachableTargets(Target target, Scalar start, Scalar dt)
      : target_(std::move(target)), start_(std::move(start)), dt_(std::move(dt)) {}

  /// Moves features of a frame to where they can be. Returns the largest motion, m.
  static Scalar hold_together(const ReachLimits<Scalar>& limits, Eigen::Ref<VectorX<Scalar>> y);
  /// Raises each value to those of its neighbours less `step`.
  static void raise_neighbours(const Scalar& step, VectorX<Scalar>& values) {
    const Index last = values.size() - 1;
    for (Index k = 1; k <= last; ++k)
      values[k] = (std::max)(values[k], Scalar(values[k - 1] - step));
    for (Index k = last; k-- > 0;) values[k] = (std::max)(values[k], Scalar(values[k + 1] - step));
  }
  /// Limits the steps of all coordinates over the frames. Returns the largest motion, m.
  static Scalar slow_down(const Scalar& step, MatrixX<Scalar>& y);

  /// Fills the changes from the wanted and the nearest places.
  void measure(const MatrixX<Scalar>& wanted, const MatrixX<Scalar>& nearest);

  Target target_;
  Scalar start_, dt_;
  MatrixX<Scalar> change_;  // 3·features × frames
  bool moved_ = false;
  ReachPeak<Scalar> largest_;
  Scalar mean_ = Scalar(0), remaining_ = Scalar(0);
};

template <RealScalar S, class Target>
auto ReachableTargets<S, Target>::create(const ReachLimits<Scalar>& limits, Target target,
                                         Scalar start, Scalar end) -> Result<ReachableTargets> {
  Index frames = 0;
  const std::string problem = detail::open_reach_curve(limits, target, start, end, frames);
  if (!problem.empty()) return Error{problem};
  MatrixX<Scalar> wanted(3 * limits.count(), frames);
  for (Index k = 0; k < frames; ++k) {
    const Scalar t = start + limits.dt * Scalar(static_cast<double>(k));
    for (Index i = 0; i < limits.count(); ++i) {
      const Vector3<Scalar> place = target(i, t);
      wanted.template block<3, 1>(3 * i, k) = place;
    }
  }
  ReachableTargets made(std::move(target), start, limits.dt);
  MatrixX<Scalar> nearest = wanted;
  const Scalar step = limits.max_hand_speed * limits.dt;
  for (int round = 0; round < kRounds; ++round) {
    made.remaining_ = slow_down(step, nearest);
    Scalar motion = Scalar(0);
    for (Index k = 0; k < frames; ++k)
      motion = (std::max)(motion, hold_together(limits, nearest.col(k)));
    made.remaining_ = (std::max)(made.remaining_, motion);
    if (!(Scalar(1e-6) * limits.size() < made.remaining_)) break;
  }
  made.measure(wanted, nearest);
  return made;
}

template <RealScalar S, class Target>
auto ReachableTargets<S, Target>::change(Index feature, const Scalar& t) const -> Vector3<Scalar> {
  const Index last = change_.cols() - 1;
  Index k = 0;  // the frame before t, by bisection: a foreign scalar need not convert to an index
  for (Index beyond = last; k + 1 < beyond;) {
    const Index middle = (k + beyond) / 2;
    (t < start_ + dt_ * Scalar(static_cast<double>(middle)) ? beyond : k) = middle;
  }
  const Scalar share = (t - start_) / dt_ - Scalar(static_cast<double>(k));
  Vector3<Scalar> before = change_.template block<3, 1>(3 * feature, k);
  if (last == 0 || !(Scalar(0) < share)) return before;
  const Vector3<Scalar> after = change_.template block<3, 1>(3 * feature, k + 1);
  return share < Scalar(1) ? Vector3<Scalar>(before + share * (after - before)) : after;
}

template <RealScalar S, class Target>
auto ReachableTargets<S, Target>::hold_together(const ReachLimits<Scalar>& limits,
                                                Eigen::Ref<VectorX<Scalar>> y) -> Scalar {
  using std::sqrt;
  Scalar largest = Scalar(0);
  const auto move = [&](Index i, const Vector3<Scalar>& way) {
    y.template segment<3>(3 * i) += way;
    largest = (std::max)(largest, Scalar(sqrt(way.squaredNorm())));
  };
  for (Index i = 0; i < limits.count(); ++i) {
    for (Index j = i + 1; j < limits.count(); ++j) {
      const Scalar most = limits.feature_lengths(i, j) * (Scalar(1) + limits.stretch);
      const Vector3<Scalar> across = y.template segment<3>(3 * j) - y.template segment<3>(3 * i);
      const Scalar apart = sqrt(across.squaredNorm());
      if (!(most < apart)) continue;
      const Vector3<Scalar> half = across * ((apart - most) / (Scalar(2) * apart));
      move(i, half);
      move(j, -half);
    }
  }
  for (Index i = 0; i < limits.count(); ++i) {
    for (const GripLimit<Scalar>& limit : limits.grip_limits) {
      const Scalar excess = detail::beyond_grip_limit<Scalar>(
          limits, limit, i, Vector3<Scalar>(y.template segment<3>(3 * i)));
      if (Scalar(0) < excess) move(i, -excess * limit.normal);
    }
    const Scalar below = limits.floor - y[3 * i + 2];
    if (Scalar(0) < below) move(i, Vector3<Scalar>(Scalar(0), Scalar(0), below));
  }
  return largest;
}

template <RealScalar S, class Target>
auto ReachableTargets<S, Target>::slow_down(const Scalar& step, MatrixX<Scalar>& y) -> Scalar {
  Scalar largest = Scalar(0);
  const Index frames = y.cols();
  for (Index row = 0; row < y.rows(); ++row) {
    bool slow = true;
    for (Index k = 1; k < frames; ++k) {
      const Scalar way = y(row, k) - y(row, k - 1);
      slow = slow && !(step < way) && !(way < -step);
    }
    if (slow) continue;
    const VectorX<Scalar> wanted = y.row(row).transpose();
    VectorX<Scalar> high = wanted, low = -wanted;
    raise_neighbours(step, high);
    raise_neighbours(step, low);
    y.row(row) = (Scalar(0.5) * (high - low)).transpose();
    for (Index k = 0; k < frames; ++k) {
      const Scalar way = y(row, k) - wanted[k];
      largest = (std::max)(largest, way < Scalar(0) ? Scalar(-way) : way);
    }
  }
  return largest;
}

template <RealScalar S, class Target>
void ReachableTargets<S, Target>::measure(const MatrixX<Scalar>& wanted,
                                          const MatrixX<Scalar>& nearest) {
  using std::sqrt;
  change_ = nearest - wanted;
  const Index features = change_.rows() / 3;
  const Scalar share =
      Scalar(1) / Scalar(static_cast<double>(features) * static_cast<double>(change_.cols()));
  for (Index k = 0; k < change_.cols(); ++k) {
    const Scalar t = start_ + dt_ * Scalar(static_cast<double>(k));
    for (Index i = 0; i < features; ++i) {
      const Vector3<Scalar> way = change_.template block<3, 1>(3 * i, k);
      const Scalar distance = sqrt(way.squaredNorm());
      mean_ += share * distance;
      largest_.raise(distance, t, static_cast<int>(i));
    }
  }
  moved_ = Scalar(0) < largest_.value;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
