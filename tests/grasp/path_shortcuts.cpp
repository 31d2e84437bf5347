// PathShortcuts: paths stay free, keep their ends and never become longer.

#include "clothctl/grasp/detail/path_shortcuts.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "support/catch.hpp"

using clothctl::VectorX;
using clothctl::detail::MotionCheck;
using clothctl::detail::PathShortcuts;
using clothctl::detail::Posture;
using clothctl::detail::SplitMix;

namespace {

VectorX<double> vector(double a, double b) {
  VectorX<double> v(2);
  v << a, b;
  return v;
}

/// Distance from a disc of radius 0.5.
double clearance(const VectorX<double>& q) { return q.norm() - 0.5; }
using Clearance = double (*)(const VectorX<double>&);

/// A detour round the disc in many small steps that zigzag.
template <class Check>
std::vector<Posture<double>> detour(Check& check) {
  std::vector<Posture<double>> path;
  for (int i = 0; i <= 60; ++i) {
    const double angle = 3.141592653589793 * i / 60, radius = i % 2 == 0 ? 0.9 : 1.0;
    path.push_back(check.posture(vector(-radius * std::cos(angle), radius * std::sin(angle))));
  }
  return path;
}

}  // namespace

TEST_CASE("shortcuts never lengthen a path, and keep it free", "[path_shortcuts]") {
  const VectorX<double> reach = vector(1, 1);
  Clearance ask = clearance;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    MotionCheck<double, Clearance> check(ask, reach, 1e-3, 1e-3);
    const std::vector<Posture<double>> start = detour(check);
    PathShortcuts<double, Clearance> path(check, start);
    const double before = path.length();
    double last = before;
    SplitMix random(seed);
    for (int k = 0; k <= 100; ++k) {
      if (k < 100) path.cut(random);
      if (k == 100) path.drop_corners();
      CHECK(path.length() <= last + 1e-12);
      last = path.length();
      CHECK(path.path().front().q == start.front().q);
      CHECK(path.path().back().q == start.back().q);
      for (std::size_t i = 0; i + 1 < path.path().size(); ++i)
        REQUIRE(check.is_free(path.path()[i], path.path()[i + 1]));
    }
    CHECK(last < 0.75 * before);
    CHECK(path.path().size() < 15);
  }
}

TEST_CASE("corners on a straight way are left out", "[path_shortcuts]") {
  const VectorX<double> reach = vector(1, 1);
  Clearance ask = [](const VectorX<double>&) { return 0.01; };
  MotionCheck<double, Clearance> check(ask, reach, 1e-3, 1e-3);
  std::vector<Posture<double>> corners;
  for (const double x : {0.0, 0.25, 0.5, 0.5, 0.75, 1.0})
    corners.push_back(check.posture(vector(x, x)));
  PathShortcuts<double, Clearance> path(check, corners);
  path.drop_corners();
  CHECK(path.path().size() == 2);
  CHECK(path.length() == 2);
}

TEST_CASE("a straight path, and one without length, stay", "[path_shortcuts]") {
  const VectorX<double> reach = vector(1, 0);
  Clearance ask = [](const VectorX<double>&) { return 1.0; };
  MotionCheck<double, Clearance> check(ask, reach, 1e-3, 1e-3);
  SplitMix random(1);
  for (const double x : {1.0, 0.0}) {
    PathShortcuts<double, Clearance> path(
        check, {check.posture(vector(0, 0)), check.posture(vector(x, 1))});
    for (int k = 0; k < 20; ++k) path.cut(random);
    path.drop_corners();
    CHECK(path.path().size() == 2);
    CHECK(path.length() == x);
  }
}
