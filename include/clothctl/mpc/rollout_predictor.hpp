#pragma once

// Predicts the free response by rolling `Model` out; `Inner` predicts the impulse response. See the
// head of this file.

#include <cassert>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/mpc/window.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a RolloutPredictor.
struct RolloutSettings {
  /// Largest number of Newton steps in a frame of a rollout. 0 takes the model's own step.
  int newton_steps = 4;
  /// A Newton step that changes no velocity by more than this is the last of its frame, m/s. Mostly
  /// the first is.
  double step_tolerance = 0.1;
  /// Number of Newton steps in the first frame of a force plan, because its force is sent. Not used
  /// when `newton_steps` is 0.
  int first_newton_steps = 5;

  /// Returns an empty string, or a line that names the first bad setting and its value.
  std::string validate() const {
    if (!is_finite(step_tolerance) || step_tolerance < 0)
      return "step_tolerance is " + number_text(step_tolerance) +
             ", must be finite and not negative";
    if (newton_steps < 0)
      return "newton_steps is " + std::to_string(newton_steps) + ", must not be negative";
    if (first_newton_steps < 1)
      return "first_newton_steps is " + std::to_string(first_newton_steps) + ", must be at least 1";
    return {};
  }
};

/// Predicts the free response by rolling `Model` (a MassSpring, or a ClothModel with its
/// `step_from` and `holding_forces`) out. `Inner` supplies the impulse response.
template <class Model, class Inner>
requires ClothRollout<Model, typename predictor_traits<Inner>::scalar_type>
class RolloutPredictor {
 public:
  /// The planner's scalar.
  using Scalar = typename predictor_traits<Inner>::scalar_type;

  /// Takes a model of the plant and a predictor. Allocates. Fails when the settings are not valid
  /// (assert).
  RolloutPredictor(Model model, Inner inner, RolloutSettings settings = {});

  /// Makes room for requests of this size. Allocates.
  void reserve(const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response);

  /// Predicts the window from positions `x` (3×n, m) and velocities `v` (3×n, m/s). Returns false
  /// when the inner predictor does. Where a step of the rollout fails, the prediction is the inner
  /// predictor's. Never allocates after `reserve`.
  bool predict(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
               const WindowRequest<Scalar>& request, WindowResponse<Scalar>& response);

  /// Returns the number of vertices of the sheet.
  Index vertex_count() const { return cloth_traits<Model>::vertex_count(model_); }
  /// Forgets earlier rollouts. Call it after the plant jumped.
  void reset() {
    fresh_ = true;
    predictor_traits<Inner>::reset(inner_);
  }

 private:
  /// Rolls frame k: moves the hands along the path, writes the outputs to free_ and the forces of
  /// the hands to plan_.
  bool roll(Index k, const WindowRequest<Scalar>& request, const WindowResponse<Scalar>& inner);

  Model model_;
  Inner inner_;
  RolloutSettings settings_;
  decltype(cloth_traits<Model>::make_workspace(std::declval<const Model&>())) workspace_;
  ClothState<Scalar> state_;
  ClothInput<Scalar> input_;
  Points<Scalar> holding_;
  MatrixX<Scalar> free_, plan_;
  std::vector<Points<Scalar>> velocities_;
  bool fresh_ = true;
};

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/mpc/detail/rollout_predictor_impl.hpp"
