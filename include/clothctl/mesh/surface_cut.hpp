#pragma once

// Cuts a triangle mesh along a polyline. The points of the polyline that lie on the surface become
// vertices. From a vertex at x the cut goes on towards the next point q in the plane through x that
// holds q - x and the normal m of the surface at x:
//
//   f(u) = ((q - x) × m) · (x_u - x)
//
// An edge u-v opposite to x is crossed at t = f(u) / (f(u) - f(v)) if f changes its sign and the
// crossing lies ahead. A vertex is inserted there, which makes the cut an edge of the mesh; then
// the edges of the cut are opened (mesh_editor.hpp). A crossing closer than the snap distance to an
// end of its edge goes through that end, so no short edges arise. The cut stays on its layer of a
// folded sheet.
//
// Where the polyline leaves the mesh, the cut ends on the border; where the line to the next point
// meets the border again, seen along the normal there, it goes on.

#include <array>
#include <cmath>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/mesh/detail/surface_walk.hpp"
#include "clothctl/mesh/mesh_editor.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a polyline cuts. Distances are in mean edge lengths of the mesh.
template <RealScalar Scalar>
struct CutSettings {
  /// A cut that passes a vertex at a smaller distance along an edge goes through the vertex.
  Scalar snap = Scalar(0.15);
  /// Points of the polyline that are farther than this above or below the surface do not cut it.
  Scalar reach = Scalar(1);

  /// Returns an empty string when all values are good, else a line that names the first bad one.
  std::string validate() const {
    if (!is_finite(snap) || snap < Scalar(0.001) || Scalar(0.5) < snap)
      return "snap must be from 0.001 to 0.5, got " + number_text(snap);
    if (!is_finite(reach) || !(Scalar(0) < reach))
      return "reach must be positive, got " + number_text(reach);
    return {};
  }
};

/// A mesh that was cut.
template <RealScalar Scalar>
struct SurfaceCut {
  /// The changed mesh. Its remap is the identity when the polyline does not meet the mesh.
  MeshChange<Scalar> change;
  /// Number of edges that were opened.
  int opened_edges = 0;
  /// Number of vertices that were inserted on edges and in triangles.
  int inserted_vertices = 0;
  /// Number of copies of vertices.
  int copied_vertices = 0;
  /// Number of segments of the polyline that could not be followed to their end, because the
  /// surface is crumpled or folded between its points: draw more points, or draw on the rest
  /// positions.
  int broken_segments = 0;
};

/// Cuts the mesh that `editor` holds along a polyline (3×k, m), in the positions of the editor:
/// inserts the vertices and marks the edges; `open_marked` opens them. Call it again for more
/// lines. Returns the number of segments that could not be followed to their end (`SurfaceCut`).
/// Allocates. Complexity: O(k · triangles). Fails as `cut_surface` does; the mesh is then
/// unchanged.
template <RealScalar Scalar>
Result<int> mark_cut(MeshEditor<Scalar>& editor, const PointsView<Scalar>& polyline,
                     const CutSettings<Scalar>& settings = {}) {
  if (std::string problem = settings.validate(); !problem.empty()) return Error{problem};
  if (polyline.cols() < 2)
    return Error{"a cut needs at least 2 points, got " + std::to_string(polyline.cols())};
  detail::SurfaceWalk<Scalar> walk(editor, settings.snap, settings.reach);
  for (Index i = 0; i < polyline.cols(); ++i) {
    const std::string name = "point " + std::to_string(i) + " of the cut";
    if (!all_finite(polyline.col(i))) return Error{name + " is not finite"};
    if (walk.too_far(polyline.col(i))) return Error{name + " is too far from the mesh"};
  }
  return walk.follow(polyline);
}

/// Cuts a mesh along a polyline. `positions` (3×n, m) are those that the polyline (3×k, m) was
/// drawn on: the rest positions, or the current ones in the world. The remap serves both. The cut
/// may start and end inside the mesh, leave it and cross itself; a closed polyline cuts a piece
/// out. Allocates. Complexity: O(k · triangles). Fails when: a value of the settings is out of
/// range, a coordinate is not finite, the polyline has fewer than 2 points or one at more than 10^4
/// times the size of the mesh, or `make_topology` refuses the mesh.
template <RealScalar Scalar>
Result<SurfaceCut<Scalar>> cut_surface(const std::type_identity_t<PointsView<Scalar>>& positions,
                                       const std::vector<std::array<int, 3>>& triangles,
                                       const std::type_identity_t<PointsView<Scalar>>& polyline,
                                       const CutSettings<Scalar>& settings) {
  Result<MeshEditor<Scalar>> made = MeshEditor<Scalar>::create(positions, triangles);
  if (!made) return Error{made.error()};
  MeshEditor<Scalar>& editor = made.value();
  const Result<int> broken = mark_cut<Scalar>(editor, polyline, settings);
  if (!broken) return Error{broken.error()};
  SurfaceCut<Scalar> cut;
  cut.broken_segments = broken.value();
  cut.inserted_vertices = editor.vertex_count() - static_cast<int>(positions.cols());
  cut.copied_vertices = editor.open_marked();
  cut.opened_edges = editor.opened_count();
  cut.change = editor.change();
  return cut;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
