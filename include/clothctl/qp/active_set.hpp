#pragma once

// General convex QP: proximal method of multipliers outside, active set on free unknowns and violated rows inside.
//
//   x_{k+1} = argmin over lb ≤ x ≤ ub of  f(x) + ρ/2 |x - x_k|² + 1/(2μ) dist²(Ax - μ y_k, [rl, ru])
//   y_{k+1} = y(x_{k+1})
//
// Every subproblem is strictly convex and always feasible (proximal_problem.hpp), so dependent rows, degenerate vertices,
// semidefinite H and linear programs need no special case. Once the sets are right the exact solution follows from a few
// refinement steps: the unregularised optimality equations of the sets, solved with the regularised factor. When no solution
// exists the differences y_{k+1} - y_k and x_{k+1} - x_k tend to a Farkas pair and to a ray: both are checked on the caller's
// data before they are reported. Scaling is by powers of two, hence exact; "Solved" is judged on unscaled residuals.
// Reference: Rockafellar, Math. Oper. Res. 1 (1976); Hermans, Themelis, Patrinos, QPALM (2022) for inner Newton steps.

#include <algorithm>
#include <span>
#include <vector>

#include "clothctl/qp/closest_point.hpp"
#include "clothctl/qp/kkt.hpp"
#include "clothctl/qp/problem_data.hpp"
#include "clothctl/qp/proof_search.hpp"
#include "clothctl/qp/proximal_problem.hpp"
#include "clothctl/qp/scaled_judge.hpp"
#include "clothctl/qp/scaling.hpp"
#include "clothctl/qp/structured_box.hpp"
#include "clothctl/qp/verdict.hpp"

namespace clothctl {

/// Solves convex QPs with bounds and two-sided rows, warm from its last iterate and active set.
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

  /// Takes settings. Solves answer InvalidData when `settings.check()` is not empty.
  explicit ActiveSet(QpSettings<Scalar> settings = {}) : settings_(settings), good_settings_(settings.check().empty()) {}

  /// Makes room for up to n unknowns and m rows and forgets both matrices; afterwards nothing here allocates up to those
  /// sizes (results size themselves at their first solve). Allocates.
  void reserve(Index n, Index m) {
    data_.reserve(n, m);
    reserve_work();
  }

  /// Takes H (n×n, symmetric, positive semidefinite; zero for a linear program) and keeps a copy. When n changes the rows
  /// must be set again. Allocates only beyond the reserved size. Fails when: an entry is not finite or not symmetric
  /// (InvalidData), a diagonal entry is negative or h_ij² > h_ii h_jj (NonConvex); `refusal()` says where, and the solver stays
  /// as it was. Complexity: O(n²).
  [[nodiscard]] QpStatus set_hessian(const MatrixView& H) {
    if (data_.judge(H) != QpStatus::Solved) return data_.refusal().status;
    if (H.rows() > data_.capacity_n()) reserve(H.rows(), data_.capacity_m());
    if (data_.take(H)) reset();
    n_ = data_.n();
    m_ = data_.m();
    prepared_ = false;
    structured_.forget();
    return QpStatus::Solved;
  }

  /// Takes A (m×n; m may be 0) and keeps a copy; call after `set_hessian`. Allocates only beyond the reserved size. Fails
  /// when: A has not n columns or an entry is not finite (InvalidData); `refusal()` says where, and the solver stays as it was.
  /// Complexity: O(mn).
  [[nodiscard]] QpStatus set_rows(const MatrixView& A) {
    if (data_.judge_rows(A) != QpStatus::Solved) return data_.refusal().status;
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

  /// What the last call of `set_hessian` or `set_rows` refused.
  const QpRefusal& refusal() const { return data_.refusal(); }

  /// Solves for gradient g, bounds lb, ub (n each) and row bounds rl, ru (m each), warm from the last iterate and active set.
  /// Never allocates once `result` has seen this size. Fails when: sizes differ, an entry is NaN, or a lower bound lies
  /// above its upper one (InvalidData; nothing is changed).
  [[nodiscard]] QpStatus solve(const VectorView& g, const VectorView& lb, const VectorView& ub, const VectorView& rl,
                               const VectorView& ru, result_type& result) {
    if (!data_.load(good_settings_, g, lb, ub, rl, ru, result)) return result.status;
    const detail::Budget budget(settings_, n_ + m_);
    const bool structured = structured_.ready(data_);
    if (structured && start_ == Start::FromX) structured_.warm_start(x_.head(n_));
    if (structured && start_ == Start::FromSides) structured_.warm_start(x_.head(n_), sides());
    if (structured && structured_.solve(data_, settings_, budget, lb, ub, rl, ru, result)) {
      follow(result);
      return result.status;
    }
    prepare();
    const bool warm = start_ != Start::Cold;
    take_start();
    best_.forget();
    result.status = iterate(budget, result);
    const bool stuck = result.status == QpStatus::IterationLimit && budget.after(result.iterations) == QpStatus::Solved;
    if (warm && stuck) {  // a start that leads nowhere is forgotten
      start_ = Start::Cold;
      take_start();
      result.status = iterate(budget, result);
    }
    if (result.status == QpStatus::PrimalInfeasible && settings_.closest_point) approach(budget, result);
    report(lb, ub, rl, ru, result);
    if (start_ == Start::Warm) structured_.warm_start(result.x);
    return result.status;
  }

  /// Makes the next solve start from x (n): unknowns at a bound are active, those strictly inside are free. Answers false, and
  /// changes nothing, when x has another size or an entry that is not finite.
  [[nodiscard]] bool warm_start(const VectorView& x) {
    if (n_ == 0 || x.size() != n_ || !all_finite(x)) return false;
    if (start_ == Start::Cold) y_.head(m_).setConstant(Scalar(0));
    x_.head(n_) = x;
    start_ = Start::FromX;
    return true;
  }

  /// Makes the next solve start from an active set, one side for each unknown and each row: that of a result, or the caller's
  /// own guess. Where it is the optimal one, x and the multipliers follow from one factorisation. Sides that a bound does not
  /// offer count as Between. Answers false, and changes nothing, for another size or a value that is no side.
  [[nodiscard]] bool warm_start(std::span<const QpSide> bounds, std::span<const QpSide> rows) {
    if (n_ == 0 || static_cast<Index>(bounds.size()) != n_ || static_cast<Index>(rows.size()) != m_) return false;
    if (!detail::are_sides(bounds) || !detail::are_sides(rows)) return false;
    if (start_ == Start::Cold) {
      x_.head(n_).setConstant(Scalar(0));
      y_.head(m_).setConstant(Scalar(0));
    }
    std::copy(bounds.begin(), bounds.end(), sides_of_unknowns_.begin());
    std::copy(rows.begin(), rows.end(), sides_of_rows_.begin());
    start_ = Start::FromSides;
    return true;
  }

  /// Makes the next solve start from an active set, and from x (n) for the unknowns that are Between.
  [[nodiscard]] bool warm_start(const VectorView& x, std::span<const QpSide> bounds, std::span<const QpSide> rows) {
    if (x.size() != n_ || !all_finite(x) || !warm_start(bounds, rows)) return false;
    x_.head(n_) = x;
    return true;
  }

  /// Receding horizon: unknown i takes value and active-set status of unknown i + unknowns, row i those of row i + rows; the
  /// tails repeat their last blocks.
  void shift(Index unknowns, Index rows) {
    if (start_ == Start::Cold) return;
    for (Index i = 0; unknowns > 0 && i + unknowns < n_; ++i) {
      x_[i] = x_[i + unknowns];
      state(i) = state(i + unknowns);
      sides_of_unknowns_[static_cast<std::size_t>(i)] = sides_of_unknowns_[static_cast<std::size_t>(i + unknowns)];
    }
    for (Index i = 0; rows > 0 && i + rows < m_; ++i) {
      y_[i] = y_[i + rows];
      sides_of_rows_[static_cast<std::size_t>(i)] = sides_of_rows_[static_cast<std::size_t>(i + rows)];
    }
    structured_.shift(unknowns);
  }

  /// Forgets the active set: the next solve is cold.
  void reset() {
    start_ = Start::Cold;
    structured_.reset();
  }

 private:
  using Problem = detail::ProximalProblem<Scalar>;
  using State = typename Problem::State;
  enum class Start { Cold, FromX, FromSides, Warm };

  State& state(Index i) { return problem_.state[static_cast<std::size_t>(i)]; }

  std::span<const QpSide> sides() const { return {sides_of_unknowns_.data(), static_cast<std::size_t>(n_)}; }

  /// Sizes everything but the data to the room that the data have.
  void reserve_work() {
    const Index n = data_.capacity_n(), m = data_.capacity_m();
    problem_.reserve(n, m);
    proofs_.reserve(n, m);
    best_.reserve(n, m);
    structured_.reserve(n, m);
    closest_.reserve(n, m);
    sides_of_unknowns_.assign(static_cast<std::size_t>(n), QpSide::Between);
    sides_of_rows_.assign(static_cast<std::size_t>(m), QpSide::Between);
    for (VectorX<Scalar>* v : {&D_, &q_, &x_, &old_x_, &p_, &n_work_, &n_size_}) v->setZero(n);
    for (VectorX<Scalar>* v : {&E_, &y_, &old_y_, &delta_, &r2_, &m_work_}) v->setZero(m);
    n_ = data_.n();
    m_ = data_.m();
    prepared_ = false;
    reset();
  }

  /// Takes over what the structured method found, for solves that it cannot do.
  void follow(const result_type& result) {
    for (Index i = 0; i < n_; ++i) {
      x_[i] = result.x[i];
      state(i) = !(x_[i] > data_.lo()[i]) ? State::Lower : !(x_[i] < data_.hi()[i]) ? State::Upper : State::Free;
    }
    y_.head(m_) = result.row_multipliers;
    start_ = Start::Warm;
  }

  /// Scales H and A afresh after either changed.
  void prepare() {
    if (prepared_) return;
    problem_.resize(n_, m_);
    problem_.H() = data_.H();
    problem_.A() = data_.A();
    detail::equilibrate<Scalar>(problem_.H(), problem_.A(), D_.head(n_), E_.head(m_));
    problem_.At() = problem_.A().transpose();
    problem_.index();
    curvature_ = Scalar(0);
    for (Index j = 0; j < n_; ++j) curvature_ = (std::max)(curvature_, problem_.H()(j, j));
    prepared_ = true;
    weighted_ = false;
  }

  /// Loads the scaled vectors, the start and the weights.
  void take_start() {
    using std::abs;
    using std::sqrt;
    const VectorX<Scalar>&lo = data_.lo(), &hi = data_.hi();
    Scalar steepest(0);
    const auto scaled = [](const Scalar& bound, const Scalar& factor) {
      return detail::has_bound(bound) ? Scalar(bound * factor) : bound;
    };
    for (Index i = 0; i < n_; ++i) {
      problem_.g[i] = D_[i] * data_.g()[i];
      steepest = (std::max)(steepest, Scalar(abs(problem_.g[i])));
      problem_.lo[i] = scaled(lo[i], Scalar(1) / D_[i]);
      problem_.hi[i] = scaled(hi[i], Scalar(1) / D_[i]);
      if (start_ == Start::Cold) x_[i] = Scalar(0);
      const bool fixed = !(lo[i] < hi[i]);
      if (start_ == Start::FromSides) state(i) = static_cast<State>(sides_of_unknowns_[static_cast<std::size_t>(i)]);
      const bool keep = (start_ == Start::Warm || start_ == Start::FromSides) && !fixed;
      if (keep && state(i) == State::Lower && detail::has_bound(lo[i])) x_[i] = lo[i];
      if (keep && state(i) == State::Upper && detail::has_bound(hi[i])) x_[i] = hi[i];
      x_[i] = (std::min)((std::max)(x_[i], lo[i]), hi[i]);
      problem_.x[i] = x_[i] / D_[i];
      if (!keep || state(i) != State::Free) {
        state(i) = !(x_[i] > lo[i]) ? State::Lower : !(x_[i] < hi[i]) ? State::Upper : State::Free;
      }
    }
    for (Index i = 0; i < m_; ++i) {
      problem_.rl[i] = scaled(data_.rl()[i], E_[i]);
      problem_.ru[i] = scaled(data_.ru()[i], E_[i]);
      if (start_ == Start::Cold) y_[i] = Scalar(0);
      if (start_ == Start::FromSides) take_side(i);
      problem_.y[i] = y_[i] / E_[i];
    }
    from_sides_ = start_ == Start::FromSides;
    const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
    // Smaller numbers count as zero: they are far below every tolerance, and ρ would underflow.
    const Scalar least = Scalar(1e-30);
    const Scalar slope = steepest > least ? steepest : Scalar(1);
    const Scalar unit = curvature_ > least ? curvature_ : slope;
    const Scalar mu_unit = Scalar(1) / (std::max)(unit, slope);
    const bool far = !weighted_ || start_ == Start::Cold || mu_unit > Scalar(64) * mu_unit_ || mu_unit < mu_unit_ / Scalar(64);
    if (far) {
      // A cold start takes its first steps close to x and falls to the lasting weight: far fewer bounds are met in vain.
      rho_unit_ = Scalar(8) * half * unit;
      problem_.rho = start_ == Start::Cold ? (std::max)(rho_unit_, Scalar(1e-2) * unit) : rho_unit_;
      problem_.mu = (start_ == Start::FromSides ? sqrt(half) : Scalar(0.1)) * mu_unit;
      problem_.rho_ceiling = unit;
      mu_unit_ = mu_unit;
      weighted_ = true;
      problem_.factor.clear();
    } else if (problem_.rho < rho_unit_) {  // lowered for a far minimum
      problem_.rho = rho_unit_;
      problem_.factor.clear();
    }
    start_ = Start::Warm;
  }

  /// Gives row i a multiplier that shows the side it was given: the sign is what counts.
  void take_side(Index i) {
    const QpSide side = sides_of_rows_[static_cast<std::size_t>(i)];
    const Scalar sign = side == QpSide::Lower ? Scalar(1) : Scalar(-1);
    const bool offered = detail::has_bound(side == QpSide::Lower ? data_.rl()[i] : data_.ru()[i]);
    if (side == QpSide::Between || !offered) {
      y_[i] = Scalar(0);
    } else if (!(y_[i] * sign > Scalar(0))) {
      y_[i] = sign * Scalar(1e-30);
    }
  }

  /// Solves for x and y on the sets that the start names.
  KktResiduals<Scalar> refine_sides(const KktResiduals<Scalar>& now) {
    const bool good = problem_.sync_rows([this](Index i) {
      return !(problem_.rl[i] < problem_.ru[i]) || problem_.y[i] > Scalar(0) || problem_.y[i] < Scalar(0);
    });
    return good ? refine(now) : now;
  }

  /// Residuals of the present (x, y); q_ holds the scaled gradient afterwards.
  KktResiduals<Scalar> judge() {
    const detail::ScaledJudgement<Scalar> judgement = detail::judge_scaled(problem_, D_, E_, settings_, q_);
    sharp_ = judgement.sharp;
    return judgement.residuals;
  }

  Scalar excess(const KktResiduals<Scalar>& r) const { return detail::excess(r, settings_); }
  void keep(const KktResiduals<Scalar>& now) { best_.offer(now, settings_, problem_.x.head(n_), problem_.y.head(m_)); }

  /// Refines (x, y) on the sets of the factor towards the unregularised optimality equations while that helps.
  KktResiduals<Scalar> refine(KktResiduals<Scalar> now) {
    constexpr int kSteps = 12;
    for (int step = 0; step < kSteps && excess(now) > Scalar(1e-3); ++step) {
      old_x_.head(n_) = problem_.x.head(n_);
      old_y_.head(m_) = problem_.y.head(m_);
      for (Index k = 0; k < problem_.factor.row_size(); ++k) {
        const Index i = problem_.factor.row(k);
        const Scalar y = problem_.y[i];
        const bool lower =
            !(problem_.rl[i] < problem_.ru[i]) || y > Scalar(0) || (!(y < Scalar(0)) && problem_.ax[i] < problem_.rl[i]);
        r2_[i] = problem_.ax[i] - (lower ? problem_.rl[i] : problem_.ru[i]);
        if (!detail::has_bound(lower ? problem_.rl[i] : problem_.ru[i])) r2_[i] = Scalar(0);
      }
      problem_.factor.solve(q_, r2_, p_, delta_);
      for (Index k = 0; k < problem_.factor.free_size(); ++k) {
        const Index i = problem_.factor.unknown(k);
        problem_.x[i] = (std::min)((std::max)(Scalar(problem_.x[i] + p_[i]), problem_.lo[i]), problem_.hi[i]);
      }
      for (Index k = 0; k < problem_.factor.row_size(); ++k) {
        const Index i = problem_.factor.row(k);
        Scalar y = problem_.y[i] + delta_[i];
        if (!detail::has_bound(problem_.rl[i])) y = (std::min)(y, Scalar(0));
        if (!detail::has_bound(problem_.ru[i])) y = (std::max)(y, Scalar(0));
        problem_.y[i] = y;
      }
      problem_.refresh_products();
      const KktResiduals<Scalar> next = judge();
      if (!(excess(next) < Scalar(0.5) * excess(now))) {
        if (!(excess(next) < excess(now))) {
          problem_.x.head(n_) = old_x_.head(n_);
          problem_.y.head(m_) = old_y_.head(m_);
          problem_.refresh_products();
          return judge();
        }
        return next;
      }
      now = next;
    }
    return now;
  }

  /// Asks whether y - yk proves infeasibility, and hands the proof to the result in the caller's units.
  bool check_infeasible(result_type& result) {
    if (!proofs_.infeasible(problem_)) return false;
    if (proven_) return true;
    for (Index i = 0; i < m_; ++i) result.row_multipliers[i] = proofs_.farkas_rows()[i] * E_[i];
    for (Index j = 0; j < n_; ++j) result.bound_multipliers[j] = proofs_.farkas_bounds()[j] / D_[j];
    result.ray.setConstant(Scalar(0));
    return true;
  }

  /// Asks whether x - xk is a ray. Near-rays lead to a far minimum: x goes there, and ρ falls so that it does not hold x back.
  bool check_unbounded(result_type& result) {
    const detail::RayVerdict verdict = proofs_.unbounded(problem_);
    if (verdict == detail::RayVerdict::Proven) {
      for (Index j = 0; j < n_; ++j) result.ray[j] = proofs_.direction()[j] * D_[j];
      return true;
    }
    if (verdict == detail::RayVerdict::FarMinimum) {
      proofs_.go_to_far_minimum(problem_);
      const Scalar floor = Scalar(64) * scalar_traits<Scalar>::epsilon() * problem_.rho_ceiling;
      problem_.refresh_products();
      if (problem_.rho > floor) {
        problem_.rho = (std::max)(floor, Scalar(problem_.rho / Scalar(16)));
        problem_.factor.clear();
      }
    }
    return false;
  }

  QpStatus iterate(const detail::Budget& budget, result_type& result) {
    using std::abs;
    using std::sqrt;
    const Scalar zero(0);
    const Scalar one(1);
    const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
    problem_.refresh_products();
    KktResiduals<Scalar> now = judge();
    if (from_sides_ && excess(now) > one) now = refine_sides(now);
    if (excess(now) <= one) return QpStatus::Solved;
    keep(now);
    Scalar tolerance = Scalar(1e-3) * (std::max)(curvature_, one / mu_unit_);
    const Scalar tolerance_floor = Scalar(0.1) * settings_.stationarity_tolerance / mu_unit_;
    Scalar gap = scalar_traits<Scalar>::infinity();
    int patience = 0;  // steps after the answer passed, for what its largest terms hide: until it passes in scaled space too
    bool falling = false;  // a ray is known; what is left to find is a feasible point, without the objective's slope
    const auto seek = [&] {
      falling = true;
      problem_.g.head(n_).setConstant(zero);
      for (Index j = 0; j < n_; ++j) problem_.x[j] = (std::min)((std::max)(zero, problem_.lo[j]), problem_.hi[j]);
      for (Index j = 0; j < n_; ++j) {
        state(j) = !(problem_.x[j] > problem_.lo[j])   ? State::Lower
                   : !(problem_.x[j] < problem_.hi[j]) ? State::Upper
                                                       : State::Free;
      }
      problem_.y.head(m_).setConstant(zero);
      problem_.refresh_products();
      gap = scalar_traits<Scalar>::infinity();
    };
    for (int outer = 0; outer < kOuterLimit; ++outer) {
      problem_.xk.head(n_) = problem_.x.head(n_);
      problem_.yk.head(m_) = problem_.y.head(m_);
      const typename Problem::Outcome outcome = problem_.minimise(tolerance, result.iterations, budget);
      if (outcome == Problem::Outcome::Concave) return QpStatus::NonConvex;
      problem_.refresh_products();
      now = judge();
      const Scalar violation = detail::row_excess(now, settings_);
      if (falling && now.relative_feasibility <= settings_.feasibility_tolerance) return QpStatus::DualInfeasible;
      if (!falling) keep(now);
      if (outcome == Problem::Outcome::TimeSpent) return QpStatus::TimeLimit;
      if (outcome != Problem::Outcome::Minimised) return QpStatus::IterationLimit;
      if (!falling && excess(now) <= one && (sharp_ || ++patience > kPatience)) return finish(now);
      if (!(now.relative_feasibility <= settings_.feasibility_tolerance) && check_infeasible(result)) {
        return QpStatus::PrimalInfeasible;
      }
      if (!falling && check_unbounded(result)) {
        if (now.feasibility <= settings_.feasibility_tolerance) return QpStatus::DualInfeasible;
        seek();
        continue;
      }
      bool changed = false;
      if (problem_.sync(changed)) {
        now = refine(judge());
        if (falling && now.relative_feasibility <= settings_.feasibility_tolerance) return QpStatus::DualInfeasible;
        if (!falling && excess(now) <= one && (sharp_ || ++patience > kPatience)) return QpStatus::Solved;
        if (!falling) keep(now);
      }
      if (detail::row_excess(now, settings_) > one && violation > Scalar(0.1) * gap) {
        problem_.mu = (std::max)(Scalar(0.1) * problem_.mu, Scalar((outer < kGentle ? sqrt(half) : half) * mu_unit_));
        problem_.factor.touch();
      }
      if (problem_.rho > rho_unit_) {
        problem_.rho = (std::max)(rho_unit_, Scalar(0.03) * problem_.rho);
        problem_.factor.clear();
      }
      gap = violation;
      tolerance = (std::max)(tolerance_floor, Scalar(0.05) * tolerance);
    }
    return QpStatus::IterationLimit;
  }

  /// Polishes a point that already passes.
  QpStatus finish(const KktResiduals<Scalar>& now) {
    bool changed = false;
    if (problem_.sync(changed)) refine(now);
    return QpStatus::Solved;
  }

  /// After PrimalInfeasible: goes to the closest feasible point, and from there to the least objective among the closest
  /// points. The proof in the result stays.
  void approach(const detail::Budget& budget, result_type& result) {
    for (Index i = 0; i < m_; ++i) {  // distances count in the caller's units
      problem_.A().row(i) *= Scalar(1) / E_[i];
      problem_.rl[i] = data_.rl()[i];
      problem_.ru[i] = data_.ru()[i];
    }
    problem_.At() = problem_.A().transpose();
    for (Index j = 0; j < n_; ++j) {
      if (!is_finite(problem_.x[j])) problem_.x[j] = Scalar(0);
      problem_.x[j] = (std::min)((std::max)(problem_.x[j], problem_.lo[j]), problem_.hi[j]);
    }
    const bool least = closest_.find(problem_, budget, result.iterations);
    result.row_shifts = closest_.shifts().head(m_);
    x_.head(n_) = D_.head(n_).cwiseProduct(problem_.x.head(n_));
    prepared_ = false;
    prepare();
    if (!least) {
      result.message = "the closest point was not found: the budget ended, or rounding stopped progress";
      return;
    }
    start_ = Start::FromX;
    y_.head(m_).setConstant(Scalar(0));
    take_start();
    for (Index i = 0; i < m_; ++i) {
      if (detail::has_bound(problem_.rl[i])) problem_.rl[i] -= result.row_shifts[i] * E_[i];
      if (detail::has_bound(problem_.ru[i])) problem_.ru[i] -= result.row_shifts[i] * E_[i];
    }
    proven_ = true;
    const QpStatus status = iterate(budget, result);
    proven_ = false;
    if (status == QpStatus::Solved) return;
    problem_.x.head(n_) = x_.head(n_).cwiseQuotient(D_.head(n_));
    result.message = "x is a closest point, but not the one of the least objective: that is unbounded, or the budget ended";
  }

  /// Fills the result in the caller's units; the definition has the last word on "Solved".
  void report(const VectorView& lb, const VectorView& ub, const VectorView& rl, const VectorView& ru, result_type& result) {
    const Scalar zero(0);
    const bool infeasible = result.status == QpStatus::PrimalInfeasible;
    const bool unbounded = result.status == QpStatus::DualInfeasible;
    if (!unbounded) result.ray.setConstant(zero);
    for (Index i = 0; i < n_; ++i) problem_.g[i] = D_[i] * data_.g()[i];
    const bool unfinished = result.status == QpStatus::IterationLimit || result.status == QpStatus::TimeLimit ||
                            result.status == QpStatus::NonConvex;
    if (unfinished && best_.known()) {
      if (best_.away() <= Scalar(1)) result.status = QpStatus::Solved;
      problem_.x.head(n_) = best_.x().head(n_);
      problem_.y.head(m_) = best_.y().head(m_);
    }
    if (!all_finite(problem_.x.head(n_)) || !all_finite(problem_.y.head(m_))) {
      for (Index i = 0; i < n_; ++i) problem_.x[i] = (std::min)((std::max)(zero, problem_.lo[i]), problem_.hi[i]);
      problem_.y.head(m_).setConstant(zero);
      if (!infeasible && !unbounded && result.status != QpStatus::NonConvex) result.status = QpStatus::IterationLimit;
      problem_.factor.clear();
    }
    problem_.refresh_products();
    problem_.reduced_gradient(q_);
    n_work_.head(n_).setConstant(zero);
    p_.head(n_).setConstant(zero);
    for (Index j = 0; j < n_; ++j) {
      x_[j] = D_[j] * problem_.x[j];
      result.x[j] = x_[j];
      n_work_[j] = problem_.hx[j] / D_[j];                       // Hx
      p_[j] = (problem_.hx[j] + problem_.g[j] - q_[j]) / D_[j];  // Aᵀy
      n_size_[j] = detail::bound_multiplier(q_[j], problem_.x[j], problem_.lo[j], problem_.hi[j]) / D_[j];
    }
    for (Index i = 0; i < m_; ++i) {
      y_[i] = E_[i] * problem_.y[i];
      m_work_[i] = problem_.ax[i] / E_[i];
    }
    const KktResiduals<Scalar> r =
        detail::kkt_from_products<Scalar>(n_work_.head(n_), m_work_.head(m_), p_.head(n_), data_.g().head(n_), rl, ru, lb, ub,
                                          result.x, y_.head(m_), n_size_.head(n_));
    detail::conclude(r, settings_, result);
    if (!infeasible) {
      result.bound_multipliers = n_size_.head(n_);
      result.row_multipliers = y_.head(m_);
    }
    if (!infeasible && !unbounded) detail::note_sides<Scalar>(data_.lo(), data_.hi(), data_.rl(), data_.ru(), result);
    if (result.status != QpStatus::Solved && result.status != QpStatus::SolvedInaccurate) reset();
  }

  static constexpr int kOuterLimit = 200, kGentle = 3, kPatience = 8;

  QpSettings<Scalar> settings_;
  Problem problem_;
  detail::ProblemData<Scalar> data_;
  detail::ProofSearch<Scalar> proofs_;
  detail::BestIterate<Scalar> best_;
  detail::StructuredBox<Scalar> structured_;
  detail::ClosestPoint<Scalar> closest_;
  std::vector<QpSide> sides_of_unknowns_, sides_of_rows_;
  VectorX<Scalar> D_, q_, x_, old_x_, p_, n_work_, n_size_;
  VectorX<Scalar> E_, y_, old_y_, delta_, r2_, m_work_;
  Scalar curvature_ = Scalar(0), mu_unit_ = Scalar(1), rho_unit_ = Scalar(0);
  Index n_ = 0, m_ = 0;
  Start start_ = Start::Cold;
  bool good_settings_ = true, prepared_ = false, weighted_ = false, from_sides_ = false, proven_ = false, sharp_ = false;
};

}  // namespace clothctl
