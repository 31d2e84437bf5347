#pragma once

// The Newton systems of row_factor.hpp for sparse H and A, factored as one matrix:
//
//   | H_FF + ρ I   A_WFᵀ |
//   |                    |  =  P L D Lᵀ Pᵀ,      D > 0 at unknowns, < 0 at rows
//   | A_WF         -μ I  |
//
// Quasi-definite matrices have this factor for every order P (Vanderbei, SIAM J. Optim. 5, 1995).
// So one order of all unknowns and rows is enough for all sets F and W. L is computed row by row,
// as in Davis, ACM TOMS 31 (2005): the nonzeros of row k are on the paths of the elimination tree
// from the nonzeros of row k of the matrix to node k. When the sets change, the rows of L before
// the first changed position of the order stay valid.

#include <algorithm>
#include <vector>

#include "clothctl/linalg/columns.hpp"
#include "clothctl/linalg/detail/minimum_degree.hpp"
#include "clothctl/linalg/vector_kernels.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Factor of the regularised KKT system of changing sets F and W, for sparse H and A.
template <RealScalar Scalar>
class SparseLdlt {
 public:
  /// A dense vector.
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    const Index nodes = n + m;
    const Index edges = n * n / 4 + n * m / 2;
    const Index fill = most_fill(n, m);
    degree_.reserve(nodes, edges, fill);
    const std::size_t count = static_cast<std::size_t>(nodes);
    for (std::vector<int>* v :
         {&place_, &column_, &length_, &parent_, &mark_, &path_, &upper_start_})
      v->assign(count + 1, 0);
    on_.assign(count, 0);
    free_.assign(static_cast<std::size_t>(n), 0);
    active_.assign(static_cast<std::size_t>(m), 0);
    upper_index_.resize(static_cast<std::size_t>(edges / 2));
    upper_.resize(static_cast<std::size_t>(edges / 2));
    row_.resize(static_cast<std::size_t>(fill));
    entry_.resize(static_cast<std::size_t>(fill));
    set_zero<Scalar>({&diagonal_, &pivot_, &spread_, &right_}, nodes);
    n_ = m_ = 0;
    clear();
  }

  /// Finds an elimination order for sparse H (n×n) and A (m×n), and stores their entries. Returns
  /// false when the factor does not fit in the memory or `work()` would exceed `work`. Clears the
  /// sets. Never allocates.
  bool analyse(const Columns<Scalar>& H, const Columns<Scalar>& A, const Columns<Scalar>& At,
               double work) {
    n_ = H.columns();
    m_ = A.rows();
    clear();
    degree_.start(n_ + m_);
    for (Index j = 0; j < n_; ++j) {
      for (int k = H.start(j); k < H.start(j + 1); ++k) {
        if (H.row(k) != j) degree_.neighbour(H.row(k));
      }
      for (int k = A.start(j); k < A.start(j + 1); ++k) degree_.neighbour(n_ + A.row(k));
      degree_.close();
    }
    for (Index i = 0; i < m_; ++i) {
      for (int k = At.start(i); k < At.start(i + 1); ++k) degree_.neighbour(At.row(k));
      degree_.close();
    }
    if (!degree_.order(work, most_fill(n_, m_))) return false;
    int entries = 0;
    for (int k = 0; k < nodes(); ++k) place(degree_.node(k)) = k;
    for (int k = 0; k < nodes(); ++k) {
      const int v = degree_.node(k);
      at(column_, k) = entries;
      entries += degree_.column(v);
    }
    at(column_, nodes()) = entries;
    int used = 0;
    const auto put = [&](int k, int other, const Scalar& value) {
      if (place(other) >= k) return;
      at(upper_index_, used) = place(other);
      upper_[static_cast<std::size_t>(used++)] = value;
    };
    for (int k = 0; k < nodes(); ++k) {
      const int v = degree_.node(k);
      at(upper_start_, k) = used;
      diagonal_[k] = Scalar(0);
      if (v < n_) {
        for (int q = H.start(v); q < H.start(v + 1); ++q) {
          if (H.row(q) == v) diagonal_[k] = H.value(q);
          if (H.row(q) != v) put(k, H.row(q), H.value(q));
        }
        for (int q = A.start(v); q < A.start(v + 1); ++q)
          put(k, static_cast<int>(n_) + A.row(q), A.value(q));
      } else {
        const Index i = v - n_;
        for (int q = At.start(i); q < At.start(i + 1); ++q) put(k, At.row(q), At.value(q));
      }
    }
    at(upper_start_, nodes()) = used;
    return true;
  }

  /// Σ |column of L|² over all unknowns and rows. A factorisation takes twice as many operations.
  double work() const { return degree_.work(); }

  /// Clears the sets. Call this after a change of ρ.
  void clear() {
    std::fill(on_.begin(), on_.end(), char(0));
    free_size_ = row_size_ = 0;
    good_ = 0;
  }
  /// Discards the factor but keeps the sets. Call this after a change of μ.
  void touch() { good_ = 0; }

  /// Number of free unknowns.
  Index free_size() const { return free_size_; }
  /// Number of active rows.
  Index row_size() const { return row_size_; }
  /// The k-th free unknown.
  Index unknown(Index k) const { return free_[static_cast<std::size_t>(k)]; }
  /// The k-th active row.
  Index row(Index k) const { return active_[static_cast<std::size_t>(k)]; }
  /// Returns true when row i is active.
  bool has_row(Index i) const { return on_[place_of(n_ + i)] != 0; }
  /// Returns true when unknown i is free.
  bool has_unknown(Index i) const { return on_[place_of(i)] != 0; }

  /// Updates the factor to the sets given by the predicates. Returns false when a pivot has the
  /// wrong sign or is too small: the caller then increases ρ if `free_failed()`, else μ. `changed`
  /// becomes true when a set differs from the previous one.
  template <class IsFree, class IsActive>
  bool sync(const Scalar& rho, const Scalar& mu, IsFree is_free, IsActive is_active,
            bool& changed) {
    free_failed_ = false;
    changed = false;
    free_size_ = row_size_ = 0;
    int first = good_;
    const auto set = [&](Index node, bool on) {
      const std::size_t k = place_of(node);
      if ((on_[k] != 0) == on) return;
      on_[k] = on ? char(1) : char(0);
      first = (std::min)(first, static_cast<int>(k));
      changed = true;
    };
    for (Index i = 0; i < n_; ++i) {
      const bool on = is_free(i);
      set(i, on);
      if (on) free_[static_cast<std::size_t>(free_size_++)] = static_cast<int>(i);
    }
    for (Index i = 0; i < m_; ++i) {
      const bool on = is_active(i);
      set(n_ + i, on);
      if (on) active_[static_cast<std::size_t>(row_size_++)] = static_cast<int>(i);
    }
    return factor_from(first, rho, mu);
  }

  /// Returns true when the pivot that failed last was that of an unknown, false when it was that of
  /// a row.
  bool free_failed() const { return free_failed_; }

  /// Solves for the right-hand sides r1 (n, read at free unknowns) and r2 (m, read at active rows).
  /// Writes p (n) at free unknowns and delta (m) at active rows only.
  void solve(const Vector& r1, const Vector& r2, Vector& p, Vector& delta) {
    for (Index k = 0; k < free_size_; ++k)
      right_[static_cast<Index>(place_of(unknown(k)))] = -r1[unknown(k)];
    for (Index k = 0; k < row_size_; ++k)
      right_[static_cast<Index>(place_of(n_ + row(k)))] = -r2[row(k)];
    for (int k = 0; k < nodes(); ++k) {
      if (!on(k)) continue;
      const Scalar value = right_[k];
      const int end = at(column_, k) + at(length_, k);
      for (int q = at(column_, k); q < end; ++q)
        right_[at(row_, q)] -= entry_[static_cast<std::size_t>(q)] * value;
    }
    for (int k = nodes(); k-- > 0;) {
      if (!on(k)) continue;
      Scalar value = right_[k] / pivot_[k];
      const int end = at(column_, k) + at(length_, k);
      for (int q = at(column_, k); q < end; ++q)
        value -= entry_[static_cast<std::size_t>(q)] * right_[at(row_, q)];
      right_[k] = value;
    }
    for (Index k = 0; k < free_size_; ++k)
      p[unknown(k)] = right_[static_cast<Index>(place_of(unknown(k)))];
    for (Index k = 0; k < row_size_; ++k)
      delta[row(k)] = -right_[static_cast<Index>(place_of(n_ + row(k)))];
  }

 private:
  static Index most_fill(Index n, Index m) { return n * (n + m) / 8; }
  static int& at(std::vector<int>& v, int i) { return v[static_cast<std::size_t>(i)]; }
  int nodes() const { return static_cast<int>(n_ + m_); }
  int& place(int node) { return place_[static_cast<std::size_t>(node)]; }
  std::size_t place_of(Index node) const {
    return static_cast<std::size_t>(place_[static_cast<std::size_t>(node)]);
  }
  bool on(int k) const { return on_[static_cast<std::size_t>(k)] != 0; }

  /// Computes the rows of L from position `first` of the order on. Returns false when a pivot
  /// fails.
  bool factor_from(int first, const Scalar& rho, const Scalar& mu) {
    if (first >= nodes()) return true;
    const Scalar relative = Scalar(4) * scalar_traits<Scalar>::epsilon();
    for (int k = 0; k < first; ++k) {
      if (at(parent_, k) >= first) at(parent_, k) = -1;
      int& length = at(length_, k);
      while (length > 0 && at(row_, at(column_, k) + length - 1) >= first) --length;
    }
    for (int k = first; k < nodes(); ++k) {
      at(parent_, k) = -1;
      at(length_, k) = 0;
      at(mark_, k) = -1;
    }
    for (int k = 0; k < first; ++k) at(mark_, k) = -1;
    for (int k = first; k < nodes(); ++k) {
      if (!on(k)) continue;
      const bool is_unknown = degree_.node(k) < n_;
      const Scalar own = is_unknown ? Scalar(diagonal_[k] + rho) : Scalar(-mu);
      pivot_[k] = make_row(k, own);
      const bool good = is_unknown ? pivot_[k] > relative * own : -pivot_[k] > relative * mu;
      if (!good) {
        free_failed_ = is_unknown;
        good_ = 0;
        return false;
      }
    }
    good_ = nodes();
    return true;
  }

  /// Computes row k of L and returns its pivot.
  Scalar make_row(int k, Scalar pivot) {
    int top = nodes();
    at(mark_, k) = k;
    for (int q = at(upper_start_, k); q < at(upper_start_, k + 1); ++q) {
      int i = at(upper_index_, q);
      if (!on(i)) continue;
      spread_[i] = upper_[static_cast<std::size_t>(q)];
      int length = 0;
      while (at(mark_, i) != k) {
        if (at(parent_, i) < 0) at(parent_, i) = k;
        at(path_, length++) = i;
        at(mark_, i) = k;
        i = at(parent_, i);
      }
      while (length > 0) at(path_, --top) = at(path_, --length);
    }
    while (top < nodes()) {
      // Successive columns with the same rows (a supernode) need only one pass over the rows.
      int width = 1;
      while (width < kMostColumns && top + width < nodes() &&
             share_rows(at(path_, top + width - 1), at(path_, top + width)))
        ++width;
      if (width == 3) width = 2;
      if (width == 4) {
        eliminate<4>(top);
      } else if (width == 2) {
        eliminate<2>(top);
      } else {
        eliminate<1>(top);
      }
      for (const int end = top + width; top < end; ++top) {
        const int i = at(path_, top);
        const Scalar value = spread_[i];
        const int last = at(column_, i) + at(length_, i)++;
        spread_[i] = Scalar(0);
        at(row_, last) = k;
        entry_[static_cast<std::size_t>(last)] = value / pivot_[i];
        pivot -= entry_[static_cast<std::size_t>(last)] * value;
      }
    }
    return pivot;
  }

  /// Returns true when columns i and `next` belong to one supernode: the first row of column i is
  /// `next`, and its other rows are those of column `next`.
  bool share_rows(int i, int next) {
    return at(length_, i) == at(length_, next) + 1 && at(row_, at(column_, i)) == next;
  }

  /// Eliminates `Width` columns of one supernode, path_[top] and the next ones, from the row in
  /// spread_.
  template <int Width>
  void eliminate(int top) {
    const Scalar* entry[Width];
    Scalar value[Width];
    for (int c = 0; c < Width; ++c) {
      const int i = at(path_, top + c);
      entry[c] = entry_.data() + at(column_, i) + (Width - 1 - c);
      value[c] = spread_[i];
      for (int b = 0; b < c; ++b) value[c] -= *(entry[b] - (Width - c)) * value[b];
      spread_[i] = value[c];
    }
    const int last = at(path_, top + Width - 1);
    const int* row = row_.data() + at(column_, last);
    const int count = at(length_, last);
    Scalar* spread = spread_.data();
    for (int q = 0; q < count; ++q) {
      Scalar sum = entry[0][q] * value[0];
      for (int c = 1; c < Width; ++c) sum += entry[c][q] * value[c];
      spread[row[q]] -= sum;
    }
  }

  static constexpr int kMostColumns = 4;

  detail::MinimumDegree degree_;
  std::vector<int> place_;  // by node; all others by position in the order
  std::vector<int> column_, length_, parent_, mark_, path_;
  std::vector<int> upper_start_, upper_index_, row_;
  std::vector<int> free_, active_;
  std::vector<char> on_;
  std::vector<Scalar> upper_, entry_;
  Vector diagonal_, pivot_, spread_, right_;
  Index n_ = 0, m_ = 0, free_size_ = 0, row_size_ = 0;
  int good_ = 0;  // number of valid rows of L
  bool free_failed_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
