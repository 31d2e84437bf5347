// Networks on torn, cut and sewn meshes: against the builder, and what must stay the same.

#include "clothctl/network/network_change.hpp"

#include <cmath>
#include <type_traits>

#include "clothctl/mesh/surface_cut.hpp"
#include "clothctl/network/rest_folds.hpp"
#include "clothctl/network/rope.hpp"
#include "network/network_checks.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Network = SpringNetwork<double>;

MeshEditor<double> editor_of(const Network& network) {
  return MeshEditor<double>::create(network.rest_positions, network.triangles).value();
}

NetworkChange<double> opened(const Network& network, const std::vector<int>& path) {
  auto editor = editor_of(network);
  for (std::size_t i = 1; i < path.size(); ++i) REQUIRE(editor.mark(path[i - 1], path[i]));
  editor.open_marked();
  return change_network(network, editor.change()).value();
}

Network grid_network(int rows, int cols, double width = 0.6, double height = 0.8) {
  return sheet_network(make_grid<double>(rows, cols, width, height).value(), Material<double>())
      .value();
}

/// Returns true when a triangle has no neighbour.
bool lone_triangle(const Network& network) {
  const Topology topology = make_topology(network.vertex_count(), network.triangles).value();
  std::vector<bool> joined(network.triangles.size(), false);
  for (const MeshEdge& e : topology.edges) {
    for (const int t : e.triangle) {
      if (t >= 0 && !e.is_boundary()) joined[static_cast<std::size_t>(t)] = true;
    }
  }
  return std::find(joined.begin(), joined.end(), false) != joined.end();
}

/// Returns the spring between two vertices, or none.
const Spring<double>* find(const Network& network, int a, int b) {
  for (const auto& s : network.springs) {
    if ((s.a == a && s.b == b) || (s.a == b && s.b == a)) return &s;
  }
  return nullptr;
}

void check_kept(const Network& before, const Network& after) {
  CHECK(orphan(after) == "");
  CHECK(after.mass.sum() == Approx(before.mass.sum()).epsilon(1e-12));
  CHECK(total_area(after.rest_positions, after.triangles) ==
        Approx(total_area(before.rest_positions, before.triangles)).epsilon(1e-10));
}

/// A cut or some openings at random; some of the time the mesh stays whole.
MeshChange<double> random_change(const Network& network, std::mt19937& random) {
  auto editor = editor_of(network);
  const Points<double>& x = network.rest_positions;
  const Vector3<double> low = x.rowwise().minCoeff(), high = x.rowwise().maxCoeff();
  if (random() % 2 == 0) {
    Points<double> line(3, 2 + static_cast<Index>(random() % 3));
    for (Index i = 0; i < line.cols(); ++i) {
      for (Index c = 0; c < 3; ++c) {
        const double size = high[c] - low[c];
        line(c, i) = uniform(random, low[c] - 0.2 * size, high[c] + 0.2 * size);
      }
    }
    REQUIRE(mark_cut<double>(editor, line).has_value());
  } else {
    const int count = 1 + static_cast<int>(random() % 12);
    for (int i = 0; i < count; ++i) {
      const auto& t = editor.triangles()[random() % editor.triangles().size()];
      if (i % 2 == 0) editor.mark(t[0], t[1]);
      if (i % 2 == 1) editor.mark_across(t[2], {uniform(random, -1, 1), 0, uniform(random, -1, 1)});
    }
  }
  editor.open_marked();
  return editor.change();
}

}  // namespace

TEST_CASE("without a change of the mesh a network stays the same to the bit", "[network]") {
  std::mt19937 random(2);
  const PlainMesh mesh = irregular_mesh(5, 5, random, 0.2);
  for (const Network& network :
       {grid_network(5, 6),
        sheet_network(mesh.positions, mesh.triangles, Material<double>()).value()}) {
    const auto same = change_network(network, editor_of(network).change()).value();
    CHECK(difference(same.network, network, {}, 0) == "");
    CHECK(same.network.rest_positions == network.rest_positions);
    CHECK(same.network.triangles == network.triangles);
    for (std::size_t i = 0; i < network.springs.size(); ++i)
      CHECK(same.network.springs[i].a == network.springs[i].a);
  }
}

TEST_CASE("the network of a torn triangle mesh is that of the builder", "[network]") {
  std::mt19937 random(4);
  for (int trial = 0; trial < clothctl_test::trials(100, 3000); ++trial) {
    const PlainMesh mesh = irregular_mesh(4 + static_cast<int>(random() % 4), 6, random,
                                          trial % 2 == 0 ? 0.0 : 0.2, trial % 5 == 4);
    Material<double> material;
    material.set_bending(1e-3);
    Network network = sheet_network(mesh.positions, mesh.triangles, material).value();
    for (int round = 0; round < 2; ++round) {
      const auto change = change_network(network, random_change(network, random)).value();
      const Network& after = change.network;
      const auto built = sheet_network(after.rest_positions, after.triangles, material);
      if (!built) continue;               // a sliver that the builder refuses
      if (lone_triangle(network)) break;  // it has no hinge to tell its bending stiffness
      CHECK(difference(after, built.value(), {}, 1e-7) == "");
      check_kept(network, after);
      network = after;
    }
  }
}

TEST_CASE("a grid that is torn along a row or a column becomes two grids", "[network]") {
  for (const bool row : {true, false}) {
    const int rows = 7, cols = 6, at = 3;
    const Network network = grid_network(rows, cols);
    std::vector<int> path;
    for (int i = 0; i < (row ? cols : rows); ++i)
      path.push_back(row ? at * cols + i : i * cols + at);
    const auto change = opened(network, path);
    const Network& torn = change.network;
    check_kept(network, torn);
    // The two grids, side by side in one network.
    const Network lower = row ? grid_network(at + 1, cols, 0.6, 0.8 * at / (rows - 1))
                              : grid_network(rows, at + 1, 0.6 * at / (cols - 1), 0.8);
    const Network upper = row ? grid_network(rows - at, cols, 0.6, 0.8 - 0.8 * at / (rows - 1))
                              : grid_network(rows, cols - at, 0.6 - 0.6 * at / (cols - 1), 0.8);
    Network both = lower;
    const int n = static_cast<int>(lower.vertex_count());
    both.rest_positions.conservativeResize(3, n + upper.vertex_count());
    both.mass.conservativeResize(n + upper.vertex_count());
    both.rest_positions.rightCols(upper.vertex_count()) = upper.rest_positions;
    both.mass.tail(upper.vertex_count()) = upper.mass;
    for (Spring<double> s : upper.springs) {
      s.a += n;
      s.b += n;
      both.springs.push_back(s);
    }
    for (BendStencil<double> b : upper.bends) {
      for (int& v : b.vertex) v += n;
      both.bends.push_back(b);
    }
    std::vector<int> number;
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < cols; ++c) {
        const int along = row ? r : c;
        const bool low = along <= at;
        if (row) number.push_back(low ? r * cols + c : n + (r - at) * cols + c);
        if (!row) number.push_back(low ? r * (at + 1) + c : n + r * (cols - at) + c - at);
      }
    }
    for (int i = 0; i < static_cast<int>(path.size()); ++i)
      number.push_back(row ? n + i : n + i * (cols - at));
    CHECK(difference(torn, both, number, 1e-12) == "");
  }
}

TEST_CASE("a slit in a grid keeps what is beside it", "[network]") {
  const Network network = grid_network(5, 5, 0.4, 0.4);
  // Along the diagonal that is an edge of the mesh: cell (2, 2) has an even sum.
  const auto change = opened(network, {6, 12, 18});
  const Network& torn = change.network;
  check_kept(network, torn);
  const int copy = change.remap.copies(12)[1];
  // The cells (1, 1) and (2, 2) are torn: each half keeps half of its diagonal and loses the other.
  CHECK(find(torn, 6, 12)->stiffness == Approx(0.5 * find(network, 6, 12)->stiffness));
  CHECK(find(torn, 6, copy)->stiffness == Approx(0.5 * find(network, 6, 12)->stiffness));
  CHECK(find(torn, 7, 11) == nullptr);
  CHECK(find(torn, 13, 17) == nullptr);
  CHECK(find(torn, 1, 5) != nullptr);
  CHECK(find(torn, 6, 12)->kind == SpringKind::Shear);
  CHECK(torn.springs.size() == network.springs.size() + 2 - 2);
  // At the tip 6, where edges 6-12 and 6-copy meet, nothing else is shared.
  CHECK(torn.mass[12] + torn.mass[copy] == Approx(network.mass[12]));
  // The stencils along row and column through 12 are gone with one side each.
  int through = 0;
  for (const auto& b : torn.bends) through += b.vertex[1] == 12 || b.vertex[1] == copy ? 1 : 0;
  CHECK(through == 0);
  // Along a column: the tips keep their stencils; those that end in the slit share it.
  const Network column = opened(network, {7, 12, 17}).network;
  double along = 0;
  int rows = 0;
  for (const auto& b : column.bends) {
    if (b.vertex[1] == 7 && (b.vertex[0] == 2 || b.vertex[2] == 2)) {
      along += b.stiffness;
      ++rows;
    }
  }
  CHECK(rows == 2);
  CHECK(along == Approx(network.bends[0].stiffness));
}

TEST_CASE("random cuts of grids keep mass and area and leave no orphans", "[network]") {
  std::mt19937 random(6);
  for (int trial = 0; trial < clothctl_test::trials(150, 5000); ++trial) {
    Network network =
        grid_network(3 + static_cast<int>(random() % 6), 3 + static_cast<int>(random() % 6));
    for (int round = 0; round < 2; ++round) {
      const auto change = change_network(network, random_change(network, random)).value();
      check_kept(network, change.network);
      // Rigid motion, stretch by an affine map: stencils and springs at rest stay at rest.
      for (const auto& s : change.network.springs) {
        const double length =
            (change.network.rest_positions.col(s.a) - change.network.rest_positions.col(s.b))
                .norm();
        REQUIRE(s.rest_length == Approx(length).epsilon(1e-9));
        REQUIRE(s.stiffness > 0);
      }
      for (const auto& b : change.network.bends) {
        Vector3<double> sum = Vector3<double>::Zero();
        for (int i = 0; i < b.count; ++i) {
          const std::size_t k = static_cast<std::size_t>(i);
          sum += b.weight[k] * change.network.rest_positions.col(b.vertex[k]);
        }
        REQUIRE(sum.norm() < 1e-9);
      }
      network = change.network;
    }
  }
}

TEST_CASE("a cut cell of a grid still bends: no free hinge beside the cut", "[network]") {
  // A bent grid has nearly the same bending energy before and after a cut across the curvature.
  const Network network = grid_network(13, 13, 1, 1);
  auto editor = editor_of(network);
  Points<double> line(3, 2);
  line.col(0) << -0.7, 0, -0.46;
  line.col(1) << 0.7, 0, -0.46;
  REQUIRE(mark_cut<double>(editor, line).has_value());
  editor.open_marked();
  const Network cut = change_network(network, editor.change()).value().network;
  const auto energy = [](const Network& n) {
    double sum = 0;
    for (const auto& b : n.bends) {
      Vector3<double> value = Vector3<double>::Zero();
      for (int i = 0; i < b.count; ++i) {
        const std::size_t k = static_cast<std::size_t>(i);
        Vector3<double> x = n.rest_positions.col(b.vertex[k]);
        x[1] = 0.5 * 0.3 * x[0] * x[0];
        value += b.weight[k] * x;
      }
      sum += 0.5 * b.stiffness * value.squaredNorm();
    }
    return sum;
  };
  CHECK(energy(cut) == Approx(energy(network)).epsilon(0.15));
}

TEST_CASE("springs of all kinds follow their vertices", "[network]") {
  Network network = grid_network(5, 5, 0.4, 0.4);
  const auto add = [&network](int a, int b, SpringKind kind) {
    detail::add_spring(network, a, b, 7.0, 0.1, kind);
  };
  add(10, 12, SpringKind::Bend);  // two edges long, on row 2
  add(12, 14, SpringKind::Bend);
  add(2, 12, SpringKind::Bend);
  add(12, 24, SpringKind::Seam);
  add(11, 12, SpringKind::Structural);  // beside the one that is there
  const auto change = opened(network, {7, 12, 17});
  const Network& torn = change.network;
  const int copy = change.remap.copies(12)[1];
  const bool left = find(torn, 11, 12) != nullptr;  // which side keeps the index
  CHECK((find(torn, 10, 12) != nullptr) == left);
  CHECK((find(torn, 14, copy) != nullptr) == left);
  CHECK((find(torn, 2, 12) != nullptr && find(torn, 2, copy) != nullptr));
  CHECK(find(torn, 12, 24)->kind == SpringKind::Seam);
  int parallel = 0;
  for (const auto& s : torn.springs)
    parallel += (s.a == 11 || s.b == 11) && (s.a == 12 || s.b == 12 || s.a == copy || s.b == copy);
  CHECK(parallel == 2);
  CHECK(torn.mass.sum() == Approx(network.mass.sum()));
}

TEST_CASE("a network that was stretched for good stays so when it is torn", "[network]") {
  Network network = grid_network(4, 4);
  for (auto& s : network.springs) s.rest_length *= 1.1;
  auto editor = editor_of(network);
  Points<double> line(3, 2);
  line.col(0) << -0.7, 0, -0.41;
  line.col(1) << 0.7, 0, -0.33;
  REQUIRE(mark_cut<double>(editor, line).has_value());
  editor.open_marked();
  const Network cut = change_network(network, editor.change()).value().network;
  for (const auto& s : cut.springs) {
    const double length = (cut.rest_positions.col(s.a) - cut.rest_positions.col(s.b)).norm();
    CHECK(s.rest_length == Approx(1.1 * length));
  }
}

TEST_CASE("cuts and tears keep the rest folds, however a hinge numbers its vertices", "[network]") {
  // New vertices lie in the old triangles, so a changed mesh measures the folds that it has kept.
  const int trials = clothctl_test::trials(20, 300);
  std::mt19937 random(8);
  int changed = 0, folded = 0;
  for (int trial = 0; trial < trials; ++trial) {
    const PlainMesh mesh = irregular_mesh(6, 6, random, 0.3);
    const Points<double>& x = mesh.positions;
    Network network = sheet_network<double>(x, mesh.triangles, Material<double>()).value();
    REQUIRE(set_rest_folds<double>(network, x).empty());
    for (BendStencil<double>& b : network.bends) {
      for (const std::size_t i : {std::size_t(0), std::size_t(2)}) {
        if (random() % 2 == 0) continue;
        std::swap(b.vertex[i], b.vertex[i + 1]);
        std::swap(b.weight[i], b.weight[i + 1]);
        b.rest_fold = -b.rest_fold;
      }
    }
    const Network after = change_network(network, random_change(network, random)).value().network;
    changed += after.vertex_count() != network.vertex_count();
    Network measured = after;
    if (!set_rest_folds<double>(measured, after.rest_positions).empty()) continue;  // slivers
    for (std::size_t b = 0; b < after.bends.size(); ++b) {
      CHECK(after.bends[b].rest_fold == Approx(measured.bends[b].rest_fold).margin(1e-6));
      folded += after.bends[b].is_folded();
    }
  }
  CHECK(changed > trials / 2);
  CHECK(folded > 20 * trials);
}

TEMPLATE_TEST_CASE("a triangle without area has no hinge, whatever the fold at rest was",
                   "[network]", float, double) {
  using Scalar = TestType;
  const bool single = std::is_same_v<Scalar, float>;
  // Two triangles, folded about the edge 0-2 by a right angle.
  Points<Scalar> x(3, 4);
  x << Scalar(0), Scalar(0.3), Scalar(0.1), Scalar(-0.2),  //
      Scalar(0), Scalar(0), Scalar(0), Scalar(0.4),        //
      Scalar(0), Scalar(0.2), Scalar(0.7), Scalar(0.3);
  SpringNetwork<Scalar> network =
      sheet_network<Scalar>(x, {{0, 1, 2}, {0, 2, 3}}, Material<Scalar>()).value();
  REQUIRE(set_rest_folds<Scalar>(network, x).empty());
  REQUIRE(network.bends.size() == 1);
  REQUIRE(std::abs(network.bends[0].rest_fold) > Scalar(0.2));

  SECTION("a part of a cut triangle: all its hinges are left out, the others rest") {
    auto editor = MeshEditor<Scalar>::create(x, network.triangles).value();
    const Scalar thin = Scalar(GENERATE(false, true) ? 1e-30 : (single ? 1e-9 : 1e-17));
    REQUIRE(editor.insert_in_triangle(0, {Scalar(1), thin, Scalar(1)}).has_value());
    const auto change = change_network(network, editor.change());
    INFO((change ? std::string() : change.error()));
    REQUIRE(change.has_value());
    // Vertex 4 is in the middle of 0-2; the edge 1-4 alone has two triangles with area.
    REQUIRE(change->network.bends.size() == 1);
    const BendStencil<Scalar>& b = change->network.bends[0];
    CHECK((b.vertex[0] == 1 && b.vertex[1] == 4 && !b.is_folded()));
    Vector3<Scalar> sum = Vector3<Scalar>::Zero();
    for (std::size_t i = 0; i < 4; ++i)
      sum += b.weight[i] * change->network.rest_positions.col(b.vertex[i]);
    CHECK(sum.norm() < (single ? 1e-6f : 1e-14));
  }
  SECTION("a whole triangle that was flattened by hand beside one that is cut") {
    network.rest_positions.col(3) = Scalar(2) * x.col(2);
    auto editor = MeshEditor<Scalar>::create(network.rest_positions, network.triangles).value();
    REQUIRE(editor.insert_on_edge(0, 1, Scalar(0.5)).has_value());
    const auto change = change_network(network, editor.change());
    INFO((change ? std::string() : change.error()));
    REQUIRE(change.has_value());
    REQUIRE(change->network.bends.size() == 1);  // over the edge that divides the first triangle
    CHECK(change->network.bends[0].vertex[1] == 4);
    CHECK(change->network.bends[0].stiffness > Scalar(0));
  }
  SECTION("with area, a thin part keeps the hinge and its fold") {
    auto editor = MeshEditor<Scalar>::create(x, network.triangles).value();
    REQUIRE(editor.insert_in_triangle(0, {Scalar(1), Scalar(1e-3), Scalar(1)}).has_value());
    const auto change = change_network(network, editor.change());
    REQUIRE(change.has_value());
    CHECK(change->network.bends.size() == 4);
    int folded = 0;
    for (const BendStencil<Scalar>& b : change->network.bends) {
      folded += b.is_folded();
      const Scalar fold = detail::measure_fold<Scalar>(b.vertex, change->network.rest_positions);
      CHECK(b.rest_fold == Approx(fold).margin(single ? 1e-4 : 1e-12));
    }
    CHECK(folded == 1);
  }
}

TEST_CASE("stitching a torn network gives back its stiffness and mass", "[network]") {
  const Network network = grid_network(5, 5);
  const auto torn = opened(network, {10, 11, 12, 13, 14});
  std::vector<std::array<int, 2>> pairs;
  for (int v = 10; v < 15; ++v) pairs.push_back({torn.remap.copies(v)[0], torn.remap.copies(v)[1]});
  const auto sewn = stitch_network(torn.network, pairs).value();
  CHECK(sewn.network.vertex_count() == 25);
  CHECK((sewn.network.mass - network.mass).cwiseAbs().maxCoeff() < 1e-15);
  CHECK(sewn.network.springs.size() == network.springs.size());
  for (const auto& s : network.springs)
    CHECK(find(sewn.network, s.a, s.b)->stiffness == Approx(s.stiffness));
  CHECK(torn.remap.then(sewn.remap).is_identity());
  CHECK(orphan(sewn.network) == "");
  // Momentum: the joined vertex moves with the mean by mass.
  Points<double> v = Points<double>::Random(3, 30);
  const Vector3<double> before = v * torn.network.mass;
  const Vector3<double> after = sewn.remap.interpolate(v) * sewn.network.mass;
  CHECK((after - before).norm() < 1e-14);
  // A seam spring between joined vertices is gone.
  Network seam = torn.network;
  detail::add_spring(seam, 12, 0, 5.0, 0.0, SpringKind::Seam);
  seam.springs.back().b = torn.remap.copies(12)[1];
  CHECK(stitch_network(seam, pairs).value().network.springs.size() == network.springs.size());
}

TEST_CASE("a rope breaks where a spring is removed", "[network]") {
  RopeSettings<double> settings;
  settings.segments = 6;
  const Network rope = rope_network(settings).value();
  const auto broken =
      change_network(rope, editor_of(rope).change(), std::vector<int>{2}).value().network;
  CHECK(broken.springs.size() == 5);
  CHECK(broken.bends.size() == 3);
  CHECK(broken.mass == rope.mass);
  for (const auto& b : broken.bends) CHECK((b.vertex[0] == 0 || b.vertex[0] >= 3));
}

TEST_CASE("changes that do not fit are refused by name", "[network]") {
  const Network network = grid_network(3, 3), other = grid_network(4, 3);
  CHECK(change_network(network, editor_of(other).change()).error().find("the change starts from") ==
        0);
  CHECK(change_network(network, editor_of(network).change(), {99}).error().find("spring 99") == 0);
  CHECK(change_network(network, editor_of(network).change(), {-1}).error().find("spring -1") == 0);
  Network bad = network;
  bad.mass[4] = 0;
  CHECK(change_network(bad, editor_of(network).change()).error() ==
        "mass of vertex 4 is not positive: 0 kg");
  bad = network;
  bad.triangles.push_back(bad.triangles[0]);
  CHECK(change_network(bad, editor_of(network).change()).error() ==
        "triangle 8 repeats triangle 0");
  CHECK(stitch_network(network, {{0, 4}}).error() == "pair 0: vertex 4 is not on the border");
}
