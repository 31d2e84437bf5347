#pragma once

// Tables and JSON of the figures.

#include <string>
#include <vector>

#include "run.hpp"

namespace planner_bench {

/// Prints the figures of a size.
void print_size(const RunSettings& settings, const SizeReport& report);

/// Prints the median time of our frames by size, and the power of the number of vertices with which
/// it grows.
void print_growth(const std::vector<SizeReport>& reports);

/// Returns all figures as JSON.
std::string to_json(const RunSettings& settings, const std::vector<SizeReport>& reports);

/// Returns what is wrong with the answers, or an empty string.
std::string problem_with(const std::vector<SizeReport>& reports);

}  // namespace planner_bench
