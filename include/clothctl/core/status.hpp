#pragma once

// Outcomes as plain enums. The comment of each value says what the caller should do.

#include <string_view>

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a simulation step ended.
enum class StepStatus {
  /// The step met its tolerance. Continue.
  Converged,
  /// The iteration limit was reached; the state was advanced with the best iterate. Continue, or
  /// shorten the step.
  IterationLimit,
  /// The input holds NaN, an infinity, an index off the mesh, a vertex driven twice or counts that
  /// differ, or the step length is not positive and finite; the state is unchanged. Correct the
  /// input: `check_input` of the model says what is wrong.
  InvalidInput,
  /// The state holds NaN or an infinity, or its number of vertices is not that of the model; the
  /// state is unchanged. Restore an earlier state: `check_input` of the model says what is wrong.
  InvalidState,
  /// The workspace was made by another model, or by none; the state is unchanged. Use a workspace
  /// from `make_workspace` of this model.
  InvalidWorkspace,
  /// The step matrix was not positive definite or the result was not finite; the state is
  /// unchanged. Shorten the step.
  NumericalFailure
};

/// How a quadratic program ended.
enum class QpStatus {
  /// Optimal: an independent test of the unscaled optimality conditions passed. Use x.
  Solved,
  /// Optimal only to looser tolerances, as the residuals show, or rounding could hide a larger
  /// error. Use x with care.
  SolvedInaccurate,
  /// The iteration limit was reached, or rounding stopped progress; x is the best iterate. It is
  /// within its bounds, but may violate rows: read the residuals before you use x, or raise the
  /// limit.
  IterationLimit,
  /// The time limit of the caller's clock was reached; x is as with IterationLimit.
  TimeLimit,
  /// No x satisfies the constraints; the result holds a verified certificate. Relax the
  /// constraints.
  PrimalInfeasible,
  /// There are feasible points, and the objective decreases without bound along the ray in the
  /// result. Add bounds or curvature.
  DualInfeasible,
  /// The Hessian has a direction of negative curvature. Make it positive semidefinite.
  NonConvex,
  /// An entry is not finite, the Hessian is not symmetric, a lower bound exceeds its upper bound,
  /// or a setting is out of range; the solver is unchanged. Correct the data.
  InvalidData
};

/// How a planning frame ended.
enum class PlanStatus {
  /// The plan is optimal for its model. Apply it.
  Planned,
  /// The QP stopped early, so the plan is not optimal. It satisfies bounds, friction cones and grip
  /// limits; it may violate hard patch rows slightly. Apply it.
  Suboptimal,
  /// No plan satisfies the hard patch rows; this plan minimises their violation, which the result
  /// reports. Apply it with care.
  Relaxed,
  /// The measured state or the target holds NaN or an infinity, or the state or the result has the
  /// wrong size; planner and result are unchanged. Correct the input.
  InvalidInput,
  /// The linearisation or the QP failed; the result holds the previous plan, shifted by one frame.
  /// Apply it or stop.
  Failed
};

/// Returns true when a plan of this status may be applied: all but InvalidInput and Failed.
constexpr bool can_apply(PlanStatus status) {
  return status != PlanStatus::InvalidInput && status != PlanStatus::Failed;
}

/// Returns the name of a step status.
constexpr std::string_view to_string(StepStatus status) {
  switch (status) {
    case StepStatus::Converged: return "converged";
    case StepStatus::IterationLimit: return "iteration_limit";
    case StepStatus::InvalidInput: return "invalid_input";
    case StepStatus::InvalidState: return "invalid_state";
    case StepStatus::InvalidWorkspace: return "invalid_workspace";
    case StepStatus::NumericalFailure: return "numerical_failure";
  }
  return "unknown";
}

/// Returns the name of a QP status.
constexpr std::string_view to_string(QpStatus status) {
  switch (status) {
    case QpStatus::Solved: return "solved";
    case QpStatus::SolvedInaccurate: return "solved_inaccurate";
    case QpStatus::IterationLimit: return "iteration_limit";
    case QpStatus::TimeLimit: return "time_limit";
    case QpStatus::PrimalInfeasible: return "primal_infeasible";
    case QpStatus::DualInfeasible: return "dual_infeasible";
    case QpStatus::NonConvex: return "non_convex";
    case QpStatus::InvalidData: return "invalid_data";
  }
  return "unknown";
}

/// Returns the name of a planning status.
constexpr std::string_view to_string(PlanStatus status) {
  switch (status) {
    case PlanStatus::Planned: return "planned";
    case PlanStatus::Suboptimal: return "suboptimal";
    case PlanStatus::Relaxed: return "relaxed";
    case PlanStatus::InvalidInput: return "invalid_input";
    case PlanStatus::Failed: return "failed";
  }
  return "unknown";
}

}  // namespace clothctl::inline CLOTHCTL_ABI
