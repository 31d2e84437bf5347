#pragma once

// Tables on standard output, and the same figures as JSON.

#include <string>
#include <vector>

#include "run.hpp"

namespace versus {

/// All figures of one robot, in the order of the runners.
struct RobotReport {
  Model model;
  std::vector<std::string> names, refusals;
  /// One for each of `kTasks`.
  std::vector<std::vector<TaskResult>> tasks;
  std::vector<ReachResult> near, random;
};

/// Prints libraries and versions.
void print_entries(const std::vector<Entry>& entries);
/// Prints the tables of one robot: microseconds, ratios to ours, differences.
void print_robot(const RobotReport& report);
/// Returns all figures as JSON; missing figures are null.
std::string to_json(const std::vector<Entry>& entries, const RunSettings& settings,
                    const std::vector<RobotReport>& robots);

}  // namespace versus
