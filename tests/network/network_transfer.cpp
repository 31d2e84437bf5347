// The parts of the transfer of a network: masses and the order of springs. network_change.cpp has
// the tests of the whole.

#include "clothctl/network/detail/network_transfer.hpp"

#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"

using namespace clothctl;

TEST_CASE("mass goes with the triangles; springs keep their order", "[network]") {
  const GridMesh<double> grid = make_grid<double>(4, 5, 1.0, 1.0).value();
  SpringNetwork<double> network = sheet_network(grid, Material<double>()).value();
  for (Index v = 0; v < network.mass.size(); ++v) network.mass[v] *= 1.0 + 0.1 * double(v);
  auto editor = MeshEditor<double>::create(grid.positions, grid.triangles).value();
  editor.mark(1, 6);
  editor.mark(6, 11);
  CHECK(editor.open_marked() == 2);
  CHECK(editor.insert_on_edge(18, 19, 0.5).has_value());
  const MeshChange<double> change = editor.change();
  const Topology before = make_topology(20, network.triangles).value();
  const Topology after = make_topology(change.remap.vertex_count(), change.triangles).value();
  const std::vector<unsigned char> none(network.springs.size(), 0);
  const detail::OldNetwork<double> old(network, before);
  const SpringNetwork<double> next =
      detail::NetworkTransfer<double>(old, change, after, none).run();
  CHECK(next.mass.sum() == Approx(network.mass.sum()).epsilon(1e-14));
  for (const int v : {1, 6}) {  // each copy has one cell on each side, half of the mass
    REQUIRE(change.remap.copies(v).size() == 2);
    for (const int copy : change.remap.copies(v))
      CHECK(next.mass[copy] == Approx(0.5 * network.mass[v]));
  }
  for (const int v : {0, 3, 10, 15}) CHECK(next.mass[v] == network.mass[v]);  // untouched
  // Unchanged springs come in the old order, and the springs of new edges last.
  std::size_t at = 0;
  for (const Spring<double>& s : network.springs) {
    for (std::size_t i = at; i < next.springs.size(); ++i) {
      if (next.springs[i].a == s.a && next.springs[i].b == s.b &&
          next.springs[i].stiffness == s.stiffness) {
        CHECK(i >= at);
        at = i;
        break;
      }
    }
  }
  CHECK(at + 1 < next.springs.size());
  CHECK(next.springs.back().b == 22);
}
