#include "clothctl/mesh/panel_outline.hpp"

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("a rectangle has its four sides and its area", "[mesh]") {
  const PanelOutline outline = rectangle_outline(0.5, 0.3);
  const auto sides = outline.all_sides();
  REQUIRE(sides.size() == 4);
  CHECK(sides[0].length() == Approx(0.5));
  CHECK(sides[1].length() == Approx(0.3));
  CHECK(outline.area() == Approx(0.15));
}

TEST_CASE("an open outline is closed by a straight side", "[mesh]") {
  PanelOutline outline(FlatPoint(0, 0));
  outline.line_to({1, 0}).line_to({0, 1});
  REQUIRE(outline.closed_sides().size() == 3);
  CHECK(outline.closed_sides()[2].points.back() == FlatPoint(0, 0));
  CHECK(outline.area() == Approx(0.5));
  outline.line_to({0, 0});
  CHECK(outline.closed_sides().size() == 3);
}

TEST_CASE("a curve has the length and area of its Bézier curve", "[mesh]") {
  // Control points above the ends give the arch y = 3 t (1 - t), |dx/dt| = 6 t (1 - t). Area under
  // it: ∫ 18 t² (1 - t)² dt = 18/30.
  PanelOutline outline(FlatPoint(1, 0));
  outline.curve_to({1, 1}, {0, 1}, {0, 0});
  CHECK(outline.area() == Approx(0.6).epsilon(4e-5));
  const OutlineSide side = outline.closed_sides()[0];
  CHECK(side.smooth);
  // Length of the same curve by Simpson's rule on its derivative.
  double length = 0;
  const int n = 2000;
  for (int i = 0; i <= n; ++i) {
    const double t = static_cast<double>(i) / n, dx = 6 * t - 6 * t * t, dy = 3 - 6 * t;
    length +=
        (i == 0 || i == n ? 1 : (i % 2 == 1 ? 4 : 2)) * std::sqrt(dx * dx + dy * dy) / (3 * n);
  }
  CHECK(side.length() == Approx(length).epsilon(1e-5));
}

TEST_CASE("holes take their area away whatever their direction; sides are numbered through",
          "[mesh]") {
  PanelOutline outline = rectangle_outline(1, 1), hole(FlatPoint(0.2, 0.2));
  hole.path_to({{0.2, 0.4}, {0.4, 0.4}, {0.4, 0.2}, {0.2, 0.2}});  // clockwise
  outline.add_hole(hole);
  CHECK(outline.area() == Approx(0.96));
  REQUIRE(outline.all_sides().size() == 5);
  CHECK(outline.all_sides()[4].points.size() == 5);
  CHECK_FALSE(outline.all_sides()[4].smooth);
  outline.smooth_to({{1, 2}, {2, 2}});
  CHECK(outline.closed_sides()[4].smooth);
}

TEST_CASE("a clockwise outline has a negative area", "[mesh]") {
  PanelOutline outline(FlatPoint(3, 3));
  outline.line_to({3, 4}).line_to({4, 4});
  CHECK(outline.area() == Approx(-0.5));
  CHECK(PanelOutline(FlatPoint(1, 1)).area() == 0);
}
