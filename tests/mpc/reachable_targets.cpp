// The nearest reachable targets: nothing moves that need not, known nearest places, and speed.

#include "clothctl/mpc/reachable_targets.hpp"

#include <cmath>
#include <limits>

#include "mpc/reach_limits.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::flat_reach;
using clothctl_test::moved_features;
using V = Vector3<double>;

namespace {

template <class Target>
ReachableTargets<double, Target> nearest(const ReachLimits<double>& limits, Target target,
                                         double end = 2.0) {
  return ReachableTargets<double, Target>::create(limits, target, 0.0, end).value();
}

}  // namespace

TEST_CASE("reachable targets keep their bits", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  const auto target = moved_features(limits, [](Index, double t) {
    return V(0.1 * std::sin(3 * t), 0.2 * t, 0.05 * std::cos(t));
  });
  const auto moved = nearest(limits, target);
  CHECK(!moved.moved());
  CHECK(moved.mean_change() == 0);
  CHECK(moved.last_motion() == 0);
  for (const double t : {-1.0, 0.0, 0.313, 1.999, 5.0}) {
    for (Index i : {0, 1}) CHECK((moved(i, t) - target(i, t)).norm() == 0);
  }
}

TEST_CASE("features that are too far apart meet on their line", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  const auto target = moved_features(
      limits, [](Index i, double) { return V(i == 0 ? -0.04 : 0.06, i == 0 ? 0.0 : 0.1, 0); });
  const auto moved = nearest(limits, target);
  const double apart = std::hypot(0.6, 0.1), excess = apart - 0.505;
  for (const double t : {-0.5, 0.0, 0.507, 2.0, 3.0}) {
    CHECK((moved(1, t) - moved(0, t)).norm() == Approx(0.505));
    CHECK((moved(0, t) - target(0, t)).norm() == Approx(excess / 2));
    CHECK((moved.change(0, t) + moved.change(1, t)).norm() < 1e-12);
    CHECK((moved(1, t) - moved(0, t)).cross(target(1, t) - target(0, t)).norm() < 1e-12);
  }
  CHECK(moved.largest_change().value == Approx(excess / 2));
  CHECK(moved.mean_change() == Approx(excess / 2));
  CHECK(moved.last_motion() < 1e-6);
}

TEST_CASE("a jump becomes a run of the hands' speed, half before it and half after", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  const auto target =
      moved_features(limits, [](Index, double t) { return V(t < 0.99 ? 0.0 : 0.4, 0, 0); });
  const auto moved = nearest(limits, target);
  // 0.4 m in a frame, of which 0.05 m are allowed: no curve has less than half of the rest as its
  // largest distance.
  CHECK(moved.largest_change().value == Approx(0.175));
  double fastest = 0;
  for (int k = 0; k < 100; ++k) {
    for (Index i : {0, 1})
      fastest = std::max(fastest, (moved(i, 0.02 * (k + 1)) - moved(i, 0.02 * k)).norm());
  }
  CHECK(fastest == Approx(0.05));
  CHECK((moved(0, 0.5) - target(0, 0.5)).norm() < 1e-12);
  CHECK((moved(0, 1.5) - target(0, 1.5)).norm() < 1e-12);
}

TEST_CASE("speed, distance and floor are met together", "[mpc]") {
  ReachLimits<double> limits = flat_reach();
  limits.floor = limits.features(2, 0) - 0.05;
  const auto target = moved_features(limits, [](Index i, double t) {
    const double side = i == 0 ? -1.0 : 1.0;
    return V(t < 0.7 ? 0.0 : 0.5 + 0.1 * side, side * 0.2 * std::sin(20 * t), -0.2 * t);
  });
  const auto moved = nearest(limits, target);
  CHECK(moved.moved());
  CHECK(moved.last_motion() < 1e-5);
  for (int k = 0; k < 100; ++k) {
    const double t = 0.02 * k;
    CHECK((moved(1, t) - moved(0, t)).norm() < 0.505 + 1e-5);
    for (Index i : {0, 1}) {
      CHECK(moved(i, t)[2] > limits.floor - 1e-5);
      CHECK((moved(i, t + 0.02) - moved(i, t)).cwiseAbs().maxCoeff() < 0.05 + 1e-5);
    }
  }
  const auto report = assess_reachability(limits, moved, 0.0, 2.0).value();
  CHECK(report.least_error < 1e-5);
}

TEST_CASE("evaluating nearest targets does not allocate", "[mpc]") {
  if (!clothctl_test::allocation_counting_works()) return;
  const ReachLimits<double> limits = flat_reach();
  const auto moved = nearest(
      limits, moved_features(limits, [](Index i, double) { return V(i == 0 ? -0.1 : 0.0, 0, 0); }));
  const long before = clothctl_test::allocations();
  double sum = 0;
  for (int k = -10; k < 200; ++k) sum += moved(k & 1, 0.011 * k)[0];
  CHECK(clothctl_test::allocations() == before);
  CHECK(std::isfinite(sum));
}

TEST_CASE("nearest targets of bad curves are refused", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto target =
      moved_features(limits, [&](Index, double t) { return V(t > 0.5 ? nan : 0.0, 0, 0); });
  using Nearest = ReachableTargets<double, std::remove_cv_t<decltype(target)>>;
  const auto made = Nearest::create(limits, target, 0.0, 1.0);
  REQUIRE(!made.has_value());
  CHECK(made.error().find("target of feature 0 at 0.52 s") != std::string::npos);
  CHECK(!Nearest::create(limits, target, 0.4, 0.4).has_value());
}
