#pragma once

// Impact zones: sets of vertices that impulses could not keep apart. A zone moves as a rigid body
// from x to x', with the momentum and the angular momentum of its vertices:
//
//   x'_i = c + p + R (x_i - c),   p = Σ m u/Σ m,   R = exp(I⁻¹ Σ m (x - c) × u),   u = y - x
//
// During the step the vertices move straight, that is by the affine map with the matrix
// (1 - t) 1 + t R. It is regular for every t because R turns by less than half a turn, so nothing
// in a zone that is apart at the start meets. Zones that meet merge; this ends at the latest with
// one zone. Reference: Provot 1997; Bridson, Fedkiw, Anderson 2002, §7.
//
// A zone that holds driven vertices follows them: their weight is much larger. Where they move
// against each other no rigid motion agrees with all, and their pairs are tested like others.

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "clothctl/core/types.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Sets of vertices that move rigidly. `resize` allocates.
template <RealScalar Scalar>
class ImpactZones {
 public:
  /// Makes room for `count` vertices. Allocates.
  void resize(std::size_t count) {
    root_.resize(count);
    next_.resize(count);
    last_.resize(count);
    size_.resize(count);
    held_.resize(count);
    clear();
  }
  /// Makes each vertex its own zone.
  void clear() {
    for (std::size_t v = 0; v < root_.size(); ++v) {
      root_[v] = last_[v] = static_cast<int>(v);
      next_[v] = -1;
      size_[v] = 1;
      held_[v] = false;
    }
  }
  /// Marks a vertex as driven.
  void hold(int v) { held_[static_cast<std::size_t>(v)] = true; }

  /// Unites the zones of four vertices. Returns false when they are one already.
  bool merge(const std::array<int, 4>& vertex) {
    bool changed = false;
    for (std::size_t i = 1; i < 4; ++i) {
      int a = root_of(vertex[0]), b = root_of(vertex[i]);
      if (a == b) continue;
      changed = true;
      if (size(a) < size(b)) std::swap(a, b);
      const std::size_t p = static_cast<std::size_t>(a), q = static_cast<std::size_t>(b);
      next_[static_cast<std::size_t>(last_[p])] = b;
      last_[p] = last_[q];
      size_[p] += size_[q];
      held_[p] = held_[p] || held_[q];
      for (int v = b; v >= 0; v = next_[static_cast<std::size_t>(v)])
        root_[static_cast<std::size_t>(v)] = a;
    }
    return changed;
  }
  /// Returns true when the four vertices are in one zone without driven vertices.
  bool rigid(const std::array<int, 4>& vertex) const {
    const int a = root_of(vertex[0]);
    return !held_[static_cast<std::size_t>(a)] && root_of(vertex[1]) == a &&
           root_of(vertex[2]) == a && root_of(vertex[3]) == a;
  }
  /// Returns the number of zones of more than one vertex.
  int count() const {
    int sum = 0;
    for (std::size_t v = 0; v < root_.size(); ++v)
      sum += root_[v] == static_cast<int>(v) && size_[v] > 1 ? 1 : 0;
    return sum;
  }

  /// Writes the rigid motion of each zone to `y`, from the start `x` and the free end `wanted`
  /// (3×n, m). Vertices of inverse mass 0 stay.
  void move(const Points<Scalar>& x, const Points<Scalar>& wanted,
            const VectorX<Scalar>& inverse_mass, Points<Scalar>& y) const {
    for (std::size_t v = 0; v < root_.size(); ++v) {
      if (root_[v] == static_cast<int>(v) && size_[v] > 1)
        move_zone(static_cast<int>(v), x, wanted, inverse_mass, y);
    }
  }

 private:
  int root_of(int v) const { return root_[static_cast<std::size_t>(v)]; }
  int size(int v) const { return size_[static_cast<std::size_t>(v)]; }
  int after(int v) const { return next_[static_cast<std::size_t>(v)]; }

  void move_zone(int root, const Points<Scalar>& x, const Points<Scalar>& wanted,
                 const VectorX<Scalar>& inverse_mass, Points<Scalar>& y) const {
    Scalar free_mass(0);
    for (int v = root; v >= 0; v = after(v)) {
      if (Scalar(0) < inverse_mass[v]) free_mass += Scalar(1) / inverse_mass[v];
    }
    const Scalar held_mass = Scalar(1e4) * (Scalar(0) < free_mass ? free_mass : Scalar(1));
    const auto mass = [&](int v) {
      return Scalar(0) < inverse_mass[v] ? Scalar(Scalar(1) / inverse_mass[v]) : held_mass;
    };
    const Vector3<Scalar> base = x.col(root);
    Vector3<Scalar> centre = Vector3<Scalar>::Constant(Scalar(0)), way = centre, spin = centre;
    Scalar sum(0);
    for (int v = root; v >= 0; v = after(v)) {
      const Scalar m = mass(v);
      sum += m;
      centre += m * (x.col(v) - base);
      way += m * (wanted.col(v) - x.col(v));
    }
    centre = base + centre / sum;
    way /= sum;
    Matrix3<Scalar> inertia = Matrix3<Scalar>::Constant(Scalar(0));
    for (int v = root; v >= 0; v = after(v)) {
      const Vector3<Scalar> r = x.col(v) - centre, u = wanted.col(v) - x.col(v) - way;
      const Scalar m = mass(v);
      spin += m * r.cross(u);
      inertia -= m * r * r.transpose();
      for (int i = 0; i < 3; ++i) inertia(i, i) += m * r.squaredNorm();
    }
    const Matrix3<Scalar> turn = rotation(inertia, spin);
    for (int v = root; v >= 0; v = after(v)) {
      if (!(Scalar(0) < inverse_mass[v])) continue;
      const Vector3<Scalar> r = x.col(v) - centre;
      y.col(v) = centre + way + turn * r;
    }
  }

  /// Returns the rotation by I⁻¹ L, at most by one radian. Along an axis without inertia nothing
  /// turns.
  static Matrix3<Scalar> rotation(Matrix3<Scalar> inertia, const Vector3<Scalar>& spin) {
    using std::cos;
    using std::sin;
    using std::sqrt;
    Matrix3<Scalar> out = Matrix3<Scalar>::Constant(Scalar(0));
    for (int i = 0; i < 3; ++i) out(i, i) = Scalar(1);
    const Scalar trace = inertia(0, 0) + inertia(1, 1) + inertia(2, 2);
    if (!(Scalar(0) < trace)) return out;
    for (int i = 0; i < 3; ++i) inertia(i, i) += Scalar(1e-5) * trace;
    const Vector3<Scalar> a = inertia.col(0), b = inertia.col(1), c = inertia.col(2);
    const Vector3<Scalar> bc = b.cross(c), ca = c.cross(a), ab = a.cross(b);
    Vector3<Scalar> axis(bc.dot(spin), ca.dot(spin), ab.dot(spin));
    axis /= a.dot(bc);
    Scalar angle = sqrt(axis.squaredNorm());
    if (!(scalar_traits<Scalar>::epsilon() < angle)) return out;
    axis /= angle;
    if (Scalar(1) < angle) angle = Scalar(1);
    const Scalar s = sin(angle), one_less = Scalar(1) - cos(angle);
    Matrix3<Scalar> cross;
    cross << Scalar(0), -axis[2], axis[1], axis[2], Scalar(0), -axis[0], -axis[1], axis[0],
        Scalar(0);
    out += s * cross + one_less * cross * cross;
    return out;
  }

  /// The first vertex of the zone of each vertex, the next one in its list, and for first vertices
  /// the last one, the number, and whether a driven vertex is in.
  std::vector<int> root_, next_, last_, size_;
  std::vector<bool> held_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
