#pragma once

// The longest extent of some points: where to cut them into halves.

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

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

/// Sorts the entries begin to end of `order` into two halves along the longest axis of their
/// `centres` (3×n, m; of equal ones the smaller entry first) and returns where the second begins.
/// Complexity: O(end - begin).
template <class Positions>
int split_along_longest_axis(const Positions& centres, std::vector<int>& order, int begin,
                             int end) {
  using Scalar = typename Positions::Scalar;
  const std::span<const int> range(order.data() + begin, static_cast<std::size_t>(end - begin));
  const int axis = longest_axis(centres, range), middle = begin + (end - begin) / 2;
  std::nth_element(order.begin() + begin, order.begin() + middle, order.begin() + end,
                   [&centres, axis](int p, int q) {
                     const Scalar a = centres(axis, p), b = centres(axis, q);
                     return a < b || (!(b < a) && p < q);
                   });
  return middle;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
