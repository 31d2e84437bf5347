#pragma once

// The operations of the box method on a dense Hessian: products, the factor of the free block, and
// slope and curvature along a search path.

#include <algorithm>
#include <vector>

#include "clothctl/linalg/updatable_cholesky.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/special/active_bounds.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A dense positive semidefinite H with the factor L Lᵀ = H_FF. All memory comes from `reserve`.
template <RealScalar Scalar>
class DenseCurvature {
 public:
  using Vector = VectorX<Scalar>;
  using ConstMap = Eigen::Map<const MatrixX<Scalar>>;

  /// H_FF may be singular, so directions of zero curvature exist.
  static constexpr bool kDefinite = false;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) {
    factor_.reserve(n);
    active_bounds_.reserve(n);
    w_.setZero(n);
    solution_.setZero(n);
    n_ = 0;
  }
  /// Sets the matrix of the next solves. H is not copied, so it must outlive these solves.
  void attach(const ConstMap& H) {
    data_ = H.data();
    n_ = H.rows();
  }

  /// Number of unknowns.
  Index unknowns() const { return n_; }
  /// H.
  ConstMap H() const { return {data_, n_, n_}; }
  /// H_ii.
  Scalar diagonal(Index i) const { return H()(i, i); }
  /// The factor of the free block.
  UpdatableCholesky<Scalar>& factor() { return factor_; }
  /// The minimiser for few active bounds.
  ActiveBounds<Scalar>& active_bounds() { return active_bounds_; }

  /// Number of unknowns in the factor.
  Index size() const { return factor_.size(); }
  /// The unknown at position k of the factor.
  Index order(Index k) const { return factor_.order(k); }
  /// The position of unknown i in the factor, or -1.
  Index place(Index i) const { return factor_.place(i); }
  /// Empties the factor.
  void clear() { factor_.clear(); }
  /// Returns true when `changes` single updates are cheaper than a factorisation from scratch,
  /// given that `kept` unknowns stay.
  bool few(Index changes, Index kept) const {
    return changes <= kFewChanges || kUpdateCost * changes <= kept;
  }
  /// Adds unknown i to the factor, unless the enlarged block would be singular.
  void append(Index i) { factor_.append(H(), i, Scalar(0), pivot_tolerance()); }
  /// Removes the unknown at position k of the factor.
  void remove(Index k) { factor_.remove(k); }
  /// Factors the block of `wanted[0 … count-1]` from scratch. Leaves out unknowns that would make
  /// it singular.
  void renew(const std::vector<Index>& wanted, Index count) {
    factor_.rebuild(H(), wanted, count, Scalar(0), pivot_tolerance());
  }

  /// q += H x.
  void add_product(const Vector& x, Vector& q) const {
    ColumnSum<Scalar> sum(data_, n_, n_, q.data());
    for (Index j = 0; j < n_; ++j) sum.add(j, x[j]);
    sum.finish();
  }
  /// p_F = -H_FF⁻¹ q_F.
  void newton(const Vector& q, Vector& p) {
    const Index f = size();
    for (Index k = 0; k < f; ++k) solution_[k] = -q[order(k)];
    factor_.solve_lower(solution_);
    factor_.solve_upper(solution_);
    for (Index k = 0; k < f; ++k) p[order(k)] = solution_[k];
  }

  /// Starts a search along p. Only the entries moving[0 … count-1] of p are not zero.
  void start_walk(const std::vector<Index>& moving, Index count, const Vector& p, const Vector&) {
    std::fill_n(w_.data(), n_, Scalar(0));
    ColumnSum<Scalar> sum(data_, n_, n_, w_.data());
    for (Index k = 0; k < count; ++k) {
      const Index i = moving[static_cast<std::size_t>(k)];
      sum.add(i, p[i]);
    }
    sum.finish();
  }
  /// Computes slope qᵀp and curvature pᵀH p over the unknowns that still move. `size` is Σ H_ii
  /// p_i².
  void line(const std::vector<Index>& moving, Index count, const Vector& p, const Vector& q,
            Scalar& slope, Scalar& curvature, Scalar& size) const {
    slope = curvature = size = Scalar(0);
    for (Index k = 0; k < count; ++k) {
      const Index i = moving[static_cast<std::size_t>(k)];
      slope += q[i] * p[i];
      curvature += w_[i] * p[i];
      size += diagonal(i) * p[i] * p[i];
    }
  }
  /// Moves by `step` along p: updates the gradient q.
  void advance(const Scalar& step, Vector& q) { add_scaled(n_, step, w_.data(), q.data()); }
  /// Stops unknown i at its bound: removes p_i from the direction.
  void stop(Index i, const Vector& p, Vector&) {
    add_scaled(n_, Scalar(-p[i]), data_ + i * n_, w_.data());
  }
  /// Ends the search. q is the gradient at its end.
  void end_walk(const std::vector<Index>&, Index, const Vector&, Vector&) {}

 private:
  static constexpr Index kFewChanges = 4, kUpdateCost = 6;

  static Scalar pivot_tolerance() {
    using std::sqrt;
    const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
    return half * sqrt(sqrt(half));
  }

  UpdatableCholesky<Scalar> factor_;
  ActiveBounds<Scalar> active_bounds_;
  Vector w_, solution_;
  const Scalar* data_ = nullptr;
  Index n_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
