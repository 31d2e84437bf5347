#pragma once

// The energy that a step of a mass-spring body creates: what kinetic and elastic energy gain beyond
// the work of gravity, input forces, wind and hands.
//
//   ΔE = ½ vᵀM v - ½ v0ᵀM v0 + U(x1) - U(x0) - outerᵀ Δx - W,     Δx = x1 - x0
//   W  = Σ_held pᵀ Δx,     p = M (v - v0)/h + α M v + (D + C) v - outer - f    force of a hand
//
// The spring forces f on a held vertex change during the step. W is the larger one of two values:
// with the forces at the end of the step, f(x1), and with mean forces f̄ that do the work U(x0) -
// U(x1) exactly,
//
//   f̄_a = -½ k (1 - 2 r/(l0 + l1)) (d0 + d1) = -f̄_b         of a spring, d = x_a - x_b, l = |d|
//   f̄_i = -½ kb w_i Σ_j w_j (x0_j + x1_j)                    of a stencil
//   f̄_i = -½ kb J̄_iᵀ (e0 + e1)                               of a folded hinge (folded_hinge.hpp)
//
// l0 and l1 are the lengths of a spring before and after the step, r is its rest length. Neither
// value alone is a bound that a solver can keep. Hands that push a spring together give it more
// energy than the forces at the end account for; and the springs of a crumpled stiff sheet relax
// within a small part of a step, so that the mean forces never act. Elements whose vertices are
// all held have the mean forces in both values. Attachments are not in U; they do the work F·Δx
// with their forces F at the end of the step (attachments.hpp), and so do contacts.
//
// Everything is computed in double where the model computes in float: there rounding errors may be
// as large as ΔE. Other symbols: step_energy.hpp. Reference: Gonzalez, Time integration and
// discrete Hamiltonian systems, J. Nonlinear Sci. 6 (1996).

#include <array>
#include <cmath>
#include <cstddef>
#include <type_traits>

#include "clothctl/cloth/detail/folded_hinge.hpp"
#include "clothctl/cloth/detail/mass_spring_workspace.hpp"
#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/core/cloth_state.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The scalar of sums over energies: double for float, else the scalar itself.
template <RealScalar Scalar>
using WideScalar = std::conditional_t<std::is_same_v<Scalar, float>, double, Scalar>;

/// The energy balance of a step, J.
template <RealScalar Scalar>
struct EnergyBalance {
  using Wide = WideScalar<Scalar>;
  /// ΔE.
  Wide created = Wide(0);
  /// Kinetic energy of the free vertices after the step.
  Wide kinetic = Wide(0);
  /// Sum of the magnitudes that were added up to ΔE.
  Wide size = Wide(0);
  /// Sum of the squares of all forces at the end of the step, counted once for a spring, N²: times
  /// the square of the rounding error of a position, the square of what rounding to Scalar adds to
  /// ΔE.
  Wide tension = Wide(0);

  /// Adds a part of ΔE.
  void add(const Wide& part) {
    created += part;
    size += part < Wide(0) ? -part : part;
  }
};

/// Computes ΔE of the step from `state` to the positions ws.position with the velocities
/// ws.velocity; ws.held, outer, direction, air and dt are those of the step.
template <RealScalar S>
class EnergyBalancer {
 public:
  /// The scalar type.
  using Scalar = S;

  EnergyBalancer(const SpringNetwork<Scalar>& network, const Scalar& drag,
                 const ClothState<Scalar>& state, const MassSpringWorkspace<Scalar>& ws)
      : network_(network), state_(state), ws_(ws), dt_(wide(ws.dt)), drag_(wide(drag)) {}

  /// Returns the balance. Never allocates. Complexity: O(elements of the network).
  EnergyBalance<Scalar> balance() {
    add_inertia();
    for (std::size_t e = 0; e < network_.springs.size(); ++e) add_spring(e);
    for (const BendStencil<Scalar>& b : network_.bends) add_bend(b);
    for (std::size_t e = 0; e < ws_.air.size(); ++e) add_air(e);
    add_attachments();
    add_contacts();
    if (difference_ < Wide(0)) out_.created += difference_;
    return out_;
  }

 private:
  using Wide = WideScalar<Scalar>;
  using Vec = Triple<Wide>;

  static Wide wide(const Scalar& value) { return static_cast<Wide>(value); }
  static Vec wide(const Triple<Scalar>& a) { return {wide(a.x), wide(a.y), wide(a.z)}; }
  Vec before(Index i) const { return wide(column(state_.positions, i)); }
  Vec after(Index i) const { return wide(column(ws_.position, i)); }
  Vec velocity(Index i) const { return wide(column(ws_.velocity, i)); }
  Vec moved(Index i) const { return after(i) - before(i); }

  void add_inertia() {
    const Wide half = Wide(0.5);
    for (Index i = 0; i < network_.vertex_count(); ++i) {
      const Wide m = wide(network_.mass[i]);
      const Vec v = velocity(i), v0 = wide(column(state_.velocities, i));
      if (ws_.is_held(i)) {
        out_.add(Wide(0) - m * (half * squared_norm(v - v0) + dt_ * drag_ * squared_norm(v)));
        continue;
      }
      const Wide kinetic = half * m * squared_norm(v);
      out_.kinetic += kinetic;
      out_.add(kinetic);
      out_.add(Wide(0) - half * m * squared_norm(v0));
      const Vec outer = wide(column(ws_.outer, i));
      out_.add(Wide(0) - dot(outer, moved(i)));
      out_.tension += squared_norm(outer);
    }
  }

  void add_spring(std::size_t e) {
    using std::sqrt;
    const Spring<Scalar>& s = network_.springs[e];
    const bool free_a = !ws_.is_held(s.a), free_b = !ws_.is_held(s.b);
    if (!free_a && !free_b && !(Scalar(0) < s.damping)) return;
    const Vec d0 = before(s.a) - before(s.b), d1 = after(s.a) - after(s.b);
    const Wide l0 = sqrt(squared_norm(d0)), l1 = sqrt(squared_norm(d1));
    const Wide k = wide(s.stiffness), rest = wide(s.rest_length);
    const Wide half = Wide(0.5), total = l0 + l1;
    const Wide tension = k * (l1 - rest), gain = half * k * (l1 - l0) * (total - Wide(2) * rest);
    out_.tension += tension * tension;
    if (free_a && free_b) out_.add(gain);
    if (free_a != free_b) {
      const Vec hand = free_a ? moved(s.b) * Wide(-1) : moved(s.a);  // of x_a - x_b
      const Vec end = d1 * (Wide(0) < l1 ? tension / l1 : Wide(0));
      const Vec mean =
          (d0 + d1) * (Wide(0) < total ? half * k * (Wide(1) - Wide(2) * rest / total) : Wide(0));
      out_.add(gain - dot(end, hand));
      difference_ += dot(end - mean, hand);
    }
    if (!(Scalar(0) < s.damping) || (free_a && free_b)) return;
    const Vec n = wide(column(ws_.direction, static_cast<Index>(e)));
    const Wide push = dt_ * wide(s.damping) * dot(n, velocity(s.a) - velocity(s.b));
    if (!free_a) out_.add(Wide(0) - push * dot(n, velocity(s.a)));
    if (!free_b) out_.add(push * dot(n, velocity(s.b)));
  }

  void add_bend(const BendStencil<Scalar>& b) {
    if (b.is_folded()) return add_folded(b);
    Vec start{Wide(0), Wide(0), Wide(0)}, end = start, hands = start;
    Wide squares = Wide(0);
    bool free = false;
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i) {
      const Index v = b.vertex[i];
      const Wide w = wide(b.weight[i]);
      start = start + before(v) * w;
      end = end + after(v) * w;
      squares += w * w;
      if (ws_.is_held(v)) hands = hands + moved(v) * w;
      free = free || !ws_.is_held(v);
    }
    if (!free) return;
    const Wide k = wide(b.stiffness), half = Wide(0.5);
    out_.tension += k * k * squares * squared_norm(end);
    out_.add(half * k * dot(end + start, end - start) - k * dot(end, hands));
    difference_ += half * k * dot(end - start, hands);
  }

  void add_folded(const BendStencil<Scalar>& b) {
    BendStencil<Wide> hinge{b.vertex, {}, wide(b.stiffness), b.count, wide(b.rest_fold)};
    std::array<Vec, 4> x0, x1;
    bool free = false;
    for (std::size_t i = 0; i < 4; ++i) {
      hinge.weight[i] = wide(b.weight[i]);
      x0[i] = before(b.vertex[i]);
      x1[i] = after(b.vertex[i]);
      free = free || !ws_.is_held(b.vertex[i]);
    }
    if (!free) return;
    const FoldedHinge<Wide> start(hinge, x0), end(hinge, x1);
    const Vec last = end.error() * hinge.stiffness;
    const Vec mean = (start.error() + end.error()) * (Wide(0.5) * hinge.stiffness);
    Wide gain = dot(mean, end.error() - start.error());
    for (int i = 0; i < 4; ++i) {
      const Index v = b.vertex[static_cast<std::size_t>(i)];
      const Vec push = end.share(i, last);
      out_.tension += squared_norm(push);
      if (!ws_.is_held(v)) continue;
      gain -= dot(push, moved(v));
      difference_ += dot(push - start.mean_share(end, i, mean), moved(v));
    }
    out_.add(gain);
  }

  void add_attachments() {
    using std::sqrt;
    for (const auto& item : ws_.attachments.items) {
      const Vec x = after(item.vertex), p = wide(item.point), step = moved(item.vertex);
      const Wide k = wide(item.stiffness);
      const Vec force = (p - x) * k;
      out_.add(Wide(0) - dot(force, step));
      // The difference of two far places may be small.
      out_.size += k * (sqrt(squared_norm(x)) + sqrt(squared_norm(p))) * sqrt(squared_norm(step));
      out_.tension += squared_norm(force) + squared_norm(step * k);
    }
  }

  void add_contacts() {
    if (ws_.contacts == nullptr) return;
    ws_.contacts->for_each_force([&](int v, const Triple<Scalar>& narrow) {
      if (ws_.is_held(v)) return;
      const Vec force = wide(narrow);
      out_.add(Wide(0) - dot(force, moved(v)));
      out_.tension += squared_norm(force);
    });
  }

  void add_air(std::size_t e) {
    const std::array<int, 3>& t = network_.triangles[e];
    const bool held = ws_.is_held(t[0]) || ws_.is_held(t[1]) || ws_.is_held(t[2]);
    if (!held) return;
    const Vec sum = velocity(t[0]) + velocity(t[1]) + velocity(t[2]);
    const Vec push = product<Wide>(ws_.air[e].template cast<Wide>(), sum) * (dt_ / Wide(9));
    for (const int v : t) {
      if (ws_.is_held(v)) out_.add(Wide(0) - dot(push, velocity(v)));
    }
  }

  const SpringNetwork<Scalar>& network_;
  const ClothState<Scalar>& state_;
  const MassSpringWorkspace<Scalar>& ws_;
  Wide dt_, drag_;
  EnergyBalance<Scalar> out_;
  Wide difference_ = Wide(0);  // what the mean forces add to ΔE
};

/// Returns true when ΔE of a step that ends at ws.position is above what rounding can cause and a
/// thousandth of the kinetic energy: too much to be taken out of the velocities alone.
template <RealScalar Scalar>
bool creates_energy(const EnergyBalance<Scalar>& balance, const MassSpringWorkspace<Scalar>& ws) {
  using std::sqrt;
  using Wide = WideScalar<Scalar>;
  const Wide rounding = static_cast<Wide>(scalar_traits<Scalar>::epsilon());
  const Wide place = static_cast<Wide>(largest_magnitude(ws.position));
  const Wide noise = Wide(4) * rounding * (place * sqrt(balance.tension) + balance.size);
  return noise + Wide(1e-3) * balance.kinetic < balance.created;
}

/// Sets ws.kept and ws.drift to take ΔE out of the kinetic energy after a step of a body with the
/// vertex masses `mass` (n, kg).
template <RealScalar Scalar>
void remove_energy(const EnergyBalance<Scalar>& balance, const VectorX<Scalar>& mass,
                   MassSpringWorkspace<Scalar>& ws) {
  using std::sqrt;
  using Wide = WideScalar<Scalar>;
  const Wide noise = Wide(64) * scalar_traits<Wide>::epsilon() * balance.size;
  if (!(noise < balance.created)) return;
  Triple<Scalar> momentum{Scalar(0), Scalar(0), Scalar(0)};
  Scalar total = Scalar(0);
  Wide kinetic = Wide(0);
  bool free = ws.attachments.empty();
  for (Index i = 0; i < mass.size(); ++i) {
    free = free && !ws.is_held(i);
    momentum = momentum + column(ws.velocity, i) * mass[i];
    total += mass[i];
  }
  ws.drift = momentum * (free ? Scalar(1) / total : Scalar(0));
  for (Index i = 0; i < mass.size(); ++i) {
    if (ws.is_held(i)) continue;
    const Triple<Scalar> v = column(ws.velocity, i) - ws.drift;
    kinetic += static_cast<Wide>(Scalar(0.5) * mass[i] * squared_norm(v));
  }
  const bool enough = balance.created < kinetic;
  ws.kept = enough ? static_cast<Scalar>(sqrt(Wide(1) - balance.created / kinetic)) : Scalar(0);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
