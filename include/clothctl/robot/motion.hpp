#pragma once

// Motions and inertias of all bodies, in world axes about each body's own origin. With ω of a body and of its parent ω_p, and r
// from the parent's origin to its own:
//
//   ω = ω_p + a q̇,  α = α_p + a q̈ + ω_p × a q̇              (turning; sliding: ω = ω_p, α = α_p)
//   K = [α] + [ω] [ω]                                      a point x from the origin accelerates by A + K x
//   A = A_p + K_p r                                        (turning)
//   A = A_p + K_p r + a q̈ + 2 ω_p × a q̇                    (sliding)
//   (N, F) = (I α + ω × I ω + h × A,  m A + K h),          h = m c_com,  I about the origin
//
// These are Newton's and Euler's equations for a point that moves with the body: linear velocities do not appear, shifts
// between bodies are translations, and origins near the masses keep digits that a common one would lose. Gravity is an
// acceleration of the world, A_0 = -gravity. Reference: Featherstone, Rigid Body Dynamics Algorithms (2008) ch. 5, here with
// classical accelerations.

#include <vector>

#include "clothctl/robot/kinematics.hpp"

namespace clothctl::robot {

namespace detail {

/// A symmetric matrix.
template <RealScalar Scalar>
struct Symmetric {
  Scalar xx, xy, xz, yy, yz, zz;

  EIGEN_ALWAYS_INLINE Vector3<Scalar> col(int k) const {
    return k == 0 ? Vector3<Scalar>(xx, xy, xz) : k == 1 ? Vector3<Scalar>(xy, yy, yz) : Vector3<Scalar>(xz, yz, zz);
  }
  EIGEN_ALWAYS_INLINE Vector3<Scalar> operator*(const Vector3<Scalar>& v) const {
    return {xx * v[0] + xy * v[1] + xz * v[2], xy * v[0] + yy * v[1] + yz * v[2], xz * v[0] + yz * v[1] + zz * v[2]};
  }
  Symmetric& operator+=(const Symmetric& other) {
    xx += other.xx;
    xy += other.xy;
    xz += other.xz;
    yy += other.yy;
    yz += other.yz;
    zz += other.zz;
    return *this;
  }
};

/// The upper triangle of M.
template <RealScalar Scalar, class Matrix>
Symmetric<Scalar> upper_of(const Matrix& M) {
  return {M(0, 0), M(0, 1), M(0, 2), M(1, 1), M(1, 2), M(2, 2)};
}

/// R S Rᵀ.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE Symmetric<Scalar> turned(const Symmetric<Scalar>& S, const Matrix3<Scalar>& R) {
  const Vector3<Scalar> x = S * Vector3<Scalar>(R(0, 0), R(0, 1), R(0, 2));
  const Vector3<Scalar> y = S * Vector3<Scalar>(R(1, 0), R(1, 1), R(1, 2));
  const Vector3<Scalar> z = S * Vector3<Scalar>(R(2, 0), R(2, 1), R(2, 2));
  const auto along = [&](int k, const Vector3<Scalar>& v) -> Scalar {
    return R(k, 0) * v[0] + R(k, 1) * v[1] + R(k, 2) * v[2];
  };
  return {along(0, x), along(0, y), along(0, z), along(1, y), along(1, z), along(2, z)};
}

/// Inertia tensor about the frame's origin.
template <RealScalar Scalar>
Symmetric<Scalar> about_origin(const Inertia<Scalar>& inertia) {
  const Vector3<Scalar>& c = inertia.com;
  const Matrix3<Scalar> shift = c.squaredNorm() * Matrix3<Scalar>::Identity() - c * c.transpose();
  return upper_of<Scalar>(Matrix3<Scalar>(inertia.about_com + inertia.mass * shift));
}

/// Mass, mass times centre and tensor about the origin.
template <RealScalar Scalar>
struct BodyInertia {
  Scalar mass;
  Vector3<Scalar> h;
  Symmetric<Scalar> I;

  BodyInertia() = default;
  explicit BodyInertia(const Inertia<Scalar>& inertia)
      : mass(inertia.mass), h(inertia.mass * inertia.com), I(about_origin(inertia)) {}

  /// The same in the axes that R leads to.
  void turn(const Matrix3<Scalar>& R, BodyInertia& out) const {
    out.mass = mass;
    out.h = R * h;
    out.I = turned(I, R);
  }
};

/// How a body moves, and what that takes.
template <RealScalar Scalar>
struct BodyMotion {
  Vector3<Scalar> w, turn, move;  // angular velocity and acceleration; acceleration of the origin
  BodyInertia<Scalar> inertia;
  Vector3<Scalar> N, F;  // moment about the origin, and force
};

/// Inertias of all bodies in their own axes. Allocates.
template <RealScalar Scalar>
std::vector<BodyInertia<Scalar>> own_inertias(const Tree<Scalar>& tree) {
  std::vector<BodyInertia<Scalar>> all;
  for (const Body<Scalar>& body : tree.bodies()) all.emplace_back(body.inertia);
  return all;
}

}  // namespace detail

/// Motions and inertias of all bodies of a tree.
template <RealScalar Scalar>
struct Motion {
  /// One for each body.
  std::vector<detail::BodyMotion<Scalar>> bodies;
  /// Inertias in the bodies' own axes.
  std::vector<detail::BodyInertia<Scalar>> inertias;

  /// Makes room for a tree's bodies. Allocates.
  explicit Motion(const Tree<Scalar>& tree) : bodies(tree.bodies().size()), inertias(detail::own_inertias(tree)) {}
};

namespace detail {

/// [turn] + [w] [w].
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE Matrix3<Scalar> point_accelerations(const Vector3<Scalar>& w, const Vector3<Scalar>& turn) {
  const Scalar x = w[0] * w[0], y = w[1] * w[1], z = w[2] * w[2];
  const Scalar xy = w[0] * w[1], xz = w[0] * w[2], yz = w[1] * w[2];
  Matrix3<Scalar> K;
  K << -y - z, xy - turn[2], xz + turn[1], xy + turn[2], -x - z, yz - turn[0], xz - turn[1], yz + turn[0], -x - y;
  return K;
}

/// Fills motions, inertias, and the moments and forces that they take of each body alone. An empty qdd is zero.
template <RealScalar Scalar>
[[gnu::flatten]] void place_motions(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics,
                                    const Eigen::Ref<const VectorX<Scalar>>& qd, const Eigen::Ref<const VectorX<Scalar>>& qdd,
                                    const Vector3<Scalar>& gravity, Motion<Scalar>& motion) {
  const Vector3<Scalar> zero = Vector3<Scalar>::Constant(Scalar(0));
  Vector3<Scalar> w = zero, turn = zero, move = -gravity;
  Matrix3<Scalar> K = Matrix3<Scalar>::Constant(Scalar(0));
  const bool accelerates = qdd.size() > 0;
  for (std::size_t i = 0; i < motion.bodies.size(); ++i) {
    const Body<Scalar>& body = tree.bodies()[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    BodyMotion<Scalar>& own = motion.bodies[i];
    if (body.parent < 0) {
      w = turn = zero;
      K.setConstant(Scalar(0));
      move = -gravity;
    } else if (body.parent + 1 != static_cast<int>(i)) {  // else they are at hand
      const BodyMotion<Scalar>& parent = motion.bodies[static_cast<std::size_t>(body.parent)];
      w = parent.w;
      turn = parent.turn;
      move = parent.move;
      K = point_accelerations<Scalar>(w, turn);
    }
    move += K * place.from_parent;
    if (body.type == JointType::Revolute) {
      const Vector3<Scalar> spin = (body.ratio * qd[body.velocity]) * place.R.col(2);
      turn += w.cross(spin);
      w += spin;
      if (accelerates) turn += (body.ratio * qdd[body.velocity]) * place.R.col(2);
    } else if (body.type == JointType::Prismatic) {
      move += w.cross((Scalar(2) * body.ratio * qd[body.velocity]) * place.R.col(2));
      if (accelerates) move += (body.ratio * qdd[body.velocity]) * place.R.col(2);
    } else {
      const Matrix3<Scalar> axes = outer_axes(kinematics, body);
      const Vector3<Scalar> slide = axes * qd.template segment<3>(body.velocity);
      const Vector3<Scalar> spin = axes * qd.template segment<3>(body.velocity + 3);
      turn += w.cross(spin);
      move += Scalar(2) * w.cross(slide);
      w += spin;
      if (accelerates) move += axes * qdd.template segment<3>(body.velocity);
      if (accelerates) turn += axes * qdd.template segment<3>(body.velocity + 3);
    }
    K = point_accelerations<Scalar>(w, turn);
    motion.inertias[i].turn(place.R, own.inertia);
    const BodyInertia<Scalar>& inertia = own.inertia;
    own.w = w;
    own.turn = turn;
    own.move = move;
    own.N = inertia.I * turn + w.cross(inertia.I * w) + inertia.h.cross(move);
    own.F = inertia.mass * move + K * inertia.h;
  }
}

}  // namespace detail

}  // namespace clothctl::robot
