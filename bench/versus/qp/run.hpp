#pragma once

// The runs: all solvers take turns at every problem and every frame, in alternating order, in one
// process; thread CPU time.

#include <string>
#include <vector>

#include "clothctl/io/qp_problem.hpp"
#include "judge.hpp"
#include "solver.hpp"

namespace versus {

/// Times are in seconds of thread CPU time. Geometric means are shifted by 1 ms and count a failure
/// as 60 s.
inline constexpr double kFailure = 60.0, kShift = 1e-3;

/// Settings of the runs.
struct RunSettings {
  int passes = 3;
  /// Time limit (s) of a solve, and of a pass over a sequence.
  double time_limit = 10;
  /// Number of frames that a solver takes in one turn; 0 for the whole sequence.
  Index block = 0;
};

/// One solver on one problem, cold.
struct SingleResult {
  std::string problem;
  Verdict verdict = Verdict::NotRun;
  Judgement judgement;
  double seconds = 0;
};

/// One solver on one set.
struct SetResult {
  std::string solver;
  std::vector<SingleResult> problems;

  int right() const;
  int absolute() const;
  int false_statuses() const;
  /// Shifted geometric mean of the times: over all answers, where failures count as `kFailure`, or
  /// over the right ones only.
  double mean(bool right_only) const;
  double slowest() const;
};

/// One solver on one sequence, with one way of starting.
struct LaneResult {
  std::string solver;
  Start start = Start::Kept;
  std::vector<double> cold, warm;
  int frames = 0, right = 0, false_statuses = 0;
  bool finished = false;
  /// The first wrong answer (frame, verdict, worst relative residual), or empty.
  std::string first_miss;

  double cold_median() const;
  double warm_median() const;
  double warm_p99() const;
};

/// Runs a set of single problems cold, with set-up. The time is the least of `passes` runs; a run
/// of over 0.2 s is not repeated.
std::vector<SetResult> run_set(const std::vector<Entry>& entries,
                               const std::vector<std::string>& files, const RunSettings& settings);

/// Runs a sequence. Warm: frames 1 to the last, each the least of `passes` passes. Cold: every
/// sixth frame with its set-up.
std::vector<LaneResult> run_sequence(const std::vector<Entry>& entries,
                                     const clothctl::QpProblem& sequence,
                                     const RunSettings& settings);

/// Reads a file, or ends the program with the reader's message.
clothctl::QpProblem load(const std::string& file);

}  // namespace versus
