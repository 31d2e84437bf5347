#pragma once

// Records a run frame by frame, for the player's page and the table of the trajectory.

#include <vector>

#include "clothctl/io/csv.hpp"
#include "clothctl/io/html_player.hpp"
#include "support/figures.hpp"

namespace program {

/// The page and the table of one run.
class RunRecorder {
 public:
  /// Errors are scored in frames 1 … `scored` - 1.
  RunRecorder(const Scene& scene, const Options& o, Index scored);

  /// Records a frame with positions `x` (3×n, m) and the hands' part of a plan. Adds errors and the
  /// speed of the hands to `figures`.
  void add_frame(Index frame, const Points& x, const Points& arrows, Figures& figures);

  /// Returns what the page draws at the hands: their planned velocities (m/s), or the sum of the
  /// `forces` of their fingers (N).
  Points arrows(const clothctl::PlanResult<double>& result,
                const std::vector<clothctl::FingerForce<double>>& forces) const;

  /// Writes player.html, trajectory.csv and summary.json to the requested folder.
  void write(const Summary& summary);

 private:
  const Scene& scene_;
  const Options& options_;
  Index scored_;
  std::vector<std::vector<int>> hands_;  // the vertices that each hand holds
  clothctl::PlayerRecorder page_;
  clothctl::CsvWriter table_;
  Points last_hands_;
};

}  // namespace program
