#pragma once

// What every model verifies before a step: state, input, step length and workspace. Also small
// parts that the models share: the load of gravity and the hash that identifies a model's
// structure.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "clothctl/contact/obstacle_contacts.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/status.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the message of a model's `check_input` for a workspace that another model made.
inline std::string foreign_workspace_line() {
  return "the workspace was made by another model; use make_workspace() of the model that steps";
}

/// Returns minus the weight of all masses under the acceleration `gravity`, N.
template <RealScalar Scalar>
Vector3<Scalar> gravity_load(const Vector3<Scalar>& gravity, const VectorX<Scalar>& mass) {
  Scalar total = Scalar(0);
  for (Index i = 0; i < mass.size(); ++i) total += mass[i];
  return {Scalar(0) - gravity[0] * total, Scalar(0) - gravity[1] * total,
          Scalar(0) - gravity[2] * total};
}

/// Hash (FNV-1a over words) of integers that describe the structure of a model.
struct StructureHash {
  std::uint64_t value = 14695981039346656037u;
  void add(std::int64_t word) {
    value = (value ^ static_cast<std::uint64_t>(word)) * 1099511628211u;
    value ^= value >> 32;
  }
};

/// Returns true when the attachments of an input for `vertex_count` vertices are valid. Never
/// allocates.
template <RealScalar Scalar>
bool attachments_are_good(const ClothInput<Scalar>& input, Index vertex_count) {
  const Index count = static_cast<Index>(input.attached_vertices.size());
  bool good = input.attached_positions.cols() == count &&
              input.attachment_stiffness.size() == count && all_finite(input.attached_positions);
  for (int vertex : input.attached_vertices) good = good && 0 <= vertex && vertex < vertex_count;
  for (Index i = 0; good && i < count; ++i) {
    const Scalar k = input.attachment_stiffness[i];
    good = is_finite(k) && Scalar(0) < k;
  }
  return good;
}

/// Verifies state, input and step length of a sheet of `vertex_count` vertices. Writes to `held` a
/// 1 for each driven vertex and a 0 for the others (n flags, resized by the caller beforehand).
///
/// Returns Converged when all is good, else InvalidInput or InvalidState. Never allocates.
/// Complexity: O(n).
template <RealScalar Scalar>
[[nodiscard]] StepStatus check_step(const ClothState<Scalar>& state,
                                    const ClothInput<Scalar>& input, const Scalar& dt,
                                    Index vertex_count, std::vector<unsigned char>& held) {
  if (state.positions.cols() != vertex_count || state.velocities.cols() != vertex_count)
    return StepStatus::InvalidState;
  if (!is_finite(dt) || !(Scalar(0) < dt)) return StepStatus::InvalidInput;
  const Index forces = static_cast<Index>(input.force_vertices.size());
  const Index driven = static_cast<Index>(input.driven_vertices.size());
  if (input.forces.cols() != forces || input.driven_positions.cols() != driven)
    return StepStatus::InvalidInput;
  for (int vertex : input.force_vertices) {
    if (vertex < 0 || vertex >= vertex_count) return StepStatus::InvalidInput;
  }
  if (!all_finite(input.forces) || !all_finite(input.driven_positions) || !all_finite(input.wind))
    return StepStatus::InvalidInput;
  if (!attachments_are_good(input, vertex_count)) return StepStatus::InvalidInput;
  held.assign(static_cast<std::size_t>(vertex_count), 0);
  for (int vertex : input.driven_vertices) {
    if (vertex < 0 || vertex >= vertex_count) return StepStatus::InvalidInput;
    unsigned char& flag = held[static_cast<std::size_t>(vertex)];
    if (flag != 0) return StepStatus::InvalidInput;
    flag = 1;
  }
  if (!all_finite(state.positions) || !all_finite(state.velocities))
    return StepStatus::InvalidState;
  return StepStatus::Converged;
}

/// Returns Converged when a step of `dt` (s) of a sheet of `vertex_count` vertices can take the
/// contacts, for which there is room for `capacity`; else InvalidInput or InvalidWorkspace.
template <RealScalar Scalar>
StepStatus check_contacts(const ObstacleContacts<Scalar>& contacts, const Scalar& dt,
                          Index vertex_count, std::size_t capacity) {
  if (capacity < contacts.contacts().size()) return StepStatus::InvalidWorkspace;
  if (contacts.step_length() < dt || dt < contacts.step_length()) return StepStatus::InvalidInput;
  for (const ObstacleContact<Scalar>& contact : contacts.contacts()) {
    for (const int v : contact.point.vertex) {
      if (v >= vertex_count) return StepStatus::InvalidInput;
    }
  }
  return StepStatus::Converged;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
