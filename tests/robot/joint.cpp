#include "clothctl/robot/joint.hpp"

#include "robot/random_tree.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("poses compose, invert and move points", "[robot]") {
  RobotDraws draws(8);
  const Pose<double> a{draws.rotation(), draws.vector()}, b{draws.rotation(), draws.vector()};
  const Vector3<double> x = draws.vector();
  CHECK(((a * b) * x - a * (b * x)).norm() < 1e-14);
  CHECK((a.inverse() * (a * x) - x).norm() < 1e-14);
  CHECK(((a * a.inverse()).R - Matrix3<double>::Identity()).norm() < 1e-14);
}

TEST_CASE("joint types have names", "[robot]") {
  CHECK(to_string(JointType::Revolute) == "revolute");
  CHECK(to_string(JointType::Prismatic) == "prismatic");
  CHECK(to_string(JointType::Fixed) == "fixed");
  CHECK(to_string(JointType::Free) == "free");
}
