#pragma once

// What is measured of a sheet, from its vertices alone, the same for all engines.

#include <vector>

#include "engine.hpp"

namespace versus {

/// Signed distance of a point from the exact shape (m).
double distance(const Obstacle& obstacle, const double* point);

/// The smallest distance of vertices, and of 15 points in each triangle (corners, edges, inside).
struct Clearance {
  double vertices = 0, points = 0;
};

Clearance clearance(const Scene& scene, const std::vector<double>& positions);

/// The largest of length over rest length - 1 of all edges.
double stretch(const Scene& scene, const std::vector<double>& positions);

/// Edges that pass through triangles without a common vertex; all pairs are tried.
int crossings(const Scene& scene, const std::vector<double>& positions);

}  // namespace versus
