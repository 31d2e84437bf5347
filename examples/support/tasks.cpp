#include "support/tasks.hpp"

#include <cstdio>

#include "clothctl/io/targets.hpp"

namespace program {

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
  task.duration = times[times.size() - 1];
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
  char text[160];
  std::snprintf(text, sizeof text,
                ": %s and %s are %.3g m apart at %.2f s; there is %.3g m of cloth between them",
                task.names[a].c_str(), task.names[b].c_str(), furthest, when, cloth);
  if (!(furthest <= 10 * cloth)) refuse(o.targets + text);
  std::fprintf(stderr, "warning: %s%s\n", o.targets.c_str(), text);
}

}  // namespace program
