#pragma once

// Targets: read from files, or made for the built-in tasks. Curves are cubic B-splines through or
// near their points.

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "clothctl/math/b_spline.hpp"
#include "support/plants.hpp"

namespace program {

/// What the features shall do, and the air around.
struct Task {
  std::vector<std::string> names;
  std::vector<clothctl::CubicBSpline<double>> curves;
  double duration = 0;
  std::function<Vec(double)> wind = [](double) { return Vec(Vec::Zero()); };
};

/// Reads `--targets`: one file with a header, or LEFT,RIGHT without.
Task read_task(const Options& o);

/// Refuses curves a and b that go further apart than ten times the `cloth` between them (m), as in
/// a file of millimetres, and warns on stderr where they would stretch it.
void check_reach(const Options& o, const Task& task, std::size_t a, std::size_t b, double cloth);

/// The two lower corners start at `left` and `right` (m) and move as `name` says; lengths scale
/// with the sheet's `size`.
Task make_handkerchief_task(const std::string& name, std::uint64_t seed, double size,
                            const Vec& left, const Vec& right);

}  // namespace program
