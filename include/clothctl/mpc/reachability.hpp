#pragma once

// Can a sheet follow a curve? Judged before a run, from the curve alone.
//
// Some curves are impossible, by an amount that is known. Without stretch, two features are at most
// ℓ apart, the shortest way along the sheet between them; a feature is at most ℓ from each hand.
// Where targets are further apart by x, the errors of both features add up to x at least.
//
// Other curves are too violent. The hands' path that belongs to a curve is the moving average of a
// hanging chain (hand_anchor.hpp). Mean and largest error of a closed loop are predicted as
//
//   e = w_x x/F + √( (w_a a L/g)² + (w_b b L/g)² + (w_c c)² + (w_d d)² )
//
// x at no stretch, mean over time or largest; F: number of features. Root mean squares over time
// are a, the acceleration of the hands in the directions in which the sheet swings; b, the
// acceleration of the features; c, by how much features are closer together than at the start; d,
// by how much their difference in height changes. L: hanging length. Where hands would be too fast,
// the way by which they lag is added. The two sets of weights are fitted to
// closed loops; `examples/reachability` tests them on curves that the fit has not seen. That errors
// scale with L and L/g follows from the dimensions of an inextensible sheet.

#include <cmath>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/contact/grip.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/mpc/detail/reach_statistics.hpp"
#include "clothctl/mpc/detail/spring_distance.hpp"
#include "clothctl/mpc/hand_anchor.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// What sheet and hands can do. Made by `make_reach_limits`; change what differs.
template <RealScalar Scalar>
struct ReachLimits {
  /// Features at the start, 3×features, m.
  Points<Scalar> features;
  /// Longest distance of two features without stretch, features × features, m; infinite where
  /// nothing holds them together.
  MatrixX<Scalar> feature_lengths;
  /// The same of a feature and a grip, features × grips, m.
  MatrixX<Scalar> grip_lengths;
  /// The anchor of each hand.
  std::vector<HandAnchor<Scalar>> anchors;
  /// Directions in which the sheet swings.
  HeavyChainAxes heavy_chain_axes = HeavyChainAxes::SheetNormal;
  /// Length of a frame, s.
  Scalar dt = Scalar(0.02);
  /// Size of gravity, m/s².
  Scalar gravity = Scalar(9.81);
  /// Highest speed of a hand along each axis, m/s. Limits of acceleration are not judged: compare
  /// `ReachabilityReport::hand_acceleration` with yours.
  Scalar max_hand_speed = Scalar(2.5);
  /// Stretch that is allowed: 0.01 means 1 %.
  Scalar stretch = Scalar(0.01);
  /// Height below which no feature can go, m.
  Scalar floor = -scalar_traits<Scalar>::infinity();
  /// Where the centroids of grips may go. Those measured from another grip do not count.
  std::vector<GripLimit<Scalar>> grip_limits = {};

  /// Returns the number of features.
  Index count() const { return features.cols(); }
  /// Returns an empty string, or a line that names the first bad value. Allocates.
  std::string validate() const;
  /// Returns the length L by which errors scale: the mean hanging length of the hands, or, where
  /// nothing hangs, the mean length from features to grips; m.
  Scalar size() const;
};

/// What counts as following a curve.
template <RealScalar Scalar>
struct ReachTolerance {
  /// Mean error over features and time, m.
  Scalar mean = Scalar(0.01);
  /// Error of a feature at any time, m: a loop that loses its targets and finds them again has not
  /// followed the curve, however small its mean error.
  Scalar largest = Scalar(0.05);
};

/// Whether a curve can be followed.
enum class ReachVerdict {
  /// Most such curves are followed within the tolerance: over 95 % where the weights were fitted
  /// (poses, rollouts, 0.5 m).
  Reachable,
  /// Success and failure are both likely.
  Doubtful,
  /// Most such curves are not followed within the tolerance.
  Unreachable
};

/// Returns the name of a verdict.
constexpr std::string_view to_string(ReachVerdict verdict) {
  switch (verdict) {
    case ReachVerdict::Reachable: return "reachable";
    case ReachVerdict::Doubtful: return "doubtful";
    case ReachVerdict::Unreachable: return "unreachable";
  }
  return "unknown";
}

/// The worst moment of a criterion.
template <RealScalar Scalar>
struct ReachPeak {
  /// The largest value over the curve; its unit is that of the criterion.
  Scalar value = Scalar(0);
  /// When, s.
  Scalar time = Scalar(0);
  /// Which feature or hand.
  int index = 0;

  /// Takes over a larger value.
  void raise(const Scalar& candidate, const Scalar& when, int which) {
    if (!(value < candidate)) return;
    value = candidate;
    time = when;
    index = which;
  }
};

/// What predicted errors are made of, m.
template <RealScalar Scalar>
struct ReachCauses {
  /// How far features are beyond what the sheet allows without stretch, over their number (x/F):
  /// mean over the curve.
  Scalar excess = Scalar(0);
  /// The same: largest value.
  Scalar largest_excess = Scalar(0);
  /// Root mean square of the acceleration of the hands as they swing the sheet, times L/g.
  Scalar hand = Scalar(0);
  /// Root mean square of the acceleration of the features, times L/g.
  Scalar feature = Scalar(0);
  /// Root mean square of how much closer together features are than at the start.
  Scalar close = Scalar(0);
  /// Root mean square of the change of their difference in height.
  Scalar tilt = Scalar(0);
};

/// What a curve asks for, and what comes of it. A peak is 0 where its limit is kept.
template <RealScalar Scalar>
struct ReachabilityReport {
  /// The judgement.
  ReachVerdict verdict = ReachVerdict::Unreachable;
  /// Estimated probability that the curve is followed: 1/(1 + r⁴) with the ratio r of a predicted
  /// error to its tolerance, the larger of the two; 0 where even the least error exceeds its
  /// tolerance, mean or largest. Reachable from 0.85 on, unreachable below 0.3.
  Scalar score = Scalar(0);
  /// Mean error over features and time that a closed loop is predicted to have, m.
  Scalar predicted_error = Scalar(0);
  /// Largest error of a feature that a closed loop is predicted to have, m.
  Scalar predicted_largest_error = Scalar(0);
  /// Mean error that no hands can avoid, m.
  Scalar least_error = Scalar(0);
  /// What the predictions are made of.
  ReachCauses<Scalar> causes;

  /// Distance of a feature from another one beyond what the sheet allows with stretch, m.
  ReachPeak<Scalar> distance_excess;
  /// Distance of a feature below the floor, or from where limits of the grips let it be, m.
  ReachPeak<Scalar> place_excess;
  /// Distance of a feature from its target at the start, m.
  ReachPeak<Scalar> start_gap;
  /// Speed that a hand needs along an axis, m/s.
  ReachPeak<Scalar> hand_speed;
  /// By how much that exceeds the highest speed, m/s.
  ReachPeak<Scalar> hand_speed_excess;
  /// Way by which a hand of the highest speed lags behind, m.
  ReachPeak<Scalar> hand_lag;
  /// Acceleration that a hand needs in the directions in which the sheet swings, m/s².
  ReachPeak<Scalar> hand_acceleration;
  /// Downward acceleration of a feature beyond that of free fall, m/s².
  ReachPeak<Scalar> fall_excess;
  /// Speed of a feature, m/s.
  ReachPeak<Scalar> speed;
  /// Acceleration of a feature, m/s².
  ReachPeak<Scalar> acceleration;

  /// Returns the verdict and its main reason in a line. Allocates.
  std::string describe() const;
};

template <RealScalar Scalar>
std::string ReachLimits<Scalar>::validate() const {
  const Index n = count();
  if (n < 1) return "there are no features";
  if (anchors.empty()) return "there are no anchors";
  if (!all_finite(features)) return "the features at the start are not finite";
  if (feature_lengths.rows() != n || feature_lengths.cols() != n)
    return "feature_lengths is not features x features";
  if (grip_lengths.rows() != n || grip_lengths.cols() != static_cast<Index>(anchors.size()))
    return "grip_lengths is not features x anchors";
  for (const MatrixX<Scalar>* lengths : {&feature_lengths, &grip_lengths}) {
    for (Index i = 0; i < lengths->size(); ++i) {
      const Scalar& length = lengths->data()[i];
      if ((!is_finite(length) && !is_unbounded(length)) || length < Scalar(0))
        return "a length is " + number_text(lengths->data()[i]) + " m, must not be negative";
    }
  }
  for (std::size_t g = 0; g < anchors.size(); ++g) {
    const std::string problem = anchors[g].validate(n);
    if (!problem.empty()) return "anchor " + std::to_string(g) + problem;
  }
  for (const auto& [name, value] : {std::pair{"dt", &dt}, std::pair{"gravity", &gravity},
                                    std::pair{"max_hand_speed", &max_hand_speed}}) {
    if (!is_finite(*value) || !(Scalar(0) < *value))
      return std::string(name) + " is " + number_text(*value) + ", must be positive";
  }
  if (!is_finite(stretch) || stretch < Scalar(0))
    return "stretch is " + number_text(stretch) + ", must be finite and not negative";
  if (!is_finite(floor) && !(floor < Scalar(0)))
    return "floor is " + number_text(floor) + " m, must be finite or minus infinity";
  for (std::size_t i = 0; i < grip_limits.size(); ++i) {
    const std::string bad = grip_limits[i].validate(static_cast<int>(anchors.size()));
    if (!bad.empty()) return "grip limit " + std::to_string(i) + bad;
  }
  return {};
}

template <RealScalar Scalar>
Scalar ReachLimits<Scalar>::size() const {
  Scalar hanging = Scalar(0), held = Scalar(0), ways = Scalar(0);
  const Scalar hands = Scalar(static_cast<double>(anchors.empty() ? 1 : anchors.size()));
  for (const HandAnchor<Scalar>& anchor : anchors) hanging += anchor.hanging_length / hands;
  if (Scalar(0) < hanging) return hanging;
  for (Index i = 0; i < grip_lengths.size(); ++i) {
    if (is_unbounded(grip_lengths.data()[i])) continue;
    held += grip_lengths.data()[i];
    ways += Scalar(1);
  }
  return Scalar(0) < ways ? Scalar(held / ways) : Scalar(0);
}

/// Returns the limits of a planner's sheet, which stands at `start` (3×n, m). Returns an error when
/// they do not fit each other. Allocates. Complexity: a search of shortest ways (Dijkstra) for each
/// vertex of a feature.
template <RealScalar Scalar, ContactModel<Scalar> Contact, FeatureMap<Scalar> Features>
Result<ReachLimits<Scalar>> make_reach_limits(
    const PlannerSetup<Scalar, Contact, Features>& setup, const PlannerSettings<Scalar>& settings,
    const SpringNetwork<Scalar>& network, const std::type_identity_t<PointsView<Scalar>>& start) {
  std::string problem = settings.validate();
  if (problem.empty()) problem = network.validate();
  if (problem.empty() && network.vertex_count() != start.cols())
    problem = "the network has " + std::to_string(network.vertex_count()) +
              " vertices, the start positions have " + std::to_string(start.cols());
  if (problem.empty()) problem = setup.validate(start.cols());
  if (problem.empty() && !all_finite(start)) problem = "the start positions are not finite";
  if (!problem.empty()) return Error{problem};
  PointFeatures<Scalar> points;
  points.add_map(setup.features);
  const Index count = points.count(), grips = static_cast<Index>(setup.grips.size());
  for (const auto& grip : setup.grips) points.add_centroid(grip.vertices());
  Points<Scalar> places(3, count + grips);
  evaluate_features<Scalar>(points, start, places);
  detail::SpringDistance<Scalar> distance(network);
  ReachLimits<Scalar> limits;
  limits.features = places.leftCols(count);
  limits.anchors = setup.anchors.empty()
                       ? make_anchors<Scalar>(limits.features, places.rightCols(grips))
                       : setup.anchors;
  limits.feature_lengths.setZero(count, count);
  limits.grip_lengths.setZero(count, grips);
  for (Index i = 0; i < count; ++i) {
    const std::vector<Scalar> ways = distance.from(points, i);
    for (Index j = 0; j < count; ++j) {
      if (i != j) limits.feature_lengths(i, j) = distance.to(ways, points, j);
    }
    for (Index g = 0; g < grips; ++g)
      limits.grip_lengths(i, g) = distance.to(ways, points, count + g);
  }
  limits.heavy_chain_axes = settings.heavy_chain_axes;
  limits.dt = settings.dt;
  limits.gravity = settings.gravity;
  limits.max_hand_speed = settings.max_step / settings.dt;
  return limits;
}

template <RealScalar Scalar>
std::string ReachabilityReport<Scalar>::describe() const {
  const auto at = [](const ReachPeak<Scalar>& peak, const char* whose, const char* what,
                     const char* unit) {
    return std::string("; at ") + rounded_text(peak.time) + " s " + whose + " " +
           std::to_string(peak.index) + " " + what + " " + rounded_text(peak.value) + " " + unit;
  };
  std::string text = std::string(to_string(verdict)) + ": predicted mean error " +
                     rounded_text(predicted_error) + " m, at least " + rounded_text(least_error) +
                     " m, largest " + rounded_text(predicted_largest_error) + " m";
  if (verdict == ReachVerdict::Reachable) return text;
  if (Scalar(0) < start_gap.value)
    text += at(start_gap, "feature", "starts away from its target by", "m");
  if (Scalar(0) < distance_excess.value)
    text += at(distance_excess, "feature", "is too far from another one by", "m");
  if (Scalar(0) < place_excess.value)
    text += at(place_excess, "feature", "is out of reach by", "m");
  if (Scalar(0) < hand_speed_excess.value)
    text += at(hand_speed_excess, "hand", "would be too fast by", "m/s");
  if (Scalar(0) < hand_lag.value) text += at(hand_lag, "hand", "lags by", "m");
  if (Scalar(0) < fall_excess.value)
    text += at(fall_excess, "feature", "falls faster than freely by", "m/s²");
  if (Scalar(0) < hand_acceleration.value)
    text += at(hand_acceleration, "hand", "needs to be accelerated by", "m/s²");
  return text;
}

/// Judges whether features can follow `target(feature, time)` (m) from `start` to `end` (s) within
/// `tolerance`. `target` must return positions half a second (2 √(L/g)) and a frame
/// before `start` and after `end` too, as for a planner. Returns an error that names what is wrong:
/// a bad limit, times, or a target that is not finite. Allocates a few vectors. Complexity: 35
/// evaluations of a target for each feature, hand and frame.
///
/// The prediction is fitted to a rolled-out planner of poses with default settings on a plant that
/// is like its model. A worse predictor has larger errors: lower the tolerance.
template <RealScalar Scalar, class Target>
Result<ReachabilityReport<Scalar>> assess_reachability(const ReachLimits<Scalar>& limits,
                                                       const Target& target, Scalar start,
                                                       Scalar end,
                                                       ReachTolerance<Scalar> tolerance = {}) {
  Index frames = 0;
  std::string problem = detail::open_reach_curve(limits, target, start, end, frames);
  if (!problem.empty()) return Error{problem};
  for (const Scalar* value : {&tolerance.mean, &tolerance.largest}) {
    if (!is_finite(*value) || !(Scalar(0) < *value))
      return Error{"a tolerance is " + number_text(*value) + " m, must be positive"};
  }
  detail::ReachStatistics<ReachLimits<Scalar>, ReachabilityReport<Scalar>> statistics(limits);
  for (Index k = 0; k < frames; ++k) {
    problem = statistics.add(target, start + limits.dt * Scalar(static_cast<double>(k)));
    if (!problem.empty()) return Error{problem};
  }
  ReachabilityReport<Scalar> report = statistics.judge(tolerance);
  if (!is_finite(report.predicted_error) || !is_finite(report.predicted_largest_error))
    return Error{"the targets move too far for a prediction"};
  report.verdict = report.score < Scalar(0.3)    ? ReachVerdict::Unreachable
                   : report.score < Scalar(0.85) ? ReachVerdict::Doubtful
                                                 : ReachVerdict::Reachable;
  return report;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
