#pragma once

// Tables of numbers as comma-separated text, one row a line, the same in every locale. Read: an optional UTF-8 mark, LF or
// CRLF, spaces around cells and blank lines at the end are tolerated, anything else is refused with one line
// `file:line: what is wrong`. Written: the shortest digits that read back as the same double.

#include <cassert>
#include <charconv>
#include <cstddef>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/io/file.hpp"

namespace clothctl {

/// A table of finite numbers and where it came from.
struct CsvTable {
  /// Name of the file, for messages.
  std::string name;
  /// Names of the columns; empty where the table has no header.
  std::vector<std::string> header;
  /// The numbers, one line of the file a row.
  MatrixX<double> values;
  /// Line of each row in the file, the first line is 1.
  std::vector<Index> lines;
};

/// Whether the first line of a table names its columns.
enum class CsvHeader {
  /// The first line holds numbers already.
  None,
  /// The first line names the columns.
  Names
};

namespace io_detail {

inline constexpr std::string_view kSpaces = " \t\r\v\f";

inline std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(kSpaces);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kSpaces) - first + 1);
}

/// The text in quotes for a message of one line: at most 40 characters, those that do not print as `?`.
inline std::string in_quotes(std::string_view text) {
  std::string out = "'";
  for (const char c : text.substr(0, 40)) out += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
  return out + (text.size() > 40 ? "…'" : "'");
}

inline std::string at_line(const std::string& name, Index line) { return name + ":" + std::to_string(line) + ": "; }

/// The cells of a line, spaces around them removed.
inline void split_cells(std::string_view line, std::vector<std::string_view>& cells) {
  cells.clear();
  while (true) {
    const std::size_t comma = line.find(',');
    cells.push_back(trimmed(line.substr(0, comma)));
    if (comma == std::string_view::npos) return;
    line.remove_prefix(comma + 1);
  }
}

/// Parses one cell; answers with what is wrong with it, "" where nothing is. `shown` stands for the cell there.
inline std::string parse_number(std::string_view cell, double& value, std::string_view shown) {
  if (cell.empty()) return "found an empty cell, expected a number";
  std::string_view digits = cell;
  if (digits.size() > 1 && digits[0] == '+' && digits[1] != '-' && digits[1] != '+') digits.remove_prefix(1);
  const std::from_chars_result end = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (end.ec == std::errc::result_out_of_range) return in_quotes(shown) + " is out of the range of a double";
  if (end.ec != std::errc() || end.ptr != digits.data() + digits.size()) return in_quotes(shown) + " is not a number";
  if (!is_finite(value)) return in_quotes(shown) + " is not finite";
  return {};
}
inline std::string parse_number(std::string_view cell, double& value) { return parse_number(cell, value, cell); }

/// Whether the text is `word` with or without a sign, and then the infinity that it stands for.
inline bool parse_infinity(std::string_view text, std::string_view word, double& value) {
  const bool negative = !text.empty() && text[0] == '-';
  if (negative || (!text.empty() && text[0] == '+')) text.remove_prefix(1);
  if (text != word) return false;
  value = negative ? -scalar_traits<double>::infinity() : scalar_traits<double>::infinity();
  return true;
}

/// The column of a cell for a message: its name where there is a header, else its number from 1.
inline std::string column_text(const CsvTable& table, std::size_t column) {
  if (!table.header.empty()) return "column " + in_quotes(table.header[column]);
  return "column " + std::to_string(column + 1);
}

}  // namespace io_detail

/// Parses a table from text; `name` stands for the file in messages. All rows must have as many cells as the header, or where
/// there is none `columns` cells (0: as many as the first row). Allocates. Complexity: O(length).
/// Fails when: there is no row, a row is short or long or blank between others, or a cell is not a finite number.
inline Result<CsvTable> parse_csv(std::string_view text, const std::string& name, CsvHeader header, std::size_t columns = 0) {
  CsvTable table;
  table.name = name;
  if (text.substr(0, 3) == "\xef\xbb\xbf") text.remove_prefix(3);
  if (text.find_first_not_of(" \t\r\v\f\n") == std::string_view::npos) {
    return Error{io_detail::at_line(name, 1) + "the file is empty"};
  }
  std::vector<double> numbers;
  std::vector<std::string_view> cells;
  Index blank = 0;
  for (Index number = 1; !text.empty(); ++number) {
    const std::size_t end = text.find('\n');
    const std::string_view line = io_detail::trimmed(text.substr(0, end));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (line.empty()) {
      if (blank == 0) blank = number;
      continue;
    }
    if (blank != 0) return Error{io_detail::at_line(name, blank) + "blank line before the last row"};
    io_detail::split_cells(line, cells);
    if (header == CsvHeader::Names && table.header.empty()) {
      table.header.assign(cells.begin(), cells.end());
      columns = cells.size();
      continue;
    }
    if (columns == 0) columns = cells.size();
    if (cells.size() != columns) {
      return Error{io_detail::at_line(name, number) + "expected " + std::to_string(columns) + " values, found " +
                   std::to_string(cells.size())};
    }
    for (std::size_t c = 0; c < cells.size(); ++c) {
      double value = 0;
      if (const std::string wrong = io_detail::parse_number(cells[c], value); !wrong.empty()) {
        return Error{io_detail::at_line(name, number) + io_detail::column_text(table, c) + ": " + wrong};
      }
      numbers.push_back(value);
    }
    table.lines.push_back(number);
  }
  if (table.lines.empty()) return Error{io_detail::at_line(name, 1) + "no row after the header"};
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  table.values =
      Eigen::Map<const RowMajor>(numbers.data(), static_cast<Index>(table.lines.size()), static_cast<Index>(columns));
  return table;
}

/// Reads a table from a file; see `parse_csv`. Allocates.
/// Fails when: the file cannot be read, or as `parse_csv` does.
inline Result<CsvTable> read_csv(const std::string& path, CsvHeader header, std::size_t columns = 0) {
  const Result<std::string> text = read_file(path);
  if (!text) return Error{text.error()};
  return parse_csv(*text, path, header, columns);
}

/// Gathers rows of numbers and writes them as a table with a header, which read_csv reads back as it was.
class CsvWriter {
 public:
  /// Starts a table with the given names of columns; names with a comma, a quote or a line break are quoted. Allocates.
  explicit CsvWriter(const std::vector<std::string>& columns) : columns_(columns) {
    for (std::size_t c = 0; c < columns.size(); ++c) {
      if (c > 0) text_ += ',';
      append_name(columns[c]);
      check_name(c);
    }
    text_ += '\n';
  }

  /// Appends a row. Fails when: it has not as many values as there are columns (assert). Allocates.
  void add_row(std::span<const double> values) {
    assert(values.size() == columns_.size());
    ++rows_;
    for (std::size_t c = 0; c < values.size(); ++c) {
      if (c > 0) text_ += ',';
      text_ += number_text(values[c]);
      if (!is_finite(values[c]) && problem_.empty()) {
        problem_ = "row " + std::to_string(rows_) + ", column " + io_detail::in_quotes(columns_[c]) + ": " +
                   number_text(values[c]) + " is not finite";
      }
    }
    text_ += '\n';
  }
  /// Appends a row. Fails when: it has not as many values as there are columns (assert). Allocates.
  void add_row(std::initializer_list<double> values) { add_row(std::span<const double>(values.begin(), values.size())); }

  /// The table so far as text, whatever it holds.
  const std::string& text() const { return text_; }
  /// Writes the table so far to a file; answers with the number of bytes. Fails when: read_csv would not read the same table
  /// back, for there is no row, a value is not finite, or a name needs quotes, begins or ends with a space or is missing; or
  /// the file cannot be written.
  Result<std::size_t> write(const std::string& path) const {
    if (!problem_.empty()) return Error{path + ": " + problem_};
    if (rows_ == 0) return Error{path + ": no row after the header"};
    return write_file(path, text_);
  }

 private:
  /// Notes a name that a reader would take for something else.
  void check_name(std::size_t c) {
    const std::string& name = columns_[c];
    const bool read_back = name.find_first_of(",\"\r\n") == std::string::npos && io_detail::trimmed(name) == name &&
                           !(columns_.size() == 1 && name.empty()) && !(c == 0 && name.substr(0, 3) == "\xef\xbb\xbf");
    if (!read_back && problem_.empty()) {
      problem_ = "column " + std::to_string(c + 1) + ": the name " + io_detail::in_quotes(name) + " would not be read back";
    }
  }

  void append_name(const std::string& name) {
    if (name.find_first_of(",\"\r\n") == std::string::npos) {
      text_ += name;
      return;
    }
    text_ += '"';
    for (const char c : name) {
      if (c == '"') text_ += '"';
      text_ += c;
    }
    text_ += '"';
  }

  std::vector<std::string> columns_;
  std::size_t rows_ = 0;
  std::string text_;
  std::string problem_;  // the first thing that a reader would refuse
};

}  // namespace clothctl
