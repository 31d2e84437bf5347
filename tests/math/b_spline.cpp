// CubicBSpline: properties of the basis, exactness on cubics and at samples, smoothness, order of
// convergence, errors.

#include "clothctl/math/b_spline.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using clothctl::CubicBSpline;
using clothctl::Index;
using clothctl::Points;
using clothctl::Vector3;
using clothctl::VectorX;

namespace {

template <class Scalar>
Scalar tolerance() {
  return Scalar(200) * std::numeric_limits<Scalar>::epsilon();
}

template <class Scalar>
Points<Scalar> random_points(Index n, unsigned seed) {
  std::mt19937 engine(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Points<Scalar> points(3, n);
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < 3; ++i) points(i, j) = static_cast<Scalar>(uniform(engine));
  }
  return points;
}

template <class Scalar>
VectorX<Scalar> uneven_times(Index n, unsigned seed) {
  std::mt19937 engine(seed);
  std::uniform_real_distribution<double> uniform(0.05, 1);
  VectorX<Scalar> times(n);
  double t = -0.7;
  for (Index i = 0; i < n; ++i) {
    times[i] = static_cast<Scalar>(t);
    t += uniform(engine);
  }
  return times;
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace

TEMPLATE_TEST_CASE("equal control points give a constant curve", "[b_spline]", float, double) {
  using Scalar = TestType;
  const Vector3<Scalar> where(Scalar(0.3), Scalar(-2), Scalar(1.5));
  for (Index n : {4, 5, 9, 40}) {
    const Points<Scalar> control = where.replicate(1, n);
    const auto curve = CubicBSpline<Scalar>::from_control_points(control, Scalar(-1), Scalar(2));
    REQUIRE(curve.has_value());
    for (int i = 0; i <= 60; ++i) {
      const Scalar t = Scalar(-1) + Scalar(i) * Scalar(0.05);
      CHECK((curve->position(t) - where).norm() <= tolerance<Scalar>());
      CHECK(curve->velocity(t).norm() <= tolerance<Scalar>());
      CHECK(curve->acceleration(t).norm() <= tolerance<Scalar>());
    }
  }
}

TEMPLATE_TEST_CASE("an affine map of the control points applies to the curve", "[b_spline]", float,
                   double) {
  using Scalar = TestType;
  const Points<Scalar> control = random_points<Scalar>(11, 3);
  const Eigen::Matrix<Scalar, 3, 3> map = random_points<Scalar>(3, 4);
  const Vector3<Scalar> offset(Scalar(1), Scalar(2), Scalar(3));
  const Points<Scalar> mapped = (map * control).colwise() + offset;
  const auto curve = CubicBSpline<Scalar>::from_control_points(control, Scalar(0), Scalar(4));
  const auto image = CubicBSpline<Scalar>::from_control_points(mapped, Scalar(0), Scalar(4));
  for (int i = 0; i <= 80; ++i) {
    const Scalar t = Scalar(i) * Scalar(0.05);
    const Vector3<Scalar> position = map * curve->position(t) + offset;
    const Vector3<Scalar> velocity = map * curve->velocity(t);
    CHECK((image->position(t) - position).norm() <= Scalar(10) * tolerance<Scalar>());
    CHECK((image->velocity(t) - velocity).norm() <= Scalar(100) * tolerance<Scalar>());
  }
}

TEST_CASE("four control points are a Bézier curve", "[b_spline]") {
  const Points<double> b = random_points<double>(4, 5);
  const auto curve = CubicBSpline<double>::from_control_points(b, 1.0, 3.0);
  for (int i = 0; i <= 20; ++i) {
    const double s = i / 20.0;
    const double r = 1 - s;
    const Vector3<double> position = r * r * r * b.col(0) + 3 * r * r * s * b.col(1) +
                                     3 * r * s * s * b.col(2) + s * s * s * b.col(3);
    const Vector3<double> velocity =
        0.5 * 3 *
        (r * r * (b.col(1) - b.col(0)) + 2 * r * s * (b.col(2) - b.col(1)) +
         s * s * (b.col(3) - b.col(2)));
    CHECK((curve->position(1 + 2 * s) - position).norm() < 1e-14);
    CHECK((curve->velocity(1 + 2 * s) - velocity).norm() < 1e-13);
  }
}

TEMPLATE_TEST_CASE("control points from polar forms reproduce any cubic", "[b_spline]", float,
                   double) {
  using Scalar = TestType;
  // p(t) = a + b t + c t² + d t³ has the polar form a + b (u+v+w)/3 + c (uv+vw+wu)/3 + d uvw. Its
  // values at three successive knots are the control points. Here: uniform clamped knots on [0, 3]
  // with 7 control points.
  const Points<Scalar> coefficient = random_points<Scalar>(4, 6);
  const double tau[] = {0, 0, 0, 0, 0.75, 1.5, 2.25, 3, 3, 3, 3};
  Points<Scalar> control(3, 7);
  for (Index j = 0; j < 7; ++j) {
    const Scalar u = static_cast<Scalar>(tau[j + 1]), v = static_cast<Scalar>(tau[j + 2]),
                 w = static_cast<Scalar>(tau[j + 3]);
    control.col(j) = coefficient.col(0) + coefficient.col(1) * ((u + v + w) / Scalar(3)) +
                     coefficient.col(2) * ((u * v + v * w + w * u) / Scalar(3)) +
                     coefficient.col(3) * (u * v * w);
  }
  const auto curve = CubicBSpline<Scalar>::from_control_points(control, Scalar(0), Scalar(3));
  for (int i = 0; i <= 60; ++i) {
    const Scalar t = Scalar(i) * Scalar(0.05);
    const Vector3<Scalar> position = coefficient.col(0) + coefficient.col(1) * t +
                                     coefficient.col(2) * (t * t) +
                                     coefficient.col(3) * (t * t * t);
    const Vector3<Scalar> velocity = coefficient.col(1) + coefficient.col(2) * (Scalar(2) * t) +
                                     coefficient.col(3) * (Scalar(3) * t * t);
    const Vector3<Scalar> acceleration =
        coefficient.col(2) * Scalar(2) + coefficient.col(3) * (Scalar(6) * t);
    CHECK((curve->position(t) - position).norm() <= Scalar(10) * tolerance<Scalar>());
    CHECK((curve->velocity(t) - velocity).norm() <= Scalar(30) * tolerance<Scalar>());
    CHECK((curve->acceleration(t) - acceleration).norm() <= Scalar(100) * tolerance<Scalar>());
  }
}

TEMPLATE_TEST_CASE("interpolation passes through every sample, with zero curvature at the ends",
                   "[b_spline]", float, double) {
  using Scalar = TestType;
  for (Index n : {2, 3, 4, 7, 250}) {
    const VectorX<Scalar> times = uneven_times<Scalar>(n, static_cast<unsigned>(n));
    const Points<Scalar> samples = random_points<Scalar>(n, 8);
    const auto curve = CubicBSpline<Scalar>::interpolate(times, samples);
    REQUIRE(curve.has_value());
    CHECK(curve->start_time() == times[0]);
    CHECK(curve->end_time() == times[n - 1]);
    CHECK(curve->control_points().cols() == n + 2);
    CHECK(curve->position(times[0]) == samples.col(0));
    CHECK(curve->position(times[n - 1]) == samples.col(n - 1));
    for (Index i = 0; i < n; ++i) {
      CHECK((curve->position(times[i]) - samples.col(i)).norm() <=
            Scalar(20) * tolerance<Scalar>());
    }
    const Scalar largest = std::max(Scalar(1), curve->acceleration(times[n / 2]).norm());
    CHECK(curve->acceleration(times[0]).norm() <= Scalar(1000) * tolerance<Scalar>() * largest);
    CHECK(curve->acceleration(times[n - 1]).norm() <= Scalar(1000) * tolerance<Scalar>() * largest);
  }
}

TEST_CASE("two samples give the straight line between them at constant speed", "[b_spline]") {
  Points<double> samples(3, 2);
  samples << 0, 1, 0, 2, 0, -4;
  const auto curve = CubicBSpline<double>::interpolate(Eigen::Vector2d(1, 3), samples);
  const Vector3<double> velocity(0.5, 1, -2);
  for (int i = 0; i <= 10; ++i) {
    const double t = 1 + 0.2 * i;
    CHECK((curve->position(t) - (t - 1) * velocity).norm() < 1e-14);
    CHECK((curve->velocity(t) - velocity).norm() < 1e-13);
  }
}

TEST_CASE("position, velocity and acceleration are continuous across knots", "[b_spline]") {
  const VectorX<double> times = uneven_times<double>(30, 9);
  const auto curve = CubicBSpline<double>::interpolate(times, random_points<double>(30, 10));
  const double step = 1e-9;
  for (Index i = 1; i < 29; ++i) {
    const double scale = 1 + 1e3;  // third derivatives of these data are below a few thousand
    const double left = times[i] - step, right = times[i] + step;
    CHECK((curve->position(right) - curve->position(left)).norm() < 1e-6);
    CHECK((curve->velocity(right) - curve->velocity(left)).norm() < 10 * step * scale);
    CHECK((curve->acceleration(right) - curve->acceleration(left)).norm() < 100 * step * scale);
  }
}

TEST_CASE("derivatives agree with central differences", "[b_spline]") {
  const auto curve =
      CubicBSpline<double>::from_control_points(random_points<double>(12, 11), 0.0, 2.0);
  for (int i = 1; i < 50; ++i) {
    const double t = 0.04 * i + 0.003, e = 1e-5;
    const Vector3<double> velocity = (curve->position(t + e) - curve->position(t - e)) / (2 * e);
    const Vector3<double> acceleration =
        (curve->velocity(t + e) - curve->velocity(t - e)) / (2 * e);
    CHECK((curve->velocity(t) - velocity).norm() < 1e-6);
    CHECK((curve->acceleration(t) - acceleration).norm() < 2e-5 * (1 + acceleration.norm()));
  }
}

TEST_CASE("the error of interpolation falls with the fourth power of the spacing", "[b_spline]") {
  const auto exact = [](double t) {
    return Vector3<double>(std::sin(3 * t), std::cos(2 * t), std::exp(-t) * std::sin(t));
  };
  double previous = 0;
  for (int n : {21, 41, 81, 161}) {
    const VectorX<double> times = VectorX<double>::LinSpaced(n, 0, 6);
    Points<double> samples(3, n);
    for (Index i = 0; i < n; ++i) samples.col(i) = exact(times[i]);
    const auto curve = CubicBSpline<double>::interpolate(times, samples);
    double error = 0;  // the natural end condition costs two orders, so not near the ends
    for (double t = 2; t <= 4; t += 0.0037)
      error = std::max(error, (curve->position(t) - exact(t)).norm());
    if (previous > 0) {
      const double order = std::log2(previous / error);
      CHECK(order > 3.8);
      CHECK(order < 4.5);
    }
    previous = error;
  }
}

TEST_CASE("outside its interval the curve is constant", "[b_spline]") {
  const Points<double> control = random_points<double>(6, 12);
  const auto curve = CubicBSpline<double>::from_control_points(control, 1.0, 2.0);
  for (double t : {-1e300, 0.0, 0.999999}) {
    CHECK(curve->position(t) == control.col(0));
    CHECK(curve->velocity(t).isZero(0));
    CHECK(curve->acceleration(t).isZero(0));
  }
  for (double t : {2.000001, 3.0, 1e300}) {
    CHECK(curve->position(t) == control.col(5));
    CHECK(curve->velocity(t).isZero(0));
    CHECK(curve->acceleration(t).isZero(0));
  }
  CHECK(curve->position(1.0) == control.col(0));
  CHECK(curve->position(2.0) == control.col(5));
  CHECK((curve->velocity(2.0) - 9 * (control.col(5) - control.col(4))).norm() <
        1e-12);  // 3 spans: 3·3·Δc
}

TEST_CASE("translate moves every point and keeps velocities", "[b_spline]") {
  auto curve = CubicBSpline<double>::from_control_points(random_points<double>(8, 13), 0.0, 1.0);
  const auto before = *curve;
  const Vector3<double> offset(0.1, -0.2, 5);
  curve->translate(offset);
  for (double t = -0.1; t < 1.15; t += 0.05) {
    CHECK((curve->position(t) - before.position(t) - offset).norm() < 1e-14);
    CHECK((curve->velocity(t) - before.velocity(t)).norm() < 1e-12);
  }
}

TEST_CASE("evaluation does not allocate", "[b_spline]") {
  if (!clothctl_test::allocation_counting_works()) return;
  const auto curve = CubicBSpline<double>::interpolate(uneven_times<double>(50, 14),
                                                       random_points<double>(50, 15));
  const long before = clothctl_test::allocations();
  Vector3<double> sum = Vector3<double>::Zero();
  for (double t = -1; t < 30; t += 0.1)
    sum += curve->position(t) + curve->velocity(t) + curve->acceleration(t);
  const long after = clothctl_test::allocations();
  CHECK(after == before);
  CHECK(clothctl::all_finite(sum));
}

TEMPLATE_TEST_CASE("bad data are refused with index and value", "[b_spline]", float, double) {
  using Scalar = TestType;
  using Curve = CubicBSpline<Scalar>;
  const Scalar nan = std::numeric_limits<Scalar>::quiet_NaN();
  const Scalar infinite = std::numeric_limits<Scalar>::infinity();
  const Points<Scalar> points = random_points<Scalar>(6, 16);

  CHECK(Curve::from_control_points(points.leftCols(3), Scalar(0), Scalar(1)).error() ==
        "control points: expected at least 4, found 3");
  CHECK(contains(Curve::from_control_points(points, Scalar(1), Scalar(1)).error(),
                 "end time 1 does not come after"));
  CHECK(contains(Curve::from_control_points(points, nan, Scalar(1)).error(), "start time is nan"));
  CHECK(
      contains(Curve::from_control_points(points, Scalar(0), infinite).error(), "end time is inf"));
  Points<Scalar> broken = points;
  broken(1, 4) = nan;
  CHECK(contains(Curve::from_control_points(broken, Scalar(0), Scalar(1)).error(),
                 "control point 4: y is nan"));

  VectorX<Scalar> times = VectorX<Scalar>::LinSpaced(6, Scalar(0), Scalar(5));
  CHECK(contains(Curve::interpolate(times, broken).error(), "sample 4: y is nan"));
  CHECK(Curve::interpolate(times.head(5), points).error() == "samples: 5 times but 6 points");
  CHECK(Curve::interpolate(times.head(1), points.leftCols(1)).error() ==
        "samples: expected at least 2, found 1");
  CHECK(!Curve::interpolate(times.head(0), points.leftCols(0)).has_value());
  times[3] = Scalar(1.5);
  CHECK(Curve::interpolate(times, points).error() == "sample 3: time 1.5 does not come after 2");
  times[3] = times[2];
  CHECK(!Curve::interpolate(times, points).has_value());
  times[3] = infinite;
  CHECK(contains(Curve::interpolate(times, points).error(), "sample 3: time is inf"));
}

TEST_CASE("knots that are equal in the scalar type are refused with a message", "[b_spline]") {
  // Near 1e7, neighbouring floats are 1 apart, so 37 spans do not fit into 4 s.
  const auto curve =
      CubicBSpline<float>::from_control_points(random_points<float>(40, 17), 1e7f, 1e7f + 4.0f);
  REQUIRE_FALSE(curve.has_value());
  CHECK(curve.error() ==
        "knot 4: time 1e+07 does not come after 1e+07, too many control points for the interval");
  CHECK(CubicBSpline<double>::from_control_points(random_points<double>(40, 17), 1e7, 1e7 + 4.0)
            .has_value());
  // The number of knots equals the number of floats in between.
  const auto full =
      CubicBSpline<float>::from_control_points(random_points<float>(7, 18), 1e7f, 1e7f + 4.0f);
  REQUIRE(full.has_value());
  for (const float t : {1e7f, 1e7f + 1, 1e7f + 2, 1e7f + 3, 1e7f + 4}) {
    CHECK(clothctl::all_finite(full->position(t)));
    CHECK(clothctl::all_finite(full->velocity(t)));
    CHECK(clothctl::all_finite(full->acceleration(t)));
  }
}
