#pragma once

// The planner's cost over one window, written as weighted rows of the predicted outputs (the sum is
// in planner_settings.hpp). Features and hands are pulled to their sampled targets at the end of
// each frame; the centroids of the grips and the affine shapes of the patches are differenced in
// time, from the frames before the window on:
//
//   z_0 = measured,   z_-1 = z_0 - h ż_0,   z_-2 = z_-1 - h ż_-1

#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "clothctl/mpc/detail/anchor_offset.hpp"
#include "clothctl/mpc/detail/term_stack.hpp"
#include "clothctl/mpc/detail/window_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Largest coordinate of a target that a planner accepts, m. A target further away is an error of
/// the caller; with it, the QP could not resolve the motion of the sheet.
template <RealScalar Scalar>
Scalar largest_target() {
  return Scalar(1e6);
}

/// Returns true when every coordinate is finite and at most `largest_target` in size.
template <class Derived>
bool within_reach(const Eigen::DenseBase<Derived>& points) {
  using Scalar = typename Derived::Scalar;
  for (Index j = 0; j < points.cols(); ++j) {
    for (Index i = 0; i < points.rows(); ++i) {
      const Scalar& value = points.derived().coeff(i, j);
      if (!is_finite(value)) return false;
      if (value < -largest_target<Scalar>() || largest_target<Scalar>() < value) return false;
    }
  }
  return true;
}

/// Returns anchors that keep the offsets of the grips of `basis` from the features at `x` (3×n, m).
/// Allocates.
template <RealScalar Scalar, class Contact, FeatureMap<Scalar> Features>
std::vector<HandAnchor<Scalar>> anchors_at(const GripBasis<Scalar, Contact>& basis,
                                           const Features& features, const PointsView<Scalar>& x) {
  const std::size_t count = basis.grips().size();
  Points<Scalar> points(3, feature_traits<Features>::count(features)),
      hands(3, static_cast<Index>(count));
  evaluate_features<Scalar>(features, x, points);
  for (std::size_t g = 0; g < count; ++g)
    hands.col(static_cast<Index>(g)) = basis.held().centroid(x, g);
  return make_anchors(points, hands);
}

/// Samples the target of a window and stacks the window's cost.
template <RealScalar Scalar, ContactModel<Scalar> Contact = HardFinger<Scalar>>
class WindowCost {
 public:
  using Problem = WindowProblem<Scalar, Contact>;

  /// Makes room for a problem with one anchor a grip. Allocates.
  void reserve(const Problem& problem, std::vector<HandAnchor<Scalar>> anchors) {
    anchors_ = std::move(anchors);
    const Index grips = static_cast<Index>(problem.basis.grips().size());
    const Index features = problem.feature_count, horizon = problem.settings.horizon;
    Index rows = 3 * features + 12 * grips;
    for (const HeldPatch<Scalar>& p : problem.patches) rows += 9 + 3 * p.affine.count();
    stack_.reserve(rows, features, problem.basis.inputs(), horizon);
    point_.reserve(problem.request.held.size());
    targets_.setZero(3 * features, horizon);
    anchor_targets_.setZero(3 * grips, horizon);
    wanted_.setZero(3, features);
    offset_.reserve(features, grips);
  }

  /// The anchors, one for each grip.
  const std::vector<HandAnchor<Scalar>>& anchors() const { return anchors_; }

  /// Samples the wanted positions of features and hands at the ends of the frames that follow `t`
  /// (s), and writes the mean velocity of the features to the request; `target(feature, time)` in
  /// m. Returns false when a position is not finite or beyond `largest_target`; the samples are
  /// then of no use. Never allocates.
  template <class Target>
  [[nodiscard]] bool sample(Problem& problem, Scalar t, const Target& target) {
    const PlannerSettings<Scalar>& settings = problem.settings;
    const Scalar share = Scalar(1) / Scalar(static_cast<double>(problem.feature_count));
    const bool anchored = Scalar(0) < settings.weights.anchor;
    Vector3<Scalar> mean = Vector3<Scalar>::Zero();
    for (Index i = 0; i < problem.feature_count && anchored; ++i) {
      const Vector3<Scalar> start = target(i, t);
      if (!within_reach(start)) return false;
      mean += share * start;
      wanted_.col(i) = start;
    }
    for (Index k = 0; k < settings.horizon; ++k) {
      const Scalar end = frame_time(problem, t, k + 1);
      for (Index i = 0; i < problem.feature_count; ++i) {
        const Vector3<Scalar> wanted = target(i, end);
        targets_.template block<3, 1>(3 * i, k) = wanted;
      }
      if (!anchored) continue;
      const Vector3<Scalar> before = mean;
      mean.setZero();
      for (Index i = 0; i < problem.feature_count; ++i)
        mean += share * targets_.template block<3, 1>(3 * i, k);
      problem.request.drift.col(k) = (mean - before) / settings.dt;
      for (std::size_t g = 0; g < anchors_.size(); ++g)
        anchor_targets_.template block<3, 1>(3 * static_cast<Index>(g), k) =
            hand(settings, g, end, target);
    }
    return within_reach(targets_) && within_reach(anchor_targets_);
  }

  /// Lets the anchors take up constant errors of the features, which are at `measured` (3×features,
  /// m) at the time of the last `sample`. From the next one on. Never allocates.
  void learn(const PlannerSettings<Scalar>& settings, const Points<Scalar>& measured) {
    if (Scalar(0) < settings.weights.anchor && Scalar(0) < settings.offset_time)
      offset_.learn(settings.dt, settings.offset_time, wanted_, measured, anchors_);
  }

  /// Forgets what the anchors have learned.
  void reset() { offset_.reset(); }

  /// Returns what the anchor of grip `g` has learned, m.
  Vector3<Scalar> learned(std::size_t g) const { return offset_.learned(g); }

  /// Returns where the hand of grip `g` belongs at time `t` (s) in still air, m. Never allocates.
  template <class Target>
  Vector3<Scalar> hand(const PlannerSettings<Scalar>& settings, std::size_t g, Scalar t,
                       const Target& target) const {
    return anchor_position(anchors_[g], settings.heavy_chain_axes, settings.gravity, target, t) +
           offset_.learned(g);
  }

  /// Returns the rows of the cost about the plan of `problem.response`. `step_weight`: w_r, s²/m²,
  /// `anchor_weight`: w_h, 1/m²; both change from frame to frame. Valid until the next call. Never
  /// allocates.
  const TermStack<Scalar>& stack(const Problem& problem, Scalar step_weight, Scalar anchor_weight) {
    stack_.clear();
    add_features(problem);
    for (std::size_t g = 0; g < problem.basis.grips().size(); ++g)
      add_grip(problem, g, step_weight, anchor_weight);
    for (const HeldPatch<Scalar>& patch : problem.patches) add_patch(problem, patch);
    return stack_;
  }

 private:
  static Vector3<Scalar> none(Index) { return Vector3<Scalar>::Zero(); }

  void add_features(const Problem& problem) {
    using std::sqrt;
    const PlannerSettings<Scalar>& settings = problem.settings;
    if (problem.response.has_jacobian) {
      stack_.add_features(problem.response, sqrt(settings.weights.feature), targets_);
      return;
    }
    for (Index i = 0; i < problem.feature_count; ++i) {
      point_.assign(1, OutputTerm<Scalar>{i, Scalar(1)});
      stack_.add(problem.response, point_, past_, 0, sqrt(settings.weights.feature),
                 [&](Index k) { return Vector3<Scalar>(targets_.template block<3, 1>(3 * i, k)); });
    }
  }

  /// Anchor and smoothness of the centroid of grip `g`.
  void add_grip(const Problem& problem, std::size_t g, Scalar step_weight, Scalar anchor_weight) {
    using std::sqrt;
    const PlannerSettings<Scalar>& settings = problem.settings;
    const HeldMotion<Scalar>& motion = problem.motion;
    const HeldVertices<Scalar>& held = problem.basis.held();
    const PlannerWeights<Scalar>& w = settings.weights;
    const Index begin = static_cast<Index>(held.grip_begin(g)),
                end = static_cast<Index>(held.grip_begin(g + 1));
    const Scalar share = held.vertex_share(begin);
    point_.clear();
    Vector3<Scalar> now = Vector3<Scalar>::Zero(), velocity = Vector3<Scalar>::Zero(),
                    before = Vector3<Scalar>::Zero();
    for (Index j = begin; j < end; ++j) {
      point_.push_back({problem.feature_count + j, share});
      now += share * motion.position.col(j);
      velocity += share * motion.velocity.col(j);
      before += share * motion.last_velocity.col(j);
    }
    past_[0] = now;
    past_[1] = past_[0] - settings.dt * velocity;
    past_[2] = past_[1] - settings.dt * before;
    stack_.add(problem.response, point_, past_, 0, sqrt(anchor_weight),
               [&](Index k) { return anchor_target(problem, g, k); });
    stack_.add(problem.response, point_, past_, 2, sqrt(w.smooth) / settings.dt, none);
    stack_.add_change(problem.response, point_, 1, sqrt(step_weight) / settings.dt);
    stack_.add(problem.response, point_, past_, 3, sqrt(w.jerk) / settings.dt, none);
  }

  /// Returns where the hand of grip `g` belongs at the end of frame `k` in the air that the
  /// predictor knows, m.
  Vector3<Scalar> anchor_target(const Problem& problem, std::size_t g, Index k) const {
    Vector3<Scalar> hand = anchor_targets_.template block<3, 1>(3 * static_cast<Index>(g), k);
    if (problem.response.air.cols() == 0) return hand;
    const PlannerSettings<Scalar>& settings = problem.settings;
    const Vector3<Scalar> across =
        targets_.template block<3, 1>(3 * (problem.feature_count - 1), k) -
        targets_.template block<3, 1>(0, k);
    const Vector3<Scalar> air = problem.response.air.col(k);
    hand += air_lead(anchors_[g], settings.heavy_chain_axes, settings.gravity, across, air);
    return hand;
  }

  /// Adds the cost of deforming a patch: the change of its affine shape (rotation, stretch, shear)
  /// from frame to frame and, for a soft patch, its non-affine motion.
  void add_patch(const Problem& problem, const HeldPatch<Scalar>& patch) {
    using std::sqrt;
    const PlannerSettings<Scalar>& settings = problem.settings;
    const HeldMotion<Scalar>& motion = problem.motion;
    for (Index a = 0; a < 3 && patch.affine.rank() > 0; ++a) {
      point_.clear();
      past_[0].setZero();
      for (Index j = 0; j < patch.affine.count(); ++j) {
        const Index slot = patch.held_slots[static_cast<std::size_t>(j)];
        point_.push_back({problem.feature_count + slot, patch.affine.map()(a, j)});
        past_[0] += patch.affine.map()(a, j) * motion.position.col(slot);
      }
      stack_.add(problem.response, point_, past_, 1, sqrt(settings.weights.shape), none);
    }
    if (settings.input != GripInput::Force || settings.patch != PatchMode::Soft) return;
    for (Index i = 0; i < patch.affine.non_affine_count(); ++i) {
      take_non_affine(patch, i, problem.feature_count, point_);
      stack_.add(problem.response, point_, past_, 0, sqrt(settings.weights.patch), none);
    }
  }

  TermStack<Scalar> stack_;
  std::vector<HandAnchor<Scalar>> anchors_;
  std::vector<OutputTerm<Scalar>> point_;
  std::array<Vector3<Scalar>, 3> past_{Vector3<Scalar>::Zero(), Vector3<Scalar>::Zero(),
                                       Vector3<Scalar>::Zero()};
  MatrixX<Scalar> targets_, anchor_targets_;
  Points<Scalar> wanted_;  // at the time of the last sample
  AnchorOffset<Scalar> offset_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
