#pragma once

// A flat sheet that hangs from its upper corners, and what it can reach: the tests of reachability.

#include <utility>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/mpc/reachability.hpp"
#include "clothctl/network/sheet.hpp"

namespace clothctl_test {

/// Returns the limits of a square sheet of side `size` (m) that hangs flat, with planners of frames
/// of `dt` (s). Its lower corners are the features.
inline clothctl::ReachLimits<double> flat_reach(double size = 0.5, double dt = 0.02) {
  const auto grid = clothctl::make_grid<double>(5, 5, size, size).value();
  const auto network = clothctl::sheet_network(grid, clothctl::Material<double>{}).value();
  clothctl::PlannerSetup<double> setup;
  for (int col : {0, 4}) {
    setup.features.add_point(grid.vertex(0, col));
    setup.grips.push_back(clothctl::make_pinch<double>({grid.vertex(4, col)}, 0.5, 20.0));
  }
  clothctl::PlannerSettings<double> settings;
  settings.dt = dt;
  return clothctl::make_reach_limits(setup, settings, network, grid.positions).value();
}

/// The features of limits, moved by `motion(feature, t)`.
template <class Motion>
auto moved_features(const clothctl::ReachLimits<double>& limits, Motion motion) {
  return [start = limits.features, motion](clothctl::Index i, double t) {
    return clothctl::Vector3<double>(start.col(i) + motion(i, t));
  };
}

}  // namespace clothctl_test
