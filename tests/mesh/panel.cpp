#include "clothctl/mesh/panel.hpp"

#include <limits>
#include <random>

#include "mesh/flat_laws.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::euler;
using clothctl_test::measure;
using clothctl_test::shoelace;

namespace {

/// A panel with straight and curved sides, both bulging in and out, and a dart in its lower edge.
PanelOutline shaped() {
  PanelOutline outline(FlatPoint(0, 0));
  outline.line_to({0.18, 0}).line_to({0.2, 0.12}).line_to({0.22, 0}).line_to({0.4, 0.02});
  outline.curve_to({0.36, 0.1}, {0.36, 0.2}, {0.4, 0.3});
  outline.curve_to({0.3, 0.42}, {0.1, 0.42}, {0, 0.3});
  return outline;
}

PanelOutline disc(double radius, double x = 0) {
  const double k = 0.5522847498 * radius, r = radius;
  PanelOutline outline(FlatPoint(x + r, 0));
  outline.curve_to({x + r, k}, {x + k, r}, {x, r}).curve_to({x - k, r}, {x - r, k}, {x - r, 0});
  outline.curve_to({x - r, -k}, {x - k, -r}, {x, -r})
      .curve_to({x + k, -r}, {x + r, -k}, {x + r, 0});
  return outline;
}

}  // namespace

TEST_CASE("panels have positive triangles, one border, good angles and the outline's area",
          "[mesh]") {
  for (const PanelOutline& outline : {rectangle_outline(0.5, 0.4), shaped(), disc(0.3)}) {
    for (const double h : {0.04, 0.02, 0.01}) {
      const auto mesh = make_panel(outline, h);
      REQUIRE(mesh);
      CHECK(mesh->validate().empty());
      CHECK(euler(mesh->positions.cols(), mesh->triangles) == 1);
      const auto m = measure(mesh->positions, mesh->triangles);
      CHECK(m.least_area > 0);
      // The sampled polygon's area is met to rounding, the outline's to the order h².
      CHECK(m.area == Approx(shoelace(mesh->positions, mesh->sides)).epsilon(1e-12));
      CHECK(mesh->area() == Approx(m.area).epsilon(1e-12));
      CHECK(m.area == Approx(outline.area()).epsilon(4 * h * h));
      CHECK(m.least_angle > (h < 0.03 ? 24 : 14));
      CHECK(m.mean == Approx(h).epsilon(0.15));
      CHECK(m.longest < 2 * h);
      CHECK(m.shortest > 0.5 * h);
      // An equilateral triangle of edge h has the area 0.433 h².
      CHECK(static_cast<double>(mesh->triangles.size()) ==
            Approx(m.area / (0.433 * h * h)).epsilon(h < 0.03 ? 0.1 : 0.2));
    }
  }
  const auto sheet = make_panel(rectangle_outline(1.0, 1.0), 0.02);
  REQUIRE(sheet);
  CHECK(measure(sheet->positions, sheet->triangles).regular > 0.9);
}

TEST_CASE("the inside of a panel is Delaunay away from its border", "[mesh]") {
  const auto mesh = make_panel(shaped(), 0.02);
  REQUIRE(mesh);
  const auto topology = make_topology(mesh->positions.cols(), mesh->triangles);
  REQUIRE(topology);
  std::size_t off = 0;
  for (const Hinge& hinge : topology->hinges) {
    double sum = 0;  // of the angles opposite the edge, at most 180° if it is Delaunay
    for (const std::size_t k : {std::size_t(2), std::size_t(3)}) {
      const FlatPoint p = mesh->positions.col(hinge.vertex[k]),
                      u = mesh->positions.col(hinge.vertex[0]) - p,
                      w = mesh->positions.col(hinge.vertex[1]) - p;
      sum += std::acos(u.dot(w) / (u.norm() * w.norm()));
    }
    off += sum > 3.14159265358979 + 1e-6 ? 1 : 0;
  }
  CHECK(off <= 4);  // the corners that were opened
}

TEST_CASE("the sides have equal edges and the vertices that were asked for", "[mesh]") {
  const PanelOutline outline = shaped();
  const auto sides = outline.all_sides();
  std::vector<int> edges(sides.size(), 0);
  edges[4] = 37;
  const auto mesh = make_panel(outline, 0.01, edges);
  REQUIRE(mesh);
  REQUIRE(mesh->sides.size() == sides.size());
  CHECK(mesh->sides[4].size() == 38);
  int next = 0;
  for (std::size_t s = 0; s < sides.size(); ++s) {
    const std::vector<int>& side = mesh->sides[s];
    CHECK(side.front() == next);  // boundary vertices come first, side by side
    next = side.back();
    CHECK(mesh->positions.col(side.front()) == sides[s].points.front());
    CHECK(mesh->positions.col(side.back()) == sides[s].points.back());
    double length = 0, longest = 0, shortest = 1;
    for (std::size_t i = 1; i < side.size(); ++i) {
      const double edge = (mesh->positions.col(side[i]) - mesh->positions.col(side[i - 1])).norm();
      length += edge;
      longest = std::max(longest, edge);
      shortest = std::min(shortest, edge);
    }
    CHECK(longest / shortest < 1.002);
    CHECK(length == Approx(sides[s].length()).epsilon(1e-3));
    if (s != 4)
      CHECK(static_cast<double>(side.size() - 1) == Approx(sides[s].length() / 0.01).margin(0.51));
  }
}

TEST_CASE("a path of straight parts keeps its corners", "[mesh]") {
  PanelOutline outline(FlatPoint(0, 0));
  outline.path_to({{0.1, 0}, {0.1, 0.02}, {0.2, 0.02}}).line_to({0.2, 0.1}).line_to({0, 0.1});
  const auto mesh = make_panel(outline, 0.02, {9, 0, 0, 0});
  REQUIRE(mesh);
  REQUIRE(mesh->sides[0].size() == 10);
  CHECK(mesh->positions.col(mesh->sides[0][4]) == FlatPoint(0.1, 0));
  CHECK(mesh->positions.col(mesh->sides[0][5]) == FlatPoint(0.1, 0.02));
  CHECK(make_panel(outline, 0.02, {2, 0, 0, 0}).error() ==
        "side 0 has 3 straight parts and cannot have 2 edges");
}

TEST_CASE("holes stay holes", "[mesh]") {
  PanelOutline outline = disc(0.3);
  outline.add_hole(disc(0.05, 0.1)).add_hole(disc(0.06, -0.12));
  const auto mesh = make_panel(outline, 0.012);
  REQUIRE(mesh);
  CHECK(mesh->validate().empty());
  CHECK(euler(mesh->positions.cols(), mesh->triangles) == -1);  // 1 less one for each hole
  CHECK(boundary_loops(mesh->positions.cols(), mesh->triangles)->size() == 3);
  CHECK(mesh->sides.size() == 12);
  CHECK(mesh->area() == Approx(outline.area()).epsilon(1e-3));
  CHECK(measure(mesh->positions, mesh->triangles).least_angle > 24);
}

TEST_CASE("the same panel has the same bits", "[mesh]") {
  const auto a = make_panel(shaped(), 0.013), b = make_panel(shaped(), 0.013);
  REQUIRE(a);
  REQUIRE(b);
  CHECK(a->positions == b->positions);
  CHECK(a->triangles == b->triangles);
}

TEST_CASE("a panel far from the origin or of any size is meshed alike", "[mesh]") {
  const auto base = make_panel(rectangle_outline(0.5, 0.3), 0.02);
  REQUIRE(base);
  for (const double scale : {1e-6, 1e6}) {
    const auto other = make_panel(rectangle_outline(0.5 * scale, 0.3 * scale), 0.02 * scale);
    REQUIRE(other);
    CHECK(other->validate().empty());
    CHECK(other->area() == Approx(0.15 * scale * scale).epsilon(1e-9));
  }
  PanelOutline moved(FlatPoint(1000, 1000));
  moved.line_to({1000.5, 1000}).line_to({1000.5, 1000.3}).line_to({1000, 1000.3});
  const auto other = make_panel(moved, 0.02);
  REQUIRE(other);
  CHECK(other->area() == Approx(0.15).epsilon(1e-9));
  CHECK(measure(other->positions, other->triangles).least_angle > 24);
}

TEST_CASE("a remeshed panel keeps its border vertex by vertex", "[mesh]") {
  PanelOutline outline = shaped();
  outline.add_hole(rectangle_outline(0.05, 0.05));
  CHECK_FALSE(make_panel(outline, 0.02));  // the hole meets the corner of the outline
  PanelOutline hole(FlatPoint(0.1, 0.2));
  hole.line_to({0.16, 0.2}).line_to({0.16, 0.26});
  outline = shaped();
  outline.add_hole(hole);
  const auto mesh = make_panel(outline, 0.02);
  REQUIRE(mesh);
  for (const double h : {0.01, 0.02, 0.04}) {
    const auto again = remesh_panel(*mesh, h);
    REQUIRE(again);
    CHECK(again->validate().empty());
    CHECK(again->area() == Approx(mesh->area()).epsilon(1e-12));
    REQUIRE(again->sides.size() == mesh->sides.size());
    for (std::size_t s = 0; s < mesh->sides.size(); ++s) {
      REQUIRE(again->sides[s].size() == mesh->sides[s].size());
      for (std::size_t i = 0; i < mesh->sides[s].size(); ++i)
        CHECK(again->positions.col(again->sides[s][i]) == mesh->positions.col(mesh->sides[s][i]));
    }
    const auto m = measure(again->positions, again->triangles);
    CHECK(m.least_area > 0);
    CHECK(m.least_angle > 15);
    if (h < 0.015) CHECK(again->positions.cols() > 2 * mesh->positions.cols());
    if (h > 0.03) CHECK(again->positions.cols() < mesh->positions.cols());
  }
}

TEST_CASE("the outline of a mesh gives the mesh at another edge length", "[mesh]") {
  PanelOutline outline = rectangle_outline(0.5, 0.4), hole(FlatPoint(0.2, 0.2));
  hole.line_to({0.3, 0.2}).line_to({0.3, 0.3}).line_to({0.2, 0.3});
  outline.add_hole(hole);
  const auto mesh = make_panel(outline, 0.02);
  REQUIRE(mesh);
  const auto found = outline_of(*mesh);
  REQUIRE(found);
  CHECK(found->all_sides().size() == 8);
  CHECK(found->area() == Approx(0.19).epsilon(1e-9));
  const auto fine = make_panel(*found, 0.01);
  REQUIRE(fine);
  const auto m = measure(fine->positions, fine->triangles);
  CHECK(m.area == Approx(0.19).epsilon(1e-9));
  CHECK(m.mean == Approx(0.01).epsilon(0.1));
  CHECK(m.least_angle > 24);
  // A border without corners is one smooth side.
  const auto round = make_panel(disc(0.1), 0.01);
  REQUIRE(round);
  const auto ring = outline_of(*round);
  REQUIRE(ring);
  CHECK(ring->all_sides().size() == 1);
  CHECK(make_panel(*ring, 0.02)->area() == Approx(round->area()).epsilon(0.03));
}

TEST_CASE("bad panels are refused with what, where and the value", "[mesh]") {
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               inf = std::numeric_limits<double>::infinity();
  const PanelOutline good = rectangle_outline(1, 1);
  CHECK(make_panel(good, 0).error() == "edge length must be positive, got 0");
  CHECK(make_panel(good, nan).error() == "edge length must be positive, got nan");
  CHECK(make_panel(good, inf).error() == "edge length must be positive, got inf");
  CHECK(make_panel(good, 1e-9).error() == "side 0 of 1 m is too long for edges of 1e-09 m");
  CHECK(make_panel(good, 2e-4).error() == "panel of 1 m by 1 m is too large for edges of 2e-04 m");
  CHECK(make_panel(good, 0.1, {1, 2}).error() == "panel has 4 sides, got edge counts for 2");
  CHECK(make_panel(good, 0.1, {1, 2, -3, 0}).error() == "side 2 cannot have -3 edges");
  CHECK(make_panel(PanelOutline(FlatPoint(0, 0)), 0.1).error() ==
        "outline has 0 edges, needs at least 3");
  PanelOutline bad(FlatPoint(0, 0));
  bad.line_to({1, nan});
  CHECK(make_panel(bad, 0.1).error() == "side 0 has a point that is not finite: (1, nan)");
  bad = PanelOutline(FlatPoint(0, 0));
  bad.line_to({1, 0}).line_to({1, 0});
  CHECK(make_panel(bad, 0.1).error() == "side 1 has two corners in one place, (1, 0) m");
  bad = PanelOutline(FlatPoint(0, 0));
  bad.line_to({0, 1}).line_to({1, 1});
  CHECK(make_panel(bad, 0.1).error() ==
        "outline must be drawn counter-clockwise, its area is -0.5 m^2");
  bad = PanelOutline(FlatPoint(0, 0));
  bad.line_to({1, 0}).line_to({1, 1}).line_to({0.25, -0.33});
  CHECK(make_panel(bad, 0.1).error().find("crosses another side") != std::string::npos);
  bad = rectangle_outline(1, 1);
  bad.add_hole(disc(0.2, 3));
  CHECK(make_panel(bad, 0.1).error() == "panel: the outline encloses 2 pieces, must be one");
  bad = rectangle_outline(1, 1);
  bad.add_hole(rectangle_outline(0.5, 0.5));
  CHECK(make_panel(bad, 0.1).error().find("meets another side") != std::string::npos);
  CHECK_FALSE(make_panel(rectangle_outline(1e200, 1e200), 1e199));
  CHECK_FALSE(make_panel(rectangle_outline(1, 1e-12), 0.1));
  CHECK_FALSE(make_panel(rectangle_outline(1e-320, 1e-320), 1e-321));

  PanelMesh mesh;
  CHECK(remesh_panel(mesh, 0.1).error() == "panel is empty");
  mesh = *make_panel(good, 0.25);
  CHECK(remesh_panel(mesh, -1).error() == "edge length must be positive, got -1");
  mesh.sides[1][1] = static_cast<int>(mesh.positions.cols()) - 1;
  CHECK(remesh_panel(mesh, 0.1).error().find("which is not on the boundary") != std::string::npos);
  mesh.sides[1][1] = 4711;
  CHECK(remesh_panel(mesh, 0.1).error().find("side 1 holds vertex 4711 off the panel") == 0);
  std::swap(mesh.triangles[3][0], mesh.triangles[3][1]);
  CHECK_FALSE(outline_of(mesh));
  mesh.positions(1, 5) = nan;
  CHECK(outline_of(mesh).error() == "position of vertex 5 is not finite");
}

TEST_CASE("random outlines are meshed by the laws or refused", "[mesh]") {
  std::mt19937_64 engine(11);
  const auto draw = [&](int n) { return static_cast<double>(engine() % static_cast<unsigned>(n)); };
  int meshed = 0, refused = 0;
  for (int i = 0; i < clothctl_test::trials(400, 20000); ++i) {
    // Points of a small lattice meet, line up and cross; stars do not.
    const int corners = 3 + static_cast<int>(draw(10));
    std::vector<FlatPoint> points;
    for (int k = 0; k < corners; ++k) {
      const double angle = 6.28318530718 * k / corners, r = 0.05 + draw(100) / 100;
      points.push_back(i % 2 == 0 ? FlatPoint(draw(5) / 4, draw(5) / 4)
                                  : FlatPoint(r * std::cos(angle), r * std::sin(angle)));
    }
    PanelOutline outline(points[0]);
    for (std::size_t k = 1; k < points.size(); ++k) outline.line_to(points[k]);
    const double h = 0.03 + draw(100) / 300;
    const auto mesh = make_panel(outline, h);
    (mesh ? meshed : refused) += 1;
    if (!mesh) {
      CHECK_FALSE(mesh.error().empty());
      CHECK(i % 2 == 0);  // a star is always meshed
      continue;
    }
    REQUIRE(mesh->validate().empty());
    CHECK(mesh->area() == Approx(outline.area()).epsilon(1e-9));
    CHECK(euler(mesh->positions.cols(), mesh->triangles) == 1);
    const auto again = remesh_panel(*mesh, 0.6 * h);
    REQUIRE(again);
    CHECK(again->area() == Approx(outline.area()).epsilon(1e-9));
  }
  CHECK(meshed > 100);
  CHECK(refused > 100);
}
