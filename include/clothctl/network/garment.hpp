#pragma once

// Spring networks of garments. All rest shapes come from the flat pattern, none from the place of
// the garment in space: a shirt that is wrapped around a body, crumpled, or half sewn has the same
// springs. With areas A and cotangents of the triangles in the pattern (sheet.hpp has the rules):
//
//   edge      l0 = the mean of its lengths in its triangles,  k = Y · Σ A / l0²
//   hinge     the stencil of sheet.hpp with the cotangents and areas of the pattern, and B
//   mass      a third of density · A of each triangle to each of its vertices
//   seam      a spring between the two vertices of each pair, l0 = the thickness of a seam
//
// Y and B are stretch and bending; where they differ along warp and weft, those of the edge's
// directions in its triangles (detail/thread_profile.hpp), by area. The warp runs along the y axis
// of the pattern, as the grain line of a panel does.
//
// Along a closed seam the two triangles of an edge may have different edge lengths l, l' (ease).
// The edge then rests at the mean, and the stencil has the rest error (l - l') along the pattern,
// whose energy is far below that of any visible fold.
//
// `SpringNetwork::rest_positions` are the places of the vertices in space at the start, which
// `rest_state` of a model returns. They are not a shape at rest: the springs may be far from their
// rest lengths there, as those of open seams are. The bending stencils rest flat, unless
// `set_rest_folds` (rest_folds.hpp) lets them rest folded as they are there.

#include <array>
#include <cassert>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/mesh/garment.hpp"
#include "clothctl/mesh/pattern_mesh.hpp"
#include "clothctl/mesh/topology.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The springs that pull a seam together.
template <RealScalar Scalar>
struct SeamSettings {
  /// Stiffness of the spring between the two vertices of a pair, N/m.
  Scalar stiffness = Scalar(1000.0);
  /// Distance at which two sewn vertices come to rest, m. It must be positive: a spring without a
  /// length has no direction.
  Scalar thickness = Scalar(1e-4);
  /// Axial damping time β, s: every spring has a damper d = β k.
  Scalar damping_time = Scalar(0.01);

  /// Returns an empty string when the thickness is positive and the others at least zero, else a
  /// line that names the first bad value.
  std::string validate() const {
    const Scalar zero = Scalar(0);
    if (!is_finite(thickness) || !(zero < thickness))
      return "seam thickness must be positive, got " + number_text(thickness);
    if (!is_finite(stiffness) || stiffness < zero)
      return "seam stiffness must not be negative, got " + number_text(stiffness);
    if (!is_finite(damping_time) || damping_time < zero)
      return "seam damping_time must not be negative, got " + number_text(damping_time);
    return {};
  }
};

namespace detail {

/// Adds a spring along each edge of a mesh with the lengths of its pattern. `flat` holds the points
/// of the pattern, 3×m with z = 0.
template <RealScalar Scalar>
void add_pattern_springs(const PatternMesh& mesh, const Points<Scalar>& flat,
                         const Topology& topology, const TriangleMeasures<Scalar>& measures,
                         const Material<Scalar>& material, const EdgeCosines<Scalar>& cosines,
                         SpringNetwork<Scalar>& network) {
  const ThreadProfile<Scalar> modulus = stretch_profile(material);
  network.springs.reserve(topology.edges.size());
  for (const MeshEdge& edge : topology.edges) {
    Scalar area(0.0), sum(0.0);
    const std::size_t sides = edge.is_boundary() ? 1 : 2;
    for (std::size_t k = 0; k < sides; ++k) {
      const std::size_t t = static_cast<std::size_t>(edge.triangle[k]);
      std::size_t i = 0;
      while (mesh.triangles[t][i] != edge.opposite[k]) ++i;
      const std::array<int, 3>& corner = mesh.pattern_triangles[t];
      const Vector3<Scalar> d = flat.col(corner[(i + 1) % 3]) - flat.col(corner[(i + 2) % 3]);
      sum += d.norm();
      area += measures.area[t];
    }
    Spring<Scalar> spring;
    spring.a = edge.a;
    spring.b = edge.b;
    spring.rest_length = sides == 2 ? Scalar(0.5) * sum : sum;
    spring.stiffness =
        edge_stiffness(modulus, edge, mesh.triangles, measures.area, cosines, Scalar(1)) * area /
        (spring.rest_length * spring.rest_length);
    spring.damping = material.damping_time * spring.stiffness;
    network.springs.push_back(spring);
  }
}

}  // namespace detail

/// Makes the spring network of a mesh with a pattern, e.g. a sewn garment or one that was read from
/// a file. Springs have the order of the edges of `make_topology`, stencils that of its hinges.
/// Allocates. Complexity: O(n log n). Fails when: a value of the material is out of range, stretch
/// or bending of warp and weft differ by more than a factor of 5, the mesh has no pattern (use
/// `sheet_network`), `mesh.validate()` finds a fault, the mesh is no manifold, a triangle has no
/// area in the pattern or is clockwise there, or a vertex belongs to no triangle.
template <RealScalar Scalar>
Result<SpringNetwork<Scalar>> pattern_network(const PatternMesh& mesh,
                                              const Material<Scalar>& material) {
  if (std::string problem = material.validate(); !problem.empty()) return Error{problem};
  if (std::string problem = mesh.validate(); !problem.empty()) return Error{problem};
  if (!mesh.has_pattern()) return Error{"mesh has no pattern"};
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.pattern_area(t) < 0)
      return Error{"triangle " + std::to_string(t) + " is clockwise in the pattern"};
  }
  const Result<Topology> topology = make_topology(mesh.positions.cols(), mesh.triangles);
  if (!topology) return Error{topology.error()};

  Points<Scalar> flat(3, mesh.pattern.cols());
  for (Index v = 0; v < flat.cols(); ++v)
    flat.col(v) =
        Vector3<Scalar>(Scalar(mesh.pattern(0, v)), Scalar(mesh.pattern(1, v)), Scalar(0));
  const auto measured = detail::measure_triangles(flat, mesh.pattern_triangles);
  if (!measured) return Error{measured.error() + " in the pattern"};
  SpringNetwork<Scalar> network;
  network.triangles = mesh.triangles;
  network.mass = VectorX<Scalar>::Zero(mesh.positions.cols());
  network.rest_positions.resize(3, mesh.positions.cols());
  for (Index i = 0; i < mesh.positions.size(); ++i)
    network.rest_positions.data()[i] = Scalar(mesh.positions.data()[i]);
  if (std::string problem = detail::lump_mass(measured->area, material.area_density, network);
      !problem.empty())
    return Error{problem};
  const Vector3<Scalar> warp(Scalar(0), Scalar(1), Scalar(0));
  const auto cosines = detail::edge_cosines<Scalar>(flat, mesh.pattern_triangles, material, warp);
  if (!cosines) return Error{cosines.error()};
  detail::add_pattern_springs(mesh, flat, *topology, *measured, material, *cosines, network);
  detail::add_bending(*topology, *measured, material, *cosines, network);
  if (std::string problem = network.validate(); !problem.empty()) return Error{problem};
  return network;
}

/// Makes the spring network of a garment with open seams: that of its panels, then a spring of kind
/// `SpringKind::Seam` for each pair of vertices, seam after seam. Allocates. Complexity: O(n log
/// n). Fails when: `seams.validate()` finds a fault, a seam holds a vertex off the mesh or joins
/// one to itself, or `pattern_network` fails.
template <RealScalar Scalar>
Result<SpringNetwork<Scalar>> sewing_network(const Garment& garment,
                                             const Material<Scalar>& material,
                                             const SeamSettings<Scalar>& seams = {}) {
  if (std::string problem = seams.validate(); !problem.empty()) return Error{problem};
  Result<SpringNetwork<Scalar>> network = pattern_network(garment.mesh, material);
  if (!network) return network;
  for (const std::vector<std::array<int, 2>>& seam : garment.seams) {
    for (const std::array<int, 2>& pair : seam)
      network->springs.push_back(Spring<Scalar>{pair[0], pair[1], seams.thickness, seams.stiffness,
                                                seams.damping_time * seams.stiffness,
                                                SpringKind::Seam});
  }
  if (std::string problem = network->validate(); !problem.empty()) return Error{problem};
  return network;
}

/// Gives each seam spring the rest length `share` times the present distance of its vertices, but
/// at least `thickness` (m). With a share that falls from 1 to 0 over a second or two, the sewing
/// of a garment stays gentle. `positions` is 3×n, m. Fails when: positions has another number of
/// columns than the network has vertices (assert).
template <RealScalar Scalar>
void set_seam_lengths(SpringNetwork<Scalar>& network,
                      const std::type_identity_t<PointsView<Scalar>>& positions, Scalar share,
                      Scalar thickness) {
  assert(positions.cols() == network.vertex_count());
  for (Spring<Scalar>& spring : network.springs) {
    if (spring.kind != SpringKind::Seam) continue;
    const Vector3<Scalar> d = positions.col(spring.b) - positions.col(spring.a);
    const Scalar length = share * d.norm();
    spring.rest_length = thickness < length ? length : thickness;
  }
}

/// Returns the largest distance of two vertices that a seam joins, m; 0 without seams. `positions`
/// is 3×n. Fails when: positions has another number of columns than the garment has vertices
/// (assert).
template <RealScalar Scalar>
Scalar largest_seam_gap(const Garment& garment, const PointsView<Scalar>& positions) {
  assert(positions.cols() == garment.mesh.positions.cols());
  Scalar largest(0.0);
  for (const std::vector<std::array<int, 2>>& seam : garment.seams) {
    for (const std::array<int, 2>& pair : seam) {
      const Vector3<Scalar> d = positions.col(pair[1]) - positions.col(pair[0]);
      const Scalar gap = d.norm();
      if (largest < gap) largest = gap;
    }
  }
  return largest;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
