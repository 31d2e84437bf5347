#include "report.hpp"

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace planner_bench {

namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kPaper = "paper, Eigen's factor";
constexpr const char* kOurFactor = "paper, our factor";

/// Three significant digits, or a dash.
std::string text(double value) {
  if (!std::isfinite(value)) return "-";
  char out[32];
  const int digits = value >= 100 ? 0 : value >= 10 ? 1 : value >= 1 ? 2 : 3;
  std::snprintf(out, sizeof out, "%.*f", digits, value);
  return out;
}

std::string small(double value) {
  if (!std::isfinite(value)) return "-";
  char out[32];
  std::snprintf(out, sizeof out, "%.1e", value);
  return out;
}

struct Part {
  const char* name;
  double Phases::*part;
};
constexpr Part kParts[] = {{"linearise", &Phases::linearise},
                           {"response", &Phases::response},
                           {"rollout", &Phases::rollout},
                           {"stack", &Phases::stack},
                           {"qp", &Phases::qp}};

}  // namespace

void print_size(const RunSettings& settings, const SizeReport& report) {
  std::printf("\n%d x %d vertices, K = %d, times in ms\n", report.n, report.n,
              static_cast<int>(settings.horizon));
  for (const Candidate& c : report.candidates)
    std::printf("  QP of the baseline: %s %s, cold %s, KKT %s%s\n", c.name.c_str(),
                c.version.c_str(), text(1e3 * c.seconds).c_str(), small(c.kkt).c_str(),
                &c - report.candidates.data() == report.chosen ? " (taken)" : "");
  std::printf("  %-25s %6s %8s %8s", "", "frames", "median", "p99");
  for (const Part& p : kParts) std::printf(" %9s", p.name);
  std::printf(" %8s %8s %8s %8s\n", "ratio", "ratio 2", "input", "KKT");
  for (const Row& row : report.rows) {
    const double median = row.quantile(&Phases::total, 0.5);
    std::printf("  %-25s %6zu %8s %8s", row.name.c_str(), row.frames.size(),
                text(1e3 * median).c_str(), text(1e3 * row.quantile(&Phases::total, 0.99)).c_str());
    for (const Part& p : kParts) std::printf(" %9s", text(1e3 * row.quantile(p.part, 0.5)).c_str());
    std::printf(" %8s %8s %8s %8s", text(report.median(kPaper) / median).c_str(),
                text(report.median(kOurFactor) / median).c_str(), small(row.difference).c_str(),
                small(row.kkt).c_str());
    std::printf(row.failures > 0 ? "  %d without a plan\n" : "\n", row.failures);
  }
  std::fflush(stdout);
}

void print_growth(const std::vector<SizeReport>& reports) {
  if (reports.size() < 2) return;
  std::printf(
      "\nmedian of a frame in ms, and e of time ~ vertices^e since the size before\n  %-25s", "");
  for (const SizeReport& r : reports) std::printf(" %15d", r.n);
  std::printf("\n");
  for (const Row& row : reports.back().rows) {
    std::printf("  %-25s", row.name.c_str());
    for (std::size_t i = 0; i < reports.size(); ++i) {
      const double now = reports[i].median(row.name);
      const double before = i > 0 ? reports[i - 1].median(row.name) : std::nan("");
      const double sides = i > 0 ? static_cast<double>(reports[i].n) / reports[i - 1].n : 1.0;
      const double power = std::log(now / before) / (2.0 * std::log(sides));
      const std::string e = std::isfinite(power) ? " (" + text(power) + ")" : "";
      std::printf(" %15s", (text(1e3 * now) + e).c_str());
    }
    std::printf("\n");
  }
}

std::string to_json(const RunSettings& settings, const std::vector<SizeReport>& reports) {
  Json sizes = Json::array();
  for (const SizeReport& report : reports) {
    Json candidates = Json::array(), rows = Json::array();
    for (const Candidate& c : report.candidates)
      candidates.push_back(
          {{"name", c.name}, {"version", c.version}, {"cold_ms", 1e3 * c.seconds}, {"kkt", c.kkt}});
    for (const Row& row : report.rows) {
      const double median = row.quantile(&Phases::total, 0.5);
      Json item{{"name", row.name},
                {"frames", row.frames.size()},
                {"failures", row.failures},
                {"median_ms", 1e3 * median},
                {"p99_ms", 1e3 * row.quantile(&Phases::total, 0.99)}};
      for (const Part& p : kParts)
        item[std::string(p.name) + "_ms"] = 1e3 * row.quantile(p.part, 0.5);
      item["ratio"] = report.median(kPaper) / median;
      item["ratio_our_factor"] = report.median(kOurFactor) / median;
      item["input_difference"] = row.difference;
      item["kkt"] = row.kkt;
      rows.push_back(std::move(item));
    }
    sizes.push_back(
        {{"n", report.n},
         {"qp_solvers", candidates},
         {"qp_solver", report.chosen < 0
                           ? std::string()
                           : report.candidates[static_cast<std::size_t>(report.chosen)].name},
         {"rows", rows}});
  }
  return Json{{"horizon", settings.horizon}, {"frames", settings.frames}, {"sizes", sizes}}.dump(
             1) +
         "\n";
}

std::string problem_with(const std::vector<SizeReport>& reports) {
  for (const SizeReport& report : reports) {
    for (const Row& row : report.rows) {
      const std::string name = std::to_string(report.n) + ": " + row.name;
      if (row.failures > 0) return name + " has frames without an optimal plan";
      if (report.chosen < 0 || !(row.baseline || row.exact)) continue;
      if (!(row.kkt <= kSolved)) return name + ": the KKT residual is " + small(row.kkt);
      if (!(row.difference <= kSameInput))
        return name + ": the first input differs from the baseline's by " + small(row.difference);
    }
  }
  return {};
}

}  // namespace planner_bench
