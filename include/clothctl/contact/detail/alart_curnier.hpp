#pragma once

// The equations of Alart and Curnier for one contact, and their derivative. With the scales ρ_n,
// ρ_t > 0 (kg), z = λ_n - ρ_n u_n and y = λ_t - ρ_t u_t, λ and u solve the contact exactly where F
// = 0:
//
//   open    z <= 0:                F = λ
//   stick   z > 0, |y| <= μ z:     F_n = ρ_n u_n,   F_t = ρ_t u_t
//   slip    z > 0, |y| > μ z:      F_n = ρ_n u_n,   F_t = λ_t - μ z y/|y|
//
// F is in N s. Its derivative (one of them where F has a kink) is dF = A dλ + G du, in slip with
// e = y/|y| and P = I - e eᵀ
//
//   dF_t = dλ_t - μ e (dλ_n - ρ_n du_n) - μ z/|y| P (dλ_t - ρ_t du_t)
//
// Reference: Alart, Curnier, A mixed formulation for frictional contact problems prone to Newton
// like solution methods, Comput. Methods Appl. Mech. Engrg. 92 (1991).

#include "clothctl/contact/detail/contact_sample.hpp"
#include "clothctl/contact/detail/friction_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// F of a contact.
template <RealScalar Scalar>
struct ContactEquation {
  ContactState branch = ContactState::Open;
  Vector3<Scalar> F;
};

/// dF = A dλ + G du of a contact.
template <RealScalar Scalar>
struct ContactDerivative {
  Matrix3<Scalar> A, G;
};

/// Returns F of a contact with impulse l and velocity u.
template <RealScalar Scalar>
ContactEquation<Scalar> contact_equation(const Vector3<Scalar>& l, const Vector3<Scalar>& u,
                                         const Scalar& mu, const Scalar& rho_n,
                                         const Scalar& rho_t) {
  const Scalar z = l[0] - rho_n * u[0];
  if (!(Scalar(0) < z)) return {ContactState::Open, l};
  const Vector3<Scalar> y(Scalar(0), l[1] - rho_t * u[1], l[2] - rho_t * u[2]);
  const Scalar length = tangential_length<Scalar>(y), limit = mu * z;
  // Without friction the contact slips, even where y is 0.
  if (Scalar(0) < mu && length <= limit)
    return {ContactState::Stick, {rho_n * u[0], rho_t * u[1], rho_t * u[2]}};
  const Scalar share = Scalar(0) < length ? Scalar(limit / length) : Scalar(0);
  return {ContactState::Slip, {rho_n * u[0], l[1] - share * y[1], l[2] - share * y[2]}};
}

/// Returns the derivative in the branch that `contact_equation` found.
template <RealScalar Scalar>
ContactDerivative<Scalar> contact_derivative(ContactState branch, const Vector3<Scalar>& l,
                                             const Vector3<Scalar>& u, const Scalar& mu,
                                             const Scalar& rho_n, const Scalar& rho_t) {
  const Scalar zero(0), one(1);
  ContactDerivative<Scalar> d;
  d.A.setConstant(zero);
  d.G.setConstant(zero);
  if (branch == ContactState::Open) {
    for (int k = 0; k < 3; ++k) d.A(k, k) = one;
    return d;
  }
  d.G(0, 0) = rho_n;
  if (branch == ContactState::Stick) {
    d.G(1, 1) = d.G(2, 2) = rho_t;
    return d;
  }
  d.A(1, 1) = d.A(2, 2) = one;
  const Scalar z = l[0] - rho_n * u[0];
  const Vector3<Scalar> y(zero, l[1] - rho_t * u[1], l[2] - rho_t * u[2]);
  const Scalar length = tangential_length<Scalar>(y);
  if (!(zero < length) || !(zero < mu)) return d;
  const Vector3<Scalar> e = y / length;
  const Scalar share = mu * z / length;
  for (int i = 1; i < 3; ++i) {
    d.A(i, 0) = -mu * e[i];
    d.G(i, 0) = mu * rho_n * e[i];
    for (int j = 1; j < 3; ++j) {
      const Scalar P = (i == j ? one : zero) - e[i] * e[j];
      d.A(i, j) -= share * P;
      d.G(i, j) = share * rho_t * P;
    }
  }
  return d;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
