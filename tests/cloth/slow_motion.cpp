// Slow motion under a limit of stretch: what counts as slow, and what is damped.

#include "clothctl/cloth/detail/slow_motion.hpp"

#include <cmath>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

const Vector3<double> kGravity(0, 3, -4);  // 5 m/s²
constexpr double kSubstep = 0.01, kStep = 0.04;

/// Three vertices; the last two are held, one of them moves by 2 mm along x.
struct Hands {
  ClothState<double> state{Points<double>::Random(3, 3), Points<double>::Zero(3, 3)};
  ClothInput<double> input;
  Hands() {
    input.driven_vertices = {2};
    input.driven_positions = state.positions.col(2) + Vector3<double>(0.002, 0, 0);
  }
  SlowMotion<double> slow(std::size_t held = 2) const {
    return slow_motion(state, input, held, kGravity, kSubstep, kStep);
  }
};

}  // namespace

TEST_CASE("slow motion is measured against the mean of the hands and gravity", "[slow_motion]") {
  Hands hands;
  const SlowMotion<double> slow = hands.slow();
  CHECK((slow.held - Vector3<double>(0.001, 0, 0)).norm() <= 1e-15);
  CHECK(slow.way == Approx(5 * 0.01 * 0.04));
  hands.input.clear();
  CHECK(hands.slow(1).held == Vector3<double>::Zero());
  CHECK(hands.slow(0).held == Vector3<double>::Zero());
}

TEST_CASE("a sheet moves if the speeds relative to the hands exceed 3 g h", "[slow_motion]") {
  Hands hands;
  const SlowMotion<double> slow = hands.slow();
  const Vector3<double> hand = slow.held / kStep;
  VectorX<double> inverse_mass(3);
  inverse_mass << 0.5, 2.0, 0.0;  // 2 kg, 0.5 kg, held
  // The mean square, weighted by the masses, is (2 a² + 0.5 b²)/2.5.
  const auto at = [&](double a, double b) {
    hands.state.velocities.col(0) = hand + Vector3<double>(0, a, 0);
    hands.state.velocities.col(1) = hand + Vector3<double>(0, 0, -b);
    hands.state.velocities.col(2).setConstant(100);
    return moves(slow, hands.state, inverse_mass);
  };
  const double bound = 3 * 5 * kSubstep;
  CHECK_FALSE(at(0.999 * bound, 0.999 * bound));
  CHECK(at(1.001 * bound, 1.001 * bound));
  CHECK_FALSE(at(0, 2.23 * bound));
  CHECK(at(0, 2.24 * bound));
}

TEST_CASE("velocities fall with the square of the way, relative to the hands", "[slow_motion]") {
  const SlowMotion<double> slow = Hands().slow();
  const Vector3<double> hand = slow.held / kStep, speed(0.3, -0.2, 0.1);
  const double bound = 0.2 * slow.way;
  Points<double> before = Points<double>::Random(3, 4), after = before;
  Points<double> velocities(3, 4);
  const double ways[] = {0.0, 0.5, 0.999, 1.001};
  for (Index v = 0; v < 4; ++v) {
    after.col(v) += slow.held + Vector3<double>(0, 0, ways[v] * bound);
    velocities.col(v) = hand + speed;
  }
  const Vector3<double> fast = velocities.col(3);
  damp_slow_vertices(slow, before, after, velocities);
  const auto left = [&](Index v) { return Vector3<double>(velocities.col(v) - hand); };
  CHECK(left(0).norm() <= 1e-12);
  CHECK((left(1) - 0.25 * speed).norm() <= 1e-12);
  CHECK((left(2) - 0.998001 * speed).norm() <= 1e-10);
  CHECK(velocities.col(3) == fast);  // the same bits
}

TEST_CASE("without gravity nothing is slow", "[slow_motion]") {
  const Hands hands;
  const SlowMotion<double> slow = slow_motion(hands.state, hands.input, std::size_t(0),
                                              Vector3<double>(0, 0, 0), kSubstep, kStep);
  Points<double> velocities = 1e-9 * Points<double>::Random(3, 3);
  const Points<double> same = velocities;
  damp_slow_vertices(slow, hands.state.positions, hands.state.positions, velocities);
  CHECK(velocities == same);
}
