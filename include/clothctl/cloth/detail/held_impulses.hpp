#pragma once

// The impulses that the held vertices of a position-based sheet give to the rest of it in a step.
//
// Held vertices have the inverse mass 0 where positions are predicted and on coarse levels. During
// the sweeps over constraints they have ε/m_i instead: each of these corrections keeps momentum, so
// that the displacement d_i that they give to the vertex shows the impulse
//
//   R_i = -(m_i/ε) d_i/h,      ε = 10⁻⁴ (10⁻³ in float)
//
// on the rest; the vertex then goes back to where it is held. Corrections on coarse levels keep no
// momentum, nor does what calms slow motion. What they add to the momentum of the rest is the work
// of the held vertices, too, and is divided among them as their |R_i|.

#include <cmath>
#include <cstddef>
#include <type_traits>

#include "clothctl/cloth/detail/reserved_list.hpp"
#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns p - x_start of a vertex in the buffers of a sheet, m.
template <class Sheet>
auto way_in_substep(const Sheet& sheet, const typename Sheet::Scratch& memory, int vertex) {
  using Scalar = typename Sheet::Scalar;
  const Scalar* p = memory.points.data() + sheet.offset(vertex);
  const Scalar* start = memory.start.data() + sheet.offset(vertex);
  constexpr std::size_t k = Sheet::kStride;
  return Triple<Scalar>{p[0] - start[0], p[k] - start[k], p[2 * k] - start[2 * k]};
}

/// Impulses of held vertices, summed over the substeps of a step.
template <RealScalar Scalar>
class HeldImpulses {
 public:
  /// ε above.
  static constexpr double kLightness = std::is_same_v<Scalar, float> ? 1e-3 : 1e-4;

  /// Makes room for a number of held vertices. Allocates.
  void reserve(std::size_t count) { held_.reserve(count); }
  std::size_t capacity() const { return held_.capacity(); }

  /// Begins a step with these vertices, of masses `mass` (n, kg). Never allocates.
  template <class Vertices>
  void begin(const Vertices& vertices, const VectorX<Scalar>& mass) {
    held_.clear();
    for (const int v : vertices) held_.push_back({v, mass[v], {}, {}, zero()});
    unaccounted_ = zero();
  }
  /// Before the sweeps of a substep, with the vertices where they are held: gives them the inverse
  /// mass ε/m in the points of the sheet.
  template <class Sheet>
  void begin_sweeps(const Sheet& sheet, typename Sheet::Scratch& memory) {
    for (Held& one : held_) {
      one.place = read(sheet, memory.points, one.vertex);
      one.moved = way_in_substep(sheet, memory, one.vertex);
      at(sheet, memory.points, one.vertex)[3 * Sheet::kStride] = light(one);
    }
  }
  /// After the sweeps of a substep of `h` s: puts them back, with the inverse mass 0.
  template <class Sheet>
  void end_sweeps(const Scalar& h, const Sheet& sheet, typename Sheet::Scratch& memory) {
    for (Held& one : held_) {
      const Triple<Scalar> now = way_in_substep(sheet, memory, one.vertex);
      one.impulse = one.impulse - (now - one.moved) / (h * light(one));
      write(sheet, memory.points, one.vertex, one.place);
      write(sheet, memory.start, one.vertex, one.place - one.moved);
      at(sheet, memory.points, one.vertex)[3 * Sheet::kStride] = Scalar(0);
    }
  }
  /// Does something that keeps no momentum, and notes by how much that of the rest changes.
  /// `velocity(v)` returns that of a vertex, m/s; masses and inverse masses are n, kg and 1/kg.
  template <class Action, class Velocity>
  void account(Action action, Velocity velocity, const VectorX<Scalar>& mass,
               const VectorX<Scalar>& inverse_mass) {
    if (held_.empty()) return action();
    const auto momentum = [&] {
      Triple<Scalar> sum = zero();
      for (Index v = 0; v < mass.size(); ++v) {
        if (Scalar(0) < inverse_mass[v]) sum = sum + velocity(v) * mass[v];
      }
      return sum;
    };
    const Triple<Scalar> before = momentum();
    action();
    unaccounted_ = unaccounted_ + momentum() - before;
  }

  /// Divides what is not accounted for. Then `impulse` is what it says. Returns Σ |R_i|, N s.
  Scalar end() {
    using std::sqrt;
    Scalar total = Scalar(0);
    for (Held& one : held_) total = total + sqrt(squared_norm(one.impulse));
    for (Held& one : held_) {
      const Scalar share = Scalar(0) < total
                               ? Scalar(sqrt(squared_norm(one.impulse)) / total)
                               : Scalar(Scalar(1) / Scalar(static_cast<double>(held_.size())));
      one.impulse = one.impulse + unaccounted_ * share;
    }
    unaccounted_ = zero();
    Scalar sum = Scalar(0);
    for (const Held& one : held_) sum = sum + sqrt(squared_norm(one.impulse));
    return sum;
  }
  /// R_i of the i-th held vertex in the last step, N s.
  const Triple<Scalar>& impulse(std::size_t i) const { return held_[i].impulse; }

 private:
  struct Held {
    int vertex;
    Scalar mass;
    /// Where it is held at the end of the substep, and its way in the substep before the sweeps, m.
    Triple<Scalar> place, moved;
    Triple<Scalar> impulse;
  };
  static Triple<Scalar> zero() { return {Scalar(0), Scalar(0), Scalar(0)}; }
  static Scalar light(const Held& one) { return Scalar(kLightness) / one.mass; }
  template <class Sheet>
  static Scalar* at(const Sheet& sheet, VectorX<Scalar>& buffer, int vertex) {
    return buffer.data() + sheet.offset(vertex);
  }
  template <class Sheet>
  static Triple<Scalar> read(const Sheet& sheet, VectorX<Scalar>& buffer, int vertex) {
    const Scalar* p = at(sheet, buffer, vertex);
    return {p[0], p[Sheet::kStride], p[2 * Sheet::kStride]};
  }
  template <class Sheet>
  static void write(const Sheet& sheet, VectorX<Scalar>& buffer, int vertex,
                    const Triple<Scalar>& value) {
    Scalar* p = at(sheet, buffer, vertex);
    p[0] = value.x;
    p[Sheet::kStride] = value.y;
    p[2 * Sheet::kStride] = value.z;
  }

  ReservedList<Held> held_;
  Triple<Scalar> unaccounted_ = zero();
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
