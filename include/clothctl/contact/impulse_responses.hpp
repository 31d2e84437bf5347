#pragma once

// How kinematic bodies, rigid bodies and particles answer to impulses (concept ImpulseResponse).
// With the place x_i of point i, the centre of mass c, the arm r_i = x_i - c, the mass m and the
// inertia about the centre of mass I_w = R I Rᵀ in world axes:
//
//   kinematic   u_i = v + w × (x_i - p)      W = 0
//   rigid       u_i = v + w × r_i            W_ij = 1/m - [r_i] I_w⁻¹ [r_j]
//   particles   u_i = v_i                    W_ii = 1/m_i, W_ij = 0
//
// An impulse p_i at point i changes a rigid body by v += p_i/m and w += I_w⁻¹ (r_i × p_i).

#include <cassert>
#include <span>
#include <string>

#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/concepts/impulse_response.hpp"
#include "clothctl/contact/detail/side_points.hpp"
#include "clothctl/core/result.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// A body whose motion is given: no impulse changes it. Models ImpulseResponse.
template <RealScalar Scalar>
class KinematicResponse {
 public:
  /// Makes a body that rests at the origin, with room for up to `capacity` points. Allocates.
  explicit KinematicResponse(Index capacity = 0) : points_(capacity) {}

  /// Gives it the motion of a step; `motion.position` is where `motion.velocity` is measured.
  /// Returns an empty string, or what is wrong; nothing is changed then. Allocates only in the
  /// second case.
  std::string set_motion(const RigidMotion<Scalar>& motion) {
    std::string bad = motion.validate();
    if (bad.empty()) motion_ = motion;
    return bad;
  }
  /// Takes the places (3×n, m, world) at which impulses may act. Allocates only for more points
  /// than ever before. InvalidPoint: a coordinate is not finite; nothing is changed then.
  [[nodiscard]] QueryStatus set_points(const PointsView<Scalar>& x) { return points_.set(x); }
  /// Its motion.
  const RigidMotion<Scalar>& motion() const { return motion_; }

  /// Returns the number of points.
  Index point_count() const { return points_.count(); }
  /// Writes the velocities (3n, m/s) of the points.
  void velocities(Eigen::Ref<VectorX<Scalar>> u) const {
    points_.rigid_velocities(motion_.position, motion_.velocity, motion_.angular_velocity, u);
  }
  /// Adds nothing: no impulse moves it.
  void add_mobility(Eigen::Ref<MatrixX<Scalar>>) const {}
  /// Does nothing.
  void apply(const Eigen::Ref<const VectorX<Scalar>>&) {}

 private:
  RigidMotion<Scalar> motion_;
  detail::SidePoints<Scalar> points_;
};

/// A rigid body. The origin of its frame is its centre of mass. Models ImpulseResponse.
template <RealScalar Scalar>
class RigidBodyResponse {
 public:
  /// Makes a body of the mass `mass` (kg) and the inertia about its centre of mass `inertia`
  /// (kg m², body axes), with room for up to `capacity` points. Allocates. Fails when: the mass is
  /// not finite and positive (for a body that nothing moves take KinematicResponse), the inertia is
  /// not symmetric positive definite, or the motion is not valid.
  static Result<RigidBodyResponse> create(const Scalar& mass, const Matrix3<Scalar>& inertia,
                                          const RigidMotion<Scalar>& motion = {},
                                          Index capacity = 0);

  /// Gives it a pose and velocities. Returns an empty string, or what is wrong; nothing is changed
  /// then. Allocates only in the second case.
  std::string set_motion(const RigidMotion<Scalar>& motion);
  /// Takes the places (3×n, m, world) at which impulses may act. Allocates only for more points
  /// than ever before. InvalidPoint: a coordinate is not finite; nothing is changed then.
  [[nodiscard]] QueryStatus set_points(const PointsView<Scalar>& x) { return points_.set(x); }
  /// Pose and velocities; `apply` changes the velocities.
  const RigidMotion<Scalar>& motion() const { return motion_; }
  /// Its mass, kg.
  const Scalar& mass() const { return mass_; }
  /// Its inertia about the centre of mass, kg m², body axes.
  const Matrix3<Scalar>& inertia() const { return inertia_; }

  /// Returns the number of points.
  Index point_count() const { return points_.count(); }
  /// Writes the velocities (3n, m/s) of the points.
  void velocities(Eigen::Ref<VectorX<Scalar>> u) const {
    points_.rigid_velocities(motion_.position, motion_.velocity, motion_.angular_velocity, u);
  }
  /// Adds the mobility to `W` (3n×3n, 1/kg).
  void add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const;
  /// Changes the velocities by the impulses p (3n, N s).
  void apply(const Eigen::Ref<const VectorX<Scalar>>& p);

 private:
  RigidBodyResponse(const Scalar& mass, const Matrix3<Scalar>& inertia,
                    const Matrix3<Scalar>& inverse, Index capacity)
      : mass_(mass), inertia_(inertia), inverse_(inverse), points_(capacity) {}

  Scalar mass_;
  Matrix3<Scalar> inertia_;
  Matrix3<Scalar> inverse_;        // of the inertia, body axes
  Matrix3<Scalar> inverse_world_;  // world axes
  RigidMotion<Scalar> motion_;
  detail::SidePoints<Scalar> points_;
};

/// Particles, such as the touched vertices of a position-based sheet. Models ImpulseResponse.
template <RealScalar Scalar>
class ParticleResponse {
 public:
  /// Makes room for up to `capacity` particles. Allocates.
  explicit ParticleResponse(Index capacity = 0)
      : inverse_masses_(VectorX<Scalar>::Constant(capacity, Scalar(0))),
        velocities_(Points<Scalar>::Constant(3, capacity, Scalar(0))) {}

  /// Takes the particles `vertices` of a sheet with the inverse masses `inverse_masses` (one for
  /// each vertex of the sheet, 1/kg; 0 for a vertex that nothing moves) and the velocities
  /// `velocities` (3 × vertices of the sheet, m/s). Point i is vertices[i]. Name no vertex twice.
  /// Allocates only for more particles than ever before. InvalidArgument: sizes differ, a vertex is
  /// not of the sheet, or an inverse mass is negative or not finite. InvalidPoint: a velocity is
  /// not finite. Nothing is changed then.
  [[nodiscard]] QueryStatus gather(std::span<const int> vertices,
                                   const Eigen::Ref<const VectorX<Scalar>>& inverse_masses,
                                   const PointsView<Scalar>& velocities);
  /// Writes the velocities back to those of the sheet (3 × vertices, m/s); others stay.
  /// InvalidArgument: a vertex is not of the sheet; nothing is changed then.
  [[nodiscard]] QueryStatus scatter(std::span<const int> vertices,
                                    Eigen::Ref<Points<Scalar>> velocities) const;

  /// Returns the number of particles.
  Index point_count() const { return count_; }
  /// Writes the velocities (3n, m/s).
  void velocities(Eigen::Ref<VectorX<Scalar>> u) const {
    assert(u.size() == 3 * count_);
    for (Index i = 0; i < count_; ++i) u.template segment<3>(3 * i) = velocities_.col(i);
  }
  /// Adds the mobility to `W` (3n×3n, 1/kg).
  void add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const {
    assert(W.rows() == 3 * count_ && W.cols() == 3 * count_);
    for (Index i = 0; i < 3 * count_; ++i) W(i, i) += inverse_masses_[i / 3];
  }
  /// Changes the velocities by the impulses p (3n, N s).
  void apply(const Eigen::Ref<const VectorX<Scalar>>& p) {
    assert(p.size() == 3 * count_);
    for (Index i = 0; i < count_; ++i)
      velocities_.col(i) += inverse_masses_[i] * p.template segment<3>(3 * i);
  }

 private:
  VectorX<Scalar> inverse_masses_;
  Points<Scalar> velocities_;
  Index count_ = 0;
};

template <RealScalar Scalar>
auto RigidBodyResponse<Scalar>::create(const Scalar& mass, const Matrix3<Scalar>& inertia,
                                       const RigidMotion<Scalar>& motion, Index capacity)
    -> Result<RigidBodyResponse> {
  if (!is_finite(mass) || is_unbounded(mass) || !(Scalar(0) < mass))
    return Error{"the mass " + number_text(mass) + " kg, must be finite and positive"};
  Matrix3<Scalar> inverse;
  if (!detail::invert_inertia<Scalar>(inertia, inverse))
    return Error{"the inertia is not symmetric and positive definite"};
  RigidBodyResponse made(mass, inertia, inverse, capacity);
  const std::string bad = made.set_motion(motion);
  if (!bad.empty()) return Error{"the rigid body has " + bad};
  return made;
}

template <RealScalar Scalar>
std::string RigidBodyResponse<Scalar>::set_motion(const RigidMotion<Scalar>& motion) {
  std::string bad = motion.validate();
  if (!bad.empty()) return bad;
  motion_ = motion;
  const Matrix3<Scalar> R = detail::orthonormal_rotation<Scalar>(motion.R_world_body);
  motion_.R_world_body = R;
  const Matrix3<Scalar> turned = R * inverse_;
  const Matrix3<Scalar> world = turned * R.transpose();
  inverse_world_ = Scalar(0.5) * (world + world.transpose());
  return bad;
}

template <RealScalar Scalar>
void RigidBodyResponse<Scalar>::add_mobility(Eigen::Ref<MatrixX<Scalar>> W) const {
  const Index n = points_.count();
  assert(W.rows() == 3 * n && W.cols() == 3 * n);
  const Scalar lightness = Scalar(1) / mass_;
  for (Index j = 0; j < n; ++j) {
    const Vector3<Scalar> r_j = points_.at(j) - motion_.position;
    const Matrix3<Scalar> spin = inverse_world_ * cross_matrix<Scalar>(r_j);
    for (Index i = 0; i < n; ++i) {
      const Vector3<Scalar> r_i = points_.at(i) - motion_.position;
      const Matrix3<Scalar> turn = cross_matrix<Scalar>(r_i) * spin;
      W.template block<3, 3>(3 * i, 3 * j) -= turn;
      for (Index k = 0; k < 3; ++k) W(3 * i + k, 3 * j + k) += lightness;
    }
  }
}

template <RealScalar Scalar>
void RigidBodyResponse<Scalar>::apply(const Eigen::Ref<const VectorX<Scalar>>& p) {
  assert(p.size() == 3 * points_.count());
  Vector3<Scalar> sum = Vector3<Scalar>::Constant(Scalar(0)), moment = sum;
  for (Index i = 0; i < points_.count(); ++i) {
    const Vector3<Scalar> p_i = p.template segment<3>(3 * i);
    const Vector3<Scalar> r_i = points_.at(i) - motion_.position;
    sum += p_i;
    moment += r_i.cross(p_i);
  }
  motion_.velocity += (Scalar(1) / mass_) * sum;
  motion_.angular_velocity += inverse_world_ * moment;
}

template <RealScalar Scalar>
QueryStatus ParticleResponse<Scalar>::gather(
    std::span<const int> vertices, const Eigen::Ref<const VectorX<Scalar>>& inverse_masses,
    const PointsView<Scalar>& velocities) {
  if (inverse_masses.size() != velocities.cols()) return QueryStatus::InvalidArgument;
  bool finite = true;
  for (const int v : vertices) {
    if (v < 0 || v >= velocities.cols()) return QueryStatus::InvalidArgument;
    const Scalar& w = inverse_masses[v];
    if (!is_finite(w) || w < Scalar(0)) return QueryStatus::InvalidArgument;
    if (!all_finite(velocities.col(v))) finite = false;
  }
  if (!finite) return QueryStatus::InvalidPoint;
  count_ = static_cast<Index>(vertices.size());
  if (inverse_masses_.size() < count_) {
    inverse_masses_.resize(count_);
    velocities_.resize(3, count_);
  }
  for (Index i = 0; i < count_; ++i) {
    const int v = vertices[static_cast<std::size_t>(i)];
    inverse_masses_[i] = inverse_masses[v];
    velocities_.col(i) = velocities.col(v);
  }
  return QueryStatus::Answered;
}

template <RealScalar Scalar>
QueryStatus ParticleResponse<Scalar>::scatter(std::span<const int> vertices,
                                              Eigen::Ref<Points<Scalar>> velocities) const {
  if (static_cast<Index>(vertices.size()) != count_) return QueryStatus::InvalidArgument;
  for (const int v : vertices) {
    if (v < 0 || v >= velocities.cols()) return QueryStatus::InvalidArgument;
  }
  for (Index i = 0; i < count_; ++i)
    velocities.col(vertices[static_cast<std::size_t>(i)]) = velocities_.col(i);
  return QueryStatus::Answered;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
