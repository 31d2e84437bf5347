#pragma once

// Targets: read from files, or made for the built-in tasks. Curves are cubic B-splines that
// interpolate or approximate their points.

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "clothctl/math/b_spline.hpp"
#include "support/plants.hpp"

namespace program {

/// The targets of the features, and the wind.
struct Task {
  std::vector<std::string> names;
  std::vector<clothctl::CubicBSpline<double>> curves;
  double duration = 0;
  std::function<Vec(double)> wind = [](double) { return Vec(Vec::Zero()); };
};

/// Rises smoothly from 0 at t = 0 to 1 at t = 1.
double ramp(double t);

/// Reads `--targets`: one file with a header, or LEFT,RIGHT without headers.
Task read_task(const Options& o);

/// Refuses curves a and b whose distance exceeds ten times the length (m) of the `cloth` between
/// them, as for a file in millimetres. Warns on stderr if they would stretch the cloth.
void check_reach(const Options& o, const Task& task, std::size_t a, std::size_t b, double cloth);

/// Returns the motion `name` of the two lower corners from `left` and `right` (m). Lengths scale
/// with the sheet's `size`.
Task make_handkerchief_task(const std::string& name, std::uint64_t seed, double size,
                            const Vec& left, const Vec& right);

/// Returns the times of the frames of `duration` s, from 0 on, s.
clothctl::VectorX<double> frame_times(double duration);

/// Returns the task that moves the lower left corner through `a` and the right one through `b` (a
/// column for each time, m).
Task curves_task(const clothctl::VectorX<double>& times, const Points& a, const Points& b);

/// Returns random targets as in [Bai 2016], section 6.2: two asynchronous lines from `left` and
/// `right`, with normal noise of standard deviation `noise_sd` (m) on every axis of the control
/// points of their B-splines, 22 in 5 s. `duration`: s.
Task make_random_task(std::uint64_t seed, double noise_sd, double duration, double size,
                      const Vec& left, const Vec& right);

/// Returns random smooth paths of two hands: B-splines with a common drift and noise as above.
Task make_hand_paths(std::uint64_t seed, double noise_sd, double duration, double size,
                     const Vec& left, const Vec& right);

}  // namespace program
