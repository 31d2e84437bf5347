#pragma once

// The contact of a convex body with any collider, through its distance function d alone. The points
// of the body's core are: its corners; the point of each edge where d is least, if that is not an
// end; the point of each face where d is least, if that is inside. Least points are found by steps
// against the gradient n of d, of the length |d| at first and projected to the edge or face; a step
// that does not get closer is halved. (On a convex collider d is convex, and the search ends at the
// least value; elsewhere at a local one.) Points with like normals are reduced to four.

#include <algorithm>
#include <cstdint>

#include "clothctl/collision/detail/polytope_contacts.hpp"
#include "clothctl/collision/detail/single_query.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Collects the contacts of one body with one collider.
template <RealScalar Scalar, class C>
class ColliderContacts {
 public:
  using Point = BodyContactPoint<Scalar>;

  ColliderContacts(const PosedPolytope<Scalar>& body, const Scalar& radius, const C& collider,
                   const Scalar& margin)
      : body_(body), collider_(collider), radius_(radius), margin_(margin) {}

  /// Adds the contacts to `out`. `size` is that of the body; features start at `label`.
  void find(const Scalar& size, std::uint32_t label, BodyContacts<Scalar>& out) {
    size_ = size;
    const Scalar middle = distance_of<Scalar>(collider_, body_.centre);
    Scalar outer(0);
    for (int i = 0; i < corners(); ++i) {
      const Scalar reach = (body_.x(i) - body_.centre).squaredNorm();
      if (outer < reach) outer = reach;
    }
    using std::sqrt;
    if (margin_ + radius_ + sqrt(outer) < middle) return;  // d changes by no more than the way
    for (int i = 0; i < corners(); ++i) {
      const SurfacePoint<Scalar> s = closest_of<Scalar>(collider_, body_.x(i));
      depth_[static_cast<std::size_t>(i)] = s.distance;
      take(body_.x(i), s, label + static_cast<std::uint32_t>(i));
    }
    const bool segment = corners() == 2;
    const int edges = segment ? 1 : body_.shape.edge_count();
    for (int e = 0; e < edges; ++e) {
      const PolytopeEdge ends =
          segment ? PolytopeEdge{0, 1, 0, 0} : body_.shape.edges[static_cast<std::size_t>(e)];
      add_edge(ends, label + 64u + static_cast<std::uint32_t>(e));
    }
    for (int f = 0; f < body_.shape.face_count(); ++f)
      add_face(f, label + 256u + static_cast<std::uint32_t>(f));
    cluster(out);
  }

 private:
  static constexpr int kRoom = 64;

  int corners() const { return body_.shape.corner_count(); }
  void take(const Vector3<Scalar>& x, const SurfacePoint<Scalar>& s, std::uint32_t feature) {
    const Scalar gap = s.distance - radius_;
    if (!is_finite(gap) || margin_ < gap || count_ == kRoom) return;
    if (!(Scalar(0.5) < s.normal.squaredNorm())) return;
    Point& p = found_[static_cast<std::size_t>(count_++)];
    p.gap = gap;
    p.position = x - (radius_ + Scalar(0.5) * gap) * s.normal;
    p.normal = s.normal;
    p.drift = s.velocity;
    p.friction = s.friction;
    p.feature = feature;
  }
  /// Goes down from x; `project` maps a point to the edge or face.
  template <class Project>
  SurfacePoint<Scalar> descend(Vector3<Scalar>& x, const Project& project) const {
    using std::abs;
    SurfacePoint<Scalar> s = closest_of<Scalar>(collider_, x);
    Scalar step = abs(s.distance) + Scalar(0.1) * size_;
    for (int k = 0; k < 24 && is_finite(s.distance); ++k) {
      const Vector3<Scalar> aim = x - step * s.normal;
      const Vector3<Scalar> next = project(aim);
      if ((next - x).squaredNorm() < Scalar(1e-8) * size_ * size_) break;
      const SurfacePoint<Scalar> t = closest_of<Scalar>(collider_, next);
      if (t.distance < s.distance) {
        x = next;
        s = t;
      } else {
        step *= Scalar(0.5);
      }
    }
    return s;
  }
  void add_edge(const PolytopeEdge& ends, std::uint32_t feature) {
    const Vector3<Scalar>& a = body_.x(ends.a);
    const Vector3<Scalar> u = body_.x(ends.b) - a;
    const Scalar uu = u.squaredNorm();
    using std::sqrt;
    const Scalar length = sqrt(uu), d_a = depth_[static_cast<std::size_t>(ends.a)],
                 d_b = depth_[static_cast<std::size_t>(ends.b)];
    // Nowhere on the edge is d less than this.
    if (margin_ + radius_ < Scalar(0.5) * (d_a + d_b - length)) return;
    Vector3<Scalar> x = a + Scalar(0.5) * u;
    const SurfacePoint<Scalar> s = descend(x, [&](const Vector3<Scalar>& y) {
      Scalar t = u.dot(Vector3<Scalar>(y - a)) / uu;
      t = t < Scalar(0) ? Scalar(0) : (Scalar(1) < t ? Scalar(1) : t);
      return Vector3<Scalar>(a + t * u);
    });
    const Scalar lower = d_a < d_b ? d_a : d_b;
    if (s.distance < lower - Scalar(1e-3) * length) take(x, s, feature);
  }
  void add_face(int f, std::uint32_t feature) {
    const int n = body_.shape.face_size(f);
    Vector3<Scalar> x = Vector3<Scalar>::Constant(Scalar(0));
    for (int k = 0; k < n; ++k)
      x += body_.x(body_.shape.face_corner(f, k)) / Scalar(static_cast<double>(n));
    Scalar lower = Scalar(1e30), reach = Scalar(0);
    for (int k = 0; k < n; ++k) {
      const int c = body_.shape.face_corner(f, k);
      const Scalar d = depth_[static_cast<std::size_t>(c)];
      if (d < lower) lower = d;
      const Scalar away = (body_.x(c) - x).squaredNorm();
      if (reach < away) reach = away;
    }
    using std::sqrt;
    if (margin_ < distance_of<Scalar>(collider_, x) - sqrt(reach)) return;
    const SurfacePoint<Scalar> s =
        descend(x, [&](const Vector3<Scalar>& y) { return onto_face(f, y); });
    if (!(s.distance < lower - Scalar(1e-3) * sqrt(reach))) return;
    for (int k = 0; k < count_; ++k) {  // the deepest point of an edge is there already
      const Vector3<Scalar> from = found_[static_cast<std::size_t>(k)].position - x;
      if (from.squaredNorm() < Scalar(4e-4) * reach + s.distance * s.distance) return;
    }
    take(x, s, feature);
  }
  /// The point of the face closest to y: its foot, or else the closest of the sides' points.
  Vector3<Scalar> onto_face(int f, const Vector3<Scalar>& y) const {
    const Vector3<Scalar> foot = y - body_.above(f, y) * body_.n(f);
    Vector3<Scalar> best = foot;
    Scalar nearest = Scalar(1e30);
    bool inside = true;
    for (int k = 0; k < body_.shape.face_size(f); ++k) {
      const Vector3<Scalar>& a = body_.x(body_.shape.face_corner(f, k));
      const Vector3<Scalar> way = body_.x(body_.shape.face_corner(f, k + 1)) - a, from = foot - a;
      inside = inside && !(Scalar(0) < way.cross(body_.n(f)).dot(from));
      Scalar t = way.dot(from) / way.squaredNorm();
      t = t < Scalar(0) ? Scalar(0) : (Scalar(1) < t ? Scalar(1) : t);
      const Vector3<Scalar> x = a + t * way;
      const Scalar square = (x - foot).squaredNorm();
      if (!(square < nearest)) continue;
      nearest = square;
      best = x;
    }
    return inside ? foot : best;
  }
  /// Hands on the points, those with like normals together, the deepest first.
  void cluster(BodyContacts<Scalar>& out) {
    while (count_ > 0 && out.count < kMostBodyContacts) {
      int deepest = 0;
      for (int i = 1; i < count_; ++i) {
        if (found_[static_cast<std::size_t>(i)].gap < found_[static_cast<std::size_t>(deepest)].gap)
          deepest = i;
      }
      const Vector3<Scalar> n = found_[static_cast<std::size_t>(deepest)].normal;
      int same = 0;
      for (int i = 0; i < count_; ++i) {
        if (!(Scalar(0.97) < found_[static_cast<std::size_t>(i)].normal.dot(n))) continue;
        std::rotate(found_.begin() + same, found_.begin() + i, found_.begin() + i + 1);
        ++same;
      }
      add_reduced<Scalar>(found_.data(), same, n, out);
      std::rotate(found_.begin(), found_.begin() + same, found_.begin() + count_);
      count_ -= same;
    }
  }

  const PosedPolytope<Scalar>& body_;
  const C& collider_;
  Scalar radius_, margin_, size_ = Scalar(0);
  std::array<Point, static_cast<std::size_t>(kRoom)> found_;
  std::array<Scalar, static_cast<std::size_t>(kMostCorners)> depth_;
  int count_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
