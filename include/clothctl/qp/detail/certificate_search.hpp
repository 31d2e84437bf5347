#pragma once

// Turns the differences of proximal iterates into certificates that a problem has no solution:
//
//   y_{k+1} - y_k  ->  Farkas pair:  refined towards Aᵀy = 0 on the free unknowns
//   x_{k+1} - x_k  ->  ray:          refined towards H d = 0 and A d = 0 on the active rows
//
// The refinement uses the factor of the regularised problem. The refinement succeeds when all sums
// that should be zero are no larger than their own rounding errors. Larger sums are rejected. So
// there is no certificate for a problem whose solutions are only far away or whose curvature is
// only small.
//
// The differences contain small entries for rows and unknowns that are not part of the certificate.
// If such an entry is the only term of a sum, nothing cancels it. Entries below a drop tolerance
// therefore count as zero. Several drop tolerances are tried, the largest first. The solver scales
// by powers of two, so a relative test in scaled space is the same test on the caller's data.
//
// Reference for certificates from differences of iterates (of ADMM): Banjac, Goulart, Stellato and
// Boyd, J. Optim. Theory Appl. 183 (2019).

#include <algorithm>
#include <cmath>
#include <vector>

#include "clothctl/linalg/accurate_sum.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/proximal_problem.hpp"
#include "clothctl/qp/detail/scaled_certificate.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The result of a search for a ray.
enum class RayStatus {
  /// The direction is no ray.
  NotFound,
  /// No bound blocks the direction, and its curvature is so small that the proximal term limited
  /// the step: the minimum may be far along the direction.
  FarMinimum,
  /// The direction proves that the problem is unbounded, if the problem is feasible.
  Proven
};

/// Searches for certificates near the iterates of a proximal problem. All memory comes from
/// `reserve`.
template <RealScalar Scalar>
class CertificateSearch {
 public:
  using Vector = VectorX<Scalar>;
  using Problem = ProximalProblem<Scalar>;

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    set_zero<Scalar>({&d_, &hd_, &hd_size_, &residual_, &p_, &z_, &z_size_}, n);
    set_zero<Scalar>({&y_, &ad_, &ad_size_, &eta_, &r2_, &delta_}, m);
    fixed_.assign(static_cast<std::size_t>(n), 0);
  }

  /// The row part y of the Farkas certificate (scaled space, first m entries).
  const Vector& farkas_rows() const { return y_; }
  /// The bound part z of the Farkas certificate (first n entries).
  const Vector& farkas_bounds() const { return z_; }
  /// The ray, or the direction of a far minimum (first n entries).
  const Vector& direction() const { return d_; }

  /// Returns true when y - yk leads to a Farkas certificate. Never allocates.
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
    Scalar threshold = largest_drop_tolerance<Scalar>();
    for (int level = 0; level < kDropLevels; ++level, threshold *= threshold) {
      for (Index i = 0; i < m; ++i) y_[i] = (problem.yk[i] - problem.y[i]) / largest;
      if (refine_farkas(problem, threshold, reach, synced)) return true;
    }
    return false;
  }

  /// Checks whether x - xk leads to a ray. Never allocates.
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
    Scalar threshold = largest_drop_tolerance<Scalar>();
    for (int level = 0; level < kDropLevels; ++level, threshold *= threshold) {
      for (Index j = 0; j < n; ++j) d_[j] = moved(j) / largest;
      const RayStatus status = refine_ray(problem, threshold, synced);
      if (status == RayStatus::Proven) return status;
      is_close = status == RayStatus::FarMinimum;
    }
    return is_close && has_far_minimum(problem) ? RayStatus::FarMinimum : RayStatus::NotFound;
  }

  /// After FarMinimum: moves x to the minimum of the objective along `direction()` and then back
  /// into its bounds. Call refresh_products afterwards.
  void go_to_far_minimum(Problem& problem) const {
    for (Index j = 0; j < problem.unknowns(); ++j) {
      problem.x[j] = (std::min)((std::max)(Scalar(problem.x[j] + step_ * d_[j]), problem.lo[j]),
                                problem.hi[j]);
    }
  }

 private:
  static constexpr int kSteps = 10;
  /// The proximal term limits a step when the curvature is below this many times ρ |d|².
  static constexpr int kSmallCurvature = 16;
  /// When the largest ratio of an error to its rounding bound is below this, accurate sums replace
  /// the plain ones.
  static constexpr int kUseAccurateSums = 1000;

  /// Refines y_ towards a Farkas certificate. Returns true on success.
  bool refine_farkas(Problem& problem, const Scalar& threshold, const Scalar& reach, bool& synced) {
    using std::abs;
    const Index n = problem.unknowns();
    const Index m = problem.rows();
    std::fill_n(r2_.data(), m, Scalar(0));
    bool accurate = false;
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
      for (Index j = 0; accurate && j < n; ++j) {
        AccurateSum<Scalar> sum;
        problem.columns_of_A().add_dot(j, y_, sum);
        z_[j] = -sum.value();
      }
      std::copy_n(z_.data(), n, residual_.data());
      const CertificateCheck<Scalar> certificate = check_farkas<Scalar>(
          y_.head(m), z_.head(n), z_size_.head(n), problem.rl.head(m), problem.ru.head(m),
          problem.lo.head(n), problem.hi.head(n), Scalar(16) * reach);
      if (certificate.holds) return true;
      if (step > 1 && (!certificate.promising || !worth_a_step(certificate.error, last)))
        return false;
      last = certificate.error;
      accurate = certificate.promising && certificate.error < Scalar(kUseAccurateSums);
      if (!synchronise(problem, synced)) return false;
      problem.factor.solve(residual_, r2_, p_, delta_);
      for (Index k = 0; k < problem.factor.row_size(); ++k)
        y_[problem.factor.row(k)] += delta_[problem.factor.row(k)];
    }
    return false;
  }

  /// Updates the factor to the present sets, unless that is done.
  bool synchronise(Problem& problem, bool& synced) {
    bool changed = false;
    if (!synced) synced = problem.sync(changed);
    return synced;
  }

  /// Refines d_ towards a ray. Returns FarMinimum when d_ is only almost a ray.
  RayStatus refine_ray(Problem& problem, const Scalar& threshold, bool& synced) {
    using std::abs;
    const Index n = problem.unknowns();
    const Index m = problem.rows();
    std::fill_n(eta_.data(), m, Scalar(0));
    const Scalar loose =
        Scalar(64) * certificate_tolerance<Scalar>() / (Scalar(4) * summation_error<Scalar>(n));
    Scalar last = scalar_traits<Scalar>::infinity();
    fixed_count_ = 0;
    bool accurate = false;
    RayStatus status = RayStatus::FarMinimum;
    for (int step = 0; step < kSteps; ++step) {
      for (Index j = 0; j < n; ++j) {
        if (abs(d_[j]) < threshold) d_[j] = Scalar(0);
      }
      multiply(problem);
      if (accurate) multiply_accurately(problem);
      const CertificateCheck<Scalar> certificate =
          check_ray<Scalar>(d_.head(n), hd_.head(n), ad_.head(m), hd_size_.head(n),
                            ad_size_.head(m), problem.g.head(n), problem.rl.head(m),
                            problem.ru.head(m), problem.lo.head(n), problem.hi.head(n));
      if (certificate.holds) status = RayStatus::Proven;
      if (!certificate.admissible || (step > 1 && !(certificate.row_error <= loose)))
        status = RayStatus::NotFound;
      if (status != RayStatus::FarMinimum || !certificate.promising ||
          (step > 1 && !(certificate.error <= loose)))
        break;
      if (step > 1 && !worth_a_step(certificate.error, last) &&
          (fixed_count_ > 0 || !fix_bounded(problem, synced)))
        break;
      last = certificate.error;
      accurate = certificate.error < Scalar(kUseAccurateSums);
      if (!synchronise(problem, synced)) {
        status = RayStatus::NotFound;
        break;
      }
      refine(problem);
    }
    if (fixed_count_ > 0) synced = false;
    for (Index k = 0; k < fixed_count_; ++k)
      problem.state[static_cast<std::size_t>(fixed(k))] = Problem::State::Free;
    return status;
  }

  /// Fixes the free unknowns that have a bound and are zero in d. Each refinement step would move
  /// them, and setting them back to zero disturbs the other unknowns. Returns true when any unknown
  /// is fixed. The caller must free these unknowns afterwards.
  bool fix_bounded(Problem& problem, bool& synced) {
    for (Index j = 0; j < problem.unknowns(); ++j) {
      typename Problem::State& state = problem.state[static_cast<std::size_t>(j)];
      const bool moves = d_[j] < Scalar(0) || d_[j] > Scalar(0);
      if (moves || state != Problem::State::Free ||
          (!has_bound(problem.lo[j]) && !has_bound(problem.hi[j])))
        continue;
      state = Problem::State::Lower;
      fixed_[static_cast<std::size_t>(fixed_count_++)] = j;
    }
    if (fixed_count_ > 0) synced = false;
    return fixed_count_ > 0;
  }
  Index fixed(Index k) const { return fixed_[static_cast<std::size_t>(k)]; }

  /// Returns true when one more refinement step can help: the error was halved, or is so close to
  /// its rounding bound that it varies from step to step.
  static bool worth_a_step(const Scalar& error, const Scalar& last) {
    return error < Scalar(0.5) * last || error < Scalar(8);
  }

  /// Returns true when the proximal term, not the curvature, limited the step along d, and slope
  /// and curvature along d are larger than their rounding errors. Then sets `step_` to the step
  /// length along d to the minimum of the objective.
  bool has_far_minimum(const Problem& problem) {
    using std::abs;
    const Index n = problem.unknowns();
    const Scalar length = problem.length_of_x();
    Scalar slope(0), slope_size(0), curvature(0), size(0);
    for (Index j = 0; j < n; ++j) {
      slope += (problem.hx[j] + problem.g[j]) * d_[j];
      slope_size += (problem.root_of_diagonal(j) * length + abs(problem.g[j])) * abs(d_[j]);
      curvature += hd_[j] * d_[j];
      size += hd_size_[j] * abs(d_[j]);
    }
    const Scalar rounding = Scalar(2) * summation_error<Scalar>(n);
    if (!(slope < -rounding * slope_size) || !(curvature > rounding * size)) return false;
    if (!(curvature < Scalar(kSmallCurvature) * problem.rho * dot_product(n, d_.data(), d_.data())))
      return false;
    step_ = -slope / curvature;
    return is_finite(step_) && step_ < largest_bound<Scalar>();
  }

  /// Computes hd = H d, ad = A d, and the sums |H||d| and |A||d|.
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

  /// Computes hd = H d and ad = A d as if in twice the precision.
  void multiply_accurately(const Problem& problem) {
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

  /// One refinement step towards H d = 0 on the free unknowns, and A d = 0 on the active rows where
  /// A d points at a finite bound.
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
  std::vector<Index> fixed_;
  Index fixed_count_ = 0;
  Scalar step_ = Scalar(0);
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
