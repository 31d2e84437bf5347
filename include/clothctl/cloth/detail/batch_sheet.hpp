#pragma once

// A position-based sheet of any network: vertices x, y, z, w side by side, constraints in batches
// (edge_batches.hpp), and what a substep does to it. lane_sheet.hpp does the same for grids.

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "clothctl/cloth/detail/batch_levels.hpp"
#include "clothctl/cloth/detail/bend_batches.hpp"
#include "clothctl/cloth/detail/edge_batches.hpp"
#include "clothctl/cloth/detail/find_grid.hpp"
#include "clothctl/cloth/detail/mesh_parts.hpp"
#include "clothctl/cloth/detail/sweep_order.hpp"
#include "clothctl/cloth/detail/triangle_constraints.hpp"
#include "clothctl/mesh/topology.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// How a sheet in batches is made.
template <RealScalar Scalar>
struct BatchSheetSetup {
  /// True for rigid springs with these relaxations (empty: 1).
  bool rigid = false;
  std::vector<Scalar> relaxation;
  Scalar bend_relaxation = Scalar(1);
  /// True to correct constraints that share a vertex in the order of the network.
  bool listed_order = false;
  /// With coarse levels for a limit of stretch.
  bool limited = false;
  /// Vertices that have tethers on the levels.
  std::vector<int> tethered;
};

/// A network in batches.
template <RealScalar S>
class BatchSheet {
 public:
  using Scalar = S;
  static constexpr int kLanes = batch_lanes<Scalar>();
  /// Distance of the coordinates of a vertex in the buffers.
  static constexpr std::size_t kStride = 1;
  using Pack = Simd<Scalar, kLanes>;

  /// Memory of a step.
  struct Scratch {
    /// Points and inverse masses; points at the start of the substep. Two spare vertices at the
    /// end.
    VectorX<Scalar> points, start;
    EdgeBatchScratch<Scalar> edges, unlimited;
    BendScratch<Scalar> bends;
    std::array<typename BatchLevels<Scalar>::Scratch, 2> levels;
    std::vector<TriangleMultipliers<Scalar>> triangles;
    /// Runs the parts of the step at hand.
    ExecutorRef executor;
  };

  BatchSheet() = default;

  /// Packs a valid network. Allocates.
  BatchSheet(const SpringNetwork<Scalar>& network, const BatchSheetSetup<Scalar>& setup);

  Scratch make_scratch() const;
  bool fits(const Scratch& scratch) const;

  /// Where x of a vertex is in the buffers; y, z and w follow.
  std::size_t offset(int vertex) const { return 4 * static_cast<std::size_t>(vertex); }
  bool damped() const { return damped_; }
  int vertex_count() const { return static_cast<int>(initial_.size() / 4) - 2; }

  /// As LaneSheet::prepare.
  void prepare(const Scalar& h, bool limited, const std::vector<int>& held, Scratch& scratch) const;
  /// As LaneSheet::predict.
  void predict(const Scalar& keep, const Vector3<Scalar>& push, Scratch& scratch) const;

  /// Sweeps the springs once.
  template <class Rule>
  Rule sweep(const Rule& rule, SweepOrder order, Scratch& scratch) const {
    return sweep_edges(edges_, scratch.edges, scratch.points.data(), scratch.start.data(), rule,
                       scratch.executor, order);
  }

  /// Sweeps the springs that no limit of stretch applies to.
  void sweep_unlimited(Scratch& scratch) const {
    sweep_edges(unlimited_, scratch.unlimited, scratch.points.data(), scratch.start.data(),
                CompliantRule<Scalar, kLanes, false, false, false>{}, scratch.executor);
  }

  /// Sweeps the stencils once.
  template <bool kRead, bool kWrite>
  void bend(SweepOrder order, Scratch& scratch) const {
    sweep_bends<kRead, kWrite>(bends_, scratch.bends, scratch.points.data(), scratch.executor,
                               order);
  }

  /// Begins a substep of the triangle elements.
  void begin_triangles(Scratch& scratch) const {
    std::fill(scratch.triangles.begin(), scratch.triangles.end(), no_multipliers());
  }
  /// Sweeps the triangle elements once; `h`: substep, s.
  void sweep_triangles(const Scalar& h, SweepOrder order, Scratch& scratch) const {
    const auto sweep_group = [&](std::size_t, std::size_t begin, std::size_t end) {
      detail::sweep_triangles(triangles_, h, scratch.triangles, scratch.points.data(),
                              SweepPlaces(order, begin, end));
    };
    for_each_group(triangle_bounds_, scratch.executor, sweep_group, order);
  }

  /// As LaneSheet::correct_levels.
  void correct_levels(int turn, int sweeps, const Scalar& slack, const PassiveFrame<Scalar>& frame,
                      Scratch& scratch) const {
    const std::size_t set = static_cast<std::size_t>(turn % 2);
    correct_passively(levels_[set], sweeps, slack, frame, scratch.points.data(),
                      scratch.start.data(), scratch.levels[set], scratch.executor);
  }

 private:
  static TriangleMultipliers<Scalar> no_multipliers() {
    return {Scalar(0), Scalar(0), Scalar(0), Scalar(0)};
  }
  VectorX<Scalar> initial_;
  /// With a limit, springs of the kind Bend are in the second.
  EdgeBatches<Scalar> edges_, unlimited_;
  BendBatches<Scalar> bends_;
  std::vector<TriangleItem<Scalar>> triangles_;
  GroupBounds triangle_bounds_{0, 0, 0};
  std::array<BatchLevels<Scalar>, 2> levels_;
  Scalar bend_relaxation_ = Scalar(1);
  bool rigid_ = false;
  bool damped_ = false;
};

template <RealScalar Scalar>
BatchSheet<Scalar>::BatchSheet(const SpringNetwork<Scalar>& network,
                               const BatchSheetSetup<Scalar>& setup)
    : bend_relaxation_(setup.bend_relaxation), rigid_(setup.rigid) {
  const int n = static_cast<int>(network.vertex_count());
  initial_.setZero(static_cast<Index>(4) * (n + 2));
  for (Index v = 0; v < n; ++v) {
    for (Index c = 0; c < 3; ++c) initial_[4 * v + c] = network.rest_positions(c, v);
    initial_[4 * v + 3] = Scalar(1) / network.mass[v];
  }
  initial_[static_cast<Index>(4) * n + 4] = Scalar(1);  // the spare vertices are 1 m apart
  std::vector<ListedEdge<Scalar>> edges, unlimited;
  for (std::size_t e = 0; e < network.springs.size(); ++e) {
    const Spring<Scalar>& s = network.springs[e];
    const bool stiff = Scalar(0) < s.stiffness, damped = Scalar(0) < s.damping;
    if (!stiff && (rigid_ || !damped)) continue;
    if (damped) damped_ = true;
    const Scalar relaxation = setup.relaxation.empty() ? Scalar(1) : setup.relaxation[e];
    const bool bends = setup.limited && s.kind == SpringKind::Bend;
    (bends ? unlimited : edges)
        .push_back({s.a, s.b, s.rest_length, relaxation, s.stiffness,
                    setup.limited ? Scalar(0) : s.damping});
  }
  const PackOrder order = setup.listed_order ? PackOrder{1, 0} : PackOrder{3, 256};
  const MeshParts parts =
      setup.listed_order ? MeshParts{} : divide_mesh<Scalar>(network.rest_positions);
  edges_ = pack_edges(edges, order, n, parts);
  unlimited_ = pack_edges(unlimited, order, n, parts);
  bends_ = pack_bends(network.bends, order, n, parts);
  triangles_ = list_triangles(network.elements);
  triangle_bounds_ = sort_by_group(parts, triangles_, [](const auto& t) { return t.vertex; });
  if constexpr (HasLevels<Scalar>) {
    if (setup.limited) {
      LevelInput input = level_input(network, setup.tethered);
      levels_[0] = BatchLevels<Scalar>(input, parts);
      input.order = level_order(input.ranks, 1);
      levels_[1] = BatchLevels<Scalar>(input, parts);
    }
  }
}

template <RealScalar Scalar>
auto BatchSheet<Scalar>::make_scratch() const -> Scratch {
  Scratch scratch;
  scratch.points = initial_;
  scratch.start = initial_;
  scratch.edges.resize(static_cast<Index>(edges_.size()));
  scratch.unlimited.resize(static_cast<Index>(unlimited_.size()));
  scratch.bends.resize(bends_.size());
  for (std::size_t set = 0; set < 2; ++set) scratch.levels[set] = levels_[set].make_scratch();
  scratch.triangles.assign(triangles_.size(), no_multipliers());
  return scratch;
}

template <RealScalar Scalar>
bool BatchSheet<Scalar>::fits(const Scratch& scratch) const {
  return scratch.points.size() == initial_.size() && scratch.start.size() == initial_.size() &&
         scratch.edges.weight.size() == static_cast<Index>(edges_.size()) &&
         scratch.edges.multiplier.size() == static_cast<Index>(edges_.size()) &&
         scratch.unlimited.inverse.size() == static_cast<Index>(unlimited_.size()) &&
         scratch.bends.error_factor.size() == bends_.size() &&
         scratch.triangles.size() == triangles_.size() && levels_[0].fits(scratch.levels[0]) &&
         levels_[1].fits(scratch.levels[1]);
}

template <RealScalar Scalar>
void BatchSheet<Scalar>::prepare(const Scalar& h, bool limited, const std::vector<int>& held,
                                 Scratch& scratch) const {
  prepare_edges(edges_, h, limited, scratch.points.data(), scratch.edges);
  prepare_edges(unlimited_, h, false, scratch.points.data(), scratch.unlimited);
  if (rigid_) {
    prepare_rigid_bends(bends_, bend_relaxation_, scratch.points.data(), scratch.bends);
  } else {
    prepare_bends(bends_, h, scratch.points.data(), scratch.bends);
  }
  for (std::size_t set = 0; set < 2; ++set) levels_[set].prepare(held, scratch.levels[set]);
}

template <RealScalar Scalar>
void BatchSheet<Scalar>::predict(const Scalar& keep, const Vector3<Scalar>& push,
                                 Scratch& scratch) const {
  using Vertex = Simd<Scalar, 4>;
  const std::array<Scalar, 4> pushed{push[0], push[1], push[2], Scalar(0)};
  const Vertex gift = Vertex::load(pushed.data()), kept = Vertex::all(keep);
  Scalar* x = scratch.points.data();
  Scalar* start = scratch.start.data();
  for_each_range(static_cast<std::size_t>(vertex_count()), scratch.executor,
                 [&](std::size_t begin, std::size_t end) {
                   for (std::size_t at = 4 * begin; at < 4 * end; at += 4) {
                     const Vertex now = Vertex::load(x + at), before = Vertex::load(start + at);
                     now.store(start + at);
                     if (Scalar(0) < x[at + 3])
                       (now + (kept * (now - before) + gift)).store(x + at);
                   }
                 });
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
