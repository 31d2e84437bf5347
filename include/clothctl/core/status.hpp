#pragma once

// Outcomes as plain enums: each value says what the caller should do.

#include <string_view>

namespace clothctl {

/// How a simulation step ended.
enum class StepStatus {
  /// The step met its tolerance. Go on.
  Converged,
  /// The iteration limit struck; the state was advanced with the best iterate. Go on, or shorten the step.
  IterationLimit,
  /// The input holds NaN, an infinity, an index off the mesh or a non-positive step; the state was left as it was. Mend the
  /// input.
  InvalidInput,
  /// The state holds NaN or an infinity; it was left as it was. Restore an earlier state.
  InvalidState,
  /// The step matrix could not be factored or the result was not finite; the state was left as it was. Shorten the step.
  NumericalFailure
};

/// How a quadratic program ended.
enum class QpStatus {
  /// Optimal: an independent check of the unscaled optimality conditions passes. Use x.
  Solved,
  /// Optimality holds only to a loosened tolerance; the residuals say how far. Use x with care.
  SolvedInaccurate,
  /// The budget ran out, or rounding stopped progress; x is the best iterate. It keeps its bounds, but rows may be violated, as
  /// far as the residuals say. Look at them before using x, or raise the budget.
  IterationLimit,
  /// The caller's clock ran out; x is as with IterationLimit.
  TimeLimit,
  /// No x satisfies the constraints; a verified certificate is in the result. Relax the constraints.
  PrimalInfeasible,
  /// There are feasible points, and the objective falls without bound along the ray in the result. Add bounds or curvature.
  DualInfeasible,
  /// The Hessian has a negative direction. Convexify it.
  NonConvex,
  /// Non-finite entries, asymmetric Hessian, a lower bound above its upper one, or bad settings; nothing was changed. Mend the
  /// data.
  InvalidData
};

/// How a planning frame ended.
enum class PlanStatus {
  /// The plan is optimal for its model. Apply it.
  Planned,
  /// The QP stopped early: the plan is not optimal. Bounds, friction cones and grip limits hold; hard patch rows may not quite.
  /// Apply it.
  Suboptimal,
  /// The hard patch rows could not be met; the plan minimises their violation, which the result reports. Apply it with care.
  Relaxed,
  /// Measured state or target hold NaN or an infinity, or state or result are of another size; planner and result were left as
  /// they were. Mend the input.
  InvalidInput,
  /// Linearisation or QP failed; the previous plan, shifted by a frame, is in the result. Apply it or stop.
  Failed
};

/// Whether a plan of this status is one to apply: all but InvalidInput and Failed.
constexpr bool can_apply(PlanStatus status) { return status != PlanStatus::InvalidInput && status != PlanStatus::Failed; }

/// Names a step status.
constexpr std::string_view to_string(StepStatus status) {
  switch (status) {
    case StepStatus::Converged: return "converged";
    case StepStatus::IterationLimit: return "iteration_limit";
    case StepStatus::InvalidInput: return "invalid_input";
    case StepStatus::InvalidState: return "invalid_state";
    case StepStatus::NumericalFailure: return "numerical_failure";
  }
  return "unknown";
}

/// Names a QP status.
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

/// Names a planning status.
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

}  // namespace clothctl
