#pragma once

// The table of the study of reachability: what was predicted of each curve, from which causes, and
// what came.

#include <cstdint>

#include "clothctl/io/csv.hpp"
#include "clothctl/mpc/reachability.hpp"
#include "support/figures.hpp"

namespace program {

/// A curve that was judged and tried.
struct ReachRow {
  std::uint64_t seed = 0;
  const clothctl::ReachabilityReport<double>& report;
  const Summary& run;
  bool finished = false, success = false;
};

/// Returns an empty table of such curves.
clothctl::CsvWriter reach_table();
/// Adds a row to it. Errors of a run that did not finish count as 1e9 m.
void add_row(const ReachRow& row, clothctl::CsvWriter& table);

}  // namespace program
