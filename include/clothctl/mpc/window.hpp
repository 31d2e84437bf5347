#pragma once

// A receding-horizon window: what is asked of a predictor and what it answers.
//
//   y_k = free_k + Σ_{j=1..k} T_{k-j} (u_j - ū_j),   k = 1..K
//
// y: chosen points (features, held vertices), u_k: the raw inputs of frame k, three for each held vertex: its force (N) or
// its velocity (m/s). ū: the plan that `free` was predicted at. The response is Toeplitz in time: T depends on k - j alone.

#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/mpc/features.hpp"

namespace clothctl {

/// What a raw input of the planner is.
enum class InputKind {
  /// The force on a held vertex during a frame, N.
  Force,
  /// The velocity of a held vertex during a frame, m/s; its motion is prescribed.
  Velocity
};

/// What is asked of a predictor: fixed by `reserve`, but for the plan and the outer influences of each frame.
template <RealScalar Scalar>
struct WindowRequest {
  /// Number of frames K.
  Index horizon = 0;
  /// Length of a frame h, s.
  Scalar dt = Scalar(0);
  /// What the inputs are.
  InputKind kind = InputKind::Force;
  /// The held vertices; input rows 3i … 3i+2 belong to the i-th.
  std::vector<int> held;
  /// The points to predict.
  PointFeatures<Scalar> outputs;
  /// Index of the output that is the first held vertex; the others follow in order.
  Index held_outputs = 0;
  /// The plan ū, 3·held × K: forces (N) or velocities (m/s).
  MatrixX<Scalar> plan;
  /// Velocities of the held vertices that the last plan promised for these frames, 3·held × K, m/s; valid where `has_path`.
  MatrixX<Scalar> path;
  /// False in the first frame and after a failure.
  bool has_path = false;
  /// Input that was applied during the frame that led to the measured state, 3·held; valid where `has_applied`.
  VectorX<Scalar> applied;
  /// False in the first frame, and where something else was sent than what is planned (positions for forces).
  bool has_applied = false;
  /// Velocity of the air in each frame, 3×K, m/s.
  Points<Scalar> wind;
  /// Other known forces on the vertices, constant over the window, 3×n, N; no columns means none.
  Points<Scalar> outer_force;

  /// Number of raw inputs a frame.
  Index inputs() const { return 3 * static_cast<Index>(held.size()); }
  /// Number of scalar outputs.
  Index output_rows() const { return 3 * outputs.count(); }
};

/// What a predictor answers.
template <RealScalar Scalar>
struct WindowResponse {
  /// The blocks T_0 … T_{K-1} side by side, 3·outputs × inputs·K; T_m answers an input of m frames ago.
  MatrixX<Scalar> impulse;
  /// The plan ū that `free` belongs to, inputs × K. Holds the request's when `predict` is called; a predictor whose model needs
  /// other inputs for the same path of the hands puts those here.
  MatrixX<Scalar> plan;
  /// The outputs at that plan, 3·outputs × K, m.
  MatrixX<Scalar> free;
};

/// free += Σ_j T_{k-j} u_j for all k: moves a prediction from the plan zero to the plan `u` (inputs × K). Never allocates.
template <RealScalar Scalar>
void add_plan(const MatrixX<Scalar>& u, WindowResponse<Scalar>& response) {
  const Index inputs = u.rows();
  for (Index k = 0; k < u.cols(); ++k) {
    for (Index j = 0; j <= k; ++j) {
      response.free.col(k).noalias() += response.impulse.middleCols((k - j) * inputs, inputs) * u.col(j);
    }
  }
}

}  // namespace clothctl
