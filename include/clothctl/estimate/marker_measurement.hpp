#pragma once

// What a camera or another tracker saw of a sheet: the places of its markers at the start of a
// frame, some of them hidden.

#include <string>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The measured places of markers at the start of a frame.
template <RealScalar Scalar>
struct MarkerMeasurement {
  /// The frame at whose start the markers were there: 0 is the start of the run.
  Index frame = 0;
  /// The places, 3×markers, m, world frame. Those of hidden markers are not read.
  Points<Scalar> positions;
  /// For each marker: 1 when it was seen, 0 when it was hidden.
  std::vector<unsigned char> seen;

  /// Makes room for a number of markers, all hidden. Allocates.
  void reserve(Index markers) {
    positions.setZero(3, markers);
    seen.assign(static_cast<std::size_t>(markers), 0);
  }

  /// Sets which markers were seen: those whose coordinates are finite, for trackers that write NaN
  /// for a lost marker. Returns how many were seen. Never allocates after `reserve`.
  Index see_finite() {
    seen.resize(static_cast<std::size_t>(positions.cols()));
    Index count = 0;
    for (Index i = 0; i < positions.cols(); ++i) {
      const bool whole = all_finite(positions.col(i));
      seen[static_cast<std::size_t>(i)] = whole ? 1 : 0;
      if (whole) ++count;
    }
    return count;
  }

  /// Returns an empty string, or a line that says why this is no measurement of `markers` markers:
  /// another number of them, or a marker that is seen at a place that is not finite. Allocates.
  std::string validate(Index markers) const {
    if (positions.cols() != markers || static_cast<Index>(seen.size()) != markers)
      return "there are " + std::to_string(positions.cols()) + " positions and " +
             std::to_string(seen.size()) + " flags for " + std::to_string(markers) + " markers";
    for (Index i = 0; i < markers; ++i) {
      if (!is_seen(i)) continue;
      for (Index c = 0; c < 3; ++c) {
        if (!is_finite(positions(c, i)))
          return "marker " + std::to_string(i) + " is seen, but its " + "xyz"[c] + " is " +
                 number_text(positions(c, i));
      }
    }
    return {};
  }

  /// Returns whether marker i was seen.
  bool is_seen(Index i) const { return seen[static_cast<std::size_t>(i)] != 0; }
};

}  // namespace clothctl::inline CLOTHCTL_ABI
