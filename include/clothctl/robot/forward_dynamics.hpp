#pragma once

// Forward dynamics by the articulated-body algorithm: the accelerations that torques cause, with a
// diagonal d ≥ 0 added to the mass matrix,
//
//   (M(q) + diag d) q̈ = τ - C(q, q̇) - g(q)
//
// Three passes over the tree:
//
// 1. From the root to the leaves: motions at q̈ = 0 and the forces p = (N, F) that they need
//    (detail/motion.hpp).
// 2. From the leaves to the root: the articulated inertia of each body. It relates the acceleration
//    (α, A) of a body to the wrench at its joint, (N, F) = [A B; Bᵀ C] (α, A) + p. With the joint's
//    direction S:
//
//      U = [A B; Bᵀ C] S,   D = Sᵀ U + d,   u = τ - Sᵀ p
//      [A B; Bᵀ C] -= U D⁻¹ Uᵀ,   p += U D⁻¹ u
//
//    and the result, shifted to the parent's origin by r, is added to the parent's:
//
//      B' = B + [r] C,   A' = A - B' [r] + [r] Bᵀ,   N' = N + r × F
//
// 3. From the root to the leaves: q̈ = D⁻¹ (u - Uᵀ (α, A)) with the parent's acceleration
// shifted to
//    the body's origin.
//
// Both B and its transpose G are stored, so that every operation works on whole columns, each
// padded to a register of four numbers. A tree whose joints share coordinates builds M and factors
// it.
//
// Reference: Featherstone, Rigid Body Dynamics Algorithms (2008) §7.3. The diagonal is that of
// stable PD: Tan, Liu, Turk (2011), who solve a dense system.

#include <cmath>
#include <string_view>
#include <vector>

#include "clothctl/linalg/small_cholesky.hpp"
#include "clothctl/robot/inverse_dynamics.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How forward dynamics ended.
enum class DynamicsStatus {
  /// The accelerations are finite. Use them.
  Solved,
  /// Poses, velocities or torques hold NaN or an infinity. Do not use the accelerations; correct
  /// the input.
  InvalidInput,
  /// A joint moves nothing that has inertia and has no diagonal; the report names its body. Give
  /// the link an inertia or the joint a diagonal.
  NoInertia,
  /// A vector is not of length nv; nothing was written. Correct the call.
  WrongSize,
  /// Poses or workspace were made for another tree; nothing was written. Make them for this one.
  OtherTree
};

/// Returns the name of a status.
constexpr std::string_view to_string(DynamicsStatus status) {
  switch (status) {
    case DynamicsStatus::Solved: return "solved";
    case DynamicsStatus::InvalidInput: return "invalid_input";
    case DynamicsStatus::NoInertia: return "no_inertia";
    case DynamicsStatus::WrongSize: return "wrong_size";
    case DynamicsStatus::OtherTree: return "other_tree";
  }
  return "unknown";
}

/// Result of forward dynamics.
struct DynamicsReport {
  /// How it ended.
  DynamicsStatus status = DynamicsStatus::Solved;
  /// With NoInertia the body that the joint moves, else -1.
  int body = -1;
};

namespace detail {

/// Three numbers and a zero. Four numbers fill a vector register.
template <RealScalar Scalar>
using Padded3 = Eigen::Matrix<Scalar, 4, 1>;

/// Returns the unit vector of axis k.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE Padded3<Scalar> unit_padded(int k) {
  return {Scalar(k == 0 ? 1 : 0), Scalar(k == 1 ? 1 : 0), Scalar(k == 2 ? 1 : 0), Scalar(0)};
}

/// A 3×3 matrix by its padded columns. Sums are written term by term: compilers keep those in
/// registers.
template <RealScalar Scalar>
struct PaddedMatrix3 {
  Padded3<Scalar> x, y, z;

  PaddedMatrix3() = default;

  /// Sets all entries to zero.
  void clear() { x = y = z = Padded3<Scalar>::Constant(Scalar(0)); }

  /// sum += M v.
  template <class Vector>
  EIGEN_ALWAYS_INLINE void add_product(const Vector& v, Padded3<Scalar>& sum) const {
    sum += v[0] * x;
    sum += v[1] * y;
    sum += v[2] * z;
  }
  /// Returns M v.
  template <class Vector>
  EIGEN_ALWAYS_INLINE Padded3<Scalar> operator*(const Vector& v) const {
    Padded3<Scalar> product = v[0] * x;
    product += v[1] * y;
    product += v[2] * z;
    return product;
  }
  /// this += B.
  EIGEN_ALWAYS_INLINE PaddedMatrix3& operator+=(const PaddedMatrix3& B) {
    x += B.x;
    y += B.y;
    z += B.z;
    return *this;
  }
  /// this += v uᵀ.
  template <class Vector>
  EIGEN_ALWAYS_INLINE void add_outer(const Padded3<Scalar>& v, const Vector& u) {
    x += u[0] * v;
    y += u[1] * v;
    z += u[2] * v;
  }
  /// this += [r] B, where `cross` is [r].
  EIGEN_ALWAYS_INLINE void add_products(const PaddedMatrix3& cross, const PaddedMatrix3& B) {
    cross.add_product(B.x, x);
    cross.add_product(B.y, y);
    cross.add_product(B.z, z);
  }
  /// this -= B [r].
  EIGEN_ALWAYS_INLINE void subtract_cross(const PaddedMatrix3& B, const Vector3<Scalar>& r) {
    x += r[1] * B.z;
    x -= r[2] * B.y;
    y += r[2] * B.x;
    y -= r[0] * B.z;
    z += r[0] * B.y;
    z -= r[1] * B.x;
  }
  /// this += [v].
  EIGEN_ALWAYS_INLINE void add_cross(const Vector3<Scalar>& v) {
    x += v[2] * unit_padded<Scalar>(1);
    x -= v[1] * unit_padded<Scalar>(2);
    y += v[0] * unit_padded<Scalar>(2);
    y -= v[2] * unit_padded<Scalar>(0);
    z += v[1] * unit_padded<Scalar>(0);
    z -= v[0] * unit_padded<Scalar>(1);
  }
  Matrix3<Scalar> matrix3() const {
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

/// sum += v. It multiplies by unit vectors, since storing single numbers would delay the next load
/// of all four.
template <RealScalar Scalar, class Vector>
EIGEN_ALWAYS_INLINE void add_padded(const Vector& v, Padded3<Scalar>& sum) {
  sum += v[0] * unit_padded<Scalar>(0);
  sum += v[1] * unit_padded<Scalar>(1);
  sum += v[2] * unit_padded<Scalar>(2);
}

/// Returns the dot product of the first three entries.
template <RealScalar Scalar, class Vector>
EIGEN_ALWAYS_INLINE Scalar dot(const Vector& v, const Padded3<Scalar>& x) {
  return v[0] * x[0] + v[1] * x[1] + v[2] * x[2];
}

/// Articulated inertia of a body; G = Bᵀ.
template <RealScalar Scalar>
struct ArticulatedInertia {
  PaddedMatrix3<Scalar> A, B, G, C;
  Padded3<Scalar> N, F;  // p: the wrench at zero acceleration

  void clear() {
    A.clear();
    B.clear();
    G.clear();
    C.clear();
    N = F = Padded3<Scalar>::Constant(Scalar(0));
  }

  /// Adds the inertia and forces of the body itself.
  EIGEN_ALWAYS_INLINE void add(const BodyMotion<Scalar>& own) {
    const BodyInertia<Scalar>& inertia = own.inertia;
    add_padded<Scalar>(inertia.moments.col(0), A.x);
    add_padded<Scalar>(inertia.moments.col(1), A.y);
    add_padded<Scalar>(inertia.moments.col(2), A.z);
    B.add_cross(inertia.h);
    G.add_cross(-inertia.h);
    C.x += inertia.mass * unit_padded<Scalar>(0);
    C.y += inertia.mass * unit_padded<Scalar>(1);
    C.z += inertia.mass * unit_padded<Scalar>(2);
    add_padded<Scalar>(own.N, N);
    add_padded<Scalar>(own.F, F);
  }
};

/// A joint after the second pass, and the acceleration of its body in the third.
template <RealScalar Scalar>
struct EliminatedJoint {
  Padded3<Scalar> U_N, U_F;  // U of a joint with one coordinate
  Padded3<Scalar> alpha, a;  // what q̈ adds to the accelerations at q̈ = 0
  Scalar inverse, u;         // 1/D, and u
  int depth;                 // number of bodies between the body and the world
};

/// Solves D X' = X for symmetric positive definite D (6×6, overwritten) and writes X' to X. Returns
/// false when D is not positive definite.
template <RealScalar Scalar>
bool cholesky_solve_six(Eigen::Matrix<Scalar, 6, 6>& D, Eigen::Matrix<Scalar, 6, 7>& X) {
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
  /// Motions and inertias of the bodies.
  detail::BodyMotions<Scalar> motion;
  /// Articulated inertias of a body and of the bodies between it and the world, by depth.
  std::vector<detail::ArticulatedInertia<Scalar>> articulated;
  /// Joints, one for each body.
  std::vector<detail::EliminatedJoint<Scalar>> joints;
  /// U of each free joint.
  std::vector<Eigen::Matrix<Scalar, 6, 6>> free_U;
  /// D⁻¹ (Uᵀ, u) of each free joint.
  std::vector<Eigen::Matrix<Scalar, 6, 7>> free_solved;
  /// For each body its index in the two lists above, or -1.
  std::vector<int> free_slot;
  /// Memory of `inverse_dynamics`, for coupled trees.
  InverseDynamicsWorkspace<Scalar> inverse;
  /// Memory of `mass_matrix`, for coupled trees.
  MassMatrixWorkspace<Scalar> composite;
  /// The mass matrix of a coupled tree, else empty.
  MatrixX<Scalar> M;
  /// Its Cholesky factor.
  clothctl::SmallCholesky<Scalar> factor;
  /// Torques C + g of a coupled tree.
  VectorX<Scalar> bias;
  /// An empty vector.
  VectorX<Scalar> none;

  /// Makes room for `tree`. Allocates.
  explicit ForwardDynamicsWorkspace(const KinematicTree<Scalar>& tree)
      : motion(tree),
        articulated(tree.bodies().size()),
        joints(tree.bodies().size()),
        free_slot(tree.bodies().size(), -1),
        inverse(tree),
        composite(tree) {
    int count = 0;
    for (std::size_t i = 0; i < tree.bodies().size(); ++i) {
      const int p = tree.bodies()[i].parent;
      joints[i].depth = p < 0 ? 0 : joints[static_cast<std::size_t>(p)].depth + 1;
      if (tree.bodies()[i].type == JointType::Free) free_slot[i] = count++;
    }
    free_U.resize(static_cast<std::size_t>(count));
    free_solved.resize(static_cast<std::size_t>(count));
    const Index n = tree.coupled() ? tree.nv() : 0;
    M.setZero(n, n);
    factor.reserve(n);
    bias.setZero(tree.nv());
  }
};

namespace detail {

/// Forward dynamics by a Cholesky factor of M + diag d, for trees whose joints share coordinates.
template <RealScalar Scalar>
DynamicsReport coupled_dynamics(
    const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
    const Eigen::Ref<const VectorX<Scalar>>& qd, const Eigen::Ref<const VectorX<Scalar>>& torques,
    const Eigen::Ref<const VectorX<Scalar>>& diagonal, const Vector3<Scalar>& gravity,
    ForwardDynamicsWorkspace<Scalar>& work, Eigen::Ref<VectorX<Scalar>> qdd) {
  MatrixX<Scalar>& M = work.M;
  qdd.setConstant(Scalar(0));
  inverse_dynamics<Scalar>(tree, body_poses, qd, qdd, gravity, work.inverse, work.bias);
  mass_matrix<Scalar>(tree, body_poses, work.composite, M);
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
    if (body.velocity <= failed && failed <= last)
      return {DynamicsStatus::NoInertia, static_cast<int>(i)};
  }
  return {};
}

/// Eliminates a joint with one coordinate from its body's articulated inertia. Returns false when
/// the joint has neither inertia nor diagonal.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE bool eliminate_joint(bool turns, const Vector3<Scalar>& axis,
                                         const Scalar& torque, const Scalar& diagonal,
                                         ArticulatedInertia<Scalar>& a,
                                         EliminatedJoint<Scalar>& joint) {
  const Padded3<Scalar> U_N = turns ? a.A * axis : a.B * axis,
                        U_F = turns ? a.G * axis : a.C * axis;
  joint.U_N = U_N;
  joint.U_F = U_F;
  // Joints below the body may leave no inertia about the axis but rounding.
  const PaddedMatrix3<Scalar>& own = turns ? a.A : a.C;
  const Scalar D = dot<Scalar>(axis, turns ? joint.U_N : joint.U_F) + diagonal;
  if (!(D > Scalar(64) * scalar_traits<Scalar>::epsilon() * (own.x[0] + own.y[1] + own.z[2])))
    return false;
  joint.inverse = Scalar(1) / D;
  joint.u = torque - dot<Scalar>(axis, turns ? a.N : a.F);
  const Padded3<Scalar> share_N = -joint.inverse * U_N, share_F = -joint.inverse * U_F;
  a.A.add_outer(share_N, joint.U_N);
  a.B.add_outer(share_N, joint.U_F);
  a.G.add_outer(share_F, joint.U_N);
  a.C.add_outer(share_F, joint.U_F);
  a.N -= joint.u * share_N;
  a.F -= joint.u * share_F;
  return true;
}

/// The same for a free joint, which has six coordinates.
template <RealScalar Scalar>
bool eliminate_free_joint(const Matrix3<Scalar>& axes,
                          const Eigen::Ref<const VectorX<Scalar>>& torques,
                          const Eigen::Ref<const VectorX<Scalar>>& diagonal, Index at,
                          Eigen::Matrix<Scalar, 6, 6>& U, Eigen::Matrix<Scalar, 6, 7>& solved,
                          ArticulatedInertia<Scalar>& a) {
  U.template block<3, 3>(0, 0).noalias() = a.B.matrix3() * axes;  // rows: moment, force
  U.template block<3, 3>(3, 0).noalias() = a.C.matrix3() * axes;
  U.template block<3, 3>(0, 3).noalias() = a.A.matrix3() * axes;
  U.template block<3, 3>(3, 3).noalias() = a.G.matrix3() * axes;
  Eigen::Matrix<Scalar, 6, 6> D;
  D.template topRows<3>().noalias() = axes.transpose() * U.template bottomRows<3>();
  D.template bottomRows<3>().noalias() = axes.transpose() * U.template topRows<3>();
  for (int k = 0; k < 6 && diagonal.size() > 0; ++k) D(k, k) += diagonal[at + k];
  solved.template leftCols<6>() = U.transpose();
  solved.template block<3, 1>(0, 6) =
      torques.template segment<3>(at) - axes.transpose() * a.F.template head<3>();
  solved.template block<3, 1>(3, 6) =
      torques.template segment<3>(at + 3) - axes.transpose() * a.N.template head<3>();
  if (!cholesky_solve_six(D, solved)) return false;
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

/// Adds a body's articulated inertia to its parent's. `r` leads from the parent's origin to the
/// body's.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE void add_to_parent(const Vector3<Scalar>& r,
                                       const ArticulatedInertia<Scalar>& a,
                                       ArticulatedInertia<Scalar>& parent) {
  PaddedMatrix3<Scalar> X, B = a.B, G = a.G, A = a.A;
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
  Padded3<Scalar> N = a.N;
  X.add_product(a.F, N);
  parent.N += N;
}

/// The second pass, leaves first. Returns the body whose joint has no inertia to move, or -1.
template <RealScalar Scalar>
[[gnu::flatten]] int inward_pass(const KinematicTree<Scalar>& tree,
                                 const BodyPoses<Scalar>& body_poses,
                                 const Eigen::Ref<const VectorX<Scalar>>& torques,
                                 const Eigen::Ref<const VectorX<Scalar>>& diagonal,
                                 ForwardDynamicsWorkspace<Scalar>& work) {
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  for (std::size_t i = bodies.size(); i-- > 0;) {
    const Body<Scalar>& body = bodies[i];
    const BodyPose<Scalar>& place = body_poses.poses[i];
    EliminatedJoint<Scalar>& joint = work.joints[i];
    ArticulatedInertia<Scalar>& a = work.articulated[static_cast<std::size_t>(joint.depth)];
    if (body.subtree_end == static_cast<int>(i) + 1) a.clear();
    a.add(work.motion.bodies[i]);
    bool released;
    if (body.type != JointType::Free) {
      const Scalar more = diagonal.size() > 0 ? diagonal[body.velocity] : Scalar(0);
      released = eliminate_joint<Scalar>(body.type == JointType::Revolute, place.R.col(2),
                                         torques[body.velocity], more, a, joint);
    } else {
      const std::size_t k = static_cast<std::size_t>(work.free_slot[i]);
      released =
          eliminate_free_joint<Scalar>(free_joint_axes(body_poses, body), torques, diagonal,
                                       body.velocity, work.free_U[k], work.free_solved[k], a);
    }
    if (!released) return static_cast<int>(i);
    if (body.parent < 0) continue;
    ArticulatedInertia<Scalar>& parent =
        work.articulated[static_cast<std::size_t>(joint.depth - 1)];
    if (body.subtree_end == bodies[static_cast<std::size_t>(body.parent)].subtree_end)
      parent.clear();  // this is the first of its children
    add_to_parent<Scalar>(place.from_parent, a, parent);
  }
  return -1;
}

/// The third pass, root first.
template <RealScalar Scalar>
[[gnu::flatten]] void outward_pass(const KinematicTree<Scalar>& tree,
                                   const BodyPoses<Scalar>& body_poses,
                                   ForwardDynamicsWorkspace<Scalar>& work,
                                   Eigen::Ref<VectorX<Scalar>>& qdd) {
  const std::vector<Body<Scalar>>& bodies = tree.bodies();
  const Padded3<Scalar> zero = Padded3<Scalar>::Constant(Scalar(0));
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const Body<Scalar>& body = bodies[i];
    const BodyPose<Scalar>& place = body_poses.poses[i];
    EliminatedJoint<Scalar>& joint = work.joints[i];
    if (body.parent < 0) {
      joint.alpha = joint.a = zero;
    } else {
      const EliminatedJoint<Scalar>& parent = work.joints[static_cast<std::size_t>(body.parent)];
      joint.alpha = parent.alpha;
      PaddedMatrix3<Scalar> back;
      back.clear();
      back.add_cross(-place.from_parent);
      Padded3<Scalar> a = parent.a;
      back.add_product(parent.alpha, a);
      joint.a = a;
    }
    if (body.type == JointType::Free) {
      const Eigen::Matrix<Scalar, 6, 7>& solved =
          work.free_solved[static_cast<std::size_t>(work.free_slot[i])];
      const Matrix3<Scalar> axes = free_joint_axes(body_poses, body);
      auto own_qdd = qdd.template segment<6>(body.velocity);
      own_qdd = solved.col(6) - solved.template leftCols<3>() * joint.alpha.template head<3>() -
                solved.template block<6, 3>(0, 3) * joint.a.template head<3>();
      joint.a.template head<3>() += axes * own_qdd.template head<3>();
      joint.alpha.template head<3>() += axes * own_qdd.template tail<3>();
      continue;
    }
    const Scalar acceleration = joint.inverse * (joint.u - dot<Scalar>(joint.alpha, joint.U_N) -
                                                 dot<Scalar>(joint.a, joint.U_F));
    qdd[body.velocity] = acceleration;
    const Vector3<Scalar>& axis = place.R.col(2);
    add_padded<Scalar>(acceleration * axis,
                       body.type == JointType::Revolute ? joint.alpha : joint.a);
  }
}

}  // namespace detail

/// Writes the accelerations (nv) that `torques` (nv; N or N m) cause at velocities `qd` (nv) and
/// poses `body_poses`. `diagonal` (nv, or empty for zero) is added to the diagonal of the mass
/// matrix. `gravity` is in m/s², world axes. Add external forces f at a point to the torques as Jᵀ
/// f. Never allocates. Complexity: O(bodies), and O(nv³) for coupled trees. Fails when: see
/// DynamicsStatus.
template <RealScalar Scalar>
[[nodiscard]] DynamicsReport forward_dynamics(
    const KinematicTree<Scalar>& tree, const BodyPoses<Scalar>& body_poses,
    const typename KinematicTree<Scalar>::VectorView& qd,
    const typename KinematicTree<Scalar>::VectorView& torques,
    const typename KinematicTree<Scalar>::VectorView& diagonal, const Vector3<Scalar>& gravity,
    ForwardDynamicsWorkspace<Scalar>& work, Eigen::Ref<VectorX<Scalar>> qdd) {
  const Index n = tree.nv();
  if (qd.size() != n || torques.size() != n || qdd.size() != n ||
      (diagonal.size() != 0 && diagonal.size() != n))
    return {DynamicsStatus::WrongSize, -1};
  if (!detail::poses_fit(tree, body_poses) || !work.motion.fits(tree))
    return {DynamicsStatus::OtherTree, -1};
  const auto refuse = [&](int body) -> DynamicsReport {
    const bool finite =
        all_finite(qd) && all_finite(torques) && all_finite(diagonal) && all_finite(gravity);
    bool placed = true;
    for (const BodyPose<Scalar>& place : body_poses.poses)
      placed = placed && all_finite(place.R) && all_finite(place.p);
    return finite && placed ? DynamicsReport{DynamicsStatus::NoInertia, body}
                            : DynamicsReport{DynamicsStatus::InvalidInput, -1};
  };
  if (tree.coupled()) {
    const DynamicsReport report = detail::coupled_dynamics<Scalar>(tree, body_poses, qd, torques,
                                                                   diagonal, gravity, work, qdd);
    if (report.status == DynamicsStatus::Solved && all_finite(qdd)) return report;
    return refuse(report.body);
  }
  detail::compute_motions<Scalar>(tree, body_poses, qd, work.none, gravity, work.motion);
  const int stuck = detail::inward_pass<Scalar>(tree, body_poses, torques, diagonal, work);
  if (stuck >= 0) return refuse(stuck);
  detail::outward_pass<Scalar>(tree, body_poses, work, qdd);
  return all_finite(qdd) ? DynamicsReport{} : refuse(-1);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
