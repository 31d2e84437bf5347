#pragma once

// Who holds the sheet where. A hand's grip is a few fingers; a finger presses a patch of vertices from one side of the
// sheet with a friction cone and a limit on its normal force. Two opposed fingers on the same patch make a pinch.

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include <Eigen/Geometry>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl {

/// One finger on a patch of vertices.
template <RealScalar Scalar>
struct Finger {
  /// The vertices it holds.
  std::vector<int> vertices;
  /// +1: its contact normal is the sheet's front normal (it pushes from behind); -1: the opposite.
  Scalar side = Scalar(1);
  /// Friction coefficient μ.
  Scalar friction = Scalar(0.5);
  /// Largest normal force over the whole patch, N.
  Scalar limit = Scalar(20);
  /// Generators of each vertex's friction cone, at least 4.
  int generators = 4;
};

/// The fingers of one hand on the sheet.
template <RealScalar Scalar>
struct Grip {
  /// Its fingers.
  std::vector<Finger<Scalar>> fingers;
  /// Contact normal where no triangle of the sheet gives one (a rope), unit.
  Vector3<Scalar> fallback_normal = Vector3<Scalar>(Scalar(0), Scalar(1), Scalar(0));

  /// The vertices held by any finger, ascending. Allocates.
  std::vector<int> vertices() const {
    std::vector<int> all;
    for (const Finger<Scalar>& f : fingers) all.insert(all.end(), f.vertices.begin(), f.vertices.end());
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    return all;
  }
};

/// A pinch of `vertices` between two opposed fingers. Allocates.
template <RealScalar Scalar>
Grip<Scalar> make_pinch(const std::vector<int>& vertices, Scalar friction, Scalar limit, int generators = 4) {
  Grip<Scalar> grip;
  for (Scalar side : {Scalar(1), Scalar(-1)}) grip.fingers.push_back({vertices, side, friction, limit, generators});
  return grip;
}

/// Checks grips on a mesh of `vertex_count` vertices. Returns an empty string, or a line that names the first bad item.
template <RealScalar Scalar>
std::string check_grips(const std::vector<Grip<Scalar>>& grips, Index vertex_count) {
  if (grips.empty()) return "there are no grips";
  std::vector<int> owner(static_cast<std::size_t>(vertex_count), -1);
  for (std::size_t g = 0; g < grips.size(); ++g) {
    const std::string grip = "grip " + std::to_string(g);
    if (grips[g].fingers.empty()) return grip + " has no fingers";
    const Scalar length = grips[g].fallback_normal.squaredNorm();
    if (!all_finite(grips[g].fallback_normal) || length < Scalar(0.99) || Scalar(1.01) < length)
      return grip + " has a fallback normal that is not a unit vector";
    for (std::size_t f = 0; f < grips[g].fingers.size(); ++f) {
      const Finger<Scalar>& finger = grips[g].fingers[f];
      const std::string name = grip + " finger " + std::to_string(f);
      if (finger.vertices.empty()) return name + " holds no vertices";
      for (std::size_t i = 0; i < finger.vertices.size(); ++i) {
        const int v = finger.vertices[i];
        if (v < 0 || v >= vertex_count)
          return name + " holds vertex " + std::to_string(v) + ", off a mesh of " + std::to_string(vertex_count) + " vertices";
        if (std::find(finger.vertices.begin(), finger.vertices.begin() + static_cast<std::ptrdiff_t>(i), v) !=
            finger.vertices.begin() + static_cast<std::ptrdiff_t>(i)) {
          return name + " holds vertex " + std::to_string(v) + " twice";
        }
        int& other = owner[static_cast<std::size_t>(v)];
        if (other >= 0 && other != static_cast<int>(g))
          return name + " holds vertex " + std::to_string(v) + ", which grip " + std::to_string(other) + " holds already";
        other = static_cast<int>(g);
      }
      if (!is_finite(finger.friction) || finger.friction < Scalar(0)) {
        return name + " has the friction coefficient " + number_text(finger.friction) + ", must be finite and not negative";
      }
      if (!is_finite(finger.limit) || !(Scalar(0) < finger.limit))
        return name + " has the grip limit " + number_text(finger.limit) + ", must be finite and positive";
      if (!is_finite(finger.side) || (!(finger.side == Scalar(1)) && !(finger.side == Scalar(-1))))
        return name + " has the side " + number_text(finger.side) + ", must be +1 or -1";
      if (finger.generators < 4) return name + " has " + std::to_string(finger.generators) + " generators, needs at least 4";
    }
  }
  return {};
}

/// Unit normal at a vertex from the triangles around it, weighted by area; `fallback` where they cancel or there are none.
/// `around` lists the indices of the triangles that hold the vertex. Never allocates.
template <RealScalar Scalar>
Vector3<Scalar> vertex_normal(const PointsView<Scalar>& x, const std::vector<std::array<int, 3>>& triangles,
                              const std::vector<int>& around, const Vector3<Scalar>& fallback) {
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

}  // namespace clothctl
