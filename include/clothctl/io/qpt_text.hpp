#pragma once

// Programs, sequences and solutions written as QPT text (format: qpt.hpp), in the shortest digits that read back as the same
// numbers. A solution file holds what anyone needs to check an answer against the program's own file:
//
//   qpt 1   name S   n N   m M
//   status S   objective V                 r included
//   x N …   y M …   z N …                  H x + g = Aᵀ y + z, multipliers ≥ 0 at a lower bound, ≤ 0 at an upper one
//   ray N …   farkas_y M …   farkas_z N …  the proof, where the status is unbounded or infeasible
//   end
//
// and for a sequence `frames K`, then `frame T` before the answer of each frame.

#include <cstddef>
#include <string>
#include <string_view>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/io/csv.hpp"
#include "clothctl/io/qp_problem.hpp"

namespace clothctl {

namespace io_detail {

/// Appends sections of QPT.
class QptText {
 public:
  void head(const std::string& name, Index n, Index m) {
    std::string word;
    for (const char c : name) word += kSpaces.find(c) == std::string_view::npos && c != '\n' ? c : '_';
    text = "qpt 1\nname " + (word.empty() ? "unnamed" : word) + "\nn " + std::to_string(n) + "\nm " + std::to_string(m) + "\n";
  }
  void gradient(const VectorX<double>& g) {
    std::string list;
    Index count = 0;
    for (Index i = 0; i < g.size(); ++i) {
      if (!(g[i] < 0) && !(g[i] > 0)) continue;
      ++count;
      list += std::to_string(i) + " " + number_text(g[i]) + "\n";
    }
    text += "g " + std::to_string(count) + "\n" + list;
  }
  void entries(const char* key, const MatrixX<double>& M, bool upper) {
    std::string list;
    Index count = 0;
    for (Index i = 0; i < M.rows(); ++i) {
      for (Index j = upper ? i : 0; j < M.cols(); ++j) {
        if (!(M(i, j) < 0) && !(M(i, j) > 0)) continue;
        ++count;
        list += std::to_string(i) + " " + std::to_string(j) + " " + number_text(M(i, j)) + "\n";
      }
    }
    text += std::string(key) + " " + std::to_string(count) + "\n" + list;
  }
  void pairs(const char* key, const VectorX<double>& lower, const VectorX<double>& upper) {
    text += std::string(key) + " " + std::to_string(lower.size()) + "\n";
    for (Index i = 0; i < lower.size(); ++i) text += number_text(lower[i]) + " " + number_text(upper[i]) + "\n";
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
  void values(const char* key, const VectorX<double>& v) {
    if (v.size() == 0) return;
    text += std::string(key) + " " + std::to_string(v.size()) + "\n";
    for (Index i = 0; i < v.size(); ++i) text += number_text(v[i]) + (i + 1 < v.size() ? " " : "\n");
  }
};

}  // namespace io_detail

/// Writes a program or a sequence as QPT text, which `parse_qpt` reads back as the same numbers; white space in its name
/// becomes `_`, names of rows and columns are left out. Allocates.
inline std::string qpt_text(const QpProblem& problem) {
  io_detail::QptText out;
  out.head(problem.name, problem.n(), problem.m());
  out.text += "r " + number_text(problem.r) + "\n";
  out.entries("H", problem.H, true);
  out.gradient(problem.g);
  out.entries("A", problem.A, false);
  out.pairs("rows", problem.rl, problem.ru);
  out.pairs("cols", problem.lb, problem.ub);
  out.answer(problem.reference);
  if (!problem.frames.empty())
    out.text += "frames " + std::to_string(problem.frames.size()) + "\nshift " + std::to_string(problem.shift) + "\n";
  for (std::size_t t = 0; t < problem.frames.size(); ++t) {
    const QpSequenceFrame& frame = problem.frames[t];
    out.text += "frame " + std::to_string(t) + "\n";
    out.gradient(frame.g);
    if (frame.rl != problem.rl || frame.ru != problem.ru) out.pairs("rows", frame.rl, frame.ru);
    if (frame.lb != problem.lb || frame.ub != problem.ub) out.pairs("cols", frame.lb, frame.ub);
    QpReference brief;
    brief.status = frame.reference.status;
    brief.objective = frame.reference.objective;
    out.answer(brief);
  }
  return out.text + "end\n";
}

/// Writes a solution as QPT text, which `parse_qpt_solution` reads back. Allocates.
inline std::string qpt_solution_text(const QpSolution& solution) {
  io_detail::QptText out;
  out.head(solution.name, solution.n, solution.m);
  out.answer(solution.reference);
  if (!solution.frames.empty()) out.text += "frames " + std::to_string(solution.frames.size()) + "\n";
  for (std::size_t t = 0; t < solution.frames.size(); ++t) {
    out.text += "frame " + std::to_string(t) + "\n";
    out.answer(solution.frames[t]);
  }
  return out.text + "end\n";
}

}  // namespace clothctl
