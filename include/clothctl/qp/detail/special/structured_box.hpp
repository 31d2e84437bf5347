#pragma once

// Eliminates equality rows that define unknowns. If each row i of A x = b has an unknown w_i
// without bounds that appears in no other row, with entry a_i, and the Hessian is Q on w and a
// diagonal D on the remaining unknowns d (A_d: their columns), without coupling of w and d, then
//
//   a_i w_i + (A_d d)_i = b_i              ->  w = c + M d,   c = b / a,   M = -A_d / a
//   ½ wᵀQ w + g_wᵀw + ½ dᵀD d + g_dᵀd      ->  ½ dᵀ(D + NᵀN) d + g'ᵀd,   Q = U Uᵀ,   N = UᵀM,
//                                              g' = g_d + Mᵀ(g_w + Q c)
//   y = (Q w + g_w) / a,   z_w = 0,   z_d = D d + g_d - A_dᵀ y
//
// Only the bounds on d remain, and the Hessian is diagonal plus low rank (low_rank_curvature.hpp).
// Contact forces w with friction-cone coefficients d have this structure. The search for this
// structure runs once for each H and A. c, g' and the recovery of x, y and z cost O(nnz(A) + m²)
// for each solve.

#include <algorithm>
#include <span>
#include <vector>

#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/box_method.hpp"
#include "clothctl/qp/detail/problem_data.hpp"
#include "clothctl/qp/detail/special/low_rank_curvature.hpp"
#include "clothctl/qp/detail/termination.hpp"
#include "clothctl/qp/kkt.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Finds the structure, and solves problems that have it. All memory comes from `reserve`.
template <RealScalar Scalar>
class StructuredBox {
 public:
  using Vector = VectorX<Scalar>;
  using Data = ProblemData<Scalar>;

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    method_.curvature().reserve(n, (std::min)(n, m));
    method_.reserve(n);
    // Memory that only a structured problem touches: pages of other problems stay untouched.
    Ut_.resize(m, m);
    Q_.resize(m, m);
    set_zero<Scalar>({&g_, &lo_, &hi_, &hx_, &aty_}, n);
    set_zero<Scalar>({&pivot_, &c_, &h_, &ax_, &scale_}, m);
    owner_.assign(static_cast<std::size_t>(m), -1);
    full_.assign(static_cast<std::size_t>(n), 0);
    for (std::vector<Index>* v : {&first_, &last_}) v->assign(static_cast<std::size_t>(n), 0);
    row_of_.assign(static_cast<std::size_t>(n), -1);
    forget();
  }

  /// Discards the structure. Call this after a change of H or A.
  void forget() { searched_ = found_ = false; }

  /// Returns true when the loaded problem has the structure. The first call after `forget` searches
  /// for it, O(nm + m²n). Later calls are O(m).
  bool ready(const Data& data) {
    if (!searched_) {
      found_ = find(data);
      searched_ = true;
    }
    return found_ && fits(data);
  }

  /// Solves a problem for which `ready` is true. Fills the result except for its ray. lb, ub, rl,
  /// ru are the caller's bounds. Returns false when x is not finite, or the method converged but x
  /// does not meet the tolerances; the caller should then use another method. `repeated`: the last
  /// call solved the same problem, and nothing changed since. Never allocates.
  bool solve(const Data& data, const QpSettings<Scalar>& settings, const Budget& budget,
             bool repeated, const Eigen::Ref<const Vector>& lb, const Eigen::Ref<const Vector>& ub,
             const Eigen::Ref<const Vector>& rl, const Eigen::Ref<const Vector>& ru,
             QpResult<Scalar>& result) {
    load(data);
    if (repeated) {
      result.status = QpStatus::Solved;
      report(data, settings, lb, ub, rl, ru, result);
      return true;
    }
    const typename Method::Data reduced{g_, lo_, hi_};
    for (const typename Method::Check criterion : {Method::Check::Caller, Method::Check::Method}) {
      result.status = method_.solve(reduced, settings.stationarity_tolerance, budget,
                                    result.iterations, criterion);
      if (method_.replace_nonfinite(reduced)) return false;
      const bool converged = result.status == QpStatus::Solved;
      report(data, settings, lb, ub, rl, ru, result);
      if (result.status == QpStatus::Solved || !converged) return true;
      load(data);
    }
    return false;
  }

  /// Makes the next solve start from x (n).
  void warm_start(const Eigen::Ref<const Vector>& x) {
    if (!found_) return;
    for (Index k = 0; k < count_; ++k) g_[k] = x[full(k)];
    method_.warm_start(g_.head(count_));
  }
  /// Makes the next solve start from an active set of the whole problem, with one side for each
  /// unknown, and from x for unknowns between their bounds.
  void warm_start(const Eigen::Ref<const Vector>& x, std::span<const QpSide> sides) {
    warm_start(x);
    if (!found_) return;
    method_.warm_start_sides([&](Index k) { return sides[static_cast<std::size_t>(full(k))]; });
  }
  /// Shifts the active set forward by `unknowns` unknowns of the whole problem, if the pattern of
  /// eliminated unknowns repeats with this period. Otherwise the active set stays.
  void shift(Index unknowns) {
    if (!found_ || unknowns <= 0) return;
    Index step = 0;
    while (step < count_ && full(step) < unknowns) ++step;
    for (Index k = 0; k + step < count_; ++k) {
      if (full(k + step) - full(k) != unknowns) return;
    }
    method_.shift(step);
  }
  /// Forgets the active set: the next solve is cold.
  void reset() { method_.reset(); }

 private:
  using Method = BoxMethod<Scalar, LowRankCurvature<Scalar>>;

  Index full(Index k) const { return full_[static_cast<std::size_t>(k)]; }
  Index owner(Index i) const { return owner_[static_cast<std::size_t>(i)]; }
  static bool nonzero(const Scalar& v) { return v < Scalar(0) || v > Scalar(0); }
  static bool open(const Data& data, Index j) {
    return !has_bound(data.lo()[j]) && !has_bound(data.hi()[j]);
  }

  /// Returns true when, in this solve, all rows are equalities and their unknowns w have no bounds.
  bool fits(const Data& data) const {
    for (Index i = 0; i < data.m(); ++i) {
      if (data.rl()[i] < data.ru()[i] || !open(data, owner(i))) return false;
    }
    return true;
  }

  bool find(const Data& data) {
    const Index n = data.n(), m = data.m();
    if (m == 0 || m >= n) return false;
    return find_owners(data) && separate(data) && factor_hessian(data) && build(data);
  }

  /// Assigns to each row an unknown without bounds that appears in no other row. If a row has
  /// several, it gets the one with the largest entry in modulus. Returns false when a row has none.
  bool find_owners(const Data& data) {
    using std::abs;
    const Index n = data.n(), m = data.m();
    for (Index i = 0; i < m; ++i) owner_[static_cast<std::size_t>(i)] = -1;
    for (Index j = 0; j < n; ++j) {
      Index first = m, last = -1, entries = 0;
      for (Index i = 0; i < m; ++i) {
        if (!nonzero(data.A()(i, j))) continue;
        first = (std::min)(first, i);
        last = i;
        ++entries;
      }
      first_[static_cast<std::size_t>(j)] = first;
      last_[static_cast<std::size_t>(j)] = last;
      row_of_[static_cast<std::size_t>(j)] = -1;
      if (entries != 1 || !open(data, j)) continue;
      const Index rival = owner(last);
      if (rival < 0 || abs(data.A()(last, rival)) < abs(data.A()(last, j)))
        owner_[static_cast<std::size_t>(last)] = j;
    }
    for (Index i = 0; i < m; ++i) {
      if (owner(i) < 0) return false;
      row_of_[static_cast<std::size_t>(owner(i))] = i;
    }
    count_ = 0;
    for (Index j = 0; j < n; ++j) {
      if (row_of_[static_cast<std::size_t>(j)] < 0) full_[static_cast<std::size_t>(count_++)] = j;
    }
    return true;
  }

  /// Returns true when H has no block between w and d, and is a positive diagonal on d.
  bool separate(const Data& data) const {
    const Index n = data.n();
    for (Index j = 0; j < n; ++j) {
      const bool defined = row_of_[static_cast<std::size_t>(j)] >= 0;
      if (!defined && !(data.H()(j, j) > Scalar(0))) return false;
      for (Index i = 0; i < n; ++i) {
        if (i == j || !nonzero(data.H()(i, j))) continue;
        if (!defined || row_of_[static_cast<std::size_t>(i)] < 0) return false;
      }
    }
    return true;
  }

  /// Factors Q = U Uᵀ by Cholesky with diagonal pivoting (Golub and Van Loan 2013, §4.2), up to
  /// its rank. Uᵀ is in the first rank_ rows of Ut_.
  bool factor_hessian(const Data& data) {
    using std::sqrt;
    const Index m = data.m();
    Scalar largest(0);
    for (Index i = 0; i < m; ++i) {
      for (Index j = 0; j < m; ++j) Q_(i, j) = data.H()(owner(i), owner(j));
      pivot_[i] = Q_(i, i);
      largest = (std::max)(largest, pivot_[i]);
    }
    const Scalar least = static_cast<Scalar>(m) * scalar_traits<Scalar>::epsilon() * largest;
    std::fill_n(Ut_.data(), Ut_.size(), Scalar(0));
    for (rank_ = 0; rank_ < m; ++rank_) {
      Index best = 0;
      for (Index i = 1; i < m; ++i) {
        if (pivot_[best] < pivot_[i]) best = i;
      }
      if (!(pivot_[best] > least)) break;
      const Scalar root = sqrt(pivot_[best]);
      for (Index i = 0; i < m; ++i) {
        Scalar value = Q_(i, best);
        for (Index k = 0; k < rank_; ++k) value -= Ut_(k, i) * Ut_(k, best);
        Ut_(rank_, i) = value / root;
      }
      for (Index i = 0; i < m; ++i) pivot_[i] -= Ut_(rank_, i) * Ut_(rank_, i);
      pivot_[best] = Scalar(0);
    }
    // The remaining pivots must be rounding errors. Otherwise Q is not positive semidefinite.
    for (Index i = 0; i < m; ++i) {
      if (pivot_[i] < -Scalar(8) * least) return false;
    }
    return rank_ > 0;
  }

  /// Computes D and N. Returns false when D is so small compared to NᵀN that the Woodbury formula
  /// would lose half of the digits.
  bool build(const Data& data) {
    using std::sqrt;
    LowRankCurvature<Scalar>& curvature = method_.curvature();
    curvature.resize(count_, rank_);
    Eigen::Ref<MatrixX<Scalar>> N = curvature.N();
    for (Index k = 0; k < count_; ++k) {
      const Index j = full(k);
      std::fill_n(&N.coeffRef(0, k), rank_, Scalar(0));
      for (Index i = first_[static_cast<std::size_t>(j)]; i <= last_[static_cast<std::size_t>(j)];
           ++i) {
        const Scalar a = data.A()(i, j);
        if (!nonzero(a)) continue;
        add_scaled(rank_, Scalar(-a / data.A()(i, owner(i))), &Ut_.coeffRef(0, i),
                   &N.coeffRef(0, k));
      }
      curvature.set_diagonal(k, data.H()(j, j));
    }
    const Scalar least = Scalar(8) * sqrt(scalar_traits<Scalar>::epsilon());
    for (Index k = 0; k < count_; ++k) {
      if (data.H()(full(k), full(k)) < least * curvature.diagonal(k)) return false;
    }
    method_.renew();
    return true;
  }

  /// Computes c, g' and the bounds on d.
  void load(const Data& data) {
    const Index m = data.m();
    for (Index i = 0; i < m; ++i) {
      scale_[i] = Scalar(1) / data.A()(i, owner(i));
      c_[i] = data.rl()[i] * scale_[i];
    }
    multiply_defined(m, c_);
    for (Index i = 0; i < m; ++i) h_[i] = (h_[i] + data.g()[owner(i)]) * scale_[i];
    for (Index k = 0; k < count_; ++k) {
      const Index j = full(k);
      g_[k] = data.g()[j] - column_dot(data, j, h_);
      lo_[k] = data.lo()[j];
      hi_[k] = data.hi()[j];
    }
  }

  /// Fills the result, and sets its status from the residuals.
  void report(const Data& data, const QpSettings<Scalar>& settings,
              const Eigen::Ref<const Vector>& lb, const Eigen::Ref<const Vector>& ub,
              const Eigen::Ref<const Vector>& rl, const Eigen::Ref<const Vector>& ru,
              QpResult<Scalar>& result) {
    recover(data, result);
    const Index n = data.n(), m = data.m();
    const KktResiduals<Scalar> r = kkt_from_products<Scalar>(
        hx_.head(n), ax_.head(m), aty_.head(n), data.g().head(n), rl, ru, lb, ub, result.x,
        result.row_multipliers, result.bound_multipliers);
    conclude(r, settings, result);
    write_active_set<Scalar>(data.lo(), data.hi(), data.rl(), data.ru(), result);
  }

  /// Computes h_ = Q w.
  void multiply_defined(Index m, const Vector& w) {
    std::fill_n(h_.data(), m, Scalar(0));
    for (Index j = 0; j < m; ++j) {
      if (nonzero(w[j])) add_scaled(m, w[j], &Q_.coeffRef(0, j), h_.data());
    }
  }

  /// Returns the product of column j of A with v.
  Scalar column_dot(const Data& data, Index j, const Vector& v) const {
    const Index first = first_[static_cast<std::size_t>(j)],
                length = last_[static_cast<std::size_t>(j)] - first + 1;
    if (length <= 0) return Scalar(0);
    return dot_product(length, data.A().data() + j * data.m() + first, v.data() + first);
  }

  /// Computes x, y, z and the products Hx, Ax, Aᵀy of the whole problem.
  void recover(const Data& data, QpResult<Scalar>& result) {
    const Index m = data.m();
    std::fill_n(ax_.data(), m, Scalar(0));
    for (Index k = 0; k < count_; ++k) {
      const Index j = full(k);
      const Scalar d = method_.x()[k];
      result.x[j] = d;
      const Index first = first_[static_cast<std::size_t>(j)],
                  length = last_[static_cast<std::size_t>(j)] - first + 1;
      if (nonzero(d) && length > 0)
        add_scaled(length, d, data.A().data() + j * m + first, ax_.data() + first);
    }
    for (Index i = 0; i < m; ++i) {
      c_[i] -= ax_[i] * scale_[i];
      result.x[owner(i)] = c_[i];
      ax_[i] += data.A()(i, owner(i)) * c_[i];
    }
    multiply_defined(m, c_);
    for (Index i = 0; i < m; ++i) {
      const Index j = owner(i);
      hx_[j] = h_[i];
      result.row_multipliers[i] = (h_[i] + data.g()[j]) * scale_[i];
      result.bound_multipliers[j] = Scalar(0);
      aty_[j] = data.A()(i, j) * result.row_multipliers[i];
    }
    for (Index k = 0; k < count_; ++k) {
      const Index j = full(k);
      hx_[j] = data.H()(j, j) * result.x[j];
      aty_[j] = column_dot(data, j, result.row_multipliers);
      result.bound_multipliers[j] =
          bound_multiplier(Scalar(hx_[j] + data.g()[j] - aty_[j]), result.x[j], lo_[k], hi_[k]);
    }
  }

  Method method_;
  MatrixX<Scalar> Ut_, Q_;
  Vector g_, lo_, hi_, hx_, aty_, pivot_, c_, h_, ax_, scale_;
  std::vector<Index> owner_, full_, first_, last_, row_of_;
  Index count_ = 0, rank_ = 0;
  bool searched_ = false, found_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
