#include "report.hpp"

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace versus {

namespace {

const char* name_of(Start start) { return start == Start::Shifted ? "shift" : "keep"; }

/// The time of our faster way through a sequence, or NaN if there is none.
double own_median(const std::vector<LaneResult>& lanes) {
  double best = std::nan("");
  for (const LaneResult& lane : lanes) {
    if (lane.solver == "clothctl" && lane.finished && !(lane.warm_median() >= best))
      best = lane.warm_median();
  }
  return best;
}

/// Three significant digits, or a dash.
std::string short_text(double value) {
  if (!std::isfinite(value)) return "-";
  char text[32];
  const int digits = value >= 100 ? 0 : value >= 10 ? 1 : value >= 1 ? 2 : value >= 0.1 ? 3 : 4;
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

using Json = nlohmann::ordered_json;

Json to_json(const SetResult& r) {
  Json problems = Json::array();
  for (const SingleResult& p : r.problems) {
    problems.push_back({{"problem", p.problem},
                        {"verdict", to_string(p.verdict)},
                        {"right", p.judgement.right},
                        {"false_status", p.judgement.false_status},
                        {"kkt_stationarity", p.judgement.residuals.relative_stationarity},
                        {"kkt_feasibility", p.judgement.residuals.relative_feasibility},
                        {"kkt_complementarity", p.judgement.residuals.relative_complementarity},
                        {"cold_ms", 1e3 * p.seconds}});
  }
  return {{"solver", r.solver},
          {"solved", r.right()},
          {"absolute", r.absolute()},
          {"false_statuses", r.false_statuses()},
          {"mean_ms", 1e3 * r.mean(false)},
          {"mean_solved_ms", 1e3 * r.mean(true)},
          {"slowest_ms", 1e3 * r.slowest()},
          {"problems", problems}};
}

Json to_json(const LaneResult& lane, double own) {
  return {{"solver", lane.solver},
          {"start", name_of(lane.start)},
          {"frames", lane.frames},
          {"right", lane.right},
          {"false_statuses", lane.false_statuses},
          {"cold_median_ms", 1e3 * lane.cold_median()},
          {"warm_median_ms", 1e3 * lane.warm_median()},
          {"warm_p99_ms", 1e3 * lane.warm_p99()},
          {"ratio", lane.warm_median() / own},
          {"finished", lane.finished},
          {"first_miss", lane.first_miss}};
}

}  // namespace

void print_solvers(const std::vector<Entry>& entries) {
  for (const Entry& e : entries) std::printf("%s %s\n", e.name.c_str(), e.version.c_str());
}

void print_set(const std::string& name, const std::vector<SetResult>& results) {
  if (results.empty()) return;
  std::printf("\n%s (%zu), cold, times in ms\n", name.c_str(), results.front().problems.size());
  std::printf("  %-12s %6s %6s %6s %10s %12s %10s\n", "solver", "solved", "abs", "false", "mean",
              "mean solved", "slowest");
  for (const SetResult& r : results) {
    std::printf("  %-12s %6d %6d %6d %10s %12s %10s\n", r.solver.c_str(), r.right(), r.absolute(),
                r.false_statuses(), short_text(1e3 * r.mean(false)).c_str(),
                short_text(1e3 * r.mean(true)).c_str(),
                short_text(r.right() > 0 ? 1e3 * r.slowest() : std::nan("")).c_str());
  }
  for (const SetResult& r : results) {
    std::string misses;
    std::size_t unsupported = 0;
    for (const SingleResult& p : r.problems) {
      if (p.verdict == Verdict::Unsupported) ++unsupported;
      if (p.judgement.right || p.verdict == Verdict::Unsupported) continue;
      misses.append(" ").append(p.problem).append(":").append(to_string(p.verdict));
      if (p.judgement.false_status) misses += "(false)";
    }
    if (unsupported > 0)
      misses.append(" and ").append(std::to_string(unsupported)).append(" unsupported");
    if (!misses.empty()) std::printf("  %s misses%s\n", r.solver.c_str(), misses.c_str());
  }
  std::fflush(stdout);
}

void print_sequence(const SequenceReport& report) {
  const double own = own_median(report.lanes);
  std::printf("\n%s (n %ld, m %ld), times in ms\n", report.name.c_str(),
              static_cast<long>(report.n), static_cast<long>(report.m));
  std::printf("  %-12s %-6s %9s %9s %9s %8s %6s %8s\n", "solver", "start", "cold", "warm", "p99",
              "right", "false", "ratio");
  for (const LaneResult& lane : report.lanes) {
    if (lane.frames == 0) continue;
    std::printf("  %-12s %-6s %9s %9s %9s %5d/%-2d %6d %8s%s\n", lane.solver.c_str(),
                name_of(lane.start), short_text(1e3 * lane.cold_median()).c_str(),
                short_text(1e3 * lane.warm_median()).c_str(),
                short_text(1e3 * lane.warm_p99()).c_str(), lane.right, lane.frames,
                lane.false_statuses, short_text(lane.warm_median() / own).c_str(),
                lane.finished ? "" : "  (over the time limit)");
    if (!lane.first_miss.empty()) std::printf("    first miss: %s\n", lane.first_miss.c_str());
  }
  std::fflush(stdout);
}

std::string to_json(const Report& report) {
  Json solvers = Json::array(), sets = Json::array(), sequences = Json::array();
  for (const Entry& e : report.entries)
    solvers.push_back({{"name", e.name}, {"version", e.version}});
  for (const auto& [name, results] : report.sets) {
    Json items = Json::array();
    for (const SetResult& r : results) items.push_back(to_json(r));
    sets.push_back({{"set", name}, {"results", items}});
  }
  for (const SequenceReport& s : report.sequences) {
    Json items = Json::array();
    for (const LaneResult& lane : s.lanes) {
      if (lane.frames > 0) items.push_back(to_json(lane, own_median(s.lanes)));
    }
    sequences.push_back({{"sequence", s.name}, {"n", s.n}, {"m", s.m}, {"results", items}});
  }
  const Json all{{"solvers", solvers},
                 {"passes", report.settings.passes},
                 {"time_limit_s", report.settings.time_limit},
                 {"block", report.settings.block},
                 {"tolerance", kTolerance},
                 {"sets", sets},
                 {"sequences", sequences}};
  return all.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace versus
