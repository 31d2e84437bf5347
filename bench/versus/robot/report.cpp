#include "report.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

namespace versus {

namespace {

using Json = nlohmann::ordered_json;

const char* name_of(Task task) {
  switch (task) {
    case Task::Poses: return "poses of all links";
    case Task::Jacobian: return "Jacobian of a tip";
    case Task::InverseDynamics: return "inverse dynamics";
    case Task::MassMatrix: return "mass matrix";
    case Task::ForwardDynamics: return "forward dynamics";
    case Task::DampedDynamics: return "same, with diagonal";
  }
  return "";
}

const char* key_of(Task task) {
  switch (task) {
    case Task::Poses: return "poses";
    case Task::Jacobian: return "jacobian";
    case Task::InverseDynamics: return "inverse_dynamics";
    case Task::MassMatrix: return "mass_matrix";
    case Task::ForwardDynamics: return "forward_dynamics";
    case Task::DampedDynamics: return "damped_dynamics";
  }
  return "";
}

/// Three significant digits, or a dash.
std::string short_text(double value) {
  if (!std::isfinite(value)) return "-";
  char text[32];
  const int digits = value >= 100 ? 0 : value >= 10 ? 1 : 2;
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string short_name(const RobotReport& report) {
  return std::filesystem::path(report.model.file).stem().string();
}

/// Time of a library's forward dynamics without the diagonal, divided by ours with it.
double forward_over_damped(const RobotReport& report, std::size_t library) {
  return report.tasks[static_cast<std::size_t>(Task::ForwardDynamics)][library].seconds /
         report.tasks[static_cast<std::size_t>(Task::DampedDynamics)][0].seconds;
}

void print_reach(const RobotReport& report, const std::vector<ReachResult>& results,
                 const char* title) {
  if (results.empty() || results[0].seconds.empty()) return;
  std::printf("  inverse kinematics of %zu tips, %s starts, %zu targets\n",
              report.model.tips.size(), title, results[0].seconds.size());
  std::printf("    %-10s %9s %7s %12s %8s %14s %8s\n", "library", "reached", "false", "median us",
              "ratio", "both reach, us", "ratio");
  for (std::size_t r = 0; r < results.size(); ++r) {
    const ReachResult& own = results[0];
    const ReachResult& it = results[r];
    if (!it.offered) continue;
    const double both = it.median_with(own), ours = own.median_with(it);
    std::printf("    %-10s %8.1f%% %7d %12s %8s %14s %8s\n", report.names[r].c_str(),
                100.0 * it.reached_count() / static_cast<double>(it.reached.size()),
                it.false_claims, short_text(1e6 * it.median()).c_str(),
                short_text(it.median() / own.median()).c_str(), short_text(1e6 * both).c_str(),
                short_text(both / ours).c_str());
  }
}

Json to_json(const std::vector<std::string>& names, const std::vector<ReachResult>& results) {
  Json items = Json::array();
  for (std::size_t r = 0; r < results.size(); ++r) {
    const ReachResult& it = results[r];
    if (!it.offered) continue;
    const double both = it.median_with(results[0]), ours = results[0].median_with(it);
    items.push_back({{"library", names[r]},
                     {"targets", it.reached.size()},
                     {"reached", it.reached_count()},
                     {"false_claims", it.false_claims},
                     {"median_us", 1e6 * it.median()},
                     {"ratio", it.median() / results[0].median()},
                     {"median_both_us", 1e6 * both},
                     {"median_both_ours_us", 1e6 * ours},
                     {"ratio_both", both / ours}});
  }
  return items;
}

}  // namespace

void print_entries(const std::vector<Entry>& entries) {
  for (const Entry& e : entries) std::printf("%s %s\n", e.name.c_str(), e.version.c_str());
}

void print_robot(const RobotReport& report) {
  std::printf("\n%s (%d coordinates, %zu links), us and ratio to ours\n",
              short_name(report).c_str(), report.model.n(), report.model.links.size());
  for (std::size_t r = 0; r < report.names.size(); ++r) {
    if (!report.refusals[r].empty())
      std::printf("  %s: %s\n", report.names[r].c_str(), report.refusals[r].c_str());
  }
  std::printf("  %-20s", "");
  for (const std::string& name : report.names) std::printf(" %18s", name.c_str());
  std::printf("\n");
  for (std::size_t t = 0; t < report.tasks.size(); ++t) {
    std::printf("  %-20s", name_of(kTasks[t]));
    for (const TaskResult& it : report.tasks[t]) {
      const std::string ratio = short_text(it.seconds / report.tasks[t][0].seconds);
      std::printf(" %9s %8s", short_text(1e6 * it.seconds).c_str(), ratio.c_str());
    }
    std::printf("\n");
  }
  if (!report.tasks.empty()) {
    std::printf("  %-20s", "without / ours with");
    for (std::size_t r = 0; r < report.names.size(); ++r) {
      std::printf(" %9s %8s", "", short_text(forward_over_damped(report, r)).c_str());
    }
    std::printf("\n");
  }
  if (!report.tasks.empty()) std::printf("  largest difference to ours, relative\n");
  for (std::size_t t = 0; t < report.tasks.size(); ++t) {
    std::printf("  %-20s", name_of(kTasks[t]));
    for (const TaskResult& it : report.tasks[t]) {
      if (!it.offered) {
        std::printf(" %18s", "-");
      } else {
        std::printf(" %8.1e %-9s", it.difference, it.agrees() ? "" : "not timed");
      }
    }
    std::printf("\n");
  }
  print_reach(report, report.near, "near");
  print_reach(report, report.random, "random");
  std::fflush(stdout);
}

std::string to_json(const std::vector<Entry>& entries, const RunSettings& settings,
                    const std::vector<RobotReport>& robots) {
  Json libraries = Json::array(), items = Json::array();
  for (const Entry& e : entries) libraries.push_back({{"name", e.name}, {"version", e.version}});
  for (const RobotReport& robot : robots) {
    Json tasks = Json::object();
    for (std::size_t t = 0; t < robot.tasks.size(); ++t) {
      Json results = Json::array();
      for (std::size_t r = 0; r < robot.names.size(); ++r) {
        const TaskResult& it = robot.tasks[t][r];
        if (!it.offered) continue;
        results.push_back({{"library", robot.names[r]},
                           {"median_us", 1e6 * it.seconds},
                           {"ratio", it.seconds / robot.tasks[t][0].seconds},
                           {"difference", it.difference}});
      }
      tasks[key_of(kTasks[t])] = results;
    }
    Json refused = Json::object(), over_damped = Json::object();
    for (std::size_t r = 0; r < robot.names.size(); ++r) {
      if (!robot.tasks.empty()) over_damped[robot.names[r]] = forward_over_damped(robot, r);
      if (!robot.refusals[r].empty()) refused[robot.names[r]] = robot.refusals[r];
    }
    items.push_back({{"robot", short_name(robot)},
                     {"coordinates", robot.model.n()},
                     {"links", robot.model.links.size()},
                     {"refused", refused},
                     {"tasks", tasks},
                     {"forward_over_damped_ours", over_damped},
                     {"reach_near", to_json(robot.names, robot.near)},
                     {"reach_random", to_json(robot.names, robot.random)}});
  }
  const Json all{{"libraries", libraries},
                 {"seed", settings.seed},
                 {"samples", settings.samples},
                 {"rounds", settings.rounds},
                 {"diagonal", settings.diagonal},
                 {"restarts", settings.restarts},
                 {"robots", items}};
  return all.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace versus
