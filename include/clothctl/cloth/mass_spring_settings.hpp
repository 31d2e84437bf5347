#pragma once

// Settings of the mass-spring model: which equations a step solves (mass_spring.hpp states them),
// gravity, drag, air and pinned vertices. Factors for predictions.

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How the implicit Euler equations of a step are solved.
enum class Integration {
  /// One linear solve about the start of the step. Fast, but damps more, and cannot buckle within a
  /// step.
  LinearlyImplicit,
  /// Newton's method with a line search, until the residual meets the tolerance.
  Newton
};

/// How a step solves its linear systems.
enum class LinearSolver {
  /// Sparse Cholesky factors. Memory of O(n log n) and time of O(n^1.5) on a sheet of n vertices.
  Factor,
  /// Conjugate gradients, preconditioned by an incomplete factor without fill and a coarse
  /// correction. Memory of O(n); for sheets whose complete factor is too large.
  ConjugateGradient
};

/// Factors on the parts of the stiffness matrix, for predictors. With n the unit vector along a
/// spring of stiffness k, length l and rest length l0, the default factors give the projection of
/// the true stiffness onto the positive semidefinite matrices.
template <RealScalar Scalar>
struct StiffnessScale {
  /// Factor on the axial part k n nᵀ.
  Scalar axial = Scalar(1);
  /// Factor on the tension (geometric) part k max(0, 1 - l0/l) (I - n nᵀ).
  Scalar geometric = Scalar(1);
  /// Factor on the bending part.
  Scalar bending = Scalar(1);
  /// Factor γ on the compression part k min(0, 1 - l0/l) (I - n nᵀ). 1 is exact, but any value
  /// other than 0 may make the matrix indefinite.
  Scalar compression = Scalar(0);
};

/// Factors on the parameters of a network, for a coarse sheet that stands for a finer one. The
/// defaults change nothing.
struct CoarseFactors {
  /// Stiffness of springs other than diagonals of cells.
  double stretch = 1;
  /// Stiffness of the diagonals of cells.
  double shear = 1;
  /// What is left of the former where such a spring is shorter than at rest.
  double compressed_stretch = 1;
  /// What is left of the latter where a diagonal is shorter than at rest.
  double compressed_shear = 1;
  /// Stiffness of bending.
  double bending = 1;
  /// Mass-proportional drag.
  double drag = 1;

  /// Returns the factors that made a grid of 17×17 vertices predict the motion of one of 33×33 best
  /// (docs/planner.md, section 1.5).
  static CoarseFactors fitted() { return {0.84, 1.3, 0.4, 0.05, 0.65, 0.84}; }

  /// Returns an empty string, or a line that names the first bad factor and its value.
  std::string validate() const {
    const std::array<std::pair<const char*, double>, 6> factors{
        {{"stretch", stretch},
         {"shear", shear},
         {"compressed_stretch", compressed_stretch},
         {"compressed_shear", compressed_shear},
         {"bending", bending},
         {"drag", drag}}};
    for (const auto& [name, value] : factors) {
      if (!is_finite(value) || value < 0)
        return std::string(name) + " is " + number_text(value) +
               ", must be finite and not negative";
    }
    return {};
  }
};

/// Settings of a MassSpring model. The defaults are gravity, no drag and one linear solve.
template <RealScalar Scalar>
struct MassSpringSettings {
  /// Which equations a step solves.
  Integration integration = Integration::LinearlyImplicit;
  /// Acceleration of gravity g, m/s².
  Vector3<Scalar> gravity = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-9.81));
  /// Mass-proportional drag α, 1/s.
  Scalar drag = Scalar(0);
  /// Air on the triangles of the network. Zero coefficients, the default, mean no air.
  AirSettings<Scalar> air = {};
  /// Newton stops when the momentum residual of every vertex, divided by its mass, is below this
  /// tolerance, m/s. It also stops when a full step was shorter than this and did not halve the
  /// residual, since what remains is rounding. 0 means 2 ∛ε, with ε the spacing of the scalar at
  /// one (1.2e-5 in double).
  Scalar velocity_tolerance = Scalar(0);
  /// Largest number of Newton steps in a time step. When it is reached, the time step ends with the
  /// status IterationLimit.
  int max_iterations = 100;
  /// With true, `step` creates no energy (see docs/mass_spring.md): a single linear solve that
  /// would is followed by Newton steps, and what is left is taken out of the kinetic energy of the
  /// free vertices. Where that is less, they stop, and the rest stays: springs that hands or
  /// attachments compress may take up more than the hands are credited with. `step_from` is not
  /// limited. With false, a step with LinearlyImplicit is one linear solve, which is what
  /// MassSpringResponse predicts.
  bool limit_energy = true;
  /// How the linear systems of a step are solved.
  LinearSolver linear_solver = LinearSolver::Factor;
  /// Largest number of iterations of conjugate gradients in the single linear solve. They end when
  /// the residual of every vertex, divided by its mass, is below `velocity_tolerance`. When the
  /// limit is reached, the step ends with the status IterationLimit.
  int max_linear_iterations = 2000;
  /// Vertices that never move unless the input drives them.
  std::vector<int> pinned = {};

  /// Returns the defaults with the drag of a material. With `wind` set, the air has the material's
  /// coefficients and a density of 1.2 kg/m³.
  static MassSpringSettings of(const Material<Scalar>& material, bool wind = false) {
    MassSpringSettings s;
    s.drag = material.drag;
    if (wind) s.air = {Scalar(1.2), material.air_normal, material.air_tangent};
    return s;
  }

  /// Returns an empty string when all settings are good, else a line that names the first bad one.
  std::string validate() const {
    const std::string sign = "is negative or not finite";
    for (Index c = 0; c < 3; ++c) {
      if (!is_finite(gravity[c]))
        return bad_number_line(std::string("gravity ") + "xyz"[c], "is not finite", gravity[c]);
    }
    if (!is_finite(drag) || drag < Scalar(0)) return bad_number_line("drag", sign, drag);
    if (!is_finite(velocity_tolerance) || velocity_tolerance < Scalar(0))
      return bad_number_line("velocity_tolerance", sign, velocity_tolerance);
    if (max_iterations < 1)
      return "max_iterations is " + std::to_string(max_iterations) + ", must be at least 1";
    if (max_linear_iterations < 1) {
      return "max_linear_iterations is " + std::to_string(max_linear_iterations) +
             ", must be at least 1";
    }
    return air.validate();
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI
