#include "support/evaluate_study.hpp"

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <string_view>

namespace program {

namespace {

/// The noise of the control points of a kind of curves, as a share of the size of the sheet.
double noise_of(const std::string& kind) {
  if (kind == "random") return 0.06;
  return kind == "fast" ? 0.08 : 0.04;
}

Case plain_case(const Evaluation& e, const std::string& name, double value) {
  Case c;
  c.name = name;
  c.value = value;
  c.kind = e.kind;
  c.noise_sd = noise_of(e.kind) * e.run.size;
  c.run = e.run;
  return c;
}

std::string grid_name(int side) { return std::to_string(side) + " x " + std::to_string(side); }

std::vector<Case> deviation_cases(const Evaluation& e) {
  std::vector<Case> cases;
  for (const int thousandths : {0, 20, 40, 60, 90, 120}) {
    const double sd = thousandths / 1000.0 * e.run.size;
    char name[32];
    std::snprintf(name, sizeof name, "SD %.3g mm", 1000 * sd);
    Case c = plain_case(e, name, sd);
    c.noise_sd = sd;
    cases.push_back(c);
  }
  return cases;
}

std::vector<Case> window_cases(const Evaluation& e, long frames) {
  std::vector<Case> cases;
  for (const int horizon : {1, 2, 3, 4, 6, 8, 10, 12, 14, 16, 20, 24, 28}) {
    if (horizon + 1 > frames) break;  // at least two frames count
    cases.push_back(plain_case(e, "K = " + std::to_string(horizon), horizon));
    cases.back().run.horizon = horizon;
  }
  return cases;
}

std::vector<Case> plant_cases(const Evaluation& e) {
  std::vector<Case> cases;
  for (const char* plant : {"newton", "linear-implicit", "xpbd", "explicit"}) {
    for (const char* grip : {"position", "force"}) {
      std::string name = plant;
      name.append(" ").append(grip);
      Case c = plain_case(e, name, static_cast<double>(cases.size()));
      c.run.plant = plant;
      c.run.grip = grip;
      if (c.run.plant == "explicit") {
        c.run.cloth = std::min(9, c.run.cloth);
        c.name.append(" ").append(grid_name(c.run.cloth));
      }
      cases.push_back(c);
    }
  }
  return cases;
}

std::vector<Case> mismatch_cases(const Evaluation& e) {
  std::vector<Case> cases{plain_case(e, "as predicted", 0)};
  for (const char* quantity : {"density", "stiffness", "drag", "bending"}) {
    for (const double factor : {0.7, 1.3}) {
      Case c = plain_case(e, std::string(quantity) + (factor < 1 ? " -30 %" : " +30 %"),
                          static_cast<double>(cases.size()));
      c.mismatch = {quantity, factor};
      cases.push_back(c);
    }
  }
  return cases;
}

std::vector<Case> size_cases(const Evaluation& e) {
  std::vector<Case> cases;
  for (int side = 9;; side = 2 * side - 1) {
    const int used = std::min(side, e.run.cloth);
    cases.push_back(plain_case(e, grid_name(used), used * used));
    cases.back().run.cloth = used;
    if (used == e.run.cloth) return cases;
  }
}

}  // namespace

const std::vector<std::string>& study_names() {
  static const std::vector<std::string> names{"known",  "fast",   "random",   "sd",
                                              "window", "plants", "mismatch", "table1"};
  return names;
}

const std::vector<std::string>& curve_kinds() {
  static const std::vector<std::string> kinds{"known", "fast", "random"};
  return kinds;
}

bool is_curve_kind(const std::string& study) {
  return std::find(curve_kinds().begin(), curve_kinds().end(), study) != curve_kinds().end();
}

std::vector<std::string> options_set_by(const std::string& study) {
  if (study == "window") return {"--horizon"};
  if (study == "plants") return {"--plant", "--grip"};
  if (study == "sd") return {"--curves"};
  if (is_curve_kind(study)) return {"--kind"};
  return {};
}

std::vector<Case> make_cases(const Evaluation& e, long frames) {
  if (e.study == "sd") return deviation_cases(e);
  if (e.study == "window") return window_cases(e, frames);
  if (e.study == "plants") return plant_cases(e);
  if (e.study == "mismatch") return mismatch_cases(e);
  if (e.study == "table1") return size_cases(e);
  return {plain_case(e, e.study, 0)};
}

std::vector<Job> make_jobs(int cases, int seeds) {
  std::vector<Job> jobs;
  for (int seed = 1; seed <= seeds; ++seed) {
    for (int c = 0; c < cases; ++c) jobs.push_back({c, seed});
  }
  return jobs;
}

void read_shard(const std::string& text, Evaluation& e) {
  const std::string_view all = text;
  const std::size_t slash = all.find('/');
  const auto number = [](std::string_view part, int& value) {
    const auto read = std::from_chars(part.data(), part.data() + part.size(), value);
    return read.ec == std::errc() && read.ptr == part.data() + part.size();
  };
  if (slash == std::string_view::npos || !number(all.substr(0, slash), e.shard) ||
      !number(all.substr(slash + 1), e.shards) || e.shard < 1 || e.shard > e.shards)
    refuse("--shard: " + text + " is not i/n with 1 <= i <= n");
}

}  // namespace program
