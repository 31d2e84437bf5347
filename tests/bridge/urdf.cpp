// Trees from URDF: the shared models, every kind of joint, couplings, merging, and connections of
// links.

#include "clothctl/bridge/urdf.hpp"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "bridge/urdf_text.hpp"
#include "clothctl/robot/forward_kinematics.hpp"
#include "support/catch.hpp"
#include "support/reading.hpp"
#include "support/shared_data.hpp"

using namespace clothctl;
using namespace clothctl;
using namespace clothctl_test;

namespace {

template <class S = double>
UrdfModel<S> parsed(const std::string& text, const UrdfOptions<S>& options = {}) {
  return value_of(parse_urdf<S>(text, "f.urdf", options));
}

std::string refusal(const std::string& text, const UrdfOptions<double>& options = {}) {
  return refusal_of(parse_urdf(text, "f.urdf", options));
}

const Body<double>& body_of(const UrdfModel<double>& model, const std::string& joint) {
  const int body = model.tree.find_joint(joint);
  REQUIRE(body >= 0);
  return model.tree.bodies()[static_cast<std::size_t>(body)];
}

/// Returns the strings of the list under a key of a JSON text.
std::vector<std::string> strings_under(const std::string& json, const std::string& key) {
  std::vector<std::string> found;
  std::size_t place = json.find('[', json.find('"' + key + '"'));
  const std::size_t end = json.find(']', place);
  while ((place = json.find('"', place)) < end) {
    const std::size_t close = json.find('"', place + 1);
    found.push_back(json.substr(place + 1, close - place - 1));
    place = close + 1;
  }
  return found;
}

}  // namespace

TEST_CASE("URDF: the shared models have the documented joints, links and masses", "[urdf]") {
  struct Row {
    std::string name;
    Index dof;
    std::size_t links;
    double mass;
  };
  const std::vector<Row> table = {
      {"shadow_hand_right", 24, 33, 3.794}, {"allegro_hand_right", 16, 24, 0.974},
      {"leap_hand_right", 16, 23, 0.746},   {"hand34", 34, 40, 1.037},
      {"motoman_sia10d", 7, 10, 432.886},   {"sia10d_shadow", 31, 42, 436.680}};
  for (const Row& row : table) {
    INFO(row.name);
    const std::string path = shared_path("data/models/" + row.name + ".urdf");
    const std::string oracle = shared_path("data/models/oracle/" + row.name + ".json");
    if (path.empty() || oracle.empty()) {
      WARN("no shared model " << row.name << ": not checked");
      continue;
    }
    const UrdfModel<double> model = value_of(read_urdf(path));
    CHECK(model.tree.nv() == row.dof);
    CHECK(model.tree.nq() == row.dof);
    CHECK(model.tree.links().size() == row.links);
    CHECK(std::abs(model.mass - row.mass) < 0.00051);
    CHECK(model.warnings.empty());
    std::ifstream file(oracle);
    std::stringstream json;
    json << file.rdbuf();
    const std::vector<std::string> order = strings_under(json.str(), "joint_order");
    std::vector<std::string> joints;
    for (const Body<double>& body : model.tree.bodies()) joints.push_back(body.name);
    CHECK(joints == order);
    CHECK(model.tree.lower().minCoeff() > -4);
    CHECK(model.tree.upper().maxCoeff() < 4);
    const UrdfModel<float> single = value_of(read_urdf<float>(path));
    CHECK(single.tree.nv() == row.dof);
    CHECK(std::abs(static_cast<double>(single.mass) - row.mass) < 0.001);
  }
}

TEST_CASE("URDF: every kind of joint is read with limits, damping and friction", "[urdf]") {
  const UrdfModel<double> model = parsed(full_robot());
  const KinematicTree<double>& tree = model.tree;
  CHECK(model.name == "everything");
  CHECK(model.warnings.empty());
  CHECK(model.weightless_links == std::vector<std::string>{"marker"});
  CHECK(model.mass == Approx(6.3));
  REQUIRE(tree.bodies().size() == 5);
  CHECK(tree.nv() == 9);  // lift, turn, bend (leads curl), fly
  CHECK(tree.nq() == 10);
  CHECK(body_of(model, "lift").type == JointType::Prismatic);
  CHECK(body_of(model, "turn").type == JointType::Revolute);
  CHECK(body_of(model, "bend").type == JointType::Revolute);
  CHECK(body_of(model, "fly").type == JointType::Free);
  CHECK(tree.find_joint("mount") == -1);
  const Index lift = body_of(model, "lift").velocity, turn = body_of(model, "turn").velocity,
              bend = body_of(model, "bend").velocity, fly = body_of(model, "fly").velocity;
  CHECK(tree.lower()[lift] == -0.5);
  CHECK(tree.upper()[lift] == 1.5);
  CHECK(tree.effort_limits()[lift] == 100);
  CHECK(tree.velocity_limits()[lift] == 2);
  CHECK(is_unbounded(tree.lower()[turn]));
  CHECK(is_unbounded(tree.upper()[turn]));
  CHECK(tree.effort_limits()[turn] == 3);
  CHECK(tree.velocity_limits()[turn] == 4);
  CHECK(is_unbounded(tree.effort_limits()[fly]));
  CHECK(model.damping[lift] == 0.5);
  CHECK(model.friction[lift] == 0.25);
  CHECK(model.damping[turn] == 0);
  CHECK(model.damping[bend] == Approx(0.1 + 0.25 * 0.4));
  CHECK(model.friction[bend] == Approx(0.02 + 0.5 * 0.04));
  CHECK(model.damping.segment(fly, 6).isZero(0));
  // The limits of a follower narrow the leader's: -1 <= -0.5 q + 0.1 <= 1.
  CHECK(tree.lower()[bend] == -1);
  CHECK(tree.upper()[bend] == 2);
  const Body<double>& curl = body_of(model, "curl");
  CHECK(curl.follows);
  CHECK(curl.ratio == -0.5);
  CHECK(curl.offset == 0.1);
  CHECK(curl.velocity == bend);
}

TEST_CASE("URDF: origin and axis give the frames", "[urdf]") {
  const UrdfModel<double> model = parsed(full_robot());
  BodyPoses<double> body_poses(model.tree);
  VectorX<double> q = model.tree.neutral();
  q[body_of(model, "lift").position] = 0.7;
  forward_kinematics<double>(model.tree, q, body_poses);
  // rpy = (0.3, -0.2, 0.1): the third column of Rz(0.1) Ry(-0.2) Rx(0.3).
  const double sr = std::sin(0.3), cr = std::cos(0.3), sp = std::sin(-0.2), cp = std::cos(-0.2),
               sy = std::sin(0.1), cy = std::cos(0.1);
  const Vector3<double> z(cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr),
      start(0.1, 0.2, 0.3);
  const Pose<double> carriage = link_pose(model.tree, body_poses, model.tree.find_link("carriage"));
  CHECK((carriage.p - start - 0.7 * z).norm() < 1e-15);
  CHECK((carriage.R.col(2) - z).norm() < 1e-15);
  CHECK((carriage.R.col(0) - Vector3<double>(cy * cp, sy * cp, -sp)).norm() < 1e-15);
  const Pose<double> plate = link_pose(model.tree, body_poses, model.tree.find_link("plate"));
  CHECK((plate.p - carriage * Vector3<double>(0, 0.1, 0)).norm() < 1e-15);
  CHECK((plate.R.col(0) - carriage.R.col(1)).norm() < 1e-15);
  // The axis of `bend` has length sqrt 2. A quarter turn about (1, 1, 0) maps x to (0.5, 0.5, -sqrt
  // 0.5).
  q[body_of(model, "bend").position] = std::acos(0.0);
  forward_kinematics<double>(model.tree, q, body_poses);
  const Pose<double> finger = link_pose(model.tree, body_poses, model.tree.find_link("finger"));
  CHECK((finger.R.col(0) - plate.R * Vector3<double>(0.5, 0.5, -std::sqrt(0.5))).norm() < 1e-14);
}

TEST_CASE("URDF: links with fixed joints keep mass, centre and tensor", "[urdf]") {
  const UrdfModel<double> model = parsed(full_robot());
  // Computed by hand in the carriage's frame: the plate is rotated by 90 degrees about z, at (0,
  // 0.1, 0).
  Matrix3<double> I, R, Rz;
  I << 0.02, 0.001, -0.002, 0.001, 0.03, 0.003, -0.002, 0.003, 0.025;
  const double sr = std::sin(0.1), cr = std::cos(0.1), sp = std::sin(0.2), cp = std::cos(0.2),
               sy = std::sin(0.3), cy = std::cos(0.3);
  Matrix3<double> Z, Y, X;
  Z << cy, -sy, 0, sy, cy, 0, 0, 0, 1;
  Y << cp, 0, sp, 0, 1, 0, -sp, 0, cp;
  X << 1, 0, 0, 0, cr, -sr, 0, sr, cr;
  R = Z * Y * X;
  Rz << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const Vector3<double> one(0.01, -0.02, 0.03), other(0, 0.1, 0.05), com = (3 * one + other) / 4;
  const auto steiner = [](double m, const Vector3<double>& d) -> Matrix3<double> {
    return m * (d.squaredNorm() * Matrix3<double>::Identity() - d * d.transpose());
  };
  const Matrix3<double> plate = Vector3<double>(0.004, 0.005, 0.006).asDiagonal();
  const Matrix3<double> tensor = R * I * R.transpose() + steiner(3, one - com) +
                                 Rz * plate * Rz.transpose() + steiner(1, other - com);
  const Body<double>& body = body_of(model, "lift");
  // The z axis of the body's frame is the axis of the joint; here it is that of the link.
  CHECK(body.inertia.mass == 4);
  CHECK((body.inertia.com - com).norm() < 1e-16);
  CHECK((body.inertia.about_com - tensor).norm() < 1e-16);
}

TEST_CASE("URDF: couplings passed as arguments act like <mimic>", "[urdf]") {
  const std::string links =
      link_text("a") + link_text("b", inertial_text()) + link_text("c", inertial_text());
  const std::string limit = "<limit lower=\"0\" upper=\"1\" effort=\"1\" velocity=\"1\"/>";
  const std::string plain = robot_text(links + joint_text("k", "revolute", "b", "c", limit) +
                                       joint_text("j", "revolute", "a", "b", limit));
  const std::string with_mimic =
      replaced(plain, limit, limit + "<mimic joint=\"j\" multiplier=\"2\" offset=\"-0.25\"/>");
  const UrdfModel<double> mimic = parsed(with_mimic);
  const UrdfModel<double> coupled = parsed(plain, UrdfOptions<double>().couple("k", "j", 2, -0.25));
  for (const UrdfModel<double>* model : {&mimic, &coupled}) {
    CHECK(model->tree.nv() == 1);
    CHECK(model->tree.coupled());
    CHECK(body_of(*model, "k").ratio == 2);
    CHECK(body_of(*model, "k").offset == -0.25);
    CHECK(model->tree.lower()[0] == 0.125);
    CHECK(model->tree.upper()[0] == 0.625);
  }
  CHECK(parsed(plain).tree.nv() == 2);
  CHECK(parsed<float>(plain, UrdfOptions<float>().couple("k", "j")).tree.nv() == 1);

  CHECK(refusal(with_mimic, UrdfOptions<double>().couple("k", "j")) ==
        "f.urdf:5: coupling of \"k\" to \"j\": the joint already follows \"j\"");
  CHECK(refusal(plain, UrdfOptions<double>().couple("x", "j")) ==
        "f.urdf:1: coupling of \"x\" to \"j\": there is no joint \"x\"");
  CHECK(refusal(plain, UrdfOptions<double>().couple("k", "y")) ==
        "f.urdf:1: coupling of \"k\" to \"y\": there is no joint \"y\"");
  CHECK(refusal(plain, UrdfOptions<double>().couple("k", "j").couple("j", "k")) ==
        "f.urdf:9: joint \"j\": its leaders follow each other in a circle");
  CHECK(refusal(plain, UrdfOptions<double>().couple("k", "j", 0)) ==
        "f.urdf:5: joint \"k\": its ratio to its leader is zero");
  CHECK(refusal(plain, UrdfOptions<double>().couple("k", "j", 1, 5)) ==
        "f.urdf:5: joint \"k\": its limits and its leader's have no position in common");
}

TEST_CASE("URDF: the included hand reads with two finger joints coupled", "[urdf]") {
  const std::string path = shared_path("data/models/shadow_hand_right.urdf");
  if (path.empty()) {
    WARN("no shared models: not checked");
    return;
  }
  UrdfOptions<double> options;
  for (const std::string finger : {"rh_FF", "rh_MF", "rh_RF", "rh_LF"})
    options.couple(finger + "J1", finger + "J2");
  const UrdfModel<double> model = value_of(read_urdf(path, options));
  CHECK(model.tree.nv() == 20);
  CHECK(model.tree.bodies().size() == 24);
  CHECK(body_of(model, "rh_FFJ1").velocity == body_of(model, "rh_FFJ2").velocity);
}

TEST_CASE("URDF: wrong connections of links are refused with their line", "[urdf]") {
  const std::string a = link_text("a"), b = link_text("b"), c = link_text("c");
  const auto fixed = [](const std::string& name, const std::string& parent,
                        const std::string& child) {
    return joint_text(name, "fixed", parent, child);
  };
  CHECK(refusal(robot_text("")) == "f.urdf:1: the robot has no links");
  CHECK(refusal(robot_text(a + b + fixed("j", "x", "b"))) ==
        "f.urdf:5: joint \"j\": <parent>: there is no link \"x\"");
  CHECK(refusal(robot_text(a + b + fixed("j", "a", "y"))) ==
        "f.urdf:6: joint \"j\": <child>: there is no link \"y\"");
  CHECK(refusal(robot_text(a + b)) ==
        "f.urdf:3: link \"b\": no joint moves it, and none moves link \"a\" in line 2: a robot has "
        "one root");
  CHECK(refusal(robot_text(a + b + c + fixed("j", "a", "c") + fixed("k", "b", "c"))) ==
        "f.urdf:11: joint \"k\": <child>: link \"c\" is already moved by joint \"j\"");
  CHECK(refusal(robot_text(a + fixed("j", "a", "a"))) == "f.urdf:3: joint \"j\" is part of a loop");
  CHECK(refusal(robot_text(a + b + fixed("j", "a", "b") + fixed("k", "b", "a"))) ==
        "f.urdf:8: joint \"k\" is part of a loop");
  const std::string beside =
      refusal(robot_text(a + b + c + fixed("j", "c", "b") + fixed("k", "b", "c")));
  CHECK((beside == "f.urdf:5: joint \"j\" is part of a loop" ||
         beside == "f.urdf:9: joint \"k\" is part of a loop"));
  CHECK(refusal(robot_text(a + b + b)) == "f.urdf:4: link \"b\": occurs twice, first in line 3");
  CHECK(refusal(robot_text(a + b + c + fixed("j", "a", "b") + fixed("j", "a", "c"))) ==
        "f.urdf:9: joint \"j\": occurs twice, first in line 5");
  const std::string mimic = "<mimic joint=\"nobody\"/>\n";
  CHECK(refusal(pair_text("continuous", mimic)) ==
        "f.urdf:7: joint \"j\": <mimic>: there is no joint \"nobody\"");
  CHECK(refusal(pair_text("continuous", "<mimic joint=\"j\"/>\n")) ==
        "f.urdf:4: joint \"j\": its leaders follow each other in a circle");
  CHECK(refusal(pair_text("fixed", "<mimic joint=\"j\"/>\n")) ==
        "f.urdf:4: joint \"j\": a fixed joint cannot follow another");
  CHECK(parsed(robot_text(a)).tree.nv() == 0);
}

TEST_CASE("URDF: finite numbers whose combination overflows are refused", "[urdf]") {
  const auto chain = [](const std::string& origin) {
    return robot_text(link_text("a") + link_text("b", inertial_text()) +
                      link_text("c", inertial_text()) +
                      joint_text("j", "continuous", "a", "b", origin) +
                      joint_text("k", "fixed", "b", "c", origin));
  };
  CHECK(parsed(chain("<origin xyz=\"1 0 0\"/>")).tree.nv() == 1);
  CHECK(refusal(chain("<origin xyz=\"1e200 0 0\"/>")) == "f.urdf:5: joint \"j\": numbers overflow");
  const std::string heavy = replaced(replaced(chain(""), "value=\"2\"", "value=\"1e308\""),
                                     "value=\"2\"", "value=\"1e308\"");
  CHECK(refusal(heavy) == "f.urdf:5: joint \"j\": numbers overflow");
  CHECK(refusal_of(parse_urdf<float>(chain("<origin xyz=\"1e30 0 0\"/>"), "f.urdf")) ==
        "f.urdf:5: joint \"j\": numbers overflow");
}

TEST_CASE("URDF: unusual parts of a file give warnings", "[urdf]") {
  const auto warnings = [](const std::string& text) { return parsed(text).warnings; };
  using Lines = std::vector<std::string>;
  CHECK(warnings(pair_text("continuous", "")).empty());
  CHECK(warnings(pair_text("revolute", "")) ==
        Lines{"f.urdf:4: joint \"j\": has no <limit>: it moves without limits"});
  CHECK(warnings(pair_text("prismatic", "<limit lower=\"0\" upper=\"1\"/>\n")) ==
        Lines{"f.urdf:7: joint \"j\": <limit> has no effort: it is unlimited",
              "f.urdf:7: joint \"j\": <limit> has no velocity: it is unlimited"});
  CHECK(warnings(pair_text("revolute", "<limit effort=\"0\" velocity=\"1\"/>\n")) ==
        Lines{"f.urdf:7: joint \"j\": <limit> effort is zero",
              "f.urdf:7: joint \"j\": <limit> has neither lower nor upper: both are 0 by the "
              "format's rule"});
  CHECK(warnings(pair_text("continuous", "<limits lower=\"0\"/>\n")) ==
        Lines{"f.urdf:7: joint \"j\": <limits> is not read"});
  CHECK(warnings("<robot><link name=\"a\"/><loop/><x:y/></robot>") ==
        Lines{"f.urdf:1: <robot> has no name", "f.urdf:1: <loop> is not read"});
  CHECK(warnings(robot_text(link_text("a") + link_text("b") +
                            joint_text("j", "continuous", "a", "b"))) ==
        Lines{"f.urdf:4: joint \"j\": the links it moves have no mass"});
  CHECK(
      warnings(replaced(pair_text("continuous", ""), "izz=\"0.015\"", "izz=\"0.04\"")) ==
      Lines{
          "f.urdf:3: link \"b\": <inertia> is not that of a body: its principal moments are 0.01, "
          "0.02, 0.04"});
  CHECK(warnings(replaced(pair_text("continuous", ""), "izz=\"0.015\"", "izz=\"0.03\"")).empty());
}

TEST_CASE("URDF: files are read, and unreadable files are reported", "[urdf]") {
  const std::string path = "clothctl_test_robot.urdf";
  std::ofstream(path, std::ios::binary) << pair_text("hinge", "");
  CHECK(refusal_of(read_urdf(path))
            .rfind(path + ":4: joint \"j\": <joint> type: \"hinge\" is unknown", 0) == 0);
  std::ofstream(path, std::ios::binary) << pair_text("fixed", "");
  CHECK(read_urdf(path).has_value());
  std::ofstream(path, std::ios::binary) << "";
  CHECK(refusal_of(read_urdf(path)) == path + ":1: the file is empty");
  std::remove(path.c_str());
  CHECK(refusal_of(read_urdf(path)).rfind(path + ": cannot be opened (", 0) == 0);
  CHECK(refusal_of(read_urdf(".")).rfind(".: cannot be ", 0) == 0);
}

TEST_CASE("URDF: an impossible inertia is refused with file, line, link and value", "[urdf]") {
  for (const char* attribute : {"ixy", "ixz", "iyz"}) {
    const std::string text =
        replaced(pair_text("continuous", ""), std::string(attribute) + "=\"0\"",
                 std::string(attribute) + "=\"1e38\"");
    INFO(text);
    const std::string error = refusal(text);
    CHECK(error.find("f.urdf:3: link \"b\": inertia tensor is not that of a body: entry " +
                     std::string(attribute + 1) + " is 1e+38") == 0);
  }
}
