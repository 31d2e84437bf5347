#pragma once

// Turns the solution of a window into its plan, the raw inputs r_k = B u_k + r0. For velocities, it
// limits the change from the previous plan r̄ to max_change. The outputs then change by
//
//   Δy_k = Σ_(j <= k) R_(k-j) (r_j - r̄_j)        R: impulse response

#include <cmath>

#include "clothctl/mpc/detail/window_problem.hpp"
#include "clothctl/mpc/plan_types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The change of the outputs from the previous plan to the new one.
template <RealScalar Scalar>
class PlanChange {
 public:
  /// Makes room. Allocates.
  template <class Problem>
  void reserve(const Problem& problem) {
    column_.setZero(problem.request.inputs());
    outputs_.setZero(problem.request.output_rows(), problem.settings.horizon);
  }

  /// Writes the raw inputs of the solution of `qp` to result.plan and computes the change. If there
  /// is a previous plan and the inputs are velocities, their change is scaled down to max_change.
  /// Never allocates.
  template <class Problem, class Qp>
  void take(const Problem& problem, const Qp& qp, bool has_previous, PlanResult<Scalar>& result) {
    using std::abs;
    const Index p = problem.basis.unknowns(), m = problem.request.inputs(),
                horizon = problem.settings.horizon;
    const Scalar most = problem.settings.max_change;
    const bool limited =
        has_previous && Scalar(0) < most && problem.settings.input != GripInput::Force;
    const MatrixX<Scalar>& previous = problem.response.plan;
    Scalar scale = Scalar(1);
    for (Index k = 0; k < horizon; ++k) {
      result.plan.col(k).noalias() = problem.basis.matrix() * qp.frame(k, p);
      result.plan.col(k) += problem.basis.offset();
      for (Index i = 0; limited && i < m; ++i) {
        const Scalar change = abs(result.plan(i, k) - previous(i, k));
        if (most < scale * change) scale = most / change;
      }
    }
    if (scale < Scalar(1)) result.plan = previous + scale * (result.plan - previous);
    const WindowResponse<Scalar>& response = problem.response;
    // Features that have a Jacobian respond by it, all other outputs by the impulse response.
    const Index own = response.has_jacobian ? 3 * problem.feature_count : 0;
    outputs_.setZero();
    for (Index k = 0; k < horizon; ++k) {
      for (Index j = 0; j <= k; ++j) {
        column_ = result.plan.col(j) - previous.col(j);
        outputs_.col(k).tail(outputs_.rows() - own).noalias() +=
            response.impulse_response.middleCols((k - j) * m, m).bottomRows(outputs_.rows() - own) *
            column_;
        if (own > 0)
          outputs_.col(k).head(own).noalias() +=
              response.jacobian.block(k * own, j * m, own, m) * column_;
      }
    }
  }

  /// Returns true when the new force plan changes the velocity of a held vertex by more than
  /// max_change in some frame, compared with the previous plan. Such a plan cannot be scaled back,
  /// because the previous plan need not lie inside of this frame's friction cones.
  template <class Problem>
  bool too_large(const Problem& problem, bool has_previous) const {
    using std::abs;
    if (!has_previous || problem.settings.input != GripInput::Force ||
        !(Scalar(0) < problem.settings.max_change))
      return false;
    const Scalar most = problem.settings.max_change * problem.settings.dt;
    for (Index i = 3 * problem.feature_count; i < outputs_.rows(); ++i) {
      if (most < abs(outputs_(i, 0))) return true;
      for (Index k = 1; k < problem.settings.horizon; ++k) {
        if (most < abs(outputs_(i, k) - outputs_(i, k - 1))) return true;
      }
    }
    return false;
  }

  /// The change of every output in every frame, output rows × K, m.
  const MatrixX<Scalar>& outputs() const { return outputs_; }

 private:
  MatrixX<Scalar> outputs_;
  VectorX<Scalar> column_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
