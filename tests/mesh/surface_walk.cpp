// The closest point of a triangle, and where a walk puts vertices.

#include "clothctl/mesh/detail/surface_walk.hpp"

#include "clothctl/mesh/grid.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"

using namespace clothctl;
using clothctl_test::uniform;

namespace {

using V = Vector3<double>;

V any(std::mt19937& random, double size) {
  return {uniform(random, -size, size), uniform(random, -size, size), uniform(random, -size, size)};
}

}  // namespace

TEST_CASE("the closest point of a triangle is closer than any other", "[mesh]") {
  std::mt19937 random(1);
  for (int trial = 0; trial < 200; ++trial) {
    const std::array<V, 3> x{any(random, 1), any(random, 1), any(random, 1)};
    const V p = any(random, 2);
    const auto best = detail::closest_on_triangle<double>(p, x);
    V place = V::Zero();
    double sum = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      CHECK(best.weights[i] >= 0);
      place += best.weights[i] * x[i];
      sum += best.weights[i];
    }
    CHECK(sum == Approx(1));
    CHECK((place - p).squaredNorm() == Approx(best.squared_distance));
    for (int sample = 0; sample < 100; ++sample) {
      double a = uniform(random, 0, 1), b = uniform(random, 0, 1);
      if (a + b > 1) {
        a = 1 - a;
        b = 1 - b;
      }
      const V other = (1 - a - b) * x[0] + a * x[1] + b * x[2];
      CHECK((other - p).squaredNorm() > best.squared_distance - 1e-12);
    }
  }
}

TEST_CASE("the closest point of a triangle without area is on a side", "[mesh]") {
  const std::array<V, 3> line{V(0, 0, 0), V(1, 0, 0), V(2, 0, 0)};
  CHECK(detail::closest_on_triangle<double>({1.5, 1, 0}, line).squared_distance == Approx(1));
  const std::array<V, 3> point{V(1, 2, 3), V(1, 2, 3), V(1, 2, 3)};
  CHECK(detail::closest_on_triangle<double>({1, 2, 5}, point).squared_distance == Approx(4));
}

TEST_CASE("a walk marks a connected path on the line, and too far points are known", "[mesh]") {
  const GridMesh<double> grid = make_grid<double>(5, 5, 1.0, 1.0).value();
  auto editor = MeshEditor<double>::create(grid.positions, grid.triangles).value();
  detail::SurfaceWalk<double> walk(editor, 0.01, 1.0);
  CHECK(walk.too_far({2e4, 0, 0}));
  CHECK_FALSE(walk.too_far({5e3, 0, 0}));
  Points<double> line(3, 2);
  line.col(0) << -0.3, 0, -0.77;
  line.col(1) << 0.31, 0, -0.2;
  walk.follow(line);
  CHECK(editor.marked_count() > 4);
  for (int v = 25; v < editor.vertex_count(); ++v) {
    const V gap = editor.position(v) - V(line.col(0));
    const V d = (line.col(1) - line.col(0)).normalized();
    CHECK((gap - d * d.dot(gap)).norm() < 1e-12);
  }
  const int copies = editor.open_marked();
  CHECK(copies == editor.opened_count() - 1);
}
