#pragma once

// What the pass that keeps layers of sheets apart (sheet_impacts.hpp) is given, and what it
// reports.

#include <array>
#include <string>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/status.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How layers of sheets act on each other.
template <RealScalar Scalar>
struct SheetImpactSettings {
  /// The distance of the middles of two layers that rest on each other, m.
  Scalar thickness = Scalar(1e-3);
  /// Coulomb's coefficient of friction between layers.
  Scalar friction = Scalar(0.3);
  /// The speed at which layers that are too close are pushed apart, m/s.
  Scalar push_speed = Scalar(0.1);
  /// The speed at which layers that cross each other are pulled apart, m/s.
  Scalar untangle_speed = Scalar(0.5);
  /// Sweeps over the pairs of layers.
  int sweeps = 20;
  /// Searches for impacts, before zones are made rigid.
  int rounds = 12;
  /// Pairs of vertices that count as one where features are tested for a common vertex: seams,
  /// layers that are stitched together.
  std::vector<std::array<int, 2>> joined = {};

  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    if (!is_finite(thickness) || !(Scalar(0) < thickness))
      return "the thickness " + number_text(thickness) + " m, must be finite and positive";
    if (!is_finite(friction) || friction < Scalar(0))
      return "the friction " + number_text(friction) + ", must be finite and not negative";
    if (!is_finite(push_speed) || push_speed < Scalar(0))
      return "the push speed " + number_text(push_speed) + " m/s, must be finite and not negative";
    if (!is_finite(untangle_speed) || untangle_speed < Scalar(0))
      return "the untangle speed " + number_text(untangle_speed) +
             " m/s, must be finite and not negative";
    if (sweeps < 1) return "sweeps " + std::to_string(sweeps) + ", must be at least 1";
    if (rounds < 1) return "rounds " + std::to_string(rounds) + ", must be at least 1";
    return {};
  }
};

/// What the pass did.
struct SheetImpactReport {
  /// Converged: nothing passed. IterationLimit: edges cross triangles at the end, or there was not
  /// room for all pairs (`complete`). InvalidInput: a mass or the time is wrong; InvalidState: a
  /// coordinate is not finite or sizes differ. In both cases nothing changed.
  StepStatus status = StepStatus::Converged;
  /// Pairs of layers that were held apart.
  int contacts = 0;
  /// Impacts that were found in all searches.
  int impacts = 0;
  /// Searches for impacts.
  int rounds = 0;
  /// Sets of vertices that were moved rigidly.
  int zones = 0;
  /// Edges that cross a triangle before the step.
  int crossings_before = 0;
  /// Edges that cross a triangle after it.
  int crossings_left = 0;
  /// False when there was not room for all pairs: `reserve` more. Layers may have crossed.
  bool complete = true;
};

/// A point of a sheet that an obstacle holds up: the pass does not push it through.
template <RealScalar Scalar>
struct SheetSupport {
  /// The vertices that carry the point, and their weights; unused entries are -1 and come last.
  std::array<int, 3> vertex{-1, -1, -1};
  /// The weights.
  Vector3<Scalar> weight = Vector3<Scalar>::Constant(Scalar(0));
  /// Outward unit normal of the obstacle.
  Vector3<Scalar> normal = Vector3<Scalar>::Constant(Scalar(0));
  /// n·x of a point x that touches, at the end of the step, m. A point that is below it may stay
  /// where it is.
  Scalar level = Scalar(0);
  /// After the pass: the impulse on the sheet, N s. The obstacle received the opposite.
  Vector3<Scalar> impulse = Vector3<Scalar>::Constant(Scalar(0));
};

}  // namespace clothctl::inline CLOTHCTL_ABI
