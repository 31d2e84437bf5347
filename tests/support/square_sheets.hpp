#pragma once

// Square sheets of the tests of the step, and random motions that are the same with every standard
// library.

#include <random>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"

namespace clothctl_test {

/// A sheet of n×n vertices and 0.3 m, of the default material.
template <class S>
clothctl::SpringNetwork<S> square_sheet(int n) {
  const auto grid = clothctl::make_grid<S>(n, n, S(0.3), S(0.3)).value();
  return clothctl::sheet_network<S>(grid, clothctl::Material<S>()).value();
}

/// 3×n numbers between -size and size.
template <class S>
clothctl::Points<S> noise(unsigned seed, clothctl::Index n, double size) {
  std::mt19937 random(seed);
  return clothctl::Points<S>::NullaryExpr(3, n, [&] {
    return static_cast<S>(size * (static_cast<double>(random()) / 2147483648.0 - 1.0));
  });
}

}  // namespace clothctl_test
