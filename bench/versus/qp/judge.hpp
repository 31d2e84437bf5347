#pragma once

// One judge for all: an answer counts when `clothctl::kkt_residuals` of the unscaled data says so,
// whatever the solver's status.

#include <string>
#include <string_view>

#include "clothctl/io/qp_problem.hpp"
#include "clothctl/qp/kkt.hpp"
#include "solver.hpp"

namespace versus {

/// What is allowed: relative residuals and objective, and absolute stationarity and violation for
/// well scaled problems.
inline constexpr double kTolerance = 1e-6;

/// What an answer is worth.
struct Judgement {
  /// The status is the expected one, and for "optimal" residuals and objective agree.
  bool right = false;
  /// Right, and stationarity and violation hold absolutely too.
  bool absolute = false;
  /// A verdict that is not true: a wrong status, or "solved" beyond the tolerance. Limits are
  /// misses but not false.
  bool false_status = false;
  clothctl::KktResiduals<double> residuals;
};

/// Names a verdict.
std::string_view to_string(Verdict verdict);

/// Judges an answer of the program (H, A) with the vectors and the reference of `frame`; r is the
/// objective's constant.
Judgement judge(const clothctl::QpProblem& program, const clothctl::QpSequenceFrame& frame,
                Verdict verdict, const Answer& answer);

}  // namespace versus
