#pragma once

// Vertices of a sheet that something else carries through a step.

#include "clothctl/cloth/detail/reserved_list.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Vertices that something outside of a sheet carries in a step, as a fingertip does, and the
/// impulses that it takes to carry them. The step takes them as held.
template <RealScalar Scalar>
struct CarriedVertices {
  /// The vertices; no vertex twice, and none that is driven or pinned.
  detail::ReservedList<int> vertices;
  /// Column i: the velocity of vertex i, m/s, constant over the step; 3×n.
  Points<Scalar> velocities;
  /// Column i: the impulse that vertex i gave to the rest of the sheet in the last step, N s; 3×n.
  /// The vertex' own weight and inertia are not in it.
  Points<Scalar> impulses;
  /// The sum of the magnitudes of such impulses over all held vertices, N s.
  Scalar total = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI
