#include "clothctl/robot/hand34.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "clothctl/math/rotation.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/kinematic_tree_builder.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

const std::vector<std::string> kFingers = {"index", "middle", "ring", "little"};

struct Hand {
  KinematicTree<double> tree = hand34<double>();
  BodyPoses<double> body_poses{tree};
  std::mt19937 random{34};

  VectorX<double> anywhere() {
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    VectorX<double> q(tree.nq());
    for (Index i = 0; i < q.size(); ++i)
      q[i] = tree.lower()[i] + uniform(random) * (tree.upper()[i] - tree.lower()[i]);
    return q;
  }
  Index entry(const std::string& joint) const {
    return tree.bodies()[static_cast<std::size_t>(tree.find_joint(joint))].position;
  }
  Pose<double> pose(const VectorX<double>& q, const std::string& link) {
    REQUIRE(tree.find_link(link) >= 0);
    forward_kinematics<double>(tree, q, body_poses);
    return link_pose(tree, body_poses, tree.find_link(link));
  }
  /// Motion of a link when one joint rotates a little from rest.
  Vector3<double> moved(const std::string& joint, const std::string& link) {
    VectorX<double> q = VectorX<double>::Zero(tree.nq());
    const Vector3<double> before = pose(q, link).p;
    q[entry(joint)] = 0.01;
    return pose(q, link).p - before;
  }
};

}  // namespace

TEST_CASE("hand34: 34 joints, 40 links, one kilogram", "[robot][hand34]") {
  const Hand hand;
  CHECK(hand.tree.nv() == 34);
  CHECK(hand.tree.nq() == 34);
  CHECK(hand.tree.bodies().size() == 34);
  CHECK(hand.tree.links().size() == 40);
  CHECK_FALSE(hand.tree.coupled());
  double mass = 0;
  for (const Body<double>& body : hand.tree.bodies()) {
    mass += body.inertia.mass;
    CHECK(body.inertia.mass > 0);
    // Moments of inertia that a body can have.
    const Vector3<double> m = body.inertia.about_com.diagonal();
    CHECK((m.minCoeff() > 0 && 2 * m.maxCoeff() <= m.sum() * (1 + 1e-12)));
  }
  CHECK(std::abs(mass - 1.037) < 5e-4);
  for (Index i = 0; i < 34; ++i) {
    CHECK(hand.tree.lower()[i] < hand.tree.upper()[i]);
    CHECK(hand.tree.effort_limits()[i] > 0);
    CHECK(hand.tree.velocity_limits()[i] > 0);
  }
  CHECK(hand34<float>().nv() == 34);
}

TEST_CASE("hand34: at rest it is a right hand with its palm down", "[robot][hand34]") {
  Hand hand;
  const VectorX<double> q = VectorX<double>::Zero(34);
  double side = 1;
  for (const std::string& finger : kFingers) {
    INFO(finger);
    const Pose<double> tip = hand.pose(q, finger + "_tip"),
                       knuckle = hand.pose(q, finger + "_knuckle");
    CHECK((tip.R - Matrix3<double>::Identity()).cwiseAbs().maxCoeff() < 1e-15);
    const Vector3<double> along = tip.p - knuckle.p;
    CHECK(along[0] > 0.07);
    CHECK(std::abs(along[1]) < 1e-15);
    CHECK(along[2] < -0.005);  // the pad is on the palm's side
    CHECK(tip.p[1] < side);    // from the thumb's side to the other
    side = tip.p[1];
    for (const char* joint : {"_cmc", "_mcp_flex", "_pip", "_dip"})
      CHECK(hand.moved(finger + joint, finger + "_tip")[2] < 0);
    CHECK(hand.moved(finger + "_mcp_abd", finger + "_tip")[1] > 0);
  }
  CHECK(hand.pose(q, "thumb_tip").p[1] > hand.pose(q, "index_tip").p[1] + 0.01);
  CHECK(hand.pose(q, "middle_tip").p[0] > hand.pose(q, "index_tip").p[0]);
  CHECK(hand.pose(q, "little_tip").p[0] < hand.pose(q, "ring_tip").p[0]);
}

TEST_CASE("hand34: the mass matrix is positive definite in every pose, even at the gimbal's limit",
          "[robot][hand34]") {
  Hand hand;
  MassMatrixWorkspace<double> work(hand.tree);
  MatrixX<double> M(34, 34);
  double least = 1;
  for (int k = 0; k < 300; ++k) {
    VectorX<double> q = hand.anywhere();
    if (k % 10 == 0) q[hand.entry("base_ry")] = k % 20 == 0 ? 1.45 : -1.45;
    forward_kinematics<double>(hand.tree, q, hand.body_poses);
    mass_matrix<double>(hand.tree, hand.body_poses, work, M);
    CHECK((M - M.transpose()).cwiseAbs().maxCoeff() == 0);
    REQUIRE(Eigen::LLT<MatrixX<double>>(M).info() == Eigen::Success);
    const double smallest =
        Eigen::SelfAdjointEigenSolver<MatrixX<double>>(M, Eigen::EigenvaluesOnly).eigenvalues()[0];
    least = (std::min)(least, smallest);
    CHECK(std::abs(M(0, 0) - 1.037) < 5e-4);  // along x the whole hand slides
  }
  INFO("least eigenvalue " << least);
  CHECK(least > 1e-7);
}

TEST_CASE("hand34: the thumb's pad reaches the pad of every finger", "[robot][hand34]") {
  Hand hand;
  IkSettings<double> settings;
  settings.tolerance = 1e-7;
  InverseKinematics<KinematicTree<double>> ik(hand.tree, 2, settings);
  const auto uniform = [&] {
    return std::uniform_real_distribution<double>(0.0, 1.0)(hand.random);
  };
  const std::vector<FingerTip<double>> tips = hand34_tips<double>();
  const VectorX<double> home = hand34_home(hand.tree);
  const auto task = [&](const FingerTip<double>& tip, const Vector3<double>& target) {
    return IkTask<double>::position(hand.tree.find_link(tip.contact_link), tip.contact_point,
                                    target);
  };
  for (std::size_t f = 1; f < tips.size(); ++f) {
    INFO(tips[f].finger);
    VectorX<double> q = home;
    const Vector3<double> meeting =
        0.5 * (hand.pose(q, tips[0].link).p + hand.pose(q, tips[f].link).p);
    CHECK((hand.pose(q, tips[0].link).p - meeting).norm() > 0.01);
    const std::vector<IkTask<double>> tasks = {task(tips[0], meeting), task(tips[f], meeting)};
    const IkReport<double> report = ik.solve(hand.tree, tasks, VectorX<double>(), q, 20, uniform);
    CHECK(report.status == IkStatus::Reached);
    CHECK((q - hand.tree.lower()).minCoeff() >= 0);
    CHECK((hand.tree.upper() - q).minCoeff() >= 0);
    q.head(8) = home.head(8);  // base and wrist as at home: they move both pads together
    CHECK((hand.pose(q, tips[0].link).p - hand.pose(q, tips[f].link).p).norm() < 1e-6);
  }
}

TEST_CASE("hand34: tips are frames of the tree, thumb first", "[robot][hand34]") {
  Hand hand;
  const VectorX<double> q = hand.anywhere();
  const std::vector<FingerTip<double>> tips = hand34_tips<double>();
  REQUIRE(tips.size() == 5);
  CHECK(tips[0].finger == "thumb");
  for (std::size_t k = 0; k < 5; ++k) {
    if (k > 0) CHECK(tips[k].finger == kFingers[k - 1]);
    const Vector3<double> frame = hand.pose(q, tips[k].link).p;
    CHECK((frame - hand.pose(q, tips[k].contact_link) * tips[k].contact_point).norm() < 1e-15);
  }
}

TEST_CASE("hand34: capsules run from joint to joint, and contact points lie inside near the skin",
          "[robot][hand34]") {
  const Hand hand;
  const std::vector<Capsule<double>> shape = hand34_capsules<double>();
  const KinematicTreeBuilder<double> builder = hand34_builder<double>();
  CHECK(shape.size() == 23);
  std::set<std::string> links;
  for (const Capsule<double>& capsule : shape) {
    links.insert(capsule.link);
    CHECK(hand.tree.find_link(capsule.link) >= 0);
    CHECK(capsule.radius > 0);
    // A bone's capsule ends at the next joint of the chain.
    for (const Joint<double>& joint : builder.joints()) {
      const bool on_finger =
          capsule.link != "palm" && capsule.link != "forearm" && joint.type != JointType::Fixed;
      if (on_finger && joint.parent == capsule.link)
        CHECK((joint.origin.p - capsule.to).norm() == 0);
    }
  }
  CHECK(links.size() == 21);
  for (const FingerTip<double>& tip : hand34_tips<double>()) {
    const auto bone = std::find_if(shape.begin(), shape.end(),
                                   [&](const auto& c) { return c.link == tip.contact_link; });
    REQUIRE(bone != shape.end());
    const double t = std::clamp(tip.contact_point[0], bone->from[0], bone->to[0]);
    const double inside = bone->radius - (tip.contact_point - Vector3<double>(t, 0, 0)).norm();
    CHECK(inside > 0);
    CHECK(inside < 0.0015);
  }
}

TEST_CASE("hand34: home is within the limits, and is found by name in a larger robot",
          "[robot][hand34]") {
  const Hand hand;
  const VectorX<double> home = hand34_home(hand.tree);
  CHECK((home - hand.tree.lower()).minCoeff() >= 0);
  CHECK((hand.tree.upper() - home).minCoeff() >= 0);
  CHECK(home[hand.entry("base_tz")] == 0.2);
  CHECK(home[hand.entry("ring_pip")] == 0.6);
  CHECK(home[hand.entry("thumb_ip")] == 0.3);
  CHECK(home[hand.entry("wrist_flex")] == 0);
  // On a rail, with one joint that follows another, and one that is renamed and so not found.
  KinematicTreeBuilder<double> larger;
  const KinematicTreeBuilder<double> own = hand34_builder<double>();
  larger.add_link("rail");
  for (const auto& link : own.links()) larger.add_link(link.name, link.inertia);
  Joint<double> rail;
  rail.name = "slide";
  rail.type = JointType::Prismatic;
  rail.parent = "rail";
  rail.child = "world";
  rail.limits.lower = 0.5;
  larger.add_joint(rail);
  for (Joint<double> joint : own.joints()) {
    if (joint.name == "index_dip") joint.leader = "index_pip";
    if (joint.name == "base_tz") joint.name = "lift";
    larger.add_joint(joint);
  }
  const KinematicTree<double> tree = larger.build().value();
  const VectorX<double> q = hand34_home(tree);
  REQUIRE(q.size() == 34);
  CHECK(q[0] == 0.5);
  CHECK(q[3] == 0);  // the renamed joint
  const Body<double>& pip = tree.bodies()[static_cast<std::size_t>(tree.find_joint("index_pip"))];
  CHECK(q[pip.position] == 0.6);
}

TEST_CASE("the base of hand34 is turned and placed as told, also at its gimbal lock", "[robot]") {
  const KinematicTree<double> tree = hand34<double>();
  using Traits = articulated_traits<KinematicTree<double>>;
  auto work = Traits::make_workspace(tree);
  const Vector3<double> origin(0.1, -0.2, 0.3);
  for (const double pitch : {0.0, 0.7, -1.2, 2.0, 0.5 * std::acos(-1.0), -0.5 * std::acos(-1.0)}) {
    for (const double roll : {0.0, 0.5, -2.0}) {
      for (const double yaw : {0.0, 1.0, -3.0}) {
        const Matrix3<double> R = rotation_exp<double>(Vector3<double>(0, 0, yaw)) *
                                  rotation_exp<double>(Vector3<double>(0, pitch, 0)) *
                                  rotation_exp<double>(Vector3<double>(roll, 0, 0));
        VectorX<double> q = hand34_pinch(tree);
        REQUIRE(hand34_place_base<double>(tree, R, origin, q));
        Traits::forward_kinematics(tree, q, work);
        Matrix3<double> now;
        Vector3<double> p;
        Traits::frame_pose(tree, work, tree.find_link("palm"), now, p);
        CHECK((now - R).norm() < 1e-7);
      }
    }
  }
  VectorX<double> q = hand34_pinch(tree);
  const VectorX<double> before = q;
  CHECK_FALSE(hand34_place_base<double>(tree, 2 * Matrix3<double>::Identity(), origin, q));
  CHECK_FALSE(hand34_place_base<double>(tree, Matrix3<double>::Identity(),
                                        Vector3<double>(0, std::nan(""), 0), q));
  CHECK(q == before);
}

TEST_CASE("a base with a joint that follows another is not placed", "[hand34]") {
  for (const bool follows : {false, true}) {
    KinematicTreeBuilder<double> robot;
    std::string parent = "world";
    robot.add_link(parent);
    for (const char* name : {"base_tx", "base_ty", "base_tz", "base_rz", "base_ry", "base_rx"}) {
      Joint<double> joint;
      joint.name = name;
      joint.type = joint.name[5] == 't' ? JointType::Prismatic : JointType::Revolute;
      joint.parent = parent;
      joint.child = parent = joint.name + "_link";
      joint.axis = Vector3<double>::UnitX();
      joint.limits = {-3, 3, 1, 1};
      if (follows && joint.name == "base_rx") joint.leader = "base_rz";
      robot.add_link(parent).add_joint(joint);
    }
    const KinematicTree<double> tree = robot.build().value();
    VectorX<double> q = tree.neutral();
    const VectorX<double> before = q;
    const Matrix3<double> R = rotation_from_roll_pitch_yaw<double>(0.3, 0.2, 0.1);
    CHECK(hand34_place_base<double>(tree, R, Vector3<double>(1, 2, 3), q) != follows);
    CHECK((q == before) == follows);
  }
}
