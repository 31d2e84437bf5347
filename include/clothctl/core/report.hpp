#pragma once

// What a step answers: a code, whether the state moved, and how well the equations were met.

#include "clothctl/core/scalar.hpp"
#include "clothctl/core/status.hpp"

namespace clothctl {

/// The outcome of one simulation step.
template <RealScalar Scalar>
struct StepReport {
  /// How the step ended.
  StepStatus status = StepStatus::Converged;
  /// True when the state now stands at the end of the step; false when it was left as it was.
  bool advanced = false;
  /// Largest entry of the momentum residual at the end of the step (N s); 0 for methods that have none.
  Scalar residual = Scalar(0);
  /// Linear solves (implicit models) or constraint sweeps (position-based) that were used.
  int iterations = 0;
};

}  // namespace clothctl
