#pragma once

// Tables on standard output, and the same figures as JSON.

#include <cstddef>
#include <string>
#include <vector>

#include "run.hpp"

namespace versus {

/// All figures of one sheet.
struct SheetReport {
  std::string mesh;
  int side = 0;
  std::size_t edges = 0;
  std::vector<RunResult> throughput;
  /// The runs of each lane, in the order of their numbers.
  std::vector<std::vector<RunResult>> curves;
};

/// Prints engines and versions.
void print_entries(const std::vector<Entry>& entries);
/// Prints the tables of one sheet.
void print_sheet(const SheetReport& report, const RunSettings& settings);
/// Returns all figures as JSON; missing figures are null.
std::string to_json(const std::vector<Entry>& entries, const RunSettings& settings,
                    const std::vector<SheetReport>& sheets);

}  // namespace versus
