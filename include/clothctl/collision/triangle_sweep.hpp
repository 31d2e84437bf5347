#pragma once

// The impact of a triangle with a convex collider that is thin: corners p_i go straight by r_i, as
// seen from the collider. From the distance d of the triangle and the normal n at its closest
// point, time advances by the larger of two safe bounds: (d - s)/max|r_i|, and the time until the
// plane across n no longer separates the two. It ends at t = 1, or as near as s, a tenth of the
// smaller of d(0) and the thickness: what was apart stays apart.
//
// A collider is thin where a point that goes in by twice the way and four times the thickness is
// nearer to another side. References: Li, Kaufman, Jiang 2021; Mirtich 1996.

#include <array>
#include <cmath>
#include <cstddef>

#include "clothctl/collision/detail/deepest_point.hpp"
#include "clothctl/collision/detail/single_query.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Returns what a collider answers about one point (m); the default where it does not.
template <RealScalar Scalar>
SurfacePoint<Scalar> surface_point_at(const ColliderRef<Scalar>& collider,
                                      const Vector3<Scalar>& x) {
  return detail::closest_of<Scalar>(collider, x);
}

/// Where a triangle meets a collider.
template <RealScalar Scalar>
struct TriangleImpact {
  /// The point of the triangle, by the weights of its corners; the collider's surface and normal
  /// there.
  Vector3<Scalar> weight, foot, normal;
  /// The distance along the normal that it may keep at the end: a quarter of the thickness, or
  /// that of the start where it starts inside.
  Scalar target;
};

/// Follows triangles that move next to a convex collider.
template <RealScalar S>
class TriangleSweep {
 public:
  /// The scalar type.
  using Scalar = S;
  /// Three points or ways, m.
  using Triangle = std::array<Vector3<Scalar>, 3>;
  /// What the collider answers about the corners.
  using Corners = std::array<SurfacePoint<Scalar>, 3>;

  /// Refers to a convex collider, and takes the thickness of the sheet (m).
  TriangleSweep(const ColliderRef<Scalar>& collider, const Scalar& thickness)
      : collider_(collider), thickness_(thickness) {}

  /// Returns true where the triangle `p` meets the collider on the way `r`, and writes the impact.
  bool find(const Triangle& p, const Triangle& r, const Corners& corner,
            TriangleImpact<Scalar>& out) const;

 private:
  using Vec = Vector3<Scalar>;
  using Deep = detail::DeepPoint<Scalar>;
  static constexpr int kMostAdvances = 100;

  /// The parameters of the corners.
  static std::array<std::array<Scalar, 2>, 3> corners() {
    const Scalar zero(0), one(1);
    return {std::array<Scalar, 2>{zero, zero}, std::array<Scalar, 2>{one, zero},
            std::array<Scalar, 2>{zero, one}};
  }
  /// Asks about the point p_0 + s (p_1 - p_0) + t (p_2 - p_0).
  Deep evaluate(const Triangle& p, const Scalar& s, const Scalar& t) const {
    const SurfacePoint<Scalar> q = detail::closest_of<Scalar>(
        collider_, Vec(p[0] + s * Vec(p[1] - p[0]) + t * Vec(p[2] - p[0])));
    return Deep{s, t, q.distance, q.normal};
  }
  /// Returns the point of a triangle that is closest.
  Deep deepest(const Triangle& p, const Scalar& tolerance) const;
  /// Returns whether a point of the triangle may be closer than `way`.
  bool reaches(const Triangle& p, const Corners& corner, const Scalar& way) const;
  bool follow(Triangle p, const Triangle& r, const Scalar& fastest,
              TriangleImpact<Scalar>& out) const;
  bool is_thin(const Vec& foot, const Vec& n, const Scalar& depth) const {
    return Scalar(-0.75) * depth < detail::distance_of<Scalar>(collider_, Vec(foot - depth * n));
  }

  const ColliderRef<Scalar>& collider_;
  Scalar thickness_;
};

template <RealScalar S>
bool TriangleSweep<S>::find(const Triangle& p, const Triangle& r, const Corners& corner,
                            TriangleImpact<Scalar>& out) const {
  using std::sqrt;
  // The plane across the normal at a corner may separate the two for the whole step.
  const Scalar clear = Scalar(0.1) * thickness_;
  for (const SurfacePoint<Scalar>& q : corner) {
    bool apart = true;
    for (std::size_t i = 0; i < 3 && apart; ++i) {
      const Scalar above = q.normal.dot(Vec(p[i] - q.point));
      apart = clear < above && clear < above + q.normal.dot(r[i]);
    }
    if (apart) return false;
  }
  Scalar fastest(0);
  for (const Vec& way : r) {
    if (fastest < way.squaredNorm()) fastest = way.squaredNorm();
  }
  fastest = sqrt(fastest);
  return reaches(p, corner, fastest) && follow(p, r, fastest, out);
}

template <RealScalar S>
auto TriangleSweep<S>::deepest(const Triangle& p, const Scalar& tolerance) const -> Deep {
  const Vec u = p[1] - p[0], v = p[2] - p[0];
  const std::array<std::array<Scalar, 2>, 3> all = corners();
  const auto at = [&](const Scalar& s, const Scalar& t) { return evaluate(p, s, t); };
  std::array<detail::DistanceBound<Scalar>, 6> known{};
  Deep best{};
  for (std::size_t k = 0; k < 3; ++k) {
    const Deep corner = at(all[k][0], all[k][1]);
    known[k] = known[k + 3] = detail::bound_at<Scalar>(corner, u, v);
    if (k == 0 || corner.distance < best.distance) best = corner;
  }
  (void)detail::search_triangle<Scalar>(at, u, v, all, known, Scalar(best.distance - tolerance),
                                        tolerance, best);
  return best;
}

template <RealScalar S>
bool TriangleSweep<S>::reaches(const Triangle& p, const Corners& corner, const Scalar& way) const {
  const Vec u = p[1] - p[0], v = p[2] - p[0];
  const std::array<std::array<Scalar, 2>, 3> all = corners();
  std::array<detail::DistanceBound<Scalar>, 6> known{};
  for (std::size_t k = 0; k < 3; ++k) {
    const SurfacePoint<Scalar>& q = corner[k];
    if (!(way < q.distance)) return true;
    known[k] = known[k + 3] =
        detail::bound_at<Scalar>(Deep{all[k][0], all[k][1], q.distance, q.normal}, u, v);
  }
  const auto at = [&](const Scalar& s, const Scalar& t) { return evaluate(p, s, t); };
  Deep unused{};
  return detail::search_triangle<Scalar>(at, u, v, all, known, way, Scalar(1), unused);
}

template <RealScalar S>
bool TriangleSweep<S>::follow(Triangle p, const Triangle& r, const Scalar& fastest,
                              TriangleImpact<Scalar>& out) const {
  const Scalar zero(0);
  // The least distance, and how near to it an impact is.
  Scalar time = zero, stop = zero, margin = zero;
  Scalar tolerance = Scalar(1e-3) * thickness_;
  for (int i = 0; i < kMostAdvances; ++i) {
    const Deep deep = deepest(p, tolerance);
    if (!is_finite(deep.distance)) return false;
    const Vec foot =
        p[0] + deep.s * (p[1] - p[0]) + deep.t * (p[2] - p[0]) - deep.distance * deep.normal;
    out.weight = Vec(Scalar(1) - deep.s - deep.t, deep.s, deep.t);
    out.foot = foot;
    out.normal = deep.normal;
    if (i == 0) {
      // A point that starts inside goes no deeper; what is nearer than the search tells is inside.
      const bool inside = !(Scalar(2) * tolerance < deep.distance);
      out.target = inside ? deep.distance : Scalar(0.25) * thickness_;
      if (!inside && fastest < deep.distance) return false;
      if (!is_thin(foot, deep.normal, Scalar(2) * fastest + Scalar(4) * thickness_)) return false;
      if (deep.distance < Scalar(-0.1) * thickness_) {
        const Vec way = out.weight[0] * r[0] + out.weight[1] * r[1] + out.weight[2] * r[2];
        return deep.normal.dot(way) < Scalar(-0.02) * thickness_;
      }
      margin = Scalar(0.1) * (deep.distance < thickness_ ? deep.distance : thickness_);
      if (inside) margin = Scalar(0.002) * thickness_;
      stop = inside ? Scalar(deep.distance - Scalar(10) * margin) : margin;
      if (Scalar(0.1) * margin < tolerance) tolerance = Scalar(0.1) * margin;
    }
    if (deep.distance < stop + margin) return true;
    Scalar step = (deep.distance - stop) / fastest, plane = Scalar(2);
    for (std::size_t k = 0; k < 3; ++k) {
      const Scalar above = deep.normal.dot(Vec(p[k] - foot)) - stop;
      const Scalar fall = zero - deep.normal.dot(r[k]);
      if (!(zero < above)) plane = zero;
      if (zero < fall && above < plane * fall) plane = above / fall;
    }
    if (step < plane) step = plane;
    time += step;
    if (!(time < Scalar(1))) return false;
    for (std::size_t k = 0; k < 3; ++k) p[k] += step * r[k];
  }
  return true;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
