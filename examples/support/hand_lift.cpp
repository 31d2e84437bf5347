#include "support/hand_lift.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/grasp/rectify.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/sim/contact_summary.hpp"
#include "support/box_triangles.hpp"
#include "support/hand_bulge.hpp"
#include "support/hand_figures.hpp"
#include "support/random_number.hpp"
#include "support/timing.hpp"

namespace program {

using clothctl::Index;
using Vec = clothctl::Vector3<double>;
using Mat = clothctl::Matrix3<double>;
using Points = clothctl::Points<double>;
using Vector = clothctl::VectorX<double>;

namespace {

const Vec kUp(0, 0, 1), kHalfTable(0.5, 0.5, 0.02);
constexpr double kLevel = 1e-3;   // of the sheet above the table, m
constexpr double kApart = 0.035;  // of each fingertip from the middle at first, m
constexpr double kGap = 4e-3;     // of each from the middle at the end, beside its radius, m
constexpr double kUneven = 5e-4;  // m: cloth is never quite flat; root mean square of its height
constexpr int kRings = 4;         // of samples on a pad
constexpr double kPi = 3.14159265358979323846;

/// Raises a flat sheet (y up) by waves of random ways and lengths from 3 to 8 cm.
void add_waves(std::uint64_t seed, Points& x) {
  constexpr int kWaves = 12;
  std::mt19937_64 random(seed);
  for (int k = 0; k < kWaves; ++k) {
    const double way = kPi * random_number(random), phase = kPi * random_number(random);
    const double number = 2 * kPi / (0.055 + 0.025 * random_number(random));
    for (Index i = 0; i < x.cols(); ++i)
      x(1, i) += kUneven * std::sqrt(2.0 / kWaves) *
                 std::cos(number * (std::cos(way) * x(0, i) + std::sin(way) * x(2, i)) + phase);
  }
}

/// Where thumb (side -1) and index (+1) press, and how the middle of their pads is turned: half
/// down and half towards each other, so that the pads can press and pinch.
clothctl::GraspContact<double> place_of(double side, double radius) {
  clothctl::GraspContact<double> c;
  c.press = Vec(-side, -0.57, -1).normalized();
  c.place = Vec(side * kApart, 0, 2 * kLevel + radius) + radius * c.press;
  c.away = kUp;
  return c;
}

}  // namespace

clothctl::Result<std::unique_ptr<TableLift>> TableLift::create(const LiftOptions& options,
                                                               bool page) {
  std::unique_ptr<TableLift> out(new TableLift(options));
  out->middle_ = Vec(0, 0, 0);
  if (options.seed != 0) {
    std::mt19937_64 random(options.seed);
    LiftOptions& o = out->options_;
    o.friction *= 1 + 0.2 * random_number(random);
    o.table_friction *= 1 + 0.2 * random_number(random);
    const double stiffer = 1 + 0.2 * random_number(random);
    o.material.stretch_warp *= stiffer;
    o.material.stretch_weft *= stiffer;
    o.material.shear *= stiffer;
    o.material.set_bending(o.material.bending_warp * stiffer);
    out->middle_ = Vec(0.005 * random_number(random), 0.005 * random_number(random), 0);
  }
  std::string bad = out->add_sheet();
  if (bad.empty()) bad = out->add_hand();
  if (!bad.empty()) return clothctl::Error{bad};
  if (page) out->begin_page();
  return out;
}

std::string TableLift::add_sheet() {
  const double cell = options_.width / (options_.cols - 1);
  auto grid = clothctl::make_grid<double>(options_.rows, options_.cols, options_.width,
                                          cell * (options_.rows - 1));
  if (!grid) return grid.error();
  grid_ = std::move(*grid);
  add_waves(options_.seed + 1, grid_.positions);
  const auto network = clothctl::sheet_network(grid_, options_.material);
  if (!network) return network.error();
  auto model = clothctl::MassSpring<double>::create(
      *network, clothctl::MassSpringSettings<double>::of(options_.material));
  if (!model) return model.error();
  auto state = model->rest_state();
  const double lowest = grid_.positions.row(1).minCoeff();
  for (Index i = 0; i < state.positions.cols(); ++i)
    state.positions.col(i) =
        Vec(grid_.positions(0, i), grid_.positions(2, i), kLevel + grid_.positions(1, i) - lowest);
  const Vec centre = state.positions.rowwise().mean();
  state.positions.topRows(2).colwise() -= centre.head<2>();
  clothctl::WorldSheetSetup<double> setup;
  setup.meets_sheets = true;
  setup.substeps = 4;  // the sheet snaps: within 20 ms it would go millimetres into the table
  const auto sheet = world_.add_sheet(std::move(*model), std::move(state), setup);
  if (!sheet) return sheet.error();
  auto table = clothctl::BoxCollider<double>::create(Vec(0, 0, -kHalfTable[2]), kHalfTable).value();
  table_ = std::make_unique<clothctl::BoxCollider<double>>(std::move(table));
  clothctl::ColliderSurface<double> surface;
  surface.friction = options_.table_friction;
  const auto obstacle = world_.add_obstacle(*table_, {}, surface);
  if (!obstacle) return obstacle.error();
  for (int i = 0; i < 10; ++i) {
    if (!world_.step(options_.dt).advanced) return "the sheet does not come to rest";
  }
  return {};
}

std::string TableLift::add_hand() {
  tree_ = clothctl::hand34<double>();
  geometry_ = clothctl::hand34_geometry(tree_);
  const std::vector<clothctl::FingerPad<double>> fingers(geometry_.fingers.begin(),
                                                         geometry_.fingers.begin() + 2);
  std::vector<clothctl::GraspContact<double>> places;
  for (int k : {0, 1}) {
    places.push_back(place_of(2 * k - 1, fingers[static_cast<std::size_t>(k)].radius));
    places.back().place += middle_;
  }
  // The palm leans back, so that all bones are above the fingertips.
  const Vec palm = clothctl::rotation_exp<double>(Vec(-0.6, 0, 0)) * Vec(-kUp);
  const Vector shape =
      clothctl::hand34_pinch_at<double>(tree_, middle_ + 0.02 * kUp, Vec(1, 0, 0), palm);
  clothctl::GraspPoseSettings<double> search;
  search.normal_weight = 0.01;
  search.restarts = 0;
  const auto poses =
      clothctl::find_grasp_poses<Hand, double>(tree_, fingers, places, shape, shape, search);
  if (poses.status != clothctl::GraspPoseStatus::Found) return poses.message;
  wait_ = poses.wait;
  touch_ = poses.touch;

  clothctl::HandSetup<double> setup;
  setup.positions = poses.wait;
  setup.control = clothctl::StablePdSettings<double>::uniform(tree_.nv());
  const auto hand = world_.add_hand(tree_, setup);
  if (!hand) return hand.error();
  clothctl::HandSurface<double> surface;
  surface.with_pads = {0, 1};
  surface.pad.friction = options_.friction;
  // Few of the samples touch: those that face the table, and then those that face the other finger.
  surface.pad.stiffness = surface.pad.tangential_stiffness = 40000;
  surface.samples.radius = 1.3 * fingers[0].radius;
  surface.samples.rings = kRings;
  auto parts = clothctl::add_hand_geometry<double>(world_, *hand, geometry_, surface);
  if (!parts) return parts.error();
  parts_ = std::move(*parts);
  contacts_ = std::make_unique<clothctl::StaticContacts<double>>(
      clothctl::StaticContacts<double>::create(world_, 0, {parts_.segments[0], parts_.segments[1]})
          .value());
  clothctl::GraspSettings<double> settings;
  settings.friction = options_.friction;
  settings.approach_speed = 0.2;
  settings.firm_contacts = 1;
  settings.most_force = std::max(5.0, options_.pinch);
  settings.force_share = 0.5;  // layers between fingers shift, and forces with them
  settings.hold_speed = 0.3;
  settings.turn_speed = 0.05;  // what three vertices say of a turn is noise
  auto controller =
      clothctl::GraspController<Hand>::create(tree_, geometry_.fingers, poses.wait, settings);
  if (!controller) return controller.error();
  controller_ = std::make_unique<clothctl::GraspController<Hand>>(std::move(*controller));
  links_ = std::make_unique<clothctl::RobotClearance<Hand>>(
      clothctl::RobotClearance<Hand>::create(tree_, geometry_.capsules).value());
  links_->ignore_pairs(poses.wait, 10);  // m: all
  const std::vector<clothctl::ColliderRef<double>> obstacles{
      clothctl::ColliderRef<double>(*table_)};
  links_->set_obstacles(obstacles);
  std::vector<clothctl::HalfSpace<double>> planes;
  for (const auto& c : geometry_.capsules) {
    if (c.frame == fingers[0].frame || c.frame == fingers[1].frame) continue;
    for (const Vec& end : {c.from, c.to}) planes.push_back({c.frame, end, kUp, c.radius + 4e-3});
  }
  return controller_->tracker().set_half_spaces(planes);
}

std::string TableLift::step() {
  const double dt = options_.dt, start = thread_seconds();
  std::array<clothctl::PadTouch<double>, 2> felt;
  for (std::size_t k : {0, 1}) {
    felt[k] = clothctl::pad_touch(world_, parts_.pads[k], dt);
    // What the table bears is no part of a pinch; and while a fold closes, its layers shift.
    felt[k].normal_force = clothctl::pad_touch(world_, parts_.pads[k], dt, press_[k]).normal_force;
    if (stage_ == "pinch" && controller_->phase() == clothctl::GraspPhase::Close)
      felt[k].sliding = 0, felt[k].tangential_force = 0;
  }
  report_ = controller_->update(dt, world_.hand(parts_.hand), felt, world_.drive(parts_.hand));
  figures_.hand_ms.push_back(1000 * (thread_seconds() - start));
  figures_.phase = to_string(report_.phase);
  if (report_.phase == clothctl::GraspPhase::Failed) return controller_->describe(report_);
  const auto report = world_.step(dt);
  if (!report.advanced)
    return "the world did not advance: " + std::string(to_string(report.status));
  contacts_->update(world_);
  measure(report);
  if (page_) page_->add_frame(world_.state(0).positions, features_, targets_, dt, stage_);
  return {};
}

std::string TableLift::steps(double seconds) {
  for (int i = 0; i < std::lround(seconds / options_.dt); ++i) {
    if (std::string bad = step(); !bad.empty()) return bad;
  }
  return {};
}

void TableLift::measure(const clothctl::WorldReport<double>& report) {
  LiftFigures& f = figures_;
  f.sheet_penetration_max_m = std::max(f.sheet_penetration_max_m, report.penetration);
  f.penetration_max_m = larger(f.penetration_max_m, -(*links_)(world_.hand(parts_.hand).positions));
  const Vector& torques = world_.torques(parts_.hand);
  f.torque_max_share = std::max(
      f.torque_max_share, (torques.cwiseAbs().cwiseQuotient(tree_.effort_limits())).maxCoeff());
  f.ik_error_max_m = std::max(f.ik_error_max_m, report_.ik_error);
  f.slips = report_.slips;
  if (report_.phase != clothctl::GraspPhase::Hold) return;
  f.force_sum += report_.mean_force;
  ++f.held_steps;
}

Vec TableLift::tip(int finger) const {
  Mat R;
  Vec at;
  controller_->tracker().pose_at(world_.hand(parts_.hand).positions, finger, R, at);
  return at;
}

std::string TableLift::take(clothctl::Grasp<double> grasp, double rest) {
  for (std::size_t k : {0, 1}) grasp.fingers.push_back({static_cast<int>(k), press_[k]});
  if (std::string bad = controller_->begin(std::move(grasp)); !bad.empty()) return bad;
  while (controller_->phase() != clothctl::GraspPhase::Hold) {
    if (std::string bad = step(); !bad.empty()) return bad;
  }
  ++figures_.firm;
  return steps(rest);
}

std::string TableLift::press() {
  stage_ = "press";
  press_ = {-kUp, -kUp};
  clothctl::Grasp<double> grasp;
  grasp.together = false;
  grasp.force = options_.press;
  grasp.keyframes = {wait_, touch_};
  return take(std::move(grasp), 0.5);
}

void TableLift::follow(int finger, const std::vector<int>& held, const Points& next) {
  const Points now = world_.state(0).positions(Eigen::all, held);
  const auto moved = clothctl::rectify<double>(now, next, Vector(), Mat::Identity());
  if (!moved.found()) return;
  figures_.rectify_residual_max_m =
      std::max(figures_.rectify_residual_max_m, moved.largest_residual);
  // What a few vertices within millimetres say of a turn is noise; and the force, not the plan,
  // says how deep a finger goes.
  const Vec way = (next - now).rowwise().mean();
  (void)controller_->move_finger_by(finger, Mat::Identity(), Vec(way[0], way[1], 0));
}

std::string TableLift::push() {
  stage_ = "push";
  BulgeOptions bulge;
  bulge.dt = options_.dt;
  bulge.horizon = options_.horizon;
  bulge.friction = options_.friction;
  bulge.spacing = options_.width / (options_.cols - 1);
  bulge.material = options_.material;
  bulge.fingertips = {parts_.segments[0], parts_.segments[1]};
  for (const std::size_t k : {0, 1}) {
    const double side = k == 0 ? -1 : 1;
    bulge.ends[k] = middle_[0] + side * (kGap + geometry_.fingers[k].radius);
  }
  const auto made = BulgePlan::create(world_, *contacts_, grid_, bulge, {tip(0), tip(1)}, middle_);
  if (!made) return made.error();
  BulgePlan& plan = **made;
  features_ = targets_ = plan.features();
  double error = 0;
  long frames = 0;
  const double near = bulge.ends[1] - bulge.ends[0] + 3e-3;
  for (double t = 0; t < bulge.seconds + 0.5 && near <= (tip(1) - tip(0)).norm();
       t += options_.dt, ++frames) {
    const double clock = thread_seconds();
    if (std::string bad = plan.make(t); !bad.empty()) return bad;
    figures_.plan_ms.push_back(1000 * (thread_seconds() - clock));
    for (int k : {0, 1}) follow(k, plan.held(k), plan.next(k));
    if (std::string bad = step(); !bad.empty()) return bad;
    features_ = plan.features();
    for (Index i = 0; i < targets_.cols(); ++i) targets_.col(i) = plan.target(i, t + options_.dt);
    error += (features_ - targets_).colwise().norm().mean();
  }
  figures_.feature_error_m = error / static_cast<double>(std::max(frames, 1L));
  figures_.bulge_height_m = features_.rightCols(4).row(2).mean() - kLevel;
  hide_features();
  return {};
}

std::string TableLift::pinch() {
  stage_ = "pinch";
  const Vec across = (tip(1) - tip(0)).normalized();
  // Also up, so that the table no longer bears what they pressed on it.
  press_ = {(across + 0.3 * kUp).normalized(), (-across + 0.3 * kUp).normalized()};
  clothctl::Grasp<double> grasp;
  grasp.force = options_.pinch;
  return take(std::move(grasp), 0.3);
}

std::string TableLift::lift() {
  stage_ = "lift";
  const double seconds = options_.height / 0.12;
  for (double t = 0; t < seconds; t += options_.dt) {
    (void)controller_->move_to(Mat::Identity(), options_.height * smooth_share(t / seconds) * kUp);
    if (std::string bad = step(); !bad.empty()) return bad;
  }
  (void)controller_->move_to(Mat::Identity(), options_.height * kUp);
  return steps(1);
}

std::string TableLift::attempt() {
  figures_.firm = 0;
  std::string bad = press();
  if (bad.empty()) bad = push();
  if (bad.empty()) bad = pinch();
  if (bad.empty()) bad = lift();
  return bad;
}

std::string TableLift::open() {
  stage_ = "open";
  hide_features();
  controller_->release();
  return steps(0.5);
}

std::string TableLift::run() {
  std::string bad = attempt();
  while (controller_->phase() == clothctl::GraspPhase::Failed &&
         figures_.attempts < options_.attempts) {
    if (std::string stuck = open(); !stuck.empty()) return stuck;
    ++figures_.attempts;
    bad = attempt();
  }
  double height = 0;
  int count = 0;
  for (const int pad : {parts_.pads[0], parts_.pads[1]}) {
    for (const auto& c : world_.pad_contacts(pad)) {
      if (c.state == clothctl::ContactState::Open) continue;
      height += c.place[2] - kLevel;
      ++count;
    }
  }
  figures_.lift_height_m = count == 0 ? 0 : height / count;
  return bad;
}

void TableLift::begin_page() {
  view_ = std::make_unique<HandView>(world_, tree_, parts_.hand,
                                     std::vector<int>{parts_.pads[0], parts_.pads[1]},
                                     1 + 2 * kRings * (kRings + 1));
  clothctl::PlayerScene scene;
  scene.title = "Thumb and index lift a sheet from a table";
  scene.dt = options_.dt;
  scene.triangles = grid_.triangles;
  scene.solids = box_triangles(Vec(0, 0, -kHalfTable[2]), kHalfTable);
  scene.feature_names = {"thumb", "index", "bulge 1", "bulge 2", "bulge 3", "bulge 4"};
  hide_features();
  page_ = std::make_unique<HandPage>(scene, vertex_count(), features_.cols(),
                                     std::vector<const HandView*>{view_.get()});
}

std::string TableLift::write_page(const std::string& folder,
                                  std::vector<std::pair<std::string, std::string>> figures) {
  if (!page_) return {};
  page_->scene().figures = std::move(figures);
  return page_->write(folder);
}

}  // namespace program
