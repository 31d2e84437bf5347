#pragma once

// The closed loop that the programs share: plan, apply, advance, record; then the figures and files of a run.

#include <array>
#include <string>
#include <vector>

#include "clothctl/mpc/plan_types.hpp"
#include "support/options.hpp"
#include "support/plants.hpp"
#include "support/tasks.hpp"

namespace program {

/// Everything that a run needs.
struct Scene {
  std::string title;
  std::string material;
  Body body;
  clothctl::PlannerSetup<double> setup;
  clothctl::PlannerSettings<double> settings;
  Task task;
  std::vector<std::array<int, 2>> segments;
};

/// Runs the loop on `plant`, writes the files that were asked for, prints the figures; answers the program's exit code.
int run(const Scene& scene, const Options& o, AnyPlant plant, AnyPredictor predictor);

/// Planner settings from the options that every program has.
clothctl::PlannerSettings<double> planner_settings(const Options& o, double weight);

/// Lets a body hang from `held` (fixed where they are) for `seconds` with firm drag; answers it at rest.
clothctl::ClothState<double> settle(const Options& o, const Body& body, clothctl::ClothState<double> state,
                                    const std::vector<int>& held, double seconds);

}  // namespace program
