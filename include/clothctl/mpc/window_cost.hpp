#pragma once

// The planner's cost over one window, written as weighted rows of the predicted outputs (the sum is in planner_settings.hpp).
// Features and anchors are pulled to samples of the target at the end of each frame; the centroids of the grips and the affine
// shapes of the patches are differenced in time, from the frames before the window on:
//
//   z_0 = measured,   z_-1 = z_0 - h ż_0,   z_-2 = z_-1 - h ż_-1

#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "clothctl/mpc/held_patches.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace clothctl {

/// What the held vertices did up to now, in the order of GripBasis::held: 3×held each.
template <RealScalar Scalar>
struct HeldMotion {
  /// Measured positions, m.
  Points<Scalar> position;
  /// Measured velocities, m/s.
  Points<Scalar> velocity;
  /// Measured velocities a frame ago, m/s.
  Points<Scalar> last_velocity;
};

/// Samples the target of a window and stacks the window's cost. The first outputs are the features, those after them the held
/// vertices.
template <RealScalar Scalar>
class WindowCost {
 public:
  /// Prepares for windows of `settings.horizon` frames with one anchor a grip. Allocates.
  void reserve(const PlannerSettings<Scalar>& settings, const GripBasis<Scalar>& basis,
               const std::vector<HeldPatch<Scalar>>& patches, Index features, std::vector<HandAnchor<Scalar>> anchors) {
    anchors_ = std::move(anchors);
    features_ = features;
    const Index grips = static_cast<Index>(basis.grips().size());
    Index rows = 3 * features + 12 * grips;
    for (const HeldPatch<Scalar>& p : patches) rows += 9 + 3 * p.modes.count();
    stack_.reserve(rows, basis.inputs(), settings.horizon);
    point_.reserve(basis.held().size());
    targets_.setZero(3 * features, settings.horizon);
    anchor_targets_.setZero(3 * grips, settings.horizon);
  }

  /// Samples where features and hands shall be at the ends of the frames that follow `t` (s); `target(feature, time)` in m.
  /// False, with samples of no use, when one is not finite. Never allocates.
  template <class Target>
  [[nodiscard]] bool sample(const PlannerSettings<Scalar>& settings, Scalar t, const Target& target) {
    for (Index k = 0; k < settings.horizon; ++k) {
      const Scalar end = t + Scalar(static_cast<double>(k + 1)) * settings.dt;
      for (Index i = 0; i < features_; ++i) {
        const Vector3<Scalar> wanted = target(i, end);
        targets_.template block<3, 1>(3 * i, k) = wanted;
      }
      if (!(Scalar(0) < settings.weights.anchor)) continue;
      for (std::size_t g = 0; g < anchors_.size(); ++g)
        anchor_targets_.template block<3, 1>(3 * static_cast<Index>(g), k) = hand(settings, g, end, target);
    }
    return all_finite(targets_) && all_finite(anchor_targets_);
  }

  /// Where the hand of grip `g` belongs at time `t` (s), m. Never allocates.
  template <class Target>
  Vector3<Scalar> hand(const PlannerSettings<Scalar>& settings, std::size_t g, Scalar t, const Target& target) const {
    return anchor_position(anchors_[g], settings.swing, settings.gravity, target, t);
  }

  /// The rows of the cost about the plan of `window`. `step_weight`: w_r, s²/m². The modes of the patches are those of
  /// `motion.position`. The answer lasts until the next call. Never allocates.
  const TermStack<Scalar>& stack(const WindowResponse<Scalar>& window, const GripBasis<Scalar>& basis,
                                 const std::vector<HeldPatch<Scalar>>& patches, const PlannerSettings<Scalar>& settings,
                                 Scalar step_weight, const HeldMotion<Scalar>& motion) {
    stack_.clear();
    add_features(window, settings);
    for (std::size_t g = 0; g < basis.grips().size(); ++g) add_grip(window, basis, g, settings, step_weight, motion);
    for (const HeldPatch<Scalar>& patch : patches) add_patch(window, patch, settings, motion);
    return stack_;
  }

 private:
  static Vector3<Scalar> none(Index) { return Vector3<Scalar>::Zero(); }

  void add_features(const WindowResponse<Scalar>& window, const PlannerSettings<Scalar>& settings) {
    using std::sqrt;
    for (Index i = 0; i < features_; ++i) {
      point_.assign(1, OutputTerm<Scalar>{i, Scalar(1)});
      stack_.add(window, point_, past_, 0, sqrt(settings.weights.feature),
                 [&](Index k) { return Vector3<Scalar>(targets_.template block<3, 1>(3 * i, k)); });
    }
  }

  /// Anchor and smoothness of the centroid of grip `g`.
  void add_grip(const WindowResponse<Scalar>& window, const GripBasis<Scalar>& basis, std::size_t g,
                const PlannerSettings<Scalar>& settings, Scalar step_weight, const HeldMotion<Scalar>& motion) {
    using std::sqrt;
    const PlannerWeights<Scalar>& w = settings.weights;
    const Index begin = static_cast<Index>(basis.grip_begin(g)), end = static_cast<Index>(basis.grip_begin(g + 1));
    const Scalar share = basis.vertex_share(begin);
    point_.clear();
    Vector3<Scalar> now = Vector3<Scalar>::Zero(), velocity = Vector3<Scalar>::Zero(), before = Vector3<Scalar>::Zero();
    for (Index j = begin; j < end; ++j) {
      point_.push_back({features_ + j, share});
      now += share * motion.position.col(j);
      velocity += share * motion.velocity.col(j);
      before += share * motion.last_velocity.col(j);
    }
    past_[0] = now;
    past_[1] = past_[0] - settings.dt * velocity;
    past_[2] = past_[1] - settings.dt * before;
    stack_.add(window, point_, past_, 0, sqrt(w.anchor),
               [&](Index k) { return Vector3<Scalar>(anchor_targets_.template block<3, 1>(3 * static_cast<Index>(g), k)); });
    stack_.add(window, point_, past_, 2, sqrt(w.smooth) / settings.dt, none);
    stack_.add_change(window, point_, 1, sqrt(step_weight) / settings.dt);
    stack_.add(window, point_, past_, 3, sqrt(w.jerk) / settings.dt, none);
  }

  /// Change of the affine shape of a patch and, where the patch is soft, its non-affine motion.
  void add_patch(const WindowResponse<Scalar>& window, const HeldPatch<Scalar>& patch, const PlannerSettings<Scalar>& settings,
                 const HeldMotion<Scalar>& motion) {
    using std::sqrt;
    for (Index a = 0; a < 3 && patch.modes.rank() > 0; ++a) {
      point_.clear();
      past_[0].setZero();
      for (Index j = 0; j < patch.modes.count(); ++j) {
        const Index slot = patch.slots[static_cast<std::size_t>(j)];
        point_.push_back({features_ + slot, patch.modes.map()(a, j)});
        past_[0] += patch.modes.map()(a, j) * motion.position.col(slot);
      }
      stack_.add(window, point_, past_, 1, sqrt(settings.weights.shape), none);
    }
    if (settings.input != GripInput::Force || settings.patch != PatchMode::Soft) return;
    for (Index i = 0; i < patch.modes.non_affine_count(); ++i) {
      take_non_affine(patch, i, features_, point_);
      stack_.add(window, point_, past_, 0, sqrt(settings.weights.patch), none);
    }
  }

  TermStack<Scalar> stack_;
  std::vector<HandAnchor<Scalar>> anchors_;
  std::vector<OutputTerm<Scalar>> point_;
  std::array<Vector3<Scalar>, 3> past_{Vector3<Scalar>::Zero(), Vector3<Scalar>::Zero(), Vector3<Scalar>::Zero()};
  MatrixX<Scalar> targets_, anchor_targets_;
  Index features_ = 0;
};

}  // namespace clothctl
