#pragma once

// The factor of the regularised optimality equations over changing sets of unknowns and rows. The
// factor is sparse (linalg/sparse_ldlt.hpp) when H and A have so many zeros that this is cheaper,
// else dense (linalg/row_factor.hpp). A pivot of the sparse factor can fail because of rounding
// alone, without negative curvature. The dense factor then takes over: it factors H_FF + ρ I first,
// and a pivot that fails there shows negative curvature.

#include "clothctl/linalg/row_factor.hpp"
#include "clothctl/linalg/sparse_ldlt.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Solves | H_FF + ρ I, A_WFᵀ; A_WF, -μ I | for sets F and W, by the cheaper of two factors.
template <RealScalar Scalar>
class KktFactor {
 public:
  using Vector = VectorX<Scalar>;
  using MatrixView = Eigen::Ref<const MatrixX<Scalar>>;

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    dense_.reserve(n, m);
    sparse_.reserve(n, m);
    is_sparse_ = false;
  }

  /// Clears everything, and uses the dense factor until `choose` is called.
  void reset() {
    is_sparse_ = false;
    clear();
  }

  /// Clears everything, and chooses the cheaper factor for H, A and Aᵀ.
  void choose(const Columns<Scalar>& H, const Columns<Scalar>& A, const Columns<Scalar>& At) {
    reset();
    if (!H.sparse() || !A.sparse() || !At.sparse()) return;
    const double n = static_cast<double>(H.columns()), m = static_cast<double>(A.rows());
    is_sparse_ = sparse_.analyse(H, A, At, (n + m) * (n + m) * (n + m) / kDenseSpeed);
    clear();
  }

  /// Returns true when the sparse factor was chosen.
  bool sparse() const { return is_sparse_; }

  /// Clears the sets. Call this after a change of the matrices or of ρ.
  void clear() {
    dense_.clear();
    sparse_.clear();
  }
  /// Discards what depends on μ. Call this after a change of μ.
  void touch() { is_sparse_ ? sparse_.touch() : dense_.touch(); }

  /// Number of free unknowns.
  Index free_size() const { return is_sparse_ ? sparse_.free_size() : dense_.free_size(); }
  /// Number of active rows.
  Index row_size() const { return is_sparse_ ? sparse_.row_size() : dense_.row_size(); }
  /// The k-th free unknown of the factor.
  Index unknown(Index k) const { return is_sparse_ ? sparse_.unknown(k) : dense_.unknown(k); }
  /// The k-th active row of the factor.
  Index row(Index k) const { return is_sparse_ ? sparse_.row(k) : dense_.row(k); }

  /// Updates the factor to the sets given by the predicates; At is Aᵀ. Returns false when a pivot
  /// is not large enough: the caller then increases ρ if `free_failed()`, else μ. `changed` becomes
  /// true when a set differs from the previous one.
  template <class IsFree, class IsActive>
  bool sync(const MatrixView& H, const MatrixView& At, const Scalar& rho, const Scalar& mu,
            IsFree is_free, IsActive is_active, bool& changed) {
    if (is_sparse_) {
      if (sparse_.sync(rho, mu, is_free, is_active, changed)) return true;
      is_sparse_ = false;
    }
    return dense_.sync(H, At, rho, mu, is_free, is_active, changed);
  }

  /// Returns true when the pivot that failed last was that of an unknown, false when it was that of
  /// a row.
  bool free_failed() const { return is_sparse_ ? sparse_.free_failed() : dense_.free_failed(); }

  /// Solves for the right-hand sides r1 (n, read at free unknowns) and r2 (m, read at active rows).
  /// Writes p (n) at free unknowns and delta (m) at active rows only.
  void solve(const Vector& r1, const Vector& r2, Vector& p, Vector& delta) {
    is_sparse_ ? sparse_.solve(r1, r2, p, delta) : dense_.solve(r1, r2, p, delta);
  }

 private:
  /// The dense factor does this many operations in the time of one operation of the sparse factor.
  static constexpr double kDenseSpeed = 32;

  RowFactor<Scalar> dense_;
  SparseLdlt<Scalar> sparse_;
  bool is_sparse_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
