#include "clothctl/network/detail/thread_profile.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

const double kPi = std::acos(-1.0);

Material<double> woven(double stretch_warp, double stretch_weft, double bending_warp = 2e-5,
                       double bending_weft = 2e-5) {
  Material<double> material;
  material.stretch_warp = stretch_warp;
  material.stretch_weft = stretch_weft;
  material.bending_warp = bending_warp;
  material.bending_weft = bending_weft;
  return material;
}

/// The stiffness of a membrane whose edges have the directions angle + k π/n: each contributes its
/// modulus times e eᵀ, where e ε is the strain along the edge and ε = (ε_warp, ε_weft, γ). On
/// triangles each of the three edges contributes its whole area.
Eigen::Matrix3d membrane(const detail::ThreadProfile<double>& modulus, int n, double angle) {
  Eigen::Matrix3d stiffness = Eigen::Matrix3d::Zero();
  for (int k = 0; k < n; ++k) {
    const double a = angle + kPi * k / n, c = std::cos(a), s = std::sin(a);
    const Eigen::Vector3d e(c * c, s * s, c * s);
    stiffness += 3.0 / n * modulus.at(2 * c * c - 1) * e * e.transpose();
  }
  return stiffness;
}

/// Young's moduli along warp and weft, N/m.
Eigen::Vector2d moduli(const Eigen::Matrix3d& stiffness) {
  const Eigen::Matrix3d compliance = stiffness.inverse();
  return {1.0 / compliance(0, 0), 1.0 / compliance(1, 1)};
}

/// Energy per ½ κ² of a cylinder that curves along the direction `turn` from the warp, on hinges
/// that curve along angle + k π/n: 1/9 (3 κ_nn - κ_ee)² for each of three on equilateral triangles.
double cylinder(const detail::ThreadProfile<double>& bending, int n, double angle, double turn) {
  double sum = 0;
  for (int k = 0; k < n; ++k) {
    const double a = angle + kPi * k / n, away = std::cos(a - turn);
    const double root = 4 * away * away - 1;  // 3 cos² - sin²
    sum += 3.0 / n * bending.at(2 * std::cos(a) * std::cos(a) - 1) * root * root / 9;
  }
  return sum;
}

}  // namespace

TEST_CASE("edges in all directions give the Young's moduli of warp and weft", "[network]") {
  for (const double ratio : {0.2, 0.5, 1.0, 1.5, 3.0, 5.0}) {
    const auto profile = detail::stretch_profile(woven(1000 * ratio, 1000));
    for (const double angle : {0.0, 0.1, 0.3}) {
      const Eigen::Vector2d found = moduli(membrane(profile, 12, angle));
      CHECK(found[0] == Approx(1000 * ratio).epsilon(1e-12));
      CHECK(found[1] == Approx(1000).epsilon(1e-12));
    }
  }
}

TEST_CASE("on equilateral triangles the moduli depend little on how the triangles lie",
          "[network]") {
  const auto worst = [](double ratio) {
    const auto profile = detail::stretch_profile(woven(1000 * ratio, 1000));
    double error = 0;
    for (int i = 0; i < 60; ++i) {
      const Eigen::Vector2d found = moduli(membrane(profile, 3, kPi / 3 * i / 60));
      error = std::max(error, std::abs(found[0] / (1000 * ratio) - 1));
      error = std::max(error, std::abs(found[1] / 1000 - 1));
    }
    return error;
  };
  // The error is of second order in the contrast. docs/cloth_materials.md states these figures.
  CHECK(worst(1.0) < 1e-12);
  CHECK(worst(1.2) < 0.005);
  CHECK(worst(1.5) < 0.025);
  CHECK(worst(2.0) < 0.075);
  CHECK(worst(3.0) < 0.24);
}

TEST_CASE(
    "cylinders along warp and weft have their energy on equilateral triangles, however they lie",
    "[network]") {
  for (const double ratio : {0.2, 0.5, 1.0, 2.0, 5.0}) {
    const auto profile = detail::bending_profile(woven(1000, 1000, 1e-5 * ratio, 1e-5));
    for (const int n : {3, 12}) {
      for (const double angle : {0.0, 0.2, 0.5, 0.9}) {
        CHECK(cylinder(profile, n, angle, 0) == Approx(1e-5 * ratio).epsilon(1e-12));
        CHECK(cylinder(profile, n, angle, kPi / 2) == Approx(1e-5).epsilon(1e-12));
      }
    }
    CHECK(cylinder(profile, 12, 0.1, kPi / 4) == Approx(0.5e-5 * (1 + ratio)).epsilon(1e-12));
  }
}

TEST_CASE("equal values are kept bit by bit, and no direction has a negative stiffness",
          "[network]") {
  for (const double value : {1000.0, 0.1, 1.0 / 3.0}) {
    const auto edges = detail::stretch_profile(woven(value, value, value, value));
    const auto folds = detail::bending_profile(woven(value, value, value, value));
    CHECK(edges.uniform());
    CHECK(edges.mean == value);
    CHECK(folds.uniform());
    CHECK(folds.mean == value);
  }
  CHECK(detail::bending_profile(woven(1, 1, 0, 0)).uniform());
  CHECK_FALSE(detail::bending_profile(woven(1, 1, 1, 2)).uniform());
  const Material<double> most = woven(5, 1, 1, 5);
  CHECK(detail::validate_contrast(most).empty());
  for (int i = 0; i <= 1000; ++i) {
    const double u = -1 + 0.002 * i;
    CHECK(detail::stretch_profile(most).at(u) > 0);
    CHECK(detail::bending_profile(most).at(u) > 0);
  }
  CHECK(
      detail::validate_contrast(woven(6, 1)) ==
      "material \"handkerchief\": stretch_warp 6 and stretch_weft 1 differ by more than the factor "
      "5 that a triangle mesh takes");
  CHECK(detail::validate_contrast(woven(1, 6)).find("stretch_weft 6") != std::string::npos);
  CHECK(detail::validate_contrast(woven(1, 1, 0, 1)).find("bending_warp 0") != std::string::npos);
  CHECK(detail::validate_contrast(woven(1, 1, 1, 0)).find("bending_weft 0") != std::string::npos);
}

TEST_CASE("the warp of a triangle is the direction projected onto its plane", "[network]") {
  Points<double> x(3, 3);
  x.col(0) = Eigen::Vector3d(0, 0, 0);
  x.col(1) = Eigen::Vector3d(1, 0, 0);
  x.col(2) = Eigen::Vector3d(0, 0.6, 0.8);
  const std::vector<std::array<int, 3>> triangles{{0, 1, 2}};
  const auto cosines = [&](const Eigen::Vector3d& warp) {
    return detail::edge_cosines<double>(x, triangles, woven(2, 1), warp);
  };
  for (const double length : {1.0, 1e-200, 1e200}) {  // projected: along the edge 0-2
    const auto found = cosines({0.0, 0.0, 2 * length});
    REQUIRE(found);
    CHECK(found.value()[0][0] == Approx(0).margin(1e-15));  // the hypotenuse 1-2
    CHECK(found.value()[0][1] == Approx(1).epsilon(1e-15));
    CHECK(found.value()[0][2] == Approx(-1).epsilon(1e-15));
  }
  CHECK(cosines({3, 0, 0}).value()[0][2] == 1);
  CHECK(cosines({0, 0.8, -0.6}).error() ==
        "triangle 0 is perpendicular to the warp direction 0 0.8 -0.6");
  CHECK(cosines({0, 0, 0}).error() == "warp direction must be finite and not zero, got 0 0 0");
  CHECK(cosines({0, std::numeric_limits<double>::quiet_NaN(), 1}).error() ==
        "warp direction must be finite and not zero, got 0 nan 1");
  CHECK_FALSE(cosines({0, std::numeric_limits<double>::infinity(), 1}));
  const auto plain = detail::edge_cosines<double>(x, triangles, woven(1, 1), {0, 0.8, -0.6});
  REQUIRE(plain);
  CHECK(plain->empty());
  CHECK(detail::cosine_of_double_angle<double>(Eigen::Vector3d(0, 0, 3), {0, 0, 1}) == 1);
  CHECK(detail::cosine_of_double_angle<double>(Eigen::Vector3d(5, 0, 0), {0, 0, 1}) == -1);
}

TEST_CASE("the stiffness at an edge is the mean over its triangles by their areas", "[network]") {
  const std::vector<std::array<int, 3>> triangles{{0, 1, 2}, {1, 0, 3}};
  const std::vector<double> area{1.0, 3.0};
  const detail::EdgeCosines<double> cosines{{0.1, 0.2, 1.0}, {0.3, 0.4, -1.0}};
  const detail::ThreadProfile<double> profile{10.0, 0.5};  // 15 along the warp, 5 along the weft
  const MeshEdge edge{0, 1, {0, 1}, {2, 3}}, border{0, 1, {0, -1}, {2, -1}};
  CHECK(detail::edge_stiffness(profile, edge, triangles, area, cosines, 1.0) ==
        Approx((15.0 + 3 * 5.0) / 4));
  CHECK(detail::edge_stiffness(profile, edge, triangles, area, cosines, -1.0) ==
        Approx((5.0 + 3 * 15.0) / 4));
  CHECK(detail::edge_stiffness(profile, border, triangles, area, cosines, 1.0) == Approx(15.0));
  CHECK(detail::edge_stiffness<double>({7.0, 0.0}, edge, triangles, area, {}, 1.0) == 7.0);
}
