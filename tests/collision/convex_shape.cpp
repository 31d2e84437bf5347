// Convex shapes: mass properties against formulas and samples, bounds, what is refused, and their
// moving colliders.

#include "clothctl/collision/convex_shape.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <random>

#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;
using Shape = ConvexShape<double>;

TEST_CASE("moments of all shapes agree with sums over cells inside") {
  Points<double> corners(3, 5);
  corners << 0, 1, 0, 0, 0.8, 0, 0, 1, 0, 0.7, 0, 0, 0, 1, 0.9;
  const Shape shapes[] = {Shape::sphere(0.7).value(), Shape::capsule(0.5, 0.3).value(),
                          Shape::box(V(0.3, 0.5, 0.7)).value(), Shape::hull(corners).value()};
  for (const Shape& shape : shapes) {
    const MovingShape<double> moving = MovingShape<double>::create(shape, {}).value();
    const BoundingBox<double> box = shape.bounds(Matrix3<double>::Identity(), V::Zero());
    const int n = 60;
    const V cell = (box.upper - box.lower) / n;
    double volume = 0;
    V centre = V::Zero();
    Matrix3<double> C = Matrix3<double>::Zero();
    Points<double> x(3, 1);
    VectorX<double> d(1);
    for (int i = 0; i < n * n * n; ++i) {
      const V at = box.lower + cell.cwiseProduct(V(i % n + 0.5, i / n % n + 0.5, i / n / n + 0.5));
      x.col(0) = at;
      REQUIRE(moving.collider().distance(x, d) == QueryStatus::Answered);
      if (d[0] > 0) continue;
      volume += cell.prod();
      centre += cell.prod() * at;
      C += cell.prod() * at * at.transpose();
    }
    const Matrix3<double> J = C.trace() * Matrix3<double>::Identity() - C;
    CAPTURE(static_cast<int>(shape.kind()));
    CHECK(shape.volume() == Approx(volume).epsilon(0.02));
    CHECK(centre.norm() < 0.01 * volume);
    CHECK((shape.unit_inertia() - J).norm() < 0.03 * J.norm());
    CHECK(shape.inner_radius() > 0);
    CHECK(shape.inner_radius() < shape.outer_radius() + 1e-12);
  }
}

TEST_CASE("a hull is moved to its centre of mass") {
  Points<double> x = detail::box_polytope<double>(V(1, 1, 1)).corners.colwise() + V(5, 6, 7);
  const Shape hull = Shape::hull(x).value();
  CHECK((hull.origin() - V(5, 6, 7)).norm() < 1e-9);
  CHECK(hull.core().corners.rowwise().sum().norm() < 1e-9);
  CHECK(hull.inner_radius() == Approx(1));
  CHECK(hull.outer_radius() == Approx(std::sqrt(3.0)));
}

TEST_CASE("the box of a turned shape holds it") {
  const Shape shape = Shape::capsule(1, 0.2).value();
  const Matrix3<double> R = rotation_exp<double>(V(0, 1.5707963267948966, 0));
  const BoundingBox<double> box = shape.bounds(R, V(1, 2, 3));
  CHECK((box.upper - V(2.2, 2.2, 3.2)).norm() < 1e-9);
  CHECK((box.lower - V(-0.2, 1.8, 2.8)).norm() < 1e-9);
}

TEST_CASE("shapes without extent are refused, and hulls with too many corners") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(!Shape::sphere(0));
  CHECK(!Shape::sphere(nan));
  CHECK(!Shape::capsule(0, 1));
  CHECK(!Shape::capsule(1, -1));
  CHECK(!Shape::box(V(1, 0, 1)));
  CHECK(!Shape::box(V(1, nan, 1)));
  Points<double> flat = Points<double>::Zero(3, 6);
  flat.row(0) << 0, 1, 2, 3, 4, 5;
  CHECK(!Shape::hull(flat));
  std::mt19937 random(2);
  Points<double> many(3, 200);
  for (Index i = 0; i < many.cols(); ++i) {
    for (int k = 0; k < 3; ++k) many(k, i) = static_cast<double>(random()) / 4294967296.0 - 0.5;
    many.col(i).normalize();
  }
  const Result<Shape> made = Shape::hull(many);
  REQUIRE(!made);
  CHECK(made.error().find("64") != std::string::npos);
}

TEST_CASE("a moving shape has its pose, its surface velocity and its number") {
  const Shape shape = Shape::box(V(1, 1, 1)).value();
  MovingShape<double> moving = MovingShape<double>::create(shape, {}, {0.3, 7}).value();
  RigidMotion<double> motion;
  motion.position = V(0, 0, 2);
  motion.velocity = V(1, 0, 0);
  motion.angular_velocity = V(0, 0, 1);
  CHECK(moving.set_motion(motion).empty());
  Points<double> x(3, 1);
  x.col(0) = V(2, 0.5, 2);
  SurfacePoint<double> s;
  REQUIRE(moving.collider().closest(x, std::span<SurfacePoint<double>>(&s, 1)) ==
          QueryStatus::Answered);
  CHECK(s.distance == Approx(1));
  CHECK((s.velocity - V(0.5, 1, 0)).norm() < 1e-12);
  CHECK(s.body == 7);
  CHECK(s.friction == 0.3);
  motion.position[0] = std::numeric_limits<double>::infinity();
  CHECK(!moving.set_motion(motion).empty());
}
