#include "clothctl/grasp/fingertip_tracker.hpp"

#include <cmath>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/grasp/hand_geometry.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/grasping.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Vec = Vector3<double>;
using Tracker = FingertipTracker<Hand34>;

HandDrive<double> drive_of(const Hand34& tree) {
  const VectorX<double> still = VectorX<double>::Zero(tree.nv());
  return {VectorX<double>::Zero(tree.nq()), still, still};
}

/// Targets where the tips of thumb and index are, moved by `way`.
std::vector<FingertipTarget<double>> targets_at(Tracker& tracker, const Vec& way) {
  std::vector<FingertipTarget<double>> out(2);
  for (int f = 0; f < 2; ++f) {
    auto& t = out[static_cast<std::size_t>(f)];
    t.finger = f;
    tracker.pose(f, t.R_world_frame, t.place);
    t.place += way;
  }
  return out;
}

}  // namespace

TEST_CASE("fingertips follow a moving target, and the base carries them", "[grasp]") {
  const Hand34 tree = hand34<double>();
  const auto geometry = hand34_geometry(tree);
  Tracker tracker = Tracker::create(tree, geometry.fingers).value();
  const VectorX<double> start = hand34_pinch(tree);
  REQUIRE(tracker.start(start));
  HandDrive<double> drive = drive_of(tree);
  const auto first = targets_at(tracker, Vec::Zero());
  for (int i = 1; i <= 100; ++i) {
    auto targets = first;
    for (auto& t : targets) t.place += Vec(0.003 * i, 0.001 * i, -0.001 * i);
    const auto report = tracker.track(targets, 0.02, drive);
    REQUIRE(report.error < 2e-4);
  }
  // 0.3 m: more than fingers reach. The base has gone there, the fingers are as they were.
  CHECK(drive.target.head<3>().isApprox((start.head<3>() + Vec(0.3, 0.1, -0.1)).eval(), 0.01));
  CHECK((drive.target.tail(26) - start.tail(26)).cwiseAbs().maxCoeff() < 0.05);
  CHECK(drive.target_velocity.head<3>().isApprox(Vec(0.15, 0.05, -0.05), 0.05));
}

TEST_CASE("the torques that are fed forward are those of the motion and of the forces", "[grasp]") {
  const Hand34 tree = hand34<double>();
  Tracker tracker = Tracker::create(tree, hand34_geometry(tree).fingers).value();
  const VectorX<double> start = hand34_pinch(tree);
  REQUIRE(tracker.start(start));
  HandDrive<double> drive = drive_of(tree);

  // At rest with a force: Jᵀ f, seen at the base, is the force and its moment.
  auto targets = targets_at(tracker, Vec::Zero());
  targets[0].force = Vec(0.5, -1, 2);
  REQUIRE(tracker.track(targets, 0.02, drive).error < 1e-9);
  CHECK((drive.torque.head<3>() - Vec(0.5, -1, 2)).norm() < 1e-12);

  // A base that starts along x needs M a: the mass of all that it carries.
  REQUIRE(tracker.start(start));
  VectorX<double> q = start;
  q[0] += 0.02 * 0.1;
  REQUIRE(tracker.move_to(q, 0.02, drive));
  double mass = 0;
  for (const auto& body : tree.bodies()) mass += body.inertia.mass;
  CHECK(drive.torque[0] == Approx(mass * 0.1 / 0.02).epsilon(1e-9));
  CHECK(drive.torque[1] == Approx(0).margin(1e-9));

  // A base that goes on turning needs what inverse dynamics says of its velocities.
  REQUIRE(tracker.start(start));
  q = start;
  for (int i = 0; i < 2; ++i) {
    q[4] += 0.02 * 1.5;
    REQUIRE(tracker.move_to(q, 0.02, drive));
  }
  using Traits = articulated_traits<Hand34>;
  auto work = Traits::make_workspace(tree);
  Traits::forward_kinematics(tree, q, work);
  const VectorX<double> none = VectorX<double>::Zero(tree.nv());
  VectorX<double> turning = none, still = none, velocity = none;
  velocity[4] = 1.5;
  Traits::inverse_dynamics(tree, velocity, none, work, turning);
  Traits::inverse_dynamics(tree, none, none, work, still);
  REQUIRE((turning - still).norm() > 0.01);
  CHECK((drive.torque - (turning - still)).norm() < 1e-9);
}

TEST_CASE("a finger is as strong as its weakest joint", "[grasp]") {
  const Hand34 tree = hand34<double>();
  Tracker tracker = Tracker::create(tree, hand34_geometry(tree).fingers).value();
  REQUIRE(tracker.start(hand34_pinch(tree)));
  const Vec press = Vec(1, 0, 0);
  const double most = tracker.largest_force(0, press);
  CHECK(most > 1);
  CHECK(most < 250);  // of the base
  // With that force one joint is at its limit, and none beyond.
  HandDrive<double> drive = drive_of(tree);
  auto targets = targets_at(tracker, Vec::Zero());
  targets[0].force = most * press;
  REQUIRE(tracker.track(targets, 0.02, drive).error < 1e-9);
  auto work = articulated_traits<Hand34>::make_workspace(tree);
  const VectorX<double> still = VectorX<double>::Zero(tree.nv());
  VectorX<double> gravity = still;
  using Traits = articulated_traits<Hand34>;
  Traits::forward_kinematics(tree, tracker.positions(), work);
  Traits::inverse_dynamics(tree, still, still, work, gravity);
  const VectorX<double> share =
      (drive.torque + gravity).cwiseAbs().cwiseQuotient(tree.effort_limits());
  CHECK(share.maxCoeff() == Approx(1).epsilon(1e-9));
  CHECK(tracker.largest_force(0, Vec::Zero()) == 0);
  CHECK(tracker.largest_force(99, Vec(0, 0, 1)) == 0);
}

TEST_CASE("joints keep to their largest speed, and free fingers go to the posture", "[grasp]") {
  const Hand34 tree = hand34<double>();
  FingertipSettings<double> settings;
  settings.joint_speed = 0.5;
  Tracker tracker = Tracker::create(tree, hand34_geometry(tree).fingers, settings).value();
  const VectorX<double> start = hand34_pinch(tree);
  REQUIRE(tracker.start(start));
  HandDrive<double> drive = drive_of(tree);
  VectorX<double> posture = start;
  const auto joint = [&](const char* name) {
    return tree.bodies()[static_cast<std::size_t>(tree.find_joint(name))].position;
  };
  posture[joint("middle_pip")] += 0.4;  // a finger without a target
  posture[0] += 0.2;                    // the base, which carries all fingers: has no posture
  REQUIRE(tracker.set_posture(posture));
  auto targets = targets_at(tracker, Vec(0.1, 0, 0));
  for (int i = 0; i < 40; ++i) {
    (void)tracker.track(targets, 0.02, drive);
    CHECK(drive.target_velocity.cwiseAbs().maxCoeff() <= 0.5 + 1e-12);
  }
  CHECK(drive.target[joint("middle_pip")] == Approx(posture[joint("middle_pip")]).margin(0.02));
  CHECK(drive.target[0] - start[0] == Approx(0.1).margin(0.01));
}

TEST_CASE("half-spaces keep a finger above a table", "[grasp]") {
  const Hand34 tree = hand34<double>();
  const auto geometry = hand34_geometry(tree);
  Tracker tracker = Tracker::create(tree, geometry.fingers).value();
  REQUIRE(tracker.start(hand34_pinch(tree)));
  Matrix3<double> R;
  Vec middle;
  tracker.pose(2, R, middle);  // the middle finger, which has no target
  const HalfSpace<double> plane{geometry.fingers[2].frame, geometry.fingers[2].centre(),
                                Vec(0, 0, 1), middle.z() - 0.002};
  const std::vector<HalfSpace<double>> planes{plane};
  REQUIRE(tracker.set_half_spaces(planes) == "");
  HandDrive<double> drive = drive_of(tree);
  Vec thumb, now;
  tracker.pose(0, R, thumb);
  for (int i = 1; i <= 20; ++i) {
    const auto targets = targets_at(tracker, Vec(0, 0, -0.001));
    const long since = allocations();
    const auto report = tracker.track(targets, 0.02, drive);
    const long allocated = allocations() - since;
    if (i > 1 && allocation_counting_works()) CHECK(allocated == 0);
    CHECK(report.status != IkStatus::InvalidInput);
    CHECK(report.error < 1e-3);
  }
  tracker.pose(2, R, now);
  CHECK(now.z() > middle.z() - 0.0021);
  tracker.pose(0, R, now);
  CHECK(now.z() == Approx(thumb.z() - 0.02).margin(2e-3));

  // What is refused is named, and those that were set stay.
  std::vector<HalfSpace<double>> bad{plane, plane};
  bad[1].frame = 999;
  CHECK(tracker.set_half_spaces(bad) == "half-space 1: a plane's frame does not exist");
  bad[1] = plane;
  bad[1].normal = Vec(0, 0, 2);
  CHECK(tracker.set_half_spaces(bad) == "half-space 1: a plane's normal is not a unit vector");
  bad.assign(65, plane);
  CHECK(tracker.set_half_spaces(bad) == "65 half-spaces, at most 64");
  for (int i = 1; i <= 5; ++i)
    (void)tracker.track(targets_at(tracker, Vec(0, 0, -0.001)), 0.02, drive);
  tracker.pose(2, R, now);
  CHECK(now.z() > middle.z() - 0.0021);
}

TEST_CASE("a hand reaches as far as the joints of its base", "[grasp]") {
  const Hand34 tree = hand34<double>();
  Tracker tracker = Tracker::create(tree, hand34_geometry(tree).fingers).value();
  const VectorX<double> start = hand34_pinch(tree);
  REQUIRE(tracker.start(start));
  const Vec place(0.3, -0.2, 0.7);
  GripLimit<double> limits[8];
  const long before = allocations();
  const std::size_t count = tracker.reach(1, place, limits);
  const long taken = allocations() - before;
  if (allocation_counting_works()) CHECK(taken == 0);
  REQUIRE(count == 6);  // two a slider
  for (std::size_t i = 0; i < count; ++i) {
    const GripLimit<double>& limit = limits[i];
    CHECK(limit.validate(2).empty());
    CHECK(limit.grip == 1);
    CHECK(limit.other == -1);
    Index axis = 0;
    CHECK(limit.normal.cwiseAbs().maxCoeff(&axis) == Approx(1));
    const double room = limit.normal[axis] > 0 ? tree.upper()[axis] - start[axis]
                                               : start[axis] - tree.lower()[axis];
    CHECK(limit.most - limit.normal.dot(place) == Approx(room).epsilon(1e-6));
    if (i == 0) continue;
    CHECK(limit.most - limit.normal.dot(place) >=
          limits[i - 1].most - limits[i - 1].normal.dot(place));
  }
  // Fewer are the nearest ones; a place that is not finite has none.
  GripLimit<double> nearest[2];
  REQUIRE(tracker.reach(1, place, nearest) == 2);
  for (int i : {0, 1}) CHECK(nearest[i].most == limits[i].most);
  CHECK(tracker.reach(1, Vec(0, std::nan(""), 0), limits) == 0);
  CHECK(tracker.reach(1, place, {}) == 0);

  // Beside a limit, and at it.
  VectorX<double> q = start;
  q[1] = tree.upper()[1] - 0.01;
  REQUIRE(tracker.start(q));
  REQUIRE(tracker.reach(0, place, limits) == 6);
  CHECK(limits[0].normal.dot(Vec(0, 1, 0)) == Approx(1));
  CHECK(limits[0].most == Approx(place[1] + 0.01).epsilon(1e-6));
  q[1] = tree.upper()[1];
  REQUIRE(tracker.start(q));
  REQUIRE(tracker.reach(0, place, limits) == 6);
  CHECK(limits[0].most == Approx(place[1]).epsilon(1e-6));
  // Joints that do not move the hand along limit nothing, also at their limits.
  q = start;
  for (Index i = 3; i < 6; ++i) q[i] = tree.upper()[i];
  REQUIRE(tracker.start(q));
  REQUIRE(tracker.reach(0, place, limits) == 6);
  for (const GripLimit<double>& limit : std::span(limits).first(6))
    CHECK(limit.most - limit.normal.dot(place) > 0.1);
}

TEST_CASE("a joint that moves all fingers apart does not carry the hand", "[grasp]") {
  // A slide along x, and two jaws on it that close along y; the right one follows the left one.
  KinematicTreeBuilder<double> builder;
  Inertia<double> body;
  body.mass = 0.1;
  body.about_com.diagonal().setConstant(1e-4);
  builder.add_link("world");
  const auto add = [&](const char* name, const char* parent, const Vec& axis, double most) {
    Joint<double> joint;
    joint.name = name;
    joint.type = JointType::Prismatic;
    joint.parent = parent;
    joint.child = name + std::string("_link");
    joint.axis = axis;
    joint.limits = {-most, most, 1, 100};
    if (joint.name == "right") joint.leader = "left";
    builder.add_link(joint.child, body).add_joint(joint);
  };
  add("slide", "world", Vec(1, 0, 0), 2);
  add("left", "slide_link", Vec(0, 1, 0), 0.05);
  add("right", "slide_link", Vec(0, -1, 0), 0.05);
  const KinematicTree<double> tree = builder.build().value();
  std::vector<FingerPad<double>> pads(2);
  pads[0].frame = tree.find_link("left_link");
  pads[1].frame = tree.find_link("right_link");
  Tracker tracker = Tracker::create(tree, pads).value();
  REQUIRE(tracker.start(VectorX<double>::Zero(2)));
  GripLimit<double> limits[8];
  REQUIRE(tracker.reach(0, Vec::Zero(), limits) == 2);
  for (int i : {0, 1}) {
    CHECK(std::abs(limits[i].normal.x()) == Approx(1));
    CHECK(limits[i].most == Approx(2));
  }
}

namespace {

/// A joint of a base: its type, its axis, and how far along x it is from the one before, m.
struct BaseJoint {
  JointType type;
  Vec axis;
  double x = 0;
};

/// The limits of the reach of two jaws on a base, `x` m from its last joint, where its joints are
/// at `q` and have the limits -most and most.
template <class Scalar>
std::vector<GripLimit<Scalar>> limits_of(const std::vector<BaseJoint>& joints, double x,
                                         double most, std::vector<double> q = {}) {
  KinematicTreeBuilder<Scalar> builder;
  Inertia<Scalar> body;
  body.mass = Scalar(0.1);
  body.about_com.diagonal().setConstant(Scalar(1e-4));
  builder.add_link("world");
  const auto add = [&](const std::string& name, const std::string& parent, const BaseJoint& at) {
    Joint<Scalar> joint;
    joint.name = name;
    joint.type = at.type;
    joint.parent = parent;
    joint.child = name + "_link";
    joint.axis = at.axis.cast<Scalar>();
    joint.origin.p = Vector3<Scalar>(Scalar(at.x), 0, 0);
    joint.limits = {Scalar(-most), Scalar(most), 1, 100};
    builder.add_link(joint.child, body).add_joint(joint);
    return joint.child;
  };
  std::string base = "world";
  for (std::size_t i = 0; i < joints.size(); ++i)
    base = add("base" + std::to_string(i), base, joints[i]);
  add("left", base, {JointType::Prismatic, Vec(0, 0, 1), x});
  add("other", base, {JointType::Prismatic, Vec(0, 0, -1), x});
  const KinematicTree<Scalar> tree = builder.build().value();
  std::vector<FingerPad<Scalar>> pads(2);
  pads[0].frame = tree.find_link("left_link");
  pads[1].frame = tree.find_link("other_link");
  auto tracker = FingertipTracker<KinematicTree<Scalar>, Scalar>::create(tree, pads).value();
  VectorX<Scalar> start = VectorX<Scalar>::Constant(tree.nv(), Scalar(0));
  for (std::size_t i = 0; i < q.size(); ++i) start[static_cast<Index>(i)] = Scalar(q[i]);
  REQUIRE(tracker.start(start));
  std::vector<GripLimit<Scalar>> out(12);
  out.resize(tracker.reach(0, Vector3<Scalar>::Constant(Scalar(0)), out));
  return out;
}

/// How far an arm of two parts of 0.4 m with a wrist may move at least before a joint is at its
/// limit of 2.5 rad, m, to first order.
template <class Scalar>
double nearest_limit(double elbow) {
  const Vec x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  const auto type = JointType::Revolute;
  const std::vector<BaseJoint> arm{{type, z},      {type, y}, {type, y, 0.4},
                                   {type, x, 0.4}, {type, y}, {type, x}};
  const auto limits = limits_of<Scalar>(arm, 0.1, 2.5, {0.3, -0.8, elbow, 0.2, 1});
  REQUIRE(!limits.empty());
  return static_cast<double>(limits[0].most);
}

}  // namespace

TEMPLATE_TEST_CASE("where a base cannot move the hand without a turn there is no reach", "[grasp]",
                   double, float) {
  const BaseJoint turn{JointType::Revolute, Vec(0, 0, 1)};
  CHECK(limits_of<TestType>({turn}, 0.5, 1).empty());
  // Slides, and a turn on a slide adds nothing to them.
  for (const Vec& way : {Vec(1, 1, 0), Vec(3, -1, 2), Vec(0.2, 1, 5)}) {
    const BaseJoint slide{JointType::Prismatic, way.normalized()};
    for (const auto& base : {std::vector<BaseJoint>{slide}, {slide, turn}}) {
      const auto limits = limits_of<TestType>(base, 0.5, 1);
      const bool is_float = sizeof(TestType) == sizeof(float);
      // In float, rounding in place of a zero may add limits that are far away.
      REQUIRE(2 <= limits.size());
      CHECK((is_float || limits.size() == 2));
      for (std::size_t i = 0; i < limits.size(); ++i) {
        const auto most = static_cast<double>(limits[i].most);
        if (2 <= i) {
          CHECK(20 < most);
          continue;
        }
        CHECK(std::abs(limits[i].normal.template cast<double>().dot(slide.axis)) ==
              Approx(1).epsilon(is_float ? 1e-3 : 1e-9));
        CHECK(most == Approx(1).epsilon(is_float ? 0.02 : 1e-6));
      }
    }
  }
}

TEST_CASE("the reach of an arm shrinks as it stretches, in float, too", "[grasp]") {
  double last = 1;
  for (const double elbow : {1.0, 0.5, 0.2, 0.1, 0.03}) {
    const double most = nearest_limit<double>(elbow);
    CHECK(most < 0.75 * last);
    if (elbow >= 0.1)
      CHECK(nearest_limit<float>(elbow) == Approx(most).epsilon(elbow > 0.1 ? 0.02 : 0.06));
    last = most;
  }
  // Near the end the way along the arm is about in proportion to the angle of the elbow.
  CHECK(nearest_limit<double>(0.003) == Approx(0.1 * last).epsilon(0.05));
}

TEST_CASE("bad targets are refused and change nothing; tracking never allocates", "[grasp]") {
  const Hand34 tree = hand34<double>();
  const auto geometry = hand34_geometry(tree);
  Tracker tracker = Tracker::create(tree, geometry.fingers).value();
  REQUIRE(tracker.start(hand34_pinch(tree)));
  HandDrive<double> drive = drive_of(tree);
  auto targets = targets_at(tracker, Vec(0.001, 0, 0));
  (void)tracker.track(targets, 0.02, drive);
  const long allocated = allocations();
  (void)tracker.track(targets, 0.02, drive);
  const long after = allocations();
  if (allocation_counting_works()) CHECK(after == allocated);

  const VectorX<double> before = tracker.positions();
  const double nan = std::nan("");
  auto bad = targets;
  bad[1].place[1] = nan;
  CHECK(tracker.track(bad, 0.02, drive).status == IkStatus::InvalidInput);
  bad = targets;
  bad[1].force[0] = nan;
  CHECK(tracker.track(bad, 0.02, drive).message == "a force holds NaN or an infinity");
  bad = targets;
  bad[0].finger = 5;
  CHECK(tracker.track(bad, 0.02, drive).message == "a target is for a finger that does not exist");
  CHECK(tracker.track(targets, 0, drive).message == "the step length is not positive");
  HandDrive<double> other;
  CHECK(tracker.track(targets, 0.02, other).message == "the drive is not that of this hand");
  CHECK_FALSE(tracker.move_to(VectorX<double>::Zero(3), 0.02, drive));
  CHECK_FALSE(tracker.start(VectorX<double>::Constant(34, nan)));
  CHECK(tracker.positions() == before);

  CHECK(Tracker::create(tree, {}).error() == "the hand has no finger pads");
  auto fingers = geometry.fingers;
  fingers[1].frame = 999;
  CHECK(Tracker::create(tree, fingers).error() ==
        "finger 1 (index) is on frame 999, which does not exist");
  FingertipSettings<double> settings;
  settings.tolerance = 0;
  CHECK(Tracker::create(tree, geometry.fingers, settings).error() ==
        "tolerance is 0 m, must be finite and positive");
}
