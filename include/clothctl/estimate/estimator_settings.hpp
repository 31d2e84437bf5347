#pragma once

// Settings of a StateEstimator: how far measurements and model are off, and how late they are.

#include <array>
#include <string>
#include <utility>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a StateEstimator. Only the ratio acceleration / noise decides how much a measurement
/// changes; both together decide what is an outlier.
template <RealScalar Scalar>
struct EstimatorSettings {
  /// Length of a frame, s.
  Scalar dt = Scalar(0.02);
  /// Standard deviation of a measured coordinate, m.
  Scalar noise = Scalar(0.002);
  /// Standard deviation of the acceleration that the model lacks, in each coordinate, m/s²: new in
  /// each frame, and the same for vertices that are close to each other. Larger values follow the
  /// measurements faster and let more of their noise through.
  Scalar acceleration = Scalar(0.02);
  /// Length over which that acceleration is correlated, as a distance in the undeformed sheet, m.
  /// About the largest distance of neighbouring markers.
  Scalar correlation = Scalar(0.5);
  /// Frames from one measurement to the next.
  Index interval = 1;
  /// A marker that is further off than this many standard deviations of what is expected of a
  /// coordinate is an outlier, unless most of the markers are: then the estimate is wrong.
  Scalar gate = Scalar(12);
  /// An outlier is left out of this many measurements in a row; after that, it is used as if it
  /// were just within the gate.
  int patience = 3;
  /// Frames that are kept: the oldest measurement that can be used is this many frames older than
  /// the estimate.
  Index history = 8;
  /// Frames from the sending of an input to the frame that it acts in. The estimate is that many
  /// frames ahead of the clock: at the start of the frame in which the next input acts.
  Index latency = 0;
  /// Largest number of Newton steps in a new frame, for models that satisfy ClothRollout. 0 takes
  /// the model's own step.
  int first_newton_steps = 8;
  /// The same in a frame that is stepped again after a correction, from the velocities found
  /// before.
  int newton_steps = 1;
  /// A Newton step that changes no velocity by more than this is the last of its frame, m/s.
  Scalar step_tolerance = Scalar(0.001);

  /// Returns an empty string, or a line that names the first bad setting and its value.
  std::string validate() const {
    const std::array<std::pair<const char*, const Scalar*>, 5> positive{
        {{"dt", &dt},
         {"noise", &noise},
         {"acceleration", &acceleration},
         {"correlation", &correlation},
         {"gate", &gate}}};
    for (const auto& [name, value] : positive) {
      if (!is_finite(*value) || !(Scalar(0) < *value))
        return std::string(name) + " is " + number_text(*value) + ", must be positive and finite";
    }
    if (!is_finite(step_tolerance) || step_tolerance < Scalar(0))
      return "step_tolerance is " + number_text(step_tolerance) +
             ", must be finite and not negative";
    const std::array<std::pair<const char*, std::pair<Index, Index>>, 6> counts{
        {{"interval", {interval, 1}},
         {"history", {history, 1}},
         {"latency", {latency, 0}},
         {"patience", {static_cast<Index>(patience), 0}},
         {"first_newton_steps", {static_cast<Index>(first_newton_steps), 0}},
         {"newton_steps", {static_cast<Index>(newton_steps), 0}}}};
    for (const auto& [name, value] : counts) {
      if (value.first < value.second)
        return std::string(name) + " is " + std::to_string(value.first) + ", must be at least " +
               std::to_string(value.second);
    }
    if (history < latency)
      return "history is " + std::to_string(history) + ", must be at least the latency of " +
             std::to_string(latency);
    return {};
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI
