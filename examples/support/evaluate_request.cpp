#include "support/evaluate_request.hpp"

#include <algorithm>
#include <cmath>

#include "support/command_line.hpp"
#include "support/inputs.hpp"
#include "support/tasks.hpp"

namespace program {

namespace {

/// Checks the curves of all runs; returns the frames of the shortest.
long check_curves(const Evaluation& e) {
  if (e.curves.empty()) return std::lround(e.seconds / 0.02);
  long shortest = 1000000;
  for (const std::string& file : e.curves) {
    Options o = e.run;
    o.targets = file;
    const Task task = read_task(o);
    if (task.curves.size() != 2)
      refuse(file + ": has " + std::to_string(task.curves.size()) +
             " curves for 2 corners of the sheet");
    shortest = std::min(shortest, std::lround(task.duration / 0.02));
  }
  return shortest;
}

/// Refuses what cannot be combined, and sets what the study decides.
void complete(const CLI::App& app, const std::string& shard, Evaluation& e) {
  for (const std::string& option : options_set_by(e.study)) {
    if (app.count(option) > 0) refuse(option + ": study " + e.study + " sets it itself");
  }
  if (!shard.empty()) read_shard(shard, e);
  if (e.study == "table1" && app.count("--cloth") == 0) e.run.cloth = 65;
  if (is_curve_kind(e.study)) e.kind = e.study;
  if (e.kind.empty()) e.kind = e.study == "sd" || e.study == "table1" ? "random" : "known";
  e.curves = curve_files(e.curves);
  const int files = static_cast<int>(e.curves.size());
  if (files == 0) return;
  if (app.count("--seeds") == 0) e.seeds = files;
  if (e.seeds > files)
    refuse("--seeds: " + std::to_string(e.seeds) + " is more than the " + std::to_string(files) +
           " files of --curves");
  e.curves.resize(static_cast<std::size_t>(e.seeds));
}

}  // namespace

EvaluationRequest read_evaluation(int argc, char** argv) {
  EvaluationRequest request;
  Evaluation& e = request.evaluation;
  Options& o = e.run;
  CLI::App app{"Measures how well the lower corners of a handkerchief follow many curves."};
  app.add_option("--study", e.study,
                 "known, random: error of curves with and without a known solution; fast: known "
                 "ones at twice the speed; sd: against the noise of curves; window: against the "
                 "window size; plants: of all plants and grips; mismatch: of sheets that differ "
                 "from the predicted one; table1: time by size of the sheet, up to --cloth "
                 "(default: 65)")
      ->check(CLI::IsMember(study_names()))
      ->required();
  app.add_option(
         "--kind", e.kind,
         "Curves of the other studies: known, fast or random (default: random for sd and table1)")
      ->check(CLI::IsMember(curve_kinds()));
  app.add_option("--seeds", e.seeds, "Curves of each case, from seeds 1, 2, …")
      ->check(between(1, 100000))
      ->capture_default_str();
  CLI::Option* seconds = app.add_option("--seconds", e.seconds, "Duration of the curves, s")
                             ->check(between(0.2, 600))
                             ->capture_default_str();
  app.add_option("--curves", e.curves,
                 "CSV files with a header t,Lx,Ly,Lz,Rx,Ry,Rz, or folders of them, instead of "
                 "curves from seeds")
      ->excludes(seconds);
  add_sheet(app, o.cloth, o.size, o.material, "Vertices along a side; 65 is the paper's sheet");
  add_model(app, o.model);
  add_planner(app, o);
  add_measurement(app, o);
  std::string shard;
  app.add_option("--shard", shard, "i/n: only the runs of part i of n");
  app.add_flag("--resume", e.resume, "Go on with the runs in --out");
  app.add_flag("--json", o.json, "Print the summary as one JSON object on the last line");
  app.add_option("--out", o.out, "Folder of all results; needed")->required();
  parse(app, o, argc, argv);
  complete(app, shard, e);
  request.shortest = check_curves(e);
  if (e.study != "window" && request.shortest <= o.horizon)
    refuse((e.curves.empty() ? "--seconds" : "--curves") + std::string(": ") +
           std::to_string(request.shortest) + " frames of 0.02 s, must be over the --horizon of " +
           std::to_string(o.horizon));
  return request;
}

}  // namespace program
