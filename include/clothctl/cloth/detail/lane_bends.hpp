#pragma once

// Bending stencils 1, -2, 1 along the rows and columns of a grid in lanes. bend_batches.hpp has the
// maths, lane_grid.hpp the layout. A stencil belongs to the block of its first vertex: the left one
// in a row, the upper one in a column.

#include <array>
#include <cstddef>

#include "clothctl/cloth/detail/lane_grid.hpp"
#include "clothctl/cloth/detail/sweep_order.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Constants: kb (N/m) of the stencils along rows [0] and along columns [1]; 0 where there is none.
template <RealScalar Scalar>
struct LaneBends {
  LaneLayout<Scalar> layout;
  std::array<VectorX<Scalar>, 2> stiffness;
  bool any = false;
};

/// Numbers of the stencils during a step, as in BendScratch.
template <RealScalar Scalar>
struct LaneBendScratch {
  std::array<VectorX<Scalar>, 2> error_factor, multiplier_factor;
  std::array<std::array<VectorX<Scalar>, 3>, 2> multiplier;

  /// Allocates.
  void resize(Index size) {
    for (std::size_t k = 0; k < 2; ++k) {
      error_factor[k].setZero(size);
      multiplier_factor[k].setZero(size);
      for (VectorX<Scalar>& list : multiplier[k]) list.setZero(size);
    }
  }
};

/// Calls `rule.stencil(direction, first entry, block, block, block)` for the stencils of a band, or
/// those along rows that cross the middle of a seam of four columns. `points` has two ghost rows
/// behind its blocks. The strips have at least three rows, bands at least two columns.
template <RealScalar Scalar, class Rule>
void for_each_stencil(const LaneLayout<Scalar>& layout, const ColumnBand& band, Scalar* points,
                      Rule& rule, SweepOrder order = SweepOrder::Forward) {
  constexpr std::size_t kLanes = LaneLayout<Scalar>::kLanes, kBlock = LaneLayout<Scalar>::kBlock;
  const std::size_t row = layout.row_size(), last = static_cast<std::size_t>(layout.strip) - 1;
  const auto at = [&](std::size_t j) { return points + j * row; };
  const auto entry = [&](std::size_t j) { return layout.block(static_cast<int>(j), 0) * kLanes; };
  const auto along_rows = [&] {
    const SweepPlaces rows(order, 0, static_cast<std::size_t>(layout.local_rows));
    const SweepPlaces cols(order, band.begin, band.end - 2);
    for (std::size_t i = 0; i < rows.count(); ++i) {
      for (std::size_t k = 0; k < cols.count(); ++k) {
        Scalar* p = at(rows[i]) + cols[k] * kBlock;
        rule.stencil(0, entry(rows[i]) + cols[k] * kLanes, p, p + kBlock, p + 2 * kBlock);
      }
    }
  };
  const auto down = [&](std::size_t j, Scalar* upper, Scalar* middle, Scalar* lower) {
    for (std::size_t c = band.begin; c < band.end; ++c) {
      const std::size_t b = c * kBlock;
      rule.stencil(1, entry(j) + c * kLanes, upper + b, middle + b, lower + b);
    }
  };
  const auto within_strips = [&] {
    const SweepPlaces rows(order, 0, last - 1);
    for (std::size_t i = 0; i < rows.count(); ++i)
      down(rows[i], at(rows[i]), at(rows[i] + 1), at(rows[i] + 2));
  };
  // The ghost row is row 0 of the next strip, the second one row 1.
  Scalar* ghost = points + layout.size();
  Scalar* second = ghost + row;
  const auto across_one_row = [&] { down(last - 1, at(last - 1), at(last), ghost); };
  const auto across_two_rows = [&] {
    read_next_strip(band, at(1), second);
    down(last, at(last), ghost, second);
    write_next_strip(layout, band, second, at(1));
  };
  if (band.seam) return along_rows();
  if (order == SweepOrder::Forward) {
    along_rows();
    within_strips();
    read_ghost_row(layout, band, points, ghost);
    across_one_row();
    across_two_rows();
    write_ghost_row(layout, band, ghost, points);
  } else {
    read_ghost_row(layout, band, points, ghost);
    across_two_rows();
    across_one_row();
    write_ghost_row(layout, band, ghost, points);
    within_strips();
    along_rows();
  }
}

/// Computes the factors of a step of substep `h` (s).
template <RealScalar Scalar>
struct LaneBendPreparation {
  static constexpr int kLanes = grid_lanes<Scalar>();
  using Pack = Simd<Scalar, kLanes>;
  const LaneBends<Scalar>& bends;
  LaneBendScratch<Scalar>& scratch;
  Scalar h;

  CLOTHCTL_KERNEL void stencil(std::size_t direction, std::size_t at, const Scalar* a,
                               const Scalar* b, const Scalar* c) {
    const auto w = [](const Scalar* block)
                       CLOTHCTL_KERNEL_LAMBDA { return Pack::load(block + 3 * kLanes); };
    const Pack one = Pack::all(Scalar(1));
    const Pack k = Pack::all(h * h) * Pack::load(bends.stiffness[direction].data() + at);
    const Pack inverse = one / (k * (w(a) + Pack::all(Scalar(4)) * w(b) + w(c)) + one);
    (k * inverse).store(scratch.error_factor[direction].data() + at);
    inverse.store(scratch.multiplier_factor[direction].data() + at);
  }
};

/// One sweep; `kRead` and `kWrite` as in sweep_bends.
template <RealScalar Scalar, bool kRead, bool kWrite>
struct LaneBendSweep {
  static constexpr int kLanes = grid_lanes<Scalar>();
  using Pack = Simd<Scalar, kLanes>;
  using Block = LanePoints<Scalar>;
  LaneBendScratch<Scalar>& scratch;

  CLOTHCTL_KERNEL void stencil(std::size_t direction, std::size_t at, Scalar* first, Scalar* middle,
                               Scalar* last) {
    Block a = Block::load(first), b = Block::load(middle), c = Block::load(last);
    const Pack factor = Pack::load(scratch.error_factor[direction].data() + at);
    const Pack two_b = b.w + b.w;
    const auto correct = [&](Pack& p, Pack& q, Pack& r, std::size_t axis) CLOTHCTL_KERNEL_LAMBDA {
      Pack change = ((p - q) + (r - q)) * factor;
      Scalar* multiplier = scratch.multiplier[direction][axis].data() + at;
      if constexpr (kRead) {
        const Pack before = Pack::load(multiplier);
        change = change + before * Pack::load(scratch.multiplier_factor[direction].data() + at);
        if constexpr (kWrite) (before - change).store(multiplier);
      } else if constexpr (kWrite) {
        (Pack::all(Scalar(0)) - change).store(multiplier);
      }
      p = p - a.w * change;
      q = q + two_b * change;
      r = r - c.w * change;
    };
    correct(a.x, b.x, c.x, 0);
    correct(a.y, b.y, c.y, 1);
    correct(a.z, b.z, c.z, 2);
    a.store_points(first);
    b.store_points(middle);
    c.store_points(last);
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
