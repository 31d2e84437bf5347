#pragma once

// What every model checks before it moves anything, and the mask of vertices whose motion is prescribed.

#include <vector>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/status.hpp"

namespace clothctl {

/// Checks state, input and step length of a sheet of `vertex_count` vertices and marks the driven ones in `held`
/// (n flags, resized by the caller beforehand; set to 1 for driven, 0 otherwise).
///
/// Returns Converged when all is well, InvalidInput or InvalidState otherwise. Never allocates. Complexity: O(n).
template <RealScalar Scalar>
[[nodiscard]] StepStatus check_step(const ClothState<Scalar>& state, const ClothInput<Scalar>& input, const Scalar& dt,
                                    Index vertex_count, std::vector<unsigned char>& held) {
  if (state.positions.cols() != vertex_count || state.velocities.cols() != vertex_count) return StepStatus::InvalidState;
  if (!is_finite(dt) || !(Scalar(0) < dt)) return StepStatus::InvalidInput;
  const Index forces = static_cast<Index>(input.force_vertices.size());
  const Index driven = static_cast<Index>(input.driven_vertices.size());
  if (input.forces.cols() != forces || input.driven_positions.cols() != driven) return StepStatus::InvalidInput;
  for (int vertex : input.force_vertices) {
    if (vertex < 0 || vertex >= vertex_count) return StepStatus::InvalidInput;
  }
  if (!all_finite(input.forces) || !all_finite(input.driven_positions) || !all_finite(input.wind))
    return StepStatus::InvalidInput;
  held.assign(static_cast<std::size_t>(vertex_count), 0);
  for (int vertex : input.driven_vertices) {
    if (vertex < 0 || vertex >= vertex_count) return StepStatus::InvalidInput;
    unsigned char& flag = held[static_cast<std::size_t>(vertex)];
    if (flag != 0) return StepStatus::InvalidInput;
    flag = 1;
  }
  if (!all_finite(state.positions) || !all_finite(state.velocities)) return StepStatus::InvalidState;
  return StepStatus::Converged;
}

}  // namespace clothctl
