#include "clothctl/cloth/detail/lane_level.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::Numbers;

namespace {

/// A grid of equal cells and its first level, or its second with the first in between.
template <class Scalar>
struct Levels {
  static constexpr Index kLanes = grid_lanes<Scalar>();
  LaneLayout<Scalar> grid;
  VectorX<Scalar> rest;
  LevelVertices grid_vertices, first_vertices, second_vertices;
  LaneLevel<Scalar> first, second;

  static LaneLayout<Scalar> layout_of(int rows, int cols) {
    int strip = 4;
    while (kLanes * strip + 1 < rows) strip += 4;
    return {rows, cols, strip, std::min((rows - 1) / strip, int(kLanes) - 1)};
  }
  static VectorX<Scalar> rest_of(const LaneLayout<Scalar>& layout) {
    VectorX<Scalar> rest = VectorX<Scalar>::Zero(static_cast<Index>(layout.buffer_size()));
    for (int row = 0; row < layout.rows; ++row) {
      for (int col = 0; col < layout.cols; ++col) {
        const Index at = static_cast<Index>(layout.offset(row, col));
        rest[at] = Scalar(0.01 * col);
        rest[at + kLanes] = Scalar(-0.02 * row);
        rest[at + 2 * kLanes] = Scalar(0.5);
        rest[at + 3 * kLanes] = Scalar(1);
      }
    }
    return rest;
  }
  static LevelVertices vertices_of(const LaneLayout<Scalar>& layout) {
    LevelVertices all{{layout.rows, 1}, {layout.cols, 1}, {}};
    Numbers random(3);
    for (int v = 0; v < layout.rows * layout.cols; ++v) all.mass.push_back(random(0.5, 2.0));
    return all;
  }
  Levels(int rows, int cols, bool shifted)
      : grid(layout_of(rows, cols)),
        rest(rest_of(grid)),
        grid_vertices(vertices_of(grid)),
        first_vertices(LevelVertices::below(grid_vertices, {rows, 2}, {cols, 2, shifted ? 1 : 0})),
        second_vertices(
            LevelVertices::below(first_vertices, {rows, 4}, {cols, 4, shifted ? 2 : 0})),
        first(grid, rest, 2, first_vertices, grid_vertices, grid),
        second(grid, rest, 4, second_vertices, first_vertices, first.edges.layout) {}
};

/// Mass, and mass times line, summed over the vertices: a row of the grid is at its number.
std::array<double, 3> moments(const LevelVertices& vertices) {
  std::array<double, 3> sums{};
  for (int row = 0; row < vertices.rows.count(); ++row) {
    for (int col = 0; col < vertices.cols.count(); ++col) {
      const double m = vertices.mass[vertices.index(row, col)];
      sums[0] += m;
      sums[1] += m * vertices.rows.fine[static_cast<std::size_t>(row)];
      sums[2] += m * vertices.cols.fine[static_cast<std::size_t>(col)];
    }
  }
  return sums;
}

struct Case {
  int rows, cols;
  bool shifted;
};
const Case kCases[] = {{33, 20, false}, {33, 21, true}, {70, 37, false}, {129, 18, true}};

}  // namespace

TEST_CASE("lane level: masses keep their sum and their centre", "[lane_level]") {
  for (const Case& c : kCases) {
    const Levels<double> levels(c.rows, c.cols, c.shifted);
    const auto fine = moments(levels.grid_vertices);
    for (const LevelVertices* coarse : {&levels.first_vertices, &levels.second_vertices}) {
      const auto sums = moments(*coarse);
      for (std::size_t i = 0; i < 3; ++i) CHECK(sums[i] == Approx(fine[i]).epsilon(1e-12));
    }
  }
}

TEMPLATE_TEST_CASE("lane level: what is injected can be subtracted", "[lane_level]", float, double,
                   long double) {
  using Scalar = TestType;
  for (const Case& c : kCases) {
    const Levels<Scalar> levels(c.rows, c.cols, c.shifted);
    for (const LaneLevel<Scalar>* level : {&levels.first, &levels.second}) {
      const LaneLayout<Scalar>& layout = level->edges.layout;
      VectorX<Scalar> points =
          VectorX<Scalar>::Constant(static_cast<Index>(layout.buffer_size()), Scalar(7));
      level->inject(levels.grid, levels.rest.data(), points.data());
      const auto at = [&](int row, int col) { return static_cast<Index>(layout.offset(row, col)); };
      bool same = true, zero = true;
      const auto for_each = [&](auto visit) {
        for (int row = 0; row < layout.rows; ++row) {
          for (int col = 0; col < layout.cols; ++col) visit(row, col);
        }
      };
      for_each([&](int row, int col) {
        same = same &&
               points[at(row, col)] ==
                   Scalar(0.01 * level->cols.fine[static_cast<std::size_t>(col)]) &&
               points[at(row, col) + grid_lanes<Scalar>()] ==
                   Scalar(-0.02 * level->rows.fine[static_cast<std::size_t>(row)]);
      });
      level->subtract_injection(levels.grid, levels.rest.data(), points.data());
      for_each([&](int row, int col) {
        for (Index k = 0; k < 3; ++k)
          zero = zero && points[at(row, col) + k * grid_lanes<Scalar>()] == Scalar(0);
      });
      CHECK(same);
      CHECK(zero);
    }
  }
}

TEMPLATE_TEST_CASE("lane level: interpolation reproduces what is linear, and skips held vertices",
                   "[lane_level]", float, double, long double) {
  using Scalar = TestType;
  constexpr Index kLanes = grid_lanes<Scalar>();
  const double small = std::is_same_v<Scalar, float> ? 1e-5 : 1e-13;
  for (const Case& c : kCases) {
    const Levels<Scalar> levels(c.rows, c.cols, c.shifted);
    const LaneLayout<Scalar>& layout = levels.first.edges.layout;
    VectorX<Scalar> coarse = VectorX<Scalar>::Zero(static_cast<Index>(layout.buffer_size()));
    const auto linear = [](int row, int col) { return 0.3 + 0.01 * row - 0.02 * col; };
    for (int row = 0; row < layout.rows; ++row) {
      for (int col = 0; col < layout.cols; ++col) {
        coarse[static_cast<Index>(layout.offset(row, col)) + kLanes] =
            Scalar(linear(levels.first.rows.fine[static_cast<std::size_t>(row)],
                          levels.first.cols.fine[static_cast<std::size_t>(col)]));
      }
    }
    VectorX<Scalar> fine = levels.rest;
    const int held_row = c.rows - 2, held_col = 3;
    const Index held = static_cast<Index>(levels.grid.offset(held_row, held_col));
    fine[held + 3 * kLanes] = Scalar(0);
    levels.first.add_interpolation(levels.grid, coarse.data(), fine.data());
    double worst = 0;
    for (int row = 0; row < c.rows; ++row) {
      for (int col = 0; col < c.cols; ++col) {
        const Index at = static_cast<Index>(levels.grid.offset(row, col));
        const double moved = static_cast<double>(fine[at + kLanes] - levels.rest[at + kLanes]);
        if (at != held) worst = std::max(worst, std::abs(moved - linear(row, col)));
      }
    }
    CHECK(worst < small);
    CHECK(fine[held + kLanes] == levels.rest[held + kLanes]);
  }
}

TEST_CASE("lane level: edges are as long as the paths that they replace", "[lane_level]") {
  const Levels<double> levels(70, 37, false);
  const LaneLevel<double>& level = levels.second;
  const LaneLayout<double>& layout = level.edges.layout;
  const auto rest = [&](std::size_t kind, int row, int col) {
    const std::size_t at = layout.offset(row, col), block = LaneLayout<double>::kBlock;
    return level.edges.rest.of[kind][static_cast<Index>(at / block * 8 + at % block)];
  };
  CHECK(rest(kAlong, 2, 1) == Approx(0.04));
  CHECK(rest(kDown, 2, 1) == Approx(0.08));
  CHECK(rest(kFalling, 2, 1) == Approx(std::hypot(0.04, 0.08)));
  CHECK(rest(kRising, 2, 1) == Approx(std::hypot(0.04, 0.08)));
  // The last row is one, not four, rows below the one before it.
  CHECK(rest(kDown, layout.rows - 2, 0) == Approx(0.02));
}
