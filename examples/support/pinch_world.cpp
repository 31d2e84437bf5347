#include "support/pinch_world.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/collision/shapes.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/robot/hand34.hpp"
#include "support/pad_ways.hpp"

namespace program {

using clothctl::Index;
using clothctl::RigidMotion;

namespace {

using Vector = PinchWorld::Vector;
using Samples = std::vector<clothctl::PadSample<double>>;

constexpr double kPi = 3.14159265358979323846;
using Robot = clothctl::articulated_traits<clothctl::KinematicTree<double>>;

const char* const kTips[] = {"index_distal", "thumb_distal"};

/// Four samples on a radius of 5 mm around `centre`, in the plane of the unit vectors u and v.
Samples four_samples(const Vector& centre, const Vector& u, const Vector& v, const Vector& normal) {
  Samples out;
  for (const double a : {0.25, 0.75, 1.25, 1.75}) {
    const Vector place = centre + 0.005 * (std::cos(a * kPi) * u + std::sin(a * kPi) * v);
    out.push_back({place, normal});
  }
  return out;
}

template <class Model, class Settings>
std::string add_sheet(clothctl::World<double>& world,
                      const clothctl::SpringNetwork<double>& network, const Settings& settings,
                      const clothctl::WorldSheetSetup<double>& setup) {
  auto model = Model::create(network, settings);
  if (!model) return model.error();
  auto state = model->rest_state();
  const auto added = world.add_sheet(std::move(*model), std::move(state), setup);
  return added ? std::string() : added.error();
}

/// A rail along x, a wrist that turns about y, and two fingers that close along y.
clothctl::KinematicTree<double> gripper() {
  clothctl::KinematicTreeBuilder<double> robot;
  clothctl::Inertia<double> body;
  body.mass = 0.05;
  body.about_com.diagonal().setConstant(1e-5);
  robot.add_link("world");
  const auto add = [&](const char* name, clothctl::JointType type, const char* parent,
                       const char* child, const Vector& axis, double effort) {
    clothctl::Joint<double> joint;
    joint.name = name;
    joint.type = type;
    joint.parent = parent;
    joint.child = child;
    joint.axis = axis;
    joint.limits = {-1e3, 1e3, 1e3, effort};
    robot.add_link(child, body).add_joint(joint);
  };
  add("rail", clothctl::JointType::Prismatic, "world", "carriage", Vector(1, 0, 0), 1e4);
  add("wrist", clothctl::JointType::Revolute, "carriage", "palm", Vector(0, 1, 0), 1e4);
  add("back", clothctl::JointType::Prismatic, "palm", "back_finger", Vector(0, 1, 0), 1e4);
  add("front", clothctl::JointType::Prismatic, "palm", "front_finger", Vector(0, -1, 0), 1e4);
  return robot.build().value();
}

clothctl::SphereCollider<double> finger() {
  return clothctl::SphereCollider<double>::create(Vector::Zero(), 0.004).value();
}

}  // namespace

clothctl::Result<std::unique_ptr<PinchWorld>> PinchWorld::create(
    const PinchSheet& sheet, const clothctl::Material<double>& material, const PinchMotion& motion,
    const clothctl::PadSettings<double>& pad) {
  const auto grid = clothctl::make_grid<double>(sheet.side, sheet.side, sheet.size, sheet.size);
  if (!grid) return clothctl::Error{grid.error()};
  const auto network = clothctl::sheet_network(*grid, material);
  if (!network) return clothctl::Error{network.error()};
  std::unique_ptr<PinchWorld> out(new PinchWorld);
  out->motion_ = motion;
  out->settings_ = pad;
  out->triangles_ = network->triangles;
  out->rest_ = network->rest_positions;
  out->springs_ = network->springs;
  out->inside_ = out->rest_.col(grid->vertex(grid->rows - 1, 0)) + Vector(0.015, 0, -0.015);
  clothctl::WorldSheetSetup<double> setup;
  setup.substeps = sheet.substeps;
  std::string bad;
  if (sheet.model == "xpbd") {
    auto settings = clothctl::PositionBasedSettings<double>::of(material);
    settings.stretch_limit = sheet.cap;
    settings.substeps = std::max(1, settings.substeps / sheet.substeps);
    bad = add_sheet<clothctl::PositionBased<double>>(out->world_, *network, settings, setup);
  } else {
    auto settings = clothctl::MassSpringSettings<double>::of(material);
    if (sheet.integration == "newton") settings.integration = clothctl::Integration::Newton;
    bad = add_sheet<clothctl::MassSpring<double>>(out->world_, *network, settings, setup);
  }
  if (bad.empty() && motion.pads == "paths") bad = out->add_paths();
  if (bad.empty() && motion.pads == "gripper") bad = out->add_gripper();
  if (bad.empty() && motion.pads == "hand") bad = out->add_hand();
  if (!bad.empty()) return clothctl::Error{bad};
  return out;
}

double PinchWorld::way(double t) const { return motion_.amplitude * (1 - std::cos(4 * kPi * t)); }

double PinchWorld::turn(double t) const { return 0.5 * motion_.twist * (1 - std::cos(kPi * t)); }

double PinchWorld::closed(double t) { return std::min(1.0, 5 * t); }

RigidMotion<double> PinchWorld::pose(std::size_t k, double t, double dt) const {
  const double side = k == 0 ? 1 : -1, most = motion_.force / settings_.stiffness;
  const double overlap = most * closed(t), deeper = most * closed(t + dt) - overlap;
  RigidMotion<double> out;
  out.R_world_body = clothctl::rotation_exp<double>(Vector(0, turn(t), 0));
  if (k == 1) out.R_world_body *= clothctl::rotation_exp<double>(Vector(0, 0, kPi));
  out.position = inside_ + Vector(way(t), side * overlap, 0);
  out.velocity = Vector(way(t + dt) - way(t), side * deeper, 0) / dt;
  out.angular_velocity = Vector(0, (turn(t + dt) - turn(t)) / dt, 0);
  return out;
}

std::string PinchWorld::add_pads(const std::array<int, 2>& carriers,
                                 const std::array<Samples, 2>& samples) {
  for (std::size_t k = 0; k < 2; ++k) {
    const auto added = world_.add_pad(carriers[k], samples[k], settings_);
    if (!added) return added.error();
  }
  return {};
}

std::string PinchWorld::add_paths() {
  std::array<int, 2> carriers{};
  for (std::size_t k = 0; k < 2; ++k) {
    const auto added = world_.add_obstacle(finger(), pose(k, 0, 1));
    if (!added) return added.error();
    carriers[k] = *added;
  }
  const Samples pad =
      four_samples(Vector::Zero(), Vector(1, 0, 0), Vector(0, 0, 1), Vector(0, 1, 0));
  return add_pads(carriers, {pad, pad});
}

std::string PinchWorld::add_gripper() {
  tree_ = gripper();
  clothctl::HandSetup<double> setup;
  setup.positions = clothctl::VectorX<double>::Zero(4);
  setup.control.kp = Eigen::Vector4d(1e4, 100, 0, 0);
  setup.control.kd = Eigen::Vector4d(1e3, 10, 5, 5);
  const auto hand = world_.add_hand(tree_, setup);
  if (!hand) return hand.error();
  std::array<int, 2> carriers{};
  std::array<Samples, 2> samples;
  for (std::size_t k = 0; k < 2; ++k) {
    const Vector normal(0, k == 0 ? 1 : -1, 0);
    const int frame = tree_.find_link(k == 0 ? "back_finger" : "front_finger");
    const auto added = world_.add_link_shape(*hand, frame, finger());
    if (!added) return added.error();
    carriers[k] = *added;
    samples[k] = four_samples(inside_, Vector(1, 0, 0), Vector(0, 0, 1), normal);
  }
  return add_pads(carriers, samples);
}

std::string PinchWorld::add_hand() {
  tree_ = clothctl::hand34<double>();
  // Tips that differ from their paths by 0.1 mm shear the pads by a tenth of what holds the sheet.
  clothctl::IkSettings<double> settings;
  settings.tolerance = 1e-6;
  ik_ = std::make_unique<clothctl::InverseKinematics<clothctl::KinematicTree<double>>>(tree_, 4,
                                                                                       settings);
  q_ = clothctl::hand34_home(tree_);
  q_[tree_.bodies()[static_cast<std::size_t>(tree_.find_joint("base_rx"))].position] = 0.5 * kPi;
  q_.head<3>() = inside_ + Vector(-0.17, 0, 0.05);
  work_ = std::make_unique<clothctl::KinematicTreeWorkspace<double>>(Robot::make_workspace(tree_));
  place_tips();
  if (tip_error_ > 1e-4) return "the hand does not reach the sheet";
  clothctl::HandSetup<double> setup;
  setup.positions = q_;
  setup.control = clothctl::StablePdSettings<double>::uniform(tree_.nv());
  const auto hand = world_.add_hand(tree_, setup);
  if (!hand) return hand.error();
  std::array<int, 2> carriers{-1, -1};
  for (const auto& capsule : clothctl::hand34_capsules<double>()) {
    auto shape =
        clothctl::CapsuleCollider<double>::create(capsule.from, capsule.to, capsule.radius);
    if (!shape) return shape.error();
    const auto added = world_.add_link_shape(*hand, tree_.find_link(capsule.link), *shape);
    if (!added) return added.error();
    for (std::size_t k = 0; k < 2; ++k) {
      if (capsule.link == kTips[k]) carriers[k] = *added;
    }
  }
  std::array<Samples, 2> samples;
  for (std::size_t k = 0; k < 2; ++k) {
    const Vector normal = R_tip_[k].transpose() * Vector(0, k == 0 ? 1 : -1, 0);
    const Vector u = normal.cross(Vector(1, 0, 0)).normalized();
    samples[k] = four_samples(tip_[k], u, normal.cross(u), normal);
  }
  return add_pads(carriers, samples);
}

void PinchWorld::place_tips() {
  // A round fingertip touches where its surface faces the other one. How the fingers are turned
  // then is where they stay.
  const auto shape = clothctl::hand34_capsules<double>();
  const auto tips = clothctl::hand34_tips<double>();  // thumb, index, ...
  for (std::size_t k = 0; k < 2; ++k) {
    tip_[k] = tips[1 - k].contact_point;
    R_tip_[k] = clothctl::Matrix3<double>::Zero();
  }
  for (int round = 0; round < 20; ++round) {
    reach(0);
    R_tip_ = R_now_;
    for (std::size_t k = 0; k < 2; ++k) {
      double radius = 0;
      for (const auto& capsule : shape) {
        if (capsule.link == kTips[k]) radius = capsule.radius;
      }
      const Vector normal = R_tip_[k].transpose() * Vector(0, k == 0 ? 1 : -1, 0);
      tip_[k] = Vector(tips[1 - k].contact_point.x(), 0, 0) + radius * normal;
    }
  }
  tip_error_ = 0;
  reach(0);
}

void PinchWorld::reach(double t) {
  using IkTask = clothctl::IkTask<double>;
  std::vector<IkTask> tasks;
  const clothctl::Matrix3<double> turned = clothctl::rotation_exp<double>(Vector(0, turn(t), 0));
  for (std::size_t k = 0; k < 2; ++k) {
    const int frame = tree_.find_link(kTips[k]);
    tasks.push_back(IkTask::position(frame, tip_[k], pose(k, t, 1).position));
    if (R_tip_[k].isZero()) {
      tasks.push_back(
          IkTask::pointing(frame, Vector(0, 0, -1), pose(k, t, 1).R_world_body.col(1), 0.002));
    } else {
      tasks.push_back(IkTask::orientation(frame, turned * R_tip_[k], 0.002));
    }
  }
  (void)ik_->solve(tree_, tasks, q_, q_);
  Robot::forward_kinematics(tree_, q_, *work_);
  for (std::size_t k = 0; k < 2; ++k) {
    Vector p;
    Robot::frame_pose(tree_, *work_, tree_.find_link(kTips[k]), R_now_[k], p);
    tip_error_ = std::max(tip_error_, (p + R_now_[k] * tip_[k] - pose(k, t, 1).position).norm());
  }
}

void PinchWorld::drive(double t, double dt) {
  if (motion_.pads == "none") return;
  if (motion_.pads == "paths") {
    for (std::size_t k = 0; k < 2; ++k)
      (void)world_.set_motion(static_cast<int>(k), pose(k, t, dt));
    return;
  }
  clothctl::HandDrive<double>& drive = world_.drive(0);
  if (motion_.pads == "gripper") {
    drive.target.head<2>() = Eigen::Vector2d(way(t + dt), turn(t + dt));
    drive.target_velocity.head<2>() =
        Eigen::Vector2d(way(t + dt) - way(t), turn(t + dt) - turn(t)) / dt;
    drive.torque.tail<2>().setConstant(motion_.force * closed(t + dt));
    return;
  }
  const clothctl::VectorX<double> before = q_;
  reach(t + dt);
  drive.target = q_;
  drive.target_velocity = (q_ - before) / dt;
}

bool PinchWorld::step(double dt) {
  report_ = world_.step(dt);
  return report_.advanced;
}

double PinchWorld::stretch() const {
  double most = 0;
  const Points& x = state().positions;
  for (const auto& s : springs_) {
    if (s.kind == clothctl::SpringKind::Structural)
      most = std::max(most, (x.col(s.a) - x.col(s.b)).norm() / s.rest_length - 1);
  }
  return most;
}

PinchWorld::Points PinchWorld::touched() const {
  const std::array<int, 2> pads{0, 1};  // none where there are none
  const std::size_t count = static_cast<std::size_t>(std::min(2, world_.pad_count()));
  return touched_at_rest(world_, {pads.data(), count}, kSamples / 2, rest_);
}

std::size_t PinchWorld::contact_count() const {
  std::size_t count = 0;
  for_each_contact([&](int, const auto&) { ++count; });
  return count;
}

PinchWorld::Vector PinchWorld::mean_offset() const {
  Vector sum = Vector::Zero();
  for_each_contact([&](int, const auto& contact) { sum += contact.offset; });
  return sum / std::max<double>(1, static_cast<double>(contact_count()));
}

void PinchWorld::mark() {
  marked_ = touched();
  marked_offset_ = mean_offset();
}

double PinchWorld::slip() const {
  if (marked_.cols() == 0) return 0;
  return mean_way(touched() - marked_) + (mean_offset() - marked_offset_).norm();
}

double PinchWorld::sample_slip() const {
  if (marked_.cols() == 0) return 0;
  const Points ways = touched() - marked_;
  double most = 0;
  for (Index k = 0; k < ways.cols(); ++k) {
    if (ways.col(k).allFinite()) most = std::max(most, ways.col(k).norm());
  }
  return most;
}

double PinchWorld::normal_force(double dt) const {
  double sum = 0;
  for_each_contact([&](int, const auto& c) { sum += c.impulse.dot(c.normal); });
  return 0.5 * sum / dt;
}

double PinchWorld::friction_use() const {
  double normal = 0, tangential = 0;
  for_each_contact([&](int, const auto& c) {
    const double lift = c.impulse.dot(c.normal);
    normal += lift;
    tangential += (c.impulse - lift * c.normal).norm();
  });
  return normal > 0 ? tangential / (settings_.friction * normal) : 0;
}

PinchWorld::Points PinchWorld::places() const {
  Points out = Points::Zero(3, kSamples);
  for_each_contact([&](int k, const auto& c) { out.col(4 * k + c.sample) = c.place; });
  return out;
}

PinchWorld::Points PinchWorld::forces(double dt) const {
  Points out = Points::Zero(3, kSamples);
  for_each_contact([&](int k, const auto& c) { out.col(4 * k + c.sample) = c.impulse / dt; });
  return out;
}

}  // namespace program
