#pragma once

// A triangle mesh in space together with its flat pattern, the data of an OBJ file with v, vt and
// f. The cloth is unstressed when every triangle has its shape in the pattern. Two triangles that
// share an edge in space may be apart in the pattern: a sewn garment has such an edge along every
// seam.

#include <array>
#include <string>
#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/mesh/panel_outline.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A triangle mesh in space with an optional flat pattern.
struct PatternMesh {
  /// Vertices in space, 3×n, m.
  Points<double> positions;
  /// Triangles of vertices in space, counter-clockwise seen from their front.
  std::vector<std::array<int, 3>> triangles;
  /// Points of the pattern, 2×m, m; empty if there is no pattern.
  FlatPoints pattern;
  /// The corners of each triangle in the pattern, in the same order as in space. Empty if there is
  /// no pattern.
  std::vector<std::array<int, 3>> pattern_triangles;

  /// Returns true when the mesh has a pattern.
  bool has_pattern() const { return !pattern_triangles.empty(); }

  /// Returns the area of a triangle in the pattern, m². It is negative if the triangle is
  /// clockwise.
  double pattern_area(std::size_t triangle) const {
    const std::array<int, 3>& t = pattern_triangles[triangle];
    const FlatPoint u = pattern.col(t[1]) - pattern.col(t[0]),
                    w = pattern.col(t[2]) - pattern.col(t[0]);
    return (u[0] * w[1] - u[1] * w[0]) / 2;
  }

  /// Returns an empty string when all coordinates are finite, all indices are in range, and the
  /// pattern, if there is one, has as many triangles as the mesh; else a line that names the first
  /// bad item. Allocates.
  std::string validate() const {
    const auto fault_of = [](const auto& points, const auto& cells, const std::string& what) {
      for (Index v = 0; v < points.cols(); ++v) {
        if (!all_finite(points.col(v))) return what + " " + std::to_string(v) + " is not finite";
      }
      for (std::size_t t = 0; t < cells.size(); ++t) {
        for (const int v : cells[t]) {
          if (v < 0 || v >= points.cols())
            return "triangle " + std::to_string(t) + " holds " + what + " " + std::to_string(v) +
                   " of " + std::to_string(points.cols());
        }
      }
      return std::string();
    };
    if (positions.cols() == 0 || triangles.empty()) return "mesh is empty";
    if (std::string wrong = fault_of(positions, triangles, "vertex"); !wrong.empty()) return wrong;
    if (!has_pattern()) return {};
    if (pattern_triangles.size() != triangles.size())
      return "pattern has " + std::to_string(pattern_triangles.size()) + " triangles, the mesh " +
             std::to_string(triangles.size());
    return fault_of(pattern, pattern_triangles, "pattern point");
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI
