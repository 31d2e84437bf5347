#include "clothctl/mesh/grid.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("a 65×65 grid has the paper's resolution", "[mesh]", float, double) {
  using S = TestType;
  const auto made = make_grid<S>(65, 65, S(1), S(1));
  REQUIRE(made);
  const GridMesh<S>& mesh = made.value();
  CHECK(mesh.positions.cols() == 4225);
  CHECK(mesh.triangles.size() == 8192);
  CHECK(mesh.vertex(64, 64) == 4224);
}

TEMPLATE_TEST_CASE("row 0 is the bottom, column 0 the left, and the top edge is at z = 0", "[mesh]",
                   float, double) {
  using S = TestType;
  const auto made = make_grid<S>(4, 6, S(0.5), S(0.3));
  REQUIRE(made);
  const GridMesh<S>& mesh = made.value();
  const S near = S(4) * scalar_traits<S>::epsilon();
  CHECK((mesh.positions.col(mesh.vertex(0, 0)) - Vector3<S>(S(-0.25), S(0), S(-0.3))).norm() <=
        near);
  CHECK((mesh.positions.col(mesh.vertex(0, 5)) - Vector3<S>(S(0.25), S(0), S(-0.3))).norm() <=
        near);
  CHECK((mesh.positions.col(mesh.vertex(3, 0)) - Vector3<S>(S(-0.25), S(0), S(0))).norm() <= near);
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 6; ++col) {
      CHECK(mesh.positions(0, mesh.vertex(row, col)) ==
            -mesh.positions(0, mesh.vertex(row, 5 - col)));
      if (row > 0) {
        const S step =
            mesh.positions(2, mesh.vertex(row, col)) - mesh.positions(2, mesh.vertex(row - 1, col));
        CHECK(step == Approx(static_cast<double>(mesh.row_spacing())).epsilon(1e-5));
      }
    }
  }
  CHECK(static_cast<double>(mesh.row_spacing()) == Approx(0.1));
  CHECK(static_cast<double>(mesh.column_spacing()) == Approx(0.1));
}

TEMPLATE_TEST_CASE("the triangles tile the sheet and face -y", "[mesh]", float, double) {
  using S = TestType;
  const auto made = make_grid<S>(5, 9, S(0.8), S(0.6));
  REQUIRE(made);
  double area = 0;
  for (const auto& t : made->triangles) {
    const Vector3<double> a = made->positions.col(t[0]).template cast<double>();
    const Vector3<double> u = made->positions.col(t[1]).template cast<double>() - a;
    const Vector3<double> w = made->positions.col(t[2]).template cast<double>() - a;
    const double normal_y = u[2] * w[0] - u[0] * w[2];
    CHECK(normal_y < 0);
    area -= 0.5 * normal_y;
  }
  CHECK(area == Approx(0.48).epsilon(1e-5));
}

TEST_CASE("a grid with an even number of cells in a row is divided mirror-symmetrically",
          "[mesh]") {
  const auto made = make_grid<double>(4, 5, 1.0, 1.0);
  REQUIRE(made);
  // Compares the triangle area at each vertex with that at its mirror image.
  std::vector<int> touching(20, 0);
  for (const auto& t : made->triangles) {
    for (int v : t) ++touching[static_cast<std::size_t>(v)];
  }
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 5; ++col) {
      CHECK(touching[static_cast<std::size_t>(made->vertex(row, col))] ==
            touching[static_cast<std::size_t>(made->vertex(row, 4 - col))]);
    }
  }
}

TEMPLATE_TEST_CASE("a grid refuses bad sizes with a message", "[mesh]", float, double) {
  using S = TestType;
  CHECK(make_grid<S>(1, 5, S(1), S(1)).error() == "grid needs at least 2 rows, got 1");
  CHECK(make_grid<S>(5, -3, S(1), S(1)).error() == "grid needs at least 2 columns, got -3");
  CHECK(make_grid<S>(5, 5, S(0), S(1)).error() == "grid width must be positive, got 0");
  CHECK(make_grid<S>(5, 5, S(1), S(-2)).error() == "grid height must be positive, got -2");
  CHECK_FALSE(make_grid<S>(5, 5, std::numeric_limits<S>::quiet_NaN(), S(1)));
  CHECK_FALSE(make_grid<S>(5, 5, S(1), std::numeric_limits<S>::infinity()));
  CHECK_FALSE(make_grid<S>(2000000000, 2000000000, S(1), S(1)));
}
