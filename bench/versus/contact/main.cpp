// Compares our sheet on an obstacle with the engines found when this was built: the same sheet,
// obstacle and frames, run by run, thread CPU time.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <string>
#include <vector>

#include "../support/command_line.hpp"
#include "../support/modules.hpp"
#include "clothctl.hpp"
#include "clothctl/io/file.hpp"
#include "report.hpp"
#include "scene.hpp"

namespace {

using versus::Entry;
using versus::holds;
using versus::Names;

struct Options {
  Names engines, variants, obstacles{"sphere"}, self{"on", "off"};
  std::vector<int> sides{33};
  int substeps = 1;
  double seconds = 10;
  std::string json;
  versus::RunSettings run;
};

[[noreturn]] void refuse(const std::string& message) {
  versus::refuse("bench_versus_contact", message);
}

Options parse(int argc, char** argv) {
  Options o;
  CLI::App app{"Our sheet on an obstacle beside other engines: run by run, thread CPU time."};
  const auto list = [](CLI::Option* option) {
    return option->delimiter(',')->allow_extra_args(false)->capture_default_str();
  };
  list(app.add_option("--engines", o.engines,
                      "Names of engines besides ours (default: all that were built in)"));
  list(app.add_option("--variants", o.variants, "Names of settings (default: the usual ones)"));
  list(app.add_option("--obstacles", o.obstacles, "Obstacles: sphere, box"))
      ->check(CLI::IsMember(Names{"sphere", "box"}));
  list(app.add_option("--self", o.self, "Whether the sheet meets itself: on, off"))
      ->check(CLI::IsMember(Names{"on", "off"}));
  list(app.add_option("--sides", o.sides, "Vertices along a side"))->check(CLI::Range(2, 300));
  app.add_option("--substeps", o.substeps, "Parts of a frame, for all engines")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--seconds", o.seconds, "Length of a run")
      ->check(CLI::Range(0.1, 1e4))
      ->capture_default_str();
  app.add_option("--repeats", o.run.repeats, "Runs of each setting, for the times")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  app.add_option("--json", o.json, "File for the figures");
  versus::parse(app, argc, argv, refuse);
  o.run.frames = static_cast<int>(o.seconds / o.run.dt + 0.5);
  return o;
}

/// Refuses names of settings that no engine has.
void check_variants(const Names& variants, const std::vector<Entry>& engines) {
  for (const std::string& name : variants) {
    const bool known = std::any_of(engines.begin(), engines.end(), [&](const Entry& e) {
      return std::any_of(e.variants.begin(), e.variants.end(),
                         [&](const versus::Variant& v) { return v.name == name; });
    });
    if (!known) refuse("--variants: no engine has '" + name + "'");
  }
}

versus::SceneReport run(const std::vector<Entry>& engines, const Options& o, int side, bool box,
                        bool self) {
  versus::Obstacle obstacle;
  obstacle.box = box;
  if (box) obstacle.size = 0.2;
  const versus::Scene scene = versus::make_scene(side, obstacle, self, o.substeps);
  versus::SceneReport report{side, box, self, versus::run_all(engines, o.variants, scene, o.run)};
  versus::print_scene(report);
  return report;
}

}  // namespace

int main(int argc, char** argv) {
  const Options o = parse(argc, argv);
  const std::vector<Entry> engines = versus::open_modules<Entry>(
      versus::clothctl_entry(), VERSUS_MODULES, o.engines, "--engines", refuse);
  check_variants(o.variants, engines);
  versus::print_entries(engines);
  std::vector<versus::SceneReport> scenes;
  for (const int side : o.sides) {
    for (const std::string& obstacle : o.obstacles) {
      for (const std::string& self : o.self)
        scenes.push_back(run(engines, o, side, obstacle == "box", self == "on"));
    }
  }
  if (o.json.empty()) return 0;
  const auto written =
      clothctl::write_file(o.json, versus::to_json(engines, o.run, o.substeps, scenes));
  if (!written) refuse(written.error());
  return 0;
}
