#include "clothctl/mesh/garment_patterns.hpp"

#include <limits>

#include "mesh/flat_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::euler;
using clothctl_test::measure;

namespace {

double side_length(const GarmentPattern& pattern, int panel, int side) {
  return pattern.panels[static_cast<std::size_t>(panel)]
      .outline.all_sides()[static_cast<std::size_t>(side)]
      .length();
}

}  // namespace

TEST_CASE("rectangles have their sizes and hang from z = 0", "[mesh]") {
  struct Case {
    GarmentPattern pattern;
    double width, height;
  };
  for (const Case& c : {Case{handkerchief_pattern(), 0.4, 0.4}, Case{towel_pattern(), 0.5, 1.0},
                        Case{scarf_pattern(), 0.3, 1.8}}) {
    const auto garment = make_garment(c.pattern, 0.02);
    REQUIRE(garment);
    CHECK(garment->panels.size() == 1);
    CHECK(garment->seams.empty());
    const Vector3<double> low = garment->mesh.positions.rowwise().minCoeff(),
                          high = garment->mesh.positions.rowwise().maxCoeff();
    CHECK((low - Vector3<double>(-c.width / 2, 0, -c.height)).norm() < 1e-12);
    CHECK((high - Vector3<double>(c.width / 2, 0, 0)).norm() < 1e-12);
    CHECK(measure(garment->mesh.pattern, garment->mesh.triangles).area ==
          Approx(c.width * c.height).epsilon(1e-9));
    CHECK(weld_seams(*garment)->mesh.positions == garment->mesh.positions);
  }
}

TEST_CASE("the default T-shirt has about 13 000 good triangles' vertices and fits", "[mesh]") {
  const auto pattern = tshirt_pattern();
  REQUIRE(pattern);
  const auto garment = make_garment(*pattern, kTshirtEdgeLength);
  REQUIRE(garment);
  CHECK(garment->mesh.positions.cols() > 12500);
  CHECK(garment->mesh.positions.cols() < 13500);
  const auto m = measure(garment->mesh.pattern, garment->mesh.triangles);
  CHECK(m.least_angle > 25);
  CHECK(m.regular > 0.9);
  CHECK(m.mean == Approx(kTshirtEdgeLength).epsilon(0.05));
  CHECK(m.longest < 1.8 * kTshirtEdgeLength);
  double area = 0;
  for (const PatternPanel& panel : pattern->panels) area += panel.outline.area();
  CHECK(m.area == Approx(area).epsilon(1e-4));
  CHECK(area > 0.7);
  CHECK(area < 1.1);
}

TEST_CASE("the seams of a T-shirt fit, with a little ease in the sleeves", "[mesh]") {
  const auto pattern = tshirt_pattern();
  REQUIRE(pattern);
  REQUIRE(pattern->seams.size() == 10);
  const auto garment = make_garment(*pattern, 0.02);
  REQUIRE(garment);
  for (std::size_t s = 0; s < pattern->seams.size(); ++s) {
    const PatternSeam& seam = pattern->seams[s];
    const double a = side_length(*pattern, seam.panel_a, seam.side_a),
                 b = side_length(*pattern, seam.panel_b, seam.side_b);
    const bool cap = seam.panel_a >= 2 && seam.side_a != 1;
    // A cap is eased by 1 to 5 %; all other seams have equal sides.
    CHECK(a / b > (cap ? 1.01 : 1 - 1e-9));
    CHECK(a / b < (cap ? 1.05 : 1 + 1e-9));
    CHECK(garment->seams[s].size() == garment->panels[static_cast<std::size_t>(seam.panel_b)]
                                          .sides[static_cast<std::size_t>(seam.side_b)]
                                          .size());
    // Before it is sewn no pair is further apart than the shoulders of the two body panels.
    for (const auto& pair : garment->seams[s])
      CHECK((garment->mesh.positions.col(pair[0]) - garment->mesh.positions.col(pair[1])).norm() <
            0.37);
  }
}

TEST_CASE("a sewn T-shirt is a manifold with neck, two cuffs and hem", "[mesh]") {
  for (const double h : {0.04, 0.02, kTshirtEdgeLength}) {
    const auto garment = make_garment(*tshirt_pattern(), h);
    REQUIRE(garment);
    const auto sewn = weld_seams(*garment);
    REQUIRE(sewn);
    const auto loops = boundary_loops(sewn->mesh.positions.cols(), sewn->mesh.triangles);
    REQUIRE(loops);
    CHECK(loops->size() == 4);
    CHECK(euler(sewn->mesh.positions.cols(), sewn->mesh.triangles) == -2);
    // Lengths in the pattern: hem 1.04 m, neck about 0.5 m, cuffs 0.35 m each.
    std::vector<double> length;
    for (const std::vector<int>& loop : *loops)
      length.push_back(h * static_cast<double>(loop.size()));
    std::sort(length.begin(), length.end());
    CHECK(length[0] == Approx(0.35).margin(h));
    CHECK(length[1] == Approx(0.35).margin(h));
    CHECK(length[2] == Approx(0.51).margin(h + 0.02));
    CHECK(length[3] == Approx(1.04).margin(2 * h));
  }
}

TEST_CASE("panels face outwards: front to -y, back to +y, sleeves up", "[mesh]") {
  const auto garment = make_garment(*tshirt_pattern(), 0.03);
  REQUIRE(garment);
  const auto normal = [&](int panel) {
    Vector3<double> sum = Vector3<double>::Zero();
    const GarmentPanel& p = garment->panels[static_cast<std::size_t>(panel)];
    for (int t = p.first_triangle; t < p.first_triangle + p.triangle_count; ++t) {
      const auto& c = garment->mesh.triangles[static_cast<std::size_t>(t)];
      const Vector3<double> u = garment->mesh.positions.col(c[1]) -
                                garment->mesh.positions.col(c[0]),
                            w = garment->mesh.positions.col(c[2]) -
                                garment->mesh.positions.col(c[0]);
      sum += Vector3<double>(u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2],
                             u[0] * w[1] - u[1] * w[0]);
    }
    return sum;
  };
  CHECK(normal(0)[1] < 0);
  CHECK(normal(1)[1] > 0);
  CHECK(normal(2)[2] > 0);
  CHECK(normal(3)[2] > 0);
}

TEST_CASE("a tank top has neck, two armholes and hem; other sizes work", "[mesh]") {
  const auto garment = make_garment(*tank_top_pattern(), 0.015);
  REQUIRE(garment);
  const auto sewn = weld_seams(*garment);
  REQUIRE(sewn);
  CHECK(boundary_loops(sewn->mesh.positions.cols(), sewn->mesh.triangles)->size() == 4);
  CHECK(measure(garment->mesh.pattern, garment->mesh.triangles).least_angle > 24);
  ShirtSizes child;
  for (double* v : {&child.chest, &child.hem, &child.length, &child.shoulders, &child.slope,
                    &child.neck, &child.front_neck, &child.back_neck, &child.armhole, &child.sleeve,
                    &child.cuff, &child.sleeve_length, &child.cap, &child.body_radius})
    *v *= 0.6;
  const auto pattern = tshirt_pattern(child);
  REQUIRE(pattern);
  CHECK(weld_seams(*make_garment(*pattern, 0.02)));
}

TEST_CASE("sizes that do not fit are refused", "[mesh]") {
  ShirtSizes s;
  s.cap = -1;
  CHECK(tshirt_pattern(s).error() == "shirt size cap must be positive, got -1");
  s = {};
  s.hem = std::numeric_limits<double>::quiet_NaN();
  CHECK(tank_top_pattern(s).error() == "shirt size hem must be positive, got nan");
  s = {};
  s.neck = 0.5;
  CHECK(tshirt_pattern(s).error() == "shirt size neck must be below shoulders, got 0.5 and 0.45");
  s = {};
  s.shoulders = 0.6;
  CHECK(tshirt_pattern(s).error() == "shirt size shoulders must be below chest, got 0.6 and 0.52");
  s = {};
  s.length = 0.2;
  CHECK(tshirt_pattern(s).error().find("shirt size length must exceed") == 0);
  s = {};
  s.sleeve = 0.3;  // too narrow for the armhole
  CHECK(make_garment(*tshirt_pattern(s), 0.02).error().find("differ by more than its ease") !=
        std::string::npos);
}
