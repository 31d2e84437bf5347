#pragma once

// Triangle meshes of flat panels of cloth.
//
// A side of length L has max(1, round(L / h)) equal edges for the edge length h, unless the caller
// asks for a number. The inside is a hexagonal lattice of spacing h, smoothed; its mesh is Delaunay
// apart from the corners. Where the outline allows it, all angles are above 24° (usually above
// 28°); sharp corners and necks narrower than an edge set smaller ones. detail/panel_mesher.hpp
// describes the steps.

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/mesh/detail/panel_mesher.hpp"
#include "clothctl/mesh/panel_outline.hpp"
#include "clothctl/mesh/topology.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A flat panel of triangles.
struct PanelMesh {
  /// Vertices, 2×n, m. Those of the boundary come first, side by side.
  FlatPoints positions;
  /// Triangles, counter-clockwise.
  std::vector<std::array<int, 3>> triangles;
  /// The vertices of each side of the outline from its first corner to its last, both included.
  std::vector<std::vector<int>> sides;

  /// Returns twice the signed area of a triangle, m².
  double doubled_area(std::size_t triangle) const {
    const std::array<int, 3>& t = triangles[triangle];
    const FlatPoint u = positions.col(t[1]) - positions.col(t[0]),
                    w = positions.col(t[2]) - positions.col(t[0]);
    return u[0] * w[1] - u[1] * w[0];
  }

  /// Returns the area of all triangles, m².
  double area() const {
    double sum = 0;
    for (std::size_t t = 0; t < triangles.size(); ++t) sum += doubled_area(t) / 2;
    return sum;
  }

  /// Returns an empty string when positions are finite, the triangles make a positive, manifold
  /// mesh, and the sides run along it; else a line that names the first bad item. Allocates.
  std::string validate() const {
    const Index n = positions.cols();
    if (n == 0 || triangles.empty()) return "panel is empty";
    for (Index v = 0; v < n; ++v) {
      if (!all_finite(positions.col(v)))
        return "position of vertex " + std::to_string(v) + " is not finite";
    }
    const auto loops = boundary_loops(n, triangles);
    if (!loops) return loops.error();
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      if (!is_finite(doubled_area(t)) || !(doubled_area(t) > 0))
        return "triangle " + std::to_string(t) + " has no positive area, got " +
               number_text(doubled_area(t) / 2) + " m^2";
    }
    for (std::size_t s = 0; s < sides.size(); ++s) {
      for (const int v : sides[s]) {
        if (v < 0 || v >= n)
          return "side " + std::to_string(s) + " holds vertex " + std::to_string(v) +
                 " off the panel of " + std::to_string(n) + " vertices";
      }
    }
    return {};
  }
};

namespace detail {

/// Appends the points that divide a side into edges, without its last point.
template <class = void>
void sample_smooth(const OutlineSide& side, int edges, std::vector<FlatPoint>& out) {
  const double length = side.length();
  std::size_t i = 1;
  double before = 0;
  for (int k = 0; k < edges; ++k) {
    const double at = length * k / edges;
    double step = (side.points[i] - side.points[i - 1]).norm();
    while (before + step < at && i + 1 < side.points.size()) {
      before += step;
      ++i;
      step = (side.points[i] - side.points[i - 1]).norm();
    }
    const double t = step > 0 ? std::clamp((at - before) / step, 0.0, 1.0) : 0.0;
    out.push_back(k == 0
                      ? side.points[0]
                      : FlatPoint(side.points[i - 1] + t * (side.points[i] - side.points[i - 1])));
  }
}

/// Divides `edges` among the straight parts of a side: at least one each, the others where the
/// edges are longest.
template <class = void>
std::vector<int> edges_of_parts(const OutlineSide& side, int edges) {
  std::vector<int> count(side.points.size() - 1, 1);
  std::vector<double> length(count.size());
  int left = edges - static_cast<int>(count.size());
  const double per_length = left / side.length();
  for (std::size_t i = 0; i < count.size(); ++i) {
    length[i] = (side.points[i + 1] - side.points[i]).norm();
    count[i] += static_cast<int>(length[i] * per_length);
  }
  for (left = edges - std::accumulate(count.begin(), count.end(), 0); left > 0; --left) {
    std::size_t longest = 0;
    for (std::size_t i = 1; i < count.size(); ++i) {
      if (length[i] / count[i] > length[longest] / count[longest]) longest = i;
    }
    ++count[longest];
  }
  return count;
}

/// Appends the points of a side without its last one.
template <class = void>
void sample_side(const OutlineSide& side, int edges, std::vector<FlatPoint>& out) {
  if (side.smooth || side.points.size() == 2) return sample_smooth(side, edges, out);
  const std::vector<int> count = edges_of_parts(side, edges);
  OutlineSide part;
  part.smooth = true;
  for (std::size_t i = 0; i < count.size(); ++i) {
    const auto first = side.points.begin() + static_cast<std::ptrdiff_t>(i);
    part.points.assign(first, first + 2);
    sample_smooth(part, count[i], out);
  }
}

/// Returns what is wrong with a side, or "".
template <class = void>
std::string check_side(const OutlineSide& side, const std::string& name) {
  for (std::size_t i = 0; i < side.points.size(); ++i) {
    if (!all_finite(side.points[i]))
      return name + " has a point that is not finite: (" + number_text(side.points[i][0]) + ", " +
             number_text(side.points[i][1]) + ")";
    const bool corner = i > 0 && (!side.smooth || side.points.size() == 2);
    if (corner && !((side.points[i] - side.points[i - 1]).norm() > 0))
      return name + " has two corners in one place, (" + number_text(side.points[i][0]) + ", " +
             number_text(side.points[i][1]) + ") m";
  }
  if (!is_finite(side.length()) || !(side.length() > 0)) return name + " has no length";
  return {};
}

/// Returns the number of edges of a side, or why it cannot have the requested number.
template <class = void>
Result<int> edges_of_side(const OutlineSide& side, double edge_length, int requested,
                          const std::string& name) {
  constexpr int most = 1000000;
  const int parts = side.smooth ? 1 : static_cast<int>(side.points.size()) - 1;
  if (requested < 0 || requested > most)
    return Error{name + " cannot have " + std::to_string(requested) + " edges"};
  if (requested > 0 && requested < parts)
    return Error{name + " has " + std::to_string(parts) + " straight parts and cannot have " +
                 std::to_string(requested) + " edges"};
  if (requested > 0) return requested;
  const double edges = side.length() / edge_length;
  if (!(edges < most))
    return Error{name + " of " + number_text(side.length()) + " m is too long for edges of " +
                 number_text(edge_length) + " m"};
  return (std::max)(parts, static_cast<int>(std::lround(edges)));
}

/// Returns why a region is too large for an edge length, or "".
template <class = void>
std::string check_extent(const std::vector<FlatPoint>& points, double edge_length) {
  if (!is_finite(edge_length) || !(edge_length > 0))
    return "edge length must be positive, got " + number_text(edge_length);
  FlatPoint low = points[0], high = points[0];
  for (const FlatPoint& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const FlatPoint size = high - low;
  if (!is_finite(size[0] * size[1]))
    return "panel of " + number_text(size[0]) + " m by " + number_text(size[1]) + " m is too large";
  if (!((size[0] / edge_length + 2) * (size[1] / edge_length + 2) < 2e6))
    return "panel of " + number_text(size[0]) + " m by " + number_text(size[1]) +
           " m is too large for edges of " + number_text(edge_length) + " m";
  return {};
}

/// Fills a boundary and checks the areas.
template <class = void>
Result<PanelMesh> fill_panel(const RegionBoundary& boundary, double edge_length) {
  if (std::string wrong = check_extent(boundary.points, edge_length); !wrong.empty())
    return Error{std::move(wrong)};
  Result<FilledRegion> filled = fill_region(boundary, edge_length);
  if (!filled) return Error{"panel: " + filled.error()};
  PanelMesh mesh;
  mesh.positions = std::move(filled->positions);
  mesh.triangles = std::move(filled->triangles);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.doubled_area(t) > 0) continue;
    const FlatPoint p = mesh.positions.col(mesh.triangles[t][0]);
    return Error{"panel is thinner than rounding near (" + number_text(p[0]) + ", " +
                 number_text(p[1]) + ") m"};
  }
  return mesh;
}

}  // namespace detail

/// Makes the mesh of an outline with edges of about `edge_length` (m). `edges` may give the number
/// of edges of each side in the order of `all_sides`; 0 means by length, and an empty list means so
/// for all. The same outline at another edge length is the panel remeshed. Allocates. Complexity:
/// O(n log n) as a rule. Fails when: the edge length is not positive, more than some 2·10^6
/// vertices would be needed, a point is not finite, a side has no length or too few edges for its
/// corners, or the outline is drawn clockwise, crosses or touches itself, or has a hole outside.
template <class = void>
Result<PanelMesh> make_panel(const PanelOutline& outline, double edge_length,
                             const std::vector<int>& edges = {}) {
  if (!is_finite(edge_length) || !(edge_length > 0))
    return Error{"edge length must be positive, got " + number_text(edge_length)};
  std::vector<std::vector<OutlineSide>> rings{outline.closed_sides()};
  rings.insert(rings.end(), outline.holes().begin(), outline.holes().end());
  const std::size_t count = outline.all_sides().size();
  if (!edges.empty() && edges.size() != count)
    return Error{"panel has " + std::to_string(count) + " sides, got edge counts for " +
                 std::to_string(edges.size())};
  detail::RegionBoundary boundary;
  std::vector<std::vector<int>> sides;
  for (std::size_t r = 0; r < rings.size(); ++r) {
    const int first = static_cast<int>(boundary.points.size());
    for (const OutlineSide& side : rings[r]) {
      const std::string name = "side " + std::to_string(sides.size());
      if (std::string wrong = detail::check_side(side, name); !wrong.empty())
        return Error{std::move(wrong)};
      const Result<int> number =
          detail::edges_of_side(side, edge_length, edges.empty() ? 0 : edges[sides.size()], name);
      if (!number) return Error{number.error()};
      std::vector<int> chain(static_cast<std::size_t>(*number) + 1);
      std::iota(chain.begin(), chain.end(), static_cast<int>(boundary.points.size()));
      detail::sample_side(side, *number, boundary.points);
      boundary.side.resize(boundary.points.size(), static_cast<int>(sides.size()));
      sides.push_back(std::move(chain));
    }
    const int end = static_cast<int>(boundary.points.size());
    if (end - first < 3)
      return Error{(r == 0 ? std::string("outline") : "hole " + std::to_string(r - 1)) + " has " +
                   std::to_string(end - first) + " edges, needs at least 3"};
    for (int v = first; v < end; ++v) boundary.next.push_back(v + 1 < end ? v + 1 : first);
    sides.back().back() = first;
  }
  if (!is_finite(outline.area()) || !(outline.area() > 0))
    return Error{"outline must be drawn counter-clockwise, its area is " +
                 number_text(outline.area()) + " m^2"};
  Result<PanelMesh> mesh = detail::fill_panel(boundary, edge_length);
  if (mesh) mesh->sides = std::move(sides);
  return mesh;
}

/// Replaces the inside of a panel by triangles of about `edge_length` (m). The boundary vertices
/// stay, so seams still match; they come first, loop by loop, and the sides keep their vertices
/// (with new indices). A panel without sides gets one closed side for each loop. If the boundary
/// edges are shorter than `edge_length`, the triangles grow from the boundary inwards. To change
/// the boundary edges too, call `make_panel(outline_of(mesh), edge_length)`. Allocates. Fails when:
/// `mesh.validate()` finds a fault, the panel has several pieces, or as for `make_panel`.
template <class = void>
Result<PanelMesh> remesh_panel(const PanelMesh& mesh, double edge_length) {
  if (std::string wrong = mesh.validate(); !wrong.empty()) return Error{std::move(wrong)};
  const auto loops = boundary_loops(mesh.positions.cols(), mesh.triangles);
  detail::RegionBoundary boundary;
  std::vector<int> renamed(static_cast<std::size_t>(mesh.positions.cols()), -1);
  std::vector<std::vector<int>> sides;
  for (std::size_t l = 0; l < loops->size(); ++l) {
    const std::vector<int>& loop = (*loops)[l];
    const int first = static_cast<int>(boundary.points.size());
    std::vector<int> side;
    for (std::size_t i = 0; i < loop.size(); ++i) {
      const int v = static_cast<int>(boundary.points.size());
      side.push_back(v);
      renamed[static_cast<std::size_t>(loop[i])] = v;
      boundary.points.push_back(mesh.positions.col(loop[i]));
      boundary.next.push_back(i + 1 < loop.size() ? v + 1 : first);
      boundary.side.push_back(static_cast<int>(l));
    }
    side.push_back(first);
    sides.push_back(std::move(side));
  }
  if (!mesh.sides.empty()) sides = mesh.sides;
  for (std::size_t s = 0; s < mesh.sides.size(); ++s) {
    for (int& v : sides[s]) {
      if (renamed[static_cast<std::size_t>(v)] < 0)
        return Error{"side " + std::to_string(s) + " holds vertex " + std::to_string(v) +
                     ", which is not on the boundary"};
      v = renamed[static_cast<std::size_t>(v)];
    }
  }
  Result<PanelMesh> out = detail::fill_panel(boundary, edge_length);
  if (out) out->sides = std::move(sides);
  return out;
}

/// Returns the outline of a flat mesh. A boundary vertex at which the boundary turns by more than
/// `corner_angle` (rad) is a corner; the sides between corners are smooth. Sides start at the first
/// corner of each loop. Allocates. Fails when: `mesh.validate()` finds a fault, or there is more
/// than one outer loop.
template <class = void>
Result<PanelOutline> outline_of(const PanelMesh& mesh, double corner_angle = 0.5) {
  if (std::string wrong = mesh.validate(); !wrong.empty()) return Error{std::move(wrong)};
  const auto loops = boundary_loops(mesh.positions.cols(), mesh.triangles);
  std::vector<PanelOutline> outer, holes;
  for (const std::vector<int>& loop : *loops) {
    const std::size_t n = loop.size();
    const auto at = [&](std::size_t i) { return FlatPoint(mesh.positions.col(loop[i % n])); };
    const auto is_corner = [&](std::size_t i) {
      const FlatPoint u = at(i) - at(i + n - 1), w = at(i + 1) - at(i);
      return std::abs(std::atan2(u[0] * w[1] - u[1] * w[0], u.dot(w))) > corner_angle;
    };
    std::size_t start = 0;
    while (start < n && !is_corner(start)) ++start;
    if (start == n) start = 0;
    PanelOutline outline(at(start));
    std::vector<FlatPoint> side;
    for (std::size_t i = start + 1; i <= start + n; ++i) {
      side.push_back(at(i));
      if (i < start + n && !is_corner(i % n)) continue;
      outline.smooth_to(side);
      side.clear();
    }
    (outline.area() > 0 ? outer : holes).push_back(std::move(outline));
  }
  if (outer.size() != 1)
    return Error{"panel has " + std::to_string(outer.size()) + " outer loops, must have one"};
  for (const PanelOutline& hole : holes) outer[0].add_hole(hole);
  return outer[0];
}

}  // namespace clothctl::inline CLOTHCTL_ABI
