#pragma once

// Slow motion under a limit of stretch. A substep h lets every vertex fall by g h²; sweeps and
// levels lift it again, but not all vertices alike. So a sheet at rest has velocities of the order
// g h that sum to no displacement over a step. Two measures let it rest:
//
// - The two sets of levels take turns only while the sheet moves: where they disagree, an irregular
//   sheet at rest would follow one and the other for ever. It moves if the root mean square of the
//   speeds at the start of a step, weighted by the masses, is above g dt/2.
// - A vertex that a step has moved slowly, |u - u_h| < κ g h, is no faster than that:
//
//     v ← u_h + min(1, |u - u_h|/|v - u_h|) (v - u_h),      u = (x - x_0)/dt
//
// x_0 and x position at the start and at the end of the step dt, u_h mean velocity of the held
// vertices over the step, κ = 0.2. Kinetic energy relative to u_h only falls. From rest u is half
// of v, so a slow vertex takes up speed at half its acceleration; it never sticks. A body that
// nothing holds is left alone, so it keeps its momentum.

#include <cmath>
#include <cstddef>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What motion in a step is measured against.
template <RealScalar Scalar>
struct SlowMotion {
  /// Mean velocity of the held vertices over the step, m/s; zero where nothing is held.
  Vector3<Scalar> held = Vector3<Scalar>::Zero();
  /// Step, s.
  Scalar dt = Scalar(0);
  /// g dt/2, the mean speed of a fall from rest in a step, and κ g h, m/s.
  Scalar fall = Scalar(0), slow = Scalar(0);
};

/// Returns the measure of a step of `dt` in substeps of `h` (s), at the `gravity` (m/s²).
/// `held_count`: of all held vertices; of these the driven ones of `input` move, and others by a
/// displacement with the sum `carried`, m.
template <RealScalar Scalar>
SlowMotion<Scalar> slow_motion(const ClothState<Scalar>& state, const ClothInput<Scalar>& input,
                               std::size_t held_count, const Vector3<Scalar>& carried,
                               const Vector3<Scalar>& gravity, const Scalar& h, const Scalar& dt) {
  using std::sqrt;
  SlowMotion<Scalar> slow;
  slow.held = carried;
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
    slow.held += input.driven_positions.col(static_cast<Index>(i)) -
                 state.positions.col(input.driven_vertices[i]);
  }
  if (held_count > 0) slow.held /= dt * Scalar(static_cast<double>(held_count));
  slow.dt = dt;
  const Scalar g = sqrt(gravity.squaredNorm());
  slow.fall = Scalar(0.5) * g * dt;
  slow.slow = Scalar(0.2) * g * h;
  return slow;
}

/// Returns whether a held sheet moves at the start of a step, as stated above. `inverse_mass`: 0
/// for held vertices, 1/kg.
template <RealScalar Scalar>
bool moves(const SlowMotion<Scalar>& slow, const ClothState<Scalar>& state,
           const VectorX<Scalar>& inverse_mass) {
  Scalar square = Scalar(0), mass = Scalar(0);
  for (Index v = 0; v < inverse_mass.size(); ++v) {
    if (!(Scalar(0) < inverse_mass[v])) continue;
    const Vector3<Scalar> relative = state.velocities.col(v) - slow.held;
    square = square + relative.squaredNorm() / inverse_mass[v];
    mass = mass + Scalar(1) / inverse_mass[v];
  }
  return slow.fall * slow.fall * mass < square;
}

/// Takes velocity that the motion does not show from the `velocities` (3×n, m/s) of a held sheet
/// that a step has moved from `before` to `after` (3×n, m), as stated above.
template <RealScalar Scalar>
void calm_slow_vertices(const SlowMotion<Scalar>& slow, const Points<Scalar>& before,
                        const Points<Scalar>& after, Points<Scalar>& velocities) {
  using std::sqrt;
  const Scalar bound = slow.slow * slow.slow;
  for (Index v = 0; v < velocities.cols(); ++v) {
    const Vector3<Scalar> mean = (after.col(v) - before.col(v)) / slow.dt,
                          relative = velocities.col(v) - slow.held;
    const Scalar seen = (mean - slow.held).squaredNorm(), told = relative.squaredNorm();
    if (seen < bound && seen < told) velocities.col(v) = slow.held + sqrt(seen / told) * relative;
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
