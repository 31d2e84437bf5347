#pragma once

// A quadratic program as files hold it:
//
//   min ½ xᵀHx + gᵀx + r   subject to   rl ≤ A x ≤ ru,  lb ≤ x ≤ ub
//
//   H x + g = Aᵀ y + z     at the optimum
//
// and sequences of them, which share H and A. Readers: qpt.hpp, qps.hpp.

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Files with more unknowns or more rows than this are refused.
inline constexpr Index kLargestQpSide = 20000;
/// Files whose matrices H and A, or whose frames, would hold more numbers than this (8 bytes each)
/// are refused.
inline constexpr Index kLargestQpEntries = Index(1) << 26;

/// The answer of a program: what a file expects, or what a solver found.
struct QpReference {
  /// "optimal", "infeasible", "unbounded", or in solutions the name of another QpStatus; empty
  /// where it is not stated.
  std::string status;
  /// The optimal value, r included.
  std::optional<double> objective;
  /// True when the minimiser is the only one.
  std::optional<bool> unique;
  /// A minimiser (n); with "unbounded" a feasible point. Empty where absent, like the vectors
  /// below.
  VectorX<double> x;
  /// Multipliers of the rows (m), ≥ 0 at a lower bound.
  VectorX<double> y;
  /// Multipliers of the bounds (n), ≥ 0 at a lower bound.
  VectorX<double> z;
  /// With "unbounded": a direction d (n) with H d = 0 and gᵀd < 0 that never meets a bound.
  VectorX<double> ray;
  /// With "infeasible": the row part y (m) of a proof (y, z): Aᵀy + z = 0, and yᵀa + zᵀx is
  /// negative for all rl ≤ a ≤ ru and lb ≤ x ≤ ub.
  VectorX<double> farkas_y;
  /// With "infeasible": the bound part z (n) of that proof.
  VectorX<double> farkas_z;
};

/// What changes from frame to frame of a sequence.
struct QpSequenceFrame {
  /// Gradient, n.
  VectorX<double> g;
  /// Lower bounds of the rows, m.
  VectorX<double> rl;
  /// Upper bounds of the rows, m.
  VectorX<double> ru;
  /// Lower bounds of the unknowns, n. Where one exceeds its upper bound, no point is feasible.
  VectorX<double> lb;
  /// Upper bounds of the unknowns, n.
  VectorX<double> ub;
  /// The expected answer.
  QpReference reference;
};

/// A program. With `frames` it is a sequence, whose base program the other members hold.
struct QpProblem : QpSequenceFrame {
  /// Its name.
  std::string name;
  /// Hessian, n×n, symmetric.
  MatrixX<double> H;
  /// Rows, m×n.
  MatrixX<double> A;
  /// The constant r of the objective.
  double r = 0;
  /// True when the file asks for a maximum. H, g and r are then those of the negated objective, so
  /// that the program still is a minimisation.
  bool maximise = false;
  /// Names of the unknowns, n, or none.
  std::vector<std::string> column_names;
  /// Names of the rows, m, or none.
  std::vector<std::string> row_names;
  /// The frames of a sequence; empty for a single program.
  std::vector<QpSequenceFrame> frames;
  /// Unknown i of a frame corresponds to unknown i + shift of the frame before.
  Index shift = 0;

  /// Number of unknowns.
  Index n() const { return g.size(); }
  /// Number of rows.
  Index m() const { return rl.size(); }
  /// Row i of a frame corresponds to row i + row_shift() of the frame before: shift · m / n.
  Index row_shift() const { return n() > 0 ? shift * m() / n() : 0; }
};

/// The answer of a program or of each frame of a sequence, without its data.
struct QpSolution {
  /// Name of the program.
  std::string name;
  /// Number of unknowns.
  Index n = 0;
  /// Number of rows.
  Index m = 0;
  /// The answer; for sequences empty.
  QpReference reference;
  /// The answers of the frames of a sequence.
  std::vector<QpReference> frames;
};

/// Returns j for the first unknown j with lb_j > ub_j, else n + i for the first row i with
/// rl_i > ru_i, else -1. Unless it is -1, no point is feasible, and no solver is needed.
inline Index first_crossed_bound(const QpSequenceFrame& frame) {
  for (Index j = 0; j < frame.lb.size(); ++j) {
    if (frame.lb[j] > frame.ub[j]) return j;
  }
  for (Index i = 0; i < frame.rl.size(); ++i) {
    if (frame.rl[i] > frame.ru[i]) return frame.lb.size() + i;
  }
  return -1;
}

namespace detail {

/// Returns what is wrong with the size of a program, or "".
inline std::string validate_qp_size(Index n, Index m) {
  if (n <= kLargestQpSide && m <= kLargestQpSide && n * (n + m) <= kLargestQpEntries) return {};
  return std::to_string(n) + " unknowns and " + std::to_string(m) + " rows are too many: at most " +
         std::to_string(kLargestQpSide) + " of each and " + std::to_string(kLargestQpEntries) +
         " entries in H and A";
}

/// One entry of a sparse matrix and the line it stands in.
struct QpEntry {
  int row = 0, column = 0;
  double value = 0;
  Index line = 0;
};

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
