#pragma once

// The operations of the box method on a Hessian that is diagonal plus low rank:
//
//   H = D + NᵀN,  D > 0 diagonal, N r×n          S = I + N_F D_F⁻¹ N_Fᵀ = L diag(d) Lᵀ,  r×r
//   H_FF⁻¹ = D_F⁻¹ - D_F⁻¹ N_Fᵀ S⁻¹ N_F D_F⁻¹      (Woodbury)
//
// F are the free unknowns. When an unknown enters or leaves F, L and d change by a rank-one update,
// O(r²) for any size f of F. A Newton step costs O(r f + r²), a gradient O(r n), and a breakpoint
// of a line search O(r), because the gradient after a move Δx of the search is q + D Δx + NᵀU with
// U = N Δx. The minimiser on an active set A, x_A = b_A, follows from c = N x in O(r n + r²):
//
//   S c = N_A b_A - N_F D_F⁻¹ g_F,   x_F = -D_F⁻¹ (g_F + N_Fᵀ c),   z_A = D_A b_A + g_A + N_Aᵀ c

#include <algorithm>
#include <cmath>
#include <vector>

#include "clothctl/linalg/tiled_cholesky.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/factor_update.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// L diag(d) Lᵀ ← L diag(d) Lᵀ + weight v vᵀ in place, for a unit lower triangular L (r×r).
/// Overwrites v. Returns false when the result would not be positive definite; the factor is then
/// no longer valid. Complexity: O(r²), with one division for each column. Reference: Gill, Golub,
/// Murray and Saunders, Math. Comp. 28 (1974), method C1.
template <RealScalar Scalar>
bool rank_one_change(Eigen::Ref<MatrixX<Scalar>> L, Eigen::Ref<VectorX<Scalar>> d,
                     Eigen::Ref<VectorX<Scalar>> v, Scalar weight) {
  const Index r = L.rows();
  for (Index j = 0; j < r; ++j) {
    const Scalar p = v[j];
    const Scalar old = d[j];
    const Scalar next = old + weight * p * p;
    if (!(next > Scalar(0))) return false;
    const Scalar inverse = Scalar(1) / next;
    const Scalar share = weight * p * inverse;
    weight *= old * inverse;
    d[j] = next;
    const Index below = r - j - 1;
    if (below == 0) break;
    Scalar* const column = &L.coeffRef(j + 1, j);
    Scalar* const rest = &v.coeffRef(j + 1);
    for (Index i = 0; i < below; ++i) {
      rest[i] -= p * column[i];
      column[i] += share * rest[i];
    }
  }
  return true;
}

/// D + NᵀN with the factor of S for the free unknowns. All memory comes from `reserve`.
template <RealScalar Scalar>
class LowRankCurvature {
 public:
  using Matrix = MatrixX<Scalar>;
  using Vector = VectorX<Scalar>;

  /// D > 0, so H_FF is never singular.
  static constexpr bool kDefinite = true;

  /// Makes room for n unknowns and rank r. Allocates.
  void reserve(Index n, Index r) {
    N_.resize(r, n);
    L_.resize(r, r);
    S_.resize(r, r);
    for (Matrix* M : {&batch_, &weighted_}) M->resize(r, kBatch);
    in_S_.assign(static_cast<std::size_t>(n), 0);
    set_zero<Scalar>({&D_, &inverse_, &share_}, n);
    set_zero<Scalar>({&work_, &v_, &U_, &d_, &right_}, r);
    for (std::vector<Index>* v : {&order_, &fresh_, &kept_})
      v->assign(static_cast<std::size_t>(n), 0);
    place_.assign(static_cast<std::size_t>(n), -1);
    n_ = r_ = size_ = 0;
  }
  /// Sets the sizes of D and N, and clears the free set. The caller must then fill D and N.
  void resize(Index n, Index r) {
    for (Matrix* M : {&L_, &S_, &batch_, &weighted_}) M->setZero();
    clear();
    n_ = n;
    r_ = r;
    summed_ = kMostSummed;
    for (Index i = 0; i < n; ++i) place_[static_cast<std::size_t>(i)] = -1;
  }
  /// N, r×n, for the caller to fill.
  Eigen::Ref<Matrix> N() { return N_.topLeftCorner(r_, n_); }
  /// Sets D_i > 0.
  void set_diagonal(Index i, const Scalar& d) {
    D_[i] = d;
    inverse_[i] = Scalar(1) / d;
  }

  /// Number of unknowns.
  Index unknowns() const { return n_; }
  /// H_ii.
  Scalar diagonal(Index i) const { return D_[i] + dot_product(r_, column(i), column(i)); }
  /// Number of free unknowns.
  Index size() const { return size_; }
  /// The free unknown at position k of the list.
  Index order(Index k) const { return order_[static_cast<std::size_t>(k)]; }
  /// The position of unknown i in the list of free unknowns, or -1.
  Index place(Index i) const { return place_[static_cast<std::size_t>(i)]; }
  /// Empties the free set.
  void clear() {
    for (Index k = 0; k < size_; ++k) place_[static_cast<std::size_t>(order(k))] = -1;
    size_ = 0;
    updates_ = 0;
    summed_ = kMostSummed;
    set_identity(L_);
    std::fill_n(d_.data(), r_, Scalar(1));
  }
  /// Returns true when `changes` updates of the factor are cheaper than an update of S and a new
  /// factor, given that `kept` unknowns stay.
  bool few(Index changes, Index kept) const {
    const Index to_sum = (std::min)(kept, static_cast<Index>(updates_) + changes);
    return updates_ + changes <= kMostUpdates && kUpdateCost * changes <= to_sum + r_ / 2;
  }

  /// Adds unknown i to the free set.
  void append(Index i) {
    order_[static_cast<std::size_t>(size_)] = i;
    place_[static_cast<std::size_t>(i)] = size_++;
    change(i, 1);
  }
  /// Removes the unknown at position k. The last unknown moves to this position.
  void remove(Index k) {
    const Index i = order(k), last = order(--size_);
    order_[static_cast<std::size_t>(k)] = last;
    place_[static_cast<std::size_t>(last)] = k;
    place_[static_cast<std::size_t>(i)] = -1;
    change(i, -1);
  }
  /// Makes `wanted[0 … count-1]` the free set, and factors S from scratch.
  void renew(const std::vector<Index>& wanted, Index count) {
    for (Index k = 0; k < size_; ++k) place_[static_cast<std::size_t>(order(k))] = -1;
    for (Index k = 0; k < count; ++k) {
      const Index i = wanted[static_cast<std::size_t>(k)];
      order_[static_cast<std::size_t>(k)] = i;
      place_[static_cast<std::size_t>(i)] = k;
    }
    size_ = count;
    refactor();
  }

  /// q += H x.
  void add_product(const Vector& x, Vector& q) {
    std::fill_n(work_.data(), r_, Scalar(0));
    ColumnSum<Scalar> sum = sum_of_columns(work_);
    for (Index j = 0; j < n_; ++j) {
      sum.add(j, x[j]);
      q[j] += D_[j] * x[j];
    }
    sum.finish();
    add_transposed_product(N_.data(), N_.outerStride(), r_, n_, work_.data(), q.data());
  }
  /// p_F = -H_FF⁻¹ q_F.
  void newton(const Vector& q, Vector& p) {
    std::fill_n(work_.data(), r_, Scalar(0));
    ColumnSum<Scalar> sum = sum_of_columns(work_);
    for (Index k = 0; k < size_; ++k) {
      const Index i = order(k);
      p[i] = -q[i] * inverse_[i];
      sum.add(i, p[i]);
    }
    sum.finish();
    solve(work_);
    for (Index k = 0; k < size_; ++k) {
      const Index i = order(k);
      p[i] -= inverse_[i] * dot_product(r_, column(i), work_.data());
    }
  }

  /// Starts the primal-dual rounds of a solve.
  void start_rounds(const Vector&) {
    std::fill_n(right_.data(), r_, Scalar(0));
    std::fill_n(share_.data(), n_, Scalar(0));
  }
  /// Computes the minimiser x on the active set of side_of and, on the set, the multipliers z
  /// (primal_dual_active_set.hpp). Never allocates.
  template <class SideOf>
  bool minimise(const Vector& g, const Vector& lo, const Vector& hi, SideOf side_of,
                const Scalar& tolerance, Vector& x, Vector& z) {
    using std::abs;
    update_factor_to(
        *this, n_, [&](Index i) { return side_of(i) == QpSide::Between; }, fresh_, kept_);
    ColumnSum<Scalar> sum = sum_of_columns(right_);
    for (Index i = 0; i < n_; ++i) {
      const QpSide side = side_of(i);
      x[i] = side == QpSide::Lower   ? lo[i]
             : side == QpSide::Upper ? hi[i]
                                     : Scalar(-g[i] * inverse_[i]);
      sum.add(i, Scalar(x[i] - share_[i]));
      share_[i] = x[i];
    }
    sum.finish();
    std::copy_n(right_.data(), r_, work_.data());
    solve(work_);
    std::fill_n(z.data(), n_, Scalar(0));
    add_transposed_product(N_.data(), N_.outerStride(), r_, n_, work_.data(), z.data());
    const Scalar rounding = Scalar(32) * scalar_traits<Scalar>::epsilon();
    for (Index i = 0; i < n_; ++i) {
      const Scalar coupling = z[i], own = D_[i] * x[i];
      if (place(i) >= 0) {
        const Scalar slack = rounding * (abs(coupling) + abs(g[i])) * inverse_[i];
        x[i] = snap(Scalar(x[i] - coupling * inverse_[i]), lo[i], hi[i], slack);
      } else {
        z[i] = coupling + own + g[i];
        if (abs(z[i]) <= tolerance * (abs(coupling) + abs(own) + abs(g[i]))) z[i] = Scalar(0);
      }
    }
    return true;
  }

  /// Starts a search along p. Only the entries moving[0 … count-1] of p are not zero.
  void start_walk(const std::vector<Index>& moving, Index count, const Vector& p, const Vector& q) {
    std::fill_n(v_.data(), r_, Scalar(0));
    std::fill_n(U_.data(), r_, Scalar(0));
    slope_ = axial_ = length_ = Scalar(0);
    left_ = count;
    ColumnSum<Scalar> sum = sum_of_columns(v_);
    for (Index k = 0; k < count; ++k) {
      const Index i = moving[static_cast<std::size_t>(k)];
      sum.add(i, p[i]);
      slope_ += q[i] * p[i];
      axial_ += D_[i] * p[i] * p[i];
    }
    sum.finish();
    bend_ = dot_product(r_, v_.data(), v_.data());
  }
  /// Returns slope qᵀp and curvature pᵀH p over the unknowns that still move.
  void line(const std::vector<Index>&, Index, const Vector&, const Vector&, Scalar& slope,
            Scalar& curvature, Scalar& size) const {
    slope = left_ > 0 ? slope_ : Scalar(0);
    curvature = axial_ + bend_;
    size = curvature;
  }
  /// Moves by `step` along p.
  void advance(const Scalar& step, Vector&) {
    slope_ += step * (axial_ + bend_);
    add_scaled(r_, step, v_.data(), U_.data());
    length_ += step;
  }
  /// Stops unknown i at its bound: removes p_i from the direction.
  void stop(Index i, const Vector& p, Vector& q) {
    q[i] += D_[i] * p[i] * length_;
    slope_ -= p[i] * (q[i] + dot_product(r_, column(i), U_.data()));
    axial_ -= D_[i] * p[i] * p[i];
    if (axial_ < Scalar(0)) axial_ = Scalar(0);
    add_scaled(r_, Scalar(-p[i]), column(i), v_.data());
    bend_ = dot_product(r_, v_.data(), v_.data());
    --left_;
  }
  /// Ends the search. q is the gradient at its end.
  void end_walk(const std::vector<Index>& moving, Index count, const Vector& p, Vector& q) {
    for (Index k = 0; k < count; ++k) {
      const Index i = moving[static_cast<std::size_t>(k)];
      q[i] += D_[i] * p[i] * length_;  // p_i is zero for an unknown that stopped
    }
    add_transposed_product(N_.data(), N_.outerStride(), r_, n_, U_.data(), q.data());
  }

 private:
  static constexpr Index kMostUpdates = 300, kUpdateCost = 3, kMostSummed = 4000, kBatch = 32;

  const Scalar* column(Index i) const { return N_.data() + i * N_.outerStride(); }

  /// A sum of columns of N, added to v.
  ColumnSum<Scalar> sum_of_columns(Vector& v) const {
    return {N_.data(), N_.outerStride(), r_, v.data()};
  }

  /// s ← S⁻¹ s.
  void solve(Vector& s) const {
    solve_lower(L_.data(), L_.outerStride(), r_, s.data(), true);
    for (Index k = 0; k < r_; ++k) s[k] /= d_[k];
    solve_upper(L_.data(), L_.outerStride(), r_, s.data(), true);
  }

  void set_identity(Matrix& M) const {
    for (Index c = 0; c < r_; ++c) {
      for (Index k = 0; k < r_; ++k) M(k, c) = Scalar(k == c ? 1 : 0);
    }
  }

  /// Updates the factor when unknown i enters (sign = 1) or leaves (sign = -1) the free set.
  void change(Index i, int sign) {
    ++updates_;
    std::copy_n(column(i), r_, work_.data());
    const Scalar weight = sign > 0 ? inverse_[i] : Scalar(-inverse_[i]);
    if (!rank_one_change<Scalar>(L_.topLeftCorner(r_, r_), d_.head(r_), work_.head(r_), weight))
      refactor();
  }

  /// Adds weight · N_i N_iᵀ to the batch of changes of S.
  void sum(Index i, const Scalar& weight) {
    for (Index k = 0; k < r_; ++k) {
      batch_(k, batched_) = column(i)[k];
      weighted_(k, batched_) = -weight * column(i)[k];
    }
    if (++batched_ == kBatch) add_batch();
  }

  /// Adds the batch to the lower triangle of S.
  void add_batch() {
    for (Index j = 0; j < r_ && batched_ > 0; j += kTile) {
      const Index rest = r_ - j, nj = (std::min)(kTile, rest);
      subtract_outer<Scalar>(S_.block(j, j, rest, nj), weighted_.block(j, 0, rest, batched_),
                             batch_.block(j, 0, nj, batched_));
    }
    batched_ = 0;
  }

  /// Updates S to the free set. Adds and subtracts the unknowns that changed, or sums all free
  /// unknowns from scratch when they are fewer than the changes, or when rounding errors of many
  /// changes may have accumulated.
  void update_S() {
    Index changes = 0;
    for (Index i = 0; i < n_; ++i)
      changes += (place(i) >= 0) != (in_S_[static_cast<std::size_t>(i)] != 0) ? 1 : 0;
    const bool from_scratch =
        summed_ >= kMostSummed || summed_ + changes > kMostSummed || changes > size_;
    if (from_scratch) {
      set_identity(S_);
      std::fill(in_S_.begin(), in_S_.end(), char(0));
      summed_ = 0;
    } else {
      summed_ += changes;
    }
    for (Index i = 0; i < n_; ++i) {
      char& in = in_S_[static_cast<std::size_t>(i)];
      const char wanted = place(i) >= 0 ? char(1) : char(0);
      if (in == wanted) continue;
      in = wanted;
      sum(i, wanted != 0 ? inverse_[i] : Scalar(-inverse_[i]));
    }
    add_batch();
  }

  /// Factors S from scratch.
  void refactor() {
    updates_ = 0;
    update_S();
    for (Index c = 0; c < r_; ++c) {
      for (Index k = 0; k < r_; ++k) L_(k, c) = S_(k, c);
      d_[c] = S_(c, c);
    }
    // No pivot fails, because S - I is positive semidefinite.
    cholesky_in_place<Scalar>(L_.topLeftCorner(r_, r_), d_.head(r_), Scalar(0));
    for (Index c = 0; c < r_; ++c) {
      const Scalar root = L_(c, c);
      scale_by(r_ - c, Scalar(Scalar(1) / root), &L_.coeffRef(c, c));
      d_[c] = root * root;
    }
  }

  Matrix N_, L_, S_;
  Matrix batch_, weighted_;  // columns to add to S_
  std::vector<char> in_S_;   // 1 for each unknown in S_
  Vector D_, inverse_, work_, v_, U_, d_;
  Vector right_, share_;  // right_ = N share_
  std::vector<Index> order_, place_, fresh_, kept_;
  Scalar slope_ = Scalar(0), axial_ = Scalar(0), bend_ = Scalar(0), length_ = Scalar(0);
  Index n_ = 0, r_ = 0, size_ = 0, left_ = 0, batched_ = 0, updates_ = 0, summed_ = kMostSummed;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
