// The reduction of contact points to four.

#include "clothctl/collision/detail/contact_manifold.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;

namespace {

using Points_ = std::vector<BodyContactPoint<double>>;

Points_ ring(int n, double tilt) {
  Points_ out(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) {
    const double a = 2 * std::acos(-1.0) * i / n;
    BodyContactPoint<double>& p = out[static_cast<std::size_t>(i)];
    p.position = V(std::cos(a), std::sin(a), 0);
    p.gap = tilt * std::cos(a);
    p.feature = static_cast<std::uint32_t>(i);
  }
  return out;
}

}  // namespace

TEST_CASE("up to four points are all kept") {
  for (int n = 1; n <= 4; ++n) {
    const Points_ points = ring(n, 0);
    BodyContacts<double> out;
    detail::add_reduced<double>(points.data(), n, V(0, 0, 1), out);
    CHECK(out.count == n);
  }
}

TEST_CASE("four of many span most of the area, with the deepest among them") {
  for (const int n : {5, 8, 24, 60}) {
    const Points_ points = ring(n, 0.1);
    BodyContacts<double> out;
    detail::add_reduced<double>(points.data(), n, V(0, 0, 1), out);
    REQUIRE(out.count == 4);
    double deepest = 1;
    std::vector<double> angles;
    for (int i = 0; i < 4; ++i) {
      const BodyContactPoint<double>& p = out.points[static_cast<std::size_t>(i)];
      deepest = std::min(deepest, p.gap);
      angles.push_back(std::atan2(p.position[1], p.position[0]));
    }
    CHECK(deepest < -0.1 * std::cos(std::acos(-1.0) / n) + 2e-3);  // to the tolerance
    std::sort(angles.begin(), angles.end());
    double area = 0;
    for (std::size_t i = 0; i < 4; ++i) area += 0.5 * std::sin(angles[(i + 1) % 4] - angles[i]);
    CHECK(area > 1.4);  // a square in the unit circle has 2
  }
}

TEST_CASE("the choice does not change with rounding") {
  Points_ points = ring(8, 0);
  std::array<int, 4> first{}, again{};
  REQUIRE(detail::ContactReduction<double>(points.data(), 8, V(0, 0, 1)).choose(first) == 4);
  for (int trial = 0; trial < 50; ++trial) {
    for (int i = 0; i < 8; ++i) {
      BodyContactPoint<double>& p = points[static_cast<std::size_t>(i)];
      p.gap = 1e-6 * std::sin(7.0 * trial + i);
      p.position += 1e-7 * V(std::sin(3.0 * trial + i), std::cos(5.0 * trial + 2 * i), 0);
    }
    REQUIRE(detail::ContactReduction<double>(points.data(), 8, V(0, 0, 1)).choose(again) == 4);
    CHECK(first == again);
  }
}

TEST_CASE("a full list takes no more") {
  BodyContacts<double> out;
  for (int i = 0; i < 20; ++i) out.add({});
  CHECK(out.count == kMostBodyContacts);
}
