#pragma once

// What a planner is made for and what a frame of planning answers.

#include <array>
#include <string>
#include <vector>

#include "clothctl/contact/grip.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/status.hpp"
#include "clothctl/mpc/features.hpp"
#include "clothctl/mpc/grip_basis.hpp"
#include "clothctl/mpc/hand_anchor.hpp"

namespace clothctl {

/// What a planning frame answers. Made by `Planner::make_result`; reused from frame to frame.
template <RealScalar Scalar>
struct PlanResult {
  /// How the frame ended.
  PlanStatus status = PlanStatus::Failed;
  /// What to apply to the plant during the next frame: forces, or driven positions. Wind is left to the caller.
  ClothInput<Scalar> input;
  /// The force of each finger on each of its vertices; empty for poses.
  std::vector<FingerForce<Scalar>> finger_forces;
  /// Raw inputs over the window, 3·held × K: forces (N) or velocities (m/s).
  MatrixX<Scalar> plan;
  /// Features over the window as predicted, 3·features × K, m.
  MatrixX<Scalar> predicted;
  /// Distance between the features measured now and what the last frame predicted for now, root mean square, m.
  Scalar prediction_error = Scalar(0);
  /// 1 - prediction_error / (how far the features moved in the last frame, at least 1 mm), within [0, 1]. 1: the plant does
  /// what was predicted. 1 in the first frame and after a Failed one.
  Scalar agreement = Scalar(1);
  /// Largest predicted non-affine displacement of a held vertex over the window, m.
  Scalar patch_residual = Scalar(0);
  /// QP iterations of the frame, over all attempts.
  int qp_iterations = 0;
  /// How the last QP ended.
  QpStatus qp_status = QpStatus::Solved;
  /// True when the last QP went to the row solver.
  bool used_rows = false;
};

/// What a planner plans for: fixed when it is made.
template <RealScalar Scalar>
struct PlannerSetup {
  /// The features that follow a target.
  PointFeatures<Scalar> features;
  /// Who holds the sheet where.
  std::vector<Grip<Scalar>> grips;
  /// The sheet's triangles, for contact normals; may be empty.
  std::vector<std::array<int, 3>> triangles;
  /// One anchor a grip; empty: made from the start positions (grip i follows feature i if there are as many, else the mean).
  std::vector<HandAnchor<Scalar>> anchors = {};

  /// Returns an empty string, or a line that names what does not fit a sheet of `vertices` vertices. Allocates.
  std::string check(Index vertices) const {
    std::string problem = check_features<Scalar>(features, vertices);
    if (problem.empty()) problem = check_grips(grips, vertices);
    for (std::size_t t = 0; problem.empty() && t < triangles.size(); ++t) {
      for (int v : triangles[t]) {
        if (problem.empty() && (v < 0 || v >= vertices))
          problem = "triangle " + std::to_string(t) + " holds vertex " + std::to_string(v) + " off the mesh";
      }
    }
    if (problem.empty() && !anchors.empty() && anchors.size() != grips.size()) {
      problem = "there are " + std::to_string(anchors.size()) + " anchors for " + std::to_string(grips.size()) + " grips";
    }
    for (std::size_t i = 0; problem.empty() && i < anchors.size(); ++i) {
      problem = anchors[i].check(features.count());
      if (!problem.empty()) problem = "anchor " + std::to_string(i) + problem;
    }
    return problem;
  }
};

}  // namespace clothctl
