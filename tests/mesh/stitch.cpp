// Joining border vertices: the reverse of a cut, and panels.

#include "clothctl/mesh/stitch.hpp"

#include <limits>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/mesh/surface_cut.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("stitching reverses a cut", "[mesh]") {
  std::mt19937 random(5);
  for (int trial = 0; trial < clothctl_test::trials(60, 1500); ++trial) {
    const PlainMesh mesh = irregular_mesh(6, 7, random, 0.2);
    Points<double> polyline(3, 3);
    for (Index i = 0; i < 3; ++i)
      polyline.col(i) << uniform(random, -0.2, 1.2), 0.1, uniform(random, -0.2, 1.2);
    const auto cut = cut_surface<double>(mesh.positions, mesh.triangles, polyline, {}).value();
    const PlainMesh torn{cut.change.remap.interpolate(mesh.positions), cut.change.triangles};
    const auto pairs = coincident_border_vertices(torn.positions, torn.triangles, 1e-12).value();
    const auto back = stitch_vertices<double>(torn.positions.cols(), torn.triangles, pairs).value();
    CHECK(remap_fault(back.remap, torn, back.triangles) == "");
    CHECK(mesh_fault(back.remap.vertex_count(), back.triangles) == "");
    CHECK(euler(back.triangles) == euler(mesh.triangles));
    CHECK(back.remap.vertex_count() == mesh.positions.cols() + cut.inserted_vertices);
    const Remap<double> both = cut.change.remap.then(back.remap);
    CHECK(remap_fault(both, mesh, back.triangles) == "");
    for (int v = 0; v < static_cast<int>(both.old_vertex_count()); ++v)
      CHECK(both.copies(v).size() == 1);
  }
}

TEST_CASE("two panels become one, with places weighted", "[mesh]") {
  const GridMesh<double> grid = make_grid<double>(3, 3, 1.0, 1.0).value();
  PlainMesh two;
  two.positions.resize(3, 18);
  two.positions << grid.positions, (grid.positions.colwise() + Vector3<double>(1.1, 0, 0));
  two.triangles = grid.triangles;
  for (const auto& t : grid.triangles) two.triangles.push_back({t[0] + 9, t[1] + 9, t[2] + 9});
  VectorX<double> weights = VectorX<double>::Ones(18);
  weights[9] = 3;
  const auto joined =
      stitch_vertices<double>(18, two.triangles, {{9, 2}, {5, 12}, {15, 8}}, weights).value();
  CHECK(joined.remap.vertex_count() == 15);
  CHECK(mesh_fault(15, joined.triangles) == "");
  CHECK(euler(joined.triangles) == 1);
  const Points<double> x = joined.remap.interpolate(two.positions);
  CHECK(x(0, 2) == Approx(0.25 * 0.5 + 0.75 * 0.6));
  CHECK(x(0, 5) == Approx(0.55));
  CHECK(joined.remap.first_copy(9) == 2);
  CHECK(joined.remap.first_copy(10) == 9);
  CHECK(joined.remap.origin(2).size() == 2);
  // Two corners only: allowed; the vertex is then on two fans.
  const auto corner = stitch_vertices<double>(18, two.triangles, {{2, 9}}).value();
  CHECK(mesh_fault(17, corner.triangles) == "");
  CHECK(fans(2, corner.triangles) == 2);
}

TEST_CASE("bad seams are refused by name", "[mesh]") {
  const GridMesh<double> grid = make_grid<double>(3, 3, 1.0, 1.0).value();
  const auto refused = [&grid](std::vector<std::array<int, 2>> pairs, VectorX<double> w = {}) {
    return stitch_vertices<double>(9, grid.triangles, pairs, w).error();
  };
  CHECK(refused({{0, 9}}) == "pair 0: vertex 9 is off the mesh of 9 vertices");
  CHECK(refused({{0, 2}, {-1, 0}}) == "pair 1: vertex -1 is off the mesh of 9 vertices");
  CHECK(refused({{0, 4}}) == "pair 0: vertex 4 is not on the border");
  CHECK(refused({{3, 3}}) == "pair 0: vertex 3 is paired with itself");
  CHECK(refused({{0, 1}}).find("stitching joins two corners of triangle 0") == 0);
  CHECK(refused({{0, 2}, {3, 5}}).find("stitching: ") == 0);
  CHECK(refused({}, VectorX<double>::Ones(8)) == "there are 8 weights for 9 vertices");
  VectorX<double> weights = VectorX<double>::Ones(9);
  for (const double bad : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
    weights[7] = bad;
    CHECK(refused({}, weights).find("weight of vertex 7 must be positive") == 0);
  }
  CHECK(stitch_vertices<double>(9, grid.triangles, {}).value().remap.is_identity());
  CHECK(
      coincident_border_vertices(grid.positions, grid.triangles, -1.0).error().find("tolerance") ==
      0);
  CHECK(coincident_border_vertices(grid.positions, grid.triangles, 0.6).value().empty());
}
