// The search for the least distance on a segment and on a triangle: smooth minima, kinks, minima on
// the border, and how many points it takes.

#include "clothctl/collision/detail/deepest_point.hpp"

#include <cmath>
#include <functional>

#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;
using Deep = detail::DeepPoint<double>;
using Bound = detail::DistanceBound<double>;

namespace {

/// Searches the triangle (0, 0), (1, 0), (0, 1) of the plane z = 0 without bounds to begin with.
bool search(const std::function<double(const V&)>& d, const std::function<V(const V&)>& slope,
            Deep& best, int& asked, double highest = 10) {
  const V u(1, 0, 0), v(0, 1, 0);
  const auto evaluate = [&](double s, double t) {
    ++asked;
    const V x = s * u + t * v;
    return Deep{s, t, d(x), slope(x)};
  };
  std::array<Bound, 6> known{};
  for (Bound& any : known) any = {-1e30, 0, 0};
  const std::array<std::array<double, 2>, 3> region{
      std::array<double, 2>{0, 0}, std::array<double, 2>{1, 0}, std::array<double, 2>{0, 1}};
  return detail::search_triangle<double>(evaluate, u, v, region, known, highest, 1e-6, best);
}

}  // namespace

TEST_CASE("the least distance on a triangle is found to the tolerance", "[contact]") {
  Deep best{};
  int asked = 0;
  const V centre(0.31, 0.22, 0.05);
  const auto ball = [&](const V& x) { return (x - centre).norm() - 0.1; };
  const auto ball_slope = [&](const V& x) { return V((x - centre).normalized()); };
  REQUIRE(search(ball, ball_slope, best, asked));
  CHECK(best.distance <= -0.05 + 1e-6);
  CHECK(asked <= 34);
  CHECK(std::hypot(best.s - centre[0], best.t - centre[1]) <= 1e-3);
  asked = 0;  // a kink: the corner of a box
  const auto corner = [](const V& x) {
    return std::max(x[0] - 0.4, std::max(-x[1] + 0.3, 0.1 - x[0]));
  };
  const auto corner_slope = [&](const V& x) {
    if (corner(x) == x[0] - 0.4) return V(1, 0, 0);
    return corner(x) == 0.3 - x[1] ? V(0, -1, 0) : V(-1, 0, 0);
  };
  REQUIRE(search(corner, corner_slope, best, asked));
  CHECK(best.distance <= -0.15 + 1e-6);
  asked = 0;  // nothing below the level
  CHECK_FALSE(search(ball, ball_slope, best, asked, -0.06));
  CHECK(asked <= 20);
}

TEST_CASE("the least distance on a segment is found to the tolerance", "[contact]") {
  const V u(2, 0, 0), centre(0.7, 0.3, 0);
  int asked = 0;
  const auto evaluate = [&](double s) {
    ++asked;
    const V x = s * u - centre;
    return Deep{s, 0, x.norm(), x.normalized()};
  };
  Deep best{};
  CHECK(detail::search_segment<double>(evaluate, u, evaluate(0), evaluate(1), 10.0, 1e-8, best));
  CHECK(std::abs(best.distance - 0.3) <= 1e-8);
  CHECK(std::abs(best.s - 0.35) <= 1e-3);
  CHECK(asked <= 20);
  asked = 0;
  CHECK_FALSE(
      detail::search_segment<double>(evaluate, u, evaluate(0), evaluate(1), 0.29, 1e-8, best));
  CHECK_FALSE(  // the least is at an end
      detail::search_segment<double>(evaluate, u, evaluate(0.5), evaluate(1), 10.0, 1e-8, best));
}

TEST_CASE("the deeper of two dents is found", "[contact]") {
  const V u(1, 0, 0), v(0, 1, 0), wide(0.2, 0.6, 0), deep(0.55, 0.12, 0);
  int asked = 0;
  const auto evaluate = [&](double s, double t) {
    ++asked;
    const V x = s * u + t * v;
    const double d_wide = (x - wide).norm() - 0.3, d_deep = (x - deep).norm() - 0.31;
    return d_wide < d_deep ? Deep{s, t, d_wide, (x - wide).normalized()}
                           : Deep{s, t, d_deep, (x - deep).normalized()};
  };
  Deep best{};
  REQUIRE(detail::search_pieces<double>(evaluate, u, v, 0.1, 0.0, 1e-5, best));
  CHECK(best.distance <= -0.31 + 1e-3);
  CHECK(asked <= 400);
  CHECK_FALSE(detail::search_pieces<double>(evaluate, u, v, 0.1, -0.4, 1e-5, best));
}

TEST_CASE("half-planes cut a polygon to nothing", "[contact]") {
  detail::CutPolygon<double> polygon({0, 0}, {1, 0}, {0, 1});
  polygon.cut({0, 1, 0}, 0.5);  // s <= 1/2
  CHECK_FALSE(polygon.empty());
  CHECK(polygon.middle()[0] <= 0.5);
  polygon.cut({0, -1, 0}, -0.25);  // s >= 1/4
  CHECK(polygon.middle()[0] == Approx(0.375));
  polygon.cut({0, 0, -1}, -0.8);  // t >= 4/5
  CHECK(polygon.empty());
}
