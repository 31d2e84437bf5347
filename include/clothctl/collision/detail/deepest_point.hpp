#pragma once

// The point of a segment or a triangle where the distance from a collider is least.
//
// On a convex collider the distance d is convex, so each evaluated point y_i gives a lower bound,
//
//   d(y) >= d(y_i) + n_i·(y - y_i)
//
// Only where all bounds are below a level can d be. The level is the largest value of interest, or
// a tolerance below the best point so far; the region is a segment or a polygon, from which each
// bound cuts a part. The next point is the middle of the region; when the region is empty, the best
// point is the minimum to the tolerance. Most triangles need no point beside their corners and
// sides. Kinks (edges and corners of a box) need no special case.
//
// For other colliders the bounds do not hold, but d changes by no more than the way: no point of a
// piece with the middle y and the radius R is deeper than d(y) - R. The triangle is divided until
// that shows that a piece is of no interest, or the piece is as small as the features that shall be
// found; the search above, in such a piece, is a local one.

#include <array>
#include <cmath>
#include <cstddef>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A point a + s u + t v of a triangle, or a + s u of a segment, its distance and the normal there.
template <RealScalar Scalar>
struct DeepPoint {
  Scalar s, t, distance;
  Vector3<Scalar> normal;
};

/// The lower bound c + gs s + gt t.
template <RealScalar Scalar>
struct DistanceBound {
  Scalar c, gs, gt;
};

/// Returns the lower bound that a point of the triangle a + s u + t v gives.
template <RealScalar Scalar>
DistanceBound<Scalar> bound_at(const DeepPoint<Scalar>& y, const Vector3<Scalar>& u,
                               const Vector3<Scalar>& v) {
  const Scalar gs = y.normal.dot(u), gt = y.normal.dot(v);
  return {y.distance - gs * y.s - gt * y.t, gs, gt};
}

/// A convex region of the (s, t) plane, from which half-planes are cut.
template <RealScalar Scalar>
class CutPolygon {
 public:
  /// The region with the corners p, q, r.
  CutPolygon(const std::array<Scalar, 2>& p, const std::array<Scalar, 2>& q,
             const std::array<Scalar, 2>& r)
      : corner_{p, q, r}, count_(3) {}

  /// True when nothing is left.
  bool empty() const { return count_ == 0; }
  /// Keeps the part where the bound is at most `level`.
  void cut(const DistanceBound<Scalar>& bound, const Scalar& level) {
    std::array<Scalar, kMost> over;
    std::size_t inside = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      const std::array<Scalar, 2>& y = corner_[i];
      over[i] = Scalar(bound.c + bound.gs * y[0] + bound.gt * y[1] - level);
      if (over[i] <= Scalar(0)) ++inside;
    }
    if (inside == count_) return;
    if (inside == 0) {
      count_ = 0;
      return;
    }
    std::array<std::array<Scalar, 2>, kMost> kept;
    std::size_t size = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      const std::size_t next = i + 1 < count_ ? i + 1 : 0;
      const std::array<Scalar, 2>&y = corner_[i], &z = corner_[next];
      const Scalar at_y = over[i], at_z = over[next];
      if (at_y <= Scalar(0) && size < kMost) kept[size++] = y;
      if ((at_y < Scalar(0) && Scalar(0) < at_z) || (at_z < Scalar(0) && Scalar(0) < at_y)) {
        const Scalar share = at_y / (at_y - at_z);
        if (size < kMost)
          kept[size++] = {y[0] + share * (z[0] - y[0]), y[1] + share * (z[1] - y[1])};
      }
    }
    for (std::size_t i = 0; i < size; ++i) corner_[i] = kept[i];
    count_ = size;
  }
  /// Returns the mean of the corners.
  std::array<Scalar, 2> middle() const {
    Scalar s(0), t(0);
    for (std::size_t i = 0; i < count_; ++i) {
      s += corner_[i][0];
      t += corner_[i][1];
    }
    const Scalar share = Scalar(1) / Scalar(static_cast<double>(count_));
    return {share * s, share * t};
  }

 private:
  /// Each cut adds at most one corner.
  static constexpr std::size_t kMost = 48;
  std::array<std::array<Scalar, 2>, kMost> corner_;
  std::size_t count_;
};

/// Points that a search evaluates at most; each has a bound.
inline constexpr std::size_t kMostDeepPoints = 40;

/// Searches the triangle p, q, r of the (s, t) plane for a point below `best.distance`, at most
/// `level`. `known` are bounds to begin with. `evaluate(s, t)` gives a DeepPoint. Returns true and
/// writes `best` when there is one.
template <RealScalar Scalar, class Evaluate>
bool search_triangle(const Evaluate& evaluate, const Vector3<Scalar>& u, const Vector3<Scalar>& v,
                     const std::array<std::array<Scalar, 2>, 3>& region,
                     const std::array<DistanceBound<Scalar>, 6>& known, const Scalar& highest,
                     const Scalar& tolerance, DeepPoint<Scalar>& best) {
  std::array<DistanceBound<Scalar>, kMostDeepPoints> bounds;
  std::size_t size = 0;
  for (const DistanceBound<Scalar>& bound : known) bounds[size++] = bound;
  Scalar level = highest;
  CutPolygon<Scalar> polygon(region[0], region[1], region[2]);
  for (std::size_t i = 0; i < size; ++i) polygon.cut(bounds[i], level);
  bool found = false;
  while (!polygon.empty() && size < kMostDeepPoints) {
    const std::array<Scalar, 2> at = polygon.middle();
    const DeepPoint<Scalar> y = evaluate(at[0], at[1]);
    if (!is_finite(y.distance)) return found;
    bounds[size++] = bound_at<Scalar>(y, u, v);
    if (y.distance < level) {
      best = y;
      found = true;
      level = y.distance - tolerance;
      for (std::size_t i = 0; i + 1 < size; ++i) polygon.cut(bounds[i], level);
    }
    polygon.cut(bounds[size - 1], level);
  }
  return found;
}

/// Searches the segment from s = low to high for a point at most at `highest`. The ends are given,
/// with bounds of the whole segment in u. Returns true and writes `best` when there is one.
template <RealScalar Scalar, class Evaluate>
bool search_segment(const Evaluate& evaluate, const Vector3<Scalar>& u, DeepPoint<Scalar> low,
                    DeepPoint<Scalar> high, const Scalar& highest, const Scalar& tolerance,
                    DeepPoint<Scalar>& best) {
  Scalar level = highest;
  bool found = false;
  for (std::size_t step = 0; step < kMostDeepPoints; ++step) {
    // The bounds of both ends meet at the lowest value that is possible between them.
    const Scalar fall = low.normal.dot(u), rise = high.normal.dot(u);
    if (!(fall < Scalar(0)) || !(Scalar(0) < rise)) return found;
    const Scalar s = (high.distance - low.distance + fall * low.s - rise * high.s) / (fall - rise);
    const Scalar lowest = low.distance + fall * (s - low.s);
    if (!(lowest < level) || !(low.s < s) || !(s < high.s)) return found;
    const DeepPoint<Scalar> y = evaluate(s);
    if (!is_finite(y.distance)) return found;
    if (y.distance < level) {
      best = y;
      found = true;
      level = y.distance - tolerance;
    }
    if (y.normal.dot(u) < Scalar(0))
      low = y;
    else
      high = y;
  }
  return found;
}

/// As `search_triangle` in the whole triangle, for colliders that are not convex: finds the deepest
/// point where the collider has no features smaller than `feature` (m), or than 1/32 of the
/// triangle.
template <RealScalar Scalar, class Evaluate>
bool search_pieces(const Evaluate& evaluate, const Vector3<Scalar>& u, const Vector3<Scalar>& v,
                   const Scalar& feature, Scalar highest, const Scalar& tolerance,
                   DeepPoint<Scalar>& best) {
  using std::sqrt;
  using Corner = std::array<Scalar, 2>;
  struct Piece {
    std::array<Corner, 3> corner;
    int level;
  };
  constexpr int kMostLevels = 5;
  constexpr std::size_t kMostPieces = 3 * kMostLevels + 1;  // each level leaves three behind
  const Scalar zero(0), one(1), half(0.5), third = Scalar(1) / Scalar(3);
  std::array<DistanceBound<Scalar>, 6> known{};
  for (DistanceBound<Scalar>& any : known) any = {Scalar(-1e30), zero, zero};  // cuts nothing
  std::array<Piece, kMostPieces> stack{};
  std::size_t size = 0;
  stack[size++] = {{Corner{zero, zero}, Corner{one, zero}, Corner{zero, one}}, 0};
  bool found = false;
  while (size > 0) {
    const Piece piece = stack[--size];
    const auto& [p, q, r] = piece.corner;
    const Corner middle{third * (p[0] + q[0] + r[0]), third * (p[1] + q[1] + r[1])};
    Scalar square(0);
    for (const Corner& c : piece.corner) {
      const Vector3<Scalar> way = (c[0] - middle[0]) * u + (c[1] - middle[1]) * v;
      if (square < way.squaredNorm()) square = way.squaredNorm();
    }
    const Scalar radius = sqrt(square);
    const DeepPoint<Scalar> y = evaluate(middle[0], middle[1]);
    if (!is_finite(y.distance) || highest < y.distance - radius) continue;
    if (y.distance < highest) {
      best = y;
      found = true;
      highest = y.distance - tolerance;
    }
    if (radius <= feature || piece.level == kMostLevels) {
      known[0] = bound_at<Scalar>(y, u, v);
      if (!search_triangle<Scalar>(evaluate, u, v, piece.corner, known, highest, tolerance, best))
        continue;
      found = true;
      highest = best.distance - tolerance;
      continue;
    }
    const auto mean = [&half](const Corner& c, const Corner& d) {
      return Corner{half * (c[0] + d[0]), half * (c[1] + d[1])};
    };
    const Corner pq = mean(p, q), qr = mean(q, r), rp = mean(r, p);
    const int level = piece.level + 1;
    stack[size++] = {{p, pq, rp}, level};
    stack[size++] = {{q, qr, pq}, level};
    stack[size++] = {{r, rp, qr}, level};
    stack[size++] = {{pq, qr, rp}, level};
  }
  return found;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
