#pragma once

// What a system of rigid bodies holds: the bodies as the solvers see them, contacts with their
// memory, and joints with their rows. A joint of n rows (ball 3, hinge 5, fixed 6) is
//
//   J v + β e/h + β c/h² μ = 0,     v = (v_A, w_A, v_B, w_B),  μ the impulses (N s, N m s)
//
// with the error e (m, rad), the compliance c (m/N, rad/(N m)) and the share β of the error that a
// step removes. With the anchors x_A, x_B and the arms r_A, r_B from the centres of mass, the error
// of a ball joint is x_A - x_B and its rows are (1, -[r_A], -1, [r_B]). A hinge adds the two turns
// across its axis, (0, t, 0, -t) with the error t·(a_B × a_A), t ⟂ a_B. A fixed joint adds all
// three turns, with the error log(R_A R_A0ᵀ R_B0 R_Bᵀ).

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/contact/contact_solver.hpp"
#include "clothctl/math/rotation.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// How two bodies hang together.
enum class JointKind {
  /// One point of each stays at the same place.
  Ball,
  /// A ball joint that turns about one axis only.
  Hinge,
  /// They move as one.
  Fixed
};

/// A contact of a body, as it was in the last step.
template <RealScalar Scalar>
struct RigidContact {
  /// The body A, and the body B; -1 - k for obstacle k.
  int a = -1, b = -1;
  /// Where, m (world).
  Vector3<Scalar> position = Vector3<Scalar>::Constant(Scalar(0));
  /// Steps since it was first seen.
  int age = 0;
  /// What touches what; see BodyContactPoint.
  std::uint32_t feature = 0;
  /// Restitution coefficient of the pair.
  Scalar restitution = Scalar(0);
  /// Gap at the start of the step, m; negative where they overlap.
  Scalar gap = Scalar(0);
  /// Normal from B to A, friction, the impulse on A (N s), its state, and its memory.
  ContactSample<Scalar> sample;

  /// Whether it transmitted an impulse.
  bool touches() const { return sample.state != ContactState::Open; }
};

namespace detail {

/// A body as the solvers see it: 0 masses for what no impulse moves.
template <RealScalar Scalar>
struct SolverBody {
  Scalar lightness = Scalar(0);  // 1/m
  Matrix3<Scalar> inverse = Matrix3<Scalar>::Constant(Scalar(0));
  Vector3<Scalar> x = Vector3<Scalar>::Constant(Scalar(0)), v = x, w = x;

  /// Velocity of a point at the arm r.
  Vector3<Scalar> at(const Vector3<Scalar>& r) const { return v + w.cross(r); }
  /// Takes the impulse p at the arm r and the angular impulse q.
  void push(const Vector3<Scalar>& p, const Vector3<Scalar>& r, const Vector3<Scalar>& q) {
    v += lightness * p;
    const Vector3<Scalar> moment = r.cross(p) + q;
    w += inverse * moment;
  }
  /// Adds how the point at r_i answers to an impulse at r_j, times `share`.
  void add_mobility(const Vector3<Scalar>& r_i, const Vector3<Scalar>& r_j, const Scalar& share,
                    Matrix3<Scalar>& W) const {
    const Matrix3<Scalar> spin = inverse * cross_matrix<Scalar>(r_j);
    W -= share * (cross_matrix<Scalar>(r_i) * spin);
    for (int k = 0; k < 3; ++k) W(k, k) += share * lightness;
  }
};

/// Most rows of a joint.
inline constexpr int kJointRows = 6;

/// A joint with its rows of this step.
template <RealScalar Scalar>
struct JointState {
  using Rows = DenseMatrix<Scalar, kJointRows, 3>;
  using Column = DenseMatrix<Scalar, kJointRows, 1>;
  using Block = DenseMatrix<Scalar, kJointRows, kJointRows>;

  JointKind kind = JointKind::Ball;
  int a = -1, b = -1;  // b: -1 for the world
  Scalar compliance = Scalar(0);
  /// Anchors and axes in body axes, and R_Aᵀ R_B at the start.
  Vector3<Scalar> anchor_a, anchor_b, axis_a, axis_b;
  Matrix3<Scalar> R_a_b = Matrix3<Scalar>::Identity();
  Column impulse = Column::Constant(Scalar(0));

  /// Of this step: J = (point, turn_a, -point, -turn_b), bias β e/h, softness β c/h².
  Rows point = Rows::Constant(Scalar(0)), turn_a = point, turn_b = point;
  Column bias = Column::Constant(Scalar(0));
  Scalar softness = Scalar(0);

  int rows() const { return kind == JointKind::Ball ? 3 : (kind == JointKind::Hinge ? 5 : 6); }

  /// Computes the rows at the poses of A and B. `beta` is the share of the error that a step of
  /// `h` removes; the error counts up to `reach` (m, rad).
  void update(const SolverBody<Scalar>& A, const Matrix3<Scalar>& R_a, const SolverBody<Scalar>& B,
              const Matrix3<Scalar>& R_b, const Scalar& h, const Scalar& beta,
              const Scalar& reach) {
    point.setConstant(Scalar(0));
    turn_a.setConstant(Scalar(0));
    turn_b.setConstant(Scalar(0));
    const Vector3<Scalar> r_a = R_a * anchor_a, r_b = R_b * anchor_b;
    Column error = Column::Constant(Scalar(0));
    error.template head<3>() = A.x + r_a - B.x - r_b;
    for (int k = 0; k < 3; ++k) point(k, k) = Scalar(1);
    turn_a.template topRows<3>() = -cross_matrix<Scalar>(r_a);
    turn_b.template topRows<3>() = -cross_matrix<Scalar>(r_b);
    if (kind == JointKind::Hinge) {
      const Vector3<Scalar> along_a = R_a * axis_a, along_b = R_b * axis_b;
      const Vector3<Scalar> off = along_b.cross(along_a);
      const Vector3<Scalar> t = unit_orthogonal<Scalar>(along_b), s = along_b.cross(t);
      turn_a.row(3) = turn_b.row(3) = t.transpose();
      turn_a.row(4) = turn_b.row(4) = s.transpose();
      error[3] = t.dot(off);
      error[4] = s.dot(off);
    }
    if (kind == JointKind::Fixed) {
      const Matrix3<Scalar> held = R_a_b * R_b.transpose(), off = R_a * held;
      error.template tail<3>() = rotation_log<Scalar>(off);
      for (int k = 0; k < 3; ++k) turn_a(3 + k, k) = turn_b(3 + k, k) = Scalar(1);
    }
    for (int k = 0; k < kJointRows; ++k) {
      if (reach < error[k]) error[k] = reach;
      if (error[k] < -reach) error[k] = -reach;
    }
    bias = (beta / h) * error;
    softness = beta * compliance / (h * h);
  }
  /// J v.
  Column velocity(const SolverBody<Scalar>& A, const SolverBody<Scalar>& B) const {
    const Vector3<Scalar> v = A.v - B.v;
    return point * v + turn_a * A.w - turn_b * B.w;
  }
  /// Adds M⁻¹ Jᵀ μ to the velocities.
  void push(const Column& mu, SolverBody<Scalar>& A, SolverBody<Scalar>& B) const {
    const Vector3<Scalar> p = point.transpose() * mu;
    const Vector3<Scalar> q_a = turn_a.transpose() * mu, q_b = turn_b.transpose() * mu;
    A.v += A.lightness * p;
    B.v -= B.lightness * p;
    A.w += A.inverse * q_a;
    B.w -= B.inverse * q_b;
  }
  /// J_i M⁻¹ J_jᵀ of two joints, as far as body `n` has it.
  static void add_coupling(const JointState& i, const JointState& j, int n,
                           const SolverBody<Scalar>& body, Block& out) {
    for (const bool on_a : {true, false}) {
      if (n < 0 || (on_a ? i.a : i.b) != n) continue;
      for (const bool of_a : {true, false}) {
        if ((of_a ? j.a : j.b) != n) continue;
        const Scalar sign = on_a == of_a ? Scalar(1) : Scalar(-1);
        const Rows& left = on_a ? i.turn_a : i.turn_b;
        const Rows& right = of_a ? j.turn_a : j.turn_b;
        const Rows turned = left * body.inverse;
        out += (sign * body.lightness) * (i.point * j.point.transpose());
        out += sign * (turned * right.transpose());
      }
    }
  }
};

}  // namespace detail

/// The whole state of a system of rigid bodies, as a value: with the same bodies, obstacles and
/// joints, a run that starts from it has the same bits.
template <RealScalar Scalar>
struct RigidBodiesState {
  /// One body.
  struct Body {
    /// Pose and velocities.
    RigidMotion<Scalar> motion;
    /// How long it has been still, s.
    Scalar still = Scalar(0);
    /// Of sleeping bodies: the smallest number of a body of its island; -1 if awake.
    int asleep = -1;
  };
  /// The bodies, by their numbers.
  std::vector<Body> bodies;
  /// The contacts of the last step, in ascending order of bodies.
  std::vector<RigidContact<Scalar>> contacts;
  /// The impulses of the joints in the last step.
  std::vector<DenseMatrix<Scalar, detail::kJointRows, 1>> joints;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
