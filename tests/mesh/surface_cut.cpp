// Cuts along drawn lines, on flat, curved and irregular meshes, and hostile ones.

#include "clothctl/mesh/surface_cut.hpp"

#include <limits>

#include "clothctl/mesh/grid.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Cut = SurfaceCut<double>;

PlainMesh grid(int n) {
  const GridMesh<double> mesh = make_grid<double>(n, n, 1.0, 1.0).value();
  return {mesh.positions, mesh.triangles};
}

/// A polyline in the x-z plane from the lower left corner of the grid.
Points<double> line(const std::vector<std::array<double, 2>>& points) {
  Points<double> out(3, static_cast<Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i)
    out.col(static_cast<Index>(i)) << points[i][0] - 0.5, 0.0, points[i][1] - 1.0;
  return out;
}

/// Cuts, and checks all laws that hold for any cut.
Cut checked_cut(const PlainMesh& mesh, const Points<double>& polyline, double tolerance = 1e-12) {
  Cut cut = cut_surface<double>(mesh.positions, mesh.triangles, polyline, {}).value();
  const MeshChange<double>& change = cut.change;
  CHECK(mesh_fault(change.remap.vertex_count(), change.triangles, false) == "");
  CHECK(remap_fault(change.remap, mesh, change.triangles, tolerance) == "");
  const double area = total_area(mesh.positions, mesh.triangles);
  CHECK(std::abs(total_area(change.remap.interpolate(mesh.positions), change.triangles) - area) <
        1e-9 * area + 1e-300);
  CHECK(euler(change.triangles) == euler(mesh.triangles) + cut.copied_vertices - cut.opened_edges);
  CHECK(change.remap.vertex_count() ==
        mesh.positions.cols() + cut.inserted_vertices + cut.copied_vertices);
  if (cut.opened_edges == 0) CHECK(cut.copied_vertices == 0);
  return cut;
}

/// Number of connected pieces.
int pieces(Index vertices, const std::vector<std::array<int, 3>>& triangles) {
  std::vector<int> root(static_cast<std::size_t>(vertices));
  for (std::size_t v = 0; v < root.size(); ++v) root[v] = static_cast<int>(v);
  const auto find = [&root](int v) {
    while (root[static_cast<std::size_t>(v)] != v) v = root[static_cast<std::size_t>(v)];
    return v;
  };
  for (const auto& t : triangles) {
    for (std::size_t i = 1; i < 3; ++i) root[static_cast<std::size_t>(find(t[i]))] = find(t[0]);
  }
  std::set<int> roots;
  for (const auto& t : triangles) roots.insert(find(t[0]));
  return static_cast<int>(roots.size());
}

}  // namespace

TEST_CASE("a straight cut across a grid severs it on the line", "[mesh]") {
  const PlainMesh mesh = grid(7);
  const Cut cut = checked_cut(mesh, line({{-0.2, 0.43}, {1.3, 0.61}}));
  CHECK(pieces(cut.change.remap.vertex_count(), cut.change.triangles) == 2);
  CHECK(euler(cut.change.triangles) == 2);
  // Every new vertex lies on the line; the areas on both sides of it are those of the trapezia, up
  // to the snap distance.
  const Points<double> x = cut.change.remap.interpolate(mesh.positions);
  double below = 0;
  const auto height = [](double at) { return 0.43 + (at + 0.2) * 0.18 / 1.5; };
  for (const auto& t : cut.change.triangles) {
    const Vector3<double> centre = (x.col(t[0]) + x.col(t[1]) + x.col(t[2])) / 3;
    if (centre[2] + 1 < height(centre[0] + 0.5)) below += total_area(x, {t});
  }
  CHECK(below == Approx(height(0.5)).margin(0.02));
  for (int v = 49; v < 49 + cut.inserted_vertices; ++v)
    CHECK(std::abs(x(2, v) + 1 - height(x(0, v) + 0.5)) < 0.03);
}

TEST_CASE("cuts inside, to the border, through vertices and along edges", "[mesh]") {
  const PlainMesh mesh = grid(7);
  struct Case {
    std::vector<std::array<double, 2>> points;
    int chi, pieces;
  };
  const double h = 1.0 / 6;
  const std::vector<Case> cases{
      {{{0.3, 0.3}, {0.7, 0.6}}, 0, 1},          // a slit: a hole
      {{{-0.1, 0.5}, {0.6, 0.55}}, 1, 1},        // from the border
      {{{0.6, 0.55}, {-0.1, 0.5}}, 1, 1},        // to the border
      {{{2 * h, 3 * h}, {4 * h, 3 * h}}, 0, 1},  // along edges
      {{{0, 3 * h}, {1, 3 * h}}, 2, 2},          // along a whole row
      {{{-1, 3 * h}, {2, 3 * h}}, 2, 2},         // the same from outside
      {{{0, 0}, {1, 1}}, 2, 2},                  // through vertices
      {{{-0.5, -0.5}, {1.5, 1.5}}, 2, 2},        // the same from outside
      {{{0.2, 0.2}, {0.8, 0.2}, {0.8, 0.8}, {0.2, 0.8}, {0.2, 0.2}}, 1, 2},  // a piece cut out
      {{{0.2, 0.2}, {0.8, 0.8}, {0.8, 0.2}, {0.2, 0.8}}, 1, 2},              // crosses itself
      {{{-0.1, 0.3}, {0.5, 0.5}, {1.1, 0.3}}, 2, 2},                         // a corner inside
      {{{-0.1, 0.3}, {0.5, 1.4}, {1.1, 0.3}}, 3, 3},  // leaves and enters again
  };
  for (const Case& c : cases) {
    INFO("from " << c.points[0][0] << ", " << c.points[0][1] << " to " << c.points[1][0] << ", "
                 << c.points[1][1]);
    const Cut cut = checked_cut(mesh, line(c.points));
    CHECK(euler(cut.change.triangles) == c.chi);
    CHECK(pieces(cut.change.remap.vertex_count(), cut.change.triangles) == c.pieces);
    CHECK(cut.broken_segments == 0);
    for (int v = 0; v < static_cast<int>(cut.change.remap.vertex_count()); ++v)
      CHECK(fans(v, cut.change.triangles) == 1);
  }
}

TEST_CASE("cuts that meet nothing change nothing", "[mesh]") {
  const PlainMesh mesh = grid(5);
  const std::vector<Points<double>> nothing{
      line({{2, 2}, {3, 3}}),                      // beside the mesh
      line({{0, 0}, {1, 0}}),                      // along the border
      line({{0.3, 0.3}, {0.3, 0.3}}),              // no length
      line({{0.3, 0.3}, {0.3, 0.3}, {0.3, 0.3}}),  //
      line({{0.25, 0.25}, {0.5, 0.25}}),           // a single inner edge stays closed
      line({{0.25, 0.25}, {0.27, 0.25}}),          // shorter than the snap distance
      Points<double>(line({{-0.1, 0.5}, {1.1, 0.5}}).colwise() + Vector3<double>(0, 0.4, 0))};
  for (const Points<double>& polyline : nothing) {
    const Cut cut = checked_cut(mesh, polyline);
    CHECK(cut.copied_vertices == 0);
    CHECK(cut.opened_edges == 0);
  }
  CHECK(checked_cut({Points<double>(3, 0), {}}, line({{0, 0}, {1, 1}})).change.remap.is_identity());
}

TEST_CASE("a repeated cut finds its slit and adds nothing", "[mesh]") {
  const PlainMesh mesh = grid(6);
  const Points<double> polyline = line({{0.2, 0.3}, {0.5, 0.55}, {1.2, 0.61}});
  const Cut first = checked_cut(mesh, polyline);
  const PlainMesh torn{first.change.remap.interpolate(mesh.positions), first.change.triangles};
  const Cut second = checked_cut(torn, polyline);
  CHECK(second.opened_edges <= 2);
  CHECK(euler(second.change.triangles) == euler(torn.triangles));
  // A line across the slit cuts both of its sides.
  const Cut across = checked_cut(torn, line({{0.7, -0.2}, {0.72, 1.2}}));
  CHECK(pieces(across.change.remap.vertex_count(), across.change.triangles) == 3);
}

TEST_CASE("a cut on a folded sheet stays on its layer", "[mesh]") {
  PlainMesh mesh = grid(9);
  for (Index v = 0; v < mesh.positions.cols(); ++v) {  // folded at z = -0.5, 5 cm between layers
    double& z = mesh.positions(2, v);
    if (z > -0.5) {
      z = -1.0 - z;
      mesh.positions(1, v) = 0.05;
    }
  }
  Points<double> polyline = line({{-0.1, 0.31}, {1.1, 0.27}});
  const Cut cut = checked_cut(mesh, polyline);
  CHECK(pieces(cut.change.remap.vertex_count(), cut.change.triangles) == 2);
  const Points<double> x = cut.change.remap.interpolate(mesh.positions);
  for (Index v = mesh.positions.cols(); v < x.cols(); ++v) CHECK(x(1, v) < 0.01);
}

TEST_CASE("bad cuts are refused by name", "[mesh]") {
  const PlainMesh mesh = grid(4);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  const auto refused = [&mesh](const Points<double>& polyline, CutSettings<double> settings = {}) {
    return cut_surface<double>(mesh.positions, mesh.triangles, polyline, settings).error();
  };
  CHECK(refused(line({{0, 0}})) == "a cut needs at least 2 points, got 1");
  CHECK(refused(Points<double>(3, 0)) == "a cut needs at least 2 points, got 0");
  CHECK(refused(line({{0, 0}, {0.5, nan}})) == "point 1 of the cut is not finite");
  CHECK(refused(line({{inf, 0}, {0.5, 0}})) == "point 0 of the cut is not finite");
  CHECK(refused(line({{0, 0}, {0.5, 0}, {1e30, 0}})) ==
        "point 2 of the cut is too far from the mesh");
  CutSettings<double> settings;
  for (const double bad : {nan, 0.0, 0.6, -1.0, inf}) {
    settings.snap = bad;
    CHECK(refused(line({{0, 0}, {1, 1}}), settings).find("snap must be from 0.001") == 0);
  }
  settings = {};
  for (const double bad : {nan, 0.0, -1.0, inf}) {
    settings.reach = bad;
    CHECK(refused(line({{0, 0}, {1, 1}}), settings).find("reach must be positive") == 0);
  }
}

TEST_CASE("random cuts keep area and manifold and obey Euler", "[mesh]") {
  std::mt19937 random(11);
  for (int trial = 0; trial < clothctl_test::trials(150, 5000); ++trial) {
    const double bulge = trial % 3 == 0 ? 0.0 : 0.3;
    PlainMesh mesh =
        irregular_mesh(4 + static_cast<int>(random() % 7), 4 + static_cast<int>(random() % 7),
                       random, bulge, trial % 4 == 3);
    for (int round = 0; round < 1 + trial % 3; ++round) {
      Points<double> polyline(3, 2 + static_cast<Index>(random() % 4));
      for (Index i = 0; i < polyline.cols(); ++i) {
        if (random() % 3 == 0) {
          polyline.col(i) =
              mesh.positions.col(static_cast<Index>(random()) % mesh.positions.cols());
        } else {
          const double x = uniform(random, -0.3, 1.3), z = uniform(random, -0.3, 1.3);
          polyline.col(i) << x, bulge * std::sin(2 * x) * std::cos(3 * z), z;
        }
      }
      const Cut cut = checked_cut(mesh, polyline);
      for (int v = 0; v < static_cast<int>(cut.change.remap.vertex_count()); ++v)
        if (cut.change.remap.origin(v).size() > 1) REQUIRE(fans(v, cut.change.triangles) == 1);
      mesh = {cut.change.remap.interpolate(mesh.positions), cut.change.triangles};
    }
  }
}

TEST_CASE("straight cuts through irregular flat sheets sever them", "[mesh]") {
  std::mt19937 random(12);
  const int count = clothctl_test::trials(100, 3000);
  int severed = 0;
  for (int trial = 0; trial < count; ++trial) {
    const PlainMesh mesh = irregular_mesh(8, 8, random);
    Points<double> polyline(3, 2);
    polyline.col(0) << -0.4, 0, uniform(random, 0.2, 0.8);
    polyline.col(1) << 1.4, 0, uniform(random, 0.2, 0.8);
    const Cut cut = checked_cut(mesh, polyline);
    CHECK(cut.broken_segments == 0);
    if (pieces(cut.change.remap.vertex_count(), cut.change.triangles) >= 2) ++severed;
  }
  CHECK(severed == count);
}

TEST_CASE("random cuts of garments keep area and manifold", "[mesh]") {
  std::mt19937 random(13);
  int found = 0;
  for (const char* name : {"dc_tshirt1426.obj", "dc_skirt681.obj", "dc_sock482.obj",
                           "dc_hat579.obj", "dc_flag540.obj"}) {
    const PlainMesh mesh = clothctl_test::shared_mesh(name);
    if (mesh.triangles.empty()) continue;
    ++found;
    INFO(name);
    for (int trial = 0; trial < clothctl_test::trials(8, 200); ++trial) {
      const auto any = [&] {
        return mesh.positions.col(static_cast<Index>(random()) % mesh.positions.cols());
      };
      Points<double> polyline(3, 3);
      for (Index i = 0; i < 3; ++i) polyline.col(i) = any();
      if (trial % 2 == 0) polyline.col(1) = 0.9 * polyline.col(0) + 0.1 * polyline.col(1);
      checked_cut(mesh, polyline, 1e-9);
    }
  }
  if (found == 0) WARN("../shared/data/meshes is missing: not tested");
}

TEST_CASE("a sheet in float is cut too", "[mesh]") {
  const GridMesh<float> mesh = make_grid<float>(9, 9, 1.0f, 1.0f).value();
  Points<float> polyline(3, 2);
  polyline.col(0) << -0.7f, 0.0f, -0.52f;
  polyline.col(1) << 0.7f, 0.0f, -0.37f;
  const auto cut = cut_surface<float>(mesh.positions, mesh.triangles, polyline, {}).value();
  CHECK(mesh_fault(cut.change.remap.vertex_count(), cut.change.triangles) == "");
  CHECK(pieces(cut.change.remap.vertex_count(), cut.change.triangles) == 2);
}
