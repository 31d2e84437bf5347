// Where a walk puts vertices.

#include "clothctl/mesh/detail/surface_walk.hpp"

#include "clothctl/mesh/grid.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;

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
