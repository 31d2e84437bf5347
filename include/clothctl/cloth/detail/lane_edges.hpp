#pragma once

// The edges of a grid in lanes: their constants, the numbers that depend on the step, and sweeps
// with any rule of edge_rules.hpp. lane_grid.hpp describes the layout.

#include <array>
#include <cstddef>

#include "clothctl/cloth/detail/edge_rules.hpp"
#include "clothctl/cloth/detail/lane_grid.hpp"
#include "clothctl/cloth/detail/sweep_order.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Rest length of the entries that hold no edge: so long that they never look stretched.
template <RealScalar Scalar>
Scalar absent_length() {
  return Scalar(1e15);
}

/// Constants of the edges of a grid.
template <RealScalar Scalar>
struct LaneEdges {
  LaneLayout<Scalar> layout;
  /// Which kinds of edges there are.
  std::array<bool, kGridEdges> present{};
  /// Rest length l0 (m), relaxation r (0 where there is no edge), spring k (N/m), damper c (N s/m).
  EdgeLanes<Scalar> rest, relaxation, stiffness, damping;

  /// Makes entries without edges. Allocates.
  void resize(const LaneLayout<Scalar>& where, const std::array<bool, kGridEdges>& kinds) {
    layout = where;
    present = kinds;
    for (EdgeLanes<Scalar>* list : {&rest, &relaxation, &stiffness, &damping})
      list->resize(layout, present);
    for (auto& lengths : rest.of) lengths.setConstant(absent_length<Scalar>());
  }
};

/// Numbers of the edges during a step.
template <RealScalar Scalar>
struct LaneEdgeScratch {
  EdgeLanes<Scalar> weight, stiffness, damping, inverse, multiplier;
};

/// One sweep with a rule: the functor that sweep_grid calls.
template <RealScalar Scalar, class Rule>
struct LaneSweep {
  static constexpr int kLanes = grid_lanes<Scalar>();
  using Pack = Simd<Scalar, kLanes>;
  using Block = LanePoints<Scalar>;

  Rule rule;
  std::array<EdgeData<Scalar>, kGridEdges> data;
  /// The buffer that is swept and that of the positions at the start of the substep.
  const Scalar* points;
  const Scalar* start;
  Pack mask = Pack::all(Scalar(1));
  bool masked = false;

  /// From now on only the even (0) or odd (1) lanes move.
  void only_lanes(std::size_t parity) {
    Scalar share[kLanes];
    for (std::size_t lane = 0; lane < kLanes; ++lane)
      share[lane] = lane % 2 == parity ? Scalar(1) : Scalar(0);
    mask = Pack::load(share);
    masked = true;
  }
  void all_lanes() { masked = false; }

  template <std::size_t kind>
  CLOTHCTL_KERNEL void edge(std::size_t at, Scalar* first, Scalar* second) {
    Block a = Block::load(first), b = Block::load(second);
    const Pack dx = b.x - a.x, dy = b.y - a.y, dz = b.z - a.z;
    const auto along = [&]() CLOTHCTL_KERNEL_LAMBDA {
      const Block a0 = Block::load(start + (first - points));
      const Block b0 = Block::load(start + (second - points));
      return dx * (b0.x - a0.x) + dy * (b0.y - a0.y) + dz * (b0.z - a0.z);
    };
    Pack s = rule.scale(data[kind], at, dx * dx + dy * dy + dz * dz, along);
    if (masked) s = s * mask;
    const Pack of_a = s * a.w, of_b = s * b.w;
    a.x = a.x + of_a * dx;
    a.y = a.y + of_a * dy;
    a.z = a.z + of_a * dz;
    b.x = b.x - of_b * dx;
    b.y = b.y - of_b * dy;
    b.z = b.z - of_b * dz;
    a.store_points(first);
    b.store_points(second);
  }
};

/// Computes the weights of a step from the inverse masses in the blocks: see edge_rules.hpp.
template <RealScalar Scalar>
struct LanePreparation {
  static constexpr int kLanes = grid_lanes<Scalar>();
  using Pack = Simd<Scalar, kLanes>;

  const LaneEdges<Scalar>& edges;
  LaneEdgeScratch<Scalar>& scratch;
  /// Substep, s.
  Scalar h;
  /// True for LimitRule: `stiffness` becomes σ instead of h² k.
  bool limited;

  void only_lanes(std::size_t) {}
  void all_lanes() {}

  template <std::size_t kind>
  CLOTHCTL_KERNEL void edge(std::size_t at, const Scalar* first, const Scalar* second) {
    const Pack one = Pack::all(Scalar(1));
    const Pack w = Pack::load(first + 3 * kLanes) + Pack::load(second + 3 * kLanes);
    const Pack k = Pack::all(h * h) * Pack::load(edges.stiffness.of[kind].data() + at);
    const Pack c = Pack::all(h) * Pack::load(edges.damping.of[kind].data() + at);
    const Pack relaxation = Pack::load(edges.relaxation.of[kind].data() + at);
    const Pack weight = where_positive(w, relaxation / larger(w, Pack::all(Scalar(1e-30))));
    weight.store(scratch.weight.of[kind].data() + at);
    const Pack share = k * w;
    (limited ? share / (share + one) : k).store(scratch.stiffness.of[kind].data() + at);
    c.store(scratch.damping.of[kind].data() + at);
    (one / ((k + c) * w + one)).store(scratch.inverse.of[kind].data() + at);
  }
};

/// Sweeps the edges once with `rule` and returns the rule as it is then. `points` and `start` are
/// buffers of `layout.buffer_size()`; the second is read only by rules with dampers.
template <RealScalar Scalar, class Rule>
Rule sweep_edges(const LaneEdges<Scalar>& edges, LaneEdgeScratch<Scalar>& scratch, Scalar* points,
                 const Scalar* start, const Rule& rule, const ExecutorRef& executor = {},
                 SweepOrder order = SweepOrder::Forward) {
  const LaneLayout<Scalar>& layout = edges.layout;
  LaneSweep<Scalar, Rule> begin{rule, {}, points, start};
  for (std::size_t kind = 0; kind < kGridEdges; ++kind) {
    begin.data[kind] = {edges.rest.of[kind].data(),        scratch.weight.of[kind].data(),
                        scratch.stiffness.of[kind].data(), scratch.damping.of[kind].data(),
                        scratch.inverse.of[kind].data(),   scratch.multiplier.of[kind].data()};
  }
  if (layout.band_count() == 1) {
    sweep_grid(layout, edges.present, layout.whole(), points, points + layout.size(), begin, order);
    return begin.rule;
  }
  std::array<Rule, 2 * LaneLayout<Scalar>::kMostBands> found;
  const auto sweep_band = [&](const ColumnBand& band, int i) {
    LaneSweep<Scalar, Rule> sweep = begin;
    sweep_grid(layout, edges.present, band, points, points + layout.size(), sweep, order);
    found[static_cast<std::size_t>(i)] = sweep.rule;
  };
  for_each_band(layout, executor, 1, sweep_band, order);
  for (int i = 1; i < 2 * layout.band_count() - 1; ++i)
    found[0].join(found[static_cast<std::size_t>(i)]);
  return found[0];
}

/// Computes the weights of a step of substep `h` from the inverse masses in `points`.
template <RealScalar Scalar>
void prepare_edges(const LaneEdges<Scalar>& edges, const Scalar& h, bool limited, Scalar* points,
                   LaneEdgeScratch<Scalar>& scratch) {
  LanePreparation<Scalar> preparation{edges, scratch, h, limited};
  sweep_grid(edges.layout, edges.present, edges.layout.whole(), points,
             points + edges.layout.size(), preparation);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
