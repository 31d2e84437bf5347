#pragma once

// Memory of a step of a position-based sheet, and how state gets into the buffers of a layout and
// out of them: a velocity v is kept as the position x - h v at the start of the substep before.

#include <cstddef>
#include <vector>

#include "clothctl/cloth/carried_vertices.hpp"
#include "clothctl/cloth/detail/attachments.hpp"
#include "clothctl/cloth/detail/batch_sheet.hpp"
#include "clothctl/cloth/detail/held_impulses.hpp"
#include "clothctl/cloth/detail/lane_sheet.hpp"
#include "clothctl/cloth/detail/position_contacts.hpp"
#include "clothctl/cloth/detail/reserved_list.hpp"
#include "clothctl/cloth/detail/slow_motion.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// All memory of a step, from `make_workspace`. Only `carried` goes from step to step.
template <RealScalar Scalar>
struct PositionBasedWorkspace {
  /// 1 for driven vertices.
  std::vector<unsigned char> driven;
  /// Driven and pinned vertices.
  detail::ReservedList<int> held;
  /// Inverse masses, 0 for driven and pinned vertices, n, 1/kg.
  VectorX<Scalar> inverse_mass;
  /// Vertices that are carried in the next step; empty unless someone fills it.
  CarriedVertices<Scalar> carried;
  /// Impulses of held vertices; used if any is carried.
  detail::HeldImpulses<Scalar> held_impulses;
  /// Springs between vertices and points of the input.
  detail::Attachments<Scalar> attachments;
  /// Room for the contacts of a step.
  detail::ContactPlaneList<Scalar> contacts;
  /// Positions and velocities at the end of the step, and for the air, 3×n, m and m/s.
  Points<Scalar> positions, velocities;
  /// What is slow in the step at hand, with a limit of stretch.
  detail::SlowMotion<Scalar> slow;
  /// Whether the sets of coarse levels take turns in the step at hand.
  bool levels_alternate = false;
  /// Data of a grid; unused otherwise.
  typename detail::LaneSheet<Scalar>::Scratch lanes;
  /// Data of any other network; unused for a grid.
  typename detail::BatchSheet<Scalar>::Scratch batches;
};

namespace detail {

/// Writes positions and velocities (3×n, m and m/s) to the buffers of a sheet in lanes or batches,
/// for substeps of `h` s.
template <class Sheet, RealScalar Scalar>
void write_points(const Sheet& sheet, typename Sheet::Scratch& memory,
                  const Points<Scalar>& positions, const Points<Scalar>& velocities,
                  const Scalar& h) {
  for (Index v = 0; v < positions.cols(); ++v) {
    Scalar* x = memory.points.data() + sheet.offset(static_cast<int>(v));
    Scalar* start = memory.start.data() + sheet.offset(static_cast<int>(v));
    for (Index c = 0; c < 3; ++c) {
      const std::size_t k = static_cast<std::size_t>(c) * Sheet::kStride;
      x[k] = positions(c, v);
      start[k] = positions(c, v) - h * velocities(c, v);
    }
  }
}

/// Reads them back.
template <class Sheet, RealScalar Scalar>
void read_points(const Sheet& sheet, const typename Sheet::Scratch& memory, const Scalar& h,
                 Points<Scalar>& positions, Points<Scalar>& velocities) {
  for (Index v = 0; v < positions.cols(); ++v) {
    const Scalar* x = memory.points.data() + sheet.offset(static_cast<int>(v));
    const Scalar* start = memory.start.data() + sheet.offset(static_cast<int>(v));
    for (Index c = 0; c < 3; ++c) {
      const std::size_t k = static_cast<std::size_t>(c) * Sheet::kStride;
      positions(c, v) = x[k];
      velocities(c, v) = (x[k] - start[k]) / h;
    }
  }
}

/// Marks carried vertices in `held` (n flags, 1 for driven vertices), and the pinned ones. Returns
/// false where a carried vertex is off the sheet, held otherwise or named twice, or a velocity is
/// not finite.
template <RealScalar Scalar>
bool mark_carried(const CarriedVertices<Scalar>& carried, const std::vector<int>& pinned,
                  std::vector<unsigned char>& held) {
  if (carried.vertices.empty()) return true;
  if (held.size() < carried.vertices.size()) return false;
  for (const int v : pinned) held[static_cast<std::size_t>(v)] = 1;
  for (const int v : carried.vertices) {
    if (v < 0 || held.size() <= static_cast<std::size_t>(v)) return false;
    unsigned char& flag = held[static_cast<std::size_t>(v)];
    if (flag != 0) return false;
    flag = 1;
  }
  return all_finite(carried.velocities.leftCols(static_cast<Index>(carried.vertices.size())));
}

/// Moves carried vertices to where they are `time` s after the start of the step; `positions`:
/// then.
template <class Sheet, RealScalar Scalar>
void move_carried(const Sheet& sheet, typename Sheet::Scratch& memory,
                  const CarriedVertices<Scalar>& carried, const Points<Scalar>& positions,
                  const Scalar& time) {
  for (std::size_t i = 0; i < carried.vertices.size(); ++i) {
    const int v = carried.vertices[i];
    Scalar* x = memory.points.data() + sheet.offset(v);
    for (Index c = 0; c < 3; ++c)
      x[static_cast<std::size_t>(c) * Sheet::kStride] =
          positions(c, v) + time * carried.velocities(c, static_cast<Index>(i));
  }
}

/// Ends a step of `dt` s from `before` (3×n, m): gives the workspace's velocities of held vertices,
/// and the impulses of carried ones.
template <RealScalar Scalar>
void end_held(const std::vector<int>& pinned, const Points<Scalar>& before,
              const ClothInput<Scalar>& input, const Scalar& dt,
              PositionBasedWorkspace<Scalar>& ws) {
  for (const int vertex : pinned) ws.velocities.col(vertex).setConstant(Scalar(0));
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
    const Index vertex = input.driven_vertices[i];
    const Vector3<Scalar> end = input.driven_positions.col(static_cast<Index>(i));
    ws.velocities.col(vertex) = Vector3<Scalar>(end - before.col(vertex)) / dt;
  }
  const std::size_t others = ws.held.size() - ws.carried.vertices.size();
  ws.carried.total = ws.held_impulses.end();
  for (std::size_t i = 0; i < ws.carried.vertices.size(); ++i) {
    ws.velocities.col(ws.carried.vertices[i]) = ws.carried.velocities.col(static_cast<Index>(i));
    set_column(ws.carried.impulses, static_cast<Index>(i), ws.held_impulses.impulse(others + i));
  }
}

}  // namespace detail

}  // namespace clothctl::inline CLOTHCTL_ABI
