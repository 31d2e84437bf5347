// Says of many random curves whether a sheet can follow them, then lets a planner try.
//
//   reachability --seeds 200 --out out          then open out/curves.csv

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "clothctl/mpc/reachability.hpp"
#include "support/command_line.hpp"
#include "support/reach_table.hpp"
#include "support/reach_trial.hpp"
#include "support/timing.hpp"

namespace {

using namespace program;

struct Request {
  Options run;
  std::uint64_t first = 3001;
  int seeds = 200;
  double seconds = 4, tolerance_mm = 10;
};

Request read_request(int argc, char** argv) {
  Request r;
  Options& o = r.run;
  o.cloth = 9;
  o.grip = "position";
  o.second_thread = false;  // small sheets do not gain by it
  CLI::App app{
      "Says of random curves of eight kinds whether the lower corners of a handkerchief can follow "
      "them, then lets a planner try. Seeds 1 to 800 are those that the prediction was fitted to."};
  app.add_option("--first", r.first, "First seed")->check(seed_number())->capture_default_str();
  app.add_option("--seeds", r.seeds, "Number of curves")
      ->check(between(1, 100000))
      ->capture_default_str();
  app.add_option("--seconds", r.seconds, "Duration of the curves, s")
      ->check(between(3.5, 60))
      ->capture_default_str();
  app.add_option("--tolerance", r.tolerance_mm,
                 "Mean error that counts as success, if no error is over five times that, mm")
      ->check(between(0.01, 1000))
      ->capture_default_str();
  add_sheet(app, o.cloth, o.size, o.material);
  add_planner(app, o);
  app.add_flag("--json", o.json, "Print the summary as one JSON object on the last line");
  app.add_option("--out", o.out, "Folder for curves.csv (made if missing)");
  parse(app, o, argc, argv);
  if (r.seconds / 0.02 < o.horizon + 50)
    refuse("--seconds: must be at least a second over the --horizon");
  make_folder(o.out);
  return r;
}

/// How many curves got each verdict, and how many of them were followed.
struct Tally {
  int called[3] = {0, 0, 0}, succeeded[3] = {0, 0, 0};
  int unfinished = 0;
  double log_error = 0;  // sum over curves; 1 m for those that do not finish
};

/// Judges and tries the curve of a seed, and adds it to table and tally.
void try_curve(const Request& r, const ReachBench& bench,
               const clothctl::ReachLimits<double>& limits, std::uint64_t seed,
               clothctl::CsvWriter& table, Tally& tally, Progress& progress) {
  std::string kind;
  const Task task = bench.curve(seed, r.seconds, kind);
  const double tolerance = r.tolerance_mm / 1000;
  const auto target = [&](Index i, double t) {
    return task.curves[static_cast<std::size_t>(i)].position(t);
  };
  const auto report = must(clothctl::assess_reachability(
      limits, target, 0.0, r.seconds - 0.02 * r.run.horizon, {tolerance, 5 * tolerance}));
  const Summary run = bench.run(task, progress);
  const bool finished = run.status == "finished" || run.status == "lost the track";
  const bool success =
      run.status == "finished" && run.mean_error_m <= tolerance && run.max_error_m <= 5 * tolerance;
  const auto verdict = static_cast<std::size_t>(report.verdict);
  ++tally.called[verdict];
  tally.succeeded[verdict] += success ? 1 : 0;
  tally.unfinished += finished ? 0 : 1;
  tally.log_error += std::log(finished ? std::max(run.mean_error_m, 1e-6) : 1.0);
  add_row({seed, report, run, finished, success}, table);
}

double share(int part, int all) { return all > 0 ? static_cast<double>(part) / all : 0.0; }

void print_tally(const Request& r, const Scene& scene, const Tally& t) {
  nlohmann::ordered_json j;
  j["status"] = "finished";
  j["curves"] = r.seeds;
  j["unfinished"] = t.unfinished;
  j["succeeded"] = t.succeeded[0] + t.succeeded[1] + t.succeeded[2];
  j["typical_error_m"] = std::exp(t.log_error / r.seeds);  // a geometric mean over curves
  j["called_reachable"] = t.called[0];
  j["reachable_succeeded_share"] = share(t.succeeded[0], t.called[0]);
  j["called_doubtful"] = t.called[1];
  j["doubtful_succeeded_share"] = share(t.succeeded[1], t.called[1]);
  j["called_unreachable"] = t.called[2];
  j["unreachable_failed_share"] = share(t.called[2] - t.succeeded[2], t.called[2]);
  j["setup"] = setup_json(scene, r.run);
  j["setup"]["first"] = r.first;
  j["setup"]["seconds"] = r.seconds;
  j["setup"]["tolerance_m"] = r.tolerance_mm / 1000;
  if (r.run.json) {
    std::printf("%s\n", j.dump().c_str());
    return;
  }
  const char* names[3] = {"reachable", "doubtful", "unreachable"};
  std::printf("%d of %d curves were followed\n", j["succeeded"].get<int>(), r.seeds);
  for (std::size_t v = 0; v < 3; ++v)
    std::printf("called %-12s %3d, of which %5.1f %% succeeded\n", names[v], t.called[v],
                100 * share(t.succeeded[v], t.called[v]));
}

}  // namespace

int main(int argc, char** argv) {
  const Request r = read_request(argc, argv);
  const ReachBench bench(r.run);
  const auto limits = must(clothctl::make_reach_limits(
      bench.scene().setup, bench.scene().settings, bench.scene().body.network, bench.positions()));
  clothctl::CsvWriter table = reach_table();
  Tally tally;
  Progress progress;
  for (int i = 0; i < r.seeds; ++i) {
    progress.set_prefix("curve " + std::to_string(i + 1) + " of " + std::to_string(r.seeds) + ": ");
    try_curve(r, bench, limits, r.first + static_cast<std::uint64_t>(i), table, tally, progress);
  }
  if (!r.run.out.empty()) {
    if (const auto written = table.write(r.run.out + "/curves.csv"); !written)
      refuse(written.error());
  }
  print_tally(r, bench.scene(), tally);
  return 0;
}
