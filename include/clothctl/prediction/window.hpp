#pragma once

// The window of a receding horizon: what is asked of a predictor, and what it answers.
//
//   y_k = free_k + Σ_{j=1..k} T_{k-j} (u_j - ū_j),   k = 1..K
//
// y_k are the predicted points at the end of frame k: features, then held vertices. u_k are the raw
// inputs of frame k, three for each held vertex: its force (N) or its velocity (m/s). ū is the plan
// at which the free response was computed. The impulse response T is Toeplitz in time: it depends
// only on k - j. Features may respond frame by frame instead, by a Jacobian.

#include <vector>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/prediction/features.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// What the planner decides on, and what the raw inputs of a window are.
enum class GripInput {
  /// Contact forces. The raw input of a held vertex is the force on it during a frame, N.
  Force,
  /// The pose of each grip. The raw input of a held vertex is its velocity during a frame, m/s; its
  /// motion is prescribed.
  Pose
};

/// What is asked of a predictor. After `reserve`, only plan, path, applied input, wind, drift,
/// outer forces and supports change.
template <RealScalar Scalar>
struct WindowRequest {
  /// Number of frames K.
  Index horizon = 0;
  /// Length of a frame h, s.
  Scalar dt = Scalar(0);
  /// What the raw inputs are.
  GripInput kind = GripInput::Force;
  /// The held vertices; input rows 3i .. 3i+2 belong to the i-th.
  std::vector<int> held;
  /// The points to predict.
  PointFeatures<Scalar> outputs;
  /// Index of the output that is the first held vertex; the others follow in order.
  Index held_outputs = 0;
  /// The plan ū, 3·held × K: forces (N) or velocities (m/s).
  MatrixX<Scalar> plan;
  /// Velocities of the held vertices that the last plan promised for these frames, 3·held × K, m/s.
  /// Valid when `has_path`.
  MatrixX<Scalar> path;
  /// False in the first frame and after a failure.
  bool has_path = false;
  /// Input during the frame that led to the measured state, 3·held. Valid when `has_applied`.
  VectorX<Scalar> applied;
  /// False in the first frame, and when positions are sent where forces are planned.
  bool has_applied = false;
  /// Velocity of the air in each frame, 3×K, m/s.
  Points<Scalar> wind;
  /// Velocity of a translation of the sheet in each frame, 3×K, m/s, for `WindowResponse::air`; no
  /// columns means zero.
  Points<Scalar> drift;
  /// Other known forces on the vertices, constant over the window, 3×n, N; no columns means none.
  Points<Scalar> outer_force;
  /// What carries vertices at the start of the window, each vertex once.
  std::vector<VertexSupport<Scalar>> supports;

  /// Returns true when every support is of a vertex of a sheet of `vertices` vertices.
  bool supports_fit(Index vertices) const {
    for (const VertexSupport<Scalar>& support : supports) {
      if (support.vertex < 0 || vertices <= support.vertex) return false;
    }
    return true;
  }
  /// Writes the outer forces to `out` (3×n, N); zeros where there are none.
  void write_outer_force(Points<Scalar>& out) const {
    if (outer_force.cols() > 0) {
      out = outer_force;
    } else {
      out.setZero();
    }
  }
  /// Writes the outputs of a sheet at `x` (3×n, m) to column k of `out` (3·outputs × K).
  void write_outputs(const PointsView<Scalar>& x, Index k, MatrixX<Scalar>& out) const {
    for (Index i = 0; i < outputs.count(); ++i) {
      Vector3<Scalar> sum = Vector3<Scalar>::Zero();
      outputs.for_each_term(
          i, [&](int vertex, const Scalar& weight) { sum += weight * x.col(vertex); });
      out.template block<3, 1>(3 * i, k) = sum;
    }
  }
  /// Returns the number of raw inputs of a frame.
  Index inputs() const { return 3 * static_cast<Index>(held.size()); }
  /// Returns the number of scalar outputs.
  Index output_rows() const { return 3 * outputs.count(); }
};

/// What a predictor answers.
template <RealScalar Scalar>
struct WindowResponse {
  /// The blocks T_0 .. T_{K-1} side by side, 3·outputs × inputs·K. T_m is the response to an input
  /// m frames earlier.
  MatrixX<Scalar> impulse_response;
  /// How the features (the outputs before `held_outputs`) respond frame by frame, where the
  /// predictor knows it: (3·held_outputs·K) × (inputs·K), block (k, j) is the response in frame k
  /// to an input of frame j, zero for j > k. Valid when `has_jacobian`; the features then do not
  /// respond as `impulse_response` says.
  MatrixX<Scalar> jacobian;
  /// True when `jacobian` holds.
  bool has_jacobian = false;
  /// The plan ū of the free response, inputs × K. It holds the request's plan when `predict` is
  /// called. A predictor whose model needs other inputs to move the hands on the same path puts
  /// those here.
  MatrixX<Scalar> plan;
  /// The outputs at that plan, 3·outputs × K, m.
  MatrixX<Scalar> free_response;
  /// The mean acceleration that the air would give the sheet in each frame if it moved at the
  /// request's drift in the request's wind, as the air acts on it now, and that of the outer forces
  /// across gravity as far as the sheet hangs, 3×K, m/s². No columns: the predictor knows no air.
  Points<Scalar> air;
};

/// Moves a Jacobian of a window on by a frame: block (k, j) becomes block (k + 1, j + 1); the last
/// frame stays, as if the sheet went on as it was. Never allocates.
template <RealScalar Scalar>
void shift_jacobian(Index horizon, MatrixX<Scalar>& jacobian) {
  if (horizon < 2) return;
  const Index p = jacobian.rows() / horizon, m = jacobian.cols() / horizon;
  for (Index k = 0; k + 1 < horizon; ++k) {
    for (Index j = 0; j <= k; ++j)
      jacobian.block(k * p, j * m, p, m) = jacobian.block((k + 1) * p, (j + 1) * m, p, m);
  }
}

/// Moves a prediction from the plan zero to the plan `u` (inputs × K): free_k += Σ_j T_{k-j} u_j
/// for all k. Never allocates.
template <RealScalar Scalar>
void add_plan(const MatrixX<Scalar>& u, WindowResponse<Scalar>& response) {
  const Index inputs = u.rows();
  for (Index k = 0; k < u.cols(); ++k) {
    for (Index j = 0; j <= k; ++j) {
      response.free_response.col(k).noalias() +=
          response.impulse_response.middleCols((k - j) * inputs, inputs) * u.col(j);
    }
  }
}

/// The scalar type of a predictor.
template <class P>
using PredictorScalar = typename predictor_traits<P>::scalar_type;

/// Returns whether a predictor predicts windows of such inputs: true if it does not say.
template <class P>
bool predicts_input(const P& predictor, GripInput kind) {
  if constexpr (requires { predictor_traits<P>::predicts(predictor, kind); }) {
    return predictor_traits<P>::predicts(predictor, kind);
  } else {
    return true;
  }
}

/// A Predictor that takes the planner's requests.
template <class P>
concept WindowPredictor =
    Predictor<P, WindowRequest<PredictorScalar<P>>, WindowResponse<PredictorScalar<P>>>;

}  // namespace clothctl::inline CLOTHCTL_ABI
