#pragma once

// The springs of rest length zero between vertices and points of the input
// (ClothInput::attached_vertices). Spring j pulls vertex i with -k_j (x_i - p_j). The springs of a
// vertex act like one spring,
//
//   -K (x - P),   K = Σ k_j,   P = Σ k_j p_j / K,
//
// so a step needs memory for one spring a vertex at most. Symbols: x position of the vertex, p_j
// point, k_j stiffness, v velocity at the end of the step, h step or substep, w inverse mass.
//
// Mass-spring: K adds h² K to the diagonal of the step matrix and the energy ½ K |x0 + h v - P|² to
// the step. The work that a step is credited with is F·Δx of the force F at its end and the move Δx
// (energy_balance.hpp): it is at most the work of the spring, and tends to that of a driven vertex
// as K grows.
//
// Position-based: the constraint x = P with the compliance 1/K, multiplied by h² K,
//
//   Δλ = -( h² K (x - P) + λ ) / ( h² K w + 1 ),   x += w Δλ,   λ += Δλ

#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/detail/reserved_list.hpp"
#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/core/cloth_state.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The attachments of a step, one for each vertex that has any.
template <RealScalar Scalar>
struct Attachments {
  /// An attached vertex.
  struct Item {
    int vertex;
    /// P, m.
    Triple<Scalar> point;
    /// K, N/m.
    Scalar stiffness;
    /// λ (N s²), which starts at zero in every substep.
    Triple<Scalar> multiplier;
  };
  ReservedList<Item> items;
  /// Place of a vertex in `items`, or -1.
  std::vector<int> place;

  bool empty() const { return items.empty(); }

  /// Makes room for `vertex_count` vertices. Allocates.
  void reserve(Index vertex_count) {
    items.clear();
    items.reserve(static_cast<std::size_t>(vertex_count));
    place.assign(static_cast<std::size_t>(vertex_count), -1);
  }

  /// Returns true when `reserve` has made room for this number of vertices.
  bool fits(Index vertex_count) const {
    const std::size_t n = static_cast<std::size_t>(vertex_count);
    return place.size() == n && items.capacity() >= n;
  }

  /// Takes the attachments of a valid input, without those of vertices that `is_held(vertex)` says
  /// are held. Never allocates.
  template <class Held>
  void load(const ClothInput<Scalar>& input, Held is_held) {
    for (const Item& item : items) place[static_cast<std::size_t>(item.vertex)] = -1;
    items.clear();
    const Triple<Scalar> zero{Scalar(0), Scalar(0), Scalar(0)};
    for (std::size_t j = 0; j < input.attached_vertices.size(); ++j) {
      const int vertex = input.attached_vertices[j];
      if (is_held(vertex)) continue;
      const Triple<Scalar> p = column(input.attached_positions, static_cast<Index>(j));
      const Scalar k = input.attachment_stiffness[static_cast<Index>(j)];
      int& at = place[static_cast<std::size_t>(vertex)];
      if (at < 0) {
        at = static_cast<int>(items.size());
        items.push_back({vertex, p, k, zero});
        continue;
      }
      Item& item = items[static_cast<std::size_t>(at)];
      item.stiffness += k;
      item.point = item.point + (p - item.point) * (k / item.stiffness);
    }
  }

  /// Returns the force on an attached vertex at `x`, N.
  static Triple<Scalar> force(const Item& item, const Triple<Scalar>& x) {
    return (item.point - x) * item.stiffness;
  }

  /// Adds the forces at positions `x` (3×n, m) to `forces` (3×n, N).
  void add_forces(const Points<Scalar>& x, Points<Scalar>& forces) const {
    for (const Item& item : items)
      add_to_column(forces, item.vertex, force(item, column(x, item.vertex)));
  }

  /// Returns the energy at positions `x` (3×n, m), J. Adds a bound on its rounding error, divided
  /// by ε, to `size`.
  Scalar energy(const Points<Scalar>& x, Scalar& size) const {
    using std::sqrt;
    Scalar sum = Scalar(0);
    for (const Item& item : items) {
      const Triple<Scalar> at = column(x, item.vertex), d = at - item.point;
      const Scalar reach = sqrt(squared_norm(at));
      sum += Scalar(0.5) * item.stiffness * squared_norm(d);
      size += item.stiffness * reach *
              (sqrt(squared_norm(d)) + scalar_traits<Scalar>::epsilon() * reach);
    }
    return sum;
  }

  /// Sets all multipliers to zero.
  void begin_substep() {
    for (Item& item : items) item.multiplier = {Scalar(0), Scalar(0), Scalar(0)};
  }

  /// Corrects the attached vertices once. `at(vertex)` returns a pointer to x of the vertex in a
  /// buffer in which y and z follow at distances of `stride`; `weight(vertex)` returns w, 1/kg.
  template <class At, class Weight>
  void correct(const Scalar& h, std::size_t stride, At at, Weight weight) {
    for (Item& item : items) {
      Scalar* x = at(item.vertex);
      const Scalar w = weight(item.vertex), stiffness = h * h * item.stiffness;
      const Triple<Scalar> p{x[0], x[stride], x[2 * stride]};
      const Triple<Scalar> change = ((item.point - p) * stiffness - item.multiplier) *
                                    (Scalar(1) / (stiffness * w + Scalar(1)));
      item.multiplier = item.multiplier + change;
      x[0] = p.x + w * change.x;
      x[stride] = p.y + w * change.y;
      x[2 * stride] = p.z + w * change.z;
    }
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
