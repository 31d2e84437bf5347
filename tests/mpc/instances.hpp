#pragma once

// The planners that most tests of this folder use, compiled once (instances.cpp).

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

#ifndef CLOTHCTL_TEST_INSTANCES
extern template class clothctl::BoxActiveSet<double>;
extern template class clothctl::ActiveSet<double>;
extern template class clothctl::MassSpring<double>;
extern template class clothctl::MassSpringResponse<float>;
extern template class clothctl::LinearisedPredictor<clothctl::MassSpringResponse<float>, double>;
extern template class clothctl::RolloutPredictor<clothctl::MassSpring<double>,
                                                 clothctl_test::FrozenPredictor>;
extern template class clothctl::Planner<clothctl_test::FrozenPredictor>;
extern template class clothctl::Planner<clothctl_test::RollingPredictor>;
#endif
