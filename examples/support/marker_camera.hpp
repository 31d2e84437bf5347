#pragma once

// A simulated camera that sees a few markers on a sheet, late and with noise.

#include <cstddef>
#include <cstdint>
#include <deque>
#include <utility>

#include "clothctl/estimate/marker_measurement.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/prediction/features.hpp"
#include "support/random_number.hpp"

namespace program {

/// Returns markers at vertices that are spread evenly over a grid, `side` along each side.
inline clothctl::PointFeatures<double> spread_markers(const clothctl::GridMesh<double>& grid,
                                                      int side) {
  clothctl::PointFeatures<double> markers;
  for (int row = 0; row < side; ++row) {
    for (int col = 0; col < side; ++col)
      markers.add_point(
          grid.vertex(row * (grid.rows - 1) / (side - 1), col * (grid.cols - 1) / (side - 1)));
  }
  return markers;
}

/// Takes a picture in each frame, which arrives `delay` frames later.
class MarkerCamera {
 public:
  /// `noise`: standard deviation of a coordinate, m.
  MarkerCamera(clothctl::PointFeatures<double> markers, double noise, long delay,
               std::uint64_t seed)
      : markers_(std::move(markers)), noise_(noise), delay_(delay), random_(seed) {}

  /// Takes a picture of a sheet at `x` (3×n, m) at the start of a frame. Returns whether a picture
  /// has arrived in `picture`.
  bool look(clothctl::Index frame, const clothctl::Points<double>& x,
            clothctl::MarkerMeasurement<double>& picture) {
    clothctl::MarkerMeasurement<double> taken;
    taken.frame = frame;
    taken.positions.resize(3, markers_.count());
    clothctl::evaluate_features<double>(markers_, x, taken.positions);
    for (clothctl::Index i = 0; noise_ > 0 && i < taken.positions.size(); ++i)
      taken.positions.data()[i] += noise_ * random_();
    taken.see_finite();
    waiting_.push_back(std::move(taken));
    if (static_cast<long>(waiting_.size()) <= delay_) return false;
    picture = waiting_.front();
    waiting_.pop_front();
    return true;
  }

 private:
  clothctl::PointFeatures<double> markers_;
  double noise_;
  long delay_;
  Normal random_;
  std::deque<clothctl::MarkerMeasurement<double>> waiting_;
};

}  // namespace program
