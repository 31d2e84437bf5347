#pragma once

// Pairs of boxes along the axes that overlap: sorted by their lower ends along x, each box is
// compared with those that start before it ends. The order is kept from call to call, so that
// sorting by insertion is short. The pairs are in ascending order, whatever the order of the boxes.

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/concepts/collider.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Two numbers of boxes, the smaller first.
using BoxPair = std::pair<int, int>;

/// Finds overlapping boxes.
template <RealScalar Scalar>
class BroadPhase {
 public:
  /// Makes room for `boxes` boxes and `pairs` pairs. Allocates.
  void reserve(std::size_t boxes, std::size_t pairs) {
    order_.reserve(boxes);
    pairs_.reserve(pairs);
  }
  /// Finds the pairs (i, j) of boxes that overlap and for which `wanted(i, j)`, i < j. Allocates
  /// only for more boxes or pairs than ever before.
  template <class Wanted>
  const std::vector<BoxPair>& find(const std::vector<BoundingBox<Scalar>>& boxes,
                                   const Wanted& wanted) {
    sort(boxes);
    pairs_.clear();
    for (std::size_t s = 0; s < order_.size(); ++s) {
      const int i = order_[s];
      const BoundingBox<Scalar>& box = boxes[static_cast<std::size_t>(i)];
      for (std::size_t t = s + 1; t < order_.size(); ++t) {
        const int j = order_[t];
        const BoundingBox<Scalar>& other = boxes[static_cast<std::size_t>(j)];
        if (box.upper[0] < other.lower[0]) break;
        const int low = (std::min)(i, j), high = (std::max)(i, j);
        if (wanted(low, high) && box.overlaps(other)) pairs_.push_back({low, high});
      }
    }
    std::sort(pairs_.begin(), pairs_.end());
    return pairs_;
  }
  /// The pairs of the last call.
  const std::vector<BoxPair>& pairs() const { return pairs_; }

 private:
  void sort(const std::vector<BoundingBox<Scalar>>& boxes) {
    if (order_.size() != boxes.size()) {
      order_.resize(boxes.size());
      for (std::size_t i = 0; i < boxes.size(); ++i) order_[i] = static_cast<int>(i);
    }
    const auto start = [&](int i) -> const Scalar& {
      return boxes[static_cast<std::size_t>(i)].lower[0];
    };
    for (std::size_t s = 1; s < order_.size(); ++s) {
      const int i = order_[s];
      std::size_t t = s;
      for (; t > 0 && start(i) < start(order_[t - 1]); --t) order_[t] = order_[t - 1];
      order_[t] = i;
    }
  }

  std::vector<int> order_;
  std::vector<BoxPair> pairs_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
