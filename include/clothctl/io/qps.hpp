#pragma once

// QPS, the MPS format of linear programs with a quadratic objective, in free form (fields between
// blanks) and in fixed form (columns 2-3, 5-12, 15-22, 25-36, 40-47, 50-61, where names may hold
// blanks). Sections start in column 1, their lines with a blank; lines that start with * are
// comments.
//
//   NAME      name
//   OBJSENSE  MIN (default) or MAX, on this line or the next
//   ROWS      N objective, L ≤, G ≥, E =     The first N is the objective, further ones are
//                                            dropped.
//   COLUMNS   column row value [row value]
//   RHS       [set] row value [row value]    In the objective row: minus the constant r.
//   RANGES    [set] row R [row R]            L: [rhs - |R|, rhs], G: [rhs, rhs + |R|],
//                                            E: from rhs to rhs + R, below it for R < 0
//   BOUNDS    type [set] column [value]      Without a bound, 0 ≤ x.
//   QUADOBJ   column column value            Objective ½ xᵀQx + …; each off-diagonal pair once,
//                                            in either triangle. QSECTION is read as QUADOBJ.
//   QMATRIX   column column value            The same, with both entries of each pair.
//   ENDATA
//
// Types of bounds: LO, UP, FX (both), FR (free), MI (no lower), PL (no upper). A negative UP
// removes the lower bound 0 of a column for which no lower bound is given; UP of 0 does not. Of
// several sets of RHS, RANGES or BOUNDS only the first is used; a later bound of a column replaces
// an earlier one on the same side. Integer unknowns (BV, LI, UI, SC, SI, MARKER) are refused.
// Numbers may have Fortran's exponent D. Bounds may be inf; a value beyond ±1e20 means no bound.
//
// Reference: Maros and Mészáros, A repository of convex quadratic programming problems, Optim.
// Methods Softw. 11 (1999).

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/io/csv.hpp"
#include "clothctl/io/detail/qps_fields.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/io/qp_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How the fields of a QPS file are told apart.
enum class QpsForm {
  /// Free form; where that fails, fixed form.
  Detect,
  /// Fields between blanks; names without blanks.
  Free,
  /// Fields in their columns, blanks between them.
  Fixed
};

namespace detail {

/// Reads QPS text line by line. Functions return true on success; the first error is kept.
class QpsParser {
 public:
  QpsParser(std::string_view text, std::string name, bool fixed)
      : text_(text), file_(std::move(name)), fixed_(fixed) {}

  bool parse() {
    for (line_ = 1;; ++line_) {
      const std::size_t end = text_.find('\n');
      std::string_view line = text_.substr(0, end);
      line = line.substr(0, line.find_last_not_of(kSpaces) + 1);
      if (!line.empty() && line[0] != '*') {
        const bool of_section = kSpaces.find(line[0]) != std::string_view::npos;
        if (!(of_section ? data(line) : head(line))) return false;
        if (section_ == "ENDATA") return finish();
      }
      if (end == std::string_view::npos) return fail("the file ends without ENDATA");
      text_.remove_prefix(end + 1);
    }
  }

  std::string error;
  QpProblem problem;

 private:
  struct Row {
    char type = 'L';
    double rhs = 0, range = 0;
    bool has_rhs = false, has_range = false;
    Index line = 0;
  };
  struct Column {
    double lower = 0, upper = scalar_traits<double>::infinity();
    bool lower_given = false;
    Index line = 0;
  };
  static constexpr int kObjective = -1, kDropped = -2;

  bool fail(const std::string& what) { return fail_at(line_, what); }
  bool fail_at(Index line, const std::string& what) {
    if (error.empty()) error = at_line(file_, line) + what;
    return false;
  }

  static std::string upper_case(std::string_view word) {
    std::string out(word);
    for (char& c : out) c = 'a' <= c && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
    return out;
  }

  bool head(std::string_view line) {
    const QpsWords words(line);
    section_ = upper_case(words.word[0]);
    set_known_ = false;
    if (section_ == "NAME") {
      problem.name = std::string(trimmed(line.substr(4)));
      return once();
    }
    bool known = false;
    for (const std::string_view name : {"OBJSENSE", "ROWS", "COLUMNS", "RHS", "RANGES", "BOUNDS",
                                        "QUADOBJ", "QMATRIX", "QSECTION", "ENDATA"})
      known = known || section_ == name;
    if (!known) return fail(in_quotes(words.word[0]) + " is not a section that is read");
    const std::size_t most = section_ == "OBJSENSE" || section_ == "QSECTION" ? 2 : 1;
    if (words.count > most)
      return fail(section_ + ": " + in_quotes(words.word[most]) +
                  " stands in the section's first line");
    if (section_ == "OBJSENSE") return once() && (words.count < 2 || sense(words.word[1]));
    if (section_ == "QSECTION" || section_ == "QMATRIX" || section_ == "QUADOBJ") {
      if (!quadratic_.empty()) return fail(section_ + " after " + quadratic_);
      quadratic_ = section_;
      return true;
    }
    return once();
  }
  bool once() {
    if (std::find(sections_.begin(), sections_.end(), section_) != sections_.end())
      return fail(section_ + " is given twice");
    sections_.push_back(section_);
    return true;
  }

  bool sense(std::string_view word) {
    const std::string upper = upper_case(word);
    problem.maximise = upper == "MAX" || upper == "MAXIMIZE" || upper == "MAXIMISE";
    return problem.maximise || upper == "MIN" || upper == "MINIMIZE" || upper == "MINIMISE" ||
           fail("OBJSENSE: " + in_quotes(word) + " is not MIN or MAX");
  }

  bool data(std::string_view line) {
    if (section_ == "OBJSENSE") return sense(trimmed(line));
    QpsFields fields;
    if (section_.empty() || section_ == "NAME")
      return fail(in_quotes(trimmed(line)) + " stands in no section");
    const std::string wrong = (fixed_ ? qps_fixed_fields : qps_free_fields)(section_, line, fields);
    if (!wrong.empty()) return fail(section_ + ": " + wrong);
    if (section_ == "ROWS") return row(fields);
    if (section_ == "BOUNDS") return bound(fields);
    if (section_ == "COLUMNS" && fields.key[0] == "'MARKER'")
      return fail("integer unknowns ('MARKER') are not read");
    if (section_ == "RHS" || section_ == "RANGES") {
      if (!counts(fields.name)) return true;
      return side(fields, 0) && (fields.pairs < 2 || side(fields, 1));
    }
    const bool quadratic = section_ != "COLUMNS";
    int column = 0;
    if (quadratic ? !find(columns_by_name_, "column", fields.name, column)
                  : !column_of(fields.name, column))
      return false;
    for (std::size_t k = 0; k < fields.pairs; ++k) {
      int target = 0;
      double value = 0;
      if (!(quadratic ? find(columns_by_name_, "column", fields.key[k], target)
                      : find(rows_by_name_, "row", fields.key[k], target)))
        return false;
      if (!number(fields.key[k], fields.value[k], value, false)) return false;
      if (quadratic) {
        hessian_.push_back({target, column, value, line_});
      } else if (target != kDropped) {
        entries_.push_back({target, column, value, line_});
      }
    }
    return true;
  }

  /// Returns true when `set` is the first set of values in its section.
  bool counts(std::string_view set) {
    if (!set_known_) set_ = std::string(set);
    set_known_ = true;
    return set == set_;
  }

  bool find(const std::unordered_map<std::string, int>& names, const char* what,
            std::string_view name, int& index) {
    const auto found = names.find(std::string(name));
    if (found == names.end()) return fail(section_ + ": " + in_quotes(name) + " is not a " + what);
    index = found->second;
    return true;
  }

  bool number(std::string_view name, std::string_view text, double& value, bool open) {
    std::string digits(text);
    for (char& c : digits)
      c = c == 'D' || c == 'd' ? 'e' : 'A' <= c && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    if (open && (parse_infinity(digits, "inf", value) || parse_infinity(digits, "infinity", value)))
      return true;
    const std::string wrong = parse_number(digits, value, text);
    return wrong.empty() || fail(section_ + ": " + in_quotes(name) + ": " + wrong);
  }

  bool row(const QpsFields& f) {
    const char type = f.type.size() == 1 ? static_cast<char>(f.type[0] & ~0x20) : ' ';
    if (type != 'N' && type != 'L' && type != 'G' && type != 'E')
      return fail("ROWS: " + in_quotes(f.type) + " is not N, L, G or E");
    if (f.name.empty()) return fail("ROWS: a row without a name");
    int index = static_cast<int>(rows_.size());
    if (type == 'N') index = has_objective_ ? kDropped : kObjective;
    if (!rows_by_name_.emplace(std::string(f.name), index).second)
      return fail("ROWS: " + in_quotes(f.name) + " is given twice");
    if (type == 'N') {
      has_objective_ = true;
      return true;
    }
    if (index >= kLargestQpSide)
      return fail("ROWS: more than " + std::to_string(kLargestQpSide) + " rows");
    Row row;
    row.type = type;
    row.line = line_;
    rows_.push_back(row);
    problem.row_names.emplace_back(f.name);
    return true;
  }

  bool column_of(std::string_view name, int& index) {
    if (name.empty()) return fail("COLUMNS: a column without a name");
    const auto [place, fresh] =
        columns_by_name_.emplace(std::string(name), static_cast<int>(columns_.size()));
    index = place->second;
    if (!fresh) return true;
    if (index >= kLargestQpSide)
      return fail("COLUMNS: more than " + std::to_string(kLargestQpSide) + " columns");
    columns_.emplace_back();
    columns_.back().line = line_;
    problem.column_names.emplace_back(name);
    return true;
  }

  /// Reads one number of RHS or RANGES.
  bool side(const QpsFields& f, std::size_t k) {
    int index = 0;
    double value = 0;
    if (!find(rows_by_name_, "row", f.key[k], index) || !number(f.key[k], f.value[k], value, false))
      return false;
    if (index == kDropped) return true;
    const bool range = section_ == "RANGES";
    if (index == kObjective) {
      if (range) return fail("RANGES: " + in_quotes(f.key[k]) + " is the objective");
      if (has_constant_) return fail("RHS: " + in_quotes(f.key[k]) + " is given twice");
      has_constant_ = true;
      problem.r = value == 0 ? 0 : -value;
      return true;
    }
    Row& row = rows_[static_cast<std::size_t>(index)];
    bool& known = range ? row.has_range : row.has_rhs;
    if (known) return fail(section_ + ": " + in_quotes(f.key[k]) + " is given twice");
    known = true;
    (range ? row.range : row.rhs) = value;
    row.line = line_;
    return true;
  }

  bool bound(const QpsFields& f) {
    for (const std::string_view integer : {"BV", "LI", "UI", "SC", "SI"}) {
      if (f.type == integer)
        return fail("BOUNDS: type " + in_quotes(f.type) +
                    " asks for an integer unknown, which is not read");
    }
    bool known = false;
    for (const std::string_view type : {"LO", "UP", "FX", "FR", "MI", "PL"})
      known = known || f.type == type;
    if (!known) return fail("BOUNDS: type " + in_quotes(f.type) + " is unknown");
    if (!counts(f.name)) return true;
    int index = 0;
    double value = 0;
    if (!find(columns_by_name_, "column", f.key[0], index)) return false;
    if (qps_bound_has_value(f.type) && !number(f.key[0], f.value[0], value, f.type != "FX"))
      return false;
    Column& column = columns_[static_cast<std::size_t>(index)];
    const double infinity = scalar_traits<double>::infinity();
    if (f.type == "LO" || f.type == "FX") column.lower = value;
    if (f.type == "UP" || f.type == "FX") column.upper = value;
    if (f.type == "MI" || f.type == "FR") column.lower = -infinity;
    if (f.type == "PL" || f.type == "FR") column.upper = infinity;
    column.lower_given = column.lower_given || (f.type != "UP" && f.type != "PL");
    if (is_unbounded(column.lower) && column.lower > 0)
      return fail("BOUNDS: " + in_quotes(f.key[0]) + ": lower bound " + number_text(column.lower));
    if (is_unbounded(column.upper) && column.upper < 0)
      return fail("BOUNDS: " + in_quotes(f.key[0]) + ": upper bound " + number_text(column.upper));
    return true;
  }

  bool finish() {
    const Index n = static_cast<Index>(columns_.size()), m = static_cast<Index>(rows_.size());
    if (n == 0) return fail("no column before ENDATA");
    if (const std::string wrong = validate_qp_size(n, m); !wrong.empty()) return fail(wrong);
    return fill_sides(n, m) && fill_rows(n, m) && fill_hessian(n);
  }

  bool fill_sides(Index n, Index m) {
    problem.lb.setZero(n);
    problem.ub.setZero(n);
    for (Index j = 0; j < n; ++j) {
      const Column& column = columns_[static_cast<std::size_t>(j)];
      const bool opened = !column.lower_given && column.upper < 0;
      problem.lb[j] = opened ? -scalar_traits<double>::infinity() : column.lower;
      problem.ub[j] = column.upper;
    }
    problem.rl.setZero(m);
    problem.ru.setZero(m);
    for (Index i = 0; i < m; ++i) {
      const Row& row = rows_[static_cast<std::size_t>(i)];
      const double infinity = scalar_traits<double>::infinity(), width = std::abs(row.range);
      double lower = row.rhs, upper = row.rhs;
      if (row.type == 'L') lower = row.has_range ? row.rhs - width : -infinity;
      if (row.type == 'G') upper = row.has_range ? row.rhs + width : infinity;
      if (row.type == 'E') (row.range < 0 ? lower : upper) += row.range;
      const std::string name = in_quotes(problem.row_names[static_cast<std::size_t>(i)]);
      if (is_unbounded(lower) && lower > 0)
        return fail_at(row.line, "row " + name + ": lower bound " + number_text(lower));
      if (is_unbounded(upper) && upper < 0)
        return fail_at(row.line, "row " + name + ": upper bound " + number_text(upper));
      problem.rl[i] = lower;
      problem.ru[i] = upper;
    }
    return true;
  }

  bool twice(const QpEntry& e, const std::string& row) {
    const std::string column = problem.column_names[static_cast<std::size_t>(e.column)];
    return fail_at(e.line, "column " + in_quotes(column) + ": the entry of " + in_quotes(row) +
                               " is given twice");
  }

  bool fill_rows(Index n, Index m) {
    problem.g.setZero(n);
    problem.A.setZero(m, n);
    std::vector<bool> known(static_cast<std::size_t>((m + 1) * n), false);
    for (const QpEntry& e : entries_) {  // the objective counts as the row after the last
      const Index i = e.row == kObjective ? m : e.row;
      std::vector<bool>::reference mark = known[static_cast<std::size_t>(i * n + e.column)];
      if (mark)
        return twice(e, i == m ? "the objective" : problem.row_names[static_cast<std::size_t>(i)]);
      mark = true;
      (i == m ? problem.g[e.column] : problem.A(i, e.column)) = e.value;
    }
    if (problem.maximise) {
      for (Index j = 0; j < n; ++j) problem.g[j] = problem.g[j] == 0 ? 0 : -problem.g[j];
      problem.r = problem.r == 0 ? 0 : -problem.r;
    }
    return true;
  }

  bool fill_hessian(Index n) {
    problem.H.setZero(n, n);
    const bool both = quadratic_ == "QMATRIX";
    std::vector<bool> known(static_cast<std::size_t>(hessian_.empty() ? 0 : n * n), false);
    for (const QpEntry& e : hessian_) {
      std::vector<bool>::reference mark = known[static_cast<std::size_t>(e.row * n + e.column)];
      if (mark) return twice(e, problem.column_names[static_cast<std::size_t>(e.row)]);
      mark = true;
      if (!both) known[static_cast<std::size_t>(e.column * n + e.row)] = true;
      problem.H(e.row, e.column) = problem.maximise ? -e.value : e.value;
      if (!both) problem.H(e.column, e.row) = problem.H(e.row, e.column);
    }
    for (const QpEntry& e : hessian_) {
      const double here = problem.H(e.row, e.column), there = problem.H(e.column, e.row);
      if (!(here < there) && !(there < here)) continue;
      const std::string a = in_quotes(problem.column_names[static_cast<std::size_t>(e.column)]);
      const std::string b = in_quotes(problem.column_names[static_cast<std::size_t>(e.row)]);
      return fail_at(e.line, "QMATRIX: the entry of " + a + " and " + b + " differs from that of " +
                                 b + " and " + a);
    }
    return true;
  }

  std::string_view text_;
  std::string file_;
  bool fixed_;
  Index line_ = 1;
  std::string section_, quadratic_, set_;
  bool set_known_ = false, has_objective_ = false, has_constant_ = false;
  std::vector<std::string> sections_;
  std::unordered_map<std::string, int> rows_by_name_, columns_by_name_;
  std::vector<Row> rows_;
  std::vector<Column> columns_;
  std::vector<QpEntry> entries_, hessian_;
};

}  // namespace detail

/// Parses a program from QPS text; `name` stands for the file in messages. With OBJSENSE MAX the
/// result holds the negated objective, and `maximise` is set. Allocates. Complexity:
/// O(length + n² + mn). Fails when: a section, a type, a row or a column is unknown or given twice,
/// a line has the wrong fields, a number is NaN or (except in bounds) infinite, an unknown is
/// integer, QMATRIX is not symmetric, ENDATA is missing, or the program is larger than
/// `kLargestQpSide` or `kLargestQpEntries`. A lower bound above its upper bound is not an error.
inline Result<QpProblem> parse_qps(std::string_view text, const std::string& name,
                                   QpsForm form = QpsForm::Detect) {
  detail::QpsParser parser(text, name, form == QpsForm::Fixed);
  if (parser.parse()) return std::move(parser.problem);
  if (form == QpsForm::Detect) {
    detail::QpsParser fixed(text, name, true);
    if (fixed.parse()) return std::move(fixed.problem);
  }
  return Error{parser.error};
}

/// Reads a program from a QPS file; see `parse_qps`. Allocates. Fails when: the file cannot be
/// read, or as `parse_qps` does.
inline Result<QpProblem> read_qps(const std::string& path, QpsForm form = QpsForm::Detect) {
  const Result<std::string> text = read_file(path);
  if (!text) return Error{text.error()};
  return parse_qps(*text, path, form);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
