#pragma once

// The planners that most tests of this folder use, those that CLOTHCTL_PRECOMPILED compiles once.

#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/mpc/linearised_predictor.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/rollout_predictor.hpp"

namespace clothctl_test {

using FrozenPredictor = clothctl::LinearisedPredictor<clothctl::MassSpringResponse<float>, double>;
using FrozenPlanner = clothctl::Planner<FrozenPredictor>;
using RollingPredictor = clothctl::RolloutPredictor<clothctl::MassSpring<double>, FrozenPredictor>;
using RollingPlanner = clothctl::Planner<RollingPredictor>;

}  // namespace clothctl_test
