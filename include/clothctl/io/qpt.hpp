#pragma once

// QPT, a text format for quadratic programs, single or in sequences, with their reference
// solutions:
//
//   qpt 1                        first: format and version
//   name S   n N   m M   r R     sizes come before any matrix; m and r may be left out (0)
//   H K        i j v …           K entries of the upper triangle of H, or
//   Hdense N   v …               its lower triangle with the diagonal, row by row, N(N+1)/2 values
//   g K        i v …             K entries of g; what is not given is 0
//   A K        i j v …           K entries of A
//   rows M     lo hi …           rl and ru of the rows; inf and -inf stand for no bound
//   cols N     lo hi …           lb and ub of the unknowns
//   status S                     optimal, infeasible or unbounded
//   objective V   unique 0|1     unique: whether the minimiser is
//   x N …   y M …   z N …        an optimal point and its multipliers; or a feasible x
//   ray N …                      proof of unbounded
//   farkas_y M …  farkas_z N …   proof of infeasible
//   frames K   shift S           K frames; unknown i of one is unknown i + S of the last
//   frame 0 …   frame 1 …
//   end
//
// Tokens are separated by white space; indices count from 0. After `frame T`, g, rows, cols, status
// and objective are those of frame T; those that are not given are taken from the base program. A
// solution file holds name, n, m, then status, objective, x, y, z, ray and the farkas pair, of the
// program or of each frame, and no data.

#include <cstddef>
#include <initializer_list>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/io/detail/token_reader.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/io/qp_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// What a QPT file holds.
enum class QptContent { Problem, Solution };

/// Reads QPT text section by section.
class QptParser : public TokenReader {
 public:
  QptParser(std::string_view text, std::string name, QptContent content)
      : TokenReader(text, std::move(name)), solution_(content == QptContent::Solution) {}

  bool parse() {
    std::string_view token;
    if (!next(token, "the head") || token != "qpt")
      return fail(in_quotes(token) + " found, expected qpt");
    Index version = 0;
    if (!count("qpt", 0, 1000000, version)) return false;
    if (version != 1)
      return fail("qpt: version " + std::to_string(version) + " is unknown, expected 1");
    while (true) {
      if (!next(token, last_)) return false;
      last_ = std::string(token);
      if (token == "end") return finish();
      if (!section(last_)) return false;
    }
  }

  QpProblem problem;
  QpSolution solution;

 private:
  using Vector = VectorX<double>;
  static bool one_of(const std::string& key, std::initializer_list<std::string_view> keys) {
    for (const std::string_view k : keys) {
      if (key == k) return true;
    }
    return false;
  }

  bool section(const std::string& key) {
    const bool answer = one_of(
        key, {"status", "objective", "unique", "x", "y", "z", "ray", "farkas_y", "farkas_z"});
    const bool head = one_of(key, {"name", "n", "m", "r", "frames", "shift"});
    const bool data = one_of(key, {"H", "Hdense", "g", "A", "rows", "cols"});
    if (key == "frame") return start_frame();
    if (!answer && !head && !data) return fail(in_quotes(key) + " is not a section");
    if (solution_ && data) return fail(in_quotes(key) + " does not belong into a solution");
    if (in_frame_ && !solution_ && !one_of(key, {"g", "rows", "cols", "status", "objective"}))
      return fail(in_quotes(key) + " does not belong into a frame");
    if (in_frame_ && head) return fail(in_quotes(key) + " does not belong into a frame");
    if (!seen_.insert(key == "Hdense" ? "H" : key).second)
      return fail(in_quotes(key) + " is given twice");
    if (head) return head_section(key);
    if ((data || !one_of(key, {"status", "objective", "unique"})) && !size_once()) return false;
    if (data) return data_section(key);
    return answer_section(key, reference());
  }

  QpReference& reference() {
    if (solution_) return in_frame_ ? solution.frames.back() : solution.reference;
    return frame().reference;
  }
  QpSequenceFrame& frame() { return in_frame_ ? problem.frames.back() : problem; }

  bool head_section(const std::string& key) {
    if (key == "name") return word(key, problem.name);
    if (key == "r") return number(key, problem.r);
    if (key == "frames") return count(key, 1, kLargestQpEntries, frames_);
    if (key == "shift") return size_once() && count(key, 0, n_, problem.shift);
    if (sized_) return fail(in_quotes(key) + " comes after what it sizes");
    return key == "n" ? count(key, 1, kLargestQpSide, n_) : count(key, 0, kLargestQpSide, m_);
  }

  /// Fixes n and m before the first section that needs them.
  bool size_once() {
    if (sized_) return true;
    if (n_ < 1) return fail(in_quotes(last_) + " comes before 'n'");
    if (const std::string wrong = validate_qp_size(n_, m_); !wrong.empty()) return fail(wrong);
    sized_ = true;
    if (solution_) return true;
    problem.g.setZero(n_);
    problem.rl.setZero(m_);
    problem.ru.setZero(m_);
    return true;
  }

  bool data_section(const std::string& key) {
    Index size = 0;
    if (key == "H")
      return count(key, 0, n_ * (n_ + 1) / 2, size) && entries(key, n_, size, true, hessian_);
    if (key == "A") return count(key, 0, m_ * n_, size) && entries(key, m_, size, false, rows_);
    if (key == "g") return gradient();
    if (key == "rows") return count(key, m_, m_, size) && pairs(key, m_, frame().rl, frame().ru);
    if (key == "cols") return count(key, n_, n_, size) && pairs(key, n_, frame().lb, frame().ub);
    if (!count(key, n_, n_, size)) return false;
    for (Index k = 0; k < n_ * (n_ + 1) / 2; ++k) {
      double value = 0;
      if (!number(key, value)) return false;
      triangle_.push_back(value);
    }
    return true;
  }

  bool entries(const std::string& key, Index rows, Index size, bool upper,
               std::vector<QpEntry>& out) {
    std::vector<bool> known(static_cast<std::size_t>(size > 0 ? rows * n_ : 0), false);
    for (Index k = 0; k < size; ++k) {
      Index i = 0, j = 0;
      double value = 0;
      if (!count(key + ": row", 0, rows - 1, i) || !count(key + ": column", 0, n_ - 1, j))
        return false;
      const std::string place = key + "(" + std::to_string(i) + "," + std::to_string(j) + ")";
      if (upper && j < i)
        return fail(place + " lies below the diagonal, expected the upper triangle");
      std::vector<bool>::reference mark = known[static_cast<std::size_t>(i * n_ + j)];
      if (mark) return fail(place + " is given twice");
      mark = true;
      if (!number(place, value)) return false;
      out.push_back({static_cast<int>(i), static_cast<int>(j), value, line()});
    }
    return true;
  }

  bool gradient() {
    Vector& g = frame().g;
    g.setZero(n_);
    std::vector<bool> known(static_cast<std::size_t>(n_), false);
    Index size = 0;
    if (!count("g", 0, n_, size)) return false;
    for (Index k = 0; k < size; ++k) {
      Index i = 0;
      if (!count("g: index", 0, n_ - 1, i)) return false;
      if (known[static_cast<std::size_t>(i)])
        return fail("g(" + std::to_string(i) + ") is given twice");
      known[static_cast<std::size_t>(i)] = true;
      if (!number("g(" + std::to_string(i) + ")", g[i])) return false;
    }
    return true;
  }

  bool pairs(const std::string& key, Index size, Vector& lower, Vector& upper) {
    lower.setZero(size);
    upper.setZero(size);
    for (Index i = 0; i < size; ++i) {
      const std::string place = key + ": " + std::to_string(i);
      if (!number(place, lower[i], true)) return false;
      if (is_unbounded(lower[i]) && lower[i] > 0)
        return fail(place + ": lower bound " + number_text(lower[i]));
      if (!number(place, upper[i], true)) return false;
      if (is_unbounded(upper[i]) && upper[i] < 0)
        return fail(place + ": upper bound " + number_text(upper[i]));
    }
    return true;
  }

  bool answer_section(const std::string& key, QpReference& out) {
    if (key == "status") {
      if (!word(key, out.status)) return false;
      return solution_ || one_of(out.status, {"optimal", "infeasible", "unbounded"}) ||
             fail("status: " + in_quotes(out.status) + " is not optimal, infeasible or unbounded");
    }
    if (key == "objective") return number(key, out.objective.emplace());
    Index size = 0;
    if (key == "unique") {
      if (!count(key, 0, 1, size)) return false;
      out.unique = size == 1;
      return true;
    }
    Vector& values = key == "x"          ? out.x
                     : key == "y"        ? out.y
                     : key == "z"        ? out.z
                     : key == "ray"      ? out.ray
                     : key == "farkas_y" ? out.farkas_y
                                         : out.farkas_z;
    const Index wanted = key == "y" || key == "farkas_y" ? m_ : n_;
    if (!count(key, wanted, wanted, size)) return false;
    values.setZero(size);
    for (Index i = 0; i < size; ++i) {
      if (!number(key + "(" + std::to_string(i) + ")", values[i])) return false;
    }
    return true;
  }

  Index frames_read() const {
    return static_cast<Index>(solution_ ? solution.frames.size() : problem.frames.size());
  }

  bool start_frame() {
    if (!in_frame_ && !complete()) return false;
    if (frames_ < 1) return fail("'frame' comes before 'frames'");
    const Index known = frames_read();
    if (known == frames_) return fail("a frame after the last of " + std::to_string(frames_));
    Index number = 0;
    if (!count("frame", known, known, number)) return false;
    if ((known + 1) * (3 * n_ + 2 * m_) > kLargestQpEntries)
      return fail("frame " + std::to_string(known) + ": more than " +
                  std::to_string(kLargestQpEntries) + " numbers in frames");
    in_frame_ = true;
    seen_.clear();
    if (solution_) {
      solution.frames.emplace_back();
    } else {
      problem.frames.push_back({problem.g, problem.rl, problem.ru, problem.lb, problem.ub, {}});
      problem.frames.back().reference.status = problem.reference.status;
      problem.frames.back().reference.objective = problem.reference.objective;
    }
    return true;
  }

  /// Returns true when all required sections of the base program were given.
  bool complete() {
    if (!size_once()) return false;
    if (solution_) return true;
    if (m_ > 0 && seen_.count("rows") == 0)
      return fail("'rows' is missing before " + in_quotes(last_));
    return seen_.count("cols") != 0 || fail("'cols' is missing before " + in_quotes(last_));
  }

  bool finish() {
    if (!in_frame_ && !complete()) return false;
    if (frames_read() != frames_)
      return fail("expected " + std::to_string(frames_) + " frames, found " +
                  std::to_string(frames_read()));
    if (!at_end("end")) return false;
    if (solution_) {
      solution.name = problem.name;
      solution.n = n_;
      solution.m = m_;
      return true;
    }
    problem.H.setZero(n_, n_);
    problem.A.setZero(m_, n_);
    for (const QpEntry& e : hessian_)
      problem.H(e.row, e.column) = problem.H(e.column, e.row) = e.value;
    for (const QpEntry& e : rows_) problem.A(e.row, e.column) = e.value;
    std::size_t k = 0;
    for (Index i = 0; i < n_ && !triangle_.empty(); ++i) {
      for (Index j = 0; j <= i; ++j) problem.H(i, j) = problem.H(j, i) = triangle_[k++];
    }
    return true;
  }

  bool solution_;
  std::string last_ = "qpt";  // the section being read
  std::set<std::string> seen_;
  Index n_ = 0, m_ = 0, frames_ = 0;
  bool sized_ = false, in_frame_ = false;
  std::vector<QpEntry> hessian_, rows_;
  std::vector<double> triangle_;
};

}  // namespace detail

/// Parses a program or a sequence from QPT text; `name` stands for the file in messages. Allocates.
/// Complexity: O(length + n² + mn). Fails when: a section is unknown, misplaced, missing, given
/// twice or cut short, a count or an index is out of range, an entry of a matrix is given twice, a
/// number is NaN or (except in bounds) infinite, the program is larger than `kLargestQpSide` or
/// `kLargestQpEntries`, or anything follows `end`. A lower bound above its upper one is not
/// refused.
template <class = void>
Result<QpProblem> parse_qpt(std::string_view text, const std::string& name) {
  detail::QptParser parser(text, name, detail::QptContent::Problem);
  if (!parser.parse()) return Error{parser.error()};
  return std::move(parser.problem);
}

/// Reads a program or a sequence from a QPT file; see `parse_qpt`. Allocates. Fails when: the file
/// cannot be read, or as `parse_qpt` does.
template <class = void>
Result<QpProblem> read_qpt(const std::string& path) {
  const Result<std::string> text = read_file(path);
  if (!text) return Error{text.error()};
  return parse_qpt(*text, path);
}

/// Parses a solution from QPT text that holds no data. Allocates. Fails when: as `parse_qpt` does,
/// or it holds data.
template <class = void>
Result<QpSolution> parse_qpt_solution(std::string_view text, const std::string& name) {
  detail::QptParser parser(text, name, detail::QptContent::Solution);
  if (!parser.parse()) return Error{parser.error()};
  return std::move(parser.solution);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
