// MotionCheck: what is proved free is free, obstacles of any width are found, the cost is small.

#include "clothctl/grasp/detail/motion_check.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "support/catch.hpp"

using clothctl::Index;
using clothctl::VectorX;
using clothctl::detail::joint_way;
using clothctl::detail::MotionCheck;

namespace {

VectorX<double> vector(std::initializer_list<double> values) {
  VectorX<double> v(static_cast<Index>(values.size()));
  std::copy(values.begin(), values.end(), v.data());
  return v;
}

template <class Clearance>
bool free_between(Clearance clearance, const VectorX<double>& a, const VectorX<double>& b,
                  double margin = 1e-3, double resolution = 1e-3, long* queries = nullptr) {
  const VectorX<double> reach = VectorX<double>::Ones(a.size());
  MotionCheck<double, Clearance> check(clearance, reach, margin, resolution);
  const bool free = check.is_free(check.posture(a), check.posture(b));
  if (queries != nullptr) *queries = check.queries();
  return free;
}

}  // namespace

TEST_CASE("a way weighs each joint by its reach", "[motion_check]") {
  CHECK(joint_way(vector({1, 2, -1}), vector({0, 2.5, 1}), vector({0.5, 2, 0})) == 1.5);
  CHECK(joint_way(VectorX<double>(), VectorX<double>(), VectorX<double>()) == 0);
}

TEST_CASE("an obstacle is found wherever it is and however thin it is", "[motion_check]") {
  std::mt19937 engine(1);
  std::uniform_real_distribution<double> uniform(0.01, 0.99);
  for (int i = 0; i < 500; ++i) {
    const double where = uniform(engine);
    for (const double half : {0.1, 1e-3, 1e-6, 0.0}) {
      // A clearance that sees no farther than 0.07 m needs many questions.
      for (const double sight : {10.0, 0.07}) {
        const auto wall = [&](const VectorX<double>& q) {
          return std::min(std::abs(q[0] - where) - half, sight);
        };
        CHECK(!free_between(wall, vector({-0.2}), vector({1.2})));
        CHECK(!free_between(wall, vector({1.2}), vector({-0.2})));
        // Up to the wall, and the margin, the way is free.
        const double before = where - half - 1.01e-3;
        CHECK(free_between(wall, vector({-0.2}), vector({before})));
      }
    }
  }
}

TEST_CASE("room decides: a corridor as wide as the margin is free, a narrower one is not",
          "[motion_check]") {
  const auto corridor = [](double half) {
    return [half](const VectorX<double>& q) { return half - std::abs(q[1]); };
  };
  long queries = 0;
  CHECK(free_between(corridor(1.0001e-3), vector({0, 0}), vector({1, 0}), 1e-3, 1e-3, &queries));
  CHECK(queries < 2100);
  CHECK(!free_between(corridor(0.9999e-3), vector({0, 0}), vector({1, 0})));
  // In open space two questions suffice: those of the ends.
  CHECK(free_between(corridor(0.6), vector({0, 0}), vector({1, 0}), 1e-3, 1e-3, &queries));
  CHECK(queries == 2);
}

TEST_CASE("what is proved free keeps the margin less half the resolution", "[motion_check]") {
  std::mt19937 engine(2);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const double margin = 0.02, resolution = 0.03;
  int proved = 0, close = 0;
  for (int i = 0; i < 2000; ++i) {
    const VectorX<double> a = vector({uniform(engine), uniform(engine)}),
                          b = vector({uniform(engine), uniform(engine)}),
                          c = vector({uniform(engine), uniform(engine)});
    const double radius = 0.3 + 0.2 * uniform(engine);
    const auto disc = [&](const VectorX<double>& q) { return (q - c).norm() - radius; };
    double least = 1e9;
    for (int k = 0; k <= 1000; ++k) least = std::min(least, disc(a + k / 1000.0 * (b - a)));
    const bool free = free_between(disc, a, b, margin, resolution);
    CHECK(free == free_between(disc, b, a, margin, resolution));
    if (free) CHECK(least >= margin - resolution / 2 - 1e-12);
    if (!free) CHECK(least < margin + 1e-12);
    // A lower bound of the clearance proves less, and nothing wrong.
    const auto bound = [&](const VectorX<double>& q) { return 0.5 * disc(q); };
    const bool bound_free = free_between(bound, a, b, margin, resolution);
    if (bound_free) CHECK(least >= margin - resolution / 2 - 1e-12);
    proved += free ? 1 : 0;
    close += free && least < margin + resolution ? 1 : 0;
  }
  CHECK(proved > 500);
  CHECK(close > 10);
}

TEST_CASE("infinite clearances are numbers, NaN is not free and is remembered", "[motion_check]") {
  const double infinite = std::numeric_limits<double>::infinity();
  CHECK(free_between([&](const VectorX<double>&) { return infinite; }, vector({0}), vector({1})));
  CHECK(!free_between([&](const VectorX<double>&) { return -infinite; }, vector({0}), vector({1})));
  const auto broken = [](const VectorX<double>& q) {
    return std::abs(q[0] - 0.5) < 0.2 ? std::numeric_limits<double>::quiet_NaN() : 0.25;
  };
  const VectorX<double> reach = VectorX<double>::Ones(1);
  MotionCheck<double, const decltype(broken)> check(broken, reach, 1e-3, 1e-3);
  const auto a = check.posture(vector({0})), b = check.posture(vector({1}));
  CHECK(!check.broken());
  CHECK(!check.is_free(a, b));
  CHECK(check.broken());
  CHECK(check.broken_at() == vector({0.5}));
  CHECK(check.collides(check.posture(vector({0.6}))));
  CHECK(check.broken_at() == vector({0.5}));
}

TEST_CASE("a resolution below the rounding of ways ends", "[motion_check]") {
  // Near 20, floats are 1.9e-6 apart. The last 1e-4 m touch an obstacle.
  const auto touching = [](const VectorX<float>& q) {
    return q[0] < 19.9999f ? 19.9999f - q[0] : 0;
  };
  const VectorX<float> reach = VectorX<float>::Ones(1);
  MotionCheck<float, const decltype(touching)> check(touching, reach, 0.0f, 1e-9f);
  CHECK(check.is_free(check.posture(VectorX<float>::Constant(1, 0.0f)),
                      check.posture(VectorX<float>::Constant(1, 20.0f))));
}

TEST_CASE("a joint that moves nothing and a robot without joints are free where their ends are",
          "[motion_check]") {
  const auto open = [](const VectorX<double>&) { return 1.0; };
  CHECK(free_between(open, VectorX<double>(), VectorX<double>()));
  const VectorX<double> reach = VectorX<double>::Zero(1);
  MotionCheck<double, const decltype(open)> check(open, reach, 1e-3, 1e-3);
  CHECK(check.is_free(check.posture(vector({0})), check.posture(vector({5}))));
}
