// Reachability: curves whose figures are known, how they scale, and bad input.

#include "clothctl/mpc/reachability.hpp"

#include <cmath>
#include <limits>

#include "mpc/reach_limits.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::flat_reach;
using clothctl_test::moved_features;
using V = Vector3<double>;

namespace {

template <class Motion>
ReachabilityReport<double> judged(const ReachLimits<double>& limits, Motion motion,
                                  double end = 3.0) {
  return assess_reachability(limits, moved_features(limits, motion), 0.0, end).value();
}

}  // namespace

TEST_CASE("limits of a square sheet are its sides and diagonals", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  CHECK(limits.feature_lengths(0, 1) == Approx(0.5));
  CHECK(limits.feature_lengths(1, 0) == Approx(0.5));
  CHECK(limits.feature_lengths(0, 0) == 0);
  CHECK(limits.grip_lengths(0, 0) == Approx(0.5));
  CHECK(limits.grip_lengths(0, 1) == Approx(std::sqrt(0.5)));
  CHECK(limits.max_hand_speed == Approx(2.5));
  CHECK(limits.size() == Approx(0.5));
  // A sheet on a table has no hanging length; lengths on the sheet take its place.
  ReachLimits<double> level = limits;
  for (HandAnchor<double>& anchor : level.anchors) anchor.hanging_length = 0;
  CHECK(level.size() == Approx((1 + std::sqrt(2.0)) / 4));
}

TEST_CASE("a target at rest is reachable without error", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  const auto report = judged(limits, [](Index, double) { return V(V::Zero()); });
  CHECK(report.verdict == ReachVerdict::Reachable);
  CHECK(report.score == Approx(1.0));
  CHECK(report.predicted_error < 1e-12);
  CHECK(report.least_error == 0);
  CHECK(report.distance_excess.value == 0);
  CHECK(report.place_excess.value == 0);
  CHECK(report.start_gap.value == 0);
  CHECK(report.hand_speed_excess.value == 0);
  CHECK(report.fall_excess.value == 0);
}

TEST_CASE("corners farther apart than the sheet allows are unreachable by what is known", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  // From 1 s on, each corner is 60 mm further out: 0.62 m apart, on 0.5 m of cloth with 1 % of
  // stretch.
  const auto report = judged(
      limits,
      [](Index i, double t) {
        return V(t < 0.99 ? 0.0 : i == 0 ? -0.06 : 0.06, 0, 0);
      },
      2.0);
  CHECK(report.distance_excess.value == Approx(0.62 - 0.505));
  CHECK(report.distance_excess.time == Approx(1.0));
  CHECK(report.least_error == Approx(0.5 * (0.62 - 0.505) * 51 / 101));
  CHECK(report.predicted_error > 0.5 * 0.12 * 51 / 101);
  CHECK(report.predicted_largest_error > 0.5 * 0.12);
  CHECK(report.verdict == ReachVerdict::Unreachable);
  CHECK(report.score == 0);
  CHECK(report.describe().find("too far from another one by 0.115 m") != std::string::npos);
  // As far as stretch allows, there is no error that cannot be avoided.
  const auto within =
      judged(limits, [](Index i, double) { return V(i == 0 ? -0.0025 : 0.0025, 0, 0); });
  CHECK(within.least_error < 1e-12);
}

TEST_CASE("speeds and accelerations are those of the curve", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  SECTION("constant acceleration across the sheet") {
    // The hands lead, but are accelerated as the features are.
    const auto report = judged(
        limits, [](Index, double t) { return V(0.3 * t, 0.5 * 1.7 * t * t, 0); }, 2.0);
    CHECK(report.acceleration.value == Approx(1.7).epsilon(1e-6));
    CHECK(report.hand_acceleration.value == Approx(1.7).epsilon(1e-6));
    CHECK(report.speed.value == Approx(std::hypot(0.3, 3.4)));
    CHECK(report.hand_speed.value == Approx(3.4));
    CHECK(report.hand_speed.time == Approx(2.0));
    CHECK(report.hand_speed_excess.value == Approx(0.9));
    CHECK(report.fall_excess.value == 0);
  }
  SECTION("a fall that is faster than free") {
    const auto report = judged(
        limits, [](Index, double t) { return V(0, 0, -7.5 * t * t); }, 1.0);
    CHECK(report.fall_excess.value == Approx(15 - 9.81).epsilon(1e-6));
    CHECK(report.hand_acceleration.value < 1e-9);
  }
  SECTION("twice the speed") {
    const auto sway = [](double rate) {
      return [rate](Index, double t) { return V(0.1 * std::sin(rate * t), 0, 0); };
    };
    const auto slow = judged(limits, sway(1.0), 7.0), fast = judged(limits, sway(2.0), 7.0);
    CHECK(fast.speed.value / slow.speed.value == Approx(2.0).epsilon(1e-3));
    CHECK(fast.acceleration.value / slow.acceleration.value == Approx(4.0).epsilon(1e-3));
    CHECK(fast.score < slow.score);
  }
}

TEST_CASE("what predicted errors are made of is known for simple curves", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  const double swing = 0.5 / 9.81;
  const auto causes = [&](auto motion) { return judged(limits, motion, 2.0).causes; };
  const auto fall = causes([](Index, double t) { return V(0, 0, -t * t); });
  CHECK(fall.feature == Approx(2 * swing).epsilon(1e-6));
  CHECK(fall.hand + fall.close + fall.tilt + fall.excess < 1e-9);
  const auto across = causes([](Index, double t) { return V(0, t * t, 0); });
  CHECK(across.hand == Approx(2 * swing).epsilon(1e-6));
  CHECK(across.feature == Approx(2 * swing).epsilon(1e-6));
  const auto wide = causes([](Index i, double t) {
    return V(t < 0.99 ? 0.0 : i == 0 ? -0.05 : 0.05, 0, 0);
  });
  CHECK(wide.largest_excess == Approx(0.05));
  CHECK(wide.excess == Approx(0.05 * 51 / 101));
  CHECK(wide.close == 0);
  const auto closer = causes([](Index i, double) { return V(i == 0 ? 0.04 : 0.0, 0, 0); });
  CHECK(closer.close == Approx(0.04));
  const auto raised = causes([](Index i, double) { return V(0, 0, i == 0 ? 0.03 : 0.0); });
  CHECK(raised.tilt == Approx(0.03));
  CHECK(raised.largest_excess < 0.001);  // the line is a little longer
}

TEST_CASE("errors scale with the sheet, times with the root of its length", "[mpc]") {
  const auto sway = [](double size) {
    return [size](Index i, double t) {
      const double angle = 4 * t * std::sqrt(0.5 / size) + 0.3 * static_cast<double>(i);
      return V(size * V(0.1 * std::sin(angle), 0.2 * std::cos(angle), 0.1 * std::sin(2 * angle)));
    };
  };
  const auto one = judged(flat_reach(0.5, 0.02), sway(0.5), 2.0);
  const auto two = judged(flat_reach(1.0, 0.02 * std::sqrt(2.0)), sway(1.0), 2.0 * std::sqrt(2.0));
  CHECK(two.predicted_error / one.predicted_error == Approx(2.0).epsilon(1e-9));
  CHECK(two.predicted_largest_error / one.predicted_largest_error == Approx(2.0).epsilon(1e-9));
}

TEST_CASE("larger motions are less reachable", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  double last = 2;
  for (const double size : {0.01, 0.05, 0.1, 0.3, 1.0}) {
    const auto report = judged(limits, [&](Index, double t) {
      return V(0.3 * size * std::sin(3 * t), size * (1 - std::cos(3 * t)), 0);
    });
    CHECK(report.score < last);
    last = report.score;
  }
  CHECK(last < 0.3);
}

TEST_CASE("hands that are too slow lag, and are found out", "[mpc]") {
  ReachLimits<double> limits = flat_reach();
  const auto line = [](Index, double t) { return V(0.05 * t, 0, 0); };
  CHECK(judged(limits, line, 5.0).verdict == ReachVerdict::Reachable);
  limits.max_hand_speed = 0.001;
  const auto report = judged(limits, line, 5.0);
  CHECK(report.verdict == ReachVerdict::Unreachable);
  CHECK(report.hand_lag.value == Approx(5 * 0.049).epsilon(0.02));
  CHECK(report.predicted_error > 0.1);
  CHECK(report.predicted_largest_error >= report.hand_lag.value);
  limits.max_hand_speed = 0.05;
  CHECK(judged(limits, line, 5.0).hand_lag.value == Approx(0).margin(1e-9));
}

TEST_CASE("an error that cannot be avoided counts, however short it is", "[mpc]") {
  ReachLimits<double> limits = flat_reach();
  limits.floor = limits.features(2, 0) - 0.03;
  const auto dip = [](Index, double t) {
    const double s = std::abs(t - 2.0) < 0.1 ? 0.1 : 0.0;
    return V(0, 0, -s);
  };
  const auto report = judged(limits, dip, 5.0);
  CHECK(report.place_excess.value == Approx(0.07));
  CHECK(report.predicted_largest_error >= report.place_excess.value);
  CHECK(report.score == 0);
  CHECK(report.verdict == ReachVerdict::Unreachable);
}

TEST_CASE("features stay above the floor and within reach of limited grips", "[mpc]") {
  ReachLimits<double> limits = flat_reach();
  const double bottom = limits.features(2, 0);
  limits.floor = bottom - 0.1;
  const auto down = [](Index i, double) { return V(0, 0, i == 1 ? -0.16 : 0.0); };
  const auto below = judged(limits, down);
  CHECK(below.place_excess.value == Approx(0.06));
  CHECK(below.place_excess.index == 1);
  CHECK(below.least_error == Approx(0.03));
  // Hands that must stay where they are: corners cannot go lower than the sheet hangs.
  limits = flat_reach();
  for (int grip : {0, 1}) {
    const double hand = limits.features(2, grip) + 0.5;
    limits.grip_limits.push_back({grip, -1, V(0, 0, -1), -hand});
  }
  CHECK(judged(limits, down).place_excess.value == Approx(0.155));
  CHECK(judged(limits, [](Index, double) { return V(0, 0, 0.4); }).place_excess.value == 0);
}

TEST_CASE("a curve that starts elsewhere costs the time of a swing", "[mpc]") {
  const ReachLimits<double> limits = flat_reach();
  const auto report = judged(limits, [](Index, double) { return V(0.2, 0, 0); });
  CHECK(report.start_gap.value == Approx(0.2));
  CHECK(report.predicted_error == Approx(0.2 * 2 * std::sqrt(0.5 / 9.81) / (151 * 0.02)));
}

TEST_CASE("bad limits, times and targets are named", "[mpc]") {
  const ReachLimits<double> good = flat_reach();
  const auto still = moved_features(good, [](Index, double) { return V(V::Zero()); });
  const auto refused = [&](const ReachLimits<double>& limits, const auto& target, double end,
                           ReachTolerance<double> tolerance = {}) {
    const auto report = assess_reachability(limits, target, 0.0, end, tolerance);
    REQUIRE(!report.has_value());
    return report.error();
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(refused(good,
                moved_features(good,
                               [&](Index i, double t) {
                                 return V(0, i == 1 && t > 0.39 && t < 0.41 ? nan : 0.0, 0);
                               }),
                1.0)
            .find("target of feature 1 at 0.4") != std::string::npos);
  CHECK(refused(good, still, 0.0).find("from 0 s to 0 s") != std::string::npos);
  CHECK(refused(good, still, nan).find("nan") != std::string::npos);
  CHECK(refused(good, still, 1e9).find("million") != std::string::npos);
  CHECK(refused(good, still, 1.0, {nan, 1.0}).find("tolerance") != std::string::npos);
  ReachLimits<double> bad = good;
  bad.stretch = nan;
  CHECK(refused(bad, still, 1.0).find("stretch is nan") != std::string::npos);
  bad = good;
  bad.feature_lengths(0, 1) = -1;
  CHECK(refused(bad, still, 1.0).find("length is -1") != std::string::npos);
  bad = good;
  bad.grip_lengths.resize(2, 1);
  CHECK(refused(bad, still, 1.0).find("grip_lengths") != std::string::npos);
  bad = good;
  bad.gravity = 0;
  CHECK(refused(bad, still, 1.0).find("gravity is 0") != std::string::npos);
  bad = good;
  bad.floor = nan;
  CHECK(refused(bad, still, 1.0).find("floor is nan") != std::string::npos);
  bad = good;
  bad.anchors.clear();
  bad.grip_lengths.resize(2, 0);
  CHECK(bad.validate() == "there are no anchors");
  bad = good;
  bad.anchors[1].hanging_length = nan;
  CHECK(refused(bad, still, 1.0).find("anchor 1") != std::string::npos);
  bad = good;
  bad.grip_limits.push_back({7, -1, V(0, 0, 1), 0.0});
  CHECK(refused(bad, still, 1.0).find("grip limit 0") != std::string::npos);
}
