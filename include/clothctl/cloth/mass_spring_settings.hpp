#pragma once

// What a MassSpring model is told once: which equations a step solves (mass_spring.hpp has them), and what acts from outside.

#include <string>
#include <vector>

#include "clothctl/cloth/air.hpp"
#include "clothctl/cloth/materials.hpp"

namespace clothctl {

/// How the implicit Euler equations of a step are solved.
enum class Integration {
  /// One linear solve about the start of the step: fast, damps more, does not buckle within a step.
  OneSolve,
  /// Newton's method with line search until the residual meets the tolerance.
  Newton
};

/// Settings of a MassSpring model. Defaults: gravity, no drag, one linear solve.
template <RealScalar Scalar>
struct MassSpringSettings {
  /// Which equations a step solves.
  Integration integration = Integration::OneSolve;
  /// Gravity, m/s².
  Vector3<Scalar> gravity = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-9.81));
  /// Mass-proportional drag α, 1/s.
  Scalar drag = Scalar(0);
  /// Air on the network's triangles; zero coefficients mean none.
  AirSettings<Scalar> air = {};
  /// Newton stops when the largest momentum residual of a vertex, divided by its mass, is below this, m/s, or when its steps
  /// are shorter than this and the residual, being rounding, shrinks no more; 0 means 2 ∛ε (1.2e-5 in double).
  Scalar velocity_tolerance = Scalar(0);
  /// Most Newton steps of a step; when they are used up the step advances with the status IterationLimit.
  int max_iterations = 100;
  /// Vertices that never move unless they are driven.
  std::vector<int> pinned = {};

  /// The defaults with the drag of a material and, where there is `wind`, its air coefficients in air of 1.2 kg/m³.
  static MassSpringSettings of(const Material<Scalar>& material, bool wind = false) {
    MassSpringSettings s;
    s.drag = material.drag;
    if (wind) s.air = {Scalar(1.2), material.air_normal, material.air_tangent};
    return s;
  }

  /// Returns an empty string, or a line that names the first bad setting.
  std::string check() const {
    if (!all_finite(gravity)) return "gravity is not finite";
    if (!is_finite(drag) || drag < Scalar(0)) return "drag is negative or not finite";
    if (!is_finite(velocity_tolerance) || velocity_tolerance < Scalar(0)) return "velocity_tolerance is negative or not finite";
    if (max_iterations < 1) return "max_iterations is " + std::to_string(max_iterations) + ", must be at least 1";
    return air.check();
  }
};

}  // namespace clothctl
