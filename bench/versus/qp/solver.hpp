#pragma once

// The interface to every solver of the comparison. An adapter translates it to its solver's own
// calls. `prepare` converts storage (row-major copies, sparse matrices, rows sorted by kind) and is
// not timed.

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "clothctl/core/types.hpp"

namespace versus {

using clothctl::Index;
using Matrix = clothctl::MatrixX<double>;
using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Vector = clothctl::VectorX<double>;

/// The data that may change from frame to frame: min ½ xᵀHx + gᵀx, rl ≤ Ax ≤ ru, lb ≤ x ≤ ub.
struct Vectors {
  Vector g, lb, ub, rl, ru;
};

/// The matrices, and the vectors of the first solve.
struct Problem {
  Matrix H, A;
  Vectors first;
  /// Unknown i corresponds to unknown i + shift of the previous frame, and row i to row i +
  /// row_shift.
  Index shift = 0, row_shift = 0;

  Index n() const { return H.rows(); }
  Index m() const { return A.rows(); }
};

/// A solver's status in common terms.
enum class Verdict {
  Solved,
  Inaccurate,   ///< optimal to a loosened tolerance
  Infeasible,   ///< no feasible point
  Unbounded,    ///< the objective has no lower limit
  Stopped,      ///< a limit, or numerical trouble
  Refused,      ///< the solver calls the data invalid
  Unsupported,  ///< the solver's documented preconditions do not hold (H not positive definite)
  NotRun
};

/// A primal-dual triple: Hx + g = Aᵀy + z, multipliers ≥ 0 at a lower bound.
struct Answer {
  Vector x, y, z;
};

/// Where a solve starts.
enum class Start {
  Single,   ///< the only solve of its problem
  First,    ///< the first of a sequence
  Kept,     ///< from the result of the last solve
  Shifted,  ///< the same, shifted by a frame
};

/// A solver. A new one is made for every cold problem and every pass over a sequence.
class Solver {
 public:
  virtual ~Solver() = default;
  /// Converts storage; not timed. Returns false if the problem breaks a documented precondition.
  virtual bool prepare(const Problem& problem) = 0;
  /// Sets the matrices; timed in cold solves.
  virtual void setup() = 0;
  /// Solves; timed.
  virtual Verdict solve(const Vectors& v, Start start) = 0;
  /// Returns the answer in the common sign convention; not timed.
  virtual void read(Answer& answer) = 0;
};

/// A solver of the comparison, with its factory.
struct Entry {
  std::string name, version;
  /// Ways of starting warm frames. Each gives a line of the sequence tables.
  std::vector<Start> warm;
  /// Makes a solver with a time limit (s), if the solver has such an option.
  std::function<std::unique_ptr<Solver>(double)> make;
};

/// Returns whether H is positive definite with a margin, as Goldfarb-Idnani solvers need.
bool is_positive_definite(const Matrix& H);

/// Bounds with infinities replaced by ±big.
inline Vector clip(const Vector& bounds, double big) { return bounds.cwiseMax(-big).cwiseMin(big); }

/// Rows by kind, for solvers that separate equalities. Rows without any bound are left out. A row
/// keeps its kind within a sequence.
struct RowSplit {
  std::vector<Index> equal, other;
  Matrix A_equal, A_other;

  void take(const Problem& p) {
    equal.clear();
    other.clear();
    for (Index i = 0; i < p.m(); ++i) {
      const double low = p.first.rl[i], high = p.first.ru[i];
      if (low > -1e20 || high < 1e20) (low == high ? equal : other).push_back(i);
    }
    A_equal = p.A(equal, Eigen::all);
    A_other = p.A(other, Eigen::all);
  }
};

Entry clothctl_entry();
Entry daqp_entry();
Entry piqp_entry();
Entry qpoases_entry();
Entry osqp_entry();
Entry proxqp_entry();
Entry qpmad_entry();
Entry eiquadprog_entry();

/// Ours and all others that were built in.
std::vector<Entry> all_entries();

}  // namespace versus
