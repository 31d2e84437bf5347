#pragma once

// The outline of a flat panel of cloth, drawn as on paper: counter-clockwise, side by side.
//
//   PanelOutline pocket({0, 0});
//   pocket.line_to({0.12, 0}).line_to({0.12, 0.14}).line_to({0, 0.14})
//         .curve_to({-0.02, 0.10}, {-0.02, 0.04}, {0, 0});
//
// A curve is a cubic Bézier curve, p(t) = (1-t)³ p0 + 3 (1-t)² t c1 + 3 (1-t) t² c2 + t³ p1, as in
// SVG. A dart is a notch of the outline: two sides that a seam closes. Coordinates are in m and
// seen from the front of the cloth. Patterns are always in double: they are drawn once, and meshes
// of them are built with exact tests.

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A point of a flat pattern, m.
using FlatPoint = DenseMatrix<double, 2, 1>;

/// n points of a flat pattern as the columns of a 2×n matrix, m.
using FlatPoints = DenseMatrix<double, 2, Eigen::Dynamic>;

/// One side of an outline, from one corner to the next.
struct OutlineSide {
  /// The points from the first corner to the last, both included. A smooth side is a dense polygon
  /// of its curve.
  std::vector<FlatPoint> points;
  /// True when only the two ends are corners, so that a mesh may cut the others. False when a mesh
  /// must have a vertex at every point.
  bool smooth = false;

  /// Returns the length of the side, m.
  double length() const {
    double sum = 0;
    for (std::size_t i = 1; i < points.size(); ++i) sum += (points[i] - points[i - 1]).norm();
    return sum;
  }
};

/// A closed outline with optional holes.
class PanelOutline {
 public:
  /// Starts at a corner. Allocates.
  explicit PanelOutline(const FlatPoint& start) : start_(start) {}

  /// Adds a straight side to `end`. Allocates.
  PanelOutline& line_to(const FlatPoint& end) { return path_to({end}); }

  /// Adds one side of several straight parts, through all points to the last one. Allocates.
  PanelOutline& path_to(const std::vector<FlatPoint>& points) {
    OutlineSide side;
    side.points.push_back(current());
    side.points.insert(side.points.end(), points.begin(), points.end());
    sides_.push_back(std::move(side));
    return *this;
  }

  /// Adds a smooth side to `end`: the Bézier curve with the control points `c1` and `c2`. It is
  /// stored as 256 chords; the error of its place and length is below 1e-5 of its length if it
  /// turns by less than a right angle. Allocates.
  PanelOutline& curve_to(const FlatPoint& c1, const FlatPoint& c2, const FlatPoint& end) {
    constexpr int chords = 256;
    const FlatPoint from = current();
    OutlineSide side;
    side.smooth = true;
    side.points.reserve(chords + 1);
    for (int i = 0; i <= chords; ++i) {
      const double t = static_cast<double>(i) / chords, s = 1 - t;
      const FlatPoint p =
          s * s * s * from + 3 * s * s * t * c1 + 3 * s * t * t * c2 + t * t * t * end;
      side.points.push_back(i == chords ? end : p);
    }
    sides_.push_back(std::move(side));
    return *this;
  }

  /// Adds a smooth side through dense points to the last one, from any kind of curve. Allocates.
  PanelOutline& smooth_to(const std::vector<FlatPoint>& points) {
    path_to(points);
    sides_.back().smooth = true;
    return *this;
  }

  /// Adds a hole, drawn in either direction. A hole of a hole is not allowed. Allocates.
  PanelOutline& add_hole(const PanelOutline& hole) {
    holes_.push_back(hole.closed_sides());
    return *this;
  }

  /// Returns the sides of the outline. If the last side does not end at the start, a straight one
  /// that does is added. Allocates.
  std::vector<OutlineSide> closed_sides() const {
    std::vector<OutlineSide> sides = sides_;
    const FlatPoint end = current();
    if (end[0] < start_[0] || start_[0] < end[0] || end[1] < start_[1] || start_[1] < end[1])
      sides.push_back(OutlineSide{{end, start_}, false});
    return sides;
  }

  /// Returns the sides of each hole.
  const std::vector<std::vector<OutlineSide>>& holes() const { return holes_; }

  /// Returns the sides of the outline, then those of the holes, in the order in which a mesh and a
  /// seam number them. Allocates.
  std::vector<OutlineSide> all_sides() const {
    std::vector<OutlineSide> sides = closed_sides();
    for (const std::vector<OutlineSide>& hole : holes_)
      sides.insert(sides.end(), hole.begin(), hole.end());
    return sides;
  }

  /// Returns the area inside the outline less that of the holes, m². It is negative when the
  /// outline is drawn clockwise.
  double area() const {
    double sum = signed_area(closed_sides());
    for (const std::vector<OutlineSide>& hole : holes_) {
      const double inner = signed_area(hole);
      sum -= inner < 0 ? -inner : inner;
    }
    return sum;
  }

 private:
  FlatPoint current() const { return sides_.empty() ? start_ : sides_.back().points.back(); }

  static double signed_area(const std::vector<OutlineSide>& sides) {
    double twice = 0;
    if (sides.empty()) return 0;
    const FlatPoint base = sides[0].points[0];  // keeps the products small
    for (const OutlineSide& side : sides) {
      for (std::size_t i = 1; i < side.points.size(); ++i) {
        const FlatPoint p = side.points[i - 1] - base, q = side.points[i] - base;
        twice += p[0] * q[1] - p[1] * q[0];
      }
    }
    return twice / 2;
  }

  FlatPoint start_;
  std::vector<OutlineSide> sides_;
  std::vector<std::vector<OutlineSide>> holes_;
};

/// Returns a rectangle with one corner at the origin, of width × height (m). Its sides are bottom,
/// right, top, left. Allocates.
template <class = void>
PanelOutline rectangle_outline(double width, double height) {
  PanelOutline outline(FlatPoint(0, 0));
  outline.line_to(FlatPoint(width, 0)).line_to(FlatPoint(width, height));
  outline.line_to(FlatPoint(0, height)).line_to(FlatPoint(0, 0));
  return outline;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
