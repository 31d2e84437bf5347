#pragma once

// Nested dissection. Cut the vertices into two sides along a coordinate. The vertices of one side
// that couple to the other side are the separator. Eliminate both sides first and the separator
// last, and order each side by the same method. For n vertices of a sheet the factor has O(n log n)
// entries. Reference: A. George, Nested dissection of a regular finite element mesh, SIAM J. Numer.
// Anal. 10 (1973).
//
// One sweep computes the separators of all cuts along an axis. Rank the vertices by coordinate. The
// cut before rank m has a lower separator, the vertices v with rank(v) < m <= the largest rank of a
// vertex coupled to v, and an upper separator, those with the smallest rank of a vertex coupled to
// v < m <= rank(v).

#include <algorithm>
#include <array>
#include <cassert>
#include <numeric>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/core/longest_axis.hpp"
#include "clothctl/linalg/block_symmetric.hpp"
#include "clothctl/linalg/elimination_tree.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// The recursion of nested_dissection. Each set of vertices is a range of order_.
template <RealScalar Scalar>
class Dissection {
 public:
  Dissection(const BlockSymmetric<Scalar>& pattern, const PointsView<Scalar>& positions,
             int leaf_size)
      : positions_(positions), leaf_size_((std::max)(leaf_size, 1)) {
    const int n = static_cast<int>(pattern.rows());
    neighbour_begin_.assign(size(n) + 1, 0);
    for (int i = 0; i < n; ++i) {
      for (int s = pattern.row_begin(i); s < pattern.row_begin(i + 1); ++s) {
        ++neighbour_begin_[size(i) + 1];
        ++neighbour_begin_[size(pattern.column(s)) + 1];
      }
    }
    std::partial_sum(neighbour_begin_.begin(), neighbour_begin_.end(), neighbour_begin_.begin());
    neighbours_.resize(size(neighbour_begin_.back()));
    std::vector<int> next(neighbour_begin_.begin(), neighbour_begin_.end() - 1);
    for (int i = 0; i < n; ++i) {
      for (int s = pattern.row_begin(i); s < pattern.row_begin(i + 1); ++s) {
        const int j = pattern.column(s);
        neighbours_[size(next[size(i)]++)] = j;
        neighbours_[size(next[size(j)]++)] = i;
      }
    }
    order_.resize(size(n));
    std::iota(order_.begin(), order_.end(), 0);
    rank_.assign(size(n), -1);
    tree_.node_begin.push_back(0);
    dissect(0, n);
  }

  EliminationTree take() { return std::move(tree_); }

 private:
  struct Cut {
    double cost = -1.0;
    int axis = 0, rank = 0;
    bool lower = true;
  };

  static std::size_t size(int i) { return static_cast<std::size_t>(i); }

  /// Sorts order_[begin, end) by a coordinate, and by index where coordinates are equal.
  /// Coordinates that are not finite come last.
  void sort_along(int axis, int begin, int end) {
    std::sort(order_.begin() + begin, order_.begin() + end, [&](int a, int b) {
      const Scalar xa = positions_(axis, a), xb = positions_(axis, b);
      const bool a_counts = is_finite(xa), b_counts = is_finite(xb);
      if (a_counts != b_counts) return a_counts;
      if (a_counts && (xa < xb || xb < xa)) return xa < xb;
      return a < b;
    });
  }

  /// Returns the smallest and the largest rank among a vertex and the vertices of the current set
  /// that couple to it.
  std::array<int, 2> partner_ranks(int v) const {
    std::array<int, 2> range = {rank_[size(v)], rank_[size(v)]};
    for (int s = neighbour_begin_[size(v)]; s < neighbour_begin_[size(v) + 1]; ++s) {
      const int r = rank_[size(neighbours_[size(s)])];
      if (r < 0) continue;
      range[0] = (std::min)(range[0], r);
      range[1] = (std::max)(range[1], r);
    }
    return range;
  }

  /// Evaluates the cuts along an axis at the middle half of the ranks. Replaces `best` if a cut is
  /// better.
  void evaluate_cuts(int axis, int begin, int end, Cut& best) {
    const int n = end - begin;
    sort_along(axis, begin, end);
    for (int r = 0; r < n; ++r) rank_[size(order_[size(begin + r)])] = r;
    std::vector<int> lower(size(n) + 2, 0), upper(size(n) + 2, 0);
    for (int r = 0; r < n; ++r) {
      const std::array<int, 2> partners = partner_ranks(order_[size(begin + r)]);
      ++lower[size(r) + 1];
      --lower[size(partners[1]) + 1];
      ++upper[size(partners[0]) + 1];
      --upper[size(r) + 1];
    }
    std::partial_sum(lower.begin(), lower.end(), lower.begin());
    std::partial_sum(upper.begin(), upper.end(), upper.begin());
    for (int m = (std::max)(1, n / 4); m <= n - (std::max)(1, n / 4); ++m) {
      for (const bool use_lower : {true, false}) {
        const int separator = use_lower ? lower[size(m)] : upper[size(m)];
        const int below = m - (use_lower ? separator : 0),
                  above = n - m - (use_lower ? 0 : separator);
        const double imbalance = static_cast<double>(below - above) / n;
        const double cost = (separator + 0.1) * (1.0 + 4.0 * imbalance * imbalance);
        if (best.cost < 0.0 || cost < best.cost) best = {cost, axis, m, use_lower};
      }
    }
  }

  /// Appends a node with the vertices order_[begin, end) and makes it the parent of `children`.
  /// Returns the number of the node.
  int add_node(int begin, int end, const std::vector<int>& children) {
    const int node = static_cast<int>(tree_.parent.size());
    tree_.permutation.insert(tree_.permutation.end(), order_.begin() + begin, order_.begin() + end);
    tree_.node_begin.push_back(static_cast<int>(tree_.permutation.size()));
    tree_.parent.push_back(-1);
    for (int child : children) tree_.parent[size(child)] = node;
    return node;
  }

  /// Orders the set order_[begin, end). Returns its nodes that do not have a parent yet.
  std::vector<int> dissect(int begin, int end) {
    const int n = end - begin;
    if (n == 0) return {};
    if (n <= leaf_size_) return {add_node(begin, end, {})};
    Cut cut;
    for (int axis = 0; axis < 3; ++axis) evaluate_cuts(axis, begin, end, cut);
    sort_along(cut.axis, begin, end);
    for (int r = 0; r < n; ++r) rank_[size(order_[size(begin + r)])] = r;
    // Partition the set into the lower side, the upper side and the separator.
    std::vector<int> parts[3];
    for (int r = 0; r < n; ++r) {
      const int v = order_[size(begin + r)];
      const std::array<int, 2> partners = partner_ranks(v);
      const bool below = r < cut.rank;
      const bool separates =
          cut.lower ? below && partners[1] >= cut.rank : !below && partners[0] < cut.rank;
      parts[separates ? 2 : (below ? 0 : 1)].push_back(v);
    }
    for (int r = 0; r < n; ++r) rank_[size(order_[size(begin + r)])] = -1;
    if (2 * static_cast<int>(parts[2].size()) >= n) return {add_node(begin, end, {})};
    auto to = order_.begin() + begin;
    for (const std::vector<int>& part : parts) to = std::copy(part.begin(), part.end(), to);
    const int middle = begin + static_cast<int>(parts[0].size());
    const int last = middle + static_cast<int>(parts[1].size());
    std::vector<int> open = dissect(begin, middle);
    const std::vector<int> more = dissect(middle, last);
    open.insert(open.end(), more.begin(), more.end());
    if (last == end) return open;
    // Sort the separator along its length. A descendant's front then couples to contiguous vertices
    // of it.
    const std::span<const int> separator(order_.data() + last, size(end - last));
    sort_along(longest_axis(positions_, separator), last, end);
    return {add_node(last, end, open)};
  }

  const PointsView<Scalar>& positions_;
  int leaf_size_;
  std::vector<int> neighbour_begin_, neighbours_;
  std::vector<int> order_, rank_;
  EliminationTree tree_;
};

}  // namespace detail

/// Orders a pattern for BlockCholesky by recursive bisection of the positions (3×n, m, rest shape)
/// with vertex separators. Works for any pattern: sheets with bending couplings, garments, ropes,
/// solids, several bodies. Does not cut sets of at most `leaf_size` vertices. Deterministic.
/// Allocates. Complexity: O((n log n + p) log n) for p pairs. Fails when: the number of positions
/// differs from the number of block rows, or a position is not finite (assert).
template <RealScalar Scalar>
EliminationTree nested_dissection(const BlockSymmetric<Scalar>& pattern,
                                  const std::type_identity_t<PointsView<Scalar>>& positions,
                                  int leaf_size = 16) {
  assert(positions.cols() == pattern.rows() && all_finite(positions));
  return detail::Dissection<Scalar>(pattern, positions, leaf_size).take();
}

}  // namespace clothctl::inline CLOTHCTL_ABI
