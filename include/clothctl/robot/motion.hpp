#pragma once

// Velocities and inertias of all bodies, in world axes about each body's own origin. With ω of a body and of its parent ω_p,
// and r from the parent's origin to its own:
//
//   ω = ω_p + a q̇                                     (turning; sliding: ω = ω_p)
//   (α, A) = (α_p, A_p + α_p × r) + S q̈ + c           angular acceleration, and acceleration of the origin
//   c = (ω_p × a q̇,  ω_p × (ω_p × r))                 (turning)
//   c = (0,  ω_p × (ω_p × r) + 2 ω_p × a q̇)           (sliding)
//   (N, F) = (I α + h × A,  m A + α × h) + (ω × I ω,  ω × (ω × h)),   h = m c_com,  I about the origin
//
// These are Newton's and Euler's equations for a point that moves with the body: linear velocities do not appear, shifts
// between bodies are translations, and origins near the masses keep digits that a common one would lose. Reference:
// Featherstone, Rigid Body Dynamics Algorithms (2008) ch. 5, here with classical accelerations.

#include <vector>

#include "clothctl/robot/kinematics.hpp"

namespace clothctl::robot {

namespace detail {

/// What dynamics know of a body.
template <RealScalar Scalar>
struct BodyMotion {
  Vector3<Scalar> w;               // angular velocity
  Vector3<Scalar> c_turn, c_move;  // the part of the accelerations that velocities cause
  Vector3<Scalar> h;               // mass times centre of mass, from the origin
  Matrix3<Scalar> I;               // about the origin
  Vector3<Scalar> bias_N, bias_F;  // moment and force that velocities cause
};

/// Inertia tensor about the frame's origin.
template <RealScalar Scalar>
Matrix3<Scalar> about_origin(const Inertia<Scalar>& inertia) {
  const Vector3<Scalar>& c = inertia.com;
  return inertia.about_com + inertia.mass * (c.squaredNorm() * Matrix3<Scalar>::Identity() - c * c.transpose());
}

/// [r]× M.
template <RealScalar Scalar>
Matrix3<Scalar> cross_columns(const Vector3<Scalar>& r, const Matrix3<Scalar>& M) {
  Matrix3<Scalar> out;
  for (int k = 0; k < 3; ++k) out.col(k) = r.cross(M.col(k));
  return out;
}

/// [v]×.
template <RealScalar Scalar>
Matrix3<Scalar> skew(const Vector3<Scalar>& v) {
  const Scalar zero(0);
  Matrix3<Scalar> S;
  S << zero, -v[2], v[1], v[2], zero, -v[0], -v[1], v[0], zero;
  return S;
}

}  // namespace detail

/// Velocities and inertias of all bodies of a tree.
template <RealScalar Scalar>
struct Motion {
  /// One for each body.
  std::vector<detail::BodyMotion<Scalar>> bodies;
  /// Inertia tensors about the bodies' origins, in their own axes.
  std::vector<Matrix3<Scalar>> tensors;

  /// Makes room for a tree's bodies. Allocates.
  explicit Motion(const Tree<Scalar>& tree) : bodies(tree.bodies().size()) {
    for (const Body<Scalar>& body : tree.bodies()) tensors.push_back(detail::about_origin(body.inertia));
  }
};

namespace detail {

/// Fills h and I of all bodies.
template <RealScalar Scalar>
void place_inertias(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics, Motion<Scalar>& motion) {
  for (std::size_t i = 0; i < motion.bodies.size(); ++i) {
    BodyMotion<Scalar>& own = motion.bodies[i];
    const Matrix3<Scalar>& R = kinematics.places[i].R;
    const Inertia<Scalar>& inertia = tree.bodies()[i].inertia;
    own.h.noalias() = R * (inertia.mass * inertia.com);
    const Matrix3<Scalar> half = R * motion.tensors[i];
    own.I.noalias() = half * R.transpose();
  }
}

/// Fills what velocities cause. Needs the inertias.
template <RealScalar Scalar>
void place_velocities(const Tree<Scalar>& tree, const Kinematics<Scalar>& kinematics,
                      const Eigen::Ref<const VectorX<Scalar>>& qd, Motion<Scalar>& motion) {
  const Vector3<Scalar> zero = Vector3<Scalar>::Constant(Scalar(0));
  for (std::size_t i = 0; i < motion.bodies.size(); ++i) {
    const Body<Scalar>& body = tree.bodies()[i];
    const BodyPlace<Scalar>& place = kinematics.places[i];
    BodyMotion<Scalar>& own = motion.bodies[i];
    const Vector3<Scalar>& wp = body.parent < 0 ? zero : motion.bodies[static_cast<std::size_t>(body.parent)].w;
    own.c_move = wp.cross(wp.cross(place.from_parent));
    if (body.type == JointType::Revolute) {
      const Vector3<Scalar> spin = (body.ratio * qd[body.velocity]) * place.R.col(2);
      own.c_turn = wp.cross(spin);
      own.w = wp + spin;
    } else if (body.type == JointType::Prismatic) {
      own.c_turn = zero;
      own.c_move += wp.cross((Scalar(2) * body.ratio * qd[body.velocity]) * place.R.col(2));
      own.w = wp;
    } else {
      const Matrix3<Scalar> axes = outer_axes(kinematics, body);
      const Vector3<Scalar> slide = axes * qd.template segment<3>(body.velocity);
      const Vector3<Scalar> spin = axes * qd.template segment<3>(body.velocity + 3);
      own.c_turn = wp.cross(spin);
      own.c_move += Scalar(2) * wp.cross(slide);
      own.w = wp + spin;
    }
    own.bias_N = own.w.cross(own.I * own.w);
    own.bias_F = own.w.cross(own.w.cross(own.h));
  }
}

}  // namespace detail

}  // namespace clothctl::robot
