#pragma once

// What a planner of contact forces and a grasp controller need to know of the contacts in a world,
// after a step: the outer forces f_e on the vertices of a sheet, which vertices a finger holds, and
// what a soft pad feels. All read `World::contacts` and `World::pad_contacts`.

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "clothctl/sim/world.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

template <RealScalar Scalar>
Vector3<Scalar> contact_normal(const ObstacleContact<Scalar>& c) {
  return c.point.surface.normal;
}
template <RealScalar Scalar>
Vector3<Scalar> contact_normal(const PadContact<Scalar>& c) {
  return c.normal;
}

/// Calls visit(vertex, weight, contact, time) for each vertex of each contact of a sheet with a
/// carrier for which `wanted(carrier)`; the contact's impulse (N s) acted for `time` in the last
/// step, of `dt` s.
template <RealScalar Scalar, class Wanted, class Visit>
void for_each_touched(const World<Scalar>& world, int sheet, const Scalar& dt, Wanted wanted,
                      Visit visit) {
  const auto corners = [&](const auto& vertex, const auto& weight, const auto& contact,
                           const Scalar& time) {
    for (std::size_t k = 0; k < 3 && vertex[k] >= 0; ++k)
      visit(vertex[k], weight[static_cast<Index>(k)], contact, time);
  };
  for (const ObstacleContact<Scalar>& c : world.contacts(sheet)) {
    if (c.state != ContactState::Open && wanted(c.obstacle))
      corners(c.point.vertex, c.point.weight, c, world.last_part());
  }
  for (int pad = 0; pad < world.pad_count(); ++pad) {
    if (!wanted(world.pad_carrier(pad))) continue;
    for (const PadContact<Scalar>& c : world.pad_contacts(pad)) {
      if (c.sheet == sheet && c.state != ContactState::Open) corners(c.vertex, c.weight, c, dt);
    }
  }
}

}  // namespace detail

/// Adds the forces (N) that obstacles, bodies and pads exerted on a sheet at the end of the last
/// step, of `dt` s, to `forces` (3×vertices). `except` names obstacles, and bodies as -1 - b, whose
/// forces do not count: those that are planned. Never allocates.
template <RealScalar Scalar>
void add_contact_forces(const World<Scalar>& world, int sheet, const Scalar& dt,
                        std::span<const int> except, Eigen::Ref<Points<Scalar>> forces) {
  detail::for_each_touched(
      world, sheet, dt,
      [&](int carrier) { return std::find(except.begin(), except.end(), carrier) == except.end(); },
      [&](int v, const Scalar& weight, const auto& contact, const Scalar& time) {
        forces.col(v) += (weight / time) * contact.impulse;
      });
}

/// Writes what carries the vertices of a sheet after the last step, of `dt` s, to `supports`, for
/// `Planner::set_supports`: the sums of all contacts but those with `except` (obstacles, and bodies
/// as -1 - b), which are planned. `release`: the way on which a contact is taken to open, m.
/// Allocates.
template <RealScalar Scalar>
void contact_supports(const World<Scalar>& world, int sheet, const Scalar& dt,
                      std::span<const int> except, const Scalar& release,
                      std::vector<VertexSupport<Scalar>>& supports) {
  const std::size_t count = static_cast<std::size_t>(world.state(sheet).positions.cols());
  std::vector<SupportSum<Scalar>> sums(count);
  detail::for_each_touched(
      world, sheet, dt,
      [&](int carrier) { return std::find(except.begin(), except.end(), carrier) == except.end(); },
      [&](int v, const Scalar& weight, const auto& contact, const Scalar& time) {
        const Vector3<Scalar> force = contact.impulse / time;
        const VertexSupport<Scalar> one{v, detail::contact_normal(contact), force, release};
        sums[static_cast<std::size_t>(v)].add(one, weight);
      });
  supports.clear();
  for (std::size_t i = 0; i < count; ++i) {
    if (sums[i].empty()) continue;
    supports.push_back(sums[i].of(static_cast<int>(i)));
    if (!is_unbounded(supports.back().release)) supports.back().release = release;
  }
}

/// Adds the vertices of a sheet that stuck to obstacle `carrier`, or to body b with -1 - b, in the
/// last step to `vertices`, each once: those with at least a fifth of a contact's weight. They are
/// the static contacts of a finger. Allocates as push_back does.
template <RealScalar Scalar>
void add_static_contacts(const World<Scalar>& world, int sheet, int carrier,
                         std::vector<int>& vertices) {
  detail::for_each_touched(
      world, sheet, Scalar(1), [&](int number) { return number == carrier; },
      [&](int v, const Scalar& weight, const auto& contact, const Scalar&) {
        if (contact.state != ContactState::Stick || weight < Scalar(0.2)) return;
        if (std::find(vertices.begin(), vertices.end(), v) == vertices.end()) vertices.push_back(v);
      });
}

/// What a soft pad, or a tactile sensor, feels.
template <RealScalar Scalar>
struct PadTouch {
  /// Sum of the normal forces of its contacts, N.
  Scalar normal_force = Scalar(0);
  /// Size of the sum of the forces across the normals, N.
  Scalar tangential_force = Scalar(0);
  /// Samples in contact, and how many of them slide.
  int contacts = 0, sliding = 0;
};

namespace detail {

/// What a pad felt of the contacts for which `counts(contact)`.
template <RealScalar Scalar, class Counts>
PadTouch<Scalar> pad_touch(const World<Scalar>& world, int pad, const Scalar& dt, Counts counts) {
  using std::sqrt;
  PadTouch<Scalar> out;
  if (pad < 0 || world.pad_count() <= pad) return out;
  Vector3<Scalar> across = Vector3<Scalar>::Constant(Scalar(0));
  for (const PadContact<Scalar>& c : world.pad_contacts(pad)) {
    if (c.state == ContactState::Open || !counts(c)) continue;
    const Scalar along = c.impulse.dot(c.normal) / dt;
    out.normal_force += along;
    across += c.impulse / dt - along * c.normal;
    ++out.contacts;
    if (c.state == ContactState::Slip) ++out.sliding;
  }
  out.tangential_force = sqrt(across.squaredNorm());
  return out;
}

}  // namespace detail

/// Returns what a pad felt in the last step, of `dt` s: nothing where there is no such pad, such as
/// -1 of a finger without one. Never allocates.
template <RealScalar Scalar>
PadTouch<Scalar> pad_touch(const World<Scalar>& world, int pad, const Scalar& dt) {
  return detail::pad_touch(world, pad, dt, [](const PadContact<Scalar>&) { return true; });
}

/// The same of contacts alone whose outward normals on the pad are within 60° of `press` (unit): a
/// fingertip that pinches a fold on a table feels the table, too, which is no part of the pinch.
template <RealScalar Scalar>
PadTouch<Scalar> pad_touch(const World<Scalar>& world, int pad, const Scalar& dt,
                           const Vector3<Scalar>& press) {
  return detail::pad_touch(world, pad, dt, [&](const PadContact<Scalar>& c) {
    return Scalar(0.5) < c.normal.dot(press);
  });
}

}  // namespace clothctl::inline CLOTHCTL_ABI
