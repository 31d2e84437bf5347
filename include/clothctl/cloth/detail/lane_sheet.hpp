#pragma once

// A position-based sheet whose network is a grid: memory in lanes (lane_grid.hpp), and what a
// substep does to it. batch_sheet.hpp does the same for any network.

#include <array>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/detail/find_grid.hpp"
#include "clothctl/cloth/detail/lane_bends.hpp"
#include "clothctl/cloth/detail/lane_edges.hpp"
#include "clothctl/cloth/detail/lane_levels.hpp"
#include "clothctl/cloth/detail/mesh_parts.hpp"
#include "clothctl/cloth/detail/reserved_list.hpp"
#include "clothctl/cloth/detail/sweep_order.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A grid in lanes.
template <RealScalar S>
class LaneSheet {
 public:
  using Scalar = S;
  static constexpr int kLanes = grid_lanes<Scalar>();
  /// Distance of the coordinates of a vertex in the buffers.
  static constexpr std::size_t kStride = static_cast<std::size_t>(kLanes);
  using Pack = Simd<Scalar, kLanes>;
  using Block = LanePoints<Scalar>;

  /// Memory of a step.
  struct Scratch {
    /// Points and inverse masses; points at the start of the substep. With ghost rows.
    VectorX<Scalar> points, start;
    LaneEdgeScratch<Scalar> edges;
    LaneBendScratch<Scalar> bends;
    std::array<typename LaneLevels<Scalar>::Scratch, 2> levels;
    ReservedList<GridPlace> held;
    /// Runs the bands of the step at hand.
    ExecutorRef executor;
  };

  LaneSheet() = default;

  /// Lays out a network that `find_grid` has found to be `grid`. `limited`: with coarse levels for
  /// a limit of stretch, which need a grid that is `is_regular`. Allocates.
  LaneSheet(const SpringNetwork<Scalar>& network, const GridShape& grid, bool limited);

  Scratch make_scratch() const;
  bool fits(const Scratch& scratch) const;

  /// Where x of a vertex is in the buffers; w follows z.
  std::size_t offset(int vertex) const { return offset_[static_cast<std::size_t>(vertex)]; }
  bool damped() const { return damped_; }
  int vertex_count() const { return static_cast<int>(offset_.size()); }

  /// Computes the factors of a step of substep `h` (s) from the inverse masses in the points.
  /// `held`: vertices of inverse mass 0.
  void prepare(const Scalar& h, bool limited, const std::vector<int>& held, Scratch& scratch) const;

  /// p = x + keep (x - x_start) + push (3-vector, m) for vertices of positive inverse mass; x_start
  /// becomes x.
  void predict(const Scalar& keep, const Vector3<Scalar>& push, Scratch& scratch) const;

  /// Sweeps the springs once.
  template <class Rule>
  Rule sweep(const Rule& rule, SweepOrder order, Scratch& scratch) const {
    if constexpr (Rule::kNeedsStart) {
      // The rows below the strips, for the ghost row of `points`.
      read_ghost_row(layout_, layout_.whole(), scratch.start.data(),
                     scratch.start.data() + layout_.size());
    }
    return sweep_edges(edges_, scratch.edges, scratch.points.data(), scratch.start.data(), rule,
                       scratch.executor, order);
  }

  /// Does nothing: a grid has only springs that a limit of stretch applies to.
  void sweep_unlimited(Scratch&) const {}

  /// Does nothing: a grid in lanes has no triangle elements.
  void begin_triangles(Scratch&) const {}
  void sweep_triangles(const Scalar&, SweepOrder, Scratch&) const {}

  /// Sweeps the stencils once.
  template <bool kRead, bool kWrite>
  void bend(SweepOrder order, Scratch& scratch) const {
    if (!bends_.any) return;
    const auto sweep_band = [&](const ColumnBand& band, int) {
      LaneBendSweep<Scalar, kRead, kWrite> rule{scratch.bends};
      for_each_stencil(layout_, band, scratch.points.data(), rule, order);
    };
    for_each_band(layout_, scratch.executor, 2, sweep_band, order);
  }

  /// Corrects the sheet on its coarse levels as far as that adds no kinetic energy; `turn`
  /// alternates between two sets of levels.
  void correct_levels(int turn, int sweeps, const Scalar& slack, const PassiveFrame<Scalar>& frame,
                      Scratch& scratch) const {
    const std::size_t set = static_cast<std::size_t>(turn % 2);
    correct_passively(levels_[set], sweeps, slack, frame, scratch.points.data(),
                      scratch.start.data(), scratch.levels[set], scratch.executor);
  }

 private:
  void lay_out_edges(const SpringNetwork<Scalar>& network, const GridShape& grid);
  void lay_out_bends(const SpringNetwork<Scalar>& network, const GridShape& grid);
  Index entry(int row, int col) const {
    const std::size_t at = layout_.offset(row, col), block = LaneLayout<Scalar>::kBlock;
    return static_cast<Index>(at / block * kStride + at % block);
  }

  LaneLayout<Scalar> layout_;
  std::vector<std::size_t> offset_;
  std::vector<GridPlace> place_;
  /// Blocks of the rest positions and inverse masses.
  VectorX<Scalar> rest_;
  LaneEdges<Scalar> edges_;
  LaneBends<Scalar> bends_;
  /// The levels keep even columns, or odd ones: one set alone would not see the others.
  std::array<LaneLevels<Scalar>, 2> levels_;
  bool damped_ = false;
};

/// Returns how many coarse levels a grid gets: halved until the longer side is below 18; at least
/// one from a side of 10 on. Sweeps alone cannot carry a limit across more vertices.
inline int level_count(int rows, int cols) {
  int count = 0;
  for (int side = (std::max)(rows, cols); side >= (count == 0 ? 10 : 18); side = (side + 1) / 2)
    ++count;
  return count;
}

template <RealScalar Scalar>
LaneSheet<Scalar>::LaneSheet(const SpringNetwork<Scalar>& network, const GridShape& grid,
                             bool limited) {
  const int levels = limited ? level_count(grid.rows, grid.cols) : 0;
  const int unit = 1 << levels;
  int strip = unit;
  // Stencils need three rows; a row more than whole strips fits into the last one.
  while (strip < 3 || kLanes * strip + 1 < grid.rows) strip += unit;
  const int last = (std::min)((grid.rows - 1) / strip, kLanes - 1);
  layout_ = LaneLayout<Scalar>(grid.rows, grid.cols, strip, last);
  rest_.setZero(static_cast<Index>(layout_.buffer_size()));
  const int n = static_cast<int>(network.vertex_count());
  for (int v = 0; v < n; ++v) {
    const std::array<int, 2> place = grid.place(v);
    const std::size_t at = layout_.offset(place[0], place[1]);
    place_.push_back({place[0], place[1]});
    offset_.push_back(at);
    for (Index c = 0; c < 3; ++c)
      rest_[static_cast<Index>(at) + c * kLanes] = network.rest_positions(c, v);
    rest_[static_cast<Index>(at) + 3 * kLanes] = Scalar(1) / network.mass[v];
  }
  lay_out_edges(network, grid);
  lay_out_bends(network, grid);
  if constexpr (HasLevels<Scalar>) {
    for (std::size_t set = 0; levels > 0 && set < 2; ++set)
      levels_[set] = LaneLevels<Scalar>(edges_.layout, rest_, levels, set == 1);
  }
}

template <RealScalar Scalar>
void LaneSheet<Scalar>::lay_out_edges(const SpringNetwork<Scalar>& network, const GridShape& grid) {
  std::array<bool, kGridEdges> present{true, true, false, false};
  for (const GridSlot& slot : grid.springs) present[slot.kind] = true;
  edges_.resize(layout_, present);
  for (std::size_t e = 0; e < network.springs.size(); ++e) {
    const Spring<Scalar>& spring = network.springs[e];
    const GridSlot& slot = grid.springs[e];
    const Index at = entry(slot.row, slot.col);
    if (!(Scalar(0) < spring.stiffness) && !(Scalar(0) < spring.damping)) continue;
    edges_.rest.of[slot.kind][at] = spring.rest_length;
    edges_.relaxation.of[slot.kind][at] = Scalar(1);
    edges_.stiffness.of[slot.kind][at] = spring.stiffness;
    edges_.damping.of[slot.kind][at] = spring.damping;
    if (Scalar(0) < spring.damping) damped_ = true;
  }
}

template <RealScalar Scalar>
void LaneSheet<Scalar>::lay_out_bends(const SpringNetwork<Scalar>& network, const GridShape& grid) {
  bends_.layout = layout_;
  for (VectorX<Scalar>& list : bends_.stiffness)
    list.setZero(static_cast<Index>(layout_.size() / 4));
  for (std::size_t e = 0; e < network.bends.size(); ++e) {
    const GridSlot& slot = grid.bends[e];
    bends_.stiffness[slot.kind][entry(slot.row, slot.col)] = network.bends[e].stiffness;
    if (Scalar(0) < network.bends[e].stiffness) bends_.any = true;
  }
}

template <RealScalar Scalar>
auto LaneSheet<Scalar>::make_scratch() const -> Scratch {
  Scratch scratch;
  scratch.points = rest_;
  scratch.start = rest_;
  for (EdgeLanes<Scalar>* list :
       {&scratch.edges.weight, &scratch.edges.stiffness, &scratch.edges.damping,
        &scratch.edges.inverse, &scratch.edges.multiplier})
    list->resize(layout_, edges_.present);
  scratch.bends.resize(static_cast<Index>(bends_.any ? layout_.size() / 4 : 0));
  for (std::size_t set = 0; set < 2; ++set) scratch.levels[set] = levels_[set].make_scratch();
  scratch.held.reserve(offset_.size());
  return scratch;
}

template <RealScalar Scalar>
bool LaneSheet<Scalar>::fits(const Scratch& scratch) const {
  return scratch.points.size() == rest_.size() && scratch.start.size() == rest_.size() &&
         scratch.edges.weight.same_size(edges_.rest) &&
         scratch.edges.multiplier.same_size(edges_.rest) &&
         scratch.bends.error_factor[0].size() ==
             static_cast<Index>(bends_.any ? layout_.size() / 4 : 0) &&
         scratch.held.capacity() >= offset_.size() && levels_[0].fits(scratch.levels[0]) &&
         levels_[1].fits(scratch.levels[1]);
}

template <RealScalar Scalar>
void LaneSheet<Scalar>::prepare(const Scalar& h, bool limited, const std::vector<int>& held,
                                Scratch& scratch) const {
  prepare_edges(edges_, h, limited, scratch.points.data(), scratch.edges);
  if (bends_.any) {
    LaneBendPreparation<Scalar> rule{bends_, scratch.bends, h};
    for_each_stencil(layout_, layout_.whole(), scratch.points.data(), rule);
  }
  scratch.held.clear();
  for (int v : held) scratch.held.push_back(place_[static_cast<std::size_t>(v)]);
  for (std::size_t set = 0; set < 2; ++set) levels_[set].prepare(scratch.held, scratch.levels[set]);
}

template <RealScalar Scalar>
void LaneSheet<Scalar>::predict(const Scalar& keep, const Vector3<Scalar>& push,
                                Scratch& scratch) const {
  const Pack k = Pack::all(keep);
  const Pack px = Pack::all(push[0]), py = Pack::all(push[1]), pz = Pack::all(push[2]);
  constexpr std::size_t kBlock = LaneLayout<Scalar>::kBlock;
  const auto predict_range = [&](std::size_t begin, std::size_t end) {
    for (std::size_t at = begin * kBlock; at < end * kBlock; at += kBlock) {
      Block x = Block::load(scratch.points.data() + at);
      const Block before = Block::load(scratch.start.data() + at);
      x.store_points(scratch.start.data() + at);
      x.x = x.x + where_positive(x.w, k * (x.x - before.x) + px);
      x.y = x.y + where_positive(x.w, k * (x.y - before.y) + py);
      x.z = x.z + where_positive(x.w, k * (x.z - before.z) + pz);
      x.store_points(scratch.points.data() + at);
    }
  };
  for_each_range(layout_.size() / kBlock, scratch.executor, predict_range, kLanes);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
