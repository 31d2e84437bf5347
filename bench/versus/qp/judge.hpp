#pragma once

// The same check for all solvers: whatever the status, an answer counts if
// `clothctl::kkt_residuals` of the unscaled data are small.

#include <string>
#include <string_view>

#include "clothctl/io/qp_problem.hpp"
#include "clothctl/qp/kkt.hpp"
#include "solver.hpp"

namespace versus {

/// Tolerances: relative residuals and objective; absolute stationarity and violation for well
/// scaled problems.
inline constexpr double kTolerance = 1e-6;

/// The result of a check.
struct Judgement {
  /// The status is the expected one, and for "optimal" the residuals and the objective are right.
  bool right = false;
  /// Right, and stationarity and violation are small in absolute terms too.
  bool absolute = false;
  /// A wrong claim: a wrong status, or "solved" with residuals above the tolerance. Reaching a
  /// limit is a miss but not a wrong claim.
  bool false_status = false;
  clothctl::KktResiduals<double> residuals;
};

/// Returns the name of a verdict.
std::string_view to_string(Verdict verdict);

/// Checks an answer of the program (H, A) with the vectors and the reference of `frame`. r is the
/// constant of the objective.
Judgement judge(const clothctl::QpProblem& program, const clothctl::QpSequenceFrame& frame,
                Verdict verdict, const Answer& answer);

}  // namespace versus
