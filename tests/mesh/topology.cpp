#include "clothctl/mesh/topology.hpp"

#include <set>
#include <utility>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/mesh/tetrahedra.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Triangles = std::vector<std::array<int, 3>>;

/// Finds edges by brute force.
std::set<std::pair<int, int>> all_edges(const Triangles& triangles) {
  std::set<std::pair<int, int>> edges;
  for (const auto& t : triangles) {
    for (std::size_t i = 0; i < 3; ++i) edges.insert(std::minmax({t[i], t[(i + 1) % 3]}));
  }
  return edges;
}

}  // namespace

TEST_CASE("the topology of a grid satisfies Euler's formula and lists every edge once", "[mesh]") {
  const auto mesh = make_grid<double>(7, 5, 1.0, 1.0);
  REQUIRE(mesh);
  const auto made = make_topology(35, mesh->triangles);
  REQUIRE(made);
  const Topology& topology = made.value();
  const auto expected = all_edges(mesh->triangles);
  REQUIRE(topology.edges.size() == expected.size());
  CHECK(35 - static_cast<int>(topology.edges.size()) + static_cast<int>(mesh->triangles.size()) ==
        1);
  auto it = expected.begin();
  for (const MeshEdge& edge : topology.edges) {
    CHECK(std::pair<int, int>(edge.a, edge.b) == *it);
    ++it;
  }
  CHECK(topology.boundary_edges.size() == 2 * (6 + 4));
  CHECK(topology.hinges.size() + topology.boundary_edges.size() == topology.edges.size());
  CHECK(topology.consistently_oriented);
}

TEST_CASE("hinges and boundary edges have the right vertices", "[mesh]") {
  //  3---2
  //  | / |
  //  0---1
  const Triangles triangles{{0, 1, 2}, {0, 2, 3}};
  const auto made = make_topology(5, triangles);
  REQUIRE(made);
  REQUIRE(made->edges.size() == 5);
  REQUIRE(made->hinges.size() == 1);
  CHECK(made->hinges[0].vertex == std::array<int, 4>{0, 2, 1, 3});
  const MeshEdge& diagonal = made->edges[static_cast<std::size_t>(made->hinges[0].edge)];
  CHECK((diagonal.a == 0 && diagonal.b == 2));
  CHECK((diagonal.triangle[0] == 0 && diagonal.triangle[1] == 1));
  for (int e : made->boundary_edges) {
    const MeshEdge& edge = made->edges[static_cast<std::size_t>(e)];
    CHECK(edge.is_boundary());
    const auto& t = triangles[static_cast<std::size_t>(edge.triangle[0])];
    CHECK(t[0] + t[1] + t[2] - edge.a - edge.b == edge.opposite[0]);
  }
  const auto near_0 = made->neighbours(0);
  CHECK(std::vector<int>(near_0.begin(), near_0.end()) == std::vector<int>{1, 2, 3});
  const auto near_1 = made->neighbours(1);
  CHECK(std::vector<int>(near_1.begin(), near_1.end()) == std::vector<int>{0, 2});
  CHECK(made->neighbours(4).empty());
}

TEST_CASE("neighbours are symmetric, ascending and complete", "[mesh]") {
  const auto mesh = make_grid<double>(6, 8, 1.0, 1.0);
  REQUIRE(mesh);
  const auto made = make_topology(48, mesh->triangles);
  REQUIRE(made);
  const auto edges = all_edges(mesh->triangles);
  std::size_t pairs = 0;
  for (int v = 0; v < 48; ++v) {
    int before = -1;
    for (int w : made->neighbours(v)) {
      CHECK(before < w);
      before = w;
      CHECK(edges.count(std::minmax({v, w})) == 1);
      ++pairs;
    }
  }
  CHECK(pairs == 2 * edges.size());
}

TEST_CASE("a triangle of opposite orientation is detected, and a closed surface has no border",
          "[mesh]") {
  const auto turned = make_topology(4, {{0, 1, 2}, {0, 3, 2}});
  REQUIRE(turned);
  CHECK_FALSE(turned->consistently_oriented);
  const auto closed = make_topology(4, {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}});
  REQUIRE(closed);
  CHECK(closed->boundary_edges.empty());
  CHECK(closed->hinges.size() == 6);
  CHECK(closed->consistently_oriented);
  const auto empty = make_topology(0, {});
  REQUIRE(empty);
  CHECK(empty->edges.empty());
}

TEST_CASE("bad triangles are refused with a message", "[mesh]") {
  CHECK(make_topology(3, {{0, 1, 2}, {0, 2, 3}}).error() ==
        "triangle 1 holds vertex 3 off the mesh of 3 vertices");
  CHECK(make_topology(3, {{0, -1, 2}}).error() ==
        "triangle 0 holds vertex -1 off the mesh of 3 vertices");
  CHECK(make_topology(3, {{0, 1, 2}, {1, 2, 1}}).error() == "triangle 1 holds vertex 1 twice");
  CHECK(make_topology(5, {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}}).error() ==
        "edge 0-1 is shared by 3 triangles, the third is triangle 2");
  CHECK(
      make_topology(5, {{0, 1, 2}, {2, 3, 1}, {2, 1, 4}}).error().find("edge 1-2 is shared by 3") ==
      0);
  CHECK(make_topology(3, {{0, 1, 2}, {2, 1, 0}}).error() == "triangle 1 repeats triangle 0");
}

TEST_CASE("counts too large for int are refused with their value", "[mesh]") {
  CHECK(make_topology(-1, {}).error() == "vertex count must not be negative, got -1");
  CHECK(make_topology(-7, {{0, 1, 2}}).error() == "vertex count must not be negative, got -7");
  CHECK(make_topology(2147483648, {}).error() ==
        "vertex count must be at most 2147483647, got 2147483648");
  CHECK(detail::bad_mesh_counts(2147483647, 357913941).empty());
  CHECK(detail::bad_mesh_counts(3, 357913942) ==
        "triangle count must be at most 357913941, got 357913942");
}

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
