#include "support/tasks.hpp"

#include <cstdio>
#include <utility>

#include "clothctl/core/number_text.hpp"
#include "clothctl/io/targets.hpp"

namespace program {

namespace {

/// Warns of times that are hardly seconds.
void check_times(const Options& o, const Task& task, Index rows) {
  const double apart = task.duration / static_cast<double>(rows - 1);
  if (apart < 1 && task.duration < 3600) return;
  std::fprintf(stderr, "warning: %s: lasts %.6g s with %.3g s from row to row; times are seconds\n",
               o.targets.c_str(), task.duration, apart);
}

}  // namespace

Task read_task(const Options& o) {
  const std::size_t comma = o.targets.find(',');
  const bool pair = comma != std::string::npos;
  if (o.dt_given && !pair)
    refuse("--dt goes with --targets LEFT.csv,RIGHT.csv; " + o.targets + " carries its own times");
  const clothctl::TargetCurves read =
      pair ? must(clothctl::read_target_pair(o.targets.substr(0, comma),
                                             o.targets.substr(comma + 1), o.dt))
           : must(clothctl::read_targets(o.targets));
  Task task;
  task.names = read.names;
  if (read.times.size() < 2)
    refuse(o.targets + ": needs at least 2 rows, has " + std::to_string(read.times.size()));
  const clothctl::VectorX<double> times = read.times.array() - read.times[0];
  for (const Points& points : read.features)
    task.curves.push_back(must(clothctl::CubicBSpline<double>::interpolate(times, points)));
  if (task.names == std::vector<std::string>{"R", "L"}) {  // features are taken from left to right
    std::swap(task.names[0], task.names[1]);
    std::swap(task.curves[0], task.curves[1]);
  }
  task.duration = times[times.size() - 1];
  check_times(o, task, times.size());
  return task;
}

void check_reach(const Options& o, const Task& task, std::size_t a, std::size_t b, double cloth) {
  double furthest = 0, when = 0;
  for (double t = 0; t <= task.duration; t += 0.02) {
    const double apart = (task.curves[a].position(t) - task.curves[b].position(t)).norm();
    if (!(apart <= furthest)) {
      furthest = apart;
      when = t;
    }
  }
  if (furthest <= 1.05 * cloth) return;
  const std::string text = o.targets + ": " + task.names[a] + " and " + task.names[b] + " are " +
                           clothctl::rounded_text(furthest) + " m apart at " +
                           clothctl::rounded_text(when) + " s; there is " +
                           clothctl::rounded_text(cloth) + " m of cloth between them";
  if (!(furthest <= 10 * cloth)) refuse(text + "; coordinates are metres");
  std::fprintf(stderr, "warning: %s\n", text.c_str());
}

}  // namespace program
