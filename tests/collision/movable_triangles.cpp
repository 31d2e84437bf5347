// Triangles without an inside: distances, directions on both sides and on the triangles themselves,
// and where they have moved.

#include "clothctl/collision/detail/movable_triangles.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "support/catch.hpp"
#include "support/meshes.hpp"
#include "support/solids.hpp"

using namespace clothctl;
using clothctl_test::uniform;
using V = Vector3<double>;

TEST_CASE("distances from triangles that move are those of all of them", "[contact]") {
  std::mt19937 random(151);
  auto mesh = clothctl_test::irregular_mesh(9, 11, random, 0.2);
  detail::MovableTriangles<double> tree(mesh.positions, mesh.triangles);
  for (int step = 0; step < 4; ++step) {
    double worst = 0, direction = 0;
    for (int i = 0; i < 100; ++i) {
      V x;
      for (int k = 0; k < 3; ++k) x[k] = uniform(random, -1, 2);
      const auto exact = static_cast<double>(clothctl_test::brute_triangles(mesh, x));
      const auto m = tree.nearest(x);
      worst = std::max(worst, std::abs(m.distance - exact));
      direction = std::max(direction, (m.point + m.distance * m.normal - x).norm());
    }
    CHECK(worst <= 1e-15);
    CHECK(direction <= 1e-15);
    CHECK(tree.bounds().upper == V(mesh.positions.rowwise().maxCoeff()));
    for (Index i = 0; i < mesh.positions.size(); ++i)
      mesh.positions(i) += uniform(random, -0.1, 0.1);
    tree.fit(mesh.positions);
  }
}

TEST_CASE("on a triangle the direction is its normal, on a thread across it", "[contact]") {
  Points<double> x(3, 5);
  x << 0, 1, 0, 4, 5, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0;
  const detail::MovableTriangles<double> tree(x, {{0, 1, 2}, {3, 4, 4}});
  CHECK(std::abs(tree.nearest(V(0.2, 0.2, 0)).normal[2]) == 1);
  CHECK(tree.nearest(V(0.2, 0.2, 1e-20)).normal == V(0, 0, 1));
  CHECK(tree.nearest(V(0.2, 0.2, -1e-20)).normal == V(0, 0, -1));
  const auto on = tree.nearest(V(4.5, 0, 0));
  CHECK(on.distance == 0);
  CHECK(std::abs(on.normal.norm() - 1) <= 1e-15);
  CHECK(on.normal[0] == 0);
}

TEST_CASE("a point on its way comes within reach from both sides, and starts there", "[contact]") {
  Points<double> x(3, 3);
  x << 0, 1, 0, 0, 0, 1, 0, 0, 0;
  const detail::MovableTriangles<double> tree(x, {{0, 1, 2}});
  for (const double side : {1.0, -1.0}) {
    const V from(0.2, 0.2, side), to(0.2, 0.2, -side);
    CHECK(tree.sweep(from, to, 0.5) == Approx(0.25));
    CHECK(tree.sweep(from, to, 0) == Approx(0.5));
    CHECK(tree.sweep(from, to, 1) == 0);
    CHECK(tree.sweep(from, V(2, 2, side), 0.5) == no_impact<double>());
  }
}
