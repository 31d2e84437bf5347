#pragma once

// Random numbers of programs: the same on every machine, which distributions of <random> are not.

#include <random>

namespace program {

/// Returns a random number from -most to most.
inline double random_number(std::mt19937_64& random, double most = 1) {
  return most * (static_cast<double>(random() >> 11) / 4503599627370496.0 - 1);
}

}  // namespace program
