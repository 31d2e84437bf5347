// Compares our robot library with those found when this was built: the same robots and positions in
// one process, in turns, thread CPU time, and every answer compared with ours.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "../support/command_line.hpp"
#include "../support/modules.hpp"
#include "clothctl.hpp"
#include "clothctl/io/file.hpp"
#include "report.hpp"

namespace {

using versus::Entry;
using versus::holds;
using versus::Names;

struct Options {
  std::string models, json, tips = "tip";
  Names files, libraries, parts{"tasks", "near", "random"};
  versus::RunSettings run;
};

[[noreturn]] void refuse(const std::string& message) {
  versus::refuse("bench_versus_robot", message);
}

Options parse(int argc, char** argv) {
  Options o;
  CLI::App app{
      "Our robot library beside others: the same robots and positions in one process, interleaved, "
      "thread CPU time, answers "
      "checked."};
  app.add_option("files", o.files,
                 "URDF files (default with --models: hand34, sia10d_shadow and shadow_hand_right)");
  app.add_option("--models", o.models, "Folder with URDF files");
  app.add_option("--tips", o.tips, "Text in the names of tip links")->capture_default_str();
  app.add_option("--libraries", o.libraries,
                 "Names of libraries besides ours (default: all that were built in)")
      ->delimiter(',')
      ->allow_extra_args(false);
  app.add_option("--parts", o.parts,
                 "What to run: tasks, near and random starts of inverse kinematics")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::IsMember(o.parts))
      ->capture_default_str();
  app.add_option("--rounds", o.run.rounds, "Timed turns of each library at each task")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  app.add_option("--diagonal", o.run.diagonal,
                 "Diagonal that damped dynamics add to the mass matrix")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app.add_option("--targets", o.run.targets, "Targets of inverse kinematics")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  app.add_option("--restarts", o.run.restarts, "Largest number of restarts for a random start")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  app.add_option("--passes", o.run.passes,
                 "Number of solves for each target; its time is their median")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--seed", o.run.seed, "Seed of positions, targets and starts")
      ->capture_default_str();
  app.add_option("--json", o.json, "File for the figures");
  versus::parse(app, argc, argv, refuse);
  if (o.files.empty()) {
    if (o.models.empty()) refuse("name URDF files, or a folder with --models");
    o.files = {"hand34.urdf", "sia10d_shadow.urdf", "shadow_hand_right.urdf"};
  }
  for (std::string& file : o.files) {
    if (!o.models.empty()) file = (std::filesystem::path(o.models) / file).string();
  }
  return o;
}

std::vector<Entry> entries(const Names& chosen) {
  return versus::open_modules<Entry>(versus::clothctl_entry(), VERSUS_MODULES, chosen,
                                     "--libraries", refuse);
}

versus::RobotReport run(const std::vector<Entry>& entries, const std::string& file,
                        const Options& options) {
  versus::RobotReport report;
  if (const std::string fault = versus::describe(file, options.tips, report.model); !fault.empty())
    refuse(fault);
  std::vector<versus::Runner> runners = versus::load(entries, report.model);
  for (const versus::Runner& runner : runners) {
    report.names.push_back(runner.name);
    report.refusals.push_back(runner.refusal);
  }
  if (holds(options.parts, "tasks"))
    report.tasks = versus::run_tasks(runners, report.model, options.run);
  if (holds(options.parts, "near"))
    report.near = versus::run_reach(runners, report.model, true, options.run);
  if (holds(options.parts, "random"))
    report.random = versus::run_reach(runners, report.model, false, options.run);
  return report;
}

}  // namespace

int main(int argc, char** argv) {
  const Options options = parse(argc, argv);
  const std::vector<Entry> libraries = entries(options.libraries);
  versus::print_entries(libraries);
  std::vector<versus::RobotReport> robots;
  for (const std::string& file : options.files) {
    robots.push_back(run(libraries, file, options));
    versus::print_robot(robots.back());
  }
  if (options.json.empty()) return 0;
  const clothctl::Result<std::size_t> written =
      clothctl::write_file(options.json, versus::to_json(libraries, options.run, robots));
  if (!written) refuse(written.error());
  return 0;
}
