#pragma once

// Articulated bodies: the accelerations that torques cause, with a diagonal d ≥ 0 added to the mass matrix,
//
//   (M(q) + diag d) q̈ = τ - C(q, q̇) - g(q)
//
// in one pass up and one down (motion.hpp for what a body knows). With the articulated inertia (N, F) = [A B; Bᵀ C] (α, a_o) +
// p of a body and its joint's direction S:
//
//   U = [A B; Bᵀ C] S,   D = Sᵀ U + d,   u = τ - Sᵀ p
//   [A B; Bᵀ C] -= U D⁻¹ Uᵀ,   p += [A B; Bᵀ C] c + U D⁻¹ (u)        then shifted by r and added to the parent:
//   B' = B + [r] C,   A' = A - B' [r] + [r] Bᵀ,   N' = N + r × F
//   q̈ = D⁻¹ (u - Uᵀ a'),   a' = shifted parent's + c
//
// Where joints share coordinates, M is made and factored instead. Reference: Featherstone (2008) §7.3; the diagonal: Tan, Liu,
// Turk, Stable Proportional-Derivative Controllers (2011), there by a dense solve.

#include <cassert>
#include <cmath>
#include <string_view>
#include <vector>

#include "clothctl/math/small_cholesky.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"
#include "clothctl/robot/mass_matrix.hpp"

namespace clothctl::robot {

/// How a solve for accelerations ended.
enum class DynamicsStatus {
  /// Accelerations are finite. Use them.
  Solved,
  /// Positions, velocities or torques hold NaN or an infinity; the accelerations are not to be used. Mend the input.
  InvalidInput,
  /// A joint moves nothing that has inertia, and has no diagonal: the report names its body. Give the link an inertia or the
  /// joint a diagonal.
  NoInertia
};

/// Names a status.
constexpr std::string_view to_string(DynamicsStatus status) {
  switch (status) {
    case DynamicsStatus::Solved: return "solved";
    case DynamicsStatus::InvalidInput: return "invalid_input";
    case DynamicsStatus::NoInertia: return "no_inertia";
  }
  return "unknown";
}

/// What a solve for accelerations answers.
struct DynamicsReport {
  /// How it ended.
  DynamicsStatus status = DynamicsStatus::Solved;
  /// With NoInertia the body whose joint it is, else -1.
  int body = -1;
};

namespace detail {

/// Articulated inertia and what the pass down needs.
template <RealScalar Scalar>
struct Articulated {
  Matrix3<Scalar> A, B, C;
  Vector3<Scalar> N, F;        // bias
  Vector3<Scalar> U_N, U_F;    // of a joint with one coordinate
  Scalar inverse, u;           // 1/D, and u
  Vector3<Scalar> turn, move;  // accelerations
};

/// x ← D⁻¹ x for a symmetric positive definite 6×6 D, which is overwritten. Answers false when it is not definite.
template <RealScalar Scalar>
bool solve_six(Eigen::Matrix<Scalar, 6, 6>& D, Eigen::Matrix<Scalar, 6, 7>& X) {
  using std::sqrt;
  for (int j = 0; j < 6; ++j) {
    Scalar pivot = D(j, j);
    for (int k = 0; k < j; ++k) pivot -= D(j, k) * D(j, k);
    if (!(pivot > Scalar(0))) return false;
    D(j, j) = sqrt(pivot);
    for (int i = j + 1; i < 6; ++i) {
      Scalar value = D(i, j);
      for (int k = 0; k < j; ++k) value -= D(i, k) * D(j, k);
      D(i, j) = value / D(j, j);
    }
  }
  for (int c = 0; c < 7; ++c) {
    for (int i = 0; i < 6; ++i) {
      for (int k = 0; k < i; ++k) X(i, c) -= D(i, k) * X(k, c);
      X(i, c) /= D(i, i);
    }
    for (int i = 5; i >= 0; --i) {
      for (int k = i + 1; k < 6; ++k) X(i, c) -= D(k, i) * X(k, c);
      X(i, c) /= D(i, i);
    }
  }
  return true;
}

}  // namespace detail

/// Memory of `forward_dynamics`.
template <RealScalar Scalar>
struct ForwardDynamicsWorkspace {
  /// Velocities and inertias.
  Motion<Scalar> motion;
  /// Articulated inertias.
  std::vector<detail::Articulated<Scalar>> articulated;
  /// U of each free joint.
  std::vector<Eigen::Matrix<Scalar, 6, 6>> free_U;
  /// D⁻¹ (Uᵀ, u) of each free joint.
  std::vector<Eigen::Matrix<Scalar, 6, 7>> free_solved;
  /// For each body the place in the lists above, or -1.
  std::vector<int> free_place;
  /// Memory of `inverse_dynamics`, for coupled trees.
  InverseDynamicsWorkspace<Scalar> inverse;
  /// Memory of `mass_matrix`, for coupled trees.
  MassMatrixWorkspace<Scalar> composite;
  /// The mass matrix of a coupled tree, else empty.
  MatrixX<Scalar> M;
  /// What velocities and gravity take.
  VectorX<Scalar> bias;

  /// Makes room for a tree. Allocates.
  explicit ForwardDynamicsWorkspace(const Tree<Scalar>& tree)
      : motion(tree), articulated(tree.bodies().size()), free_place(tree.bodies().size(), -1), inverse(tree), composite(tree) {
    int count = 0;
    for (std::size_t i = 0; i < tree.bodies().size(); ++i) {
      if (tree.bodies()[i].type == JointType::Free) free_place[i] = count++;
    }
    free_U.resize(static_cast<std::size_t>(count));
    free_solved.resize(static_cast<std::size_t>(count));
    const Index n = tree.coupled() ? tree.velocities() : 0;
    M.setZero(n, n);
    bias.setZero(tree.velocities());
  }
};

namespace detail {

/// M + diag d by Cholesky, for trees whose joints share coordinates.
template <RealScalar Scalar>
DynamicsReport coupled_dynamics(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics,
                                const Eigen::Ref<const VectorX<Scalar>>& qd, const Eigen::Ref<const VectorX<Scalar>>& torques,
                                const Eigen::Ref<const VectorX<Scalar>>& diagonal, const Vector3<Scalar>& gravity,
                                ForwardDynamicsWorkspace<Scalar>& work, Eigen::Ref<VectorX<Scalar>> qdd) {
  MatrixX<Scalar>& M = work.M;
  qdd.setConstant(Scalar(0));
  inverse_dynamics<Scalar>(tree, kinematics, qd, qdd, gravity, work.inverse, work.bias);
  mass_matrix<Scalar>(tree, kinematics, work.composite, M);
  if (diagonal.size() > 0) M.diagonal() += diagonal;
  qdd = torques - work.bias;
  const Index failed = clothctl::detail::factor_small<Scalar>(M);
  for (std::size_t i = 0; failed >= 0 && i < tree.bodies().size(); ++i) {
    const Body<Scalar>& body = tree.bodies()[i];
    const Index last = body.velocity + (body.type == JointType::Free ? 5 : 0);
    if (body.velocity <= failed && failed <= last) return {DynamicsStatus::NoInertia, static_cast<int>(i)};
  }
  clothctl::detail::solve_small<Scalar>(M, qdd);
  return {};
}

/// Takes one joint's freedom out of its body's articulated inertia.
template <RealScalar Scalar>
bool release_joint(const Body<Scalar>& body, const Vector3<Scalar>& axis, const BodyMotion<Scalar>& own, const Scalar& torque,
                   const Scalar& diagonal, Articulated<Scalar>& a) {
  const bool turns = body.type == JointType::Revolute;
  if (turns) {
    a.U_N.noalias() = a.A * axis;
    a.U_F.noalias() = a.B.transpose() * axis;
  } else {
    a.U_N.noalias() = a.B * axis;
    a.U_F.noalias() = a.C * axis;
  }
  const Scalar D = axis.dot(turns ? a.U_N : a.U_F) + diagonal;
  if (!(D > Scalar(0))) return false;
  a.inverse = Scalar(1) / D;
  a.u = torque - axis.dot(turns ? a.N : a.F);
  const Vector3<Scalar> share_N = a.inverse * a.U_N, share_F = a.inverse * a.U_F;
  a.A.noalias() -= share_N * a.U_N.transpose();
  a.B.noalias() -= share_N * a.U_F.transpose();
  a.C.noalias() -= share_F * a.U_F.transpose();
  a.N += a.A * own.c_turn + a.B * own.c_move + a.u * share_N;
  a.F += a.B.transpose() * own.c_turn + a.C * own.c_move + a.u * share_F;
  return true;
}

/// The same for a free joint, with six coordinates.
template <RealScalar Scalar>
bool release_free(const Matrix3<Scalar>& axes, const BodyMotion<Scalar>& own, const Eigen::Ref<const VectorX<Scalar>>& torques,
                  const Eigen::Ref<const VectorX<Scalar>>& diagonal, Index at, Eigen::Matrix<Scalar, 6, 6>& U,
                  Eigen::Matrix<Scalar, 6, 7>& solved, Articulated<Scalar>& a) {
  U.template block<3, 3>(0, 0).noalias() = a.B * axes;  // rows: moment, force
  U.template block<3, 3>(3, 0).noalias() = a.C * axes;
  U.template block<3, 3>(0, 3).noalias() = a.A * axes;
  U.template block<3, 3>(3, 3).noalias() = a.B.transpose() * axes;
  Eigen::Matrix<Scalar, 6, 6> D;
  D.template topRows<3>().noalias() = axes.transpose() * U.template bottomRows<3>();
  D.template bottomRows<3>().noalias() = axes.transpose() * U.template topRows<3>();
  for (int k = 0; k < 6 && diagonal.size() > 0; ++k) D(k, k) += diagonal[at + k];
  solved.template leftCols<6>() = U.transpose();
  solved.template block<3, 1>(0, 6) = torques.template segment<3>(at) - axes.transpose() * a.F;
  solved.template block<3, 1>(3, 6) = torques.template segment<3>(at + 3) - axes.transpose() * a.N;
  if (!solve_six(D, solved)) return false;
  const Eigen::Matrix<Scalar, 6, 6> taken = U * solved.template leftCols<6>();
  const Eigen::Matrix<Scalar, 6, 1> push = U * solved.col(6);
  a.A -= taken.template block<3, 3>(0, 0);
  a.B -= taken.template block<3, 3>(0, 3);
  a.C -= taken.template block<3, 3>(3, 3);
  a.N += a.A * own.c_turn + a.B * own.c_move + push.template head<3>();
  a.F += a.B.transpose() * own.c_turn + a.C * own.c_move + push.template tail<3>();
  return true;
}

/// Adds a body's articulated inertia to its parent's.
template <RealScalar Scalar>
void hand_down(const Vector3<Scalar>& r, const Articulated<Scalar>& a, Articulated<Scalar>& parent) {
  const Matrix3<Scalar> B = a.B + cross_columns<Scalar>(r, a.C);
  for (int k = 0; k < 3; ++k) {
    const Vector3<Scalar> row = B.row(k).transpose();
    const Vector3<Scalar> other = a.B.row(k).transpose();
    parent.A.row(k) -= row.cross(r).transpose();  // (B' [r])
    parent.A.col(k) += r.cross(other);            // ([r] Bᵀ)
  }
  parent.A += a.A;
  parent.B += B;
  parent.C += a.C;
  parent.F += a.F;
  parent.N += a.N + r.cross(a.F);
}

}  // namespace detail

/// Writes the accelerations that torques (N, N m) cause at velocities qd where `kinematics` stands; `diagonal` (velocities, or
/// empty for none) is added to the mass matrix. External forces f at a point join the torques as Jᵀ f. Never allocates.
/// Complexity: O(bodies); O(velocities³) for coupled trees.
template <RealScalar Scalar>
[[nodiscard]] DynamicsReport forward_dynamics(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics,
                                              const typename Tree<Scalar>::VectorView& qd,
                                              const typename Tree<Scalar>::VectorView& torques,
                                              const typename Tree<Scalar>::VectorView& diagonal, const Vector3<Scalar>& gravity,
                                              ForwardDynamicsWorkspace<Scalar>& work, Eigen::Ref<VectorX<Scalar>> qdd) {
  assert(qd.size() == tree.velocities() && torques.size() == tree.velocities() && qdd.size() == tree.velocities());
  assert(diagonal.size() == 0 || diagonal.size() == tree.velocities());
  const auto refuse = [&](int body) -> DynamicsReport {
    const bool finite = all_finite(qd) && all_finite(torques) && all_finite(diagonal);
    bool placed = true;
    for (const BodyPlace<Scalar>& place : kinematics.places) placed = placed && all_finite(place.R) && all_finite(place.p);
    return finite && placed ? DynamicsReport{DynamicsStatus::NoInertia, body}
                            : DynamicsReport{DynamicsStatus::InvalidInput, -1};
  };
  if (tree.coupled()) {
    const DynamicsReport report = detail::coupled_dynamics<Scalar>(tree, kinematics, qd, torques, diagonal, gravity, work, qdd);
    if (report.status == DynamicsStatus::Solved && all_finite(qdd)) return report;
    return refuse(report.body);
  }
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  detail::place_inertias(tree, kinematics, work.motion);
  detail::place_velocities<Scalar>(tree, kinematics, qd, work.motion);
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const detail::BodyMotion<Scalar>& own = work.motion.bodies[i];
    detail::Articulated<Scalar>& a = work.articulated[i];
    a.A = own.I;
    a.B = detail::skew(own.h);
    a.C = bodies[i].inertia.mass * Matrix3<Scalar>::Identity();
    a.N = own.bias_N;
    a.F = own.bias_F;
  }
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    const detail::BodyMotion<Scalar>& own = work.motion.bodies[i];
    detail::Articulated<Scalar>& a = work.articulated[i];
    bool released;
    if (body.type != JointType::Free) {
      const Scalar more = diagonal.size() > 0 ? diagonal[body.velocity] : Scalar(0);
      released = detail::release_joint<Scalar>(body, place.R.col(2), own, torques[body.velocity], more, a);
    } else {
      const std::size_t k = static_cast<std::size_t>(work.free_place[i]);
      released = detail::release_free<Scalar>(detail::outer_axes(kinematics, body), own, torques, diagonal, body.velocity,
                                              work.free_U[k], work.free_solved[k], a);
    }
    if (!released) return refuse(static_cast<int>(i));
    if (body.parent >= 0) {
      detail::hand_down<Scalar>(place.from_parent, a, work.articulated[static_cast<std::size_t>(body.parent)]);
    }
  }
  const Vector3<Scalar> zero = Vector3<Scalar>::Constant(Scalar(0)), up = -gravity;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const Body<Scalar>& body = bodies[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    const detail::BodyMotion<Scalar>& own = work.motion.bodies[i];
    detail::Articulated<Scalar>& a = work.articulated[i];
    const detail::Articulated<Scalar>& parent = work.articulated[static_cast<std::size_t>((std::max)(body.parent, 0))];
    const Vector3<Scalar>&turn_p = body.parent < 0 ? zero : parent.turn, &move_p = body.parent < 0 ? up : parent.move;
    a.turn = turn_p + own.c_turn;
    a.move = move_p + turn_p.cross(place.from_parent) + own.c_move;
    if (body.type == JointType::Free) {
      const Eigen::Matrix<Scalar, 6, 7>& solved = work.free_solved[static_cast<std::size_t>(work.free_place[i])];
      const Matrix3<Scalar> axes = detail::outer_axes(kinematics, body);
      auto own_qdd = qdd.template segment<6>(body.velocity);
      own_qdd = solved.col(6) - solved.template leftCols<3>() * a.turn - solved.template block<6, 3>(0, 3) * a.move;
      a.move += axes * own_qdd.template head<3>();
      a.turn += axes * own_qdd.template tail<3>();
      continue;
    }
    const Scalar acceleration = a.inverse * (a.u - a.U_N.dot(a.turn) - a.U_F.dot(a.move));
    qdd[body.velocity] = acceleration;
    (body.type == JointType::Revolute ? a.turn : a.move) += acceleration * place.R.col(2);
  }
  return all_finite(qdd) ? DynamicsReport{} : refuse(-1);
}

}  // namespace clothctl::robot
