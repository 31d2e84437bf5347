#pragma once

// The contact models of grasp mechanics, for a finger that holds m vertices of a sheet with unit
// normals n_j (concepts/contact_model.hpp):
//
//   frictionless   f_j = d_j n_j
//   hard finger    f_j inside of the friction pyramid about n_j: point contact with friction
//   soft finger    one contact for the whole patch: force and torsion τ about the mean normal n̄,
//                  |f_t|²/μ² + τ²/e² <= f_n²
//   adhesive       a hard finger that also pulls, up to a: |f_t| <= μ (f_n + a/m), f_n >= -a/m at
//                  each vertex. A suction cup, or the sticky finger of [Toh 2011]
//
// Reference for the soft finger's ellipsoid: Li, Kao, A review of modeling of soft-contact fingers
// and stiffness control for dextrous manipulation in robotics (2001).

#include <cmath>
#include <string>
#include <utility>

#include "clothctl/concepts/contact_model.hpp"
#include "clothctl/contact/friction_cone.hpp"
#include "clothctl/core/number_text.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

namespace detail {

/// Returns an empty string, or why `value` is no parameter: it must be finite and not negative.
template <RealScalar Scalar>
std::string validate_parameter(const char* name, const Scalar& value) {
  if (is_finite(value) && !(value < Scalar(0))) return {};
  return std::string("the ") + name + " " + number_text(value) +
         ", must be finite and not negative";
}

/// Returns an empty string, or why so many generators span no pyramid.
inline std::string validate_generators(int count) {
  if (count >= 4 && count <= 1024) return {};
  return std::to_string(count) + " generators, must be 4 to 1024";
}

/// Returns the largest violation (N) of the vertices' friction cones, each moved by `pull` (N)
/// against its normal, and of the limit on the sum of the normal forces.
template <RealScalar Scalar>
Scalar worst_cone_violation(const PointsView<Scalar>& normals, const PointsView<Scalar>& forces,
                            const Scalar& friction, const Scalar& pull,
                            const Scalar& max_normal_force) {
  Scalar worst(0), total(0);
  for (Index j = 0; j < forces.cols(); ++j) {
    const Vector3<Scalar> normal = normals.col(j), force = forces.col(j);
    total += force.dot(normal);
    const Vector3<Scalar> shifted = force + pull * normal;
    const Scalar violation =
        cone_violation<Scalar>(shifted, normal, friction, Scalar(shifted.dot(normal)));
    if (worst < violation) worst = violation;
  }
  if (worst < total - max_normal_force) worst = total - max_normal_force;
  if (!is_finite(total) || !is_finite(max_normal_force)) return scalar_traits<Scalar>::infinity();
  return worst;
}

}  // namespace detail

/// Pushes only along the normals. Models ContactModel.
template <RealScalar Scalar>
struct Frictionless {
  /// One generator for each vertex.
  Index generators(Index vertices) const { return vertices; }
  /// Generator i acts on vertex i.
  std::pair<Index, Index> support(Index, Index i) const { return {i, 1}; }
  /// Writes the normals (3m × m, block diagonal).
  void fill(const PointsView<Scalar>&, const PointsView<Scalar>& normals,
            Eigen::Ref<MatrixX<Scalar>> out) const {
    out.setConstant(Scalar(0));
    for (Index j = 0; j < normals.cols(); ++j) out.template block<3, 1>(3 * j, j) = normals.col(j);
  }
  /// 1: a generator is a unit normal.
  Scalar normal_share(Index, Index) const { return Scalar(1); }
  /// The limit itself.
  Scalar upper_bound(Index, Index, const Scalar& max_normal_force) const {
    return max_normal_force;
  }
  /// The largest tangential or pulling force of a vertex, or the excess over the limit, N.
  Scalar violation(const PointsView<Scalar>&, const PointsView<Scalar>& normals,
                   const PointsView<Scalar>& forces, const Scalar& max_normal_force) const {
    return detail::worst_cone_violation<Scalar>(normals, forces, Scalar(0), Scalar(0),
                                                max_normal_force);
  }
  /// Always an empty string: there are no parameters.
  std::string validate() const { return {}; }
};

/// Point contact with friction at each vertex: the default, [Bai 2016], eq. 1-2. Models
/// ContactModel.
template <RealScalar Scalar>
struct HardFinger {
  /// Friction coefficient μ.
  Scalar friction = Scalar(0.5);
  /// Generators n_g of the friction pyramid at each vertex, 4 to 1024.
  int pyramid = 4;

  /// n_g generators for each vertex, vertex by vertex.
  Index generators(Index vertices) const { return vertices * pyramid; }
  /// A generator acts on one vertex.
  std::pair<Index, Index> support(Index, Index i) const { return {i / pyramid, 1}; }
  /// Writes the friction pyramids (3m × m·n_g, block diagonal).
  void fill(const PointsView<Scalar>&, const PointsView<Scalar>& normals,
            Eigen::Ref<MatrixX<Scalar>> out) const {
    out.setConstant(Scalar(0));
    for (Index j = 0; j < normals.cols(); ++j)
      friction_generators<Scalar>(normals.col(j), friction,
                                  out.block(3 * j, j * pyramid, 3, pyramid));
  }
  /// 1/√(1+μ²).
  Scalar normal_share(Index, Index) const { return Scalar(1) / generator_slant(friction); }
  /// The limit times √(1+μ²).
  Scalar upper_bound(Index, Index, const Scalar& max_normal_force) const {
    return max_normal_force * generator_slant(friction);
  }
  /// The largest violation of a vertex's friction cone, or the excess over the limit, N.
  Scalar violation(const PointsView<Scalar>&, const PointsView<Scalar>& normals,
                   const PointsView<Scalar>& forces, const Scalar& max_normal_force) const {
    return detail::worst_cone_violation<Scalar>(normals, forces, friction, Scalar(0),
                                                max_normal_force);
  }
  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    std::string problem = detail::validate_parameter("friction coefficient", friction);
    return problem.empty() ? detail::validate_generators(pyramid) : problem;
  }
};

/// A hard finger that also pulls: suction cup, sticky finger. Models ContactModel.
template <RealScalar Scalar>
struct AdhesiveFinger {
  /// The finger without adhesion.
  HardFinger<Scalar> finger = {};
  /// Largest pull a of the whole finger, N; its vertices share it equally.
  Scalar strength = Scalar(5);

  /// As many as without adhesion.
  Index generators(Index vertices) const { return finger.generators(vertices); }
  /// As without adhesion.
  std::pair<Index, Index> support(Index vertices, Index i) const {
    return finger.support(vertices, i);
  }
  /// Writes the friction pyramids of the finger; their apex lies at -(a/m) n_j.
  void fill(const PointsView<Scalar>& points, const PointsView<Scalar>& normals,
            Eigen::Ref<MatrixX<Scalar>> out) const {
    finger.fill(points, normals, out);
  }
  /// 1/√(1+μ²).
  Scalar normal_share(Index vertices, Index i) const { return finger.normal_share(vertices, i); }
  /// The coefficient that raises the normal force from -a to the limit.
  Scalar upper_bound(Index vertices, Index i, const Scalar& max_normal_force) const {
    return finger.upper_bound(vertices, i, Scalar(max_normal_force + strength));
  }
  /// The largest violation of a vertex's shifted cone, or the excess over the limit, N.
  Scalar violation(const PointsView<Scalar>&, const PointsView<Scalar>& normals,
                   const PointsView<Scalar>& forces, const Scalar& max_normal_force) const {
    const Scalar pull = strength / Scalar(static_cast<double>(forces.cols()));
    return detail::worst_cone_violation<Scalar>(normals, forces, finger.friction, pull,
                                                max_normal_force);
  }
  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    std::string problem = finger.validate();
    return problem.empty() ? detail::validate_parameter("adhesion", strength) : problem;
  }
  /// a, N.
  Scalar adhesion() const { return strength; }
};

/// One contact for the whole patch, with friction and torsion about the mean normal. Models
/// ContactModel.
///
/// Force and torsion are spread over the vertices: f_j = f/m + τ (n̄ × r_j) / Σ |n̄ × r_j|², with
/// r_j the vector from the patch's centroid to vertex j. A patch without extent (one vertex)
/// transmits no torsion.
template <RealScalar Scalar>
struct SoftFinger {
  /// Friction coefficient μ.
  Scalar friction = Scalar(0.5);
  /// Torsional friction coefficient e: the largest ratio of torsion to normal force, m.
  Scalar torsional_friction = Scalar(0.005);
  /// Generators n_g of the friction pyramid, 4 to 1024; two more carry the torsion.
  int pyramid = 8;

  /// n_g tangential generators and two torsional ones.
  Index generators(Index) const { return pyramid + 2; }
  /// Every generator acts on all vertices.
  std::pair<Index, Index> support(Index vertices, Index) const { return {0, vertices}; }
  /// Writes the generators (3m × (n_g + 2)): unit generators of the pyramid about n̄, shared by all
  /// vertices, then (n̄ ± torsion e)/m.
  void fill(const PointsView<Scalar>& points, const PointsView<Scalar>& normals,
            Eigen::Ref<MatrixX<Scalar>> out) const {
    const Vector3<Scalar> n = mean_normal(normals), centre = centroid(points);
    const Index m = points.cols();
    const Scalar share = Scalar(1) / Scalar(static_cast<double>(m));
    friction_generators<Scalar>(n, friction, out.block(0, 0, 3, pyramid));
    for (Index j = m; j-- > 0;)
      out.block(3 * j, 0, 3, pyramid) = share * out.block(0, 0, 3, pyramid);
    const Scalar lever = squared_lever(points, n, centre);
    for (Index j = 0; j < m; ++j) {
      const Vector3<Scalar> r = points.col(j) - centre;
      Vector3<Scalar> turn = Vector3<Scalar>::Constant(Scalar(0));
      if (Scalar(0) < lever) turn = n.cross(r) * (torsional_friction / lever);
      out.template block<3, 1>(3 * j, pyramid) = share * n + turn;
      out.template block<3, 1>(3 * j, pyramid + 1) = share * n - turn;
    }
  }
  /// 1/√(1+μ²) for the pyramid, 1 for the torsional generators.
  Scalar normal_share(Index, Index i) const {
    return i < pyramid ? Scalar(1) / generator_slant(friction) : Scalar(1);
  }
  /// The coefficient that reaches the limit when all others are zero.
  Scalar upper_bound(Index, Index i, const Scalar& max_normal_force) const {
    return i < pyramid ? Scalar(max_normal_force * generator_slant(friction)) : max_normal_force;
  }
  /// The largest of these, N: √(|f_t|² + (μ τ/e)²) - μ f_n; (|τ| - e f_n)/ρ, with ρ the rms
  /// distance of the vertices from the axis n̄ through the centroid; the pull -f_n; the excess over
  /// the limit; and the difference between a vertex's force and the spread above.
  Scalar violation(const PointsView<Scalar>& points, const PointsView<Scalar>& normals,
                   const PointsView<Scalar>& forces, const Scalar& max_normal_force) const {
    using std::sqrt;
    const Vector3<Scalar> n = mean_normal(normals), centre = centroid(points);
    Vector3<Scalar> total = Vector3<Scalar>::Constant(Scalar(0));
    Scalar torsion(0);
    for (Index j = 0; j < points.cols(); ++j) {
      const Vector3<Scalar> r = points.col(j) - centre, f = forces.col(j);
      total += f;
      torsion += n.dot(r.cross(f));
    }
    const Scalar f_n = total.dot(n);
    const Vector3<Scalar> f_t = total - f_n * n;
    Scalar twist(0);
    if (Scalar(0) < torsional_friction) twist = friction * torsion / torsional_friction;
    Scalar worst = sqrt(f_t.squaredNorm() + twist * twist) - friction * f_n;
    if (!is_finite(worst)) return scalar_traits<Scalar>::infinity();
    const Scalar share = Scalar(1) / Scalar(static_cast<double>(points.cols()));
    const Scalar lever = squared_lever(points, n, centre);
    if (Scalar(0) < lever) {
      const Scalar size = torsion < Scalar(0) ? Scalar(-torsion) : torsion;
      const Scalar excess = (size - torsional_friction * f_n) / sqrt(lever * share);
      if (worst < excess) worst = excess;
    }
    const Scalar rounding =
        Scalar(32) * scalar_traits<Scalar>::epsilon() * sqrt(forces.squaredNorm());
    for (Index j = 0; j < points.cols(); ++j) {
      Vector3<Scalar> rest = forces.col(j) - share * total;
      if (Scalar(0) < lever) {
        const Vector3<Scalar> r = points.col(j) - centre;
        rest -= n.cross(r) * (torsion / lever);
      }
      const Scalar distance = sqrt(rest.squaredNorm()) - rounding;
      if (!(distance <= worst)) worst = distance;
    }
    if (worst < -f_n) worst = -f_n;
    if (worst < f_n - max_normal_force) worst = f_n - max_normal_force;
    if (!is_finite(worst) || !is_finite(max_normal_force)) return scalar_traits<Scalar>::infinity();
    return Scalar(0) < worst ? worst : Scalar(0);
  }
  /// Returns an empty string, or what is wrong.
  std::string validate() const {
    std::string problem = detail::validate_parameter("friction coefficient", friction);
    if (problem.empty())
      problem = detail::validate_parameter("torsional friction", torsional_friction);
    return problem.empty() ? detail::validate_generators(pyramid) : problem;
  }

 private:
  static Vector3<Scalar> centroid(const PointsView<Scalar>& points) {
    Vector3<Scalar> sum = Vector3<Scalar>::Constant(Scalar(0));
    for (Index j = 0; j < points.cols(); ++j) sum += points.col(j);
    return sum / Scalar(static_cast<double>(points.cols()));
  }
  /// Returns the normalised mean of the normals, or the first normal where they cancel.
  static Vector3<Scalar> mean_normal(const PointsView<Scalar>& normals) {
    using std::sqrt;
    const Vector3<Scalar> mean = centroid(normals);
    const Scalar length = sqrt(mean.squaredNorm());
    if (length <= Scalar(1e-3)) return normals.col(0);  // a NaN goes on, for violation to see
    return mean / length;
  }
  static Scalar squared_lever(const PointsView<Scalar>& points, const Vector3<Scalar>& n,
                              const Vector3<Scalar>& centre) {
    Scalar sum(0);
    for (Index j = 0; j < points.cols(); ++j)
      sum += n.cross(Vector3<Scalar>(points.col(j) - centre)).squaredNorm();
    return sum;
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI
