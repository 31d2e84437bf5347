#pragma once

// Approximate minimum degree: an elimination order that keeps the factor of a sparse symmetric
// matrix sparse. The next node is always one with the smallest upper bound of the degree.
//
// The elimination of a node p makes its neighbours a clique. The clique is stored as one element
// L_p = (A_p ∪ ⋃_e L_e) \ {p}, where A_p are the neighbours of p that are listed singly, and e are
// the elements that contain p. L_p replaces these elements, so the graph does not grow. L_p is also
// the pattern of column p of the factor, so the order gives the fill too. After the elimination of
// p, the degree of node i is at most |A_i| + |L_p \ i| + Σ_e |L_e \ L_p|, over the other elements e
// that contain i. Reference: Amestoy, Davis and Duff, SIAM J. Matrix Anal. Appl. 17 (1996).

#include <algorithm>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Orders nodes by approximate minimum degree. Among nodes of equal degree, the one whose degree
/// changed last comes first. All memory comes from `reserve`.
class MinimumDegree {
 public:
  /// Makes room for graphs with up to `nodes` nodes and `neighbours` neighbours in all (each edge
  /// counts twice), and for `fill` entries of the factor below the diagonal. Allocates.
  void reserve(Index nodes, Index neighbours, Index fill) {
    const std::size_t n = static_cast<std::size_t>(nodes);
    for (std::vector<int>* v : {&first_, &elements_, &variables_, &size_, &outside_, &mark_,
                                &degree_, &next_, &previous_, &head_, &order_, &scratch_}) {
      v->assign(n + 1, 0);
    }
    list_.assign(static_cast<std::size_t>(neighbours), 0);
    cliques_.assign(static_cast<std::size_t>(fill), 0);
    clique_first_.assign(n + 1, 0);
    start(0);
  }

  /// Starts a graph of `nodes` nodes. For each node in turn, call `neighbour` for all its
  /// neighbours and then `close`.
  void start(Index nodes) {
    nodes_ = static_cast<int>(nodes);
    node_ = 0;
    used_ = 0;
    first_[0] = 0;
  }
  /// Adds a neighbour of the current node.
  void neighbour(Index other) {
    list_[static_cast<std::size_t>(used_++)] = static_cast<int>(other);
  }
  /// Ends the neighbours of the current node; the next node becomes the current one.
  void close() { first_[static_cast<std::size_t>(++node_)] = used_; }

  /// Finds the order. Returns false when the factor would have more than `fill` entries below the
  /// diagonal (or more than are reserved), or when Σ |L_p|² would exceed `work`. Never allocates.
  bool order(double work, Index fill) {
    most_ = (std::min)(static_cast<int>(fill), static_cast<int>(cliques_.size()));
    for (int i = 0; i <= nodes_; ++i) {
      at(head_, i) = -1;
      at(mark_, i) = -1;
      at(outside_, i) = -1;
      at(size_, i) = 0;
    }
    for (int i = 0; i < nodes_; ++i) {
      at(elements_, i) = 0;
      at(variables_, i) = at(first_, i + 1) - at(first_, i);
      insert(i, at(variables_, i));
    }
    fill_ = 0;
    work_ = 0;
    int lowest = 0;
    for (int k = 0; k < nodes_; ++k) {
      while (at(head_, lowest) < 0) ++lowest;
      const int p = at(head_, lowest);
      remove(p);
      at(order_, k) = p;
      if (!join(p)) return false;
      const double length = at(size_, p);
      work_ += length * length;
      if (work_ > work) return false;
      lowest = (std::min)(lowest, renew_degrees(p, k));
    }
    return true;
  }

  /// The node at position k of the order.
  int node(int k) const { return order_[static_cast<std::size_t>(k)]; }
  /// Number of entries below the diagonal in column p of the factor.
  int column(int p) const { return size_[static_cast<std::size_t>(p)]; }
  /// Number of entries of the factor below the diagonal.
  int fill() const { return fill_; }
  /// Σ |L_p|². A factorisation takes twice as many operations.
  double work() const { return work_; }

 private:
  static int& at(std::vector<int>& v, int i) { return v[static_cast<std::size_t>(i)]; }

  void insert(int i, int degree) {
    at(degree_, i) = degree;
    at(next_, i) = at(head_, degree);
    at(previous_, i) = -1;
    if (at(head_, degree) >= 0) at(previous_, at(head_, degree)) = i;
    at(head_, degree) = i;
  }

  void remove(int i) {
    if (at(next_, i) >= 0) at(previous_, at(next_, i)) = at(previous_, i);
    if (at(previous_, i) >= 0) {
      at(next_, at(previous_, i)) = at(next_, i);
    } else {
      at(head_, at(degree_, i)) = at(next_, i);
    }
  }

  /// Makes the element L_p: the union of the variables (A_p) and of the members of the elements of
  /// node p. Absorbs these elements. Returns false when the limit on the fill is exceeded.
  bool join(int p) {
    const int begin = fill_;
    at(clique_first_, p) = begin;
    at(mark_, p) = p;
    const auto take = [&](int i) {
      if (at(mark_, i) == p) return true;
      if (fill_ == most_) return false;
      at(mark_, i) = p;
      at(cliques_, fill_++) = i;
      return true;
    };
    const int list = at(first_, p);
    for (int k = list; k < list + at(elements_, p); ++k) {
      const int e = at(list_, k);
      if (absorbed(e)) continue;
      for (int c = at(clique_first_, e); c < at(clique_first_, e) + at(size_, e); ++c) {
        if (!take(at(cliques_, c))) return false;
      }
      absorb(e);
    }
    for (int k = list + at(elements_, p); k < list + at(elements_, p) + at(variables_, p); ++k) {
      if (!take(at(list_, k))) return false;
    }
    at(size_, p) = fill_ - begin;
    return true;
  }

  /// Marks an element as absorbed by a later one. The length of its factor column (size_) is kept.
  void absorb(int e) { at(outside_, e) = kAbsorbed; }
  bool absorbed(int e) { return at(outside_, e) == kAbsorbed; }

  /// Updates the lists and degree bounds of the members of L_p after p was eliminated at position
  /// k. Returns the smallest of these bounds.
  int renew_degrees(int p, int k) {
    const int begin = at(clique_first_, p);
    const int end = begin + at(size_, p);
    for (int c = begin; c < end; ++c) {
      const int i = at(cliques_, c);
      const int list = at(first_, i);
      for (int q = list; q < list + at(elements_, i); ++q) {
        const int e = at(list_, q);
        if (absorbed(e)) continue;
        // Elements are not members of L_p, so their marks are free for use here. An element that is
        // not absorbed still has all its members, because the elimination of a member absorbs the
        // element.
        if (at(mark_, e) != p) {
          at(mark_, e) = p;
          at(outside_, e) = at(size_, e);
        }
        --at(outside_, e);
      }
    }
    int least = nodes_;
    for (int c = begin; c < end; ++c) {
      const int i = at(cliques_, c);
      const int list = at(first_, i);
      const int elements = at(elements_, i), variables = at(variables_, i);
      int degree = end - begin - 1;
      int kept = 0;
      for (int q = list; q < list + elements; ++q) {
        const int e = at(list_, q);
        if (absorbed(e) || at(outside_, e) == 0) continue;
        degree += at(outside_, e);
        at(scratch_, kept++) = e;
      }
      at(scratch_, kept++) = p;
      at(elements_, i) = kept;
      for (int q = list + elements; q < list + elements + variables; ++q) {
        const int j = at(list_, q);
        if (at(mark_, j) == p) continue;
        ++degree;
        at(scratch_, kept++) = j;
      }
      at(variables_, i) = kept - at(elements_, i);
      std::copy(scratch_.begin(), scratch_.begin() + kept, list_.begin() + list);
      degree = (std::min)((std::min)(degree, at(degree_, i) + end - begin - 1), nodes_ - k - 1);
      remove(i);
      insert(i, degree);
      least = (std::min)(least, degree);
    }
    return least;
  }

  static constexpr int kAbsorbed = -2;

  /// The elements and then the variables of node i begin at list_[first_[i]].
  std::vector<int> first_, elements_, variables_, list_;
  /// The size_[e] members of element e begin at cliques_[clique_first_[e]]. outside_[e] counts
  /// those that are not in L_p for the last eliminated node p.
  std::vector<int> cliques_, clique_first_, size_, outside_;
  std::vector<int> mark_, degree_, next_, previous_, head_, order_, scratch_;
  int nodes_ = 0, node_ = 0, used_ = 0, fill_ = 0, most_ = 0;
  double work_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
