#pragma once

// The solvers' copy of the caller's problem. H is made exactly symmetric, and `no_bound` replaces
// infinite bounds.
//
// `validate_hessian` and `validate_rows` check a matrix before `take` and `take_rows` copy it, so a
// refused matrix changes nothing. `load` takes the vectors of each solve, and replaces the stored
// ones only if all new ones are valid.

#include <algorithm>
#include <string_view>
#include <vector>

#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// H, A, g and bounds of min ½ xᵀHx + gᵀx, lb ≤ x ≤ ub, rl ≤ Ax ≤ ru.
template <RealScalar Scalar>
class ProblemData {
 public:
  /// A read-only view of a vector.
  using VectorView = Eigen::Ref<const VectorX<Scalar>>;
  /// A read-only view of a matrix.
  using MatrixView = Eigen::Ref<const MatrixX<Scalar>>;

  /// Makes room for n unknowns and m rows, and discards both matrices. Allocates.
  void reserve(Index n, Index m) {
    capacity_n_ = n;
    hessian_.assign(static_cast<std::size_t>(n * n), Scalar(0));
    set_zero<Scalar>({&g_, &lo_, &hi_, &lo_next_, &hi_next_}, n);
    n_ = 0;
    refusal_ = {};
    hessian_refusal_ = kNoHessian;
    reserve_rows(m);
  }

  /// Returns true when no size is negative. Otherwise sets `refusal()` and changes nothing else.
  bool may_reserve(Index n, Index m) {
    if (n >= 0 && m >= 0) return true;
    refusal_ = {
        QpStatus::InvalidData,
        n < 0 ? "reserved number of unknowns is negative" : "reserved number of rows is negative",
        -1};
    return false;
  }

  /// Makes room for m rows and discards the rows. The Hessian stays. Allocates.
  void reserve_rows(Index m) {
    capacity_m_ = m;
    matrix_.assign(static_cast<std::size_t>(capacity_n_ * m), Scalar(0));
    set_zero<Scalar>({&rl_, &ru_, &rl_next_, &ru_next_}, m);
    m_ = 0;
  }

  /// Number of unknowns; 0 before the first Hessian.
  Index n() const { return n_; }
  /// Number of rows.
  Index m() const { return m_; }
  /// Number of unknowns that fit in the memory.
  Index capacity_n() const { return capacity_n_; }
  /// Number of rows that fit in the memory.
  Index capacity_m() const { return capacity_m_; }
  /// H, n×n.
  Eigen::Map<const MatrixX<Scalar>> H() const { return {hessian_.data(), n_, n_}; }
  /// A, m×n.
  Eigen::Map<const MatrixX<Scalar>> A() const { return {matrix_.data(), m_, n_}; }
  /// The gradient; n entries are in use.
  const VectorX<Scalar>& g() const { return g_; }
  /// Lower bounds, -no_bound where open; n entries are in use.
  const VectorX<Scalar>& lo() const { return lo_; }
  /// Upper bounds.
  const VectorX<Scalar>& hi() const { return hi_; }
  /// Lower row bounds; m entries are in use.
  const VectorX<Scalar>& rl() const { return rl_; }
  /// Upper row bounds.
  const VectorX<Scalar>& ru() const { return ru_; }
  /// What the last check of sizes or of a matrix refused.
  const QpRefusal& refusal() const { return refusal_; }

  /// Returns true when the last `load` had the same vectors and matrices as the one before.
  bool repeated() const { return repeated_; }

  /// Checks a Hessian as `detail::validate_hessian` does.
  QpStatus validate_hessian(const MatrixView& H) {
    refusal_ = hessian_refusal_ = detail::validate_hessian<Scalar>(H);
    return refusal_.status;
  }

  /// Copies a valid Hessian that fits in the memory. Returns true when n changed; this discards the
  /// rows.
  bool take(const MatrixView& H) {
    const Index n = H.rows();
    const bool resized = n != n_;
    if (resized) m_ = 0;
    loaded_ = false;
    n_ = n;
    constexpr Index kTile = 16;  // reads whole lines of cache in both directions
    for (Index first = 0; first < n; first += kTile) {
      for (Index top = 0; top < n; top += kTile) {
        for (Index j = first; j < (std::min)(first + kTile, n); ++j) {
          for (Index i = top; i < (std::min)(top + kTile, n); ++i) {
            hessian_[static_cast<std::size_t>(i + j * n)] =
                Scalar(0.5) * H(i, j) + Scalar(0.5) * H(j, i);
          }
        }
      }
    }
    return resized;
  }

  /// Checks that A has as many columns as the Hessian and only finite entries.
  QpStatus validate_rows(const MatrixView& A) {
    refusal_ = {};
    if (n_ == 0 && A.rows() > 0) refusal_ = kNoHessian;
    if (n_ > 0 && A.cols() != n_ && A.rows() > 0)
      refusal_ = {QpStatus::InvalidData, "rows differ in length from the Hessian", -1};
    for (Index j = 0; j < A.cols(); ++j) {
      for (Index i = 0; i < A.rows() && refusal_.status == QpStatus::Solved; ++i) {
        if (!is_finite(A(i, j)))
          refusal_ = {QpStatus::InvalidData, "row entry is not finite", i + j * A.rows()};
      }
    }
    return refusal_.status;
  }

  /// Copies valid rows that fit in the memory. Returns true when m changed.
  bool take_rows(const MatrixView& A) {
    const bool resized = A.rows() != m_;
    loaded_ = false;
    m_ = A.rows();
    for (Index j = 0; j < A.cols(); ++j) {
      for (Index i = 0; i < m_; ++i) matrix_[static_cast<std::size_t>(i + j * m_)] = A(i, j);
    }
    return resized;
  }

  /// Sizes and clears `result`, and copies gradient and bounds of a solve. Returns false when there
  /// is no Hessian, `settings_error` (static text) is not empty, a size is wrong, or an entry is
  /// not valid; status, message and index in the result then name the reason.
  bool load(std::string_view settings_error, const VectorView& g, const VectorView& lb,
            const VectorView& ub, const VectorView& rl, const VectorView& ru,
            QpResult<Scalar>& result) {
    result.resize(n_, m_);
    result.iterations = 0;
    result.stationarity = result.feasibility = result.complementarity = result.objective =
        Scalar(0);
    const QpRefusal refusal = validate_vectors(settings_error, g, lb, ub, rl, ru);
    result.status = refusal.status;
    result.message = refusal.message;
    result.invalid_index = refusal.index;
    if (refusal.status != QpStatus::Solved) return false;
    const auto same = [](const VectorX<Scalar>& a, const Scalar* b, Index count) {
      return std::equal(b, b + count, a.data());
    };
    repeated_ = loaded_ && same(g_, g.data(), n_) && same(lo_, lo_next_.data(), n_) &&
                same(hi_, hi_next_.data(), n_) && same(rl_, rl_next_.data(), m_) &&
                same(ru_, ru_next_.data(), m_);
    loaded_ = true;
    lo_.swap(lo_next_);
    hi_.swap(hi_next_);
    rl_.swap(rl_next_);
    ru_.swap(ru_next_);
    std::copy_n(g.data(), n_, g_.data());
    return true;
  }

 private:
  QpRefusal validate_vectors(std::string_view settings_error, const VectorView& g,
                             const VectorView& lb, const VectorView& ub, const VectorView& rl,
                             const VectorView& ru) {
    constexpr QpStatus bad = QpStatus::InvalidData;
    if (n_ == 0) return hessian_refusal_;
    if (!settings_error.empty()) return {bad, settings_error.data(), -1};
    if (g.size() != n_) return {bad, "gradient differs in size from the Hessian", -1};
    if (lb.size() != n_) return {bad, "lower bounds differ in size from the Hessian", -1};
    if (ub.size() != n_) return {bad, "upper bounds differ in size from the Hessian", -1};
    if (rl.size() != m_) return {bad, "lower row bounds differ in size from the rows", -1};
    if (ru.size() != m_) return {bad, "upper row bounds differ in size from the rows", -1};
    for (Index i = 0; i < n_; ++i) {
      if (!is_finite(g[i])) return {bad, "gradient entry is not finite", i};
    }
    const BoundRefusal of_unknown =
        load_bounds<Scalar>(lb, ub, lo_next_.head(n_), hi_next_.head(n_));
    if (of_unknown.index >= 0) return {bad, of_unknown.bound, of_unknown.index};
    const BoundRefusal of_row = load_bounds<Scalar>(rl, ru, rl_next_.head(m_), ru_next_.head(m_));
    if (of_row.index >= 0) return {bad, of_row.row, of_row.index};
    return {};
  }

  static constexpr QpRefusal kNoHessian{QpStatus::InvalidData, "no Hessian was set", -1};

  std::vector<Scalar> hessian_, matrix_;
  VectorX<Scalar> g_, lo_, hi_, lo_next_, hi_next_, rl_, ru_, rl_next_, ru_next_;
  Index capacity_n_ = 0, capacity_m_ = 0, n_ = 0, m_ = 0;
  bool loaded_ = false, repeated_ = false;
  QpRefusal refusal_, hessian_refusal_ = kNoHessian;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
