#pragma once

// The minimiser on a given active set for a dense H, for sequences of problems in which few bounds
// are active. With K = H⁻¹, computed once for each H, the minimiser on the active set A (x_A = b_A)
// is
//
//   u = -K g,   K_AA z_A = b_A - u_A,   x = u + K_{:A} z_A
//
// The factor of K_AA is updated when A changes (updatable_cholesky.hpp). Cost for a = |A| active
// bounds: n³/2 for K, n² for u in each solve, n a in each round, and a² for each unknown that
// enters or leaves A. It does not depend on the number of free unknowns.

#include <algorithm>
#include <cmath>
#include <vector>

#include "clothctl/linalg/updatable_cholesky.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/factor_update.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Keeps K and the factor of K_AA between solves. All memory comes from `reserve`.
template <RealScalar Scalar>
class ActiveBounds {
 public:
  using Vector = VectorX<Scalar>;
  using ConstMap = Eigen::Map<const MatrixX<Scalar>>;

  /// Largest number of unknowns. For more, the computation of K takes longer than it saves.
  static constexpr Index kMostUnknowns = 400;

  /// Makes room for n unknowns, at most kMostUnknowns. Allocates.
  void reserve(Index n) {
    n = (std::min)(n, kMostUnknowns);
    K_.setZero(n, n);
    set_zero<Scalar>({&u_, &solution_}, n);
    for (std::vector<Index>* v : {&fresh_, &kept_}) v->assign(static_cast<std::size_t>(n), 0);
    factor_.reserve(n, most(n));
    forget();
  }

  /// Discards K. Call this after a change of the Hessian.
  void forget() {
    known_ = refused_ = false;
    factor_.clear();
  }
  /// Returns true when K is known.
  bool known() const { return known_; }
  /// Returns true when this class is efficient for n unknowns with `active` active bounds.
  static bool suits(Index active, Index n) { return n <= kMostUnknowns && active <= most(n); }

  /// Returns true when `prepare` was called for this Hessian, whether it succeeded or not.
  bool ready() const { return known_ || refused_; }

  /// Computes K, unless a pivot shows that H is almost singular. The rounding errors of K are not
  /// checked here: the solver checks the residuals of every solution. Overwrites `scratch`, at
  /// least n×n. Never allocates. Complexity: n³/2.
  void prepare(const ConstMap& H, Eigen::Ref<MatrixX<Scalar>> scratch) {
    using std::sqrt;
    forget();
    n_ = H.rows();
    Eigen::Ref<MatrixX<Scalar>> K = K_.topLeftCorner(n_, n_);
    for (Index j = 0; j < n_; ++j) {
      for (Index i = 0; i < n_; ++i) K(i, j) = H(i, j);
      u_[j] = H(j, j);
    }
    const Scalar least = Scalar(8) * sqrt(scalar_traits<Scalar>::epsilon());
    refused_ = cholesky_in_place<Scalar>(K, u_.head(n_), least) < n_;
    if (refused_) return;
    Eigen::Ref<MatrixX<Scalar>> X = scratch.topLeftCorner(n_, n_);  // L⁻ᵀ; K = X Xᵀ
    for (Index j = 0; j < n_; ++j) {
      for (Index i = 0; i < n_; ++i) X(i, j) = Scalar(i == j ? 1 : 0);
    }
    for (Index i = 0; i < n_; i += kTile) {
      const Index rest = n_ - i;
      right_solve<Scalar>(K.bottomRightCorner(rest, rest),
                          X.block(i, i, (std::min)(kTile, rest), rest));
    }
    for (Index j = 0; j < n_; ++j) {
      for (Index i = 0; i < n_; ++i) K(i, j) = Scalar(0);
    }
    for (Index j = 0; j < n_; j += kTile) {
      const Index nj = (std::min)(kTile, n_ - j);
      for (Index i = j; i < n_; i += kTile) {
        const Index ni = (std::min)(kTile, n_ - i), rest = n_ - i;
        subtract_outer<Scalar>(K.block(i, j, ni, nj), X.block(i, i, ni, rest),
                               X.block(j, i, nj, rest));
      }
    }
    for (Index j = 0; j < n_; ++j) {
      for (Index i = j; i < n_; ++i) K(j, i) = K(i, j) = -K(i, j);
    }
    known_ = true;
  }

  /// Starts the rounds of a solve with gradient g, n entries.
  void start_rounds(const Vector& g) {
    for (Index i = 0; i < n_; ++i) solution_[i] = -g[i];
    multiply(solution_, u_);
  }

  /// Computes the minimiser x on the active set and, on the set, the multipliers z
  /// (primal_dual_active_set.hpp). Returns false when the set is too large, or K_AA is singular to
  /// rounding. Never allocates.
  template <class SideOf>
  bool minimise(const Vector&, const Vector& lo, const Vector& hi, SideOf side_of,
                const Scalar& tolerance, Vector& x, Vector& z) {
    Index active = 0;
    for (Index i = 0; i < n_; ++i) active += side_of(i) != QpSide::Between ? 1 : 0;
    if (!suits(active, n_)) return false;
    update_factor_to(
        *this, n_, [&](Index i) { return side_of(i) != QpSide::Between; }, fresh_, kept_);
    if (size() != active) return false;
    const auto bound = [&](Index i) { return side_of(i) == QpSide::Lower ? lo[i] : hi[i]; };
    for (Index k = 0; k < active; ++k) solution_[k] = bound(order(k)) - u_[order(k)];
    add_bound_forces(u_, x);
    using std::abs;
    using std::sqrt;
    Scalar sum_of_forces(0), largest_force(0);  // |z_i|, in units in which every K_ii is 1
    for (Index k = 0; k < active; ++k) {
      const Scalar own = abs(solution_[k]) * sqrt(K_(order(k), order(k)));
      sum_of_forces += own;
      largest_force = (std::max)(largest_force, own);
    }
    const Scalar rounding = Scalar(32) * scalar_traits<Scalar>::epsilon();
    for (Index i = 0; i < n_; ++i) {
      if (place(i) < 0)
        x[i] = snap(x[i], lo[i], hi[i],
                    Scalar(rounding * (abs(u_[i]) + sqrt(K_(i, i)) * sum_of_forces)));
    }
    for (Index k = 0; k < active; ++k) {
      const Index i = order(k);
      z[i] = abs(solution_[k]) * sqrt(K_(i, i)) <= tolerance * largest_force ? Scalar(0)
                                                                             : solution_[k];
      x[i] = bound(i);
    }
    return true;
  }

  /// Computes p_F = -H_FF⁻¹ q_F for the unknowns outside the last active set, and p = 0 on it. Uses
  /// n entries of q and p. Never allocates.
  void newton(const Vector& q, Vector& p) {
    for (Index i = 0; i < n_; ++i) p[i] = -q[i];
    for (Index k = 0; k < size(); ++k) p[order(k)] = Scalar(0);
    multiply(p, u_);
    for (Index k = 0; k < size(); ++k) solution_[k] = -u_[order(k)];
    add_bound_forces(u_, p);
    for (Index k = 0; k < size(); ++k) p[order(k)] = Scalar(0);
  }

  // The interface that update_factor_to needs of the factor of K_AA.
  Index size() const { return factor_.size(); }
  Index order(Index k) const { return factor_.order(k); }
  Index place(Index i) const { return factor_.place(i); }
  bool few(Index changes, Index kept) const { return changes <= 4 || 6 * changes <= kept; }
  void append(Index i) { factor_.append(K_.topLeftCorner(n_, n_), i, Scalar(0), dependent()); }
  void remove(Index k) { factor_.remove(k); }
  void renew(const std::vector<Index>& wanted, Index count) {
    factor_.rebuild(K_.topLeftCorner(n_, n_), wanted, count, Scalar(0), dependent());
  }

 private:
  static Index most(Index n) { return n / 3; }
  static Scalar dependent() { return Scalar(8) * scalar_traits<Scalar>::epsilon(); }

  /// Computes product = K v.
  void multiply(const Vector& v, Vector& product) const {
    std::fill_n(product.data(), n_, Scalar(0));
    add_product(K_.data(), K_.outerStride(), n_, n_, v.data(), product.data());
  }

  /// Computes x = u + K_{:A} K_AA⁻¹ r for r in the head of solution_, and leaves K_AA⁻¹ r there.
  void add_bound_forces(const Vector& u, Vector& x) {
    factor_.solve_lower(solution_);
    factor_.solve_upper(solution_);
    std::copy_n(u.data(), n_, x.data());
    ColumnSum<Scalar> sum(K_.data(), K_.outerStride(), n_, x.data());
    for (Index k = 0; k < size(); ++k) sum.add(order(k), solution_[k]);
    sum.finish();
  }

  MatrixX<Scalar> K_;
  UpdatableCholesky<Scalar> factor_;
  Vector u_, solution_;
  std::vector<Index> fresh_, kept_;
  Index n_ = 0;
  bool known_ = false, refused_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
