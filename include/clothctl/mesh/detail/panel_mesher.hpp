#pragma once

// Fills a region of the plane with triangles of one size. Its boundary vertices are given.
//
//   1. triangulate the boundary vertices, with the boundary edges as constraints
//   2. add the points of a hexagonal lattice of spacing h that are inside and at least 0.65 h away
//      from the boundary
//   3. smooth: each inner vertex moves to Σ A_t b_t / Σ A_t over its triangles (areas A, centroids
//      b), which spreads the vertices evenly; then flip edges to Delaunay again
//   4. refine: a triangle with an angle below 25° gets a vertex at the centre of its circle, unless
//      that is next to the boundary (Chew 1993). The new edges are longer than the shortest edge of
//      the triangle, so this ends. It grades the mesh where boundary edges are shorter than h
//   5. flip where two sides of a triangle are on the boundary
//
// Coordinates are rounded to a lattice of 2^26 steps across the region (15 nm for one metre), on
// which all tests are exact.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/mesh/detail/constrained_triangulation.hpp"
#include "clothctl/mesh/panel_outline.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// The boundary of a region: closed loops of vertices.
struct RegionBoundary {
  /// All vertices, loop after loop, m.
  std::vector<FlatPoint> points;
  /// The vertex after each one in its loop.
  std::vector<int> next;
  /// The side that the edge from each vertex to the next belongs to, for messages.
  std::vector<int> side;
};

/// The boundary edges near a point, found by cells of the size of an edge.
class BoundaryCells {
 public:
  /// Allocates.
  BoundaryCells(const RegionBoundary& boundary, const FlatPoint& low, const FlatPoint& high,
                double cell)
      : boundary_(boundary), low_(low), cell_(cell) {
    cols_ = static_cast<std::size_t>((high[0] - low[0]) / cell) + 1;
    rows_ = static_cast<std::size_t>((high[1] - low[1]) / cell) + 1;
    edges_.resize(cols_ * rows_);
    for (std::size_t i = 0; i < boundary.points.size(); ++i) {
      // An edge is listed piece by piece, so that a long one does not fill its whole box.
      const FlatPoint &p = boundary.points[i], &q = end(i);
      const int pieces = static_cast<int>((q - p).norm() / cell) + 1;
      for (int k = 0; k < pieces; ++k)
        list(p + (q - p) * k / pieces, p + (q - p) * (k + 1) / pieces, static_cast<int>(i));
    }
  }

  /// Returns whether a boundary edge is nearer to p than `distance`, which is at most a cell.
  bool near_boundary(const FlatPoint& p, double distance) const {
    const std::size_t r = row(p[1]), c = col(p[0]);
    for (std::size_t i = r == 0 ? 0 : r - 1; i <= (std::min)(r + 1, rows_ - 1); ++i) {
      for (std::size_t j = c == 0 ? 0 : c - 1; j <= (std::min)(c + 1, cols_ - 1); ++j) {
        for (const int e : edges_[i * cols_ + j]) {
          if (squared_distance(p, static_cast<std::size_t>(e)) < distance * distance) return true;
        }
      }
    }
    return false;
  }

 private:
  /// Lists an edge in the cells of the box of two points.
  void list(const FlatPoint& p, const FlatPoint& q, int edge) {
    for (std::size_t r = row((std::min)(p[1], q[1])); r <= row((std::max)(p[1], q[1])); ++r) {
      for (std::size_t c = col((std::min)(p[0], q[0])); c <= col((std::max)(p[0], q[0])); ++c)
        edges_[r * cols_ + c].push_back(edge);
    }
  }

  const FlatPoint& end(std::size_t i) const {
    return boundary_.points[static_cast<std::size_t>(boundary_.next[i])];
  }
  std::size_t index(double from_low, std::size_t count) const {
    const double at = from_low / cell_;
    return at < 0 ? 0 : (std::min)(static_cast<std::size_t>(at), count - 1);
  }
  std::size_t row(double y) const { return index(y - low_[1], rows_); }
  std::size_t col(double x) const { return index(x - low_[0], cols_); }
  double squared_distance(const FlatPoint& p, std::size_t i) const {
    const FlatPoint along = end(i) - boundary_.points[i], from = p - boundary_.points[i];
    const double t = std::clamp(from.dot(along) / along.squaredNorm(), 0.0, 1.0);
    return (from - t * along).squaredNorm();
  }

  const RegionBoundary& boundary_;
  FlatPoint low_;
  double cell_;
  std::size_t rows_ = 0, cols_ = 0;
  std::vector<std::vector<int>> edges_;
};

/// Vertices and triangles of a filled region. The boundary vertices come first, in their order.
struct FilledRegion {
  FlatPoints positions;
  std::vector<std::array<int, 3>> triangles;
};

/// Fills one region. `fill_region` uses it.
template <class = void>
class PanelMesher {
 public:
  PanelMesher(const RegionBoundary& boundary, double spacing)
      : boundary_(boundary), spacing_(spacing) {
    low_ = high_ = boundary.points[0];
    for (const FlatPoint& p : boundary.points) {
      low_ = low_.cwiseMin(p);
      high_ = high_.cwiseMax(p);
    }
    const double extent = (high_ - low_).maxCoeff();
    int exponent = 0;
    std::frexp(extent, &exponent);  // extent ≤ 2^exponent
    unit_ = std::ldexp(1.0, exponent - 26);
    middle_ = 0.5 * (low_ + high_);
  }

  /// Triangulates the boundary. Returns what is wrong with it, or "".
  std::string add_boundary() {
    for (std::size_t i = 0; i < boundary_.points.size(); ++i) {
      if (mesh_.insert(to_lattice(boundary_.points[i])) != InsertOutcome::Inserted)
        return at_side(i) + " meets another side";
    }
    for (std::size_t i = 0; i < boundary_.points.size(); ++i) {
      const InsertOutcome outcome =
          mesh_.constrain(static_cast<int>(i) + kFirst, boundary_.next[i] + kFirst);
      if (outcome == InsertOutcome::Crosses) return at_side(i) + " crosses another side";
      if (outcome == InsertOutcome::Touches) return at_side(i) + " touches another side";
    }
    const int pieces = mesh_.classify();
    if (pieces != 1)
      return "the outline encloses " + std::to_string(pieces) + " pieces, must be one";
    return {};
  }

  /// Adds the inner vertices.
  void fill() {
    const BoundaryCells cells(boundary_, low_, high_, spacing_);
    const double pitch = spacing_ * std::sqrt(0.75);
    const std::int64_t rows = static_cast<std::int64_t>((high_[1] - low_[1]) / pitch) + 1,
                       cols = static_cast<std::int64_t>((high_[0] - low_[0]) / spacing_) + 2;
    // The lattice is centred in the region, so that a symmetric panel gets a nearly symmetric mesh.
    for (std::int64_t r = 0; r <= rows; ++r) {
      for (std::int64_t k = 0; k <= cols; ++k) {
        const std::int64_t c = r % 2 == 0 ? k : cols - k;  // back and forth: short walks
        const double x = static_cast<double>(2 * c - cols + r % 2) / 2,
                     y = static_cast<double>(2 * r - rows) / 2;
        const FlatPoint p = middle_ + FlatPoint(x * spacing_, y * pitch);
        if ((p.array() < low_.array()).any() || (p.array() > high_.array()).any()) continue;
        if (cells.near_boundary(p, 0.65 * spacing_)) continue;
        const LatticePoint at = to_lattice(p);
        if (mesh_.faces()[static_cast<std::size_t>(mesh_.locate(at))].inside) mesh_.insert(at);
      }
    }
  }

  /// Moves the inner vertices `sweeps` times and restores the Delaunay property after each sweep.
  void smooth(int sweeps) {
    std::vector<int> ring;
    for (int sweep = 0; sweep < sweeps; ++sweep) {
      mesh_.legalise_all();
      std::vector<int> face_of(mesh_.points().size(), -1);
      for (std::size_t f = 0; f < mesh_.faces().size(); ++f) {
        for (const int v : mesh_.faces()[f].vertex)
          face_of[static_cast<std::size_t>(v)] = static_cast<int>(f);
      }
      for (std::size_t v = first_inner(); v < mesh_.points().size(); ++v)
        move_to_centre(static_cast<int>(v), face_of[v], ring);
    }
    mesh_.legalise_all();
  }

  /// Adds vertices until no triangle has an angle below 25° that an inner vertex could widen.
  void refine() {
    const std::size_t most = 4 * mesh_.points().size() + 1000;
    for (bool added = true; added && mesh_.points().size() < most;) {
      added = false;
      for (std::size_t f = 0; f < mesh_.faces().size() && mesh_.points().size() < most; ++f) {
        LatticePoint centre;
        if (!mesh_.faces()[f].inside || !circle_centre(mesh_.faces()[f], centre)) continue;
        const int at = mesh_.locate(centre);
        if (!mesh_.faces()[static_cast<std::size_t>(at)].inside || encroaches(at, centre)) continue;
        added = mesh_.insert(centre) == InsertOutcome::Inserted || added;
      }
    }
  }

  /// Flips the third edge of triangles with two edges on the boundary where that leaves angles of
  /// at least 20°, so that a corner has more than one triangle.
  void open_corners() {
    for (std::size_t f = 0; f < mesh_.faces().size(); ++f) {
      const Face face = mesh_.faces()[f];
      if (!face.inside) continue;
      for (std::size_t i = 0; i < 3; ++i) {
        if (face.fixed[i] || !face.fixed[(i + 1) % 3] || !face.fixed[(i + 2) % 3]) continue;
        const int at = static_cast<int>(f);
        if (!mesh_.convex(at, i)) continue;
        mesh_.flip(at, i);
        const Face &one = mesh_.faces()[f],
                   &two = mesh_.faces()[static_cast<std::size_t>(face.next[i])];
        if ((std::min)(least_angle(one), least_angle(two)) < 20.0 / 57.29577951308232)
          mesh_.flip(at, 1);  // the edge between the two is opposite the middle corner
        break;
      }
    }
  }

  /// Returns the mesh inside. Boundary vertices keep their coordinates to the last bit.
  FilledRegion region() const {
    FilledRegion out;
    const std::size_t fixed = boundary_.points.size(), count = mesh_.points().size() - kFirst;
    out.positions.resize(2, static_cast<Index>(count));
    for (std::size_t v = 0; v < count; ++v)
      out.positions.col(static_cast<Index>(v)) =
          v < fixed ? boundary_.points[v] : to_plane(mesh_.points()[v + kFirst]);
    for (const Face& f : mesh_.faces()) {
      if (f.inside)
        out.triangles.push_back({f.vertex[0] - kFirst, f.vertex[1] - kFirst, f.vertex[2] - kFirst});
    }
    return out;
  }

 private:
  static constexpr int kFirst = 3;  // vertices below are the far ones

  std::size_t first_inner() const { return boundary_.points.size() + kFirst; }

  LatticePoint to_lattice(const FlatPoint& p) const {
    return {std::llround((p[0] - middle_[0]) / unit_), std::llround((p[1] - middle_[1]) / unit_)};
  }
  FlatPoint to_plane(const LatticePoint& p) const {
    return middle_ + unit_ * FlatPoint(static_cast<double>(p.x), static_cast<double>(p.y));
  }

  std::string at_side(std::size_t i) const {
    const FlatPoint& p = boundary_.points[i];
    return "side " + std::to_string(boundary_.side[i]) + " near (" + number_text(p[0]) + ", " +
           number_text(p[1]) + ") m";
  }

  void move_to_centre(int v, int start, std::vector<int>& ring) {
    if (start < 0) return;
    ring.clear();
    const LatticePoint from = mesh_.point(v);
    double area = 0, x = 0, y = 0;
    for (int at = start;;) {
      const Face& f = mesh_.faces()[static_cast<std::size_t>(at)];
      const std::size_t i = f.corner(v);
      const LatticePoint &b = mesh_.point(f.vertex[(i + 1) % 3]),
                         &c = mesh_.point(f.vertex[(i + 2) % 3]);
      const double a = static_cast<double>(orientation(from, b, c));
      area += a;
      x += a * static_cast<double>(b.x + c.x - 2 * from.x);
      y += a * static_cast<double>(b.y + c.y - 2 * from.y);
      ring.push_back(at);
      at = f.next[(i + 1) % 3];
      if (at == start) break;
      if (at < 0) return;
    }
    for (const double share : {1.0, 0.5}) {
      const double scale = share / (3 * area);
      mesh_.move(v, {from.x + std::llround(x * scale), from.y + std::llround(y * scale)});
      if (all_positive(ring)) return;
    }
    mesh_.move(v, from);
  }

  bool all_positive(const std::vector<int>& ring) const {
    for (const int f : ring) {
      const auto& corner = mesh_.faces()[static_cast<std::size_t>(f)].vertex;
      if (orientation(mesh_.point(corner[0]), mesh_.point(corner[1]), mesh_.point(corner[2])) <= 0)
        return false;
    }
    return true;
  }

  double least_angle(const Face& f) const {
    double least = 4;
    for (std::size_t i = 0; i < 3; ++i) {
      const FlatPoint p = to_plane(mesh_.point(f.vertex[i])),
                      u = to_plane(mesh_.point(f.vertex[(i + 1) % 3])) - p,
                      w = to_plane(mesh_.point(f.vertex[(i + 2) % 3])) - p;
      least = (std::min)(least, std::atan2(u[0] * w[1] - u[1] * w[0], u.dot(w)));
    }
    return least;
  }

  /// Returns whether a face has an angle below 25°, and the centre of its circle.
  bool circle_centre(const Face& f, LatticePoint& centre) const {
    const LatticePoint &a = mesh_.point(f.vertex[0]), &b = mesh_.point(f.vertex[1]),
                       &c = mesh_.point(f.vertex[2]);
    const double ux = static_cast<double>(b.x - a.x), uy = static_cast<double>(b.y - a.y),
                 wx = static_cast<double>(c.x - a.x), wy = static_cast<double>(c.y - a.y);
    const double u2 = ux * ux + uy * uy, w2 = wx * wx + wy * wy,
                 v2 = (ux - wx) * (ux - wx) + (uy - wy) * (uy - wy), twice = ux * wy - uy * wx;
    const double x = (wy * u2 - uy * w2) / (2 * twice), y = (ux * w2 - wx * u2) / (2 * twice);
    const double shortest = (std::min)({u2, v2, w2}), radius2 = x * x + y * y;
    // sin(least angle) = shortest / (2 radius)
    if (!(shortest < 4 * radius2 * 0.17860619515673032)) return false;  // sin² 25°
    if (shortest < 16) return false;  // only a few steps of the lattice
    const double limit = static_cast<double>(ConstrainedTriangulation::kExtent);
    const double cx = static_cast<double>(a.x) + x, cy = static_cast<double>(a.y) + y;
    if (!(std::abs(cx) < limit) || !(std::abs(cy) < limit)) return false;
    centre = {std::llround(cx), std::llround(cy)};
    return true;
  }

  /// Returns whether a point in a face sees a boundary edge of the face, or of its neighbours,
  /// under an angle of more than 90°.
  bool encroaches(int at, const LatticePoint& p) const {
    const Face& f = mesh_.faces()[static_cast<std::size_t>(at)];
    bool found = blocks(f, p);
    for (std::size_t i = 0; i < 3; ++i) {
      if (f.next[i] >= 0 && !f.fixed[i])
        found = found || blocks(mesh_.faces()[static_cast<std::size_t>(f.next[i])], p);
    }
    return found;
  }
  bool blocks(const Face& f, const LatticePoint& p) const {
    for (std::size_t i = 0; i < 3; ++i) {
      if (!f.fixed[i]) continue;
      const LatticePoint &a = mesh_.point(f.vertex[(i + 1) % 3]),
                         &b = mesh_.point(f.vertex[(i + 2) % 3]);
      if ((a.x - p.x) * (b.x - p.x) + (a.y - p.y) * (b.y - p.y) <= 0) return true;
    }
    return false;
  }

  const RegionBoundary& boundary_;
  double spacing_;
  FlatPoint low_, high_, middle_;
  double unit_ = 1;
  ConstrainedTriangulation mesh_;
};

/// Fills a region with triangles whose edges have about the length `spacing` (m). The caller has
/// made sure that all points are finite and different from their successors. Allocates. Complexity:
/// O(n log n) as a rule. Fails when: sides touch or cross, or there is more than one piece.
template <class = void>
Result<FilledRegion> fill_region(const RegionBoundary& boundary, double spacing) {
  PanelMesher<> mesher(boundary, spacing);
  if (std::string wrong = mesher.add_boundary(); !wrong.empty()) return Error{std::move(wrong)};
  mesher.fill();
  mesher.smooth(8);
  mesher.refine();
  mesher.smooth(4);
  mesher.refine();
  mesher.open_corners();
  return mesher.region();
}

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
