#pragma once

// Turns the differences of proximal iterates into certificates that a problem has no solution:
//
//   y_{k+1} - y_k  ->  Farkas pair:  refined towards Aᵀy = 0 on the free unknowns
//   x_{k+1} - x_k  ->  ray:          refined towards H d = 0 and A d = 0 on the active rows
//
// The factor of the regularised problem serves for the refinement. It ends when the sums that
// should vanish are no larger than their own rounding errors; anything larger is rejected. So a
// problem whose solutions lie far out, or that is nearly flat, gets no certificate.
//
// The differences contain small entries for rows and unknowns that do not belong to the
// certificate. Such an entry, alone in a sum, would never cancel. Entries below a threshold
// therefore count as zero; the threshold starts large and gets smaller. Scaling is by powers of
// two, so a relative test here is the same test on the caller's data.

#include <algorithm>
#include <cmath>
#include <vector>

#include "clothctl/linalg/accurate_sum.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/proximal_problem.hpp"
#include "clothctl/qp/detail/scaled_certificate.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What was learnt about a direction.
enum class RayStatus {
  /// It is no ray.
  NotFound,
  /// It leaves no bound and is so flat that the proximal term governs the step: the minimum may lie
  /// far along it.
  FarMinimum,
  /// It proves that the problem is unbounded (if it is feasible).
  Proven
};

/// Searches for proofs around the iterate of a proximal problem. All memory comes from `reserve`.
template <RealScalar Scalar>
class CertificateSearch {
 public:
  using Vector = VectorX<Scalar>;
  using Problem = ProximalProblem<Scalar>;

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    set_zero<Scalar>({&d_, &hd_, &hd_size_, &residual_, &p_, &z_, &z_size_}, n);
    set_zero<Scalar>({&y_, &ad_, &ad_size_, &eta_, &r2_, &delta_}, m);
    held_.assign(static_cast<std::size_t>(n), 0);
  }

  /// The row part y of a proof of infeasibility (scaled space, first m entries).
  const Vector& farkas_rows() const { return y_; }
  /// The bound part z of a proof of infeasibility (first n entries).
  const Vector& farkas_bounds() const { return z_; }
  /// The ray, or the direction of a far minimum (first n entries).
  const Vector& direction() const { return d_; }

  /// Returns true when y - yk proves infeasibility. Never allocates.
  bool infeasible(Problem& problem) {
    using std::abs;
    const Index n = problem.unknowns();
    const Index m = problem.rows();
    Scalar largest(0);
    for (Index i = 0; i < m; ++i)
      largest = (std::max)(largest, Scalar(abs(problem.y[i] - problem.yk[i])));
    if (!(largest > Scalar(0)) || !is_finite(largest)) return false;
    Scalar reach(1);
    for (Index j = 0; j < n; ++j) reach = (std::max)(reach, Scalar(abs(problem.x[j])));
    bool synced = false;
    Scalar threshold = coarsest_trace<Scalar>();
    for (int level = 0; level < kTraceLevels; ++level, threshold *= threshold) {
      for (Index i = 0; i < m; ++i) y_[i] = (problem.yk[i] - problem.y[i]) / largest;
      if (refine_farkas(problem, threshold, reach, synced)) return true;
    }
    return false;
  }

  /// Judges x - xk as a ray. Never allocates.
  RayStatus unbounded(Problem& problem) {
    using std::abs;
    const Index n = problem.unknowns();
    Scalar largest(0);
    const auto moved = [&](Index j) {
      const bool free = problem.state[static_cast<std::size_t>(j)] == Problem::State::Free;
      return free ? Scalar(problem.x[j] - problem.xk[j]) : Scalar(0);
    };
    for (Index j = 0; j < n; ++j) largest = (std::max)(largest, Scalar(abs(moved(j))));
    if (!(largest > Scalar(0)) || !is_finite(largest)) return RayStatus::NotFound;
    bool synced = false;
    bool is_close = false;
    Scalar threshold = coarsest_trace<Scalar>();
    for (int level = 0; level < kTraceLevels; ++level, threshold *= threshold) {
      for (Index j = 0; j < n; ++j) d_[j] = moved(j) / largest;
      const RayStatus verdict = refine_ray(problem, threshold, synced);
      if (verdict == RayStatus::Proven) return verdict;
      is_close = verdict == RayStatus::FarMinimum;
    }
    return is_close && has_far_minimum(problem) ? RayStatus::FarMinimum : RayStatus::NotFound;
  }

  /// After FarMinimum: moves x to the minimum of the objective along `direction()`, as far as the
  /// bounds of x let it. Call refresh_products afterwards.
  void go_to_far_minimum(Problem& problem) const {
    for (Index j = 0; j < problem.unknowns(); ++j) {
      problem.x[j] = (std::min)((std::max)(Scalar(problem.x[j] + step_ * d_[j]), problem.lo[j]),
                                problem.hi[j]);
    }
  }

 private:
  static constexpr int kSteps = 10, kHeldBack = 16;
  static constexpr int kNearly =
      1000;  // errors over what rounding explains from which on sums are accurate

  /// Refines y_ towards a proof of infeasibility.
  bool refine_farkas(Problem& problem, const Scalar& threshold, const Scalar& reach, bool& synced) {
    using std::abs;
    const Index n = problem.unknowns();
    const Index m = problem.rows();
    std::fill_n(r2_.data(), m, Scalar(0));
    bool nearly = false;
    Scalar last = scalar_traits<Scalar>::infinity();
    for (int step = 0; step < kSteps; ++step) {
      std::fill_n(z_.data(), n, Scalar(0));
      std::fill_n(z_size_.data(), n, Scalar(0));
      for (Index i = 0; i < m; ++i) {
        const Scalar v = y_[i];
        if (abs(v) < threshold) y_[i] = Scalar(0);
        if (!(y_[i] < Scalar(0)) && !(y_[i] > Scalar(0))) continue;
        problem.columns_of_At().add(i, -v, z_);
        problem.columns_of_At().add_size(i, v, z_size_);
      }
      for (Index j = 0; nearly && j < n; ++j) {
        AccurateSum<Scalar> sum;
        problem.columns_of_A().add_dot(j, y_, sum);
        z_[j] = -sum.value();
      }
      std::copy_n(z_.data(), n, residual_.data());
      const ProofCheck<Scalar> proof = check_farkas<Scalar>(
          y_.head(m), z_.head(n), z_size_.head(n), problem.rl.head(m), problem.ru.head(m),
          problem.lo.head(n), problem.hi.head(n), Scalar(16) * reach);
      if (proof.proven) return true;
      if (step > 1 && (!proof.promising || !worth_a_step(proof.error, last))) return false;
      last = proof.error;
      nearly = proof.promising && proof.error < Scalar(kNearly);
      if (!synchronise(problem, synced)) return false;
      problem.factor.solve(residual_, r2_, p_, delta_);
      for (Index k = 0; k < problem.factor.row_size(); ++k)
        y_[problem.factor.row(k)] += delta_[problem.factor.row(k)];
    }
    return false;
  }

  /// Brings the factor to the sets, once.
  bool synchronise(Problem& problem, bool& synced) {
    bool changed = false;
    if (!synced) synced = problem.sync(changed);
    return synced;
  }

  /// Refines d_ towards a ray: Proven, FarMinimum where it is nearly one, or None.
  RayStatus refine_ray(Problem& problem, const Scalar& threshold, bool& synced) {
    using std::abs;
    const Index n = problem.unknowns();
    const Index m = problem.rows();
    std::fill_n(eta_.data(), m, Scalar(0));
    const Scalar loose =
        Scalar(64) * certificate_tolerance<Scalar>() / (Scalar(4) * summation_error<Scalar>(n));
    Scalar last = scalar_traits<Scalar>::infinity();
    held_count_ = 0;
    bool nearly = false;
    RayStatus verdict = RayStatus::FarMinimum;
    for (int step = 0; step < kSteps; ++step) {
      for (Index j = 0; j < n; ++j) {
        if (abs(d_[j]) < threshold) d_[j] = Scalar(0);
      }
      multiply(problem);
      if (nearly) sharpen(problem);
      const ProofCheck<Scalar> proof =
          check_ray<Scalar>(d_.head(n), hd_.head(n), ad_.head(m), hd_size_.head(n),
                            ad_size_.head(m), problem.g.head(n), problem.rl.head(m),
                            problem.ru.head(m), problem.lo.head(n), problem.hi.head(n));
      if (proof.proven) verdict = RayStatus::Proven;
      if (!proof.admissible || (step > 1 && !(proof.row_error <= loose)))
        verdict = RayStatus::NotFound;
      if (verdict != RayStatus::FarMinimum || !proof.promising ||
          (step > 1 && !(proof.error <= loose)))
        break;
      if (step > 1 && !worth_a_step(proof.error, last) &&
          (held_count_ > 0 || !hold(problem, synced)))
        break;
      last = proof.error;
      nearly = proof.error < Scalar(kNearly);
      if (!synchronise(problem, synced)) {
        verdict = RayStatus::NotFound;
        break;
      }
      refine(problem);
    }
    if (held_count_ > 0) synced = false;
    for (Index k = 0; k < held_count_; ++k)
      problem.state[static_cast<std::size_t>(held(k))] = Problem::State::Free;
    return verdict;
  }

  /// Takes unknowns that a bound keeps out of the ray from the free set: else each step moves them,
  /// and putting them back disturbs the others. Returns whether there are any; they are to be freed
  /// again.
  bool hold(Problem& problem, bool& synced) {
    for (Index j = 0; j < problem.unknowns(); ++j) {
      typename Problem::State& state = problem.state[static_cast<std::size_t>(j)];
      const bool moves = d_[j] < Scalar(0) || d_[j] > Scalar(0);
      if (moves || state != Problem::State::Free ||
          (!has_bound(problem.lo[j]) && !has_bound(problem.hi[j])))
        continue;
      state = Problem::State::Lower;
      held_[static_cast<std::size_t>(held_count_++)] = j;
    }
    if (held_count_ > 0) synced = false;
    return held_count_ > 0;
  }
  Index held(Index k) const { return held_[static_cast<std::size_t>(k)]; }

  /// Errors halve from step to step; near the rounding limit they wander, and another step may hit.
  static bool worth_a_step(const Scalar& error, const Scalar& last) {
    return error < Scalar(0.5) * last || error < Scalar(8);
  }

  /// Returns true when the proximal term, not curvature, ended the step along d, and finds the step
  /// to the objective's minimum.
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
    if (!(slope < Scalar(0)) || !(curvature > Scalar(2) * summation_error<Scalar>(n) * size))
      return false;
    if (!(curvature < Scalar(kHeldBack) * problem.rho * dot_product(n, d_.data(), d_.data())))
      return false;
    step_ = -slope / curvature;
    return is_finite(step_) && step_ < largest_bound<Scalar>();
  }

  /// hd = H d, ad = A d and the sizes of their terms.
  void multiply(const Problem& problem) {
    const Index n = problem.unknowns();
    const Index m = problem.rows();
    std::fill_n(hd_.data(), n, Scalar(0));
    std::fill_n(hd_size_.data(), n, Scalar(0));
    std::fill_n(ad_.data(), m, Scalar(0));
    std::fill_n(ad_size_.data(), m, Scalar(0));
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

  /// hd and ad as if summed in twice the precision.
  void sharpen(const Problem& problem) {
    for (Index j = 0; j < problem.unknowns(); ++j) {
      AccurateSum<Scalar> sum;
      problem.columns_of_H().add_dot(j, d_, sum);
      hd_[j] = sum.value();
    }
    for (Index i = 0; i < problem.rows(); ++i) {
      AccurateSum<Scalar> sum;
      problem.columns_of_At().add_dot(i, d_, sum);
      ad_[i] = sum.value();
    }
  }

  /// One step towards H d = 0 on the free unknowns and A d = 0 on the active rows that d would
  /// leave.
  void refine(Problem& problem) {
    const Index n = problem.unknowns();
    std::copy_n(hd_.data(), n, residual_.data());
    const KktFactor<Scalar>& factor = problem.factor;
    for (Index k = 0; k < factor.row_size(); ++k) {
      const Index i = factor.row(k);
      if (eta_[i] < Scalar(0) || eta_[i] > Scalar(0))
        problem.columns_of_At().add(i, -eta_[i], residual_);
      const bool leaves = (ad_[i] < Scalar(0) && has_bound(problem.rl[i])) ||
                          (ad_[i] > Scalar(0) && has_bound(problem.ru[i]));
      r2_[i] = leaves ? ad_[i] : Scalar(0);
    }
    problem.factor.solve(residual_, r2_, p_, delta_);
    for (Index k = 0; k < factor.free_size(); ++k) d_[factor.unknown(k)] += p_[factor.unknown(k)];
    for (Index k = 0; k < factor.row_size(); ++k) eta_[factor.row(k)] += delta_[factor.row(k)];
  }

  Vector d_, hd_, hd_size_, residual_, p_, z_, z_size_;
  Vector y_, ad_, ad_size_, eta_, r2_, delta_;
  std::vector<Index> held_;
  Index held_count_ = 0;
  Scalar step_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
