#pragma once

// The proximal method of multipliers on a scaled problem:
//
//   x_{k+1} = argmin over lb ≤ x ≤ ub of f(x) + ρ/2 |x - x_k|² + 1/(2μ) dist²(Ax - μ y_k, [rl, ru])
//   y_{k+1} = y(x_{k+1})
//
// y(x) are the multipliers of the penalty term. Every subproblem is strictly convex and feasible
// (proximal_problem.hpp). So dependent rows, degenerate vertices, semidefinite H and linear
// programs need no special treatment. When the active sets are right, a few refinement steps give
// the solution to rounding: these steps solve the optimality equations of the sets without the
// terms in ρ and μ, with the factor of the regularised equations. When no solution exists,
// y_{k+1} - y_k and x_{k+1} - x_k converge to a Farkas pair or to a ray (certificate_search.hpp).
// Scaling is by powers of two, hence exact. Tolerances apply to unscaled residuals. References:
// Rockafellar, Math. Oper. Res. 1 (1976); Hermans, Themelis and Patrinos, QPALM, Math. Program.
// Comput. 14 (2022), for Newton steps in the inner loop.

#include <algorithm>
#include <optional>

#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/certificate_search.hpp"
#include "clothctl/qp/detail/entrywise_errors.hpp"
#include "clothctl/qp/detail/outer_progress.hpp"
#include "clothctl/qp/detail/problem_data.hpp"
#include "clothctl/qp/detail/proximal_problem.hpp"
#include "clothctl/qp/detail/refinement_step.hpp"
#include "clothctl/qp/detail/scaled_residuals.hpp"
#include "clothctl/qp/detail/scaling.hpp"
#include "clothctl/qp/detail/termination.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The start of a run of the proximal method.
enum class ProximalStart {
  /// x = 0, y = 0, and a large first weight ρ.
  Cold,
  /// The loaded x.
  FromX,
  /// The loaded active set, with one side for each unknown and row.
  FromSides,
  /// The end of the last run.
  Warm
};

/// Iterate, weights and scales of the method. Call `scale` after each change of a matrix, then for
/// each solve `load`, `run` and `settle`.
template <RealScalar Scalar>
class ProximalMethod {
 public:
  using Vector = VectorX<Scalar>;
  using Problem = ProximalProblem<Scalar>;
  using State = typename Problem::State;
  using Start = ProximalStart;

  /// Takes the tolerances from the settings.
  explicit ProximalMethod(const QpSettings<Scalar>& settings) : settings_(settings) {}

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    problem_.reserve(n, m);
    certificates_.reserve(n, m);
    best_.reserve(n, m);
    entrywise_.reserve(n);
    set_zero<Scalar>({&D_, &q_, &old_x_, &p_}, n);
    set_zero<Scalar>({&E_, &old_y_, &delta_, &r2_}, m);
    weighted_ = false;
  }

  /// Copies and scales H and A: Ĥ = D H D, Â = E A D.
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

  /// Loads gradient, bounds and the start x = D x̂ (must be within the bounds), y = E ŷ, and
  /// chooses the weights ρ and μ. The caller sets the states of the unknowns in `problem()`.
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

  /// Returns true when rounding errors of products at the loaded start could hide the solution: x
  /// and y may be those of other matrices, far along directions that cost nothing there. A start
  /// that is the solution is not far.
  bool start_is_far() {
    problem_.refresh_products();
    (void)measure_residuals();
    return !errors_.met &&
           (rounding_counts(problem_, D_, E_, settings_) || slopes_are_rounding(problem_));
  }

  /// Discards the best iterate of earlier runs. `settle` uses the best iterate of the runs since
  /// this call.
  void forget_best() { best_.forget(); }

  /// Runs from the loaded start. Adds the rounds that change a set to `iterations`. Returns Solved,
  /// IterationLimit, TimeLimit, NonConvex, or PrimalInfeasible or DualInfeasible with a certificate
  /// in `certificates()`. IterationLimit before the end of the budget means that rounding errors
  /// prevent progress. Never allocates.
  QpStatus run(const Budget& budget, int& iterations) {
    const Scalar one(1);
    problem_.refresh_products();
    KktResiduals<Scalar> now = measure_residuals();
    if (from_sides_ && !errors_.met) now = refine_sides(now);
    if (errors_.met) return QpStatus::Solved;
    keep(now);
    Scalar tolerance = Scalar(soft_ ? 3e-2 : 1e-3) * (std::max)(curvature_, one / mu_unit_);
    const Scalar tolerance_floor = Scalar(0.1) * settings_.stationarity_tolerance / mu_unit_;
    gap_ = scalar_traits<Scalar>::infinity();
    extra_steps_ = 0;
    ray_known_ = false;
    progress_.restart();
    for (int outer = 0; outer < kOuterLimit && !progress_.stalled(); ++outer) {
      std::copy_n(problem_.x.data(), n(), problem_.xk.data());
      std::copy_n(problem_.y.data(), m(), problem_.yk.data());
      const int rounds = iterations;
      const typename Problem::Outcome outcome = problem_.minimise(tolerance, iterations, budget);
      if (outcome == Problem::Outcome::NonConvex) return QpStatus::NonConvex;
      problem_.refresh_products();
      now = measure_residuals();
      if (progress_.is_spoilt_by(now.relative_stationarity)) {
        problem_.rho = (std::max)(problem_.rho, rho_unit_);
        problem_.factor.clear();
      }
      const Scalar violation = row_residual_ratio(now, settings_);
      const bool moved = has_moved(n(), problem_.xk, problem_.x);
      if (ray_known_ && is_feasible(now)) return QpStatus::DualInfeasible;
      if (!ray_known_) keep(now);
      const bool late = outer > 0 && budget.after(iterations) == QpStatus::TimeLimit;
      if (outcome == Problem::Outcome::TimeLimit || late) return QpStatus::TimeLimit;
      if (outcome != Problem::Outcome::Minimised) return QpStatus::IterationLimit;
      bool again = false;
      if (const std::optional<QpStatus> end = end_of_step(now, tolerance, again)) return *end;
      if (again) continue;
      bool changed = false;
      if (problem_.sync(changed)) {
        now = refine(measure_residuals());
        if (ray_known_ && is_feasible(now)) return QpStatus::DualInfeasible;
        if (!ray_known_ && residual_ratio(now) <= one &&
            ((errors_.met && !is_doubtful(now)) || ++extra_steps_ > kExtraSteps))
          return QpStatus::Solved;
        if (!ray_known_) keep(now);
      }
      progress_.add(now.relative_stationarity / settings_.stationarity_tolerance,
                    row_residual_ratio(now, settings_), iterations > rounds, moved);
      lower_weights(outer, now, violation > Scalar(0.1) * gap_);
      gap_ = violation;
      tolerance = (std::max)((std::min)(tolerance_floor, tolerance), Scalar(0.05) * tolerance);
    }
    return QpStatus::IterationLimit;
  }

  /// Ends a solve and returns the status to report. After IterationLimit, TimeLimit and NonConvex
  /// it restores the best iterate, and returns Solved if this iterate meets the tolerances. An
  /// iterate that is not finite is replaced by the point of the box nearest to zero. Afterwards
  /// products and `gradient()` are up to date. If rounding errors could reach the tolerances, both
  /// are computed in twice the precision, provided that the scalar type has accurate sums.
  QpStatus settle(const ProblemData<Scalar>& data, QpStatus status) {
    load_gradient(data);
    std::copy_n(problem_.x.data(), n(), old_x_.data());
    std::copy_n(problem_.yk.data(), m(), old_y_.data());
    const bool unfinished = status == QpStatus::IterationLimit || status == QpStatus::TimeLimit ||
                            status == QpStatus::NonConvex;
    if (unfinished && best_.known()) {
      if (best_.ratio() <= Scalar(1)) status = QpStatus::Solved;
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
    limited_by_rounding_ = rounding_counts(problem_, D_, E_, settings_);
    if (limited_by_rounding_ && has_accurate_sums<Scalar>()) {
      refine_accurately(status == QpStatus::Solved);
      limited_by_rounding_ = false;
    }
    return status;
  }

  /// Returns true when, in the last `settle`, rounding errors of products could hide an error of
  /// the size of a tolerance, and the scalar type has no accurate sums.
  bool limited_by_rounding() const { return limited_by_rounding_; }
  /// The scaled problem with its iterate.
  Problem& problem() { return problem_; }
  const Problem& problem() const { return problem_; }
  /// The certificate of the last PrimalInfeasible or DualInfeasible, in scaled space.
  const CertificateSearch<Scalar>& certificates() const { return certificates_; }
  /// Scales of the unknowns, n entries in use.
  const Vector& D() const { return D_; }
  /// Scales of the rows, m entries in use.
  const Vector& E() const { return E_; }
  /// The last x of the run before `settle`, in scaled space. A solve that reached a limit continues
  /// from here, not from its best iterate.
  const Vector& last_x() const { return old_x_; }
  /// The row multipliers at the start of the last step of that run.
  const Vector& last_y() const { return old_y_; }
  /// Ĥx̂ + ĝ - Âᵀŷ of the last `settle`, n entries in use.
  const Vector& gradient() const { return q_; }

 private:
  static constexpr int kOuterLimit = 200, kFirstSteps = 3, kExtraSteps = 8;

  Index n() const { return problem_.unknowns(); }
  Index m() const { return problem_.rows(); }

  void load_gradient(const ProblemData<Scalar>& data) {
    for (Index j = 0; j < n(); ++j) problem_.g[j] = D_[j] * data.g()[j];
  }

  /// Chooses ρ and μ in the units of the scaled problem. Keeps ρ and μ of the last run if they have
  /// the right order of magnitude.
  void choose_weights(const Scalar& steepest, Start start) {
    using std::sqrt;
    const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
    // Smaller numbers count as zero: they are far below all tolerances, and ρ would underflow.
    const Scalar least = Scalar(1e-30);
    const Scalar slope = steepest > least ? steepest : Scalar(1);
    const Scalar unit = curvature_ > least ? curvature_ : slope;
    const Scalar mu_unit = Scalar(1) / (std::max)(unit, slope);
    const bool stale = !weighted_ || start == Start::Cold || mu_unit > Scalar(64) * mu_unit_ ||
                       mu_unit < mu_unit_ / Scalar(64);
    if (stale) {
      // A cold start begins with a large ρ, which keeps the first steps short: this avoids many
      // needless changes of the active set. ρ then decreases to rho_unit_.
      rho_unit_ = Scalar(8) * half * unit;
      problem_.rho = start == Start::Cold ? (std::max)(rho_unit_, Scalar(1e-2) * unit) : rho_unit_;
      // Where rows are inequalities, its first penalty is soft: a stiff one bends φ so much at each
      // row that the line search passes few rows in a round.
      soft_ = start == Start::Cold && problem_.inequalities_count();
      problem_.mu = (start == Start::FromSides ? sqrt(half) : Scalar(soft_ ? 32 : 0.1)) * mu_unit;
      problem_.rho_ceiling = unit;
      mu_unit_ = mu_unit;
      weighted_ = true;
      problem_.factor.clear();
      return;
    }
    if (soft_) problem_.mu = Scalar(0.1) * mu_unit_;  // a cold start ended early
    if (soft_) problem_.factor.touch();
    soft_ = false;
    if (problem_.rho < rho_unit_) {  // a far minimum had decreased it
      problem_.rho = rho_unit_;
      problem_.factor.clear();
    }
  }

  /// Returns false when a certificate of infeasibility is unlikely, so that the search for it is
  /// not worth its time: the penalty is still soft, and the violation falls.
  bool may_be_infeasible(const Scalar& violation) const {
    return !soft_ || violation > Scalar(0.5) * gap_;
  }

  /// Decreases the weights after an outer step. `slow`: the violation of the rows hardly fell.
  void lower_weights(int outer, const KktResiduals<Scalar>& now, bool slow) {
    if (soft_ || (row_residual_ratio(now, settings_) > Scalar(1) && slow)) lower_mu(outer);
    const Scalar rho = problem_.rho > rho_unit_ ? (std::max)(rho_unit_, Scalar(0.03) * problem_.rho)
                       : progress_.slow()       ? less_rho()
                                                : problem_.rho;
    if (!(rho < problem_.rho)) return;
    if (rho < rho_unit_) progress_.set_lowered();
    problem_.rho = rho;
    problem_.factor.clear();
  }

  /// Returns ρ / 16, but no less than rounding of the factor allows.
  Scalar less_rho() const {
    const Scalar floor = Scalar(64) * scalar_traits<Scalar>::epsilon() * problem_.rho_ceiling;
    return (std::min)(problem_.rho, (std::max)(floor, Scalar(problem_.rho / Scalar(16))));
  }

  /// Decreases μ, which penalises violated rows more. The lower limit of μ is higher in the first
  /// steps. The penalty is no longer soft once μ is below a fifth of its unit.
  void lower_mu(int outer) {
    using std::sqrt;
    const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
    problem_.mu = (std::max)(Scalar(0.1) * problem_.mu,
                             Scalar((outer < kFirstSteps ? sqrt(half) : half) * mu_unit_));
    soft_ = soft_ && problem_.mu > Scalar(0.2) * mu_unit_;
    problem_.factor.touch();
  }

  /// Prepares the next steps for errors of entries that are small beside others, and returns the
  /// tolerance of these steps. ρ must not limit how far a slope of that size moves x.
  Scalar sharpen() {
    using std::sqrt;
    const Scalar slope = errors_.least_slope;
    if (!is_finite(slope)) return slope;
    const Scalar epsilon = scalar_traits<Scalar>::epsilon(), half = sqrt(epsilon);
    const Scalar floor = (std::max)(Scalar(64) * epsilon * curvature_, Scalar(1e-30));
    const Scalar wanted = (std::max)(floor, Scalar(8) * half * slope);
    if (wanted < problem_.rho) {
      problem_.rho = wanted;
      problem_.factor.clear();
    }
    return Scalar(0.1) * settings_.stationarity_tolerance * slope;
  }

  /// Returns the residuals of the current (x, y), and stores the scaled gradient in q_. Judges the
  /// errors of single entries when the residuals are within the tolerances.
  KktResiduals<Scalar> measure_residuals() {
    if (accurate_sums_) {
      problem_.accurate_products(q_);
    } else {
      problem_.reduced_gradient(q_);
    }
    const KktResiduals<Scalar> r = scaled_residuals(problem_, D_, E_, q_);
    errors_ = {};
    errors_.met = residual_ratio(r) <= Scalar(1);
    if (errors_.met) errors_ = entrywise_.judge(problem_, settings_, q_);
    return r;
  }

  Scalar residual_ratio(const KktResiduals<Scalar>& r) const {
    return detail::residual_ratio(r, settings_);
  }
  bool is_feasible(const KktResiduals<Scalar>& r) const {
    return r.relative_feasibility <= settings_.feasibility_tolerance;
  }
  /// Offers the iterate as the best one, unless it is within the tolerances and single entries are
  /// not: violations of rows may hide behind a large unknown, or behind multipliers that are still
  /// small. If later steps leave the tolerances, such a point must not count as solved.
  void keep(const KktResiduals<Scalar>& now) {
    if (!errors_.met && residual_ratio(now) <= Scalar(1)) return;
    best_.offer(now, settings_, problem_.x.head(n()), problem_.y.head(m()));
  }

  /// Computes products and gradient in twice the precision. If x is a `solution` and the residuals
  /// then exceed the tolerances, refines it.
  void refine_accurately(bool solution) {
    accurate_sums_ = true;
    const KktResiduals<Scalar> now = measure_residuals();
    bool changed = false;
    if (solution && residual_ratio(now) > Scalar(1) && problem_.sync(changed)) refine(now);
    accurate_sums_ = false;
  }

  /// Solves for x and y on the active sets of the start.
  KktResiduals<Scalar> refine_sides(const KktResiduals<Scalar>& now) {
    const bool good = problem_.sync_rows([this](Index i) {
      return !(problem_.rl[i] < problem_.ru[i]) || problem_.y[i] > Scalar(0) ||
             problem_.y[i] < Scalar(0);
    });
    return good ? refine(now) : now;
  }

  /// Refines (x, y) on the sets of the factor towards the optimality equations without
  /// regularisation, as long as this halves the residuals or meets the limits of single entries.
  KktResiduals<Scalar> refine(KktResiduals<Scalar> now) {
    constexpr int kSteps = 12;
    for (int step = 0; step < kSteps && !(errors_.met && residual_ratio(now) <= Scalar(1e-3));
         ++step) {
      const bool met = errors_.met;
      std::copy_n(problem_.x.data(), n(), old_x_.data());
      std::copy_n(problem_.y.data(), m(), old_y_.data());
      take_refinement_step(problem_, q_, r2_, p_, delta_);
      problem_.refresh_products();
      const KktResiduals<Scalar> next = measure_residuals();
      if (errors_.met && !met) {
        now = next;
        continue;
      }
      if (!(residual_ratio(next) < residual_ratio(now))) {
        std::copy_n(old_x_.data(), n(), problem_.x.data());
        std::copy_n(old_y_.data(), m(), problem_.y.data());
        problem_.refresh_products();
        return measure_residuals();
      }
      if (!(residual_ratio(next) < Scalar(0.5) * residual_ratio(now))) return next;
      now = next;
    }
    return now;
  }

  /// Returns true when x - xk leads to a ray. When it leads to a far minimum, moves x there and
  /// decreases ρ, so that the proximal term no longer limits the steps.
  bool is_unbounded_along_step() {
    const RayStatus status = certificates_.unbounded(problem_);
    if (status != RayStatus::FarMinimum) return status == RayStatus::Proven;
    certificates_.go_to_far_minimum(problem_);
    problem_.refresh_products();
    if (less_rho() < problem_.rho) {
      problem_.rho = less_rho();
      problem_.factor.clear();
    }
    return false;
  }

  /// Restarts near zero with g = 0.
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

  /// Sets x to the point of the box nearest to zero.
  void put_near_zero() {
    for (Index j = 0; j < n(); ++j)
      problem_.x[j] = (std::min)((std::max)(Scalar(0), problem_.lo[j]), problem_.hi[j]);
  }

  /// Returns true when refinement left much of the tolerance of the gradient.
  bool is_doubtful(const KktResiduals<Scalar>& now) const {
    return now.relative_stationarity > Scalar(0.1) * settings_.stationarity_tolerance;
  }

  /// Returns the status with which the solve ends after an outer step, or nothing: the point is a
  /// solution, or the step proves that there is none. Sets `again` when the search for a feasible
  /// point begins. May lower the tolerance of the next steps.
  std::optional<QpStatus> end_of_step(const KktResiduals<Scalar>& now, Scalar& tolerance,
                                      bool& again) {
    if (!ray_known_ && residual_ratio(now) <= Scalar(1)) {
      const bool last = ++extra_steps_ > kExtraSteps;
      if (errors_.met || last) {
        if (const std::optional<QpStatus> end = finish(now, last)) return end;
      }
      tolerance = (std::min)(tolerance, sharpen());
    }
    if (!is_feasible(now) && may_be_infeasible(row_residual_ratio(now, settings_)) &&
        certificates_.infeasible(problem_))
      return QpStatus::PrimalInfeasible;
    again = !ray_known_ && is_unbounded_along_step();
    if (!again) return std::nullopt;
    if (now.feasibility <= settings_.feasibility_tolerance) return QpStatus::DualInfeasible;
    ray_known_ = true;
    seek_feasible_point();
    gap_ = scalar_traits<Scalar>::infinity();
    progress_.restart();
    return std::nullopt;
  }

  /// Refines a point that already meets the tolerances. If little comes of it, the point may be one
  /// on a ray along which the objective falls so slowly that its slope is within the tolerances.
  /// Then returns nothing unless this is the `last` step: the next ones show the ray.
  std::optional<QpStatus> finish(KktResiduals<Scalar> now, bool last) {
    bool changed = false;
    if (problem_.sync(changed)) now = refine(now);
    if (!is_doubtful(now)) return QpStatus::Solved;
    if (certificates_.unbounded(problem_) == RayStatus::Proven) return QpStatus::DualInfeasible;
    return last ? QpStatus::Solved : std::optional<QpStatus>{};
  }

  QpSettings<Scalar> settings_;
  Problem problem_;
  CertificateSearch<Scalar> certificates_;
  BestIterate<Scalar> best_;
  EntrywiseJudge<Scalar> entrywise_;
  EntrywiseErrors<Scalar> errors_;
  OuterProgress<Scalar> progress_;
  Vector D_, q_, old_x_, p_;
  Vector E_, old_y_, delta_, r2_;
  Scalar curvature_ = Scalar(0), mu_unit_ = Scalar(1), rho_unit_ = Scalar(0);
  Scalar gap_ = Scalar(0);  // the violation after the last outer step
  int extra_steps_ = 0;     // steps from points within the tolerances, but not in each entry
  // A ray is known: a feasible point, sought with g = 0, then proves that there is no minimum.
  bool ray_known_ = false;
  bool weighted_ = false, from_sides_ = false;
  bool soft_ = false;  // μ still falls after each step of a cold start
  bool limited_by_rounding_ = false, accurate_sums_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
