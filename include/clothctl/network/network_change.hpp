#pragma once

// Moves a spring network to a mesh that was torn, cut or sewn. The network itself says what the
// sheet is made of (detail/old_network.hpp), so no material is needed, and networks that were
// changed by hand stay as they are where the mesh does not change. Each triangle owns a share of
// what lies on it:
//
//   mass      of a vertex: shared by its triangles as their areas. Copies of the vertex keep the
//             shares of their triangles. A divided triangle spreads its mass evenly over its area.
//   spring    on an edge: shared by its two triangles as their areas. Where the edge opens, each
//             copy keeps the share of its triangle; a part of length l' and area A' of an edge of
//             length l and area A has the stiffness k (A'/A) (l/l')².
//             An edge inside a divided triangle gets κ A'/l'² with the mean modulus κ of the
//             triangle.
//   hinge     moves with its two triangles; where they changed, cotangent weights are computed
//             anew, with the same bending modulus and rest fold. It is gone where the edge has
//             opened, and beside a triangle without area, which has no normal. New edges and seams
//             rest flat.
//   element   of a triangle goes to the parts of the triangle, with its moduli.
//
// Springs and stencils that span several edges live as long as the edges below them hold together:
//
//   the diagonal of a cell of a grid that is no edge of the mesh (a shear spring): as long as both
//             triangles of the cell are whole and share their edge. A cell that is torn or cut
//             loses it. The other diagonal is an edge of the mesh, so each half of the cell keeps
//             its share of it.
//   stencil 1,-2,1 and springs two edges long: as long as both edges are whole and meet at the
//             same copy of the vertex between. If a row is torn lengthwise, both borders get a full
//             one, as sheet_network gives a border; at the tip of a slit, where two rows share the
//             middle vertex, each gets half. In a cut cell, hinges replace the stencils that have
//             gone.
//   a seam, and anything else not on the mesh: stays with the first copies of its vertices. A seam
//             spring between vertices that were joined is gone.
//
// The network of a torn triangle mesh is the one that sheet_network makes of the torn mesh; a grid
// that is torn along a whole row becomes the two grids.

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/mesh/mesh_editor.hpp"
#include "clothctl/mesh/stitch.hpp"
#include "clothctl/network/detail/element_transfer.hpp"
#include "clothctl/network/detail/network_transfer.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A network after a change, and how its vertices came from the old ones.
template <RealScalar Scalar>
struct NetworkChange {
  /// The changed network.
  SpringNetwork<Scalar> network;
  /// From the old vertices and triangles to the new ones.
  Remap<Scalar> remap;
};

/// Moves a network to its changed mesh. `removed_springs` are left out, with the stencils that span
/// them if they are on no edge of the mesh (a rope). Mass and rest area stay the same up to
/// rounding. Springs keep their order, new ones follow; parallel springs of one kind become one
/// where an edge changed. Allocates. Complexity: O(n log n). Fails when: the network or its mesh is
/// not valid, the change does not start from its triangles, or an index of `removed_springs` is not
/// one of its springs.
template <RealScalar Scalar>
Result<NetworkChange<Scalar>> change_network(const SpringNetwork<Scalar>& network,
                                             MeshChange<Scalar> change,
                                             const std::vector<int>& removed_springs = {}) {
  if (std::string problem = network.validate(); !problem.empty()) return Error{std::move(problem)};
  const Result<Topology> before = make_topology(network.vertex_count(), network.triangles);
  if (!before) return Error{before.error()};
  if (change.remap.old_vertex_count() != network.vertex_count() ||
      change.remap.old_triangle_count() != static_cast<Index>(network.triangles.size()) ||
      change.remap.triangle_count() != static_cast<Index>(change.triangles.size()))
    return Error{"the change starts from a mesh of " +
                 std::to_string(change.remap.old_vertex_count()) + " vertices and " +
                 std::to_string(change.remap.old_triangle_count()) +
                 " triangles, the network has " + std::to_string(network.vertex_count()) + " and " +
                 std::to_string(network.triangles.size())};
  const Result<Topology> after = make_topology(change.remap.vertex_count(), change.triangles);
  if (!after) return Error{after.error()};
  std::vector<unsigned char> removed(network.springs.size(), 0);
  for (const int s : removed_springs) {
    if (s < 0 || s >= static_cast<int>(removed.size()))
      return Error{"spring " + std::to_string(s) + " is not one of " +
                   std::to_string(removed.size()) + " springs"};
    removed[static_cast<std::size_t>(s)] = 1;
  }
  NetworkChange<Scalar> out;
  const detail::OldNetwork<Scalar> old(network, before.value());
  out.network = detail::NetworkTransfer<Scalar>(old, change, after.value(), removed).run();
  out.network.elements = detail::move_elements(network, change);
  if (std::string problem = out.network.validate(); !problem.empty())
    return Error{"after the change: " + problem};
  out.remap = std::move(change.remap);
  return out;
}

/// Joins pairs of border vertices of a network. A joined vertex has the sum of their masses and,
/// through the remap, the mean of their positions and velocities by mass, so that the momentum
/// stays the same; rest lengths do not change. The seam gets the mean bending stiffness of its two
/// sides. Allocates. Fails when: `stitch_vertices` or `change_network` fails.
template <RealScalar Scalar>
Result<NetworkChange<Scalar>> stitch_network(const SpringNetwork<Scalar>& network,
                                             const std::vector<std::array<int, 2>>& pairs) {
  if (std::string problem = network.validate(); !problem.empty()) return Error{std::move(problem)};
  Result<MeshChange<Scalar>> change =
      stitch_vertices<Scalar>(network.vertex_count(), network.triangles, pairs, network.mass);
  if (!change) return Error{change.error()};
  return change_network(network, std::move(change).value());
}

}  // namespace clothctl::inline CLOTHCTL_ABI
