#pragma once

// The contact of two polytopes. The separating axis with the largest separation is the normal of a
// face of one, or the cross product of an edge of each. Of the edge pairs, only those count that
// form a face of the Minkowski difference: with the normals a, b of the faces beside the edge of A
// and c, d those of B, reversed, the arcs ab and cd on the sphere of normals cross (Gregorius, The
// separating axis test between convex polyhedra, GDC 2013):
//
//   (c·ba)(d·ba) < 0,   (a·dc)(b·dc) < 0,   (c·ba)(b·dc) > 0,      ba = b × a,  dc = d × c
//
// For a face, the most opposite face of the other is clipped by its sides (Sutherland, Hodgman,
// 1974); an edge pair gives one point. Faces are preferred where both are as good,
// and where their normal is within 8° of that of the edges: faces that lie on each other tilted
// have the least overlap where edges cross, but one such point does not hold them. Where the
// polytopes are apart, the separation is at most their distance. It is that distance for faces and
// edges that face each other; where the clipped polygon is empty nothing touches along that axis.

#include <algorithm>
#include <cstdint>

#include "clothctl/collision/detail/contact_manifold.hpp"
#include "clothctl/collision/detail/polytope.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A polytope in a pose: corners and normals in world axes.
template <RealScalar Scalar>
struct PosedPolytope {
  PosedPolytope(const Polytope<Scalar>& polytope, const Matrix3<Scalar>& R,
                const Vector3<Scalar>& position)
      : shape(polytope), centre(position) {
    for (int i = 0; i < shape.corner_count(); ++i)
      corner[static_cast<std::size_t>(i)] = position + R * shape.corners.col(i);
    for (int f = 0; f < shape.face_count(); ++f)
      normal[static_cast<std::size_t>(f)] = R * shape.normals.col(f);
  }
  const Vector3<Scalar>& x(int i) const { return corner[static_cast<std::size_t>(i)]; }
  const Vector3<Scalar>& n(int f) const { return normal[static_cast<std::size_t>(f)]; }
  /// Distance of a point from the plane of a face.
  Scalar above(int f, const Vector3<Scalar>& p) const {
    return n(f).dot(Vector3<Scalar>(p - centre)) - shape.offsets[f];
  }

  const Polytope<Scalar>& shape;
  Vector3<Scalar> centre;
  std::array<Vector3<Scalar>, static_cast<std::size_t>(kMostCorners)> corner;
  std::array<Vector3<Scalar>, static_cast<std::size_t>(2 * kMostCorners)> normal;
};

/// A separating axis: a face, or an edge of each polytope.
template <RealScalar Scalar>
struct SeparatingAxis {
  Scalar separation = Scalar(-1e30);
  int a = -1, b = -1;
  /// Of edges: from the first polytope to the second.
  Vector3<Scalar> axis = Vector3<Scalar>::Constant(Scalar(0));
};

/// Returns the face of P that separates Q best.
template <RealScalar Scalar>
SeparatingAxis<Scalar> best_face(const PosedPolytope<Scalar>& P, const PosedPolytope<Scalar>& Q,
                                 const Scalar& margin) {
  SeparatingAxis<Scalar> best;
  for (int f = 0; f < P.shape.face_count(); ++f) {
    Scalar least = P.above(f, Q.x(0));
    for (int i = 1; i < Q.shape.corner_count(); ++i) {
      const Scalar now = P.above(f, Q.x(i));
      if (now < least) least = now;
    }
    if (!(best.separation < least)) continue;
    best.separation = least;
    best.a = f;
    if (margin < least) break;
  }
  return best;
}

/// Returns the pair of edges that separates best.
template <RealScalar Scalar>
SeparatingAxis<Scalar> best_edges(const PosedPolytope<Scalar>& P, const PosedPolytope<Scalar>& Q) {
  using std::sqrt;
  SeparatingAxis<Scalar> best;
  const Scalar zero(0);
  for (int i = 0; i < P.shape.edge_count(); ++i) {
    const PolytopeEdge& e = P.shape.edges[static_cast<std::size_t>(i)];
    const Vector3<Scalar>&a = P.n(e.left), &b = P.n(e.right);
    const Vector3<Scalar> u = P.x(e.b) - P.x(e.a), ba = b.cross(a);
    const Scalar length = u.squaredNorm();
    for (int j = 0; j < Q.shape.edge_count(); ++j) {
      const PolytopeEdge& g = Q.shape.edges[static_cast<std::size_t>(j)];
      const Vector3<Scalar> c = -Q.n(g.left), d = -Q.n(g.right);
      const Scalar cba = c.dot(ba), dba = d.dot(ba);
      if (!(cba * dba < zero)) continue;
      const Vector3<Scalar> v = Q.x(g.b) - Q.x(g.a), dc = d.cross(c);
      const Scalar adc = a.dot(dc), bdc = b.dot(dc);
      if (!(adc * bdc < zero) || !(zero < cba * bdc)) continue;
      Vector3<Scalar> axis = u.cross(v);
      const Scalar square = axis.squaredNorm();
      if (square < Scalar(2.5e-5) * length * v.squaredNorm()) continue;
      axis /= sqrt(square);
      const Vector3<Scalar> out = a + b;  // points out of P at its edge
      if (axis.dot(out) < zero) axis = -axis;
      const Scalar now = axis.dot(Vector3<Scalar>(Q.x(g.a) - P.x(e.a)));
      if (best.separation < now) best = {now, i, j, axis};
    }
  }
  return best;
}

/// Returns the points of the segments a + s u and b + t v that are closest, s and t in [0, 1].
template <RealScalar Scalar>
std::array<Scalar, 2> closest_on_segments(const Vector3<Scalar>& a, const Vector3<Scalar>& u,
                                          const Vector3<Scalar>& b, const Vector3<Scalar>& v) {
  const Scalar zero(0), one(1);
  const auto clamp = [&](const Scalar& x) { return x < zero ? zero : (one < x ? one : x); };
  const Vector3<Scalar> r = a - b;
  const Scalar uu = u.squaredNorm(), vv = v.squaredNorm(), ur = u.dot(r), vr = v.dot(r);
  if (!(zero < uu)) return {zero, zero < vv ? clamp(vr / vv) : zero};
  if (!(zero < vv)) return {clamp(-ur / uu), zero};
  const Scalar uv = u.dot(v), det = uu * vv - uv * uv;
  Scalar s = zero;
  if (Scalar(8) * scalar_traits<Scalar>::epsilon() * uu * vv < det)
    s = clamp((uv * vr - ur * vv) / det);
  Scalar t = (uv * s + vr) / vv;
  if (t < zero) {
    t = zero;
    s = clamp(-ur / uu);
  } else if (one < t) {
    t = one;
    s = clamp((uv - ur) / uu);
  }
  return {s, t};
}

/// Clips a polygon by the sides of a face.
template <RealScalar Scalar>
class FaceClip {
 public:
  /// Starts with face `f` of Q.
  FaceClip(const PosedPolytope<Scalar>& Q, int f) : count_(Q.shape.face_size(f)) {
    for (int k = 0; k < count_; ++k) {
      const unsigned corner = static_cast<unsigned>(Q.shape.face_corner(f, k));
      point(k) = {Q.x(static_cast<int>(corner)), corner, corner};
    }
  }
  /// Cuts off what lies beyond the sides of face `f` of P.
  void clip(const PosedPolytope<Scalar>& P, int f) {
    for (int k = 0; k < P.shape.face_size(f) && count_ > 0; ++k) {
      const Vector3<Scalar>& a = P.x(P.shape.face_corner(f, k));
      const Vector3<Scalar> side = P.x(P.shape.face_corner(f, k + 1)) - a;
      const Vector3<Scalar> out = unit_or_zero<Scalar>(side.cross(P.n(f)));
      cut(out, out.dot(a), static_cast<unsigned>(k));
    }
  }
  int count() const { return count_; }
  const Vector3<Scalar>& x(int k) const { return points_[static_cast<std::size_t>(k)].x; }
  std::uint32_t feature(int k) const { return points_[static_cast<std::size_t>(k)].feature; }

 private:
  /// A corner of the polygon, what it is, and the number of the side that starts there.
  struct Corner {
    Vector3<Scalar> x;
    std::uint32_t feature, side;
  };
  static constexpr std::size_t kRoom = std::size_t{2} * kMostCorners + 2;

  Corner& point(int k) { return points_[static_cast<std::size_t>(k)]; }
  void cut(const Vector3<Scalar>& out, const Scalar& level, unsigned plane) {
    const int n = count_;
    std::array<Corner, kRoom> old;
    std::copy(points_.begin(), points_.begin() + n, old.begin());
    count_ = 0;
    for (int k = 0; k < n; ++k) {
      const Corner& p = old[static_cast<std::size_t>(k)];
      const Corner& q = old[static_cast<std::size_t>((k + 1) % n)];
      const Scalar d_p = out.dot(p.x) - level, d_q = out.dot(q.x) - level;
      const bool keeps = !(Scalar(0) < d_p), next = !(Scalar(0) < d_q);
      if (keeps) point(count_++) = p;
      if (keeps == next || static_cast<std::size_t>(count_) + 1 >= kRoom) continue;
      const Vector3<Scalar> way = q.x - p.x;
      const std::uint32_t side = keeps ? 64u + plane : p.side;
      const std::uint32_t feature = 0x4000u | (p.side << 7) | plane;
      point(count_++) = {p.x + (d_p / (d_p - d_q)) * way, feature, side};
    }
  }

  std::array<Corner, kRoom> points_;
  int count_;
};

/// The points of a clipped polygon of Q above face `f` of P. `flip` is true when P is the body B.
/// Most polygons have few corners, and need little room.
template <int kRoom, RealScalar Scalar>
void add_polygon(const PosedPolytope<Scalar>& P, const PosedPolytope<Scalar>& Q, int f,
                 const FaceClip<Scalar>& polygon, const Scalar& separation, const Scalar& margin,
                 bool flip, BodyContacts<Scalar>& out) {
  const Vector3<Scalar>& n = P.n(f);
  const Vector3<Scalar> normal = flip ? n : Vector3<Scalar>(-n);
  std::array<BodyContactPoint<Scalar>, static_cast<std::size_t>(kRoom)> found;
  int count = 0;
  const std::uint32_t label = (flip ? 0x80000000u : 0u) | (static_cast<std::uint32_t>(f) << 24);
  const auto keep = [&](const Vector3<Scalar>& x, std::uint32_t feature) {
    BodyContactPoint<Scalar>& p = found[static_cast<std::size_t>(count++)];
    p.gap = P.above(f, x);
    p.position = x - Scalar(0.5) * p.gap * n;
    p.normal = normal;
    p.feature = label | feature;
  };
  for (int k = 0; k < polygon.count(); ++k) {
    if (!(margin < P.above(f, polygon.x(k)))) keep(polygon.x(k), polygon.feature(k));
  }
  if (count == 0 && separation < Scalar(0)) {  // overlap without a clipped point: rounding
    int deepest = 0;
    for (int i = 1; i < Q.shape.corner_count(); ++i) {
      if (P.above(f, Q.x(i)) < P.above(f, Q.x(deepest))) deepest = i;
    }
    keep(Q.x(deepest), static_cast<std::uint32_t>(deepest));
  }
  add_reduced<Scalar>(found.data(), count, normal, out);
}

/// The points of a face contact: face `f` of P against Q, n_P pointing to Q.
template <RealScalar Scalar>
void add_face_contact(const PosedPolytope<Scalar>& P, const PosedPolytope<Scalar>& Q, int f,
                      const Scalar& separation, const Scalar& margin, bool flip,
                      BodyContacts<Scalar>& out) {
  int incident = 0;
  for (int g = 1; g < Q.shape.face_count(); ++g) {
    if (P.n(f).dot(Q.n(g)) < P.n(f).dot(Q.n(incident))) incident = g;
  }
  FaceClip<Scalar> polygon(Q, incident);
  polygon.clip(P, f);
  if (polygon.count() <= 12)
    add_polygon<12, Scalar>(P, Q, f, polygon, separation, margin, flip, out);
  else
    add_polygon<2 * kMostCorners + 2, Scalar>(P, Q, f, polygon, separation, margin, flip, out);
}

/// Adds the points of the contact of polytopes A and B whose gap is at most `margin`. `size` (m) is
/// that of the smaller one.
template <RealScalar Scalar>
void polytope_contacts(const PosedPolytope<Scalar>& A, const PosedPolytope<Scalar>& B,
                       const Scalar& margin, const Scalar& size, BodyContacts<Scalar>& out) {
  const SeparatingAxis<Scalar> of_a = best_face<Scalar>(A, B, margin);
  if (margin < of_a.separation) return;
  const SeparatingAxis<Scalar> of_b = best_face<Scalar>(B, A, margin);
  if (margin < of_b.separation) return;
  const SeparatingAxis<Scalar> edges = best_edges<Scalar>(A, B);
  if (margin < edges.separation) return;
  const Scalar better = Scalar(1e-4) * size;
  const bool face_b = of_a.separation + better < of_b.separation;
  const SeparatingAxis<Scalar>& face = face_b ? of_b : of_a;
  const Vector3<Scalar>& n = face_b ? B.n(of_b.a) : A.n(of_a.a);
  const Scalar along = (face_b ? Scalar(-1) : Scalar(1)) * n.dot(edges.axis);
  const bool alike = edges.a < 0 || Scalar(0.99) < along;
  if (alike || !(face.separation + better < edges.separation)) {
    if (face_b)
      add_face_contact<Scalar>(B, A, face.a, face.separation, margin, true, out);
    else
      add_face_contact<Scalar>(A, B, face.a, face.separation, margin, false, out);
    return;
  }
  const PolytopeEdge& e = A.shape.edges[static_cast<std::size_t>(edges.a)];
  const PolytopeEdge& g = B.shape.edges[static_cast<std::size_t>(edges.b)];
  const Vector3<Scalar> u = A.x(e.b) - A.x(e.a), v = B.x(g.b) - B.x(g.a);
  const std::array<Scalar, 2> at = closest_on_segments<Scalar>(A.x(e.a), u, B.x(g.a), v);
  const Vector3<Scalar> p = A.x(e.a) + at[0] * u, q = B.x(g.a) + at[1] * v;
  if (Scalar(0) < edges.separation && margin * margin < (p - q).squaredNorm()) return;
  BodyContactPoint<Scalar> point;
  point.position = Scalar(0.5) * (p + q);
  point.normal = -edges.axis;
  point.gap = edges.separation;
  point.feature = 0x00800000u | (static_cast<std::uint32_t>(edges.a) << 8) |
                  static_cast<std::uint32_t>(edges.b);
  out.add(point);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
