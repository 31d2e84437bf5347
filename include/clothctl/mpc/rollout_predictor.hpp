#pragma once

// A predictor whose free response is rolled out with the model's own nonlinear step along the path that the last plan promised
// for the hands, and whose impulse response is that of another (frozen) predictor:
//
//   free_k = C x_k,  x_k from a few Newton steps on the converged step's energy, started at the velocities that the last
//                    rollout found for the same frame;  0 steps: the one-solve step, linearised anew in every frame
//   ū_k    = velocity input: the path itself;  force input: what the model's hands must give to stay on it
//
// A force profile is an unstable thing to roll out (a light corner flies off), a path of the hands is not; so forces are kept
// between frames as the path that they were to cause, and made anew from the nonlinear model each frame. The first frame's
// force, which is sent, then moves the hand as planned if the plant is the model, whatever the linearisation.
//
// A receding-horizon iterative-learning update: the residual is that of the nonlinear model, the frozen response only turns
// it into a correction. The planner needs damping with it (PlannerSettings::rollout).

#include <cassert>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/mpc/window.hpp"

namespace clothctl {

/// Settings of a RolloutPredictor.
struct RolloutSettings {
  /// Most Newton steps in a frame of a rollout; 0 takes the model's one-solve step instead.
  int newton_steps = 4;
  /// A Newton step that changes no velocity by more than this ends the frame, m/s; mostly one does.
  double step_tolerance = 0.1;
  /// Newton steps in the first frame where forces are planned, since its force is sent; not used with 0 `newton_steps`.
  int first_newton_steps = 5;

  /// Returns an empty string, or a line that names the first bad setting and its value.
  std::string check() const {
    if (!is_finite(step_tolerance) || step_tolerance < 0)
      return "step_tolerance is " + number_text(step_tolerance) + ", must be finite and not negative";
    if (newton_steps < 0) return "newton_steps is " + std::to_string(newton_steps) + ", must not be negative";
    if (first_newton_steps < 1) return "first_newton_steps is " + std::to_string(first_newton_steps) + ", must be at least 1";
    return {};
  }
};

/// Predicts the free response by rolling `Model` (a MassSpring, or a ClothModel with its `step_from` and `holding_forces`) out.
/// `Inner` supplies the impulse response.
template <class Model, class Inner>
class RolloutPredictor {
 public:
  /// The planner's scalar.
  using Scalar = typename Inner::Scalar;

  /// Takes over a copy of the plant's model (or of what is known of it) and a predictor. Allocates. Fails when: the settings do
  /// not pass their check (assert).
  RolloutPredictor(Model model, Inner inner, RolloutSettings settings = {})
      : model_(std::move(model)),
        inner_(std::move(inner)),
        settings_(settings),
        workspace_(model_.make_workspace()),
        state_(model_.rest_state()) {
    assert(settings.check().empty());
  }

  /// Makes room for requests of this size. Allocates.
  void reserve(const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response) {
    inner_.reserve(request, response);
    velocities_.assign(static_cast<std::size_t>(request.horizon), Points<Scalar>::Zero(3, model_.vertex_count()));
    input_.clear();
    const Index held = static_cast<Index>(request.held.size());
    input_.driven_vertices = request.held;
    input_.driven_positions.setZero(3, held);
    holding_.setZero(3, held);
    const Index count = model_.vertex_count();
    input_.forces.setZero(3, count);
    for (Index i = 0; i < count; ++i) input_.force_vertices.push_back(static_cast<int>(i));
    free_ = response.free;
    plan_.setZero(request.inputs(), request.horizon);
    fresh_ = true;
  }

  /// Predicts the window. Where a step of the rollout fails, the answer is the inner predictor's. Never allocates after
  /// `reserve`.
  bool predict(const PointsView<Scalar>& x, const PointsView<Scalar>& v, const WindowRequest<Scalar>& request,
               WindowResponse<Scalar>& response) {
    if (!inner_.predict(x, v, request, response)) return false;
    state_.positions = x;
    state_.velocities = v;
    if (request.outer_force.cols() > 0) {
      input_.forces = request.outer_force;
    } else {
      input_.forces.setZero();
    }
    if (!fresh_) {
      for (std::size_t k = 0; k + 1 < velocities_.size(); ++k) velocities_[k].swap(velocities_[k + 1]);
      velocities_.back() = velocities_[velocities_.size() > 1 ? velocities_.size() - 2 : 0];
    }
    plan_ = response.plan;
    for (Index k = 0; k < request.horizon; ++k) {
      if (!roll(k, request, response)) {
        fresh_ = true;
        return true;
      }
    }
    response.free = free_;
    response.plan = plan_;
    fresh_ = false;
    return true;
  }

  /// Number of vertices of the sheet.
  Index vertex_count() const { return model_.vertex_count(); }
  /// Forgets earlier rollouts (after a jump of the plant).
  void reset() {
    fresh_ = true;
    inner_.reset();
  }

 private:
  /// Steps frame k: hands along the path, outputs to free_, the hands' forces to plan_.
  bool roll(Index k, const WindowRequest<Scalar>& request, const WindowResponse<Scalar>& inner) {
    const bool force = request.kind == InputKind::Force;
    const Index held = static_cast<Index>(request.held.size());
    input_.wind = request.wind.col(k);
    for (Index j = 0; j < held; ++j) {
      if (force && !request.has_path) {  // the path that the inner predictor expects
        input_.driven_positions.col(j) = inner.free.template block<3, 1>(3 * (request.held_outputs + j), k);
        continue;
      }
      const MatrixX<Scalar>& path = force ? request.path : request.plan;
      input_.driven_positions.col(j) =
          state_.positions.col(request.held[static_cast<std::size_t>(j)]) + request.dt * path.template block<3, 1>(3 * j, k);
    }
    Points<Scalar>& guess = velocities_[static_cast<std::size_t>(k)];
    const bool sent = force && k == 0;
    const int newton_steps = sent ? settings_.first_newton_steps : settings_.newton_steps;
    const Scalar tolerance = Scalar(sent ? 0.0 : settings_.step_tolerance);
    const bool plain = fresh_ || settings_.newton_steps == 0;
    const StepReport<Scalar> report =
        plain ? model_.step(state_, input_, request.dt, workspace_)
              : model_.step_from(guess, newton_steps, state_, input_, request.dt, workspace_, tolerance);
    if (!report.advanced) return false;
    guess = state_.velocities;
    if (force) {
      model_.holding_forces(request.held, workspace_, holding_);
      for (Index j = 0; j < held; ++j) plan_.template block<3, 1>(3 * j, k) = holding_.col(j);
    }
    for (Index i = 0; i < request.outputs.count(); ++i) {
      Vector3<Scalar> sum = Vector3<Scalar>::Zero();
      request.outputs.for_each_term(i, [&](int vertex, const Scalar& weight) { sum += weight * state_.positions.col(vertex); });
      free_.template block<3, 1>(3 * i, k) = sum;
    }
    return true;
  }

  Model model_;
  Inner inner_;
  RolloutSettings settings_;
  typename Model::Workspace workspace_;
  ClothState<Scalar> state_;
  ClothInput<Scalar> input_;
  Points<Scalar> holding_;
  MatrixX<Scalar> free_, plan_;
  std::vector<Points<Scalar>> velocities_;
  bool fresh_ = true;
};

}  // namespace clothctl
