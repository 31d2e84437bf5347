// What a network says about its material.

#include "clothctl/network/detail/old_network.hpp"

#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"

using namespace clothctl;

TEST_CASE("the moduli of a triangle mesh are those of its material", "[network]") {
  std::mt19937 random(8);
  const clothctl_test::PlainMesh mesh = clothctl_test::irregular_mesh(6, 7, random, 0.3);
  const Material<double> material;
  const auto network = sheet_network(mesh.positions, mesh.triangles, material).value();
  const Topology topology = make_topology(network.vertex_count(), network.triangles).value();
  const detail::OldNetwork<double> old(network, topology);
  for (int e = 0; e < static_cast<int>(topology.edges.size()); ++e) {
    const auto& edge = topology.edges[static_cast<std::size_t>(e)];
    CHECK(old.edge(e).stretch == Approx(material.stretch_warp));
    CHECK(old.edge(e).damping_time == Approx(material.damping_time));
    CHECK(old.edge(e).slack == Approx(1));
    CHECK(old.edge(e).bending == Approx(edge.is_boundary() ? 0 : material.bending_warp));
    CHECK(old.find_edge(edge.b, edge.a) == e);
  }
  for (int t = 0; t < static_cast<int>(mesh.triangles.size()); ++t) {
    CHECK(old.triangle(t).stretch == Approx(material.stretch_warp));
    CHECK(old.triangle(t).bending == Approx(material.bending_warp));
  }
  CHECK(old.free_springs().empty());
  CHECK(old.free_stencils().empty());
  CHECK(old.find_edge(0, static_cast<int>(network.vertex_count()) - 1) == -1);
}

TEST_CASE("the moduli of a grid are those of its material", "[network]") {
  const Material<double> material;
  const auto network = sheet_network(make_grid<double>(5, 6, 1.0, 0.6).value(), material).value();
  const Topology topology = make_topology(30, network.triangles).value();
  const detail::OldNetwork<double> old(network, topology);
  for (int e = 0; e < static_cast<int>(topology.edges.size()); ++e) {
    const auto& edge = topology.edges[static_cast<std::size_t>(e)];
    const bool diagonal = edge.b != edge.a + 1 && edge.b != edge.a + 6;
    if (diagonal) {
      const double l = old.edge(e).length, cell = 0.2 * 0.15;
      CHECK(old.edge(e).stretch == Approx(0.5 * material.shear * l * l * l * l / (cell * cell)));
      CHECK(old.edge(e).bending == 0);
    } else {
      CHECK(old.edge(e).stretch == Approx(material.stretch_warp));
      CHECK(old.edge(e).bending == Approx(material.bending_warp));
    }
  }
  CHECK(old.free_springs().size() == 20);  // a diagonal of each cell
  CHECK(old.rows().size() == network.bends.size());
  for (int v = 0; v < 30; ++v) CHECK(old.area_around(v) > 0);
}
