#pragma once

// What a planner is made for, and what a frame of planning answers.

#include <array>
#include <string>
#include <vector>

#include "clothctl/contact/grip.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/status.hpp"
#include "clothctl/mpc/hand_anchor.hpp"
#include "clothctl/prediction/features.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A half-space for a feature: n · y <= most, such as the space above a table.
/// `Planner::set_limits`.
template <RealScalar Scalar>
struct FeatureLimit {
  /// The feature.
  int feature = 0;
  /// Direction of the limit, unit, world.
  Vector3<Scalar> normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
  /// The largest coordinate of the feature along it, m.
  Scalar most = Scalar(0);

  /// Returns an empty string, or what is wrong with a limit for `features` features, to be put
  /// after its name. Allocates.
  std::string validate(Index features) const {
    if (feature < 0 || features <= feature) return " is for feature " + std::to_string(feature);
    return validate_half_space(normal, most);
  }
};

/// What a planning frame answers. Made by `Planner::make_result`; reused from frame to frame.
template <RealScalar Scalar>
struct PlanResult {
  /// How the frame ended.
  PlanStatus status = PlanStatus::Failed;
  /// What to apply to the plant during the next frame: forces, or driven positions. Wind is left to
  /// the caller.
  ClothInput<Scalar> input;
  /// The force of each finger on each of its vertices; empty for poses.
  std::vector<FingerForce<Scalar>> finger_forces;
  /// Raw inputs over the window, 3·held × K: forces (N) or velocities (m/s).
  MatrixX<Scalar> plan;
  /// Features over the window as predicted, 3·features × K, m.
  MatrixX<Scalar> predicted;
  /// Root mean square distance between the features measured now and those that the last frame
  /// predicted for now, m.
  Scalar prediction_error = Scalar(0);
  /// 1 - prediction_error / (motion of the features in the last frame, at least 1 mm), limited to
  /// [0, 1]. 1 means that the plant does what was predicted. 1 also in the first frame and after a
  /// failure.
  Scalar agreement = Scalar(1);
  /// The same for predictions over half a window, with means over the last second, and a motion of
  /// at least 1 mm a frame. 1 until the first such prediction can be judged; kept after a failure.
  Scalar window_agreement = Scalar(1);
  /// Weight of the hand anchor in this frame, 1/m² (PlannerSettings::least_agreement).
  Scalar anchor_weight = Scalar(0);
  /// True when window_agreement is below 0.7 and the anchor cannot grow, or below 0.5: the plant
  /// does not do what the model says, and the features are about to lose their targets or have lost
  /// them. Hold the hands still, move the targets more slowly, or use a better model. May be true
  /// for a second when a sheet starts to move.
  bool losing = false;
  /// Largest coordinate of a predicted non-affine mode of a patch (affine_patch.hpp) over the
  /// window, m.
  Scalar patch_residual = Scalar(0);
  /// How far planned centroids and features are beyond a limit of `set_limits` at most, m.
  Scalar limit_excess = Scalar(0);
  /// QP iterations of the frame, over all attempts.
  int qp_iterations = 0;
  /// How the last QP ended.
  QpStatus qp_status = QpStatus::Solved;
  /// True when the last QP went to the row solver.
  bool used_rows = false;
};

/// What a planner plans for: fixed when it is made. `Contact` is what the fingers can transmit,
/// `Features` the map from vertices to the points that follow a target.
template <RealScalar Scalar, ContactModel<Scalar> Contact = HardFinger<Scalar>,
          FeatureMap<Scalar> Features = PointFeatures<Scalar>>
struct PlannerSetup {
  /// The scalar type.
  using scalar_type = Scalar;
  /// The contact model of the fingers.
  using contact_type = Contact;

  /// The features that follow a target.
  Features features;
  /// Which vertices are held, and by whom.
  std::vector<Grip<Scalar, Contact>> grips;
  /// The sheet's triangles, for contact normals; may be empty.
  std::vector<std::array<int, 3>> triangles;
  /// One anchor for each grip. Empty: made from the start positions; grip i follows feature i if
  /// there are as many grips as features, and the mean of all features otherwise.
  std::vector<HandAnchor<Scalar>> anchors = {};

  /// Returns an empty string, or a line that names what does not fit a sheet of `vertices`
  /// vertices. Allocates.
  std::string validate(Index vertices) const {
    std::string problem = validate_features<Scalar>(features, vertices);
    if (problem.empty()) problem = validate_grips(grips, vertices);
    for (std::size_t t = 0; problem.empty() && t < triangles.size(); ++t) {
      for (int v : triangles[t]) {
        if (problem.empty() && (v < 0 || v >= vertices))
          problem = "triangle " + std::to_string(t) + " holds vertex " + std::to_string(v) +
                    " off the mesh";
      }
    }
    const Index count = feature_traits<Features>::count(features);
    if (problem.empty() && !anchors.empty() && anchors.size() != grips.size()) {
      problem = "there are " + std::to_string(anchors.size()) + " anchors for " +
                std::to_string(grips.size()) + " grips";
    }
    for (std::size_t i = 0; problem.empty() && i < anchors.size(); ++i) {
      problem = anchors[i].validate(count);
      if (!problem.empty()) problem = "anchor " + std::to_string(i) + problem;
    }
    return problem;
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI
