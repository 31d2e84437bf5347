// Ways along the springs of a network.

#include "clothctl/mpc/detail/spring_distance.hpp"

#include <cmath>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("ways along a grid follow its threads and diagonals", "[mpc]") {
  const auto grid = make_grid<double>(4, 6, 0.5, 0.3).value();
  const auto network = sheet_network(grid, Material<double>{}).value();
  detail::SpringDistance<double> distance(network);
  PointFeatures<double> corner;
  corner.add_point(grid.vertex(0, 0));
  const std::vector<double> length = distance.from(corner, 0);
  const double dx = grid.positions(0, grid.vertex(0, 1)) - grid.positions(0, grid.vertex(0, 0));
  const double dz = grid.positions(2, grid.vertex(1, 0)) - grid.positions(2, grid.vertex(0, 0));
  for (int row = 0; row < grid.rows; ++row) {
    for (int col = 0; col < grid.cols; ++col) {
      const int both = std::min(row, col);
      const double way = both * std::hypot(dx, dz) + (col - both) * dx + (row - both) * dz;
      CHECK(length[static_cast<std::size_t>(grid.vertex(row, col))] == Approx(way).margin(1e-12));
    }
  }
}

TEST_CASE("springs of bending hold nothing, and means have mean ways", "[mpc]") {
  SpringNetwork<double> network;
  network.rest_positions.setZero(3, 4);
  network.mass.setOnes(4);
  network.springs = {{0, 1, 0.2, 1.0, 0.0, SpringKind::Structural},
                     {1, 2, 0.3, 1.0, 0.0, SpringKind::Seam},
                     {0, 3, 0.1, 1.0, 0.0, SpringKind::Bend}};
  detail::SpringDistance<double> distance(network);
  PointFeatures<double> points;
  points.add_point(0);
  points.add_centroid({1, 2});
  points.add_sum({{1, 2.0}, {2, -1.0}});
  points.add_centroid({1, 3});
  CHECK(distance.from(points, 0)[2] == Approx(0.5));
  CHECK(is_unbounded(distance.from(points, 0)[3]));
  const auto between = [&](Index i, Index j) {
    return distance.to(distance.from(points, i), points, j);
  };
  CHECK(between(0, 1) == Approx(0.35));
  CHECK(between(1, 0) == Approx(0.35));
  CHECK(is_unbounded(between(0, 2)));  // not a mean: nothing is known
  CHECK(is_unbounded(between(2, 0)));
  CHECK(is_unbounded(between(0, 3)));  // vertex 3 is loose
  CHECK(is_unbounded(between(3, 0)));
}
