#pragma once

// Bound-constrained QP by a primal active set that factors only the free unknowns F:
//
//   min ½ xᵀHx + gᵀx,  lb ≤ x ≤ ub        q = Hx + g,   z_i = q_i at an active bound
//
//   1. Newton on the free set:  p_F = -H_FF⁻¹ q_F.
//   2. Path search: walk x + t p; where an unknown meets its bound it stays there and the walk goes on with the rest, up to
//      the first minimum along the bent path. Unknowns that met a bound leave F; back to 1.
//   3. When no bound was met x minimises over F: free every unknown whose multiplier has the wrong sign (in blocks; one at a
//      time once the objective stops falling). None left: optimal.
//
// Finite: step 2 only shrinks F, and between two visits of step 3 the objective falls strictly, since q_F = 0 there and
// dropping an unknown that points outward only steepens the descent. A freed unknown that depends on F (zero pivot) gives
// a direction d with H d = 0 and qᵀd < 0: walk along it to the first bound; if there is none the problem is unbounded.
// Cost per round O(f² + n f); factor updates O(f²) an unknown, or f³/3 in tiles when many change.
// Reference: primal active sets, Nocedal and Wright (2006) §16.5; projected Newton, Bertsekas, SIAM J. Control Optim. 20
// (1982).

#include <algorithm>
#include <vector>

#include "clothctl/qp/certificate.hpp"
#include "clothctl/qp/free_set_factor.hpp"
#include "clothctl/qp/kkt.hpp"
#include "clothctl/qp/problem_data.hpp"
#include "clothctl/qp/verdict.hpp"

namespace clothctl {

/// Solves bound-constrained convex QPs, warm from its last active set. Best where few unknowns are free.
template <RealScalar Scalar>
class BoxActiveSet {
 public:
  /// The number type.
  using scalar_type = Scalar;
  /// What `solve` fills.
  using result_type = QpResult<Scalar>;
  /// A read-only view of a vector.
  using VectorView = Eigen::Ref<const VectorX<Scalar>>;

  /// Takes settings. Solves answer InvalidData when `settings.check()` is not empty.
  explicit BoxActiveSet(QpSettings<Scalar> settings = {}) : settings_(settings), good_settings_(settings.check().empty()) {}

  /// Makes room for up to n unknowns and forgets the Hessian; afterwards nothing here allocates for up to n unknowns
  /// (results size themselves at their first solve). Allocates.
  void reserve(Index n) {
    data_.reserve(n, 0);
    factor_.reserve(n);
    for (VectorX<Scalar>* v : {&x_, &q_, &p_, &w_, &scale_, &zeros_, &limit_, &last_x_, &last_q_}) v->setZero(n);
    state_.assign(static_cast<std::size_t>(n), kLower);
    list_.assign(static_cast<std::size_t>(n), 0);
    moving_.assign(static_cast<std::size_t>(n), 0);
    n_ = 0;
    reset();
  }

  /// Takes H (n×n, symmetric, positive semidefinite) and keeps a copy. The active set is kept while n stays. Allocates
  /// only when n exceeds the reserved size. Fails when: an entry is not finite or not symmetric (InvalidData), a diagonal entry
  /// is negative or h_ij² > h_ii h_jj (NonConvex); `refusal()` says where, and the solver stays as it was. Complexity: O(n²).
  [[nodiscard]] QpStatus set_hessian(const Eigen::Ref<const MatrixX<Scalar>>& H) {
    if (data_.judge(H) != QpStatus::Solved) return data_.refusal().status;
    if (H.rows() > data_.capacity_n()) reserve(H.rows());
    factor_.clear();
    if (data_.take(H)) reset();
    n_ = data_.n();
    using std::sqrt;
    for (Index j = 0; j < n_; ++j) scale_[j] = H(j, j) > Scalar(0) ? Scalar(1) / sqrt(H(j, j)) : Scalar(1);
    return QpStatus::Solved;
  }

  /// What the last call of `set_hessian` refused.
  const QpRefusal& refusal() const { return data_.refusal(); }

  /// Solves for gradient g and bounds lb, ub (n each), warm from the last active set. Never allocates once `result` has
  /// seen this size. Fails when: sizes differ, g or a bound is NaN, or lb > ub (InvalidData; nothing is changed).
  [[nodiscard]] QpStatus solve(const VectorView& g, const VectorView& lb, const VectorView& ub, result_type& result) {
    const VectorX<Scalar> none;
    if (!data_.load(good_settings_, g, lb, ub, none, none, result)) return result.status;
    take_start();
    result.status = iterate(result);
    report(lb, ub, result);
    return result.status;
  }

  /// Makes the next solve start from x (n): unknowns at a bound are active, those strictly inside are free. Answers false, and
  /// changes nothing, when x has another size or an entry that is not finite.
  [[nodiscard]] bool warm_start(const VectorView& x) {
    if (n_ == 0 || x.size() != n_ || !all_finite(x)) return false;
    x_.head(n_) = x;
    start_ = Start::FromX;
    return true;
  }

  /// Receding horizon: unknown i takes value and active-set status of unknown i + unknowns; the tail repeats the last block.
  void shift(Index unknowns) {
    if (unknowns <= 0) return;
    for (Index i = 0; i + unknowns < n_; ++i) {
      x_[i] = x_[i + unknowns];
      state(i) = state(i + unknowns);
    }
  }

  /// Forgets the active set: the next solve is cold.
  void reset() { start_ = Start::Cold; }

  /// Number of free unknowns after the last solve.
  Index free_count() const { return factor_.size(); }

 private:
  using State = signed char;
  static constexpr State kLower = -1, kFree = 0, kUpper = 1, kParked = 2;  // parked: inside, but dependent on the free set
  enum class Start { Cold, FromX, Warm };
  enum class Walk { Full, Clipped, Unbounded, Concave };

  State& state(Index i) { return state_[static_cast<std::size_t>(i)]; }
  Index list(Index k) const { return list_[static_cast<std::size_t>(k)]; }
  Eigen::Map<const MatrixX<Scalar>> H() const { return data_.H(); }
  const VectorX<Scalar>& g() const { return data_.g(); }
  const VectorX<Scalar>& lo() const { return data_.lo(); }
  const VectorX<Scalar>& hi() const { return data_.hi(); }
  static Scalar pivot_tolerance() {
    using std::sqrt;
    const Scalar half = sqrt(scalar_traits<Scalar>::epsilon());
    return half * sqrt(sqrt(half));
  }

  /// Sets x within its bounds and the first guess of the active set.
  void take_start() {
    for (Index i = 0; i < n_; ++i) {
      if (start_ == Start::Cold) x_[i] = Scalar(0);
      const bool fixed = !(lo()[i] < hi()[i]);
      if (start_ == Start::Warm && !fixed) {
        if (state(i) == kLower && detail::has_bound(lo()[i])) x_[i] = lo()[i];
        if (state(i) == kUpper && detail::has_bound(hi()[i])) x_[i] = hi()[i];
      }
      if (x_[i] < lo()[i]) x_[i] = lo()[i];
      if (x_[i] > hi()[i]) x_[i] = hi()[i];
      if (start_ == Start::Warm && !fixed && state(i) == kFree) continue;
      place_by_x(i);
      if (state(i) == kParked) state(i) = kFree;
    }
    start_ = Start::Warm;
  }

  /// Status of an unknown that is not in the factor, from where it stands.
  void place_by_x(Index i) { state(i) = !(x_[i] > lo()[i]) ? kLower : !(x_[i] < hi()[i]) ? kUpper : kParked; }

  /// q = g + H x, from scratch.
  void refresh_gradient() {
    q_.head(n_) = g().head(n_);
    for (Index j = 0; j < n_; ++j) {
      if (x_[j] < Scalar(0) || x_[j] > Scalar(0)) q_.head(n_) += x_[j] * H().col(j);
    }
    using std::abs;
    gradient_scale_ = Scalar(1);
    for (Index j = 0; j < n_; ++j) {
      gradient_scale_ = std::max(gradient_scale_, std::max(Scalar(abs(g()[j])), Scalar(abs(q_[j] - g()[j]))));
    }
  }

  /// What counts as zero in a multiplier or reduced gradient.
  Scalar dual_tolerance() const {
    const Scalar floor = Scalar(32) * scalar_traits<Scalar>::epsilon();
    const Scalar wanted = settings_.stationarity_tolerance / Scalar(64);
    return gradient_scale_ * std::max(floor, wanted);
  }

  /// Brings the factor in line with the free states. Returns how many unknowns it took in; the dependent ones stay out.
  Index sync_factor() {
    Index gone = 0;
    Index fresh = 0;
    for (Index i = 0; i < n_; ++i) {
      const bool in = factor_.place(i) >= 0;
      if (state(i) == kFree && !in) list_[static_cast<std::size_t>(fresh++)] = i;
      if (state(i) != kFree && in) ++gone;
    }
    if (gone == 0 && fresh == 0) return 0;
    const Index kept = factor_.size() - gone;
    if (gone + fresh > kFewChanges && kUpdateCost * (gone + fresh) > kept) {
      Index count = 0;
      for (Index k = 0; k < factor_.size(); ++k) {
        if (state(factor_.order(k)) == kFree) moving_[static_cast<std::size_t>(count++)] = factor_.order(k);
      }
      for (Index k = 0; k < fresh; ++k) moving_[static_cast<std::size_t>(count++)] = list(k);
      factor_.rebuild(H(), moving_, count, Scalar(0), pivot_tolerance());
    } else {
      for (Index k = factor_.size(); k-- > 0;) {
        if (state(factor_.order(k)) != kFree) factor_.remove(k);
      }
      for (Index k = 0; k < fresh; ++k) factor_.append(H(), list(k), Scalar(0), pivot_tolerance());
    }
    Index taken = 0;
    for (Index k = 0; k < fresh; ++k) {
      if (factor_.place(list(k)) >= 0) ++taken;
    }
    for (Index i = 0; i < n_; ++i) {
      if (state(i) == kFree && factor_.place(i) < 0) place_by_x(i);
    }
    return taken;
  }

  /// One Newton step over the free set along the bent path.
  Walk newton_step() {
    using std::abs;
    const Index f = factor_.size();
    Scalar largest(0);
    for (Index k = 0; k < f; ++k) {
      w_[k] = -q_[factor_.order(k)];
      largest = std::max(largest, Scalar(abs(w_[k])));
    }
    if (!(largest > Scalar(0))) return Walk::Full;
    factor_.solve_lower(w_);
    factor_.solve_upper(w_);
    for (Index k = 0; k < f; ++k) {
      moving_[static_cast<std::size_t>(k)] = factor_.order(k);
      p_[factor_.order(k)] = w_[k];
    }
    return walk(f, true);
  }

  /// Walks along p over the `count` unknowns in moving_, whose bounds bend the path.
  Walk walk(Index count, bool newton) {
    using std::sqrt;
    const Scalar rounding = Scalar(4) * static_cast<Scalar>(n_) * scalar_traits<Scalar>::epsilon();
    w_.head(n_).setConstant(Scalar(0));
    const auto moving = [this](Index k) { return moving_[static_cast<std::size_t>(k)]; };
    Index hits = 0;
    bool clipped = false;
    for (Index k = 0; k < count; ++k) {
      const Index i = moving(k);
      w_.head(n_) += p_[i] * H().col(i);
      const Scalar edge = p_[i] < Scalar(0) ? lo()[i] : hi()[i];
      if (!detail::has_bound(edge) || (!(p_[i] < Scalar(0)) && !(p_[i] > Scalar(0)))) continue;
      limit_[i] = std::max(Scalar(0), Scalar((edge - x_[i]) / p_[i]));
      if (newton && limit_[i] < Scalar(1)) clipped = true;
      list_[static_cast<std::size_t>(hits++)] = i;
    }
    if (newton && !clipped) {
      for (Index k = 0; k < count; ++k) {
        const Index i = moving(k);
        x_[i] = std::min(std::max(Scalar(x_[i] + p_[i]), lo()[i]), hi()[i]);
      }
      q_.head(n_) += w_.head(n_);
      return Walk::Full;
    }
    std::sort(list_.begin(), list_.begin() + hits,
              [this](Index a, Index b) { return limit_[a] < limit_[b] || (!(limit_[b] < limit_[a]) && a < b); });
    Scalar t(0);
    Index hit = 0;
    for (;;) {
      Scalar slope(0);
      Scalar curvature(0);
      Scalar size(0);
      for (Index k = 0; k < count; ++k) {
        const Index i = moving(k);
        slope += q_[i] * p_[i];
        curvature += w_[i] * p_[i];
        size += H()(i, i) * p_[i] * p_[i];
      }
      if (!(slope < Scalar(0))) break;
      if (!newton && curvature < -sqrt(scalar_traits<Scalar>::epsilon()) * size) return Walk::Concave;
      const bool curved = curvature > (newton ? Scalar(0) : rounding * size);
      const Scalar rest = curved ? -slope / curvature : Scalar(0);
      const bool stops_first = hit < hits && !(curved && t + rest < limit_[list(hit)]);
      if (!stops_first && !curved) return Walk::Unbounded;
      const Scalar step = stops_first ? limit_[list(hit)] - t : rest;
      for (Index k = 0; k < count; ++k) x_[moving(k)] += step * p_[moving(k)];
      q_.head(n_) += step * w_.head(n_);
      t += step;
      if (!stops_first) break;
      const Index i = list(hit++);
      const bool down = p_[i] < Scalar(0);
      x_[i] = down ? lo()[i] : hi()[i];
      state(i) = down ? kLower : kUpper;
      w_.head(n_) -= p_[i] * H().col(i);
      p_[i] = Scalar(0);
    }
    for (Index k = 0; k < count; ++k) {  // rounding must not leave the box
      const Index i = moving(k);
      x_[i] = std::min(std::max(x_[i], lo()[i]), hi()[i]);
    }
    return Walk::Clipped;
  }

  /// Violation of the sign condition on q_i, scaled by curvature; 0 where it holds.
  Scalar violation(Index i, const Scalar& tolerance) {
    using std::abs;
    if (state(i) == kFree || !(lo()[i] < hi()[i])) return Scalar(0);
    const Scalar q = state(i) == kLower ? -q_[i] : state(i) == kUpper ? q_[i] : Scalar(abs(q_[i]));
    return q > tolerance ? q * scale_[i] : Scalar(0);
  }

  /// Frees unknowns whose multiplier has the wrong sign: all, or only the worst. Returns the worst one, or -1.
  Index release(bool one) {
    const Scalar tolerance = dual_tolerance();
    Index worst = -1;
    Scalar most(0);
    for (Index i = 0; i < n_; ++i) {
      const Scalar v = violation(i, tolerance);
      if (v > most) {
        most = v;
        worst = i;
      }
    }
    if (worst < 0) return worst;
    for (Index i = 0; i < n_; ++i) {
      if (one ? i == worst : violation(i, tolerance) > Scalar(0)) state(i) = kFree;
    }
    return worst;
  }

  /// Follows the flat direction that unknown i opens when it depends on the free set.
  Walk flat_step(Index i) {
    const Index f = factor_.size();
    factor_.append(H(), i, Scalar(0), Scalar(2));  // always refused: leaves L⁻¹ H_Fi behind
    const Scalar sign = q_[i] > Scalar(0) ? Scalar(-1) : Scalar(1);
    w_.head(f) = factor_.column().head(f);
    factor_.solve_upper(w_);
    for (Index k = 0; k < f; ++k) {
      moving_[static_cast<std::size_t>(k)] = factor_.order(k);
      p_[factor_.order(k)] = -sign * w_[k];
    }
    moving_[static_cast<std::size_t>(f)] = i;
    p_[i] = sign;
    const Walk outcome = walk(f + 1, false);
    if (outcome != Walk::Unbounded) {
      if (x_[i] > lo()[i] && x_[i] < hi()[i]) state(i) = kFree;
    }
    return outcome;
  }

  /// Tells whether the direction p over moving_[0 … count-1] is flat in every row of H, to the rounding of the product, and
  /// falls; if so hands it to the result. The part in the factor is refined towards H p = 0.
  bool verify_ray(Index count, result_type& result) {
    using std::abs;
    bool bent = false;  // an unknown of the factor met its bound: no refinement
    for (Index k = 0; k < factor_.size(); ++k) bent = bent || state(factor_.order(k)) != kFree;
    constexpr int kSteps = 3;
    for (int step = 0; step < kSteps; ++step) {
      last_x_.head(n_).setConstant(Scalar(0));
      last_q_.head(n_).setConstant(Scalar(0));
      limit_.head(n_).setConstant(Scalar(0));
      for (Index k = 0; k < count; ++k) {
        const Index i = moving_[static_cast<std::size_t>(k)];
        last_x_[i] = p_[i];
        last_q_.head(n_) += p_[i] * H().col(i);
        limit_.head(n_) += abs(p_[i]) * H().col(i).cwiseAbs();
      }
      const VectorX<Scalar>& none = result.row_multipliers;
      const detail::ProofCheck<Scalar> check =
          detail::check_ray<Scalar>(last_x_.head(n_), last_q_.head(n_), none, limit_.head(n_), none, g().head(n_), none, none,
                                    lo().head(n_), hi().head(n_));
      if (check.proven) {
        result.ray = last_x_.head(n_);
        return true;
      }
      if (!check.promising || bent) return false;
      for (Index k = 0; k < factor_.size(); ++k) w_[k] = last_q_[factor_.order(k)];
      factor_.solve_lower(w_);
      factor_.solve_upper(w_);
      for (Index k = 0; k < factor_.size(); ++k) p_[factor_.order(k)] -= w_[k];
    }
    return false;
  }

  /// Tells whether the objective is lower than ever since the start. Its changes ½ (q + q')ᵀ(x - x') are summed, so that a
  /// large constant hides nothing.
  bool progressed() {
    using std::abs;
    Scalar change(0);
    Scalar size(0);
    for (Index i = 0; i < n_; ++i) {
      const Scalar step = x_[i] - last_x_[i];
      change += Scalar(0.5) * (q_[i] + last_q_[i]) * step;
      size += (abs(g()[i]) + abs(q_[i] - g()[i])) * abs(step);
    }
    last_x_.head(n_) = x_.head(n_);
    last_q_.head(n_) = q_.head(n_);
    total_ += change;
    if (!(total_ < least_ - scalar_traits<Scalar>::epsilon() * size)) return false;
    least_ = total_;
    return true;
  }

  QpStatus iterate(result_type& result) {
    using std::abs;
    const int limit = settings_.max_iterations > 0 ? settings_.max_iterations : 10 * static_cast<int>(n_) + 10;
    refresh_gradient();
    int stalls = 0;
    int polishes = 0;
    bool first = true;
    bool stuck = false;
    for (;;) {
      sync_factor();
      if (newton_step() == Walk::Clipped) {
        if (++result.iterations >= limit) return QpStatus::IterationLimit;
        continue;
      }
      if (first) {
        last_x_.head(n_) = x_.head(n_);
        last_q_.head(n_) = q_.head(n_);
        total_ = least_ = Scalar(0);
        first = false;
      } else {
        stalls = progressed() ? 0 : stalls + 1;
      }
      const Index worst = stuck || stalls > 2 * kStalls ? Index(-1) : release(stalls > kStalls);
      if (worst < 0) {
        refresh_gradient();
        const Scalar tolerance = dual_tolerance();
        Scalar rest(0);
        bool wrong = false;
        for (Index i = 0; i < n_; ++i) {
          if (state(i) == kFree) rest = std::max(rest, Scalar(abs(q_[i])));
          if (violation(i, tolerance) > Scalar(0)) wrong = true;
        }
        if ((!(rest > tolerance) && !wrong) || ++polishes > kPolishes) return QpStatus::Solved;
        if (polishes > 1) factor_.clear();
        continue;
      }
      if (++result.iterations >= limit) return QpStatus::IterationLimit;
      if (sync_factor() > 0) continue;
      const Walk outcome = flat_step(worst);
      if (outcome == Walk::Concave) return QpStatus::NonConvex;
      if (outcome != Walk::Unbounded) continue;
      if (verify_ray(factor_.size() + 1, result)) return QpStatus::DualInfeasible;
      stuck = first = true;  // no further way down that rounding does not hide: the residuals will tell
    }
  }

  /// Fills the result from x and a fresh gradient, and lets the definition have the last word on "Solved".
  void report(const VectorView& lb, const VectorView& ub, result_type& result) {
    if (!all_finite(x_.head(n_))) {
      x_.head(n_).setConstant(Scalar(0));
      for (Index i = 0; i < n_; ++i) x_[i] = std::min(std::max(Scalar(0), lo()[i]), hi()[i]);
      result.status = QpStatus::IterationLimit;
      factor_.clear();
      reset();
    }
    refresh_gradient();
    result.x = x_.head(n_);
    const Scalar zero(0);
    for (Index i = 0; i < n_; ++i) {
      Scalar z(0);
      if (!(lo()[i] < hi()[i])) {
        z = q_[i];
      } else if (!(x_[i] > lo()[i])) {
        z = std::max(zero, q_[i]);
      } else if (!(x_[i] < hi()[i])) {
        z = std::min(zero, q_[i]);
      }
      result.bound_multipliers[i] = z;
    }
    w_.head(n_) = q_.head(n_) - g().head(n_);
    const VectorX<Scalar>& none = result.row_multipliers;
    const KktResiduals<Scalar> r = detail::kkt_from_products<Scalar>(w_.head(n_), none, zeros_.head(n_), g().head(n_), none,
                                                                     none, lb, ub, result.x, none, result.bound_multipliers);
    detail::settle(r, settings_, result);
    if (result.status != QpStatus::DualInfeasible) result.ray.setConstant(zero);
  }

  static constexpr Index kFewChanges = 4, kUpdateCost = 6;
  static constexpr int kStalls = 3;
  static constexpr int kPolishes = 4;

  QpSettings<Scalar> settings_;
  detail::ProblemData<Scalar> data_;
  detail::FreeSetFactor<Scalar> factor_;
  VectorX<Scalar> x_, q_, p_, w_, scale_, zeros_, limit_, last_x_, last_q_;
  std::vector<State> state_;
  std::vector<Index> list_, moving_;
  Scalar gradient_scale_ = Scalar(1), total_ = Scalar(0), least_ = Scalar(0);
  Index n_ = 0;
  Start start_ = Start::Cold;
  bool good_settings_ = true;
};

}  // namespace clothctl
