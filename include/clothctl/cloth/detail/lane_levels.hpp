#pragma once

// Coarse levels of a grid, which carry a limit of stretch across the sheet.
//
// Level l has the rows 0, 2^l, 2·2^l, … and the last row, and columns likewise. A coarse edge is as
// long as the fine path that it replaces, so it is one-sided: any motion of the fine sheet within
// its lengths obeys it. Fold and bend stay free. One visit of an edge of length 2^l h has the
// effect of 4^l visits on the fine grid, at 4^-l of the cost.
//
// With the injection Y_l of the fine positions x and linear interpolation W (weights sum to one and
// reproduce positions at rest), `correct` does
//
//   for l = coarsest … 1:
//     Y_l ← x at level l,  B_l = Y_l
//     Y_l += W D_{l+1}
//     tethers: |Y_i - x_q| ≤ rest distance, for held vertices q
//     several sweeps of one-sided edges over Y_l
//     D_l = Y_l - B_l
//
// `add` moves the fine vertices by a share of W D_1 (passive_share.hpp). Held vertices move on no
// level. Nothing held: the rigid part of W D_1 (mass-weighted) is removed, since interpolation
// keeps neither momentum.

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/lane_level.hpp"
#include "clothctl/cloth/detail/passive_share.hpp"
#include "clothctl/cloth/detail/rigid_motion.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// One coarse level: memory of a step.
template <RealScalar Scalar>
struct LaneLevelScratch {
  LaneEdgeScratch<Scalar> edges;
  /// Y, then D.
  VectorX<Scalar> points;
  /// Lengths of the tethers, m: an array of blocks / 4 for each held vertex in use.
  std::vector<VectorX<Scalar>> tether;
};

/// A vertex of the grid by its row and column.
struct GridPlace {
  int row = 0, col = 0;
};

/// The levels of a grid.
template <RealScalar Scalar>
class LaneLevels {
 public:
  static constexpr int kLanes = grid_lanes<Scalar>();
  static constexpr std::size_t kBlock = LaneLayout<Scalar>::kBlock;
  /// More held vertices than this share tethers: those farthest from each other have them.
  static constexpr std::size_t kTethers = 4;
  using Pack = Simd<Scalar, kLanes>;
  using Block = LanePoints<Scalar>;

  /// Memory of a step.
  struct Scratch {
    std::vector<LaneLevelScratch<Scalar>> levels;
    /// Held vertices that have tethers.
    std::array<GridPlace, kTethers> tethered;
    std::size_t tether_count = 0;
    bool anything_held = false;
    /// W D_1.
    VectorX<Scalar> displacement;
  };

  LaneLevels() = default;

  /// Makes `count` levels over a grid. `rest` has the blocks of the rest positions with the inverse
  /// masses; at rest the sheet is flat and its cells are equal. `shifted`: the levels keep the
  /// first column and then those halfway between the usual ones. Allocates.
  LaneLevels(const LaneLayout<Scalar>& layout, const VectorX<Scalar>& rest, int count,
             bool shifted);

  int count() const { return static_cast<int>(levels_.size()); }
  Scratch make_scratch() const;
  bool fits(const Scratch& scratch) const;

  /// Takes the held vertices of a step.
  void prepare(const std::vector<GridPlace>& held, Scratch& scratch) const;

  /// Computes W D_1 for the fine vertices in `points`. `sweeps` a level; `slack`: part of its
  /// length by which an edge may stay too long.
  void correct(int sweeps, const Scalar& slack, const Scalar* points, Scratch& scratch,
               const ExecutorRef& executor = {}) const;
  /// Returns the share of W D_1 that adds no kinetic energy but the gift to the substep that began
  /// at `start`.
  Scalar share(const PassiveFrame<Scalar>& frame, const Scalar* points, const Scalar* start,
               const Scratch& scratch) const;
  /// Moves the vertices in `points` by a share of W D_1.
  void add(const Scalar& share, Scalar* points, const Scratch& scratch) const;

 private:
  void apply_tethers(std::size_t l, const Scalar& slack, const Scalar* points,
                     Scratch& scratch) const;
  static Pack mass_of(const Pack& w) {
    const Pack one = Pack::all(Scalar(1));
    return where_positive(w, one / larger(w, Pack::all(Scalar(1e-30))));
  }
  void remove_rigid_motion(const Scalar* points, Scratch& scratch) const;

  LaneLayout<Scalar> layout_;
  /// Blocks of the grid at rest.
  VectorX<Scalar> rest_;
  std::vector<LaneLevel<Scalar>> levels_;
};

template <RealScalar Scalar>
LaneLevels<Scalar>::LaneLevels(const LaneLayout<Scalar>& layout, const VectorX<Scalar>& rest,
                               int count, bool shifted)
    : layout_(layout), rest_(rest) {
  LevelVertices finer{{layout.rows, 1}, {layout.cols, 1}, {}};
  for (int row = 0; row < layout.rows; ++row) {
    for (int col = 0; col < layout.cols; ++col) {
      const std::size_t at = layout.offset(row, col) + 3 * kLanes;
      finer.mass.push_back(1.0 / static_cast<double>(rest[static_cast<Index>(at)]));
    }
  }
  LaneLayout<Scalar> finer_layout = layout;
  levels_.reserve(static_cast<std::size_t>(count));
  for (int l = 1; l <= count; ++l) {
    const int spacing = 1 << l;
    LevelVertices vertices = LevelVertices::below(
        finer, {layout.rows, spacing}, {layout.cols, spacing, shifted ? spacing / 2 : 0});
    levels_.emplace_back(layout, rest, spacing, vertices, finer, finer_layout);
    finer_layout = levels_.back().edges.layout;
    finer = std::move(vertices);
  }
}

template <RealScalar Scalar>
auto LaneLevels<Scalar>::make_scratch() const -> Scratch {
  Scratch scratch;
  for (const LaneLevel<Scalar>& level : levels_) {
    LaneLevelScratch<Scalar>& memory = scratch.levels.emplace_back();
    const LaneLayout<Scalar>& layout = level.edges.layout;
    for (EdgeLanes<Scalar>* list : {&memory.edges.weight, &memory.edges.stiffness,
                                    &memory.edges.damping, &memory.edges.inverse})
      list->resize(layout, level.edges.present);
    memory.points = level.rest;
    memory.tether.assign(kTethers, VectorX<Scalar>::Zero(static_cast<Index>(layout.size() / 4)));
  }
  scratch.displacement.setZero(static_cast<Index>(layout_.buffer_size()));
  return scratch;
}

template <RealScalar Scalar>
bool LaneLevels<Scalar>::fits(const Scratch& scratch) const {
  bool good = scratch.levels.size() == levels_.size();
  for (std::size_t l = 0; good && l < levels_.size(); ++l)
    good = scratch.levels[l].points.size() == levels_[l].rest.size();
  return good && scratch.displacement.size() == static_cast<Index>(layout_.buffer_size());
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::prepare(const std::vector<GridPlace>& held, Scratch& scratch) const {
  scratch.anything_held = !held.empty();
  scratch.tether_count = 0;
  // Farthest first: each tethered vertex is the one farthest from those before it.
  while (scratch.tether_count < (std::min)(kTethers, held.size())) {
    GridPlace best = held.front();
    int best_distance = -1;
    for (const GridPlace& place : held) {
      int nearest = 1 << 30;
      for (std::size_t i = 0; i < scratch.tether_count; ++i) {
        const int dr = place.row - scratch.tethered[i].row,
                  dc = place.col - scratch.tethered[i].col;
        nearest = (std::min)(nearest, dr * dr + dc * dc);
      }
      if (best_distance < nearest) {
        best_distance = nearest;
        best = place;
      }
    }
    scratch.tethered[scratch.tether_count++] = best;
  }
  for (std::size_t l = 0; l < levels_.size(); ++l) {
    const LaneLevel<Scalar>& level = levels_[l];
    LaneLevelScratch<Scalar>& memory = scratch.levels[l];
    const LaneLayout<Scalar>& layout = level.edges.layout;
    memory.points = level.rest;
    for (const GridPlace& place : held) {
      const std::size_t at =
          layout.offset(level.rows.nearest(place.row), level.cols.nearest(place.col));
      memory.points[static_cast<Index>(at) + 3 * kLanes] = Scalar(0);
    }
    prepare_edges(level.edges, Scalar(1), true, memory.points.data(), memory.edges);
    for (std::size_t i = 0; i < scratch.tether_count; ++i) {
      // The distance at rest from the held vertex itself, which need not be on this level.
      const GridPlace& place = scratch.tethered[i];
      const Index at = static_cast<Index>(layout_.offset(place.row, place.col));
      const Pack qx = Pack::all(rest_[at]), qy = Pack::all(rest_[at + kLanes]),
                 qz = Pack::all(rest_[at + 2 * kLanes]);
      Scalar* length = memory.tether[i].data();
      for (std::size_t block = 0; block * kBlock < layout.size(); ++block) {
        const Block p = Block::load(level.rest.data() + block * kBlock);
        const Pack dx = p.x - qx, dy = p.y - qy, dz = p.z - qz;
        const Pack squared = dx * dx + dy * dy + dz * dz;
        (squared * reciprocal_sqrt(squared)).store(length + block * kLanes);
      }
    }
  }
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::apply_tethers(std::size_t l, const Scalar& slack, const Scalar* points,
                                       Scratch& scratch) const {
  LaneLevelScratch<Scalar>& memory = scratch.levels[l];
  const std::size_t size = levels_[l].edges.layout.size();
  for (std::size_t i = 0; i < scratch.tether_count; ++i) {
    const GridPlace& place = scratch.tethered[i];
    const Scalar* q = points + layout_.offset(place.row, place.col);
    const Pack qx = Pack::all(q[0]), qy = Pack::all(q[kLanes]), qz = Pack::all(q[2 * kLanes]);
    const Scalar* length = memory.tether[i].data();
    for (std::size_t at = 0; at < size; at += kBlock) {
      Block p = Block::load(memory.points.data() + at);
      const Pack dx = qx - p.x, dy = qy - p.y, dz = qz - p.z;
      const Pack r = reciprocal_sqrt(dx * dx + dy * dy + dz * dz);
      const Pack e = Pack::all(Scalar(1) - slack) - Pack::load(length + at / 4) * r;
      const Pack s = where_positive(p.w, larger(e, Pack::all(Scalar(0))));
      p.x = p.x + s * dx;
      p.y = p.y + s * dy;
      p.z = p.z + s * dz;
      p.store_points(memory.points.data() + at);
    }
  }
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::correct(int sweeps, const Scalar& slack, const Scalar* points,
                                 Scratch& scratch, const ExecutorRef& executor) const {
  if (levels_.empty()) return;
  for (std::size_t l = levels_.size(); l-- > 0;) {
    const LaneLevel<Scalar>& level = levels_[l];
    LaneLevelScratch<Scalar>& memory = scratch.levels[l];
    level.inject(layout_, points, memory.points.data());
    if (l + 1 < levels_.size()) {
      levels_[l + 1].add_interpolation(level.edges.layout, scratch.levels[l + 1].points.data(),
                                       memory.points.data());
    }
    apply_tethers(l, slack, points, scratch);
    auto rule = TensionRule<Scalar, kLanes>::over_relaxed(slack);
    for (int sweep = 0; sweep < sweeps; ++sweep)
      rule = sweep_edges(level.edges, memory.edges, memory.points.data(), memory.points.data(),
                         rule, executor);
    level.subtract_injection(layout_, points, memory.points.data());
  }
  const std::size_t size = layout_.size();
  const Pack zero = Pack::all(Scalar(0));
  Scalar* moved = scratch.displacement.data();
  for (std::size_t at = 0; at < size; at += kBlock) {
    const Block p = Block::load(points + at);
    Block{zero, zero, zero, zero}.store_points(moved + at);
    p.w.store(moved + at + 3 * kLanes);
  }
  levels_[0].add_interpolation(layout_, scratch.levels[0].points.data(), moved);
  if (!scratch.anything_held) remove_rigid_motion(points, scratch);
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::remove_rigid_motion(const Scalar* points, Scratch& scratch) const {
  const std::size_t size = layout_.size();
  Scalar* moved = scratch.displacement.data();
  const auto rigid = closest_rigid_displacement<Scalar, Pack>([&](auto&& visit) {
    for (std::size_t at = 0; at < size; at += kBlock) {
      const Block x = Block::load(points + at);
      visit(mass_of(x.w), x, Block::load(moved + at));
    }
  });
  for (std::size_t at = 0; at < size; at += kBlock)
    rigid.removed_from(Block::load(moved + at), Block::load(points + at)).store_points(moved + at);
}

template <RealScalar Scalar>
Scalar LaneLevels<Scalar>::share(const PassiveFrame<Scalar>& frame, const Scalar* points,
                                 const Scalar* start, const Scratch& scratch) const {
  const Scalar* moved = scratch.displacement.data();
  const Pack mx = Pack::all(frame.mean.x), my = Pack::all(frame.mean.y),
             mz = Pack::all(frame.mean.z);
  PassiveSums<Pack> sums(Pack::all(Scalar(0)));
  for (std::size_t at = 0; at < layout_.size() && !levels_.empty(); at += kBlock) {
    const Block x = Block::load(points + at), before = Block::load(start + at),
                d = Block::load(moved + at);
    sums.add(mass_of(d.w), x.x - before.x - mx, x.y - before.y - my, x.z - before.z - mz, d);
  }
  return passive_share(sums, frame.gift);
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::add(const Scalar& share, Scalar* points, const Scratch& scratch) const {
  const Scalar* moved = scratch.displacement.data();
  const Pack s = Pack::all(share);
  for (std::size_t at = 0; at < layout_.size() && !levels_.empty(); at += kBlock) {
    Block x = Block::load(points + at);
    const Block d = Block::load(moved + at);
    x.x = x.x + where_positive(d.w, s * d.x);
    x.y = x.y + where_positive(d.w, s * d.y);
    x.z = x.z + where_positive(d.w, s * d.z);
    x.store_points(points + at);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
