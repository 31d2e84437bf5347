#pragma once

// Closed triangle meshes of tests, and an oracle for signed distances: all triangles in long
// double, the sign by the winding number. It shares no code with the library.

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "support/meshes.hpp"

namespace clothctl_test {

/// A sphere about the origin: an icosahedron with each triangle split in four `levels` times.
inline PlainMesh icosphere(int levels, double radius) {
  const double g = 0.5 * (1.0 + std::sqrt(5.0));
  std::vector<Eigen::Vector3d> x{{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                                 {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                                 {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
  Triangles triangles{{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                      {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                      {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                      {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  for (int level = 0; level < levels; ++level) {
    std::map<std::array<int, 2>, int> middles;
    const auto middle = [&](int a, int b) {
      const std::array<int, 2> key{std::min(a, b), std::max(a, b)};
      const auto [at, fresh] = middles.try_emplace(key, static_cast<int>(x.size()));
      if (fresh)
        x.push_back(x[static_cast<std::size_t>(a)].normalized() +
                    x[static_cast<std::size_t>(b)].normalized());
      return at->second;
    };
    Triangles finer;
    for (const auto& t : triangles) {
      const int ab = middle(t[0], t[1]), bc = middle(t[1], t[2]), ca = middle(t[2], t[0]);
      finer.insert(finer.end(), {{t[0], ab, ca}, {t[1], bc, ab}, {t[2], ca, bc}, {ab, bc, ca}});
    }
    triangles = finer;
  }
  PlainMesh mesh{clothctl::Points<double>(3, static_cast<Index>(x.size())), triangles};
  for (std::size_t i = 0; i < x.size(); ++i)
    mesh.positions.col(static_cast<Index>(i)) = radius * x[i].normalized();
  return mesh;
}

/// A box of 12 triangles about the origin.
inline PlainMesh box_mesh(const Eigen::Vector3d& half) {
  PlainMesh mesh{clothctl::Points<double>(3, 8), {}};
  for (int i = 0; i < 8; ++i)
    mesh.positions.col(i) =
        Eigen::Vector3d(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1).cwiseProduct(half);
  mesh.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                    {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return mesh;
}

/// A torus about the z axis: `around` × `across` vertices.
inline PlainMesh torus_mesh(int around, int across, double radius, double thickness) {
  PlainMesh mesh{clothctl::Points<double>(3, around * across), {}};
  const double turn = 2.0 * std::acos(-1.0);
  for (int i = 0; i < around; ++i) {
    for (int j = 0; j < across; ++j) {
      const double u = turn * i / around, v = turn * j / across;
      const double out = radius + thickness * std::cos(v);
      mesh.positions.col(i * across + j) << out * std::cos(u), out * std::sin(u),
          thickness * std::sin(v);
      const int a = i * across + j, b = (i + 1) % around * across + j;
      const int c = (i + 1) % around * across + (j + 1) % across;
      const int d = i * across + (j + 1) % across;
      mesh.triangles.push_back({a, b, c});
      mesh.triangles.push_back({a, c, d});
    }
  }
  return mesh;
}

using LongVector = Eigen::Matrix<long double, 3, 1>;

/// The distance of x from the segment from a to b.
inline long double segment_distance(const LongVector& x, const LongVector& a, const LongVector& b) {
  const LongVector ab = b - a;
  const long double t = std::clamp((x - a).dot(ab) / ab.squaredNorm(), 0.0L, 1.0L);
  return (x - a - t * ab).norm();
}

/// The distance of x from a triangle: the height over its plane if the foot lies inside, else the
/// distance from the nearest side.
inline long double triangle_distance(const LongVector& x, const LongVector& a, const LongVector& b,
                                     const LongVector& c) {
  const LongVector n = (b - a).cross(c - a);
  const long double size = n.norm();
  if (size > 0) {
    const long double height = n.dot(x - a) / size;
    const LongVector foot = x - height / size * n;
    if (n.dot((b - a).cross(foot - a)) >= 0 && n.dot((c - b).cross(foot - b)) >= 0 &&
        n.dot((a - c).cross(foot - c)) >= 0)
      return std::abs(height);
  }
  return std::min(
      {segment_distance(x, a, b), segment_distance(x, b, c), segment_distance(x, c, a)});
}

/// The distance of x from the nearest of a mesh's triangles.
inline long double brute_triangles(const PlainMesh& mesh, const Eigen::Vector3d& x) {
  long double best = std::numeric_limits<long double>::max();
  for (const auto& t : mesh.triangles) {
    const LongVector a = mesh.positions.col(t[0]).cast<long double>();
    const LongVector b = mesh.positions.col(t[1]).cast<long double>();
    const LongVector c = mesh.positions.col(t[2]).cast<long double>();
    best = std::min(best, triangle_distance(x.cast<long double>(), a, b, c));
  }
  return best;
}

/// The signed distance of x from a closed mesh.
inline long double brute_distance(const PlainMesh& mesh, const Eigen::Vector3d& point) {
  const LongVector x = point.cast<long double>();
  long double best = std::numeric_limits<long double>::max(), winding = 0;
  for (const auto& t : mesh.triangles) {
    const LongVector a = mesh.positions.col(t[0]).cast<long double>() - x;
    const LongVector b = mesh.positions.col(t[1]).cast<long double>() - x;
    const LongVector c = mesh.positions.col(t[2]).cast<long double>() - x;
    best = std::min(best, triangle_distance(LongVector::Zero(), a, b, c));
    // The solid angle (van Oosterom, Strackee 1983).
    const long double la = a.norm(), lb = b.norm(), lc = c.norm();
    winding +=
        std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return winding > std::acos(-1.0L) ? -best : best;  // 2π inside, 0 outside
}

}  // namespace clothctl_test
