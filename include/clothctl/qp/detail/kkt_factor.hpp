#pragma once

// The factor of the regularised optimality equations over changing sets of unknowns and rows: dense
// (linalg/row_factor.hpp), or sparse (linalg/sparse_ldlt.hpp) when H and A have enough zeros to
// make it cheaper. A pivot of the sparse factor can fail by rounding alone. The dense factor then
// takes over: its first block is H_FF + ρ I itself, so it shows whether negative curvature is the
// cause.

#include "clothctl/linalg/row_factor.hpp"
#include "clothctl/linalg/sparse_ldlt.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Solves | H_FF + ρ I, A_WFᵀ; A_WF, -μ I | over sets F and W, by the cheaper of two factors.
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

  /// Forgets everything and works on dense matrices until `choose`.
  void reset() {
    is_sparse_ = false;
    clear();
  }

  /// Forgets everything and chooses a factor for H, A and Aᵀ.
  void choose(const Columns<Scalar>& H, const Columns<Scalar>& A, const Columns<Scalar>& At) {
    reset();
    if (!H.sparse() || !A.sparse() || !At.sparse()) return;
    const double n = static_cast<double>(H.columns()), m = static_cast<double>(A.rows());
    is_sparse_ = sparse_.analyse(H, A, At, (n + m) * (n + m) * (n + m) / kDenseSpeed);
    clear();
  }

  /// Returns true when the sparse factor was chosen.
  bool sparse() const { return is_sparse_; }

  /// Forgets the sets (the matrices or ρ changed).
  void clear() {
    dense_.clear();
    sparse_.clear();
  }
  /// Forgets what depends on μ.
  void touch() { is_sparse_ ? sparse_.touch() : dense_.touch(); }

  /// Number of free unknowns.
  Index free_size() const { return is_sparse_ ? sparse_.free_size() : dense_.free_size(); }
  /// Number of active rows.
  Index row_size() const { return is_sparse_ ? sparse_.row_size() : dense_.row_size(); }
  /// The free unknown at place k.
  Index unknown(Index k) const { return is_sparse_ ? sparse_.unknown(k) : dense_.unknown(k); }
  /// The active row at place k.
  Index row(Index k) const { return is_sparse_ ? sparse_.row(k) : dense_.row(k); }

  /// Brings the factor to the sets that the predicates name; At is Aᵀ. Returns false when a pivot
  /// fails: raise ρ (when `free_failed()`) or μ. `changed` says whether a set differs from before.
  template <class IsFree, class IsActive>
  bool sync(const MatrixView& H, const MatrixView& At, const Scalar& rho, const Scalar& mu,
            IsFree is_free, IsActive is_active, bool& changed) {
    if (is_sparse_) {
      if (sparse_.sync(rho, mu, is_free, is_active, changed)) return true;
      is_sparse_ = false;
    }
    return dense_.sync(H, At, rho, mu, is_free, is_active, changed);
  }

  /// Returns true when the last failure lay at an unknown (else at a row).
  bool free_failed() const { return is_sparse_ ? sparse_.free_failed() : dense_.free_failed(); }

  /// Solves for r1 (n, read at free places) and r2 (m, read at active places); p and delta (full
  /// length) are written at free and active places only.
  void solve(const Vector& r1, const Vector& r2, Vector& p, Vector& delta) {
    is_sparse_ ? sparse_.solve(r1, r2, p, delta) : dense_.solve(r1, r2, p, delta);
  }

 private:
  static constexpr double kDenseSpeed =
      32;  // operations of the dense factor in the time of one of the sparse

  RowFactor<Scalar> dense_;
  SparseLdlt<Scalar> sparse_;
  bool is_sparse_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
