#pragma once

// The folder of an evaluation. Each finished run is a file of its own that appears whole or not at
// all (written beside, then renamed), so that a stopped program loses only runs that it had not
// finished, and programs on several machines may share the folder:
//
//   settings.json          what makes the results what they are; a run of other settings is refused
//   runs/CASE-SEED.csv     a line of results and a line of times
//   results.csv, times.csv, summary.json, report.html: made from all runs that are there

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "support/evaluate_row.hpp"
#include "support/evaluate_study.hpp"

namespace program {

/// Returns the settings of an evaluation, without what does not change results.
nlohmann::ordered_json settings_json(const Evaluation& e);

/// The folder.
class ResultFolder {
 public:
  /// Makes the folder, or with `resume` goes on with one of the same settings. Refuses a folder
  /// with results otherwise, and one of other settings.
  ResultFolder(std::string path, const nlohmann::ordered_json& settings, bool resume);

  /// Saves a run.
  void save(const Job& job, const Row& row) const;
  /// Returns a saved run, or nothing. Refuses a damaged file.
  std::optional<Row> read(const Job& job) const;
  /// Writes a file of the folder, whole or not at all.
  void write(const std::string& name, const std::string& content) const;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

/// Returns the text of results.csv or times.csv: a line with version and settings, names, rows.
std::string table_text(const nlohmann::ordered_json& settings, const std::string& columns,
                       const std::vector<std::string>& lines);

}  // namespace program
