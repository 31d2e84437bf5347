#pragma once

// The state of a sheet and the input of a step: plain values that can be copied, compared and
// stored.

#include <cmath>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Positions and velocities of the vertices. World frame, z up.
template <RealScalar Scalar>
struct ClothState {
  /// Vertex positions, 3×n, m.
  Points<Scalar> positions;
  /// Vertex velocities, 3×n, m/s.
  Points<Scalar> velocities;

  /// Returns true when all coordinates are equal as numbers (-0 equals 0, NaN equals nothing).
  bool operator==(const ClothState& other) const {
    return positions.cols() == other.positions.cols() &&
           velocities.cols() == other.velocities.cols() && positions == other.positions &&
           velocities == other.velocities;
  }
};

/// What carries a vertex, such as a table, for models that know no obstacles: its force now, f, and
/// where it ends. For a displacement d from where the vertex is now, models that are nonlinear take
/// f - k (n·d) n with k = f·n/release where n·d < release, and nothing beyond. The part across n is
/// friction, which stays.
template <RealScalar Scalar>
struct VertexSupport {
  /// The vertex.
  int vertex = 0;
  /// Direction in which the vertex can leave, unit.
  Vector3<Scalar> normal = Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(1));
  /// What is exerted on the vertex now, N.
  Vector3<Scalar> force = Vector3<Scalar>::Zero();
  /// The way along the normal on which the force ends, m; unbounded for a force that does not.
  Scalar release = Scalar(0.001);

  /// Returns k, N/m; 0 for a force that does not push.
  Scalar stiffness() const {
    const Scalar pressed = force.dot(normal);
    return Scalar(0) < pressed ? Scalar(pressed / release) : Scalar(0);
  }
};

/// Sums what carries a vertex in several places, or several vertices of a finer sheet.
template <RealScalar Scalar>
class SupportSum {
 public:
  /// Adds a share of a support.
  void add(const VertexSupport<Scalar>& support, const Scalar& share) {
    const Scalar pressed = share * support.force.dot(support.normal);
    force_ += share * support.force;
    stiffness_ += share * support.stiffness();
    if (!(Scalar(0) < pressed)) return;
    normal_ += pressed * support.normal;
    pressed_ += pressed;
  }
  /// Returns true when nothing was added that pushes or pulls.
  bool empty() const { return !(Scalar(0) < force_.squaredNorm()); }
  /// Returns the sum for a vertex: all forces, their mean normal and stiffness. Where they press
  /// against each other (the mean normal is shorter than a half), or none of them presses, the
  /// vertex cannot leave, and the force does not end.
  VertexSupport<Scalar> of(int vertex) const {
    using std::sqrt;
    VertexSupport<Scalar> sum;
    sum.vertex = vertex;
    sum.force = force_;
    sum.release = scalar_traits<Scalar>::infinity();
    const Scalar size = sqrt(normal_.squaredNorm());
    if (!(Scalar(0) < pressed_) || !(pressed_ < Scalar(2) * size)) return sum;
    const Vector3<Scalar> normal = normal_ / size;
    const Scalar along = force_.dot(normal);
    if (!(Scalar(0) < along)) return sum;
    sum.normal = normal;
    sum.release = along / stiffness_;
    return sum;
  }

 private:
  Vector3<Scalar> force_ = Vector3<Scalar>::Zero(), normal_ = Vector3<Scalar>::Zero();
  Scalar pressed_ = Scalar(0), stiffness_ = Scalar(0);
};

/// What acts on a sheet during one step. World frame. Forces on a driven vertex have no effect.
template <RealScalar Scalar>
struct ClothInput {
  /// Vertices that a force acts on. An index may occur more than once: the forces add up.
  std::vector<int> force_vertices;
  /// Forces, 3×force_vertices.size(), N, constant over the step.
  Points<Scalar> forces;
  /// Vertices whose motion is prescribed. An index may occur once only.
  std::vector<int> driven_vertices;
  /// Positions of the driven vertices at the end of the step, 3×driven_vertices.size(), m.
  Points<Scalar> driven_positions;
  /// Velocity of the air, m/s.
  Vector3<Scalar> wind = Vector3<Scalar>::Zero();
  /// Vertices that a spring of rest length zero ties to a point: a soft grip, a mouse, a haptic
  /// device. An index may occur more than once: the forces add up. A spring on a driven or pinned
  /// vertex has no effect.
  std::vector<int> attached_vertices = {};
  /// The points at the end of the step, 3×attached_vertices.size(), m. They are there during the
  /// whole step.
  Points<Scalar> attached_positions = {};
  /// Stiffness of each of these springs, attached_vertices.size(), positive, N/m.
  VectorX<Scalar> attachment_stiffness = {};

  /// Removes forces, driven vertices, attachments and wind. The index lists keep their memory.
  void clear() {
    force_vertices.clear();
    forces.resize(3, 0);
    driven_vertices.clear();
    driven_positions.resize(3, 0);
    wind.setZero();
    attached_vertices.clear();
    attached_positions.resize(3, 0);
    attachment_stiffness.resize(0);
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI
