#pragma once

// What inverse kinematics is told, and what it answers.

#include <cmath>
#include <string_view>

#include "clothctl/core/types.hpp"

namespace clothctl::robot {

/// Tolerances and budget of inverse kinematics.
template <RealScalar Scalar>
struct IkSettings {
  /// Largest weighted residual of a task that counts as reached (m).
  Scalar tolerance = Scalar(1e-4);
  /// Largest entry of the projected gradient, relative to its terms, that counts as a minimum: 1e-6, or what rounding allows.
  Scalar gradient_tolerance = default_gradient_tolerance();
  /// Weight w of the posture (m²/rad², beside residuals in m): 0 leaves it to the damping.
  Scalar posture_weight = Scalar(0);
  /// First damping μ.
  Scalar damping = Scalar(1e-3);
  /// Steps that may be tried in each attempt.
  int max_iterations = 100;
  /// Whether targets that were not reached are tried again in other ways from the same start. Targets out of reach then take
  /// several times as long.
  bool fallbacks = true;

  /// 1e-6, or four roots of the scalar's spacing.
  static Scalar default_gradient_tolerance() {
    using std::sqrt;
    const Scalar rounding = Scalar(4) * sqrt(scalar_traits<Scalar>::epsilon());
    const Scalar wished = Scalar(1e-6);
    return wished < rounding ? rounding : wished;
  }
  /// Names what is wrong, or "".
  std::string_view check() const {
    const auto positive = [](const Scalar& v) { return is_finite(v) && v > Scalar(0); };
    if (!positive(tolerance)) return "tolerance is not a positive length";
    if (!positive(gradient_tolerance)) return "gradient_tolerance is not a positive number";
    if (!is_finite(posture_weight) || posture_weight < Scalar(0)) return "posture_weight is negative or not finite";
    if (!positive(damping)) return "damping is not a positive number";
    if (max_iterations < 1) return "max_iterations is less than 1";
    return {};
  }
};

/// Why inverse kinematics stopped.
enum class IkStatus {
  /// Every task is within the tolerance. Use q.
  Reached,
  /// q is a local minimum: the projected gradient is zero. Out of reach, or start elsewhere.
  LocalMinimum,
  /// No step helps although the gradient is not zero: rounding, or levels that stand in each other's way. Use q if `error` will
  /// do, else start elsewhere.
  Stalled,
  /// The steps ran out; q is the best met. Allow more, or start elsewhere.
  IterationLimit,
  /// A start, target, reference or setting is not finite or of a wrong size; q was left as it was. Mend the input.
  InvalidInput
};

/// Names a status.
constexpr std::string_view to_string(IkStatus status) {
  switch (status) {
    case IkStatus::Reached: return "reached";
    case IkStatus::LocalMinimum: return "local_minimum";
    case IkStatus::Stalled: return "stalled";
    case IkStatus::IterationLimit: return "iteration_limit";
    case IkStatus::InvalidInput: return "invalid_input";
  }
  return "unknown";
}

/// What inverse kinematics answers.
template <RealScalar Scalar>
struct IkReport {
  /// Why it stopped.
  IkStatus status = IkStatus::IterationLimit;
  /// Largest weighted residual of a task (m).
  Scalar error = scalar_traits<Scalar>::infinity();
  /// What was minimised: half the squares of the residuals, and the posture's share (m²).
  Scalar cost = scalar_traits<Scalar>::infinity();
  /// Largest entry of the projected gradient over its terms.
  Scalar gradient = scalar_traits<Scalar>::infinity();
  /// Steps tried, of all attempts and starts.
  int iterations = 0;
  /// Starts used.
  int starts = 1;
  /// With InvalidInput: what was refused (static text); else empty.
  std::string_view message;
};

}  // namespace clothctl::robot
