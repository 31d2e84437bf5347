// Planning a frame the way of the paper, with the fastest third-party QP solver that was found when
// this was built, beside our planners: the same recorded frames in one process, in turns, thread
// CPU time, with the parts of a frame. Both must plan the same first force where they have the same
// model and precision; otherwise this fails.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>
#include <vector>

#include "../versus/support/command_line.hpp"
#include "clothctl/io/file.hpp"
#include "report.hpp"

namespace {

struct Options {
  std::string json;
  versus::Names solvers;
  planner_bench::RunSettings run;
};

[[noreturn]] void refuse(const std::string& message) { versus::refuse("bench_planner", message); }

Options parse(int argc, char** argv) {
  Options o;
  CLI::App app{
      "A frame of planning: the paper's procedure beside our planners, on the same frames."};
  const auto number = [&](const char* name, auto& value, int least, int most, const char* help) {
    app.add_option(name, value, help)->check(CLI::Range(least, most))->capture_default_str();
  };
  const auto list = [&](const char* name, std::vector<int>& value, const char* help) {
    app.add_option(name, value, help)
        ->delimiter(',')
        ->check(CLI::Range(4, 513))
        ->capture_default_str();
  };
  list("--sizes", o.run.sizes, "Vertices along a side of the sheets");
  list("--baseline-sizes", o.run.baseline_sizes, "Sizes at which the baseline takes part");
  number("--frames", o.run.frames, 1, 100000, "Frames of each size");
  number("--baseline-frames", o.run.baseline_frames, 1, 100000,
         "How many of these the baseline plans, evenly spread");
  number("--horizon", o.run.horizon, 1, 100, "Frames of the window");
  app.add_option("--solvers", o.solvers,
                 "QP solvers of the baseline, of which the fastest serves (default: all that were "
                 "built in)")
      ->delimiter(',');
  app.add_option("--json", o.json, "File for the figures");
  versus::parse(app, argc, argv, refuse);
  return o;
}

/// The third-party solvers that were built in.
std::vector<versus::Entry> third_party(const versus::Names& chosen) {
  std::vector<versus::Entry> some;
  for (const versus::Entry& e : versus::all_entries()) {
    if (e.name != "clothctl" && (chosen.empty() || versus::holds(chosen, e.name)))
      some.push_back(e);
  }
  if (some.empty() && !chosen.empty())
    refuse("--solvers: none of '" + CLI::detail::join(chosen) + "' is built in");
  return some;
}

}  // namespace

int main(int argc, char** argv) {
  const Options options = parse(argc, argv);
  const std::vector<versus::Entry> solvers = third_party(options.solvers);
  if (solvers.empty())
    std::printf(
        "The baseline is missing: no third-party QP solver was found when this was built.\n");
  std::printf(
      "ratio, ratio 2: times of the baseline with Eigen's factor and with ours, over this\n"
      "input: first input, relative to the baseline's; KKT: residual in the baseline's QP\n");
  std::vector<planner_bench::SizeReport> reports;
  for (const int n : options.run.sizes) {
    reports.push_back(planner_bench::run_size(options.run, n, solvers));
    planner_bench::print_size(options.run, reports.back());
  }
  planner_bench::print_growth(reports);
  if (!options.json.empty()) {
    const clothctl::Result<std::size_t> written =
        clothctl::write_file(options.json, planner_bench::to_json(options.run, reports));
    if (!written) refuse(written.error());
  }
  const std::string problem = planner_bench::problem_with(reports);
  if (problem.empty()) return 0;
  std::fprintf(stderr, "bench_planner: %s\n", problem.c_str());
  return 1;
}
