#include "clothctl/mesh/detail/panel_mesher.hpp"

#include "mesh/flat_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::measure;

namespace {

detail::RegionBoundary polygon(const std::vector<FlatPoint>& corners) {
  detail::RegionBoundary boundary;
  boundary.points = corners;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    boundary.next.push_back(static_cast<int>((i + 1) % corners.size()));
    boundary.side.push_back(static_cast<int>(i));
  }
  return boundary;
}

/// A square of n edges a side.
detail::RegionBoundary square(int n) {
  std::vector<FlatPoint> points;
  for (int side = 0; side < 4; ++side) {
    for (int i = 0; i < n; ++i) {
      const double t = static_cast<double>(i) / n;
      points.push_back(side == 0   ? FlatPoint(t, 0)
                       : side == 1 ? FlatPoint(1, t)
                       : side == 2 ? FlatPoint(1 - t, 1)
                                   : FlatPoint(0, 1 - t));
    }
  }
  return polygon(points);
}

}  // namespace

TEST_CASE("cells find the boundary edges near a point", "[mesh]") {
  const detail::RegionBoundary boundary = square(10);
  const detail::BoundaryCells cells(boundary, FlatPoint(0, 0), FlatPoint(1, 1), 0.1);
  for (int i = 0; i <= 40; ++i) {
    for (int k = 0; k <= 40; ++k) {
      const FlatPoint p(i / 40.0, k / 40.0);
      const double distance = std::min({p[0], p[1], 1 - p[0], 1 - p[1]});
      for (const double reach : {0.03, 0.06, 0.09})
        CHECK(cells.near_boundary(p, reach) == (distance < reach));
    }
  }
}

TEST_CASE("a region keeps its boundary to the last bit and has good angles", "[mesh]") {
  const detail::RegionBoundary boundary = square(20);
  const auto region = detail::fill_region(boundary, 0.05);
  REQUIRE(region);
  for (std::size_t v = 0; v < boundary.points.size(); ++v)
    CHECK(region->positions.col(static_cast<Index>(v)) == boundary.points[v]);
  const auto m = measure(region->positions, region->triangles);
  CHECK(m.area == Approx(1.0).epsilon(1e-12));
  CHECK(m.least_area > 0);
  CHECK(m.least_angle > 25);
  CHECK(clothctl_test::euler(region->positions.cols(), region->triangles) == 1);
}

TEST_CASE("a fine boundary grades into a coarse inside, and a coarse one into a fine inside",
          "[mesh]") {
  const auto coarse = detail::fill_region(square(64), 0.1);
  REQUIRE(coarse);
  const auto m = measure(coarse->positions, coarse->triangles);
  CHECK(m.least_angle > 24);
  CHECK(m.longest > 0.08);
  CHECK(m.shortest < 0.017);
  const auto fine = detail::fill_region(square(4), 0.05);
  REQUIRE(fine);
  CHECK(measure(fine->positions, fine->triangles).area == Approx(1.0).epsilon(1e-12));
  CHECK(fine->positions.cols() > 300);
}

TEST_CASE("sides that meet, cross or touch are named", "[mesh]") {
  CHECK(detail::fill_region(polygon({{0, 0}, {1, 0}, {1, 1}, {0, 0}, {0, 1}}), 0.5).error() ==
        "side 3 near (0, 0) m meets another side");
  CHECK(detail::fill_region(polygon({{0, 0}, {1, 0}, {1, 1}, {0.2, -1}}), 0.5)
            .error()
            .find("crosses another side") != std::string::npos);
  CHECK(detail::fill_region(polygon({{0, 0}, {1, 0}, {1, 1}, {0.5, 0}, {0, 1}}), 0.5)
            .error()
            .find("touches another side") != std::string::npos);
}

TEST_CASE("a corner that is wide enough has more than one triangle", "[mesh]") {
  const auto region = detail::fill_region(square(8), 0.125);
  REQUIRE(region);
  for (const int corner : {0, 8, 16, 24}) {
    int count = 0;
    for (const auto& t : region->triangles)
      count += std::count(t.begin(), t.end(), corner) > 0 ? 1 : 0;
    CHECK(count >= 2);
  }
}
