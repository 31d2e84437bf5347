#pragma once

// Runs a sheet and measures it: stretch, energy, speed. docs/programs.md defines the figures.

#include <string>
#include <vector>

#include "clothctl/io/html_player.hpp"
#include "support/cloth_scene.hpp"

namespace program {

/// How a sheet is simulated.
struct ClothRunOptions {
  std::string model = "xpbd";
  double cap = 0;
  double seconds = 5;
  double dt = 1.0 / 60;
  /// What the sheet may touch (support/obstacles.hpp), and with what friction.
  std::vector<std::string> obstacles;
  double friction = 0.5;
  /// Whether it touches itself; its thickness, m.
  bool self = false;
  double thickness = 0.002;

  bool touches() const { return self || !obstacles.empty(); }
};

/// The figures of a run, in the order of the JSON object.
struct ClothFigures {
  std::string status = "finished";
  Index vertices = 0;
  double real_time_factor = 0, stretch_max = 0, stretch_mean = 0, energy_drift = 0,
         solves_per_second = 0;
  long long nonfinite = 0;
  double energy_rise_max = 0;
  /// With obstacles or self: the most contacts, the largest depth, edges that pierce a triangle at
  /// the end, the error of the momentum balance, the largest residual of the contacts; at the end
  /// of the run the depth, and the speed of the fastest vertex that touches.
  long contacts_max = 0, self_crossings = 0;
  double penetration_max_m = 0, momentum_residual = 0, solver_residual_max = 0;
  double penetration_end_m = 0, speed_end_m_s = 0;
  long steps = 0, unconverged_steps = 0;
};

/// Returns the energy of a state that the model knows, J: motion, height, and (not for pbd, whose
/// distances are rigid) springs and bending.
double cloth_energy(const ClothRunOptions& run, const ClothScene& scene, const Points& x,
                    const Points& v);

/// Runs the sheet. Adds its positions to `page`, unless that is null, every `every` steps, and the
/// obstacles.
ClothFigures run_cloth(const ClothRunOptions& run, const ClothScene& scene,
                       clothctl::PlayerRecorder* page, long every);

}  // namespace program
