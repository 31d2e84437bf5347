#pragma once

// The points of a contact of two bodies, and how many of them are kept. Four corners of a large
// area hold a face as well as many do: the first is the deepest, or an extreme one in a fixed
// direction where several are as deep; the second is farthest from it; the third and the fourth
// span the largest area on either side of the line through both. A point replaces an earlier one
// only if it is better by a tolerance, so that rounding does not change the choice from step to
// step.

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "clothctl/collision/detail/basic_shape.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI {

/// A point of a contact between a body A and a body or obstacle B.
template <RealScalar Scalar>
struct BodyContactPoint {
  /// Midway between both surfaces, m (world).
  Vector3<Scalar> position = Vector3<Scalar>::Constant(Scalar(0));
  /// Unit normal from B to A.
  Vector3<Scalar> normal = Vector3<Scalar>::Constant(Scalar(0));
  /// Distance of the surfaces along the normal, m; negative where they overlap.
  Scalar gap = Scalar(0);
  /// What touches what: the same corner, edge or face has the same number in the next step.
  std::uint32_t feature = 0;
  /// Velocity of the surface of a collider B, m/s; 0 for a body B.
  Vector3<Scalar> drift = Vector3<Scalar>::Constant(Scalar(0));
  /// Friction coefficient of a collider B; -1 for a body B.
  Scalar friction = Scalar(-1);
};

/// Most points of a contact of two bodies, or of a body and an obstacle.
inline constexpr int kMostBodyContacts = 8;

/// The points of a contact: up to 4 of two convex bodies, up to 8 with an obstacle.
template <RealScalar Scalar>
struct BodyContacts {
  /// The first `count` are points of the contact.
  std::array<BodyContactPoint<Scalar>, static_cast<std::size_t>(kMostBodyContacts)> points;
  /// Number of points.
  int count = 0;

  /// Adds a point if there is room.
  void add(const BodyContactPoint<Scalar>& point) {
    if (count < kMostBodyContacts) points[static_cast<std::size_t>(count++)] = point;
  }
};

namespace detail {

/// Chooses up to four of `count` points that share the normal `n`.
template <RealScalar Scalar>
class ContactReduction {
 public:
  using Point = BodyContactPoint<Scalar>;

  ContactReduction(const Point* points, int count, const Vector3<Scalar>& n)
      : points_(points), count_(count), n_(n), along_(unit_orthogonal<Scalar>(n)) {
    for (int i = 1; i < count; ++i) {
      const Scalar reach = (at(i) - at(0)).squaredNorm();
      if (size_ < reach) size_ = reach;
    }
    using std::sqrt;
    size_ = sqrt(size_);
  }

  /// Writes the numbers of the chosen points and returns how many there are.
  int choose(std::array<int, 4>& chosen) const {
    if (count_ <= 4) {
      for (int i = 0; i < count_; ++i) chosen[static_cast<std::size_t>(i)] = i;
      return count_;
    }
    const Scalar step = Scalar(1e-3) * size_;
    const int a = first(step);
    const int b = best(
        step * step, [&](int i) { return (at(i) - at(a)).squaredNorm(); }, a, a, a);
    const auto area = [&](int i) {
      const Vector3<Scalar> u = at(b) - at(a), v = at(i) - at(a);
      return u.cross(v).dot(n_);
    };
    const int c = best(step * size_, area, a, b, b);
    const int d = best(
        step * size_, [&](int i) { return Scalar(-area(i)); }, a, b, c);
    int n = 0;
    for (const int i : {a, b, c, d}) {
      if (i >= 0) chosen[static_cast<std::size_t>(n++)] = i;
    }
    return n;
  }

 private:
  const Vector3<Scalar>& at(int i) const { return points_[i].position; }
  /// The deepest point, or of several the extreme one.
  int first(const Scalar& step) const {
    Scalar deepest = points_[0].gap;
    for (int i = 1; i < count_; ++i) {
      if (points_[i].gap < deepest) deepest = points_[i].gap;
    }
    int chosen = -1;
    for (int i = 0; i < count_; ++i) {
      if (deepest + step < points_[i].gap) continue;
      if (chosen < 0 || step < along_.dot(Vector3<Scalar>(at(i) - at(chosen)))) chosen = i;
    }
    return chosen;
  }
  /// The point with the largest positive value, but for three; -1 if none.
  template <class Value>
  int best(const Scalar& step, const Value& value, int p, int q, int r) const {
    int chosen = -1;
    Scalar most(0);
    for (int i = 0; i < count_; ++i) {
      if (i == p || i == q || i == r) continue;
      const Scalar now = value(i);
      if (!(most + step < now)) continue;
      most = now;
      chosen = i;
    }
    return chosen;
  }

  const Point* points_;
  int count_;
  Vector3<Scalar> n_, along_;
  Scalar size_ = Scalar(0);
};

/// Adds the points, reduced to four if there are more, to a contact.
template <RealScalar Scalar>
void add_reduced(const BodyContactPoint<Scalar>* points, int count, const Vector3<Scalar>& n,
                 BodyContacts<Scalar>& out) {
  std::array<int, 4> chosen{};
  const int kept = ContactReduction<Scalar>(points, count, n).choose(chosen);
  for (int i = 0; i < kept; ++i) out.add(points[chosen[static_cast<std::size_t>(i)]]);
}

}  // namespace detail
}  // namespace clothctl::inline CLOTHCTL_ABI
