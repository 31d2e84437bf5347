#pragma once

// The longest extent of some points: where to cut them into halves.

#include <span>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Returns the coordinate axis (0, 1 or 2) along which the points (3×n, m) of `vertices` spread
/// farthest; of equal ones the first. 0 for no vertices. Complexity: O(vertices).
template <class Positions>
int longest_axis(const Positions& points, std::span<const int> vertices) {
  using Scalar = typename Positions::Scalar;
  int longest = 0;
  Scalar most = Scalar(0);
  for (int axis = 0; axis < 3 && !vertices.empty(); ++axis) {
    Scalar low = points(axis, vertices.front()), high = low;
    for (const int v : vertices) {
      const Scalar x = points(axis, v);
      if (x < low) low = x;
      if (high < x) high = x;
    }
    if (most < high - low) {
      most = high - low;
      longest = axis;
    }
  }
  return longest;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
