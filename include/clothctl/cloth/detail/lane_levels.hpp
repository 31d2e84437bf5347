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
//   x += W D_1
//
// Held vertices move on no level. Nothing held: the rigid part of W D_1 (mass-weighted) is removed,
// since interpolation keeps neither momentum.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/detail/lane_edges.hpp"
#include "clothctl/cloth/detail/level_lines.hpp"
#include "clothctl/cloth/detail/rigid_motion.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// One coarse level: constants.
template <RealScalar Scalar>
struct LaneLevel {
  LevelLines rows{1, 1}, cols{1, 1};
  LaneEdges<Scalar> edges;
  /// Blocks of the rest positions and of the inverse masses.
  VectorX<Scalar> rest;
  /// For each local row of the next finer level and each lane, the weight of the second parent row;
  /// for each column of that level, its first parent and the weight of the second.
  VectorX<Scalar> row_weight;
  std::vector<LineParents<Scalar>> col_parents;
};

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

  /// Moves the fine vertices in `points` as above. `sweeps` a level; `slack`: part of its length by
  /// which an edge may stay too long.
  void correct(int sweeps, const Scalar& slack, Scalar* points, Scratch& scratch) const;

 private:
  void add_level(const VectorX<Scalar>& rest, const LevelLines& rows, const LevelLines& cols,
                 const std::vector<double>& mass, int spacing);
  static void add_edges(LaneLevel<Scalar>& level);

  void inject(std::size_t l, const Scalar* points, Scalar* level_points) const;
  void subtract_injection(std::size_t l, const Scalar* points, Scalar* level_points) const;
  /// Adds the interpolation of `coarse` (level l) to `fine` (level l - 1; the grid itself if l = 0)
  /// where the inverse mass is positive.
  void add_interpolation(std::size_t l, const LaneLayout<Scalar>& layout, Scalar* coarse,
                         Scalar* fine) const;
  void apply_tethers(std::size_t l, const Scalar& slack, const Scalar* points,
                     Scratch& scratch) const;
  void add_without_rigid_motion(Scalar* points, Scratch& scratch) const;

  /// Calls `visit(destination, source)` for each point of level l that comes from a fine point.
  template <class Visit>
  void for_each_injected(std::size_t l, Visit&& visit) const;

  LaneLayout<Scalar> layout_;
  /// Blocks of the grid at rest.
  VectorX<Scalar> rest_;
  std::vector<LaneLevel<Scalar>> levels_;
};

template <RealScalar Scalar>
LaneLevels<Scalar>::LaneLevels(const LaneLayout<Scalar>& layout, const VectorX<Scalar>& rest,
                               int count, bool shifted)
    : layout_(layout), rest_(rest) {
  LevelLines rows(layout_.rows, 1), cols(layout_.cols, 1);
  std::vector<double> mass(static_cast<std::size_t>(layout_.rows) *
                           static_cast<std::size_t>(layout_.cols));
  for (int row = 0; row < layout_.rows; ++row) {
    for (int col = 0; col < layout_.cols; ++col) {
      const std::size_t v = static_cast<std::size_t>(row * layout_.cols + col);
      const std::size_t at = layout_.offset(row, col) + 3 * kLanes;
      mass[v] = 1.0 / static_cast<double>(rest[static_cast<Index>(at)]);
    }
  }
  levels_.reserve(static_cast<std::size_t>(count));
  for (int l = 1; l <= count; ++l) {
    const LevelLines coarse_rows(layout_.rows, 1 << l),
        coarse_cols(layout_.cols, 1 << l, shifted ? 1 << (l - 1) : 0);
    std::vector<double> coarse_mass(
        static_cast<std::size_t>(coarse_rows.count() * coarse_cols.count()), 0.0);
    for (int row = 0; row < rows.count(); ++row) {
      const LineParents<double> r(rows, coarse_rows, row);
      for (int col = 0; col < cols.count(); ++col) {
        const LineParents<double> c(cols, coarse_cols, col);
        const double m = mass[static_cast<std::size_t>(row * cols.count() + col)];
        const auto give = [&](int i, int j, double share) {
          if (0.0 < share)
            coarse_mass[static_cast<std::size_t>(i * coarse_cols.count() + j)] += share * m;
        };
        give(r.first, c.first, (1.0 - r.second) * (1.0 - c.second));
        give(r.first, c.first + 1, (1.0 - r.second) * c.second);
        give(r.first + 1, c.first, r.second * (1.0 - c.second));
        give(r.first + 1, c.first + 1, r.second * c.second);
      }
    }
    add_level(rest, coarse_rows, coarse_cols, coarse_mass, 1 << l);
    LaneLevel<Scalar>& level = levels_.back();
    // The interpolation from this level to the finer one.
    const LaneLayout<Scalar>& fine =
        l == 1 ? layout_ : levels_[static_cast<std::size_t>(l) - 2].edges.layout;
    level.row_weight.setZero(static_cast<Index>(fine.local_rows) * kLanes);
    for (int row = 0; row < rows.count(); ++row) {
      const LineParents<double> parents(rows, coarse_rows, row);
      const int lane = fine.lane(row), local = fine.local_row(row);
      const int base = lane * level.edges.layout.strip + local / 2;
      level.row_weight[static_cast<Index>(local) * kLanes + lane] =
          Scalar(static_cast<double>(parents.first - base) + parents.second);
    }
    for (int col = 0; col < cols.count(); ++col)
      level.col_parents.emplace_back(cols, coarse_cols, col);
    rows = coarse_rows;
    cols = coarse_cols;
    mass = std::move(coarse_mass);
  }
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::add_level(const VectorX<Scalar>& rest, const LevelLines& rows,
                                   const LevelLines& cols, const std::vector<double>& mass,
                                   int spacing) {
  LaneLevel<Scalar>& level = levels_.emplace_back();
  level.rows = rows;
  level.cols = cols;
  level.edges.resize({rows.count(), cols.count(), layout_.strip / spacing, layout_.last_lane},
                     {true, true, true, true});
  const LaneLayout<Scalar>& layout = level.edges.layout;
  level.rest.setZero(static_cast<Index>(layout.buffer_size()));
  for (int row = 0; row < rows.count(); ++row) {
    for (int col = 0; col < cols.count(); ++col) {
      const Index to = static_cast<Index>(layout.offset(row, col));
      const Index from = static_cast<Index>(layout_.offset(
          rows.fine[static_cast<std::size_t>(row)], cols.fine[static_cast<std::size_t>(col)]));
      for (Index c = 0; c < 3; ++c) level.rest[to + c * kLanes] = rest[from + c * kLanes];
      level.rest[to + 3 * kLanes] =
          Scalar(1.0 / mass[static_cast<std::size_t>(row * cols.count() + col)]);
    }
  }
  add_edges(level);
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::add_edges(LaneLevel<Scalar>& level) {
  const LaneLayout<Scalar>& layout = level.edges.layout;
  const auto add = [&](std::size_t kind, int row, int col, std::size_t a, std::size_t b) {
    double squared = 0.0;
    for (std::size_t c = 0; c < 3; ++c) {
      const double d = static_cast<double>(level.rest[static_cast<Index>(b + c * kLanes)]) -
                       static_cast<double>(level.rest[static_cast<Index>(a + c * kLanes)]);
      squared += d * d;
    }
    const std::size_t at = layout.offset(row, col);
    const Index entry = static_cast<Index>(at / kBlock * kLanes + at % kBlock);
    level.edges.rest.of[kind][entry] = Scalar(std::sqrt(squared));
    level.edges.relaxation.of[kind][entry] = Scalar(1);
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
  while (scratch.tether_count < std::min(kTethers, held.size())) {
    GridPlace best = held.front();
    int best_distance = -1;
    for (const GridPlace& place : held) {
      int nearest = 1 << 30;
      for (std::size_t i = 0; i < scratch.tether_count; ++i) {
        const int dr = place.row - scratch.tethered[i].row,
                  dc = place.col - scratch.tethered[i].col;
        nearest = std::min(nearest, dr * dr + dc * dc);
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
template <class Visit>
void LaneLevels<Scalar>::for_each_injected(std::size_t l, Visit&& visit) const {
  const LaneLevel<Scalar>& level = levels_[l];
  const LaneLayout<Scalar>& layout = level.edges.layout;
  const int spacing = 1 << (l + 1);
  const std::size_t fine_row = layout_.row_size(), row = layout.row_size();
  const std::size_t cols = static_cast<std::size_t>(layout.cols);
  for (int j = 0; j < layout.strip; ++j) {
    const std::size_t from = static_cast<std::size_t>(j * spacing) * fine_row;
    const std::size_t to = static_cast<std::size_t>(j) * row;
    for (std::size_t c = 0; c < cols; ++c)
      visit(to + c * kBlock, from + static_cast<std::size_t>(level.cols.fine[c]) * kBlock);
  }
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::inject(std::size_t l, const Scalar* points, Scalar* level_points) const {
  for_each_injected(l, [&](std::size_t to, std::size_t from) CLOTHCTL_KERNEL_LAMBDA {
    Block::load(points + from).store_points(level_points + to);
  });
  // The last row, which need not be a multiple of the spacing.
  const LaneLayout<Scalar>& layout = levels_[l].edges.layout;
  for (int col = 0; col < layout.cols; ++col) {
    const std::size_t to = layout.offset(layout.rows - 1, col);
    const std::size_t from =
        layout_.offset(layout_.rows - 1, levels_[l].cols.fine[static_cast<std::size_t>(col)]);
    for (std::size_t c = 0; c < 3; ++c) level_points[to + c * kLanes] = points[from + c * kLanes];
  }
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::subtract_injection(std::size_t l, const Scalar* points,
                                            Scalar* level_points) const {
  const LaneLayout<Scalar>& layout = levels_[l].edges.layout;
  // The last row first, with its values kept from the loop over all rows.
  for (int col = 0; col < layout.cols; ++col) {
    const std::size_t to = layout.offset(layout.rows - 1, col);
    const std::size_t from =
        layout_.offset(layout_.rows - 1, levels_[l].cols.fine[static_cast<std::size_t>(col)]);
    const int local = layout.local_row(layout.rows - 1);
    const bool regular = local < layout.strip;
    const std::size_t lane = static_cast<std::size_t>(layout_.last_lane);
    const int spacing = 1 << (l + 1);
    for (std::size_t c = 0; c < 3; ++c) {
      Scalar subtract = points[from + c * kLanes];
      if (regular) {
        const std::size_t block =
            layout_.block(local * spacing, levels_[l].cols.fine[static_cast<std::size_t>(col)]);
        subtract = subtract - points[block * kBlock + c * kLanes + lane];
      }
      level_points[to + c * kLanes] = level_points[to + c * kLanes] - subtract;
    }
  }
  for_each_injected(l, [&](std::size_t to, std::size_t from) CLOTHCTL_KERNEL_LAMBDA {
    Block y = Block::load(level_points + to);
    const Block b = Block::load(points + from);
    y.x = y.x - b.x;
    y.y = y.y - b.y;
    y.z = y.z - b.z;
    y.store_points(level_points + to);
  });
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::add_interpolation(std::size_t l, const LaneLayout<Scalar>& layout,
                                           Scalar* coarse, Scalar* fine) const {
  const LaneLevel<Scalar>& level = levels_[l];
  const LaneLayout<Scalar>& from = level.edges.layout;
  Scalar* ghost = coarse + from.size();
  read_ghost_row(from, coarse, ghost);
  const std::size_t row = from.row_size();
  for (int local = 0; local < layout.local_rows; ++local) {
    const int j = local / 2;
    const Scalar* first = coarse + static_cast<std::size_t>(j) * row;
    const Scalar* second = j + 1 < from.strip ? first + row : (j < from.strip ? ghost : first);
    const Pack w1 = Pack::load(level.row_weight.data() + local * kLanes);
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
      const LineParents<Scalar>& parents = level.col_parents[c];
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
void LaneLevels<Scalar>::correct(int sweeps, const Scalar& slack, Scalar* points,
                                 Scratch& scratch) const {
  if (levels_.empty()) return;
  for (std::size_t l = levels_.size(); l-- > 0;) {
    const LaneLevel<Scalar>& level = levels_[l];
    LaneLevelScratch<Scalar>& memory = scratch.levels[l];
    inject(l, points, memory.points.data());
    if (l + 1 < levels_.size()) {
      add_interpolation(l + 1, level.edges.layout, scratch.levels[l + 1].points.data(),
                        memory.points.data());
    }
    apply_tethers(l, slack, points, scratch);
    TensionRule<Scalar, kLanes> rule{Pack::all(slack), Pack::all(Scalar(1.7))};
    for (int sweep = 0; sweep < sweeps; ++sweep)
      rule =
          sweep_edges(level.edges, memory.edges, memory.points.data(), memory.points.data(), rule);
    subtract_injection(l, points, memory.points.data());
  }
  if (scratch.anything_held) {
    add_interpolation(0, layout_, scratch.levels[0].points.data(), points);
  } else {
    add_without_rigid_motion(points, scratch);
  }
}

template <RealScalar Scalar>
void LaneLevels<Scalar>::add_without_rigid_motion(Scalar* points, Scratch& scratch) const {
  const std::size_t size = layout_.size();
  const Pack zero = Pack::all(Scalar(0)), one = Pack::all(Scalar(1));
  Scalar* moved = scratch.displacement.data();
  for (std::size_t at = 0; at < size; at += kBlock) {
    const Block p = Block::load(points + at);
    Block{zero, zero, zero, zero}.store_points(moved + at);
    p.w.store(moved + at + 3 * kLanes);
  }
  add_interpolation(0, layout_, scratch.levels[0].points.data(), moved);

  const auto mass_of = [&](const Pack& w) CLOTHCTL_KERNEL_LAMBDA {
    return where_positive(w, one / larger(w, Pack::all(Scalar(1e-30))));
  };
  FirstMoments<Pack> first(zero);
  for (std::size_t at = 0; at < size; at += kBlock) {
    const Block x = Block::load(points + at);
    first.add(mass_of(x.w), x, Block::load(moved + at));
  }
  const Scalar per_mass = Scalar(1) / first.mass.sum();
  const auto mean = [&](const Pack& sum) { return Pack::all(sum.sum() * per_mass); };
  const Pack cx = mean(first.x), cy = mean(first.y), cz = mean(first.z);
  const Pack ux = mean(first.px), uy = mean(first.py), uz = mean(first.pz);
  SecondMoments<Pack> second(zero);
  for (std::size_t at = 0; at < size; at += kBlock) {
    const Block x = Block::load(points + at);
    second.add(mass_of(x.w), x.x - cx, x.y - cy, x.z - cz, Block::load(moved + at));
  }
  const Vector3<Scalar> turn = angular_displacement<Scalar>(second);
  const Pack ox = Pack::all(turn[0]), oy = Pack::all(turn[1]), oz = Pack::all(turn[2]);
  for (std::size_t at = 0; at < size; at += kBlock) {
    Block x = Block::load(points + at);
    const Block d = Block::load(moved + at);
    const Pack rx = x.x - cx, ry = x.y - cy, rz = x.z - cz;
    x.x = x.x + where_positive(x.w, d.x - (ux + oy * rz - oz * ry));
    x.y = x.y + where_positive(x.w, d.y - (uy + oz * rx - ox * rz));
    x.z = x.z + where_positive(x.w, d.z - (uz + ox * ry - oy * rx));
    x.store_points(points + at);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
