#pragma once

// Contacts with obstacles in the substeps h of a position-based sheet. The point of contact is
// x = Σ w_i x_i, its inverse mass w = Σ w_i²/m_i, x⁻ its position at the start of the substep. The
// obstacle is asked at most once in a substep, and then is a plane with the outward normal n; it
// moves by t u_s, with u_s the velocity of its surface and t the time since the start of the step.
// After each sweep over the springs, and after the last one, every contact in turn is corrected. c
// >= 0 is the sum of its corrections along n in the substep, b that of its corrections across, both
// in m; λ = c/w is a multiplier, and x_i += (w_i/m_i) λ n. With the depth δ of x below the
// thickness, and the way r from where it stuck, along the surface:
//
//   c ← max(0, c + δ)                     at most the way that x came in, and h times the push-out
//                                         speed
//   b ← b - r, at most μ (c - e) long     it sticks, or slips
//
// e = max(0, n·(x - x⁻ - h u_s)), at most c, is what this leaves of a motion outwards. At the end
// of the substep x⁻ also moves by e n: pushing out gives no velocity. The impulse is ((c - e) n + b
// - s)/(w h), with s what of the corrections moved x⁻, too: they undo sweeps for a limit of stretch
// that had no effect on velocities. (c - s_n takes the place of c in e then, so that nothing is
// pulled, and b - s_t is cut back to the cone.) A contact that slips forgets r; one that does not
// touch keeps it.
//
// A point whose normal turned round since the last substep has passed through something thin: it
// is corrected by the plane of that substep. Points inside edges and triangles keep the plane of
// the start of the step: the part of the sheet around them may be on both sides of what is thin. As
// the distance changes by no more than the point moves, most of the points that are not close need
// no query; nor do points that have moved by no more than a fiftieth of the thickness since the
// last one: the plane is then off by at most twice that, and by its square over the thickness where
// the surface is no sharper than that.
//
// Reference: Macklin, Müller, Chentanez, Kim: Unified particle physics, 2014, section 6.

#include <array>
#include <cmath>
#include <cstddef>

#include "clothctl/cloth/detail/reserved_list.hpp"
#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What a step knows of a contact.
template <RealScalar Scalar>
struct ContactPlane {
  // What each substep reads of every contact comes first.
  /// w_i, and the number of vertices; 0 if all are held.
  std::array<Scalar, 3> weight;
  std::array<int, 3> vertex;
  int count;
  /// The last answer of the obstacle, moved back by t u_s: its distance, its point, and the point
  /// that was asked about.
  Scalar distance;
  Triple<Scalar> asked, foot;
  /// u_s; n; n·x of a point at the thickness.
  Triple<Scalar> surface, normal;
  Scalar level;
  /// c, m, and b.
  Scalar pressed;
  Triple<Scalar> held;
  /// What of the corrections has no effect on velocities, m.
  Triple<Scalar> still;
  /// x⁻ + h u_s, and the same less the way from where it stuck.
  Triple<Scalar> start, stuck;
  /// w_i/(m_i w); w, 1/kg; μ; the distance of the point from the surface where it rests, m.
  std::array<Scalar, 3> share;
  Scalar inverse_mass, friction, thickness;
};

/// Memory of the contacts of a step.
template <RealScalar Scalar>
struct ContactPlaneList {
  ReservedList<ContactPlane<Scalar>> planes;
  /// Those that may touch in the substep.
  ReservedList<int> touching;

  /// Makes room for a number of contacts. Allocates.
  void reserve(std::size_t count) {
    planes.reserve(count);
    touching.reserve(count);
  }
  std::size_t capacity() const { return planes.capacity(); }
};

/// The contacts of a step of a sheet whose coordinates are `kStride` apart in memory.
template <RealScalar S, std::size_t kStride>
class PositionContacts {
 public:
  /// The scalar type.
  using Scalar = S;
  using Vec = Triple<Scalar>;
  using Contact = ObstacleContact<Scalar>;
  using Plane = ContactPlane<Scalar>;

  /// Refers to the contacts, to memory with room for them, and to the inverse masses (n, 1/kg).
  PositionContacts(ObstacleContacts<Scalar>& contacts, ContactPlaneList<Scalar>& memory,
                   const VectorX<Scalar>& inverse_mass)
      : contacts_(contacts), memory_(memory), thickness_(contacts.settings().thickness) {
    memory_.planes.clear();
    for (Contact& c : contacts_.contacts()) {
      memory_.planes.push_back(make(c, inverse_mass));
      memory_.planes.back().thickness = thickness_ - c.point.slack;
      c.impulse.setConstant(Scalar(0));
      c.state = ContactState::Open;
    }
  }

  /// Begins a substep of `h` s that ends `time` s after the start of the step. `points(v)` and
  /// `start(v)` return pointers to x of a vertex as predicted and at the start of the substep.
  template <class At, class StartAt>
  void begin_substep(const Scalar& h, const Scalar& time, At points, StartAt start) {
    h_ = h;
    time_ = time;
    memory_.touching.clear();
    for (std::size_t i = 0; i < memory_.planes.size(); ++i) {
      Plane& plane = memory_.planes[i];
      if (plane.count == 0 || !ask(i, sum(plane, points))) continue;
      plane.pressed = Scalar(0);
      plane.still = plane.held = Vec{Scalar(0), Scalar(0), Scalar(0)};
      plane.start = sum(plane, start) + plane.surface * h_;
      plane.stuck = plane.start - triple<Scalar>(contacts_.contacts()[i].offset);
      memory_.touching.push_back(static_cast<int>(i));
    }
  }

  /// Corrects all points once. The share `still` of it has no effect on velocities, and so gives no
  /// impulse: the start of the substep moves with it. Returns the largest correction along a
  /// normal, either way, m.
  template <class At>
  Scalar correct(At points, const Scalar& still) {
    Scalar largest = Scalar(0);
    for (const int i : memory_.touching) {
      const Scalar by = correct_one(memory_.planes[static_cast<std::size_t>(i)], points, still);
      if (largest < by) largest = by;
    }
    return largest;
  }

  /// Lifts points that are inside of an obstacle to its surface, once. The share `counted` of it
  /// goes into velocities, and so into impulses.
  template <class At>
  void lift(At points, const Scalar& counted) {
    for (const int i : memory_.touching) {
      Plane& plane = memory_.planes[static_cast<std::size_t>(i)];
      const Scalar deep = plane.level - plane.thickness - dot(plane.normal, sum(plane, points));
      if (!(Scalar(0) < deep)) continue;
      plane.pressed = plane.pressed + counted * deep;
      move(plane, plane.normal * deep, points);
    }
  }

  /// Corrects all points until none moves by a twentieth of the thickness, a few times at most:
  /// contacts that share vertices disturb each other. `last` is the largest correction of the pass
  /// that was just made, `still` as above.
  template <class At>
  void settle(At points, Scalar last, const Scalar& still) {
    for (int pass = 0; pass < kMostPasses && Scalar(0.05) * thickness_ < last; ++pass)
      last = correct(points, still);
  }

  /// Ends a substep: sets states and adds up impulses.
  template <class At, class StartAt>
  void end_substep(At points, StartAt start) {
    for (const int i : memory_.touching) end_one(static_cast<std::size_t>(i), points, start);
  }

  /// Counts what the step did.
  void finish(ObstacleContactReport<Scalar>& report) const {
    report = {};
    report.penetration = deepest_;
    for (Contact& c : contacts_.contacts()) {
      if (c.state == ContactState::Open) {
        c.age = 0;
        continue;
      }
      ++c.age;
      ++report.closed;
      if (c.state == ContactState::Slip) ++report.slipping;
    }
  }

 private:
  static constexpr int kMostPasses = 8;
  /// A plane serves within this share of the thickness.
  static constexpr double kNear = 0.02;

  static Plane make(const Contact& c, const VectorX<Scalar>& inverse_mass);

  template <class At>
  static Vec sum(const Plane& plane, At at) {
    if (plane.count == 1) {
      const Scalar* p = at(plane.vertex[0]);
      return Vec{p[0], p[kStride], p[2 * kStride]};
    }
    Vec x{Scalar(0), Scalar(0), Scalar(0)};
    for (std::size_t k = 0; k < static_cast<std::size_t>(plane.count); ++k) {
      const Scalar* p = at(plane.vertex[k]);
      x = x + Vec{p[0], p[kStride], p[2 * kStride]} * plane.weight[k];
    }
    return x;
  }
  /// Moves the vertices so that the point moves by `by`.
  template <class At>
  static void move(const Plane& plane, const Vec& by, At at) {
    for (std::size_t k = 0; k < static_cast<std::size_t>(plane.count); ++k) {
      Scalar* p = at(plane.vertex[k]);
      p[0] = p[0] + plane.share[k] * by.x;
      p[kStride] = p[kStride] + plane.share[k] * by.y;
      p[2 * kStride] = p[2 * kStride] + plane.share[k] * by.z;
    }
  }
  /// Returns e for the way n·(x - x⁻ - h u_s).
  static Scalar outwards(const Scalar& along, const Scalar& pressed) {
    if (!(Scalar(0) < along)) return Scalar(0);
    return pressed < along ? pressed : along;
  }
  /// Asks the obstacle about the point x unless it cannot touch. Returns whether it may, in this
  /// substep.
  bool ask(std::size_t i, const Vec& x);
  template <class At>
  Scalar correct_one(Plane& plane, At points, const Scalar& still) const;
  template <class At, class StartAt>
  void end_one(std::size_t i, At points, StartAt start);

  ObstacleContacts<Scalar>& contacts_;
  ContactPlaneList<Scalar>& memory_;
  Scalar thickness_;
  Scalar h_ = Scalar(0), time_ = Scalar(0), deepest_ = Scalar(0);
};

template <RealScalar S, std::size_t kStride>
auto PositionContacts<S, kStride>::make(const Contact& c, const VectorX<Scalar>& inverse_mass)
    -> Plane {
  const Scalar zero = Scalar(0);
  Plane plane{};
  plane.inverse_mass = zero;
  for (std::size_t k = 0; k < 3 && c.point.vertex[k] >= 0; ++k) {
    plane.vertex[k] = c.point.vertex[k];
    const Scalar w = plane.weight[k] = c.point.weight[static_cast<Index>(k)];
    plane.share[k] = w * inverse_mass[plane.vertex[k]];
    plane.inverse_mass = plane.inverse_mass + w * plane.share[k];
    ++plane.count;
  }
  if (!(zero < plane.inverse_mass)) plane.count = 0;
  for (std::size_t k = 0; k < static_cast<std::size_t>(plane.count); ++k)
    plane.share[k] = plane.share[k] / plane.inverse_mass;
  const SurfacePoint<Scalar>& there = c.point.surface;
  plane.friction = there.friction;
  plane.normal = triple<Scalar>(there.normal);
  plane.surface = triple<Scalar>(there.velocity);
  plane.distance = there.distance;
  plane.foot = triple<Scalar>(there.point);
  plane.asked = triple<Scalar>(c.point.position);
  return plane;
}

template <RealScalar S, std::size_t kStride>
bool PositionContacts<S, kStride>::ask(std::size_t i, const Vec& x) {
  Plane& plane = memory_.planes[i];
  const Vec moved = plane.surface * time_, y = x - moved;
  // Sweeps move a point, too: what is a thickness away may touch.
  const Scalar clear = plane.distance - Scalar(2) * thickness_;
  if (Scalar(0) < clear && squared_norm(y - plane.asked) < clear * clear) return false;
  const Scalar slight = Scalar(kNear) * thickness_;
  bool keeps = (1 < plane.count && Scalar(0) < plane.distance) ||
               squared_norm(y - plane.asked) <= slight * slight;
  if (!keeps) {
    const Vector3<Scalar> point(y.x, y.y, y.z);
    const SurfacePoint<Scalar> now = contacts_.surface_at(contacts_.contacts()[i], point);
    const Vec normal = triple<Scalar>(now.normal);
    keeps = Scalar(0) < plane.distance && dot(normal, plane.normal) < Scalar(0);
    if (!keeps) {
      plane.normal = normal;
      plane.distance = now.distance;
      plane.foot = triple<Scalar>(now.point);
      plane.asked = y;
    }
  }
  const Scalar distance = dot(plane.normal, y - plane.foot);
  plane.level = dot(plane.normal, plane.foot + moved) + plane.thickness;
  return distance < Scalar(2) * thickness_;
}

template <RealScalar S, std::size_t kStride>
template <class At>
S PositionContacts<S, kStride>::correct_one(Plane& plane, At points, const Scalar& still) const {
  using std::sqrt;
  const Scalar zero = Scalar(0);
  const Vec n = plane.normal, x = sum(plane, points);
  Scalar pressed = plane.pressed + plane.level - dot(n, x);
  if (!(zero < pressed) && !(zero < plane.pressed)) return zero;
  Scalar along = dot(n, x - plane.start);
  // What the springs and the way before the substep brought in, and what may be pushed out.
  const Scalar came = plane.pressed - along, out = h_ * contacts_.settings().push_out_speed;
  const Scalar most = (zero < came ? came : zero) + out;
  if (most < pressed) pressed = most;
  if (pressed < zero) pressed = zero;
  const Scalar by = pressed - plane.pressed;
  plane.pressed = pressed;
  along += by;
  const Scalar limit = plane.friction * (pressed - outwards(along, pressed));
  Vec held = plane.held - (x - plane.stuck);
  held = held - n * dot(held, n);
  const Scalar square = squared_norm(held);
  if (limit * limit < square) held = held * (limit / sqrt(square));
  const Vec way = n * by + held - plane.held;
  move(plane, way, points);
  plane.still = plane.still + way * still;
  plane.held = held;
  return by < zero ? zero - by : by;
}

template <RealScalar S, std::size_t kStride>
template <class At, class StartAt>
void PositionContacts<S, kStride>::end_one(std::size_t i, At points, StartAt start) {
  using std::sqrt;
  Plane& plane = memory_.planes[i];
  Contact& c = contacts_.contacts()[i];
  const Vec n = plane.normal, x = sum(plane, points);
  const Scalar depth = plane.level - dot(n, x);
  if (deepest_ < depth) deepest_ = depth;
  Vec moved = x - plane.stuck;
  moved = moved - n * dot(moved, n);
  c.offset = Vector3<Scalar>(moved.x, moved.y, moved.z);
  // What sweeps for a limit lifted off may have pressed before, with effect on velocities.
  const bool undone = Scalar(0) < squared_norm(plane.still);
  if (!(Scalar(0) < plane.pressed) && !undone) return;
  // These sweeps may have moved the start of the substep. Only what counts for velocities can be
  // taken from them: no contact pulls, nor across by more than its friction.
  const Vec from = sum(plane, start) + plane.surface * h_;
  const Scalar lifted = dot(n, plane.still), counted = plane.pressed - lifted;
  const Scalar e = counted < Scalar(0) ? counted : outwards(dot(n, x - from), counted);
  const Vec across = plane.held - (plane.still - n * lifted);
  const Scalar most = plane.friction * (counted - e), square = squared_norm(across);
  Vec kept = across;
  if (undone && most * most < square) kept = across * (most / sqrt(square));
  move(plane, n * e + across - kept, start);
  const Vec p = (n * (counted - e) + kept) / (plane.inverse_mass * h_);
  c.impulse += Vector3<Scalar>(p.x, p.y, p.z);
  if (!(Scalar(0) < plane.pressed)) return;
  const Scalar limit = plane.friction * (plane.pressed - e);
  const bool slips = !(squared_norm(plane.held) < Scalar(0.998) * limit * limit);
  c.state = slips ? ContactState::Slip : ContactState::Stick;
  if (slips) c.offset.setConstant(Scalar(0));
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
