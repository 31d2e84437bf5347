// Triangles that fly at a needle: impacts against a brute-force walk in small steps.

#include "clothctl/collision/triangle_sweep.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "clothctl/collision/shapes.hpp"
#include "support/catch.hpp"
#include "support/throws.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("a triangle that passes a needle has an impact before", "[collision]") {
  std::mt19937 random(5);
  const auto needle =
      CapsuleCollider<double>::create(Vec3(0, 0, -0.05), Vec3(0, 0, 0.05), 0.0005).value();
  const ColliderRef<double> collider(needle);
  const TriangleSweep<double> sweep(collider, 0.0005);
  const Skeleton axis = make_skeleton(Thrown::Needle, 0.05);
  const int throws = trials(2000, 100000, 400);
  int passed = 0, free = 0;
  for (int trial = 0; trial < throws; ++trial) {
    TriangleSweep<double>::Triangle p, r;
    TriangleSweep<double>::Corners corner;
    Points<double> from(3, 3), to(3, 3);
    double least = 1;
    for (std::size_t k = 0; k < 3; ++k) {
      p[k] = 0.06 * any_direction(random) * uniform(random, 0.1, 1);
      r[k] = 0.05 * any_direction(random) * uniform(random, 0, 1);
      corner[k] = surface_point_at<double>(collider, p[k]);
      from.col(static_cast<Index>(k)) = p[k];
      to.col(static_cast<Index>(k)) = p[k] + r[k];
    }
    for (int i = 0; i <= 20; ++i) {
      for (int j = 0; i + j <= 20; ++j) {
        const Vec3 x = p[0] + 0.05 * i * (p[1] - p[0]) + 0.05 * j * (p[2] - p[0]);
        least = std::min(least, surface_point_at<double>(collider, x).distance);
      }
    }
    if (least < 0.003) continue;  // it may start inside
    TriangleImpact<double> impact;
    const bool met = sweep.find(p, r, corner, impact);
    if (passes(axis, axis.points, axis.points, {{0, 1, 2}}, from, to)) {
      ++passed;
      CHECK(met);
    }
    free += met ? 0 : 1;
    if (!met) continue;
    CHECK(std::abs(impact.weight.sum() - 1) < 1e-12);
    CHECK(impact.weight.minCoeff() > -1e-12);
    CHECK(std::abs(surface_point_at<double>(collider, impact.foot).distance) < 1e-9);
    CHECK(impact.target == 0.000125);
  }
  CHECK(passed > throws / 40);
  CHECK(free > throws / 40);
}
