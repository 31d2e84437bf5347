#pragma once

// The preconditioned conjugate gradient method for A d = b, A a symmetric matrix of 3×3 blocks.
//
//   z = P⁻¹ r,  p = z + β p,  d += a p,  r -= a A p,     a = rᵀz / pᵀA p
//
// The k-th iteration lowers the quadratic q(d) = ½ dᵀA d - bᵀd by δ_k = ½ a rᵀz. The iteration ends
// when k δ_k <= η Σ δ: more iterations would hardly lower q. It also ends when every entry of r is
// small, or when pᵀA p is not positive: then A is indefinite, and d is the step so far, or the
// first direction P⁻¹ b, which is a direction of descent of q. Held vertices keep d = 0.
// References: Hestenes and Stiefel (1952); Nash and Sofer, Assessing a search direction within a
// truncated-Newton method, Oper. Res. Lett. 9 (1990).

#include <vector>

#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/linalg/block_symmetric.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The vectors of a solve, 1×3n each.
template <RealScalar Scalar>
struct ConjugateGradientMemory {
  /// Solution d, residual r, preconditioned residual z, direction p and its product A p.
  Lanes<Scalar, 1> solution, residual, preconditioned, direction, product;

  /// Makes room for n vertices. Allocates.
  void reserve(Index n) {
    for (Lanes<Scalar, 1>* v : {&solution, &residual, &preconditioned, &direction, &product})
      v->setZero(1, 3 * n);
  }
};

/// When a solve ends.
template <RealScalar Scalar>
struct ConjugateGradientLimits {
  /// η above; 0 switches this test off.
  Scalar forcing = Scalar(0);
  /// The solve ends when every entry of r is, in magnitude, below this times the mass of its
  /// vertex, m/s.
  Scalar tolerance = Scalar(0);
  /// Largest number of iterations.
  int max_iterations = 0;
};

/// How a solve ended.
struct ConjugateGradientReport {
  /// Number of products with A.
  int iterations = 0;
  /// True when a direction had no positive curvature.
  bool indefinite = false;
  /// True when one of the tests for a good solution was met.
  bool converged = false;
  /// False when a number was not finite; d must then not be used.
  bool finite = true;
};

/// Returns true when every entry of r is below `tolerance` (m/s) times the mass of its vertex.
template <RealScalar Scalar>
bool is_small(const Lanes<Scalar, 1>& r, const VectorX<Scalar>& mass, const Scalar& tolerance) {
  for (Index i = 0; i < mass.size(); ++i) {
    const Scalar limit = tolerance * mass[i];
    for (Index c = 0; c < 3; ++c) {
      const Scalar& entry = r[3 * i + c];
      if (!(entry < limit) || !(-entry < limit)) return false;
    }
  }
  return true;
}

/// Solves A d = b for b in `right` (1×3n, zero at held vertices), and leaves d in memory.solution.
/// `apply(r, z)` must write z = P⁻¹ r, zero at held vertices. Never allocates.
template <RealScalar Scalar, class Apply>
ConjugateGradientReport conjugate_gradient(const BlockSymmetric<Scalar>& A,
                                           const Lanes<Scalar, 1>& right,
                                           const VectorX<Scalar>& mass,
                                           const std::vector<unsigned char>& held,
                                           const ConjugateGradientLimits<Scalar>& limits,
                                           Apply&& apply, ConjugateGradientMemory<Scalar>& memory) {
  ConjugateGradientReport report;
  Lanes<Scalar, 1>&d = memory.solution, &r = memory.residual, &z = memory.preconditioned;
  Lanes<Scalar, 1>&p = memory.direction, &q = memory.product;
  d.setZero();
  r = right;
  if (is_small(r, mass, limits.tolerance)) report.converged = true;
  if (report.converged) return report;
  apply(r, z);
  p = z;
  Scalar rz = r.cwiseProduct(z).sum(), total = Scalar(0);
  while (report.iterations < limits.max_iterations) {
    A.template multiply<1>(p, q);
    for (std::size_t i = 0; i < held.size(); ++i) {
      if (held[i] == 0) continue;
      for (Index c = 0; c < 3; ++c) q[3 * static_cast<Index>(i) + c] = Scalar(0);
    }
    const Scalar curvature = p.cwiseProduct(q).sum();
    ++report.iterations;
    if (!is_finite(curvature) || !is_finite(rz) || !(Scalar(0) < rz)) {
      report.finite = false;
      return report;
    }
    if (!(Scalar(0) < curvature)) {
      report.indefinite = true;
      if (report.iterations == 1) d = p;
      return report;
    }
    const Scalar a = rz / curvature;
    const Scalar drop = Scalar(0.5) * a * rz;
    for (Index k = 0; k < d.cols(); ++k) {
      d[k] = d[k] + a * p[k];
      r[k] = r[k] - a * q[k];
    }
    total += drop;
    const bool little = Scalar(report.iterations) * drop < limits.forcing * total;
    if (little || is_small(r, mass, limits.tolerance)) {
      report.converged = true;
      return report;
    }
    if (report.iterations == limits.max_iterations) break;
    apply(r, z);
    const Scalar next = r.cwiseProduct(z).sum();
    const Scalar ratio = next / rz;
    for (Index k = 0; k < p.cols(); ++k) p[k] = z[k] + ratio * p[k];
    rz = next;
  }
  return report;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
