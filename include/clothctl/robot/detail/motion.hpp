#pragma once

// Velocities, accelerations and inertial forces of all bodies, in world axes about each body's own
// origin. For a body with angular velocity ω, joint axis a, parent p, and the vector r from its
// parent's origin to its own:
//
//   ω = ω_p + a q̇,   α = α_p + a q̈ + ω_p × a q̇               revolute
//   ω = ω_p,         α = α_p                                 prismatic
//   A = A_p + K_p r                                          revolute
//   A = A_p + K_p r + a q̈ + 2 ω_p × a q̇                      prismatic
//   K = [α] + [ω] [ω]        the point at x from the origin accelerates by A + K x
//   N = I α + ω × I ω + h × A,   F = m A + K h               h = m c, I about the origin
//
// N and F are the moment about the origin and the force that accelerate the body itself, without
// the bodies below it. These are the Newton-Euler equations for a point fixed on the body. Linear
// velocities do not appear, and going from a body to its parent is a translation. Origins near the
// masses keep digits that one common origin would lose. Gravity enters as an acceleration of the
// world, A_0 = -gravity.
//
// Reference: Featherstone, Rigid Body Dynamics Algorithms (2008) ch. 5, here with the accelerations
// of points instead of spatial accelerations.

#include <cstdint>
#include <vector>

#include "clothctl/robot/forward_kinematics.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A symmetric 3×3 matrix by its upper triangle.
template <RealScalar Scalar>
struct SymmetricMatrix3 {
  Scalar xx, xy, xz, yy, yz, zz;

  EIGEN_ALWAYS_INLINE Vector3<Scalar> col(int k) const {
    return k == 0   ? Vector3<Scalar>(xx, xy, xz)
           : k == 1 ? Vector3<Scalar>(xy, yy, yz)
                    : Vector3<Scalar>(xz, yz, zz);
  }
  EIGEN_ALWAYS_INLINE Vector3<Scalar> operator*(const Vector3<Scalar>& v) const {
    return {xx * v[0] + xy * v[1] + xz * v[2], xy * v[0] + yy * v[1] + yz * v[2],
            xz * v[0] + yz * v[1] + zz * v[2]};
  }
  SymmetricMatrix3& operator+=(const SymmetricMatrix3& other) {
    xx += other.xx;
    xy += other.xy;
    xz += other.xz;
    yy += other.yy;
    yz += other.yz;
    zz += other.zz;
    return *this;
  }
};

/// Returns the symmetric matrix with the upper triangle of M.
template <RealScalar Scalar, class Matrix>
SymmetricMatrix3<Scalar> symmetric_from_upper(const Matrix& M) {
  return {M(0, 0), M(0, 1), M(0, 2), M(1, 1), M(1, 2), M(2, 2)};
}

/// Returns R S Rᵀ.
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE SymmetricMatrix3<Scalar> rotated(const SymmetricMatrix3<Scalar>& S,
                                                     const Matrix3<Scalar>& R) {
  const Vector3<Scalar> x = S * Vector3<Scalar>(R(0, 0), R(0, 1), R(0, 2));
  const Vector3<Scalar> y = S * Vector3<Scalar>(R(1, 0), R(1, 1), R(1, 2));
  const Vector3<Scalar> z = S * Vector3<Scalar>(R(2, 0), R(2, 1), R(2, 2));
  const auto along = [&](int k, const Vector3<Scalar>& v) -> Scalar {
    return R(k, 0) * v[0] + R(k, 1) * v[1] + R(k, 2) * v[2];
  };
  return {along(0, x), along(0, y), along(0, z), along(1, y), along(1, z), along(2, z)};
}

/// Returns the inertia tensor about the frame's origin.
template <RealScalar Scalar>
SymmetricMatrix3<Scalar> about_origin(const Inertia<Scalar>& inertia) {
  const Vector3<Scalar>& c = inertia.com;
  const Matrix3<Scalar> shift = c.squaredNorm() * Matrix3<Scalar>::Identity() - c * c.transpose();
  return symmetric_from_upper<Scalar>(Matrix3<Scalar>(inertia.about_com + inertia.mass * shift));
}

/// Mass m, first moment h = m c and inertia tensor I about the origin.
template <RealScalar Scalar>
struct BodyInertia {
  Scalar mass;
  Vector3<Scalar> h;
  SymmetricMatrix3<Scalar> moments;

  BodyInertia() = default;
  explicit BodyInertia(const Inertia<Scalar>& inertia)
      : mass(inertia.mass), h(inertia.mass * inertia.com), moments(about_origin(inertia)) {}

  /// Writes the same inertia in other axes: R leads from the old ones to the new ones.
  void rotate(const Matrix3<Scalar>& R, BodyInertia& out) const {
    out.mass = mass;
    out.h = R * h;
    out.moments = rotated(moments, R);
  }
};

/// Motion and inertial forces of a body, as named above; `a` is A, the acceleration of the origin.
template <RealScalar Scalar>
struct BodyMotion {
  Vector3<Scalar> w, alpha, a;
  BodyInertia<Scalar> inertia;
  Vector3<Scalar> N, F;
};

/// Returns the inertias of all bodies in their own axes. Allocates.
template <RealScalar Scalar>
std::vector<BodyInertia<Scalar>> body_inertias(const KinematicTree<Scalar>& tree) {
  std::vector<BodyInertia<Scalar>> all;
  for (const Body<Scalar>& body : tree.bodies()) all.emplace_back(body.inertia);
  return all;
}

/// Motions and inertias of all bodies of a tree.
template <RealScalar Scalar>
struct BodyMotions {
  /// One for each body.
  std::vector<BodyMotion<Scalar>> bodies;
  /// Inertias in the bodies' own axes.
  std::vector<BodyInertia<Scalar>> inertias;
  /// The tree that they belong to.
  std::uint64_t fingerprint;

  /// Makes room for the bodies of `tree`. Allocates.
  explicit BodyMotions(const KinematicTree<Scalar>& tree)
      : bodies(tree.bodies().size()),
        inertias(body_inertias(tree)),
        fingerprint(tree.fingerprint()) {}

  /// Returns true when these motions were made for `tree` or a copy of it.
  bool fits(const KinematicTree<Scalar>& tree) const { return fingerprint == tree.fingerprint(); }
};

/// Returns K = [alpha] + [w] [w].
template <RealScalar Scalar>
EIGEN_ALWAYS_INLINE Matrix3<Scalar> acceleration_gradient(const Vector3<Scalar>& w,
                                                          const Vector3<Scalar>& alpha) {
  const Scalar x = w[0] * w[0], y = w[1] * w[1], z = w[2] * w[2];
  const Scalar xy = w[0] * w[1], xz = w[0] * w[2], yz = w[1] * w[2];
  Matrix3<Scalar> K;
  K << -y - z, xy - alpha[2], xz + alpha[1], xy + alpha[2], -x - z, yz - alpha[0], xz - alpha[1],
      yz + alpha[0], -x - y;
  return K;
}

/// Computes motions, inertias in world axes, and for each body the moment and force that it needs
/// without the bodies below it. An empty qdd stands for zero.
template <RealScalar Scalar>
[[gnu::flatten]] void compute_motions(const KinematicTree<Scalar>& tree,
                                      const BodyPoses<Scalar>& body_poses,
                                      const Eigen::Ref<const VectorX<Scalar>>& qd,
                                      const Eigen::Ref<const VectorX<Scalar>>& qdd,
                                      const Vector3<Scalar>& gravity, BodyMotions<Scalar>& motion) {
  const Vector3<Scalar> zero = Vector3<Scalar>::Constant(Scalar(0));
  Vector3<Scalar> w = zero, alpha = zero, a = -gravity;
  Matrix3<Scalar> K = Matrix3<Scalar>::Constant(Scalar(0));
  const bool accelerates = qdd.size() > 0;
  for (std::size_t i = 0; i < motion.bodies.size(); ++i) {
    const Body<Scalar>& body = tree.bodies()[i];
    const BodyPose<Scalar>& place = body_poses.poses[i];
    BodyMotion<Scalar>& own = motion.bodies[i];
    if (body.parent < 0) {
      w = alpha = zero;
      K.setConstant(Scalar(0));
      a = -gravity;
    } else if (body.parent + 1 != static_cast<int>(i)) {  // else w, alpha, a, K are the parent's
      const BodyMotion<Scalar>& parent = motion.bodies[static_cast<std::size_t>(body.parent)];
      w = parent.w;
      alpha = parent.alpha;
      a = parent.a;
      K = acceleration_gradient<Scalar>(w, alpha);
    }
    a += K * place.from_parent;
    if (body.type == JointType::Revolute) {
      const Vector3<Scalar> spin = (body.ratio * qd[body.velocity]) * place.R.col(2);
      alpha += w.cross(spin);
      w += spin;
      if (accelerates) alpha += (body.ratio * qdd[body.velocity]) * place.R.col(2);
    } else if (body.type == JointType::Prismatic) {
      a += w.cross((Scalar(2) * body.ratio * qd[body.velocity]) * place.R.col(2));
      if (accelerates) a += (body.ratio * qdd[body.velocity]) * place.R.col(2);
    } else {
      const Matrix3<Scalar> axes = free_joint_axes(body_poses, body);
      const Vector3<Scalar> slide = axes * qd.template segment<3>(body.velocity);
      const Vector3<Scalar> spin = axes * qd.template segment<3>(body.velocity + 3);
      alpha += w.cross(spin);
      a += Scalar(2) * w.cross(slide);
      w += spin;
      if (accelerates) a += axes * qdd.template segment<3>(body.velocity);
      if (accelerates) alpha += axes * qdd.template segment<3>(body.velocity + 3);
    }
    K = acceleration_gradient<Scalar>(w, alpha);
    motion.inertias[i].rotate(place.R, own.inertia);
    const BodyInertia<Scalar>& inertia = own.inertia;
    own.w = w;
    own.alpha = alpha;
    own.a = a;
    own.N = inertia.moments * alpha + w.cross(inertia.moments * w) + inertia.h.cross(a);
    own.F = inertia.mass * a + K * inertia.h;
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
