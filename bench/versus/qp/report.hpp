#pragma once

// Tables on standard output, and the same figures as JSON.

#include <string>
#include <utility>
#include <vector>

#include "run.hpp"

namespace versus {

/// A sequence's name and size with its results.
struct SequenceReport {
  std::string name;
  Index n = 0, m = 0;
  std::vector<LaneResult> lanes;
};

/// The results of all runs.
struct Report {
  std::vector<Entry> entries;
  RunSettings settings;
  std::vector<std::pair<std::string, std::vector<SetResult>>> sets;
  std::vector<SequenceReport> sequences;
};

/// Prints the solvers and their versions.
void print_solvers(const std::vector<Entry>& entries);
/// Prints the results of one set.
void print_set(const std::string& name, const std::vector<SetResult>& results);
/// Prints the results of one sequence.
void print_sequence(const SequenceReport& report);
/// Returns all figures as JSON. Times are in milliseconds; missing figures are null.
std::string to_json(const Report& report);

}  // namespace versus
