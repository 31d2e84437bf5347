// A hand goes to the corner of a hanging sheet, or to the edge of one on a table, pinches it, takes
// it off and shakes it.
//
//   pinch_and_shake --out out           then open out/player.html
//   pinch_and_shake --force 0.5 --most-force 0.5      too little: the sheet slides out
//   pinch_and_shake --seed 7            from a random start, around the sheet
//   pinch_and_shake --hand gripper      another hand; or one from hand.urdf

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "support/command_line.hpp"
#include "support/figure_text.hpp"
#include "support/hand_figures.hpp"
#include "support/hand_files.hpp"
#include "support/hand_page.hpp"
#include "support/hand_scene.hpp"
#include "support/inputs.hpp"
#include "support/timing.hpp"

namespace {

using namespace program;
using Vec = clothctl::Vector3<double>;
using Points = clothctl::Points<double>;

struct Request {
  GraspOptions grasp;
  HandFiles hand;
  int cloth = 33;
  double size = 0.5, amplitude = 0.08, frequency = 2, dt = 0.02, seconds = 30;
  std::string material = "handkerchief", pd = "stable", from = "hanging", out;
  bool json = false;
};

Request read_request(int argc, char** argv) {
  Request r;
  CLI::App app{"A hand pinches the corner of a hanging sheet and shakes it."};
  const auto add = [&](const char* name, double& value, double least, double most,
                       const char* help) {
    app.add_option(name, value, help)->check(between(least, most))->capture_default_str();
  };
  add_sheet(app, r.cloth, r.size, r.material);
  (void)add_hand(app, r.hand);
  add("--force", r.grasp.force, 0.01, 15, "Normal force of each finger, N");
  add("--most-force", r.grasp.most_force, 0.01, 15, "Largest force, where the sheet slides, N");
  add("--friction", r.grasp.friction, 0.01, 10, "Friction coefficient of the fingertips");
  add("--amplitude", r.amplitude, 0, 0.5, "Amplitude of the shake, m");
  add("--frequency", r.frequency, 0, 10, "Frequency of the shake, Hz");
  add("--dt", r.dt, 1e-3, 0.04, "Time step, s");
  add("--seconds", r.seconds, 0.1, 600, "Length of the shake, s");
  app.add_option("--pd", r.pd, "Form of the hand's control")
      ->check(CLI::IsMember({"stable", "implicit"}))
      ->capture_default_str();
  app.add_option("--from", r.from,
                 "Where the sheet is: hanging from its upper corners, or on a table, over its edge")
      ->check(CLI::IsMember({"hanging", "table"}))
      ->capture_default_str();
  app.add_option("--seed", r.grasp.seed, "Of a random start of the hand; 0: beside the corner")
      ->check(seed_number())
      ->capture_default_str();
  app.add_flag("--json", r.json, "Print the figures as one JSON object on the last line");
  app.add_option("--out", r.out, "Folder for player.html (made if missing)");
  parse(app, argc, argv);
  r.grasp.implicit = r.pd == "implicit";
  if (r.grasp.most_force < r.grasp.force) refuse("--most-force: less than --force (default 10)");
  const double speed = 6.2831853 * r.frequency * r.amplitude;  // m/s
  if (speed > clothctl::GraspSettings<double>().hold_speed)
    refuse("--frequency: the shake reaches " + clothctl::rounded_text(speed) + " m/s, at most 3");
  if (r.size < 0.1) refuse("--size: the hand needs a sheet of 0.1 m");
  return r;
}

}  // namespace

int main(int argc, char** argv) {
  const Request r = read_request(argc, argv);
  make_folder(r.out);  // before the work, since it may fail
  const auto material = read_material(r.material);
  const bool flat = r.from == "table";
  const auto place = make_hand_scene(r.cloth, r.size, material, flat, r.dt);
  clothctl::World<double>& world = place->world;
  const clothctl::GridMesh<double>& grid = place->grid;
  const auto hand =
      must(GraspingHand::create(world, read_hand(r.hand)(place->place), grid.triangles,
                                place->obstacles(), place->place, r.grasp));
  clothctl::PlayerScene scene;
  scene.title = "A hand pinches a sheet and shakes it";
  scene.dt = r.dt;
  scene.triangles = grid.triangles;
  scene.solids = place->solids();
  HandPage page(scene, grid.positions.cols(), 0, {&hand->view()});
  const Points none(3, 0);
  Progress progress;
  bool failed = false;
  double slip = 0, held = 0;
  const double rest = flat ? 2 : 0.5;  // s from the pins, or the table, to the shake
  double t = 0;
  while (!failed && hand->figures().fault.empty() && held < r.seconds + rest) {
    progress.show(std::lround(held / r.dt), std::lround((r.seconds + rest) / r.dt));
    if (hand->holds()) {
      world.input(0).clear();
      const double shaken = std::max(0.0, held + r.dt - rest);
      const double w = 2 * 3.14159265358979323846 * r.frequency * shaken;
      // Out from under the table, then up.
      const double out = flat ? -0.15 * smooth_share(held / (0.5 * rest)) : 0;      // m
      const double up = flat ? 0.25 * smooth_share((held / rest - 0.3) / 0.7) : 0;  // m
      (void)hand->controller().move_to(clothctl::Matrix3<double>::Identity(),
                                       Vec(r.amplitude * (1 - std::cos(w)), out, up));
      held += r.dt;
    }
    hand->drive(t, r.dt);
    const auto report = world.step(r.dt);
    failed = !report.advanced;
    hand->measure(report, r.dt);
    if (held > 0 && held <= rest) hand->mark(grid.positions);
    if (held > rest) slip = std::max(slip, hand->slip(grid.positions));
    if (!r.out.empty()) {
      page.add_frame(world.state(0).positions, none, none, r.dt,
                     std::string(to_string(hand->figures().last.phase)));
    }
    t += r.dt;
  }
  progress.clear();
  const GraspFigures& f = hand->figures();
  nlohmann::ordered_json j;
  j["status"] = failed ? "failed" : !f.fault.empty() ? f.fault : "held";
  j["vertices"] = grid.positions.cols();
  j["grasp_firm_share"] = f.firm_s >= 0 ? 1 : 0;
  j["firm_s"] = known(f.firm_s, f.firm_s >= 0);
  j["slip_max_m"] = known(slip, held > rest);
  j["slips"] = f.last.slips;
  j["too_weak"] = f.too_weak;
  j["grip_force_mean_N"] = known(f.force_sum / static_cast<double>(f.held_steps), f.held_steps > 0);
  j["ik_error_max_m"] = f.ik_error_max_m;
  j["penetration_max_m"] = known(f.penetration_max_m);
  j["torque_max_share"] = f.torque_max_share;
  j["momentum_residual"] = known(f.momentum_residual);
  j["hand_frame_ms"] = quantile(f.ms, 0.5);
  j["hand_frame_ms_p99"] = quantile(f.ms, 0.99);
  j["hand_frame_ms_max"] = quantile(f.ms, 1);
  j["material"] = material.name;
  for (const auto& [key, value] : j.items())
    page.scene().figures.emplace_back(key, figure_text(value));
  if (const std::string bad = r.out.empty() ? "" : page.write(r.out); !bad.empty()) refuse(bad);
  print_figures(j, r.json);
  if (!r.out.empty() && !r.json) std::printf("open %s/player.html\n", r.out.c_str());
  return failed || !f.fault.empty() ? 1 : 0;
}
