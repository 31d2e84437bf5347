#include "judge.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace versus {

std::string_view to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::Solved: return "solved";
    case Verdict::Inaccurate: return "inaccurate";
    case Verdict::Infeasible: return "infeasible";
    case Verdict::Unbounded: return "unbounded";
    case Verdict::Stopped: return "stopped";
    case Verdict::Refused: return "refused";
    case Verdict::Unsupported: return "unsupported";
    case Verdict::NotRun: return "not run";
  }
  return "unknown";
}

bool is_positive_definite(const Matrix& H) {
  const Eigen::LDLT<Matrix> factor(H);
  const Vector pivots = factor.vectorD();
  return factor.info() == Eigen::Success && pivots.minCoeff() > 1e-14 * pivots.maxCoeff();
}

Judgement judge(const clothctl::QpProblem& program, const clothctl::QpSequenceFrame& frame,
                Verdict verdict, const Answer& answer) {
  Judgement j;
  const bool claim =
      verdict == Verdict::Solved || verdict == Verdict::Infeasible || verdict == Verdict::Unbounded;
  const std::string& expected = frame.reference.status;
  if (expected == "infeasible") {
    const bool crossed = clothctl::first_crossed_bound(frame) >= 0;
    j.right = verdict == Verdict::Infeasible || (crossed && verdict == Verdict::Refused);
  } else if (expected == "unbounded") {
    j.right = verdict == Verdict::Unbounded;
  } else if (verdict == Verdict::Solved && answer.x.size() == program.n()) {
    j.residuals = clothctl::kkt_residuals(program.H, frame.g, program.A, frame.rl, frame.ru,
                                          frame.lb, frame.ub, answer.x, answer.y, answer.z);
    const double found = j.residuals.objective + program.r;
    const double wanted = frame.reference.objective.value_or(found);
    const double scale = std::max({1.0, std::abs(wanted), std::abs(program.r)});
    j.right = j.residuals.worst() <= kTolerance && std::abs(found - wanted) <= kTolerance * scale;
    j.absolute =
        j.right && j.residuals.stationarity <= kTolerance && j.residuals.feasibility <= kTolerance;
  }
  j.false_status = claim && !j.right;
  return j;
}

}  // namespace versus
