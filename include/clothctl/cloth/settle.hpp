#pragma once

// Lets a sheet come to rest by its drag while some of its vertices are held. Start planning from
// such a state: while a sheet still falls into its folds, the predictions of the first windows are
// wrong.

#include <cmath>
#include <vector>

#include "clothctl/concepts/cloth.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The outcome of settling.
template <RealScalar Scalar>
struct SettleReport {
  /// Status of the last step; InvalidInput when an argument was refused and no step was taken.
  StepStatus status = StepStatus::InvalidInput;
  /// True when every step advanced.
  bool advanced = false;
  /// Speed of the fastest vertex at the end, m/s.
  Scalar speed = Scalar(0);
};

/// Holds the vertices `held` of `plant` in place and lets the others move freely, in frames of `dt`
/// (s). It stops when every vertex was slower than `rest_speed` (m/s) for ten frames in a row, at
/// the latest after the number of frames nearest to `seconds`/`dt`, but takes at least one frame.
/// With a `rest_speed` of 0 it takes all frames. Give the plant strong drag meanwhile (about 3/s
/// for a sheet of half a metre); with its usual damping, settling takes much longer. Afterwards the
/// plant still holds `held`. Allocates.
///
/// Fails when: `dt` or `seconds` is not positive, `rest_speed` is negative, one of them is not
/// finite, there would be 10⁹ frames or more, or a vertex is off the mesh (InvalidInput, and the
/// plant is unchanged); a step of the plant fails; a velocity is not finite (NumericalFailure).
template <class Plant, RealScalar Scalar>
requires ClothPlant<Plant, Scalar>
[[nodiscard]] SettleReport<Scalar> settle(Plant& plant, const std::vector<int>& held, Scalar dt,
                                          Scalar seconds, Scalar rest_speed = Scalar(0)) {
  using std::floor;
  using std::sqrt;
  using Traits = plant_traits<Plant>;
  const Scalar zero = Scalar(0);
  SettleReport<Scalar> report;
  if (!is_finite(dt) || !is_finite(seconds) || !is_finite(rest_speed)) return report;
  if (!(zero < dt) || !(zero < seconds) || rest_speed < zero) return report;
  Scalar frames = floor(seconds / dt + Scalar(0.5));
  if (frames < Scalar(1)) frames = Scalar(1);
  if (!(frames < Scalar(1e9))) return report;
  for (int v : held) {
    if (v < 0 || v >= static_cast<Index>(Traits::vertex_count(plant))) return report;
  }
  ClothInput<Scalar> input;
  input.clear();
  input.driven_vertices = held;
  const auto take = [&](const PointsView<Scalar>& x) {
    input.driven_positions.resize(3, static_cast<Index>(held.size()));
    for (std::size_t i = 0; i < held.size(); ++i)
      input.driven_positions.col(static_cast<Index>(i)) = x.col(held[i]);
  };
  const auto fastest = [](const PointsView<Scalar>& v) {  // maxCoeff may miss a NaN
    Scalar most = Scalar(0);
    for (Index i = 0; i < v.cols(); ++i) {
      const Scalar square = v.col(i).squaredNorm();
      if (!(square <= most)) most = square;
      if (!is_finite(square)) break;
    }
    return Scalar(sqrt(most));
  };
  take(Traits::positions(plant));
  Traits::apply(plant, input);
  Index slow_frames = 0;
  for (Scalar left = frames; Scalar(0.5) < left && slow_frames < 10; left -= Scalar(1)) {
    const StepReport<Scalar> step = Traits::advance(plant, dt);
    report.status = step.status;
    report.advanced = step.advanced;
    if (!step.advanced) break;
    report.speed = fastest(Traits::velocities(plant));
    if (!is_finite(report.speed)) {
      report.status = StepStatus::NumericalFailure;
      report.advanced = false;
      break;
    }
    slow_frames = report.speed < rest_speed ? slow_frames + 1 : 0;
  }
  return report;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
