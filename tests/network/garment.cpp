#include "clothctl/network/garment.hpp"

#include <Eigen/Geometry>
#include <limits>

#include "clothctl/mesh/garment_patterns.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// Two rectangles joined along the long sides.
GarmentPattern tube() {
  GarmentPattern pattern;
  PanelPlacement front, back;
  front.origin = {-0.15, -0.1, 0};
  back.origin = {0.15, 0.1, 0};
  back.right = {-1, 0, 0};
  pattern.add_panel("front", rectangle_outline(0.3, 0.4), front);
  pattern.add_panel("back", rectangle_outline(0.3, 0.4), back);
  pattern.sew(0, 1, 1, 3);
  pattern.sew(0, 3, 1, 1);
  return pattern;
}

template <class S>
double bending_energy(const SpringNetwork<S>& network, const Points<S>& x) {
  double energy = 0;
  for (const BendStencil<S>& b : network.bends) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < 4; ++i)
      sum += static_cast<double>(b.weight[i]) * x.col(b.vertex[i]).template cast<double>();
    energy += 0.5 * static_cast<double>(b.stiffness) * sum.squaredNorm();
  }
  return energy;
}

}  // namespace

TEMPLATE_TEST_CASE("a flat panel has the network of the same mesh as a sheet", "[network]", float,
                   double) {
  using S = TestType;
  const auto garment = make_garment(handkerchief_pattern(), 0.03);
  REQUIRE(garment);
  const Material<S> material;
  const auto network = pattern_network(garment->mesh, material);
  REQUIRE(network);
  const Points<S> x = garment->mesh.positions.template cast<S>();
  const auto sheet = sheet_network<S>(x, garment->mesh.triangles, material);
  REQUIRE(sheet);
  REQUIRE(network->springs.size() == sheet->springs.size());
  REQUIRE(network->bends.size() == sheet->bends.size());
  const double loose = std::is_same_v<S, float> ? 2e-5 : 1e-12;
  for (std::size_t e = 0; e < sheet->springs.size(); ++e) {
    const Spring<S>&p = network->springs[e], &q = sheet->springs[e];
    CHECK((p.a == q.a && p.b == q.b && p.kind == q.kind));
    CHECK(p.rest_length == Approx(q.rest_length).epsilon(loose));
    CHECK(p.stiffness == Approx(q.stiffness).epsilon(loose));
  }
  for (std::size_t e = 0; e < sheet->bends.size(); ++e) {
    CHECK(network->bends[e].vertex == sheet->bends[e].vertex);
    CHECK(network->bends[e].stiffness == Approx(sheet->bends[e].stiffness).epsilon(loose));
    for (std::size_t i = 0; i < 4; ++i)
      CHECK(network->bends[e].weight[i] ==
            Approx(sheet->bends[e].weight[i]).margin(std::is_same_v<S, float> ? 1e-4 : 1e-11));
  }
  CHECK((network->mass - sheet->mass).norm() <= S(loose) * sheet->mass.norm());
}

TEST_CASE("springs, stencils and masses do not depend on the place in space", "[network]") {
  const auto garment = make_garment(tube(), 0.03);
  REQUIRE(garment);
  PatternMesh crumpled = garment->mesh;
  for (Index v = 0; v < crumpled.positions.cols(); ++v)
    crumpled.positions.col(v) *= 0.3 + 0.2 * std::sin(static_cast<double>(v));
  const auto a = pattern_network(garment->mesh, Material<double>{}),
             b = pattern_network(crumpled, Material<double>{});
  REQUIRE(a);
  REQUIRE(b);
  for (std::size_t e = 0; e < a->springs.size(); ++e) {
    CHECK(a->springs[e].rest_length == b->springs[e].rest_length);
    CHECK(a->springs[e].stiffness == b->springs[e].stiffness);
  }
  for (std::size_t e = 0; e < a->bends.size(); ++e) CHECK(a->bends[e].weight == b->bends[e].weight);
  CHECK(a->mass == b->mass);
  CHECK(b->rest_positions == crumpled.positions);
}

TEMPLATE_TEST_CASE("mass is density times the area of the pattern, open and sewn", "[network]",
                   float, double) {
  using S = TestType;
  const auto pattern = tshirt_pattern();
  REQUIRE(pattern);
  const auto garment = make_garment(*pattern, 0.03);
  REQUIRE(garment);
  double area = 0;
  for (std::size_t t = 0; t < garment->mesh.triangles.size(); ++t)
    area += garment->mesh.pattern_area(t);
  const Material<S> material;
  const auto open = sewing_network(*garment, material);
  const auto sewn = pattern_network(weld_seams(*garment)->mesh, material);
  REQUIRE(open);
  REQUIRE(sewn);
  for (const auto* network : {&*open, &*sewn})
    CHECK(static_cast<double>(network->mass.sum()) == Approx(0.2 * area).epsilon(1e-5));
  // ½ Σ k l0² is 3/2 stretch · area on every mesh, and the same sewn as open up to the ease.
  double total = 0;
  for (const Spring<S>& s : sewn->springs)
    total += static_cast<double>(s.stiffness * s.rest_length * s.rest_length);
  CHECK(total == Approx(3 * 1000 * area).epsilon(1e-4));
}

TEST_CASE("seam springs come last, one for each pair", "[network]") {
  const auto garment = make_garment(tube(), 0.06);
  REQUIRE(garment);
  SeamSettings<double> seams;
  seams.stiffness = 30;
  seams.thickness = 1e-3;
  seams.damping_time = 0.1;
  auto network = sewing_network(*garment, Material<double>{}, seams);
  REQUIRE(network);
  const std::size_t pairs = garment->seams[0].size() + garment->seams[1].size();
  std::size_t e = network->springs.size() - pairs;
  for (std::size_t i = 0; i < e; ++i) CHECK(network->springs[i].kind == SpringKind::Structural);
  for (const auto& seam : garment->seams) {
    for (const auto& pair : seam) {
      const Spring<double>& s = network->springs[e++];
      CHECK((s.a == pair[0] && s.b == pair[1] && s.kind == SpringKind::Seam));
      CHECK((s.stiffness == 30 && s.rest_length == 1e-3 && s.damping == Approx(3)));
    }
  }
  // The panels are 0.2 m apart along both seams.
  CHECK(largest_seam_gap<double>(*garment, network->rest_positions) == Approx(0.2));
  set_seam_lengths<double>(*network, network->rest_positions, 0.25, 1e-3);
  CHECK(network->springs.back().rest_length == Approx(0.05));
  CHECK(network->springs.front().rest_length != Approx(0.05).epsilon(1e-3));
  set_seam_lengths<double>(*network, network->rest_positions, 0, 1e-3);
  CHECK(network->springs.back().rest_length == 1e-3);
}

TEST_CASE("a sewn garment bends across its seams as across any other line", "[network]") {
  // Two strips side by side in one plane, sewn, against the strip in one piece: both folded alike.
  GarmentPattern pattern;
  PanelPlacement left, right;
  right.origin = {0.3, 0, 0};
  pattern.add_panel("left", rectangle_outline(0.3, 0.4), left);
  pattern.add_panel("right", rectangle_outline(0.3, 0.4), right);
  pattern.sew(0, 1, 1, 3);
  const auto sewn = weld_seams(*make_garment(pattern, 0.02));
  REQUIRE(sewn);
  const auto network = pattern_network(sewn->mesh, Material<double>{});
  REQUIRE(network);
  CHECK(bending_energy(*network, sewn->mesh.positions) < 1e-20);
  // Rolled on a cylinder of radius R the sheet has the energy ½ B A / R² (sheet.hpp: exact on
  // equilateral triangles, so nearly so here).
  const double R = 0.2;
  Points<double> rolled = sewn->mesh.positions;
  for (Index v = 0; v < rolled.cols(); ++v) {
    const double angle = rolled(0, v) / R;
    rolled(0, v) = R * std::sin(angle);
    rolled(1, v) = R * (1 - std::cos(angle));
  }
  CHECK(bending_energy(*network, rolled) == Approx(0.5 * 2e-5 * 0.24 / (R * R)).epsilon(0.1));
}

TEST_CASE("ease spreads over both sides of a seam", "[network]") {
  GarmentPattern pattern;
  PanelPlacement right;
  right.origin = {0.3, 0, 0};
  pattern.add_panel("left", rectangle_outline(0.3, 0.40));
  pattern.add_panel("right", rectangle_outline(0.3, 0.42), right);
  pattern.sew(0, 1, 1, 3);
  const auto garment = make_garment(pattern, 0.041);
  REQUIRE(garment);
  const auto sewn = weld_seams(*garment);
  REQUIRE(sewn);
  const auto network = pattern_network(sewn->mesh, Material<double>{});
  REQUIRE(network);
  double along = 0;
  for (std::size_t i = 1; i < garment->seams[0].size(); ++i) {
    const int a = sewn->vertex_of[static_cast<std::size_t>(garment->seams[0][i - 1][0])],
              b = sewn->vertex_of[static_cast<std::size_t>(garment->seams[0][i][0])];
    for (const Spring<double>& s : network->springs) {
      if ((s.a == a && s.b == b) || (s.a == b && s.b == a)) along += s.rest_length;
    }
  }
  CHECK(along == Approx(0.41));
}

TEST_CASE("meshes and settings without sense are refused", "[network]") {
  const auto garment = make_garment(tube(), 0.1);
  REQUIRE(garment);
  const Material<double> material;
  PatternMesh mesh = garment->mesh;
  mesh.pattern_triangles.clear();
  CHECK(pattern_network(mesh, material).error() == "mesh has no pattern");
  mesh = garment->mesh;
  for (auto* list : {&mesh.triangles, &mesh.pattern_triangles})
    std::swap((*list)[2][0], (*list)[2][1]);
  CHECK(pattern_network(mesh, material).error() == "triangle 2 is clockwise in the pattern");
  mesh = garment->mesh;
  mesh.pattern.col(mesh.pattern_triangles[1][0]) = mesh.pattern.col(mesh.pattern_triangles[1][1]);
  CHECK(pattern_network(mesh, material).error().find(" has no area in the pattern") !=
        std::string::npos);
  mesh = garment->mesh;
  mesh.positions(0, 7) = std::numeric_limits<double>::quiet_NaN();
  CHECK(pattern_network(mesh, material).error() == "vertex 7 is not finite");
  mesh = garment->mesh;
  mesh.positions.conservativeResize(3, mesh.positions.cols() + 1);
  mesh.positions.rightCols(1).setZero();
  CHECK(pattern_network(mesh, material).error().find("belongs to no triangle") !=
        std::string::npos);
  CHECK(pattern_network(PatternMesh(), material).error() == "mesh is empty");
  Material<double> heavy;
  heavy.area_density = -1;
  CHECK_FALSE(pattern_network(garment->mesh, heavy));
  SeamSettings<double> seams;
  seams.thickness = 0;
  CHECK(sewing_network(*garment, material, seams).error() ==
        "seam thickness must be positive, got 0");
  seams.thickness = 1e-3;
  seams.stiffness = -2;
  CHECK(sewing_network(*garment, material, seams).error() ==
        "seam stiffness must not be negative, got -2");
  seams.stiffness = 2;
  seams.damping_time = std::numeric_limits<double>::infinity();
  CHECK(sewing_network(*garment, material, seams).error() ==
        "seam damping_time must not be negative, got inf");
  Garment bad = *garment;
  bad.seams[0][1][0] = -4;
  CHECK(sewing_network(bad, material).error().find("joins vertex -4 off the mesh") !=
        std::string::npos);
}

TEST_CASE("the warp runs along the y axis of the pattern, wherever the panel lies", "[network]") {
  Material<double> material;
  material.stretch_weft = 400.0;
  material.bending_warp = 6e-5;
  const auto garment = make_garment(handkerchief_pattern(), 0.03);
  REQUIRE(garment);
  // The pattern's y axis is the z axis of space here, the default warp of a sheet.
  const auto sheet = sheet_network(garment->mesh.positions, garment->mesh.triangles, material);
  PatternMesh turned = garment->mesh;
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(1.0, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  turned.positions = turn * garment->mesh.positions;
  const auto network = pattern_network(turned, material);
  REQUIRE(sheet);
  REQUIRE(network);
  REQUIRE(network->springs.size() == sheet->springs.size());
  double least = 1e9, most = 0;  // of k l²/ΣA up to the border: the modulus depends on direction
  for (std::size_t e = 0; e < sheet->springs.size(); ++e) {
    CHECK(network->springs[e].stiffness == Approx(sheet->springs[e].stiffness).epsilon(1e-9));
    least = std::min(least, network->springs[e].stiffness);
    most = std::max(most, network->springs[e].stiffness);
  }
  CHECK(most > 2 * least);
  for (std::size_t e = 0; e < sheet->bends.size(); ++e)
    CHECK(network->bends[e].stiffness == Approx(sheet->bends[e].stiffness).epsilon(1e-9));
  material.stretch_weft = 1.0;
  CHECK(pattern_network(turned, material).error().find("stretch_weft 1 differ") !=
        std::string::npos);
}
