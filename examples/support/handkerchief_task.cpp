#include <algorithm>
#include <cmath>

#include "support/random_number.hpp"
#include "support/tasks.hpp"

namespace program {

namespace {

/// Three of them. The order of arguments would be the compiler's choice.
Vec normal_vector(Normal& normal) {
  const double z = normal(), y = normal(), x = normal();
  return {x, y, z};
}

/// Limits the distance of two curves to `most`, smoothly from `from` on, because a sheet cannot
/// stretch.
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

/// Both corners move around the vertical axis through the hands, on a circle that grows during the
/// first second.
void draw_circles(const clothctl::VectorX<double>& times, double size, const Vec& left,
                  const Vec& right, Points& a, Points& b) {
  const double pi = 3.14159265358979323846, radius = 0.3 * size, period = 1.8;
  for (Index i = 0; i < times.size(); ++i) {
    const double t = times[i], open = radius * ramp(t), angle = 2 * pi * t / period;
    const Vec shift(open * std::cos(angle), open * std::sin(angle), 0.3 * open);
    a.col(i) = left + shift;
    b.col(i) = right + shift;
  }
}

/// Returns the control points of a curve of `duration`: 22 for 5 s, of which 3 stand still.
Index control_points(double duration) {
  return std::max<Index>(7, static_cast<Index>(std::lround(22 * duration / 5)));
}

/// Draws B-splines of control points; their distance is limited to what a sheet of `size` bears.
void draw_splines(const clothctl::VectorX<double>& times, double size, const Points& ca,
                  const Points& cb, Points& a, Points& b) {
  const double duration = times[times.size() - 1];
  const auto sa = must(clothctl::CubicBSpline<double>::from_control_points(ca, 0, duration));
  const auto sb = must(clothctl::CubicBSpline<double>::from_control_points(cb, 0, duration));
  for (Index i = 0; i < times.size(); ++i) {
    a.col(i) = sa.position(times[i]);
    b.col(i) = sb.position(times[i]);
  }
  const Points wide_a = a, wide_b = b;
  keep_close(a, b, 0.92 * size, 0.98 * size);
  for (Index i = 0; i < times.size();
       ++i) {  // blended in, since curves start at the settled corners
    const double w = ramp(times[i] / 0.3);
    a.col(i) = (1 - w) * wide_a.col(i) + w * a.col(i);
    b.col(i) = (1 - w) * wide_b.col(i) + w * b.col(i);
  }
}

/// Two asynchronous lines with the same end, time laws u^a and u^(1/a), and normally distributed
/// noise on their control points.
void draw_lines(const clothctl::VectorX<double>& times, std::uint64_t seed, double scale,
                double noise_sd, double size, const Vec& left, const Vec& right, Points& a,
                Points& b) {
  Normal normal(seed * 2654435761u + 12345u);
  const double law = 1.5;
  const Vec end =
      scale * size * (normal_vector(normal).cwiseProduct(Vec(0.3, 0.3, 0.12)) + Vec(0, 0, 0.2));
  const Index controls = control_points(times[times.size() - 1]);
  Points ca(3, controls), cb(3, controls);
  for (Index i = 0; i < controls; ++i) {
    const double u = i < 3 ? 0.0 : static_cast<double>(i - 2) / static_cast<double>(controls - 3);
    const double noise = i < 3 ? 0.0 : noise_sd;
    ca.col(i) = left + end * std::pow(u, law) + noise * normal_vector(normal);
    cb.col(i) = right + end * std::pow(u, 1 / law) + noise * normal_vector(normal);
  }
  draw_splines(times, size, ca, cb, a, b);
}

}  // namespace

double ramp(double t) {
  return t <= 0 ? 0.0 : t >= 1 ? 1.0 : t * t * t * (10 - 15 * t + 6 * t * t);
}

clothctl::VectorX<double> frame_times(double duration) {
  const Index rows = static_cast<Index>(std::lround(duration / 0.02)) + 1;
  clothctl::VectorX<double> times(rows);
  for (Index i = 0; i < rows; ++i) times[i] = 0.02 * static_cast<double>(i);
  return times;
}

Task curves_task(const clothctl::VectorX<double>& times, const Points& a, const Points& b) {
  Task task;
  task.names = {"L", "R"};
  task.duration = times[times.size() - 1];
  task.curves.push_back(must(clothctl::CubicBSpline<double>::interpolate(times, a)));
  task.curves.push_back(must(clothctl::CubicBSpline<double>::interpolate(times, b)));
  return task;
}

Task make_handkerchief_task(const std::string& name, std::uint64_t seed, double size,
                            const Vec& left, const Vec& right) {
  const clothctl::VectorX<double> times = frame_times(name == "wind" ? 6 : 5);
  Points a(3, times.size()), b(3, times.size());
  const double scale = name == "wind" ? 0.3 : 1.0;
  if (name == "circle") {
    draw_circles(times, size, left, right, a, b);
  } else {
    draw_lines(times, seed, scale, 0.06 * size * scale, size, left, right, a, b);
  }
  Task task = curves_task(times, a, b);
  if (name == "wind") {
    // A breeze from the front with gusts, which the planner knows.
    task.wind = [](double t) {
      const double gust = 1 + 0.5 * std::sin(2.1 * t) + 0.3 * std::sin(5.3 * t + 1);
      return Vec(0.2 * ramp(t / 2) * gust, 1.0 * ramp(t / 2) * gust, 0);
    };
  }
  return task;
}

Task make_random_task(std::uint64_t seed, double noise_sd, double duration, double size,
                      const Vec& left, const Vec& right) {
  const clothctl::VectorX<double> times = frame_times(duration);
  Points a(3, times.size()), b(3, times.size());
  draw_lines(times, seed, 1.0, noise_sd, size, left, right, a, b);
  return curves_task(times, a, b);
}

Task make_hand_paths(std::uint64_t seed, double noise_sd, double duration, double size,
                     const Vec& left, const Vec& right) {
  const clothctl::VectorX<double> times = frame_times(duration);
  Points a(3, times.size()), b(3, times.size());
  Normal normal(seed * 2654435761u + 54321u);
  const Vec drift = 0.3 * size * normal_vector(normal);
  const Index controls = control_points(duration);
  Points ca(3, controls), cb(3, controls);
  for (Index i = 0; i < controls; ++i) {
    const double u = i < 3 ? 0.0 : static_cast<double>(i - 2) / static_cast<double>(controls - 3);
    const double noise = i < 3 ? 0.0 : noise_sd;
    ca.col(i) = left + u * drift + noise * normal_vector(normal);
    cb.col(i) = right + u * drift + noise * normal_vector(normal);
  }
  draw_splines(times, size, ca, cb, a, b);
  return curves_task(times, a, b);
}

}  // namespace program
