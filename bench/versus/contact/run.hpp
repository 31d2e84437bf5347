#pragma once

// The runs: all settings of all engines, one run after the other, in alternating order, in one
// thread; thread CPU time.

#include <string>
#include <vector>

#include "engine.hpp"

namespace versus {

/// Settings of the runs.
struct RunSettings {
  /// Frames of a run, and their length (s). The first frame is not timed: worlds allocate in it.
  int frames = 600;
  double dt = 1.0 / 60;
  /// Runs of each setting.
  int repeats = 3;
};

/// Seconds at the end in which a sheet should lie still.
inline constexpr double kRestSeconds = 2;
/// A vertex touches that is at most this far above the gap (m).
inline constexpr double kTouch = 2e-3;
/// A sheet has slid off that is all this far away (m).
inline constexpr double kOff = 0.05;

/// One setting of an engine on a scene. Lengths in m, times in s.
struct RunResult {
  std::string engine, variant;
  double gap = 0;
  /// Why the engine does not take part, or "".
  std::string refusal;
  /// Times of a frame, medians over the repeats; and seconds of motion a second.
  double median = 0, p99 = 0, most = 0, real_time = 0;
  /// Largest depth of vertices, and of them and points of triangles, below the exact surface: in
  /// the whole run, and in the last seconds.
  double depth_vertices = 0, depth_points = 0, rest_depth_vertices = 0, rest_depth_points = 0;
  /// The same below the gap, of vertices.
  double below_gap = 0, rest_below_gap = 0;
  /// Vertices that touch at the start and the end of the last seconds; speeds along the line
  /// between both places, root mean square and largest; root mean square of their steps over dt.
  int touching = 0;
  double creep = 0, most_creep = 0, tremble = 0;
  /// Largest stretch in the whole run, and in the last seconds.
  double stretch = 0, rest_stretch = 0;
  /// At the end.
  int crossings = 0;
  /// Way of the middle vertex, along the ground, in the whole run.
  double drift = 0;
  /// When the sheet had slid off, or -1.
  double off = -1;
  bool finite = true;
};

/// Runs the chosen settings of the engines.
std::vector<RunResult> run_all(const std::vector<Entry>& entries,
                               const std::vector<std::string>& variants, const Scene& scene,
                               const RunSettings& settings);

}  // namespace versus
