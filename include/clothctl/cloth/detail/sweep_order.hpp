#pragma once

// The direction of a Gauss-Seidel sweep.
//
// A sweep applies the corrections of its constraints one after the other. Linearised, it is a
// matrix that is not symmetric, unless another sweep follows the other way round. Sweeps in one
// direction put energy into sheets that are numbered row by row: pinned at two corners and damped,
// 32×32 vertices never rest, but go on at 0.1 m/s with 80 substeps of two sweeps forward.

#include <cstddef>

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The direction of a sweep: as the constraints are stored, or back (edges in lanes: back within
/// each row).
enum class SweepOrder { Forward, Backward };

/// Returns the direction of sweep i of `count`, from 0: the last one runs forward, the one before
/// it back, and so on.
constexpr SweepOrder alternating(int i, int count) {
  return (count - i) % 2 == 1 ? SweepOrder::Forward : SweepOrder::Backward;
}

/// The places begin, begin + step, … below `end` in a direction. `end - begin` is a multiple of
/// `step`.
class SweepPlaces {
 public:
  constexpr SweepPlaces(SweepOrder order, std::size_t begin, std::size_t end, std::size_t step = 1)
      : first_(order == SweepOrder::Forward ? begin : end - step),
        stride_(order == SweepOrder::Forward ? step : std::size_t{0} - step),
        count_((end - begin) / step) {}

  constexpr std::size_t count() const { return count_; }
  /// Place i of the sweep, from 0. Adding a negative stride wraps around.
  constexpr std::size_t operator[](std::size_t i) const { return first_ + i * stride_; }

 private:
  std::size_t first_, stride_, count_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
