#pragma once

// Random numbers of programs: the same on every machine, which distributions of <random> are not.

#include <cmath>
#include <cstdint>
#include <random>

namespace program {

/// Returns a random number from -most to most.
inline double random_number(std::mt19937_64& random, double most = 1) {
  return most * (static_cast<double>(random() >> 11) / 4503599627370496.0 - 1);
}

/// Normally distributed numbers; a seed gives the same ones on every platform.
class Normal {
 public:
  explicit Normal(std::uint64_t seed) : engine_(seed) {}
  double operator()() {
    const double u = (static_cast<double>(engine_() >> 11) + 0.5) / 9007199254740992.0;
    const double v = (static_cast<double>(engine_() >> 11) + 0.5) / 9007199254740992.0;
    return std::sqrt(-2 * std::log(u)) * std::cos(2 * 3.14159265358979323846 * v);
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace program
