#pragma once

// Reads target curves of features from files. One file for all features has the header
//
//   t,<a>x,<a>y,<a>z,<b>x,<b>y,<b>z,…        e.g. t,Lx,Ly,Lz,Rx,Ry,Rz
//
// with strictly increasing times t in seconds, and positions in metres. Alternatively, two files
// without header hold rows x,y,z, one row for each time step.

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/io/csv.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Target positions of k features at n times.
struct TargetCurves {
  /// Name of each feature: its column names without x, y, z.
  std::vector<std::string> names;
  /// Times of the samples (n, strictly increasing, s).
  VectorX<double> times;
  /// Positions of each feature at those times: k matrices of 3×n (m).
  std::vector<Points<double>> features;
};

namespace detail {

/// Reads the names of the features from a header. Returns what is wrong with the header, or "".
template <class = void>
std::string parse_target_header(const std::vector<std::string>& header,
                                std::vector<std::string>& names) {
  const std::string expected = ", expected t,Lx,Ly,Lz,Rx,Ry,Rz or the like";
  if (header.empty()) return "no header" + expected;
  if (header[0] != "t") return "header starts with " + in_quotes(header[0]) + expected;
  if (header.size() < 4 || header.size() % 3 != 1) {
    return "header has " + std::to_string(header.size()) + " columns" + expected;
  }
  for (std::size_t c = 1; c < header.size(); c += 3) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::string& cell = header[c + axis];
      if (cell.empty() || cell.back() != "xyz"[axis])
        return "header has " + in_quotes(cell) + expected;
      const std::string name = cell.substr(0, cell.size() - 1);
      if (axis == 0) {
        for (const std::string& other : names) {
          if (other == name) return "header has " + in_quotes(cell) + " twice";
        }
        names.push_back(name);
      } else if (name != names.back()) {
        return "header has " + in_quotes(cell) + " after " + in_quotes(header[c]) + expected;
      }
    }
  }
  return {};
}

/// Returns why the parts of a table contradict each other, or "". The parts of a table that was
/// read from a file never do.
template <class = void>
std::string check_parts(const CsvTable& table) {
  const std::string at_header = at_line(table.name, 1);
  if (table.values.rows() == 0) return at_header + "no row after the header";
  if (static_cast<Index>(table.header.size()) != table.values.cols()) {
    return at_header + "header has " + std::to_string(table.header.size()) +
           " columns, but the rows have " + std::to_string(table.values.cols());
  }
  if (static_cast<Index>(table.lines.size()) != table.values.rows()) {
    return at_header + std::to_string(table.values.rows()) + " rows, but the lines of " +
           std::to_string(table.lines.size());
  }
  return {};
}

}  // namespace detail

/// Makes target curves from a table with a header. Allocates. Fails when: the header is missing or
/// does not have the form above, the numbers of rows, header cells and line numbers contradict each
/// other, a time is not after the previous one, or there are fewer than two rows.
template <class = void>
Result<TargetCurves> targets_from_table(const CsvTable& table) {
  TargetCurves curves;
  if (const std::string wrong = detail::parse_target_header(table.header, curves.names);
      !wrong.empty()) {
    return Error{detail::at_line(table.name, 1) + wrong};
  }
  if (std::string wrong = detail::check_parts(table); !wrong.empty())
    return Error{std::move(wrong)};
  curves.times = table.values.col(0);
  for (Index i = 1; i < curves.times.size(); ++i) {
    if (curves.times[i] > curves.times[i - 1]) continue;
    return Error{detail::at_line(table.name, table.lines[static_cast<std::size_t>(i)]) + "time " +
                 number_text(curves.times[i]) + " does not come after " +
                 number_text(curves.times[i - 1])};
  }
  if (curves.times.size() < 2) {
    return Error{detail::at_line(table.name, table.lines.back()) +
                 "expected at least 2 rows, found 1"};
  }
  for (std::size_t f = 0; f < curves.names.size(); ++f) {
    curves.features.push_back(
        table.values.middleCols(static_cast<Index>(1 + 3 * f), 3).transpose());
  }
  return curves;
}

/// Reads target curves of any number of features from one file with a header. Allocates. Fails
/// when: the file cannot be read, a row is malformed, or `targets_from_table` fails.
template <class = void>
Result<TargetCurves> read_targets(const std::string& path) {
  const Result<CsvTable> table = read_csv(path, CsvHeader::Names);
  if (!table) return Error{table.error()};
  return targets_from_table(*table);
}

/// Reads the target curves "L" and "R" from two files without header; row i belongs to time i·dt
/// (s). Allocates. Fails when: dt is not positive, a file cannot be read, a row is malformed, or
/// the files differ in their number of rows.
template <class = void>
Result<TargetCurves> read_target_pair(const std::string& left, const std::string& right,
                                      double dt) {
  if (!is_finite(dt) || !(dt > 0))
    return Error{"dt is " + number_text(dt) + ", expected a positive number of seconds"};
  TargetCurves curves;
  curves.names = {"L", "R"};
  Index rows = 0;
  for (const std::string& path : {left, right}) {
    const Result<CsvTable> table = read_csv(path, CsvHeader::Absent, 3);
    if (!table) return Error{table.error()};
    const Index found = table->values.rows();
    const std::string at_last = detail::at_line(path, table->lines.back());
    if (found < 2) return Error{at_last + "expected at least 2 rows, found 1"};
    if (!curves.features.empty() && found != rows) {
      return Error{at_last + "expected " + std::to_string(rows) + " rows as in " + left +
                   ", found " + std::to_string(found)};
    }
    rows = found;
    curves.features.push_back(table->values.transpose());
  }
  curves.times = VectorX<double>::LinSpaced(rows, 0, static_cast<double>(rows - 1)) * dt;
  if (!all_finite(curves.times))
    return Error{"dt is " + number_text(dt) + ", too large for " + std::to_string(rows) + " rows"};
  return curves;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
