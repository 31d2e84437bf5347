#pragma once

// A primal active-set method for bound-constrained QP that factors only the free unknowns F:
//
//   min ½ xᵀHx + gᵀx,  lb ≤ x ≤ ub        q = Hx + g,   z_i = q_i at an active bound
//
//   1. Newton step on the free set:  p_F = -H_FF⁻¹ q_F.
//   2. Line search along x + t p. An unknown that meets its bound stops there and the others go on,
//      up to the first minimum along the bent path. Unknowns that met a bound leave F. Go to 1.
//   3. When no bound was met, x is the minimiser on F. Free the unknowns whose multiplier has the
//      wrong sign: all at once, or one at a time when the objective no longer falls. When there is
//      no such unknown, x is optimal.
//
// The method is finite. Step 2 only shrinks F. Between two visits of step 3 the objective falls
// strictly: q_F = 0 there, and removing an unknown whose step points out of its bound only makes
// the descent steeper. A freed unknown that makes H_FF singular (zero pivot) gives a direction d
// with H d = 0 and qᵀd < 0 (zero_curvature_direction.hpp). The method moves along d until a bound
// stops it; when no bound blocks d, the problem is unbounded. The curvature class stores H,
// multiplies with it and factors H_FF (dense_curvature.hpp, special/low_rank_curvature.hpp).
//
// When a minimiser on a given active set is cheap, a primal-dual active-set method
// (special/primal_dual_active_set.hpp) runs first and provides the start, which in most cases is
// already optimal. This minimiser is always cheap with a low-rank Hessian. With a dense Hessian it
// is cheap when few bounds are active and the Hessian has been used before
// (special/active_bounds.hpp). Reference: primal active sets, Nocedal and Wright (2006) §16.5;
// projected Newton, Bertsekas, SIAM J. Control Optim. 20 (1982).

#include <algorithm>
#include <vector>

#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/bound_breakpoints.hpp"
#include "clothctl/qp/detail/box_warm_start.hpp"
#include "clothctl/qp/detail/budget.hpp"
#include "clothctl/qp/detail/cached_product.hpp"
#include "clothctl/qp/detail/descent_monitor.hpp"
#include "clothctl/qp/detail/factor_update.hpp"
#include "clothctl/qp/detail/zero_curvature_direction.hpp"
#include "clothctl/qp/detail/zero_gradient.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The method on loaded data: infinite bounds are ±no_bound, and every entry is finite. Keeps
/// iterate and active set between solves.
template <RealScalar Scalar, class Curvature>
class BoxMethod {
 public:
  using Vector = VectorX<Scalar>;

  /// Gradient g and bounds of a solve, n entries each; they must outlive this object.
  struct Data {
    const Vector& g;
    const Vector& lo;
    const Vector& hi;
  };

  /// Makes room for n unknowns. The caller must reserve `curvature()` too. Allocates.
  void reserve(Index n) {
    set_zero<Scalar>({&x_, &q_, &p_, &work_}, n);
    breaks_.reserve(n);
    zero_.reserve(n);
    descent_.reserve(n);
    product_.reserve(n);
    flat_.reserve(n);
    guess_.reserve(n);
    state_.assign(static_cast<std::size_t>(n), kLower);
    list_.assign(static_cast<std::size_t>(n), 0);
    moving_.assign(static_cast<std::size_t>(n), 0);
    n_ = 0;
    reset();
  }

  /// The Hessian. After a change call `renew`.
  Curvature& curvature() { return curvature_; }

  /// Prepares for a new Hessian in `curvature()`. The active set stays when n is unchanged.
  void renew() {
    if (curvature_.unknowns() != n_) reset();
    n_ = curvature_.unknowns();
    curvature_.clear();
    guess_.forget(curvature_);
    product_.forget();
    zero_.set_diagonal(n_, [this](Index j) { return curvature_.diagonal(j); });
  }

  /// The iterate, n entries in use.
  const Vector& x() const { return x_; }
  /// H x + g of the last refresh, n entries in use.
  const Vector& gradient() const { return q_; }
  /// An upper bound on Σ_k |H_jk x_k| for every j, at the x of the last refresh.
  const Scalar& largest_terms() const { return zero_.largest_terms(); }
  /// The direction of the last DualInfeasible, n entries in use.
  const Vector& ray() const { return flat_.ray(); }

  /// Who checks the optimality of a converged guess of the primal-dual method: this method or its
  /// caller.
  enum class Check { Method, Caller };

  /// Solves. Returns Solved (by its own tests), IterationLimit, TimeLimit, NonConvex or
  /// DualInfeasible. Adds the rounds that change the active set to `iterations`. With Check::Caller
  /// a converged guess is Solved without a test, and `gradient()` is then out of date. Never
  /// allocates.
  QpStatus solve(const Data& data, const Scalar& stationarity_tolerance, const Budget& budget,
                 int& iterations, Check criterion = Check::Method) {
    data_ = &data;
    stationarity_tolerance_ = stationarity_tolerance;
    const bool warm = start_ != Start::Cold;
    take_start();
    const QpStatus status =
        warm && is_solved_already() ? QpStatus::Solved : run(warm, criterion, budget, iterations);
    guess_.end_solve(curvature_, warm, status == QpStatus::Solved, n_ - free_count());
    data_ = nullptr;
    return status;
  }

  /// Number of unknowns that are free.
  Index free_count() const {
    return static_cast<Index>(std::count(state_.begin(), state_.begin() + n_, kFree));
  }

  /// Computes `gradient()` = H x + g. Reuses H x only if it was computed from scratch for this very
  /// x.
  void refresh(const Data& data) {
    data_ = &data;
    refresh_gradient();
    data_ = nullptr;
  }

  /// Takes one Newton step on the free unknowns from `gradient`, which the caller has computed more
  /// accurately. `gradient()` is out of date afterwards.
  void correct(const Data& data, const Vector& gradient) {
    sync_factor();
    curvature_.newton(gradient, p_);
    for (Index k = 0; k < curvature_.size(); ++k) {
      const Index i = curvature_.order(k);
      x_[i] = std::clamp(Scalar(x_[i] + p_[i]), data.lo[i], data.hi[i]);
    }
  }

  /// Replaces an iterate that is not finite: x goes to the point of the box nearest to zero, and
  /// the next solve is cold. Returns true when it replaced x.
  bool replace_nonfinite(const Data& data) {
    if (all_finite(x_.head(n_))) return false;
    for (Index i = 0; i < n_; ++i) x_[i] = std::clamp(Scalar(0), data.lo[i], data.hi[i]);
    curvature_.clear();
    product_.forget();
    reset();
    return true;
  }

  /// Makes the next solve start from x (n): unknowns at a bound are active, those strictly inside
  /// are free.
  void warm_start(const Eigen::Ref<const Vector>& x) {
    std::copy_n(x.data(), n_, x_.data());
    start_ = Start::FromX;
  }

  /// Makes the next solve start from an active set: side_of(i) of unknown i. Unknowns between their
  /// bounds keep their x.
  template <class SideOf>
  void warm_start_sides(SideOf side_of) {
    if (start_ == Start::Cold) std::fill_n(x_.data(), n_, Scalar(0));
    for (Index i = 0; i < n_; ++i) state(i) = static_cast<State>(side_of(i));
    start_ = Start::Warm;
  }

  /// Receding horizon: unknown i takes the value and active-set status of unknown i + unknowns; the
  /// last `unknowns` unknowns keep theirs.
  void shift(Index unknowns) {
    if (unknowns <= 0) return;
    for (Index i = 0; i + unknowns < n_; ++i) {
      x_[i] = x_[i + unknowns];
      state(i) = state(i + unknowns);
    }
  }

  /// Forgets the active set: the next solve is cold.
  void reset() { start_ = Start::Cold; }

 private:
  using State = signed char;
  static constexpr State kLower = -1, kFree = 0, kUpper = 1,
                         kParked = 2;  // parked: inside, but dependent on the free set
  enum class Start { Cold, FromX, Warm };
  enum class Walk { Full, Clipped, Unbounded, Concave, Ray };

  State& state(Index i) { return state_[static_cast<std::size_t>(i)]; }
  Index list(Index k) const { return list_[static_cast<std::size_t>(k)]; }
  Index moving(Index k) const { return moving_[static_cast<std::size_t>(k)]; }
  const Vector& g() const { return data_->g; }
  const Vector& lo() const { return data_->lo; }
  const Vector& hi() const { return data_->hi; }

  /// Sets x within its bounds and the first guess of the active set.
  void take_start() {
    for (Index i = 0; i < n_; ++i) {
      if (start_ == Start::Cold) x_[i] = Scalar(0);
      const bool fixed = !(lo()[i] < hi()[i]);
      if (start_ == Start::Warm && !fixed) {
        if (state(i) == kLower && has_bound(lo()[i])) x_[i] = lo()[i];
        if (state(i) == kUpper && has_bound(hi()[i])) x_[i] = hi()[i];
      }
      x_[i] = std::clamp(x_[i], lo()[i], hi()[i]);
      if (start_ == Start::Warm && !fixed && state(i) == kFree) continue;
      place_by_x(i);
      if (state(i) == kParked) state(i) = kFree;
    }
    start_ = Start::Warm;
  }

  /// Returns true when the iterate already solves the problem, as it does when nothing has changed.
  bool is_solved_already() {
    if (!product_.is_of(x_, n_)) return false;
    refresh_gradient();
    return good_guess();
  }

  /// Searches for a guess, then runs the free-set method from there. The search may use half of the
  /// budget. A guess that the budget cut short is used only if its objective is lower than that of
  /// x.
  QpStatus run(bool warm, Check criterion, const Budget& budget, int& iterations) {
    const auto side_of = [this](Index i) {
      return static_cast<QpSide>(state(i) == kParked ? kFree : state(i));
    };
    const Budget share = budget.half(iterations);
    bool guessed = guess_.find(curvature_, warm, n_ - free_count(), g(), lo(), hi(), side_of,
                               relative_zero(), share, iterations);
    if (!guessed) return iterate(false, budget, iterations);
    const PrimalDualActiveSet<Scalar>& found = guess_.rounds();
    const bool cut_short = !found.ended() && share.after(iterations) != QpStatus::Solved;
    if (cut_short) guessed = objective(found.x()) < objective(x_);
    if (guessed) {
      std::copy_n(found.x().data(), n_, x_.data());
      for (Index i = 0; i < n_; ++i) {
        state(i) = found.side(i) == QpSide::Between || lo()[i] < hi()[i]
                       ? static_cast<State>(found.side(i))
                       : kLower;
      }
    }
    const QpStatus spent = cut_short ? budget.after(iterations) : QpStatus::Solved;
    if (spent != QpStatus::Solved && !guessed) guess_.skip_next();
    if (spent != QpStatus::Solved || (found.ended() && criterion == Check::Caller)) return spent;
    return iterate(guessed, budget, iterations);
  }

  Scalar objective(const Vector& x) {
    std::fill_n(work_.data(), n_, Scalar(0));
    curvature_.add_product(x, work_);
    Scalar sum(0);
    for (Index i = 0; i < n_; ++i) sum += (Scalar(0.5) * work_[i] + g()[i]) * x[i];
    return sum;
  }

  void refine_guess() {
    if (!guess_.refine(curvature_, q_, p_)) return;
    for (Index i = 0; i < n_; ++i) x_[i] = std::clamp(Scalar(x_[i] + p_[i]), lo()[i], hi()[i]);
    refresh_gradient();
  }

  /// Sets the state of an unknown that is not in the factor from x_i: at a bound, or parked between
  /// the bounds.
  void place_by_x(Index i) {
    state(i) = !(x_[i] > lo()[i]) ? kLower : !(x_[i] < hi()[i]) ? kUpper : kParked;
  }

  /// q = g + H x. Reuses H x only if it was computed from scratch for this very x.
  void refresh_gradient() { take_gradient(product_.refresh(curvature_, x_)); }

  Scalar relative_zero() const {
    return (std::max)(Scalar(ZeroGradient<Scalar>::kRounding) * scalar_traits<Scalar>::epsilon(),
                      Scalar(stationarity_tolerance_ / Scalar(64)));
  }

  void take_gradient(const Vector& product) {
    for (Index i = 0; i < n_; ++i) q_[i] = g()[i] + product[i];
    zero_.update(n_, g(), x_, product, relative_zero());
  }

  /// Updates the factor to the free unknowns. Returns the number of unknowns added. Unknowns that
  /// would make H_FF singular stay out.
  Index sync_factor() {
    const Index fresh = update_factor_to(
        curvature_, n_, [this](Index i) { return state(i) == kFree; }, list_, moving_);
    if (fresh == 0) return 0;
    if constexpr (Curvature::kDefinite) return fresh;
    Index taken = 0;
    for (Index k = 0; k < fresh; ++k) {
      if (curvature_.place(list(k)) >= 0) ++taken;
    }
    for (Index i = 0; i < n_; ++i) {
      if (state(i) == kFree && curvature_.place(i) < 0) place_by_x(i);
    }
    return taken;
  }

  /// Takes one Newton step of the free set along the bent path.
  Walk newton_step() {
    const Index f = curvature_.size();
    bool still = true;
    for (Index k = 0; k < f; ++k) {
      const Index i = curvature_.order(k);
      moving_[static_cast<std::size_t>(k)] = i;
      still = still && !(q_[i] < Scalar(0)) && !(q_[i] > Scalar(0));
    }
    if (still) return Walk::Full;
    curvature_.newton(q_, p_);
    return walk(f, true);
  }

  /// Moves the `count` unknowns in moving_ along p, up to the first minimum. An unknown that meets
  /// its bound stays there while the others go on. `newton`: p is a Newton step.
  Walk walk(Index count, bool newton) {
    using std::sqrt;
    const Scalar rounding = Scalar(4) * static_cast<Scalar>(n_) * scalar_traits<Scalar>::epsilon();
    breaks_.find(moving_, count, x_, p_, lo(), hi());
    curvature_.start_walk(moving_, count, p_, q_);
    if (newton && !breaks_.any_before(Scalar(1))) {
      curvature_.advance(Scalar(1), q_);
      curvature_.end_walk(moving_, count, p_, q_);
      go_on(Scalar(1), count);
      stay_inside(count);
      return Walk::Full;
    }
    breaks_.sort();
    Scalar t(0);
    for (;;) {
      Scalar slope, curvature, size;
      curvature_.line(moving_, count, p_, q_, slope, curvature, size);
      if (!(slope < Scalar(0))) break;
      if (!newton && curvature < -sqrt(scalar_traits<Scalar>::epsilon()) * size)
        return Walk::Concave;
      const bool curved = curvature > (newton ? Scalar(0) : rounding * size);
      const Scalar rest = curved ? -slope / curvature : Scalar(0);
      const bool stops_first = !breaks_.done() && !(curved && t + rest < breaks_.length());
      if (!stops_first && !curved) return Walk::Unbounded;
      const Scalar step = stops_first ? breaks_.length() - t : rest;
      go_on(step, count);
      curvature_.advance(step, q_);
      t += step;
      if (!stops_first) break;
      const Index i = breaks_.take();
      const bool down = p_[i] < Scalar(0);
      x_[i] = down ? lo()[i] : hi()[i];
      state(i) = down ? kLower : kUpper;
      curvature_.stop(i, p_, q_);
      p_[i] = Scalar(0);
    }
    curvature_.end_walk(moving_, count, p_, q_);
    stay_inside(count);
    return Walk::Clipped;
  }

  void go_on(const Scalar& step, Index count) {
    for (Index k = 0; k < count; ++k) x_[moving(k)] += step * p_[moving(k)];
  }

  /// Puts x back within its bounds after rounding errors.
  void stay_inside(Index count) {
    for (Index k = 0; k < count; ++k) {
      const Index i = moving(k);
      x_[i] = std::clamp(x_[i], lo()[i], hi()[i]);
    }
  }

  /// Returns by how much q_i has the wrong sign for the bound that unknown i is at, or |q_i| when
  /// it is between its bounds; divided by √H_ii. Returns 0 when the sign is right, and for a free
  /// unknown.
  Scalar violation(Index i) {
    using std::abs;
    if (state(i) == kFree || !(lo()[i] < hi()[i])) return Scalar(0);
    const Scalar q = state(i) == kLower ? -q_[i] : state(i) == kUpper ? q_[i] : Scalar(abs(q_[i]));
    return q > zero_[i] ? q * zero_.scale(i) : Scalar(0);
  }

  /// Frees unknowns whose multiplier has the wrong sign: all, or only the one with the largest
  /// violation. Returns that one, or -1 when there is none.
  Index release(bool one) {
    Index worst = -1;
    Scalar most(0);
    for (Index i = 0; i < n_; ++i) {
      const Scalar v = violation(i);
      if (v > most) {
        most = v;
        worst = i;
      }
    }
    if (worst < 0) return worst;
    for (Index i = 0; i < n_; ++i) {
      if (one ? i == worst : violation(i) > Scalar(0)) state(i) = kFree;
    }
    return worst;
  }

  /// Moves along the direction of zero curvature that unknown i has when it would make H_FF
  /// singular.
  Walk flat_step(Index i) {
    const Index count = flat_.open(curvature_, i, Scalar(q_[i] > Scalar(0) ? -1 : 1), moving_, p_);
    if (flat_.is_ray(curvature_, moving_, count, p_, g(), lo(), hi())) return Walk::Ray;
    const Walk outcome = walk(count, false);
    if (x_[i] > lo()[i] && x_[i] < hi()[i]) state(i) = kFree;
    return outcome;
  }

  /// Returns true when an unknown of the factor has met its bound.
  bool met_bound() {
    for (Index k = 0; k < curvature_.size(); ++k) {
      if (state(curvature_.order(k)) != kFree) return true;
    }
    return false;
  }

  /// Returns true when the objective is lower than at all earlier calls of this run.
  bool progressed() {
    using std::abs;
    descent_.add_quadratic(
        n_, x_, [this](Index i) { return q_[i]; },
        [this](Index i) { return Scalar(abs(g()[i]) + abs(q_[i] - g()[i])); });
    return descent_.is_lowest();
  }

  /// Returns true when each |q_i| of a free unknown is at most `times` its threshold zero_[i], and
  /// q has the right sign at the other unknowns.
  bool optimal(const Scalar& times = Scalar(1)) {
    using std::abs;
    for (Index i = 0; i < n_; ++i) {
      if (state(i) == kFree && !(abs(q_[i]) <= times * zero_[i])) return false;
      if (violation(i) > Scalar(0)) return false;
    }
    return true;
  }

  /// Returns true when a guess needs no more work: its stationarity error is within an eighth of
  /// the tolerance.
  bool good_guess() {
    return optimal(
        (std::max)(Scalar(1), Scalar(stationarity_tolerance_ / (Scalar(8) * relative_zero()))));
  }

  QpStatus iterate(bool guessed, const Budget& budget, int& iterations) {
    take_gradient(product_.update(curvature_, x_));
    if (guessed && good_guess()) return QpStatus::Solved;
    if (guessed && guess_.rounds().ended()) refine_guess();
    if (optimal()) {  // rounding errors of an updated H x grow with the distance moved
      refresh_gradient();
      if (optimal()) return QpStatus::Solved;
    }
    int stalls = 0;
    int polishes = 0;
    bool stuck = false;
    descent_.restart();
    for (;;) {
      sync_factor();
      if (newton_step() == Walk::Clipped) {
        if (const QpStatus spent = budget.after(++iterations); spent != QpStatus::Solved)
          return spent;
        continue;
      }
      stalls = progressed() ? 0 : stalls + 1;
      const Index worst = stuck || stalls > 2 * kStalls ? Index(-1) : release(stalls > kStalls);
      if (worst < 0) {
        refresh_gradient();
        if (optimal() || ++polishes > kPolishes) return QpStatus::Solved;
        if (polishes > 1) curvature_.clear();
        continue;
      }
      if (const QpStatus spent = budget.after(++iterations); spent != QpStatus::Solved)
        return spent;
      if (sync_factor() > 0) continue;
      if constexpr (!Curvature::kDefinite) {
        const Walk outcome = flat_step(worst);
        if (outcome == Walk::Concave) return QpStatus::NonConvex;
        if (outcome == Walk::Ray) return QpStatus::DualInfeasible;
        if (outcome != Walk::Unbounded) continue;
        if (met_bound()) continue;  // go on with the unknowns that are still free
      }
      stuck = true;  // rounding hides any further descent; the residuals decide
    }
  }

  static constexpr int kStalls = 3, kPolishes = 4;

  Curvature curvature_;
  ZeroCurvatureDirection<Scalar> flat_;
  BoxWarmStart<Scalar, Curvature> guess_;
  ZeroGradient<Scalar> zero_;
  DescentMonitor<Scalar> descent_;
  BoundBreakpoints<Scalar> breaks_;
  Vector x_, q_, p_, work_;
  CachedProduct<Scalar> product_;
  std::vector<State> state_;
  std::vector<Index> list_, moving_;
  const Data* data_ = nullptr;
  Scalar stationarity_tolerance_ = Scalar(0);
  Index n_ = 0;
  Start start_ = Start::Cold;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
