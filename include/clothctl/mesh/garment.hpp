#pragma once

// A garment: flat panels, their places around the body, and the seams that join them.
//
//   GarmentPattern bag;
//   const int front = bag.add_panel("front", rectangle_outline(0.3, 0.4), {.origin = {0, -0.1,
//   0}}); const int back = ... bag.sew(front, 1, back, 3);                       // right side of
//   the front, left of the back const auto garment = make_garment(bag, 0.01);     // meshes, 10 mm
//   edges const auto sewn = weld_seams(*garment);           // one mesh
//
// A placement puts the point (x, y) of a panel at
//
//   flat             origin + x right + y up
//   on a cylinder    origin + r sin(x/r) right + y up - r (1 - cos(x/r)) n,     n = right × up
//
// Both keep all lengths. The axis of the cylinder is parallel to `up`, at the distance r behind the
// panel; n points to the front of the cloth, away from the body. A seam joins two sides point by
// point. All panels are drawn counter-clockwise seen from their front, so the two sides of a seam
// run in opposite directions: vertex i of one goes with vertex last - i of the other. Sides that
// seams join get equal numbers of edges. If their lengths differ, the longer one is eased in: its
// edges are longer, and the cloth puckers there.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/quoted_text.hpp"
#include "clothctl/mesh/panel.hpp"
#include "clothctl/mesh/pattern_mesh.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Where a panel is in space before it is sewn.
struct PanelPlacement {
  /// The place of the panel's origin, m.
  Vector3<double> origin = Vector3<double>::Zero();
  /// The direction of the panel's x axis, a unit vector.
  Vector3<double> right = Vector3<double>::UnitX();
  /// The direction of the panel's y axis, a unit vector at right angles to `right`.
  Vector3<double> up = Vector3<double>::UnitZ();
  /// Radius of the cylinder on which the panel lies, m; 0 for a flat panel.
  double radius = 0;

  /// Returns the place of a point of the panel, m.
  Vector3<double> position(const FlatPoint& p) const {
    if (!(radius > 0)) return origin + p[0] * right + p[1] * up;
    const Vector3<double> n(right[1] * up[2] - right[2] * up[1],
                            right[2] * up[0] - right[0] * up[2],
                            right[0] * up[1] - right[1] * up[0]);
    const double angle = p[0] / radius, half = std::sin(angle / 2);
    return origin + radius * std::sin(angle) * right + p[1] * up - 2 * radius * half * half * n;
  }

  /// Returns an empty string when the directions are orthonormal to 1e-6 and the other values
  /// finite, else a line that names the first bad one.
  std::string validate() const {
    if (!all_finite(origin)) return "origin of the placement is not finite";
    const auto off = [](double value, double wanted) {
      return !is_finite(value) || std::abs(value - wanted) > 1e-6;
    };
    if (off(right.squaredNorm(), 1)) return "direction right of the placement is no unit vector";
    if (off(up.squaredNorm(), 1)) return "direction up of the placement is no unit vector";
    if (off(right.dot(up), 0)) return "directions of the placement are not at right angles";
    if (!is_finite(radius) || radius < 0)
      return "radius of the placement must not be negative, got " + number_text(radius);
    return {};
  }
};

/// A panel of a pattern.
struct PatternPanel {
  /// Its name, for messages.
  std::string name;
  /// Its outline, counter-clockwise seen from the front of the cloth.
  PanelOutline outline;
  /// Its place in space.
  PanelPlacement placement;
};

/// A seam between two sides of one or two panels. Sides have the order of
/// `PanelOutline::all_sides`.
struct PatternSeam {
  /// The first panel.
  int panel_a = 0;
  /// Its side.
  int side_a = 0;
  /// The second panel.
  int panel_b = 0;
  /// Its side.
  int side_b = 0;
  /// The largest difference of the two lengths that is intended, as a share of the longer one.
  double ease = 0.1;
};

/// What a garment is cut and sewn from.
struct GarmentPattern {
  /// The panels.
  std::vector<PatternPanel> panels;
  /// The seams.
  std::vector<PatternSeam> seams;

  /// Adds a panel and returns its index. Allocates.
  int add_panel(std::string name, PanelOutline outline, const PanelPlacement& placement = {}) {
    panels.push_back(PatternPanel{std::move(name), std::move(outline), placement});
    return static_cast<int>(panels.size()) - 1;
  }

  /// Adds a seam. Allocates.
  void sew(int panel_a, int side_a, int panel_b, int side_b, double ease = 0.1) {
    seams.push_back(PatternSeam{panel_a, side_a, panel_b, side_b, ease});
  }
};

/// A panel of a garment: its part of the mesh.
struct GarmentPanel {
  /// The name of the pattern's panel.
  std::string name;
  /// Its first vertex; the others follow, boundary vertices first.
  int first_vertex = 0;
  /// Number of its vertices.
  int vertex_count = 0;
  /// Its first triangle; the others follow.
  int first_triangle = 0;
  /// Number of its triangles.
  int triangle_count = 0;
  /// The garment's vertices on each side, from corner to corner, both included.
  std::vector<std::vector<int>> sides;
};

/// A garment of separate panels with seams that are still open.
struct Garment {
  /// All panels. Vertices in space and points of the pattern have the same indices. The panels
  /// overlap in the pattern, since each has coordinates of its own.
  PatternMesh mesh;
  /// The panels.
  std::vector<GarmentPanel> panels;
  /// For each seam of the pattern the pairs of vertices that it joins, along the seam. Vertices
  /// that belong to both sides, as at the tip of a dart, are left out.
  std::vector<std::vector<std::array<int, 2>>> seams;
};

/// A garment with closed seams.
struct SewnGarment {
  /// The mesh. Its pattern is that of the open garment.
  PatternMesh mesh;
  /// The vertex of the sewn garment that each vertex of the open one became.
  std::vector<int> vertex_of;
};

namespace detail {

/// Disjoint sets; the smallest member names a set.
class DisjointSets {
 public:
  /// Makes sets of one member each. Allocates.
  explicit DisjointSets(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }
  /// Returns the smallest member of a set.
  int find(int i) {
    int root = i;
    while (parent_[static_cast<std::size_t>(root)] != root)
      root = parent_[static_cast<std::size_t>(root)];
    while (i != root) i = std::exchange(parent_[static_cast<std::size_t>(i)], root);
    return root;
  }
  /// Unites two sets.
  void unite(int a, int b) {
    a = find(a);
    b = find(b);
    parent_[static_cast<std::size_t>((std::max)(a, b))] = (std::min)(a, b);
  }

 private:
  std::vector<int> parent_;
};

/// The sides of all panels, numbered through.
struct PatternSides {
  /// Number of the first side of each panel.
  std::vector<int> first;
  std::vector<OutlineSide> sides;
  std::vector<double> length;

  int number(int panel, int side) const { return first[static_cast<std::size_t>(panel)] + side; }
};

template <class = void>
std::string seam_name(const GarmentPattern& pattern, std::size_t index) {
  const PatternSeam& s = pattern.seams[index];
  const auto place = [&](int panel, int side) {
    return quoted_text(pattern.panels[static_cast<std::size_t>(panel)].name) + " side " +
           std::to_string(side);
  };
  return "seam " + std::to_string(index) + " (" + place(s.panel_a, s.side_a) + ", " +
         place(s.panel_b, s.side_b) + ")";
}

/// Lists the sides of a pattern. Fails when: a panel or a side of a seam does not exist, or a
/// placement is wrong.
template <class = void>
Result<PatternSides> pattern_sides(const GarmentPattern& pattern) {
  if (pattern.panels.empty()) return Error{"garment has no panels"};
  PatternSides out;
  for (std::size_t p = 0; p < pattern.panels.size(); ++p) {
    const std::string name = "panel " + quoted_text(pattern.panels[p].name) + ": ";
    if (std::string wrong = pattern.panels[p].placement.validate(); !wrong.empty())
      return Error{name + wrong};
    out.first.push_back(static_cast<int>(out.sides.size()));
    for (OutlineSide& side : pattern.panels[p].outline.all_sides()) {
      const std::size_t index = out.sides.size() - static_cast<std::size_t>(out.first.back());
      if (std::string wrong = check_side(side, "side " + std::to_string(index)); !wrong.empty())
        return Error{name + wrong};
      out.length.push_back(side.length());
      out.sides.push_back(std::move(side));
    }
  }
  out.first.push_back(static_cast<int>(out.sides.size()));
  for (std::size_t i = 0; i < pattern.seams.size(); ++i) {
    const PatternSeam& s = pattern.seams[i];
    for (const auto& [panel, side] :
         {std::pair(s.panel_a, s.side_a), std::pair(s.panel_b, s.side_b)}) {
      const std::string name = "seam " + std::to_string(i);
      if (panel < 0 || panel >= static_cast<int>(pattern.panels.size()))
        return Error{name + " joins panel " + std::to_string(panel) + " of " +
                     std::to_string(pattern.panels.size())};
      const int count = out.number(panel + 1, 0) - out.number(panel, 0);
      if (side < 0 || side >= count)
        return Error{name + " joins side " + std::to_string(side) + " of the " +
                     std::to_string(count) + " sides of panel " +
                     quoted_text(pattern.panels[static_cast<std::size_t>(panel)].name)};
    }
  }
  return out;
}

/// Returns the number of edges of each side: equal along seams, 0 (by length) elsewhere. Fails
/// when: the lengths of a seam's sides differ by more than its ease, or a seam joins a side to
/// itself.
template <class = void>
Result<std::vector<int>> seam_edges(const GarmentPattern& pattern, const PatternSides& all,
                                    double edge_length) {
  DisjointSets joined(all.sides.size());
  for (std::size_t i = 0; i < pattern.seams.size(); ++i) {
    const PatternSeam& s = pattern.seams[i];
    const int a = all.number(s.panel_a, s.side_a), b = all.number(s.panel_b, s.side_b);
    const double la = all.length[static_cast<std::size_t>(a)],
                 lb = all.length[static_cast<std::size_t>(b)];
    if (a == b) return Error{seam_name(pattern, i) + " joins a side to itself"};
    if (!is_finite(s.ease) || !(std::abs(la - lb) <= s.ease * (std::max)(la, lb)))
      return Error{seam_name(pattern, i) + ": lengths " + number_text(la) + " m and " +
                   number_text(lb) + " m differ by more than its ease of " + number_text(s.ease)};
    joined.unite(a, b);
  }
  const std::size_t n = all.sides.size();
  std::vector<double> sum(n, 0);
  std::vector<int> members(n, 0), parts(n, 1), edges(n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t root = static_cast<std::size_t>(joined.find(static_cast<int>(i)));
    sum[root] += all.length[i];
    ++members[root];
    if (!all.sides[i].smooth)
      parts[root] = (std::max)(parts[root], static_cast<int>(all.sides[i].points.size()) - 1);
  }
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t root = static_cast<std::size_t>(joined.find(static_cast<int>(i)));
    if (members[root] < 2) continue;
    const double wanted = sum[root] / members[root] / edge_length;
    if (!(wanted < 1e6))
      return Error{"a seam of " + number_text(sum[root] / members[root]) +
                   " m is too long for edges of " + number_text(edge_length) + " m"};
    edges[i] = (std::max)(parts[root], static_cast<int>(std::lround(wanted)));
  }
  return edges;
}

/// Adds the mesh of one panel to a garment.
template <class = void>
void add_panel_mesh(const PatternPanel& panel, const PanelMesh& flat, Garment& garment) {
  PatternMesh& mesh = garment.mesh;
  GarmentPanel out;
  out.name = panel.name;
  out.first_vertex = static_cast<int>(mesh.positions.cols());
  out.vertex_count = static_cast<int>(flat.positions.cols());
  out.first_triangle = static_cast<int>(mesh.triangles.size());
  out.triangle_count = static_cast<int>(flat.triangles.size());
  mesh.positions.conservativeResize(3, out.first_vertex + out.vertex_count);
  mesh.pattern.conservativeResize(2, out.first_vertex + out.vertex_count);
  for (Index v = 0; v < flat.positions.cols(); ++v) {
    mesh.pattern.col(out.first_vertex + v) = flat.positions.col(v);
    mesh.positions.col(out.first_vertex + v) = panel.placement.position(flat.positions.col(v));
  }
  for (const std::array<int, 3>& t : flat.triangles)
    mesh.triangles.push_back(
        {t[0] + out.first_vertex, t[1] + out.first_vertex, t[2] + out.first_vertex});
  out.sides = flat.sides;
  for (std::vector<int>& side : out.sides) {
    for (int& v : side) v += out.first_vertex;
  }
  garment.panels.push_back(std::move(out));
}

}  // namespace detail

/// Cuts and places a garment with edges of about `edge_length` (m). Allocates. Complexity: O(n log
/// n) as a rule. Fails when: there is no panel, a placement is not orthonormal, a seam joins a
/// panel or a side that does not exist or sides whose lengths differ by more than its ease, or
/// `make_panel` fails; the message names the panel or the seam.
template <class = void>
Result<Garment> make_garment(const GarmentPattern& pattern, double edge_length) {
  if (!is_finite(edge_length) || !(edge_length > 0))
    return Error{"edge length must be positive, got " + number_text(edge_length)};
  const Result<detail::PatternSides> all = detail::pattern_sides(pattern);
  if (!all) return Error{all.error()};
  const Result<std::vector<int>> edges = detail::seam_edges(pattern, *all, edge_length);
  if (!edges) return Error{edges.error()};
  Garment garment;
  for (std::size_t p = 0; p < pattern.panels.size(); ++p) {
    const std::vector<int> own(edges->begin() + all->first[p], edges->begin() + all->first[p + 1]);
    const Result<PanelMesh> flat = make_panel(pattern.panels[p].outline, edge_length, own);
    if (!flat) return Error{"panel " + quoted_text(pattern.panels[p].name) + ": " + flat.error()};
    detail::add_panel_mesh(pattern.panels[p], *flat, garment);
  }
  garment.mesh.pattern_triangles = garment.mesh.triangles;
  for (const PatternSeam& s : pattern.seams) {
    const auto chain = [&](int panel, int side) -> const std::vector<int>& {
      return garment.panels[static_cast<std::size_t>(panel)].sides[static_cast<std::size_t>(side)];
    };
    const std::vector<int>&a = chain(s.panel_a, s.side_a), &b = chain(s.panel_b, s.side_b);
    std::vector<std::array<int, 2>> pairs;
    for (std::size_t i = 0; i < a.size(); ++i) {
      if (a[i] != b[b.size() - 1 - i]) pairs.push_back({a[i], b[b.size() - 1 - i]});
    }
    garment.seams.push_back(std::move(pairs));
  }
  return garment;
}

/// Returns the means of the points (3×n) that became one vertex each, e.g. positions or velocities
/// of an open garment for `SewnGarment::vertex_of`. Allocates.
template <RealScalar Scalar>
Points<Scalar> merge_points(const std::vector<int>& vertex_of, const Points<Scalar>& points) {
  int last = -1;
  for (const int v : vertex_of) last = (std::max)(last, v);
  Points<Scalar> sum = Points<Scalar>::Zero(3, last + 1);
  std::vector<int> members(static_cast<std::size_t>(last + 1), 0);
  for (std::size_t v = 0; v < vertex_of.size(); ++v) {
    sum.col(vertex_of[v]) += points.col(static_cast<Index>(v));
    ++members[static_cast<std::size_t>(vertex_of[v])];
  }
  for (Index v = 0; v <= last; ++v) {
    const Scalar share = Scalar(1.0 / static_cast<double>(members[static_cast<std::size_t>(v)]));
    if (members[static_cast<std::size_t>(v)] > 1) sum.col(v) *= share;
  }
  return sum;
}

/// Merges the vertices that seams join. Each group takes its smallest index, at the mean of its
/// places; the indices above close up. Triangles, and the pattern with its shapes, stay. Allocates.
/// Complexity: O(n log n). Fails when: a seam holds a vertex off the mesh, or the sewn mesh is no
/// oriented manifold, e.g. where a seam joins two edges of one triangle.
template <class = void>
Result<SewnGarment> weld_seams(const Garment& garment) {
  if (std::string wrong = garment.mesh.validate(); !wrong.empty()) return Error{std::move(wrong)};
  const std::size_t n = static_cast<std::size_t>(garment.mesh.positions.cols());
  detail::DisjointSets groups(n);
  for (std::size_t s = 0; s < garment.seams.size(); ++s) {
    for (const std::array<int, 2>& pair : garment.seams[s]) {
      for (const int v : pair) {
        if (v < 0 || v >= static_cast<int>(n))
          return Error{"seam " + std::to_string(s) + " holds vertex " + std::to_string(v) +
                       " off the mesh of " + std::to_string(n) + " vertices"};
      }
      groups.unite(pair[0], pair[1]);
    }
  }
  SewnGarment out;
  out.vertex_of.resize(n);
  int count = 0;
  for (std::size_t v = 0; v < n; ++v) {
    const int root = groups.find(static_cast<int>(v));
    out.vertex_of[v] =
        root == static_cast<int>(v) ? count++ : out.vertex_of[static_cast<std::size_t>(root)];
  }
  out.mesh.pattern = garment.mesh.pattern;
  out.mesh.pattern_triangles = garment.mesh.pattern_triangles;
  out.mesh.triangles = garment.mesh.triangles;
  for (std::array<int, 3>& t : out.mesh.triangles) {
    for (int& v : t) v = out.vertex_of[static_cast<std::size_t>(v)];
  }
  if (const auto loops = boundary_loops(count, out.mesh.triangles); !loops)
    return Error{"sewn garment: " + loops.error()};
  out.mesh.positions = merge_points<double>(out.vertex_of, garment.mesh.positions);
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
