// An obstacle of a world.

#include "clothctl/sim/detail/world_obstacle.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "clothctl/collision/shapes.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Ball = SphereCollider<double>;

detail::WorldObstacleOf<double, Ball> obstacle(const RigidMotion<double>& motion) {
  const Ball ball = Ball::create(Vector3<double>(1, 0, 0), 0.1).value();
  return detail::WorldObstacleOf<double, Ball>(
      MovingCollider<double, Ball>::create(ball, motion).value());
}

}  // namespace

TEST_CASE("an obstacle goes on with its velocities, and stays without", "[sim]") {
  auto still = obstacle({});
  CHECK(!still.moves());
  still.move(1);
  CHECK(still.motion().position.norm() == 0);
  RigidMotion<double> motion;
  motion.velocity = Vector3<double>(0, 0, 2);
  motion.angular_velocity = Vector3<double>(0, 0, 0.5 * std::numbers::pi);
  auto moving = obstacle(motion);
  CHECK(moving.moves());
  moving.move(1);
  // A quarter turn brings the ball from x to y.
  Eigen::Vector3d x(0, 1, 2);
  Eigen::VectorXd distance(1);
  CHECK(moving.collider().distance(x, distance) == QueryStatus::Answered);
  CHECK(std::abs(distance[0] + 0.1) < 1e-12);
  motion.velocity[0] = std::numeric_limits<double>::quiet_NaN();
  CHECK(!moving.set_motion(motion).empty());
  CHECK(moving.motion().position == Vector3<double>(0, 0, 2));
}
