#pragma once

// Members of ActiveSet (clothctl/qp/active_set.hpp).

#include "clothctl/qp/active_set.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

template <RealScalar Scalar>
QpStatus ActiveSet<Scalar>::reserve(Index n, Index m) {
  if (!data_.may_reserve(n, m)) return data_.refusal().status;
  data_.reserve(n, m);
  reserve_work();
  return QpStatus::Solved;
}

template <RealScalar Scalar>
QpStatus ActiveSet<Scalar>::set_hessian(const MatrixView& H) {
  if (data_.validate_hessian(H) != QpStatus::Solved) return data_.refusal().status;
  if (H.rows() > data_.capacity_n()) reserve(H.rows(), data_.capacity_m());
  if (data_.take(H)) reset();
  n_ = data_.n();
  m_ = data_.m();
  prepared_ = false;
  structured_.forget();
  return QpStatus::Solved;
}

template <RealScalar Scalar>
QpStatus ActiveSet<Scalar>::set_rows(const MatrixView& A) {
  if (data_.validate_rows(A) != QpStatus::Solved) return data_.refusal().status;
  if (A.rows() > data_.capacity_m()) {
    data_.reserve_rows(A.rows());
    reserve_work();
  }
  if (data_.take_rows(A)) reset();
  m_ = data_.m();
  prepared_ = false;
  structured_.forget();
  return QpStatus::Solved;
}

template <RealScalar Scalar>
QpStatus ActiveSet<Scalar>::solve(const VectorView& g, const VectorView& lb, const VectorView& ub,
                                  const VectorView& rl, const VectorView& ru, result_type& result) {
  if (!data_.load(settings_error_, g, lb, ub, rl, ru, result)) return result.status;
  const detail::Budget budget(settings_, n_ + m_);
  const bool structured = structured_.ready(data_);
  if (structured && start_ == Start::FromX) structured_.warm_start(x_.head(n_));
  if (structured && start_ == Start::FromSides) structured_.warm_start(x_.head(n_), sides());
  if (structured && structured_.solve(data_, settings_, budget, lb, ub, rl, ru, result)) {
    follow(result);
    return result.status;
  }
  if (answered_ && data_.repeated()) {
    result.status = QpStatus::Solved;
    write_certificate(result);
    report(lb, ub, rl, ru, result);
    return result.status;
  }
  prepare();
  const bool warm = start_ != Start::Cold;
  method_.forget_best();
  attempt(budget, lb, ub, rl, ru, result);
  const bool passed =
      result.status != QpStatus::IterationLimit && result.status != QpStatus::SolvedInaccurate;
  if (warm && !passed &&
      budget.after(result.iterations) ==
          QpStatus::Solved) {  // a start that leads nowhere is forgotten
    start_ = Start::Cold;
    attempt(budget, lb, ub, rl, ru, result);
  }
  answered_ = result.status == QpStatus::Solved;
  const bool good = answered_ || result.status == QpStatus::SolvedInaccurate;
  unfinished_ =
      result.status == QpStatus::TimeLimit || (result.status == QpStatus::IterationLimit &&
                                               budget.after(result.iterations) != QpStatus::Solved);
  if (!good && !unfinished_) reset();
  if (unfinished_) stay_at_last();
  if (start_ == Start::Warm) structured_.warm_start(result.x);
  return result.status;
}

template <RealScalar Scalar>
bool ActiveSet<Scalar>::warm_start(const VectorView& x) {
  if (n_ == 0 || x.size() != n_ || !all_finite(x)) return false;
  if (start_ == Start::Cold) std::fill_n(y_.data(), m_, Scalar(0));
  std::copy_n(x.data(), n_, x_.data());
  answered_ = false;
  start_ = Start::FromX;
  return true;
}

template <RealScalar Scalar>
bool ActiveSet<Scalar>::warm_start(std::span<const QpSide> bounds, std::span<const QpSide> rows) {
  if (n_ == 0 || static_cast<Index>(bounds.size()) != n_ || static_cast<Index>(rows.size()) != m_)
    return false;
  if (!detail::are_sides(bounds) || !detail::are_sides(rows)) return false;
  if (start_ == Start::Cold || unfinished_) {
    std::fill_n(x_.data(), n_, Scalar(0));
    std::fill_n(y_.data(), m_, Scalar(0));
  }
  std::copy(bounds.begin(), bounds.end(), sides_of_unknowns_.begin());
  std::copy(rows.begin(), rows.end(), sides_of_rows_.begin());
  answered_ = false;
  start_ = Start::FromSides;
  return true;
}

template <RealScalar Scalar>
bool ActiveSet<Scalar>::warm_start(const VectorView& x, std::span<const QpSide> bounds,
                                   std::span<const QpSide> rows) {
  if (x.size() != n_ || !all_finite(x) || !warm_start(bounds, rows)) return false;
  std::copy_n(x.data(), n_, x_.data());
  return true;
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::shift(Index unknowns, Index rows) {
  if (start_ == Start::Cold) return;
  answered_ = false;
  for (Index i = 0; unknowns > 0 && i + unknowns < n_; ++i) {
    x_[i] = x_[i + unknowns];
    state(i) = state(i + unknowns);
    sides_of_unknowns_[static_cast<std::size_t>(i)] =
        sides_of_unknowns_[static_cast<std::size_t>(i + unknowns)];
  }
  for (Index i = 0; rows > 0 && i + rows < m_; ++i) {
    y_[i] = y_[i + rows];
    sides_of_rows_[static_cast<std::size_t>(i)] =
        sides_of_rows_[static_cast<std::size_t>(i + rows)];
  }
  structured_.shift(unknowns);
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::reset() {
  start_ = Start::Cold;
  answered_ = false;
  structured_.reset();
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::reserve_work() {
  const Index n = data_.capacity_n(), m = data_.capacity_m();
  method_.reserve(n, m);
  structured_.reserve(n, m);
  closest_.reserve(n, m);
  sides_of_unknowns_.assign(static_cast<std::size_t>(n), QpSide::Between);
  sides_of_rows_.assign(static_cast<std::size_t>(m), QpSide::Between);
  set_zero<Scalar>({&x_, &hx_, &aty_, &z_}, n);
  set_zero<Scalar>({&y_, &ax_}, m);
  n_ = data_.n();
  m_ = data_.m();
  prepared_ = false;
  reset();
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::follow(const result_type& result) {
  for (Index i = 0; i < n_; ++i) {
    x_[i] = result.x[i];
    place(i);
  }
  std::copy_n(result.row_multipliers.data(), m_, y_.data());
  start_ = Start::Warm;
  unfinished_ = answered_ = false;
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::prepare() {
  if (prepared_) return;
  method_.scale(data_);
  prepared_ = true;
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::place(Index i) {
  state(i) = !(x_[i] > data_.lo()[i])   ? State::Lower
             : !(x_[i] < data_.hi()[i]) ? State::Upper
                                        : State::Free;
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::take_start() {
  const VectorX<Scalar>&lo = data_.lo(), &hi = data_.hi();
  for (Index i = 0; i < n_; ++i) {
    if (start_ == Start::Cold) x_[i] = Scalar(0);
    const bool fixed = !(lo[i] < hi[i]);
    if (start_ == Start::FromSides)
      state(i) = static_cast<State>(sides_of_unknowns_[static_cast<std::size_t>(i)]);
    const bool keep = (start_ == Start::Warm || start_ == Start::FromSides) && !fixed;
    if (keep && state(i) == State::Lower && detail::has_bound(lo[i])) x_[i] = lo[i];
    if (keep && state(i) == State::Upper && detail::has_bound(hi[i])) x_[i] = hi[i];
    x_[i] = (std::min)((std::max)(x_[i], lo[i]), hi[i]);
    if (!keep || state(i) != State::Free) place(i);
  }
  if (start_ == Start::Cold) std::fill_n(y_.data(), m_, Scalar(0));
  for (Index i = 0; start_ == Start::FromSides && i < m_; ++i) take_side(i);
  method_.load(data_, x_, y_, start_);
  start_ = Start::Warm;
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::attempt(const detail::Budget& budget, const VectorView& lb,
                                const VectorView& ub, const VectorView& rl, const VectorView& ru,
                                result_type& result) {
  take_start();
  result.status = method_.run(budget, result.iterations);
  write_certificate(result);
  if (result.status == QpStatus::PrimalInfeasible && settings_.closest_point)
    approach(budget, result);
  report(lb, ub, rl, ru, result);
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::take_side(Index i) {
  const QpSide side = sides_of_rows_[static_cast<std::size_t>(i)];
  const Scalar sign = side == QpSide::Lower ? Scalar(1) : Scalar(-1);
  const bool offered = detail::has_bound(side == QpSide::Lower ? data_.rl()[i] : data_.ru()[i]);
  if (side == QpSide::Between || !offered) {
    y_[i] = Scalar(0);
  } else if (!(y_[i] * sign > Scalar(0))) {
    y_[i] = sign * Scalar(1e-30) * (std::max)(Scalar(1), method_.E()[i]);
  }
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::write_certificate(result_type& result) const {
  const VectorX<Scalar>&D = method_.D(), &E = method_.E();
  result.ray.setConstant(Scalar(0));
  if (result.status == QpStatus::PrimalInfeasible) {
    detail::multiply_entries(m_, E, method_.certificates().farkas_rows(), result.row_multipliers);
    detail::divide_entries(n_, method_.certificates().farkas_bounds(), D, result.bound_multipliers);
  }
  if (result.status == QpStatus::DualInfeasible) {
    detail::multiply_entries(n_, D, method_.certificates().direction(), result.ray);
  }
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::approach(const detail::Budget& budget, result_type& result) {
  detail::ProximalProblem<Scalar>& problem = method_.problem();
  const VectorX<Scalar>&D = method_.D(), &E = method_.E();
  for (Index i = 0; i < m_; ++i) {  // distances count in the caller's units
    for (Index j = 0; j < n_; ++j) problem.A()(i, j) *= Scalar(1) / E[i];
    problem.rl[i] = data_.rl()[i];
    problem.ru[i] = data_.ru()[i];
  }
  problem.refresh_transpose();
  for (Index j = 0; j < n_; ++j) {
    if (!is_finite(problem.x[j])) problem.x[j] = Scalar(0);
    problem.x[j] = (std::min)((std::max)(problem.x[j], problem.lo[j]), problem.hi[j]);
  }
  const bool least = closest_.find(problem, budget, result.iterations);
  std::copy_n(closest_.shifts().data(), m_, result.row_shifts.data());
  detail::multiply_entries(n_, D, problem.x, x_);
  prepared_ = false;
  prepare();
  if (!least) {
    result.message =
        "the closest point was not found: the budget ended, or rounding stopped progress";
    return;
  }
  start_ = Start::FromX;
  std::fill_n(y_.data(), m_, Scalar(0));
  take_start();
  closest_.tighten_bounds(problem, E);
  const QpStatus status = method_.run(budget, result.iterations);
  if (status == QpStatus::Solved) return;
  detail::divide_entries(n_, x_, D, problem.x);
  result.message =
      status == QpStatus::DualInfeasible
          ? "x is a closest point, but not the one of the least objective: that is unbounded"
      : budget.after(result.iterations) != QpStatus::Solved
          ? "x is a closest point, but not the one of the least objective: the budget ended"
          : "x is a closest point, but not the one of the least objective: rounding stopped "
            "progress";
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::stay_at_last() {
  detail::multiply_entries(n_, method_.D(), method_.last_x(), x_);
  detail::multiply_entries(m_, method_.E(), method_.last_y(), y_);
  if (!all_finite(x_.head(n_)) || !all_finite(y_.head(m_))) reset();
}

template <RealScalar Scalar>
void ActiveSet<Scalar>::report(const VectorView& lb, const VectorView& ub, const VectorView& rl,
                               const VectorView& ru, result_type& result) {
  result.status = method_.settle(data_, result.status);
  const bool infeasible = result.status == QpStatus::PrimalInfeasible;
  const bool unbounded = result.status == QpStatus::DualInfeasible;
  const detail::ProximalProblem<Scalar>& problem = method_.problem();
  const VectorX<Scalar>&D = method_.D(), &E = method_.E(), &q = method_.gradient();
  for (Index j = 0; j < n_; ++j) {
    x_[j] = D[j] * problem.x[j];
    result.x[j] = x_[j];
    hx_[j] = problem.hx[j] / D[j];
    aty_[j] = (problem.hx[j] + problem.g[j] - q[j]) / D[j];
    z_[j] = detail::bound_multiplier(q[j], problem.x[j], problem.lo[j], problem.hi[j]) / D[j];
  }
  for (Index i = 0; i < m_; ++i) {
    y_[i] = E[i] * problem.y[i];
    ax_[i] = problem.ax[i] / E[i];
  }
  KktResiduals<Scalar> r = detail::kkt_from_products<Scalar>(
      hx_.head(n_), ax_.head(m_), aty_.head(n_), data_.g().head(n_), rl, ru, lb, ub, result.x,
      y_.head(m_), z_.head(n_));
  using std::abs;
  Scalar unseen(0);  // A x, however well summed, is rounded once, and what that takes off a slack
                     // counts as slack
  for (Index i = 0; i < m_; ++i) unseen += abs(y_[i] * ax_[i]);
  r.complementarity += Scalar(0.5) * scalar_traits<Scalar>::epsilon() * unseen;
  r.relative_complementarity = detail::relative_error(
      r.complementarity, Scalar((std::max)(Scalar(1), Scalar(abs(r.objective)))));
  detail::conclude(r, settings_, result);
  if (result.status == QpStatus::Solved && method_.limited_by_rounding())
    result.status = QpStatus::SolvedInaccurate;
  if (!infeasible) {
    std::copy_n(z_.data(), n_, result.bound_multipliers.data());
    std::copy_n(y_.data(), m_, result.row_multipliers.data());
  }
  if (!infeasible && !unbounded)
    detail::write_active_set<Scalar>(data_.lo(), data_.hi(), data_.rl(), data_.ru(), result);
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class ActiveSet<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
