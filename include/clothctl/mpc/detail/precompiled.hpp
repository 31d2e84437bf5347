#pragma once

// What CLOTHCTL_PRECOMPILED compiles once of the planner (config.hpp): the predictors of the
// mass-spring sheet and the planner with each.

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/mpc/linearised_predictor.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/rollout_predictor.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {
using SheetPredictor = LinearisedPredictor<MassSpringResponse<float>, double>;
using SheetRollout = RolloutPredictor<MassSpring<double>, SheetPredictor>;
}  // namespace detail

CLOTHCTL_INSTANTIATE(class LinearisedPredictor<MassSpringResponse<float>, double>);
CLOTHCTL_INSTANTIATE(class RolloutPredictor<MassSpring<double>, detail::SheetPredictor>);
CLOTHCTL_INSTANTIATE(class Planner<detail::SheetPredictor>);
CLOTHCTL_INSTANTIATE(class Planner<detail::SheetRollout>);

}  // namespace clothctl::inline CLOTHCTL_ABI
