// Tables and JSON.

#include "report.hpp"

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace versus {

namespace {

using Json = nlohmann::ordered_json;

/// Three significant digits or less.
std::string text(double value) {
  char out[32];
  const double size = std::abs(value);
  const int digits = size >= 100 ? 0 : size >= 10 ? 1 : size >= 0.1 ? 2 : 3;
  std::snprintf(out, sizeof out, "%.*f", digits, value);
  return size < 0.0005 ? "0" : out;
}

/// "whole run/rest".
std::string pair(double a, double b) { return text(a) + "/" + text(b); }

void print_run(const RunResult& r) {
  std::printf("  %-30s", (r.engine + " " + r.variant).c_str());
  if (!r.refusal.empty()) {
    std::printf(" %s\n", r.refusal.c_str());
    return;
  }
  if (!r.finite) {
    std::printf(" not finite\n");
    return;
  }
  std::printf(" %7s %7s %7s %6s", text(1e3 * r.median).c_str(), text(1e3 * r.p99).c_str(),
              text(1e3 * r.most).c_str(), text(r.real_time).c_str());
  std::printf(" %5s %13s %13s %13s", text(1e3 * r.gap).c_str(),
              pair(1e3 * r.depth_vertices, 1e3 * r.rest_depth_vertices).c_str(),
              pair(1e3 * r.depth_points, 1e3 * r.rest_depth_points).c_str(),
              pair(1e3 * r.below_gap, 1e3 * r.rest_below_gap).c_str());
  std::printf(" %5d %15s %7s %11s %5d %6s %s\n", r.touching,
              r.touching > 0 ? pair(1e3 * r.creep, 1e3 * r.most_creep).c_str() : "-",
              r.touching > 0 ? text(1e3 * r.tremble).c_str() : "-",
              pair(100 * r.stretch, 100 * r.rest_stretch).c_str(), r.crossings,
              text(1e3 * r.drift).c_str(),
              r.off < 0 ? "lies" : ("off at " + text(r.off) + " s").c_str());
}

Json to_json(const RunResult& r) {
  const bool still = r.touching > 0;
  const auto number = [](double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); };
  const auto when = [&](bool sense, double x) { return sense ? number(x) : Json(nullptr); };
  return {{"engine", r.engine},
          {"variant", r.variant},
          {"refusal", r.refusal},
          {"finite", r.finite},
          {"median_ms", number(1e3 * r.median)},
          {"p99_ms", number(1e3 * r.p99)},
          {"max_ms", number(1e3 * r.most)},
          {"real_time_factor", number(r.real_time)},
          {"gap_mm", 1e3 * r.gap},
          {"depth_vertices_mm", 1e3 * r.depth_vertices},
          {"depth_points_mm", 1e3 * r.depth_points},
          {"rest_depth_vertices_mm", 1e3 * r.rest_depth_vertices},
          {"rest_depth_points_mm", 1e3 * r.rest_depth_points},
          {"below_gap_mm", 1e3 * r.below_gap},
          {"rest_below_gap_mm", 1e3 * r.rest_below_gap},
          {"touching", r.touching},
          {"creep_mm_s", when(still, 1e3 * r.creep)},
          {"most_creep_mm_s", when(still, 1e3 * r.most_creep)},
          {"tremble_mm_s", when(still, 1e3 * r.tremble)},
          {"stretch", number(r.stretch)},
          {"rest_stretch", number(r.rest_stretch)},
          {"crossings", r.crossings},
          {"drift_mm", number(1e3 * r.drift)},
          {"off_s", when(!(r.off < 0), r.off)}};
}

}  // namespace

void print_entries(const std::vector<Entry>& entries) {
  for (const Entry& e : entries) std::printf("%s %s\n", e.name.c_str(), e.version.c_str());
}

void print_scene(const SceneReport& report) {
  std::printf("\n%d x %d on a %s, %s itself; depths mm, speeds mm/s, A/B: whole run/at rest\n",
              report.side, report.side, report.box ? "box" : "sphere",
              report.self ? "meets" : "does not meet");
  std::printf("  %-30s %7s %7s %7s %6s %5s %13s %13s %13s %5s %15s %7s %11s %5s %6s\n", "", "ms",
              "p99", "max", "x real", "gap", "depth vert", "depth points", "below gap", "touch",
              "creep rms/max", "tremble", "stretch %", "cross", "drift");
  for (const RunResult& r : report.runs) print_run(r);
  std::fflush(stdout);
}

std::string to_json(const std::vector<Entry>& entries, const RunSettings& settings, int substeps,
                    const std::vector<SceneReport>& scenes) {
  Json engines = Json::array(), items = Json::array();
  for (const Entry& e : entries) engines.push_back({{"name", e.name}, {"version", e.version}});
  for (const SceneReport& scene : scenes) {
    Json runs = Json::array();
    for (const RunResult& r : scene.runs) runs.push_back(to_json(r));
    items.push_back({{"side", scene.side},
                     {"obstacle", scene.box ? "box" : "sphere"},
                     {"self", scene.self},
                     {"runs", runs}});
  }
  const Json all{{"engines", engines},   {"frames", settings.frames},   {"dt", settings.dt},
                 {"substeps", substeps}, {"repeats", settings.repeats}, {"scenes", items}};
  return all.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace versus
