#pragma once

// Why a step refuses its state, its input or its step length, in words. A step itself only returns
// a status, since it must not allocate.

#include <string>
#include <string_view>
#include <vector>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/number_text.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Returns a text that names the first coordinate of `points` that is not finite, or "" if there is
/// none.
template <RealScalar Scalar>
std::string find_not_finite(const Points<Scalar>& points, std::string_view item) {
  for (Index i = 0; i < points.cols(); ++i) {
    for (Index c = 0; c < 3; ++c) {
      if (is_finite(points(c, i))) continue;
      return std::string(item) + " " + std::to_string(i) + ": " + "xyz"[c] + " is " +
             number_text(points(c, i));
    }
  }
  return {};
}

/// Returns a text that names the first index that is off the mesh or, if `once` is set, occurs
/// twice; "" if there is none.
inline std::string find_bad_vertex(const std::vector<int>& vertices, Index vertex_count, bool once,
                                   std::string_view item) {
  std::vector<int> first(once ? static_cast<std::size_t>(vertex_count) : 0, -1);
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    const std::string name = std::string(item) + " " + std::to_string(i);
    const int v = vertices[i];
    if (v < 0 || v >= vertex_count)
      return name + ": vertex " + std::to_string(v) + " is off the mesh of " +
             std::to_string(vertex_count) + " vertices";
    if (!once) continue;
    int& seen = first[static_cast<std::size_t>(v)];
    if (seen >= 0)
      return name + ": vertex " + std::to_string(v) + " is driven already by driven vertex " +
             std::to_string(seen);
    seen = static_cast<int>(i);
  }
  return {};
}

/// Returns a text that names the first stiffness that is not positive and finite, or "".
template <RealScalar Scalar>
std::string find_bad_stiffness(const VectorX<Scalar>& stiffness) {
  for (Index i = 0; i < stiffness.size(); ++i) {
    if (is_finite(stiffness[i]) && Scalar(0) < stiffness[i]) continue;
    return "stiffness of attachment " + std::to_string(i) + " must be positive and finite, got " +
           number_text(stiffness[i]) + " N/m";
  }
  return {};
}

/// Returns a text that names both counts if they differ, else "".
inline std::string find_other_count(Index found, std::string_view what, Index expected,
                                    std::string_view of) {
  if (found == expected) return {};
  return std::to_string(found) + " " + std::string(what) + " for " + std::to_string(expected) +
         " " + std::string(of);
}

/// Returns a text that names both sizes if those of the state are not of `vertex_count` vertices,
/// else "".
template <RealScalar Scalar>
std::string find_other_size(const ClothState<Scalar>& state, Index vertex_count) {
  std::string line = find_other_count(state.positions.cols(), "positions in the state",
                                      vertex_count, "vertices of the model");
  if (line.empty())
    line = find_other_count(state.velocities.cols(), "velocities in the state", vertex_count,
                            "vertices of the model");
  return line;
}

/// Returns a text that names the first position or velocity of the state that is not finite, or "".
template <RealScalar Scalar>
std::string find_not_finite(const ClothState<Scalar>& state) {
  std::string line = find_not_finite(state.positions, "position of vertex");
  if (line.empty()) line = find_not_finite(state.velocities, "velocity of vertex");
  return line;
}

/// Returns a text that names the first fault of the attachments of an input for `vertex_count`
/// vertices, or "".
template <RealScalar Scalar>
std::string find_bad_attachment(const ClothInput<Scalar>& input, Index vertex_count) {
  const Index count = static_cast<Index>(input.attached_vertices.size());
  std::string line = find_other_count(input.attached_positions.cols(), "attached positions", count,
                                      "attached vertices");
  if (line.empty())
    line = find_other_count(input.attachment_stiffness.size(), "attachment stiffnesses", count,
                            "attached vertices");
  if (line.empty())
    line = find_bad_vertex(input.attached_vertices, vertex_count, false, "attached vertex");
  if (line.empty()) line = find_not_finite(input.attached_positions, "attached position");
  if (line.empty()) line = find_bad_stiffness(input.attachment_stiffness);
  return line;
}

}  // namespace detail

/// Returns why `state` is not one of a model of `vertex_count` vertices: one line that names the
/// sizes, or the vertex and the value that is not finite. Returns an empty string when it is.
/// Allocates. Complexity: O(vertices).
template <RealScalar Scalar>
std::string check_state(const ClothState<Scalar>& state, Index vertex_count) {
  std::string line = detail::find_other_size(state, vertex_count);
  return line.empty() ? detail::find_not_finite(state) : line;
}

/// Returns why a model of `vertex_count` vertices refuses to step `state` by `dt` (s) under
/// `input`: one line that names the item, its index and the bad value, e.g. `force 2: vertex 81 is
/// off the mesh of 81 vertices`. Returns an empty string when state, input and dt are valid. The
/// steps of this library's models check the same conditions. Allocates. Complexity: O(vertices).
template <RealScalar Scalar>
std::string check_step_input(const ClothState<Scalar>& state, const ClothInput<Scalar>& input,
                             const Scalar& dt, Index vertex_count) {
  const auto first_of = [](auto... finders) {
    std::string line;
    ((line.empty() ? void(line = finders()) : void()), ...);
    return line;
  };
  return first_of(
      [&] { return detail::find_other_size(state, vertex_count); },
      [&] {
        const bool good = is_finite(dt) && Scalar(0) < dt;
        return good ? std::string()
                    : "step length dt must be positive and finite, got " + number_text(dt) + " s";
      },
      [&] {
        return detail::find_other_count(input.forces.cols(), "forces",
                                        static_cast<Index>(input.force_vertices.size()),
                                        "force vertices");
      },
      [&] {
        return detail::find_other_count(input.driven_positions.cols(), "driven positions",
                                        static_cast<Index>(input.driven_vertices.size()),
                                        "driven vertices");
      },
      [&] { return detail::find_bad_vertex(input.force_vertices, vertex_count, false, "force"); },
      [&] { return detail::find_not_finite(input.forces, "force"); },
      [&] { return detail::find_not_finite(input.driven_positions, "driven position"); },
      [&] {
        std::string line;
        for (Index c = 2; c >= 0; --c) {
          if (!is_finite(input.wind[c]))
            line = std::string("wind: ") + "xyz"[c] + " is " + number_text(input.wind[c]);
        }
        return line;
      },
      [&] {
        return detail::find_bad_vertex(input.driven_vertices, vertex_count, true, "driven vertex");
      },
      [&] { return detail::find_bad_attachment(input, vertex_count); },
      [&] { return detail::find_not_finite(state); });
}

}  // namespace clothctl::inline CLOTHCTL_ABI
