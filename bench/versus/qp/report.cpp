#include "report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <initializer_list>

#include "clothctl/core/number_text.hpp"

namespace versus {

namespace {

const char* name_of(Start start) { return start == Start::Shifted ? "shift" : "keep"; }

/// The faster of our own ways through a sequence; NaN where there is none.
double own_median(const std::vector<LaneResult>& lanes) {
  double best = std::nan("");
  for (const LaneResult& lane : lanes) {
    if (lane.solver == "clothctl" && lane.finished && !(lane.warm_median() >= best)) best = lane.warm_median();
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

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return out + "\"";
}

std::string number(double value) { return std::isfinite(value) ? clothctl::number_text(value) : "null"; }

using Member = std::pair<const char*, std::string>;

std::string object(std::initializer_list<Member> members) {
  std::string out = "{";
  for (const Member& m : members) {
    if (out.size() > 1) out += ", ";
    out.append(quoted(m.first)).append(": ").append(m.second);
  }
  return out + "}";
}

std::string array(const std::vector<std::string>& items, const char* separator) {
  std::string out = "[";
  for (const std::string& item : items) {
    if (out.size() > 1) out += ",";
    out.append(separator).append(item);
  }
  return out + "]";
}

std::string to_json(const SetResult& r) {
  std::vector<std::string> problems;
  for (const SingleResult& p : r.problems) {
    problems.push_back(object({{"problem", quoted(p.problem)},
                               {"verdict", quoted(std::string(to_string(p.verdict)))},
                               {"right", p.judgement.right ? "true" : "false"},
                               {"false_status", p.judgement.false_status ? "true" : "false"},
                               {"kkt_stationarity", number(p.judgement.residuals.relative_stationarity)},
                               {"kkt_feasibility", number(p.judgement.residuals.relative_feasibility)},
                               {"kkt_complementarity", number(p.judgement.residuals.relative_complementarity)},
                               {"cold_ms", number(1e3 * p.seconds)}}));
  }
  return object({{"solver", quoted(r.solver)},
                 {"solved", std::to_string(r.right())},
                 {"absolute", std::to_string(r.absolute())},
                 {"false_statuses", std::to_string(r.false_statuses())},
                 {"mean_ms", number(1e3 * r.mean(false))},
                 {"mean_solved_ms", number(1e3 * r.mean(true))},
                 {"slowest_ms", number(1e3 * r.slowest())},
                 {"problems", array(problems, "\n      ")}});
}

std::string to_json(const LaneResult& lane, double own) {
  return object({{"solver", quoted(lane.solver)},
                 {"start", quoted(name_of(lane.start))},
                 {"frames", std::to_string(lane.frames)},
                 {"right", std::to_string(lane.right)},
                 {"false_statuses", std::to_string(lane.false_statuses)},
                 {"cold_median_ms", number(1e3 * lane.cold_median())},
                 {"warm_median_ms", number(1e3 * lane.warm_median())},
                 {"warm_p99_ms", number(1e3 * lane.warm_p99())},
                 {"ratio", number(lane.warm_median() / own)},
                 {"finished", lane.finished ? "true" : "false"},
                 {"first_miss", quoted(lane.first_miss)}});
}

}  // namespace

void print_solvers(const std::vector<Entry>& entries) {
  for (const Entry& e : entries) std::printf("%s %s\n", e.name.c_str(), e.version.c_str());
}

void print_set(const std::string& name, const std::vector<SetResult>& results) {
  if (results.empty()) return;
  std::printf("\n%s (%zu), cold, times in ms\n", name.c_str(), results.front().problems.size());
  std::printf("  %-12s %6s %6s %6s %10s %12s %10s\n", "solver", "solved", "abs", "false", "mean", "mean solved", "slowest");
  for (const SetResult& r : results) {
    std::printf("  %-12s %6d %6d %6d %10s %12s %10s\n", r.solver.c_str(), r.right(), r.absolute(), r.false_statuses(),
                short_text(1e3 * r.mean(false)).c_str(), short_text(1e3 * r.mean(true)).c_str(),
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
    if (unsupported > 0) misses.append(" and ").append(std::to_string(unsupported)).append(" unsupported");
    if (!misses.empty()) std::printf("  %s misses%s\n", r.solver.c_str(), misses.c_str());
  }
  std::fflush(stdout);
}

void print_sequence(const SequenceReport& report) {
  const double own = own_median(report.lanes);
  std::printf("\n%s (n %ld, m %ld), times in ms\n", report.name.c_str(), static_cast<long>(report.n),
              static_cast<long>(report.m));
  std::printf("  %-12s %-6s %9s %9s %9s %8s %6s %8s\n", "solver", "start", "cold", "warm", "p99", "right", "false", "ratio");
  for (const LaneResult& lane : report.lanes) {
    if (lane.frames == 0) continue;
    std::printf("  %-12s %-6s %9s %9s %9s %5d/%-2d %6d %8s%s\n", lane.solver.c_str(), name_of(lane.start),
                short_text(1e3 * lane.cold_median()).c_str(), short_text(1e3 * lane.warm_median()).c_str(),
                short_text(1e3 * lane.warm_p99()).c_str(), lane.right, lane.frames, lane.false_statuses,
                short_text(lane.warm_median() / own).c_str(), lane.finished ? "" : "  (over the time limit)");
    if (!lane.first_miss.empty()) std::printf("    first miss: %s\n", lane.first_miss.c_str());
  }
  std::fflush(stdout);
}

std::string to_json(const Report& report) {
  std::vector<std::string> solvers, sets, sequences;
  for (const Entry& e : report.entries) solvers.push_back(object({{"name", quoted(e.name)}, {"version", quoted(e.version)}}));
  for (const auto& [name, results] : report.sets) {
    std::vector<std::string> items;
    for (const SetResult& r : results) items.push_back(to_json(r));
    sets.push_back(object({{"set", quoted(name)}, {"results", array(items, "\n    ")}}));
  }
  for (const SequenceReport& s : report.sequences) {
    std::vector<std::string> items;
    for (const LaneResult& lane : s.lanes) {
      if (lane.frames > 0) items.push_back(to_json(lane, own_median(s.lanes)));
    }
    sequences.push_back(object({{"sequence", quoted(s.name)},
                                {"n", std::to_string(s.n)},
                                {"m", std::to_string(s.m)},
                                {"results", array(items, "\n    ")}}));
  }
  return object({{"solvers", array(solvers, "\n  ")},
                 {"passes", std::to_string(report.settings.passes)},
                 {"time_limit_s", number(report.settings.time_limit)},
                 {"block", std::to_string(report.settings.block)},
                 {"tolerance", number(kTolerance)},
                 {"sets", array(sets, "\n  ")},
                 {"sequences", array(sequences, "\n  ")}}) +
         "\n";
}

}  // namespace versus
