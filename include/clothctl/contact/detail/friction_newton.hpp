#pragma once

// Solves the contact problem of friction_problem.hpp by Newton's method on the equations of Alart
// and Curnier, F(λ) = 0, with u = D λ + b and the 3×3 blocks of alart_curnier.hpp:
//
//   (A_i δ_ij + G_i D_ij) dλ_j = -F_i
//
// Open contacts have dλ_i = -λ_i and leave the system. A small multiple of dλ is added to the other
// equations: where D is singular, as for many rigid contacts of one body, Newton's step is then the
// one of (nearly) least change. A step is halved until |F| falls; where no half helps, the whole
// step is taken.
//
// Newton's method converges from near a solution only. From elsewhere, sweeps of exact solutions of
// single contacts (Gauss–Seidel) lead to its neighbourhood. They do not solve the problem by
// themselves: a light sheet between two heavy fingers takes tens of thousands of sweeps, and the
// residual is small long before the grip force is right.

#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/contact/detail/alart_curnier.hpp"
#include "clothctl/contact/detail/pivoted_lu.hpp"
#include "clothctl/contact/detail/single_contact.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// When and how long to iterate.
template <RealScalar Scalar>
struct FrictionLimits {
  /// What a solution may have, N s and m/s.
  Scalar impulse_tolerance, velocity_tolerance;
  int first_sweeps, newton_steps, rounds, sweeps;
};

/// How a solve ended.
template <RealScalar Scalar>
struct FrictionReport {
  bool solved = false;
  NaturalResidual<Scalar> residual;
  int newton_steps = 0, sweeps = 0;
};

/// The memory of the method. The best impulses that it has met are kept.
template <RealScalar Scalar>
class FrictionNewton {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for c contacts. Allocates.
  void reserve(Index c) {
    lu_.reserve(3 * c);
    for (Vector* v : {&lambda_, &u_, &best_, &step_, &push_, &right_, &trial_, &trial_u_})
      v->setConstant(3 * c, Scalar(0));
    branch_.assign(static_cast<std::size_t>(c), ContactState::Open);
    place_.assign(static_cast<std::size_t>(c), -1);
  }

  /// The impulses (3c): where to start, and after `solve` the answer.
  Vector& impulses() { return best_; }
  /// The velocities D λ + b of the answer.
  const Vector& velocities() const { return u_; }

  /// Solves a prepared problem from `impulses()`. Never allocates.
  FrictionReport<Scalar> solve(const FrictionProblem<Scalar>& problem,
                               const FrictionLimits<Scalar>& limits);

 private:
  /// Takes λ = lambda_ and u = u_ for the best if their residual is the smallest yet.
  void judge(const FrictionProblem<Scalar>& problem, const FrictionLimits<Scalar>& limits,
             FrictionReport<Scalar>& report);
  /// One round of Newton's method from lambda_.
  void newton(const FrictionProblem<Scalar>& problem, const FrictionLimits<Scalar>& limits,
              FrictionReport<Scalar>& report);
  /// One sweep of single contacts over lambda_ and u_.
  void sweep(const FrictionProblem<Scalar>& problem);
  /// Returns |F|² of λ and u. Keeps the branches if `keep`.
  Scalar merit(const FrictionProblem<Scalar>& problem, const Vector& lambda, const Vector& u,
               bool keep);
  /// Computes Newton's step. Returns false when there is none.
  bool find_step(const FrictionProblem<Scalar>& problem);

  PivotedLu<Scalar> lu_;
  Vector lambda_, u_, best_, step_, push_, right_, trial_, trial_u_;
  std::vector<ContactState> branch_;
  std::vector<Index> place_;  // of a contact in the system, -1 if open
};

template <RealScalar Scalar>
FrictionReport<Scalar> FrictionNewton<Scalar>::solve(const FrictionProblem<Scalar>& problem,
                                                     const FrictionLimits<Scalar>& limits) {
  FrictionReport<Scalar> report;
  report.residual.excess = scalar_traits<Scalar>::infinity();
  const Index n = 3 * problem.contacts();
  lambda_.head(n) = best_.head(n);
  problem.velocities(lambda_, u_);
  judge(problem, limits, report);
  for (int round = 0; round <= limits.rounds && !report.solved; ++round) {
    const int sweeps = round == 0 ? limits.first_sweeps : round * limits.sweeps;
    lambda_.head(n) = best_.head(n);
    problem.velocities(lambda_, u_);
    for (int k = 0; k < sweeps; ++k) sweep(problem);
    report.sweeps += sweeps;
    problem.velocities(lambda_, u_);
    judge(problem, limits, report);
    if (!report.solved) newton(problem, limits, report);
  }
  problem.velocities(best_, u_);
  return report;
}

template <RealScalar Scalar>
void FrictionNewton<Scalar>::judge(const FrictionProblem<Scalar>& problem,
                                   const FrictionLimits<Scalar>& limits,
                                   FrictionReport<Scalar>& report) {
  const NaturalResidual<Scalar> now =
      problem.residual(lambda_, u_, limits.impulse_tolerance, limits.velocity_tolerance);
  if (!is_finite(now.excess) || !(now.excess < report.residual.excess)) {
    if (!is_finite(report.residual.excess)) report.residual = now;  // nothing better was seen
    return;
  }
  report.residual = now;
  report.solved = now.excess <= Scalar(1);
  best_.head(3 * problem.contacts()) = lambda_.head(3 * problem.contacts());
}

template <RealScalar Scalar>
void FrictionNewton<Scalar>::newton(const FrictionProblem<Scalar>& problem,
                                    const FrictionLimits<Scalar>& limits,
                                    FrictionReport<Scalar>& report) {
  const Index n = 3 * problem.contacts();
  for (int k = 0; k < limits.newton_steps; ++k) {
    const Scalar now = merit(problem, lambda_, u_, true);
    if (!is_finite(now) || !find_step(problem)) return;
    ++report.newton_steps;
    Scalar share(1);
    for (int half = 0; half <= 5; ++half, share *= Scalar(0.5)) {
      trial_.head(n) = lambda_.head(n) + share * step_.head(n);
      trial_u_.head(n) = u_.head(n) + share * push_.head(n);
      const Scalar then = merit(problem, trial_, trial_u_, false);
      if (is_finite(then) && then < now) break;
      if (half < 5) continue;
      trial_.head(n) = lambda_.head(n) + step_.head(n);
    }
    lambda_.head(n) = trial_.head(n);
    problem.velocities(lambda_, u_);
    judge(problem, limits, report);
    if (report.solved) return;
  }
}

template <RealScalar Scalar>
void FrictionNewton<Scalar>::sweep(const FrictionProblem<Scalar>& problem) {
  const typename FrictionProblem<Scalar>::ConstMatrix D = problem.D();
  const Index n = 3 * problem.contacts();
  for (Index i = 0; i < problem.contacts(); ++i) {
    const Matrix3<Scalar> own = D.template block<3, 3>(3 * i, 3 * i);
    const Vector3<Scalar> old = lambda_.template segment<3>(3 * i);
    const Vector3<Scalar> u = u_.template segment<3>(3 * i);
    const Vector3<Scalar> b = u - own * old;
    const Vector3<Scalar> found = solve_single_contact<Scalar>(own, b, problem.friction(i));
    if (!all_finite(found)) continue;
    lambda_.template segment<3>(3 * i) = found;
    for (Index k = 0; k < 3; ++k) {
      const Scalar change = found[k] - old[k];
      u_.head(n) += change * D.col(3 * i + k);
    }
  }
}

template <RealScalar Scalar>
Scalar FrictionNewton<Scalar>::merit(const FrictionProblem<Scalar>& problem, const Vector& lambda,
                                     const Vector& u, bool keep) {
  Scalar sum(0);
  for (Index i = 0; i < problem.contacts(); ++i) {
    const ContactEquation<Scalar> e =
        contact_equation<Scalar>(lambda.template segment<3>(3 * i), u.template segment<3>(3 * i),
                                 problem.friction(i), problem.rho_n(i), problem.rho_t(i));
    sum += e.F.squaredNorm();
    if (!keep) continue;
    branch_[static_cast<std::size_t>(i)] = e.branch;
    right_.template segment<3>(3 * i) = -e.F;
  }
  return sum;
}

template <RealScalar Scalar>
bool FrictionNewton<Scalar>::find_step(const FrictionProblem<Scalar>& problem) {
  using std::sqrt;
  const typename FrictionProblem<Scalar>::ConstMatrix D = problem.D();
  const Index c = problem.contacts();
  // Open contacts: dλ = -λ, and the velocities that this causes.
  push_.head(3 * c).setConstant(Scalar(0));
  Index closed = 0;
  for (Index i = 0; i < c; ++i) {
    const bool open = branch_[static_cast<std::size_t>(i)] == ContactState::Open;
    place_[static_cast<std::size_t>(i)] = open ? Index(-1) : closed++;
    if (!open) continue;
    step_.template segment<3>(3 * i) = right_.template segment<3>(3 * i);
    for (Index k = 0; k < 3; ++k) push_.head(3 * c) += right_[3 * i + k] * D.col(3 * i + k);
  }
  lu_.resize(3 * closed);
  typename PivotedLu<Scalar>::Matrix J = lu_.matrix();
  const Scalar calm = Scalar(0.1) * sqrt(scalar_traits<Scalar>::epsilon());
  for (Index i = 0; i < c; ++i) {
    const Index row = place_[static_cast<std::size_t>(i)];
    if (row < 0) continue;
    const ContactDerivative<Scalar> d = contact_derivative<Scalar>(
        branch_[static_cast<std::size_t>(i)], lambda_.template segment<3>(3 * i),
        u_.template segment<3>(3 * i), problem.friction(i), problem.rho_n(i), problem.rho_t(i));
    for (Index j = 0; j < c; ++j) {
      const Index col = place_[static_cast<std::size_t>(j)];
      if (col < 0) continue;
      const Matrix3<Scalar> block = D.template block<3, 3>(3 * i, 3 * j);
      Matrix3<Scalar> out = d.G * block;
      if (i == j) {
        out += d.A;
        for (int k = 0; k < 3; ++k) out(k, k) += calm;
      }
      J.template block<3, 3>(3 * row, 3 * col) = out;
    }
    const Vector3<Scalar> pushed = push_.template segment<3>(3 * i);
    const Vector3<Scalar> right = right_.template segment<3>(3 * i);
    trial_.template segment<3>(3 * row) = right - d.G * pushed;
  }
  if (!lu_.solve(trial_)) return false;
  for (Index i = 0; i < c; ++i) {
    const Index row = place_[static_cast<std::size_t>(i)];
    if (row < 0) continue;
    const Vector3<Scalar> found = trial_.template segment<3>(3 * row);
    step_.template segment<3>(3 * i) = found;
    for (Index k = 0; k < 3; ++k) push_.head(3 * c) += found[k] * D.col(3 * i + k);
  }
  return all_finite(step_.head(3 * c));
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
