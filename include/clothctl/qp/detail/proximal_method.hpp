#pragma once

// The proximal method of multipliers on a scaled problem:
//
//   x_{k+1} = argmin over lb ≤ x ≤ ub of f(x) + ρ/2 |x - x_k|² + 1/(2μ) dist²(Ax - μ y_k, [rl, ru])
//   y_{k+1} = y(x_{k+1})
//
// Every subproblem is strictly convex and feasible (proximal_problem.hpp), so dependent rows,
// degenerate vertices, semidefinite H and linear programs are no special cases. Once the active
// sets are right, a few refinement steps give the exact solution: they solve the optimality
// equations of these sets without the terms in ρ and μ, with the factor of the regularised
// equations. When no solution exists, y_{k+1} - y_k and x_{k+1} - x_k tend to a Farkas pair and to
// a ray (certificate_search.hpp). Scaling is by powers of two, hence exact. Tolerances apply to
// unscaled residuals. Reference: Rockafellar, Math. Oper. Res. 1 (1976); Hermans, Themelis and
// Patrinos, QPALM, Math. Program. Comput. 14 (2022), for Newton steps in the inner loop.

#include <algorithm>

#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/certificate_search.hpp"
#include "clothctl/qp/detail/problem_data.hpp"
#include "clothctl/qp/detail/proximal_problem.hpp"
#include "clothctl/qp/detail/scaled_residuals.hpp"
#include "clothctl/qp/detail/scaling.hpp"
#include "clothctl/qp/detail/termination.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Where a run of the proximal method starts from.
enum class ProximalStart {
  /// Zero, with the strong weights of the first steps.
  Cold,
  /// The x that was loaded.
  FromX,
  /// The active set that was loaded, one side for each unknown and row.
  FromSides,
  /// The end of the last run.
  Warm
};

/// Iterate, weights and scales of the method. Use: `scale` after a matrix changed, `load` for each
/// start, `run`, `settle`.
template <RealScalar Scalar>
class ProximalMethod {
 public:
  using Vector = VectorX<Scalar>;
  using Problem = ProximalProblem<Scalar>;
  using State = typename Problem::State;
  using Start = ProximalStart;

  /// Takes settings, for their tolerances.
  explicit ProximalMethod(const QpSettings<Scalar>& settings) : settings_(settings) {}

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    problem_.reserve(n, m);
    proofs_.reserve(n, m);
    best_.reserve(n, m);
    set_zero<Scalar>({&D_, &q_, &old_x_, &p_}, n);
    set_zero<Scalar>({&E_, &old_y_, &delta_, &r2_}, m);
    weighted_ = false;
  }

  /// Takes H and A and scales them: Ĥ = D H D, Â = E A D.
  void scale(const ProblemData<Scalar>& data) {
    const Index n = data.n(), m = data.m();
    problem_.resize(n, m);
    std::copy_n(data.H().data(), n * n, problem_.H().data());
    std::copy_n(data.A().data(), m * n, problem_.A().data());
    equilibrate<Scalar>(problem_.H(), problem_.A(), D_.head(n), E_.head(m));
    problem_.refresh_transpose();
    problem_.index();
    curvature_ = Scalar(0);
    for (Index j = 0; j < n; ++j) curvature_ = (std::max)(curvature_, problem_.H()(j, j));
    weighted_ = false;
  }

  /// Loads gradient and bounds of the data, the start x = D x̂ (within its bounds), y = E ŷ, and
  /// chooses the weights. The states of the unknowns, in `problem()`, are the caller's to set.
  void load(const ProblemData<Scalar>& data, const Vector& x, const Vector& y, Start start) {
    using std::abs;
    const auto scaled = [](const Scalar& bound, const Scalar& factor) {
      return has_bound(bound) ? Scalar(bound * factor) : bound;
    };
    problem_.attach();
    Scalar steepest(0);
    load_gradient(data);
    for (Index j = 0; j < problem_.unknowns(); ++j) {
      steepest = (std::max)(steepest, Scalar(abs(problem_.g[j])));
      problem_.lo[j] = scaled(data.lo()[j], Scalar(1) / D_[j]);
      problem_.hi[j] = scaled(data.hi()[j], Scalar(1) / D_[j]);
      problem_.x[j] = x[j] / D_[j];
    }
    for (Index i = 0; i < problem_.rows(); ++i) {
      problem_.rl[i] = scaled(data.rl()[i], E_[i]);
      problem_.ru[i] = scaled(data.ru()[i], E_[i]);
      problem_.y[i] = y[i] / E_[i];
    }
    from_sides_ = start == Start::FromSides;
    choose_weights(steepest, start);
  }

  /// Forgets the best iterate of earlier runs, which `settle` falls back to.
  void forget_best() { best_.forget(); }

  /// Runs from the loaded start; adds rounds with a change of sets to `iterations`. Returns Solved,
  /// what ran out, NonConvex, or with a proof in `proofs()` PrimalInfeasible or DualInfeasible.
  /// IterationLimit with budget left: rounding stopped progress. Never allocates.
  QpStatus run(const Budget& budget, int& iterations) {
    const Scalar one(1);
    problem_.refresh_products();
    KktResiduals<Scalar> now = judge();
    if (from_sides_ && residual_ratio(now) > one) now = refine_sides(now);
    if (residual_ratio(now) <= one && sharp_) return QpStatus::Solved;
    keep(now);
    Scalar tolerance = Scalar(1e-3) * (std::max)(curvature_, one / mu_unit_);
    const Scalar tolerance_floor = Scalar(0.1) * settings_.stationarity_tolerance / mu_unit_;
    Scalar gap = scalar_traits<Scalar>::infinity();
    int patience = 0;  // steps after the answer passed, for what its largest terms hide: until it
                       // passes in scaled space too
    bool falling = false;  // a ray is known; what is left to find is a feasible point, without the
                           // objective's slope
    for (int outer = 0; outer < kOuterLimit; ++outer) {
      std::copy_n(problem_.x.data(), n(), problem_.xk.data());
      std::copy_n(problem_.y.data(), m(), problem_.yk.data());
      const typename Problem::Outcome outcome = problem_.minimise(tolerance, iterations, budget);
      if (outcome == Problem::Outcome::Concave) return QpStatus::NonConvex;
      problem_.refresh_products();
      now = judge();
      const Scalar violation = row_residual_ratio(now, settings_);
      if (falling && is_feasible(now)) return QpStatus::DualInfeasible;
      if (!falling) keep(now);
      if (outcome == Problem::Outcome::TimeSpent) return QpStatus::TimeLimit;
      if (outcome != Problem::Outcome::Minimised) return QpStatus::IterationLimit;
      if (!falling && residual_ratio(now) <= one && (sharp_ || ++patience > kPatience))
        return finish(now);
      if (!is_feasible(now) && proofs_.infeasible(problem_)) return QpStatus::PrimalInfeasible;
      if (!falling && is_unbounded_along_step()) {
        if (now.feasibility <= settings_.feasibility_tolerance) return QpStatus::DualInfeasible;
        falling = true;
        seek_feasible_point();
        gap = scalar_traits<Scalar>::infinity();
        continue;
      }
      bool changed = false;
      if (problem_.sync(changed)) {
        now = refine(judge());
        if (falling && is_feasible(now)) return QpStatus::DualInfeasible;
        if (!falling && residual_ratio(now) <= one && (sharp_ || ++patience > kPatience))
          return QpStatus::Solved;
        if (!falling) keep(now);
      }
      if (row_residual_ratio(now, settings_) > one && violation > Scalar(0.1) * gap)
        lower_mu(outer);
      if (problem_.rho > rho_unit_) {
        problem_.rho = (std::max)(rho_unit_, Scalar(0.03) * problem_.rho);
        problem_.factor.clear();
      }
      gap = violation;
      tolerance = (std::max)(tolerance_floor, Scalar(0.05) * tolerance);
    }
    return QpStatus::IterationLimit;
  }

  /// Ends a solve: after a status without an answer the iterate becomes the best one met, and
  /// Solved if that passes; one that is not finite is given up. Products and `gradient()` are fresh
  /// afterwards, and known to a fraction of the tolerances where the number type allows. Returns
  /// the status to report.
  QpStatus settle(const ProblemData<Scalar>& data, QpStatus status) {
    load_gradient(data);
    std::copy_n(problem_.x.data(), n(), old_x_.data());
    std::copy_n(problem_.yk.data(), m(), old_y_.data());
    const bool unfinished = status == QpStatus::IterationLimit || status == QpStatus::TimeLimit ||
                            status == QpStatus::NonConvex;
    if (unfinished && best_.known()) {
      if (best_.away() <= Scalar(1)) status = QpStatus::Solved;
      std::copy_n(best_.x().data(), n(), problem_.x.data());
      std::copy_n(best_.y().data(), m(), problem_.y.data());
    }
    if (!all_finite(problem_.x.head(n())) || !all_finite(problem_.y.head(m()))) {
      put_near_zero();
      std::fill_n(problem_.y.data(), m(), Scalar(0));
      if (status == QpStatus::Solved || status == QpStatus::TimeLimit)
        status = QpStatus::IterationLimit;
      problem_.factor.clear();
    }
    problem_.refresh_products();
    problem_.reduced_gradient(q_);
    blurred_ = rounding_counts(problem_, D_, E_, settings_, q_);
    if (blurred_ && has_accurate_sums<Scalar>()) {
      look_closely(status == QpStatus::Solved);
      blurred_ = false;
    }
    return status;
  }

  /// Returns true when rounding of the products of the last `settle` could hide an error of the
  /// size of a tolerance, and the number type knows no better.
  bool blurred() const { return blurred_; }
  /// The scaled problem with its iterate.
  Problem& problem() { return problem_; }
  const Problem& problem() const { return problem_; }
  /// The proof of the last PrimalInfeasible or DualInfeasible, in scaled space.
  const CertificateSearch<Scalar>& proofs() const { return proofs_; }
  /// Scales of the unknowns, n entries in use.
  const Vector& D() const { return D_; }
  /// Scales of the rows, m entries in use.
  const Vector& E() const { return E_; }
  /// Where the last run stood before `settle`, in scaled space: an unfinished one goes on from
  /// there, not from its best iterate.
  const Vector& last_x() const { return old_x_; }
  /// The row multipliers that its last step started from.
  const Vector& last_y() const { return old_y_; }
  /// Ĥx̂ + ĝ - Âᵀŷ of the last `settle`, n entries in use.
  const Vector& gradient() const { return q_; }

 private:
  static constexpr int kOuterLimit = 200, kGentle = 3, kPatience = 8;

  Index n() const { return problem_.unknowns(); }
  Index m() const { return problem_.rows(); }

  void load_gradient(const ProblemData<Scalar>& data) {
    for (Index j = 0; j < n(); ++j) problem_.g[j] = D_[j] * data.g()[j];
  }

  /// Weights in the units of the scaled problem: those of the last run are kept where they are of
  /// the right size.
  void choose_weights(const Scalar& steepest, Start start) {
    using std::sqrt;
    const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
    // Smaller numbers count as zero: they are far below every tolerance, and ρ would underflow.
    const Scalar least = Scalar(1e-30);
    const Scalar slope = steepest > least ? steepest : Scalar(1);
    const Scalar unit = curvature_ > least ? curvature_ : slope;
    const Scalar mu_unit = Scalar(1) / (std::max)(unit, slope);
    const bool stale = !weighted_ || start == Start::Cold || mu_unit > Scalar(64) * mu_unit_ ||
                       mu_unit < mu_unit_ / Scalar(64);
    if (stale) {
      // A cold start takes its first steps close to x and falls to the lasting weight: far fewer
      // bounds are met in vain.
      rho_unit_ = Scalar(8) * half * unit;
      problem_.rho = start == Start::Cold ? (std::max)(rho_unit_, Scalar(1e-2) * unit) : rho_unit_;
      problem_.mu = (start == Start::FromSides ? sqrt(half) : Scalar(0.1)) * mu_unit;
      problem_.rho_ceiling = unit;
      mu_unit_ = mu_unit;
      weighted_ = true;
      problem_.factor.clear();
    } else if (problem_.rho < rho_unit_) {  // lowered for a far minimum
      problem_.rho = rho_unit_;
      problem_.factor.clear();
    }
  }

  /// Makes violated rows stiffer, in the first steps only so far.
  void lower_mu(int outer) {
    using std::sqrt;
    const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
    problem_.mu = (std::max)(Scalar(0.1) * problem_.mu,
                             Scalar((outer < kGentle ? sqrt(half) : half) * mu_unit_));
    problem_.factor.touch();
  }

  /// Residuals of the present (x, y); q_ holds the scaled gradient afterwards.
  KktResiduals<Scalar> judge() {
    if (precise_) {
      problem_.sharpen_products(q_);
    } else {
      problem_.reduced_gradient(q_);
    }
    const ScaledResiduals<Scalar> judgement = scaled_residuals(problem_, D_, E_, settings_, q_);
    sharp_ = judgement.met_in_scaled_space;
    return judgement.residuals;
  }

  Scalar residual_ratio(const KktResiduals<Scalar>& r) const {
    return detail::residual_ratio(r, settings_);
  }
  bool is_feasible(const KktResiduals<Scalar>& r) const {
    return r.relative_feasibility <= settings_.feasibility_tolerance;
  }
  void keep(const KktResiduals<Scalar>& now) {
    best_.offer(now, settings_, problem_.x.head(n()), problem_.y.head(m()));
  }

  /// Products and gradient as if summed in twice the precision. Where they show that a solution is
  /// none yet, it is refined.
  void look_closely(bool solution) {
    precise_ = true;
    const KktResiduals<Scalar> now = judge();
    bool changed = false;
    if (solution && residual_ratio(now) > Scalar(1) && problem_.sync(changed)) refine(now);
    precise_ = false;
  }

  /// Solves for x and y on the sets that the start names.
  KktResiduals<Scalar> refine_sides(const KktResiduals<Scalar>& now) {
    const bool good = problem_.sync_rows([this](Index i) {
      return !(problem_.rl[i] < problem_.ru[i]) || problem_.y[i] > Scalar(0) ||
             problem_.y[i] < Scalar(0);
    });
    return good ? refine(now) : now;
  }

  /// Refines (x, y) on the sets of the factor towards the unregularised optimality equations while
  /// that helps.
  KktResiduals<Scalar> refine(KktResiduals<Scalar> now) {
    constexpr int kSteps = 12;
    for (int step = 0; step < kSteps && residual_ratio(now) > Scalar(1e-3); ++step) {
      std::copy_n(problem_.x.data(), n(), old_x_.data());
      std::copy_n(problem_.y.data(), m(), old_y_.data());
      take_refinement_step();
      problem_.refresh_products();
      const KktResiduals<Scalar> next = judge();
      if (!(residual_ratio(next) < residual_ratio(now))) {
        std::copy_n(old_x_.data(), n(), problem_.x.data());
        std::copy_n(old_y_.data(), m(), problem_.y.data());
        problem_.refresh_products();
        return judge();
      }
      if (!(residual_ratio(next) < Scalar(0.5) * residual_ratio(now))) return next;
      now = next;
    }
    return now;
  }

  /// One solve for the optimality equations on the sets of the factor, whose gradient is in q_.
  void take_refinement_step() {
    const KktFactor<Scalar>& factor = problem_.factor;
    for (Index k = 0; k < factor.row_size(); ++k) {
      const Index i = factor.row(k);
      const Scalar y = problem_.y[i];
      const bool lower = !(problem_.rl[i] < problem_.ru[i]) || y > Scalar(0) ||
                         (!(y < Scalar(0)) && problem_.ax[i] < problem_.rl[i]);
      const Scalar edge = lower ? problem_.rl[i] : problem_.ru[i];
      r2_[i] = has_bound(edge) ? Scalar(problem_.ax[i] - edge) : Scalar(0);
    }
    problem_.factor.solve(q_, r2_, p_, delta_);
    for (Index k = 0; k < factor.free_size(); ++k) {
      const Index i = factor.unknown(k);
      problem_.x[i] =
          (std::min)((std::max)(Scalar(problem_.x[i] + p_[i]), problem_.lo[i]), problem_.hi[i]);
    }
    for (Index k = 0; k < factor.row_size(); ++k) {
      const Index i = factor.row(k);
      Scalar y = problem_.y[i] + delta_[i];
      if (!has_bound(problem_.rl[i])) y = (std::min)(y, Scalar(0));
      if (!has_bound(problem_.ru[i])) y = (std::max)(y, Scalar(0));
      problem_.y[i] = y;
    }
  }

  /// Asks whether x - xk is a ray. Near-rays lead to a far minimum: x goes there, and ρ falls so
  /// that it does not hold x back.
  bool is_unbounded_along_step() {
    const RayStatus verdict = proofs_.unbounded(problem_);
    if (verdict != RayStatus::FarMinimum) return verdict == RayStatus::Proven;
    proofs_.go_to_far_minimum(problem_);
    problem_.refresh_products();
    const Scalar floor = Scalar(64) * scalar_traits<Scalar>::epsilon() * problem_.rho_ceiling;
    if (problem_.rho > floor) {
      problem_.rho = (std::max)(floor, Scalar(problem_.rho / Scalar(16)));
      problem_.factor.clear();
    }
    return false;
  }

  /// Starts afresh without the objective's slope.
  void seek_feasible_point() {
    std::fill_n(problem_.g.data(), n(), Scalar(0));
    put_near_zero();
    for (Index j = 0; j < n(); ++j) {
      problem_.state[static_cast<std::size_t>(j)] = !(problem_.x[j] > problem_.lo[j]) ? State::Lower
                                                    : !(problem_.x[j] < problem_.hi[j])
                                                        ? State::Upper
                                                        : State::Free;
    }
    std::fill_n(problem_.y.data(), m(), Scalar(0));
    problem_.refresh_products();
  }

  /// x at the point of the box nearest to zero.
  void put_near_zero() {
    for (Index j = 0; j < n(); ++j)
      problem_.x[j] = (std::min)((std::max)(Scalar(0), problem_.lo[j]), problem_.hi[j]);
  }

  /// Polishes a point that already passes.
  QpStatus finish(const KktResiduals<Scalar>& now) {
    bool changed = false;
    if (problem_.sync(changed)) refine(now);
    return QpStatus::Solved;
  }

  QpSettings<Scalar> settings_;
  Problem problem_;
  CertificateSearch<Scalar> proofs_;
  BestIterate<Scalar> best_;
  Vector D_, q_, old_x_, p_;
  Vector E_, old_y_, delta_, r2_;
  Scalar curvature_ = Scalar(0), mu_unit_ = Scalar(1), rho_unit_ = Scalar(0);
  bool weighted_ = false, from_sides_ = false, sharp_ = false;
  bool blurred_ = false, precise_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
