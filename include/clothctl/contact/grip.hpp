#pragma once

// Which vertices of the sheet are held, and by whom. The grip of a hand consists of fingers; a
// finger presses a patch of vertices from one side of the sheet. Its contact model says which
// forces it can transmit, and its normal force is limited. Two opposed fingers on the same patch
// make a pinch.

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "clothctl/config.hpp"
#include "clothctl/contact/contact_models.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/mesh/remap.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// One finger on a patch of vertices.
template <RealScalar Scalar, ContactModel<Scalar> Contact = HardFinger<Scalar>>
struct Finger {
  /// The vertices that it holds.
  std::vector<int> vertices;
  /// +1: the contact normal is the sheet's front normal (the finger pushes from behind); -1: the
  /// opposite.
  Scalar side = Scalar(1);
  /// The forces that it can transmit.
  Contact contact = {};
  /// Largest normal force over the whole patch, N.
  Scalar max_normal_force = Scalar(20);
};

/// The force of one finger on one vertex, as planned and sent.
template <RealScalar Scalar>
struct FingerForce {
  /// Index of the grip.
  int grip = 0;
  /// Index of the finger within the grip.
  int finger = 0;
  /// The vertex.
  int vertex = 0;
  /// Contact normal from the finger into the sheet, unit.
  Vector3<Scalar> normal = Vector3<Scalar>::Zero();
  /// Force on the sheet, N.
  Vector3<Scalar> force = Vector3<Scalar>::Zero();
};

/// The fingers of one hand on the sheet.
template <RealScalar Scalar, ContactModel<Scalar> Contact = HardFinger<Scalar>>
struct Grip {
  /// Its fingers.
  std::vector<Finger<Scalar, Contact>> fingers;
  /// Contact normal where no triangle of the sheet defines one (a rope), unit.
  Vector3<Scalar> fallback_normal = Vector3<Scalar>(Scalar(0), Scalar(1), Scalar(0));

  /// Returns the vertices that any finger holds, ascending. Allocates.
  std::vector<int> vertices() const {
    std::vector<int> all;
    for (const Finger<Scalar, Contact>& f : fingers)
      all.insert(all.end(), f.vertices.begin(), f.vertices.end());
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    return all;
  }
};

/// Makes a pinch of `vertices` between two opposed fingers of the same contact model. Allocates.
template <RealScalar Scalar, ContactModel<Scalar> Contact>
Grip<Scalar, Contact> make_pinch(const std::vector<int>& vertices, const Contact& contact,
                                 std::type_identity_t<Scalar> max_normal_force) {
  Grip<Scalar, Contact> grip;
  for (Scalar side : {Scalar(1), Scalar(-1)})
    grip.fingers.push_back({vertices, side, contact, max_normal_force});
  return grip;
}

/// Makes a pinch between two hard fingers with a friction coefficient, a limit on the normal force
/// of each (N) and the number of generators of the friction pyramid. Allocates.
template <RealScalar Scalar>
Grip<Scalar> make_pinch(const std::vector<int>& vertices, Scalar friction, Scalar max_normal_force,
                        int pyramid = 4) {
  return make_pinch<Scalar>(vertices, HardFinger<Scalar>{friction, pyramid}, max_normal_force);
}

/// Returns an empty string, or what is wrong with the half-space n · x <= most, to be put after its
/// name. Allocates.
template <RealScalar Scalar>
std::string validate_half_space(const Vector3<Scalar>& normal, const Scalar& most) {
  if (!is_unit(normal)) return " has a normal that is not a unit vector";
  if (!is_finite(most)) return " is " + number_text(most) + " m, must be finite";
  return {};
}

/// A half-space for the centroid of a grip, or for the way to it from that of another: what a hand
/// can reach, how far the fingers of a hand can part, a wall. `Planner::set_limits`.
template <RealScalar Scalar>
struct GripLimit {
  /// The grip.
  int grip = 0;
  /// The grip from which it is measured, or -1 for the origin of the world.
  int other = -1;
  /// Direction of the limit, unit, world.
  Vector3<Scalar> normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
  /// The largest part of the centroid, or way, along it, m.
  Scalar most = Scalar(0);

  /// Returns an empty string, or what is wrong with a limit for `grips` grips, to be put after its
  /// name. Allocates.
  std::string validate(int grips) const {
    if (grip < 0 || grips <= grip) return " is for grip " + std::to_string(grip);
    if (other < -1 || grips <= other || other == grip)
      return " is measured from grip " + std::to_string(other);
    return validate_half_space(normal, most);
  }
};

namespace detail {

/// Returns an empty string, or what is wrong with the vertices of finger `name` of grip `g`.
/// `owner` holds the index of the grip of each vertex of the mesh, or -1; it is updated.
inline std::string validate_held_vertices(const std::string& name, const std::vector<int>& vertices,
                                          int g, std::vector<int>& owner) {
  if (vertices.empty()) return name + " holds no vertices";
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    const int v = vertices[i];
    if (v < 0 || v >= static_cast<int>(owner.size()))
      return name + " holds vertex " + std::to_string(v) + ", off a mesh of " +
             std::to_string(owner.size()) + " vertices";
    const auto end = vertices.begin() + static_cast<std::ptrdiff_t>(i);
    if (std::find(vertices.begin(), end, v) != end)
      return name + " holds vertex " + std::to_string(v) + " twice";
    int& other = owner[static_cast<std::size_t>(v)];
    if (other >= 0 && other != g)
      return name + " holds vertex " + std::to_string(v) + ", which grip " + std::to_string(other) +
             " holds already";
    other = g;
  }
  return {};
}

/// Returns an empty string, or which axiom of ContactModel a finger on `vertices` vertices breaks.
/// `largest`: its limit on the normal force, N.
template <RealScalar Scalar, class Contact>
std::string validate_contact(const Contact& contact, Index vertices, const Scalar& largest) {
  using Traits = contact_traits<Contact>;
  const Index count = Traits::generators(contact, vertices);
  if (count < 1 || count > 65536) return "has " + std::to_string(count) + " generators";
  for (Index i = 0; i < count; ++i) {
    const auto [first, number] = Traits::support(contact, vertices, i);
    if (first < 0 || number < 1 || first > vertices - number)
      return "has a generator " + std::to_string(i) + " that acts off its " +
             std::to_string(vertices) + " vertices";
    const Scalar share = Traits::normal_share(contact, vertices, i);
    if (!is_finite(share) || !(Scalar(0) < share))
      return "has a generator " + std::to_string(i) + " of normal share " + number_text(share) +
             ", must be finite and positive";
    const Scalar bound = Traits::upper_bound(contact, vertices, i, largest);
    if (!is_finite(bound) || bound < Scalar(0))
      return "has a generator " + std::to_string(i) + " with the upper bound " +
             number_text(bound) + ", must be finite and not negative";
  }
  if constexpr (requires { Traits::adhesion(contact); }) {
    const Scalar pull = static_cast<Scalar>(Traits::adhesion(contact));
    if (!is_finite(pull) || pull < Scalar(0))
      return "has the adhesion " + number_text(pull) + ", must be finite and not negative";
  }
  return {};
}

/// Returns an empty string, or what is wrong with a finger apart from its vertices.
template <RealScalar Scalar, class Contact>
std::string validate_finger(const std::string& name, const Finger<Scalar, Contact>& finger) {
  if (const std::string problem = contact_traits<Contact>::validate(finger.contact);
      !problem.empty())
    return name + " has " + problem;
  if (!is_finite(finger.max_normal_force) || !(Scalar(0) < finger.max_normal_force))
    return name + " has the largest normal force " + number_text(finger.max_normal_force) +
           ", must be finite and positive";
  if (!is_finite(finger.side) || (!(finger.side == Scalar(1)) && !(finger.side == Scalar(-1))))
    return name + " has the side " + number_text(finger.side) + ", must be +1 or -1";
  const std::string broken = validate_contact<Scalar>(
      finger.contact, static_cast<Index>(finger.vertices.size()), finger.max_normal_force);
  return broken.empty() ? broken : name + " " + broken;
}

}  // namespace detail

/// Returns an empty string, or a line that names the first thing that is wrong with grips on a mesh
/// of `vertex_count` vertices. Allocates.
template <RealScalar Scalar, class Contact = HardFinger<Scalar>>
std::string validate_grips(const std::vector<Grip<Scalar, Contact>>& grips, Index vertex_count) {
  if (grips.empty()) return "there are no grips";
  std::vector<int> owner(static_cast<std::size_t>(vertex_count), -1);
  for (std::size_t g = 0; g < grips.size(); ++g) {
    const std::string grip = "grip " + std::to_string(g);
    if (grips[g].fingers.empty()) return grip + " has no fingers";
    const Scalar length = grips[g].fallback_normal.squaredNorm();
    if (!all_finite(grips[g].fallback_normal) || length < Scalar(0.99) || Scalar(1.01) < length)
      return grip + " has a fallback normal that is not a unit vector";
    for (std::size_t f = 0; f < grips[g].fingers.size(); ++f) {
      const std::string name = grip + " finger " + std::to_string(f);
      std::string problem = detail::validate_held_vertices(name, grips[g].fingers[f].vertices,
                                                           static_cast<int>(g), owner);
      if (problem.empty()) problem = detail::validate_finger(name, grips[g].fingers[f]);
      if (!problem.empty()) return problem;
    }
  }
  return {};
}

/// Returns the grips on a sheet after a change of its mesh: a finger holds all copies of the
/// vertices that it held, so a hand that holds both sides of a tear keeps both. Allocates.
template <RealScalar Scalar, class Contact>
std::vector<Grip<Scalar, Contact>> remap_grips(std::vector<Grip<Scalar, Contact>> grips,
                                               const Remap<Scalar>& remap) {
  for (Grip<Scalar, Contact>& grip : grips) {
    for (Finger<Scalar, Contact>& finger : grip.fingers)
      finger.vertices = remap.all_copies(finger.vertices);
  }
  return grips;
}

/// Returns the unit normal at a vertex, or at a few, of positions `x` (3×n): the mean of the
/// triangles around, weighted by area; `fallback` where they cancel or there are none. `around`
/// lists the indices of the triangles that contain a vertex. Never allocates.
template <RealScalar Scalar>
Vector3<Scalar> vertex_normal(const PointsView<Scalar>& x,
                              std::span<const std::array<int, 3>> triangles,
                              std::span<const int> around, const Vector3<Scalar>& fallback) {
  using std::sqrt;
  Vector3<Scalar> sum = Vector3<Scalar>::Zero();
  Scalar size = Scalar(0);
  for (int t : around) {
    const std::array<int, 3>& tri = triangles[static_cast<std::size_t>(t)];
    const Vector3<Scalar> ab = x.col(tri[1]) - x.col(tri[0]);
    const Vector3<Scalar> ac = x.col(tri[2]) - x.col(tri[0]);
    const Vector3<Scalar> area = ab.cross(ac);
    sum += area;
    size += sqrt(area.squaredNorm());
  }
  const Scalar length = sqrt(sum.squaredNorm());
  if (!(Scalar(1e-3) * size < length)) return fallback;
  return sum / length;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
