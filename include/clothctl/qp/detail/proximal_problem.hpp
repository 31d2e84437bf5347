#pragma once

// One step of the proximal method of multipliers around (x_k, y_k): minimise over lb ≤ x ≤ ub
//
//   φ(x) = ½ xᵀHx + gᵀx + ρ/2 |x - x_k|² + 1/(2μ) dist²(Ax - μ y_k, [rl, ru])
//   y(x) = (Π(v) - v)/μ,  v = Ax - μ y_k         ∇φ = Hx + g + ρ (x - x_k) - Aᵀ y(x)
//
// Π projects onto [rl, ru]. φ is strictly convex, bounded below and finite for every x in the box,
// so it has a minimiser even if the rows contradict each other. The minimiser is found by Newton
// steps on the free unknowns and the violated rows. Each step has an exact line search along a path
// that bends at the bounds: an unknown that meets its bound stops there and leaves the free set.
// When the gradient on the free set is small, unknowns at a bound whose multiplier has the wrong
// sign become free.

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "clothctl/linalg/accurate_sum.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/bound_breakpoints.hpp"
#include "clothctl/qp/detail/budget.hpp"
#include "clothctl/qp/detail/descent_monitor.hpp"
#include "clothctl/qp/detail/kkt_factor.hpp"
#include "clothctl/qp/detail/piecewise_quadratic.hpp"
#include "clothctl/qp/detail/proximal_matrices.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Bounds, iterate and factor of the proximal subproblem, in scaled space, on top of its matrices.
/// Members are public because the class is internal to the proximal method and its parts.
template <RealScalar Scalar>
class ProximalProblem : public ProximalMatrices<Scalar> {
 public:
  using Vector = VectorX<Scalar>;
  enum class State : signed char { Lower = -1, Free = 0, Upper = 1 };
  enum class Outcome { Minimised, IterationLimit, TimeLimit, NonConvex, NumericalError };

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    Matrices::reserve(n, m);
    set_zero<Scalar>({&g, &lo, &hi, &x, &xk, &hx, &grad, &p_, &w_}, n);
    breaks_.reserve(n);
    set_zero<Scalar>(
        {&rl, &ru, &y, &yk, &ax, &moved_, &below_, &above_, &b_, &delta_, &zero_rows_, &last_y_},
        m);
    state.assign(static_cast<std::size_t>(n), State::Lower);
    active_.assign(static_cast<std::size_t>(m), 0);
    moving_.assign(static_cast<std::size_t>(n), 0);
    along_.reserve(2 * m);
    descent_.reserve(n);
    factor.reserve(n, m);
  }
  /// Sets the size of the problem, at most the reserved one. The caller must then write H, A and
  /// Aᵀ.
  void resize(Index n, Index m) {
    factor.reset();
    Matrices::resize(n, m);
  }
  /// Lists the nonzeros of H, A and Aᵀ, unless the problem is small. Call it after each change.
  void index() {
    if (Matrices::list()) factor.choose(h_, a_, at_);
  }

  /// Returns Σ_k √h_kk |x_k|. Times √h_jj it bounds the sum of the terms of (H x)_j.
  Scalar length_of_x() const {
    using std::abs;
    Scalar length(0);
    for (Index k = 0; k < n_; ++k) length += this->root_of_diagonal(k) * abs(x[k]);
    return length;
  }

  /// Returns true when a row is an inequality, and the equalities are fewer than the unknowns: they
  /// cannot determine x alone.
  bool inequalities_count() const {
    Index equalities = 0;
    for (Index i = 0; i < m_; ++i) equalities += rl[i] < ru[i] ? 0 : 1;
    return equalities < m_ && equalities < n_;
  }

  /// Computes hx = H x and ax = A x from scratch, and makes this A x the reference of later row
  /// moves (`anchor`).
  void refresh_products() {
    std::fill_n(hx.data(), n_, Scalar(0));
    std::fill_n(ax.data(), m_, Scalar(0));
    for (Index j = 0; j < n_; ++j) {
      if (!(x[j] < Scalar(0)) && !(x[j] > Scalar(0))) continue;
      h_.add(j, x[j], hx);
      a_.add(j, x[j], ax);
    }
    anchor();
  }

  /// Computes out = H x + g - Aᵀ y from hx and y.
  void reduced_gradient(Vector& out) const {
    for (Index j = 0; j < n_; ++j) out[j] = hx[j] + g[j];
    for (Index i = 0; i < m_; ++i) {
      if (y[i] < Scalar(0) || y[i] > Scalar(0)) at_.add(i, -y[i], out);
    }
  }

  /// Computes hx, ax and out = H x + g - Aᵀ y as if in twice the precision (accurate_sum.hpp).
  void accurate_products(Vector& out) {
    for (Index j = 0; j < n_; ++j) {
      AccurateSum<Scalar> sum, rows;
      h_.add_dot(j, x, sum);
      hx[j] = sum.value();
      sum.add(g[j]);
      a_.add_dot(j, y, rows);
      sum.subtract(rows);
      out[j] = sum.value();
    }
    for (Index i = 0; i < m_; ++i) {
      AccurateSum<Scalar> sum;
      at_.add_dot(i, x, sum);
      ax[i] = sum.value();
    }
  }

  /// Computes y(x) and ∇φ from hx and from the change of A x since `refresh_products`.
  void update_multipliers() {
    for (Index i = 0; i < m_; ++i) y[i] = multiplier(i);
    reduced_gradient(grad);
    for (Index j = 0; j < n_; ++j) grad[j] += rho * (x[j] - xk[j]);
  }

  /// Returns by how much the multiplier of an unknown at a bound has the wrong sign, given the
  /// gradient; 0 if the sign is right or the unknown is free or fixed.
  Scalar violation(Index i, const Vector& gradient) const {
    const State s = state[static_cast<std::size_t>(i)];
    if (s == State::Free || !(lo[i] < hi[i])) return Scalar(0);
    return (std::max)(Scalar(0), s == State::Lower ? Scalar(-gradient[i]) : gradient[i]);
  }

  /// Minimises φ from x until the gradient on the free set and all sign violations are below
  /// `wanted`, or below their rounding errors. hx and ax must be up to date. Adds the number of set
  /// changes to `iterations`. Returns NumericalError when no factor exists because numbers are not
  /// finite or are out of the range of the scalar.
  Outcome minimise(const Scalar& wanted, int& iterations, const Budget& budget) {
    if (!usable_weights()) return Outcome::NumericalError;
    update_multipliers();
    descent_.restart();
    int stalls = 0;
    int settled = 0;
    int idle = 0;
    for (;;) {
      const Scalar tolerance = (std::max)(wanted, rounding());
      const GradientSize size = measure_gradient();
      const bool bottom = !(size.free > tolerance) || settled > 2;
      if (bottom && !(size.violation > tolerance)) return Outcome::Minimised;
      stalls = progressed() ? 0 : stalls + 1;
      // Rounding errors prevent progress. The outer loop checks the residuals.
      if (stalls > kStalls || idle > kIdle) return Outcome::Minimised;
      if (size.violation > tolerance &&
          (bottom || settled > 0 || size.free < Scalar(0.1) * size.violation)) {
        if (stalls > kStalls / 2) {
          state[static_cast<std::size_t>(size.worst)] = State::Free;
        } else {
          release_bounds(tolerance);
        }
        settled = 0;
      }
      bool changed = false;
      if (const std::optional<Outcome> failure = factorise(changed)) return *failure;
      idle = changed ? 0 : idle + 1;
      if (changed) ++iterations;
      if (changed || idle > 1) {
        const QpStatus spent = budget.after(iterations);
        if (spent == QpStatus::TimeLimit) return Outcome::TimeLimit;
        if (spent != QpStatus::Solved && changed) return Outcome::IterationLimit;
      }
      std::fill_n(zero_rows_.data(), m_, Scalar(0));
      factor.solve(grad, zero_rows_, p_, delta_);
      settled = walk() ? settled + 1 : 0;
      update_multipliers();
    }
  }

  /// Updates the factor to the free unknowns and to the rows for which `is_active` is true. Does
  /// not read x or y.
  template <class IsActive>
  bool sync_rows(IsActive is_active) {
    for (Index i = 0; i < m_; ++i) active_[static_cast<std::size_t>(i)] = is_active(i) ? 1 : 0;
    bool changed = false;
    return sync_sets(changed);
  }

  /// Updates the factor to the free unknowns and to the equality and violated rows.
  bool sync(bool& changed) {
    for (Index i = 0; i < m_; ++i) {
      const Scalar v = position(i);
      const bool active = !(rl[i] < ru[i]) || v < below_[i] || v > above_[i];
      active_[static_cast<std::size_t>(i)] = active ? 1 : 0;
    }
    return sync_sets(changed);
  }

  Vector g, lo, hi, x, xk, hx, grad;
  Vector rl, ru, y, yk, ax;
  std::vector<State> state;
  KktFactor<Scalar> factor;
  Scalar rho = Scalar(0), mu = Scalar(1), rho_ceiling = Scalar(1);

 private:
  using Matrices = ProximalMatrices<Scalar>;
  using Matrices::a_;
  using Matrices::at_;
  using Matrices::h_;
  using Matrices::m_;
  using Matrices::n_;
  static constexpr int kStalls = 8, kIdle = 60, kTries = 40;

  /// Infinity norms of ∇φ on the free unknowns, and of the sign violations.
  struct GradientSize {
    Scalar free = Scalar(0), violation = Scalar(0);
    /// The unknown of the largest sign violation, or -1.
    Index worst = -1;
  };

  GradientSize measure_gradient() const {
    using std::abs;
    GradientSize size;
    for (Index i = 0; i < n_; ++i) {
      if (state[static_cast<std::size_t>(i)] == State::Free)
        size.free = (std::max)(size.free, Scalar(abs(grad[i])));
      const Scalar v = violation(i, grad);
      if (v > size.violation) {
        size.violation = v;
        size.worst = i;
      }
    }
    return size;
  }

  /// Frees the unknowns at bounds whose sign violation exceeds the tolerance.
  void release_bounds(const Scalar& tolerance) {
    for (Index i = 0; i < n_; ++i) {
      if (violation(i, grad) > tolerance) state[static_cast<std::size_t>(i)] = State::Free;
    }
  }

  /// Updates the factor to the current sets. When a pivot fails, increases ρ or μ and tries again.
  /// Returns nothing on success, else the outcome of `minimise`.
  std::optional<Outcome> factorise(bool& changed) {
    for (int tries = 0; !sync(changed); ++tries) {
      if (tries == kTries) return Outcome::NumericalError;
      if (factor.free_failed()) {
        if (rho > Scalar(1e-2) * rho_ceiling) return Outcome::NonConvex;
        rho *= Scalar(16);
        factor.clear();
      } else {
        mu *= Scalar(16);
        factor.touch();
      }
      if (!usable_weights()) return Outcome::NumericalError;
      update_multipliers();
      descent_.restart();
    }
    return std::nullopt;
  }

  /// Updates the factor to the free unknowns in `state` and the rows in `active_`.
  bool sync_sets(bool& changed) {
    const auto is_active = [this](Index i) { return active_[static_cast<std::size_t>(i)] != 0; };
    const auto is_free = [this](Index i) {
      return state[static_cast<std::size_t>(i)] == State::Free;
    };
    const ProximalProblem& self = *this;
    return factor.sync(self.H(), self.At(), rho, mu, is_free, is_active, changed);
  }

  /// Stores the row bounds relative to the current A x, as the reference of moved_. Later changes
  /// of A x are small, so that the rounding error of A x does not dominate y = (bound - A x)/μ.
  void anchor() {
    for (Index i = 0; i < m_; ++i) {
      below_[i] = has_bound(rl[i]) ? Scalar(rl[i] - ax[i]) : rl[i];
      above_[i] = has_bound(ru[i]) ? Scalar(ru[i] - ax[i]) : ru[i];
      moved_[i] = Scalar(0);
    }
  }

  /// Returns A x - μ y_k, relative to A x at the last `anchor`.
  Scalar position(Index i) const { return moved_[i] - mu * yk[i]; }

  /// Returns y(x) of row i.
  Scalar multiplier(Index i) const {
    const Scalar v = position(i);
    return v < below_[i] ? (below_[i] - v) / mu : v > above_[i] ? (above_[i] - v) / mu : Scalar(0);
  }

  /// Returns an estimate of the rounding error of the multipliers.
  Scalar rounding() const {
    using std::abs;
    Scalar farthest(0);
    for (Index i = 0; i < m_; ++i) farthest = (std::max)(farthest, Scalar(abs(moved_[i])));
    return Scalar(8) * scalar_traits<Scalar>::epsilon() * farthest / mu;
  }

  /// Returns true when ρ and μ are finite and positive.
  bool usable_weights() const {
    return is_finite(rho) && is_finite(mu) && rho > Scalar(0) && mu > Scalar(0);
  }

  /// Returns the gradient of φ without the term of the rows.
  Scalar smooth_slope(Index j) const { return hx[j] + g[j] + rho * (x[j] - xk[j]); }

  /// Returns true when φ is lower than at all earlier calls since the restart of `descent_`. The
  /// row part changes by μ/2 (y + y')ᵀ(y - y'), where y' is y at the previous call.
  bool progressed() {
    using std::abs;
    descent_.add_quadratic(
        n_, x, [this](Index j) { return smooth_slope(j); },
        [this](Index j) { return Scalar(abs(hx[j]) + abs(g[j])); });
    for (Index i = 0; i < m_; ++i) {
      const Scalar term = Scalar(0.5) * mu * (y[i] + last_y_[i]) * (y[i] - last_y_[i]);
      const bool moves = term < Scalar(0) || term > Scalar(0);
      descent_.add_term(term, moves ? Scalar(abs(y[i] + last_y_[i]) * abs(moved_[i])) : Scalar(0));
      last_y_[i] = y[i];
    }
    return descent_.is_lowest();
  }

  /// Returns the first minimiser of φ(x + t p) on 0 ≤ t ≤ end, given the slope < 0 of φ at t = 0
  /// and the curvature of φ without the row term. Returns `end` when φ decreases on all of [0,
  /// end].
  Scalar minimum_along(const Scalar& slope, const Scalar& curvature, const Scalar& end) {
    along_.clear();
    Scalar bend = curvature;
    for (Index i = 0; i < m_; ++i) {
      const Scalar b = b_[i];
      if (!(b < Scalar(0)) && !(b > Scalar(0))) continue;
      const Scalar stiffness = b * b / mu;
      const Scalar v = position(i);
      const bool equality = !(rl[i] < ru[i]);
      if (equality || v < below_[i] || v > above_[i]) bend += stiffness;
      if (equality) continue;
      const auto kink = [&](const Scalar& edge, bool inwards) {
        if (!has_bound(edge)) return;
        const Scalar t = (edge - v) / b;
        if (t < Scalar(0) || !(t < end)) return;
        if (!(t > Scalar(0)) && inwards) return;  // on the bound and moving in: not violated
        along_.add(t, inwards ? Scalar(-stiffness) : stiffness);
      };
      kink(below_[i], b > Scalar(0));
      kink(above_[i], b < Scalar(0));
    }
    return along_.minimiser(slope, bend, end);
  }

  /// Moves x along the Newton direction, on a path that bends at the bounds. Returns true when x
  /// moved by the whole step and no set changed.
  bool walk() {
    const Index count = factor.free_size();
    start_walk(count);
    const bool whole = !breaks_.any_before(Scalar(1)) && keeps_row_sides();
    if (whole) {
      advance(Scalar(1), count);
    } else {
      search_bent_path(count);
    }
    stay_inside(count);
    return whole;
  }

  /// Computes w = H p and b = A p, and finds where the moving unknowns meet their bounds.
  void start_walk(Index count) {
    std::fill_n(w_.data(), n_, Scalar(0));
    std::fill_n(b_.data(), m_, Scalar(0));
    for (Index k = 0; k < count; ++k) {
      const Index i = factor.unknown(k);
      moving_[static_cast<std::size_t>(k)] = i;
      if (!(p_[i] < Scalar(0)) && !(p_[i] > Scalar(0))) continue;
      h_.add(i, p_[i], w_);
      a_.add(i, p_[i], b_);
    }
    breaks_.find(moving_, count, x, p_, lo, hi);
  }

  /// Returns true when the whole step crosses no bound of an inequality row.
  bool keeps_row_sides() const {
    for (Index i = 0; i < m_; ++i) {
      if (!(rl[i] < ru[i])) continue;
      const Scalar v = position(i);
      const Scalar ahead = v + b_[i];
      if ((v < below_[i]) != (ahead < below_[i]) || (v > above_[i]) != (ahead > above_[i]))
        return false;
    }
    return true;
  }

  /// Moves x to the first minimum of φ along the bent path. The path is straight from one bound to
  /// the next; an unknown stops at the bound that it meets.
  void search_bent_path(Index count) {
    breaks_.sort();
    const Scalar big = no_bound<Scalar>();
    Scalar t(0);
    for (;;) {
      Scalar slope(0);
      Scalar curvature(0);
      for (Index k = 0; k < count; ++k) {
        const Index i = moving_[static_cast<std::size_t>(k)];
        slope += smooth_slope(i) * p_[i];
        curvature += (w_[i] + rho * p_[i]) * p_[i];
      }
      for (Index i = 0; i < m_; ++i) slope -= multiplier(i) * b_[i];
      if (!(slope < Scalar(0))) return;
      const Scalar end = breaks_.done() ? big : Scalar(breaks_.length() - t);
      const Scalar step = minimum_along(slope, curvature, end);
      if (!(step < big)) return;
      advance(step, count);
      t += step;
      if (step < end) return;
      stop_at_bound(breaks_.take());
    }
  }

  /// Sets an unknown to the bound that it moves towards, and removes it from the direction.
  void stop_at_bound(Index i) {
    const bool down = p_[i] < Scalar(0);
    x[i] = down ? lo[i] : hi[i];
    state[static_cast<std::size_t>(i)] = down ? State::Lower : State::Upper;
    h_.add(i, -p_[i], w_);
    a_.add(i, -p_[i], b_);
    p_[i] = Scalar(0);
  }

  /// Moves x by `step` along the direction, and updates hx and moved_.
  void advance(const Scalar& step, Index count) {
    for (Index k = 0; k < count; ++k) {
      const Index i = moving_[static_cast<std::size_t>(k)];
      x[i] += step * p_[i];
    }
    add_scaled(n_, step, w_.data(), hx.data());
    add_scaled(m_, step, b_.data(), moved_.data());
  }

  /// Puts x back within its bounds after rounding errors.
  void stay_inside(Index count) {
    for (Index k = 0; k < count; ++k) {
      const Index i = moving_[static_cast<std::size_t>(k)];
      x[i] = std::clamp(x[i], lo[i], hi[i]);
    }
  }

  Vector p_, w_, b_, moved_, below_, above_, delta_, zero_rows_, last_y_;
  DescentMonitor<Scalar> descent_;
  PiecewiseQuadratic<Scalar> along_;
  std::vector<Index> moving_;
  BoundBreakpoints<Scalar> breaks_;
  std::vector<char> active_;  // 1 for each row that belongs in the factor
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
