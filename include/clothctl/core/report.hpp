#pragma once

// What a step returns: its status, whether the state changed, and the remaining error of the
// equations.

#include "clothctl/core/scalar.hpp"
#include "clothctl/core/status.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The outcome of one simulation step.
template <RealScalar Scalar>
struct StepReport {
  /// How the step ended.
  StepStatus status = StepStatus::Converged;
  /// True when the state was advanced to the end of the step; false when it is unchanged.
  bool advanced = false;
  /// Implicit models: largest entry of the momentum residual at the end of the step, N s, 0 after a
  /// solve by a factor. Position-based models: with a limit of stretch, the largest stretch l/l0 -
  /// 1 that the last sweep met, else 0.
  Scalar residual = Scalar(0);
  /// Number of linear solves (implicit models) or of constraint sweeps (position-based models).
  int iterations = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
