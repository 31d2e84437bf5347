#pragma once

// The symbolic part of a multifrontal factorisation (Liu 1992): the vertices of each front, the
// positions in its front of each matrix block and of each row of the children's update matrices,
// and the layout of the memory. All depend only on the pattern and the elimination tree.

#include <algorithm>
#include <cassert>
#include <vector>

#include "clothctl/linalg/block_symmetric.hpp"
#include "clothctl/linalg/detail/dense_kernels.hpp"
#include "clothctl/linalg/elimination_tree.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// One dense front, with sizes in scalars. Its rows are the pivots and then the border, each sorted
/// by position in the elimination order.
struct Front {
  Index pivots = 0, border = 0;
  Index ld = 0, ldu = 0;         // leading dimensions of the pivot columns and of the update matrix
  Index factor = 0, update = 0;  // begin of the packed columns and of the update matrix
  int vertex_begin = 0;          // begin in `vertices`, one for 3 rows
  int entry_begin = 0, entry_end = 0;  // range in `entries`
  int child_begin = 0, child_end = 0;
  int parent = -1;  // the front that assembles the update matrix, -1 if there is no border
};

/// A block of the matrix: its slot (-1 for a diagonal block), its vertices (row > column unless
/// diagonal), whether the front gets its transpose, and the position of its first scalar in the
/// pivot columns.
struct FrontEntry {
  int slot, row, column;
  bool transposed;
  Index target;
};

/// `length` rows of a child's update matrix, from row `source` on, that are contiguous in the
/// parent's front too, from row `target` on.
struct FrontRun {
  Index source, target, length;
};

/// A child of a front: its number and the range of its runs in `runs`.
struct FrontChild {
  int front;
  int run_begin, run_end;
};

/// Fronts, blocks and runs, in order of elimination.
struct FrontLayout {
  Index rows = 0, lower_count = 0;
  Index factor_size = 0, update_size = 0;
  Index largest_front = 0, most_pivots = 0;  // scalars of the pivot columns; rows
  std::vector<Front> fronts;
  std::vector<int> vertices;
  std::vector<FrontEntry> entries;
  std::vector<FrontChild> children;
  std::vector<FrontRun> runs;
  std::vector<int> front_of;  // the front that has a vertex as pivot

  FrontLayout() = default;

  /// Computes the layout. Leading dimensions are multiples of `align`. Allocates. Fails when: the
  /// tree is not valid (assert).
  template <class Scalar>
  FrontLayout(const BlockSymmetric<Scalar>& pattern, const EliminationTree& tree, int align)
      : rows(pattern.rows()),
        lower_count(pattern.lower_count()),
        align_(align),
        fronts_border_(tree.parent.size()) {
    lay_out_fronts(pattern, tree);
    lay_out_children(tree);
    lay_out_updates();
    fronts_border_ = {};
    front_of.resize(at(static_cast<int>(rows)));
    for (std::size_t k = 0; k < fronts.size(); ++k) {
      const Front& front = fronts[k];
      if (front.border > 0) fronts[k].parent = tree.parent[k];
      for (int v = 0; v < static_cast<int>(front.pivots / 3); ++v)
        front_of[at(vertices[at(front.vertex_begin + v)])] = static_cast<int>(k);
    }
  }

 private:
  /// A block with the positions of its later and its earlier vertex in the elimination order.
  struct Placed {
    int late, early;
    FrontEntry entry;
  };

  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  Index padded(Index n) const { return (n + align_ - 1) / align_ * align_; }

  /// Returns the blocks of the matrix, grouped by the node of their earlier vertex.
  template <class Scalar>
  static std::vector<std::vector<Placed>> blocks_by_node(const BlockSymmetric<Scalar>& pattern,
                                                         const EliminationTree& tree) {
    const std::size_t n = static_cast<std::size_t>(pattern.rows());
    const int nodes = static_cast<int>(tree.parent.size());
    assert(tree.permutation.size() == n && tree.node_begin.size() == tree.parent.size() + 1);
    std::vector<int> position(n), node_of(n);
    for (int k = 0; k < nodes; ++k) {
      for (int p = tree.node_begin[at(k)]; p < tree.node_begin[at(k) + 1]; ++p) {
        node_of[at(p)] = k;
        position[at(tree.permutation[at(p)])] = p;
      }
    }
    std::vector<std::vector<Placed>> blocks(tree.parent.size());
    for (int i = 0; i < static_cast<int>(n); ++i) {
      const int pi = position[at(i)];
      blocks[at(node_of[at(pi)])].push_back({pi, pi, {-1, i, i, false, 0}});
      for (int slot = pattern.row_begin(i); slot < pattern.row_begin(i + 1); ++slot) {
        const int j = pattern.column(slot);
        const int pj = position[at(j)];
        const int early = (std::min)(pi, pj);
        blocks[at(node_of[at(early)])].push_back(
            {(std::max)(pi, pj), early, {slot, i, j, pi < pj, 0}});
      }
    }
    return blocks;
  }

  template <class Scalar>
  void lay_out_fronts(const BlockSymmetric<Scalar>& pattern, const EliminationTree& tree) {
    const std::vector<std::vector<Placed>> blocks = blocks_by_node(pattern, tree);
    std::vector<int> local(static_cast<std::size_t>(rows), -1);
    for (std::size_t k = 0; k < blocks.size(); ++k) {
      const int begin = tree.node_begin[k], end = tree.node_begin[k + 1];
      std::vector<int>& border =
          fronts_border_[k];  // already holds the rows that the children pass on
      for (const Placed& block : blocks[k]) {
        if (block.late >= end) border.push_back(block.late);
      }
      std::sort(border.begin(), border.end());
      border.erase(std::unique(border.begin(), border.end()), border.end());
      if (tree.parent[k] >= 0) {
        const std::size_t parent = at(tree.parent[k]);
        assert(parent > k && (border.empty() || border.front() >= tree.node_begin[parent]));
        for (int p : border) {
          if (p >= tree.node_begin[parent + 1]) fronts_border_[parent].push_back(p);
        }
      }
      assert(tree.parent[k] >= 0 || border.empty());
      Front front;
      front.pivots = 3 * (end - begin);
      front.border = 3 * static_cast<Index>(border.size());
      front.ld = padded(front.pivots + front.border);
      front.ldu = padded(front.border);
      front.factor = factor_size;
      factor_size += packed_size(front.pivots, front.border);
      largest_front = (std::max)(largest_front, front.ld * front.pivots);
      most_pivots = (std::max)(most_pivots, front.pivots);
      front.vertex_begin = static_cast<int>(vertices.size());
      const auto add_row = [&](int p) {
        local[at(p)] = static_cast<int>(vertices.size()) - front.vertex_begin;
        vertices.push_back(tree.permutation[at(p)]);
      };
      for (int p = begin; p < end; ++p) add_row(p);
      for (int p : border) add_row(p);
      front.entry_begin = static_cast<int>(entries.size());
      for (const Placed& block : blocks[k]) {
        entries.push_back(block.entry);
        entries.back().target = 3 * local[at(block.early)] * front.ld + 3 * local[at(block.late)];
      }
      front.entry_end = static_cast<int>(entries.size());
      fronts.push_back(front);
    }
  }

  /// Lists the children of each front in ascending order, and computes which rows of the front get
  /// the rows of their update matrices.
  void lay_out_children(const EliminationTree& tree) {
    // Linked lists of the children that have a border.
    std::vector<int> first(fronts.size(), -1), next(fronts.size(), -1);
    for (std::size_t c = fronts.size(); c-- > 0;) {
      if (fronts[c].border == 0) continue;
      const std::size_t parent = at(tree.parent[c]);
      next[c] = first[parent];
      first[parent] = static_cast<int>(c);
    }
    for (std::size_t k = 0; k < fronts.size(); ++k) {
      fronts[k].child_begin = static_cast<int>(children.size());
      for (int c = first[k]; c >= 0; c = next[at(c)]) lay_out_child(tree, k, at(c));
      fronts[k].child_end = static_cast<int>(children.size());
    }
  }

  /// Computes which rows of the front of node k get the rows of the update matrix of child c. A run
  /// never extends from the pivots of the parent into its border.
  void lay_out_child(const EliminationTree& tree, std::size_t k, std::size_t c) {
    const Front& front = fronts[k];
    FrontChild child{static_cast<int>(c), static_cast<int>(runs.size()), 0};
    Index source = 0;
    for (int p : fronts_border_[c]) {
      Index target = 3 * (p - tree.node_begin[k]);
      if (p >= tree.node_begin[k + 1]) {
        const auto it = std::lower_bound(fronts_border_[k].begin(), fronts_border_[k].end(), p);
        target = front.pivots + 3 * (it - fronts_border_[k].begin());
      }
      const bool joins = static_cast<int>(runs.size()) > child.run_begin &&
                         target != front.pivots &&
                         runs.back().target + runs.back().length == target;
      if (joins) {
        runs.back().length += 3;
      } else {
        runs.push_back({source, target, 3});
      }
      source += 3;
    }
    child.run_end = static_cast<int>(runs.size());
    children.push_back(child);
  }

  /// Assigns to each update matrix the first sufficient gap in memory. The gap is in use from the
  /// elimination of its front until the parent has assembled the matrix.
  void lay_out_updates() {
    struct Live {
      Index begin, end;
      int front;
    };
    std::vector<Live> live;  // sorted by begin
    for (std::size_t k = 0; k < fronts.size(); ++k) {
      Front& front = fronts[k];
      const Index wanted = front.ldu * front.border;
      if (wanted > 0) {
        std::size_t place = 0;
        for (; place < live.size() && live[place].begin < front.update + wanted; ++place)
          front.update = live[place].end;
        live.insert(live.begin() + static_cast<std::ptrdiff_t>(place),
                    {front.update, front.update + wanted, static_cast<int>(k)});
        update_size = (std::max)(update_size, front.update + wanted);
      }
      for (int c = front.child_begin; c < front.child_end; ++c) {
        const int child = children[at(c)].front;
        live.erase(std::remove_if(live.begin(), live.end(),
                                  [&](const Live& l) { return l.front == child; }),
                   live.end());
      }
    }
  }

  Index align_ = 1;
  std::vector<std::vector<int>> fronts_border_;  // positions, during analysis only
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
