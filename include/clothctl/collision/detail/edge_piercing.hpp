#pragma once

// Whether an edge p q pierces a triangle a b c: by the signs of the volumes
//
//   V(a, b, c, p) V(a, b, c, q) < 0,    V(p, q, a, b), V(p, q, b, c), V(p, q, c, a) of one sign
//
// Each volume is computed from the vertices in ascending order of their numbers, and the sign
// follows from the order. So all edges and triangles that meet at the same four vertices use the
// same bits, and no edge slips between two triangles that share a side. (Within rounding of a
// corner it can: there the volumes of several sides are decided one by one.) A volume of exactly
// zero counts as positive.

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "clothctl/core/types.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns true when the tetrahedron of four vertices has a positive volume, or none and an even
/// order. `x` are all vertices (3×n).
template <RealScalar Scalar>
bool positive_volume(const PointsView<Scalar>& x, std::array<int, 4> vertex) {
  bool odd = false;
  for (std::size_t i = 1; i < 4; ++i) {
    for (std::size_t j = i; j > 0 && vertex[j] < vertex[j - 1]; --j) {
      std::swap(vertex[j], vertex[j - 1]);
      odd = !odd;
    }
  }
  const Vector3<Scalar> d = x.col(vertex[3]);
  const Vector3<Scalar> a = x.col(vertex[0]) - d, b = x.col(vertex[1]) - d;
  const Vector3<Scalar> c = x.col(vertex[2]) - d;
  const Scalar volume = a.dot(Vector3<Scalar>(b.cross(c)));
  return (volume < Scalar(0)) == odd;
}

/// Returns true when the edge pierces the triangle; they must not share a vertex.
template <RealScalar Scalar>
bool edge_pierces(const PointsView<Scalar>& x, const std::array<int, 2>& edge,
                  const std::array<int, 3>& triangle) {
  const auto [a, b, c] = triangle;
  const auto [p, q] = edge;
  if (positive_volume<Scalar>(x, {a, b, c, p}) == positive_volume<Scalar>(x, {a, b, c, q}))
    return false;
  const bool first = positive_volume<Scalar>(x, {p, q, a, b});
  return positive_volume<Scalar>(x, {p, q, b, c}) == first &&
         positive_volume<Scalar>(x, {p, q, c, a}) == first;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
