#pragma once

// A predictor made of a simulator alone: any ClothModel, without derivatives. For cloths whose
// motion no linearised step of springs describes, such as position-based ones, whose stiffness
// comes from unfinished sweeps.
//
//   free response     the model's steps along the last plan ū
//   impulse response  T_m e_j = (y_{m+1}(ū + ε e_j in the first frame) - y_{m+1}(ū)) / ε, one
//                     rollout for each input j
//
// The inputs are velocities of the held vertices, which are driven (poses); ε is the difference of
// the settings over the length of a frame. If the model is the plant, the free response is exact.
// Rollouts do not depend on each other, so an executor can run them at the same time. Hands do not
// lead by wind, drag or outer forces: a simulator does not tell them apart from the rest.

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/concepts/executor.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/prediction/window.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a SimulatorPredictor.
struct SimulatorPredictorSettings {
  /// By how much a held vertex is moved in the first frame of a rollout for the impulse response,
  /// m: less than the folds of the sheet, more than rounding errors.
  double difference = 1e-3;

  /// Returns an empty string, or a line that names the first bad setting and its value.
  std::string validate() const {
    if (!is_finite(difference) || !(0 < difference))
      return "difference is " + number_text(difference) + ", must be positive";
    return {};
  }
};

/// Predicts planned poses by rollouts of `Model`, for planners of the scalar S. Complexity:
/// (1 + inputs) × K steps of the model.
template <class Model, RealScalar S = typename Model::Scalar>
requires ClothModel<Model, S>
class SimulatorPredictor {
 public:
  /// The planner's scalar.
  using Scalar = S;

  /// Takes a model of the plant. Fails when the settings are not valid (assert).
  explicit SimulatorPredictor(Model model, SimulatorPredictorSettings settings = {})
      : model_(std::move(model)), settings_(settings) {
    assert(settings.validate().empty());
  }

  /// Makes room for requests of this size. Allocates.
  void reserve(const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response);

  /// Predicts the window from positions `x` (3×n, m) and velocities `v` (3×n, m/s). Returns false
  /// when a step of the model fails, for planned forces, and for a request that does not fit; the
  /// response is then as it was. Never allocates after `reserve`.
  bool predict(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
               const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response);

  /// Lets `executor`, which must outlive this, run the rollouts. Predictions have the same bits
  /// with every executor.
  void set_executor(ExecutorRef executor) { executor_ = executor; }

  /// Returns the number of vertices of the sheet.
  Index vertex_count() const { return cloth_traits<Model>::vertex_count(model_); }
  /// Returns true for poses. A light corner under planned forces flies off in a rollout.
  static bool predicts(GripInput kind) { return kind == GripInput::Pose; }
  /// Does nothing: no prediction depends on earlier ones.
  void reset() {}

 private:
  using Request = WindowRequest<Scalar>;

  /// A simulation of the sheet.
  struct Rollout {
    ClothState<Scalar> state;
    ClothInput<Scalar> input;
    decltype(cloth_traits<Model>::make_workspace(std::declval<const Model&>())) workspace;
    MatrixX<Scalar> outputs;
    bool finished;
  };

  /// Rolls out the plan of a request, with input j of the first frame changed by `change` (m/s);
  /// j < 0: as it is.
  void roll_out(const Request& request, Index j, const Scalar& change, Rollout& rollout) const;

  /// Writes outer forces and supports to the input of a rollout. A support pushes less as its
  /// vertex lifts off, but no harder as it is pressed.
  void add_forces(const Request& request, Rollout& rollout) const;

  Model model_;
  SimulatorPredictorSettings settings_;
  ExecutorRef executor_;
  ClothState<Scalar> start_;
  std::vector<Rollout> rollouts_;  // the first is the free response, those of inputs follow
};

template <class Model, RealScalar S>
requires ClothModel<Model, S>
void SimulatorPredictor<Model, S>::reserve(const Request& request,
                                           WindowResponse<Scalar>& response) {
  const Index n = vertex_count(), inputs = request.inputs();
  response.impulse_response.setZero(request.output_rows(), inputs * request.horizon);
  response.plan.setZero(inputs, request.horizon);
  response.free_response.setZero(request.output_rows(), request.horizon);
  response.air.resize(3, 0);
  ClothInput<Scalar> input;
  input.driven_vertices = request.held;
  input.driven_positions.setZero(3, static_cast<Index>(request.held.size()));
  input.forces.setZero(3, n);
  for (Index i = 0; i < n; ++i) input.force_vertices.push_back(static_cast<int>(i));
  start_ = cloth_traits<Model>::rest_state(model_);
  rollouts_.clear();
  for (Index i = 0; i <= inputs; ++i) {
    rollouts_.push_back({start_, input, cloth_traits<Model>::make_workspace(model_),
                         response.free_response, false});
  }
}

template <class Model, RealScalar S>
requires ClothModel<Model, S>
void SimulatorPredictor<Model, S>::add_forces(const Request& request, Rollout& rollout) const {
  Points<Scalar>& sum = rollout.input.forces;
  request.write_outer_force(sum);
  for (const VertexSupport<Scalar>& support : request.supports) {
    const int v = support.vertex;
    const Vector3<Scalar> moved = rollout.state.positions.col(v) - start_.positions.col(v);
    Scalar lifted = support.normal.dot(moved);
    if (lifted < Scalar(0)) lifted = Scalar(0);
    if (!(lifted < support.release)) continue;
    sum.col(v) += support.force - support.stiffness() * lifted * support.normal;
  }
}

template <class Model, RealScalar S>
requires ClothModel<Model, S>
void SimulatorPredictor<Model, S>::roll_out(const Request& request, Index j, const Scalar& change,
                                            Rollout& rollout) const {
  ClothState<Scalar>& state = rollout.state;
  ClothInput<Scalar>& input = rollout.input;
  state = start_;
  rollout.finished = false;
  for (Index k = 0; k < request.horizon; ++k) {
    input.wind = request.wind.col(k);
    add_forces(request, rollout);
    for (Index i = 0; i < input.driven_positions.cols(); ++i)
      input.driven_positions.col(i) =
          state.positions.col(request.held[static_cast<std::size_t>(i)]) +
          request.dt * request.plan.template block<3, 1>(3 * i, k);
    if (k == 0 && 0 <= j) input.driven_positions(j % 3, j / 3) += request.dt * change;
    if (!cloth_traits<Model>::step(model_, state, input, request.dt, rollout.workspace).advanced)
      return;
    request.write_outputs(state.positions, k, rollout.outputs);
  }
  rollout.finished = true;
}

template <class Model, RealScalar S>
requires ClothModel<Model, S>
bool SimulatorPredictor<Model, S>::predict(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                                           const Request& request,
                                           WindowResponse<Scalar>& response) {
  const Index inputs = request.inputs();
  if (!predicts(request.kind) || x.cols() != vertex_count() || v.cols() != vertex_count() ||
      rollouts_.size() != static_cast<std::size_t>(inputs) + 1 ||
      rollouts_[0].outputs.cols() != request.horizon ||
      rollouts_[0].outputs.rows() != request.output_rows() || !request.supports_fit(x.cols()))
    return false;
  start_.positions = x;
  start_.velocities = v;
  const Scalar change = Scalar(settings_.difference) / request.dt;
  executor_.for_each_block(static_cast<int>(inputs) + 1, [&](int block) {
    roll_out(request, block - 1, change, rollouts_[static_cast<std::size_t>(block)]);
  });
  if (!std::all_of(rollouts_.begin(), rollouts_.end(), [](const Rollout& r) { return r.finished; }))
    return false;
  const MatrixX<Scalar>& free = rollouts_[0].outputs;
  for (Index j = 0; j < inputs; ++j) {
    const MatrixX<Scalar>& moved = rollouts_[static_cast<std::size_t>(j) + 1].outputs;
    for (Index m = 0; m < request.horizon; ++m)
      response.impulse_response.col(m * inputs + j) = (moved.col(m) - free.col(m)) / change;
  }
  response.free_response = free;
  response.plan = request.plan;
  return true;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
