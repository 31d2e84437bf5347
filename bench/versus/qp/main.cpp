// Compares our QP solvers with those found when this was built: the same problems in one process,
// in turns, thread CPU time, and every answer checked on the unscaled data.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "../support/command_line.hpp"
#include "clothctl/io/file.hpp"
#include "report.hpp"

namespace {

using versus::Entry;
using versus::holds;
using versus::Names;

struct Options {
  std::string data, json;
  Names sets{"mm", "a", "b", "c", "d", "e"}, solvers;
  versus::RunSettings run;
};

[[noreturn]] void refuse(const std::string& message) { versus::refuse("bench_versus_qp", message); }

Options parse(int argc, char** argv) {
  Options o;
  CLI::App app{
      "Our QP solvers beside others: the same problems in one process, interleaved, thread CPU "
      "time, answers judged."};
  app.add_option("--data", o.data, "Folder with maros_meszaros/*.qpt and synthetic/*.qpt")
      ->required();
  app.add_option("--sets", o.sets,
                 "Problems: mm is Maros-Meszaros, a to e synthetic; e are the sequences")
      ->delimiter(',')
      ->check(CLI::IsMember(o.sets))
      ->capture_default_str();
  Names built;
  for (const Entry& e : versus::all_entries()) built.push_back(e.name);
  app.add_option("--solvers", o.solvers, "Solvers by name (default: all that were built in)")
      ->delimiter(',')
      ->check(CLI::IsMember(built));
  app.add_option("--passes", o.run.passes, "Times are the least of this many passes")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--block", o.run.block,
                 "Frames of a sequence that a solver does in a row before the next takes its turn; "
                 "0 means all")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  app.add_option("--time-limit", o.run.time_limit,
                 "Seconds after which a solver is told to give up, and a pass over a sequence ends")
      ->check(CLI::Range(1e-3, 1e5))
      ->capture_default_str();
  app.add_option("--json", o.json, "File for the figures");
  versus::parse(app, argc, argv, refuse);
  return o;
}

std::vector<Entry> entries(const Names& chosen) {
  const std::vector<Entry> all = versus::all_entries();
  if (chosen.empty()) return all;
  std::vector<Entry> some;
  for (const Entry& e : all) {
    if (holds(chosen, e.name)) some.push_back(e);
  }
  return some;
}

/// Returns the QPT files of a folder whose names begin with `prefix`, sorted.
std::vector<std::string> files(const std::filesystem::path& folder, const std::string& prefix) {
  std::vector<std::string> found;
  std::error_code error;
  for (const auto& item : std::filesystem::directory_iterator(folder, error)) {
    const std::string name = item.path().filename().string();
    if (name.rfind(prefix, 0) == 0 && item.path().extension() == ".qpt")
      found.push_back(item.path().string());
  }
  if (found.empty()) refuse("no " + prefix + "*.qpt in " + folder.string());
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace

int main(int argc, char** argv) {
  const Options options = parse(argc, argv);
  const std::filesystem::path data(options.data);
  versus::Report report;
  report.entries = entries(options.solvers);
  report.settings = options.run;
  versus::print_solvers(report.entries);
  const auto set = [&](const char* key, const char* name, const char* folder, const char* prefix) {
    if (!holds(options.sets, key)) return;
    report.sets.emplace_back(
        name, versus::run_set(report.entries, files(data / folder, prefix), options.run));
    versus::print_set(name, report.sets.back().second);
  };
  set("mm", "maros_meszaros", "maros_meszaros", "");
  set("a", "a strictly convex", "synthetic", "a_");
  set("b", "b semidefinite and linear", "synthetic", "b_");
  set("c", "c infeasible", "synthetic", "c_inf");
  set("c", "c unbounded", "synthetic", "c_unb");
  set("d", "d redundant equalities", "synthetic", "d_");
  if (holds(options.sets, "e")) {
    for (const std::string& file : files(data / "synthetic", "e_")) {
      const clothctl::QpProblem sequence = versus::load(file);
      if (sequence.frames.empty()) refuse(file + " is not a sequence");
      report.sequences.push_back({sequence.name, sequence.n(), sequence.m(),
                                  versus::run_sequence(report.entries, sequence, options.run)});
      versus::print_sequence(report.sequences.back());
    }
  }
  if (options.json.empty()) return 0;
  const clothctl::Result<std::size_t> written =
      clothctl::write_file(options.json, versus::to_json(report));
  if (!written) refuse(written.error());
  return 0;
}
