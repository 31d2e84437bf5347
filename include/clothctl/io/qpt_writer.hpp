#pragma once

// Programs, sequences and solutions written as QPT text (format: qpt.hpp), in the shortest digits
// that read back as the same numbers. A solution file holds what anyone needs to check an answer
// against the program's own file:
//
//   qpt 1   name S   n N   m M
//   status S   objective V       the objective with the constant r
//   unique 0|1                   where it is known
//   x N …   y M …   z N …        H x + g = Aᵀ y + z; multipliers are ≥ 0 at a lower bound and
//                                ≤ 0 at an upper one
//   ray N …                      the proof, where the status is unbounded
//   farkas_y M …  farkas_z N …   the proof, where the status is infeasible
//   end
//
// and for a sequence `frames K`, then `frame T` before the answer of each frame.

#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/scalar.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/io/csv.hpp"
#include "clothctl/io/qp_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Appends sections of QPT.
class QptText {
 public:
  void head(const std::string& name, Index n, Index m) {
    std::string word;
    for (const char c : name)
      word += kSpaces.find(c) == std::string_view::npos && c != '\n' ? c : '_';
    text = "qpt 1\nname " + (word.empty() ? "unnamed" : word) + "\nn " + std::to_string(n) +
           "\nm " + std::to_string(m) + "\n";
  }
  void gradient(const VectorX<double>& g) {
    std::string list;
    Index count = 0;
    for (Index i = 0; i < g.size(); ++i) {
      if (is_zero(g[i])) continue;
      ++count;
      list += std::to_string(i) + " " + number_text(g[i]) + "\n";
    }
    text += "g " + std::to_string(count) + "\n" + list;
  }
  /// Appends the entries of a matrix, or with `upper` those of its upper triangle. If the entry
  /// across the diagonal is not finite, it is written instead, so that a reader refuses it.
  void entries(const char* key, const MatrixX<double>& M, bool upper) {
    std::string list;
    Index count = 0;
    for (Index i = 0; i < M.rows(); ++i) {
      for (Index j = upper ? i : 0; j < M.cols(); ++j) {
        const double& value = upper && !is_finite(M(j, i)) ? M(j, i) : M(i, j);
        if (is_zero(value)) continue;
        ++count;
        list += std::to_string(i) + " " + std::to_string(j) + " " + number_text(value) + "\n";
      }
    }
    text += std::string(key) + " " + std::to_string(count) + "\n" + list;
  }
  void pairs(const char* key, const VectorX<double>& lower, const VectorX<double>& upper) {
    text += std::string(key) + " " + std::to_string(lower.size()) + "\n";
    for (Index i = 0; i < lower.size(); ++i)
      text += number_text(lower[i]) + " " + number_text(upper[i]) + "\n";
  }
  void answer(const QpReference& a) {
    if (!a.status.empty()) text += "status " + a.status + "\n";
    if (a.objective) text += "objective " + number_text(*a.objective) + "\n";
    if (a.unique) text += *a.unique ? "unique 1\n" : "unique 0\n";
    values("x", a.x);
    values("y", a.y);
    values("z", a.z);
    values("ray", a.ray);
    values("farkas_y", a.farkas_y);
    values("farkas_z", a.farkas_z);
  }

  std::string text;

 private:
  static bool is_zero(const double& value) {
    return is_finite(value) && !(value < 0) && !(value > 0);
  }
  void values(const char* key, const VectorX<double>& v) {
    if (v.size() == 0) return;
    text += std::string(key) + " " + std::to_string(v.size()) + "\n";
    for (Index i = 0; i < v.size(); ++i)
      text += number_text(v[i]) + (i + 1 < v.size() ? " " : "\n");
  }
};

/// Returns true when two vectors hold the same bits, which -ffast-math cannot misjudge.
inline bool same_bits(const VectorX<double>& a, const VectorX<double>& b) {
  if (a.size() != b.size()) return false;
  for (Index i = 0; i < a.size(); ++i) {
    if (std::bit_cast<std::uint64_t>(a[i]) != std::bit_cast<std::uint64_t>(b[i])) return false;
  }
  return true;
}

}  // namespace detail

/// Writes a program or a sequence as QPT text, which `parse_qpt` reads back as the same numbers. Of
/// H, the upper triangle is written. What `parse_qpt` refuses, such as NaN, is written all the same
/// and refused when read. The format cannot express the following, which is lost: `maximise` (the
/// minimum is written), names of rows and columns, white space in the name (`_` instead; an empty
/// name becomes `unnamed`), signs of zeros in H, g and A, `shift` without frames, and of a frame's
/// reference all but status and objective. The base program's status is left out when any frame has
/// none, since that frame would inherit it; likewise its objective. Allocates. Complexity:
/// O(n² + mn), and O(n + m) for each frame.
inline std::string qpt_text(const QpProblem& problem) {
  detail::QptText out;
  out.head(problem.name, problem.n(), problem.m());
  out.text += "r " + number_text(problem.r) + "\n";
  out.entries("H", problem.H, true);
  out.gradient(problem.g);
  out.entries("A", problem.A, false);
  out.pairs("rows", problem.rl, problem.ru);
  out.pairs("cols", problem.lb, problem.ub);
  QpReference base = problem.reference;
  for (const QpSequenceFrame& frame : problem.frames) {
    if (frame.reference.status.empty()) base.status.clear();
    if (!frame.reference.objective) base.objective.reset();
  }
  out.answer(base);
  if (!problem.frames.empty())
    out.text += "frames " + std::to_string(problem.frames.size()) + "\nshift " +
                std::to_string(problem.shift) + "\n";
  for (std::size_t t = 0; t < problem.frames.size(); ++t) {
    const QpSequenceFrame& frame = problem.frames[t];
    out.text += "frame " + std::to_string(t) + "\n";
    out.gradient(frame.g);
    if (!detail::same_bits(frame.rl, problem.rl) || !detail::same_bits(frame.ru, problem.ru))
      out.pairs("rows", frame.rl, frame.ru);
    if (!detail::same_bits(frame.lb, problem.lb) || !detail::same_bits(frame.ub, problem.ub))
      out.pairs("cols", frame.lb, frame.ub);
    QpReference brief;
    brief.status = frame.reference.status;
    brief.objective = frame.reference.objective;
    out.answer(brief);
  }
  return out.text + "end\n";
}

/// Writes a solution as QPT text, which `parse_qpt_solution` reads back as the same numbers; its
/// name becomes one word as by `qpt_text`. Values that are not finite are written, and refused when
/// read. Allocates.
inline std::string qpt_solution_text(const QpSolution& solution) {
  detail::QptText out;
  out.head(solution.name, solution.n, solution.m);
  out.answer(solution.reference);
  if (!solution.frames.empty())
    out.text += "frames " + std::to_string(solution.frames.size()) + "\n";
  for (std::size_t t = 0; t < solution.frames.size(); ++t) {
    out.text += "frame " + std::to_string(t) + "\n";
    out.answer(solution.frames[t]);
  }
  return out.text + "end\n";
}

}  // namespace clothctl::inline CLOTHCTL_ABI
