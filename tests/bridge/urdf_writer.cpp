// Written robots read back as the same robots.

#include "clothctl/bridge/urdf_writer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "clothctl/bridge/urdf.hpp"
#include "clothctl/robot/hand34.hpp"
#include "robot/random_tree.hpp"
#include "support/catch.hpp"
#include "support/reading.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

template <class S>
double gap(const Pose<S>& a, const Pose<S>& b) {
  const double turn = static_cast<double>((a.R - b.R).cwiseAbs().maxCoeff());
  return (std::max)(
      turn, static_cast<double>((a.p - b.p).norm()) / (1 + static_cast<double>(a.p.norm())));
}

template <class S>
bool same_bound(const S& a, const S& b) {
  return is_unbounded(a) ? is_unbounded(b) && (a < 0) == (b < 0) : a == b;
}

template <class S>
UrdfModel<S> again(const KinematicTreeBuilder<S>& builder, const std::string& name = "r") {
  return value_of(parse_urdf<S>(urdf_text(builder, name), "again.urdf"));
}

/// Checks that two trees are equal except for their numbers. Returns the largest difference of
/// numbers.
template <class S>
double gap(const KinematicTree<S>& a, const KinematicTree<S>& b) {
  REQUIRE(a.bodies().size() == b.bodies().size());
  REQUIRE(a.links().size() == b.links().size());
  REQUIRE(a.nq() == b.nq());
  double worst = 0;
  for (std::size_t k = 0; k < a.links().size(); ++k) {
    CHECK(a.links()[k].name == b.links()[k].name);
    CHECK(a.links()[k].body == b.links()[k].body);
    CHECK(a.links()[k].has_inertia == b.links()[k].has_inertia);
    worst = (std::max)(worst, gap(a.links()[k].placement, b.links()[k].placement));
  }
  for (std::size_t k = 0; k < a.bodies().size(); ++k) {
    const Body<S>&x = a.bodies()[k], &y = b.bodies()[k];
    INFO(x.name);
    CHECK(x.name == y.name);
    CHECK(x.parent == y.parent);
    CHECK(x.type == y.type);
    CHECK(x.position == y.position);
    CHECK(x.follows == y.follows);
    CHECK(x.ratio == y.ratio);
    CHECK(x.offset == y.offset);
    CHECK(x.inertia.mass == y.inertia.mass);
    worst = (std::max)(worst, gap(x.placement, y.placement));
    worst = (std::max)(worst, static_cast<double>((x.inertia.com - y.inertia.com).norm()));
    const double size = 1e-30 + static_cast<double>(x.inertia.about_com.norm());
    worst = (std::max)(
        worst, static_cast<double>((x.inertia.about_com - y.inertia.about_com).norm()) / size);
  }
  for (Index i = 0; i < a.nq(); ++i) {
    CHECK(same_bound(a.lower()[i], b.lower()[i]));
    CHECK(same_bound(a.upper()[i], b.upper()[i]));
  }
  for (Index i = 0; i < a.nv(); ++i) {
    CHECK(same_bound(a.velocity_limits()[i], b.velocity_limits()[i]));
    CHECK(same_bound(a.effort_limits()[i], b.effort_limits()[i]));
  }
  return worst;
}

const std::vector<std::string> kNasty = {" ",
                                         "a b",
                                         "<link name=\"x\"/>",
                                         "&amp;",
                                         "&#65;",
                                         "'single' \"double\"",
                                         "]]>--><!--",
                                         "tab\tline\nreturn\rend",
                                         "Zähigkeit μ ✋",
                                         std::string("bell\x07"
                                                     "delete\x7f"),
                                         "percent %s %n",
                                         "\\u0041\\"};

/// A robot of random parts with every kind of joint, some limits, and names that need escaping in
/// XML.
template <class S>
KinematicTreeBuilder<S> random_builder(RobotDraws& draws, int joints) {
  KinematicTreeBuilder<S> builder;
  const auto link_name = [](int k) {
    return kNasty[static_cast<std::size_t>(k) % kNasty.size()] + std::to_string(k);
  };
  builder.add_link(link_name(0));
  for (int k = 1; k <= joints; ++k) {
    if (k % 5 == 0) {
      builder.add_link(link_name(k));
    } else {
      Inertia<S> inertia = draws.inertia<S>();
      inertia.about_com = Matrix3<S>(inertia.about_com.template selfadjointView<Eigen::Upper>());
      builder.add_link(link_name(k), inertia);
    }
    Joint<S> joint;
    joint.name = "joint of " + link_name(k);
    joint.type =
        std::vector<JointType>{JointType::Revolute, JointType::Prismatic, JointType::Fixed,
                               JointType::Revolute, JointType::Free,      JointType::Revolute}
            [static_cast<std::size_t>(draws.below(6))];
    joint.parent = link_name(draws.below(k));
    joint.child = link_name(k);
    joint.axis = draws.vector().template cast<S>();
    joint.origin.p = draws.vector().template cast<S>();
    joint.origin.R = draws.rotation().template cast<S>();
    if (draws.below(2) == 0) joint.limits.lower = S(-1) - static_cast<S>(std::abs(draws.normal()));
    if (draws.below(2) == 0) joint.limits.upper = S(1) + static_cast<S>(std::abs(draws.normal()));
    if (draws.below(2) == 0) joint.limits.velocity = static_cast<S>(std::abs(draws.normal()));
    if (draws.below(2) == 0) joint.limits.effort = static_cast<S>(std::abs(draws.normal()));
    const bool moves = joint.type == JointType::Revolute || joint.type == JointType::Prismatic;
    if (moves && k > 1 && draws.below(3) == 0) {
      for (const Joint<S>& other : builder.joints()) {
        if (other.type != JointType::Revolute && other.type != JointType::Prismatic) continue;
        joint.leader = other.name;
        joint.ratio = static_cast<S>(draws.normal());
        joint.offset = static_cast<S>(0.1 * draws.normal());
      }
    }
    builder.add_joint(joint);
  }
  return builder;
}

template <class S>
Pose<S> reread(const Matrix3<S>& R, std::string* text = nullptr) {
  KinematicTreeBuilder<S> builder;
  Joint<S> joint;
  joint.name = "j";
  joint.parent = "a";
  joint.child = "b";
  joint.axis = Vector3<S>(S(0), S(0), S(1));
  joint.origin.R = R;
  builder.add_link("a").add_link("b").add_joint(joint);
  if (text != nullptr) *text = urdf_text(builder, "r");
  return again(builder).tree.bodies()[0].placement;
}

Matrix3<double> turn(double roll, double pitch, double yaw) {
  return (Eigen::AngleAxisd(yaw, Vector3<double>::UnitZ()) *
          Eigen::AngleAxisd(pitch, Vector3<double>::UnitY()) *
          Eigen::AngleAxisd(roll, Vector3<double>::UnitX()))
      .toRotationMatrix();
}

}  // namespace

TEST_CASE("URDF: random robots with special characters in names read back the same", "[urdf]") {
  RobotDraws draws(4711);
  double worst = 0, worst_single = 0;
  int built = 0;
  for (int k = 0; k < 200; ++k) {
    const KinematicTreeBuilder<double> builder = random_builder<double>(draws, 1 + k % 30);
    const Result<KinematicTree<double>> tree = builder.build();
    if (tree) {  // the limits of followers may leave no position
      ++built;
      const UrdfModel<double> model =
          again(builder, kNasty[static_cast<std::size_t>(k) % kNasty.size()]);
      CHECK(model.name == kNasty[static_cast<std::size_t>(k) % kNasty.size()]);
      worst = (std::max)(worst, gap(*tree, model.tree));
      CHECK(urdf_text(builder, "r") == urdf_text(builder, "r"));
    }
    const KinematicTreeBuilder<float> single = random_builder<float>(draws, 1 + k % 30);
    const Result<KinematicTree<float>> single_tree = single.build();
    if (single_tree) worst_single = (std::max)(worst_single, gap(*single_tree, again(single).tree));
  }
  CHECK(built > 100);
  INFO("double " << worst << ", float " << worst_single);
  CHECK(worst < 2e-15);
  CHECK(worst_single < 1e-6);
}

TEST_CASE("URDF: rotations read back the same, also at and near both gimbal locks", "[urdf]") {
  RobotDraws draws(99);
  const double quarter = std::acos(0.0);
  double worst = 0;
  for (int k = 0; k < 4000; ++k) {
    Matrix3<double> R = draws.rotation();
    if (k % 2 ==
        0) {  // so near to the lock, on both sides, that all or some digits of yaw are lost
      const double off = k % 8 < 4 ? std::pow(10.0, -1.0 - 0.1 * (k % 190)) : 0.0;
      R = turn(3 * draws.normal(), (k % 4 == 0 ? quarter : -quarter) + (k % 3 - 1) * off,
               3 * draws.normal());
    }
    worst = (std::max)(worst, (reread<double>(R).R - R).cwiseAbs().maxCoeff());
  }
  // Quarter turns about all axes, from exact zeros and ones. At the lock, no entries determine the
  // angle.
  int quarters = 0;
  for (int x = 0; x < 3; ++x) {
    for (int y = 0; y < 3; ++y) {
      for (int signs = 0; signs < 4 && x != y; ++signs, ++quarters) {
        Matrix3<double> R = Matrix3<double>::Zero();
        R(x, 0) = signs % 2 == 0 ? 1 : -1;
        R(y, 1) = signs < 2 ? 1 : -1;
        R.col(2) = R.col(0).cross(R.col(1));
        worst = (std::max)(worst, (reread<double>(R).R - R).cwiseAbs().maxCoeff());
      }
    }
  }
  CHECK(quarters == 24);
  INFO(worst);
  CHECK(worst < 1.5e-15);
}

TEST_CASE("URDF: angles with few digits are written with few digits", "[urdf]") {
  std::string text;
  for (const Vector3<double>& rpy :
       {Vector3<double>(-1.05, 0.35, 0.75), Vector3<double>(0.1, -0.2, 0.3),
        Vector3<double>(0, 0, -0.13), Vector3<double>(3, 1.25, -2.5)}) {
    reread<double>(turn(rpy[0], rpy[1], rpy[2]), &text);
    const std::string written =
        number_text(rpy[0]) + " " + number_text(rpy[1]) + " " + number_text(rpy[2]);
    INFO(text);
    CHECK(text.find("rpy=\"" + written + "\"") != std::string::npos);
  }
  reread<double>(Matrix3<double>::Identity(), &text);
  CHECK(text.find("<origin") == std::string::npos);
  reread<float>(Eigen::AngleAxisf(0.35f, Vector3<float>::UnitZ()).toRotationMatrix(), &text);
  CHECK(text.find("rpy=\"0 0 0.35\"") != std::string::npos);
}

TEST_CASE("URDF: every kind of joint is written as its own type", "[urdf]") {
  KinematicTreeBuilder<double> builder;
  Inertia<double> heavy;
  heavy.mass = 1e25;  // large numbers are allowed here
  heavy.com = Vector3<double>(0.5, -0.0, 1e-9);
  heavy.about_com.diagonal() = Vector3<double>(3, 2, 2);
  heavy.about_com(0, 1) = heavy.about_com(1, 0) = -0.25;
  builder.add_link("a")
      .add_link("b", heavy)
      .add_link("c")
      .add_link("d")
      .add_link("e")
      .add_link("f");
  const auto join = [](const char* name, JointType type, const char* parent, const char* child) {
    Joint<double> joint;
    joint.name = name;
    joint.type = type;
    joint.parent = parent;
    joint.child = child;
    return joint;
  };
  Joint<double> slide = join("slide", JointType::Prismatic, "b", "c"),
                bend = join("bend", JointType::Revolute, "c", "d"),
                follow = join("follow", JointType::Revolute, "d", "e");
  bend.limits = {-1.5, 2.0, 3.0, 4.5};
  follow.leader = "bend";
  follow.ratio = -0.5;
  follow.offset = 0.25;
  builder.add_joint(join("turn", JointType::Revolute, "a", "b"))
      .add_joint(slide)
      .add_joint(bend)
      .add_joint(follow);
  builder.add_joint(join("fly", JointType::Free, "e", "f"));
  const std::string expected = R"(<?xml version="1.0" encoding="utf-8"?>
<robot name="all">
  <link name="a"/>
  <link name="b">
    <inertial>
      <origin xyz="0.5 0 1e-09"/>
      <mass value="1e+25"/>
      <inertia ixx="3" ixy="-0.25" ixz="0" iyy="2" iyz="0" izz="2"/>
    </inertial>
  </link>
  <link name="c"/>
  <link name="d"/>
  <link name="e"/>
  <link name="f"/>
  <joint name="turn" type="continuous">
    <parent link="a"/>
    <child link="b"/>
    <axis xyz="1 0 0"/>
    <limit effort="1e30" velocity="1e30"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="b"/>
    <child link="c"/>
    <axis xyz="1 0 0"/>
    <limit lower="-1e30" upper="1e30" effort="1e30" velocity="1e30"/>
  </joint>
  <joint name="bend" type="revolute">
    <parent link="c"/>
    <child link="d"/>
    <axis xyz="1 0 0"/>
    <limit lower="-1.5" upper="2" effort="4.5" velocity="3"/>
  </joint>
  <joint name="follow" type="continuous">
    <parent link="d"/>
    <child link="e"/>
    <axis xyz="1 0 0"/>
    <limit effort="1e30" velocity="1e30"/>
    <mimic joint="bend" multiplier="-0.5" offset="0.25"/>
  </joint>
  <joint name="fly" type="floating">
    <parent link="e"/>
    <child link="f"/>
  </joint>
</robot>
)";
  CHECK(urdf_text(builder, "all") == expected);
  CHECK(gap(builder.build().value(), again(builder).tree) < 1e-15);
}

TEST_CASE("URDF: a robot that does not build is written, and refused when read", "[urdf]") {
  Inertia<double> broken;
  broken.mass = std::numeric_limits<double>::quiet_NaN();
  KinematicTreeBuilder<double> builder;
  builder.add_link("a", broken);
  CHECK(refusal_of(parse_urdf(urdf_text(builder, "r"), "f")) ==
        "f:5: link \"a\": <mass> value: \"nan\" is not finite");
  CHECK(refusal_of(parse_urdf(urdf_text(KinematicTreeBuilder<double>(), "r"), "f")) != "accepted");
  KinematicTreeBuilder<double> xacro;
  xacro.add_link("${name}");
  CHECK(refusal_of(parse_urdf(urdf_text(xacro, "r"), "f")).find("xacro") != std::string::npos);
}

TEST_CASE("URDF: the 34-joint hand reads back to the last digits in both precisions",
          "[urdf][hand34]") {
  const UrdfModel<double> model = again(hand34_builder<double>(), "hand34");
  CHECK(gap(hand34<double>(), model.tree) < 1e-15);
  CHECK(model.warnings.empty());
  CHECK(gap(hand34<float>(), again(hand34_builder<float>(), "hand34").tree) < 5e-7);
}
