#include "support/reach_curves.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "support/random_number.hpp"

namespace program {

namespace {

/// What a seed draws.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : random_(seed * 2654435761u + 777u) {}
  /// A number from `least` to `most`, evenly.
  double between(double least, double most) {
    return least + (most - least) * (0.5 + 0.5 * random_number(random_));
  }
  /// The same, evenly in the logarithm.
  double decades(double least, double most) {
    return std::exp(between(std::log(least), std::log(most)));
  }
  /// A direction.
  Vec direction() {
    for (;;) {
      const double x = between(-1, 1), y = between(-1, 1), z = between(-1, 1);
      const Vec v(x, y, z);
      if (0.1 < v.norm() && v.norm() <= 1) return v.normalized();
    }
  }

 private:
  std::mt19937_64 random_;
};

/// Samples `place(corner, t)` at all frames and returns the curves.
template <class Place>
Task sampled_task(double duration, const Place& place) {
  const clothctl::VectorX<double> times = frame_times(duration);
  Points paths[2] = {Points(3, times.size()), Points(3, times.size())};
  for (Index i = 0; i < times.size(); ++i) {
    for (std::size_t c = 0; c < 2; ++c) paths[c].col(i) = place(c, times[i]);
  }
  return curves_task(times, paths[0], paths[1]);
}

/// Random lines in which `speed` times as much happens.
Task fast_task(std::uint64_t seed, double duration, double sd, double speed, const ReachStart& s) {
  const Task slow = make_random_task(seed, sd, duration * speed, s.size, s.left, s.right);
  return sampled_task(duration,
                      [&](std::size_t c, double t) { return slow.curves[c].position(t * speed); });
}

/// Random lines whose distance becomes `factor` times the size of the sheet.
Task apart_task(std::uint64_t seed, double duration, double factor, const ReachStart& s) {
  const Task close = make_random_task(seed, 0.02 * s.size, duration, s.size, s.left, s.right);
  return sampled_task(duration, [&](std::size_t c, double t) {
    const Vec a = close.curves[0].position(t), b = close.curves[1].position(t);
    const double grown = 1 + (factor * s.size / (b - a).norm() - 1) * ramp(t / 1.5);
    const Vec middle = (a + b) / 2, half = (b - a) / 2;
    return Vec(middle + (c == 0 ? -grown : grown) * half);
  });
}

/// Both corners move along `way` after 0.6 s, in `time`, and back again 1 s later.
Task jump_task(double duration, const Vec& way, double time, const ReachStart& s) {
  return sampled_task(duration, [&](std::size_t c, double t) {
    const double there = ramp((t - 0.6) / time) - ramp((t - 1.6 - time) / time);
    return Vec((c == 0 ? s.left : s.right) + there * way);
  });
}

/// Both corners sway, the second one a quarter of a radian later.
Task sway_task(double duration, const Vec& way, double rate, const ReachStart& s) {
  return sampled_task(duration, [&](std::size_t c, double t) {
    const double phase = rate * t - (c == 0 ? 0.0 : 0.25);
    return Vec((c == 0 ? s.left : s.right) + ramp(t) * std::sin(phase) * way);
  });
}

}  // namespace

const std::vector<std::string>& reach_kinds() {
  static const std::vector<std::string> kinds{"known", "random", "fast", "apart",
                                              "jump",  "sway",   "drop", "calm"};
  return kinds;
}

Task make_reach_curve(std::uint64_t seed, double duration, const ReachStart& s, std::string& kind) {
  kind = reach_kinds()[static_cast<std::size_t>((seed - 1) % reach_kinds().size())];
  Dice dice(seed);
  const double size = s.size;
  if (kind == "known")
    return s.follow(make_hand_paths(seed, size * dice.decades(0.02, 0.15), duration, size,
                                    s.hands[0], s.hands[1]));
  if (kind == "random")
    return make_random_task(seed, size * dice.decades(0.02, 0.25), duration, size, s.left, s.right);
  if (kind == "fast") return fast_task(seed, duration, 0.06 * size, dice.decades(1, 4), s);
  if (kind == "apart") return apart_task(seed, duration, dice.between(0.9, 1.3), s);
  if (kind == "jump") {
    const Vec way = size * dice.decades(0.05, 0.8) * dice.direction();
    return jump_task(duration, way, dice.decades(0.06, 0.4), s);
  }
  if (kind == "sway") {
    const Vec way = size * dice.decades(0.02, 0.3) * dice.direction();
    return sway_task(duration, way, dice.decades(2, 12), s);
  }
  if (kind == "drop") {
    const Vec way(0, 0, -size * dice.decades(0.1, 1.0));
    return jump_task(duration, way, dice.decades(0.15, 1.0), s);
  }
  const double scale = dice.between(0.2, 1);
  const Task whole = make_random_task(seed, 0.06 * size, duration, size, s.left, s.right);
  return sampled_task(duration, [&](std::size_t c, double t) {
    const Vec from = c == 0 ? s.left : s.right;
    return Vec(from + scale * (whole.curves[c].position(t) - from));
  });
}

}  // namespace program
