// Random hands, sheets, friction, forces, places, postures, steps and measurements, good and bad,
// and calls in random order. What holds for all of them:
//
// * A failure is a status or words, drives stay finite and within speeds and limits, and the
//   targets of a hand that failed or is free rest at once.
// * What is refused changes nothing. Each set-up runs twice, once with refused calls in between,
//   and both runs must give the same bits: so it is also the same each time.

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/grasp/grasp_controller.hpp"
#include "clothctl/grasp/grasp_poses.hpp"
#include "clothctl/grasp/hand_geometry.hpp"
#include "clothctl/grasp/joint_path_planner.hpp"
#include "clothctl/grasp/robot_clearance.hpp"
#include "clothctl/robot/hand34.hpp"
#include "support/bits.hpp"
#include "support/catch.hpp"
#include "support/pads.hpp"
#include "support/random_bodies.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Vec = Vector3<double>;
using Tree = KinematicTree<double>;
using Traits = articulated_traits<Tree>;
using Controller = GraspController<Tree>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

template <class T, std::size_t n>
const T& pick(Draw& draw, const T (&of)[n]) {
  return of[static_cast<std::size_t>(draw.whole(0, static_cast<int>(n) - 1))];
}

Vec random_direction(Draw& draw) {
  const Vec v = draw.vector(1);
  return v.norm() > 1e-3 ? Vec(v.normalized()) : Vec(0, 0, -1);
}

Matrix3<double> random_turn(Draw& draw, double most) {
  const double angle = draw.uniform(0, most);
  return rotation_exp<double>(angle * random_direction(draw));
}

/// A robot with fingers.
struct Robot {
  Tree tree;
  HandGeometry<double> geometry;
  VectorX<double> home;

  /// Positions within the limits; joints without limits, within 0.5 of home. `share`: of the way
  /// from home.
  VectorX<double> posture(Draw& draw, double share = 1) const {
    VectorX<double> q = home, step(tree.nv());
    for (Index i = 0; i < step.size(); ++i) step[i] = share * draw.uniform(-0.5, 0.5);
    if (tree.nq() != tree.nv()) {
      tree.advance(home, step, q);
      return q;
    }
    for (Index i = 0; i < q.size(); ++i) {
      const bool bounded = tree.upper()[i] - tree.lower()[i] < 100;
      const double to =
          bounded ? draw.uniform(tree.lower()[i], tree.upper()[i]) : home[i] + step[i];
      q[i] += bounded ? share * (to - q[i]) : to - q[i];
    }
    return q;
  }
  bool within_limits(const VectorX<double>& q) const {
    for (Index i = 0; i < q.size(); ++i) {
      const double room = 1e-9 * (1 + std::abs(q[i]));
      if (q[i] < tree.lower()[i] - room || tree.upper()[i] + room < q[i]) return false;
    }
    return true;
  }
};

/// Adds links with random masses.
class RobotMaker {
 public:
  explicit RobotMaker(Draw& draw) : draw_(draw) { builder_.add_link("world"); }

  void add(const std::string& parent, const std::string& child, JointType type, const Vec& axis,
           const Vec& place, JointLimits<double> limits = {}) {
    Inertia<double> body;
    body.mass = draw_.decades(-2, 0);
    body.about_com.diagonal().setConstant(body.mass * draw_.decades(-4, -3));
    Joint<double> joint;
    joint.name = "to_" + child;
    joint.type = type;
    joint.parent = parent;
    joint.child = child;
    joint.axis = axis;
    joint.origin.p = place;
    joint.limits = limits;
    builder_.add_link(child, body).add_joint(joint);
  }
  /// A palm on three sliders, and on three hinges where it turns.
  void add_base(bool turns) {
    JointLimits<double> limits;
    if (draw_.chance(0.6)) limits = {-2, 2, 5, 300};
    const char* const names[] = {"x", "y", "z", "yaw", "pitch", "palm"};
    std::string last = "world";
    for (int k = 0; k < (turns ? 6 : 3); ++k) {
      const std::string name = !turns && k == 2 ? "palm" : names[k];
      add(last, name, k < 3 ? JointType::Prismatic : JointType::Revolute, Vec::Unit(k % 3),
          Vec::Zero(), k < 3 ? limits : JointLimits<double>());
      last = name;
    }
  }
  Tree build() const { return builder_.build().value(); }

 private:
  Draw& draw_;
  KinematicTreeBuilder<double> builder_;
};

/// Two fingers that slide against each other along y.
Robot random_gripper(Draw& draw) {
  RobotMaker maker(draw);
  maker.add_base(false);
  const double gap = draw.uniform(0.03, 0.08), radius = draw.uniform(0.003, 0.01);
  const bool round = draw.chance(0.7);
  Robot out;
  for (const double side : {-1.0, 1.0}) {
    const std::string name = side < 0 ? "back" : "front";
    maker.add("palm", name, JointType::Prismatic, Vec(0, -side, 0), Vec(0, side * gap, 0),
              {-0.01, gap, 1, draw.chance(0.5) ? 50 : kInf});
  }
  out.tree = maker.build();
  for (const double side : {-1.0, 1.0}) {
    const std::string name = side < 0 ? "back" : "front";
    const int link = out.tree.find_link(name);
    const Vec tip(0, 0, -0.05);
    out.geometry.capsules.push_back({link, Vec::Zero(), tip, radius});
    out.geometry.fingers.push_back(
        {name, link, tip - side * radius * Vec::UnitY(), Vec(0, -side, 0), round ? radius : 0});
  }
  out.home = out.tree.neutral();
  return out;
}

/// Three fingers of two or three hinges around a palm, which may float on a free joint.
Robot random_three_fingers(Draw& draw, bool floats) {
  RobotMaker maker(draw);
  if (floats) {
    maker.add("world", "palm", JointType::Free, Vec::UnitX(), Vec::Zero());
  } else {
    maker.add_base(draw.chance(0.7));
  }
  const double palm = draw.uniform(0.02, 0.05), radius = draw.uniform(0.004, 0.01);
  const int bones = draw.whole(2, 3);
  std::vector<double> lengths;
  for (int k = 0; k < bones; ++k) lengths.push_back(draw.uniform(0.02, 0.06));
  Robot out;
  for (int f = 0; f < 3; ++f) {
    const double angle = f == 0 ? M_PI / 2 : (f == 1 ? -0.8 : -2.3);
    const Vec out_of_palm(std::cos(angle), std::sin(angle), 0);
    std::string last = "palm";
    for (int k = 0; k < bones; ++k) {
      const std::string name = "finger" + std::to_string(f) + "_" + std::to_string(k);
      const Vec place =
          k == 0 ? Vec(palm * out_of_palm) : Vec(0, 0, -lengths[static_cast<std::size_t>(k - 1)]);
      maker.add(last, name, JointType::Revolute, Vec::UnitZ().cross(out_of_palm), place,
                {-1.0, 1.2, 10, 5});
      last = name;
    }
  }
  out.tree = maker.build();
  for (int f = 0; f < 3; ++f) {
    const double angle = f == 0 ? M_PI / 2 : (f == 1 ? -0.8 : -2.3);
    const Vec inward(-std::cos(angle), -std::sin(angle), 0);
    for (int k = 0; k < bones; ++k) {
      const std::string name = "finger" + std::to_string(f) + "_" + std::to_string(k);
      const int link = out.tree.find_link(name);
      const Vec end(0, 0, -lengths[static_cast<std::size_t>(k)]);
      out.geometry.capsules.push_back({link, Vec::Zero(), end, radius});
      if (k + 1 == bones)
        out.geometry.fingers.push_back({name, link, end + radius * inward, inward, radius});
    }
  }
  out.home = out.tree.neutral();
  return out;
}

Robot random_robot(Draw& draw) {
  const int kind = draw.whole(0, 9);
  if (kind < 4) return random_gripper(draw);
  if (kind < 8) return random_three_fingers(draw, kind == 7);
  Robot out;
  out.tree = hand34<double>();
  out.geometry = hand34_geometry(out.tree);
  out.home = draw.chance(0.5) ? hand34_home(out.tree) : hand34_pinch(out.tree);
  return out;
}

/// What a run left: a hash of all that it saw, the first law that was broken, and what it met.
struct Outcome {
  std::uint64_t hash = kEmptyHash;
  std::string broken;
  unsigned phases = 0, faults = 0, poses = 0, paths = 0;
  int refused_settings = 0, refused_grasps = 0, refused_calls = 0, contacts = 0;

  void law(bool holds, const std::string& what) {
    if (!holds && broken.empty()) broken = what;
  }
  void note(const VectorX<double>& v) {
    hash = hash_bytes(v.data(), sizeof(double) * static_cast<std::size_t>(v.size()), hash);
  }
  void note(const std::string& text) { hash = hash_bytes(text.data(), text.size(), hash); }
  void add(const Outcome& other) {
    phases |= other.phases;
    faults |= other.faults;
    poses |= other.poses;
    paths |= other.paths;
    refused_settings += other.refused_settings;
    refused_grasps += other.refused_grasps;
    refused_calls += other.refused_calls;
    contacts += other.contacts;
  }
};

template <class Enum>
unsigned bit(Enum value) {
  return 1u << static_cast<unsigned>(value);
}

/// Where fingertips are told to go, and postures, of which one may be bad.
struct PoseRequest {
  std::vector<GraspContact<double>> contacts;
  VectorX<double> pre_shape, grip;
  bool bad = false, beyond_limits = false;
};

PoseRequest random_request(Draw& draw, const Robot& robot, std::size_t fingers) {
  PoseRequest out;
  out.pre_shape = robot.posture(draw, draw.uniform(0, 1));
  out.grip = robot.posture(draw, draw.uniform(0, 1));
  auto work = Traits::make_workspace(robot.tree);
  Traits::forward_kinematics(robot.tree, robot.posture(draw, 0.5), work);
  for (std::size_t i = 0; i < fingers; ++i) {
    const FingerPad<double>& pad = robot.geometry.fingers[i];
    Matrix3<double> R;
    Vec p;
    Traits::frame_pose(robot.tree, work, pad.frame, R, p);
    GraspContact<double> c{p + R * pad.point, Vec((R * pad.normal).normalized()), Vec::Zero()};
    if (draw.chance(0.2)) c.press = random_direction(draw);
    if (draw.chance(0.2)) c.away = random_direction(draw);
    out.contacts.push_back(c);
  }
  GraspContact<double>& one = out.contacts[0];
  const int kind = draw.whole(0, 19);
  out.bad = 6 <= kind && kind <= 12;
  if (kind == 3) one.place += 10 * random_direction(draw);
  if (kind == 4) one.place += 1e12 * random_direction(draw);
  if (kind == 5) one.place = draw.vector(0.5);
  if (kind == 6) one.place[draw.whole(0, 2)] = draw.chance(0.5) ? kNan : kInf;
  if (kind == 7) one.press *= draw.chance(0.5) ? 0.0 : 3.0;
  if (kind == 8) one.away = draw.chance(0.5) ? Vec(0, kNan, 0) : Vec(0, 2, 0);
  if (kind == 9) out.contacts.pop_back();
  if (kind == 10) out.pre_shape[draw.whole(0, static_cast<int>(robot.tree.nq()) - 1)] = kNan;
  if (kind == 11) out.grip.setZero(draw.whole(0, 3));
  if (kind == 12) out.pre_shape = VectorX<double>::Zero(robot.tree.nq() + 1);
  out.beyond_limits = kind == 13 || kind == 14;
  if (kind == 13) out.pre_shape[robot.tree.nq() - 1] = draw.chance(0.5) ? 50 : -50;
  if (kind == 14) out.grip[robot.tree.nq() - 1] = draw.chance(0.5) ? 50 : -50;
  return out;
}

/// Searches poses for a random request. Returns those found, else random ones.
GraspPoses<double> search_poses(Draw& draw, const Robot& robot, Outcome& out) {
  const std::size_t fingers = static_cast<std::size_t>(draw.whole(1, 2));
  const auto first = robot.geometry.fingers.begin();
  const std::vector<FingerPad<double>> pads(first, first + static_cast<std::ptrdiff_t>(fingers));
  const PoseRequest asked = random_request(draw, robot, fingers);
  GraspPoseSettings<double> settings;
  settings.restarts = draw.whole(0, 2);
  const auto found = find_grasp_poses<Tree, double>(robot.tree, pads, asked.contacts,
                                                    asked.pre_shape, asked.grip, settings);
  out.poses |= bit(found.status);
  out.note(found.message);
  const bool refused = found.status == GraspPoseStatus::InvalidInput;
  out.law(refused == asked.bad, "poses are refused where, and only where, their input is bad");
  out.law(found.message.empty() == (found.status == GraspPoseStatus::Found),
          "poses that were not found come with words, others without");
  if (refused) {
    out.law(found.touch.size() == 0 && found.wait.size() == 0, "refused poses are empty");
  } else {
    const std::pair<const VectorX<double>*, double> both[] = {
        {&found.touch, found.touch_errors.maxCoeff()}, {&found.wait, found.wait_errors.maxCoeff()}};
    for (const auto& [q, error] : both) {
      out.law(q->size() == robot.tree.nq() && all_finite(*q) && is_finite(error),
              "poses and their errors are finite");
      out.law(robot.within_limits(*q), "poses are within the limits of the joints");
      if (found.status == GraspPoseStatus::Found)
        out.law(error <= settings.tolerance, "poses that were found reach their places");
      out.note(*q);
    }
  }
  if (found.status == GraspPoseStatus::Found) return found;
  GraspPoses<double> other = found;
  other.touch = robot.posture(draw, draw.chance(0.7) ? 0.1 : 1.0);
  other.wait = robot.home;
  return other;
}

/// Plans a path to a posture above or in a table.
void plan_to(Draw& draw, const Robot& robot, const VectorX<double>& to, Outcome& out) {
  auto clearance = RobotClearance<Tree>::create(robot.tree, robot.geometry.capsules).value();
  (void)clearance.ignore_pairs(robot.home, 2e-3);
  const double top = draw.uniform(-0.4, 0.1);
  const auto table = BoxCollider<double>::create(Vec(0, 0, top - 0.5), Vec(2, 2, 0.5)).value();
  const std::vector<ColliderRef<double>> obstacles{ColliderRef<double>(table)};
  clearance.set_obstacles(obstacles);
  const auto bounds = joint_reach<double>(robot.tree, robot.geometry.capsules);
  if (!bounds) {
    out.law(!bounds.error().empty(), "what has no reach is named");
    return;
  }
  const VectorX<double>& reach = *bounds;
  JointPathSettings<double> settings;
  settings.max_iterations = 10;
  settings.shortcuts = 3;
  settings.step = 0.5;
  VectorX<double> goal = to;
  const int kind = draw.whole(0, 9);
  if (kind == 0) goal[0] = kNan;
  if (kind == 1) goal.conservativeResize(goal.size() - 1);
  const bool bad = kind < 2;
  const auto path = plan_joint_path<double>(robot.home, goal, robot.tree.lower(),
                                            robot.tree.upper(), reach, clearance, settings);
  out.paths |= bit(path.status);
  out.note(path.message);
  out.law(path.message.empty() == (path.status == JointPathStatus::Found),
          "paths that were not found come with words, others without");
  out.law((path.status == JointPathStatus::InvalidInput) == bad, "paths to bad goals are refused");
  if (bad) return;
  if (clearance(robot.home) < settings.margin) {
    out.law(path.status == JointPathStatus::StartCollides, "a start in the table is told");
  } else if (robot.within_limits(goal) && clearance(goal) < settings.margin) {
    out.law(path.status == JointPathStatus::GoalCollides, "a goal in the table is told");
  }
}

GraspSettings<double> random_settings(Draw& draw, bool& bad) {
  GraspSettings<double> s;
  const double friction[] = {0.6, 0.6, 0.6, 1e-9, 1e6, 0, -1, kNan};
  s.friction = pick(draw, friction);
  bad = !(s.friction > 0);
  s.approach_speed = draw.uniform(0.5, 5);
  s.fingertips.joint_speed = draw.uniform(5, 20);
  s.closing_speed = draw.uniform(0.02, 0.1);
  s.time_out = draw.uniform(0.2, 1);
  s.firm_steps = draw.whole(1, 4);
  s.firm_contacts = draw.whole(1, 3);
  if (draw.chance(0.2)) s.fingertips.turn_length = 0;
  if (draw.chance(0.2)) s.fingertips.feed_motion = false;
  if (draw.chance(0.2)) s.most_force = draw.decades(-1, 3);
  double* const numbers[] = {&s.most_depth, &s.stiffness, &s.hold_speed, &s.rest_speed, &s.margin};
  if (draw.chance(0.05)) {
    *pick(draw, numbers) = draw.chance(0.5) ? kNan : -1;
    bad = true;
  }
  return s;
}

/// Spoils one thing of a grasp. `holds`: the hand holds, and may go on without keyframes.
void spoil(Draw& draw, const Robot& robot, bool holds, Grasp<double>& grasp) {
  VectorX<double>& key = grasp.keyframes.back();
  const double numbers[] = {kNan, kInf, 0.0, -1.0, 1e9};
  switch (draw.whole(0, 7)) {
    case 0:
      grasp.fingers.clear();
      grasp.keyframes.clear();
      break;
    case 1: grasp.fingers[0].finger = draw.chance(0.5) ? -1 : 99; break;
    case 2: grasp.fingers.push_back(grasp.fingers[0]); break;
    case 3: grasp.fingers[0].press *= draw.chance(0.5) ? kNan : 2.0; break;
    case 4: grasp.force = pick(draw, numbers); break;
    case 5:
      grasp.keyframes.clear();
      if (holds) grasp.fingers.clear();
      break;
    case 6: key = VectorX<double>::Zero(draw.chance(0.5) ? 0 : robot.tree.nq() + 1); break;
    default: key[draw.whole(0, static_cast<int>(key.size()) - 1)] = draw.chance(0.5) ? kNan : kInf;
  }
}

Grasp<double> random_grasp(Draw& draw, const Robot& robot, const VectorX<double>& touch,
                           double most_force) {
  Grasp<double> out;
  const int fingers = draw.whole(1, 2), first = draw.whole(0, 1);
  for (int f = 0; f < fingers; ++f)
    out.fingers.push_back({(first + f) % 2, Vec(0, f == 0 ? 1 : -1, 0)});
  if (draw.chance(0.3)) out.keyframes.push_back(robot.posture(draw, 0.1));
  out.keyframes.push_back(touch);
  const KeyframeTangents tangents[] = {KeyframeTangents::Monotone, KeyframeTangents::CatmullRom,
                                       KeyframeTangents::Standstill};
  out.tangents = pick(draw, tangents);
  out.together = draw.chance(0.6);
  out.force = most_force * draw.uniform(0.05, 1);
  return out;
}

/// A controller, what drives its hand, and the laws that each step must keep.
struct Watched {
  const Robot& robot;
  GraspSettings<double> settings;
  Controller controller;
  HandDrive<double> drive;
  Outcome& out;
  GraspReport<double> report = {};
  bool overshoots = false;

  Watched(const Robot& r, const GraspSettings<double>& s, Controller c, Outcome& o)
      : robot(r), settings(s), controller(std::move(c)), out(o) {
    const VectorX<double> zero = VectorX<double>::Zero(robot.tree.nv());
    drive = {controller.tracker().positions(), zero, zero};
  }
  GraspReport<double> update(double dt, const HandState<double>& hand,
                             std::span<const PadTouch<double>> felt) {
    const VectorX<double> before = drive.target;
    const GraspPhase old = controller.phase();
    report = controller.update(dt, hand, felt, drive);
    out.phases |= bit(report.phase);
    out.note(drive.target);
    out.note(drive.target_velocity);
    out.note(drive.torque);
    out.law(report.phase == controller.phase(), "a report tells the phase");
    out.law(
        all_finite(drive.target) && all_finite(drive.target_velocity) && all_finite(drive.torque),
        "drives are finite");
    const double most = settings.fingertips.joint_speed * (1 + 1e-9);
    out.law(drive.target_velocity.cwiseAbs().maxCoeff() <= most,
            "targets keep to their largest speed");
    VectorX<double> way(robot.tree.nv());
    robot.tree.difference(before, drive.target, way);
    const double rounding = 1e-9 + 1e-12 * before.cwiseAbs().maxCoeff();
    out.law(way.cwiseAbs().maxCoeff() <= (dt > 0 ? most * dt : 0.0) + rounding,
            "targets go no farther in a step than their speed leads");
    // Those on Catmull-Rom's curves need not, nor those that start there.
    overshoots = overshoots || controller.grasp().tangents == KeyframeTangents::CatmullRom;
    out.law(overshoots || robot.within_limits(drive.target), "targets stay within the limits");
    const std::string words = controller.describe(report);
    out.note(words);
    const bool failed = report.phase == GraspPhase::Failed;
    out.law(failed == !words.empty(), "a failure has words, and nothing else has");
    out.law(failed == (report.fault != GraspFault::Nothing), "a failure has a fault");
    if (failed) out.faults |= bit(report.fault);
    if (failed || report.phase == GraspPhase::Free)
      out.law(drive.target_velocity.isZero(0) && drive.torque.isZero(0),
              "targets of a hand that failed or is free rest");
    out.law(is_finite(report.depth) && std::abs(report.depth) <= settings.most_depth,
            "depths keep to the largest");
    const bool bad = !is_finite(dt) || !(dt > 0) || !all_finite(hand.positions) ||
                     hand.positions.size() != robot.tree.nq() ||
                     hand.velocities.size() != robot.tree.nv();
    if (bad && old != GraspPhase::Failed)
      out.law(report.fault == GraspFault::BadInput, "a bad measurement is a fault");
    return report;
  }
  /// Calls that must be refused, chosen by a source of their own.
  void refused_calls(Draw& draw);
  /// A call that may be refused, and is the same in both runs.
  void any_call(Draw& draw, const VectorX<double>& touch);
};

void Watched::refused_calls(Draw& draw) {
  const Matrix3<double> I = Matrix3<double>::Identity(),
                        bad_R = (draw.chance(0.5) ? kNan : 2.0) * I;
  const Vec bad_t(0, kInf, 0);
  const GraspPhase phase = controller.phase();
  const std::string when = " in phase " + std::string(to_string(phase));
  Grasp<double> grasp = random_grasp(draw, robot, robot.posture(draw), settings.most_force);
  spoil(draw, robot, phase == GraspPhase::Hold, grasp);
  const double forces[] = {kNan, 0, -1, kInf, 2 * settings.most_force};
  FingertipTracker<Tree>& tracker = controller.tracker();
  HandDrive<double> spare = drive;
  const VectorX<double> bad_q = VectorX<double>::Constant(robot.tree.nq(), kNan);
  const FingertipTarget<double> targets[] = {{draw.chance(0.5) ? -1 : 99, Vec::Zero()}};
  bool refused = true;
  switch (draw.whole(0, 9)) {
    case 0: refused = !controller.begin(grasp).empty(); break;
    case 1: refused = !controller.move_to(bad_R, Vec::Zero()); break;
    case 2: refused = !controller.move_by(I, bad_t); break;
    case 3: refused = phase == GraspPhase::Hold || !controller.move_to(I, Vec(1, 0, 0)); break;
    case 4: refused = !controller.set_force(pick(draw, forces)); break;
    case 5: refused = !controller.set_load(draw.chance(0.5) ? -1 : 9, Vec::Zero()); break;
    case 6: refused = !controller.set_load(0, bad_t); break;
    case 7: refused = !tracker.move_to(bad_q, 0.02, spare) && !tracker.set_posture(bad_q); break;
    case 8: refused = tracker.track(targets, 0.02, spare).status == IkStatus::InvalidInput; break;
    default: refused = !tracker.start(bad_q) && !tracker.move_to(robot.home, -1, spare);
  }
  ++out.refused_calls;
  out.law(refused, "bad calls are refused" + when);
  out.law(controller.phase() == phase, "refused calls change no phase");
  out.law(spare.target == drive.target && spare.torque == drive.torque,
          "refused calls change no drive");
}

void Watched::any_call(Draw& draw, const VectorX<double>& touch) {
  const double far_away[] = {0.01, 0.1, 1, 1e12, 1e200};
  const double loads[] = {0, 0.1, 1, 1e12, 1e100};
  Matrix3<double> R;
  Vec t;
  switch (draw.whole(0, 11)) {
    case 0:
    case 1: {
      Grasp<double> grasp = random_grasp(draw, robot, touch, settings.most_force);
      const bool bad = draw.chance(0.3);
      const GraspPhase before = controller.phase();
      if (bad) spoil(draw, robot, before == GraspPhase::Hold, grasp);
      if (!bad && draw.chance(0.2)) grasp.fingers.clear();  // goes elsewhere
      const std::string words = controller.begin(grasp);
      out.note(words);
      out.refused_grasps += words.empty() ? 0 : 1;
      if (bad || robot.within_limits(touch))
        out.law(words.empty() != bad, "grasps are refused where, and only where, they are bad");
      out.law(controller.phase() == (words.empty() ? GraspPhase::Approach : before),
              "a grasp that begins approaches");
      break;
    }
    case 2: controller.release(); break;
    case 3: controller.stop(); break;
    case 4: (void)controller.set_force(settings.most_force * draw.uniform(-0.1, 1.2)); break;
    case 5:
      t = draw.vector(pick(draw, loads));
      (void)controller.set_load(draw.whole(-1, 2), t);
      break;
    case 6:
    case 7:
      R = random_turn(draw, 3);
      t = draw.vector(pick(draw, far_away));
      (void)controller.move_to(R, t);
      break;
    default:
      R = random_turn(draw, 0.1);
      t = draw.vector(0.02);
      (void)controller.move_by(R, t);
  }
}

/// What fingers may feel: springs behind what they touch, nothing, or anything.
std::vector<PadTouch<double>> random_touches(Draw& draw, std::size_t fingers, double depth,
                                             bool sound) {
  std::vector<PadTouch<double>> felt(fingers);
  for (PadTouch<double>& t : felt) {
    t.normal_force = std::max(0.0, 2000 * depth);
    t.contacts = depth > 0 ? 5 : 0;
    t.tangential_force = 0.1 * t.normal_force;
  }
  if (sound || fingers == 0) return felt;
  const double numbers[] = {kNan, kInf, 1e300, -1e300, 1e9, 0};
  switch (draw.whole(0, 3)) {
    case 0: felt.resize(draw.chance(0.5) ? 0 : fingers + 1); break;
    case 1: felt[0].normal_force = pick(draw, numbers); break;
    case 2: felt[0].tangential_force = pick(draw, numbers); break;
    default: felt.back().contacts = felt.back().sliding = draw.whole(0, 9);
  }
  return felt;
}

/// The controller of a random robot with good settings, after bad ones were refused.
Controller make_controller(Draw& draw, const Robot& robot, const VectorX<double>& q,
                           GraspSettings<double>& settings, Outcome& out) {
  bool bad = false;
  settings = random_settings(draw, bad);
  auto made = Controller::create(robot.tree, robot.geometry.fingers, q, settings);
  out.law(made.has_value() != bad, "controllers are refused where their settings are bad");
  if (made) return std::move(made).value();
  out.law(!made.error().empty(), "what is refused is said in words");
  out.note(made.error());
  ++out.refused_settings;
  settings = GraspSettings<double>();
  return Controller::create(robot.tree, robot.geometry.fingers, q, settings).value();
}

/// A set-up without a world: the hand is where it was sent, or is said to be elsewhere.
Outcome run_alone(std::uint64_t seed, bool with_refused) {
  Outcome out;
  Draw draw(seed), refuse(seed + 77777);
  const Robot robot = random_robot(draw);
  const GraspPoses<double> poses = search_poses(draw, robot, out);
  if (draw.chance(0.15)) plan_to(draw, robot, poses.touch, out);
  GraspSettings<double> settings;
  Controller made = make_controller(draw, robot, poses.wait, settings, out);
  Watched hand(robot, settings, std::move(made), out);
  const double odd_steps[] = {0, -0.02, kNan, kInf};
  const double step = draw.chance(0.8) ? draw.uniform(0.02, 0.1) : draw.decades(-4, -1);
  const double surface = draw.chance(0.8) ? draw.uniform(0, 2e-3) : 1.0;
  const bool sound = draw.chance(0.6);                                 // what is measured
  const int slips_off = draw.chance(0.3) ? draw.whole(20, 60) : 1000;  // the sheet does, then
  if (draw.chance(0.8))
    (void)hand.controller.begin(random_grasp(draw, robot, poses.touch, settings.most_force));
  HandState<double> state{poses.wait, VectorX<double>::Zero(robot.tree.nv())};
  for (int k = 0; k < 70; ++k) {
    if (with_refused && refuse.chance(0.2)) hand.refused_calls(refuse);
    if (draw.chance(0.15)) hand.any_call(draw, poses.touch);
    state.positions = hand.controller.tracker().positions();
    HandState<double> seen = state;
    const int kind = sound ? 400 : draw.whole(0, 199);
    if (kind == 0) seen.positions[0] += 0.01;
    if (kind == 1) seen.positions[0] = kNan;
    if (kind == 2) seen.velocities.setZero(1);
    if (kind == 3) seen.positions.setZero(0);
    const double dt = sound || draw.chance(0.99) ? step : pick(draw, odd_steps);
    const std::size_t fingers = hand.controller.grasp().fingers.size();
    const double pressed = k < slips_off ? hand.report.depth - surface : 0.0;
    const auto felt = random_touches(draw, fingers, pressed, sound || draw.chance(0.97));
    if (kind == 4) {  // another hand's drive
      HandDrive<double> other{VectorX<double>::Zero(1), VectorX<double>::Zero(1), {}};
      const bool moves = hand.controller.phase() != GraspPhase::Free;
      hand.report = hand.controller.update(dt, seen, felt, other);
      out.law(other.target.isZero(0) && other.target.size() == 1, "another drive stays");
      out.law(!moves || !hand.controller.describe(hand.report).empty() ||
                  hand.report.phase == GraspPhase::Free,
              "a drive that does not fit has words");
      continue;
    }
    (void)hand.update(dt, seen, felt);
    if (!out.broken.empty()) return out;
  }
  hand.controller.release();
  const double opens = settings.open_distance / settings.closing_speed;
  const std::vector<PadTouch<double>> nothing(hand.controller.grasp().fingers.size());
  for (double t = -0.1; t < opens; t += 0.05) {
    state.positions = hand.controller.tracker().positions();
    (void)hand.update(0.05, state, nothing);
  }
  out.law(hand.controller.phase() == GraspPhase::Free, "a hand that is told to open ends free");
  return out;
}

/// Adds the hand and its parts to a world; pads of bad friction are refused first.
HandInWorld add_hand(Draw& draw, World<double>& world, const Robot& robot, const VectorX<double>& q,
                     Outcome& out) {
  HandSetup<double> setup;
  setup.positions = q;
  setup.control = StablePdSettings<double>::uniform(robot.tree.nv());
  if (draw.chance(0.5)) setup.control.form = PdForm::Implicit;
  const int number = world.add_hand(robot.tree, setup).value();
  HandSurface<double> surface;
  surface.with_pads = {0, 1};
  const double friction[] = {0.6, 0.6, 0, 1e-9, 1e6, kNan, -1};
  surface.pad.friction = pick(draw, friction);
  auto added = add_hand_geometry<double>(world, number, robot.geometry, surface);
  const bool bad = !(surface.pad.friction >= 0);
  out.law(added.has_value() != bad, "pads are refused where their friction is bad");
  if (added) return std::move(added).value();
  out.law(added.error().find("friction") != std::string::npos, "what is refused is named");
  ++out.refused_settings;
  surface.pad.friction = 0.6;
  return add_hand_geometry<double>(world, number, robot.geometry, surface).value();
}

/// The poses of a pinch at a place of the sheet.
GraspPoses<double> pinch_poses(const Robot& robot, const Vec& at) {
  const std::vector<FingerPad<double>> pads{robot.geometry.fingers[0], robot.geometry.fingers[1]};
  const std::vector<GraspContact<double>> places{{at, Vec(0, 1, 0)}, {at, Vec(0, -1, 0)}};
  GraspPoseSettings<double> settings;
  settings.restarts = 1;
  VectorX<double> near_it = robot.home;
  if (robot.tree.find_link("thumb_tip") >= 0)
    near_it = hand34_pinch_at<double>(robot.tree, at, Vec(0, 1, 0), Vec(0, 0, -1));
  return find_grasp_poses<Tree, double>(robot.tree, pads, places, near_it, near_it, settings);
}

/// A step of a world must leave it finite, and as it was where it did not advance.
void step_world(World<double>& world, double dt, Outcome& out) {
  const ClothState<double> sheet = world.state(0);
  const HandState<double> hand = world.hand(0);
  const auto report = world.step(dt);
  out.law(all_finite(world.state(0).positions) && all_finite(world.state(0).velocities),
          "sheets stay finite");
  out.law(all_finite(world.hand(0).positions) && all_finite(world.hand(0).velocities),
          "hands stay finite");
  const bool moved =
      world.state(0).positions != sheet.positions || world.hand(0).positions != hand.positions;
  out.law(report.advanced || !moved, "a step that did not advance changes nothing");
  if (report.status == StepStatus::InvalidInput)
    out.law(!world.check_input(dt).empty() && !report.advanced, "refused steps say why");
  out.note(world.hand(0).positions);
  out.hash =
      hash_bytes(world.state(0).positions.data(),
                 sizeof(double) * static_cast<std::size_t>(sheet.positions.size()), out.hash);
}

/// A set-up in a world, with a sheet of 5x5 to 9x9 vertices.
Outcome run_in_world(std::uint64_t seed, bool with_refused) {
  Outcome out;
  Draw draw(seed), refuse(seed + 77777);
  const Robot robot = random_robot(draw);
  World<double> world;
  const int n = draw.whole(5, 9);
  const Vec at = add_hanging_sheet(world, n);
  if (draw.chance(0.7)) {
    const int pins[] = {n * (n - 1), n * n - 1};
    world.input(0).driven_vertices = {pins[0], pins[1]};
    world.input(0).driven_positions = world.state(0).positions(Eigen::all, pins);
  }
  const GraspPoses<double> poses = pinch_poses(robot, at);
  out.poses |= bit(poses.status);
  GraspSettings<double> settings;
  const VectorX<double> start = draw.chance(0.5) ? poses.wait : poses.touch;
  Controller made = make_controller(draw, robot, start, settings, out);
  Watched hand(robot, settings, std::move(made), out);
  const HandInWorld in = add_hand(draw, world, robot, start, out);
  Grasp<double> grasp = random_grasp(draw, robot, poses.touch, settings.most_force);
  if (draw.chance(0.8)) {
    grasp.fingers = {{0, Vec(0, 1, 0)}, {1, Vec(0, -1, 0)}};
    grasp.keyframes = {poses.touch};
  }
  (void)hand.controller.begin(grasp);
  const double odd_steps[] = {0, -0.02, kNan, kInf};
  const double step = draw.chance(0.7) ? draw.uniform(0.015, 0.04) : draw.decades(-4, -1);
  for (int k = 0; k < 60 && out.broken.empty(); ++k) {
    if (with_refused && refuse.chance(0.2)) hand.refused_calls(refuse);
    if (draw.chance(0.04)) hand.any_call(draw, poses.touch);
    const double dt = draw.chance(0.995) ? step : pick(draw, odd_steps);
    std::vector<PadTouch<double>> felt;
    for (const GraspFinger<double>& f : hand.controller.grasp().fingers) {
      const int pad = in.pads[static_cast<std::size_t>(f.finger)];
      felt.push_back(pad_touch(world, pad, step));
      out.contacts += felt.back().contacts;
    }
    (void)hand.update(dt, world.hand(0), felt);
    world.drive(0) = hand.drive;
    step_world(world, dt, out);
  }
  return out;
}

}  // namespace

TEST_CASE("random grasps fail in words, stay finite, and what is refused changes nothing",
          "[grasp]") {
  Outcome all;
  for (int k = 0; k < trials(180, 9000, 40); ++k) {
    CAPTURE(k);
    const auto seed = static_cast<std::uint64_t>(k + 1);
    const Outcome one = run_alone(seed, true), other = run_alone(seed, false);
    REQUIRE(one.broken == "");
    REQUIRE(other.broken == "");
    REQUIRE(one.hash == other.hash);
    all.add(one);
  }
  CHECK(all.refused_calls > 10);
  CHECK(all.refused_settings > 10);
  CHECK(all.refused_grasps > 10);
  CHECK(all.phases == 0x3f);  // each of the six
  CHECK(all.poses == 0xf);    // each status
  CHECK((all.faults & bit(GraspFault::NoTouch)) != 0);
  CHECK((all.faults & bit(GraspFault::Lost)) != 0);
  CHECK((all.faults & bit(GraspFault::BadInput)) != 0);
  CHECK((all.paths & bit(JointPathStatus::GoalCollides)) != 0);
  CHECK((all.paths & bit(JointPathStatus::InvalidInput)) != 0);
}

TEST_CASE("random grasps in a world with a sheet stay finite", "[grasp]") {
  Outcome all;
  for (int k = 0; k < trials(20, 1000, 5); ++k) {
    CAPTURE(k);
    const auto seed = static_cast<std::uint64_t>(1000001 + k);
    const Outcome one = run_in_world(seed, true), other = run_in_world(seed, false);
    REQUIRE(one.broken == "");
    REQUIRE(other.broken == "");
    REQUIRE(one.hash == other.hash);
    all.add(one);
  }
  CHECK(all.contacts > 0);
  CHECK((all.phases & bit(GraspPhase::Close)) != 0);
}
