#pragma once

// One step of the proximal method of multipliers around (x_k, y_k): minimise over lb ≤ x ≤ ub
//
//   φ(x) = ½ xᵀHx + gᵀx + ρ/2 |x - x_k|² + 1/(2μ) dist²(Ax - μ y_k, [rl, ru])
//   y(x) = (Π(v) - v)/μ,  v = Ax - μ y_k         ∇φ = Hx + g + ρ (x - x_k) - Aᵀ y(x)
//
// φ is strictly convex, bounded below and finite for every x in the box, so its minimiser exists
// whatever the rows are. It is found by Newton steps on the free unknowns and violated rows, each
// with an exact search along the path that bends at the bounds; unknowns that meet a bound leave
// the free set, those with a wrong multiplier sign join it once the reduced gradient is small.

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "clothctl/linalg/columns.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/budget.hpp"
#include "clothctl/qp/detail/kkt_factor.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Data, iterate and factor of the proximal subproblem, in scaled space. Members are plain: the
/// method around it is the only user.
template <RealScalar Scalar>
class ProximalProblem {
 public:
  using Vector = VectorX<Scalar>;
  using ConstMap = Eigen::Map<const MatrixX<Scalar>>;
  using Map = Eigen::Map<MatrixX<Scalar>>;
  enum class State : signed char { Lower = -1, Free = 0, Upper = 1 };
  enum class Outcome { Minimised, RoundsSpent, TimeSpent, Concave, Broken };

  /// Makes room. Allocates.
  void reserve(Index n, Index m) {
    hessian_.assign(static_cast<std::size_t>(n * n), Scalar(0));
    rows_.assign(static_cast<std::size_t>(n * m), Scalar(0));
    columns_.assign(static_cast<std::size_t>(n * m), Scalar(0));
    set_zero<Scalar>({&g, &lo, &hi, &x, &xk, &hx, &grad, &p_, &w_, &limit_, &last_x_, &last_slope_},
                     n);
    set_zero<Scalar>(
        {&rl, &ru, &y, &yk, &ax, &moved_, &below_, &above_, &b_, &delta_, &zero_rows_, &last_y_},
        m);
    state.assign(static_cast<std::size_t>(n), State::Lower);
    active_.assign(static_cast<std::size_t>(m), 0);
    moving_.assign(static_cast<std::size_t>(n), 0);
    hits_.assign(static_cast<std::size_t>(n), 0);
    kinks_.assign(static_cast<std::size_t>(2 * m), {Scalar(0), Scalar(0)});
    factor.reserve(n, m);
    h_.reserve(n, n);
    a_.reserve(m, n);
    at_.reserve(n, m);
    n_ = m_ = 0;
  }
  /// Sets the problem's size, within what was reserved. H, A and Aᵀ are to be written then.
  void resize(Index n, Index m) {
    n_ = n;
    m_ = m;
    factor.reset();
    h_.view(hessian_.data(), n, n);
    a_.view(rows_.data(), m, n);
    at_.view(columns_.data(), n, m);
  }
  /// Writes Aᵀ from A.
  void refresh_transpose() {
    for (Index i = 0; i < m_; ++i) {
      for (Index j = 0; j < n_; ++j) At()(j, i) = A()(i, j);
    }
  }
  /// Takes the matrices where they are now: a copy of this has its own.
  void attach() {
    h_.attach(hessian_.data());
    a_.attach(rows_.data());
    at_.attach(columns_.data());
  }
  /// Makes use of zeros in H, A and Aᵀ; to be called again after they change.
  void index() {
    constexpr Index kSmall = 40;
    if (n_ + m_ < kSmall) return;
    h_.list(hessian_.data(), n_, n_);
    a_.list(rows_.data(), m_, n_);
    at_.list(columns_.data(), n_, m_);
    factor.choose(h_, a_, at_);
  }

  Index unknowns() const { return n_; }
  Index rows() const { return m_; }
  Map H() { return {hessian_.data(), n_, n_}; }
  Map A() { return {rows_.data(), m_, n_}; }
  Map At() { return {columns_.data(), n_, m_}; }
  ConstMap H() const { return {hessian_.data(), n_, n_}; }
  ConstMap A() const { return {rows_.data(), m_, n_}; }
  ConstMap At() const { return {columns_.data(), n_, m_}; }
  const Columns<Scalar>& columns_of_H() const { return h_; }
  const Columns<Scalar>& columns_of_A() const { return a_; }
  const Columns<Scalar>& columns_of_At() const { return at_; }

  /// hx = H x and ax = A x from scratch; the rows' moves are counted from here.
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

  /// out = H x + g - Aᵀ y for the present x, y.
  void reduced_gradient(Vector& out) const {
    for (Index j = 0; j < n_; ++j) out[j] = hx[j] + g[j];
    for (Index i = 0; i < m_; ++i) {
      if (y[i] < Scalar(0) || y[i] > Scalar(0)) at_.add(i, -y[i], out);
    }
  }

  /// hx, ax and out = H x + g - Aᵀ y as if summed in twice the precision (accurate_sum.hpp).
  void sharpen_products(Vector& out) {
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

  /// y(x) and ∇φ from hx and from how far the rows moved since `refresh_products`.
  void update_multipliers() {
    for (Index i = 0; i < m_; ++i) y[i] = multiplier(i);
    reduced_gradient(grad);
    for (Index j = 0; j < n_; ++j) grad[j] += rho * (x[j] - xk[j]);
  }

  /// Sign violation of the multiplier of an unknown at a bound, given its gradient; 0 where it
  /// holds.
  Scalar violation(Index i, const Vector& gradient) const {
    const State s = state[static_cast<std::size_t>(i)];
    if (s == State::Free || !(lo[i] < hi[i])) return Scalar(0);
    return (std::max)(Scalar(0), s == State::Lower ? Scalar(-gradient[i]) : gradient[i]);
  }

  /// Minimises φ from x until free gradient and sign violations are below `wanted`, or below their
  /// rounding. hx and ax must be fresh. Adds set changes to `iterations`. Returns Broken when no
  /// factor can be had: numbers are not finite, or lie beyond the range of the scalar.
  Outcome minimise(const Scalar& wanted, int& iterations, const Budget& budget) {
    using std::abs;
    if (!usable_weights()) return Outcome::Broken;
    update_multipliers();
    restart_progress();
    int stalls = 0;
    int settled = 0;
    int idle = 0;
    for (;;) {
      const Scalar tolerance = (std::max)(wanted, rounding());
      Scalar inside(0);
      Scalar outside(0);
      Index worst = -1;
      for (Index i = 0; i < n_; ++i) {
        if (state[static_cast<std::size_t>(i)] == State::Free)
          inside = (std::max)(inside, Scalar(abs(grad[i])));
        const Scalar v = violation(i, grad);
        if (v > outside) {
          outside = v;
          worst = i;
        }
      }
      const bool bottom = !(inside > tolerance) || settled > 2;
      if (bottom && !(outside > tolerance)) return Outcome::Minimised;
      stalls = progressed() ? 0 : stalls + 1;
      if (stalls > kStalls || idle > kIdle)
        return Outcome::Minimised;  // rounding rules: the outer loop judges
      if (outside > tolerance && (bottom || settled > 0 || inside < Scalar(0.1) * outside)) {
        const bool one = stalls > kStalls / 2;
        for (Index i = 0; i < n_; ++i) {
          if (one ? i == worst : violation(i, grad) > tolerance)
            state[static_cast<std::size_t>(i)] = State::Free;
        }
        settled = 0;
      }
      bool changed = false;
      for (int tries = 0; !sync(changed); ++tries) {
        if (tries == kTries) return Outcome::Broken;
        if (factor.free_failed()) {
          if (rho > Scalar(1e-2) * rho_ceiling) return Outcome::Concave;
          rho *= Scalar(16);
          factor.clear();
        } else {
          mu *= Scalar(16);
          factor.touch();
        }
        if (!usable_weights()) return Outcome::Broken;
        update_multipliers();
        restart_progress();
      }
      idle = changed ? 0 : idle + 1;
      if (changed) {
        const QpStatus spent = budget.after(++iterations);
        if (spent == QpStatus::TimeLimit) return Outcome::TimeSpent;
        if (spent != QpStatus::Solved) return Outcome::RoundsSpent;
      }
      std::fill_n(zero_rows_.data(), m_, Scalar(0));
      factor.solve(grad, zero_rows_, p_, delta_);
      settled = walk() ? settled + 1 : 0;
      update_multipliers();
    }
  }

  /// Brings the factor to the free unknowns and to the rows that `is_active` names, whatever x and
  /// y are.
  template <class IsActive>
  bool sync_rows(IsActive is_active) {
    for (Index i = 0; i < m_; ++i) active_[static_cast<std::size_t>(i)] = is_active(i) ? 1 : 0;
    bool changed = false;
    return sync_sets(changed);
  }

  /// Brings the factor to the present sets.
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
  static constexpr int kStalls = 8, kIdle = 60, kTries = 40;

  /// Updates the factor to the free unknowns in `state` and the rows in `active_`.
  bool sync_sets(bool& changed) {
    const auto is_active = [this](Index i) { return active_[static_cast<std::size_t>(i)] != 0; };
    const auto is_free = [this](Index i) {
      return state[static_cast<std::size_t>(i)] == State::Free;
    };
    const ProximalProblem& self = *this;
    return factor.sync(self.H(), self.At(), rho, mu, is_free, is_active, changed);
  }

  /// Takes the rows' edges from where x stands now: with small moves, y = (edge - A x)/μ is not
  /// drowned by the rounding of A x.
  void anchor() {
    for (Index i = 0; i < m_; ++i) {
      below_[i] = has_bound(rl[i]) ? Scalar(rl[i] - ax[i]) : rl[i];
      above_[i] = has_bound(ru[i]) ? Scalar(ru[i] - ax[i]) : ru[i];
      moved_[i] = Scalar(0);
    }
  }

  /// Ax - μ y_k, from the anchor.
  Scalar position(Index i) const { return moved_[i] - mu * yk[i]; }

  Scalar multiplier(Index i) const {
    const Scalar v = position(i);
    return v < below_[i] ? (below_[i] - v) / mu : v > above_[i] ? (above_[i] - v) / mu : Scalar(0);
  }

  /// What rounding leaves in the multipliers.
  Scalar rounding() const {
    using std::abs;
    Scalar farthest(0);
    for (Index i = 0; i < m_; ++i) farthest = (std::max)(farthest, Scalar(abs(moved_[i])));
    return Scalar(8) * scalar_traits<Scalar>::epsilon() * farthest / mu;
  }

  bool usable_weights() const {
    return is_finite(rho) && is_finite(mu) && rho > Scalar(0) && mu > Scalar(0);
  }

  /// Gradient of φ without its row part.
  Scalar smooth_slope(Index j) const { return hx[j] + g[j] + rho * (x[j] - xk[j]); }

  /// Forgets what `progressed` compares with.
  void restart_progress() { fresh_ = true; }

  /// Returns true when φ is lower than ever since the restart. Changes of φ are summed, so that a
  /// large constant hides nothing: the smooth part changes by ½ (s + s')ᵀ(x - x'), the row part by
  /// μ/2 (y
  /// + y')ᵀ(y - y').
  bool progressed() {
    using std::abs;
    Scalar change(0);
    Scalar size(0);
    for (Index j = 0; j < n_; ++j) {
      const Scalar slope = smooth_slope(j);
      const Scalar term = Scalar(0.5) * (slope + last_slope_[j]) * (x[j] - last_x_[j]);
      change += term;
      size += (abs(hx[j]) + abs(g[j])) * abs(x[j] - last_x_[j]);
      last_slope_[j] = slope;
      last_x_[j] = x[j];
    }
    for (Index i = 0; i < m_; ++i) {
      const Scalar term = Scalar(0.5) * mu * (y[i] + last_y_[i]) * (y[i] - last_y_[i]);
      change += term;
      if (term < Scalar(0) || term > Scalar(0)) size += abs(y[i] + last_y_[i]) * abs(moved_[i]);
      last_y_[i] = y[i];
    }
    if (fresh_) {
      fresh_ = false;
      total_ = least_ = Scalar(0);
      return true;
    }
    total_ += change;
    if (!(total_ < least_ - scalar_traits<Scalar>::epsilon() * size)) return false;
    least_ = total_;
    return true;
  }

  /// First minimum of φ(x + t p) on 0 ≤ t ≤ end, given φ'(0) < 0 and the curvature without rows;
  /// `end` when there is none.
  Scalar minimum_along(const Scalar& slope, const Scalar& curvature, const Scalar& end) {
    Index kinks = 0;
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
        if (!(t > Scalar(0)) && inwards) return;  // on the edge, moving in: was not counted
        kinks_[static_cast<std::size_t>(kinks++)] = {t, inwards ? Scalar(-stiffness) : stiffness};
      };
      kink(below_[i], b > Scalar(0));
      kink(above_[i], b < Scalar(0));
    }
    std::sort(kinks_.begin(), kinks_.begin() + kinks,
              [](const Kink& a, const Kink& c) { return a.first < c.first; });
    Scalar t(0);
    Scalar s = slope;
    for (Index k = 0; k < kinks; ++k) {
      const Kink& kink = kinks_[static_cast<std::size_t>(k)];
      const Scalar next = s + bend * (kink.first - t);
      if (!(next < Scalar(0))) break;
      s = next;
      t = kink.first;
      bend += kink.second;
    }
    if (!(bend > Scalar(0))) return end;
    return (std::min)(end, Scalar(t - s / bend));
  }

  /// Walks along the bent path of the Newton direction. Returns true when it was one whole step
  /// within the present sets.
  bool walk() {
    const Scalar big = no_bound<Scalar>();
    const Index count = factor.free_size();
    std::fill_n(w_.data(), n_, Scalar(0));
    std::fill_n(b_.data(), m_, Scalar(0));
    Index hits = 0;
    bool whole = true;
    for (Index k = 0; k < count; ++k) {
      const Index i = factor.unknown(k);
      moving_[static_cast<std::size_t>(k)] = i;
      if (!(p_[i] < Scalar(0)) && !(p_[i] > Scalar(0))) continue;
      h_.add(i, p_[i], w_);
      a_.add(i, p_[i], b_);
      const Scalar edge = p_[i] < Scalar(0) ? lo[i] : hi[i];
      if (!has_bound(edge)) continue;
      limit_[i] = (std::max)(Scalar(0), Scalar((edge - x[i]) / p_[i]));
      if (limit_[i] < Scalar(1)) whole = false;
      hits_[static_cast<std::size_t>(hits++)] = i;
    }
    for (Index i = 0; whole && i < m_; ++i) {
      if (!(rl[i] < ru[i])) continue;
      const Scalar v = position(i);
      const Scalar ahead = v + b_[i];
      if ((v < below_[i]) != (ahead < below_[i]) || (v > above_[i]) != (ahead > above_[i]))
        whole = false;
    }
    if (whole) {
      advance(Scalar(1), count);
      stay_inside(count);
      return true;
    }
    std::sort(hits_.begin(), hits_.begin() + hits, [this](Index a, Index c) {
      return limit_[a] < limit_[c] || (!(limit_[c] < limit_[a]) && a < c);
    });
    Scalar t(0);
    for (Index hit = 0;; ++hit) {
      Scalar slope(0);
      Scalar curvature(0);
      for (Index k = 0; k < count; ++k) {
        const Index i = moving_[static_cast<std::size_t>(k)];
        slope += smooth_slope(i) * p_[i];
        curvature += (w_[i] + rho * p_[i]) * p_[i];
      }
      for (Index i = 0; i < m_; ++i) slope -= multiplier(i) * b_[i];
      if (!(slope < Scalar(0))) break;
      const Index next = hit < hits ? hits_[static_cast<std::size_t>(hit)] : Index(-1);
      const Scalar end = next >= 0 ? Scalar(limit_[next] - t) : big;
      const Scalar step = minimum_along(slope, curvature, end);
      if (!(step < big)) break;
      advance(step, count);
      t += step;
      if (step < end) break;
      const bool down = p_[next] < Scalar(0);
      x[next] = down ? lo[next] : hi[next];
      state[static_cast<std::size_t>(next)] = down ? State::Lower : State::Upper;
      h_.add(next, -p_[next], w_);
      a_.add(next, -p_[next], b_);
      p_[next] = Scalar(0);
    }
    stay_inside(count);
    return false;
  }

  void advance(const Scalar& step, Index count) {
    for (Index k = 0; k < count; ++k) {
      const Index i = moving_[static_cast<std::size_t>(k)];
      x[i] += step * p_[i];
    }
    add_scaled(n_, step, w_.data(), hx.data());
    add_scaled(m_, step, b_.data(), moved_.data());
  }

  /// Rounding must not leave the box.
  void stay_inside(Index count) {
    for (Index k = 0; k < count; ++k) {
      const Index i = moving_[static_cast<std::size_t>(k)];
      x[i] = (std::min)((std::max)(x[i], lo[i]), hi[i]);
    }
  }

  using Kink = std::pair<Scalar, Scalar>;
  std::vector<Scalar> hessian_, rows_, columns_;
  Columns<Scalar> h_, a_, at_;
  Vector p_, w_, limit_, b_, moved_, below_, above_, delta_, zero_rows_, last_x_, last_slope_,
      last_y_;
  Scalar total_ = Scalar(0), least_ = Scalar(0);
  std::vector<Index> moving_, hits_;
  std::vector<char> active_;  // rows that the factor should hold
  std::vector<Kink> kinks_;
  Index n_ = 0, m_ = 0;
  bool fresh_ = true;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
