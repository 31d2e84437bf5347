#pragma once

// Plastic creep: a spring of length l that is strained beyond its yield strain y keeps a part of
// its length. Its rest length l0 moves towards the length at which the strain would be y,
//
//   l0' = r (l* - l0),   l* = l/(1 + y) where l > (1 + y) l0,   l* = l/(1 - y) where l < (1 - y)
//   l0,
//
// with the rate r, while |l0/L - 1| is below a limit; L is the distance of the ends in the rest
// positions. Over a step dt with constant l the exact solution is l0 + (1 - e^(-r dt)) (l* - l0).

#include <cmath>
#include <string>

#include "clothctl/core/number_text.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How springs creep. The default rate is 0: none does.
template <RealScalar Scalar>
struct CreepSettings {
  /// Strain up to which a spring is elastic, from 0 to below 1.
  Scalar yield_strain = Scalar(0.05);
  /// Rate r, 1/s.
  Scalar rate = Scalar(0);
  /// Largest change of the rest length relative to the rest positions.
  Scalar limit = Scalar(0.5);

  /// Returns an empty string when all values are good, else a line that names the first bad one.
  std::string validate() const {
    const auto bad = [](const Scalar& value) { return !is_finite(value) || value < Scalar(0); };
    if (bad(yield_strain) || !(yield_strain < Scalar(1)))
      return "yield strain must be at least 0 and below 1, got " + number_text(yield_strain);
    if (bad(rate)) return "creep rate must not be negative, got " + number_text(rate);
    if (bad(limit) || !(limit < Scalar(1)))
      return "creep limit must be at least 0 and below 1, got " + number_text(limit);
    return {};
  }
};

/// Lets the rest lengths of a network creep for `dt` (s) at vertex positions `x` (3×n, m). Seams do
/// not creep. Returns the largest relative change of a rest length; -1, and changes nothing, when a
/// setting or `dt` is out of range, or `x` has the wrong size or is not finite. A model has a copy
/// of its network: make a new one for the changes to take effect. Never allocates. Complexity:
/// O(springs).
template <RealScalar Scalar>
Scalar creep_rest_lengths(SpringNetwork<Scalar>& network, const Points<Scalar>& x,
                          const CreepSettings<Scalar>& settings, const Scalar& dt) {
  using std::exp;
  using std::sqrt;
  const Scalar one = Scalar(1);
  if (!is_finite(dt) || dt < Scalar(0) || !settings.validate().empty() ||
      x.cols() != network.vertex_count() || !all_finite(x))
    return Scalar(-1);
  const Scalar part = one - exp(Scalar(0) - settings.rate * dt);
  Scalar largest = Scalar(0);
  for (Spring<Scalar>& spring : network.springs) {
    if (spring.kind == SpringKind::Seam) continue;
    const Scalar length = sqrt((x.col(spring.b) - x.col(spring.a)).squaredNorm());
    const Scalar now = spring.rest_length, high = length / (one + settings.yield_strain),
                 low = length / (one - settings.yield_strain);
    Scalar next = now;
    if (now < high) next = now + part * (high - now);
    if (low < now) next = now + part * (low - now);
    const Scalar rest =
        sqrt((network.rest_positions.col(spring.b) - network.rest_positions.col(spring.a))
                 .squaredNorm());
    const Scalar most = (one + settings.limit) * rest, least = (one - settings.limit) * rest;
    if (most < next) next = most < now ? now : most;
    if (next < least) next = now < least ? now : least;
    const Scalar change = next < now ? (now - next) / now : (next - now) / now;
    if (largest < change) largest = change;
    spring.rest_length = next;
  }
  return largest;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
