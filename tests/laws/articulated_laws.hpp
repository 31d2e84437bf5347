#pragma once

// The laws that every robot must obey. Inside a TEST_CASE, call
// check_articulated_laws(model, q, qd, qdd, frames, tolerance) for kinematics and
// check_articulated_dynamics_laws(model, q, qd, qdd, tolerance) for dynamics, with q within limits.
//
//   sizes        there is a limit for each position; advance by zero changes nothing
//   there        advance(q, difference(q, p)) = p, up to the sign of quaternions
//   rotation     RᵀR = 1 and det R = 1
//   derivative   the Jacobian times qd is the velocity of point and frame, to second order
//   const        a second workspace at the same q gives the same bits
//   inverse      forward dynamics undoes inverse dynamics
//   diagonal     with an added diagonal d, forward dynamics solves (M + d) q̈ = τ - C - g
//   symmetric    the columns of M, computed one by one, form a symmetric matrix
//   power        M is positive definite: q̇ᵀ M q̇ > 0

#include <Eigen/Dense>

#include "clothctl/concepts/articulated.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// Checks the laws of kinematics. The steps of finite differences are the cube root of `tolerance`.
template <class Model, class Scalar>
requires clothctl::ArticulatedModel<Model, Scalar>
void check_articulated_laws(const Model& model, const clothctl::VectorX<Scalar>& q,
                            const clothctl::VectorX<Scalar>& other,
                            const clothctl::VectorX<Scalar>& qd, int frames, Scalar tolerance) {
  using Traits = clothctl::articulated_traits<Model>;
  using clothctl::Index;
  using Vector = clothctl::VectorX<Scalar>;
  const Index positions = Traits::nq(model), n = Traits::nv(model);
  const Vector lower = Traits::lower(model), upper = Traits::upper(model);
  REQUIRE(q.size() == positions);
  REQUIRE(qd.size() == n);
  REQUIRE(lower.size() == positions);
  REQUIRE(upper.size() == positions);
  CHECK((lower.array() <= upper.array()).all());

  Vector out = q, step = Vector::Zero(n);
  Traits::advance(model, q, step, out);
  Vector apart(n);
  Traits::difference(model, q, out, apart);
  CHECK(apart.cwiseAbs().maxCoeff() <= tolerance);
  Traits::difference(model, q, other, step);
  Traits::advance(model, q, step, out);
  Traits::difference(model, out, other, apart);
  CHECK(apart.cwiseAbs().maxCoeff() <= tolerance * (Scalar(1) + step.cwiseAbs().maxCoeff()));

  auto work = Traits::make_workspace(model), second = Traits::make_workspace(model);
  clothctl::MatrixX<Scalar> J = clothctl::MatrixX<Scalar>::Zero(6, n);
  clothctl::Matrix3<Scalar> R, R_again, R_after, R_before;
  clothctl::Vector3<Scalar> p, p_again, p_after, p_before;
  const Scalar h = std::cbrt(tolerance);
  for (int frame = 0; frame < frames; ++frame) {
    CAPTURE(frame);
    Traits::forward_kinematics(model, q, work);
    Traits::forward_kinematics(model, q, second);
    Traits::frame_pose(model, work, frame, R, p);
    Traits::frame_pose(model, second, frame, R_again, p_again);
    CHECK((R == R_again && p == p_again));
    CHECK((R.transpose() * R - clothctl::Matrix3<Scalar>::Identity()).cwiseAbs().maxCoeff() <=
          tolerance);
    CHECK(R.determinant() > Scalar(0));

    const clothctl::Vector3<Scalar> local(Scalar(0.03), Scalar(-0.02), Scalar(0.05));
    const clothctl::Vector3<Scalar> x = p + R * local;
    Traits::point_jacobian(model, work, frame, x, J);
    const Eigen::Matrix<Scalar, 6, 1> twist = J * qd;
    Traits::advance(model, q, Vector(h * qd), out);
    Traits::forward_kinematics(model, out, work);
    Traits::frame_pose(model, work, frame, R_after, p_after);
    Traits::advance(model, q, Vector(-h * qd), out);
    Traits::forward_kinematics(model, out, work);
    Traits::frame_pose(model, work, frame, R_before, p_before);
    const clothctl::Vector3<Scalar> velocity =
        ((p_after + R_after * local) - (p_before + R_before * local)) / (Scalar(2) * h);
    const clothctl::Matrix3<Scalar> turn = (R_after - R_before) * R.transpose() / (Scalar(2) * h);
    const clothctl::Vector3<Scalar> angular(turn(2, 1), turn(0, 2), turn(1, 0));
    // The error of central differences is h² times the third derivative, which grows with the cube
    // of the speed.
    const Scalar speed = qd.cwiseAbs().sum();
    const Scalar allowed = h * h * (Scalar(1) + speed * speed * speed);
    CHECK((velocity - twist.template head<3>()).cwiseAbs().maxCoeff() <= allowed);
    CHECK((angular - twist.template tail<3>()).cwiseAbs().maxCoeff() <= allowed);
  }
}

/// Checks the laws of dynamics. Errors are relative.
template <class Model, class Scalar>
requires clothctl::ArticulatedDynamics<Model, Scalar>
void check_articulated_dynamics_laws(const Model& model, const clothctl::VectorX<Scalar>& q,
                                     const clothctl::VectorX<Scalar>& qd,
                                     const clothctl::VectorX<Scalar>& qdd, Scalar tolerance) {
  using Traits = clothctl::articulated_traits<Model>;
  using clothctl::Index;
  using Vector = clothctl::VectorX<Scalar>;
  const Index n = Traits::nv(model);
  const Vector limits = Traits::effort_limits(model), none = Vector::Zero(n);
  REQUIRE(limits.size() == n);
  CHECK(limits.minCoeff() >= Scalar(0));
  auto work = Traits::make_workspace(model);
  Traits::forward_kinematics(model, q, work);

  Vector torques = none, answer = none, bias = none, rest = none;
  Traits::inverse_dynamics(model, qd, none, work, bias);
  Traits::inverse_dynamics(model, none, none, work, rest);
  clothctl::MatrixX<Scalar> M(n, n);
  for (Index i = 0; i < n; ++i) {
    Traits::inverse_dynamics(model, none, Vector(Vector::Unit(n, i)), work, torques);
    M.col(i) = torques - rest;
  }
  const Scalar size = M.cwiseAbs().maxCoeff();
  CHECK((M - M.transpose()).cwiseAbs().maxCoeff() <= tolerance * size);
  CHECK(qd.dot(M * qd) > Scalar(0));
  Traits::inverse_dynamics(model, qd, qdd, work, torques);
  CHECK((M * qdd + bias - torques).cwiseAbs().maxCoeff() <=
        tolerance * (torques.cwiseAbs().maxCoeff() + size));

  // Compared as torques: if M is ill-conditioned, accelerations have no correct digits.
  REQUIRE(Traits::forward_dynamics(model, qd, torques, none, work, answer) < 0);
  CHECK((M * (answer - qdd)).cwiseAbs().maxCoeff() <=
        tolerance * (torques.cwiseAbs().maxCoeff() + size));
  const Vector diagonal = (qd.array().abs() + Scalar(0.1)).matrix();
  REQUIRE(Traits::forward_dynamics(model, qd, torques, diagonal, work, answer) < 0);
  const Vector left = M * answer + diagonal.cwiseProduct(answer) + bias - torques;
  CHECK(left.cwiseAbs().maxCoeff() <= tolerance * (torques.cwiseAbs().maxCoeff() + size));
}

}  // namespace clothctl_test
