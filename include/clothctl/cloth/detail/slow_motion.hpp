#pragma once

// Slow motion under a limit of stretch. A substep h lets every vertex fall by g h²; sweeps and
// levels lift it again, but not all vertices alike. So a sheet at rest has velocities of the order
// g h that sum to no displacement over a step. Two measures let it rest:
//
// - The two sets of levels take turns only while the sheet moves: where they disagree, a sheet at
//   rest would follow one and the other for ever.
// - A vertex that a step has moved by less than κ g h dt loses part of its velocity:
//
//     v ← v_h + min(1, |x - x_0 - d|² / (κ g h dt)²) (v - v_h),      v_h = d/dt
//
// d mean displacement of the held vertices over the step, x_0 and x position at the start and at
// the end, κ = 0.2. Kinetic energy relative to the hands only falls. A body that nothing holds
// keeps its velocities, and so its momentum.

#include <cmath>
#include <cstddef>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What motion in a step is measured against.
template <RealScalar Scalar>
struct SlowMotion {
  /// Mean displacement of the held vertices over the step, m; zero where nothing is held.
  Vector3<Scalar> held = Vector3<Scalar>::Zero();
  /// Step, s.
  Scalar dt = Scalar(0);
  /// g h dt: the way in a step at the speed that gravity gives in a substep, m.
  Scalar way = Scalar(0);
};

/// Returns the measure of a step of `dt` in substeps of `h` (s), at the `gravity` (m/s²).
/// `held_count`: of driven and pinned vertices; only the driven ones of `input` move.
template <RealScalar Scalar>
SlowMotion<Scalar> slow_motion(const ClothState<Scalar>& state, const ClothInput<Scalar>& input,
                               std::size_t held_count, const Vector3<Scalar>& gravity,
                               const Scalar& h, const Scalar& dt) {
  using std::sqrt;
  SlowMotion<Scalar> slow;
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
    slow.held += input.driven_positions.col(static_cast<Index>(i)) -
                 state.positions.col(input.driven_vertices[i]);
  }
  if (held_count > 0) slow.held *= Scalar(1) / Scalar(static_cast<double>(held_count));
  slow.dt = dt;
  slow.way = sqrt(gravity.squaredNorm()) * h * dt;
  return slow;
}

/// Returns whether the root mean square of the speeds at the start of a step, weighted by the
/// masses, is above 3 g h. `inverse_mass`: 0 for held vertices, 1/kg.
template <RealScalar Scalar>
bool moves(const SlowMotion<Scalar>& slow, const ClothState<Scalar>& state,
           const VectorX<Scalar>& inverse_mass) {
  Scalar square = Scalar(0), mass = Scalar(0);
  for (Index v = 0; v < inverse_mass.size(); ++v) {
    if (!(Scalar(0) < inverse_mass[v])) continue;
    const Vector3<Scalar> way = slow.dt * state.velocities.col(v) - slow.held;
    square = square + way.squaredNorm() / inverse_mass[v];
    mass = mass + Scalar(1) / inverse_mass[v];
  }
  return Scalar(9) * slow.way * slow.way * mass < square;
}

/// Damps the `velocities` (3×n, m/s) of a held sheet that a step has moved from `before` to `after`
/// (3×n, m), as stated above.
template <RealScalar Scalar>
void damp_slow_vertices(const SlowMotion<Scalar>& slow, const Points<Scalar>& before,
                        const Points<Scalar>& after, Points<Scalar>& velocities) {
  const Scalar bound = Scalar(0.2) * slow.way;
  const Vector3<Scalar> held = slow.held / slow.dt;
  for (Index v = 0; v < velocities.cols(); ++v) {
    const Vector3<Scalar> way = after.col(v) - before.col(v) - slow.held;
    const Scalar square = way.squaredNorm();
    if (!(square < bound * bound)) continue;
    const Scalar share = square / (bound * bound);
    velocities.col(v) = held + share * (velocities.col(v) - held);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
