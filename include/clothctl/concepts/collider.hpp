#pragma once

// Collider: a solid that a sheet may touch, through batched queries about its surface.
//
// A solid S has a signed distance: d(x) = ± distance from x to the surface, negative inside S.
// Where the closest surface point q(x) is unique,
//
//   q(x) = x - d(x) n(x),     n(x) = ∇d(x),     |∇d| = 1,     |d(x) - d(y)| <= |x - y|
//
// n is the outward unit normal at q. A sweep moves a ball of radius r on a straight line from a to
// b during a step of length h, while the solid moves too. It returns the time of impact, as a share
// of the step,
//
//   min { t in [0, 1] : d(a + t (b - a), t h) <= r }
//
// where d(x, s) is the distance from the solid where it is after the time s. All queries are about
// the solid as it is at the start of the step, in world coordinates.

#include <concepts>
#include <memory>
#include <span>
#include <string_view>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a query of a collider ended.
enum class QueryStatus {
  /// All points were answered. Use the answers.
  Answered,
  /// A coordinate of a point is not finite. That point has the answer "nothing there" (the comments
  /// of the query say how it looks), all others have theirs. Correct the points.
  InvalidPoint,
  /// Input and output differ in length, or a radius or a time is negative or not finite. Nothing
  /// was written. Correct the call.
  InvalidArgument
};

/// Returns the name of the status of a query.
constexpr std::string_view to_string(QueryStatus status) {
  switch (status) {
    case QueryStatus::Answered: return "answered";
    case QueryStatus::InvalidPoint: return "invalid_point";
    case QueryStatus::InvalidArgument: return "invalid_argument";
  }
  return "unknown";
}

/// The time of impact of a sweep that hits nothing; times of impact are 0 to 1.
template <RealScalar Scalar>
Scalar no_impact() {
  return Scalar(2);
}

/// What a collider answers about one point. The default is the answer for a point that is not
/// finite.
template <RealScalar Scalar>
struct SurfacePoint {
  /// Signed distance d, m; negative inside.
  Scalar distance = scalar_traits<Scalar>::infinity();
  /// The closest point q of the surface, m.
  Vector3<Scalar> point = Vector3<Scalar>::Constant(Scalar(0));
  /// Outward unit normal at q.
  Vector3<Scalar> normal = Vector3<Scalar>::Constant(Scalar(0));
  /// Velocity of the collider's material at q, m/s.
  Vector3<Scalar> velocity = Vector3<Scalar>::Constant(Scalar(0));
  /// Friction coefficient there.
  Scalar friction = Scalar(0);
  /// The body that the surface belongs to: a number of the caller's, or -1 for no body.
  int body = -1;
};

/// A box along the axes, m. A side without bound is at ±1e30.
template <RealScalar Scalar>
struct BoundingBox {
  /// The corner with the smallest coordinates.
  Vector3<Scalar> lower = Vector3<Scalar>::Constant(Scalar(-1e30));
  /// The corner with the largest coordinates.
  Vector3<Scalar> upper = Vector3<Scalar>::Constant(Scalar(1e30));

  /// Returns true when the boxes have a point in common.
  bool overlaps(const BoundingBox& other) const {
    for (int i = 0; i < 3; ++i) {
      if (other.upper[i] < lower[i] || upper[i] < other.lower[i]) return false;
    }
    return true;
  }
  /// Returns the box with each side moved outwards by `margin` (m).
  BoundingBox grown(const Scalar& margin) const {
    const Vector3<Scalar> by = Vector3<Scalar>::Constant(margin);
    return {lower - by, upper + by};
  }
  /// Grows the box so that it holds `point`.
  void include(const Vector3<Scalar>& point) {
    for (int i = 0; i < 3; ++i) {
      if (point[i] < lower[i]) lower[i] = point[i];
      if (upper[i] < point[i]) upper[i] = point[i];
    }
  }
  /// Grows the box so that it holds `other`.
  void include(const BoundingBox& other) {
    include(other.lower);
    include(other.upper);
  }
};

/// How a type acts as a collider. The primary template forwards to members of the same names.
template <class C>
struct collider_traits {
  /// Writes the signed distances (n, m) of `points` (3×n, m). infinity() for a point that is not
  /// finite. Must not allocate.
  template <class Positions, class Values>
  requires requires(const C& c, const Positions& x, Values& d) {
    { c.distance(x, d) } -> std::same_as<QueryStatus>;
  }
  static QueryStatus distance(const C& collider, const Positions& points, Values&& out) {
    return collider.distance(points, out);
  }

  /// Writes everything about the closest surface points (a span of n `SurfacePoint`) of `points`
  /// (3×n, m). The default `SurfacePoint` for a point that is not finite. Must not allocate.
  template <class Positions, class Answers>
  requires requires(const C& c, const Positions& x, const Answers& s) {
    { c.closest(x, s) } -> std::same_as<QueryStatus>;
  }
  static QueryStatus closest(const C& collider, const Positions& points, const Answers& out) {
    return collider.closest(points, out);
  }

  /// Writes the times of impact (n, shares of the step) of balls of radius `radius` (m) that move
  /// straight from `from` to `to` (3×n, m) during a step of `dt` (s); `no_impact()` for a ball that
  /// hits nothing or is not finite. Must not allocate.
  template <class Positions, class Scalar, class Values>
  requires requires(const C& c, const Positions& x, const Scalar& s, Values& t) {
    { c.sweep(x, x, s, s, t) } -> std::same_as<QueryStatus>;
  }
  static QueryStatus sweep(const C& collider, const Positions& from, const Positions& to,
                           const Scalar& radius, const Scalar& dt, Values&& out) {
    return collider.sweep(from, to, radius, dt, out);
  }

  /// Returns a box that holds the collider during a whole step of `dt` (s).
  template <class Scalar>
  requires requires(const C& c, const Scalar& dt) { c.bounds(dt); }
  static auto bounds(const C& collider, const Scalar& dt) { return collider.bounds(dt); }

  /// Returns whether the solid is convex. Optional.
  static bool is_convex(const C& collider) requires requires { collider.is_convex(); }
  { return collider.is_convex(); }

  /// Returns the number of parts of a union. Optional.
  static Index part_count(const C& collider) requires requires { collider.part_count(); }
  { return collider.part_count(); }

  /// Returns part `i` of a union as a `ColliderRef`. Optional.
  static auto part(const C& collider, Index i) requires requires { collider.part(i); }
  { return collider.part(i); }
};

/// A solid that a sheet may touch.
///
/// Axioms: the formulas at the top of this header, to rounding, or to an error that the type
/// states; a union may understate depths inside of it, and its closest point may lie inside another
/// part. A point that is inside, or closer than the radius, when a sweep starts has the time 0. A
/// sweep may be early by a length that the type states, never late, and passes through nothing,
/// however thin. The box holds every surface point during the step. A batch gives the same bits as
/// its points one by one; repeated queries give the same bits. Nothing allocates, throws or prints.
///
/// Optional hooks: `is_convex(c)`, whether the solid is convex, no if missing; `part_count(c)` and
/// `part(c, i)`, the parts of a union, each as a ColliderRef. With them, points inside triangles
/// are found faster and more surely.
template <class C, class Scalar = double>
concept Collider = RealScalar<Scalar> &&
    requires(const C& collider, const PointsView<Scalar>& x, Eigen::Ref<VectorX<Scalar>> values,
             std::span<SurfacePoint<Scalar>> out, const Scalar& number) {
  { collider_traits<C>::distance(collider, x, values) } -> std::same_as<QueryStatus>;
  { collider_traits<C>::closest(collider, x, out) } -> std::same_as<QueryStatus>;
  {
    collider_traits<C>::sweep(collider, x, x, number, number, values)
    } -> std::same_as<QueryStatus>;
  { collider_traits<C>::bounds(collider, number) } -> std::convertible_to<BoundingBox<Scalar>>;
};

/// A reference to any collider, so that a list can hold colliders of many types. Models Collider.
template <RealScalar Scalar>
class ColliderRef {
 public:
  /// Refers to a collider, which must outlive this.
  template <Collider<Scalar> C>
  requires(!std::same_as<C, ColliderRef>) explicit ColliderRef(const C& collider)
      : collider_(std::addressof(collider)), calls_(&kCalls<C>) {}

  /// See `collider_traits::distance`.
  QueryStatus distance(const PointsView<Scalar>& points, Eigen::Ref<VectorX<Scalar>> out) const {
    return calls_->distance(collider_, points, out);
  }
  /// See `collider_traits::closest`.
  QueryStatus closest(const PointsView<Scalar>& points, std::span<SurfacePoint<Scalar>> out) const {
    return calls_->closest(collider_, points, out);
  }
  /// See `collider_traits::sweep`.
  QueryStatus sweep(const PointsView<Scalar>& from, const PointsView<Scalar>& to,
                    const Scalar& radius, const Scalar& dt, Eigen::Ref<VectorX<Scalar>> out) const {
    return calls_->sweep(collider_, from, to, radius, dt, out);
  }
  /// See `collider_traits::bounds`.
  BoundingBox<Scalar> bounds(const Scalar& dt) const { return calls_->bounds(collider_, dt); }
  /// See `collider_traits::is_convex`; false where the collider does not tell.
  bool is_convex() const { return calls_->is_convex(collider_); }
  /// See `collider_traits::part_count`; 0 for a collider that is no union.
  Index part_count() const { return calls_->part_count(collider_); }
  /// See `collider_traits::part`; this itself for a collider that is no union.
  ColliderRef part(Index i) const { return calls_->part(*this, i); }

 private:
  struct Calls {
    QueryStatus (*distance)(const void*, const PointsView<Scalar>&, Eigen::Ref<VectorX<Scalar>>&);
    QueryStatus (*closest)(const void*, const PointsView<Scalar>&, std::span<SurfacePoint<Scalar>>);
    QueryStatus (*sweep)(const void*, const PointsView<Scalar>&, const PointsView<Scalar>&,
                         const Scalar&, const Scalar&, Eigen::Ref<VectorX<Scalar>>&);
    BoundingBox<Scalar> (*bounds)(const void*, const Scalar&);
    bool (*is_convex)(const void*);
    Index (*part_count)(const void*);
    ColliderRef (*part)(const ColliderRef&, Index);
  };

  template <class C>
  static const C& as(const void* collider) {
    return *static_cast<const C*>(collider);
  }
  template <class C>
  static bool convex_of(const void* collider) {
    if constexpr (requires(const C& c) { collider_traits<C>::is_convex(c); })
      return collider_traits<C>::is_convex(as<C>(collider));
    else
      return static_cast<void>(collider), false;
  }
  template <class C>
  static constexpr bool kHasParts = requires(const C& c, Index i) {
    collider_traits<C>::part_count(c);
    { collider_traits<C>::part(c, i) } -> std::same_as<ColliderRef>;
  };
  template <class C>
  static Index part_count_of(const void* collider) {
    if constexpr (kHasParts<C>)
      return static_cast<Index>(collider_traits<C>::part_count(as<C>(collider)));
    else
      return static_cast<void>(collider), Index(0);
  }
  template <class C>
  static ColliderRef part_of(const ColliderRef& self, Index i) {
    if constexpr (kHasParts<C>)
      return collider_traits<C>::part(as<C>(self.collider_), i);
    else
      return static_cast<void>(i), self;
  }
  template <class C>
  static constexpr Calls kCalls = {
      [](const void* c, const PointsView<Scalar>& x, Eigen::Ref<VectorX<Scalar>>& out) {
        return collider_traits<C>::distance(as<C>(c), x, out);
      },
      [](const void* c, const PointsView<Scalar>& x, std::span<SurfacePoint<Scalar>> out) {
        return collider_traits<C>::closest(as<C>(c), x, out);
      },
      [](const void* c, const PointsView<Scalar>& from, const PointsView<Scalar>& to,
         const Scalar& radius, const Scalar& dt, Eigen::Ref<VectorX<Scalar>>& out) {
        return collider_traits<C>::sweep(as<C>(c), from, to, radius, dt, out);
      },
      [](const void* c, const Scalar& dt) -> BoundingBox<Scalar> {
        return collider_traits<C>::bounds(as<C>(c), dt);
      },
      &convex_of<C>,
      &part_count_of<C>,
      &part_of<C>};

  const void* collider_;
  const Calls* calls_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
