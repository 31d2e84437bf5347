#include "run.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <memory>

#include "clothctl/qp/kkt.hpp"

namespace planner_bench {

namespace {

using Contenders = std::vector<std::unique_ptr<Contender>>;

double worst_residual(const versus::Problem& p, const VectorX<double>& d,
                      const VectorX<double>& z) {
  const VectorX<double> none;
  return kkt_residuals(p.H, p.first.g, p.A, none, none, p.first.lb, p.first.ub, d, none, z).worst();
}

/// Solves the QP of the first frame cold with each solver.
void try_solvers(const Scene& scene, Index horizon, const std::vector<versus::Entry>& solvers,
                 SizeReport& report) {
  for (const versus::Entry& entry : solvers) {
    Candidate c{entry.name, entry.version, 0, std::numeric_limits<double>::infinity()};
    const std::unique_ptr<Contender> paper = make_baseline(scene, horizon, Factor::Ours, entry);
    Phases times;
    try {
      if (paper->plan(scene.frames.front(), times) && paper->plan(scene.frames.front(), times))
        c.kkt = worst_residual(*paper->problem(), paper->d, paper->z);
    } catch (const std::exception&) {
    }
    c.seconds = times.qp;
    const auto better = [&](const Candidate& other) { return c.seconds < other.seconds; };
    if (c.kkt <= kSolved &&
        (report.chosen < 0 || better(report.candidates[static_cast<std::size_t>(report.chosen)])))
      report.chosen = static_cast<int>(report.candidates.size());
    report.candidates.push_back(c);
  }
}

Contenders make_contenders(const RunSettings& settings, const Scene& scene,
                           const versus::Entry* solver) {
  const Index k = settings.horizon;
  Contenders all;
  if (solver != nullptr) {
    for (Factor f : {Factor::Eigen, Factor::Ours})
      all.push_back(make_baseline(scene, k, f, *solver));
  }
  for (Prediction p : {Prediction::Linearised, Prediction::LinearisedFloat, Prediction::Rollout})
    all.push_back(make_planner(scene, k, p, GripInput::Force));
  if (scene.n > kCoarse)
    all.push_back(make_planner(scene, k, Prediction::Coarse, GripInput::Force));
  all.push_back(make_planner(scene, k, Prediction::LinearisedFloat, GripInput::Pose));
  return all;
}

/// Compares what the contenders made of a frame with the first of them, a baseline.
void compare(const Contenders& all, std::vector<Row>& rows) {
  const Contender& paper = *all.front();
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!all[i]->has_same_model() || all[i]->d.size() != paper.d.size()) continue;
    const double difference = (all[i]->first - paper.first).norm() / paper.first.norm();
    const double kkt = worst_residual(*paper.problem(), all[i]->d, all[i]->z);
    if (!(difference <= rows[i].difference)) rows[i].difference = difference;
    if (!(kkt <= rows[i].kkt)) rows[i].kkt = kkt;
  }
}

}  // namespace

double Row::quantile(double Phases::*part, double q) const {
  std::vector<double> values;
  for (const Phases& f : frames) values.push_back(f.*part);
  return versus::quantile(std::move(values), q);
}

double SizeReport::median(const std::string& name) const {
  for (const Row& row : rows) {
    if (row.name == name) return row.quantile(&Phases::total, 0.5);
  }
  return std::numeric_limits<double>::quiet_NaN();
}

SizeReport run_size(const RunSettings& settings, int n, const std::vector<versus::Entry>& solvers) {
  SizeReport report;
  report.n = n;
  Scene scene = Scene::make(n);
  scene.record(settings.frames, settings.horizon);
  const auto& with = settings.baseline_sizes;
  if (std::find(with.begin(), with.end(), n) != with.end())
    try_solvers(scene, settings.horizon, solvers, report);
  const versus::Entry* solver = nullptr;
  if (report.chosen >= 0) solver = &solvers[static_cast<std::size_t>(report.chosen)];
  const Contenders all = make_contenders(settings, scene, solver);
  for (const auto& c : all) {
    report.rows.push_back({});
    report.rows.back().name = c->name();
    report.rows.back().baseline = c->is_baseline();
    report.rows.back().exact = c->name() == "linearised, double";
    if (solver == nullptr || !c->has_same_model())
      report.rows.back().difference = report.rows.back().kkt =
          std::numeric_limits<double>::quiet_NaN();
  }
  const int stride = std::max(1, settings.frames / settings.baseline_frames);
  for (int k = 0; k < settings.frames; ++k) {
    const Frame& frame = scene.frames[static_cast<std::size_t>(k)];
    const bool paper = solver != nullptr && k % stride == 0;
    for (std::size_t turn = 0; turn < all.size(); ++turn) {
      const std::size_t i = k / stride % 2 == 0 ? turn : all.size() - 1 - turn;
      if (all[i]->is_baseline() && !paper) continue;
      Phases times;
      if (!all[i]->plan(frame, times)) ++report.rows[i].failures;
      report.rows[i].frames.push_back(times);
    }
    if (paper) compare(all, report.rows);
  }
  return report;
}

}  // namespace planner_bench
