#pragma once

// Random grids in lanes, and the order in which a sweep visits their edges, in plain code.

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/detail/lane_edges.hpp"
#include "support/sweeps.hpp"

namespace clothctl_test {

/// Rows, columns and rows of a strip.
struct LaneCase {
  int rows, cols, strip;
};

/// Sizes for grids in lanes: whole strips, one row more, some lanes only.
template <class Scalar>
std::vector<LaneCase> lane_cases() {
  constexpr int kLanes = clothctl::detail::grid_lanes<Scalar>();
  if (kLanes == 1) return {{12, 8, 11}, {12, 8, 12}, {4, 3, 4}};
  return {{kLanes * 3, 8, 3}, {kLanes * 3 + 1, 9, 3}, {17, 8, 4}, {13, 5, 3}, {4, 4, 4}};
}

/// An edge of a grid: its kind, upper row and left column, and the numbers of its ends.
struct GridEdgePlace {
  std::size_t kind = 0;
  int row = 0, col = 0;
  std::size_t a = 0, b = 0;
};

/// The edges in the order of a sweep: row j of all strips, kind after kind; then the last row.
template <class Scalar>
std::vector<GridEdgePlace> sweep_order(const clothctl::detail::LaneLayout<Scalar>& layout) {
  using namespace clothctl::detail;
  std::vector<GridEdgePlace> order;
  const auto visit_row = [&](int row) {
    for (std::size_t kind = 0; kind < kGridEdges; ++kind) {
      for (int col = 0; col < layout.cols; ++col) {
        const bool right = col + 1 < layout.cols, below = row + 1 < layout.rows;
        if ((kind != kDown && !right) || (kind != kAlong && !below)) continue;
        const int first = row * layout.cols + col + (kind == kRising ? 1 : 0);
        const int second = (kind == kAlong ? row : row + 1) * layout.cols + col +
                           (kind == kAlong || kind == kFalling ? 1 : 0);
        order.push_back(
            {kind, row, col, static_cast<std::size_t>(first), static_cast<std::size_t>(second)});
      }
    }
  };
  const int parts = layout.strip == 1 ? 2 : 1;
  for (int j = 0; j < layout.strip; ++j) {
    for (int part = 0; part < parts; ++part) {
      for (int lane = part; lane <= layout.last_lane; lane += parts) {
        const int row = lane * layout.strip + j;
        if (row < layout.rows) visit_row(row);
      }
    }
  }
  if (layout.local_rows > layout.strip) visit_row(layout.rows - 1);
  return order;
}

/// Where the entry of an edge or stencil is.
template <class Scalar>
clothctl::Index entry_of(const clothctl::detail::LaneLayout<Scalar>& layout, int row, int col) {
  constexpr std::size_t kLanes = std::size_t(clothctl::detail::grid_lanes<Scalar>());
  const std::size_t at = layout.offset(row, col);
  return static_cast<clothctl::Index>(at / (4 * kLanes) * kLanes + at % (4 * kLanes));
}

/// Random points and inverse masses in lanes and in plain code. One in eight vertices is held if
/// `held`.
template <class Scalar>
struct LaneCloud {
  clothctl::detail::LaneLayout<Scalar> layout;
  clothctl::VectorX<Scalar> buffer;
  std::vector<PlainPoint> points;

  LaneCloud(const LaneCase& size, unsigned seed, bool held)
      : layout(size.rows, size.cols, size.strip,
               std::min((size.rows - 1) / size.strip, clothctl::detail::grid_lanes<Scalar>() - 1)) {
    constexpr std::size_t kLanes = std::size_t(clothctl::detail::grid_lanes<Scalar>());
    Numbers random(seed);
    buffer.setZero(static_cast<clothctl::Index>(layout.buffer_size()));
    for (int row = 0; row < layout.rows; ++row) {
      for (int col = 0; col < layout.cols; ++col) {
        PlainPoint point;
        const std::array<double, 2> place{0.1 * row, 0.1 * col};
        for (std::size_t c = 0; c < 4; ++c) {
          Scalar& value =
              buffer[static_cast<clothctl::Index>(layout.offset(row, col) + c * kLanes)];
          if (c < 3) value = Scalar((c < 2 ? place[c] : 0.0) + random(-0.04, 0.04));
          if (c == 3) value = Scalar(held && random.below(8) == 0 ? 0.0 : random(0.5, 3.0));
          (c < 3 ? point.at[static_cast<clothctl::Index>(c)] : point.w) =
              static_cast<double>(value);
        }
        points.push_back(point);
      }
    }
  }
  /// The point of a vertex in the lanes.
  PlainPoint in_lanes(std::size_t v) const {
    constexpr std::size_t kLanes = std::size_t(clothctl::detail::grid_lanes<Scalar>());
    const int row = static_cast<int>(v) / layout.cols, col = static_cast<int>(v) % layout.cols;
    const std::size_t at = layout.offset(row, col);
    const auto get = [&](std::size_t c) {
      return static_cast<double>(buffer[static_cast<clothctl::Index>(at + c * kLanes)]);
    };
    PlainPoint point;
    point.at << get(0), get(1), get(2);
    point.w = get(3);
    return point;
  }
  /// The largest distance between a vertex in the lanes and the same in plain code.
  double distance() const {
    double most = 0;
    for (std::size_t v = 0; v < points.size(); ++v)
      most = std::max(most, (in_lanes(v).at - points[v].at).norm());
    return most;
  }
};

}  // namespace clothctl_test
