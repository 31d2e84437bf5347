#pragma once

// One coarse level of a grid: which vertices it keeps, its edges, and what moves between it and
// finer ones.

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/lane_edges.hpp"
#include "clothctl/cloth/detail/level_lines.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The lines that a level keeps, and the masses of the vertices where they cross, row by row, kg.
struct LevelVertices {
  LevelLines rows, cols;
  std::vector<double> mass;

  std::size_t index(int row, int col) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(cols.count()) +
           static_cast<std::size_t>(col);
  }
  /// Returns these vertices with the masses of `finer` ones, each shared among its parents by the
  /// weights of linear interpolation. Allocates.
  static LevelVertices below(const LevelVertices& finer, LevelLines rows, LevelLines cols);
};

inline LevelVertices LevelVertices::below(const LevelVertices& finer, LevelLines rows,
                                          LevelLines cols) {
  LevelVertices made{std::move(rows), std::move(cols), {}};
  made.mass.assign(made.index(made.rows.count(), 0), 0.0);
  for (int row = 0; row < finer.rows.count(); ++row) {
    const LineParents<double> r(finer.rows, made.rows, row);
    for (int col = 0; col < finer.cols.count(); ++col) {
      const LineParents<double> c(finer.cols, made.cols, col);
      const double m = finer.mass[finer.index(row, col)];
      const auto give = [&](int i, int j, double share) {
        if (0.0 < share) made.mass[made.index(i, j)] += share * m;
      };
      give(r.first, c.first, (1.0 - r.second) * (1.0 - c.second));
      give(r.first, c.first + 1, (1.0 - r.second) * c.second);
      give(r.first + 1, c.first, r.second * (1.0 - c.second));
      give(r.first + 1, c.first + 1, r.second * c.second);
    }
  }
  return made;
}

/// One coarse level. "The grid" is the finest one.
template <RealScalar Scalar>
struct LaneLevel {
  static constexpr int kLanes = grid_lanes<Scalar>();
  static constexpr std::size_t kBlock = LaneLayout<Scalar>::kBlock;
  using Pack = Simd<Scalar, kLanes>;
  using Block = LanePoints<Scalar>;

  /// Rows of the grid between two regular rows of the level.
  int spacing = 1;
  LevelLines rows{1, 1}, cols{1, 1};
  LaneEdges<Scalar> edges;
  /// Blocks of the rest positions and of the inverse masses.
  VectorX<Scalar> rest;
  /// For each local row of the next finer level and each lane, the weight of the second parent row;
  /// for each column of that level, its first parent and the weight of the second.
  VectorX<Scalar> row_weight;
  std::vector<LineParents<Scalar>> col_parents;

  /// Makes a level with the given vertices. `grid_rest` has the blocks of the grid at rest; `finer`
  /// is the next finer level, of layout `finer_layout`. Allocates.
  LaneLevel(const LaneLayout<Scalar>& grid, const VectorX<Scalar>& grid_rest, int row_spacing,
            const LevelVertices& vertices, const LevelVertices& finer,
            const LaneLayout<Scalar>& finer_layout);

  /// Copies the positions of the level's vertices from the grid.
  void inject(const LaneLayout<Scalar>& grid, const Scalar* points, Scalar* level_points) const;
  /// Subtracts the positions of the level's vertices on the grid.
  void subtract_injection(const LaneLayout<Scalar>& grid, const Scalar* points,
                          Scalar* level_points) const;
  /// Adds the interpolation of `coarse`, of this level, to `fine`, of the next finer one, where the
  /// inverse mass is positive.
  void add_interpolation(const LaneLayout<Scalar>& layout, Scalar* coarse, Scalar* fine) const;

 private:
  void set_edges();
  void set_parents(const LevelVertices& finer, const LaneLayout<Scalar>& finer_layout);
  /// Calls `visit(destination, source)` for each block of the level that comes from the grid.
  template <class Visit>
  void for_each_injected(const LaneLayout<Scalar>& grid, Visit&& visit) const;
};

template <RealScalar Scalar>
LaneLevel<Scalar>::LaneLevel(const LaneLayout<Scalar>& grid, const VectorX<Scalar>& grid_rest,
                             int row_spacing, const LevelVertices& vertices,
                             const LevelVertices& finer, const LaneLayout<Scalar>& finer_layout)
    : spacing(row_spacing), rows(vertices.rows), cols(vertices.cols) {
  edges.resize({rows.count(), cols.count(), grid.strip / spacing, grid.last_lane},
               {true, true, true, true});
  const LaneLayout<Scalar>& layout = edges.layout;
  rest.setZero(static_cast<Index>(layout.buffer_size()));
  for (int row = 0; row < rows.count(); ++row) {
    for (int col = 0; col < cols.count(); ++col) {
      const Index to = static_cast<Index>(layout.offset(row, col));
      const Index from = static_cast<Index>(grid.offset(rows.fine[static_cast<std::size_t>(row)],
                                                        cols.fine[static_cast<std::size_t>(col)]));
      for (Index c = 0; c < 3; ++c) rest[to + c * kLanes] = grid_rest[from + c * kLanes];
      rest[to + 3 * kLanes] = Scalar(1.0 / vertices.mass[vertices.index(row, col)]);
    }
  }
  set_edges();
  set_parents(finer, finer_layout);
}

template <RealScalar Scalar>
void LaneLevel<Scalar>::set_parents(const LevelVertices& finer,
                                    const LaneLayout<Scalar>& finer_layout) {
  row_weight.setZero(static_cast<Index>(finer_layout.local_rows) * kLanes);
  for (int row = 0; row < finer.rows.count(); ++row) {
    const LineParents<double> parents(finer.rows, rows, row);
    const int lane = finer_layout.lane(row), local = finer_layout.local_row(row);
    const int base = lane * edges.layout.strip + local / 2;
    row_weight[static_cast<Index>(local) * kLanes + lane] =
        Scalar(static_cast<double>(parents.first - base) + parents.second);
  }
  for (int col = 0; col < finer.cols.count(); ++col)
    col_parents.emplace_back(finer.cols, cols, col);
}

template <RealScalar Scalar>
void LaneLevel<Scalar>::set_edges() {
  const LaneLayout<Scalar>& layout = edges.layout;
  const auto add = [&](std::size_t kind, int row, int col, std::size_t a, std::size_t b) {
    double squared = 0.0;
    for (std::size_t c = 0; c < 3; ++c) {
      const double d = static_cast<double>(rest[static_cast<Index>(b + c * kLanes)]) -
                       static_cast<double>(rest[static_cast<Index>(a + c * kLanes)]);
      squared += d * d;
    }
    const std::size_t at = layout.offset(row, col);
    const Index entry = static_cast<Index>(at / kBlock * kLanes + at % kBlock);
    edges.rest.of[kind][entry] = Scalar(std::sqrt(squared));
    edges.relaxation.of[kind][entry] = Scalar(1);
  };
  for (int row = 0; row < layout.rows; ++row) {
    for (int col = 0; col < layout.cols; ++col) {
      const bool below = row + 1 < layout.rows, right = col + 1 < layout.cols;
      const std::size_t here = layout.offset(row, col);
      if (right) add(kAlong, row, col, here, layout.offset(row, col + 1));
      if (below) add(kDown, row, col, here, layout.offset(row + 1, col));
      if (!right || !below) continue;
      add(kFalling, row, col, here, layout.offset(row + 1, col + 1));
      add(kRising, row, col, layout.offset(row, col + 1), layout.offset(row + 1, col));
    }
  }
}

template <RealScalar Scalar>
template <class Visit>
void LaneLevel<Scalar>::for_each_injected(const LaneLayout<Scalar>& grid, Visit&& visit) const {
  const LaneLayout<Scalar>& layout = edges.layout;
  const std::size_t fine_row = grid.row_size(), row = layout.row_size();
  const std::size_t col_count = static_cast<std::size_t>(layout.cols);
  for (int j = 0; j < layout.strip; ++j) {
    const std::size_t from = static_cast<std::size_t>(j * spacing) * fine_row;
    const std::size_t to = static_cast<std::size_t>(j) * row;
    for (std::size_t c = 0; c < col_count; ++c)
      visit(to + c * kBlock, from + static_cast<std::size_t>(cols.fine[c]) * kBlock);
  }
}

template <RealScalar Scalar>
void LaneLevel<Scalar>::inject(const LaneLayout<Scalar>& grid, const Scalar* points,
                               Scalar* level_points) const {
  for_each_injected(grid, [&](std::size_t to, std::size_t from) CLOTHCTL_KERNEL_LAMBDA {
    Block::load(points + from).store_points(level_points + to);
  });
  // The last row, which need not be a multiple of the spacing.
  const LaneLayout<Scalar>& layout = edges.layout;
  for (int col = 0; col < layout.cols; ++col) {
    const std::size_t to = layout.offset(layout.rows - 1, col);
    const std::size_t from = grid.offset(grid.rows - 1, cols.fine[static_cast<std::size_t>(col)]);
    for (std::size_t c = 0; c < 3; ++c) level_points[to + c * kLanes] = points[from + c * kLanes];
  }
}

template <RealScalar Scalar>
void LaneLevel<Scalar>::subtract_injection(const LaneLayout<Scalar>& grid, const Scalar* points,
                                           Scalar* level_points) const {
  const LaneLayout<Scalar>& layout = edges.layout;
  // The last row first, with its values kept from the loop over all rows.
  for (int col = 0; col < layout.cols; ++col) {
    const std::size_t to = layout.offset(layout.rows - 1, col);
    const std::size_t from = grid.offset(grid.rows - 1, cols.fine[static_cast<std::size_t>(col)]);
    const int local = layout.local_row(layout.rows - 1);
    const bool regular = local < layout.strip;
    const std::size_t lane = static_cast<std::size_t>(grid.last_lane);
    for (std::size_t c = 0; c < 3; ++c) {
      Scalar subtract = points[from + c * kLanes];
      if (regular) {
        const std::size_t block =
            grid.block(local * spacing, cols.fine[static_cast<std::size_t>(col)]);
        subtract = subtract - points[block * kBlock + c * kLanes + lane];
      }
      level_points[to + c * kLanes] = level_points[to + c * kLanes] - subtract;
    }
  }
  for_each_injected(grid, [&](std::size_t to, std::size_t from) CLOTHCTL_KERNEL_LAMBDA {
    Block y = Block::load(level_points + to);
    const Block b = Block::load(points + from);
    y.x = y.x - b.x;
    y.y = y.y - b.y;
    y.z = y.z - b.z;
    y.store_points(level_points + to);
  });
}

template <RealScalar Scalar>
void LaneLevel<Scalar>::add_interpolation(const LaneLayout<Scalar>& layout, Scalar* coarse,
                                          Scalar* fine) const {
  const LaneLayout<Scalar>& from = edges.layout;
  Scalar* ghost = coarse + from.size();
  read_ghost_row(from, from.whole(), coarse, ghost);
  const std::size_t row = from.row_size();
  for (int local = 0; local < layout.local_rows; ++local) {
    const int j = local / 2;
    const Scalar* first = coarse + static_cast<std::size_t>(j) * row;
    const Scalar* second = j + 1 < from.strip ? first + row : (j < from.strip ? ghost : first);
    const Pack w1 = Pack::load(row_weight.data() + local * kLanes);
    const Pack w0 = Pack::all(Scalar(1)) - w1;
    const auto across = [&](std::size_t at) CLOTHCTL_KERNEL_LAMBDA {
      const Block a = Block::load(first + at), b = Block::load(second + at);
      return Block{w0 * a.x + w1 * b.x, w0 * a.y + w1 * b.y, w0 * a.z + w1 * b.z, a.w};
    };
    Scalar* target = fine + layout.block(local, 0) * kBlock;
    int at = 0;
    Block here = across(0), next = here;
    if (from.cols > 1) next = across(kBlock);
    for (std::size_t c = 0; c < static_cast<std::size_t>(layout.cols); ++c, target += kBlock) {
      const LineParents<Scalar>& parents = col_parents[c];
      while (at < parents.first) {
        ++at;
        here = next;
        if (at + 1 < from.cols) next = across(static_cast<std::size_t>(at + 1) * kBlock);
      }
      const Pack u = Pack::all(parents.second);
      Block p = Block::load(target);
      p.x = p.x + where_positive(p.w, here.x + u * (next.x - here.x));
      p.y = p.y + where_positive(p.w, here.y + u * (next.y - here.y));
      p.z = p.z + where_positive(p.w, here.z + u * (next.z - here.z));
      p.store_points(target);
    }
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
