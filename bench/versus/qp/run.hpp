#pragma once

// The runs: every problem and every frame goes to all solvers in turn, forwards and backwards, in
// one process; thread CPU time.

#include <string>
#include <vector>

#include "clothctl/io/qp_problem.hpp"
#include "judge.hpp"
#include "solver.hpp"

namespace versus {

/// Times are in seconds of thread CPU time; 60 s stand for a failure in geometric means, which are
/// shifted by 1 ms.
inline constexpr double kFailure = 60.0, kShift = 1e-3;

/// How to run.
struct RunSettings {
  int passes = 3;
  /// Seconds after which a solver is told to give up, and a pass over a sequence ends.
  double time_limit = 10;
  /// Frames that one solver does in a row before the next takes its turn; 0: the whole sequence.
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
  /// Shifted geometric mean, failures as `kFailure`, or over the right ones only.
  double mean(bool right_only) const;
  double slowest() const;
};

/// One solver and way of starting on one sequence.
struct LaneResult {
  std::string solver;
  Start start = Start::Kept;
  std::vector<double> cold, warm;
  int frames = 0, right = 0, false_statuses = 0;
  bool finished = false;
  /// What was first not right: frame, verdict, worst relative residual; empty when all was.
  std::string first_miss;

  double cold_median() const;
  double warm_median() const;
  double warm_p99() const;
};

/// Runs a set of single problems cold, set-up included: the least of `passes` runs (one where it
/// took over 0.2 s).
std::vector<SetResult> run_set(const std::vector<Entry>& entries,
                               const std::vector<std::string>& files, const RunSettings& settings);

/// Runs a sequence. Warm: the least of `passes` passes per frame, frames 1 to the last. Cold: every
/// sixth frame, set-up included.
std::vector<LaneResult> run_sequence(const std::vector<Entry>& entries,
                                     const clothctl::QpProblem& sequence,
                                     const RunSettings& settings);

/// Reads a file or ends the program with the reader's message.
clothctl::QpProblem load(const std::string& file);

}  // namespace versus
