#pragma once

// Turns the differences of proximal iterates into proofs that a problem has no solution:
//
//   y_{k+1} - y_k  ->  Farkas pair:  refined towards Aᵀy = 0 on the free unknowns
//   x_{k+1} - x_k  ->  ray:          refined towards H d = 0 and A d = 0 on the active rows
//
// with the factor of the regularised problem, until what is left is the rounding of the sums themselves. Anything larger is not
// believed: a problem whose only solutions lie far out, or that is nearly flat, has no proof. Scaling is by powers of two, so a
// relative test here is the same test on the caller's numbers.

#include <algorithm>
#include <cmath>

#include "clothctl/qp/certificate.hpp"
#include "clothctl/qp/proximal_problem.hpp"

namespace clothctl::detail {

/// What was learnt about a direction.
enum class RayVerdict {
  /// It is no ray.
  None,
  /// It leaves no bound and is so flat that the proximal term governs the step: the minimum may lie far along it.
  FarMinimum,
  /// It proves that the problem is unbounded (if it is feasible).
  Proven
};

/// Searches for proofs around the iterate of a proximal problem. All memory comes from `reserve`.
template <RealScalar Scalar>
class ProofSearch {
 public:
  using Vector = VectorX<Scalar>;
  using Problem = ProximalProblem<Scalar>;

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    for (Vector* v : {&d_, &hd_, &hd_size_, &residual_, &p_, &z_, &z_size_}) v->setZero(n);
    for (Vector* v : {&y_, &ad_, &ad_size_, &eta_, &r2_, &delta_}) v->setZero(m);
  }

  /// The row part y of a proof of infeasibility (scaled space, first m entries).
  const Vector& farkas_rows() const { return y_; }
  /// The bound part z of a proof of infeasibility (first n entries).
  const Vector& farkas_bounds() const { return z_; }
  /// The ray, or the direction of a far minimum (first n entries).
  const Vector& direction() const { return d_; }

  /// Tells whether y - yk proves infeasibility. Never allocates.
  bool infeasible(Problem& problem) {
    using std::abs;
    const Index n = problem.unknowns();
    const Index m = problem.rows();
    Scalar largest(0);
    for (Index i = 0; i < m; ++i) largest = (std::max)(largest, Scalar(abs(problem.y[i] - problem.yk[i])));
    if (!(largest > Scalar(0)) || !is_finite(largest)) return false;
    Scalar reach(1);
    for (Index j = 0; j < n; ++j) reach = (std::max)(reach, Scalar(abs(problem.x[j])));
    for (Index i = 0; i < m; ++i) y_[i] = (problem.yk[i] - problem.y[i]) / largest;
    r2_.head(m).setConstant(Scalar(0));
    Scalar last = scalar_traits<Scalar>::infinity();
    for (int step = 0; step < kSteps; ++step) {
      z_.head(n).setConstant(Scalar(0));
      z_size_.head(n).setConstant(Scalar(0));
      for (Index i = 0; i < m; ++i) {
        const Scalar v = y_[i];
        if (!has_bound(v > Scalar(0) ? problem.ru[i] : problem.rl[i]) && abs(v) < certificate_tolerance<Scalar>()) {
          y_[i] = Scalar(0);
        }
        if (!(y_[i] < Scalar(0)) && !(y_[i] > Scalar(0))) continue;
        problem.columns_of_At().add(i, -v, z_);
        problem.columns_of_At().add_size(i, v, z_size_);
      }
      residual_.head(n) = z_.head(n);
      const ProofCheck<Scalar> check =
          check_farkas<Scalar>(y_.head(m), z_.head(n), z_size_.head(n), problem.rl.head(m), problem.ru.head(m),
                               problem.lo.head(n), problem.hi.head(n), Scalar(16) * reach);
      if (check.proven) return true;
      if (step > 1 && (!check.promising || !worth_a_step(check.error, last))) return false;
      last = check.error;
      bool changed = false;
      if (step == 0 && !problem.sync(changed)) return false;
      problem.factor.solve(residual_, r2_, p_, delta_);
      for (Index k = 0; k < problem.factor.row_size(); ++k) y_[problem.factor.row(k)] += delta_[problem.factor.row(k)];
    }
    return false;
  }

  /// Judges x - xk as a ray. Never allocates.
  RayVerdict unbounded(Problem& problem) {
    using std::abs;
    const Index n = problem.unknowns();
    const Index m = problem.rows();
    Scalar largest(0);
    for (Index j = 0; j < n; ++j) {
      d_[j] =
          problem.state[static_cast<std::size_t>(j)] == Problem::State::Free ? Scalar(problem.x[j] - problem.xk[j]) : Scalar(0);
      largest = (std::max)(largest, Scalar(abs(d_[j])));
    }
    if (!(largest > Scalar(0)) || !is_finite(largest)) return RayVerdict::None;
    d_.head(n) /= largest;
    eta_.head(m).setConstant(Scalar(0));
    const Scalar loose = Scalar(64) * certificate_tolerance<Scalar>() / (Scalar(4) * summation_error<Scalar>(n));
    Scalar last = scalar_traits<Scalar>::infinity();
    for (int step = 0; step < kSteps; ++step) {
      for (Index j = 0; j < n; ++j) {
        const bool leaves = has_bound(d_[j] < Scalar(0) ? problem.lo[j] : problem.hi[j]);
        if (leaves && abs(d_[j]) < Scalar(64) * certificate_tolerance<Scalar>()) d_[j] = Scalar(0);
      }
      multiply(problem);
      const ProofCheck<Scalar> check =
          check_ray<Scalar>(d_.head(n), hd_.head(n), ad_.head(m), hd_size_.head(n), ad_size_.head(m), problem.g.head(n),
                            problem.rl.head(m), problem.ru.head(m), problem.lo.head(n), problem.hi.head(n));
      if (check.proven) return RayVerdict::Proven;
      if (!check.admissible || !(check.row_error <= loose)) return RayVerdict::None;
      if (!check.promising || !(check.error <= loose)) break;
      if (!worth_a_step(check.error, last)) break;
      last = check.error;
      bool changed = false;
      if (step == 0 && !problem.sync(changed)) return RayVerdict::None;
      refine(problem);
    }
    return has_far_minimum(problem) ? RayVerdict::FarMinimum : RayVerdict::None;
  }

  /// After FarMinimum: moves x to the minimum of the objective along `direction()`, as far as the bounds of x let it. Call
  /// refresh_products afterwards.
  void go_to_far_minimum(Problem& problem) const {
    for (Index j = 0; j < problem.unknowns(); ++j) {
      problem.x[j] = (std::min)((std::max)(Scalar(problem.x[j] + step_ * d_[j]), problem.lo[j]), problem.hi[j]);
    }
  }

 private:
  static constexpr int kSteps = 10, kHeldBack = 16;

  /// Errors halve from step to step; near the rounding limit they wander, and another step may hit.
  static bool worth_a_step(const Scalar& error, const Scalar& last) { return error < Scalar(0.5) * last || error < Scalar(8); }

  /// Tells whether the proximal term, not curvature, ended the step along d, and finds the step to the objective's minimum.
  bool has_far_minimum(const Problem& problem) {
    using std::abs;
    const Index n = problem.unknowns();
    Scalar slope(0);
    Scalar curvature(0);
    Scalar size(0);
    for (Index j = 0; j < n; ++j) {
      slope += (problem.hx[j] + problem.g[j]) * d_[j];
      curvature += hd_[j] * d_[j];
      size += hd_size_[j] * abs(d_[j]);
    }
    if (!(slope < Scalar(0)) || !(curvature > Scalar(2) * summation_error<Scalar>(n) * size)) return false;
    if (!(curvature < Scalar(kHeldBack) * problem.rho * d_.head(n).squaredNorm())) return false;
    step_ = -slope / curvature;
    return is_finite(step_);
  }

  /// hd = H d, ad = A d and the sizes of their terms.
  void multiply(const Problem& problem) {
    const Index n = problem.unknowns();
    const Index m = problem.rows();
    hd_.head(n).setConstant(Scalar(0));
    hd_size_.head(n).setConstant(Scalar(0));
    ad_.head(m).setConstant(Scalar(0));
    ad_size_.head(m).setConstant(Scalar(0));
    using std::abs;
    for (Index j = 0; j < n; ++j) {
      const Scalar d = d_[j];
      if (!(d < Scalar(0)) && !(d > Scalar(0))) continue;
      problem.columns_of_H().add(j, d, hd_);
      problem.columns_of_H().add_size(j, d, hd_size_);
      problem.columns_of_A().add(j, d, ad_);
      problem.columns_of_A().add_size(j, d, ad_size_);
    }
  }

  /// One step towards H d = 0 on the free unknowns and A d = 0 on the active rows that d would leave.
  void refine(Problem& problem) {
    const Index n = problem.unknowns();
    residual_.head(n) = hd_.head(n);
    const KktFactor<Scalar>& factor = problem.factor;
    for (Index k = 0; k < factor.row_size(); ++k) {
      const Index i = factor.row(k);
      if (eta_[i] < Scalar(0) || eta_[i] > Scalar(0)) problem.columns_of_At().add(i, -eta_[i], residual_);
      const bool leaves = (ad_[i] < Scalar(0) && has_bound(problem.rl[i])) || (ad_[i] > Scalar(0) && has_bound(problem.ru[i]));
      r2_[i] = leaves ? ad_[i] : Scalar(0);
    }
    problem.factor.solve(residual_, r2_, p_, delta_);
    for (Index k = 0; k < factor.free_size(); ++k) d_[factor.unknown(k)] += p_[factor.unknown(k)];
    for (Index k = 0; k < factor.row_size(); ++k) eta_[factor.row(k)] += delta_[factor.row(k)];
  }

  Vector d_, hd_, hd_size_, residual_, p_, z_, z_size_;
  Vector y_, ad_, ad_size_, eta_, r2_, delta_;
  Scalar step_ = Scalar(0);
};

}  // namespace clothctl::detail
