#pragma once

// Settings of the position-based sheet. position_based.hpp describes the schemes and the symbols.

#include <cstddef>
#include <string>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Which position-based scheme advances the sheet.
enum class PositionScheme {
  /// Verlet integration, then sweeps over rigid distance constraints ([Toh 2011], ch. 2.3). The
  /// number of sweeps sets the stiffness of the sheet; the stiffness of its springs has no effect.
  Verlet,
  /// Substeps with compliant constraints. The sheet has the stiffness and damping of the network as
  /// far as the sweeps converge.
  Xpbd
};

/// Settings of `PositionBased`. The defaults are XPBD with 20 substeps of 2 sweeps.
template <RealScalar Scalar>
struct PositionBasedSettings {
  /// The scheme.
  PositionScheme scheme = PositionScheme::Xpbd;
  /// Number of equal parts that a step is divided into, at least 1.
  int substeps = 20;
  /// Number of sweeps over all constraints in a substep, at least 1. XPBD sweeps without
  /// a limit alternate in direction: with one, a stiff sheet may not come to rest.
  int iterations = 2;
  /// Acceleration of gravity g, m/s².
  Vector3<Scalar> gravity = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-9.81));
  /// Mass-proportional drag α, 1/s: a substep h divides the velocity by 1 + h α.
  Scalar drag = Scalar(0);
  /// XPBD only: largest stretch of a structural or shear spring, its length over its rest length
  /// minus 1; 0 means no limit. The scalar must convert to double. At the end of a step hardly an
  /// edge exceeds it: the report says by how much. Without a limit the sheet is as soft as the
  /// sweeps leave it. With one, a substep does `iterations` sweeps in which dampers do not act.
  Scalar stretch_limit = Scalar(0);
  /// With a limit: the compression (1 minus length over rest length) that an edge does not resist,
  /// 0 to less than 1. Fabric cannot be pushed, and sweeps that push fight with the limit: with 0 a
  /// sheet at rest keeps trembling.
  Scalar free_compression = Scalar(0.1);
  /// With a limit: the share of a compression beyond the free one that a sweep removes, 0 to 1.
  Scalar compression = Scalar(0.1);
  /// With a limit: the most sweeps that the last substep adds until the limit is kept, at least 0.
  int extra_sweeps = 60;
  /// Verlet only: the fraction d of the velocity that a substep removes, 0 to 1.
  Scalar verlet_damping = Scalar(0.01);
  /// Verlet only: the fraction r of a spring's length error that one projection removes, 0 to 1,
  /// one number for each spring. Empty means 1 for all.
  std::vector<Scalar> spring_relaxation;
  /// Verlet only: the fraction r of a bending stencil's error that one projection removes, 0 to 1.
  Scalar bend_relaxation = Scalar(0.2);
  /// Air on the triangles of the network. Zero coefficients, the default, mean no air.
  AirSettings<Scalar> air;
  /// Vertices that never move unless the input drives them.
  std::vector<int> pinned;

  /// Returns the Verlet scheme of [Toh 2011]: one substep, 15 sweeps, d = 0.01.
  static PositionBasedSettings verlet() {
    PositionBasedSettings settings;
    settings.scheme = PositionScheme::Verlet;
    settings.substeps = 1;
    settings.iterations = 15;
    return settings;
  }

  /// Returns the defaults with the drag of a material. With `wind` set, the air has the material's
  /// coefficients and a density of 1.2 kg/m³.
  static PositionBasedSettings of(const Material<Scalar>& material, bool wind = false) {
    PositionBasedSettings s;
    s.drag = material.drag;
    if (wind) s.air = {Scalar(1.2), material.air_normal, material.air_tangent};
    return s;
  }

  /// Returns an empty string when all settings are good for the network, else a line that names the
  /// first bad one.
  std::string validate(const SpringNetwork<Scalar>& network) const {
    const std::size_t spring_count = network.springs.size();
    const auto negative = [](const Scalar& value) {
      return !is_finite(value) || value < Scalar(0);
    };
    const auto no_part = [&](const Scalar& value) { return negative(value) || Scalar(1) < value; };
    if (substeps < 1 || substeps > 1000000)
      return "substeps is " + std::to_string(substeps) + ", must be 1 to 1000000";
    if (iterations < 1)
      return "iterations is " + std::to_string(iterations) + ", must be at least 1";
    const std::string sign = "is negative or not finite", part = "is outside 0 to 1";
    for (Index c = 0; c < 3; ++c) {
      if (!is_finite(gravity[c]))
        return bad_number_line(std::string("gravity ") + "xyz"[c], "is not finite", gravity[c]);
    }
    if (negative(drag)) return bad_number_line("drag", sign, drag);
    if (negative(stretch_limit)) return bad_number_line("stretch limit", sign, stretch_limit);
    if (scheme == PositionScheme::Verlet && Scalar(0) < stretch_limit)
      return "stretch limit needs the scheme Xpbd";
    if (!requires(const Scalar& s) { static_cast<double>(s); } && Scalar(0) < stretch_limit)
      return "stretch limit needs a scalar that converts to double";
    if (no_part(compression)) return bad_number_line("compression", part, compression);
    if (negative(free_compression) || !(free_compression < Scalar(1)))
      return bad_number_line("free compression", "is not from 0 to less than 1", free_compression);
    if (extra_sweeps < 0)
      return "extra_sweeps is " + std::to_string(extra_sweeps) + ", must be at least 0";
    if (no_part(verlet_damping)) return bad_number_line("verlet damping", part, verlet_damping);
    if (no_part(bend_relaxation)) return bad_number_line("bend relaxation", part, bend_relaxation);
    if (!spring_relaxation.empty() && spring_relaxation.size() != spring_count) {
      return std::to_string(spring_relaxation.size()) + " spring relaxations for " +
             std::to_string(spring_count) + " springs";
    }
    for (std::size_t e = 0; e < spring_relaxation.size(); ++e) {
      if (no_part(spring_relaxation[e]))
        return bad_number_line("relaxation of spring " + std::to_string(e), part,
                               spring_relaxation[e]);
    }
    for (int v : pinned) {
      if (v < 0 || v >= network.vertex_count())
        return "pinned vertex " + std::to_string(v) + " is off the mesh of " +
               std::to_string(network.vertex_count()) + " vertices";
    }
    return air.validate();
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI
