#include "clothctl/mesh/boundary_loops.hpp"

#include "clothctl/mesh/grid.hpp"
#include "clothctl/mesh/tetrahedra.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("a grid has one loop, a ball's surface none", "[mesh]") {
  const auto grid = make_grid<double>(4, 5, 1.0, 1.0);
  REQUIRE(grid);
  const auto loops = boundary_loops(20, grid->triangles);
  REQUIRE(loops);
  REQUIRE(loops->size() == 1);
  // Counter-clockwise from the first corner.
  CHECK((*loops)[0] == std::vector<int>{0, 1, 2, 3, 4, 9, 14, 19, 18, 17, 16, 15, 10, 5});
  const auto ball = make_ball<double>(1.0, 2, Eigen::Vector3d::Zero());
  REQUIRE(ball);
  CHECK(boundary_loops(ball->positions.cols(), surface_triangles(*ball))->empty());
}

TEST_CASE("a hole is a loop of its own, clockwise", "[mesh]") {
  auto grid = make_grid<double>(6, 6, 1.0, 1.0);
  REQUIRE(grid);
  std::vector<std::array<int, 3>> rest;
  for (const auto& t : grid->triangles) {
    bool middle = true;
    for (const int v : t) middle = middle && v / 6 >= 2 && v / 6 <= 3 && v % 6 >= 2 && v % 6 <= 3;
    if (!middle) rest.push_back(t);
  }
  const auto loops = boundary_loops(36, rest);
  REQUIRE(loops);
  REQUIRE(loops->size() == 2);
  CHECK((*loops)[1] == std::vector<int>{14, 20, 21, 15});
}

TEST_CASE("meshes without a clean border are refused", "[mesh]") {
  CHECK(boundary_loops(5, {{0, 1, 2}, {0, 3, 4}}).error() ==
        "the border passes twice through vertex 0");
  CHECK(boundary_loops(4, {{0, 1, 2}, {0, 1, 3}}).error() ==
        "neighbouring triangles have opposite orientations");
  CHECK(boundary_loops(3, {{0, 1, 3}}).error() ==
        "triangle 0 holds vertex 3 off the mesh of 3 vertices");
  CHECK(boundary_loops(-1, {}).error() == "vertex count must not be negative, got -1");
  CHECK(boundary_loops(0, {})->empty());
}
