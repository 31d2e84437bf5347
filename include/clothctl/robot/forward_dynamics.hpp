#pragma once

// Articulated bodies: the accelerations that torques cause, with a diagonal d ≥ 0 added to the mass matrix,
//
//   (M(q) + diag d) q̈ = τ - C(q, q̇) - g(q)
//
// in a pass up (motion.hpp: the forces p that q̈ = 0 takes), one down and one up again, which finds the accelerations (α, A)
// that q̈ adds. With the articulated inertia (N, F) = [A B; Bᵀ C] (α, A) + p of a body and its joint's direction S:
//
//   U = [A B; Bᵀ C] S,   D = Sᵀ U + d,   u = τ - Sᵀ p
//   [A B; Bᵀ C] -= U D⁻¹ Uᵀ,   p += U D⁻¹ u               then shifted by r and added to the parent:
//   B' = B + [r] C,   A' = A - B' [r] + [r] Bᵀ,   N' = N + r × F
//   q̈ = D⁻¹ (u - Uᵀ a),   a = shifted parent's
//
// Both B and Bᵀ are kept: columns are then all that is added and multiplied, each a register with room for four numbers.
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

/// Three numbers and a zero: they fill registers, which three do not.
template <RealScalar Scalar>
using Lanes = Eigen::Matrix<Scalar, 4, 1>;

/// The unit vector of axis k.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE Lanes<Scalar> lane(int k) {
  return {Scalar(k == 0 ? 1 : 0), Scalar(k == 1 ? 1 : 0), Scalar(k == 2 ? 1 : 0), Scalar(0)};
}

/// A 3×3 matrix by its columns. Sums are made term by term: compilers keep those in registers.
template <RealScalar Scalar>
struct LaneMatrix {
  Lanes<Scalar> x, y, z;

  LaneMatrix() = default;

  /// 0.
  void clear() { x = y = z = Lanes<Scalar>::Constant(Scalar(0)); }

  /// Σ += M v.
  template <class Vector>
  EIGEN_ALWAYS_INLINE void add_product(const Vector& v, Lanes<Scalar>& sum) const {
    sum += v[0] * x;
    sum += v[1] * y;
    sum += v[2] * z;
  }
  /// M v.
  template <class Vector>
  EIGEN_ALWAYS_INLINE Lanes<Scalar> operator*(const Vector& v) const {
    Lanes<Scalar> product = v[0] * x;
    product += v[1] * y;
    product += v[2] * z;
    return product;
  }
  /// += B.
  EIGEN_ALWAYS_INLINE LaneMatrix& operator+=(const LaneMatrix& B) {
    x += B.x;
    y += B.y;
    z += B.z;
    return *this;
  }
  /// += v uᵀ.
  template <class Vector>
  EIGEN_ALWAYS_INLINE void add_outer(const Lanes<Scalar>& v, const Vector& u) {
    x += u[0] * v;
    y += u[1] * v;
    z += u[2] * v;
  }
  /// += [r] B.
  EIGEN_ALWAYS_INLINE void add_products(const LaneMatrix& cross, const LaneMatrix& B) {
    cross.add_product(B.x, x);
    cross.add_product(B.y, y);
    cross.add_product(B.z, z);
  }
  /// -= B [r].
  EIGEN_ALWAYS_INLINE void subtract_cross(const LaneMatrix& B, const Vector3<Scalar>& r) {
    x += r[1] * B.z;
    x -= r[2] * B.y;
    y += r[2] * B.x;
    y -= r[0] * B.z;
    z += r[0] * B.y;
    z -= r[1] * B.x;
  }
  /// += [v].
  EIGEN_ALWAYS_INLINE void add_cross(const Vector3<Scalar>& v) {
    x += v[2] * lane<Scalar>(1);
    x -= v[1] * lane<Scalar>(2);
    y += v[0] * lane<Scalar>(2);
    y -= v[2] * lane<Scalar>(0);
    z += v[1] * lane<Scalar>(0);
    z -= v[0] * lane<Scalar>(1);
  }
  Matrix3<Scalar> small() const {
    Matrix3<Scalar> M;
    M << x.template head<3>(), y.template head<3>(), z.template head<3>();
    return M;
  }
  void subtract(const Matrix3<Scalar>& M) {
    x.template head<3>() -= M.col(0);
    y.template head<3>() -= M.col(1);
    z.template head<3>() -= M.col(2);
  }
};

/// sum += v. By products: single numbers that are stored would hold up the load of all.
template <RealScalar Scalar, class Vector>
EIGEN_ALWAYS_INLINE void add_lanes(const Vector& v, Lanes<Scalar>& sum) {
  sum += v[0] * lane<Scalar>(0);
  sum += v[1] * lane<Scalar>(1);
  sum += v[2] * lane<Scalar>(2);
}

/// The sum of the products of three lanes.
template <RealScalar Scalar, class Vector>
EIGEN_ALWAYS_INLINE Scalar dot(const Vector& v, const Lanes<Scalar>& x) {
  return v[0] * x[0] + v[1] * x[1] + v[2] * x[2];
}

/// Articulated inertia of a body, G = Bᵀ.
template <RealScalar Scalar>
struct Articulated {
  LaneMatrix<Scalar> A, B, G, C;
  Lanes<Scalar> N, F;  // of what does not accelerate

  void clear() {
    A.clear();
    B.clear();
    G.clear();
    C.clear();
    N = F = Lanes<Scalar>::Constant(Scalar(0));
  }

  /// Adds the body itself.
  EIGEN_ALWAYS_INLINE void add(const BodyMotion<Scalar>& own) {
    const BodyInertia<Scalar>& inertia = own.inertia;
    add_lanes<Scalar>(inertia.I.col(0), A.x);
    add_lanes<Scalar>(inertia.I.col(1), A.y);
    add_lanes<Scalar>(inertia.I.col(2), A.z);
    B.add_cross(inertia.h);
    G.add_cross(-inertia.h);
    C.x += inertia.mass * lane<Scalar>(0);
    C.y += inertia.mass * lane<Scalar>(1);
    C.z += inertia.mass * lane<Scalar>(2);
    add_lanes<Scalar>(own.N, N);
    add_lanes<Scalar>(own.F, F);
  }
};

/// What the pass down needs of a joint.
template <RealScalar Scalar>
struct ReleasedJoint {
  Lanes<Scalar> U_N, U_F;    // of a joint with one coordinate
  Lanes<Scalar> turn, move;  // accelerations beside those that velocities and gravity cause
  Scalar inverse, u;         // 1/D, and u
  int depth;                 // how many bodies its body hangs on
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
  /// Articulated inertias of a body and of those that it hangs on, by depth.
  std::vector<detail::Articulated<Scalar>> articulated;
  /// One for each body.
  std::vector<detail::ReleasedJoint<Scalar>> joints;
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
  /// Its factor.
  clothctl::detail::SmallCholesky<Scalar> factor;
  /// What velocities and gravity take.
  VectorX<Scalar> bias;
  /// Accelerations of a body that has none: empty.
  VectorX<Scalar> none;

  /// Makes room for a tree. Allocates.
  explicit ForwardDynamicsWorkspace(const Tree<Scalar>& tree)
      : motion(tree),
        articulated(tree.bodies().size()),
        joints(tree.bodies().size()),
        free_place(tree.bodies().size(), -1),
        inverse(tree),
        composite(tree) {
    int count = 0;
    for (std::size_t i = 0; i < tree.bodies().size(); ++i) {
      const int p = tree.bodies()[i].parent;
      joints[i].depth = p < 0 ? 0 : joints[static_cast<std::size_t>(p)].depth + 1;
      if (tree.bodies()[i].type == JointType::Free) free_place[i] = count++;
    }
    free_U.resize(static_cast<std::size_t>(count));
    free_solved.resize(static_cast<std::size_t>(count));
    const Index n = tree.coupled() ? tree.velocities() : 0;
    M.setZero(n, n);
    factor.reserve(n);
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
  work.factor.resize(M.rows());
  for (Index j = 0; j < M.cols(); ++j) {
    for (Index i = j; i < M.rows(); ++i) work.factor(i, j) = M(i, j);
  }
  const Index failed = work.factor.solve(qdd);
  for (std::size_t i = 0; failed >= 0 && i < tree.bodies().size(); ++i) {
    const Body<Scalar>& body = tree.bodies()[i];
    const Index last = body.velocity + (body.type == JointType::Free ? 5 : 0);
    if (body.velocity <= failed && failed <= last) return {DynamicsStatus::NoInertia, static_cast<int>(i)};
  }
  return {};
}

/// Takes one joint's freedom out of its body's articulated inertia.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE bool release_joint(bool turns, const Vector3<Scalar>& axis, const Scalar& torque, const Scalar& diagonal,
                                       Articulated<Scalar>& a, ReleasedJoint<Scalar>& joint) {
  const Lanes<Scalar> U_N = turns ? a.A * axis : a.B * axis, U_F = turns ? a.G * axis : a.C * axis;
  joint.U_N = U_N;
  joint.U_F = U_F;
  // What is left of inertia about the axis when joints below gave way to it may be rounding alone.
  const LaneMatrix<Scalar>& own = turns ? a.A : a.C;
  const Scalar D = dot<Scalar>(axis, turns ? joint.U_N : joint.U_F) + diagonal;
  if (!(D > Scalar(64) * scalar_traits<Scalar>::epsilon() * (own.x[0] + own.y[1] + own.z[2]))) return false;
  joint.inverse = Scalar(1) / D;
  joint.u = torque - dot<Scalar>(axis, turns ? a.N : a.F);
  const Lanes<Scalar> share_N = -joint.inverse * U_N, share_F = -joint.inverse * U_F;
  a.A.add_outer(share_N, joint.U_N);
  a.B.add_outer(share_N, joint.U_F);
  a.G.add_outer(share_F, joint.U_N);
  a.C.add_outer(share_F, joint.U_F);
  a.N -= joint.u * share_N;
  a.F -= joint.u * share_F;
  return true;
}

/// The same for a free joint, with six coordinates.
template <RealScalar Scalar>
bool release_free(const Matrix3<Scalar>& axes, const Eigen::Ref<const VectorX<Scalar>>& torques,
                  const Eigen::Ref<const VectorX<Scalar>>& diagonal, Index at, Eigen::Matrix<Scalar, 6, 6>& U,
                  Eigen::Matrix<Scalar, 6, 7>& solved, Articulated<Scalar>& a) {
  U.template block<3, 3>(0, 0).noalias() = a.B.small() * axes;  // rows: moment, force
  U.template block<3, 3>(3, 0).noalias() = a.C.small() * axes;
  U.template block<3, 3>(0, 3).noalias() = a.A.small() * axes;
  U.template block<3, 3>(3, 3).noalias() = a.G.small() * axes;
  Eigen::Matrix<Scalar, 6, 6> D;
  D.template topRows<3>().noalias() = axes.transpose() * U.template bottomRows<3>();
  D.template bottomRows<3>().noalias() = axes.transpose() * U.template topRows<3>();
  for (int k = 0; k < 6 && diagonal.size() > 0; ++k) D(k, k) += diagonal[at + k];
  solved.template leftCols<6>() = U.transpose();
  solved.template block<3, 1>(0, 6) = torques.template segment<3>(at) - axes.transpose() * a.F.template head<3>();
  solved.template block<3, 1>(3, 6) = torques.template segment<3>(at + 3) - axes.transpose() * a.N.template head<3>();
  if (!solve_six(D, solved)) return false;
  const Eigen::Matrix<Scalar, 6, 6> taken = U * solved.template leftCols<6>();
  const Eigen::Matrix<Scalar, 6, 1> push = U * solved.col(6);
  a.A.subtract(taken.template topLeftCorner<3, 3>());
  a.B.subtract(taken.template topRightCorner<3, 3>());
  a.G.subtract(taken.template bottomLeftCorner<3, 3>());
  a.C.subtract(taken.template bottomRightCorner<3, 3>());
  a.N.template head<3>() += push.template head<3>();
  a.F.template head<3>() += push.template tail<3>();
  return true;
}

/// Adds a body's articulated inertia to its parent's.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE void hand_down(const Vector3<Scalar>& r, const Articulated<Scalar>& a, Articulated<Scalar>& parent) {
  LaneMatrix<Scalar> X, B = a.B, G = a.G, A = a.A;
  X.clear();
  X.add_cross(r);
  B.add_products(X, a.C);
  G.subtract_cross(a.C, r);
  A.add_products(X, a.G);
  A.subtract_cross(B, r);
  parent.A += A;
  parent.B += B;
  parent.G += G;
  parent.C += a.C;
  parent.F += a.F;
  Lanes<Scalar> N = a.N;
  X.add_product(a.F, N);
  parent.N += N;
}

/// The pass down, leaves first. Answers the body whose joint has no inertia to move, or -1.
template <RealScalar Scalar>
[[gnu::flatten]] int release_joints(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics,
                                    const Eigen::Ref<const VectorX<Scalar>>& torques,
                                    const Eigen::Ref<const VectorX<Scalar>>& diagonal, ForwardDynamicsWorkspace<Scalar>& work) {
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    ReleasedJoint<Scalar>& joint = work.joints[i];
    Articulated<Scalar>& a = work.articulated[static_cast<std::size_t>(joint.depth)];
    if (body.subtree_end == static_cast<int>(i) + 1) a.clear();
    a.add(work.motion.bodies[i]);
    bool released;
    if (body.type != JointType::Free) {
      const Scalar more = diagonal.size() > 0 ? diagonal[body.velocity] : Scalar(0);
      released =
          release_joint<Scalar>(body.type == JointType::Revolute, place.R.col(2), torques[body.velocity], more, a, joint);
    } else {
      const std::size_t k = static_cast<std::size_t>(work.free_place[i]);
      released = release_free<Scalar>(outer_axes(kinematics, body), torques, diagonal, body.velocity, work.free_U[k],
                                      work.free_solved[k], a);
    }
    if (!released) return static_cast<int>(i);
    if (body.parent < 0) continue;
    Articulated<Scalar>& parent = work.articulated[static_cast<std::size_t>(joint.depth - 1)];
    if (body.subtree_end == bodies[static_cast<std::size_t>(body.parent)].subtree_end) parent.clear();  // first to come down
    hand_down<Scalar>(place.from_parent, a, parent);
  }
  return -1;
}

/// The pass up, leaves last.
template <RealScalar Scalar>
[[gnu::flatten]] void find_accelerations(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics,
                                         ForwardDynamicsWorkspace<Scalar>& work, Eigen::Ref<VectorX<Scalar>>& qdd) {
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  const Lanes<Scalar> zero = Lanes<Scalar>::Constant(Scalar(0));
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const Body<Scalar>& body = bodies[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    ReleasedJoint<Scalar>& joint = work.joints[i];
    if (body.parent < 0) {
      joint.turn = joint.move = zero;
    } else {
      const ReleasedJoint<Scalar>& parent = work.joints[static_cast<std::size_t>(body.parent)];
      joint.turn = parent.turn;
      LaneMatrix<Scalar> back;
      back.clear();
      back.add_cross(-place.from_parent);
      Lanes<Scalar> move = parent.move;
      back.add_product(parent.turn, move);
      joint.move = move;
    }
    if (body.type == JointType::Free) {
      const Eigen::Matrix<Scalar, 6, 7>& solved = work.free_solved[static_cast<std::size_t>(work.free_place[i])];
      const Matrix3<Scalar> axes = outer_axes(kinematics, body);
      auto own_qdd = qdd.template segment<6>(body.velocity);
      own_qdd = solved.col(6) - solved.template leftCols<3>() * joint.turn.template head<3>() -
                solved.template block<6, 3>(0, 3) * joint.move.template head<3>();
      joint.move.template head<3>() += axes * own_qdd.template head<3>();
      joint.turn.template head<3>() += axes * own_qdd.template tail<3>();
      continue;
    }
    const Scalar acceleration =
        joint.inverse * (joint.u - dot<Scalar>(joint.turn, joint.U_N) - dot<Scalar>(joint.move, joint.U_F));
    qdd[body.velocity] = acceleration;
    const Vector3<Scalar>& axis = place.R.col(2);
    add_lanes<Scalar>(acceleration * axis, body.type == JointType::Revolute ? joint.turn : joint.move);
  }
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
    const bool finite = all_finite(qd) && all_finite(torques) && all_finite(diagonal) && all_finite(gravity);
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
  detail::place_motions<Scalar>(tree, kinematics, qd, work.none, gravity, work.motion);
  const int stuck = detail::release_joints<Scalar>(tree, kinematics, torques, diagonal, work);
  if (stuck >= 0) return refuse(stuck);
  detail::find_accelerations<Scalar>(tree, kinematics, work, qdd);
  return all_finite(qdd) ? DynamicsReport{} : refuse(-1);
}

}  // namespace clothctl::robot
