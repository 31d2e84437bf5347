// Batches from single points, and what the surface of a collider may be.

#include "clothctl/collision/detail/point_queries.hpp"

#include <limits>

#include "laws/collider_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// All below x = 0, one point at a time.
struct Wall : detail::PointQueries<Wall, double> {
  double distance_at(const Vector3<double>& x) const { return x[0]; }
  SurfacePoint<double> closest_at(const Vector3<double>& x) const {
    SurfacePoint<double> s;
    s.distance = x[0];
    s.point = Vector3<double>(0, x[1], x[2]);
    s.normal = Vector3<double>::UnitX();
    s.body = 1;
    return s;
  }
  double sweep_at(const Vector3<double>& a, const Vector3<double>& b, double radius, double) const {
    if (a[0] <= radius) return 0;
    return b[0] <= radius ? (a[0] - radius) / (a[0] - b[0]) : no_impact<double>();
  }
  BoundingBox<double> bounds(double) const { return {}; }
};

}  // namespace

TEST_CASE("answers about single points make a collider", "[contact]") {
  clothctl_test::check_collider_laws<double>(Wall(), clothctl_test::exact_laws<double>(1.0));
}

TEST_CASE("a surface has a finite friction coefficient that is not negative", "[contact]") {
  CHECK(ColliderSurface<double>().validate().empty());
  CHECK(ColliderSurface<double>{0, 3}.validate().empty());
  CHECK(ColliderSurface<double>{-0.1, 3}.validate() ==
        "the friction coefficient -0.1, must be finite and not negative");
  CHECK(ColliderSurface<double>{std::numeric_limits<double>::quiet_NaN(), 3}.validate() ==
        "the friction coefficient nan, must be finite and not negative");
}

TEST_CASE("boxes include, grow and overlap", "[contact]") {
  BoundingBox<double> box{Vector3<double>::Zero(), Vector3<double>::Ones()};
  CHECK(box.overlaps({Vector3<double>(1, 1, 1), Vector3<double>(2, 2, 2)}));
  CHECK_FALSE(box.overlaps({Vector3<double>(1.1, 0, 0), Vector3<double>(2, 2, 2)}));
  CHECK(box.grown(0.2).overlaps({Vector3<double>(1.1, 0, 0), Vector3<double>(2, 2, 2)}));
  box.include(Vector3<double>(-1, 0.5, 3));
  CHECK(box.lower == Vector3<double>(-1, 0, 0));
  CHECK(box.upper == Vector3<double>(1, 1, 3));
  CHECK(BoundingBox<double>().overlaps(box));
}
