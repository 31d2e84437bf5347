#pragma once

// What an evaluation tells of its runs: a summary of each case, and a page with the plots of [Bai
// 2016], figures 8 and 9, and of Table 1.

#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "support/evaluate_folder.hpp"
#include "support/evaluate_row.hpp"
#include "support/evaluate_study.hpp"

namespace program {

/// The folder inside that of the evaluation with the files of the first run.
inline const char* first_run_folder() { return "first_run"; }

/// Returns the summary of all runs so far; `runs` of the study are wanted.
nlohmann::ordered_json summarise(const Evaluation& e, const std::vector<Case>& cases,
                                 const std::vector<Row>& rows, std::size_t runs);

/// Writes results.csv, times.csv, summary.json and report.html.
void write_report(const ResultFolder& folder, const Evaluation& e, const std::vector<Case>& cases,
                  const std::vector<Row>& rows, const nlohmann::ordered_json& summary);

/// Prints a summary as text.
void print_summary(const nlohmann::ordered_json& summary, const ResultFolder& folder);

}  // namespace program
