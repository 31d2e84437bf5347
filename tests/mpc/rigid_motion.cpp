// Rigid motion of held vertices: exact for rigid velocities, and rigid for any velocities.

#include "clothctl/mpc/detail/rigid_motion.hpp"

#include <random>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
Points<S> random_points(unsigned seed, Index n) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-0.1, 0.1);
  Points<S> points(3, n);
  for (Index i = 0; i < points.size(); ++i) points(i) = S(uniform(random));
  return points;
}

template <class S>
Points<S> moved(const Points<S>& points, const Points<S>& velocities, S dt) {
  Points<S> out = Points<S>::Zero(3, points.cols());
  detail::move_rigidly<S>(points, detail::fit_rigid_velocity<S>(points, velocities), dt, out);
  return out;
}

}  // namespace

TEMPLATE_TEST_CASE("a rigid motion is reproduced exactly", "[mpc]", float, double) {
  using S = TestType;
  const S tolerance = S(64) * scalar_traits<S>::epsilon();
  const Points<S> points = random_points<S>(1, 9);
  const Vector3<S> centre = points.rowwise().mean(), v(S(0.3), S(-0.2), S(1)),
                   omega(S(2), S(-1), S(3));
  Points<S> velocities(3, 9);
  for (Index j = 0; j < 9; ++j) velocities.col(j) = v + omega.cross(points.col(j) - centre);
  const S dt = S(0.02);
  const Points<S> out = moved<S>(points, velocities, dt);
  const Matrix3<S> turn =
      Eigen::AngleAxis<S>(dt * omega.norm(), omega.normalized()).toRotationMatrix();
  for (Index j = 0; j < 9; ++j) {
    const Vector3<S> expected = centre + dt * v + turn * (points.col(j) - centre);
    CHECK((out.col(j) - expected).norm() <= tolerance);
  }
}

TEMPLATE_TEST_CASE("any velocities give a rigid motion with the same mean velocity", "[mpc]", float,
                   double) {
  using S = TestType;
  const S tolerance = S(64) * scalar_traits<S>::epsilon();
  for (const Index n : {1, 2, 3, 4, 12}) {
    const Points<S> points = random_points<S>(2, n), velocities = S(20) * random_points<S>(3, n);
    const S dt = S(0.02);
    const Points<S> out = moved<S>(points, velocities, dt);
    const Vector3<S> mean = (out - points).rowwise().mean() - dt * velocities.rowwise().mean();
    CHECK(mean.norm() <= tolerance);
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < i; ++j) {
        CHECK(std::abs((out.col(i) - out.col(j)).norm() - (points.col(i) - points.col(j)).norm()) <=
              tolerance);
      }
    }
  }
}

TEST_CASE("points on a line do not rotate about it, and coincident points do not rotate", "[mpc]") {
  Points<double> line(3, 3);
  line << -0.1, 0.0, 0.1, 0.2, 0.2, 0.2, 0.0, 0.0, 0.0;
  Points<double> velocities = Points<double>::Zero(3, 3);
  velocities.row(2) << -1.0, 0.0, 1.0;  // rotates about -y
  const Points<double> out = moved<double>(line, velocities, 0.02);
  CHECK(out.row(1).isApproxToConstant(0.2));
  CHECK(std::atan2(out(2, 2), out(0, 2)) == Approx(0.02 * 10.0));
  const Points<double> place = Points<double>::Constant(3, 4, 0.5);
  const Points<double> kept = moved<double>(place, random_points<double>(4, 4), 0.02);
  for (Index j = 1; j < 4; ++j) CHECK(kept.col(j) == kept.col(0));
}

TEST_CASE("moving rigidly does not allocate", "[mpc]") {
  if (!clothctl_test::allocation_counting_works()) return;
  const Points<double> points = random_points<double>(1, 9),
                       velocities = random_points<double>(2, 9);
  Points<double> out(3, 9);
  const long before = clothctl_test::allocations();
  detail::move_rigidly<double>(points, detail::fit_rigid_velocity<double>(points, velocities), 0.02,
                               out);
  const long made = clothctl_test::allocations() - before;
  CHECK(made == 0);
}
