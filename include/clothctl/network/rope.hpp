#pragma once

// A rope as a chain of springs. It hangs along -z from vertex 0 at the origin. With Young's modulus
// E, cross-section A, second moment of area I and segments of length l = length/segments:
//
//   spring   k  = E A / l       so that all springs in a row have the stiffness E A / length
//   bending  kb = E I / l³      from ½ E I ∫ κ² ds with κ = |x_{i-1} - 2 x_i + x_{i+1}| / l²
//   mass     each segment gives half of its mass to each end
//
// A rope has no triangles, so drag and gravity act on it, but no wind.

#include <array>
#include <string>
#include <utility>

#include "clothctl/network/sheet.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Material and number of segments of a rope. The defaults are a soft cord of half a metre.
template <RealScalar Scalar>
struct RopeSettings {
  /// Length without load, m.
  Scalar length = Scalar(0.5);
  /// Number of springs, at least 1. There is one vertex more.
  int segments = 20;
  /// Mass per length, kg/m.
  Scalar mass_per_length = Scalar(0.04);
  /// Stretching stiffness E A, N.
  Scalar stretch = Scalar(500.0);
  /// Bending stiffness E I, N m².
  Scalar bending = Scalar(2e-5);
  /// Axial damping time β, s: every spring has a damper d = β k.
  Scalar damping_time = Scalar(0.002);

  /// Returns an empty string when all values are in range, else a line that names the first
  /// quantity that is not, and its value.
  std::string validate() const {
    const Scalar zero = Scalar(0);
    const std::array<std::pair<const char*, const Scalar*>, 5> quantities{
        {{"length", &length},
         {"mass_per_length", &mass_per_length},
         {"stretch", &stretch},
         {"bending", &bending},
         {"damping_time", &damping_time}}};
    if (segments < 1) return "rope needs at least 1 segment, got " + std::to_string(segments);
    for (std::size_t i = 0; i < quantities.size(); ++i) {
      const Scalar& value = *quantities[i].second;
      const std::string item = std::string("rope ") + quantities[i].first;
      if (!is_finite(value)) return item + " is not a finite number";
      if (i < 3 && !(zero < value)) return item + " must be positive, got " + number_text(value);
      if (value < zero) return item + " must not be negative, got " + number_text(value);
    }
    return {};
  }
};

/// Makes a rope of segments + 1 vertices; vertex i is at (0, 0, -i l). Springs and stencils are
/// numbered from the top down. Allocates. Complexity: O(segments). Fails when:
/// `settings.validate()` finds a fault.
template <RealScalar Scalar>
Result<SpringNetwork<Scalar>> rope_network(const RopeSettings<Scalar>& settings) {
  if (std::string problem = settings.validate(); !problem.empty()) return Error{problem};
  const int n = settings.segments;
  const Scalar l = settings.length / Scalar(static_cast<double>(n));
  const Scalar half_mass = Scalar(0.5) * settings.mass_per_length * l;

  SpringNetwork<Scalar> network;
  network.rest_positions = Points<Scalar>::Zero(3, n + 1);
  network.mass = VectorX<Scalar>::Zero(n + 1);
  for (int i = 0; i <= n; ++i)
    network.rest_positions(2, i) =
        Scalar(0) - settings.length * Scalar(static_cast<double>(i) / static_cast<double>(n));
  network.springs.reserve(static_cast<std::size_t>(n));
  network.bends.reserve(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) {
    detail::add_spring(network, i, i + 1, Scalar(settings.stretch / l), settings.damping_time);
    network.mass[i] += half_mass;
    network.mass[i + 1] += half_mass;
  }
  for (int i = 1; i < n; ++i)
    detail::add_second_difference(network, i - 1, i, i + 1, Scalar(settings.bending / (l * l * l)));
  if (std::string problem = network.validate(); !problem.empty()) return Error{problem};
  return network;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
