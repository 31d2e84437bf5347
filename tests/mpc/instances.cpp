// Instantiates what instances.hpp declares.

#define CLOTHCTL_TEST_INSTANCES
#include "mpc/instances.hpp"

template class clothctl::BoxActiveSet<double>;
template class clothctl::ActiveSet<double>;
template class clothctl::MassSpring<double>;
template class clothctl::MassSpringResponse<float>;
template class clothctl::LinearisedPredictor<clothctl::MassSpringResponse<float>, double>;
template class clothctl::RolloutPredictor<clothctl::MassSpring<double>,
                                          clothctl_test::FrozenPredictor>;
template class clothctl::Planner<clothctl_test::FrozenPredictor>;
template class clothctl::Planner<clothctl_test::RollingPredictor>;
