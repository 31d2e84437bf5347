#pragma once

// Two meshes of the same sheet: where the vertices of each lie in the other one. Vertices are
// weighted sums of vertices, with weights that are not negative and sum to one, found in the
// undeformed sheet: bilinear in the cells of a grid, barycentric in the triangles of other meshes.
// A vertex that both meshes share is that vertex alone.

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/result.hpp"
#include "clothctl/math/closest_point.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/prediction/features.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A coarse and a fine mesh of one sheet, each vertex as a sum of vertices of the other mesh.
template <RealScalar Scalar>
struct SheetSampling {
  /// The vertices of the coarse mesh, as sums of vertices of the fine one.
  PointFeatures<Scalar> coarse_from_fine;
  /// The vertices of the fine mesh, as sums of vertices of the coarse one.
  PointFeatures<Scalar> fine_from_coarse;
};

namespace detail {

/// A place on a line of `count` evenly spaced points: the point before it, and the share of the way
/// to the next.
struct PlaceOnLine {
  int before;
  double share;

  /// The place of point i of `points` on a line of `count` points over the same length.
  PlaceOnLine(int i, int points, int count) {
    const double at =
        static_cast<double>(i) * static_cast<double>(count - 1) / static_cast<double>(points - 1);
    before = (std::min)(static_cast<int>(at + 1e-9), count - 2);
    share = at - static_cast<double>(before);
    if (share < 1e-9) share = 0;
    if (1 - 1e-9 < share) share = 1;
  }
};

/// Returns the vertices of a grid as bilinear sums of those of another grid.
template <RealScalar Scalar>
PointFeatures<Scalar> sample_vertices(const GridMesh<Scalar>& of, const GridMesh<Scalar>& by) {
  PointFeatures<Scalar> out;
  for (int row = 0; row < of.rows; ++row) {
    const PlaceOnLine r(row, of.rows, by.rows);
    for (int col = 0; col < of.cols; ++col) {
      const PlaceOnLine c(col, of.cols, by.cols);
      std::vector<typename PointFeatures<Scalar>::Term> terms;
      for (const int down : {0, 1}) {
        for (const int right : {0, 1}) {
          const double weight =
              (down == 0 ? 1 - r.share : r.share) * (right == 0 ? 1 - c.share : c.share);
          if (0 < weight)
            terms.push_back({by.vertex(r.before + down, c.before + right), Scalar(weight)});
        }
      }
      out.add_sum(std::move(terms));
    }
  }
  return out;
}

/// Returns `points` (3×n, m) as sums of the corners of the nearest triangles of a mesh. Weights
/// that are rounding errors are left out.
template <RealScalar Scalar>
PointFeatures<Scalar> sample_points(const PointsView<Scalar>& points,
                                    const PointsView<Scalar>& vertices,
                                    const std::vector<std::array<int, 3>>& triangles) {
  PointFeatures<Scalar> out;
  for (Index i = 0; i < points.cols(); ++i) {
    PointOnTriangle<Scalar> best;
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      const std::array<int, 3>& c = triangles[t];
      const PointOnTriangle<Scalar> at = closest_on_triangle<Scalar>(
          points.col(i), {vertices.col(c[0]), vertices.col(c[1]), vertices.col(c[2])});
      if (best.triangle >= 0 && !(at.squared_distance < best.squared_distance)) continue;
      best = at;
      best.triangle = static_cast<int>(t);
    }
    const Scalar least = Scalar(64) * scalar_traits<Scalar>::epsilon();
    Scalar sum = Scalar(0);
    for (Scalar& weight : best.weights) {
      if (weight < least) weight = Scalar(0);
      sum += weight;
    }
    std::vector<typename PointFeatures<Scalar>::Term> terms;
    for (std::size_t c = 0; c < 3; ++c) {
      if (Scalar(0) < best.weights[c])
        terms.push_back(
            {triangles[static_cast<std::size_t>(best.triangle)][c], best.weights[c] / sum});
    }
    out.add_sum(std::move(terms));
  }
  return out;
}

/// Returns what is wrong with a mesh, or "".
template <RealScalar Scalar>
std::string check_sampled_mesh(const PointsView<Scalar>& vertices,
                               const std::vector<std::array<int, 3>>& triangles) {
  if (triangles.empty()) return "has no triangles";
  if (!all_finite(vertices)) return "has a vertex that is not finite";
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    for (const int v : triangles[t]) {
      if (v < 0 || v >= vertices.cols())
        return "has vertex " + std::to_string(v) + " in triangle " + std::to_string(t) + ", off " +
               std::to_string(vertices.cols()) + " vertices";
    }
  }
  return {};
}

}  // namespace detail

/// Returns the sampling of two grids of one sheet, whatever their numbers of vertices. Allocates.
template <RealScalar Scalar>
SheetSampling<Scalar> sample_grids(const GridMesh<Scalar>& fine, const GridMesh<Scalar>& coarse) {
  return {detail::sample_vertices(coarse, fine), detail::sample_vertices(fine, coarse)};
}

/// Returns the sampling of two triangle meshes of one sheet, from undeformed positions in the same
/// place: `fine` (3×n, m) and `coarse` (3×m, m). Allocates. Complexity: vertices of each mesh times
/// triangles of the other. Fails when: a mesh has no triangles, a triangle is off its mesh, or a
/// position is not finite.
template <RealScalar Scalar>
Result<SheetSampling<Scalar>> sample_meshes(
    const Points<Scalar>& fine, const std::vector<std::array<int, 3>>& fine_triangles,
    const Points<Scalar>& coarse, const std::vector<std::array<int, 3>>& coarse_triangles) {
  std::string problem = detail::check_sampled_mesh<Scalar>(fine, fine_triangles);
  if (!problem.empty()) return Error{"the fine mesh " + problem};
  problem = detail::check_sampled_mesh<Scalar>(coarse, coarse_triangles);
  if (!problem.empty()) return Error{"the coarse mesh " + problem};
  return SheetSampling<Scalar>{detail::sample_points<Scalar>(coarse, fine, fine_triangles),
                               detail::sample_points<Scalar>(fine, coarse, coarse_triangles)};
}

}  // namespace clothctl::inline CLOTHCTL_ABI
