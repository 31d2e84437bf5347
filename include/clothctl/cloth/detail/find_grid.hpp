#pragma once

// Finds out whether a spring network is a grid: vertices numbered row by row, springs between
// neighbours in a row, a column or a cell, stencils 1, -2, 1 along rows and columns. Springs may be
// missing. lane_grid.hpp says what a grid gains.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/lane_grid.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The place of a spring or stencil in the lanes.
struct GridSlot {
  /// Kind of edge (GridEdge); or direction of a stencil, 0 along rows, 1 along columns.
  std::size_t kind = 0;
  /// Upper row and left column.
  int row = 0, col = 0;
};

/// A network as a grid.
struct GridShape {
  int rows = 0, cols = 0;
  /// True if rows of the lanes are columns of the numbering.
  bool transposed = false;
  /// The places of all springs and stencils.
  std::vector<GridSlot> springs, bends;

  /// Row and column of a vertex.
  std::array<int, 2> place(int vertex) const {
    const int stride = transposed ? rows : cols;
    const int first = vertex / stride, second = vertex % stride;
    return transposed ? std::array<int, 2>{second, first} : std::array<int, 2>{first, second};
  }
};

/// Returns the place of the edge between two vertices, if it joins neighbours.
inline std::optional<GridSlot> edge_slot(const GridShape& grid, int a, int b) {
  std::array<int, 2> p = grid.place(a), q = grid.place(b);
  if (q[0] < p[0] || (q[0] == p[0] && q[1] < p[1])) std::swap(p, q);
  const int down = q[0] - p[0], along = q[1] - p[1];
  if (down == 0 && along == 1) return GridSlot{kAlong, p[0], p[1]};
  if (down == 1 && along == 0) return GridSlot{kDown, p[0], p[1]};
  if (down == 1 && along == 1) return GridSlot{kFalling, p[0], p[1]};
  if (down == 1 && along == -1) return GridSlot{kRising, p[0], q[1]};
  return std::nullopt;
}

/// Returns the place of a stencil, if it is 1, -2, 1 over neighbours in a row or column.
template <RealScalar Scalar>
std::optional<GridSlot> bend_slot(const GridShape& grid, const BendStencil<Scalar>& bend) {
  const auto equals = [](const Scalar& a, double b) {
    return !(a < Scalar(b)) && !(Scalar(b) < a);
  };
  if (bend.count != 3 || !equals(bend.weight[0], 1.0) || !equals(bend.weight[1], -2.0) ||
      !equals(bend.weight[2], 1.0))
    return std::nullopt;
  const auto first = edge_slot(grid, bend.vertex[0], bend.vertex[1]);
  const auto second = edge_slot(grid, bend.vertex[1], bend.vertex[2]);
  if (!first || !second || first->kind != second->kind || first->kind > kDown) return std::nullopt;
  const std::size_t direction = first->kind == kAlong ? 0 : 1;
  const int dr = second->row - first->row, dc = second->col - first->col;
  const int step = direction == 0 ? dc : dr, aside = direction == 0 ? dr : dc;
  if (aside != 0 || (step != 1 && step != -1)) return std::nullopt;
  return GridSlot{direction, (std::min)(first->row, second->row),
                  (std::min)(first->col, second->col)};
}

/// Returns the network as a grid of `rows` × `cols`, if it is one.
template <RealScalar Scalar>
std::optional<GridShape> as_grid(const SpringNetwork<Scalar>& network, int rows, int cols) {
  GridShape grid;
  grid.transposed = cols > rows;  // lanes divide the longer side
  grid.rows = (std::max)(rows, cols);
  grid.cols = (std::min)(rows, cols);
  const std::size_t n = static_cast<std::size_t>(network.vertex_count());
  std::vector<unsigned char> taken(n * (kGridEdges + 2), 0);
  const auto take = [&](const GridSlot& slot, std::size_t kind) {
    const std::size_t at =
        static_cast<std::size_t>(slot.row) * static_cast<std::size_t>(grid.cols) +
        static_cast<std::size_t>(slot.col);
    unsigned char& flag = taken[at * (kGridEdges + 2) + kind];
    return flag++ == 0;
  };
  for (const Spring<Scalar>& spring : network.springs) {
    const auto slot = edge_slot(grid, spring.a, spring.b);
    if (!slot || spring.kind == SpringKind::Bend || !take(*slot, slot->kind)) return std::nullopt;
    grid.springs.push_back(*slot);
  }
  for (const BendStencil<Scalar>& bend : network.bends) {
    const auto slot = bend_slot(grid, bend);
    if (!slot || !take(*slot, kGridEdges + slot->kind)) return std::nullopt;
    grid.bends.push_back(*slot);
  }
  return grid;
}

/// Returns the network as a grid, if it is one of at least 8×8 vertices. Allocates. Complexity:
/// O(springs).
template <RealScalar Scalar>
std::optional<GridShape> find_grid(const SpringNetwork<Scalar>& network) {
  const int n = static_cast<int>(network.vertex_count());
  int farthest = 0;
  for (const Spring<Scalar>& spring : network.springs)
    farthest =
        (std::max)(farthest, spring.a < spring.b ? spring.b - spring.a : spring.a - spring.b);
  // The largest difference of numbers is a row, or a row and one column.
  for (int cols : {farthest, farthest - 1}) {
    if (cols < 8 || n % cols != 0 || n / cols < 8) continue;
    if (auto grid = as_grid(network, n / cols, cols)) return grid;
  }
  return std::nullopt;
}

/// True if levels can be made for the scalar: their lengths and weights are computed in double.
template <class Scalar>
concept HasLevels = requires(const Scalar& value) {
  static_cast<double>(value);
};

/// Returns true when the grid is whole and is at rest in a plane with equal cells, so that
/// distances at rest bound the distances in any motion that stretches no spring.
template <RealScalar Scalar>
requires HasLevels<Scalar>
bool is_regular(const SpringNetwork<Scalar>& network, const GridShape& grid) {
  const std::size_t rows = static_cast<std::size_t>(grid.rows),
                    cols = static_cast<std::size_t>(grid.cols);
  const auto at = [&](int v) {
    return Vector3<double>(network.rest_positions.col(v).template cast<double>());
  };
  std::size_t threads = 0;
  for (std::size_t e = 0; e < network.springs.size(); ++e) {
    const Spring<Scalar>& s = network.springs[e];
    if (Scalar(0) < s.stiffness && grid.springs[e].kind <= kDown) ++threads;
    const double rest = static_cast<double>(s.rest_length);
    const double distance = (at(s.b) - at(s.a)).norm();
    if (!(std::abs(distance - rest) < 1e-3 * rest)) return false;
  }
  if (threads != rows * (cols - 1) + cols * (rows - 1)) return false;
  // Every vertex is where a linear map of its row and column puts it.
  const int n = grid.rows * grid.cols;
  const int last_of_first = grid.transposed ? grid.rows - 1 : grid.cols - 1;
  const Vector3<double> origin = at(0);
  const Vector3<double> inner = (at(last_of_first) - origin) / last_of_first;
  const Vector3<double> outer =
      (at(n - 1 - last_of_first) - origin) / (n / (last_of_first + 1) - 1);
  const double tolerance = 1e-3 * (std::min)(inner.norm(), outer.norm());
  for (int v = 0; v < n; ++v) {
    const int i = v % (last_of_first + 1), j = v / (last_of_first + 1);
    if (!((at(v) - (origin + inner * i + outer * j)).norm() < tolerance)) return false;
  }
  return true;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
