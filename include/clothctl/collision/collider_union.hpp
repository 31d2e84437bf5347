#pragma once

// Several colliders as one: the parts A_i may overlap.
//
//   d(x) = min_i d_i(x)
//
// Outside of all parts this is the distance from the union. Inside, it is the depth within the
// deepest part, which is less than the depth within the union where parts overlap; the closest
// point then lies inside another part. Both suffice to push a point out, part by part.

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/detail/point_queries.hpp"
#include "clothctl/collision/detail/single_query.hpp"
#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The union of colliders of one type. For colliders of several types let `C` be
/// `ColliderRef<Scalar>`. Of parts at equal distance the first counts. Models Collider.
template <RealScalar Scalar, Collider<Scalar> C = ColliderRef<Scalar>>
class ColliderUnion : public detail::PointQueries<ColliderUnion<Scalar, C>, Scalar> {
 public:
  /// Makes a union of at least one part. Fails when: there are no parts, or the box of a part is
  /// empty or not a number.
  static Result<ColliderUnion> create(std::vector<C> parts) {
    if (parts.empty()) return Error{"the union has no parts"};
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const BoundingBox<Scalar> box = collider_traits<C>::bounds(parts[i], Scalar(0));
      bool good = all_finite(box.lower) && all_finite(box.upper);
      for (int k = 0; k < 3; ++k) good = good && !(box.upper[k] < box.lower[k]);
      if (!good) return Error{"part " + std::to_string(i) + " of the union has no box"};
    }
    return ColliderUnion(std::move(parts));
  }

  /// The parts. Change them between steps, for instance to give them their new motion.
  std::vector<C>& parts() { return parts_; }
  /// The parts.
  const std::vector<C>& parts() const { return parts_; }
  /// Number of parts.
  Index part_count() const { return static_cast<Index>(parts_.size()); }
  /// Refers to part i.
  ColliderRef<Scalar> part(Index i) const {
    if constexpr (std::same_as<C, ColliderRef<Scalar>>)
      return parts_[static_cast<std::size_t>(i)];
    else
      return ColliderRef<Scalar>(parts_[static_cast<std::size_t>(i)]);
  }
  /// A box that holds all parts during a step of `dt` (s).
  BoundingBox<Scalar> bounds(const Scalar& dt) const {
    BoundingBox<Scalar> box = collider_traits<C>::bounds(parts_.front(), dt);
    for (const C& part : parts_) {
      const BoundingBox<Scalar> other = collider_traits<C>::bounds(part, dt);
      box.include(other);
    }
    return box;
  }

  /// Returns the least distance of a finite point from a part, m.
  Scalar distance_at(const Vector3<Scalar>& x) const {
    Scalar best = detail::distance_of<Scalar>(parts_.front(), x);
    for (std::size_t i = 1; i < parts_.size(); ++i) {
      const Scalar d = detail::distance_of<Scalar>(parts_[i], x);
      if (d < best) best = d;
    }
    return best;
  }
  /// Returns everything about the part closest to a finite point.
  SurfacePoint<Scalar> closest_at(const Vector3<Scalar>& x) const {
    SurfacePoint<Scalar> best = detail::closest_of<Scalar>(parts_.front(), x);
    for (std::size_t i = 1; i < parts_.size(); ++i) {
      const SurfacePoint<Scalar> s = detail::closest_of<Scalar>(parts_[i], x);
      if (s.distance < best.distance) best = s;
    }
    return best;
  }
  /// Returns the first time at which a ball with a finite path touches a part.
  Scalar sweep_at(const Vector3<Scalar>& from, const Vector3<Scalar>& to, const Scalar& radius,
                  const Scalar& dt) const {
    Scalar first = no_impact<Scalar>();
    for (const C& part : parts_) {
      const Scalar t = detail::sweep_of<Scalar>(part, from, to, radius, dt);
      if (t < first) first = t;
    }
    return first;
  }

 private:
  explicit ColliderUnion(std::vector<C>&& parts) : parts_(std::move(parts)) {}

  std::vector<C> parts_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
