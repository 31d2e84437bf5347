#include "clothctl/network/surface_distance.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::irregular_sheet;
using clothctl_test::TriangleSheet;

namespace {

/// The sides of all triangles, as long as they are at these positions.
std::vector<SurfaceEdge<>> edges_of(const Points<double>& positions,
                                    const std::vector<std::array<int, 3>>& triangles) {
  std::set<std::pair<int, int>> pairs;
  for (const std::array<int, 3>& t : triangles) {
    for (std::size_t i = 0; i < 3; ++i) pairs.insert(std::minmax(t[i], t[(i + 1) % 3]));
  }
  std::vector<SurfaceEdge<>> edges;
  for (const auto& [a, b] : pairs)
    edges.push_back({a, b, (positions.col(a) - positions.col(b)).norm()});
  return edges;
}

/// Distances from a source; infinite where `spread` does not come.
std::vector<double> distances(SurfaceDistance<>& surface, int count, int source, double radius) {
  std::vector<double> out(static_cast<std::size_t>(count), std::numeric_limits<double>::infinity());
  double before = 0;
  surface.spread(source, radius, [&](int v, double distance) {
    CHECK(std::isinf(out[static_cast<std::size_t>(v)]));  // each vertex once
    CHECK(before <= distance);                            // nearest first
    before = distance;
    out[static_cast<std::size_t>(v)] = distance;
  });
  return out;
}

/// A sheet of equal cells in the x-y plane.
TriangleSheet even_sheet(int rows, int cols, double dx, double dy) {
  TriangleSheet sheet = irregular_sheet(rows, cols, 1.0, 0.0, 5);
  sheet.positions.row(0) *= dx;
  sheet.positions.row(1) *= dy;
  return sheet;
}

}  // namespace

TEST_CASE("surface distance: on a regular flat sheet it is Euclid's", "[surface_distance]") {
  for (const double dy : {1.0, 0.7}) {
    const TriangleSheet sheet = even_sheet(17, 23, 0.02, 0.02 * dy);
    const int n = static_cast<int>(sheet.positions.cols());
    SurfaceDistance surface(n, edges_of(sheet.positions, sheet.triangles), sheet.triangles);
    for (int source : {0, 7, 200, 390}) {
      const std::vector<double> found = distances(surface, n, source, 1e30);
      for (int v = 0; v < n; ++v) {
        const double exact = (sheet.positions.col(v) - sheet.positions.col(source)).norm();
        CHECK(found[static_cast<std::size_t>(v)] == Approx(exact).margin(1e-12));
      }
    }
  }
}

TEST_CASE("surface distance: on an irregular flat sheet it is Euclid's beyond the first ring",
          "[surface_distance]") {
  for (unsigned seed = 0; seed < 6; ++seed) {
    const double jitter = 0.1 + 0.04 * seed;
    const TriangleSheet sheet = irregular_sheet(24, 19, 0.02, jitter, seed);
    const int n = static_cast<int>(sheet.positions.cols());
    SurfaceDistance surface(n, edges_of(sheet.positions, sheet.triangles), sheet.triangles);
    int exact_ones = 0, all = 0;
    for (int source = 0; source < n; source += 37) {
      const std::vector<double> found = distances(surface, n, source, 1e30);
      for (int v = 0; v < n; ++v) {
        const double exact = (sheet.positions.col(v) - sheet.positions.col(source)).norm();
        const double ratio = v == source ? 1.0 : found[static_cast<std::size_t>(v)] / exact;
        CHECK(ratio > 1.0 - 1e-9);  // no way on a plane is shorter
        CHECK(ratio < (exact > 0.05 ? 1.001 : 1.2));
        ++all;
        if (ratio < 1.0 + 1e-9) ++exact_ones;
      }
    }
    CHECK(exact_ones > 0.9 * all);
  }
}

TEST_CASE("surface distance: a bent sheet has the distances of the plane", "[surface_distance]") {
  const TriangleSheet sheet = even_sheet(15, 31, 0.03, 0.03);
  const int n = static_cast<int>(sheet.positions.cols());
  // On a cylinder about y. The edges keep their length along the surface.
  const double radius = 0.2;
  Points<double> rolled = sheet.positions;
  for (int v = 0; v < n; ++v) {
    const double angle = sheet.positions(0, v) / radius;
    rolled(0, v) = radius * std::sin(angle);
    rolled(2, v) = radius * (1.0 - std::cos(angle));
  }
  std::vector<SurfaceEdge<>> edges = edges_of(rolled, sheet.triangles);
  SurfaceDistance surface(n, edges, sheet.triangles);
  // The chords of the cells are shorter than the arcs: by (cell/radius)²/24.
  for (int source : {0, 100, 333}) {
    const std::vector<double> found = distances(surface, n, source, 1e30);
    double farthest = 0;
    for (int v = 0; v < n; ++v) {
      const double unrolled = (sheet.positions.col(v) - sheet.positions.col(source)).norm();
      CHECK(found[static_cast<std::size_t>(v)] == Approx(unrolled).epsilon(2e-3).margin(1e-12));
      farthest = std::max(farthest, unrolled - (rolled.col(v) - rolled.col(source)).norm());
    }
    CHECK(farthest > 0.08);  // through space it is much shorter
  }
}

TEST_CASE("surface distance: the radius is respected and changes no distance",
          "[surface_distance]") {
  const TriangleSheet sheet = irregular_sheet(20, 20, 0.05, 0.25, 3);
  const int n = static_cast<int>(sheet.positions.cols());
  SurfaceDistance surface(n, edges_of(sheet.positions, sheet.triangles), sheet.triangles);
  const std::vector<double> all = distances(surface, n, 17, 1e30);
  for (const double radius : {0.0, 0.05, 0.2, 0.4}) {
    const std::vector<double> some = distances(surface, n, 17, radius);
    int reached = 0;
    for (std::size_t v = 0; v < some.size(); ++v) {
      if (std::isinf(some[v])) {
        // A path must not leave the radius, so one that bends may be missed at the rim.
        CHECK(all[v] > 0.999 * radius);
      } else {
        ++reached;
        CHECK(some[v] <= radius);
        CHECK(some[v] == Approx(all[v]).epsilon(1e-3).margin(1e-12));
      }
    }
    CHECK((radius > 0.1 ? reached > 20 : reached >= 1));
  }
  // The same source again: nothing is left from the spreads before.
  CHECK(distances(surface, n, 17, 1e30) == all);
}

TEST_CASE("surface distance: pieces without connection are not reached", "[surface_distance]") {
  const TriangleSheet one = irregular_sheet(6, 6, 0.1, 0.2, 1);
  TriangleSheet two = one;
  two.positions.conservativeResize(3, 72);
  two.positions.rightCols(36) = one.positions;  // in the same place
  for (const std::array<int, 3>& t : one.triangles)
    two.triangles.push_back({t[0] + 36, t[1] + 36, t[2] + 36});
  SurfaceDistance surface(72, edges_of(two.positions, two.triangles), two.triangles);
  const std::vector<double> found = distances(surface, 72, 40, 1e30);
  for (std::size_t v = 0; v < 72; ++v) CHECK(std::isinf(found[v]) == (v < 36));
}

TEST_CASE("surface distance: without triangles it goes along the edges", "[surface_distance]") {
  SurfaceDistance chain(4, {{0, 1, 1.0}, {1, 2, 2.0}, {0, 2, 2.5}}, {});
  CHECK(distances(chain, 4, 0, 1e30) ==
        std::vector<double>{0.0, 1.0, 2.5, std::numeric_limits<double>::infinity()});
  // A triangle with a missing side is not used.
  SurfaceDistance open(4, {{0, 1, 1.0}, {1, 2, 1.0}, {1, 3, 1.0}, {2, 3, 1.0}},
                       {{0, 1, 2}, {1, 3, 2}});
  CHECK(distances(open, 4, 0, 1e30)[3] == Approx(2.0));
}

TEST_CASE("surface distance: around a hole it is the shortest way in the sheet",
          "[surface_distance]") {
  // A wall of missing cells between source and target, open at one end.
  TriangleSheet sheet = even_sheet(21, 21, 0.1, 0.1);
  std::vector<std::array<int, 3>> left;
  for (const std::array<int, 3>& t : sheet.triangles) {
    const Vector3<double> c =
        (sheet.positions.col(t[0]) + sheet.positions.col(t[1]) + sheet.positions.col(t[2])) / 3.0;
    if (!(c[0] > 0.9 && c[0] < 1.1 && c[1] < 1.5)) left.push_back(t);
  }
  const auto vertex_at = [&](double x, double y) {
    Index best = 0;
    (sheet.positions.colwise() - Vector3<double>(x, y, 0)).colwise().norm().minCoeff(&best);
    return static_cast<int>(best);
  };
  SurfaceDistance surface(441, edges_of(sheet.positions, left), left);
  const int source = vertex_at(0.2, 0.2), target = vertex_at(1.7, 0.3);
  const std::vector<double> found = distances(surface, 441, source, 1e30);
  // Over the corners of the wall at (0.9, 1.5) and (1.1, 1.5).
  const double exact = std::hypot(0.7, 1.3) + 0.2 + std::hypot(0.6, 1.2);
  // Behind a corner the distances of two vertices come from different sources.
  CHECK(found[static_cast<std::size_t>(target)] > exact * (1.0 - 1e-9));
  CHECK(found[static_cast<std::size_t>(target)] < exact * 1.01);
}
