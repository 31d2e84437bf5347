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

TEST_CASE("an impact at the edge of a box asks for a motion", "[collision]") {
  // One side of the triangle touches the edge, within the tolerance of the first search. It was an
  // impact whatever the ways were, and vertices stayed where they were for ever.
  const auto box =
      BoxCollider<double>::create(Vec3(0, -0.5, -0.4), Vec3(0.125, 0.125, 0.05)).value();
  const ColliderRef<double> collider(box);
  const TriangleSweep<double> sweep(collider, 1e-3);
  const TriangleSweep<double>::Triangle p{
      Vec3(-0.095523415060821279, -0.37289657375323121, -0.43265220879867333),
      Vec3(-0.060889666413486435, -0.37443331136143171, -0.45959024186246139),
      Vec3(-0.090406525687835373, -0.3766016995346832, -0.46320259438418154)};
  TriangleSweep<double>::Corners corner;
  for (std::size_t k = 0; k < 3; ++k) corner[k] = surface_point_at<double>(collider, p[k]);
  TriangleImpact<double> impact;
  const TriangleSweep<double>::Triangle out{
      Vec3(9.779397751e-05, -2.429055678e-04, -7.746801999e-04),
      Vec3(-1.468393978e-04, -3.794693720e-05, -1.190719392e-03),
      Vec3(1.626990526e-05, 6.259101136e-04, -8.200558363e-04)};
  CHECK(!sweep.find(p, out, corner, impact));
  // Inwards by 1 mm, across the edge.
  const TriangleSweep<double>::Triangle in{Vec3(0, -1e-3, 1e-3), Vec3(0, -1e-3, 1e-3),
                                           Vec3(0, -1e-3, 1e-3)};
  REQUIRE(sweep.find(p, in, corner, impact));
  double end = 0;
  for (std::size_t k = 0; k < 3; ++k)
    end +=
        impact.weight[static_cast<Index>(k)] * impact.normal.dot(Vec3(p[k] + in[k] - impact.foot));
  CHECK(end < impact.target);
  // It turns into the box beside the point that touches.
  const TriangleSweep<double>::Triangle turn{Vec3::Zero(), Vec3::Zero(), Vec3(0, -0.02, 0.02)};
  CHECK(sweep.find(p, turn, corner, impact));
}

TEST_CASE("a triangle at the edge of a plate that leaves it has no impact, and cannot enter",
          "[collision]") {
  std::mt19937 random(11);
  // A plate of 10 mm; its edge along x at y = 0.1, z = 0.005.
  const auto plate = BoxCollider<double>::create(Vec3::Zero(), Vec3(0.2, 0.1, 0.005)).value();
  const ColliderRef<double> collider(plate);
  const double thickness = 1e-3;
  const TriangleSweep<double> sweep(collider, thickness);
  for (int trial = 0; trial < trials(500, 20000, 100); ++trial) {
    CAPTURE(trial);
    // One side of the triangle lies across the edge, within two thousandths of the thickness.
    const Vec3 outwards = Vec3(0, 1, 1).normalized();
    const Vec3 along = Vec3(uniform(random, -1, 1), 1, -1).normalized();
    const double share = uniform(random, 0.3, 0.7), depth = uniform(random, -2e-6, 2e-6);
    const Vec3 touch = Vec3(uniform(random, -0.1, 0.1), 0.1, 0.005) + depth * outwards;
    TriangleSweep<double>::Triangle p{touch - 0.03 * share * along,
                                      touch + 0.03 * (1 - share) * along,
                                      touch + 0.03 * outwards + 0.01 * along};
    TriangleSweep<double>::Corners corner;
    for (std::size_t k = 0; k < 3; ++k) corner[k] = surface_point_at<double>(collider, p[k]);
    TriangleSweep<double>::Triangle r;
    for (Vec3& way : r) way = uniform(random, 1e-6, 0.01) * Vec3(0, 1, 1);
    TriangleImpact<double> impact;
    CHECK(!sweep.find(p, r, corner, impact));
    for (Vec3& way : r) way = uniform(random, -0.01, -1e-3) * Vec3(0, 1, 1);
    REQUIRE(sweep.find(p, r, corner, impact));
    CHECK(impact.target <= 0.25 * thickness);
    // One corner goes in, so that the triangle turns into the plate beside the point that touches.
    for (Vec3& way : r) way = Vec3::Zero();
    r[1] = -0.02 * outwards;
    CHECK(sweep.find(p, r, corner, impact));
  }
}
