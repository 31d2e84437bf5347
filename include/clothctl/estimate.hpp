#pragma once

// The state of a sheet from late, noisy and partial measurements.

#include "clothctl/estimate/disturbance_observer.hpp"
#include "clothctl/estimate/estimator_settings.hpp"
#include "clothctl/estimate/marker_measurement.hpp"
#include "clothctl/estimate/state_estimator.hpp"
