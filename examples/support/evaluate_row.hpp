#pragma once

// The result of a run as a line of a table. Times are in a line of their own, since they differ
// from run to run; all other cells have the same bits wherever and whenever a run is made.

#include <string>

namespace program {

/// The result of a run.
struct Row {
  std::string study_case, curve, status;
  int seed = 0;
  double value = 0, frames = 0, scored_frames = 0, vertices = 0;
  double mean_error_m = 0, p95_error_m = 0, max_error_m = 0;
  double prediction_error_m = 0, agreement = 0, hand_speed_max = 0, cone_violation_max = 0;
  double curve_speed_mean = 0, curve_speed_max = 0, curve_length_m = 0;
  double frame_ms_median = 0, frame_ms_p99 = 0, plant_ms_median = 0, planning_s = 0;

  bool finished() const { return status == "finished"; }
};

/// The names of the columns, with commas: of results and of times.
std::string result_columns();
std::string time_columns();

/// The cells of a row, with commas.
std::string result_cells(const Row& row);
std::string time_cells(const Row& row);

/// Reads the cells of both lines. Returns what is wrong, or an empty string.
std::string read_row(const std::string& results, const std::string& times, Row& row);

}  // namespace program
