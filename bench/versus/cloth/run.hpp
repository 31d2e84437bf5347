#pragma once

// The runs: all variants take turns, some frames each, in alternating order, in one process and
// thread; thread CPU time.

#include <string>
#include <vector>

#include "engine.hpp"

namespace versus {

/// Settings of the runs.
struct RunSettings {
  /// Frames of a run, and their length (s).
  int frames = 600;
  double dt = 1.0 / 60;
  /// Frames with extra damping after that, and the factor on all velocities after each of them.
  int rest_frames = 300;
  double rest_factor = 1 - 5.0 / 60;
  /// Frames in a turn. The first one is not timed: its data are not in the cache.
  int turn = 50;
  /// Largest median time of a frame (s) up to which numbers grow.
  double limit = 1.0 / 60;
  /// Worst stretches to reach, largest first.
  std::vector<double> targets = {0.05, 0.02};
  /// Extra numbers between a miss and a hit.
  int refinements = 2;
};

/// A stretch at which a run ends: the sheet has come apart.
inline constexpr double kApart = 10;

/// Frames after which the energy is reported.
inline constexpr int kEnergyFrames[] = {120, 300, 600};

/// One run: a variant, a number, a sheet.
struct RunResult {
  std::string engine, variant;
  int number = 0;
  Setting setting;
  /// Why the engine does not take part, or "".
  std::string refusal;
  int frames = 0;
  /// Times of a frame (s).
  double median = 0, p99 = 0;
  /// Largest l / l0 - 1 over all frames and edges, of either kind.
  double structural = 0, diagonal = 0;
  /// Mean over all frames and edges of the positive and the negative part of l / l0 - 1.
  double mean_stretch = 0, mean_squeeze = 0;
  /// (E - E_rest) / (E_0 - E_rest) after `kEnergyFrames`, and its maximum over all frames; E is
  /// kinetic energy plus weight times height, E_rest weight times height at the end of the damped
  /// frames.
  double energy[3] = {0, 0, 0}, most_energy = 0;
  /// At the end of the damped frames: root mean square speed (m/s), and largest stretch.
  double rest_speed = 0, rest_stretch = 0;
  /// Frames with a coordinate that is not finite.
  int nonfinite = 0;
  /// The run ended early: not finite, or a stretch of `kApart`.
  bool apart = false;
  /// Projections of an edge a second: edges × sweeps a frame / median.
  double solves = 0;

  double worst() const { return structural > diagonal ? structural : diagonal; }
};

/// A variant of an engine.
struct Lane {
  std::string engine;
  const Variant* variant;
};

std::vector<Lane> lanes_of(const std::vector<Entry>& entries);

/// Makes a run of each lane with its number, in turns.
std::vector<RunResult> run_together(const std::vector<Lane>& lanes, const std::vector<int>& numbers,
                                    const Sheet& sheet, const RunSettings& settings);

/// Runs each lane with growing numbers: doubled until the smallest target is reached or the limit
/// of time is, then between the last miss and the first hit of each target. Then times the cheapest
/// runs that reach the targets once more, in turns. Returns the runs of each lane in the order of
/// their numbers.
std::vector<std::vector<RunResult>> run_curves(const std::vector<Lane>& lanes, const Sheet& sheet,
                                               const RunSettings& settings);

/// The run of least number with a worst stretch of at most `target`, or null.
const RunResult* cheapest(const std::vector<RunResult>& runs, double target);

/// Times the projections of the variants that have a setting for it: equal sweeps over equal edges,
/// without compliance. Returns the runs, with nothing but times and solves.
std::vector<RunResult> run_throughput(const std::vector<Lane>& lanes, const Sheet& sheet,
                                      const RunSettings& settings, int frames);

}  // namespace versus
