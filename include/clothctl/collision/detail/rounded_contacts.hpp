#pragma once

// The contacts of spheres and capsules with each other and with polytopes, from the distance of
// their cores: a point or a segment, and the polytope. The normal runs between the closest points
// of the cores. Where the core of a capsule is inside of a polytope, the axis of least depth takes
// its place. A capsule that lies on a face, or along another capsule, has two points.

#include <utility>

#include "clothctl/collision/detail/polytope_contacts.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The segment from a to a + u (u = 0: a point) and the radius around it.
template <RealScalar Scalar>
struct RoundedSegment {
  Vector3<Scalar> a, u;
  Scalar radius;

  Vector3<Scalar> at(const Scalar& s) const { return a + s * u; }
};

/// Makes a point from the closest points p of core A and q of core B, and the normal from B to A.
template <RealScalar Scalar>
BodyContactPoint<Scalar> rounded_point(const Vector3<Scalar>& p, const Scalar& r_a,
                                       const Vector3<Scalar>& q, const Scalar& r_b,
                                       const Vector3<Scalar>& n, std::uint32_t feature) {
  BodyContactPoint<Scalar> out;
  const Vector3<Scalar> on_a = p - r_a * n, on_b = q + r_b * n;
  out.position = Scalar(0.5) * (on_a + on_b);
  out.normal = n;
  out.gap = n.dot(Vector3<Scalar>(on_a - on_b));
  out.feature = feature;
  return out;
}

/// Adds the points of the contact of two rounded segments.
template <RealScalar Scalar>
void segment_contacts(const RoundedSegment<Scalar>& A, const RoundedSegment<Scalar>& B,
                      const Scalar& margin, BodyContacts<Scalar>& out) {
  const std::array<Scalar, 2> st = closest_on_segments<Scalar>(A.a, A.u, B.a, B.u);
  const Vector3<Scalar> p = A.at(st[0]), q = B.at(st[1]), across = A.u.cross(B.u);
  // Cores that cross: out of the plane of both; on one line: any direction across.
  Vector3<Scalar> other(Scalar(0), Scalar(0), Scalar(1));
  const Scalar uu = A.u.squaredNorm(), vv = B.u.squaredNorm();
  const bool parallel = !(Scalar(1e-6) * uu * vv < across.squaredNorm());
  if (!parallel) other = unit_or_zero<Scalar>(across);
  if (parallel && Scalar(0) < uu + vv)
    other = unit_orthogonal<Scalar>(unit_or_zero<Scalar>(uu < vv ? B.u : A.u));
  const Direction<Scalar> way = direction_of<Scalar>(p - q, other);
  if (margin < way.length - A.radius - B.radius) return;
  if (parallel && Scalar(0) < uu && Scalar(0) < vv) {
    // The stretch of A beside B, as shares of A.
    Scalar low = A.u.dot(Vector3<Scalar>(B.a - A.a)) / uu;
    Scalar high = low + A.u.dot(B.u) / uu;
    if (high < low) std::swap(low, high);
    if (low < Scalar(0)) low = Scalar(0);
    if (Scalar(1) < high) high = Scalar(1);
    const Scalar room = high - low;
    if (Scalar(0) < room && A.radius * A.radius * Scalar(1e-4) < room * room * uu) {
      std::uint32_t feature = 0;
      for (const Scalar& s : {low, high}) {
        const Vector3<Scalar> x = A.at(s);
        Scalar t = B.u.dot(Vector3<Scalar>(x - B.a)) / vv;
        t = t < Scalar(0) ? Scalar(0) : (Scalar(1) < t ? Scalar(1) : t);
        out.add(rounded_point<Scalar>(x, A.radius, B.at(t), B.radius, way.unit, feature++));
      }
      return;
    }
  }
  out.add(rounded_point<Scalar>(p, A.radius, q, B.radius, way.unit, 2));
}

/// A rounded segment against a polytope. Normals run from the polytope to the segment.
template <RealScalar Scalar>
class SegmentOnPolytope {
 public:
  SegmentOnPolytope(const RoundedSegment<Scalar>& segment, const PosedPolytope<Scalar>& P)
      : S_(segment), P_(P) {}

  /// Adds the points whose gap is at most `margin`; `flip` when the segment is the body B.
  void add(const Scalar& margin, const Scalar& size, bool flip, BodyContacts<Scalar>& out) {
    const Scalar reach = margin + S_.radius, near_zero = Scalar(1e-3) * size;
    find_face();
    if (reach < level_) return;
    SeparatingAxis<Scalar> edge = best_edge();
    bool face = true;
    Vector3<Scalar> p, q;
    if (Scalar(0) < level_ || Scalar(0) < edge.separation) {
      const Direction<Scalar> way = closest(p, q);
      if (reach < way.length) return;
      edge.axis = way.unit;
      face = !(level_ + near_zero < way.length);
    } else if (level_ + near_zero < edge.separation) {
      face = false;
      const PolytopeEdge& e = P_.shape.edges[static_cast<std::size_t>(edge.a)];
      const Vector3<Scalar> v = P_.x(e.b) - P_.x(e.a);
      const std::array<Scalar, 2> st = closest_on_segments<Scalar>(S_.a, S_.u, P_.x(e.a), v);
      p = S_.at(st[0]);
      q = p - edge.separation * edge.axis;
    }
    if (face && add_face(reach, flip, out)) return;
    if (face) {  // beside the face, to rounding
      edge.axis = P_.n(face_);
      p = Scalar(0) < S_.u.dot(edge.axis) ? S_.a : S_.at(Scalar(1));
      q = p - P_.above(face_, p) * edge.axis;
    }
    put(p, q, edge.axis, 3, flip, out);
  }

 private:
  void put(const Vector3<Scalar>& p, const Vector3<Scalar>& q, const Vector3<Scalar>& n,
           std::uint32_t feature, bool flip, BodyContacts<Scalar>& out) const {
    if (flip)
      out.add(rounded_point<Scalar>(q, Scalar(0), p, S_.radius, -n, feature));
    else
      out.add(rounded_point<Scalar>(p, S_.radius, q, Scalar(0), n, feature));
  }
  /// The face that separates best.
  void find_face() {
    for (int f = 0; f < P_.shape.face_count(); ++f) {
      const Scalar start = P_.above(f, S_.a), end = P_.above(f, S_.at(Scalar(1)));
      const Scalar now = end < start ? end : start;
      if (f > 0 && !(level_ < now)) continue;
      level_ = now;
      face_ = f;
    }
  }
  /// The edge whose cross product with the segment separates best; its axis points to the segment.
  SeparatingAxis<Scalar> best_edge() const {
    SeparatingAxis<Scalar> best;
    const Scalar uu = S_.u.squaredNorm();
    if (!(Scalar(0) < uu)) return best;
    for (int i = 0; i < P_.shape.edge_count(); ++i) {
      const PolytopeEdge& e = P_.shape.edges[static_cast<std::size_t>(i)];
      if (!(P_.n(e.left).dot(S_.u) * P_.n(e.right).dot(S_.u) < Scalar(0))) continue;
      const Vector3<Scalar> v = P_.x(e.b) - P_.x(e.a);
      Vector3<Scalar> axis = S_.u.cross(v);
      if (axis.squaredNorm() < Scalar(1e-6) * uu * v.squaredNorm()) continue;
      axis = unit_or_zero<Scalar>(axis);
      if (axis.dot(Vector3<Scalar>(P_.n(e.left) + P_.n(e.right))) < Scalar(0)) axis = -axis;
      const Scalar now = axis.dot(Vector3<Scalar>(S_.a - P_.x(e.a)));
      if (best.separation < now) best = {now, i, -1, axis};
    }
    return best;
  }
  /// The closest points p of the segment and q of the polytope, which are apart.
  Direction<Scalar> closest(Vector3<Scalar>& p, Vector3<Scalar>& q) const {
    Scalar least = Scalar(1e30);
    const auto take = [&](const Vector3<Scalar>& x, const Vector3<Scalar>& y) {
      const Scalar square = (x - y).squaredNorm();
      if (!(square < least)) return;
      least = square;
      p = x;
      q = y;
    };
    for (int i = 0; i < P_.shape.edge_count(); ++i) {
      const PolytopeEdge& e = P_.shape.edges[static_cast<std::size_t>(i)];
      const Vector3<Scalar> v = P_.x(e.b) - P_.x(e.a);
      const std::array<Scalar, 2> st = closest_on_segments<Scalar>(S_.a, S_.u, P_.x(e.a), v);
      take(S_.at(st[0]), P_.x(e.a) + st[1] * v);
    }
    for (int f = 0; f < P_.shape.face_count(); ++f) {
      for (const Scalar& s : {Scalar(0), Scalar(1)}) {
        const Vector3<Scalar> x = S_.at(s);
        const Scalar d = P_.above(f, x);
        const Vector3<Scalar> foot = x - d * P_.n(f);
        if (Scalar(0) < d && covers(f, foot)) take(x, foot);
      }
    }
    return direction_of<Scalar>(p - q, P_.n(face_));
  }
  /// The outward direction of side k of a face.
  Vector3<Scalar> side(int f, int k) const {
    const Vector3<Scalar> way =
        P_.x(P_.shape.face_corner(f, k + 1)) - P_.x(P_.shape.face_corner(f, k));
    return way.cross(P_.n(f));
  }
  bool covers(int f, const Vector3<Scalar>& x) const {
    for (int k = 0; k < P_.shape.face_size(f); ++k) {
      const Vector3<Scalar> from = x - P_.x(P_.shape.face_corner(f, k));
      if (Scalar(0) < side(f, k).dot(from)) return false;
    }
    return true;
  }
  /// The ends of the part of the segment above the face. Returns whether there are any.
  bool add_face(const Scalar& reach, bool flip, BodyContacts<Scalar>& out) const {
    Scalar low(0), high(1);
    std::uint32_t from = 64, to = 65;
    for (int k = 0; k < P_.shape.face_size(face_); ++k) {
      const Vector3<Scalar> n = side(face_, k);
      const Scalar start = n.dot(Vector3<Scalar>(S_.a - P_.x(P_.shape.face_corner(face_, k))));
      const Scalar slope = n.dot(S_.u);
      if (!(Scalar(0) < start) && !(Scalar(0) < start + slope)) continue;
      if (Scalar(0) < start && Scalar(0) < start + slope) return false;
      const Scalar cut = -start / slope;
      if (Scalar(0) < slope && cut < high) {
        high = cut;
        to = static_cast<std::uint32_t>(k);
      }
      if (slope < Scalar(0) && low < cut) {
        low = cut;
        from = static_cast<std::uint32_t>(k);
      }
    }
    if (high < low) return false;
    const Vector3<Scalar>& n = P_.n(face_);
    bool any = false;
    const std::uint32_t label = 0x100u + (static_cast<std::uint32_t>(face_) << 9);
    for (const bool first : {true, false}) {
      const Vector3<Scalar> x = S_.at(first ? low : high);
      const Scalar d = P_.above(face_, x);
      if (reach < d) continue;
      put(x, x - d * n, n, label + (first ? from : to), flip, out);
      any = true;
      if (!(S_.radius * S_.radius * Scalar(1e-8) <
            (high - low) * (high - low) * S_.u.squaredNorm()))
        break;
    }
    return any;
  }

  const RoundedSegment<Scalar>& S_;
  const PosedPolytope<Scalar>& P_;
  Scalar level_ = Scalar(-1e30);
  int face_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
