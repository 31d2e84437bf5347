#pragma once

// Measures of flat triangle meshes, computed by definition, for the tests of panels and garments.

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "clothctl/mesh/panel_outline.hpp"
#include "clothctl/mesh/topology.hpp"

namespace clothctl_test {

/// Smallest and largest angle (degrees), smallest, mean and largest edge (m), share of triangles
/// with all angles above 50 degrees, sum and least of the areas (m²).
struct FlatMeasures {
  double least_angle = 180, largest_angle = 0, shortest = 1e300, mean = 0, longest = 0;
  double regular = 0, area = 0, least_area = 1e300;
};

inline FlatMeasures measure(const clothctl::FlatPoints& x,
                            const std::vector<std::array<int, 3>>& triangles) {
  FlatMeasures m;
  for (const auto& t : triangles) {
    double least = 180;
    for (std::size_t i = 0; i < 3; ++i) {
      const clothctl::FlatPoint p = x.col(t[i]), u = x.col(t[(i + 1) % 3]) - p,
                                w = x.col(t[(i + 2) % 3]) - p;
      const double angle =
          std::acos(std::clamp(u.dot(w) / (u.norm() * w.norm()), -1.0, 1.0)) * 57.29577951308232;
      least = std::min(least, angle);
      m.largest_angle = std::max(m.largest_angle, angle);
      m.shortest = std::min(m.shortest, u.norm());
      m.longest = std::max(m.longest, u.norm());
      m.mean += u.norm() / (3.0 * static_cast<double>(triangles.size()));
      if (i > 0) continue;
      const double area = (u[0] * w[1] - u[1] * w[0]) / 2;
      m.area += area;
      m.least_area = std::min(m.least_area, area);
    }
    m.least_angle = std::min(m.least_angle, least);
    m.regular += least > 50 ? 1.0 / static_cast<double>(triangles.size()) : 0.0;
  }
  return m;
}

/// V - E + F, or -1000 if the mesh is no manifold.
inline long euler(long vertices, const std::vector<std::array<int, 3>>& triangles) {
  const auto topology = clothctl::make_topology(vertices, triangles);
  if (!topology || !topology->consistently_oriented) return -1000;
  return vertices - static_cast<long>(topology->edges.size()) + static_cast<long>(triangles.size());
}

/// The area inside polygons by the shoelace formula. Each side lists vertices.
inline double shoelace(const clothctl::FlatPoints& x, const std::vector<std::vector<int>>& sides) {
  double twice = 0;
  for (const auto& side : sides) {
    for (std::size_t i = 1; i < side.size(); ++i)
      twice += x(0, side[i - 1]) * x(1, side[i]) - x(1, side[i - 1]) * x(0, side[i]);
  }
  return twice / 2;
}

}  // namespace clothctl_test
