// Simulates a sheet without a controller, and measures stretch, energy and speed.
//
//   simulate --model xpbd --mesh grid:65x65 --pin corners --start level --out out
//                                                           then open out/player.html

#include <cmath>
#include <nlohmann/json.hpp>

#include "clothctl/core/number_text.hpp"
#include "clothctl/io/file.hpp"
#include "support/cloth_run.hpp"
#include "support/command_line.hpp"
#include "support/contact_options.hpp"

namespace {

using namespace program;

struct SimulateOptions {
  ClothOptions cloth;
  ClothRunOptions run;
  bool json = false;
  std::string out;
};

SimulateOptions read_options(int argc, char** argv) {
  SimulateOptions o;
  CLI::App app{"Simulates a sheet and measures stretch, energy and speed."};
  const auto named = [](const std::string& text) {
    return text.empty() ? std::string("is empty") : std::string();
  };
  app.add_option("--model", o.run.model, "pbd, xpbd, or mass-spring (implicit, Newton)")
      ->check(CLI::IsMember({"pbd", "xpbd", "mass-spring"}))
      ->capture_default_str();
  app.add_option("--mesh", o.cloth.mesh, "grid:ROWSxCOLUMNS of vertices, tshirt, or FILE.obj")
      ->capture_default_str();
  app.add_option("--size", o.cloth.size,
                 "Width of a grid (its cells are square), largest extent of another mesh, m")
      ->check(between(0.01, 100))
      ->capture_default_str();
  app.add_option("--material", o.cloth.material, "Preset name or JSON file")->capture_default_str();
  app.add_option("--pin", o.cloth.pin,
                 "Vertices that stay: corners (upper; shoulders of the shirt), top (edge), none, "
                 "or A,B,...")
      ->check(named)
      ->capture_default_str();
  app.add_option("--start", o.cloth.start, "hanging, or level: turned about the top edge")
      ->check(CLI::IsMember({"hanging", "level"}))
      ->capture_default_str();
  app.add_option("--wind", o.cloth.wind, "Velocity of the air X,Y,Z, m/s; without it, no air")
      ->check(named);
  app.add_option("--cap", o.run.cap, "Largest stretch of an edge, 0.02 for 2 %; 0: no cap")
      ->check(between(0, 1))
      ->capture_default_str();
  add_contact_options(app, o.run);
  app.add_option("--seconds", o.run.seconds, "Simulated time, s")
      ->check(between(1e-3, 1e5))
      ->capture_default_str();
  app.add_option("--dt", o.run.dt, "Time step, s")->check(between(1e-5, 1))->capture_default_str();
  app.add_option("--seed", o.cloth.seed, "Seed of the small disturbance at the start")
      ->check(seed_number())
      ->capture_default_str();
  app.add_flag("--json", o.json, "Print the figures as one JSON object on the last line");
  app.add_option("--out", o.out, "Folder for player.html and summary.json (made if missing)")
      ->check(named);
  parse(app, argc, argv);
  o.cloth.size_given = app.count("--size") > 0;
  if (o.run.seconds < o.run.dt)
    refuse("--dt: " + clothctl::number_text(o.run.dt) + " s is longer than --seconds " +
           clothctl::number_text(o.run.seconds));
  if (o.run.seconds / o.run.dt > 1e7)
    refuse("--seconds: " + clothctl::number_text(o.run.seconds) +
           " s are over 10^7 steps of --dt " + clothctl::number_text(o.run.dt));
  return o;
}

std::string to_json(const ClothFigures& f, const SimulateOptions& o, const ClothScene& scene,
                    int indent) {
  nlohmann::ordered_json j;
  j["status"] = f.status;
  j["vertices"] = f.vertices;
  j["real_time_factor"] = f.real_time_factor;
  j["stretch_max"] = f.stretch_max;
  j["stretch_mean"] = f.stretch_mean;
  j["energy_drift"] = f.energy_drift;
  j["solves_per_second"] = f.solves_per_second;
  j["nonfinite"] = f.nonfinite;
  j["energy_rise_max"] = f.energy_rise_max;
  if (o.run.touches()) j.update(contact_figures(f));
  j["steps"] = f.steps;
  j["unconverged_steps"] = f.unconverged_steps;
  j["setup"] = {{"model", o.run.model},
                {"mesh", o.cloth.mesh},
                {"size_m", scene.extent},
                {"material", scene.material.name},
                {"start", o.cloth.start},
                {"pinned", scene.pinned.size()},
                {"wind_m_s", {scene.wind[0], scene.wind[1], scene.wind[2]}},
                {"cap", o.run.cap},
                {"obstacles", o.run.obstacles},
                {"self", o.run.self},
                {"seconds", o.run.seconds},
                {"dt_s", o.run.dt},
                {"seed", o.cloth.seed}};
  return j.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string formatted(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace

int main(int argc, char** argv) {
  const SimulateOptions o = read_options(argc, argv);
  const ClothScene scene = make_cloth_scene(o.cloth);
  const long every =
      std::max(1L, std::lround(1 / (30 * o.run.dt)));  // the page: 30 frames a second
  clothctl::PlayerScene shown;
  shown.title = "Simulated sheet";
  shown.subtitle = scene.material.name + ", " + std::to_string(scene.network.vertex_count()) +
                   " vertices, " + o.run.model;
  shown.dt = o.run.dt * static_cast<double>(every);
  shown.triangles = scene.network.triangles;
  clothctl::PlayerRecorder page(shown, scene.network.vertex_count(), 0, 0);
  make_folder(o.out);  // before the work, since it may fail
  const ClothFigures f = run_cloth(o.run, scene, o.out.empty() ? nullptr : &page, every);
  if (!o.out.empty()) {
    page.scene().figures = {{"Status", f.status},
                            {"Largest stretch", formatted("%.2f %%", 100 * f.stretch_max)},
                            {"Mean stretch", formatted("%.3f %%", 100 * f.stretch_mean)},
                            {"Times real time", formatted("%.1f", f.real_time_factor)}};
    if (o.run.touches()) add_contact_rows(f, page.scene().figures);
    must(page.write(o.out + "/player.html"));
    must(clothctl::write_file(o.out + "/summary.json", to_json(f, o, scene, 2) + "\n"));
  }
  if (o.json) {
    std::printf("%s\n", to_json(f, o, scene, -1).c_str());
  } else {
    std::printf("%s: %ld steps of %ld vertices, %.1f times real time\n", f.status.c_str(), f.steps,
                static_cast<long>(f.vertices), f.real_time_factor);
    std::printf("stretch at most %.2f %%, mean %.3f %%; %.3g solves a second\n",
                100 * f.stretch_max, 100 * f.stretch_mean, f.solves_per_second);
    if (!o.out.empty()) std::printf("open %s/player.html\n", o.out.c_str());
  }
  return f.status == "finished" ? 0 : 1;
}
