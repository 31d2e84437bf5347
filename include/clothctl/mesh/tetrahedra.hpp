#pragma once

// Tetrahedral meshes of a ball and a box, their volumes, edges and surface. A tetrahedron
// (a, b, c, d) is positive when V = det(b-a, c-a, d-a) / 6 > 0. Its outward faces are then acb,
// abd, adc and bcd.
//
// Box: every cell is divided into six tetrahedra, one for each order of the three axes (Kuhn). The
// faces of neighbouring cells match.
//
// Ball: the mesh starts as the octahedron |x|+|y|+|z| ≤ n on the integer lattice. With p = x+y+z, q
// = y+z, r = z, one octant is n ≥ p ≥ q ≥ r ≥ 0. Kuhn's division of the (p, q, r) lattice fills
// this octant with n³ tetrahedra of equal volume; their mirror images fill the other seven octants,
// and all faces match. Then each vertex moves along the ray from the centre through it, x → radius
// (|x|₁/n) x/|x|₂, which maps the faces of the octahedron onto the sphere.

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A tetrahedral mesh.
template <RealScalar Scalar>
struct TetMesh {
  /// Vertex positions, 3×n, m.
  Points<Scalar> positions;
  /// The four vertices of each tetrahedron, in positive order.
  std::vector<std::array<int, 4>> tetrahedra;

  /// Returns the signed volume of one tetrahedron, m³.
  Scalar volume(std::size_t tetrahedron) const {
    const std::array<int, 4>& t = tetrahedra[tetrahedron];
    const Vector3<Scalar> u = positions.col(t[1]) - positions.col(t[0]);
    const Vector3<Scalar> v = positions.col(t[2]) - positions.col(t[0]);
    const Vector3<Scalar> w = positions.col(t[3]) - positions.col(t[0]);
    return (u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) +
            u[2] * (v[0] * w[1] - v[1] * w[0])) /
           Scalar(6.0);
  }

  /// Returns an empty string when positions are finite, indices are in range, all volumes are
  /// positive and every vertex belongs to a tetrahedron; else a line that names the first bad item.
  std::string validate() const {
    const Index n = positions.cols();
    if (n == 0 || tetrahedra.empty()) return "tetrahedral mesh is empty";
    for (Index v = 0; v < n; ++v) {
      if (!all_finite(positions.col(v)))
        return "position of vertex " + std::to_string(v) + " is not finite";
    }
    std::vector<bool> used(static_cast<std::size_t>(n), false);
    for (std::size_t t = 0; t < tetrahedra.size(); ++t) {
      const std::string name = "tetrahedron " + std::to_string(t);
      for (int v : tetrahedra[t]) {
        if (v < 0 || v >= n)
          return name + " holds vertex " + std::to_string(v) + " off the mesh of " +
                 std::to_string(n) + " vertices";
        used[static_cast<std::size_t>(v)] = true;
      }
      const Scalar v = volume(t);
      if (!is_finite(v) || !(Scalar(0) < v))
        return name + " has no positive volume, got " + number_text(v) + " m^3";
    }
    for (Index v = 0; v < n; ++v) {
      if (!used[static_cast<std::size_t>(v)])
        return "vertex " + std::to_string(v) + " belongs to no tetrahedron";
    }
    return {};
  }
};

namespace detail {

/// Calls `visit` for each of the six Kuhn tetrahedra of a lattice cell, with its four corners as
/// bit sets of axes (bit i: one step along axis i). The corners are in positive order for
/// right-handed axes.
template <class Function>
void for_each_kuhn_tetrahedron(Function&& visit) {
  constexpr std::array<std::array<int, 3>, 6> orders{
      {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}}};
  for (std::size_t i = 0; i < orders.size(); ++i) {
    const int first = 1 << orders[i][0], second = first | 1 << orders[i][1];
    std::array<int, 4> corner{0, first, second, 7};
    if (i >= 3) std::swap(corner[1], corner[2]);
    visit(corner);
  }
}

/// The points |x| + |y| + |z| ≤ n of the integer lattice, numbered with x fastest and z slowest.
class OctahedronLattice {
 public:
  /// Allocates. Complexity: O(n³).
  explicit OctahedronLattice(int n) : n_(n) {
    const std::size_t side = 2 * static_cast<std::size_t>(n) + 1;
    number_.assign(side * side * side, -1);
    points_.reserve(static_cast<std::size_t>((2 * n + 1) * (2 * n * n + 2 * n + 3) / 3));
    for (int k = -n; k <= n; ++k) {
      for (int j = -n; j <= n; ++j) {
        for (int i = -n; i <= n; ++i) {
          if (layer({i, j, k}) > n) continue;
          number_[slot({i, j, k})] = static_cast<int>(points_.size());
          points_.push_back({i, j, k});
        }
      }
    }
  }
  /// Number of layers n from the centre to the surface.
  int layers() const { return n_; }
  /// The layer |x| + |y| + |z| of a point.
  static int layer(const std::array<int, 3>& at) {
    return (at[0] < 0 ? -at[0] : at[0]) + (at[1] < 0 ? -at[1] : at[1]) +
           (at[2] < 0 ? -at[2] : at[2]);
  }
  /// All points, in the order of their numbers.
  const std::vector<std::array<int, 3>>& points() const { return points_; }
  /// The number of a point.
  int number(const std::array<int, 3>& at) const { return number_[slot(at)]; }

 private:
  std::size_t slot(const std::array<int, 3>& at) const {
    const std::size_t side = 2 * static_cast<std::size_t>(n_) + 1;
    const auto shifted = [&](std::size_t c) {
      const int from_corner = at[c] + n_;
      return static_cast<std::size_t>(from_corner);
    };
    return shifted(0) + side * (shifted(1) + side * shifted(2));
  }

  int n_;
  std::vector<int> number_;
  std::vector<std::array<int, 3>> points_;
};

/// Moves each lattice point along the ray from the centre through it, so that the octahedron
/// becomes a ball (radius and centre in m). Returns the positions, 3×vertices. Allocates.
template <RealScalar Scalar>
Points<Scalar> ball_positions(const OctahedronLattice& lattice, const Scalar& radius,
                              const Vector3<Scalar>& centre) {
  using std::sqrt;
  const double layers = static_cast<double>(lattice.layers());
  Points<Scalar> positions(3, static_cast<Index>(lattice.points().size()));
  Index vertex = 0;
  for (const std::array<int, 3>& at : lattice.points()) {
    const int squared = at[0] * at[0] + at[1] * at[1] + at[2] * at[2];
    const Scalar length = sqrt(Scalar(static_cast<double>(squared)));
    const Scalar share = Scalar(static_cast<double>(OctahedronLattice::layer(at)) / layers);
    for (std::size_t c = 0; c < 3; ++c) {
      const Index row = static_cast<Index>(c);
      const Scalar along = at[c] == 0 ? Scalar(0) : Scalar(static_cast<double>(at[c])) / length;
      positions(row, vertex) = centre[row] + radius * share * along;
    }
    ++vertex;
  }
  return positions;
}

/// Appends the tetrahedra of one octant of the octahedron: Kuhn's division of n ≥ p ≥ q ≥ r ≥ 0.
/// `sign` holds the signs of x, y and z in the octant.
inline void add_octant(const OctahedronLattice& lattice, const std::array<int, 3>& sign,
                       std::vector<std::array<int, 4>>& tetrahedra) {
  const bool mirrored = sign[0] * sign[1] * sign[2] < 0;
  for (int p = 0; p < lattice.layers(); ++p) {
    for (int q = 0; q <= p; ++q) {
      for (int r = 0; r <= q; ++r) {
        for_each_kuhn_tetrahedron([&](const std::array<int, 4>& corner) {
          std::array<int, 4> t{};
          for (std::size_t c = 0; c < 4; ++c) {
            const int P = p + (corner[c] & 1), Q = q + (corner[c] >> 1 & 1),
                      R = r + (corner[c] >> 2 & 1);
            if (P < Q || Q < R) return;
            t[c] = lattice.number({sign[0] * (P - Q), sign[1] * (Q - R), sign[2] * R});
          }
          if (mirrored) std::swap(t[0], t[1]);
          tetrahedra.push_back(t);
        });
      }
    }
  }
}

/// Divides the octahedron into 8 n³ tetrahedra of equal volume, octant by octant. Allocates.
inline std::vector<std::array<int, 4>> octahedron_tetrahedra(const OctahedronLattice& lattice) {
  const std::size_t n = static_cast<std::size_t>(lattice.layers());
  std::vector<std::array<int, 4>> tetrahedra;
  tetrahedra.reserve(8 * n * n * n);
  for (int octant = 0; octant < 8; ++octant)
    add_octant(lattice, {1 - 2 * (octant & 1), 1 - (octant & 2), 1 - (octant & 4) / 2}, tetrahedra);
  return tetrahedra;
}

}  // namespace detail

/// Makes a box of nx × ny × nz cells, centred at the origin. `size` holds its edge lengths, m.
/// Vertex (i, j, k) has the index i + (nx+1) (j + (ny+1) k). Allocates. Complexity: O(nx ny nz).
/// Fails when: a count is below 1, there are more than 10^7 cells, a size is not positive and
/// finite, or a volume is too small or too large for Scalar.
template <RealScalar Scalar>
Result<TetMesh<Scalar>> make_box(int nx, int ny, int nz, const Vector3<Scalar>& size) {
  const std::array<int, 3> count{nx, ny, nz};
  double cells = 1.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::string axis(1, "xyz"[i]);
    const Scalar extent = size[static_cast<Index>(i)];
    if (count[i] < 1)
      return Error{"box needs at least 1 cell along " + axis + ", got " + std::to_string(count[i])};
    if (!is_finite(extent) || !(Scalar(0) < extent))
      return Error{"box size along " + axis + " must be positive, got " + number_text(extent)};
    cells *= static_cast<double>(count[i]);
  }
  if (cells > 1e7) return Error{"box of " + number_text(cells) + " cells is too large"};

  TetMesh<Scalar> mesh;
  mesh.positions.resize(3, static_cast<Index>(nx + 1) * (ny + 1) * (nz + 1));
  const auto vertex = [nx, ny](int i, int j, int k) { return i + (nx + 1) * (j + (ny + 1) * k); };
  for (int k = 0; k <= nz; ++k) {
    for (int j = 0; j <= ny; ++j) {
      for (int i = 0; i <= nx; ++i) {
        const std::array<int, 3> at{i, j, k};
        for (std::size_t c = 0; c < 3; ++c) {
          const double share =
              static_cast<double>(2 * at[c] - count[c]) / static_cast<double>(2 * count[c]);
          mesh.positions(static_cast<Index>(c), vertex(i, j, k)) =
              size[static_cast<Index>(c)] * Scalar(share);
        }
      }
    }
  }
  mesh.tetrahedra.reserve(6 * static_cast<std::size_t>(cells));
  for (int k = 0; k < nz; ++k) {
    for (int j = 0; j < ny; ++j) {
      for (int i = 0; i < nx; ++i) {
        detail::for_each_kuhn_tetrahedron([&](const std::array<int, 4>& corner) {
          std::array<int, 4> t{};
          for (std::size_t c = 0; c < 4; ++c)
            t[c] = vertex(i + (corner[c] & 1), j + (corner[c] >> 1 & 1), k + (corner[c] >> 2 & 1));
          mesh.tetrahedra.push_back(t);
        });
      }
    }
  }
  if (std::string problem = mesh.validate(); !problem.empty()) return Error{"box: " + problem};
  return mesh;
}

/// Makes a ball; `radius` and `centre` are in m. `resolution` is the number of layers from centre
/// to surface; the ball has 8 resolution³ tetrahedra. The first vertex is the south pole centre -
/// (0, 0, radius), the last one the north pole centre + (0, 0, radius), the middle one the centre.
/// Allocates. Complexity: O(resolution³). Fails when: resolution is below 1 or above 100, the
/// radius is not positive and finite, the centre is not finite, or a volume is too small or too
/// large for Scalar.
template <RealScalar Scalar>
Result<TetMesh<Scalar>> make_ball(Scalar radius, int resolution, const Vector3<Scalar>& centre) {
  if (resolution < 1 || resolution > 100)
    return Error{"ball resolution must be 1 to 100, got " + std::to_string(resolution)};
  if (!is_finite(radius) || !(Scalar(0) < radius))
    return Error{"ball radius must be positive, got " + number_text(radius)};
  if (!all_finite(centre)) return Error{"ball centre is not finite"};
  const detail::OctahedronLattice lattice(resolution);
  TetMesh<Scalar> mesh;
  mesh.positions = detail::ball_positions(lattice, radius, centre);
  mesh.tetrahedra = detail::octahedron_tetrahedra(lattice);
  if (std::string problem = mesh.validate(); !problem.empty()) return Error{"ball: " + problem};
  return mesh;
}

/// Returns the volume of every tetrahedron, m³. Allocates.
template <RealScalar Scalar>
VectorX<Scalar> tetrahedron_volumes(const TetMesh<Scalar>& mesh) {
  VectorX<Scalar> volumes(static_cast<Index>(mesh.tetrahedra.size()));
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t)
    volumes[static_cast<Index>(t)] = mesh.volume(t);
  return volumes;
}

/// Returns every edge (a, b) of a tetrahedral mesh once, with a < b, ascending. Allocates.
/// Complexity: O(n log n).
template <RealScalar Scalar>
std::vector<std::array<int, 2>> tetrahedron_edges(const TetMesh<Scalar>& mesh) {
  std::vector<std::array<int, 2>> edges;
  edges.reserve(6 * mesh.tetrahedra.size());
  for (const std::array<int, 4>& t : mesh.tetrahedra) {
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = i + 1; j < 4; ++j)
        edges.push_back({(std::min)(t[i], t[j]), (std::max)(t[i], t[j])});
    }
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

/// Returns the faces that belong to one tetrahedron only, counter-clockwise seen from outside, in
/// the order of the tetrahedra. Allocates. Complexity: O(n log n).
template <RealScalar Scalar>
std::vector<std::array<int, 3>> surface_triangles(const TetMesh<Scalar>& mesh) {
  constexpr std::array<std::array<std::size_t, 3>, 4> faces{
      {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};
  std::vector<std::array<int, 3>> outward;
  std::vector<std::pair<std::array<int, 3>, std::size_t>> keys;
  outward.reserve(4 * mesh.tetrahedra.size());
  keys.reserve(4 * mesh.tetrahedra.size());
  for (const std::array<int, 4>& t : mesh.tetrahedra) {
    for (const std::array<std::size_t, 3>& face : faces) {
      std::array<int, 3> triangle{t[face[0]], t[face[1]], t[face[2]]};
      outward.push_back(triangle);
      std::sort(triangle.begin(), triangle.end());
      keys.emplace_back(triangle, keys.size());
    }
  }
  std::sort(keys.begin(), keys.end());
  std::vector<std::size_t> single;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const bool as_before = i > 0 && keys[i - 1].first == keys[i].first;
    const bool as_after = i + 1 < keys.size() && keys[i + 1].first == keys[i].first;
    if (!as_before && !as_after) single.push_back(keys[i].second);
  }
  std::sort(single.begin(), single.end());
  std::vector<std::array<int, 3>> surface;
  surface.reserve(single.size());
  for (std::size_t i : single) surface.push_back(outward[i]);
  return surface;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
