#pragma once

// A predictor whose free response is a rollout: nonlinear steps of a model from the measured state.
// The held vertices move along a path.
//
//   poses:    the planned velocities
//   forces:   the path of the held vertices that the last plan promised. The rollout gives the
//             forces that hold the sheet on it; the planner counts changes from these. Rolling out
//             the planned forces instead would be unstable: a light corner flies off.
//
// Each frame starts Newton's method from the velocities that the last rollout found for it. How the
// features respond is derived along the rollout (window_jacobian.hpp) where the model has that
// hook: under planned forces, the inner predictor says how the held vertices respond to forces, and
// the rollout how the features respond to the held vertices. Else features respond as the inner
// predictor says, which is linear. The planner needs damping with this predictor
// (PlannerSettings::rollout). The rollout of the last frame is derived, and what is found moves on
// with the window; only the first is derived in its own frame. So the rollout, and the derivation
// with the inner prediction, do not depend on each other, and an executor can run both at the same
// time.

#include <cassert>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/concepts/executor.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/prediction/window.hpp"
#include "clothctl/prediction/window_jacobian.hpp"

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/cloth/mass_spring_rollout.hpp"  // what is compiled once
#include "clothctl/prediction/linearised_predictor.hpp"
#endif

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a RolloutPredictor.
struct RolloutSettings {
  /// Largest number of Newton steps in a frame of a rollout. 0 takes the model's own step.
  int newton_steps = 4;
  /// A Newton step that changes no velocity by more than this is the last of its frame, m/s. In
  /// most frames that is the first step.
  double step_tolerance = 0.1;
  /// Number of Newton steps in the first frame of a force plan, because its force is sent. Not used
  /// when `newton_steps` is 0.
  int first_newton_steps = 5;
  /// A Newton step of that frame that changes no velocity by more than this is its last, m/s.
  double first_step_tolerance = 0.01;
  /// Number of frames after which the response of the features is derived anew along the rollout,
  /// for models with `make_derivative`; in between it moves on with the window. 0: never; features
  /// then respond as the inner predictor says.
  int derivative_interval = 2;
  /// Number of frames that one step of the derivation takes (window_jacobian.hpp). 1 is exact.
  int derivative_stride = 2;

  /// Returns an empty string, or a line that names the first bad setting and its value.
  std::string validate() const {
    if (!is_finite(step_tolerance) || step_tolerance < 0)
      return "step_tolerance is " + number_text(step_tolerance) +
             ", must be finite and not negative";
    if (!is_finite(first_step_tolerance) || first_step_tolerance < 0)
      return "first_step_tolerance is " + number_text(first_step_tolerance) +
             ", must be finite and not negative";
    if (newton_steps < 0)
      return "newton_steps is " + std::to_string(newton_steps) + ", must not be negative";
    if (first_newton_steps < 1)
      return "first_newton_steps is " + std::to_string(first_newton_steps) + ", must be at least 1";
    if (derivative_interval < 0) {
      return "derivative_interval is " + std::to_string(derivative_interval) +
             ", must not be negative";
    }
    if (derivative_stride < 1)
      return "derivative_stride is " + std::to_string(derivative_stride) + ", must be at least 1";
    return {};
  }
};

namespace detail {

/// A model whose rollouts can be derived.
template <class Model>
concept DerivableRollout = requires(const Model& model, const std::vector<int>& driven) {
  cloth_rollout_traits<Model>::make_derivative(model, driven);
};

/// What derives rollouts of a model; nothing where it has no such hook.
template <class Model, RealScalar Scalar>
struct RolloutJacobian {
  struct type {};
};
template <DerivableRollout Model, RealScalar Scalar>
struct RolloutJacobian<Model, Scalar> {
  using type = WindowJacobian<decltype(cloth_rollout_traits<Model>::make_derivative(
                                  std::declval<const Model&>(), std::vector<int>())),
                              Scalar>;
};

}  // namespace detail

/// Predicts the free response by a rollout of `Model`: a MassSpring, or another ClothModel that has
/// `step_from` and `holding_forces` too. `Inner` supplies the impulse response, of the features
/// only where the rollout is not derived.
template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
class RolloutPredictor {
 public:
  /// The planner's scalar.
  using Scalar = typename predictor_traits<Inner>::scalar_type;

  /// Takes a model of the plant and a predictor. Allocates. Fails when the settings are not valid
  /// (assert).
  RolloutPredictor(Model model, Inner inner, RolloutSettings settings = {});

  /// Makes room for requests of this size. Earlier rollouts over as many frames are not forgotten,
  /// whatever vertices were held in them. Allocates.
  void reserve(const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response);

  /// Predicts the window from positions `x` (3×n, m) and velocities `v` (3×n, m/s). Returns false
  /// when the inner predictor does. Where a step of the rollout fails, the prediction is the inner
  /// predictor's. Never allocates after `reserve`.
  bool predict(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
               const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response);

  /// Lets `executor`, which must outlive this, run the rollout and the inner prediction.
  /// Predictions have the same bits with every executor.
  void set_executor(ExecutorRef executor) { executor_ = executor; }

  /// Returns the number of vertices of the sheet.
  Index vertex_count() const { return cloth_traits<Model>::vertex_count(model_); }
  /// Returns whether the inner predictor predicts such inputs: true if it does not say.
  bool predicts(GripInput kind) const { return predicts_input(inner_, kind); }
  /// Forgets earlier rollouts. Call it after the plant jumped.
  void reset() {
    fresh_ = true;
    known_.reset();
    age_ = kNone;
    predictor_traits<Inner>::reset(inner_);
  }

 private:
  using Traits = cloth_rollout_traits<Model>;
  static constexpr bool kParts =
      requires(Inner & inner, const PointsView<Scalar>& x, const WindowRequest<Scalar>& request,
               WindowResponse<Scalar>& response) {
    predictor_traits<Inner>::predict_air(inner, x, x, request, response);
    predictor_traits<Inner>::predict_rest(inner, x, request, response);
  };

  /// Sets the start of the rollout and its forces, and moves the guesses of the last one on.
  void start(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
             const WindowRequest<Scalar>& request, const WindowResponse<Scalar>& response);
  /// Predicts by the inner predictor, or if `brief` and it can, only what the air does.
  bool ask_inner(bool brief, const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                 const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response);
  /// Returns whether the Jacobian is to be derived anew.
  bool is_stale() const { return age_ != kNone && settings_.derivative_interval <= age_; }
  /// What can be done of a Jacobian beside the rollout: derives that of the last frame's rollout if
  /// the present one is too old, and moves it on by a frame.
  void update_jacobian(const WindowRequest<Scalar>& request);
  /// Makes the Jacobian that of the last rollout, whose wind is taken to be that of `request`;
  /// there is none where that fails.
  void derive(const WindowRequest<Scalar>& request, ExecutorRef executor);
  /// Writes the response of the features to the inputs: for forces, by way of the velocities of the
  /// held vertices that `response.impulse_response` gives.
  void write_jacobian(const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response);

  /// Rolls out the window. Returns false when a step fails.
  bool roll_out(const WindowRequest<Scalar>& request, const WindowResponse<Scalar>& inner);

  /// Rolls out frame k: moves the held vertices along the path, writes the outputs to free_ and the
  /// forces that hold these vertices to plan_. Returns false when the step fails.
  bool roll(Index k, const WindowRequest<Scalar>& request, const WindowResponse<Scalar>& inner);

  Model model_;
  Inner inner_;
  RolloutSettings settings_;
  ExecutorRef executor_;
  decltype(cloth_traits<Model>::make_workspace(std::declval<const Model&>())) workspace_;
  ClothState<Scalar> state_;
  ClothInput<Scalar> input_;
  Points<Scalar> holding_;
  MatrixX<Scalar> free_, plan_;
  std::vector<Points<Scalar>> velocities_;
  bool fresh_ = true;
  static constexpr int kNone = -1;
  MatrixX<Scalar> jacobian_, motion_;  // features by velocities, velocities by forces
  int age_ = kNone;                    // frames since the rollout that the Jacobian is of
  // Where rollouts are derived: of the last one, and of the present one.
  std::vector<ClothState<Scalar>> last_states_, states_;
  std::optional<GripInput> known_;  // the inputs to which the response of the held vertices is
  std::optional<typename detail::RolloutJacobian<Model, Scalar>::type> derived_;
};

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
  const std::size_t frames = static_cast<std::size_t>(request.horizon);
  if (velocities_.size() != frames) {
    velocities_.assign(frames, Points<Scalar>::Zero(3, cloth_traits<Model>::vertex_count(model_)));
    fresh_ = true;
  }
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
  age_ = kNone;
  known_.reset();
  if constexpr (detail::DerivableRollout<Model>) {
    if (settings_.derivative_interval == 0) return;
    response.has_jacobian = false;
    derived_.emplace(Traits::make_derivative(model_, request.held), request,
                     static_cast<Index>(settings_.derivative_stride));
    states_.assign(frames + 1, state_);
    last_states_ = states_;
    jacobian_.setZero(3 * request.held_outputs * request.horizon,
                      request.inputs() * request.horizon);
    response.jacobian = jacobian_;
    motion_.setZero(request.inputs(), request.inputs() * request.horizon);
  }
}

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
void RolloutPredictor<Model, Inner>::start(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                                           const WindowRequest<Scalar>& request,
                                           const WindowResponse<Scalar>& response) {
  state_.positions = x;
  state_.velocities = v;
  request.write_outer_force(input_.forces);
  for (const VertexSupport<Scalar>& support : request.supports)
    input_.forces.col(support.vertex) += support.force;
  if constexpr (requires { Traits::set_supports(model_, std::span(request.supports), x); })
    Traits::set_supports(model_, std::span(request.supports), x);
  if (!fresh_) {
    for (std::size_t k = 0; k + 1 < velocities_.size(); ++k)
      velocities_[k].swap(velocities_[k + 1]);
    velocities_.back() = velocities_[velocities_.size() > 1 ? velocities_.size() - 2 : 0];
  }
  plan_ = response.plan;
  if (derived_) states_[0] = state_;
}

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
bool RolloutPredictor<Model, Inner>::predict(const PointsView<Scalar>& x,
                                             const PointsView<Scalar>& v,
                                             const WindowRequest<Scalar>& request,
                                             WindowResponse<Scalar>& response) {
  if (x.cols() != vertex_count() || v.cols() != vertex_count() ||
      !request.supports_fit(vertex_count())) {
    age_ = kNone;  // the window moves on without this
    return false;
  }
  start(x, v, request, response);
  // Where the features have a Jacobian, poses need nothing but the air of the inner predictor. How
  // the held vertices respond to forces may be a frame old where a rollout is derived, too.
  const bool brief = kParts && derived_ && known_ == request.kind &&
                     (request.kind == GripInput::Pose || (is_stale() && request.has_path));
  bool predicted = false, rolled = false;
  const auto beside = [&] {
    predicted = ask_inner(brief, x, v, request, response);
    update_jacobian(request);
  };
  if (request.kind == GripInput::Force && !request.has_path) {
    beside();  // the rollout follows the inner predictor's path
    if (predicted) rolled = roll_out(request, response);
  } else {
    executor_.for_each_block(2, [&](int block) {
      if (block == 0) beside();
      if (block == 1) rolled = roll_out(request, response);
    });
  }
  fresh_ = !rolled;
  if (derived_) response.has_jacobian = false;
  if (predicted && rolled) {
    response.free_response = free_;
    response.plan = plan_;
    last_states_.swap(states_);
    if (age_ == kNone) derive(request, executor_);
    if (age_ != kNone) {
      write_jacobian(request, response);
      response.has_jacobian = true;
    }
  } else {
    age_ = kNone;
  }
  if constexpr (kParts) {
    if (brief && predicted && !response.has_jacobian) {
      predictor_traits<Inner>::predict_rest(inner_, x, request, response);
      if (rolled) {
        response.free_response = free_;
        response.plan = plan_;
      }
    }
  }
  if (!brief || request.kind == GripInput::Force) known_.reset();
  if (!brief && predicted) known_ = request.kind;
  return predicted;
}

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
bool RolloutPredictor<Model, Inner>::ask_inner(bool brief, const PointsView<Scalar>& x,
                                               const PointsView<Scalar>& v,
                                               const WindowRequest<Scalar>& request,
                                               WindowResponse<Scalar>& response) {
  if constexpr (kParts) {
    if (brief) return predictor_traits<Inner>::predict_air(inner_, x, v, request, response);
  }
  return predictor_traits<Inner>::predict(inner_, x, v, request, response);
}

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
void RolloutPredictor<Model, Inner>::update_jacobian(const WindowRequest<Scalar>& request) {
  if (is_stale()) derive(request, {});  // the executor is in use
  if (age_ == kNone) return;
  shift_jacobian(request.horizon, jacobian_);
  ++age_;
}

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
void RolloutPredictor<Model, Inner>::derive(const WindowRequest<Scalar>& request,
                                            ExecutorRef executor) {
  if constexpr (detail::DerivableRollout<Model>) {
    if (derived_) age_ = derived_->evaluate(last_states_, request, executor, jacobian_) ? 0 : kNone;
  }
}

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
void RolloutPredictor<Model, Inner>::write_jacobian(const WindowRequest<Scalar>& request,
                                                    WindowResponse<Scalar>& response) {
  if (request.kind == GripInput::Pose) {
    response.jacobian = jacobian_;
    return;
  }
  const Index m = request.inputs(), p = 3 * request.held_outputs, horizon = request.horizon;
  for (Index d = 0; d < horizon; ++d) {
    motion_.middleCols(d * m, m) = response.impulse_response.block(p, d * m, m, m) / request.dt;
    if (d > 0)
      motion_.middleCols(d * m, m) -=
          response.impulse_response.block(p, (d - 1) * m, m, m) / request.dt;
  }
  response.jacobian.setZero();
  for (Index j = 0; j < horizon; ++j) {
    for (Index i = 0; i < m; ++i) {
      auto column = response.jacobian.col(j * m + i);
      for (Index l = j; l < horizon; ++l) {  // by what moves in frame l, later features
        for (Index c = 0; c < m; ++c)
          column.tail((horizon - l) * p) +=
              motion_(c, (l - j) * m + i) * jacobian_.col(l * m + c).tail((horizon - l) * p);
      }
    }
  }
}

template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
bool RolloutPredictor<Model, Inner>::roll_out(const WindowRequest<Scalar>& request,
                                              const WindowResponse<Scalar>& inner) {
  for (Index k = 0; k < request.horizon; ++k) {
    if (!roll(k, request, inner)) return false;
  }
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
  const Scalar tolerance = Scalar(sent ? settings_.first_step_tolerance : settings_.step_tolerance);
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
  request.write_outputs(state_.positions, k, free_);
  if (derived_) states_[static_cast<std::size_t>(k) + 1] = state_;
  return true;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(
    class RolloutPredictor<MassSpringRollout<double>,
                           LinearisedPredictor<MassSpringResponse<float>, double>>);

}  // namespace clothctl::inline CLOTHCTL_ABI
