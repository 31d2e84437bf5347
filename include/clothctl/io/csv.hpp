#pragma once

// Tables of numbers as comma-separated text, one row in each line. The format does not depend on
// the locale. The reader accepts an optional UTF-8 byte order mark, LF or CRLF, spaces around cells
// and blank lines at the end. It refuses anything else with one line `file:line: what is wrong`.
// The writer uses the fewest digits that read back as the same double.

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

namespace clothctl::inline CLOTHCTL_ABI {

/// A table of finite numbers, its file and its lines.
struct CsvTable {
  /// Name of the file, for error messages.
  std::string name;
  /// Names of the columns; empty if the table has no header.
  std::vector<std::string> header;
  /// The numbers; each row is one line of the file.
  MatrixX<double> values;
  /// Line number of each row in the file; the first line has number 1.
  std::vector<Index> lines;
};

/// What the first line of a table holds.
enum class CsvHeader {
  /// Numbers: the table has no header.
  Absent,
  /// The names of the columns.
  Names
};

namespace detail {

inline constexpr std::string_view kSpaces = " \t\r\v\f";

inline std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(kSpaces);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kSpaces) - first + 1);
}

/// Returns the text in single quotes for a message of one line: at most 40 characters, with `?` in
/// place of control characters.
inline std::string in_quotes(std::string_view text) {
  std::string out = "'";
  for (const char c : text.substr(0, 40))
    out += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
  return out + (text.size() > 40 ? "…'" : "'");
}

inline std::string at_line(const std::string& name, Index line) {
  return name + ":" + std::to_string(line) + ": ";
}

/// Splits a line into cells and removes the spaces around them.
inline void split_cells(std::string_view line, std::vector<std::string_view>& cells) {
  cells.clear();
  while (true) {
    const std::size_t comma = line.find(',');
    cells.push_back(trimmed(line.substr(0, comma)));
    if (comma == std::string_view::npos) return;
    line.remove_prefix(comma + 1);
  }
}

/// Parses one cell. Returns what is wrong with it, or "". The message shows `shown` in place of the
/// cell.
inline std::string parse_number(std::string_view cell, double& value, std::string_view shown) {
  if (cell.empty()) return "found an empty cell, expected a number";
  std::string_view digits = cell;
  if (digits.size() > 1 && digits[0] == '+' && digits[1] != '-' && digits[1] != '+')
    digits.remove_prefix(1);
  const std::from_chars_result end =
      std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (end.ec == std::errc::result_out_of_range)
    return in_quotes(shown) + " is out of the range of a double";
  if (end.ec != std::errc() || end.ptr != digits.data() + digits.size())
    return in_quotes(shown) + " is not a number";
  if (!is_finite(value)) return in_quotes(shown) + " is not finite";
  return {};
}
inline std::string parse_number(std::string_view cell, double& value) {
  return parse_number(cell, value, cell);
}

/// Returns true when the text is `word` with or without a sign, and sets `value` to the infinity of
/// that sign.
inline bool parse_infinity(std::string_view text, std::string_view word, double& value) {
  const bool negative = !text.empty() && text[0] == '-';
  if (negative || (!text.empty() && text[0] == '+')) text.remove_prefix(1);
  if (text != word) return false;
  value = negative ? -scalar_traits<double>::infinity() : scalar_traits<double>::infinity();
  return true;
}

/// Names a column for a message: by its header if there is one, else by its number from 1.
inline std::string column_text(const CsvTable& table, std::size_t column) {
  if (!table.header.empty()) return "column " + in_quotes(table.header[column]);
  return "column " + std::to_string(column + 1);
}

}  // namespace detail

/// Parses a table from text. `name` is the name of the file in messages. All rows must have as many
/// cells as the header. Without a header they must have `columns` cells, or with 0 as many as the
/// first row. Allocates. Complexity: O(length). Fails when: there is no row, a row has another
/// number of cells, a line between rows is blank, or a cell is not a finite number.
inline Result<CsvTable> parse_csv(std::string_view text, const std::string& name, CsvHeader header,
                                  std::size_t columns = 0) {
  CsvTable table;
  table.name = name;
  if (text.substr(0, 3) == "\xef\xbb\xbf") text.remove_prefix(3);
  if (text.find_first_not_of(" \t\r\v\f\n") == std::string_view::npos) {
    return Error{detail::at_line(name, 1) + "the file is empty"};
  }
  std::vector<double> numbers;
  std::vector<std::string_view> cells;
  Index blank = 0;
  for (Index number = 1; !text.empty(); ++number) {
    const std::size_t end = text.find('\n');
    const std::string_view line = detail::trimmed(text.substr(0, end));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (line.empty()) {
      if (blank == 0) blank = number;
      continue;
    }
    if (blank != 0) return Error{detail::at_line(name, blank) + "blank line before the last row"};
    detail::split_cells(line, cells);
    if (header == CsvHeader::Names && table.header.empty()) {
      table.header.assign(cells.begin(), cells.end());
      columns = cells.size();
      continue;
    }
    if (columns == 0) columns = cells.size();
    if (cells.size() != columns) {
      return Error{detail::at_line(name, number) + "expected " + std::to_string(columns) +
                   " values, found " + std::to_string(cells.size())};
    }
    for (std::size_t c = 0; c < cells.size(); ++c) {
      double value = 0;
      if (const std::string wrong = detail::parse_number(cells[c], value); !wrong.empty()) {
        return Error{detail::at_line(name, number) + detail::column_text(table, c) + ": " + wrong};
      }
      numbers.push_back(value);
    }
    table.lines.push_back(number);
  }
  if (table.lines.empty()) return Error{detail::at_line(name, 1) + "no row after the header"};
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  table.values = Eigen::Map<const RowMajor>(numbers.data(), static_cast<Index>(table.lines.size()),
                                            static_cast<Index>(columns));
  return table;
}

/// Reads a table from a file with `parse_csv`. Allocates. Fails when: the file cannot be read, or
/// `parse_csv` fails.
inline Result<CsvTable> read_csv(const std::string& path, CsvHeader header,
                                 std::size_t columns = 0) {
  const Result<std::string> text = read_file(path);
  if (!text) return Error{text.error()};
  return parse_csv(*text, path, header, columns);
}

/// Collects rows of numbers and writes them as a table with a header. read_csv reads the same table
/// back.
class CsvWriter {
 public:
  /// Starts a table with the given column names. `text()` shows names with a comma, a quote or a
  /// line break in quotes; `write` refuses them. Allocates.
  explicit CsvWriter(const std::vector<std::string>& columns) : columns_(columns) {
    for (std::size_t c = 0; c < columns.size(); ++c) {
      if (c > 0) text_ += ',';
      append_name(columns[c]);
      check_name(c);
    }
    text_ += '\n';
  }

  /// Appends a row. A row whose number of values differs from the number of columns is left out,
  /// and `write` then fails and names it. Allocates.
  void add_row(std::span<const double> values) {
    ++rows_;
    if (values.size() != columns_.size()) {
      if (problem_.empty()) {
        problem_ = "row " + std::to_string(rows_) + ": expected " +
                   std::to_string(columns_.size()) + " values, found " +
                   std::to_string(values.size());
      }
      return;
    }
    for (std::size_t c = 0; c < values.size(); ++c) {
      if (c > 0) text_ += ',';
      text_ += number_text(values[c]);
      if (!is_finite(values[c]) && problem_.empty()) {
        problem_ = "row " + std::to_string(rows_) + ", column " + detail::in_quotes(columns_[c]) +
                   ": " + number_text(values[c]) + " is not finite";
      }
    }
    text_ += '\n';
  }
  /// Appends a row, as above.
  void add_row(std::initializer_list<double> values) {
    add_row(std::span<const double>(values.begin(), values.size()));
  }

  /// Returns the text of the table so far, even if `write` would refuse it.
  const std::string& text() const { return text_; }
  /// Writes the table so far to a file and returns the number of bytes. Fails when: read_csv would
  /// not read the same table back, i.e. there is no row, a row has the wrong number of values, a
  /// value is not finite, or a name is missing, needs quotes, or begins or ends with a space; or
  /// the file cannot be written.
  Result<std::size_t> write(const std::string& path) const {
    if (!problem_.empty()) return Error{path + ": " + problem_};
    if (rows_ == 0) return Error{path + ": no row after the header"};
    return write_file(path, text_);
  }

 private:
  /// Records a problem when read_csv would not read the name back.
  void check_name(std::size_t c) {
    const std::string& name = columns_[c];
    const bool read_back =
        name.find_first_of(",\"\r\n") == std::string::npos && detail::trimmed(name) == name &&
        !(columns_.size() == 1 && name.empty()) && !(c == 0 && name.substr(0, 3) == "\xef\xbb\xbf");
    if (!read_back && problem_.empty()) {
      problem_ = "column " + std::to_string(c + 1) + ": the name " + detail::in_quotes(name) +
                 " would not be read back";
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
  std::string problem_;  // the first reason why `write` fails
};

}  // namespace clothctl::inline CLOTHCTL_ABI
