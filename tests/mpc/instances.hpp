#pragma once

// The planners that most tests of this folder use, those that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/cloth/mass_spring_rollout.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/prediction/linearised_predictor.hpp"
#include "clothctl/prediction/rollout_predictor.hpp"

namespace clothctl_test {

using FrozenPredictor = clothctl::LinearisedPredictor<clothctl::MassSpringResponse<float>, double>;
using FrozenPlanner = clothctl::Planner<FrozenPredictor>;
using RollingPredictor =
    clothctl::RolloutPredictor<clothctl::MassSpringRollout<double>, FrozenPredictor>;
using RollingPlanner = clothctl::Planner<RollingPredictor>;

/// Rolls out a model by steps of its own equations.
inline RollingPredictor rolling_predictor(const clothctl::MassSpring<double>& model,
                                          clothctl::RolloutSettings settings = {}) {
  clothctl::RolloutModelSettings steps;
  steps.integration = model.settings().integration;
  return {clothctl::MassSpringRollout<double>(model, steps),
          FrozenPredictor(clothctl::MassSpringResponse<float>(model)), settings};
}

/// A FrozenPredictor that fails on request.
struct FailingPredictor {
  using Scalar = double;
  FrozenPredictor inner;
  bool* fails;
  void reserve(const clothctl::WindowRequest<double>& request,
               clothctl::WindowResponse<double>& response) {
    inner.reserve(request, response);
  }
  bool predict(const clothctl::PointsView<double>& x, const clothctl::PointsView<double>& v,
               const clothctl::WindowRequest<double>& request,
               clothctl::WindowResponse<double>& response) {
    return !*fails && inner.predict(x, v, request, response);
  }
  void reset() { inner.reset(); }
};

}  // namespace clothctl_test
