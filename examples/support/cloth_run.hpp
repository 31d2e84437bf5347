#pragma once

// Runs a sheet and measures it: stretch, energy, speed. docs/programs.md defines the figures.

#include <string>

#include "clothctl/io/html_player.hpp"
#include "support/cloth_scene.hpp"

namespace program {

/// How a sheet is simulated.
struct ClothRunOptions {
  std::string model = "xpbd";
  double cap = 0;
  double seconds = 5;
  double dt = 1.0 / 60;
};

/// The figures of a run, in the order of the JSON object.
struct ClothFigures {
  std::string status = "finished";
  Index vertices = 0;
  double real_time_factor = 0, stretch_max = 0, stretch_mean = 0, energy_drift = 0,
         solves_per_second = 0;
  long long nonfinite = 0;
  double energy_rise_max = 0;
  long steps = 0, unconverged_steps = 0;
};

/// Makes the model called `run.model`: pbd, xpbd or mass-spring.
AnyPlant make_cloth_plant(const ClothRunOptions& run, const ClothScene& scene);

/// Returns the energy of a state that the model knows, J: motion, height, and (not for pbd, whose
/// distances are rigid) springs and bending.
double cloth_energy(const ClothRunOptions& run, const ClothScene& scene, const Points& x,
                    const Points& v);

/// Runs the sheet. Adds its positions to `page`, unless that is null, every `every` steps.
ClothFigures run_cloth(const ClothRunOptions& run, const ClothScene& scene,
                       clothctl::PlayerRecorder* page, long every);

}  // namespace program
