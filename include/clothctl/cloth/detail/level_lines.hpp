#pragma once

// The rows, or the columns, that a coarse level of a grid keeps, and how those of the next finer
// level lie between them.

#include <algorithm>
#include <cstddef>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Which fine rows (or columns) a level has, and between which of the next coarser level they lie.
struct LevelLines {
  /// The fine line of each line of the level.
  std::vector<int> fine;

  /// The lines 0, s, 2 s, … and count-1. Allocates.
  /// With `shift`, the lines 0, shift, shift + s, … and count-1.
  LevelLines(int count, int spacing, int shift = 0) {
    if (shift > 0) fine.push_back(0);
    for (int at = shift; at < count - 1; at += spacing) fine.push_back(at);
    fine.push_back(count - 1);
  }
  int count() const { return static_cast<int>(fine.size()); }
  /// The line nearest to a fine line; the smaller one of two.
  int nearest(int line) const {
    const auto above = std::lower_bound(fine.begin(), fine.end(), line);
    if (above == fine.begin()) return 0;
    const auto below = above - 1;
    const bool take_below = above == fine.end() || line - *below <= *above - line;
    return static_cast<int>((take_below ? below : above) - fine.begin());
  }
};

/// Where a line lies among those of the next coarser level: between `first` and first + 1, with the
/// weight `second` of the latter.
template <RealScalar Scalar>
struct LineParents {
  int first = 0;
  Scalar second = Scalar(0);

  LineParents(const LevelLines& fine, const LevelLines& coarse, int line) {
    const int at = fine.fine[static_cast<std::size_t>(line)];
    const auto above = std::upper_bound(coarse.fine.begin(), coarse.fine.end(), at);
    first = static_cast<int>(above - coarse.fine.begin()) - 1;
    if (above == coarse.fine.end()) {
      // The last line: its weight is on the second parent if there is one.
      first = coarse.count() - 1;
      return;
    }
    const double from = static_cast<double>(coarse.fine[static_cast<std::size_t>(first)]);
    second = Scalar((static_cast<double>(at) - from) / (static_cast<double>(*above) - from));
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
