// KeyframePath: keys, smoothness, known curves, ranges and speeds of monotone paths, refused input.

#include "clothctl/grasp/keyframe_path.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using clothctl::Index;
using clothctl::Keyframe;
using clothctl::KeyframePath;
using clothctl::KeyframeTangents;
using clothctl::time_keyframes;
using clothctl::VectorX;

namespace {

template <class Scalar>
using Keys = std::vector<Keyframe<Scalar>>;

/// Keys of random positions in [-1, 1] at uneven times from -0.7 on. Every fifth position repeats
/// the one before.
template <class Scalar>
Keys<Scalar> random_keys(int count, Index joints, unsigned seed) {
  std::mt19937 engine(seed);
  std::uniform_real_distribution<double> place(-1, 1), duration(0.05, 1);
  Keys<Scalar> keys(static_cast<std::size_t>(count));
  double t = -0.7;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    keys[i].time = static_cast<Scalar>(t);
    t += duration(engine);
    keys[i].positions.resize(joints);
    for (Index j = 0; j < joints; ++j) {
      keys[i].positions[j] = static_cast<Scalar>(place(engine));
      if (i > 0 && engine() % 5 == 0) keys[i].positions[j] = keys[i - 1].positions[j];
    }
  }
  return keys;
}

/// Keys of one joint at the times 0, 1, 2, ….
Keys<double> one_joint(const std::vector<double>& positions) {
  Keys<double> keys;
  for (const double p : positions)
    keys.push_back({static_cast<double>(keys.size()), VectorX<double>::Constant(1, p)});
  return keys;
}

template <class Scalar>
struct Sample {
  VectorX<Scalar> q, qd;
};

template <class Scalar>
Sample<Scalar> at(const KeyframePath<Scalar>& path, Scalar t) {
  Sample<Scalar> s{VectorX<Scalar>(path.size()), VectorX<Scalar>(path.size())};
  path.sample(t, s.q, s.qd);
  return s;
}

constexpr KeyframeTangents kBoth[] = {KeyframeTangents::CatmullRom, KeyframeTangents::Monotone};

/// Whether numbers below the normal ones are not flushed to zero, as -ffast-math does.
template <class Scalar>
bool keeps_tiny() {
  volatile Scalar tiny = std::numeric_limits<Scalar>::denorm_min();
  return tiny + tiny > 0;
}

}  // namespace

TEMPLATE_TEST_CASE("a path passes through its keys and rests outside of them", "[keyframe_path]",
                   float, double) {
  using Scalar = TestType;
  const Keys<Scalar> keys = random_keys<Scalar>(9, 3, 1);
  for (const KeyframeTangents kind : kBoth) {
    const auto path = KeyframePath<Scalar>::create(keys, kind);
    REQUIRE(path.has_value());
    CHECK(path->size() == 3);
    CHECK(path->keys().size() == 9);
    CHECK(path->begin_time() == keys.front().time);
    CHECK(path->end_time() == keys.back().time);
    for (const Keyframe<Scalar>& key : keys) CHECK(at(*path, key.time).q == key.positions);
    for (const Scalar t : {Scalar(-1e30), Scalar(-0.70001), keys.front().time,
                           std::numeric_limits<Scalar>::quiet_NaN()}) {
      CHECK(at(*path, t).q == keys.front().positions);
      CHECK(at(*path, t).qd.isZero(0));
    }
    for (const Scalar t : {keys.back().time, Scalar(keys.back().time + 1), Scalar(1e30)}) {
      CHECK(at(*path, t).q == keys.back().positions);
      CHECK(at(*path, t).qd.isZero(0));
    }
  }
}

TEST_CASE("a single key, and keys without joints, are paths", "[keyframe_path]") {
  const auto one = KeyframePath<double>::create({{2.0, VectorX<double>::Constant(4, 0.3)}});
  REQUIRE(one.has_value());
  for (const double t : {1.0, 2.0, 3.0}) {
    CHECK(at(*one, t).q == VectorX<double>::Constant(4, 0.3));
    CHECK(at(*one, t).qd.isZero(0));
  }
  const auto none = KeyframePath<double>::create({{0.0, VectorX<double>()}, {1.0, {}}});
  REQUIRE(none.has_value());
  CHECK(at(*none, 0.5).q.size() == 0);
}

TEST_CASE("positions and velocities are continuous", "[keyframe_path]") {
  const Keys<double> keys = random_keys<double>(30, 2, 2);
  for (const KeyframeTangents kind : kBoth) {
    const auto path = KeyframePath<double>::create(keys, kind);
    // Accelerations of these data are below 4e4, so the jumps fall in proportion to the step.
    for (const double step : {1e-5, 1e-7, 1e-9}) {
      for (const Keyframe<double>& key : keys) {
        const Sample<double> left = at(*path, key.time - step), right = at(*path, key.time + step);
        CHECK((right.q - left.q).norm() < 200 * step);
        CHECK((right.qd - left.qd).norm() < 8e4 * step + 1e-12);
      }
    }
  }
}

TEST_CASE("central differences converge to the velocity with order 2", "[keyframe_path]") {
  const Keys<double> keys = random_keys<double>(12, 2, 3);
  for (const KeyframeTangents kind : kBoth) {
    const auto path = KeyframePath<double>::create(keys, kind);
    double previous = 0;
    for (const double step : {4e-3, 2e-3, 1e-3}) {
      double error = 0;  // inside of segments: accelerations jump at keys
      for (std::size_t i = 0; i + 1 < keys.size(); ++i) {
        const double t = 0.5 * (keys[i].time + keys[i + 1].time) + 1e-3;
        const VectorX<double> slope = (at(*path, t + step).q - at(*path, t - step).q) / (2 * step);
        error = std::max(error, (slope - at(*path, t).qd).norm());
      }
      if (previous > 0) CHECK(std::log2(previous / error) == Approx(2).margin(0.01));
      previous = error;
    }
  }
}

TEST_CASE("both kinds of path approach a smooth motion through more and more keys",
          "[keyframe_path]") {
  for (const KeyframeTangents kind : kBoth) {
    double previous = 0;
    for (const int n : {20, 40, 80}) {
      Keys<double> keys;
      for (int i = 0; i <= n; ++i)
        keys.push_back({2.0 * i / n, VectorX<double>::Constant(1, std::exp(2.0 * i / n))});
      const auto path = KeyframePath<double>::create(keys, kind);
      double error = 0;  // not near the ends, which are at rest
      for (double t = 0.5; t < 1.5; t += 0.0017)
        error = std::max(error, std::abs(at(*path, t).q[0] - std::exp(t)));
      if (previous > 0) CHECK(std::log2(previous / error) > 2.7);
      previous = error;
    }
  }
}

TEST_CASE("at equal spacing Catmull-Rom is the textbook's formula", "[keyframe_path]") {
  const double h = 0.25;
  Keys<double> keys = random_keys<double>(8, 3, 4);
  for (std::size_t i = 0; i < keys.size(); ++i) keys[i].time = h * static_cast<double>(i);
  const auto path = KeyframePath<double>::create(keys, KeyframeTangents::CatmullRom);
  for (std::size_t i = 1; i + 2 < keys.size(); ++i) {
    const VectorX<double>&a = keys[i - 1].positions, &b = keys[i].positions,
          &c = keys[i + 1].positions, &d = keys[i + 2].positions;
    for (double s = 0; s < 1; s += 0.125) {
      const VectorX<double> q = 0.5 * (2 * b + (c - a) * s + (2 * a - 5 * b + 4 * c - d) * s * s +
                                       (3 * b - a - 3 * c + d) * s * s * s);
      const VectorX<double> qd =
          0.5 / h *
          ((c - a) + 2 * (2 * a - 5 * b + 4 * c - d) * s + 3 * (3 * b - a - 3 * c + d) * s * s);
      const Sample<double> found = at(*path, keys[i].time + s * h);
      CHECK((found.q - q).norm() < 1e-14);
      CHECK((found.qd - qd).norm() < 1e-13);
    }
  }
}

TEST_CASE("at uneven times a key's velocity is the slope between its neighbours",
          "[keyframe_path]") {
  const Keys<double> keys = random_keys<double>(10, 2, 5);
  const auto path = KeyframePath<double>::create(keys, KeyframeTangents::CatmullRom);
  for (std::size_t i = 1; i + 1 < keys.size(); ++i) {
    const VectorX<double> slope =
        (keys[i + 1].positions - keys[i - 1].positions) / (keys[i + 1].time - keys[i - 1].time);
    CHECK((at(*path, keys[i].time).qd - slope).norm() < 1e-13);
  }
}

TEST_CASE("through 0, 0, 1, 1 Catmull-Rom overshoots by 2/27 and Monotone does not",
          "[keyframe_path]") {
  for (const KeyframeTangents kind : kBoth) {
    const auto path = KeyframePath<double>::create(one_joint({0, 0, 1, 1}), kind);
    double low = 0, high = 0;
    for (int i = 0; i <= 3000; ++i) {
      const double q = at(*path, i * 1e-3).q[0];
      low = std::min(low, q);
      high = std::max(high, q);
    }
    const double beyond = kind == KeyframeTangents::CatmullRom ? 2.0 / 27 : 0;
    CHECK(low == Approx(-beyond).margin(1e-6));
    CHECK(high == Approx(1 + beyond).margin(1e-6));
    if (kind != KeyframeTangents::Monotone) continue;
    CHECK(low == 0);
    CHECK(high == 1);
  }
}

TEMPLATE_TEST_CASE("a monotone path never leaves the range of the two keys around, nor turns round",
                   "[keyframe_path]", float, double) {
  using Scalar = TestType;
  long outside = 0, backward = 0, fast = 0;
  for (unsigned seed = 0; seed < 1000; ++seed) {
    const Keys<Scalar> keys = random_keys<Scalar>(7, 2, seed);
    const auto path = KeyframePath<Scalar>::create(keys);
    for (std::size_t i = 0; i + 1 < keys.size(); ++i) {
      const Scalar h = keys[i + 1].time - keys[i].time;
      for (int k = 0; k < 40; ++k) {
        const Sample<Scalar> s = at(*path, keys[i].time + h * static_cast<Scalar>(k) / Scalar(40));
        for (Index j = 0; j < 2; ++j) {
          const Scalar a = keys[i].positions[j], b = keys[i + 1].positions[j], d = (b - a) / h;
          const Scalar rounding = 64 * std::numeric_limits<Scalar>::epsilon();
          if (s.q[j] < std::min(a, b) || std::max(a, b) < s.q[j]) ++outside;
          if (s.qd[j] * d < -rounding * d * d) ++backward;
          if (std::abs(s.qd[j]) > Scalar(1.5) * std::abs(d) * (1 + rounding)) ++fast;
        }
      }
    }
  }
  CHECK(outside == 0);
  CHECK(backward == 0);
  CHECK(fast == 0);
}

TEST_CASE("a monotone path does not stop at keys that it passes", "[keyframe_path]") {
  const auto path = KeyframePath<double>::create(one_joint({0, 1, 2, 3, 2}));
  CHECK(at(*path, 1.0).qd[0] == 1);
  CHECK(at(*path, 1.5).qd[0] == 1);
  CHECK(at(*path, 3.0).qd[0] == 0);  // turns round
  // A key between a slow and a fast segment: 3/2 of the slow one.
  const auto uneven = KeyframePath<double>::create(one_joint({0, 1, 11}));
  CHECK(at(*uneven, 1.0).qd[0] == 1.5);
}

TEMPLATE_TEST_CASE("no joint exceeds its velocity limit at the times that are given",
                   "[keyframe_path]", float, double) {
  using Scalar = TestType;
  const Scalar infinite = std::numeric_limits<Scalar>::infinity();
  for (unsigned seed = 0; seed < 200; ++seed) {
    std::vector<VectorX<Scalar>> positions;
    for (const Keyframe<Scalar>& key : random_keys<Scalar>(8, 3, seed))
      positions.push_back(key.positions);
    VectorX<Scalar> limits(3);
    limits << Scalar(0.5), Scalar(2), infinite;
    const Scalar start = static_cast<Scalar>(seed) - Scalar(100);
    const auto keys = time_keyframes<Scalar>(positions, limits, start);
    REQUIRE(keys.has_value());
    REQUIRE(keys->size() == 8);
    CHECK(keys->front().time == start);
    const auto path = KeyframePath<Scalar>::create(*keys);
    REQUIRE(path.has_value());
    Scalar fastest = 0;
    for (std::size_t i = 0; i < 8; ++i) CHECK((*keys)[i].positions == positions[i]);
    for (int k = 0; k <= 4000; ++k) {
      const Scalar share = static_cast<Scalar>(k) / Scalar(4000);
      const Sample<Scalar> s =
          at(*path, Scalar(start + share * (path->end_time() - path->begin_time())));
      fastest = std::max(fastest, std::max(std::abs(s.qd[0]) / limits[0], std::abs(s.qd[1]) / 2));
    }
    CHECK(fastest <= 1 + 4 * std::numeric_limits<Scalar>::epsilon());
    CHECK(fastest > Scalar(0.66));  // no slower than need be: the mean of the slowest joint
  }
}

TEST_CASE("a motion from rest to rest reaches the limit in its middle", "[keyframe_path]") {
  const auto keys =
      time_keyframes<double>({VectorX<double>::Constant(1, 0.2), VectorX<double>::Constant(1, 1.2)},
                             VectorX<double>::Constant(1, 2.0), 5.0);
  CHECK(keys->back().time == Approx(5.75));
  const auto path = KeyframePath<double>::create(*keys);
  CHECK(at(*path, 5.375).qd[0] == Approx(2));
}

TEST_CASE("segments without a duration of their own take a millisecond", "[keyframe_path]") {
  const double infinite = std::numeric_limits<double>::infinity();
  const VectorX<double> a = VectorX<double>::Constant(2, 0.1), b = VectorX<double>::Constant(2, 3);
  const auto equal = time_keyframes<double>({a, a, b, b}, VectorX<double>::Constant(2, 1.0), 0.0);
  REQUIRE(equal->size() == 4);
  CHECK((*equal)[1].time == Approx(1e-3));
  CHECK((*equal)[3].time - (*equal)[2].time == Approx(1e-3));
  CHECK(KeyframePath<double>::create(*equal).has_value());
  const auto free = time_keyframes<double>({a, b}, VectorX<double>::Constant(2, infinite), 0.0);
  CHECK(free->back().time == Approx(1e-3));
  // Even where a millisecond is less than the spacing of numbers.
  const auto late =
      time_keyframes<float>({VectorX<float>::Constant(1, 0.0f), VectorX<float>::Constant(1, 0.0f)},
                            VectorX<float>::Constant(1, 1.0f), 1e6f);
  REQUIRE(late.has_value());
  CHECK(late->front().time < late->back().time);
}

TEST_CASE("sampling does not allocate", "[keyframe_path]") {
  if (!clothctl_test::allocation_counting_works()) return;
  const auto path = KeyframePath<double>::create(random_keys<double>(50, 7, 6));
  VectorX<double> q(7), qd(7);
  double sum = 0;
  const long before = clothctl_test::allocations();
  for (double t = -2; t < 40; t += 0.01) {
    path->sample(t, q, qd);
    sum += q.sum() + qd.sum();
  }
  const long after = clothctl_test::allocations();
  CHECK(after == before);
  CHECK(clothctl::is_finite(sum));
}

TEMPLATE_TEST_CASE("bad keys are refused with key and value", "[keyframe_path]", float, double) {
  using Scalar = TestType;
  using Path = KeyframePath<Scalar>;
  const Scalar nan = std::numeric_limits<Scalar>::quiet_NaN();
  const Scalar infinite = std::numeric_limits<Scalar>::infinity();
  const Keys<Scalar> good = {{Scalar(0), VectorX<Scalar>::Constant(2, Scalar(1))},
                             {Scalar(0.5), VectorX<Scalar>::Constant(2, Scalar(2))},
                             {Scalar(1.5), VectorX<Scalar>::Constant(2, Scalar(1))}};
  REQUIRE(Path::create(good).has_value());
  const auto error = [&good](auto change) {
    Keys<Scalar> keys = good;
    change(keys);
    const auto path = Path::create(keys);
    return path.has_value() ? std::string("accepted") : path.error();
  };
  CHECK(Path::create({}).error() == "keys: expected at least 1, found 0");
  CHECK(error([&](auto& k) { k[2].time = Scalar(0.25); }) ==
        "key 2: time 0.25 does not come after 0.5");
  CHECK(error([&](auto& k) { k[1].time = Scalar(0); }) == "key 1: time 0 does not come after 0");
  CHECK(error([&](auto& k) { k[0].time = nan; }) == "key 0: time is nan, expected a finite number");
  CHECK(error([&](auto& k) { k[2].time = infinite; }) ==
        "key 2: time is inf, expected a finite number");
  CHECK(error([&](auto& k) { k[1].positions.resize(3); }) ==
        "key 1: expected 2 positions as in key 0, found 3");
  CHECK(error([&](auto& k) { k[2].positions[1] = nan; }) ==
        "key 2: position 1 is nan, expected a finite number");
  const Scalar tiny = std::numeric_limits<Scalar>::denorm_min();
  if (!keeps_tiny<Scalar>()) return;
  CHECK(error([&](auto& k) { k[1].time = tiny; }) ==
        "key 1: time " + clothctl::number_text(tiny) +
            " is too close to the key before for its positions");
}

TEMPLATE_TEST_CASE("bad input of time_keyframes is refused", "[keyframe_path]", float, double) {
  using Scalar = TestType;
  const Scalar nan = std::numeric_limits<Scalar>::quiet_NaN();
  const Scalar infinite = std::numeric_limits<Scalar>::infinity();
  using Places = std::vector<VectorX<Scalar>>;
  const Places places(3, VectorX<Scalar>::Constant(2, Scalar(1)));
  VectorX<Scalar> limits = VectorX<Scalar>::Constant(2, Scalar(1));
  const auto error = [](const Places& p, const VectorX<Scalar>& v, Scalar start) {
    const auto keys = time_keyframes(p, v, start);
    return keys.has_value() ? std::string("accepted") : keys.error();
  };
  CHECK(error(places, limits, Scalar(0)) == "accepted");
  CHECK(error({}, limits, Scalar(0)) == "keys: expected at least 1, found 0");
  CHECK(error(places, limits, nan) == "key 0: time is nan, expected a finite number");
  CHECK(error(places, limits.head(1), Scalar(0)) ==
        "velocity limits: expected 2 as positions in key 0, found 1");
  for (const Scalar bad : {Scalar(0), Scalar(-1), nan, Scalar(-infinite)}) {
    limits[1] = bad;
    CHECK(error(places, limits, Scalar(0)) == "joint 1: velocity limit is " +
                                                  clothctl::number_text(bad) +
                                                  ", expected a positive number");
  }
  limits[1] = Scalar(1);
  Places other = places;
  other[2].resize(1);
  CHECK(error(other, limits, Scalar(0)) == "key 2: expected 2 positions as in key 0, found 1");
  other = places;
  other[1].resize(0);  // the key after it has all
  CHECK(error(other, limits, Scalar(0)) == "key 1: expected 2 positions as in key 0, found 0");
  other = places;
  other[1][0] = infinite;
  CHECK(error(other, limits, Scalar(0)) == "key 1: position 0 is inf, expected a finite number");
  other[1][0] = Scalar(2);
  limits[0] = std::numeric_limits<Scalar>::denorm_min();
  if (keeps_tiny<Scalar>())
    CHECK(error(other, limits, Scalar(0)) == "key 1: time is inf, expected a finite number");
}

TEST_CASE("a path that stands still at its keys is straight between them", "[grasp]") {
  using Path = KeyframePath<double>;
  std::vector<Keyframe<double>> keys(4);
  for (int i = 0; i < 4; ++i) {
    auto& key = keys[static_cast<std::size_t>(i)];
    key.time = i * i;
    key.positions = Eigen::Vector3d(std::sin(3.0 * i), 0.5 * i, i == 2 ? 4 : -1);
  }
  const Path path = Path::create(keys, KeyframeTangents::Standstill).value();
  VectorX<double> q(3), qd(3);
  for (std::size_t i = 0; i + 1 < keys.size(); ++i) {
    const VectorX<double> way = keys[i + 1].positions - keys[i].positions;
    for (double s = 0; s <= 1; s += 0.0625) {
      path.sample(keys[i].time + s * (keys[i + 1].time - keys[i].time), q, qd);
      const VectorX<double> gone = q - keys[i].positions;
      CHECK((gone - gone.dot(way) / way.squaredNorm() * way).norm() < 1e-14);
      if (s == 0) CHECK(qd.norm() == 0);
    }
  }
}
