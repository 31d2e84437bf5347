// The evaluation of [Bai 2016], section 6.2, and the planning time of its Table 1: many curves, one
// run for each, a page with plots.
//
//   evaluate --study random --seeds 20 --out out/random      then open out/random/report.html
//   evaluate --study random --seeds 20 --out out/random --resume          after it was stopped
//   evaluate … --resume --shard 2/3         a third of the runs, in the same or another folder
//   mpirun -n 8 evaluate …                  the same on processes that see one folder

#include <cstdio>
#include <nlohmann/json.hpp>

#include "support/evaluate_ranks.hpp"
#include "support/evaluate_report.hpp"
#include "support/evaluate_request.hpp"
#include "support/evaluate_run.hpp"

namespace {

using namespace program;

/// Returns which runs of the shard are not in the folder.
std::vector<int> open_jobs(const ResultFolder& folder, const Evaluation& e,
                           const std::vector<Job>& jobs) {
  std::vector<int> open;
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    if (in_shard(jobs[i], e.shard, e.shards) && !folder.read(jobs[i]))
      open.push_back(static_cast<int>(i));
  }
  return open;
}

/// Makes every n-th run of the list and saves it.
void make_runs(const ResultFolder& folder, const Evaluation& e, const std::vector<Case>& cases,
               const std::vector<Job>& jobs, const std::vector<int>& open, const Ranks& ranks) {
  Runner runner;
  Progress progress;
  const auto step = static_cast<std::size_t>(ranks.count());
  for (auto i = static_cast<std::size_t>(ranks.rank()); i < open.size(); i += step) {
    const Job& job = jobs[static_cast<std::size_t>(open[i])];
    const Case& c = cases[static_cast<std::size_t>(job.study_case)];
    progress.set_prefix("run " + std::to_string(i + 1) + " of " + std::to_string(open.size()) +
                        ", " + c.name + ", seed " + std::to_string(job.seed) + ": ");
    const bool shown = open[i] == 0 && cases.size() == 1;  // its positions are plotted
    const std::string files = shown ? folder.path() + "/" + first_run_folder() : "";
    folder.save(job, runner.run(e, c, job.seed, files, progress));
  }
}

}  // namespace

int main(int argc, char** argv) {
  const Ranks ranks(&argc, &argv);
  EvaluationRequest request;
  ranks.first_alone([&] { request = read_evaluation(argc, argv); });
  Evaluation& e = request.evaluation;
  e.run.second_thread = ranks.count() == 1;  // processes have one processor each
  const std::vector<Case> cases = make_cases(e, request.shortest);
  const std::vector<Job> jobs = make_jobs(static_cast<int>(cases.size()), e.seeds);
  const nlohmann::ordered_json settings = settings_json(e);
  if (ranks.first()) const ResultFolder made(e.run.out, settings, e.resume);
  ranks.wait();
  const ResultFolder folder(e.run.out, settings, true);
  std::vector<int> open;
  if (ranks.first()) open = open_jobs(folder, e, jobs);
  ranks.share(open);
  make_runs(folder, e, cases, jobs, open, ranks);
  ranks.wait();
  if (!ranks.first()) return 0;
  std::vector<Row> rows;
  for (const Job& job : jobs) {
    if (const auto row = folder.read(job)) rows.push_back(*row);
  }
  const nlohmann::ordered_json summary = summarise(e, cases, rows, jobs.size());
  write_report(folder, e, cases, rows, summary);
  if (e.run.json) {
    std::printf("%s\n", summary.dump().c_str());
  } else {
    print_summary(summary, folder);
  }
  return 0;
}
