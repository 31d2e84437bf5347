#pragma once

// Convex QP with bounds and two-sided rows. The outer loop is a proximal method of multipliers:
// each step minimises the augmented Lagrangian plus a proximal term over the bounds,
//
//   x_{k+1} = argmin over lb ≤ x ≤ ub of f(x) + ρ/2 |x - x_k|² + 1/(2μ) dist²(Ax - μ y_k, [rl, ru])
//   y_{k+1} = y(x_{k+1})
//
// y(x) are the multipliers of the penalty term, (Π(v) - v)/μ at v = Ax - μ y_k, where Π projects
// onto [rl, ru]. The inner loop is an active-set method on the free unknowns and the violated rows.
// Both loops are in detail/proximal_method.hpp. This header adds the interface: it checks and keeps
// the caller's data, manages warm starts, and returns results and certificates in the caller's
// units. Reference: R. T. Rockafellar, Augmented Lagrangians and applications of the proximal point
// algorithm in convex programming, Math. Oper. Res. 1 (1976).

#include <algorithm>
#include <span>
#include <string_view>
#include <vector>

#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/problem_data.hpp"
#include "clothctl/qp/detail/proximal_method.hpp"
#include "clothctl/qp/detail/special/closest_point.hpp"
#include "clothctl/qp/detail/special/structured_box.hpp"
#include "clothctl/qp/detail/termination.hpp"
#include "clothctl/qp/kkt.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Solves convex QPs with bounds and two-sided rows. Each solve starts from the last iterate and
/// active set.
template <RealScalar Scalar>
class ActiveSet {
 public:
  /// The number type.
  using scalar_type = Scalar;
  /// What `solve` fills.
  using result_type = QpResult<Scalar>;
  /// A read-only view of a vector.
  using VectorView = Eigen::Ref<const VectorX<Scalar>>;
  /// A read-only view of a matrix.
  using MatrixView = Eigen::Ref<const MatrixX<Scalar>>;

  /// Keeps the settings. When the text of `settings.validate()` is not empty, every solve returns
  /// InvalidData with that text as its message.
  explicit ActiveSet(QpSettings<Scalar> settings = {})
      : settings_(settings), method_(settings), settings_error_(settings.validate()) {}

  /// Makes room for up to n unknowns and m rows and forgets both matrices. Afterwards no member
  /// function allocates for problems up to these sizes, except that a result is sized at its first
  /// solve. Returns Solved, or InvalidData for a negative size: `refusal()` then names this size,
  /// and the solver is unchanged. Allocates.
  QpStatus reserve(Index n, Index m);

  /// Takes H (n×n, symmetric, positive semidefinite; zero for a linear program) and keeps a copy.
  /// When n changes the rows must be set again. Allocates only beyond the reserved size. Fails
  /// when: an entry is not finite or not symmetric (InvalidData), a diagonal entry is negative or
  /// h_ij² > h_ii h_jj (NonConvex); `refusal()` says where, and the solver is unchanged.
  /// Complexity: O(n²).
  [[nodiscard]] QpStatus set_hessian(const MatrixView& H);

  /// Takes A (m×n; m may be 0) and keeps a copy; call after `set_hessian`. Allocates only beyond
  /// the reserved size. Fails when: A does not have n columns or an entry is not finite
  /// (InvalidData); `refusal()` says where, and the solver is unchanged. Complexity: O(mn).
  [[nodiscard]] QpStatus set_rows(const MatrixView& A);

  /// What the last call of `reserve`, `set_hessian` or `set_rows` refused.
  const QpRefusal& refusal() const { return data_.refusal(); }

  /// Solves for gradient g, bounds lb, ub (n each) and row bounds rl, ru (m each), warm from the
  /// last iterate and active set. Never allocates once `result` has seen this size. Fails when:
  /// sizes differ, an entry of g is not finite, a bound is NaN, or a lower bound exceeds its upper
  /// bound (InvalidData; the solver is unchanged).
  [[nodiscard]] QpStatus solve(const VectorView& g, const VectorView& lb, const VectorView& ub,
                               const VectorView& rl, const VectorView& ru, result_type& result);

  /// Makes the next solve start from x (n): unknowns at a bound are active, those strictly inside
  /// are free. Returns false, and changes nothing, when x has another size or an entry that is not
  /// finite.
  [[nodiscard]] bool warm_start(const VectorView& x);

  /// Makes the next solve start from an active set, one side for each unknown and each row: that of
  /// a result, or the caller's own guess. If the active set is the optimal one, x and the
  /// multipliers follow from one factorisation. A side whose bound is infinite counts as Between.
  /// Returns false, and changes nothing, for another size or a value that is no side.
  [[nodiscard]] bool warm_start(std::span<const QpSide> bounds, std::span<const QpSide> rows);

  /// Makes the next solve start from an active set, and from x (n) for the unknowns that are
  /// Between.
  [[nodiscard]] bool warm_start(const VectorView& x, std::span<const QpSide> bounds,
                                std::span<const QpSide> rows);

  /// Receding horizon: unknown i takes the value and active-set status of unknown i + unknowns, and
  /// row i those of row i + rows; the last `unknowns` unknowns and the last `rows` rows keep
  /// theirs.
  void shift(Index unknowns, Index rows);

  /// Forgets the active set: the next solve is cold.
  void reset();

 private:
  using Method = detail::ProximalMethod<Scalar>;
  using State = typename Method::State;
  using Start = typename Method::Start;

  State& state(Index i) { return method_.problem().state[static_cast<std::size_t>(i)]; }

  std::span<const QpSide> sides() const {
    return {sides_of_unknowns_.data(), static_cast<std::size_t>(n_)};
  }

  /// Sizes all memory but that of the data to the reserved sizes of the data, and forgets the
  /// active set.
  void reserve_work();

  /// Takes over the solution of the structured method as the start of later solves by the proximal
  /// method.
  void follow(const result_type& result);

  /// Scales H and A afresh after either changed.
  void prepare();

  /// Prepares for new matrices, and forgets a start that rounding errors would spoil with them.
  void drop_far_start() {
    prepare();
    if (start_ != Start::Warm) return;
    take_start();
    if (method_.start_is_far()) start_ = Start::Cold;
  }

  /// Sets the state of unknown i from x_i: at its lower or upper bound, or free.
  void place(Index i);

  /// Sets x, the states of the unknowns and y as `start_` says, and loads the method.
  void take_start();

  /// Runs the method from `start_`, and fills the result.
  void attempt(const detail::Budget& budget, const VectorView& lb, const VectorView& ub,
               const VectorView& rl, const VectorView& ru, result_type& result);

  /// Gives row i a multiplier with the sign of the side that the caller gave the row. Its size only
  /// has to survive scaling.
  void take_side(Index i);

  /// Writes the certificate that belongs to the status, if any, into the result, in the caller's
  /// units.
  void write_certificate(result_type& result) const;

  /// After PrimalInfeasible: finds a closest point (closest_point.hpp), then minimises the
  /// objective among all closest points. Keeps the certificate in the result.
  void approach(const detail::Budget& budget, result_type& result);

  /// After the budget ended: makes the next solve continue from the last iterate.
  void stay_at_last();

  /// Fills the result in the caller's units. The residuals of the caller's problem decide whether
  /// the status is Solved.
  void report(const VectorView& lb, const VectorView& ub, const VectorView& rl,
              const VectorView& ru, result_type& result);

  QpSettings<Scalar> settings_;
  detail::ProblemData<Scalar> data_;
  Method method_;
  detail::StructuredBox<Scalar> structured_;
  detail::ClosestPoint<Scalar> closest_;
  std::vector<QpSide> sides_of_unknowns_, sides_of_rows_;
  VectorX<Scalar> x_, hx_, aty_, z_;
  VectorX<Scalar> y_, ax_;
  Index n_ = 0, m_ = 0;
  Start start_ = Start::Cold;
  std::string_view settings_error_;  // of the settings, static text
  bool prepared_ = false, unfinished_ = false;
  // The proximal method's iterate solves the data loaded last, or that of the structured one does.
  bool answered_ = false, followed_ = false;
};

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
  if (answered_ && data_.repeated()) {
    result.status = QpStatus::Solved;
    write_certificate(result);
    report(lb, ub, rl, ru, result);
    return result.status;
  }
  const detail::Budget budget(settings_, n_ + m_);
  const bool structured = structured_.ready(data_), known = followed_ && data_.repeated();
  if (structured && start_ == Start::FromX) structured_.warm_start(x_.head(n_));
  if (structured && start_ == Start::FromSides) structured_.warm_start(x_.head(n_), sides());
  if (structured && structured_.solve(data_, settings_, budget, known, lb, ub, rl, ru, result)) {
    follow(result);
    return result.status;
  }
  if (!prepared_) drop_far_start();
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
  followed_ = false;
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
  answered_ = followed_ = false;
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
  answered_ = followed_ = false;
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
  answered_ = followed_ = false;
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
  answered_ = followed_ = false;
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
  followed_ = result.status == QpStatus::Solved;
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
  if (result.status == QpStatus::DualInfeasible)
    detail::multiply_entries(n_, D, method_.certificates().direction(), result.ray);
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
  Scalar unseen(0);  // A x is rounded at least once; this error of a slack counts as slack
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
