#pragma once

// A tree of boxes over items that have boxes: which are closest to a point, which are first on a
// way, which overlap. The tree is made once, of the items' centres; later only its boxes change.
//
// Boxes are halved at the median of the centres along the longest axis of the centres. A search
// goes to the more promising half first, keeps the best answer so far, and leaves out nodes that
// cannot improve on it.

#include <array>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

#include "clothctl/concepts/collider.hpp"
#include "clothctl/core/longest_axis.hpp"
#include "clothctl/core/simd.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns true when the boxes have a point in common. Without branches: most answers are no.
template <RealScalar Scalar>
CLOTHCTL_KERNEL bool boxes_overlap(const BoundingBox<Scalar>& p, const BoundingBox<Scalar>& q) {
  const auto meet = [&](int i) CLOTHCTL_KERNEL_LAMBDA {
    return static_cast<int>(p.lower[i] <= q.upper[i]) & static_cast<int>(q.lower[i] <= p.upper[i]);
  };
  return (meet(0) & meet(1) & meet(2)) != 0;
}

/// Returns the smallest box that holds both.
template <RealScalar Scalar>
CLOTHCTL_KERNEL BoundingBox<Scalar> common_box(const BoundingBox<Scalar>& p,
                                               const BoundingBox<Scalar>& q) {
  return {p.lower.cwiseMin(q.lower), p.upper.cwiseMax(q.upper)};
}

/// Returns the squared distance of a point from a box.
template <RealScalar Scalar>
Scalar box_square(const BoundingBox<Scalar>& box, const Vector3<Scalar>& x) {
  Scalar sum(0);
  for (int i = 0; i < 3; ++i) {
    const Scalar below = box.lower[i] - x[i], above = x[i] - box.upper[i];
    Scalar out = below < above ? above : below;
    if (out < Scalar(0)) out = Scalar(0);
    sum += out * out;
  }
  return sum;
}

/// Returns the share of the way from `from` to `to` at which a point enters a box, or
/// `no_impact()` when it does not by the time `latest`.
template <RealScalar Scalar>
Scalar box_entry(const BoundingBox<Scalar>& box, const Vector3<Scalar>& from,
                 const Vector3<Scalar>& to, const Scalar& latest) {
  Scalar enter(0), leave = latest;
  for (int i = 0; i < 3; ++i) {
    const Scalar way = to[i] - from[i], low = box.lower[i] - from[i], high = box.upper[i] - from[i];
    if (way == Scalar(0)) {
      if (Scalar(0) < low || high < Scalar(0)) return no_impact<Scalar>();
      continue;
    }
    Scalar first = low / way, second = high / way;
    if (second < first) std::swap(first, second);
    if (enter < first) enter = first;
    if (second < leave) leave = second;
    if (leave < enter) return no_impact<Scalar>();
  }
  return enter;
}

/// Returns `items` in another order: first that with the number order[0]. Allocates.
template <class Item>
std::vector<Item> in_order(const std::vector<Item>& items, const std::vector<int>& order) {
  std::vector<Item> sorted;
  sorted.reserve(order.size());
  for (const int i : order) sorted.push_back(items[static_cast<std::size_t>(i)]);
  return sorted;
}

/// The tree. Only `build` allocates.
template <RealScalar Scalar, int kLeafItems = 4>
class BoxTree {
 public:
  /// Sorts items by their centres (3×n, m). Returns the items in the order of the tree: elsewhere,
  /// item k is the k-th of them. There are no boxes before `fit`. Allocates. Complexity: O(n log
  /// n).
  std::vector<int> build(const Points<Scalar>& centres) {
    const int count = static_cast<int>(centres.cols());
    std::vector<int> order(static_cast<std::size_t>(count));
    std::iota(order.begin(), order.end(), 0);
    nodes_.clear();
    nodes_.reserve(2 * order.size());
    if (count > 0) split(order, 0, count, centres);
    return order;
  }

  /// Fits the boxes to those of the items: `box_of(k)` returns that of item k. Complexity: O(n).
  template <class BoxOf>
  void fit(const BoxOf& box_of) {
    // Children come after their parents.
    for (std::size_t i = nodes_.size(); i-- > 0;) {
      Node& at = nodes_[i];
      if (!at.is_leaf()) {
        at.box = common_box<Scalar>(nodes_[i + 1].box, node(at.first).box);
        continue;
      }
      at.box = box_of(at.first);
      for (int k = at.first + 1; k < at.first + at.count; ++k)
        at.box = common_box<Scalar>(at.box, box_of(k));
    }
  }

  /// The box of all items. There must be one.
  const BoundingBox<Scalar>& bounds() const { return nodes_.front().box; }

  /// Returns the item that is closest to x, or -1 when none is closer than the root of `square`
  /// (m²). `square_of(k, best)` returns the squared distance of item k, or any number not below
  /// `best` when the distance is not either; it must not be below that of the item's box.
  template <class SquareOf>
  int nearest(const Vector3<Scalar>& x, Scalar square, const SquareOf& square_of) const {
    int best = -1;
    if (nodes_.empty()) return best;
    search([&](const BoundingBox<Scalar>& box) { return box_square<Scalar>(box, x); },
           [&](const Scalar& least) { return least < square; },
           [&](int k) {
             const Scalar found = square_of(k, square);
             if (!(found < square)) return;
             square = found;
             best = k;
           });
    return best;
  }

  /// Returns when the first item is hit on the straight way between two points, as a share of the
  /// way, or `no_impact()`. `time_of(k, latest)` returns when item k is hit, or `no_impact()` when
  /// it is not by the time `latest`. That must not be before the point comes within `reach` (m)
  /// of the item's box along each axis.
  template <class TimeOf>
  Scalar sweep(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& reach,
               const TimeOf& time_of) const {
    Scalar best = no_impact<Scalar>(), latest(1);
    const auto entry = [&](const BoundingBox<Scalar>& box) {
      return box_entry<Scalar>(box.grown(reach), from, to, latest);
    };
    if (nodes_.empty() || latest < entry(bounds())) return best;
    search(
        entry, [&](const Scalar& least) { return least <= latest; },
        [&](int k) {
          const Scalar t = time_of(k, latest);
          if (t < best) best = t;
          if (best < latest) latest = best;
        });
    return best;
  }

  /// Calls `visit(first, count)` for ranges of items whose common box overlaps `box`, in the order
  /// of the tree.
  template <class Visit>
  void for_each_overlap(const BoundingBox<Scalar>& box, const Visit& visit) const {
    std::array<int, kMostLevels> stack;
    std::size_t size = 0;
    if (!nodes_.empty()) stack[size++] = 0;
    while (size > 0) {
      const int i = stack[--size];
      const Node& at = node(i);
      if (!at.box.overlaps(box)) continue;
      if (at.is_leaf()) {
        visit(at.first, at.count);
        continue;
      }
      stack[size++] = at.first;
      stack[size++] = i + 1;
    }
  }

  /// Calls `visit(p, p_end, q, q_end)` for pairs of ranges of items whose common boxes overlap:
  /// each pair once, and each range with itself.
  template <class Visit>
  void for_each_overlap_within(const Visit& visit) const {
    // A step down takes one entry and adds up to three, and the tree is at most 32 deep.
    std::array<std::array<int, 2>, 256> stack;
    std::size_t size = 0;
    if (!nodes_.empty()) stack[size++] = {0, 0};
    while (size > 0) {
      const auto [a, b] = stack[--size];
      const Node &p = node(a), &q = node(b);
      if (a != b && !boxes_overlap(p.box, q.box)) continue;
      if (p.is_leaf() && q.is_leaf()) {
        visit(p.first, p.first + p.count, q.first, q.first + q.count);
      } else if (a == b) {
        stack[size++] = {p.first, p.first};
        stack[size++] = {a + 1, p.first};
        stack[size++] = {a + 1, a + 1};
      } else if (q.is_leaf() || (!p.is_leaf() && p.count >= q.count)) {
        stack[size++] = {p.first, b};
        stack[size++] = {a + 1, b};
      } else {
        stack[size++] = {a, q.first};
        stack[size++] = {a, b + 1};
      }
    }
  }

 private:
  /// Halving 2^31 items gives no more levels.
  static constexpr std::size_t kMostLevels = 64;

  struct Node {
    BoundingBox<Scalar> box;
    /// A leaf: its first item. Otherwise the second child; the first is the next node.
    int first = 0;
    /// Items below the node.
    int count = 0;

    bool is_leaf() const { return count <= kLeafItems; }
  };

  const Node& node(int i) const { return nodes_[static_cast<std::size_t>(i)]; }

  /// Makes the node of the entries begin to end of `order`, and those below it.
  void split(std::vector<int>& order, int begin, int end, const Points<Scalar>& centres) {
    const std::size_t self = nodes_.size();
    nodes_.push_back({});
    nodes_[self].first = begin;
    nodes_[self].count = end - begin;
    if (nodes_[self].is_leaf()) return;
    const int middle = split_along_longest_axis(centres, order, begin, end);
    split(order, begin, middle, centres);
    nodes_[self].first = static_cast<int>(nodes_.size());
    split(order, middle, end, centres);
  }

  /// Visits the items of all leaves below nodes with a `key(box)` for which `useful(key)` is true,
  /// those with a smaller key first. A visit may make keys useless.
  template <class Key, class Useful, class Visit>
  CLOTHCTL_FORCE_INLINE void search(const Key& key, const Useful& useful,
                                    const Visit& visit) const {
    struct Later {
      int node;
      Scalar key;
    };
    std::array<Later, kMostLevels> stack;
    std::size_t size = 0;
    int at = 0;
    for (;;) {
      if (!node(at).is_leaf()) {
        int sooner = at + 1, other = node(at).first;
        Scalar k_sooner = key(node(sooner).box), k_other = key(node(other).box);
        if (k_other < k_sooner) {
          std::swap(sooner, other);
          std::swap(k_sooner, k_other);
        }
        if (useful(k_other)) stack[size++] = {other, k_other};
        if (useful(k_sooner)) {
          at = sooner;
          continue;
        }
      } else {
        for (int k = node(at).first; k < node(at).first + node(at).count; ++k) visit(k);
      }
      while (size > 0 && !useful(stack[size - 1].key)) --size;
      if (size == 0) return;
      at = stack[--size].node;
    }
  }

  std::vector<Node> nodes_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
