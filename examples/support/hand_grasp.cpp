#include "support/hand_grasp.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include "clothctl/grasp/joint_path_planner.hpp"
#include "clothctl/math/rotation.hpp"
#include "support/hand_figures.hpp"
#include "support/random_number.hpp"
#include "support/timing.hpp"

namespace program {

using clothctl::Index;
using Vec = clothctl::Vector3<double>;
using Vector = clothctl::VectorX<double>;
using Clearance = clothctl::RobotClearance<GraspingHand::Hand>;

namespace {

constexpr double kAllPairs = 10;  // m: larger than any hand

}  // namespace

clothctl::Result<std::unique_ptr<GraspingHand>> GraspingHand::create(
    World& world, HandModel model, const std::vector<std::array<int, 3>>& triangles,
    std::vector<clothctl::ColliderRef<double>> obstacles, const GraspPlace& place,
    const GraspOptions& options) {
  std::unique_ptr<GraspingHand> out(new GraspingHand(world, std::move(model)));
  const std::string bad = out->add(triangles, std::move(obstacles), place, options);
  if (!bad.empty()) return clothctl::Error{bad};
  return out;
}

std::string GraspingHand::add(const std::vector<std::array<int, 3>>& triangles,
                              std::vector<clothctl::ColliderRef<double>> obstacles,
                              const GraspPlace& place, const GraspOptions& options) {
  options_ = options;
  const std::vector<clothctl::FingerPad<double>> fingers(model_.geometry.fingers.begin(),
                                                         model_.geometry.fingers.begin() + 2);
  auto sheet = clothctl::SheetCollider<double>::create(world_.state(0).positions, triangles, 2e-3);
  if (!sheet) return sheet.error();
  sheet_ = std::make_unique<clothctl::SheetCollider<double>>(std::move(*sheet));
  std::vector<clothctl::LinkCapsule<double>> links;
  for (const auto& c : model_.geometry.capsules) {
    if (c.frame != fingers[0].frame && c.frame != fingers[1].frame) links.push_back(c);
  }
  links_ = std::make_unique<Clearance>(Clearance::create(model_.tree, links).value());
  links_->ignore_pairs(model_.home, kAllPairs);
  Clearance whole = Clearance::create(model_.tree, model_.geometry.capsules).value();
  whole.ignore_pairs(model_.home, 5e-3);  // neighbouring bones and fingers touch, or nearly
  beside_ = obstacles;
  obstacles.emplace_back(*sheet_);
  whole.set_obstacles(obstacles);
  clothctl::GraspPoses<double> poses;
  if (std::string bad = find_poses(place, fingers, poses); !bad.empty()) return bad;
  clothctl::Grasp<double> grasp;
  if (std::string bad = plan_way(whole, poses.wait, options.seed, grasp.keyframes); !bad.empty())
    return bad;
  const Vector start = grasp.keyframes.front();
  grasp.keyframes.push_back(poses.touch);
  grasp.tangents = clothctl::KeyframeTangents::Standstill;  // the way was proved free
  grasp.fingers = {{0, press_[0]}, {1, press_[1]}};
  grasp.force = options.force;
  if (std::string bad = put_into_world(start); !bad.empty()) return bad;
  return controller_->begin(std::move(grasp));
}

std::string GraspingHand::put_into_world(const Vector& start) {
  clothctl::HandSetup<double> setup;
  setup.positions = start;
  setup.control = model_.control;
  if (options_.implicit) setup.control.form = clothctl::PdForm::Implicit;
  const auto hand = world_.add_hand(model_.tree, setup);
  if (!hand) return hand.error();
  clothctl::HandSurface<double> surface;
  surface.pad.friction = options_.friction;
  surface.with_pads = {0, 1};
  auto parts = clothctl::add_hand_geometry<double>(world_, *hand, model_.geometry, surface);
  if (!parts) return parts.error();
  parts_ = std::move(*parts);
  clothctl::GraspSettings<double> settings;
  settings.friction = options_.friction;
  settings.most_force = options_.most_force;
  settings.approach_speed = model_.approach_speed;
  auto controller = clothctl::GraspController<Hand>::create(model_.tree, model_.geometry.fingers,
                                                            start, settings);
  if (!controller) return controller.error();
  controller_ = std::make_unique<clothctl::GraspController<Hand>>(std::move(*controller));
  view_ = std::make_unique<HandView>(world_, model_.tree, *hand,
                                     std::vector<int>{parts_.pads[0], parts_.pads[1]}, kSamples);
  return {};
}

std::string GraspingHand::find_poses(const GraspPlace& place,
                                     const std::vector<clothctl::FingerPad<double>>& fingers,
                                     clothctl::GraspPoses<double>& poses) {
  // Where the hand waits its fingertips keep clear of the sheet, too; from there to the sheet all
  // of it keeps clear of what is beside the sheet.
  Clearance all = Clearance::create(model_.tree, model_.geometry.capsules).value();
  all.ignore_pairs(model_.home, kAllPairs);
  const auto room = [&](const clothctl::GraspPoses<double>& p) {
    const clothctl::ColliderRef<double> sheet(*sheet_);
    all.set_obstacles({&sheet, 1});
    double least = all(p.wait);
    all.set_obstacles(beside_);
    for (int k = 0; k <= 8; ++k)
      least = std::min(least, all(p.wait + k / 8.0 * (p.touch - p.wait)));
    return least;
  };
  // The fingertips come at right angles to the sheet, or along it from beyond its edge, too. The
  // palm faces the edge, or the hand is turned about the line between its fingertips.
  press_ = {place.press, -place.press};
  double best = -1;  // m
  std::string message;
  for (const double from_edge : {0.0, 0.5, 0.7}) {
    for (const double turn : {0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2}) {
      const Vec approach = clothctl::rotation_exp<double>(turn * place.press) * place.approach;
      std::vector<clothctl::GraspContact<double>> contacts{{place.place, place.press},
                                                           {place.place, -place.press}};
      for (auto& c : contacts)
        c.away = (-(1 - from_edge) * c.press - from_edge * place.approach).normalized();
      const Vector pinch = model_.pinch_at(model_.tree, {place.place, place.press, approach});
      const auto found =
          clothctl::find_grasp_poses<Hand, double>(model_.tree, fingers, contacts, pinch, pinch);
      if (found.status != clothctl::GraspPoseStatus::Found) {
        message = found.message;
        continue;
      }
      const double now = room(found);
      if (!(best < now)) continue;
      best = now;
      poses = found;
      if (best > 5e-3) return {};
    }
  }
  if (best > 1e-3) return {};
  if (poses.touch.size() == 0) return message;
  return "in each pose found, bones of the hand are in the sheet or in what is beside it (gap " +
         std::to_string(best) +
         " m, must be 0.001 m): take a finer or a smaller sheet, or another hand";
}

std::string GraspingHand::plan_way(Clearance& whole, const Vector& wait, std::uint64_t seed,
                                   std::vector<Vector>& keys) {
  keys = {wait};
  if (seed == 0) return {};
  whole.ignore_pairs(wait, 5e-3);
  const auto reach = clothctl::joint_reach<double>(model_.tree, model_.geometry.capsules);
  if (!reach) return reach.error();
  std::mt19937_64 random(seed);
  Vector start = wait;
  for (int i = 0; i < 100; ++i) {
    start = wait;
    for (Index k = 0; k < 3; ++k) start[k] += random_number(random, 0.3);
    for (Index k = 3; k < 6; ++k) start[k] += random_number(random, 0.4);
    for (Index k = 6; k < start.size(); ++k) start[k] += random_number(random, 0.1);
    start = start.cwiseMax(model_.tree.lower()).cwiseMin(model_.tree.upper());
    if (whole(start) > 2e-3) break;
  }
  clothctl::JointPathSettings<double> settings;
  settings.seed = seed;
  auto path = clothctl::plan_joint_path<double>(start, wait, model_.tree.lower(),
                                                model_.tree.upper(), *reach, whole, settings);
  if (path.status != clothctl::JointPathStatus::Found)
    return "no way to the sheet: " + std::string(to_string(path.status)) + ", " + path.message;
  keys = std::move(path.positions);
  return {};
}

std::vector<clothctl::HoldingFinger<double>> GraspingHand::holding(int k) {
  std::vector<clothctl::HoldingFinger<double>> out;
  for (const int i : {0, 1}) {
    const Vec& press = press_[static_cast<std::size_t>(i)];
    // A plan may ask for no more than the joints can press with.
    const double most = controller_->tracker().largest_force(i, press);
    out.push_back({2 * k + i, press, options_.friction, std::min(options_.most_force, most)});
  }
  return out;
}

std::array<clothctl::PadTouch<double>, 2> GraspingHand::touches(double dt) const {
  return {clothctl::pad_touch(world_, parts_.pads[0], dt),
          clothctl::pad_touch(world_, parts_.pads[1], dt)};
}

void GraspingHand::drive(double t, double dt) {
  before_ = world_.hand(parts_.hand);
  const double start = thread_seconds();
  const auto felt = touches(dt);
  figures_.last = controller_->update(dt, before_, felt, world_.drive(parts_.hand));
  figures_.ms.push_back(1000 * (thread_seconds() - start));
  if (figures_.last.phase == clothctl::GraspPhase::Failed)
    figures_.fault = controller_->describe(figures_.last);
  if (!holds()) return;
  figures_.too_weak = figures_.too_weak || figures_.last.too_weak;
  if (figures_.firm_s < 0) figures_.firm_s = t;
  figures_.force_sum += figures_.last.mean_force;
  figures_.ik_error_max_m = std::max(figures_.ik_error_max_m, figures_.last.ik_error);
  ++figures_.held_steps;
}

void GraspingHand::measure(const clothctl::WorldReport<double>& report, double dt) {
  const Vector& torques = world_.torques(parts_.hand);
  const Vector limits = model_.tree.effort_limits();
  for (Index i = 0; i < torques.size(); ++i)
    figures_.torque_max_share =
        std::max(figures_.torque_max_share, std::abs(torques[i]) / limits[i]);
  const auto depth_in = [&](std::span<const clothctl::ColliderRef<double>> obstacles) {
    links_->set_obstacles(obstacles);
    return -(*links_)(world_.hand(parts_.hand).positions);
  };
  if (!beside_.empty())
    figures_.penetration_max_m = larger(figures_.penetration_max_m, depth_in(beside_));
  // The sheet counts with half its thickness; a link that reaches its middle is in it.
  double depth = std::nan("");
  const clothctl::ColliderRef<double> sheet(*sheet_);
  if (sheet_->update(world_.state(0).positions).empty())
    depth = depth_in({&sheet, 1}) - 0.5 * sheet_->thickness();
  figures_.penetration_max_m = larger(figures_.penetration_max_m, depth);
  if (report.parts != 1 || !floats()) return;  // torques are those of the last part
  figures_.momentum_residual = std::fmax(
      figures_.momentum_residual, momentum_residual(world_, parts_, model_.tree, before_, dt));
}

}  // namespace program
