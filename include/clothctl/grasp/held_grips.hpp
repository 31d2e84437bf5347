#pragma once

// The grips that a planner of contact forces plans for, from what fingers hold: each segment of
// StaticContacts is a finger on the vertices that stick to it, on the side of the sheet that it
// presses from.

#include <array>
#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "clothctl/contact/grip.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/grasp/static_contacts.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A finger of a hand that holds a sheet.
template <RealScalar Scalar>
struct HoldingFinger {
  /// Its segment in StaticContacts.
  int segment = 0;
  /// The direction in which it presses, unit, world.
  Vector3<Scalar> press = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(-1));
  /// Friction coefficient.
  Scalar friction = Scalar(0.6);
  /// Largest normal force, N: of what it presses with, or of what its joints can exert
  /// (FingertipTracker::largest_force).
  Scalar max_normal_force = Scalar(10);
};

/// Makes the grip of one hand. `x` (3×n, m): the sheet; `triangles`: its faces, which say where its
/// front is (the fallback normal of the grip where there are none, as on a rope). Fingers that hold
/// nothing are left out. Allocates. Fails when: no finger holds anything, a segment does not exist,
/// a triangle has a vertex off the mesh, a number is not finite, a friction coefficient is
/// negative, or a largest force is not positive.
template <RealScalar Scalar>
Result<Grip<Scalar>> make_held_grip(const StaticContacts<Scalar>& contacts,
                                    std::span<const HoldingFinger<Scalar>> fingers,
                                    const PointsView<Scalar>& x,
                                    std::span<const std::array<int, 3>> triangles) {
  Grip<Scalar> out;
  std::vector<int> around;  // triangles at what a finger holds
  for (std::size_t i = 0; i < fingers.size(); ++i) {
    const HoldingFinger<Scalar>& f = fingers[i];
    const std::string name = "finger " + std::to_string(i);
    if (f.segment < 0 || contacts.segment_count() <= f.segment)
      return Error{name + ": there is no segment " + std::to_string(f.segment)};
    if (!all_finite(f.press)) return Error{name + " has a direction that is not finite"};
    Finger<Scalar> finger;
    finger.contact.friction = f.friction;
    finger.max_normal_force = f.max_normal_force;
    if (const std::string bad = finger.contact.validate(); !bad.empty())
      return Error{name + " has " + bad};
    if (!is_finite(f.max_normal_force) || !(Scalar(0) < f.max_normal_force))
      return Error{name + " has the largest normal force " + number_text(f.max_normal_force) +
                   ", must be finite and positive"};
    for (const auto& held : contacts.held(f.segment)) {
      if (held.vertex >= x.cols())
        return Error{name + " holds vertex " + std::to_string(held.vertex) + " off a mesh of " +
                     std::to_string(x.cols()) + " vertices"};
      if (!all_finite(x.col(held.vertex)))
        return Error{name + " holds vertex " + std::to_string(held.vertex) +
                     ", which is not finite"};
      finger.vertices.push_back(held.vertex);
    }
    if (finger.vertices.empty()) continue;
    around.clear();
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      bool held = false;
      for (const int corner : triangles[t]) {
        if (corner < 0 || x.cols() <= corner)
          return Error{"a triangle has vertex " + std::to_string(corner) + " off a mesh of " +
                       std::to_string(x.cols()) + " vertices"};
        for (const int v : finger.vertices) held = held || v == corner;
      }
      if (!held) continue;
      around.push_back(static_cast<int>(t));
      for (const int corner : triangles[t]) {
        if (!all_finite(x.col(corner)))
          return Error{name + " holds the sheet where it is not finite"};
      }
    }
    const Vector3<Scalar> front = vertex_normal<Scalar>(x, triangles, around, out.fallback_normal);
    finger.side = front.dot(f.press) < Scalar(0) ? Scalar(-1) : Scalar(1);
    out.fingers.push_back(std::move(finger));
  }
  if (out.fingers.empty()) return Error{"no finger holds a vertex of the sheet"};
  return out;
}

/// Lets a grip hold only the vertex nearest to the middle of all that it holds, at x (3×n, m; all
/// of its vertices are columns), by the fingers that hold any. A pinch is nearly a point: how a few
/// vertices close to each other turn says little of what fingers can do, and rollouts of such
/// patches diverge. Allocates.
template <RealScalar Scalar>
void keep_middle(Grip<Scalar>& grip, const PointsView<Scalar>& x) {
  const std::vector<int> held = grip.vertices();
  if (held.empty()) return;
  Vector3<Scalar> middle = Vector3<Scalar>::Constant(Scalar(0));
  for (const int v : held) middle += x.col(v) / Scalar(static_cast<double>(held.size()));
  int nearest = held.front();
  for (const int v : held) {
    const Vector3<Scalar> way = x.col(v) - middle, least = x.col(nearest) - middle;
    if (way.squaredNorm() < least.squaredNorm()) nearest = v;
  }
  for (Finger<Scalar>& f : grip.fingers) {
    if (!f.vertices.empty()) f.vertices = {nearest};
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI
