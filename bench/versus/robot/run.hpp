#pragma once

// The runs: each peer in turn, forwards and backwards, in one process and thread; thread CPU time.
// Answers are checked first, and a peer with other answers is not timed.

#include <memory>
#include <string>
#include <vector>

#include "peer.hpp"

namespace versus {

/// How to run.
struct RunSettings {
  unsigned seed = 1;
  int samples = 32;
  /// Timed turns of each peer, of at least this many seconds.
  int rounds = 101;
  double turn = 3e-4;
  /// The diagonal that damped dynamics add (N m s²/rad, N s²/m): time step times damping.
  double diagonal = 1;
  /// Targets of inverse kinematics, other starts that a target is given, and times that each is
  /// solved.
  int targets = 200;
  int restarts = 20;
  int passes = 3;
};

/// The largest difference to our answers, over their largest entry, at which a peer is timed.
inline constexpr double kAgreement = 1e-6;

/// One peer at one task.
struct TaskResult {
  bool offered = false;
  /// NaN where there are no answers.
  double difference = 0;
  /// Of one run; NaN where it was not timed.
  double seconds = 0;

  bool agrees() const { return offered && difference <= kAgreement; }
};

/// One peer at inverse kinematics.
struct ReachResult {
  bool offered = false;
  /// Whether each target was reached: our kinematics of its answer is within the tolerance, and the
  /// answer within limits.
  std::vector<bool> reached;
  /// It said that it had and had not.
  int false_claims = 0;
  /// Of each target.
  std::vector<double> seconds;

  int reached_count() const;
  double median() const;
  /// Over the targets that `other` reached too, and its own median there.
  double median_with(const ReachResult& other) const;
};

/// A peer with a robot.
struct Runner {
  std::string name;
  std::unique_ptr<Peer> peer;
  /// Why it takes no part, or "".
  std::string refusal;
};

/// Loads a robot into all; the first is ours.
std::vector<Runner> load(const std::vector<Entry>& entries, const Model& model);

/// All tasks, in turns: for each of `kTasks` a result for each runner.
std::vector<std::vector<TaskResult>> run_tasks(std::vector<Runner>& runners, const Model& model,
                                               const RunSettings& settings);

/// Inverse kinematics to places that random positions give, from starts within 10 % of each range
/// (near, without restarts) or anywhere; a result for each runner.
std::vector<ReachResult> run_reach(std::vector<Runner>& runners, const Model& model, bool near,
                                   const RunSettings& settings);

}  // namespace versus
