// Remaps: chains, interpolation, states and inputs.

#include "clothctl/mesh/remap.hpp"

#include "clothctl/mesh/grid.hpp"
#include "clothctl/mesh/mesh_editor.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::irregular_mesh;
using clothctl_test::PlainMesh;
using clothctl_test::remap_fault;
using clothctl_test::uniform;

namespace {

/// Some insertions and openings.
MeshChange<double> random_change(const PlainMesh& mesh, std::mt19937& random) {
  auto editor = MeshEditor<double>::create(mesh.positions, mesh.triangles).value();
  for (int i = 0; i < 9; ++i) {
    const std::array<int, 3> t = editor.triangles()[random() % editor.triangles().size()];
    if (i < 2) (void)editor.insert_on_edge(t[0], t[1], uniform(random, 0.2, 0.8));
    if (i == 2) (void)editor.insert_in_triangle(static_cast<int>(random() % 9), {0.3, 0.3, 0.4});
    if (i > 2) editor.mark_across(t[0], {uniform(random, -1, 1), 0, uniform(random, -1, 1)});
  }
  editor.open_marked();
  return editor.change();
}

}  // namespace

TEST_CASE("the identity maps everything to itself", "[mesh]") {
  const auto same = Remap<double>::identity(4, 2);
  CHECK(same.is_identity());
  CHECK((same.vertex_count() == 4 && same.old_vertex_count() == 4));
  CHECK((same.triangle_count() == 2 && same.old_triangle_count() == 2));
  CHECK((same.first_copy(3) == 3 && same.parent(1) == 1 && same.children(1)[0] == 1));
  CHECK(is_whole(same.corners(0)));
  CHECK(same.all_copies({2, 0, 2}) == std::vector<int>{2, 0});
  CHECK(same.then(same).is_identity());
  CHECK(Remap<double>().is_identity());
  CHECK(area_share(whole_triangle<double>()) == 1.0);
}

TEST_CASE("a chain of changes is one change", "[mesh]") {
  std::mt19937 random(3);
  for (int trial = 0; trial < clothctl_test::trials(40, 1000); ++trial) {
    const PlainMesh mesh = irregular_mesh(5, 5, random, 0.3);
    PlainMesh now = mesh;
    auto all =
        Remap<double>::identity(mesh.positions.cols(), static_cast<Index>(mesh.triangles.size()));
    for (int i = 0; i < 3; ++i) {
      const MeshChange<double> change = random_change(now, random);
      CHECK(change.remap
                .then(Remap<double>::identity(change.remap.vertex_count(),
                                              change.remap.triangle_count()))
                .interpolate(now.positions) == change.remap.interpolate(now.positions));
      now = {change.remap.interpolate(now.positions), change.triangles};
      all = all.then(change.remap);
    }
    CHECK(remap_fault(all, mesh, now.triangles) == "");
    CHECK((all.interpolate(mesh.positions) - now.positions).cwiseAbs().maxCoeff() < 1e-14);
  }
}

TEST_CASE("states and inputs continue on the changed mesh", "[mesh]") {
  const GridMesh<double> grid = make_grid<double>(3, 3, 1.0, 1.0).value();
  auto editor = MeshEditor<double>::create(grid.positions, grid.triangles).value();
  editor.mark(3, 4);
  editor.mark(4, 5);
  editor.open_marked();
  const int middle = editor.insert_on_edge(0, 1, 0.5).value();
  const Remap<double> remap = editor.change().remap;
  REQUIRE(remap.vertex_count() == 13);

  ClothState<double> state{grid.positions, 2.0 * grid.positions};
  const ClothState<double> next = remap_state(state, remap);
  CHECK(next.positions.col(4) == state.positions.col(4));
  CHECK(next.positions.col(remap.copies(4)[1]) == state.positions.col(4));
  CHECK(next.velocities.col(middle) ==
        0.5 * state.velocities.col(0) + 0.5 * state.velocities.col(1));

  ClothInput<double> input;
  input.force_vertices = {4, 0, 4};
  input.forces.setRandom(3, 3);
  input.driven_vertices = {8, 4};
  input.driven_positions.setRandom(3, 2);
  input.wind = {1, 2, 3};
  input.attached_vertices = {4, 8, 4};
  input.attached_positions.setRandom(3, 3);
  input.attachment_stiffness.setConstant(3, 10.0);
  input.attachment_stiffness[2] = 4.0;
  const ClothInput<double> out = remap_input(input, remap);
  CHECK(out.force_vertices == input.force_vertices);  // first copies keep their index
  CHECK(out.forces == input.forces);
  CHECK(out.wind == input.wind);
  CHECK(out.driven_vertices == std::vector<int>{8, 4, remap.copies(4)[1]});
  CHECK(out.driven_positions.col(0) == input.driven_positions.col(0));
  CHECK(out.driven_positions.col(1) == input.driven_positions.col(1));
  CHECK(out.driven_positions.col(2) == input.driven_positions.col(1));
  // Copies share the stiffness of an attachment: while they coincide the force is the same.
  const int copy = remap.copies(4)[1];
  CHECK(out.attached_vertices == std::vector<int>{4, copy, 8, 4, copy});
  const std::vector<Index> from{0, 0, 1, 2, 2};
  for (Index j = 0; j < 5; ++j)
    CHECK(out.attached_positions.col(j) ==
          input.attached_positions.col(from[static_cast<std::size_t>(j)]));
  CHECK(out.attachment_stiffness == Eigen::Vector<double, 5>(5, 5, 10, 2, 2));
}
