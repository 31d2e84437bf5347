#include "clothctl/network/rest_folds.hpp"

#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/Geometry>

#include "clothctl/network/rope.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

constexpr double kPi = 3.14159265358979323846;

/// A sheet of 1 m × 0.4 m, bent about the direction of its rows to `turn` radians in all.
template <class Scalar>
std::pair<Points<Scalar>, std::vector<std::array<int, 3>>> arch(int cols, double turn) {
  const GridMesh<Scalar> grid = make_grid<Scalar>(5, cols, Scalar(1), Scalar(0.4)).value();
  Points<Scalar> x = grid.positions;
  const double step = turn / (cols - 1), chord = 1.0 / (cols - 1);
  for (int row = 0; row < grid.rows; ++row) {
    double along = 0, up = 0;
    for (int col = 0; col < cols; ++col) {
      const int v = grid.vertex(row, col);
      const double z =
          static_cast<double>(grid.positions(2, v)) + static_cast<double>(grid.positions(1, v));
      x.col(v) << Scalar(along), Scalar(up), Scalar(z);
      along += chord * std::cos(turn / 2 - step * (col + 0.5));
      up += chord * std::sin(turn / 2 - step * (col + 0.5));
    }
  }
  return {x, grid.triangles};
}

template <class Scalar>
SpringNetwork<Scalar> arch_network(int cols, double turn) {
  const auto [x, triangles] = arch<Scalar>(cols, turn);
  return sheet_network<Scalar>(x, triangles, Material<Scalar>()).value();
}

/// The angle of a hinge by its unit normals, with the sign of BendStencil.
double angle_of(const BendStencil<double>& b, const Points<double>& x) {
  const Eigen::Vector3d o = x.col(b.vertex[0]), edge = x.col(b.vertex[1]) - o,
                        left = x.col(b.vertex[2]) - o, right = x.col(b.vertex[3]) - o;
  const Eigen::Vector3d n = left.cross(edge).normalized(), m = edge.cross(right).normalized();
  // Seen as in the drawing both normals point at the eye; away from it, `right` turns about the
  // edge by the angle.
  return std::atan2(n.cross(m).dot(edge.normalized()), n.dot(m));
}

}  // namespace

TEMPLATE_TEST_CASE(
    "rest folds: those of an arch are its angles, and the mirror image has the "
    "opposite ones",
    "[rest_folds]", float, double) {
  using Scalar = TestType;
  const double tolerance = std::is_same_v<Scalar, float> ? 2e-5 : 1e-12;
  SpringNetwork<Scalar> network = arch_network<Scalar>(9, kPi), mirrored = network;
  REQUIRE(set_rest_folds<Scalar>(network, network.rest_positions).empty());
  mirrored.rest_positions.row(1) *= Scalar(-1);
  REQUIRE(set_rest_folds<Scalar>(mirrored, mirrored.rest_positions).empty());
  REQUIRE(network.validate().empty());
  int folded = 0;
  for (std::size_t e = 0; e < network.bends.size(); ++e) {
    const auto& b = network.bends[e];
    const double fold = static_cast<double>(b.rest_fold);
    CHECK(fold == Approx(std::tan(angle_of(network.template cast<double>().bends[e],
                                           network.rest_positions.template cast<double>()) /
                                  2))
                      .margin(tolerance));
    CHECK(fold == Approx(-static_cast<double>(mirrored.bends[e].rest_fold)).margin(tolerance));
    if (!b.is_folded()) continue;
    ++folded;
    CHECK(std::abs(fold) == Approx(std::tan(kPi / 16)).margin(tolerance));
  }
  CHECK(folded >= 7 * 4);  // the edges across the arch; the diagonals of its plane cells are flat
  CHECK(folded < static_cast<int>(network.bends.size()));
}

TEST_CASE("rest folds: the sign is that of the drawing", "[rest_folds]") {
  SpringNetwork<double> network;
  network.rest_positions.resize(3, 4);
  network.mass = Eigen::VectorXd::Ones(4);
  BendStencil<double> hinge;
  hinge.vertex = {0, 1, 2, 3};  // below, above, left, right; the eye is at +z
  hinge.weight = {1, 1, -1, -1};
  hinge.stiffness = 1;
  hinge.count = 4;
  network.bends = {hinge};
  for (const double angle : {-2.9, -1.0, 0.0, 0.3, 1.5707963, 3.0}) {
    const double down = -std::sin(angle / 2), out = std::cos(angle / 2);
    network.rest_positions << 0, 0, -out, out,  //
        0, 1, 0.5, 0.5,                         //
        0, 0, down, down;
    REQUIRE(set_rest_folds<double>(network, network.rest_positions).empty());
    CHECK(2 * std::atan(network.bends[0].rest_fold) == Approx(angle).margin(1e-14));
  }
}

TEMPLATE_TEST_CASE(
    "rest folds: the fold of a triangle without area is not a number, also when the "
    "compiler takes all numbers for finite",
    "[rest_folds]", float, double) {
  using Scalar = TestType;
  const std::array<int, 4> vertex{0, 1, 2, 3};
  Points<Scalar> x(3, 4);
  const auto set = [&](Index v, double a, double b, double c) {
    x.col(v) << Scalar(a), Scalar(b), Scalar(c);
  };
  const auto hinge = [&] {
    set(0, 0, 0, 0);
    set(1, 0, 1, 0);
    set(2, -1, 0.5, 0);
    set(3, 1, 0.5, 0);
  };
  hinge();
  CHECK(detail::measure_fold<Scalar>(vertex, x) == Scalar(0));
  set(3, 0, 0.5, -1);
  CHECK(detail::measure_fold<Scalar>(vertex, x) == Approx(1));  // a right angle
  for (const Index flat : {2, 3}) {
    hinge();
    set(flat, 0, 0.5, 0);  // on the edge
    CHECK_FALSE(is_finite(detail::measure_fold<Scalar>(vertex, x)));
    set(flat, 0, 0, 0);  // at an end of it
    CHECK_FALSE(is_finite(detail::measure_fold<Scalar>(vertex, x)));
  }
  hinge();
  set(1, 0, 0, 0);  // an edge without length
  CHECK_FALSE(is_finite(detail::measure_fold<Scalar>(vertex, x)));
  x.setZero();
  CHECK_FALSE(is_finite(detail::measure_fold<Scalar>(vertex, x)));
  for (const Index v : {0, 1, 2, 3}) {
    for (const Scalar bad :
         {std::numeric_limits<Scalar>::quiet_NaN(), std::numeric_limits<Scalar>::infinity()}) {
      hinge();
      x(2, v) = bad;
      CHECK_FALSE(is_finite(detail::measure_fold<Scalar>(vertex, x)));
    }
  }
}

TEST_CASE("rest folds: flat positions make every hinge exactly flat again", "[rest_folds]") {
  SpringNetwork<double> network = arch_network<double>(9, 2.0);
  const auto flat = network.bends;
  REQUIRE(set_rest_folds<double>(network, network.rest_positions).empty());
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(0.9, Eigen::Vector3d(1, -2, 3).normalized()).toRotationMatrix();
  const Points<double> plane = turn * arch<double>(9, 1e-20).first;
  REQUIRE(set_rest_folds<double>(network, plane).empty());
  for (std::size_t e = 0; e < flat.size(); ++e) {
    CHECK_FALSE(network.bends[e].is_folded());
    CHECK(network.bends[e].weight == flat[e].weight);
    CHECK(network.bends[e].stiffness == flat[e].stiffness);
  }
}

TEST_CASE("rest folds: bad input is refused by name and changes nothing", "[rest_folds]") {
  SpringNetwork<double> network = arch_network<double>(9, 2.0);
  REQUIRE(set_rest_folds<double>(network, network.rest_positions).empty());
  const auto before = network.bends;
  Points<double> x = network.rest_positions;
  CHECK(set_rest_folds<double>(network, x.leftCols(7)) ==
        "set_rest_folds: 7 positions for 45 vertices");
  CHECK(set_rest_folds<double>(network, Points<double>(3, 0)) ==
        "set_rest_folds: 0 positions for 45 vertices");
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e300}) {
    x = network.rest_positions;
    x(1, 11) = bad;
    CHECK_FALSE(set_rest_folds<double>(network, x).empty());
  }
  x = network.rest_positions;
  x(1, 11) = std::numeric_limits<double>::infinity();
  CHECK(set_rest_folds<double>(network, x) ==
        "set_rest_folds: position of vertex 11 is not finite");
  x.setZero();
  CHECK(set_rest_folds<double>(network, x).find("bending stencil 0 has a triangle without area") !=
        std::string::npos);
  // Folded onto each other: the columns 0 and 2 in one place.
  x = arch<double>(9, 1e-20).first;
  for (int row = 0; row < 5; ++row) x.col(9 * row) = x.col(9 * row + 2);
  CHECK_FALSE(set_rest_folds<double>(network, x).empty());
  for (std::size_t e = 0; e < before.size(); ++e)
    CHECK(network.bends[e].rest_fold == before[e].rest_fold);

  SpringNetwork<double> rope = rope_network(RopeSettings<double>()).value();
  CHECK(set_rest_folds<double>(rope, rope.rest_positions) ==
        "set_rest_folds: bending stencil 0 has 3 vertices, not those of a hinge");
  network.bends[3].vertex[1] = 99;
  CHECK(set_rest_folds<double>(network, network.rest_positions) ==
        "set_rest_folds: bending stencil 3 holds vertex 99 off the mesh");
}
