#include "support/evaluate_row.hpp"

#include <array>
#include <charconv>
#include <span>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"

namespace program {

namespace {

using Column = std::pair<const char*, double Row::*>;

constexpr std::array<Column, 14> kResults{{{"value", &Row::value},
                                           {"frames", &Row::frames},
                                           {"scored_frames", &Row::scored_frames},
                                           {"vertices", &Row::vertices},
                                           {"mean_error_m", &Row::mean_error_m},
                                           {"p95_error_m", &Row::p95_error_m},
                                           {"max_error_m", &Row::max_error_m},
                                           {"prediction_error_m", &Row::prediction_error_m},
                                           {"agreement", &Row::agreement},
                                           {"hand_speed_max", &Row::hand_speed_max},
                                           {"cone_violation_max", &Row::cone_violation_max},
                                           {"curve_speed_mean", &Row::curve_speed_mean},
                                           {"curve_speed_max", &Row::curve_speed_max},
                                           {"curve_length_m", &Row::curve_length_m}}};
constexpr std::array<Column, 4> kTimes{{{"frame_ms_median", &Row::frame_ms_median},
                                        {"frame_ms_p99", &Row::frame_ms_p99},
                                        {"plant_ms_median", &Row::plant_ms_median},
                                        {"planning_s", &Row::planning_s}}};

/// A text as a cell: what would end the cell or the line becomes a semicolon.
std::string cell(std::string text) {
  for (char& c : text) {
    if (c == ',' || c == '"' || c == '\n' || c == '\r') c = ';';
  }
  return text;
}

std::string names(std::string line, std::span<const Column> columns) {
  for (const Column& column : columns) line.append(",").append(column.first);
  return line;
}

std::string numbers(std::string line, const Row& row, std::span<const Column> columns) {
  for (const Column& column : columns)
    line.append(",").append(clothctl::number_text(row.*column.second));
  return line;
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells(1);
  for (const char c : line) {
    if (c == ',') {
      cells.emplace_back();
    } else {
      cells.back() += c;
    }
  }
  return cells;
}

/// Reads numbers from the end of `cells`.
std::string read_numbers(const std::vector<std::string>& cells, std::span<const Column> columns,
                         Row& row) {
  const std::size_t first = cells.size() - columns.size();
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const std::string& text = cells[first + i];
    const auto read =
        std::from_chars(text.data(), text.data() + text.size(), row.*columns[i].second);
    if (read.ec != std::errc() || read.ptr != text.data() + text.size())
      return std::string(columns[i].first) + " is '" + text + "', not a number";
  }
  return {};
}

std::string key(const Row& row) {
  return cell(row.study_case) + "," + cell(row.curve) + "," + std::to_string(row.seed);
}

}  // namespace

std::string result_columns() { return names("case,curve,seed,status", kResults); }
std::string time_columns() { return names("case,curve,seed", kTimes); }

std::string result_cells(const Row& row) {
  return numbers(key(row) + "," + cell(row.status), row, kResults);
}
std::string time_cells(const Row& row) { return numbers(key(row), row, kTimes); }

std::string read_row(const std::string& results, const std::string& times, Row& row) {
  const std::vector<std::string> cells = split(results), timed = split(times);
  if (cells.size() != kResults.size() + 4)
    return "found " + std::to_string(cells.size()) + " cells of a result, expected " +
           std::to_string(kResults.size() + 4);
  if (timed.size() != kTimes.size() + 3)
    return "found " + std::to_string(timed.size()) + " cells of times, expected " +
           std::to_string(kTimes.size() + 3);
  row.study_case = cells[0];
  row.curve = cells[1];
  row.status = cells[3];
  const std::string& seed = cells[2];
  const auto read = std::from_chars(seed.data(), seed.data() + seed.size(), row.seed);
  if (read.ec != std::errc() || read.ptr != seed.data() + seed.size())
    return "seed is '" + seed + "', not a whole number";
  const std::string wrong = read_numbers(cells, kResults, row);
  return wrong.empty() ? read_numbers(timed, kTimes, row) : wrong;
}

}  // namespace program
