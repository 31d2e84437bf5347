#pragma once

// Triangle meshes of tests, and what every mesh must satisfy after a change.

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/mesh/remap.hpp"
#include "clothctl/mesh/topology.hpp"
#include "support/shared_data.hpp"

namespace clothctl_test {

using clothctl::Index;
using Triangles = std::vector<std::array<int, 3>>;

/// A triangle mesh.
struct PlainMesh {
  clothctl::Points<double> positions;
  Triangles triangles;
};

/// A number from low to high that is the same with every standard library.
inline double uniform(std::mt19937& random, double low, double high) {
  return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
}

/// A sheet of n×m jittered vertices in the x-z plane, 1 m wide, with random diagonals; curved if
/// `bulge` is not 0, and with some cells missing if `holes`.
inline PlainMesh irregular_mesh(int n, int m, std::mt19937& random, double bulge = 0,
                                bool holes = false) {
  PlainMesh mesh;
  mesh.positions.resize(3, n * m);
  const double cell = 1.0 / (m - 1);
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < m; ++c) {
      const double x = cell * (c + uniform(random, -0.25, 0.25));
      const double z = cell * (r + uniform(random, -0.25, 0.25));
      mesh.positions.col(r * m + c) << x, bulge * std::sin(2 * x) * std::cos(3 * z), z;
    }
  }
  std::vector<bool> used(static_cast<std::size_t>(n * m), false);
  for (int r = 0; r + 1 < n; ++r) {
    for (int c = 0; c + 1 < m; ++c) {
      const int a = r * m + c, b = a + 1, d = a + m, e = d + 1;
      if (holes && random() % 12 == 0) continue;
      if (random() % 2 == 0) {
        mesh.triangles.push_back({a, b, e});
        mesh.triangles.push_back({a, e, d});
      } else {
        mesh.triangles.push_back({a, b, d});
        mesh.triangles.push_back({b, e, d});
      }
    }
  }
  // Vertices of no triangle are removed.
  for (const auto& t : mesh.triangles) {
    for (int v : t) used[static_cast<std::size_t>(v)] = true;
  }
  std::vector<int> number(used.size(), -1);
  int count = 0;
  for (std::size_t v = 0; v < used.size(); ++v) {
    if (!used[v]) continue;
    mesh.positions.col(count) = mesh.positions.col(static_cast<Index>(v)).eval();
    number[v] = count++;
  }
  mesh.positions.conservativeResize(3, count);
  for (auto& t : mesh.triangles) {
    for (int& v : t) v = number[static_cast<std::size_t>(v)];
  }
  return mesh;
}

/// Reads a mesh of the shared folder; polygons become fans. Empty if the file is missing.
inline PlainMesh shared_mesh(const std::string& name) {
  PlainMesh mesh;
  const std::string path = shared_path("data/meshes/" + name);
  if (path.empty()) return mesh;
  std::ifstream file(path);
  std::vector<double> x;
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::string word;
    words >> word;
    if (word == "v") {
      double value = 0;
      for (int c = 0; c < 3 && words >> value; ++c) x.push_back(value);
    } else if (word == "f") {
      std::vector<int> corner;
      while (words >> word) corner.push_back(std::stoi(word) - 1);
      for (std::size_t i = 2; i < corner.size(); ++i)
        mesh.triangles.push_back({corner[0], corner[i - 1], corner[i]});
    }
  }
  mesh.positions.resize(3, static_cast<Index>(x.size() / 3));
  for (std::size_t i = 0; i < x.size(); ++i) mesh.positions(static_cast<Index>(i)) = x[i];
  return mesh;
}

/// Sum of the areas of all triangles.
inline double total_area(const clothctl::Points<double>& x, const Triangles& triangles) {
  double area = 0;
  for (const auto& t : triangles) {
    const Eigen::Vector3d u = x.col(t[1]) - x.col(t[0]), v = x.col(t[2]) - x.col(t[0]);
    area += 0.5 * u.cross(v).norm();
  }
  return area;
}

/// V - E + F, with E counted as a set of pairs; vertices of no triangle do not count.
inline int euler(const Triangles& triangles) {
  std::set<std::array<int, 2>> edges;
  std::set<int> vertices;
  for (const auto& t : triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      vertices.insert(t[i]);
      edges.insert({std::min(t[i], t[(i + 1) % 3]), std::max(t[i], t[(i + 1) % 3])});
    }
  }
  return static_cast<int>(vertices.size()) - static_cast<int>(edges.size()) +
         static_cast<int>(triangles.size());
}

/// Returns "" if the mesh is a manifold with this orientation whose vertices all belong to
/// triangles, else what is wrong. Counts edges by itself.
inline std::string mesh_fault(Index vertices, const Triangles& triangles, bool oriented = true) {
  const auto topology = clothctl::make_topology(vertices, triangles);
  if (!topology) return topology.error();
  if (oriented && !topology->consistently_oriented) return "a triangle is flipped";
  for (int v = 0; v < static_cast<int>(vertices); ++v) {
    if (topology->neighbours(v).empty())
      return "vertex " + std::to_string(v) + " belongs to no triangle";
  }
  return {};
}

/// Returns the number of fans of triangles around a vertex: 1 on a manifold.
inline int fans(int vertex, const Triangles& triangles) {
  std::vector<std::array<int, 2>> rest;
  for (const auto& t : triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      if (t[i] == vertex) rest.push_back({t[(i + 1) % 3], t[(i + 2) % 3]});
    }
  }
  int count = 0;
  while (!rest.empty()) {
    std::set<int> ring(rest.back().begin(), rest.back().end());
    rest.pop_back();
    for (bool grew = true; grew;) {
      grew = false;
      for (std::size_t i = 0; i < rest.size(); ++i) {
        if (ring.count(rest[i][0]) == 0 && ring.count(rest[i][1]) == 0) continue;
        ring.insert(rest[i].begin(), rest[i].end());
        rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
        grew = true;
        break;
      }
    }
    ++count;
  }
  return count;
}

/// Returns "" if a remap fits both meshes: every origin reproduces the place of its vertex, copies
/// are where the old vertex was, corner weights reproduce the triangles, shares of area sum to one.
inline std::string remap_fault(const clothctl::Remap<double>& remap, const PlainMesh& before,
                               const Triangles& after, double tolerance = 1e-12) {
  if (remap.old_vertex_count() != before.positions.cols()) return "wrong number of old vertices";
  if (remap.triangle_count() != static_cast<Index>(after.size())) return "wrong triangle count";
  const clothctl::Points<double> x = remap.interpolate(before.positions);
  for (int v = 0; v < static_cast<int>(remap.vertex_count()); ++v) {
    double sum = 0;
    for (const auto& share : remap.origin(v)) sum += share.weight;
    if (std::abs(sum - 1) > 1e-12) return "weights of vertex " + std::to_string(v);
  }
  for (int v = 0; v < static_cast<int>(remap.old_vertex_count()); ++v) {
    if (remap.copies(v).empty()) return "no copy of vertex " + std::to_string(v);
    for (const int copy : remap.copies(v)) {
      if ((x.col(copy) - before.positions.col(v)).norm() > tolerance)
        return "copy of vertex " + std::to_string(v);
    }
  }
  for (int t = 0; t < static_cast<int>(after.size()); ++t) {
    const auto& old = before.triangles[static_cast<std::size_t>(remap.parent(t))];
    for (std::size_t i = 0; i < 3; ++i) {
      Eigen::Vector3d place = Eigen::Vector3d::Zero();
      for (std::size_t k = 0; k < 3; ++k)
        place += remap.corners(t)[i][k] * before.positions.col(old[k]);
      if ((place - x.col(after[static_cast<std::size_t>(t)][i])).norm() > tolerance)
        return "corner of triangle " + std::to_string(t);
    }
  }
  for (int t = 0; t < static_cast<int>(remap.old_triangle_count()); ++t) {
    double share = 0;
    for (const int child : remap.children(t)) {
      if (remap.parent(child) != t) return "children of triangle " + std::to_string(t);
      if (!(clothctl::area_share(remap.corners(child)) > 0)) return "a triangle without area";
      share += clothctl::area_share(remap.corners(child));
    }
    if (std::abs(share - 1) > 1e-12) return "area of triangle " + std::to_string(t);
  }
  return {};
}

}  // namespace clothctl_test
