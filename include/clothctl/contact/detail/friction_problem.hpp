#pragma once

// The contact problem of a step, in the frames (n, t1, t2) of c contacts. With the impulses λ (3c,
// N s) and the relative velocities u (3c, m/s)
//
//   u = D λ + b,     û_i = u_i + μ_i |u_i,t| n     (de Saxcé's correction)
//   λ_i ∈ K_i,   û_i ∈ K_i*,   û_i·λ_i = 0
//
// K = { |λ_t| <= μ λ_n } is Coulomb's cone and K* = { û_n >= μ |û_t| } its dual. This holds exactly
// for contacts that are open (λ = 0, u_n >= 0), stick (u = 0), or slip (u_n = 0, λ_t against u_t,
// |λ_t| = μ λ_n). How far λ is from a solution is measured by the natural map
//
//   λ_i - P_K(λ_i - ρ û_i)   (N s),       divided by ρ   (m/s),       ρ = 1/(largest D_kk of i)
//
// where P_K is the projection to the cone.
//
// Reference: de Saxcé, Feng, The bipotential method, Math. Comput. Modelling 28 (1998); Acary,
// Brémond, Huber, On solving contact problems with Coulomb friction (2018).

#include <cmath>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the length of the tangential part of a vector in the frame (n, t1, t2).
template <RealScalar Scalar>
Scalar tangential_length(const Vector3<Scalar>& x) {
  using std::sqrt;
  return sqrt(x[1] * x[1] + x[2] * x[2]);
}

/// Returns the point of the cone |x_t| <= μ x_n that is closest to x (n, t1, t2).
template <RealScalar Scalar>
Vector3<Scalar> project_to_cone(const Vector3<Scalar>& x, const Scalar& mu) {
  const Scalar t = tangential_length<Scalar>(x);
  if (t <= mu * x[0]) return x;
  if (mu * t <= -x[0]) return Vector3<Scalar>::Constant(Scalar(0));
  const Scalar n = (x[0] + mu * t) / (Scalar(1) + mu * mu);
  const Scalar share = Scalar(0) < t ? Scalar(mu * n / t) : Scalar(0);
  return {n, share * x[1], share * x[2]};
}

/// Returns the natural map of a contact with the impulse l and the velocity u, l - P_K(l - ρ û),
/// which is 0 for a solution, N s.
template <RealScalar Scalar>
Vector3<Scalar> natural_map(const Vector3<Scalar>& l, const Vector3<Scalar>& u, const Scalar& mu,
                            const Scalar& rho) {
  Vector3<Scalar> v = u;
  v[0] += mu * tangential_length<Scalar>(u);
  const Vector3<Scalar> moved = l - rho * v;
  return l - project_to_cone<Scalar>(moved, mu);
}

/// How far impulses are from a solution: the largest natural map of a contact.
template <RealScalar Scalar>
struct NaturalResidual {
  /// In N s and m/s.
  Scalar impulse = Scalar(0), velocity = Scalar(0);
  /// What of it exceeds what rounding may cause, relative to the tolerances: at most 1 if solved.
  Scalar excess = Scalar(0);
};

/// D, b and μ of up to a reserved number of contacts.
template <RealScalar Scalar>
class FrictionProblem {
 public:
  using Matrix = Eigen::Map<MatrixX<Scalar>>;
  using ConstMatrix = Eigen::Map<const MatrixX<Scalar>>;

  /// Makes room for c contacts. Allocates.
  void reserve(Index c) {
    entries_.setConstant(9 * c * c, Scalar(0));
    b_.setConstant(3 * c, Scalar(0));
    friction_.setConstant(c, Scalar(0));
    rho_.setConstant(3, c, Scalar(0));
    c_ = 0;
  }
  Index capacity() const { return friction_.size(); }

  /// Sets the size, at most the reserved one, and everything to zero.
  void resize(Index c) {
    c_ = c;
    D().setConstant(Scalar(0));
    b().setConstant(Scalar(0));
  }
  Index contacts() const { return c_; }
  Matrix D() { return Matrix(entries_.data(), 3 * c_, 3 * c_); }
  ConstMatrix D() const { return ConstMatrix(entries_.data(), 3 * c_, 3 * c_); }
  Eigen::Map<VectorX<Scalar>> b() { return {b_.data(), 3 * c_}; }
  Eigen::Map<const VectorX<Scalar>> b() const { return {b_.data(), 3 * c_}; }
  Scalar& friction(Index i) { return friction_[i]; }
  const Scalar& friction(Index i) const { return friction_[i]; }

  /// Computes the scales ρ once D is complete. Returns -1, or the first contact at which impulses
  /// move nothing.
  Index prepare() {
    for (Index i = 0; i < c_; ++i) {
      const ConstMatrix all = static_cast<const FrictionProblem&>(*this).D();
      const Scalar n = all(3 * i, 3 * i);
      const Scalar t1 = all(3 * i + 1, 3 * i + 1), t2 = all(3 * i + 2, 3 * i + 2);
      const bool rubs = Scalar(0) < friction_[i];
      if (!(Scalar(0) < n) || (rubs && (!(Scalar(0) < t1) || !(Scalar(0) < t2)))) return i;
      rho_(0, i) = Scalar(1) / n;
      rho_(1, i) = Scalar(0) < t1 + t2 ? Scalar(Scalar(2) / (t1 + t2)) : Scalar(0);
      Scalar most = n;
      if (most < t1) most = t1;
      if (most < t2) most = t2;
      rho_(2, i) = Scalar(1) / most;
    }
    return -1;
  }
  /// The scales of the normal, of the tangential equations, and of the natural map (kg).
  const Scalar& rho_n(Index i) const { return rho_(0, i); }
  const Scalar& rho_t(Index i) const { return rho_(1, i); }
  const Scalar& rho(Index i) const { return rho_(2, i); }

  /// Writes u = D λ + b.
  void velocities(const VectorX<Scalar>& lambda, VectorX<Scalar>& u) const {
    const ConstMatrix all = D();
    u.head(3 * c_) = b();
    for (Index j = 0; j < 3 * c_; ++j) u.head(3 * c_) += lambda[j] * all.col(j);
  }

  /// Returns the natural map of impulses with the velocities u. `impulse_tolerance` (N s) and
  /// `velocity_tolerance` (m/s) are what a solution may have.
  NaturalResidual<Scalar> residual(const VectorX<Scalar>& lambda, const VectorX<Scalar>& u,
                                   const Scalar& impulse_tolerance,
                                   const Scalar& velocity_tolerance) const;

 private:
  VectorX<Scalar> entries_, b_, friction_;
  Points<Scalar> rho_;
  Index c_ = 0;
};

template <RealScalar Scalar>
NaturalResidual<Scalar> FrictionProblem<Scalar>::residual(const VectorX<Scalar>& lambda,
                                                          const VectorX<Scalar>& u,
                                                          const Scalar& impulse_tolerance,
                                                          const Scalar& velocity_tolerance) const {
  using std::abs;
  using std::sqrt;
  NaturalResidual<Scalar> out;
  // What the terms of D λ may add up to; a sum of n terms has about √n rounding errors of that.
  Scalar largest(0), heaviest(0);
  for (Index j = 0; j < 3 * c_; ++j) {
    if (largest < abs(lambda[j])) largest = abs(lambda[j]);
  }
  for (Index i = 0; i < c_; ++i) {
    if (heaviest < Scalar(1) / rho(i)) heaviest = Scalar(1) / rho(i);
  }
  const Scalar count = sqrt(Scalar(static_cast<double>(3 * c_)));
  const Scalar terms = Scalar(8) * scalar_traits<Scalar>::epsilon();
  for (Index i = 0; i < c_; ++i) {
    const Vector3<Scalar> l = lambda.template segment<3>(3 * i);
    const Vector3<Scalar> v = u.template segment<3>(3 * i);
    const Scalar size = sqrt(natural_map<Scalar>(l, v, friction(i), rho(i)).squaredNorm());
    if (!is_finite(size)) {
      out.impulse = out.velocity = out.excess = scalar_traits<Scalar>::infinity();
      return out;
    }
    Scalar shift(0);
    for (Index k = 0; k < 3; ++k) {
      if (shift < abs(b_[3 * i + k])) shift = abs(b_[3 * i + k]);
    }
    const Scalar rounding = terms * (count * largest * sqrt(heaviest / rho(i)) + shift);
    const Scalar speed = size / rho(i);
    const Scalar one = size / (impulse_tolerance + rho(i) * rounding);
    const Scalar other = speed / (velocity_tolerance + rounding);
    if (out.impulse < size) out.impulse = size;
    if (out.velocity < speed) out.velocity = speed;
    if (out.excess < one) out.excess = one;
    if (out.excess < other) out.excess = other;
  }
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
