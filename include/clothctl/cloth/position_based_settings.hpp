#pragma once

// Settings of the position-based sheet; the schemes themselves are described in position_based.hpp.

#include <cstddef>
#include <string>
#include <vector>

#include "clothctl/cloth/air.hpp"
#include "clothctl/cloth/materials.hpp"
#include "clothctl/cloth/spring_network.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl {

/// Which position-based scheme advances the sheet.
enum class PositionScheme {
  /// Verlet integration, then sweeps of rigid distance constraints (paper 004, ch. 2.3). Stiffness comes from the number of
  /// sweeps, not from the network.
  Verlet,
  /// Substeps with compliant constraints: the network's stiffness and damping are honoured as far as the sweeps converge.
  Xpbd
};

/// Settings of `PositionBased`. The defaults are 20 substeps of 2 sweeps of XPBD.
template <RealScalar Scalar>
struct PositionBasedSettings {
  /// The scheme.
  PositionScheme scheme = PositionScheme::Xpbd;
  /// Equal parts that a step is cut into, at least 1.
  int substeps = 20;
  /// Sweeps over all constraints in a substep, at least 1.
  int iterations = 2;
  /// Acceleration of free fall, m/s².
  Vector3<Scalar> gravity = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-9.81));
  /// Mass-proportional drag α, 1/s: the velocity is divided by 1 + h α in a substep of h.
  Scalar drag = Scalar(0);
  /// Verlet only: part d of the velocity that is lost in a substep, 0 to 1.
  Scalar verlet_damping = Scalar(0.01);
  /// Verlet only: part of a spring's error that one projection removes, 0 to 1, one for each spring; empty means all 1.
  std::vector<Scalar> spring_relaxation;
  /// Verlet only: part of a bending stencil's error that one projection removes, 0 to 1.
  Scalar bend_relaxation = Scalar(0.2);
  /// The air.
  AirSettings<Scalar> air;
  /// Vertices that never move unless they are driven.
  std::vector<int> pinned;

  /// The Verlet scheme as in paper 004: one substep, 15 sweeps, d = 0.01.
  static PositionBasedSettings verlet() {
    PositionBasedSettings settings;
    settings.scheme = PositionScheme::Verlet;
    settings.substeps = 1;
    settings.iterations = 15;
    return settings;
  }

  /// The defaults with the drag of a material and, where there is `wind`, its air coefficients in air of 1.2 kg/m³.
  static PositionBasedSettings of(const Material<Scalar>& material, bool wind = false) {
    PositionBasedSettings s;
    s.drag = material.drag;
    if (wind) s.air = {Scalar(1.2), material.air_normal, material.air_tangent};
    return s;
  }

  /// Checks the values for a network. Returns an empty string, or a line that names the first bad one.
  std::string check(const SpringNetwork<Scalar>& network) const {
    const std::size_t spring_count = network.springs.size();
    const auto negative = [](const Scalar& value) { return !is_finite(value) || value < Scalar(0); };
    const auto no_part = [&](const Scalar& value) { return negative(value) || Scalar(1) < value; };
    if (substeps < 1) return "substeps is " + std::to_string(substeps) + ", must be at least 1";
    if (iterations < 1) return "iterations is " + std::to_string(iterations) + ", must be at least 1";
    if (!all_finite(gravity)) return "gravity is not finite";
    if (negative(drag)) return "drag is negative or not finite";
    if (no_part(verlet_damping)) return "verlet damping is outside 0 to 1";
    if (no_part(bend_relaxation)) return "bend relaxation is outside 0 to 1";
    if (!spring_relaxation.empty() && spring_relaxation.size() != spring_count) {
      return std::to_string(spring_relaxation.size()) + " spring relaxations for " + std::to_string(spring_count) + " springs";
    }
    for (std::size_t e = 0; e < spring_relaxation.size(); ++e) {
      if (no_part(spring_relaxation[e])) return "relaxation of spring " + std::to_string(e) + " is outside 0 to 1";
    }
    for (int v : pinned) {
      if (v < 0 || v >= network.vertex_count()) return "pinned vertex " + std::to_string(v) + " is off the mesh";
    }
    return air.check();
  }
};

}  // namespace clothctl
