#pragma once

// A grid of vertices laid out for vector registers, and Gauss-Seidel sweeps over its edges.
//
// The rows are divided into strips of R rows, one strip a lane. Row j of every strip and column c
// form a block: the coordinates x, y, z and the inverse mass w of kLanes vertices. An instruction
// works on the same place of all strips at once.
//
//     block (j, c):   x[kLanes]  y[kLanes]  z[kLanes]  w[kLanes]
//
// The last strip may have one row more than the others (local row R), so that grids of 16 R + 1
// rows need no padding of whole strips. Lanes without a vertex hold a point of inverse mass 0 whose
// edges have no weight.
//
// The edges between the last row of a strip and the first row of the next one are swept on a copy
// of that first row, the ghost row: lane k of the ghost row is the vertex below lane k. A vertex is
// written back before it is read again, so the sweep is sequential as far as edges share vertices.
//
// Within a row pass the four kinds of edges follow each other at a distance of two columns, so that
// an edge need not wait for the one before it. The order of the edges is: by rows; in a row, kind
// by kind as far as edges share vertices, each kind by columns. With A the row, C the row below:
//
//     along   A(c) - A(c+1)
//     down    A(c) - C(c)
//     falling A(c) - C(c+1)
//     rising  A(c+1) - C(c)
//
// A sweep back takes the edges within each row in the opposite order; the rows keep theirs. With
// rows back too, hanging sheets sank 1.6 times as far (docs/position_based.md).
//
// A wide grid has bands of columns, which threads may sweep at the same time. What spans two bands,
// a seam, follows when all bands are done, or in a sweep back comes first. So the order depends on
// the grid alone.

#include <algorithm>
#include <array>
#include <cstddef>

#include "clothctl/cloth/detail/sweep_order.hpp"
#include "clothctl/concepts/executor.hpp"
#include "clothctl/core/simd.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Lanes of a grid: the widest register of floats, or of doubles; 1 for other scalars.
template <class Scalar>
constexpr int grid_lanes() {
  return std::is_same_v<Scalar, float> ? 16 : std::is_same_v<Scalar, double> ? 8 : 1;
}

/// The columns `begin` to `end` of a grid.
struct ColumnBand {
  std::size_t begin = 0, end = 0;
  /// True for a seam: what lies in a column belongs to its band.
  bool seam = false;
};

/// Where the vertices of a grid are.
template <RealScalar Scalar>
struct LaneLayout {
  static constexpr int kLanes = grid_lanes<Scalar>();
  static constexpr int kBlock = 4 * kLanes;
  /// Narrower bands would spend more of their time at their ends.
  static constexpr int kMostBands = 16, kBandCols = 64;
  int rows = 0;
  int cols = 0;
  /// Rows of a strip, R.
  int strip = 0;
  /// Local rows in memory: R, or R + 1.
  int local_rows = 0;
  /// The lane of the last row.
  int last_lane = 0;

  LaneLayout() = default;
  LaneLayout(int rows_, int cols_, int strip_, int last_lane_)
      : rows(rows_), cols(cols_), strip(strip_), last_lane(last_lane_) {
    const int in_last = rows - last_lane * strip;
    local_rows = in_last > strip ? in_last : strip;
  }

  int lane(int row) const {
    const int at = row / strip;
    return at < last_lane ? at : last_lane;
  }
  int local_row(int row) const { return row - lane(row) * strip; }
  /// Number of vertices in a lane.
  int rows_in_lane(int k) const {
    return k < last_lane ? strip : (k == last_lane ? rows - last_lane * strip : 0);
  }
  std::size_t block(int local, int col) const {
    return static_cast<std::size_t>(local) * static_cast<std::size_t>(cols) +
           static_cast<std::size_t>(col);
  }
  /// Where x of a vertex is; y, z and w follow at distances of kLanes.
  std::size_t offset(int row, int col) const {
    return block(local_row(row), col) * kBlock + static_cast<std::size_t>(lane(row));
  }
  /// Scalars of all blocks.
  std::size_t size() const {
    return static_cast<std::size_t>(local_rows) * static_cast<std::size_t>(cols) * kBlock;
  }
  /// Scalars of all blocks and of two ghost rows behind them.
  std::size_t buffer_size() const { return size() + 2 * row_size(); }
  /// Scalars of one row of blocks.
  std::size_t row_size() const { return static_cast<std::size_t>(cols) * kBlock; }

  /// Number of bands.
  int band_count() const { return (std::clamp)(cols / kBandCols, 1, kMostBands); }
  /// Where band i begins; the last one ends where a band `band_count()` would begin.
  std::size_t band_begin(int i) const {
    return static_cast<std::size_t>(i) * static_cast<std::size_t>(cols) /
           static_cast<std::size_t>(band_count());
  }
  ColumnBand whole() const { return {0, static_cast<std::size_t>(cols)}; }
};

/// Calls `run(band, i)` for each band, at the same time, and then for each seam of vertices that
/// are `reach` columns apart, or the other way round; i counts both.
template <RealScalar Scalar, class Run>
void for_each_band(const LaneLayout<Scalar>& layout, const ExecutorRef& executor, std::size_t reach,
                   const Run& run, SweepOrder order = SweepOrder::Forward) {
  const int count = layout.band_count();
  const auto seams = [&] {
    for (int i = 1; i < count; ++i) {
      const std::size_t at = layout.band_begin(i);
      run(ColumnBand{at - reach, at + reach, true}, count + i - 1);
    }
  };
  if (order == SweepOrder::Backward) seams();
  executor.for_each_block(count, [&](int i) {
    run(ColumnBand{layout.band_begin(i), layout.band_begin(i + 1)}, i);
  });
  if (order == SweepOrder::Forward) seams();
}

/// Kinds of edges of a grid.
enum GridEdge : std::size_t { kAlong, kDown, kFalling, kRising, kGridEdges };

/// Numbers of the edges of a grid, one array a kind. Entry block · kLanes + lane belongs to the
/// edge whose upper row is in that block and lane, and whose left column is its column.
template <RealScalar Scalar>
struct EdgeLanes {
  /// Empty for a kind that the grid has not.
  std::array<VectorX<Scalar>, kGridEdges> of;

  /// Allocates.
  void resize(const LaneLayout<Scalar>& layout, const std::array<bool, kGridEdges>& present) {
    for (std::size_t kind = 0; kind < kGridEdges; ++kind)
      of[kind].setZero(present[kind] ? static_cast<Index>(layout.size() / 4) : 0);
  }
  bool same_size(const EdgeLanes& other) const {
    bool same = true;
    for (std::size_t kind = 0; kind < kGridEdges; ++kind)
      same = same && of[kind].size() == other.of[kind].size();
    return same;
  }
};

/// Four packs: the points of a block and their inverse masses.
template <RealScalar Scalar>
struct LanePoints {
  static constexpr int kLanes = grid_lanes<Scalar>();
  using Pack = Simd<Scalar, kLanes>;
  Pack x, y, z, w;

  static CLOTHCTL_KERNEL LanePoints load(const Scalar* from) {
    return {Pack::load(from), Pack::load(from + kLanes), Pack::load(from + 2 * kLanes),
            Pack::load(from + 3 * kLanes)};
  }
  /// Writes the points; the inverse masses stay.
  CLOTHCTL_KERNEL void store_points(Scalar* to) const {
    x.store(to);
    y.store(to + kLanes);
    z.store(to + 2 * kLanes);
  }
};

/// Copies a row of blocks so that lane k of `ghost` is what lane k + 1 of `row` is; the last lane
/// gets lane 0.
template <RealScalar Scalar>
void read_next_strip(const ColumnBand& band, const Scalar* row, Scalar* ghost) {
  constexpr std::size_t kLanes = LaneLayout<Scalar>::kLanes, kBlock = LaneLayout<Scalar>::kBlock;
  for (std::size_t at = band.begin * kBlock; at < band.end * kBlock; at += kLanes) {
    for (std::size_t lane = 0; lane + 1 < kLanes; ++lane) ghost[at + lane] = row[at + lane + 1];
    ghost[at + kLanes - 1] = row[at];
  }
}

/// Copies the lanes before the last strip's back.
template <RealScalar Scalar>
void write_next_strip(const LaneLayout<Scalar>& layout, const ColumnBand& band, const Scalar* ghost,
                      Scalar* row) {
  constexpr std::size_t kLanes = LaneLayout<Scalar>::kLanes, kBlock = LaneLayout<Scalar>::kBlock;
  const std::size_t last = static_cast<std::size_t>(layout.last_lane);
  for (std::size_t at = band.begin * kBlock; at < band.end * kBlock; at += kLanes) {
    for (std::size_t lane = 0; lane < last; ++lane) row[at + lane + 1] = ghost[at + lane];
  }
}

/// Copies into `ghost` (one row of blocks) what is below row R-1 of each strip: row 0 of the next
/// strip or, in the last lane, row R if there is one. The lanes without such a vertex get another
/// one; their edges have no weight.
template <RealScalar Scalar>
void read_ghost_row(const LaneLayout<Scalar>& layout, const ColumnBand& band, const Scalar* points,
                    Scalar* ghost) {
  constexpr std::size_t kLanes = LaneLayout<Scalar>::kLanes, kBlock = LaneLayout<Scalar>::kBlock;
  read_next_strip(band, points, ghost);
  if (layout.local_rows <= layout.strip) return;
  const std::size_t last = static_cast<std::size_t>(layout.last_lane);
  const Scalar* extra = points + static_cast<std::size_t>(layout.strip) * layout.row_size();
  for (std::size_t at = band.begin * kBlock; at < band.end * kBlock; at += kLanes)
    ghost[at + last] = extra[at + last];
}

/// Copies the points of the ghost row back to the vertices that they were read from: those of the
/// lanes first, first + step, …
template <RealScalar Scalar>
void write_ghost_row(const LaneLayout<Scalar>& layout, const ColumnBand& band, const Scalar* ghost,
                     Scalar* points, std::size_t first = 0, std::size_t step = 1) {
  constexpr std::size_t kLanes = LaneLayout<Scalar>::kLanes, kBlock = LaneLayout<Scalar>::kBlock;
  const std::size_t begin = band.begin * kBlock, end = band.end * kBlock;
  const std::size_t last = static_cast<std::size_t>(layout.last_lane);
  if (step == 1) {
    write_next_strip(layout, band, ghost, points);
  } else {
    for (std::size_t at = begin; at < end; at += kLanes) {
      for (std::size_t lane = first; lane < last; lane += step)
        points[at + lane + 1] = ghost[at + lane];
    }
  }
  if (layout.local_rows <= layout.strip || last % step != first) return;
  Scalar* extra = points + static_cast<std::size_t>(layout.strip) * layout.row_size();
  for (std::size_t at = begin; at < end; at += kLanes) extra[at + last] = ghost[at + last];
}

/// Calls `rule.edge(kind, first entry in EdgeLanes, block of one end, block of the other end)` for
/// the edges between the row of blocks `upper`, whose local row is `local`, and `lower`.
template <RealScalar Scalar, class Rule>
void sweep_rows(const LaneLayout<Scalar>& layout, const std::array<bool, kGridEdges>& present,
                const ColumnBand& band, int local, Scalar* upper, Scalar* lower, Rule& rule,
                SweepOrder order) {
  constexpr std::size_t kLanes = LaneLayout<Scalar>::kLanes, kBlock = LaneLayout<Scalar>::kBlock;
  const std::size_t cols = band.end - band.begin, down = band.seam ? 0 : cols;
  const std::size_t first = layout.block(local, 0) + band.begin;
  upper += band.begin * kBlock;
  lower += band.begin * kBlock;
  // An edge starts when those that it waits for are some iterations back. Every kind lags two
  // columns behind the one before, so the edges of an iteration have no vertex in common.
  const SweepPlaces places(order, 0, cols + 6);
  for (std::size_t i = 0; i < places.count(); ++i) {
    const std::size_t c = places[i];
    if (c + 1 < cols) {
      rule.template edge<kAlong>((first + c) * kLanes, upper + c * kBlock,
                                 upper + (c + 1) * kBlock);
    }
    if (const std::size_t k = c - 2; k < down) {
      rule.template edge<kDown>((first + k) * kLanes, upper + k * kBlock, lower + k * kBlock);
    }
    if (const std::size_t k = c - 4; present[kFalling] && k < cols - 1) {
      rule.template edge<kFalling>((first + k) * kLanes, upper + k * kBlock,
                                   lower + (k + 1) * kBlock);
    }
    if (const std::size_t k = c - 6; present[kRising] && k < cols - 1) {
      rule.template edge<kRising>((first + k) * kLanes, upper + (k + 1) * kBlock,
                                  lower + k * kBlock);
    }
  }
}

/// Visits the edges of local row `local` along the row.
template <RealScalar Scalar, class Rule>
void sweep_along(const LaneLayout<Scalar>& layout, const ColumnBand& band, int local, Scalar* row,
                 Rule& rule, SweepOrder order) {
  constexpr std::size_t kLanes = LaneLayout<Scalar>::kLanes, kBlock = LaneLayout<Scalar>::kBlock;
  const std::size_t first = layout.block(local, 0);
  const SweepPlaces places(order, band.begin, band.end - 1);
  for (std::size_t i = 0; i < places.count(); ++i) {
    const std::size_t c = places[i];
    rule.template edge<kAlong>((first + c) * kLanes, row + c * kBlock, row + (c + 1) * kBlock);
  }
}

/// Visits every edge of a band, or of a seam, once. `ghost` has room for one row of blocks. Calls
/// `rule.only_lanes(parity)` before and `rule.all_lanes()` after edges of which only those of the
/// even (0) or odd (1) lanes may move. A sweep back runs back within each row.
template <RealScalar Scalar, class Rule>
void sweep_grid(const LaneLayout<Scalar>& layout, const std::array<bool, kGridEdges>& present,
                const ColumnBand& band, Scalar* points, Scalar* ghost, Rule& rule,
                SweepOrder order = SweepOrder::Forward) {
  const std::size_t row = layout.row_size();
  const int last = layout.strip - 1;
  const auto at = [&](int j) { return points + static_cast<std::size_t>(j) * row; };
  for (int j = 0; j < last; ++j)
    sweep_rows(layout, present, band, j, at(j), at(j + 1), rule, order);
  if (last == 0) {
    // Both ends of an edge between strips are in one row of blocks: every other lane at a time.
    for (std::size_t parity = 0; parity < 2; ++parity) {
      rule.only_lanes(parity);
      read_ghost_row(layout, band, points, ghost);
      sweep_rows(layout, present, band, 0, points, ghost, rule, order);
      write_ghost_row(layout, band, ghost, points, parity, 2);
    }
    rule.all_lanes();
  } else {
    read_ghost_row(layout, band, points, ghost);
    sweep_rows(layout, present, band, last, at(last), ghost, rule, order);
    write_ghost_row(layout, band, ghost, points);
  }
  if (layout.local_rows > layout.strip)
    sweep_along(layout, band, layout.strip, at(layout.strip), rule, order);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
