#pragma once

// The edges of any mesh in batches, and Gauss-Seidel sweeps over them.
//
// The edges of a batch share no vertex, so a vector instruction may correct them at once. Edges
// keep the order of a list: an edge goes into the first batch with room after the last batch that
// holds one of its vertices. Two edges that share a vertex are therefore corrected in the order of
// the list, or in a sweep back in the opposite order, and the sweep gives what a sequential sweep
// gives. A batch that is not full is filled up with edges of weight zero between two vertices that
// exist for that purpose.

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/edge_rules.hpp"
#include "clothctl/cloth/detail/mesh_parts.hpp"
#include "clothctl/cloth/detail/point_batch.hpp"
#include "clothctl/cloth/detail/sweep_order.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// How `pack_items` may reorder a list.
struct PackOrder {
  /// Batches between two that hold the same vertex, at least 1. More of them hide the time that a
  /// number takes from a store to the next load.
  std::size_t distance = 1;
  /// Items after the first one waiting that may overtake it; 0 keeps the order of items that share
  /// a vertex.
  std::size_t window = 0;
};

/// Returns for each place of each batch the item that it holds, or -1. `corners(i)` returns the
/// vertices of item i. Allocates. Complexity: O(items × window).
template <class Corners>
std::vector<int> pack_items(std::size_t item_count, std::size_t vertex_count, int lanes,
                            const PackOrder& order, Corners corners) {
  const std::size_t width = static_cast<std::size_t>(lanes);
  std::vector<int> places;
  std::vector<std::size_t> free_from(vertex_count, 0);
  std::vector<std::size_t> waiting(item_count), kept;
  for (std::size_t i = 0; i < item_count; ++i) waiting[i] = i;
  // Positions in `waiting`; a list of those that are left, so that taken items cost nothing.
  std::vector<std::size_t> next(item_count + 1);
  for (std::size_t i = 0; i <= item_count; ++i) next[i] = i + 1;
  std::size_t head = 0;
  std::vector<std::size_t> blocked(vertex_count, 0);  // batch + 1 in which an earlier item waits
  for (std::size_t batch = 0; head < item_count; ++batch) {
    const std::size_t begin = places.size();
    places.resize(begin + width, -1);
    std::size_t found = 0, seen = 0, before = item_count;
    for (std::size_t at = head; at < item_count && found < width; at = next[at]) {
      bool ready = true;
      for (int v : corners(at)) {
        const std::size_t k = static_cast<std::size_t>(v);
        ready = ready && free_from[k] <= batch && (order.window > 0 || blocked[k] != batch + 1);
      }
      if (ready) {
        places[begin + found++] = static_cast<int>(at);
        for (int v : corners(at)) free_from[static_cast<std::size_t>(v)] = batch + order.distance;
        (before == item_count ? head : next[before]) = next[at];
        continue;
      }
      for (int v : corners(at)) blocked[static_cast<std::size_t>(v)] = batch + 1;
      before = at;
      if (++seen > (order.window > 0 ? order.window : 64 * width)) break;
    }
  }
  return places;
}

/// Items in batches, group by group.
struct PackedItems {
  /// For each place of each batch the item that it holds, or -1.
  std::vector<int> places;
  /// Bounds of the groups in `places`.
  GroupBounds bounds;
};

/// Packs the items of each group of `parts` with `pack_items`. Allocates.
template <class Corners>
PackedItems pack_groups(std::size_t item_count, std::size_t vertex_count, int lanes,
                        const PackOrder& order, const MeshParts& parts, Corners corners) {
  PackedItems packed;
  std::vector<std::vector<std::size_t>> items(static_cast<std::size_t>(parts.count) + 1);
  for (std::size_t i = 0; i < item_count; ++i)
    items[static_cast<std::size_t>(parts.group(corners(i)))].push_back(i);
  for (const std::vector<std::size_t>& group : items) {
    packed.bounds.push_back(packed.places.size());
    const auto places = pack_items(group.size(), vertex_count, lanes, order,
                                   [&](std::size_t i) { return corners(group[i]); });
    for (const int i : places)
      packed.places.push_back(i < 0 ? i : static_cast<int>(group[static_cast<std::size_t>(i)]));
  }
  packed.bounds.push_back(packed.places.size());
  return packed;
}

/// Constants of the edges of a mesh, batch by batch.
template <RealScalar Scalar>
struct EdgeBatches {
  /// Where the vertices of the ends begin in the buffer of points.
  std::vector<int> first, second;
  /// Rest length l0 (m), relaxation r (0 where there is no edge), spring k (N/m), damper c (N s/m).
  VectorX<Scalar> rest, relaxation, stiffness, damping;
  /// Bounds of the groups.
  GroupBounds bounds{0, 0, 0};

  std::size_t size() const { return first.size(); }
};

/// Numbers of the edges during a step.
template <RealScalar Scalar>
struct EdgeBatchScratch {
  VectorX<Scalar> weight, stiffness, damping, inverse, multiplier;

  /// Allocates.
  void resize(Index size) {
    for (VectorX<Scalar>* list : {&weight, &stiffness, &damping, &inverse, &multiplier})
      list->setZero(size);
  }
};

/// An edge of the list that is packed.
template <RealScalar Scalar>
struct ListedEdge {
  int a = 0, b = 0;
  Scalar rest, relaxation, stiffness, damping;
};

/// Packs edges in their order, group by group. `spare`: the first of two vertices that no edge
/// holds. Allocates.
template <RealScalar Scalar>
EdgeBatches<Scalar> pack_edges(const std::vector<ListedEdge<Scalar>>& edges, const PackOrder& order,
                               int spare, const MeshParts& parts = {}) {
  const auto ends = [&](std::size_t e) { return std::array<int, 2>{edges[e].a, edges[e].b}; };
  PackedItems packed = pack_groups(edges.size(), static_cast<std::size_t>(spare),
                                   batch_lanes<Scalar>(), order, parts, ends);
  const std::vector<int>& places = packed.places;
  EdgeBatches<Scalar> out;
  out.bounds = std::move(packed.bounds);
  const Index size = static_cast<Index>(places.size());
  out.first.assign(places.size(), 4 * spare);
  out.second.assign(places.size(), 4 * spare + 4);
  out.rest.setConstant(size, Scalar(1));
  for (VectorX<Scalar>* list : {&out.relaxation, &out.stiffness, &out.damping}) list->setZero(size);
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (places[i] < 0) continue;
    const ListedEdge<Scalar>& edge = edges[static_cast<std::size_t>(places[i])];
    const Index at = static_cast<Index>(i);
    out.first[i] = 4 * edge.a;
    out.second[i] = 4 * edge.b;
    out.rest[at] = edge.rest;
    out.relaxation[at] = edge.relaxation;
    out.stiffness[at] = edge.stiffness;
    out.damping[at] = edge.damping;
  }
  return out;
}

/// Sweeps the edges of some places once with `rule` and returns the rule as it is then.
template <RealScalar Scalar, class Rule>
Rule sweep_edge_range(const EdgeBatches<Scalar>& edges, EdgeBatchScratch<Scalar>& scratch,
                      Scalar* points, const Scalar* start, Rule rule, const SweepPlaces& places) {
  using Batch = PointBatch<Scalar>;
  using Pack = typename Batch::Pack;
  const EdgeData<Scalar> data{edges.rest.data(),        scratch.weight.data(),
                              scratch.stiffness.data(), scratch.damping.data(),
                              scratch.inverse.data(),   scratch.multiplier.data()};
  for (std::size_t i = 0; i < places.count(); ++i) {
    const std::size_t at = places[i];
    const int* first = edges.first.data() + at;
    const int* second = edges.second.data() + at;
    Batch a = Batch::load(points, first), b = Batch::load(points, second);
    const Pack dx = b.x - a.x, dy = b.y - a.y, dz = b.z - a.z;
    const auto along = [&]() CLOTHCTL_KERNEL_LAMBDA {
      const Batch a0 = Batch::load(start, first), b0 = Batch::load(start, second);
      return dx * (b0.x - a0.x) + dy * (b0.y - a0.y) + dz * (b0.z - a0.z);
    };
    const Pack s = rule.scale(data, at, dx * dx + dy * dy + dz * dz, along);
    const Pack of_a = s * a.w, of_b = s * b.w;
    a.x = a.x + of_a * dx;
    a.y = a.y + of_a * dy;
    a.z = a.z + of_a * dz;
    b.x = b.x - of_b * dx;
    b.y = b.y - of_b * dy;
    b.z = b.z - of_b * dz;
    a.store(points, first);
    b.store(points, second);
  }
  return rule;
}

/// Sweeps the edges once with `rule` and returns the rule as it is then. `start` holds the points
/// at the start of the substep; only rules with dampers read it.
template <RealScalar Scalar, class Rule>
Rule sweep_edges(const EdgeBatches<Scalar>& edges, EdgeBatchScratch<Scalar>& scratch,
                 Scalar* points, const Scalar* start, const Rule& rule,
                 const ExecutorRef& executor = {}, SweepOrder order = SweepOrder::Forward) {
  const auto sweep = [&](std::size_t begin, std::size_t end) {
    const SweepPlaces places(order, begin, end, static_cast<std::size_t>(batch_lanes<Scalar>()));
    return sweep_edge_range(edges, scratch, points, start, rule, places);
  };
  if (edges.bounds.size() == 3 || edges.size() == 0) return sweep(0, edges.size());  // one part
  std::array<Rule, MeshParts::kMost + 1> found;
  const auto sweep_group = [&](std::size_t g, std::size_t begin, std::size_t end) {
    found[g] = sweep(begin, end);
  };
  for_each_group(edges.bounds, executor, sweep_group, order);
  for (std::size_t g = 1; g + 1 < edges.bounds.size(); ++g) {
    if (edges.bounds[g] < edges.bounds[g + 1]) found[0].join(found[g]);
  }
  return found[0];
}

/// Computes the weights of a step of substep `h` (s) from the inverse masses in `points`.
/// `limited`: for LimitRule, `stiffness` becomes σ instead of h² k.
template <RealScalar Scalar>
void prepare_edges(const EdgeBatches<Scalar>& edges, const Scalar& h, bool limited,
                   const Scalar* points, EdgeBatchScratch<Scalar>& scratch) {
  const Scalar one = Scalar(1), zero = Scalar(0);
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const Index at = static_cast<Index>(i);
    const Scalar w = points[edges.first[i] + 3] + points[edges.second[i] + 3];
    const Scalar k = h * h * edges.stiffness[at], c = h * edges.damping[at];
    scratch.weight[at] = zero < w ? edges.relaxation[at] / w : zero;
    scratch.stiffness[at] = limited ? k * w / (k * w + one) : k;
    scratch.damping[at] = c;
    scratch.inverse[at] = one / ((k + c) * w + one);
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
