#pragma once

// The parts of a run: a body, its grips and features, settings and a task.

#include <array>
#include <string>
#include <vector>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner_settings.hpp"
#include "clothctl/network/materials.hpp"
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

/// Ends the program if grips, features or settings do not fit the body.
void check_scene(const Scene& scene);

/// Returns a sheet of `material`. If --model is less than --cloth, it has a coarse sheet that
/// predicts it.
Body sheet_body(const Options& o, const clothctl::GridMesh<double>& grid,
                const clothctl::Material<double>& material);

/// Returns the planner's settings from the common options.
clothctl::PlannerSettings<double> planner_settings(const Options& o, double weight);

/// Lets a body hang from the fixed vertices `held` for `seconds` with strong drag. Returns it at
/// rest.
clothctl::ClothState<double> settle(const Options& o, const Body& body,
                                    clothctl::ClothState<double> state,
                                    const std::vector<int>& held, double seconds);

}  // namespace program
