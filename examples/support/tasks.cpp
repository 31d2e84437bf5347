#include "support/tasks.hpp"

#include <cmath>
#include <cstdio>
#include <random>

#include "clothctl/io/targets.hpp"

namespace program {

namespace {

/// Normally distributed numbers, the same on every platform for a seed.
class Normal {
 public:
  explicit Normal(std::uint64_t seed) : engine_(seed) {}
  double operator()() {
    const double u = (static_cast<double>(engine_() >> 11) + 0.5) / 9007199254740992.0;
    const double v = (static_cast<double>(engine_() >> 11) + 0.5) / 9007199254740992.0;
    return std::sqrt(-2 * std::log(u)) * std::cos(2 * 3.14159265358979323846 * v);
  }

 private:
  std::mt19937_64 engine_;
};

/// Keeps two curves closer than `most`, softly from `from` on, because a sheet cannot stretch.
void keep_close(Points& a, Points& b, double from, double most) {
  for (Index i = 0; i < a.cols(); ++i) {
    const Vec apart = b.col(i) - a.col(i);
    const double distance = apart.norm();
    if (distance <= from) continue;
    const double wanted = from + (most - from) * std::tanh((distance - from) / (most - from));
    const Vec shift = apart * (0.5 * (1 - wanted / distance));
    a.col(i) += shift;
    b.col(i) -= shift;
  }
}

}  // namespace

Task read_task(const Options& o) {
  const std::size_t comma = o.targets.find(',');
  const bool pair = comma != std::string::npos;
  if (o.dt_given && !pair) refuse("--dt goes with --targets LEFT.csv,RIGHT.csv; " + o.targets + " carries its own times");
  const clothctl::TargetCurves read =
      pair ? must(clothctl::read_target_pair(o.targets.substr(0, comma), o.targets.substr(comma + 1), o.dt))
           : must(clothctl::read_targets(o.targets));
  Task task;
  task.names = read.names;
  if (read.times.size() < 2) refuse(o.targets + ": needs at least 2 rows, has " + std::to_string(read.times.size()));
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
  std::snprintf(text, sizeof text, ": %s and %s are %.3g m apart at %.2f s; there is %.3g m of cloth between them",
                task.names[a].c_str(), task.names[b].c_str(), furthest, when, cloth);
  if (!(furthest <= 10 * cloth)) refuse(o.targets + text);
  std::fprintf(stderr, "warning: %s%s\n", o.targets.c_str(), text);
}

Task make_handkerchief_task(const std::string& name, std::uint64_t seed, double size, const Vec& left, const Vec& right) {
  Task task;
  task.names = {"L", "R"};
  task.duration = name == "wind" ? 6 : 5;
  const double pi = 3.14159265358979323846;
  const Index rows = static_cast<Index>(std::lround(task.duration / 0.02)) + 1;
  clothctl::VectorX<double> times(rows);
  for (Index i = 0; i < rows; ++i) times[i] = 0.02 * static_cast<double>(i);
  Points a(3, rows), b(3, rows);
  const auto ramp = [](double t) { return t <= 0 ? 0.0 : t >= 1 ? 1.0 : t * t * t * (10 - 15 * t + 6 * t * t); };
  if (name == "circle") {
    // Both corners go round the vertical axis through the hands on a horizontal circle that opens during the first second.
    const double radius = 0.3 * size, period = 1.8;
    for (Index i = 0; i < rows; ++i) {
      const double t = times[i], open = radius * ramp(t), angle = 2 * pi * t / period;
      const Vec shift(open * std::cos(angle), open * std::sin(angle), 0.3 * open);
      a.col(i) = left + shift;
      b.col(i) = right + shift;
    }
  } else {
    // Two asynchronous lines with the same end, time laws u^a and u^(1/a), and normal noise on 22 control points.
    Normal normal(seed * 2654435761u + 12345u);
    const double law = 1.5, scale = name == "wind" ? 0.3 : 1.0;
    const Vec end = scale * size * Vec(0.3 * normal(), 0.3 * normal(), 0.12 * normal() + 0.2);
    const Index controls = 22;
    Points ca(3, controls), cb(3, controls);
    for (Index i = 0; i < controls; ++i) {
      const double u = i < 3 ? 0.0 : static_cast<double>(i - 2) / static_cast<double>(controls - 3);
      const double noise = i < 3 ? 0.0 : 0.06 * size * scale;
      ca.col(i) = left + end * std::pow(u, law) + noise * Vec(normal(), normal(), normal());
      cb.col(i) = right + end * std::pow(u, 1 / law) + noise * Vec(normal(), normal(), normal());
    }
    const clothctl::CubicBSpline<double> sa = must(clothctl::CubicBSpline<double>::from_control_points(ca, 0, task.duration));
    const clothctl::CubicBSpline<double> sb = must(clothctl::CubicBSpline<double>::from_control_points(cb, 0, task.duration));
    for (Index i = 0; i < rows; ++i) {
      a.col(i) = sa.position(times[i]);
      b.col(i) = sb.position(times[i]);
    }
    const Points wide_a = a, wide_b = b;
    keep_close(a, b, 0.92 * size, 0.98 * size);
    for (Index i = 0; i < rows; ++i) {  // blended in, so that the curves start at the settled corners
      const double w = ramp(times[i] / 0.3);
      a.col(i) = (1 - w) * wide_a.col(i) + w * a.col(i);
      b.col(i) = (1 - w) * wide_b.col(i) + w * b.col(i);
    }
  }
  if (name == "wind") {
    // A breeze from the front with gusts, known to the planner.
    task.wind = [ramp](double t) {
      const double gust = 1 + 0.5 * std::sin(2.1 * t) + 0.3 * std::sin(5.3 * t + 1);
      return Vec(0.2 * ramp(t / 2) * gust, 1.0 * ramp(t / 2) * gust, 0);
    };
  }
  task.curves.push_back(must(clothctl::CubicBSpline<double>::interpolate(times, a)));
  task.curves.push_back(must(clothctl::CubicBSpline<double>::interpolate(times, b)));
  return task;
}

}  // namespace program
