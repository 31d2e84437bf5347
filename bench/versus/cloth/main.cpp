// Compares our cloth with the engines found when this was built: the same sheets, edges and frames
// in one process, in turns, thread CPU time.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "../support/command_line.hpp"
#include "../support/modules.hpp"
#include "clothctl.hpp"
#include "clothctl/io/file.hpp"
#include "report.hpp"
#include "sheets.hpp"

namespace {

using versus::Entry;
using versus::holds;
using versus::Names;

struct Options {
  Names engines, meshes{"grid", "irregular"}, parts{"throughput", "curves"};
  std::vector<int> sides{32, 64, 128};
  unsigned seed = 1;
  int throughput_frames = 60;
  int reference_side = 32;
  std::string json;
  versus::RunSettings run;
};

[[noreturn]] void refuse(const std::string& message) {
  versus::refuse("bench_versus_cloth", message);
}

void add_lists(CLI::App& app, Options& o) {
  const auto list = [](CLI::Option* option) {
    return option->delimiter(',')->allow_extra_args(false)->capture_default_str();
  };
  list(app.add_option("--engines", o.engines,
                      "Names of engines besides ours (default: all that were built in)"));
  list(app.add_option("--parts", o.parts,
                      "What to run: throughput, curves, and reference, the implicit sheet"))
      ->check(CLI::IsMember(Names{"throughput", "curves", "reference"}));
  list(app.add_option("--meshes", o.meshes, "Meshes: grid, irregular"))
      ->check(CLI::IsMember(Names{"grid", "irregular"}));
  list(app.add_option("--sides", o.sides, "Vertices along a side"))->check(CLI::Range(2, 2000));
  list(app.add_option("--targets", o.run.targets, "Worst stretches to reach"))
      ->check(CLI::Range(1e-6, 10.0));
}

Options parse(int argc, char** argv) {
  Options o;
  CLI::App app{
      "Our cloth beside other engines: the same sheets, edges and frames in one process, "
      "interleaved, thread CPU time."};
  add_lists(app, o);
  double limit = 1e3 * o.run.limit;
  app.add_option("--limit", limit, "Longest median frame (ms) that a setting may take")
      ->check(CLI::Range(1e-3, 1e5))
      ->capture_default_str();
  app.add_option("--frames", o.run.frames, "Frames of a run, 60 a second")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  app.add_option("--rest-frames", o.run.rest_frames, "Damped frames after a run")
      ->check(CLI::Range(6, 1000000))
      ->capture_default_str();
  app.add_option("--turn", o.run.turn,
                 "Frames before the next engine's turn; the first is not timed")
      ->check(CLI::Range(2, 1000000))
      ->capture_default_str();
  app.add_option("--throughput-frames", o.throughput_frames, "Frames of the throughput")
      ->check(CLI::Range(6, 1000000))
      ->capture_default_str();
  app.add_option("--reference-side", o.reference_side,
                 "Vertices along a side of the implicit sheet")
      ->check(CLI::Range(2, 2000))
      ->capture_default_str();
  app.add_option("--seed", o.seed, "Seed of the irregular meshes")->capture_default_str();
  app.add_option("--json", o.json, "File for the figures");
  versus::parse(app, argc, argv, refuse);
  o.run.limit = 1e-3 * limit;
  if (!std::isfinite(limit)) refuse("--limit: not a number");
  for (const double target : o.run.targets) {
    if (!std::isfinite(target)) refuse("--targets: not a number");
  }
  std::sort(o.run.targets.rbegin(), o.run.targets.rend());
  return o;
}

std::vector<Entry> entries(const Names& chosen) {
  return versus::open_modules<Entry>(versus::clothctl_entry(), VERSUS_MODULES, chosen, "--engines",
                                     refuse);
}

versus::SheetReport run(const std::vector<Entry>& engines, const std::string& mesh, int side,
                        const Options& options) {
  versus::SheetReport report;
  const versus::Sheet sheet =
      mesh == "grid" ? versus::grid_sheet(side) : versus::irregular_sheet(side, options.seed);
  report.mesh = mesh;
  report.side = side;
  report.edges = sheet.edges.size();
  const std::vector<versus::Lane> lanes = versus::lanes_of(engines);
  if (holds(options.parts, "throughput"))
    report.throughput =
        versus::run_throughput(lanes, sheet, options.run, options.throughput_frames);
  if (holds(options.parts, "curves")) report.curves = versus::run_curves(lanes, sheet, options.run);
  return report;
}

/// The implicit sheet on its own: its times are not compared.
versus::SheetReport run_reference(const Options& options) {
  const std::vector<Entry> entry{versus::reference_entry()};
  const versus::Sheet sheet = versus::grid_sheet(options.reference_side);
  versus::SheetReport report{"grid", options.reference_side, sheet.edges.size(), {}, {}};
  const std::vector<versus::Lane> lanes = versus::lanes_of(entry);
  report.curves.push_back(
      versus::run_together(lanes, {lanes.front().variant->start}, sheet, options.run));
  return report;
}

}  // namespace

int main(int argc, char** argv) {
  const Options options = parse(argc, argv);
  const std::vector<Entry> engines = entries(options.engines);
  versus::print_entries(engines);
  std::vector<versus::SheetReport> sheets;
  const auto add = [&](versus::SheetReport report) {
    versus::print_sheet(report, options.run);
    sheets.push_back(std::move(report));
  };
  if (holds(options.parts, "reference")) add(run_reference(options));
  if (holds(options.parts, "throughput") || holds(options.parts, "curves")) {
    for (const std::string& mesh : options.meshes) {
      for (const int side : options.sides) add(run(engines, mesh, side, options));
    }
  }
  if (options.json.empty()) return 0;
  const clothctl::Result<std::size_t> written =
      clothctl::write_file(options.json, versus::to_json(engines, options.run, sheets));
  if (!written) refuse(written.error());
  return 0;
}
