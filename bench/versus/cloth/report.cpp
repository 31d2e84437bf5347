#include "report.hpp"

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace versus {

namespace {

using Json = nlohmann::ordered_json;

/// Three significant digits, or a dash.
std::string short_text(double value) {
  if (!std::isfinite(value)) return "-";
  char text[32];
  const double size = std::abs(value);
  const int digits = size >= 100 ? 0 : size >= 10 ? 1 : size >= 0.1 ? 2 : 3;
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string name_of(const RunResult& run) { return run.engine + " " + run.variant; }

void print_throughput(const SheetReport& report) {
  if (report.throughput.empty()) return;
  std::printf("  projections of edges: %-18s %10s %10s %8s %12s\n", "", "substeps", "sweeps", "ms",
              "M solves/s");
  for (const RunResult& r : report.throughput) {
    std::printf("    %-36s %10d %10d %8s %12s\n", name_of(r).c_str(), r.setting.substeps,
                r.setting.sweeps, short_text(1e3 * r.median).c_str(),
                short_text(1e-6 * r.solves).c_str());
  }
}

void print_run(const RunResult& r) {
  std::printf("    %-18s %4d x %-4d %8s %8s", name_of(r).c_str(), r.setting.substeps,
              r.setting.sweeps, short_text(1e3 * r.median).c_str(),
              short_text(1e3 * r.p99).c_str());
  if (r.apart) {
    std::printf("  apart after %d frames%s\n", r.frames, r.nonfinite > 0 ? ", not finite" : "");
    return;
  }
  std::printf(" %7s %7s %7s %7s %5s/%5s/%5s %5s %8s %7s %5s %5d\n",
              short_text(100 * r.structural).c_str(), short_text(100 * r.diagonal).c_str(),
              short_text(100 * r.mean_stretch).c_str(), short_text(100 * r.mean_squeeze).c_str(),
              short_text(r.energy[0]).c_str(), short_text(r.energy[1]).c_str(),
              short_text(r.energy[2]).c_str(), short_text(r.most_energy).c_str(),
              short_text(1e3 * r.rest_speed).c_str(), short_text(100 * r.rest_stretch).c_str(),
              short_text(1e-6 * r.solves).c_str(), r.nonfinite);
}

void print_curves(const SheetReport& report) {
  if (report.curves.empty()) return;
  std::printf("  %-20s %-11s %8s %8s %7s %7s %7s %7s %-17s %5s %8s %7s %5s %5s\n", "engine",
              "sub x sweep", "ms", "p99", "worst%", "diag%", "mean%", "short%", "energy 2/5/10 s",
              "most", "v mm/s", "rest%", "M/s", "nan");
  for (const std::vector<RunResult>& runs : report.curves) {
    for (const RunResult& r : runs) {
      if (r.refusal.empty()) {
        print_run(r);
      } else {
        std::printf("    %s: %s\n", name_of(r).c_str(), r.refusal.c_str());
      }
    }
  }
}

/// "0.51 (10 x 2)", or why there is none.
std::string cheapest_text(const std::vector<RunResult>& runs, double target, double limit) {
  const RunResult* const best = cheapest(runs, target);
  if (best == nullptr) return "none up to " + short_text(1e3 * limit);
  return short_text(1e3 * best->median) + " (" + std::to_string(best->setting.substeps) + " x " +
         std::to_string(best->setting.sweeps) + ")";
}

void print_cheapest(const SheetReport& report, const RunSettings& settings) {
  if (report.curves.size() < 2) return;
  std::printf("  cheapest ms a frame (substeps x sweeps) at a worst edge of\n    %-20s", "");
  for (const double target : settings.targets)
    std::printf(" %20s", ("<= " + short_text(100 * target) + " %").c_str());
  std::printf("\n");
  for (const std::vector<RunResult>& runs : report.curves) {
    if (runs.empty() || !runs.front().refusal.empty()) continue;
    std::printf("    %-20s", name_of(runs.front()).c_str());
    for (const double target : settings.targets)
      std::printf(" %20s", cheapest_text(runs, target, settings.limit).c_str());
    std::printf("\n");
  }
}

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json to_json(const RunResult& r) {
  return {{"engine", r.engine},
          {"variant", r.variant},
          {"substeps", r.setting.substeps},
          {"sweeps", r.setting.sweeps},
          {"refusal", r.refusal},
          {"frames", r.frames},
          {"median_ms", number(1e3 * r.median)},
          {"p99_ms", number(1e3 * r.p99)},
          {"worst_structural", number(r.structural)},
          {"worst_diagonal", number(r.diagonal)},
          {"mean_stretch", number(r.mean_stretch)},
          {"mean_squeeze", number(r.mean_squeeze)},
          {"energy_2_5_10_s", {number(r.energy[0]), number(r.energy[1]), number(r.energy[2])}},
          {"most_energy", number(r.most_energy)},
          {"rest_speed", number(r.rest_speed)},
          {"rest_stretch", number(r.rest_stretch)},
          {"solves_per_second", number(r.solves)},
          {"nonfinite", r.nonfinite},
          {"apart", r.apart}};
}

}  // namespace

void print_entries(const std::vector<Entry>& entries) {
  for (const Entry& e : entries) std::printf("%s %s\n", e.name.c_str(), e.version.c_str());
}

void print_sheet(const SheetReport& report, const RunSettings& settings) {
  std::printf("\n%s %d x %d, %zu edges\n", report.mesh.c_str(), report.side, report.side,
              report.edges);
  print_throughput(report);
  print_curves(report);
  print_cheapest(report, settings);
  std::fflush(stdout);
}

std::string to_json(const std::vector<Entry>& entries, const RunSettings& settings,
                    const std::vector<SheetReport>& sheets) {
  Json engines = Json::array(), items = Json::array();
  for (const Entry& e : entries) engines.push_back({{"name", e.name}, {"version", e.version}});
  for (const SheetReport& sheet : sheets) {
    Json throughput = Json::array(), runs = Json::array();
    for (const RunResult& r : sheet.throughput)
      throughput.push_back({{"engine", r.engine},
                            {"variant", r.variant},
                            {"substeps", r.setting.substeps},
                            {"sweeps", r.setting.sweeps},
                            {"median_ms", number(1e3 * r.median)},
                            {"solves_per_second", number(r.solves)}});
    for (const std::vector<RunResult>& curve : sheet.curves) {
      for (const RunResult& r : curve) runs.push_back(to_json(r));
    }
    items.push_back({{"mesh", sheet.mesh},
                     {"side", sheet.side},
                     {"edges", sheet.edges},
                     {"throughput", throughput},
                     {"runs", runs}});
  }
  const Json all{{"engines", engines},
                 {"frames", settings.frames},
                 {"rest_frames", settings.rest_frames},
                 {"limit_ms", 1e3 * settings.limit},
                 {"targets", settings.targets},
                 {"sheets", items}};
  return all.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace versus
