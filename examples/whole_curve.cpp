// How far is the planner from the best that hands can do on a whole curve?
//
//   whole_curve --kind random --seeds 5 --out out          then open out/curves.csv

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <vector>

#include "clothctl/io/csv.hpp"
#include "support/command_line.hpp"
#include "support/inputs.hpp"
#include "support/whole_trial.hpp"

namespace {

using namespace program;

struct WholeCurveRequest {
  Options run;
  WholeTrialOptions trial;
  std::vector<std::string> curves;
  std::uint64_t first = 1;
  int seeds = 5;
};

WholeCurveRequest read_whole_curve(int argc, char** argv) {
  WholeCurveRequest r;
  Options& o = r.run;
  o.cloth = 9;
  o.grip = "position";
  CLI::App app{
      "Compares a planner that moves the upper corners of a handkerchief with the best paths of "
      "hands for the whole curve, found with the curve known from start to end."};
  CLI::Option* kind =
      app.add_option("--kind", r.trial.kind,
                     "Curves from seeds: known (a hand path produces them) or random")
          ->check(CLI::IsMember({"known", "random"}))
          ->capture_default_str();
  app.add_option("--first", r.first, "First seed")->check(seed_number())->capture_default_str();
  app.add_option("--seeds", r.seeds, "Number of curves from seeds")
      ->check(between(1, 100000))
      ->capture_default_str();
  CLI::Option* seconds = app.add_option("--seconds", r.trial.seconds, "Duration of these curves, s")
                             ->check(between(0.5, 60))
                             ->capture_default_str();
  app.add_option("--curves", r.curves,
                 "CSV files with a header t,Lx,Ly,Lz,Rx,Ry,Rz, or folders of them, instead of "
                 "curves from seeds")
      ->excludes(seconds)
      ->excludes(kind);
  app.add_option(
         "--hand-weight", r.trial.hand_weight,
         "Factor on the planner's weights of the hands' motion in the cost of a whole curve")
      ->check(between(1e-4, 1e4))
      ->capture_default_str();
  app.add_option("--start", r.trial.start,
                 "Where the search starts: from the path of the planner, of the hand anchor, or "
                 "from both; the better end counts")
      ->check(CLI::IsMember({"planner", "anchor", "both"}))
      ->capture_default_str();
  app.add_option("--iterations", r.trial.iterations, "Largest number of iterations from a start")
      ->check(between(0, 10000))
      ->capture_default_str();
  app.add_option("--horizon", o.horizon, "Frames in the planner's window")
      ->check(between(1, 200))
      ->capture_default_str();
  add_sheet(app, o.cloth, o.size, o.material);
  app.add_flag("--json", o.json, "Print the summary as one JSON object on the last line");
  app.add_option("--out", o.out, "Folder for curves.csv and the best hands of each curve");
  parse(app, argc, argv);
  r.curves = curve_files(r.curves);
  if (!r.curves.empty()) r.seeds = static_cast<int>(r.curves.size());
  o.plant = "newton";
  o.model = o.cloth;  // the planner predicts with the plant's own vertices
  make_folder(o.out);
  return r;
}

void save(const clothctl::CsvWriter& table, const std::string& file) {
  if (const auto written = table.write(file); !written) refuse(written.error());
}

/// Writes the best path of both hands.
void save_hands(const WholeTrial& trial, const std::string& file) {
  clothctl::CsvWriter table({"t", "Lx", "Ly", "Lz", "Rx", "Ry", "Rz"});
  for (Index k = 0; k < trial.hands.cols(); ++k) {
    std::vector<double> row{0.02 * static_cast<double>(k + 1)};
    for (Index i = 0; i < 6; ++i) row.push_back(trial.hands(i, k));
    table.add_row(row);
  }
  save(table, file);
}

}  // namespace

int main(int argc, char** argv) {
  const WholeCurveRequest r = read_whole_curve(argc, argv);
  clothctl::CsvWriter table({"curve", "planner_mean_error_m", "planner_max_error_m",
                             "optimum_mean_error_m", "optimum_max_error_m", "planner_cost",
                             "optimum_cost", "planner_hand_speed_max", "optimum_hand_speed_max",
                             "gradient_norm", "iterations", "products", "rollouts", "optimise_s"});
  double planner = 0, optimum = 0, seconds = 0, planner_max = 0, optimum_max = 0;
  int converged = 0, finished = 0;
  Progress progress;
  for (int i = 0; i < r.seeds; ++i) {
    Options o = r.run;
    if (!r.curves.empty()) o.targets = r.curves[static_cast<std::size_t>(i)];
    const WholeTrial t =
        run_whole_trial(o, r.trial, r.first + static_cast<std::uint64_t>(i), progress);
    const WholeFigures &p = t.planner, &b = t.optimum;
    std::printf(
        "%-12s planner %6.2f mm (largest %6.2f), best %6.2f mm (%6.2f), cost %.3g to %.3g, "
        "%s, %.0f s\n",
        t.name.c_str(), 1000 * p.mean_error_m, 1000 * p.max_error_m, 1000 * b.mean_error_m,
        1000 * b.max_error_m, p.cost, b.cost, t.optimum_status.c_str(), t.optimise_s);
    std::fflush(stdout);
    table.add_row({static_cast<double>(i + 1), p.mean_error_m, p.max_error_m, b.mean_error_m,
                   b.max_error_m, p.cost, b.cost, p.hand_speed_max, b.hand_speed_max,
                   t.gradient_norm, static_cast<double>(t.iterations),
                   static_cast<double>(t.products), static_cast<double>(t.rollouts), t.optimise_s});
    if (!r.run.out.empty()) save_hands(t, r.run.out + "/hands_" + std::to_string(i + 1) + ".csv");
    planner += p.mean_error_m / r.seeds;
    optimum += b.mean_error_m / r.seeds;
    seconds += t.optimise_s / r.seeds;
    planner_max = std::max(planner_max, p.max_error_m);
    optimum_max = std::max(optimum_max, b.max_error_m);
    converged += t.optimum_status == "converged" ? 1 : 0;
    finished += t.status == "finished" ? 1 : 0;
  }
  if (!r.run.out.empty()) save(table, r.run.out + "/curves.csv");
  nlohmann::ordered_json j{{"status", finished == r.seeds ? "finished" : "planner failed"},
                           {"curves", r.seeds},
                           {"planner_mean_error_m", planner},
                           {"planner_max_error_m", planner_max},
                           {"optimum_mean_error_m", optimum},
                           {"optimum_max_error_m", optimum_max},
                           {"converged", converged},
                           {"optimise_s_mean", seconds}};
  j["setup"] = {{"cloth", r.run.cloth}, {"horizon", r.run.horizon}, {"start", r.trial.start}};
  if (r.run.json) {
    std::printf("%s\n", j.dump().c_str());
  } else {
    std::printf("mean: planner %.2f mm, best %.2f mm\n", 1000 * planner, 1000 * optimum);
  }
  return finished == r.seeds ? 0 : 1;
}
