// Vertices on edges and in triangles, and edges that open.

#include "clothctl/mesh/mesh_editor.hpp"

#include <limits>

#include "clothctl/mesh/grid.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

PlainMesh grid(int rows, int cols) {
  const GridMesh<double> mesh = make_grid<double>(rows, cols, 1.0, 1.0).value();
  return {mesh.positions, mesh.triangles};
}

MeshEditor<double> editor_of(const PlainMesh& mesh) {
  return MeshEditor<double>::create(mesh.positions, mesh.triangles).value();
}

/// Checks all laws of a change of `before`.
void check_change(const MeshChange<double>& change, const PlainMesh& before) {
  CHECK(mesh_fault(change.remap.vertex_count(), change.triangles) == "");
  CHECK(remap_fault(change.remap, before, change.triangles) == "");
  const double area = total_area(before.positions, before.triangles);
  CHECK(std::abs(total_area(change.remap.interpolate(before.positions), change.triangles) - area) <
        1e-12 * area);
}

}  // namespace

TEST_CASE("a slit doubles the inner vertices of its path, and its ends on the border", "[mesh]") {
  const PlainMesh mesh = grid(5, 5);
  struct Case {
    std::vector<int> path;
    int copies, chi;
  };
  // Row 2 holds the vertices 10 to 14.
  const std::vector<Case> cases{{{11, 12}, 0, 0},
                                {{11, 12, 13}, 1, -1},
                                {{10, 11}, 1, 0},
                                {{10, 11, 12}, 2, 0},
                                {{10, 11, 12, 13, 14}, 5, 1}};
  for (const Case& c : cases) {
    MeshEditor<double> editor = editor_of(mesh);
    for (std::size_t i = 1; i < c.path.size(); ++i) CHECK(editor.mark(c.path[i - 1], c.path[i]));
    CHECK(editor.open_marked() == c.copies);
    const MeshChange<double> change = editor.change();
    check_change(change, mesh);
    CHECK(euler(change.triangles) == euler(mesh.triangles) + c.chi);
    CHECK(c.copies - editor.opened_count() == c.chi);
    CHECK(change.remap.is_identity() == (c.copies == 0));
    for (int v = 0; v < static_cast<int>(change.remap.vertex_count()); ++v)
      CHECK(fans(v, change.triangles) == 1);
    for (const int v : c.path) CHECK(change.remap.first_copy(v) == v);
  }
}

TEST_CASE("marks on the border change nothing, and a ring of marks cuts a piece out", "[mesh]") {
  const PlainMesh mesh = grid(5, 5);
  MeshEditor<double> editor = editor_of(mesh);
  CHECK(editor.mark(0, 1));
  CHECK(editor.open_marked() == 0);
  CHECK(editor.change().remap.is_identity());
  CHECK_FALSE(editor.mark(0, 24));
  CHECK_FALSE(editor.mark(-1, 0));
  CHECK_FALSE(editor.mark(0, 25));
  CHECK_FALSE(editor.mark(3, 3));
  const std::vector<int> ring{6, 7, 8, 13, 18, 17, 16, 11, 6};
  for (std::size_t i = 1; i < ring.size(); ++i) CHECK(editor.mark(ring[i - 1], ring[i]));
  CHECK(editor.open_marked() == 8);
  CHECK(editor.opened_count() == 8);
  check_change(editor.change(), mesh);
  CHECK(euler(editor.triangles()) == 1);  // a ring (0) and a disk (1)
}

TEST_CASE("an inserted vertex divides its triangles and their marks", "[mesh]") {
  const PlainMesh mesh = grid(3, 3);
  MeshEditor<double> editor = editor_of(mesh);
  CHECK(editor.mark(3, 4));
  CHECK(editor.mark(4, 5));
  const int on_edge = editor.insert_on_edge(4, 3, 0.25).value();
  CHECK(on_edge == 9);
  CHECK(
      (editor.position(9) - (0.75 * mesh.positions.col(4) + 0.25 * mesh.positions.col(3))).norm() <
      1e-15);
  CHECK(editor.triangles().size() == 10);
  CHECK(editor.marked_count() == 3);
  const int inside = editor.insert_in_triangle(0, {2.0, 1.0, 1.0}).value();
  CHECK(inside == 10);
  CHECK(editor.triangles().size() == 12);
  check_change(editor.change(), mesh);
  CHECK(euler(editor.triangles()) == 1);
  CHECK(editor.open_marked() == 4);
  check_change(editor.change(), mesh);
  CHECK(editor.change().remap.origin(9).size() == 2);
  CHECK(editor.change().remap.origin(10).size() == 3);
  CHECK(editor.change().remap.copies(4).size() == 2);
}

TEST_CASE("a plane through a vertex divides its fan", "[mesh]") {
  const PlainMesh mesh = grid(5, 5);
  MeshEditor<double> editor = editor_of(mesh);
  CHECK(editor.mark_across(12, {1, 0, 0}) == 2);
  CHECK(editor.open_marked() == 1);
  check_change(editor.change(), mesh);
  CHECK(editor.mark_across(2, {1, 0, 0}) == 1);  // on the border
  CHECK(editor.open_marked() == 2);              // joins the slit, whose end is doubled too
  check_change(editor.change(), mesh);
  CHECK(editor.mark_across(0, {0, 1, 0}) == 0);
  CHECK(editor.mark_across(10, {1, 0, 0}) == 0);  // all triangles on one side
  CHECK(editor.mark_across(-1, {1, 0, 0}) == 0);
  CHECK(editor.mark_across(12, {std::numeric_limits<double>::quiet_NaN(), 0, 0}) == 0);
}

TEST_CASE("bad meshes and bad places are refused by name", "[mesh]") {
  PlainMesh mesh = grid(3, 3);
  MeshEditor<double> editor = editor_of(mesh);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(editor.insert_on_edge(0, 8, 0.5).error() == "edge 0-8 does not exist");
  for (const double t : {0.0, 1.0, -0.5, nan, 2.0}) {
    CHECK(editor.insert_on_edge(0, 1, t).error().find("edge 0-1: a new vertex must lie") == 0);
  }
  CHECK(editor.insert_in_triangle(8, {1, 1, 1}).error() == "triangle 8 does not exist");
  CHECK(editor.insert_in_triangle(-1, {1, 1, 1}).error() == "triangle -1 does not exist");
  CHECK_FALSE(editor.insert_in_triangle(0, {1, 0, 1}).has_value());
  CHECK_FALSE(editor.insert_in_triangle(0, {1, nan, 1}).has_value());
  CHECK(editor.change().remap.is_identity());
  mesh.positions(1, 4) = nan;
  CHECK(MeshEditor<double>::create(mesh.positions, mesh.triangles).error() ==
        "position of vertex 4 is not finite");
  CHECK_FALSE(MeshEditor<double>::create(grid(3, 3).positions, {{0, 1, 9}}).has_value());
  CHECK(MeshEditor<double>::create(Points<double>(3, 0), {}).has_value());
}

TEST_CASE("random insertions and openings keep area and manifold and obey Euler", "[mesh]") {
  std::mt19937 random(7);
  for (int trial = 0; trial < clothctl_test::trials(60, 2000); ++trial) {
    const PlainMesh mesh = irregular_mesh(4 + static_cast<int>(random() % 4),
                                          4 + static_cast<int>(random() % 4), random, 0.2);
    MeshEditor<double> editor = editor_of(mesh);
    for (int round = 0; round < 3; ++round) {
      const int chi = euler(editor.triangles()), opened = editor.opened_count();
      for (int i = 0; i < 12; ++i) {
        const std::array<int, 3> t = editor.triangles()[random() % editor.triangles().size()];
        if (i % 4 == 0) (void)editor.insert_on_edge(t[0], t[1], uniform(random, 0.1, 0.9));
        if (i % 4 == 1)
          editor.mark_across(t[0], {uniform(random, -1, 1), 0.3, uniform(random, -1, 1)});
        if (i % 4 > 1) editor.mark(t[1], t[2]);
      }
      CHECK(euler(editor.triangles()) == chi);
      const int copies = editor.open_marked();
      CHECK(euler(editor.triangles()) == chi + copies - (editor.opened_count() - opened));
    }
    check_change(editor.change(), mesh);
    for (int v = 0; v < editor.vertex_count(); ++v) REQUIRE(fans(v, editor.triangles()) == 1);
  }
}
