// Convex hulls: exact sides on the lattice, closed and oriented triangles that hold all points, and
// points on common planes and lines.

#include "clothctl/collision/detail/convex_hull.hpp"

#include <cmath>
#include <random>

#include "clothctl/mesh/topology.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::uniform;
using detail::HullLatticePoint;

TEST_CASE("the side of a lattice point is exact", "[contact]") {
  const std::int64_t n = std::int64_t(1) << 28;
  const HullLatticePoint a{-n, -n, -n}, b{n, n, -n}, c{-n, n, n};
  // The plane x + z = y - n through a, b, c; its points, and those beside them.
  for (const std::int64_t x : {-n, std::int64_t(-7), std::int64_t(0), n / 3}) {
    for (const std::int64_t y : {std::int64_t(5), n / 7, n}) {
      const std::int64_t z = y - x - n;
      const int above = detail::lattice_side(a, b, c, {x, y, z + 1});
      CHECK(detail::lattice_side(a, b, c, {x, y, z}) == 0);
      CHECK(above != 0);
      CHECK(detail::lattice_side(a, b, c, {x, y, z - 1}) == -above);
      CHECK(detail::lattice_side(a, c, b, {x, y, z + 1}) == -above);
    }
  }
  std::mt19937 random(101);
  for (int i = 0; i < 2000; ++i) {  // small numbers against a plain determinant
    std::array<HullLatticePoint, 4> p{};
    for (auto& point : p) {
      for (auto& x : point) x = static_cast<std::int64_t>(random() % 9) - 4;
    }
    std::array<std::array<std::int64_t, 3>, 3> m{};
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t k = 0; k < 3; ++k) m[r][k] = p[r + 1][k] - p[0][k];
    }
    const std::int64_t det = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                             m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                             m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    CHECK(detail::lattice_side(p[0], p[1], p[2], p[3]) == (det > 0) - (det < 0));
  }
}

TEST_CASE("a hull is closed, faces outwards and holds its points", "[contact]") {
  std::mt19937 random(102);
  int made_hulls = 0;
  for (int trial = 0; trial < clothctl_test::trials(60, 3000, 10); ++trial) {
    const int n = 4 + static_cast<int>(random() % 80);
    Points<double> x(3, n);
    for (Index i = 0; i < x.size(); ++i) {
      x(i) = uniform(random, -1, 1);
      if (trial % 3 == 1) x(i) = std::round(2 * x(i));
    }
    if (trial % 3 == 2) x.colwise().normalize();  // all points are corners
    const auto made = detail::convex_hull<double>(x);
    if (!made) continue;
    ++made_hulls;
    const int corners = static_cast<int>(made->vertices.size());
    const auto topology = make_topology(corners, made->triangles);
    REQUIRE(topology);
    CHECK(topology->boundary_edges.empty());
    CHECK(topology->consistently_oriented);
    CHECK(clothctl_test::euler(made->triangles) == 2);
    if (trial % 3 == 2) CHECK(corners == n);
    double outside = 0;
    for (const auto& t : made->triangles) {
      const auto at = [&](std::size_t k) {
        return Vector3<double>(x.col(made->vertices[static_cast<std::size_t>(t[k])]));
      };
      const Vector3<double> normal = (at(1) - at(0)).cross(at(2) - at(0)).normalized();
      for (Index i = 0; i < n; ++i)
        outside = std::max(outside, normal.dot(Vector3<double>(x.col(i)) - at(0)));
    }
    CHECK(outside <= 5e-8);
  }
  CHECK(made_hulls > 8);
}

TEST_CASE("rounding to the lattice is to the nearest step", "[contact]") {
  CHECK(detail::to_lattice<double>(2.4) == 2);
  CHECK(detail::to_lattice<double>(-2.6) == -3);
  CHECK(detail::to_lattice<double>(-268435456.0) == -268435456);
}
