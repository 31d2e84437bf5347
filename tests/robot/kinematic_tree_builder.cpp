#include "clothctl/robot/kinematic_tree_builder.hpp"

#include <functional>
#include <limits>

#include "clothctl/robot/forward_kinematics.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"
#include "robot/random_tree.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

Joint<double> joint(const std::string& name, const std::string& parent, const std::string& child) {
  Joint<double> made;
  made.name = name;
  made.parent = parent;
  made.child = child;
  return made;
}

/// Builds world - a - b - c after `change`, and returns the builder's error.
std::string refused(const std::function<void(Inertia<double>&, Joint<double>&)>& spoil) {
  Inertia<double> inertia;
  inertia.mass = 1.0;
  Joint<double> middle = joint("middle", "a", "b");
  spoil(inertia, middle);
  KinematicTreeBuilder<double> builder;
  builder.add_link("world").add_link("a").add_link("b", inertia).add_link("c");
  builder.add_joint(joint("first", "world", "a"))
      .add_joint(middle)
      .add_joint(joint("last", "b", "c"));
  const Result<KinematicTree<double>> tree = builder.build();
  return tree ? std::string() : tree.error();
}

}  // namespace

TEST_CASE(
    "bodies are in depth-first order whatever the order of joints, and subtrees are intervals",
    "[robot]") {
  KinematicTreeBuilder<double> builder;
  builder.add_link("tip").add_link("palm").add_link("thumb").add_link("world").add_link("finger");
  builder.add_joint(joint("j3", "finger", "tip")).add_joint(joint("j1", "palm", "finger"));
  builder.add_joint(joint("j2", "palm", "thumb")).add_joint(joint("j0", "world", "palm"));
  const KinematicTree<double> tree = builder.build().value();
  std::string order;
  for (const Body<double>& body : tree.bodies())
    order += body.name + ":" + std::to_string(body.parent) + ":" +
             std::to_string(body.subtree_end) + " ";
  CHECK(order == "j0:-1:4 j1:0:3 j3:1:3 j2:0:4 ");
  CHECK(tree.links()[3].body == -1);
  CHECK(tree.links()[0].body == 2);
}

TEST_CASE("links with fixed joints form one body with the sum of their mass, centre and tensor",
          "[robot]") {
  RobotDraws draws(11);
  const Inertia<double> one = draws.inertia<double>(), two = draws.inertia<double>(),
                        three = draws.inertia<double>();
  KinematicTreeBuilder<double> apart, together;
  Joint<double> moving = joint("moving", "world", "one"), still = joint("still", "one", "two"),
                more = joint("more", "two", "three");
  moving.axis = draws.vector();
  for (Joint<double>* j : {&still, &more}) {
    j->type = JointType::Fixed;
    j->origin = {draws.rotation(), draws.vector()};
  }
  apart.add_link("world").add_link("one", one).add_link("two", two).add_link("three", three);
  const KinematicTree<double> tree =
      apart.add_joint(moving).add_joint(still).add_joint(more).build().value();
  REQUIRE(tree.bodies().size() == 1);
  const Inertia<double>& body = tree.bodies()[0].inertia;
  CHECK(body.mass == Approx(one.mass + two.mass + three.mass));
  // The kinetic energy of rotations about the joint's origin is the sum of the parts' energies.
  const Pose<double> first = tree.links()[1].placement, second = first * still.origin,
                     third = second * more.origin;
  for (int k = 0; k < 5; ++k) {
    const Vector3<double> w = draws.vector();
    const auto twice_energy = [&](const Inertia<double>& part, const Pose<double>& pose) {
      const Vector3<double> local = pose.R.transpose() * w;
      return part.mass * w.cross(pose * part.com).squaredNorm() + local.dot(part.about_com * local);
    };
    const double parts =
        twice_energy(one, first) + twice_energy(two, second) + twice_energy(three, third);
    CHECK(twice_energy(body, {}) == Approx(parts));
  }
}

TEST_CASE("joints that follow a leader share its coordinate and narrow its limits", "[robot]") {
  KinematicTreeBuilder<double> builder;
  builder.add_link("world").add_link("a").add_link("b").add_link("c");
  Joint<double> lead = joint("lead", "world", "a"), follow = joint("follow", "a", "b"),
                last = joint("last", "b", "c");
  lead.limits.lower = -1.0;
  lead.limits.upper = 2.0;
  lead.limits.effort = 3.0;
  follow.leader = "lead";
  follow.ratio = -2.0;
  follow.offset = 0.5;
  follow.limits.lower = -1.5;
  follow.limits.upper = 1.5;
  last.leader = "follow";
  last.ratio = 0.5;
  const KinematicTree<double> tree =
      builder.add_joint(last).add_joint(follow).add_joint(lead).build().value();
  CHECK(tree.coupled());
  CHECK(tree.nq() == 1);
  CHECK(tree.lower()[0] == Approx(-0.5));  // -2 q + 0.5 = 1.5
  CHECK(tree.upper()[0] == Approx(1.0));
  CHECK(tree.effort_limits()[0] == 3.0);
  CHECK(tree.bodies()[2].ratio == -1.0);
  CHECK(tree.bodies()[2].offset == 0.25);
}

TEST_CASE("errors are named with their value", "[robot]") {
  const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
  CHECK(refused([](Inertia<double>&, Joint<double>&) {}) == "");
  CHECK(refused([](Inertia<double>& i, Joint<double>&) { i.mass = -2.5; }) ==
        "link \"b\": mass is negative: -2.5");
  CHECK(refused([&](Inertia<double>& i, Joint<double>&) { i.mass = nan; }) ==
        "link \"b\": mass is not finite");
  CHECK(refused([&](Inertia<double>& i, Joint<double>&) { i.com[1] = infinity; }) ==
        "link \"b\": centre of mass is not finite");
  CHECK(refused([&](Inertia<double>& i, Joint<double>&) { i.about_com(0, 1) = nan; }) ==
        "link \"b\": inertia tensor is not finite");
  CHECK(refused([](Inertia<double>& i, Joint<double>&) { i.about_com(2, 2) = -1; }) ==
        "link \"b\": moment of inertia is negative: -1");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.parent = "x"; }) ==
        "joint \"middle\": there is no link \"x\" to be its parent");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.child = "y"; }) ==
        "joint \"middle\": there is no link \"y\" to be its child");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.child = "c"; }) ==
        "joint \"last\": link \"c\" is already moved by joint \"middle\"");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.parent = "c"; }) ==
        "joint \"middle\" is part of a loop");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.name = "first"; }) ==
        "joint \"first\": it occurs twice");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.axis.setZero(); }) ==
        "joint \"middle\": its axis is zero");
  CHECK(refused([&](Inertia<double>&, Joint<double>& j) { j.axis[0] = nan; }) ==
        "joint \"middle\": its axis is not finite");
  CHECK(refused([&](Inertia<double>&, Joint<double>& j) { j.origin.p[0] = nan; }) ==
        "joint \"middle\": its origin is not finite");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.origin.R(0, 0) = -1; }) ==
        "joint \"middle\": its origin's R is not a rotation");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) {
          j.limits.lower = 2, j.limits.upper = 1;
        }) == "joint \"middle\": limits are crossed: 2 .. 1");
  CHECK(refused([&](Inertia<double>&, Joint<double>& j) { j.limits.lower = nan; }) ==
        "joint \"middle\": a limit is not a number");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.limits.lower = 1e30; }) ==
        "joint \"middle\": its lower limit is beyond every position");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.limits.effort = -1; }) ==
        "joint \"middle\": effort limit is negative: -1");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.leader = "z"; }) ==
        "joint \"middle\": there is no joint \"z\" for it to follow");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.leader = "middle"; }) ==
        "joint \"middle\": its leaders follow each other in a circle");
  CHECK(refused([](Inertia<double>&, Joint<double>& j) { j.leader = "first", j.ratio = 0; }) ==
        "joint \"middle\": its ratio to its leader is zero");
  CHECK(KinematicTreeBuilder<double>().build().error() == "the robot has no links");
  CHECK(KinematicTreeBuilder<double>().add_link("a").add_link("b").build().error() ==
        "links \"a\" and \"b\" are not connected");
  CHECK(KinematicTreeBuilder<double>().add_link("a").add_link("a").build().error() ==
        "link \"a\" occurs twice");
}

TEST_CASE("finite numbers whose combination overflows are refused", "[robot]") {
  Inertia<double> huge;
  huge.mass = 1e308;
  Joint<double> first = joint("first", "world", "a"), fixed = joint("fixed", "a", "b");
  fixed.type = JointType::Fixed;
  KinematicTreeBuilder<double> builder;
  builder.add_link("world").add_link("a", huge).add_link("b", huge).add_joint(first).add_joint(
      fixed);
  CHECK(builder.build().error() == "joint \"first\": numbers overflow");
}

TEST_CASE("a builder shows its links and joints in their order, built or not", "[robot]") {
  Inertia<double> heavy;
  heavy.mass = 2.0;
  KinematicTreeBuilder<double> builder;
  CHECK(builder.links().empty());
  CHECK(builder.joints().empty());
  Joint<double> first = joint("first", "a", "b"), odd = joint("odd", "nowhere", "a");
  first.axis = Vector3<double>(0, 0, 5);
  builder.add_link("b", heavy).add_link("a").add_joint(first).add_joint(odd);
  REQUIRE(builder.links().size() == 2);
  CHECK(builder.links()[0].name == "b");
  REQUIRE(builder.links()[0].inertia);
  CHECK(builder.links()[0].inertia->mass == 2.0);
  CHECK(builder.links()[1].name == "a");
  CHECK_FALSE(builder.links()[1].inertia);
  REQUIRE(builder.joints().size() == 2);
  CHECK(builder.joints()[0].axis[2] == 5);
  CHECK(builder.joints()[1].parent == "nowhere");
  CHECK_FALSE(builder.build());
}

TEST_CASE("long chains build fast", "[robot]") {
  KinematicTreeBuilder<double> builder;
  builder.add_link("0");
  for (int k = 0; k < 20000; ++k) {
    builder.add_link(std::to_string(k + 1))
        .add_joint(joint("j" + std::to_string(k), std::to_string(k), std::to_string(k + 1)));
  }
  const Result<KinematicTree<double>> tree = builder.build();
  REQUIRE(tree);
  CHECK(tree->bodies().back().parent == 19998);
}

TEST_CASE(
    "ratios that overflow and asymmetric tensors are refused, and rounded rotations are accepted",
    "[robot]") {
  const auto chain = [](double ratio_one, double ratio_two, double limit) {
    KinematicTreeBuilder<double> builder;
    builder.add_link("world");
    for (int k = 0; k < 3; ++k) {
      Joint<double> joint;
      joint.name = "j" + std::to_string(k);
      joint.parent = k == 0 ? "world" : "l" + std::to_string(k - 1);
      joint.child = "l" + std::to_string(k);
      joint.axis << 0.0, 0.0, 1.0;
      if (k > 0) {
        joint.leader = "j" + std::to_string(k - 1);
        joint.ratio = k == 1 ? ratio_one : ratio_two;
        joint.limits.lower = -limit;
        joint.limits.upper = limit;
      }
      builder.add_link(joint.child).add_joint(joint);
    }
    return builder.build();
  };
  CHECK(chain(2.0, 0.5, 1.0));
  CHECK(chain(1e-200, 1e-200, 1.0).error() == "joint \"j2\": ratios to its leaders multiply to 0");
  CHECK(chain(1e-300, 1.0, 1e10).error() == "joint \"j1\": numbers overflow");

  Inertia<double> inertia;
  inertia.mass = 1.0;
  inertia.about_com.setIdentity();
  inertia.about_com(1, 0) = 0.9;
  KinematicTreeBuilder<double> uneven;
  uneven.add_link("world", inertia);
  CHECK(uneven.build().error() == "link \"world\": inertia tensor is not symmetric");

  // A chain of rotations with seven digits is accepted as rotations.
  KinematicTreeBuilder<float> rounded;
  rounded.add_link("world");
  for (int k = 0; k < 30; ++k) {
    Joint<float> joint;
    joint.name = "j" + std::to_string(k);
    joint.parent = k == 0 ? "world" : "l" + std::to_string(k - 1);
    joint.child = "l" + std::to_string(k);
    joint.axis << 1.0f, 2.0f, 3.0f;
    joint.origin.R *= 1.005f;
    rounded.add_link(joint.child).add_joint(joint);
  }
  const KinematicTree<float> tree = rounded.build().value();
  BodyPoses<float> body_poses(tree);
  forward_kinematics<float>(tree, tree.neutral(), body_poses);
  const Matrix3<float> R = body_poses.poses.back().R;
  CHECK((R.transpose() * R - Matrix3<float>::Identity()).cwiseAbs().maxCoeff() < 1e-5f);
}

TEST_CASE("an impossible inertia is refused with link and value", "[robot]") {
  for (const double entry : {1e38, -1e38, 1e300, 0.3}) {
    for (int k = 0; k < 3; ++k) {
      Inertia<double> inertia;
      inertia.mass = 1;
      inertia.about_com.diagonal() = Vector3<double>(0.1, 0.1, 0.15);
      inertia.about_com(k, (k + 1) % 3) = inertia.about_com((k + 1) % 3, k) = entry;
      KinematicTreeBuilder<double> builder;
      Joint<double> joint;
      joint.name = "j";
      joint.parent = "world";
      joint.child = "bone";
      builder.add_link("world").add_link("bone", inertia).add_joint(joint);
      const Result<KinematicTree<double>> tree = builder.build();
      REQUIRE_FALSE(tree);
      const std::string axes[] = {"xy", "yz", "xz"};
      CHECK(tree.error().find("link \"bone\": inertia tensor is not that of a body: entry " +
                              axes[k] + " is " + number_text(entry)) == 0);
    }
  }
}

TEST_CASE("fingerprints differ between trees and are equal for copies", "[robot]") {
  RobotDraws draws(44);
  const KinematicTree<double> a = draws.tree<double>(7, false, false),
                              b = draws.tree<double>(7, false, false), c = a;
  CHECK(a.fingerprint() != b.fingerprint());
  CHECK(a.fingerprint() == c.fingerprint());
}
