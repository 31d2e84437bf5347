#include "clothctl/mesh/garment.hpp"

#include <limits>

#include "mesh/flat_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::euler;

namespace {

/// Two rectangles sewn along the long sides: a tube.
GarmentPattern tube(double front_width = 0.3, double back_length = 0.4) {
  GarmentPattern pattern;
  PanelPlacement front, back;
  front.origin = {0, -0.1, 0};
  back.origin = {0.3, 0.1, 0};
  back.right = {-1, 0, 0};
  const int f = pattern.add_panel("front", rectangle_outline(front_width, 0.4), front);
  const int b = pattern.add_panel("back", rectangle_outline(0.3, back_length), back);
  pattern.sew(f, 1, b, 3);
  pattern.sew(f, 3, b, 1);
  return pattern;
}

double edge_lengths_differ(const PatternMesh& mesh) {
  double worst = 0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t k = (i + 1) % 3;
      const double space =
          (mesh.positions.col(mesh.triangles[t][i]) - mesh.positions.col(mesh.triangles[t][k]))
              .norm();
      const double flat = (mesh.pattern.col(mesh.pattern_triangles[t][i]) -
                           mesh.pattern.col(mesh.pattern_triangles[t][k]))
                              .norm();
      worst = std::max(worst, std::abs(space - flat) / flat);
    }
  }
  return worst;
}

}  // namespace

TEST_CASE("a placement keeps lengths: exactly when flat, to the order h² on a cylinder", "[mesh]") {
  GarmentPattern pattern;
  PanelPlacement place;
  place.origin = {1, 2, 3};
  place.right = {0, 0.6, 0.8};
  place.up = {0, -0.8, 0.6};
  pattern.add_panel("flat", rectangle_outline(0.3, 0.2), place);
  CHECK(edge_lengths_differ(make_garment(pattern, 0.02)->mesh) < 1e-12);
  pattern.panels[0].placement.radius = 0.1;
  CHECK(edge_lengths_differ(make_garment(pattern, 0.02)->mesh) < 0.04 * 0.04 / (24 * 0.01));
  // All points lie at the distance 0.1 from the axis, whose direction is `up`.
  const Vector3<double> normal(1, 0, 0);  // right × up
  const auto garment = make_garment(pattern, 0.02);
  for (Index v = 0; v < garment->mesh.positions.cols(); ++v) {
    Vector3<double> from = garment->mesh.positions.col(v) - (place.origin - 0.1 * normal);
    from -= from.dot(place.up) * place.up;
    CHECK(from.norm() == Approx(0.1).epsilon(1e-12));
  }
  CHECK(place.position(FlatPoint(0, 0)) == place.origin);
}

TEST_CASE("seams pair equal numbers of vertices in opposite directions", "[mesh]") {
  for (const double h : {0.05, 0.013}) {
    const GarmentPattern pattern = tube(0.3, 0.38);
    const auto garment = make_garment(pattern, h);
    REQUIRE(garment);
    REQUIRE(garment->seams.size() == 2);
    for (std::size_t s = 0; s < 2; ++s) {
      const PatternSeam& seam = pattern.seams[s];
      const auto& a = garment->panels[0].sides[static_cast<std::size_t>(seam.side_a)];
      const auto& b = garment->panels[1].sides[static_cast<std::size_t>(seam.side_b)];
      REQUIRE(a.size() == b.size());
      REQUIRE(garment->seams[s].size() == a.size());
      CHECK(static_cast<double>(a.size() - 1) == Approx(0.39 / h).margin(0.51));
      for (std::size_t i = 0; i < a.size(); ++i) {
        CHECK(garment->seams[s][i][0] == a[i]);
        CHECK(garment->seams[s][i][1] == b[b.size() - 1 - i]);
      }
      // Both ends are at the hem or at the top, at the same height up to the ease.
      for (const auto& pair : {garment->seams[s].front(), garment->seams[s].back()})
        CHECK(std::abs(garment->mesh.positions(2, pair[0]) - garment->mesh.positions(2, pair[1])) <
              0.021);
    }
    CHECK(garment->panels[1].first_vertex == garment->panels[0].vertex_count);
    CHECK(garment->panels[1].first_triangle == garment->panels[0].triangle_count);
  }
}

TEST_CASE("a sewn tube is a manifold with two loops", "[mesh]") {
  const auto garment = make_garment(tube(), 0.03);
  REQUIRE(garment);
  const auto sewn = weld_seams(*garment);
  REQUIRE(sewn);
  const long n = sewn->mesh.positions.cols();
  CHECK(n == garment->mesh.positions.cols() -
                 static_cast<long>(garment->seams[0].size() + garment->seams[1].size()));
  CHECK(euler(n, sewn->mesh.triangles) == 0);
  CHECK(boundary_loops(n, sewn->mesh.triangles)->size() == 2);
  CHECK(sewn->mesh.validate().empty());
  // The pattern is untouched, and so is the place of vertices off the seams.
  CHECK(sewn->mesh.pattern == garment->mesh.pattern);
  std::vector<int> members(static_cast<std::size_t>(n), 0);
  for (const int v : sewn->vertex_of) ++members[static_cast<std::size_t>(v)];
  for (std::size_t v = 0; v < sewn->vertex_of.size(); ++v) {
    const int to = sewn->vertex_of[v];
    if (members[static_cast<std::size_t>(to)] == 1)
      CHECK(sewn->mesh.positions.col(to) == garment->mesh.positions.col(static_cast<Index>(v)));
  }
  for (const auto& seam : garment->seams) {
    for (const auto& pair : seam) {
      const int to = sewn->vertex_of[static_cast<std::size_t>(pair[0])];
      CHECK(to == sewn->vertex_of[static_cast<std::size_t>(pair[1])]);
      const Vector3<double> mean =
          0.5 * (garment->mesh.positions.col(pair[0]) + garment->mesh.positions.col(pair[1]));
      CHECK((sewn->mesh.positions.col(to) - mean).norm() < 1e-15);
    }
  }
  const Points<float> x = garment->mesh.positions.cast<float>();
  CHECK((merge_points(sewn->vertex_of, x).cast<double>() - sewn->mesh.positions).norm() < 1e-5);
}

TEST_CASE("a pillow closes: corners of two panels sewn all round stay manifold", "[mesh]") {
  for (const double h : {0.03, 0.05, 0.1}) {
    GarmentPattern pattern;
    PanelPlacement back;
    back.right = {-1, 0, 0};
    pattern.add_panel("front", rectangle_outline(0.3, 0.4));
    pattern.add_panel("back", rectangle_outline(0.3, 0.4), back);
    pattern.sew(0, 0, 1, 0);
    pattern.sew(0, 1, 1, 3);
    pattern.sew(0, 2, 1, 2);
    pattern.sew(0, 3, 1, 1);
    const auto sewn = weld_seams(*make_garment(pattern, h));
    REQUIRE(sewn);
    CHECK(euler(sewn->mesh.positions.cols(), sewn->mesh.triangles) == 2);
    CHECK(boundary_loops(sewn->mesh.positions.cols(), sewn->mesh.triangles)->empty());
  }
}

TEST_CASE("a dart closes to a cone: one panel, a seam from corner to tip", "[mesh]") {
  PanelOutline outline(FlatPoint(0, 0));
  outline.line_to({0.18, 0}).line_to({0.2, 0.12}).line_to({0.22, 0}).line_to({0.4, 0});
  outline.line_to({0.4, 0.3}).line_to({0, 0.3});
  GarmentPattern pattern;
  pattern.add_panel("skirt", outline);
  pattern.sew(0, 1, 0, 2);
  const auto garment = make_garment(pattern, 0.015);
  REQUIRE(garment);
  CHECK(garment->seams[0].size() == 8);  // nine vertices a side, of which the tip is common
  const auto sewn = weld_seams(*garment);
  REQUIRE(sewn);
  CHECK(euler(sewn->mesh.positions.cols(), sewn->mesh.triangles) == 1);
  CHECK(boundary_loops(sewn->mesh.positions.cols(), sewn->mesh.triangles)->size() == 1);
}

TEST_CASE("bad patterns are refused with the panel, the seam and the value", "[mesh]") {
  GarmentPattern pattern;
  CHECK(make_garment(pattern, 0.01).error() == "garment has no panels");
  CHECK(make_garment(tube(), -1).error() == "edge length must be positive, got -1");
  CHECK(
      make_garment(tube(0.3, 0.3), 0.05).error() ==
      "seam 0 (\"front\" side 1, \"back\" side 3): lengths 0.4 m and 0.3 m differ by more than its "
      "ease of 0.1");
  pattern = tube();
  pattern.sew(0, 1, 2, 0);
  CHECK(make_garment(pattern, 0.05).error() == "seam 2 joins panel 2 of 2");
  pattern = tube();
  pattern.seams[1].side_b = 4;
  CHECK(make_garment(pattern, 0.05).error() ==
        "seam 1 joins side 4 of the 4 sides of panel \"back\"");
  pattern.seams[1].side_b = -1;
  CHECK(make_garment(pattern, 0.05).error() ==
        "seam 1 joins side -1 of the 4 sides of panel \"back\"");
  pattern = tube();
  pattern.sew(1, 0, 1, 0);
  CHECK(make_garment(pattern, 0.05).error() ==
        "seam 2 (\"back\" side 0, \"back\" side 0) joins a side to itself");
  pattern = tube();
  pattern.seams[0].ease = std::numeric_limits<double>::quiet_NaN();
  CHECK_FALSE(make_garment(pattern, 0.05));
  pattern = tube();
  pattern.panels[1].placement.up = {0, 0, 2};
  CHECK(make_garment(pattern, 0.05).error() ==
        "panel \"back\": direction up of the placement is no unit vector");
  pattern.panels[1].placement.up = {-1, 0, 0};
  CHECK(make_garment(pattern, 0.05).error() ==
        "panel \"back\": directions of the placement are not at right angles");
  pattern = tube();
  pattern.panels[0].placement.radius = -0.1;
  CHECK(make_garment(pattern, 0.05).error() ==
        "panel \"front\": radius of the placement must not be negative, got -0.1");
  pattern.panels[0].placement.radius = 0;
  pattern.panels[0].placement.origin[1] = std::numeric_limits<double>::infinity();
  CHECK(make_garment(pattern, 0.05).error() ==
        "panel \"front\": origin of the placement is not finite");
  pattern = tube();
  pattern.panels[0].outline = PanelOutline(FlatPoint(0, 0));
  CHECK(make_garment(pattern, 0.05).error() ==
        "seam 0 joins side 1 of the 0 sides of panel \"front\"");
}

TEST_CASE("a side without a place or a length is named with its panel", "[mesh]") {
  GarmentPattern pattern = tube();
  PanelOutline bad(FlatPoint(0, 0));
  bad.line_to({1, 0}).line_to({1, std::numeric_limits<double>::quiet_NaN()}).line_to({0, 1});
  pattern.panels[1].outline = bad;
  CHECK(make_garment(pattern, 0.05).error() ==
        "panel \"back\": side 1 has a point that is not finite: (1, nan)");
}

TEST_CASE("garments that cannot be sewn are refused", "[mesh]") {
  auto garment = make_garment(tube(), 0.1);
  REQUIRE(garment);
  Garment bad = *garment;
  bad.seams[1][0][1] = 1000;
  CHECK(weld_seams(bad).error().find("seam 1 holds vertex 1000 off the mesh") == 0);
  bad = *garment;
  bad.seams[0].push_back({bad.mesh.triangles[0][0], bad.mesh.triangles[0][1]});
  CHECK(weld_seams(bad).error().find("sewn garment: triangle 0 holds vertex") == 0);
  CHECK(weld_seams(Garment()).error() == "mesh is empty");
}
