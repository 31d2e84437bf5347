// Broken springs, and tears along them.

#include "clothctl/network/tearing.hpp"

#include <limits>

#include "clothctl/network/rope.hpp"
#include "network/network_checks.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Network = SpringNetwork<double>;

Network grid_network(int rows, int cols) {
  return sheet_network(make_grid<double>(rows, cols, 1.0, 1.0).value(), Material<double>()).value();
}

TornSprings<double> found(const Network& network, const Points<double>& x,
                          const TearSettings<double>& settings, Index most = 1000) {
  TornSprings<double> torn;
  torn.reserve_splits(most);
  const Index count = find_torn(network, x, settings, torn);
  CHECK(count == torn.count());
  return torn;
}

}  // namespace

TEST_CASE("springs break above the limit of their kind, the most overloaded first", "[network]") {
  Network network = grid_network(4, 4);
  Points<double> x = network.rest_positions;
  x.row(0) *= 1.2;
  TearSettings<double> settings;
  CHECK(found(network, x, settings).count() == 0);  // the default never tears
  settings.structural = 0.21;
  CHECK(found(network, x, settings).count() == 0);
  settings.structural = 0.19;
  CHECK(found(network, x, settings).count() == 12);  // the threads along x
  settings.shear = 0.05;  // diagonals are strained by sqrt((1.44 + 1)/2) - 1
  const auto torn = found(network, x, settings);
  CHECK(torn.count() == 12 + 18);
  for (Index i = 0; i < torn.count(); ++i) {
    const TornSpring<double>& t = torn.springs()[static_cast<std::size_t>(i)];
    const Spring<double>& s = network.springs[static_cast<std::size_t>(t.spring)];
    const double strain = (x.col(s.b) - x.col(s.a)).norm() / s.rest_length - 1;
    CHECK(t.overload == Approx(strain / settings.limit(s.kind)));
    CHECK((i < 18) == (s.kind == SpringKind::Shear));
    if (i > 0) CHECK(torn.springs()[static_cast<std::size_t>(i) - 1].overload >= t.overload);
  }
  const auto some = found(network, x, settings, 5);
  REQUIRE(some.count() == 5);
  for (std::size_t i = 0; i < 5; ++i) CHECK(some.springs()[i].spring == torn.springs()[i].spring);
  CHECK(found(network, x, settings, 0).count() == 0);
  CHECK(found(network, x, settings, -3).count() == 0);
  settings.structural = std::numeric_limits<double>::infinity();
  settings.shear = 1e30;
  CHECK(found(network, 100 * x, settings).count() == 0);
  detail::add_spring(network, 0, 15, 1.0, 0.0, SpringKind::Seam);
  settings.seam = 0.01;
  CHECK(found(network, x, settings).count() == 1);
}

TEST_CASE("looking for broken springs does not allocate and survives bad positions", "[network]") {
  const Network network = grid_network(6, 6);
  Points<double> x = 2 * network.rest_positions;
  TearSettings<double> settings;
  settings.structural = settings.shear = 0.1;
  TornSprings<double> torn;
  torn.reserve_splits(20);
  const long before = clothctl_test::allocations();
  CHECK(find_torn(network, x, settings, torn) == 20);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  x.setConstant(std::numeric_limits<double>::quiet_NaN());
  CHECK(find_torn(network, x, settings, torn) == 0);
  CHECK(find_torn(network, Points<double>(Points<double>::Zero(3, 4)), settings, torn) == 0);
}

TEST_CASE("limits that are no strains are refused by name", "[network]") {
  TearSettings<double> settings;
  CHECK(settings.validate() == "");
  settings.seam = std::numeric_limits<double>::infinity();
  CHECK(settings.validate() == "");
  settings.bend = std::numeric_limits<double>::quiet_NaN();
  CHECK(settings.validate().find("tear limit bend must not be negative, got ") == 0);
  settings.bend = 0;
  settings.shear = -0.1;
  CHECK(settings.validate() == "tear limit shear must not be negative, got -0.1");
}

TEST_CASE("a broken thread splits the end that is loaded more, across its direction", "[network]") {
  const Network network = grid_network(5, 5);
  TornSprings<double> torn;
  torn.reserve_splits(9);
  const auto spring = [&network](int a, int b) {
    for (std::size_t s = 0; s < network.springs.size(); ++s) {
      if (network.springs[s].a == a && network.springs[s].b == b) return static_cast<int>(s);
    }
    return -1;
  };
  torn.add({spring(11, 12), 1.5});
  torn.add({spring(12, 13), 1.2});
  torn.sort();
  const Tear<double> tear = apply_topology_changes(network, torn).value();
  CHECK(tear.split_vertices == 1);
  CHECK(tear.removed_springs == 0);
  CHECK(tear.whole_springs == 0);
  const Remap<double>& remap = tear.change.remap;
  REQUIRE(remap.copies(12).size() == 2);
  // The neighbours along x are on different sides, those along z on both.
  const Topology topology = make_topology(26, tear.change.network.triangles).value();
  const auto joined = [&topology](int a, int b) {
    const auto beside = topology.neighbours(a);
    return std::find(beside.begin(), beside.end(), b) != beside.end();
  };
  const int one = remap.copies(12)[0], two = remap.copies(12)[1];
  CHECK(joined(one, 11) != joined(two, 11));
  CHECK(joined(one, 11) == joined(two, 13));
  CHECK((joined(one, 7) && joined(two, 7) && joined(one, 17) && joined(two, 17)));
  CHECK(orphan(tear.change.network) == "");
  // At a corner, all triangles are on one side: the other end is split.
  torn.clear();
  torn.add({spring(0, 1), 2.0});
  const Tear<double> corner = apply_topology_changes(network, torn).value();
  CHECK(corner.change.remap.copies(1).size() == 2);
  torn.clear();
  torn.add({4000, 2.0});
  CHECK(apply_topology_changes(network, torn).error() ==
        "torn spring 4000 is not one of 72 springs");
}

TEST_CASE("a spring that no plane can tear is reported", "[network]") {
  const Network network = grid_network(2, 2);
  TornSprings<double> torn;
  torn.reserve_splits(9);
  torn.add({0, 2.0});
  const Tear<double> tear = apply_topology_changes(network, torn).value();
  CHECK(tear.whole_springs == 1);
  CHECK(tear.split_vertices == 0);
  CHECK(tear.change.remap.is_identity());
}

TEST_CASE("seams, bend springs and ropes lose the broken spring", "[network]") {
  Network network = grid_network(4, 4);
  const std::size_t count = network.springs.size();
  detail::add_spring(network, 0, 15, 1.0, 0.0, SpringKind::Seam);
  detail::add_spring(network, 4, 6, 1.0, 0.0, SpringKind::Bend);
  TornSprings<double> torn;
  torn.reserve_splits(9);
  torn.add({static_cast<int>(count), 2.0});
  torn.add({static_cast<int>(count) + 1, 2.0});
  const Tear<double> tear = apply_topology_changes(network, torn).value();
  CHECK(tear.removed_springs == 2);
  CHECK(tear.change.network.springs.size() == count);
  CHECK(tear.split_vertices == 0);
  const Network rope = rope_network(RopeSettings<double>()).value();
  torn.clear();
  torn.add({3, 1.1});
  CHECK(apply_topology_changes(rope, torn).value().change.network.springs.size() ==
        rope.springs.size() - 1);
}

TEST_CASE("random tears keep mass and area, leave no orphans and obey Euler", "[network]") {
  std::mt19937 random(21);
  for (int trial = 0; trial < clothctl_test::trials(120, 5000); ++trial) {
    Network network;
    if (trial % 2 == 0) {
      network =
          grid_network(3 + static_cast<int>(random() % 6), 3 + static_cast<int>(random() % 6));
    } else {
      const PlainMesh mesh = irregular_mesh(6, 5, random, 0.2, trial % 3 == 0);
      network = sheet_network(mesh.positions, mesh.triangles, Material<double>()).value();
    }
    const double mass = network.mass.sum(),
                 area = total_area(network.rest_positions, network.triangles);
    TearSettings<double> settings;
    settings.structural = uniform(random, 0.05, 0.3);
    settings.shear = uniform(random, 0.05, 0.3);
    Points<double> x = network.rest_positions;
    for (int round = 0; round < 3; ++round) {
      for (Index i = 0; i < x.size(); ++i) x(i) += uniform(random, -0.06, 0.06);
      const auto torn = found(network, x, settings, 1 + static_cast<Index>(random() % 30));
      const int chi = euler(network.triangles);
      auto tear = apply_topology_changes(network, torn).value();
      const Network& after = tear.change.network;
      CHECK(orphan(after) == "");
      CHECK(clothctl_test::mesh_fault(after.vertex_count(), after.triangles) == "");
      CHECK(clothctl_test::remap_fault(tear.change.remap,
                                       {network.rest_positions, network.triangles},
                                       after.triangles) == "");
      CHECK(after.mass.sum() == Approx(mass).epsilon(1e-9));
      CHECK(total_area(after.rest_positions, after.triangles) == Approx(area).epsilon(1e-9));
      CHECK(after.vertex_count() == network.vertex_count() + tear.split_vertices);
      const auto edges = [](const Network& n) {
        return static_cast<int>(make_topology(n.vertex_count(), n.triangles)->edges.size());
      };
      CHECK(euler(after.triangles) - chi == tear.split_vertices - (edges(after) - edges(network)));
      if (torn.count() > 0) CHECK(tear.split_vertices + tear.whole_springs > 0);
      x = tear.change.remap.interpolate(x);
      network = std::move(tear.change.network);
    }
  }
}

TEST_CASE("a network is cut where the line was drawn in the world", "[network]") {
  const Network network = grid_network(7, 7);
  const Points<double>& rest = network.rest_positions;
  Points<double> x(3, 49);  // turned and stretched
  for (Index v = 0; v < 49; ++v) x.col(v) << 3 + rest(2, v), 0.2 * rest(0, v), -rest(0, v);
  Points<double> line(3, 2);
  line.col(0) << 2.45, 0, -0.8;
  line.col(1) << 2.55, 0, 0.8;
  CutSettings<double> settings;
  const auto cut = cut_network(network, x, line, settings).value();
  CHECK(orphan(cut.network) == "");
  CHECK(euler(cut.network.triangles) == 2);
  CHECK(cut.network.mass.sum() == Approx(network.mass.sum()));
  CHECK(cut_network(network, line, line, settings).error() ==
        "2 positions for 49 vertices of the network");
  line(0, 1) = std::numeric_limits<double>::quiet_NaN();
  CHECK(cut_network(network, x, line, settings).error() == "point 1 of the cut is not finite");
}

TEST_CASE("garments are cut and torn without orphans", "[network]") {
  std::mt19937 random(31);
  int found_meshes = 0;
  for (const char* name : {"dc_tshirt1426.obj", "dc_skirt681.obj", "dc_sock482.obj"}) {
    const PlainMesh mesh = clothctl_test::shared_mesh(name);
    if (mesh.triangles.empty()) continue;
    ++found_meshes;
    INFO(name);
    const Network network =
        sheet_network(mesh.positions, mesh.triangles, Material<double>()).value();
    const double mass = network.mass.sum(), area = total_area(mesh.positions, mesh.triangles);
    TearSettings<double> settings;
    settings.structural = 0.3;
    for (int trial = 0; trial < clothctl_test::trials(3, 40); ++trial) {
      const Index n = network.vertex_count();
      Points<double> line(3, 2);
      line.col(0) = mesh.positions.col(static_cast<Index>(random()) % n);
      line.col(1) = 0.8 * line.col(0) + 0.2 * mesh.positions.col(static_cast<Index>(random()) % n);
      const auto cut = cut_network(network, mesh.positions, line, CutSettings<double>()).value();
      Points<double> x = cut.network.rest_positions;
      for (Index i = 0; i < x.size(); ++i) x(i) += uniform(random, -0.01, 0.01);
      const auto tear =
          apply_topology_changes(cut.network, found(cut.network, x, settings, 30)).value();
      for (const Network* after : {&cut.network, &tear.change.network}) {
        CHECK(orphan(*after) == "");
        CHECK(after->mass.sum() == Approx(mass).epsilon(1e-9));
        CHECK(total_area(after->rest_positions, after->triangles) == Approx(area).epsilon(1e-9));
      }
    }
  }
  if (found_meshes == 0) WARN("../shared/data/meshes is missing: not tested");
}
