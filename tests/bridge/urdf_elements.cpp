// Links and joints of URDF: inertia in rotated axes compared with a hand calculation, defaults, and
// every error with its line.

#include "clothctl/bridge/detail/urdf_elements.hpp"

#include <cmath>
#include <string>
#include <vector>

#include "bridge/urdf_text.hpp"
#include "clothctl/bridge/urdf.hpp"
#include "support/catch.hpp"
#include "support/reading.hpp"

using namespace clothctl;
using namespace clothctl;
using namespace clothctl_test;

namespace {

UrdfModel<double> parsed(const std::string& text) { return value_of(parse_urdf(text, "f.urdf")); }

std::string refusal(const std::string& text) { return refusal_of(parse_urdf(text, "f.urdf")); }

/// Returns why a joint with `inside` in line 7 is refused, without file and joint.
std::string of_joint(const std::string& inside, const std::string& type = "revolute",
                     int line = 7) {
  const std::string message = refusal(pair_text(type, inside + "\n"));
  const std::string start = "f.urdf:" + std::to_string(line) + ": joint \"j\": ";
  INFO(message);
  CHECK(message.rfind(start, 0) == 0);
  return message.substr((std::min)(start.size(), message.size()));
}

/// Returns why a link with `inside` in line 3 is refused.
std::string of_link(const std::string& inside) {
  const std::string message = refusal(robot_text(link_text("a") + link_text("b", inside) +
                                                 joint_text("j", "continuous", "a", "b")));
  const std::string start = "f.urdf:3: link \"b\": ";
  INFO(message);
  CHECK(message.rfind(start, 0) == 0);
  return message.substr((std::min)(start.size(), message.size()));
}

}  // namespace

TEST_CASE("URDF: an inertia tensor in rotated axes is converted", "[urdf]") {
  // A quarter turn about z maps x to y, so the moments about x and y are exchanged.
  const UrdfModel<double> model = parsed(robot_text(
      link_text("a") +
      link_text("b", inertial_text("<origin xyz=\"1 2 3\" rpy=\"0 0 1.5707963267948966\"/>")) +
      joint_text("j", "floating", "a", "b")));
  REQUIRE(model.tree.bodies().size() == 1);
  const Inertia<double>& inertia = model.tree.bodies()[0].inertia;
  CHECK(inertia.mass == 2);
  CHECK(inertia.com == Vector3<double>(1, 2, 3));
  const Matrix3<double> expected = Vector3<double>(0.02, 0.01, 0.015).asDiagonal();
  CHECK((inertia.about_com - expected).norm() < 1e-17);
  // rpy = (a, b, 0): I = Ry Rx diag Rxᵀ Ryᵀ, entry by entry.
  const UrdfModel<double> tilted = parsed(
      robot_text(link_text("a") + link_text("b", inertial_text("<origin rpy=\"0.5 0.25 0\"/>")) +
                 joint_text("j", "floating", "a", "b")));
  const double s = std::sin(0.5), c = std::cos(0.5), sb = std::sin(0.25), cb = std::cos(0.25),
               x = 0.01, y = 0.02, z = 0.015;
  const double yy = c * c * y + s * s * z, yz = s * c * (y - z),
               zz = s * s * y + c * c * z;  // after the rotation about x
  const Matrix3<double>& I = tilted.tree.bodies()[0].inertia.about_com;
  CHECK(I(0, 0) == Approx(cb * cb * x + sb * sb * zz).epsilon(1e-14));
  CHECK(I(1, 1) == Approx(yy).epsilon(1e-14));
  CHECK(I(2, 2) == Approx(sb * sb * x + cb * cb * zz).epsilon(1e-14));
  CHECK(I(0, 1) == Approx(sb * yz).epsilon(1e-14));
  CHECK(I(1, 2) == Approx(cb * yz).epsilon(1e-14));
  CHECK(I(0, 2) == Approx(sb * cb * (zz - x)).epsilon(1e-14));
}

TEST_CASE("URDF: omitted values have the format's defaults", "[urdf]") {
  const UrdfModel<double> model = parsed(pair_text("revolute", ""));
  const Body<double>& body = model.tree.bodies().front();
  CHECK(body.placement.p == Vector3<double>(0, 0, 0));
  CHECK((body.placement.R.col(2) - Vector3<double>(1, 0, 0)).norm() < 1e-16);  // the axis is x
  CHECK(is_unbounded(model.tree.upper()[0]));
  CHECK(is_unbounded(model.tree.effort_limits()[0]));
  const UrdfModel<double> still =
      parsed(pair_text("revolute", "<limit effort=\"1\" velocity=\"1\"/>"));
  CHECK(still.tree.lower()[0] == 0);
  CHECK(still.tree.upper()[0] == 0);
  const UrdfModel<double> endless = parsed(
      pair_text("continuous", "<limit lower=\"0\" upper=\"0\" effort=\"1\" velocity=\"1\"/>"));
  CHECK(is_unbounded(endless.tree.upper()[0]));
  const UrdfModel<double> wide = parsed(
      pair_text("revolute", "<limit lower=\"-1e30\" upper=\"1e30\" effort=\"1\" velocity=\"1\"/>"));
  CHECK(is_unbounded(wide.tree.lower()[0]));
  // Fixed and floating joints have no axis and no limits, whatever the file says.
  const std::string rest =
      "<axis xyz=\"0 0 0\"/><limit lower=\"1\" upper=\"0\"/><dynamics damping=\"1\"/>";
  CHECK(parsed(pair_text("fixed", rest)).tree.nv() == 0);
  CHECK(parsed(pair_text("floating", rest)).tree.nv() == 6);
}

TEST_CASE("URDF: errors of joints name line, element and value", "[urdf]") {
  CHECK(of_joint("", "hinge", 4) ==
        "<joint> type: \"hinge\" is unknown, expected revolute, continuous, prismatic, fixed or "
        "floating");
  CHECK(of_joint("", "planar", 4) ==
        "<joint> type: \"planar\" is not supported: two prismatic joints and a revolute one do the "
        "same");
  CHECK(of_joint("", "", 4) == "<joint> type: \"\" is empty");
  CHECK(of_joint("<origin xyz=\"1 2\"/>") == "<origin> xyz: \"1 2\" holds 2 numbers, expected 3");
  CHECK(of_joint("<origin xyz=\"1 2 3 4\"/>") ==
        "<origin> xyz: \"1 2 3 4\" holds 4 numbers, expected 3");
  CHECK(of_joint("<origin xyz=\"\"/>") == "<origin> xyz: \"\" is empty");
  CHECK(of_joint("<origin xyz=\" \"/>") == "<origin> xyz: \" \" holds 0 numbers, expected 3");
  CHECK(of_joint("<origin rpy=\"0 nan 0\"/>") ==
        "<origin> rpy: \"0 nan 0\" holds \"nan\", which is not finite");
  CHECK(of_joint("<origin rpy=\"0 0 1e999\"/>") ==
        "<origin> rpy: \"0 0 1e999\" holds \"1e999\", which is out of range");
  CHECK(of_joint("<origin xyz=\"0,5 0 0\"/>") ==
        "<origin> xyz: \"0,5 0 0\" holds \"0,5\", which is not a number");
  CHECK(of_joint("<origin quat_xyzw=\"0 0 0 1\"/>") ==
        "<origin> quat_xyzw: \"0 0 0 1\" is not supported: only xyz and rpy are");
  CHECK(of_joint("<origin/>\n<origin/>", "fixed", 8) == "<origin> occurs twice");
  CHECK(of_joint("<axis/>") == "<axis> has no xyz");
  CHECK(of_joint("<axis xyz=\"0 0 0\"/>", "revolute", 4) == "its axis is zero");
  CHECK(of_joint("<axis xyz=\"1 0 0\"/><axis xyz=\"1 0 0\"/>") == "<axis> occurs twice");
  CHECK(of_joint("<limit lower=\"2\" upper=\"1\" effort=\"1\" velocity=\"1\"/>") ==
        "<limit> lower 2 is above upper 1");
  CHECK(of_joint("<limit lower=\"x\" upper=\"1\"/>") == "<limit> lower: \"x\" is not a number");
  CHECK(of_joint("<limit lower=\"-inf\" upper=\"1\"/>") == "<limit> lower: \"-inf\" is not finite");
  CHECK(of_joint("<limit lower=\"1e30\" upper=\"1e31\"/>") ==
        "<limit> lower: \"1e30\" is no lower bound");
  CHECK(of_joint("<limit lower=\"-1e31\" upper=\"-1e30\"/>") ==
        "<limit> upper: \"-1e30\" is no upper bound");
  CHECK(of_joint("<limit effort=\"-1\"/>") == "<limit> effort: \"-1\" is negative");
  CHECK(of_joint("<limit velocity=\"-0.5\"/>") == "<limit> velocity: \"-0.5\" is negative");
  CHECK(of_joint("<limit velocity=\"\"/>") == "<limit> velocity: \"\" is empty");
  CHECK(of_joint("<limit/><limit/>") == "<limit> occurs twice");
  CHECK(of_joint("<dynamics damping=\"-1\"/>") == "<dynamics> damping: \"-1\" is negative");
  CHECK(of_joint("<dynamics friction=\"-2\"/>") == "<dynamics> friction: \"-2\" is negative");
  CHECK(of_joint("<dynamics friction=\"f\"/>") == "<dynamics> friction: \"f\" is not a number");
  CHECK(of_joint("<dynamics/><dynamics/>") == "<dynamics> occurs twice");
  CHECK(of_joint("<mimic/>") == "<mimic> has no joint");
  CHECK(of_joint("<mimic joint=\"\"/>") == "<mimic> joint: \"\" is empty");
  CHECK(of_joint("<mimic joint=\"j\" multiplier=\"two\"/>") ==
        "<mimic> multiplier: \"two\" is not a number");
  CHECK(of_joint("<mimic joint=\"j\" offset=\"0 0\"/>") ==
        "<mimic> offset: \"0 0\" holds 2 numbers, expected 1");
  CHECK(of_joint("<parent link=\"a\"/>") == "<parent> occurs twice");
  CHECK(of_joint("<child link=\"b\"/>") == "<child> occurs twice");

  const std::string good = pair_text("fixed", "");
  CHECK(refusal(replaced(good, "<parent link=\"a\"/>", "")) ==
        "f.urdf:4: joint \"j\": <joint> has no <parent>");
  CHECK(refusal(replaced(good, "<child link=\"b\"/>", "")) ==
        "f.urdf:4: joint \"j\": <joint> has no <child>");
  CHECK(refusal(replaced(good, "<parent link=\"a\"/>", "<parent/>")) ==
        "f.urdf:5: joint \"j\": <parent> has no link");
  CHECK(refusal(replaced(good, "<child link=\"b\"/>", "<child name=\"b\"/>")) ==
        "f.urdf:6: joint \"j\": <child> has no link");
  CHECK(refusal(replaced(good, " type=\"fixed\"", "")) ==
        "f.urdf:4: joint \"j\": <joint> has no type");
  CHECK(refusal(replaced(good, "<joint name=\"j\"", "<joint")) == "f.urdf:4: <joint> has no name");
  CHECK(refusal(replaced(good, "<joint name=\"j\"", "<joint name=\"\"")) ==
        "f.urdf:4: <joint> name: \"\" is empty");
}

TEST_CASE("URDF: errors of links name line, element and value", "[urdf]") {
  const std::string good = inertial_text();
  CHECK(refusal(robot_text("<link/>")) == "f.urdf:2: <link> has no name");
  CHECK(of_link(good + good) == "<inertial> occurs twice");
  CHECK(of_link("<inertial/>") == "<inertial> has no <mass>");
  CHECK(of_link("<inertial><mass value=\"1\"/></inertial>") == "<inertial> has no <inertia>");
  CHECK(of_link(replaced(good, "<mass value=\"2\"/>", "<mass/>")) == "<mass> has no value");
  CHECK(of_link(replaced(good, "value=\"2\"", "value=\"heavy\"")) ==
        "<mass> value: \"heavy\" is not a number");
  CHECK(of_link(replaced(good, "value=\"2\"", "value=\"-2\"")) == "mass is negative: -2");
  CHECK(of_link(replaced(good, "value=\"2\"", "value=\"NaN\"")) ==
        "<mass> value: \"NaN\" is not finite");
  for (const std::string name : {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"}) {
    CHECK(of_link(replaced(good, name + "=", "other=")) == "<inertia> has no " + name);
    CHECK(of_link(replaced(good, name + "=\"", name + "=\"a"))
              .rfind("<inertia> " + name + ": \"a0", 0) == 0);
  }
  CHECK(of_link(replaced(good, "ixx=\"0.01\"", "ixx=\"-1\"")) ==
        "moment of inertia is negative: -1");
  CHECK(of_link(inertial_text("<origin xyz=\"0 0 inf\"/>")) ==
        "<origin> xyz: \"0 0 inf\" holds \"inf\", which is not finite");
  std::string crowd;
  for (std::size_t k = 0; k <= kLargestUrdfLinks; ++k)
    crowd += "<link name=\"l" + std::to_string(k) + "\"/>\n";
  CHECK(refusal(robot_text(crowd)) == "f.urdf:10002: link \"l10000\": more than 10000 links");
}

TEST_CASE("URDF: single precision refuses numbers that it cannot represent", "[urdf]") {
  const std::string text = pair_text("fixed", "<origin xyz=\"1e300 0 0\"/>");
  CHECK(refusal(text) == "accepted");
  CHECK(
      refusal_of(parse_urdf<float>(text, "f.urdf")) ==
      "f.urdf:7: joint \"j\": <origin> xyz: \"1e300 0 0\" holds \"1e300\", which is out of range");
}
