#pragma once

// A predictor whose free response is rolled out with the model's own nonlinear step along the plan, and whose impulse
// response is that of another (frozen) predictor:
//
// Forces are rolled out as the hand path that the inner predictor expects of them: a light corner under a fixed force profile
// is an unstable thing to roll out, the same corner on a path is not.
//
//   free_k = C x_k,  x_k from `newton_steps` Newton steps on the converged step's energy, started at the velocities that the
//   last
//                    rollout found for the same frame;  0 steps: the one-solve step, linearised anew in every frame
//
// A receding-horizon iterative-learning update: the residual is that of the nonlinear model, the frozen response only turns
// it into a correction. The planner needs damping with it (PlannerSettings::rollout).

#include <utility>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/mpc/window.hpp"

namespace clothctl {

/// Settings of a RolloutPredictor.
struct RolloutSettings {
  /// Newton steps in each frame of a rollout; 0 takes the model's one-solve step instead.
  int newton_steps = 3;
};

/// Predicts the free response by rolling `Model` out. `Inner` supplies the impulse response.
template <class Model, class Inner>
class RolloutPredictor {
 public:
  /// The planner's scalar.
  using Scalar = typename Inner::Scalar;

  /// Takes over a copy of the plant's model (or of what is known of it) and a predictor. Allocates.
  RolloutPredictor(Model model, Inner inner, RolloutSettings settings = {})
      : model_(std::move(model)),
        inner_(std::move(inner)),
        settings_(settings),
        workspace_(model_.make_workspace()),
        state_(model_.rest_state()) {}

  /// Makes room for requests of this size. Allocates.
  void reserve(const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response) {
    inner_.reserve(request, response);
    velocities_.assign(static_cast<std::size_t>(request.horizon), Points<Scalar>::Zero(3, model_.vertex_count()));
    input_.clear();
    const Index held = static_cast<Index>(request.held.size());
    input_.driven_vertices = request.held;
    input_.driven_positions.setZero(3, held);
    const Index count = model_.vertex_count();
    input_.forces.setZero(3, count);
    for (Index i = 0; i < count; ++i) input_.force_vertices.push_back(static_cast<int>(i));
    fresh_ = true;
  }

  /// Predicts the window. Falls back on the inner predictor's free response from the frame where a rollout step fails.
  /// Never allocates after `reserve`.
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
    for (Index k = 0; k < request.horizon; ++k) {
      input_.wind = request.wind.col(k);
      for (Index j = 0; j < static_cast<Index>(request.held.size()); ++j) {
        const Vector3<Scalar> u = request.plan.template block<3, 1>(3 * j, k);
        if (request.kind == InputKind::Force) {
          input_.driven_positions.col(j) = response.free.template block<3, 1>(3 * (request.held_outputs + j), k);
        } else {
          input_.driven_positions.col(j) = state_.positions.col(request.held[static_cast<std::size_t>(j)]) + request.dt * u;
        }
      }
      Points<Scalar>& guess = velocities_[static_cast<std::size_t>(k)];
      const bool plain = fresh_ || settings_.newton_steps == 0;
      const StepReport<Scalar> report =
          plain ? model_.step(state_, input_, request.dt, workspace_)
                : model_.step_from(guess, settings_.newton_steps, state_, input_, request.dt, workspace_);
      if (!report.advanced) {
        fresh_ = true;
        return true;
      }
      guess = state_.velocities;
      for (Index i = 0; i < request.outputs.count(); ++i) {
        Vector3<Scalar> sum = Vector3<Scalar>::Zero();
        request.outputs.for_each_term(i,
                                      [&](int vertex, const Scalar& weight) { sum += weight * state_.positions.col(vertex); });
        response.free.template block<3, 1>(3 * i, k) = sum;
      }
    }
    fresh_ = false;
    return true;
  }

  /// Forgets earlier rollouts (after a jump of the plant).
  void reset() {
    fresh_ = true;
    inner_.reset();
  }

 private:
  Model model_;
  Inner inner_;
  RolloutSettings settings_;
  typename Model::Workspace workspace_;
  ClothState<Scalar> state_;
  ClothInput<Scalar> input_;
  std::vector<Points<Scalar>> velocities_;
  bool fresh_ = true;
};

}  // namespace clothctl
