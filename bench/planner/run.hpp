#pragma once

// The runs: on the frames of one size all contenders take turns, in alternating order, in one
// process; thread CPU time.

#include <string>
#include <vector>

#include "contender.hpp"

namespace planner_bench {

/// Settings of the runs.
struct RunSettings {
  /// Vertices along a side of the sheets, and of those that the baseline plans for, too.
  std::vector<int> sizes{9, 17, 33, 65, 129}, baseline_sizes{9, 17, 33};
  /// Frames of each size, and how many of them the baseline plans.
  int frames = 40, baseline_frames = 5;
  /// Frames of the window.
  Index horizon = 20;
};

/// The largest relative difference of the first input from the baseline's, where the models are the
/// same and both compute in double precision.
inline constexpr double kSameInput = 1e-6;
/// The largest relative KKT residual of an answer that counts, as in bench_versus_qp.
inline constexpr double kSolved = 1e-6;

/// A QP solver that might serve the baseline, on the QP of the first frame, cold.
struct Candidate {
  std::string name, version;
  double seconds = 0;
  /// Largest relative KKT residual; infinite without an answer.
  double kkt = 0;
};

/// One contender on the frames of a size.
struct Row {
  std::string name;
  bool baseline = false, exact = false;
  std::vector<Phases> frames;
  /// Frames without an optimal plan.
  int failures = 0;
  /// Largest over the baseline's frames; NaN where the models differ. `kkt` is the largest relative
  /// KKT residual in the baseline's QP, `difference` that of the first input, relative to it.
  double difference = 0, kkt = 0;

  double quantile(double Phases::*part, double q) const;
};

/// All contenders on the frames of a size.
struct SizeReport {
  int n = 0;
  std::vector<Candidate> candidates;
  /// Index of the candidate that serves the baseline, or -1: then there is no baseline.
  int chosen = -1;
  std::vector<Row> rows;

  /// Returns the median time of the first row of this name, s; NaN without such a row.
  double median(const std::string& name) const;
};

/// Runs a size. `solvers` are the third-party QP solvers.
SizeReport run_size(const RunSettings& settings, int n, const std::vector<versus::Entry>& solvers);

}  // namespace planner_bench
