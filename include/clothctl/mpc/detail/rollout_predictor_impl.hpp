#pragma once

// Members of RolloutPredictor (clothctl/mpc/rollout_predictor.hpp).

#include "clothctl/mpc/rollout_predictor.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
RolloutPredictor<Model, Inner>::RolloutPredictor(Model model, Inner inner, RolloutSettings settings)
    : model_(std::move(model)),
      inner_(std::move(inner)),
      settings_(settings),
      workspace_(cloth_traits<Model>::make_workspace(model_)),
      state_(cloth_traits<Model>::rest_state(model_)) {
  assert(settings.validate().empty());
}

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
void RolloutPredictor<Model, Inner>::reserve(const WindowRequest<Scalar>& request,
                                             WindowResponse<Scalar>& response) {
  predictor_traits<Inner>::reserve(inner_, request, response);
  velocities_.assign(static_cast<std::size_t>(request.horizon),
                     Points<Scalar>::Zero(3, cloth_traits<Model>::vertex_count(model_)));
  input_.clear();
  const Index held = static_cast<Index>(request.held.size());
  input_.driven_vertices = request.held;
  input_.driven_positions.setZero(3, held);
  holding_.setZero(3, held);
  const Index count = cloth_traits<Model>::vertex_count(model_);
  input_.forces.setZero(3, count);
  for (Index i = 0; i < count; ++i) input_.force_vertices.push_back(static_cast<int>(i));
  free_ = response.free_response;
  plan_.setZero(request.inputs(), request.horizon);
  fresh_ = true;
}

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
bool RolloutPredictor<Model, Inner>::predict(const PointsView<Scalar>& x,
                                             const PointsView<Scalar>& v,
                                             const WindowRequest<Scalar>& request,
                                             WindowResponse<Scalar>& response) {
  if (!predictor_traits<Inner>::predict(inner_, x, v, request, response)) return false;
  state_.positions = x;
  state_.velocities = v;
  if (request.outer_force.cols() > 0) {
    input_.forces = request.outer_force;
  } else {
    input_.forces.setZero();
  }
  if (!fresh_) {
    for (std::size_t k = 0; k + 1 < velocities_.size(); ++k)
      velocities_[k].swap(velocities_[k + 1]);
    velocities_.back() = velocities_[velocities_.size() > 1 ? velocities_.size() - 2 : 0];
  }
  plan_ = response.plan;
  for (Index k = 0; k < request.horizon; ++k) {
    if (!roll(k, request, response)) {
      fresh_ = true;
      return true;
    }
  }
  response.free_response = free_;
  response.plan = plan_;
  fresh_ = false;
  return true;
}

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
bool RolloutPredictor<Model, Inner>::roll(Index k, const WindowRequest<Scalar>& request,
                                          const WindowResponse<Scalar>& inner) {
  const bool force = request.kind == GripInput::Force;
  const Index held = static_cast<Index>(request.held.size());
  input_.wind = request.wind.col(k);
  for (Index j = 0; j < held; ++j) {
    if (force && !request.has_path) {  // the path that the inner predictor expects
      input_.driven_positions.col(j) =
          inner.free_response.template block<3, 1>(3 * (request.held_outputs + j), k);
      continue;
    }
    const MatrixX<Scalar>& path = force ? request.path : request.plan;
    input_.driven_positions.col(j) =
        state_.positions.col(request.held[static_cast<std::size_t>(j)]) +
        request.dt * path.template block<3, 1>(3 * j, k);
  }
  Points<Scalar>& guess = velocities_[static_cast<std::size_t>(k)];
  const bool sent = force && k == 0;
  const int newton_steps = sent ? settings_.first_newton_steps : settings_.newton_steps;
  const Scalar tolerance = Scalar(sent ? 0.0 : settings_.step_tolerance);
  const bool plain = fresh_ || settings_.newton_steps == 0;
  const StepReport<Scalar> report =
      plain ? cloth_traits<Model>::step(model_, state_, input_, request.dt, workspace_)
            : cloth_rollout_traits<Model>::step_from(model_, guess, newton_steps, state_, input_,
                                                     request.dt, workspace_, tolerance);
  if (!report.advanced) return false;
  guess = state_.velocities;
  if (force) {
    cloth_rollout_traits<Model>::holding_forces(model_, request.held, workspace_, holding_);
    for (Index j = 0; j < held; ++j) plan_.template block<3, 1>(3 * j, k) = holding_.col(j);
  }
  for (Index i = 0; i < request.outputs.count(); ++i) {
    Vector3<Scalar> sum = Vector3<Scalar>::Zero();
    request.outputs.for_each_term(
        i, [&](int vertex, const Scalar& weight) { sum += weight * state_.positions.col(vertex); });
    free_.template block<3, 1>(3 * i, k) = sum;
  }
  return true;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
