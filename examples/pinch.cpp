// Two soft pads pinch a hanging sheet near its upper left corner, hold it, shake it and turn it:
// pads on given paths, of a gripper that presses with a given force, or the tips of a hand.
//
//   pinch --pads hand --amplitude 0.08 --out out      then open out/player.html
//   pinch --pads gripper --force 0.15                 too little: the sheet slides out

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "clothctl/io/html_player.hpp"
#include "support/command_line.hpp"
#include "support/figure_text.hpp"
#include "support/hand_figures.hpp"
#include "support/inputs.hpp"
#include "support/pinch_world.hpp"
#include "support/timing.hpp"

namespace {

using namespace program;
using Points = clothctl::Points<double>;

struct Request {
  PinchMotion motion;
  PinchSheet sheet;
  clothctl::PadSettings<double> pad;
  double dt = 0.02, seconds = 10;
  std::string material = "handkerchief", out;
  bool json = false;
};

Request read_request(int argc, char** argv) {
  Request r;
  CLI::App app{"Two soft pads pinch a hanging sheet, hold it, shake it and turn it."};
  const auto add = [&](const char* name, double& value, double least, double most,
                       const char* help) {
    app.add_option(name, value, help)->check(between(least, most))->capture_default_str();
  };
  add_sheet(app, r.sheet.side, r.sheet.size, r.material);
  const auto choose = [&](const char* name, std::string& value, std::vector<std::string> names,
                          const char* help) {
    app.add_option(name, value, help)
        ->check(CLI::IsMember(std::move(names)))
        ->capture_default_str();
  };
  choose("--pads", r.motion.pads, {"paths", "gripper", "hand", "none"},
         "What carries the pads; none: the sheet falls");
  choose("--model", r.sheet.model, {"mass-spring", "xpbd"}, "Model of the sheet");
  choose("--integration", r.sheet.integration, {"linear-implicit", "newton"},
         "How a mass-spring sheet is stepped");
  app.add_option("--substeps", r.sheet.substeps, "Equal parts of a step of the whole world")
      ->check(between(1, 100))
      ->capture_default_str();
  add("--cap", r.sheet.cap, 0, 10, "Largest stretch of an edge of an XPBD sheet; 0: no cap");
  add("--force", r.motion.force, 0.01, 100, "Normal force of each pad, N");
  add("--friction", r.pad.friction, 0, 10, "Friction coefficient");
  add("--stiffness", r.pad.stiffness, 1, 1e6, "Stiffness of a pad, N/m");
  add("--amplitude", r.motion.amplitude, 0, 1, "Amplitude of a shake of 2 Hz, m");
  add("--twist", r.motion.twist, -3, 3,
      "Turn about the normal of the pads and back, at 0.5 Hz, rad");
  add("--dt", r.dt, 1e-4, 0.1, "Time step, s");
  add("--seconds", r.seconds, 0.1, 600, "Length of the run, s");
  app.add_flag("--json", r.json, "Print the figures as one JSON object on the last line");
  app.add_option("--out", r.out, "Folder for player.html (made if missing)")
      ->check([](const std::string& t) { return std::string(t.empty() ? "is empty" : ""); });
  parse(app, argc, argv);
  r.pad.tangential_stiffness = r.pad.stiffness;
  if (r.motion.force > r.pad.stiffness * r.pad.reach)
    refuse("--force: a pad of this stiffness reaches the sheet with at most " +
           figure_text(r.pad.stiffness * r.pad.reach) + " N");
  if (r.sheet.size < 0.05) refuse("--size: the pads need a sheet of 0.05 m");
  return r;
}

/// What a run counts.
struct Counts {
  double slip = 0, sample_slip = 0, residual = 0, force = 0, use = 0, stretch = 0;
  bool failed = false, held = true, marked = false;
  std::vector<double> step_ms;
};

}  // namespace

int main(int argc, char** argv) {
  const Request r = read_request(argc, argv);
  make_folder(r.out);  // before the work, since it may fail
  const auto material = read_material(r.material);
  const auto pinch = must(PinchWorld::create(r.sheet, material, r.motion, r.pad));
  clothctl::PlayerScene scene;
  scene.title = "Two soft pads hold a sheet";
  scene.subtitle = material.name;
  scene.dt = r.dt;
  scene.arrow_name = "Forces of the pads on the sheet";
  scene.triangles = pinch->triangles();
  clothctl::PlayerRecorder page(scene, pinch->state().positions.cols(), 0, PinchWorld::kSamples);
  Counts counts;
  Progress progress;
  // Slip is measured from where the sheet is after 0.3 s; a sheet that is lost falls for 0.5 s.
  const long frames = std::lround(r.seconds / r.dt);
  double lost_at = r.seconds;
  for (long frame = 0; frame < frames && !counts.failed; ++frame) {
    const double t = static_cast<double>(frame) * r.dt;
    if (t > lost_at + 0.5) break;
    pinch->drive(t, r.dt);
    const double start = thread_seconds();
    counts.failed = !pinch->step(r.dt);
    counts.step_ms.push_back(1000 * (thread_seconds() - start));
    counts.residual = std::max(counts.residual, pinch->report().pads.force_residual);
    counts.stretch = std::max(counts.stretch, pinch->stretch());
    if (counts.held && pinch->contact_count() == 0) {
      counts.held = false;
      lost_at = t;
    }
    if (counts.held) {
      if (!counts.marked && t >= 0.3) pinch->mark();
      counts.marked = t >= 0.3;
      counts.slip = std::max(counts.slip, pinch->slip());
      counts.sample_slip = std::max(counts.sample_slip, pinch->sample_slip());
      counts.force = pinch->normal_force(r.dt);
      counts.use = pinch->friction_use();
    }
    if (!r.out.empty()) {
      const Points none(3, 0);
      page.add_frame(pinch->state().positions, none, none, pinch->places(), pinch->forces(r.dt));
    }
    progress.show(frame + 1, frames);
  }
  progress.clear();
  counts.held = counts.held && counts.slip < 0.01;
  nlohmann::ordered_json j;
  j["status"] = counts.failed ? "failed" : counts.held ? "held" : "lost";
  j["vertices"] = pinch->state().positions.cols();
  j["slip_max_mm"] = known(1000 * counts.slip, counts.marked);
  j["sample_slip_max_mm"] = known(1000 * counts.sample_slip, counts.marked);
  j["normal_force_N"] = counts.force;
  j["friction_use"] = counts.use;
  j["solver_residual_max_N"] = counts.residual;
  j["stretch_max"] = counts.stretch;
  j["tip_error_max_mm"] = known(1000 * pinch->tip_error(), r.motion.pads == "hand");
  j["step_ms_median"] = quantile(counts.step_ms, 0.5);
  j["step_ms_p99"] = quantile(counts.step_ms, 0.99);
  j["material"] = material.name;
  for (const auto& [key, value] : j.items())
    page.scene().figures.emplace_back(key, figure_text(value));
  if (!r.out.empty()) must(page.write(r.out + "/player.html"));
  print_figures(j, r.json);
  if (!r.out.empty() && !r.json) std::printf("open %s/player.html\n", r.out.c_str());
  return counts.failed ? 1 : 0;
}
