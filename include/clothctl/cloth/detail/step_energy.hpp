#pragma once

// The energy that a Newton step of a mass-spring body minimises over the velocities v at its end,
// up to a constant, and its gradient:
//
//   E(v)  = ½ (v - v0)ᵀM(v - v0) + U(x0 + h v) - h outerᵀ v
//           + ½ h α vᵀM v + ½ h vᵀD v + ½ h vᵀC v
//   ∇E(v) = M (v - v0 + h α v) - h (f(x0 + h v) + outer) + h (D + C) v
//
// U is the energy of springs, stencils and attachments, f their force (detail/attachments.hpp);
// contacts add theirs (detail/contact_springs.hpp).
// outer: forces that are constant over the step (gravity, input, C w); the other symbols are those
// of mass_spring.hpp.

#include <array>
#include <cmath>
#include <cstddef>

#include "clothctl/cloth/detail/mass_spring_workspace.hpp"
#include "clothctl/cloth/detail/spring_forces.hpp"
#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/core/cloth_state.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// `value`: the energy of a step (J). `size`: a bound on its rounding error, divided by ε (J).
template <RealScalar Scalar>
struct StepEnergy {
  Scalar value, size;
};

/// Returns `energy` plus that of the frozen dampers and the air at velocities `v`. Adds their
/// gradient to ws.gradient.
template <RealScalar Scalar>
Scalar add_damping(const SpringNetwork<Scalar>& network, const Points<Scalar>& v, Scalar dt,
                   Scalar energy, MassSpringWorkspace<Scalar>& ws) {
  using Triple = detail::Triple<Scalar>;
  const Scalar half = Scalar(0.5);
  for (std::size_t e = 0; e < network.springs.size(); ++e) {
    const Spring<Scalar>& s = network.springs[e];
    if (!(Scalar(0) < s.damping)) continue;
    const Index k = static_cast<Index>(e);
    const Triple direction = column(ws.direction, k);
    const Scalar rate = dot(direction, column(v, s.a) - column(v, s.b));
    const Triple push = direction * (dt * s.damping * rate);
    energy += half * dt * s.damping * rate * rate;
    add_to_column(ws.gradient, s.a, push);
    subtract_from_column(ws.gradient, s.b, push);
  }
  return add_air_gradient<Scalar>(network, ws.air, v, dt, energy, ws.gradient);
}

/// Returns the energy E of a step of length `dt` (s) that starts at `state` and ends with
/// velocities `v` (3×n, m/s). `drag`: α, 1/s; `total_stiffness`: sum of k over the springs, N/m.
/// Writes ∇E to ws.gradient and x0 + h v to ws.position; reads what is constant over the step from
/// `ws`. On a held vertex the gradient is the impulse that holds it. Never allocates.
template <RealScalar Scalar>
StepEnergy<Scalar> step_energy(const SpringNetwork<Scalar>& network, Scalar drag,
                               Scalar total_stiffness, const ClothState<Scalar>& state,
                               const Points<Scalar>& v, Scalar dt,
                               MassSpringWorkspace<Scalar>& ws) {
  using std::sqrt;
  using Triple = detail::Triple<Scalar>;
  const Scalar h_drag = dt * drag;
  move_along(state.positions, dt, v, ws.position);
  ws.gradient = ws.outer;
  Scalar energy = add_spring_forces<Scalar>(network, ws.position, ws.gradient);
  // The rounding error of a position is ε |x|, that of a spring's energy k |l - l0| ε |x|. The sum
  // over all springs is at most √(2 U Σk) ε |x|.
  Scalar size = sqrt(Scalar(2) * energy * total_stiffness) * largest_magnitude(ws.position);
  if (!ws.attachments.empty()) {
    ws.attachments.add_forces(ws.position, ws.gradient);
    energy += ws.attachments.energy(ws.position, size);
  }
  Scalar work = Scalar(0);
  for (Index i = 0; i < network.vertex_count(); ++i) {
    const Triple vi = column(v, i);
    const Triple dv = vi - column(state.velocities, i);
    const Scalar m = network.mass[i];
    set_column(ws.gradient, i, (dv + vi * h_drag) * m - column(ws.gradient, i) * dt);
    if (ws.is_held(i)) continue;  // its part of the energy is constant
    const Scalar gain = dt * dot(column(ws.outer, i), vi);
    energy += Scalar(0.5) * m * (squared_norm(dv) + h_drag * squared_norm(vi));
    work += gain;
    size += gain < Scalar(0) ? -gain : gain;
  }
  energy = add_damping(network, v, dt, energy, ws);
  if (ws.contacts != nullptr) energy += ws.contacts->add_energy(v, ws.gradient);
  return {energy - work, energy + size};
}

/// Sets ws.rhs to minus the gradient on free vertices and to 0 on held ones, and `largest` to the
/// largest magnitude in ws.rhs (NaN when an entry is NaN). Returns true when every entry of a
/// vertex is, in magnitude, less than `tolerance` (m/s) times the mass of the vertex. Never
/// allocates.
template <RealScalar Scalar>
bool load_residual(const SpringNetwork<Scalar>& network, Scalar tolerance, Scalar& largest,
                   MassSpringWorkspace<Scalar>& ws) {
  bool converged = true;
  largest = Scalar(0);
  for (Index i = 0; i < network.vertex_count(); ++i) {
    if (ws.is_held(i)) {
      set_point(ws.rhs, i, {Scalar(0), Scalar(0), Scalar(0)});
      continue;
    }
    const Triple<Scalar> g = column(ws.gradient, i);
    set_point(ws.rhs, i, {-g.x, -g.y, -g.z});
    Scalar size = Scalar(0);
    for (const Scalar& entry : {g.x, g.y, g.z}) {
      const Scalar magnitude = entry < Scalar(0) ? -entry : entry;
      if (!(magnitude <= size)) size = magnitude;  // keeps a NaN
      if (!is_finite(size)) break;
    }
    if (is_finite(largest) && !(size <= largest)) largest = size;
    if (!(size < tolerance * network.mass[i])) converged = false;
  }
  return converged;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
