#pragma once

// The vertices of a sheet in parts that threads may work on at the same time.
//
// A constraint with all its vertices in one part belongs to that part; parts share no vertex, so
// their constraints may be corrected in any order with the same bits. The other constraints, those
// across borders, follow when all parts are done; in a sweep back they come first. The parts depend
// on the rest positions alone: they are halves of halves, cut across the longest extent at the
// median.

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/sweep_order.hpp"
#include "clothctl/concepts/executor.hpp"
#include "clothctl/core/longest_axis.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Parts of a sheet. Constraints across borders count as one more group, after the parts.
struct MeshParts {
  /// Most parts of a sheet; a part has at least `kLeast` vertices. Smaller parts would have longer
  /// borders and pay more for meeting.
  static constexpr int kMost = 16;
  static constexpr int kLeast = 1500;

  int count = 1;
  /// The part of each vertex; empty for one part.
  std::vector<int> of;

  /// Returns the group of a constraint on these vertices.
  template <class Vertices>
  int group(const Vertices& vertices) const {
    if (count < 2) return 0;
    const int first = of[static_cast<std::size_t>(*vertices.begin())];
    for (const int v : vertices) {
      if (of[static_cast<std::size_t>(v)] != first) return count;
    }
    return first;
  }

  /// Returns the parts of some of the vertices, here numbered in the order of `kept`. Neighbours
  /// are joined until a part has `kLeast` vertices on average. Allocates.
  MeshParts of_some(const std::vector<int>& kept) const {
    MeshParts some;
    some.count = count;
    int shift = 0;
    const std::size_t most = kept.size() / static_cast<std::size_t>(kLeast);
    for (; some.count > 1 && most < static_cast<std::size_t>(some.count); ++shift) some.count /= 2;
    if (some.count == 1) return some;
    for (const int v : kept) some.of.push_back(of[static_cast<std::size_t>(v)] >> shift);
    return some;
  }
};

/// Where the items of each group begin in an array, and where those of the last one end. One part
/// and no border: {0, n, n}.
using GroupBounds = std::vector<std::size_t>;

/// Divides the vertices at `rest`. Allocates. Complexity: O(n log n).
template <RealScalar Scalar>
MeshParts divide_mesh(const Points<Scalar>& rest) {
  const Index n = rest.cols();
  MeshParts parts;
  while (parts.count < MeshParts::kMost && n >= Index{2} * parts.count * MeshParts::kLeast)
    parts.count *= 2;
  if (parts.count == 1) return parts;
  std::vector<int> order(static_cast<std::size_t>(n));
  std::iota(order.begin(), order.end(), 0);
  std::vector<std::size_t> bounds{0, order.size()};
  while (bounds.size() <= static_cast<std::size_t>(parts.count)) {
    std::vector<std::size_t> halves;
    for (std::size_t p = 0; p + 1 < bounds.size(); ++p) {
      const auto begin = order.begin() + static_cast<std::ptrdiff_t>(bounds[p]),
                 end = order.begin() + static_cast<std::ptrdiff_t>(bounds[p + 1]);
      const std::span<const int> part(order.data() + bounds[p], bounds[p + 1] - bounds[p]);
      const int axis = longest_axis(rest, part);
      const auto before = [&](int u, int v) {
        if (rest(axis, u) < rest(axis, v)) return true;
        return !(rest(axis, v) < rest(axis, u)) && u < v;
      };
      const auto middle = begin + (end - begin) / 2;
      std::nth_element(begin, middle, end, before);
      halves.push_back(bounds[p]);
      halves.push_back(static_cast<std::size_t>(middle - order.begin()));
    }
    halves.push_back(order.size());
    bounds = std::move(halves);
  }
  parts.of.assign(order.size(), 0);
  for (std::size_t p = 0; p + 1 < bounds.size(); ++p) {
    for (std::size_t i = bounds[p]; i < bounds[p + 1]; ++i)
      parts.of[static_cast<std::size_t>(order[i])] = static_cast<int>(p);
  }
  return parts;
}

/// Sorts items by their group, in their order within each, and returns the bounds of the groups.
/// `vertices(item)` returns what a constraint is on. Allocates.
template <class Item, class Vertices>
GroupBounds sort_by_group(const MeshParts& parts, std::vector<Item>& items, Vertices vertices) {
  GroupBounds bounds;
  std::vector<Item> sorted;
  for (int g = 0; g <= parts.count; ++g) {
    bounds.push_back(sorted.size());
    for (const Item& item : items) {
      if (parts.group(vertices(item)) == g) sorted.push_back(item);
    }
  }
  bounds.push_back(sorted.size());
  items = std::move(sorted);
  return bounds;
}

/// Calls `run(group, begin, end)` for the items of each group: parts at the same time, then those
/// across borders; or the other way round. Does nothing when there are no items.
template <class Run>
void for_each_group(const GroupBounds& bounds, const ExecutorRef& executor, const Run& run,
                    SweepOrder order = SweepOrder::Forward) {
  if (bounds.front() == bounds.back()) return;
  const std::size_t parts = bounds.size() - 2;
  const bool forward = order == SweepOrder::Forward;
  if (parts > 1 && !forward) run(parts, bounds[parts], bounds[parts + 1]);
  executor.for_each_block(static_cast<int>(parts), [&](int block) {
    const std::size_t p = static_cast<std::size_t>(block);
    run(p, bounds[p], bounds[p + 1]);
  });
  if (parts > 1 && forward) run(parts, bounds[parts], bounds[parts + 1]);
}

/// Calls `run(begin, end)` for ranges of the items 0 … n - 1, at the same time. `vertices`: how
/// many of them an item stands for.
template <class Run>
void for_each_range(std::size_t n, const ExecutorRef& executor, const Run& run, int vertices = 1) {
  const std::size_t wanted = n * static_cast<std::size_t>(vertices) / MeshParts::kLeast;
  const std::size_t count = (std::clamp)(wanted, std::size_t{1}, std::size_t{MeshParts::kMost});
  executor.for_each_block(static_cast<int>(count), [&](int block) {
    const std::size_t i = static_cast<std::size_t>(block);
    run(n * i / count, n * (i + 1) / count);
  });
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
