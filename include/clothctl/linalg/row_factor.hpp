#pragma once

// Newton systems of a regularised QP on its free unknowns F and active rows W:
//
//   | H_FF + ρ I   A_WFᵀ | |  p |     | r1 |
//   |                    | |    | = - |    |
//   | A_WF         -μ I  | | -δ |     | r2 |
//
//   L Lᵀ = H_FF + ρ I,   V = L⁻¹ A_WFᵀ,   S = μ I + VᵀV
//   S δ = Vᵀ L⁻¹ r1 - r2,    p = L⁻ᵀ (V δ - L⁻¹ r1)
//
// H_FF + ρ I and S are positive definite even if rows are linearly dependent or H is semidefinite,
// so these cases need no special treatment. Vᵀ and G = VᵀV are updated when F changes. A new
// unknown i adds the row v = (A_Wi - Vᵀl)/d to V, where (lᵀ, d) is the new row of L
// (updatable_cholesky.hpp). When an unknown leaves, the rotations that update L are applied to the
// rows of V, and the last row is deleted. G changes by ±v vᵀ. With f free unknowns and w active
// rows the cost is O(f² + f w + w²) for each unknown that changes, and w³/3 for the factor of S.
// When many unknowns change, and after many updates, everything is factored from scratch.

#include <algorithm>
#include <vector>

#include "clothctl/linalg/updatable_cholesky.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Factor of the regularised KKT system of changing sets F and W.
template <RealScalar Scalar>
class RowFactor {
 public:
  /// A dense matrix.
  using Matrix = MatrixX<Scalar>;
  /// A read-only view of a matrix.
  using MatrixView = Eigen::Ref<const Matrix>;

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    free_.reserve(n);
    Vt_.setZero(m, n);
    S_.setZero(m, m);
    G_.setZero(m, m);
    carry_.setZero(m);
    scale_.setZero(m);
    right_.setZero(n);
    delta_.setZero(m);
    rows_.assign(static_cast<std::size_t>(m), 0);
    wanted_.assign(static_cast<std::size_t>(n), 0);
    place_.assign(static_cast<std::size_t>(m), -1);
    rows_count_ = 0;
    stale_ = true;
  }

  /// Clears the factor. Call this after a change of the matrices or of ρ.
  void clear() {
    free_.clear();
    clear_rows();
  }
  /// Discards the factor of S. Call this after a change of μ.
  void touch() { stale_ = true; }

  /// Number of free unknowns.
  Index free_size() const { return free_.size(); }
  /// Number of active rows.
  Index row_size() const { return rows_count_; }
  /// The free unknown at position k of the factor.
  Index unknown(Index k) const { return free_.order(k); }
  /// The active row at position k of the factor.
  Index row(Index k) const { return rows_[static_cast<std::size_t>(k)]; }
  /// Returns true when row i is active.
  bool has_row(Index i) const { return place_[static_cast<std::size_t>(i)] >= 0; }
  /// Returns true when unknown i is free.
  bool has_unknown(Index i) const { return free_.place(i) >= 0; }

  /// Updates the factor to the sets given by the predicates. At is Aᵀ, n×m. Returns false when a
  /// pivot is not large enough: the caller then increases ρ if `free_failed()`, else μ. `changed`
  /// becomes true when a set differs from the previous one.
  template <class IsFree, class IsActive>
  bool sync(const MatrixView& H, const MatrixView& At, const Scalar& rho, const Scalar& mu,
            IsFree is_free, IsActive is_active, bool& changed) {
    const Scalar relative = Scalar(4) * scalar_traits<Scalar>::epsilon();
    free_failed_ = false;
    changed = false;
    Index gone = 0;
    Index fresh = 0;
    for (Index i = 0; i < H.rows(); ++i) {
      const bool in = free_.place(i) >= 0;
      if (is_free(i) && !in) ++fresh;
      if (!is_free(i) && in) ++gone;
    }
    drop_rows(is_active, changed);
    if (gone + fresh > 0) {
      changed = true;
      stale_ = true;
      updates_ += static_cast<int>(gone + fresh);
      const bool many = gone + fresh > 4 && 6 * (gone + fresh) > free_.size() - gone;
      if (many || updates_ > kMostUpdates) {
        Index count = 0;
        for (Index i = 0; i < H.rows(); ++i) {
          if (is_free(i)) wanted_[static_cast<std::size_t>(count++)] = i;
        }
        clear_rows();
        free_.rebuild(H, wanted_, count, rho, relative);
        updates_ = 0;
      } else {
        for (Index k = free_.size(); k-- > 0;) {
          if (!is_free(free_.order(k))) remove_unknown(k);
        }
        for (Index i = 0; i < H.rows(); ++i) {
          if (is_free(i) && free_.place(i) < 0) append_unknown(H, At, i, rho, relative);
        }
      }
      for (Index i = 0; i < H.rows(); ++i) {
        if (is_free(i) && free_.place(i) < 0) free_failed_ = true;
      }
      if (free_failed_) return false;
    }
    add_rows(At, is_active, changed);
    return factor_rows(mu, relative);
  }

  /// Returns true when the pivot that failed last was one of H_FF + ρ I, false when it was one of
  /// S.
  bool free_failed() const { return free_failed_; }

  /// Solves for the right-hand sides r1 (n, read at free unknowns) and r2 (m, read at active rows).
  /// Writes p (n) at free unknowns and delta (m) at active rows only.
  void solve(const VectorX<Scalar>& r1, const VectorX<Scalar>& r2, VectorX<Scalar>& p,
             VectorX<Scalar>& delta) {
    const Index f = free_.size();
    const Index w = rows_count_;
    for (Index k = 0; k < f; ++k) right_[k] = -r1[free_.order(k)];
    free_.solve_lower(right_);
    if (w > 0) {
      for (Index k = 0; k < w; ++k) delta_[k] = Scalar(0);
      add_product(Vt_.data(), Vt_.outerStride(), w, f, right_.data(), delta_.data());
      for (Index k = 0; k < w; ++k) delta_[k] = -delta_[k] - r2[row(k)];
      solve_lower(S_.data(), S_.outerStride(), w, delta_.data());
      solve_upper(S_.data(), S_.outerStride(), w, delta_.data());
      add_transposed_product(Vt_.data(), Vt_.outerStride(), w, f, delta_.data(), right_.data());
      for (Index k = 0; k < w; ++k) delta[row(k)] = delta_[k];
    }
    free_.solve_upper(right_);
    for (Index k = 0; k < f; ++k) p[free_.order(k)] = right_[k];
  }

 private:
  Scalar* v_column(Index k) { return Vt_.data() + k * Vt_.outerStride(); }
  Scalar* g_column(Index k) { return G_.data() + k * G_.outerStride(); }

  Index& place(Index i) { return place_[static_cast<std::size_t>(i)]; }

  void clear_rows() {
    for (Index k = 0; k < rows_count_; ++k) place(row(k)) = -1;
    rows_count_ = 0;
    stale_ = true;
  }

  /// Removes a free unknown from L, Vᵀ and G.
  void remove_unknown(Index k) {
    const Index w = rows_count_;
    const Index behind = free_.size() - k - 1;
    free_.remove(k);
    std::copy_n(v_column(k), w, carry_.data());
    for (Index j = 0; j < behind; ++j) {
      std::copy_n(v_column(k + j + 1), w, v_column(k + j));
      apply_rotation(w, free_.cosine()[j], free_.sine()[j], v_column(k + j), carry_.data());
    }
    for (Index c = 0; c < w; ++c) add_scaled(w, Scalar(-carry_[c]), carry_.data(), g_column(c));
  }

  /// Adds a free unknown to L, Vᵀ and G.
  void append_unknown(const MatrixView& H, const MatrixView& At, Index i, const Scalar& rho,
                      const Scalar& relative) {
    const Index w = rows_count_;
    const Index f = free_.size();
    if (!free_.append(H, i, rho, relative) || w == 0) return;
    using std::sqrt;
    std::fill_n(carry_.data(), w, Scalar(0));
    add_product(Vt_.data(), Vt_.outerStride(), w, f, free_.column().data(), carry_.data());
    const Scalar inverse = Scalar(1) / sqrt(free_.pivot());
    for (Index c = 0; c < w; ++c) Vt_(c, f) = (At(i, row(c)) - carry_[c]) * inverse;
    for (Index c = 0; c < w; ++c) add_scaled(w, Vt_(c, f), v_column(f), g_column(c));
  }

  template <class IsActive>
  void drop_rows(IsActive is_active, bool& changed) {
    const Index f = free_.size();
    for (Index k = rows_count_; k-- > 0;) {
      if (is_active(row(k))) continue;
      const Index last = --rows_count_;
      place(row(k)) = -1;
      if (k != last) {
        for (Index j = 0; j < f; ++j) Vt_(k, j) = Vt_(last, j);
        for (Index j = 0; j < last; ++j) G_(k, j) = G_(last, j);
        for (Index j = 0; j < last; ++j) G_(j, k) = G_(k, j);
        G_(k, k) = G_(last, last);
        rows_[static_cast<std::size_t>(k)] = row(last);
        place(row(k)) = k;
      }
      stale_ = true;
      changed = true;
    }
  }

  template <class IsActive>
  void add_rows(const MatrixView& At, IsActive is_active, bool& changed) {
    const Index f = free_.size();
    const Index old = rows_count_;
    for (Index i = 0; i < At.cols(); ++i) {
      if (!is_active(i) || has_row(i)) continue;
      for (Index k = 0; k < f; ++k) Vt_(rows_count_, k) = At(free_.order(k), i);
      rows_[static_cast<std::size_t>(rows_count_)] = i;
      place(i) = rows_count_++;
    }
    const Index w = rows_count_;
    if (w == old) return;
    right_solve<Scalar>(free_.lower(), Vt_.block(old, 0, w - old, f));
    for (Index c = 0; c < w; ++c) std::fill(g_column(c) + old, g_column(c) + w, Scalar(0));
    if (f > 0)
      subtract_outer<Scalar>(G_.block(old, 0, w - old, w), Vt_.block(old, 0, w - old, f),
                             Vt_.topLeftCorner(w, f));
    for (Index i = old; i < w; ++i) {
      for (Index j = 0; j < w; ++j) {
        if (j > i) continue;  // row j handles the transposed entry
        G_(i, j) = -G_(i, j);
        G_(j, i) = G_(i, j);
      }
    }
    stale_ = true;
    changed = true;
  }

  bool factor_rows(const Scalar& mu, const Scalar& relative) {
    if (!stale_) return true;
    const Index w = rows_count_;
    for (Index c = 0; c < w; ++c) {
      std::copy_n(g_column(c), w, &S_.coeffRef(0, c));
      S_(c, c) += mu;
      scale_[c] = S_(c, c);
    }
    stale_ = cholesky_in_place<Scalar>(S_.topLeftCorner(w, w), scale_.head(w), relative) < w;
    return !stale_;
  }

  static constexpr int kMostUpdates = 200;

  UpdatableCholesky<Scalar> free_;
  Matrix Vt_, S_, G_;
  VectorX<Scalar> scale_, right_, delta_, carry_;
  int updates_ = 0;
  std::vector<Index> rows_, place_, wanted_;
  Index rows_count_ = 0;
  bool stale_ = true, free_failed_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
