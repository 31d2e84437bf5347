#include "clothctl/robot/kinematic_tree.hpp"

#include <cmath>

#include "robot/random_tree.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEMPLATE_TEST_CASE(
    "a difference leads from one configuration to the other, and quaternions stay unit", "[robot]",
    float, double) {
  using S = TestType;
  RobotDraws draws(9);
  const double loose = sizeof(S) == sizeof(float) ? 1e-5 : 1e-13;
  for (int trial = 0; trial < 50; ++trial) {
    const KinematicTree<S> tree = draws.tree<S>(12, true, trial % 2 == 0);
    VectorX<S> from = draws.positions<S>(tree), to = draws.positions<S>(tree);
    if (trial % 3 == 0) to = from;
    if (trial % 3 == 1) {  // nearly equal, and with the opposite sign of the quaternion
      VectorX<S> nudge = draws.entries<S>(tree.nv(), 1e-4);
      tree.advance(from, nudge, to);
      for (const Body<S>& body : tree.bodies()) {
        if (body.type == JointType::Free) to.template segment<4>(body.position + 3) *= S(-1);
      }
    }
    VectorX<S> step(tree.nv()), reached = from;
    const long before = clothctl_test::allocations();
    tree.difference(from, to, step);
    tree.advance(reached, step, reached);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    for (const Body<S>& body : tree.bodies()) {
      if (body.type != JointType::Free) {
        CHECK(std::abs(static_cast<double>(reached[body.position] - to[body.position])) < loose);
        continue;
      }
      const auto p = reached.template segment<4>(body.position + 3),
                 w = to.template segment<4>(body.position + 3);
      CHECK(std::abs(static_cast<double>(p.norm()) - 1.0) < loose);
      CHECK(std::abs(std::abs(static_cast<double>(p.dot(w))) - 1.0) < loose);
      CHECK(static_cast<double>(step.template segment<3>(body.velocity + 3).norm()) < 3.1416);
      CHECK(static_cast<double>((reached - to).template segment<3>(body.position).norm()) <
            10 * loose);
    }
  }
}

TEST_CASE(
    "a full turn of a free body returns to the start, and half a turn gives its rotation matrix",
    "[robot]") {
  RobotDraws draws(10);
  const KinematicTree<double> tree = draws.tree<double>(1, true, false);
  const double pi = std::acos(-1.0);
  const VectorX<double> q = draws.positions<double>(tree);
  VectorX<double> step = VectorX<double>::Zero(6), moved(7);
  step[5] = 2 * pi;
  tree.advance(q, step, moved);
  CHECK((moved.tail<4>() + q.tail<4>()).norm() < 1e-14);
  step[5] = pi / 2;
  VectorX<double> identity = q;
  identity.tail<4>() << 1, 0, 0, 0;
  tree.advance(identity, step, moved);
  CHECK(moved[3] == Approx(std::sqrt(0.5)));
  CHECK(moved[6] == Approx(std::sqrt(0.5)));
}

TEST_CASE("neutral is zero, moved into the limits", "[robot]") {
  KinematicTreeBuilder<double> builder;
  builder.add_link("world").add_link("a").add_link("b");
  Joint<double> one;
  one.name = "one";
  one.parent = "world";
  one.child = "a";
  one.limits.lower = 0.25;
  one.limits.upper = 1.0;
  Joint<double> two;
  two.name = "two";
  two.type = JointType::Free;
  two.parent = "a";
  two.child = "b";
  const KinematicTree<double> tree = builder.add_joint(one).add_joint(two).build().value();
  VectorX<double> wanted = VectorX<double>::Zero(8);
  wanted[0] = 0.25;
  wanted[4] = 1.0;
  CHECK(tree.neutral() == wanted);
  CHECK(tree.find_link("b") == 2);
  CHECK(tree.find_joint("two") == 1);
  CHECK(tree.find_link("c") == -1);
}

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
