#pragma once

// The runs: the libraries take turns in alternating order, in one process and thread; thread CPU
// time. Answers are checked first, and a library with wrong answers is not timed.

#include <memory>
#include <string>
#include <vector>

#include "peer.hpp"

namespace versus {

/// Settings of the runs.
struct RunSettings {
  unsigned seed = 1;
  int samples = 32;
  /// Number of timed turns of each library, and their least duration (s).
  int rounds = 101;
  double turn = 3e-4;
  /// The diagonal for damped dynamics (N m s²/rad, N s²/m): time step times damping.
  double diagonal = 1;
  /// Number of targets of inverse kinematics, of other starts for each target, and of repetitions
  /// of each solve.
  int targets = 200;
  int restarts = 20;
  int passes = 3;
};

/// Largest difference from our answers, relative to their largest entry, for a library to be timed.
inline constexpr double kAgreement = 1e-6;

/// A library at a task.
struct TaskResult {
  bool offered = false;
  /// NaN if there are no answers.
  double difference = 0;
  /// Time of one run, or NaN if not timed.
  double seconds = 0;

  bool agrees() const { return offered && difference <= kAgreement; }
};

/// A library at inverse kinematics.
struct ReachResult {
  bool offered = false;
  /// Whether each target was reached: by our kinematics, the answer is within the tolerance, and it
  /// is within the limits.
  std::vector<bool> reached;
  /// Number of wrong reports of success, and of failure.
  int false_claims = 0;
  /// Time for each target.
  std::vector<double> seconds;

  int reached_count() const;
  double median() const;
  /// Median over the targets that `other` reached too, and the median of `other` there.
  double median_with(const ReachResult& other) const;
};

/// A library with a robot.
struct Runner {
  std::string name;
  std::unique_ptr<Peer> peer;
  /// Why the library does not take part, or "".
  std::string refusal;
};

/// Loads a robot into all libraries; the first one is ours.
std::vector<Runner> load(const std::vector<Entry>& entries, const Model& model);

/// Runs all tasks in turns. Returns a result of each runner for each of `kTasks`.
std::vector<std::vector<TaskResult>> run_tasks(std::vector<Runner>& runners, const Model& model,
                                               const RunSettings& settings);

/// Runs inverse kinematics. Targets are the tips at random positions; starts are within 10 % of
/// each range (without restarts) or anywhere. Returns a result of each runner.
std::vector<ReachResult> run_reach(std::vector<Runner>& runners, const Model& model, bool near,
                                   const RunSettings& settings);

}  // namespace versus
