#pragma once

// Which triangle meshes bound a solid: closed, manifold, oriented outwards, without triangles that
// have no area. Self-intersections are not looked for. Then the pseudonormals that give the sign of
// the distance from such a mesh:
//
//   face    the unit normal n_t of the triangle
//   edge    the mean of the normals of its two triangles
//   vertex  Σ α_t n_t, α_t the angle of triangle t at the vertex
//
// A point x whose closest point q lies on a feature with the pseudonormal n is inside exactly when
// n·(x - q) < 0. The mean of face normals alone would give wrong signs at vertices. Reference:
// Bærentzen, Aanæs, Signed distance computation using the angle weighted pseudonormal (2005).

#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/detail/basic_shape.hpp"
#include "clothctl/collision/detail/triangle_point.hpp"
#include "clothctl/mesh/topology.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Finds the root of an element of a forest, and shortens the way to it.
inline int forest_root(std::vector<int>& parent, int i) {
  while (parent[static_cast<std::size_t>(i)] != i) {
    int& up = parent[static_cast<std::size_t>(i)];
    up = parent[static_cast<std::size_t>(up)];
    i = up;
  }
  return i;
}

/// Returns an empty string, or a vertex whose triangles form more than one fan. The mesh is closed.
inline std::string validate_fans(const std::vector<std::array<int, 3>>& triangles,
                                 const Topology& topology) {
  // Corners of triangles; two at a vertex are joined when their triangles share an edge there.
  std::vector<int> parent(3 * triangles.size());
  for (std::size_t i = 0; i < parent.size(); ++i) parent[i] = static_cast<int>(i);
  const auto corner = [&](int triangle, int vertex) {
    int i = 0;
    while (triangles[static_cast<std::size_t>(triangle)][static_cast<std::size_t>(i)] != vertex)
      ++i;
    return 3 * triangle + i;
  };
  for (const MeshEdge& edge : topology.edges) {
    for (const int v : {edge.a, edge.b}) {
      const int p = forest_root(parent, corner(edge.triangle[0], v));
      const int q = forest_root(parent, corner(edge.triangle[1], v));
      parent[static_cast<std::size_t>(p)] = q;
    }
  }
  std::vector<int> fan(topology.neighbour_start.size(), -1);
  for (std::size_t i = 0; i < parent.size(); ++i) {
    const int v = triangles[i / 3][i % 3], root = forest_root(parent, static_cast<int>(i));
    int& known = fan[static_cast<std::size_t>(v)];
    if (known >= 0 && known != root)
      return "vertex " + std::to_string(v) + " joins two parts that share no edge there";
    known = root;
  }
  return {};
}

/// Returns an empty string, or why a mesh with this connectivity bounds no solid.
inline std::string validate_closed(const std::vector<std::array<int, 3>>& triangles,
                                   const Topology& topology) {
  if (triangles.empty()) return "it has no triangles";
  if (!topology.boundary_edges.empty()) {
    const MeshEdge& edge =
        topology.edges[static_cast<std::size_t>(topology.boundary_edges.front())];
    return "it is open: edge " + std::to_string(edge.a) + "-" + std::to_string(edge.b) +
           " belongs to triangle " + std::to_string(edge.triangle[0]) + " alone";
  }
  for (const MeshEdge& edge : topology.edges) {
    const auto forward = [&](int t) {
      const std::array<int, 3>& c = triangles[static_cast<std::size_t>(t)];
      return (c[0] == edge.a && c[1] == edge.b) || (c[1] == edge.a && c[2] == edge.b) ||
             (c[2] == edge.a && c[0] == edge.b);
    };
    if (forward(edge.triangle[0]) == forward(edge.triangle[1]))
      return "triangle " + std::to_string(edge.triangle[1]) + " is flipped against triangle " +
             std::to_string(edge.triangle[0]);
  }
  return validate_fans(triangles, topology);
}

/// Returns an empty string, or why the positions (3×n, m) are no solid: a coordinate that is not
/// finite, a triangle without area, or a volume that is not positive. A triangle has no area when
/// it is thinner than rounding: its least height is below 1e3 ε of its longest side.
template <RealScalar Scalar>
std::string validate_solid(const Points<Scalar>& x,
                           const std::vector<std::array<int, 3>>& triangles) {
  using std::sqrt;
  for (Index v = 0; v < x.cols(); ++v) {
    const std::string name = "vertex " + std::to_string(v);
    if (std::string bad = validate_point<Scalar>(name.c_str(), x.col(v)); !bad.empty())
      return "it has " + bad.substr(4);
  }
  Scalar volume(0);
  const Vector3<Scalar> origin = x.col(triangles[0][0]);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const Vector3<Scalar> a = x.col(triangles[t][0]) - origin, b = x.col(triangles[t][1]) - origin,
                          c = x.col(triangles[t][2]) - origin;
    const Vector3<Scalar> ab = b - a, bc = c - b, ca = a - c;
    Scalar longest = ab.squaredNorm();
    if (longest < bc.squaredNorm()) longest = bc.squaredNorm();
    if (longest < ca.squaredNorm()) longest = ca.squaredNorm();
    const Scalar doubled = length_of<Scalar>(ab.cross(Vector3<Scalar>(c - a)));
    if (!(Scalar(1000) * scalar_traits<Scalar>::epsilon() * longest < doubled))
      return "triangle " + std::to_string(t) + " is degenerate: its area is " +
             number_text(Scalar(Scalar(0.5) * doubled)) + " m^2, its longest side " +
             number_text(Scalar(sqrt(longest))) + " m";
    volume += a.dot(b.cross(c)) / Scalar(6);
  }
  if (Scalar(0) < volume) return {};
  return "it is inverted: its volume is " + number_text(volume) + " m^3";
}

/// The pseudonormals of one triangle, in the order of its corners.
template <RealScalar Scalar>
struct Pseudonormals {
  /// Of the face.
  Vector3<Scalar> face;
  /// Of the edges 0-1, 1-2 and 2-0.
  std::array<Vector3<Scalar>, 3> edge;
  /// Of the corners.
  std::array<Vector3<Scalar>, 3> corner;
};

/// Returns the unit normals (3×triangles) of all triangles. Allocates.
template <RealScalar Scalar>
Points<Scalar> face_normals(const Points<Scalar>& x,
                            const std::vector<std::array<int, 3>>& triangles) {
  Points<Scalar> out(3, static_cast<Index>(triangles.size()));
  for (Index t = 0; t < out.cols(); ++t) {
    const std::array<int, 3>& c = triangles[static_cast<std::size_t>(t)];
    out.col(t) = triangle_frame<Scalar>(x.col(c[0]), x.col(c[1]), x.col(c[2])).normal;
  }
  return out;
}

/// Returns the pseudonormals of all triangles of a closed mesh, whose unit normals are `face`
/// (3×triangles). Allocates.
template <RealScalar Scalar>
std::vector<Pseudonormals<Scalar>> pseudonormals(const Points<Scalar>& x,
                                                 const std::vector<std::array<int, 3>>& triangles,
                                                 const Topology& topology,
                                                 const Points<Scalar>& face) {
  using std::atan2;
  std::vector<Pseudonormals<Scalar>> out(triangles.size());
  std::vector<Vector3<Scalar>> vertex(static_cast<std::size_t>(x.cols()),
                                      Vector3<Scalar>::Constant(Scalar(0)));
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      const Index a = triangles[t][i], b = triangles[t][(i + 1) % 3], c = triangles[t][(i + 2) % 3];
      const Vector3<Scalar> ab = x.col(b) - x.col(a), ac = x.col(c) - x.col(a);
      out[t].face = face.col(static_cast<Index>(t));
      const Scalar angle = atan2(length_of<Scalar>(ab.cross(ac)), ab.dot(ac));
      vertex[static_cast<std::size_t>(a)] += angle * out[t].face;
    }
  }
  for (Vector3<Scalar>& n : vertex) n = unit_or_zero<Scalar>(n);
  for (const MeshEdge& edge : topology.edges) {
    const Vector3<Scalar> sum = out[static_cast<std::size_t>(edge.triangle[0])].face +
                                out[static_cast<std::size_t>(edge.triangle[1])].face;
    const Vector3<Scalar> normal = unit_or_zero<Scalar>(sum);
    for (std::size_t k = 0; k < 2; ++k) {
      const std::size_t t = static_cast<std::size_t>(edge.triangle[k]);
      // The edge lies across from the corner that is not on it.
      std::size_t i = 0;
      while (triangles[t][i] != edge.opposite[k]) ++i;
      out[t].edge[(i + 1) % 3] = normal;
    }
  }
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i)
      out[t].corner[i] = vertex[static_cast<std::size_t>(triangles[t][i])];
  }
  return out;
}

/// As above, with the normals of the positions.
template <RealScalar Scalar>
std::vector<Pseudonormals<Scalar>> pseudonormals(const Points<Scalar>& x,
                                                 const std::vector<std::array<int, 3>>& triangles,
                                                 const Topology& topology) {
  return pseudonormals<Scalar>(x, triangles, topology, face_normals<Scalar>(x, triangles));
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
