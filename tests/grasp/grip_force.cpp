#include "clothctl/grasp/detail/grip_force.hpp"

#include <array>
#include <cmath>
#include <vector>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Touches = std::array<PadTouch<double>, 2>;

Touches felt(double normal, double across, int sliding = 0) {
  PadTouch<double> t;
  t.normal_force = normal;
  t.tangential_force = across;
  t.contacts = 4;
  t.sliding = sliding;
  return {t, t};
}

}  // namespace

TEST_CASE("a grip presses as the load needs, and as asked for where that is more", "[grasp]") {
  GraspSettings<double> settings;
  detail::GripForce<double> force;
  force.reset(2);
  GraspReport<double> report;
  force.update(settings, 3, true, 0.02, felt(2, 0.5), report);
  CHECK(report.wanted_force == 3);  // 1.5 · 0.5 / 0.6 is less
  CHECK(report.mean_force == 2);
  force.update(settings, 3, true, 0.02, felt(2, 2), report);
  CHECK(report.wanted_force == Approx(1.5 * 2 / 0.6));
  force.update(settings, 3, true, 0.02, felt(2, 0), report);
  CHECK(report.wanted_force == Approx(3 + 2 * 0.98));  // falls with a time constant of 1 s
  force.update(settings, 3, true, 0.02, felt(2, 100), report);
  CHECK(report.wanted_force == settings.most_force);
  CHECK_FALSE(report.too_weak);  // nothing slides
  force.update(settings, 3, false, 0.02, felt(2, 100), report);
  CHECK(report.wanted_force == 3);  // while it closes, the load does not count
}

TEST_CASE("a grip that slides at the largest force is too weak, whatever the rounding", "[grasp]") {
  GraspSettings<double> settings;
  GraspReport<double> report;
  int missed = 0;
  for (int most = 1; most <= 100; ++most) {
    for (int asked = 1; asked <= most; ++asked) {
      settings.most_force = 0.1 * most;
      detail::GripForce<double> force;
      force.reset(2);
      force.update(settings, 0.1 * asked, true, 0.02, felt(2, 1000, 4), report);
      if (!report.too_weak || report.wanted_force != settings.most_force) ++missed;
    }
  }
  CHECK(missed == 0);
}

TEST_CASE("a grip rises steadily while something slides, and each slip counts once", "[grasp]") {
  GraspSettings<double> settings;
  settings.most_force = 4;
  detail::GripForce<double> force;
  force.reset(2);
  GraspReport<double> report;
  force.update(settings, 3, false, 0.02, felt(3, 0, 4), report);
  CHECK(force.slips() == 0);  // not while it closes
  force.update(settings, 3, true, 0.02, felt(3, 0, 0), report);
  CHECK_FALSE(report.slides);
  double last = 3;
  for (int i = 0; i < 40; ++i) {
    force.update(settings, 3, true, 0.02, felt(3, 0, 3), report);
    CHECK(report.slides);
    CHECK(report.wanted_force >= last);
    CHECK(report.wanted_force - last <= 2 * 3 * 0.02 + 1e-12);
    last = report.wanted_force;
  }
  CHECK(last == 4);
  CHECK(report.too_weak);
  CHECK(force.slips() == 2);  // both fingers began once
  force.update(settings, 3, true, 0.02, felt(3, 0, 2), report);
  CHECK_FALSE(report.slides);  // half is not more than half
  Touches one = felt(3, 0, 0);
  one[1].sliding = 4;
  one[1].normal_force = 1;
  force.update(settings, 3, true, 0.02, one, report);
  CHECK(force.slips() == 3);
  CHECK(report.least_force == 1);
  force.reset(2);
  CHECK(force.slips() == 0);
}

TEST_CASE("a fingertip against a spring ends at its force, within speed and depth", "[grasp]") {
  GraspSettings<double> settings;
  using Force = detail::GripForce<double>;
  double depth = 0, last = 0;
  for (int i = 0; i < 200; ++i) {
    depth = Force::deepen(settings, 3, 2000 * depth, 0.02, depth);
    CHECK(depth - last <= settings.closing_speed * 0.02 + 1e-15);
    CHECK(depth >= last - 1e-15);  // does not overshoot
    last = depth;
  }
  CHECK(depth == Approx(3.0 / 2000));
  // After one response time, 1 - (1 - 0.2)^5 of the way.
  depth = 0;
  for (int i = 0; i < 5; ++i) depth = Force::deepen(settings, 3, 2000 * depth, 0.02, depth);
  CHECK(depth == Approx(3.0 / 2000 * (1 - std::pow(0.8, 5))));
  // Against nothing it stops at the largest depth, and pushed back at its negative.
  for (int i = 0; i < 1000; ++i) depth = Force::deepen(settings, 10, 0, 0.02, depth);
  CHECK(depth == settings.most_depth);
  for (int i = 0; i < 1000; ++i) depth = Force::deepen(settings, 1, 1e6, 0.02, depth);
  CHECK(depth == -settings.most_depth);
}

TEST_CASE("bad readings are named, each", "[grasp]") {
  const HandState<double> good{VectorX<double>::Zero(3), VectorX<double>::Zero(2)};
  const std::vector<PadTouch<double>> felt(2);
  const auto bad = [&](double dt, const HandState<double>& hand,
                       const std::vector<PadTouch<double>>& touches) {
    return detail::find_bad_reading<double>(dt, hand, 3, 2, touches, 2);
  };
  CHECK(bad(0.02, good, felt) == "");
  CHECK(bad(0, good, felt) == "the step length is not positive");
  CHECK(bad(std::nan(""), good, felt) == "the step length is not positive");
  HandState<double> hand = good;
  hand.velocities.resize(3);
  CHECK(bad(0.02, hand, felt) == "the state of the hand has another size");
  hand = good;
  hand.positions[2] = std::nan("");
  CHECK(bad(0.02, hand, felt) == "a position of the hand is not finite");
  hand = good;
  hand.velocities[1] = std::nan("");
  CHECK(bad(0.02, hand, felt) == "a velocity of the hand is not finite");
  CHECK(bad(0.02, good, {felt[0]}) == "there is not one touch for each finger of the grasp");
  auto spoilt = felt;
  spoilt[1].tangential_force = std::nan("");
  CHECK(bad(0.02, good, spoilt) == "a force that a finger feels is not finite");
}
