#pragma once

// The rotation of a free rigid body during a step of length h, with Euler's equations in the body's
// frame by the implicit midpoint rule:
//
//   I (Ω' - Ω) + k Ω̄ × I Ω̄ = 0,    Ω̄ = (Ω + Ω')/2,    R' = R cay(k Ω̄)
//
// cay(x) turns about x by the angle 2 atan(|x|/2). The rule keeps two quadratic forms: the energy
// Ω·IΩ/2 and, in world axes, the angular momentum R I Ω. It does so for any k; with k = 2/|Ω|
// tan(h|Ω|/2) a body that spins about a principal axis turns by exactly h|Ω|. Newton's method finds
// Ω'; where it does not, at more than about two radians a step, the body turns by h Ω, keeps its
// momentum, and never gains energy.

#include <cmath>

#include "clothctl/core/types.hpp"
#include "clothctl/math/rotation.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Solves A x = r for a 3×3 block by Cramer's rule. Returns false when A is singular.
template <RealScalar Scalar>
bool solve_3x3(const Matrix3<Scalar>& A, const Vector3<Scalar>& r, Vector3<Scalar>& x) {
  const Vector3<Scalar> a = A.col(0), b = A.col(1), c = A.col(2);
  const Vector3<Scalar> bc = b.cross(c), ca = c.cross(a), ab = a.cross(b);
  const Scalar det = a.dot(bc);
  if (!is_finite(det) || (!(Scalar(0) < det) && !(det < Scalar(0)))) return false;
  x = Vector3<Scalar>(bc.dot(r), ca.dot(r), ab.dot(r)) / det;
  return all_finite(x);
}

/// The step length k of the midpoint rule.
template <RealScalar Scalar>
Scalar midpoint_length(const Scalar& h, const Scalar& speed) {
  using std::cos;
  using std::sin;
  const Scalar half = Scalar(0.5) * h * speed;
  if (half < Scalar(1e-3)) return h * (Scalar(1) + half * half / Scalar(3));
  const Scalar angle = half < Scalar(1.2) ? half : Scalar(1.2);
  return Scalar(2) * sin(angle) / (speed * cos(angle));
}

/// Finds Ω' by Newton's method. Returns whether it was found.
template <RealScalar Scalar>
bool midpoint_spin(const Matrix3<Scalar>& inertia, const Vector3<Scalar>& spin, const Scalar& k,
                   Vector3<Scalar>& next) {
  next = spin;
  const Vector3<Scalar> start = inertia * spin;
  const Scalar scale = start.squaredNorm();
  const Scalar fine = Scalar(16) * scalar_traits<Scalar>::epsilon();
  for (int i = 0; i < 12; ++i) {
    const Vector3<Scalar> middle = Scalar(0.5) * (spin + next), L = inertia * middle;
    const Vector3<Scalar> F = inertia * next - start + k * middle.cross(L);
    if (F.squaredNorm() <= fine * fine * scale) return true;
    const Matrix3<Scalar> turn = cross_matrix<Scalar>(middle) * inertia;
    const Matrix3<Scalar> J = inertia + Scalar(0.5) * k * (turn - cross_matrix<Scalar>(L));
    Vector3<Scalar> step;
    if (!solve_3x3<Scalar>(J, F, step)) return false;
    next -= step;
    if (step.squaredNorm() <= fine * fine * next.squaredNorm()) return true;
  }
  return false;
}

/// Moves the orientation R and the angular velocity w (world axes) by a step of `h` (s). `inertia`
/// and its inverse are in body axes.
template <RealScalar Scalar>
void rotate_freely(const Matrix3<Scalar>& inertia, const Matrix3<Scalar>& inverse, const Scalar& h,
                   Matrix3<Scalar>& R, Vector3<Scalar>& w) {
  using std::sqrt;
  const Vector3<Scalar> spin = R.transpose() * w;
  const Vector3<Scalar> momentum = inertia * spin;
  const Scalar square = spin.squaredNorm(), energy = momentum.dot(spin);
  if (!(Scalar(0) < square)) return;
  const Scalar k = midpoint_length<Scalar>(h, sqrt(square));
  Vector3<Scalar> next;
  Vector3<Scalar> turn = h * spin;
  if (midpoint_spin<Scalar>(inertia, spin, k, next)) {
    const Vector3<Scalar> x = Scalar(0.5) * k * (spin + next);
    // cay(x) as a quaternion is (1, x/2), of any length.
    const Matrix3<Scalar> C = rotation_from_quaternion<Scalar>(
        Scalar(1), Scalar(0.5) * x[0], Scalar(0.5) * x[1], Scalar(0.5) * x[2]);
    R = R * C;
    w = R * next;
    return;
  }
  const Vector3<Scalar> L = R * momentum;
  R = R * rotation_exp<Scalar>(turn);
  const Vector3<Scalar> body = R.transpose() * L;
  next = inverse * body;
  const Scalar then = body.dot(next);
  if (energy < then) next *= sqrt(energy / then);
  w = R * next;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
