#pragma once

// Sparse Cholesky factorisation A = L Lᵀ of a symmetric positive definite matrix of 3×3 blocks, multifrontal.
//
// An elimination tree groups the vertices into nodes; a node's pivots couple only to its subtree and its ancestors. Bottom
// up, each node gathers a dense front: its rows of A and what its children left (their Schur complements), eliminates its
// pivots and passes the rest on (dense_kernels.hpp). Which entry goes where is worked out once, with all memory; a numeric
// factorisation then only adds and multiplies. Reference: J. W. H. Liu, The multifrontal method for sparse matrix solution:
// theory and practice, SIAM Review 34 (1992).

#include <algorithm>
#include <cassert>
#include <numeric>
#include <span>
#include <vector>

#include "clothctl/math/block_symmetric.hpp"
#include "clothctl/math/dense_kernels.hpp"

namespace clothctl {

/// An order of elimination: nodes of vertices that are eliminated together, and who waits for whom.
struct EliminationTree {
  /// Vertex at each position of the order.
  std::vector<int> permutation;
  /// Pivots of node k are the positions node_begin[k] … node_begin[k+1]-1. One entry more than there are nodes.
  std::vector<int> node_begin;
  /// Node that a node reports to, -1 for a root. Children stand before their parents. No pair of the matrix may couple
  /// two nodes unless one is an ancestor of the other.
  std::vector<int> parent;
};

/// Factor of a BlockSymmetric with all memory taken at construction. One object a thread.
template <RealScalar Scalar>
class BlockCholesky {
 public:
  /// Factor of a matrix of no rows.
  BlockCholesky() = default;

  /// Analyses a pattern for an order of elimination. Allocates. Complexity: O(factor entries / 3).
  /// Fails when: the tree is not valid for the pattern (assert).
  BlockCholesky(const BlockSymmetric<Scalar>& pattern, const EliminationTree& tree) {
    lay_out_fronts(pattern, tree);
    lay_out_children(tree);
    lay_out_updates();
  }

  /// Factorises a matrix of the analysed pattern. Vertices with held[i] ≠ 0 get the rows and columns of the identity; `held`
  /// is empty or has an entry a vertex and may change from call to call. Returns false when a pivot is not positive or not
  /// finite; the factor must not be used then. No allocation.
  [[nodiscard]] bool factorize(const BlockSymmetric<Scalar>& matrix, std::span<const unsigned char> held = {}) {
    assert(matrix.rows() == rows_ && matrix.lower_count() == lower_count_);
    assert(held.empty() || static_cast<Index>(held.size()) == rows_);
    for (std::size_t k = 0; k < fronts_.size(); ++k) {
      const Front& front = fronts_[k];
      Scalar* f = factor_.data() + front.factor;
      std::fill_n(f, front.ld * front.pivots, Scalar(0));
      assemble(front, matrix, held);
      const bool leaf = front.child_begin == front.child_end;
      if (!leaf) clear_update(front);
      for (int c = front.child_begin; c < front.child_end; ++c) add_child(children_[static_cast<std::size_t>(c)], front);
      if (!detail::eliminate_front(f, front.ld, front.pivots, front.border, updates_.data() + front.update, front.ldu, leaf)) {
        return false;
      }
    }
    return true;
  }

  /// Solves A X = B in place for kLanes right-hand sides: kLanes×3n, column 3i+c is coordinate c of vertex i. Held entries
  /// come back as they went in. No allocation. Complexity: two multiply-adds a factor entry and right-hand side.
  template <int kLanes>
  void solve(Lanes<Scalar, kLanes>& x) {
    assert(x.cols() == 3 * rows_);
    constexpr int kGroup = lane_group(kLanes);
    for (std::size_t k = 0; k < fronts_.size(); ++k) {
      for (int lane = 0; lane < kLanes; lane += kGroup) forward<kLanes, kGroup>(fronts_[k], x.data(), lane);
    }
    for (std::size_t k = fronts_.size(); k-- > 0;) {
      for (int lane = 0; lane < kLanes; lane += kGroup) backward<kLanes, kGroup>(fronts_[k], x.data(), lane);
    }
  }

  /// Number of scalars in the factor.
  Index factor_entries() const {
    Index count = 0;
    for (const Front& front : fronts_) count += front.pivots * (front.pivots + 1) / 2 + front.pivots * front.border;
    return count;
  }

 private:
  /// One dense front; sizes in scalars. Local rows: pivots, then border, each by position.
  struct Front {
    Index pivots = 0, border = 0;
    Index ld = 0, ldu = 0;
    Index factor = 0, update = 0;           // where its columns and its update matrix begin
    int vertex_begin = 0;                   // its rows' vertices in vertices_
    int entry_begin = 0, entry_end = 0;     // its blocks of A in entries_
    int child_begin = 0, child_end = 0;     // in children_
  };
  /// A block of A: slot (-1: diagonal), its vertices (row > column unless diagonal), where it is added in the front.
  struct Entry {
    int slot, row, column;
    bool transposed;
    Index target;
  };
  /// Rows of a child's update matrix that stay neighbours in the parent's front.
  struct Run {
    Index source, target, length;
  };
  struct Child {
    int front;
    int run_begin, run_end;
  };

  static constexpr int kAlign = detail::native_lanes<Scalar>();
  static constexpr int kMaxGroup = 16;
  static Index padded(Index rows) { return (rows + kAlign - 1) / kAlign * kAlign; }

  /// Right-hand sides that go through a front together: as many as the registers take twelve (or six) rows of.
  static constexpr int lane_group(int lanes) {
    const int most = std::min(kMaxGroup, std::max(kAlign, 1) * (detail::kManyRegisters ? 2 : 1));
    int group = 1;
    while (group < lanes && group < most) group *= 2;
    return group;
  }

  void lay_out_fronts(const BlockSymmetric<Scalar>& pattern, const EliminationTree& tree) {
    rows_ = pattern.rows();
    lower_count_ = pattern.lower_count();
    const std::size_t n = static_cast<std::size_t>(rows_);
    const std::size_t nodes = tree.parent.size();
    assert(tree.permutation.size() == n && tree.node_begin.size() == nodes + 1);
    std::vector<int> position(n), node_of(n);
    for (std::size_t p = 0; p < n; ++p) position[static_cast<std::size_t>(tree.permutation[p])] = static_cast<int>(p);
    for (std::size_t k = 0; k < nodes; ++k) {
      for (int p = tree.node_begin[k]; p < tree.node_begin[k + 1]; ++p) node_of[static_cast<std::size_t>(p)] = static_cast<int>(k);
    }
    // Blocks by the node of their earlier vertex: (position of the later one, position of the earlier one, entry).
    struct Placed {
      int late, early;
      Entry entry;
    };
    std::vector<std::vector<Placed>> blocks(nodes);
    for (int i = 0; i < static_cast<int>(rows_); ++i) {
      const int pi = position[static_cast<std::size_t>(i)];
      blocks[static_cast<std::size_t>(node_of[static_cast<std::size_t>(pi)])].push_back({pi, pi, {-1, i, i, false, 0}});
      for (int slot = pattern.row_begin(i); slot < pattern.row_begin(i + 1); ++slot) {
        const int j = pattern.column(slot);
        const int pj = position[static_cast<std::size_t>(j)];
        const int early = std::min(pi, pj);
        blocks[static_cast<std::size_t>(node_of[static_cast<std::size_t>(early)])].push_back(
            {std::max(pi, pj), early, {slot, i, j, pi < pj, 0}});
      }
    }
    std::vector<std::vector<int>> border(nodes);
    std::vector<int> local(n, -1);
    fronts_.resize(nodes);
    Index largest = 0;
    for (std::size_t k = 0; k < nodes; ++k) {
      const int begin = tree.node_begin[k], end = tree.node_begin[k + 1];
      for (const Placed& block : blocks[k]) {
        if (block.late >= end) border[k].push_back(block.late);
      }
      std::sort(border[k].begin(), border[k].end());
      border[k].erase(std::unique(border[k].begin(), border[k].end()), border[k].end());
      if (tree.parent[k] >= 0) {
        const std::size_t parent = static_cast<std::size_t>(tree.parent[k]);
        assert(parent > k && (border[k].empty() || border[k].front() >= tree.node_begin[parent]));
        for (int p : border[k]) {
          if (p >= tree.node_begin[parent + 1]) border[parent].push_back(p);
        }
      }
      assert(tree.parent[k] >= 0 || border[k].empty());
      Front& front = fronts_[k];
      front.pivots = 3 * (end - begin);
      front.border = 3 * static_cast<Index>(border[k].size());
      front.ld = padded(front.pivots + front.border);
      front.ldu = padded(front.border);
      front.factor = factor_size_;
      factor_size_ += front.ld * front.pivots;
      largest = std::max(largest, front.ld);
      front.vertex_begin = static_cast<int>(vertices_.size());
      front.entry_begin = static_cast<int>(entries_.size());
      for (int p = begin; p < end; ++p) {
        local[static_cast<std::size_t>(p)] = p - begin;
        vertices_.push_back(tree.permutation[static_cast<std::size_t>(p)]);
      }
      int row = end - begin;
      for (int p : border[k]) {
        local[static_cast<std::size_t>(p)] = row++;
        vertices_.push_back(tree.permutation[static_cast<std::size_t>(p)]);
      }
      for (Placed& block : blocks[k]) {
        const Index i = local[static_cast<std::size_t>(block.late)], j = local[static_cast<std::size_t>(block.early)];
        block.entry.target = front.factor + 3 * j * front.ld + 3 * i;
        entries_.push_back(block.entry);
      }
      front.entry_end = static_cast<int>(entries_.size());
    }
    factor_.setZero(factor_size_ + kAlign);
    scratch_.setZero((largest + kAlign) * kMaxGroup);
    borders_ = std::move(border);
  }

  void lay_out_children(const EliminationTree& tree) {
    const std::size_t nodes = fronts_.size();
    std::vector<std::vector<int>> of(nodes);
    for (std::size_t k = 0; k < nodes; ++k) {
      if (tree.parent[k] >= 0 && fronts_[k].border > 0) of[static_cast<std::size_t>(tree.parent[k])].push_back(static_cast<int>(k));
    }
    for (std::size_t k = 0; k < nodes; ++k) {
      fronts_[k].child_begin = static_cast<int>(children_.size());
      for (int c : of[k]) {
        const std::vector<int>& border = borders_[static_cast<std::size_t>(c)];
        Child child{c, static_cast<int>(runs_.size()), 0};
        const Index pivots = fronts_[k].pivots;
        for (std::size_t i = 0; i < border.size(); ++i) {
          Index target = 3 * (border[i] - tree.node_begin[k]);
          if (border[i] >= tree.node_begin[k + 1]) {
            const auto it = std::lower_bound(borders_[k].begin(), borders_[k].end(), border[i]);
            target = pivots + 3 * (it - borders_[k].begin());
          }
          const bool joins = static_cast<int>(runs_.size()) > child.run_begin && target != pivots &&
                             runs_.back().target + runs_.back().length == target;
          if (joins) {
            runs_.back().length += 3;
          } else {
            runs_.push_back({3 * static_cast<Index>(i), target, 3});
          }
        }
        child.run_end = static_cast<int>(runs_.size());
        children_.push_back(child);
      }
      fronts_[k].child_end = static_cast<int>(children_.size());
    }
    borders_ = {};
  }

  /// Gives each update matrix the first gap that is free from its own elimination to its parent's assembly.
  void lay_out_updates() {
    struct Live {
      Index begin, end;
      int front;
    };
    std::vector<Live> live;  // by begin
    Index size = 0;
    for (std::size_t k = 0; k < fronts_.size(); ++k) {
      Front& front = fronts_[k];
      const Index wanted = front.ldu * front.border;
      Index at = 0;
      std::size_t place = 0;
      while (place < live.size() && live[place].begin < at + wanted) at = live[place++].end;
      front.update = at;
      live.insert(live.begin() + static_cast<std::ptrdiff_t>(place), {at, at + wanted, static_cast<int>(k)});
      size = std::max(size, at + wanted);
      for (int c = front.child_begin; c < front.child_end; ++c) {
        const int child = children_[static_cast<std::size_t>(c)].front;
        live.erase(std::remove_if(live.begin(), live.end(), [&](const Live& l) { return l.front == child; }), live.end());
      }
      if (wanted == 0) {
        live.erase(std::remove_if(live.begin(), live.end(), [&](const Live& l) { return l.front == static_cast<int>(k); }),
                   live.end());
      }
    }
    updates_.setZero(size + kAlign);
  }

  void assemble(const Front& front, const BlockSymmetric<Scalar>& matrix, std::span<const unsigned char> held) {
    for (int e = front.entry_begin; e < front.entry_end; ++e) {
      const Entry& entry = entries_[static_cast<std::size_t>(e)];
      Scalar* f = factor_.data() + entry.target;
      const bool fixed = !held.empty() && (held[static_cast<std::size_t>(entry.row)] != 0 ||
                                           held[static_cast<std::size_t>(entry.column)] != 0);
      if (fixed) {
        if (entry.slot < 0) {
          for (Index c = 0; c < 3; ++c) f[c * front.ld + c] = Scalar(1);
        }
        continue;
      }
      const Matrix3<Scalar>& block = entry.slot < 0 ? matrix.diagonal(entry.row) : matrix.lower(entry.slot);
      for (Index c = 0; c < 3; ++c) {
        for (Index r = 0; r < 3; ++r) f[c * front.ld + r] = entry.transposed ? block(c, r) : block(r, c);
      }
    }
  }

  void clear_update(const Front& front) {
    for (Index j = 0; j < front.border; ++j) {
      std::fill(updates_.data() + front.update + j * front.ldu + j, updates_.data() + front.update + (j + 1) * front.ldu,
                Scalar(0));
    }
  }

  void add_child(const Child& child, const Front& front) {
    const Front& from = fronts_[static_cast<std::size_t>(child.front)];
    const Run* runs = runs_.data();
    for (int q = child.run_begin; q < child.run_end; ++q) {
      const Run& across = runs[q];
      for (Index t = 0; t < across.length; ++t) {
        const Scalar* source = updates_.data() + from.update + (across.source + t) * from.ldu;
        const Index column = across.target + t;
        Scalar* target = column < front.pivots
                             ? factor_.data() + front.factor + column * front.ld
                             : updates_.data() + front.update + (column - front.pivots) * front.ldu - front.pivots;
        detail::add_run(target + column, source + across.source + t, across.length - t);
        for (int p = q + 1; p < child.run_end; ++p) {
          detail::add_run(target + runs[p].target, source + runs[p].source, runs[p].length);
        }
      }
    }
  }

  /// Copies lanes of a front's rows (vertices [first, last) of its list) into the scratch rows.
  template <int kLanes, int kGroup>
  CLOTHCTL_INLINE void gather(const int* vertices, Index first, Index last, const Scalar* x, int lane) {
    Scalar* to = scratch_.data() + 3 * first * kGroup;
    for (Index v = first; v < last; ++v) {
      const Scalar* from = x + 3 * static_cast<Index>(vertices[v]) * kLanes + lane;
      for (Index c = 0; c < 3; ++c, from += kLanes, to += kGroup) {
        if constexpr (kLanes % kGroup == 0) {
          detail::Pack<Scalar, kGroup> row;
          row.load(from);
          row.store(to);
        } else {
          for (int l = 0; l < kGroup; ++l) to[l] = lane + l < kLanes ? from[l] : Scalar(0);
        }
      }
    }
  }

  template <int kLanes, int kGroup>
  CLOTHCTL_INLINE void scatter(const int* vertices, Index count, Scalar* x, int lane) const {
    const Scalar* from = scratch_.data();
    for (Index v = 0; v < count; ++v) {
      Scalar* to = x + 3 * static_cast<Index>(vertices[v]) * kLanes + lane;
      for (Index c = 0; c < 3; ++c, to += kLanes, from += kGroup) {
        if constexpr (kLanes % kGroup == 0) {
          detail::Pack<Scalar, kGroup> row;
          row.load(from);
          row.store(to);
        } else {
          for (int l = 0; l < kGroup && lane + l < kLanes; ++l) to[l] = from[l];
        }
      }
    }
  }

  template <int kLanes, int kGroup>
  void forward(const Front& front, Scalar* x, int lane) {
    const int* vertices = vertices_.data() + front.vertex_begin;
    const Scalar* f = factor_.data() + front.factor;
    gather<kLanes, kGroup>(vertices, 0, front.pivots / 3, x, lane);
    detail::solve_pivots_forward<kGroup>(f, front.ld, front.pivots, scratch_.data());
    scatter<kLanes, kGroup>(vertices, front.pivots / 3, x, lane);
    const detail::Panels panels(front.border);
    for (int panel = 0; panel < panels.count; ++panel) {
      const int first = panels.begin(panel);
      detail::dispatch_width(panels.begin(panel + 1) - first, [&](auto w) {
        constexpr int kRows = decltype(w)::value;
        detail::Pack<Scalar, kGroup> sum[kRows];
        detail::row_products<kRows, kGroup>(f + front.pivots + first, front.ld, scratch_.data(), front.pivots, sum);
        detail::unroll<kRows>([&](auto i) CLOTHCTL_INLINE_LAMBDA {
          const Index vertex = vertices[(front.pivots + first) / 3 + i / 3];
          Scalar* to = x + (3 * vertex + i % 3) * kLanes + lane;
          if constexpr (kLanes % kGroup == 0) {
            detail::Pack<Scalar, kGroup> row;
            row.load(to);
            row.subtract(sum[i]);
            row.store(to);
          } else {
            Scalar values[kGroup];
            sum[i].store(values);
            for (int l = 0; l < kGroup && lane + l < kLanes; ++l) to[l] = to[l] - values[l];
          }
        });
      });
    }
  }

  template <int kLanes, int kGroup>
  void backward(const Front& front, Scalar* x, int lane) {
    const int* vertices = vertices_.data() + front.vertex_begin;
    gather<kLanes, kGroup>(vertices, 0, (front.pivots + front.border) / 3, x, lane);
    detail::solve_pivots_backward<kGroup>(factor_.data() + front.factor, front.ld, front.pivots, front.pivots + front.border,
                                          scratch_.data());
    scatter<kLanes, kGroup>(vertices, front.pivots / 3, x, lane);
  }

  Index rows_ = 0, lower_count_ = 0, factor_size_ = 0;
  std::vector<Front> fronts_;
  std::vector<int> vertices_;
  std::vector<Entry> entries_;
  std::vector<Child> children_;
  std::vector<Run> runs_;
  std::vector<std::vector<int>> borders_;  // during analysis only
  VectorX<Scalar> factor_, updates_, scratch_;
};

}  // namespace clothctl
