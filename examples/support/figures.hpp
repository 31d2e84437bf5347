#pragma once

// The figures of a run: collected frame by frame, summarised at its end, printed and written.

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "clothctl/mpc/plan_types.hpp"
#include "support/scene.hpp"

namespace program {

/// The figures of a run, in the order of summary.json.
struct Summary {
  std::string status = "finished";
  Index frames = 0, scored_frames = 0, suboptimal_frames = 0, relaxed_frames = 0;
  double patch_residual_max_m = 0;
  double mean_error_m = 0, p95_error_m = 0, max_error_m = 0;
  double frame_ms_median = 0, frame_ms_p99 = 0, plant_ms_median = 0;
  double planning_s = 0;  // of all frames; not in summary.json
  double agreement = 0, prediction_error_m = 0, qp_iterations_median = 0, cone_violation_max = 0,
         hand_speed_max = 0;
};

/// The data of each frame so far.
class Figures {
 public:
  /// The loop and the recorder set status, frames and hand_speed_max.
  Summary summary;
  /// Distances of the features from their targets in scored frames, m.
  std::vector<double> errors;

  /// Adds the times of a frame, ms.
  void add_times(double planning, double plant);
  /// Adds an applied plan, and the forces of the fingers.
  void add_plan(const std::vector<clothctl::Grip<double>>& grips,
                const clothctl::PlanResult<double>& result,
                const std::vector<clothctl::FingerForce<double>>& forces);
  /// Summarises the run. A run of all `frames` with a mean error over half of `size` (m) has lost
  /// the track.
  Summary sum_up(Index features, Index frames, double size);

 private:
  std::vector<double> frame_ms_, plant_ms_, agreement_, prediction_, iterations_;
};

/// Returns what decides the outcome of a run besides its task and seed.
nlohmann::ordered_json setup_json(const Scene& scene, const Options& o);

/// Returns the summary as JSON text of one object, on one line if `indent` is -1.
std::string to_json(const Summary& summary, const Scene& scene, const Options& o, int indent);

/// Prints the summary as text.
void print(const Summary& summary, const Options& o);

}  // namespace program
