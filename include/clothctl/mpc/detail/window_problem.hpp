#pragma once

// Everything that the parts of the planner work on in a frame: what was asked for, the basis of the
// grips, the request to the predictor and its answer, and what was measured of the held vertices.

#include <string>
#include <utility>
#include <vector>

#include "clothctl/mpc/detail/held_patches.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Measured motion of the held vertices, by slot: 3×held each.
template <RealScalar Scalar>
struct HeldMotion {
  /// Measured positions, m.
  Points<Scalar> position;
  /// Measured velocities, m/s.
  Points<Scalar> velocity;
  /// Measured velocities one frame ago, m/s.
  Points<Scalar> last_velocity;
};

/// One planning problem: the fixed setup and the data of the current frame. The first outputs of
/// the window are the features, those after them the held vertices.
template <RealScalar Scalar, ContactModel<Scalar> Contact = HardFinger<Scalar>>
struct WindowProblem {
  /// Makes room for everything whose size the grips and settings fix. Allocates.
  WindowProblem(PlannerSettings<Scalar> planner_settings, GripBasis<Scalar, Contact> grip_basis,
                const PointFeatures<Scalar>& features)
      : settings(std::move(planner_settings)),
        basis(std::move(grip_basis)),
        patches(find_patches(basis)),
        feature_count(features.count()) {
    const std::vector<int>& held = basis.held().vertices();
    const Index held_count = static_cast<Index>(held.size());
    request.horizon = settings.horizon;
    request.dt = settings.dt;
    request.kind = settings.input;
    request.held = held;
    request.outputs = features;
    request.held_outputs = feature_count;
    for (int vertex : held) request.outputs.add_point(vertex);
    request.plan.setZero(request.inputs(), request.horizon);
    request.path.setZero(request.inputs(), request.horizon);
    request.applied.setZero(request.inputs());
    request.wind.setZero(3, request.horizon);
    request.drift.setZero(3, request.horizon);
    for (Points<Scalar>* p : {&motion.position, &motion.velocity, &motion.last_velocity})
      p->setZero(3, held_count);
    if (settings.input == GripInput::Force)
      force_share = settings.gravity_load / Scalar(static_cast<double>(held_count));
  }

  /// The planner's settings.
  PlannerSettings<Scalar> settings;
  /// The map from unknowns to raw inputs.
  GripBasis<Scalar, Contact> basis;
  /// The patches that the grips hold.
  std::vector<HeldPatch<Scalar>> patches;
  /// Number of features.
  Index feature_count;
  /// What is asked of the predictor.
  WindowRequest<Scalar> request;
  /// What it answered.
  WindowResponse<Scalar> response;
  /// What was measured of the held vertices.
  HeldMotion<Scalar> motion;
  /// Share of the gravity load that each held vertex carries, N; zero for poses.
  Vector3<Scalar> force_share = Vector3<Scalar>::Zero();
};

/// Returns an empty string, or why a predictor cannot serve a planner of such inputs and a sheet of
/// so many vertices. Allocates only for that message.
template <class P>
std::string check_predictor(const P& predictor, GripInput input, Index vertices) {
  using Traits = predictor_traits<P>;
  if constexpr (requires { Traits::vertex_count(predictor); }) {
    if (Traits::vertex_count(predictor) != vertices) {
      return "the predictor is made for " + std::to_string(Traits::vertex_count(predictor)) +
             " vertices, the start positions have " + std::to_string(vertices);
    }
  }
  if (!predicts_input(predictor, input)) {
    return input == GripInput::Force ? "the predictor does not predict planned forces"
                                     : "the predictor does not predict planned poses";
  }
  return {};
}

/// Returns true when the predictor's response has the size of the request.
template <RealScalar Scalar, class Contact>
bool response_fits(const WindowProblem<Scalar, Contact>& problem) {
  const WindowRequest<Scalar>& q = problem.request;
  const WindowResponse<Scalar>& r = problem.response;
  return r.impulse_response.rows() == q.output_rows() &&
         r.impulse_response.cols() == q.inputs() * q.horizon && r.plan.rows() == q.inputs() &&
         r.plan.cols() == q.horizon && r.free_response.rows() == q.output_rows() &&
         r.free_response.cols() == q.horizon && (r.air.cols() == 0 || r.air.cols() == q.horizon) &&
         (!r.has_jacobian || (r.jacobian.rows() == 3 * q.held_outputs * q.horizon &&
                              r.jacobian.cols() == q.inputs() * q.horizon));
}

/// Returns the time `k` frames after `t`, s.
template <RealScalar Scalar, class Contact>
Scalar frame_time(const WindowProblem<Scalar, Contact>& problem, Scalar t, Index k) {
  return t + Scalar(static_cast<double>(k)) * problem.settings.dt;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
