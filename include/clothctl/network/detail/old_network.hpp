#pragma once

// What a spring network says about its material, triangle by triangle, so that parts of a triangle
// get the share of it. With A the area of a triangle, l the rest length of an edge, k the stiffness
// of its springs and kb that of a bending stencil:
//
//   stretch modulus of an edge   κ = k l² / Σ A         over the one or two triangles at the edge
//   bending modulus of an edge   B = kb Σ A             from the stencil of its hinge, or
//                                B = kb l⁴ / (2 A̅)      from a stencil in a row through the edge,
//                                                       A̅ the mean area of its triangles
//
// sheet_network makes networks in which κ is `stretch` on every edge between vertices in a row and
// B is `bending`. The moduli of a triangle are the means of those of its edges that have them.

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "clothctl/mesh/topology.hpp"
#include "clothctl/network/spring_network.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What one edge of the mesh carries.
template <RealScalar Scalar>
struct EdgeContent {
  /// Sum of the areas of the triangles at the edge, m².
  Scalar area = Scalar(0);
  /// Distance of its ends at rest, m.
  Scalar length = Scalar(0);
  /// The springs on the edge, without seams.
  std::vector<int> springs = {};
  /// The stencils of its hinge.
  std::vector<int> hinges = {};
  /// Stretch modulus κ, N/m; 0 without springs.
  Scalar stretch = Scalar(0);
  /// Damping time β of its springs, s.
  Scalar damping_time = Scalar(0);
  /// Mean of the springs' rest length over the rest distance.
  Scalar slack = Scalar(1);
  /// Bending modulus B, N m; 0 when no stencil runs across or along the edge.
  Scalar bending = Scalar(0);
};

/// The moduli of a triangle: means over its edges.
template <RealScalar Scalar>
struct TriangleContent {
  Scalar area = Scalar(0);
  Scalar stretch = Scalar(0), damping_time = Scalar(0), slack = Scalar(1), bending = Scalar(0);
};

/// A stencil over three vertices in a row, whose edges are edges of the mesh.
struct RowStencil {
  int stencil = 0;
  /// Position in the stencil of its middle vertex and of the other two.
  std::array<std::size_t, 3> place{};
  /// The edges from the middle vertex to the other two.
  std::array<int, 2> edge{};
};

/// A network with its springs and stencils assigned to the edges of its mesh.
template <RealScalar Scalar>
class OldNetwork {
 public:
  /// Takes a valid network and the topology of its triangles; both must outlive this. Allocates.
  OldNetwork(const SpringNetwork<Scalar>& network, const Topology& topology)
      : network_(network), topology_(topology) {
    measure();
    assign_springs();
    assign_stencils();
    average();
  }

  const SpringNetwork<Scalar>& network() const { return network_; }
  const Topology& topology() const { return topology_; }
  const EdgeContent<Scalar>& edge(int e) const { return edges_[static_cast<std::size_t>(e)]; }
  const TriangleContent<Scalar>& triangle(int t) const {
    return triangles_[static_cast<std::size_t>(t)];
  }
  /// Area of all triangles around a vertex, m², and their number.
  const Scalar& area_around(int v) const { return around_[static_cast<std::size_t>(v)]; }
  int count_around(int v) const { return count_around_[static_cast<std::size_t>(v)]; }
  /// Springs that are on no edge of the mesh, and seams.
  const std::vector<int>& free_springs() const { return free_springs_; }
  /// Stencils over three vertices in a row.
  const std::vector<RowStencil>& rows() const { return rows_; }
  /// Stencils that are neither on a hinge nor on a row.
  const std::vector<int>& free_stencils() const { return free_stencils_; }

  /// Returns the index of the edge a-b, or -1.
  int find_edge(int a, int b) const {
    const std::array<int, 2> key{(std::min)(a, b), (std::max)(a, b)};
    const auto at = std::lower_bound(topology_.edges.begin(), topology_.edges.end(), key,
                                     [](const MeshEdge& e, const std::array<int, 2>& k) {
                                       return e.a != k[0] ? e.a < k[0] : e.b < k[1];
                                     });
    if (at == topology_.edges.end() || at->a != key[0] || at->b != key[1]) return -1;
    return static_cast<int>(at - topology_.edges.begin());
  }

  /// Returns true when an edge lies between two triangles with the opposite vertices a and b.
  bool spans(int e, int a, int b) const {
    const std::array<int, 2>& o = topology_.edges[static_cast<std::size_t>(e)].opposite;
    return (o[0] == a && o[1] == b) || (o[0] == b && o[1] == a);
  }

 private:
  void measure() {
    around_.assign(static_cast<std::size_t>(network_.vertex_count()), Scalar(0));
    count_around_.assign(around_.size(), 0);
    for (const std::array<int, 3>& corner : network_.triangles) {
      const Vector3<Scalar> x = network_.rest_positions.col(corner[0]);
      const Vector3<Scalar> u = network_.rest_positions.col(corner[1]) - x;
      const Vector3<Scalar> w = network_.rest_positions.col(corner[2]) - x;
      TriangleContent<Scalar> content;
      content.area = Scalar(0.5) * u.cross(w).norm();
      triangles_.push_back(content);
      for (const int v : corner) {
        around_[static_cast<std::size_t>(v)] += content.area;
        ++count_around_[static_cast<std::size_t>(v)];
      }
    }
    for (const MeshEdge& e : topology_.edges) {
      EdgeContent<Scalar> content;
      content.area = triangle(e.triangle[0]).area;
      if (!e.is_boundary()) content.area += triangle(e.triangle[1]).area;
      content.length = (network_.rest_positions.col(e.b) - network_.rest_positions.col(e.a)).norm();
      edges_.push_back(std::move(content));
    }
  }

  void assign_springs() {
    for (std::size_t s = 0; s < network_.springs.size(); ++s) {
      const Spring<Scalar>& spring = network_.springs[s];
      const int e = spring.kind == SpringKind::Seam ? -1 : find_edge(spring.a, spring.b);
      if (e < 0) {
        free_springs_.push_back(static_cast<int>(s));
        continue;
      }
      EdgeContent<Scalar>& content = edges_[static_cast<std::size_t>(e)];
      content.springs.push_back(static_cast<int>(s));
    }
    for (EdgeContent<Scalar>& content : edges_) {
      Scalar stiffness = Scalar(0), damping = Scalar(0), slack = Scalar(0);
      for (const int s : content.springs) {
        const Spring<Scalar>& spring = network_.springs[static_cast<std::size_t>(s)];
        stiffness += spring.stiffness;
        damping += spring.damping;
        slack += spring.rest_length;
      }
      if (Scalar(0) < content.area)
        content.stretch = stiffness * content.length * content.length / content.area;
      if (Scalar(0) < stiffness) content.damping_time = damping / stiffness;
      if (Scalar(0) < content.length && !content.springs.empty())
        content.slack =
            slack / (content.length * Scalar(static_cast<double>(content.springs.size())));
    }
  }

  /// Returns the edge whose hinge a stencil is on, or -1.
  int hinge_of(const BendStencil<Scalar>& stencil) const {
    const int e = stencil.count == 4 ? find_edge(stencil.vertex[0], stencil.vertex[1]) : -1;
    return e >= 0 && spans(e, stencil.vertex[2], stencil.vertex[3]) ? e : -1;
  }

  /// Returns true when a stencil runs along two edges of the mesh, and which.
  bool row_of(const BendStencil<Scalar>& stencil, RowStencil& row) const {
    if (stencil.count != 3) return false;
    for (const std::size_t middle : {std::size_t(1), std::size_t(0), std::size_t(2)}) {
      row.place = {middle, (middle + 2) % 3, (middle + 1) % 3};
      const auto& v = stencil.vertex;
      row.edge = {find_edge(v[middle], v[row.place[1]]), find_edge(v[middle], v[row.place[2]])};
      if (row.edge[0] >= 0 && row.edge[1] >= 0) return true;
    }
    return false;
  }

  void assign_stencils() {
    std::vector<int> counts(edges_.size(), 0);
    for (std::size_t b = 0; b < network_.bends.size(); ++b) {
      const BendStencil<Scalar>& stencil = network_.bends[b];
      RowStencil row;
      row.stencil = static_cast<int>(b);
      if (const int e = hinge_of(stencil); e >= 0) {
        EdgeContent<Scalar>& content = edges_[static_cast<std::size_t>(e)];
        content.hinges.push_back(row.stencil);
        content.bending += stencil.stiffness * content.area;
        counts[static_cast<std::size_t>(e)] = 1;
      } else if (row_of(stencil, row)) {
        rows_.push_back(row);
      } else {
        free_stencils_.push_back(row.stencil);
      }
    }
    for (const RowStencil& row : rows_) {
      for (const int e : row.edge) {
        EdgeContent<Scalar>& content = edges_[static_cast<std::size_t>(e)];
        if (!content.hinges.empty() || !(Scalar(0) < content.area)) continue;
        const bool border = topology_.edges[static_cast<std::size_t>(e)].is_boundary();
        const Scalar both = border ? Scalar(2) * content.area : content.area;
        const Scalar l = content.length;
        content.bending +=
            network_.bends[static_cast<std::size_t>(row.stencil)].stiffness * l * l * l * l / both;
        ++counts[static_cast<std::size_t>(e)];
      }
    }
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (counts[e] > 1) edges_[e].bending /= Scalar(static_cast<double>(counts[e]));
    }
  }

  void average() {
    std::vector<std::array<double, 2>> counts(triangles_.size(), {0.0, 0.0});
    for (TriangleContent<Scalar>& t : triangles_) t.slack = Scalar(0);
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      for (const int index : topology_.edges[e].triangle) {
        if (index < 0) continue;
        TriangleContent<Scalar>& t = triangles_[static_cast<std::size_t>(index)];
        std::array<double, 2>& count = counts[static_cast<std::size_t>(index)];
        if (!edges_[e].springs.empty()) {
          t.stretch += edges_[e].stretch;
          t.damping_time += edges_[e].damping_time;
          t.slack += edges_[e].slack;
          count[0] += 1.0;
        }
        if (Scalar(0) < edges_[e].bending) {
          t.bending += edges_[e].bending;
          count[1] += 1.0;
        }
      }
    }
    for (std::size_t i = 0; i < triangles_.size(); ++i) {
      TriangleContent<Scalar>& t = triangles_[i];
      if (counts[i][0] > 0.0) {
        const Scalar share = Scalar(1.0 / counts[i][0]);
        t.stretch *= share;
        t.damping_time *= share;
        t.slack *= share;
      }
      if (counts[i][1] > 0.0) t.bending *= Scalar(1.0 / counts[i][1]);
    }
  }

  const SpringNetwork<Scalar>& network_;
  const Topology& topology_;
  std::vector<EdgeContent<Scalar>> edges_;
  std::vector<TriangleContent<Scalar>> triangles_;
  std::vector<Scalar> around_;
  std::vector<int> count_around_;
  std::vector<int> free_springs_, free_stencils_;
  std::vector<RowStencil> rows_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
