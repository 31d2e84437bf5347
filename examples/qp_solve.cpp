// Solves a quadratic program, or a sequence of them, from a file. Checks the answers on the file's
// own numbers.
//
//   qp_solve HS118.qpt --solution hs118.txt
//   qp_solve sequence.qpt --json --out frames.csv
//
// The file formats are described in clothctl/io/qpt.hpp and clothctl/io/qps.hpp. Class Solver shows
// how the two solvers are set up and used; copy it into your program.

#include <algorithm>
#include <vector>

#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"
#include "support/options.hpp"
#include "support/qp_answer.hpp"
#include "support/qp_report.hpp"
#include "support/qp_request.hpp"
#include "support/timing.hpp"

namespace {

using namespace program;
using clothctl::QpProblem;
using clothctl::QpSequenceFrame;

/// Solves frames of one problem, each from the active set of the previous one. Uses BoxActiveSet
/// for a problem without rows, else ActiveSet.
class Solver {
 public:
  /// Sets the matrices, which all frames share.
  Solver(const QpProblem& problem, const Request& o)
      : problem_(problem),
        closest_point_(o.closest_point),
        box_(settings_of(o)),
        rows_(settings_of(o)) {
    result_.resize(problem.n(), problem.m());
    if (has_rows()) {
      refusal_ = rows_.set_hessian(problem.H);
      if (refusal_ != QpStatus::Solved) {
        refused_ = refused_entry(rows_.refusal(), "H", problem.H, o.file);
      } else if ((refusal_ = rows_.set_rows(problem.A)) != QpStatus::Solved) {
        refused_ = refused_entry(rows_.refusal(), "A", problem.A, o.file);
      }
    } else {
      refusal_ = box_.set_hessian(problem.H);
      if (refusal_ != QpStatus::Solved)
        refused_ = refused_entry(box_.refusal(), "H", problem.H, o.file);
    }
  }

  /// Shifts the warm start by one frame of a receding horizon.
  void shift() {
    if (has_rows()) return rows_.shift(problem_.shift, problem_.row_shift());
    box_.shift(problem_.shift);
  }
  /// Forgets the warm start.
  void reset() { has_rows() ? rows_.reset() : box_.reset(); }

  /// Solves for the vectors of one frame. Crossed bounds prove infeasibility without a solve.
  void solve(const QpSequenceFrame& f) {
    result_.iterations = 0;
    crossed_ = clothctl::first_crossed_bound(f);
    if (refusal_ != QpStatus::Solved) {
      result_.status = refusal_;
    } else if (crossed_ >= 0) {
      result_.status = QpStatus::PrimalInfeasible;
    } else if (has_rows()) {
      result_.status = rows_.solve(f.g, f.lb, f.ub, f.rl, f.ru, result_);
    } else {
      result_.status = box_.solve(f.g, f.lb, f.ub, result_);
    }
  }

  /// Checks the last answer.
  Answer answer(const QpSequenceFrame& f, double seconds) const {
    return check_answer(problem_, f, {result_, crossed_, refused_, closest_point_}, seconds);
  }

 private:
  bool has_rows() const { return problem_.m() > 0; }

  const QpProblem& problem_;
  bool closest_point_;
  clothctl::BoxActiveSet<double> box_;
  clothctl::ActiveSet<double> rows_;
  clothctl::QpResult<double> result_;
  QpStatus refusal_ = QpStatus::Solved;
  std::string refused_;
  clothctl::Index crossed_ = -1;
};

/// A cold solve: the time includes a new solver, its memory and its matrices.
Answer solve_cold(const QpProblem& problem, const QpSequenceFrame& frame, const Request& o) {
  const double before = thread_seconds();
  Solver solver(problem, o);
  solver.solve(frame);
  const double seconds = thread_seconds() - before;
  return solver.answer(frame, seconds);
}

/// A warm solve of the next frame: the time includes the shift.
double seconds_of_frame(Solver& solver, const QpSequenceFrame& frame, bool first) {
  const double before = thread_seconds();
  if (!first) solver.shift();
  solver.solve(frame);
  return thread_seconds() - before;
}

int solve_single(const QpProblem& problem, const Request& o) {
  return report_single(problem, o, solve_cold(problem, problem, o));
}

int solve_sequence(const QpProblem& problem, const Request& o) {
  const std::size_t count = problem.frames.size();
  std::vector<Answer> cold, warm;
  Progress progress;
  for (std::size_t t = 0; t < count; ++t) {
    cold.push_back(solve_cold(problem, problem.frames[t], o));
    if (cold.back().status == QpStatus::InvalidData)
      refuse(o.file + ": frame " + std::to_string(t) + ": " + cold.back().note);
    progress.show(static_cast<long>(t + 1), static_cast<long>(count));
  }
  Solver solver(problem, o);
  for (int pass = 0; pass < o.passes; ++pass) {
    solver.reset();
    for (std::size_t t = 0; t < count; ++t) {
      const double seconds = seconds_of_frame(solver, problem.frames[t], t == 0);
      if (pass == 0) warm.push_back(solver.answer(problem.frames[t], seconds));
      warm[t].seconds = std::min(warm[t].seconds, seconds);
    }
  }
  progress.clear();
  return report_sequence(problem, o, cold, warm);
}

}  // namespace

int main(int argc, char** argv) {
  const Request o = parse_request(argc, argv);
  const QpProblem problem = read_problem(o.file);
  return problem.frames.empty() ? solve_single(problem, o) : solve_sequence(problem, o);
}
