#pragma once

// The closest points of a vertex and a triangle, and of two edges, with their weights.
//
// A pair has four vertices x_0 .. x_3 and weights w_i that are positive on side A and negative on
// side B and sum to one on each side, so that
//
//   o = Σ w_i x_i      is the way from the closest point of B to that of A, and |o| the distance
//
//   vertex x_0 over triangle x_1 x_2 x_3:   w = (1, -b_1, -b_2, -b_3)
//   edge x_0 x_1 and edge x_2 x_3:          w = (1 - s, s, t - 1, -t)
//
// Inside of both features the weights follow from cross products: with m = e_1 × e_2 of the
// triangle's sides, b = det(...)/m², and with m = e_A × e_B, s and t likewise. Their error grows as
// 1/sin of the angle, and the distance along the features as the sine, so the distance keeps its
// digits near the parallel case. (The usual way divides by e_A² e_B² - (e_A·e_B)², which loses
// twice as many.) Elsewhere the closest points are those of a vertex and an edge, of which there
// are three and four. A triangle without area counts as its sides.
//
// Where edges are parallel to rounding, the middle of the part that they share is taken.

#include <array>
#include <cmath>
#include <cstddef>

#include "clothctl/core/types.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Four positions of a pair.
template <RealScalar Scalar>
using PairPoints = std::array<Vector3<Scalar>, 4>;

/// The closest points of a pair.
template <RealScalar Scalar>
struct PairOffset {
  /// Signed weights of the vertices.
  std::array<Scalar, 4> weight{Scalar(0), Scalar(0), Scalar(0), Scalar(0)};
  /// The way from side B to side A, m, and its square.
  Vector3<Scalar> offset = Vector3<Scalar>::Constant(Scalar(0));
  Scalar square = scalar_traits<Scalar>::infinity();
  /// True when the closest points lie inside of the triangle, or of both edges.
  bool inside = false;
};

/// The share of the segment a, a + e at which it is closest to a + p, from 0 to 1.
template <RealScalar Scalar>
Scalar closest_share(const Vector3<Scalar>& p, const Vector3<Scalar>& e) {
  const Scalar along = e.dot(p), square = e.squaredNorm();
  if (!(Scalar(0) < along)) return Scalar(0);
  return along < square ? Scalar(along / square) : Scalar(1);
}

/// Replaces `best` by the closest points of a vertex and an edge, if they are closer. `a`, `b` and
/// `c` are places of the vertex and the ends of the edge in `x`; `sign` is 1 if the vertex is on
/// side A.
template <RealScalar Scalar>
void consider_corner(const PairPoints<Scalar>& x, std::size_t a, std::size_t b, std::size_t c,
                     const Scalar& sign, PairOffset<Scalar>& best) {
  const Vector3<Scalar> e = x[c] - x[b];
  const Scalar s = closest_share<Scalar>(Vector3<Scalar>(x[a] - x[b]), e);
  const Vector3<Scalar> way = Scalar(0.5) < s ? Vector3<Scalar>(x[a] - x[c] + (Scalar(1) - s) * e)
                                              : Vector3<Scalar>(x[a] - x[b] - s * e);
  const Scalar square = way.squaredNorm();
  if (!(square < best.square)) return;
  best.weight = {Scalar(0), Scalar(0), Scalar(0), Scalar(0)};
  best.weight[a] = sign;
  best.weight[b] = -sign * (Scalar(1) - s);
  best.weight[c] = -sign * s;
  best.offset = sign * way;
  best.square = square;
  best.inside = false;
}

/// Returns the closest points of the vertex x_0 and the triangle x_1 x_2 x_3. If the distance of
/// the triangle's plane shows that they are further apart than the square root of `limit` (m²), it
/// may return an infinite distance instead.
template <RealScalar Scalar>
PairOffset<Scalar> vertex_triangle(const PairPoints<Scalar>& x,
                                   const Scalar& limit = scalar_traits<Scalar>::infinity()) {
  PairOffset<Scalar> best;
  const Vector3<Scalar> e1 = x[2] - x[1], e2 = x[3] - x[1], p = x[0] - x[1];
  const Vector3<Scalar> m = e1.cross(e2);
  const Scalar area = m.squaredNorm(), eps = scalar_traits<Scalar>::epsilon();
  const Scalar size = e1.squaredNorm() * e2.squaredNorm();
  // Thinner than this, m is no more than rounding.
  const bool flat = Scalar(64) * eps * eps * size < area;
  if (flat) {
    const Scalar height = m.dot(p);
    if (Scalar(1e-4) * size < area && Scalar(1.0001) * limit * area < height * height) return best;
    Scalar u = m.dot(Vector3<Scalar>(p.cross(e2))), v = m.dot(Vector3<Scalar>(e1.cross(p)));
    if (Scalar(0) < u && Scalar(0) < v && u + v < area) {
      u /= area;
      v /= area;
      Vector3<Scalar> o = p - u * e1 - v * e2;
      // What is left in the plane, where the triangle is thin.
      const Scalar du = m.dot(Vector3<Scalar>(o.cross(e2))) / area;
      const Scalar dv = m.dot(Vector3<Scalar>(e1.cross(o))) / area;
      o -= du * e1 + dv * e2;
      u += du;
      v += dv;
      best.weight = {Scalar(1), u + v - Scalar(1), -u, -v};
      best.offset = o;
      best.square = o.squaredNorm();
      best.inside = true;
      if (Scalar(1e-4) * size < area) {
        // The direction keeps its digits where the distance is small.
        best.offset = (height / area) * m;
        best.square = best.offset.squaredNorm();
        return best;
      }
    }
  }
  consider_corner<Scalar>(x, 0, 1, 2, Scalar(1), best);
  consider_corner<Scalar>(x, 0, 2, 3, Scalar(1), best);
  consider_corner<Scalar>(x, 0, 3, 1, Scalar(1), best);
  return best;
}

/// Returns the middle of the part that two parallel edges share, if they share one.
template <RealScalar Scalar>
bool middle_of_parallel(const PairPoints<Scalar>& x, PairOffset<Scalar>& out) {
  const Vector3<Scalar> e = x[1] - x[0], f = x[3] - x[2];
  const Scalar square = e.squaredNorm();
  if (!(Scalar(0) < square) || !(Scalar(0) < f.squaredNorm())) return false;
  const Scalar a = e.dot(Vector3<Scalar>(x[2] - x[0])) / square;
  const Scalar b = e.dot(Vector3<Scalar>(x[3] - x[0])) / square;
  Scalar low = a < b ? a : b, high = a < b ? b : a;
  if (low < Scalar(0)) low = Scalar(0);
  if (Scalar(1) < high) high = Scalar(1);
  if (!(low < high)) return false;
  const Scalar s = (low + high) / Scalar(2);
  const Scalar t = closest_share<Scalar>(Vector3<Scalar>(x[0] + s * e - x[2]), f);
  out.weight = {Scalar(1) - s, s, t - Scalar(1), -t};
  out.offset = x[0] - x[2] + s * e - t * f;
  out.square = out.offset.squaredNorm();
  out.inside = true;
  return true;
}

/// Returns the closest points of the edges x_0 x_1 and x_2 x_3. `limit` as for `vertex_triangle`.
template <RealScalar Scalar>
PairOffset<Scalar> edge_edge(const PairPoints<Scalar>& x,
                             const Scalar& limit = scalar_traits<Scalar>::infinity()) {
  PairOffset<Scalar> best;
  const Vector3<Scalar> e = x[1] - x[0], f = x[3] - x[2], r = x[2] - x[0];
  const Vector3<Scalar> m = e.cross(f);
  const Scalar sine = m.squaredNorm(), eps = scalar_traits<Scalar>::epsilon();
  const Scalar size = e.squaredNorm() * f.squaredNorm();
  const bool parallel = !(Scalar(256) * eps * eps * size < sine);
  if (!parallel) {
    const Scalar height = m.dot(r);
    if (Scalar(1e-4) * size < sine && Scalar(1.0001) * limit * sine < height * height) return best;
    const Scalar s = m.dot(Vector3<Scalar>(r.cross(f)));
    const Scalar t = m.dot(Vector3<Scalar>(r.cross(e)));
    if (Scalar(0) < s && s < sine && Scalar(0) < t && t < sine) {
      const Scalar u = s / sine, v = t / sine;
      best.weight = {Scalar(1) - u, u, v - Scalar(1), -v};
      best.offset = u * e - v * f - r;
      best.square = best.offset.squaredNorm();
      best.inside = true;
      if (Scalar(1e-4) * size < sine) {
        best.offset = (-height / sine) * m;
        best.square = best.offset.squaredNorm();
        return best;
      }
    }
  }
  consider_corner<Scalar>(x, 0, 2, 3, Scalar(1), best);
  consider_corner<Scalar>(x, 1, 2, 3, Scalar(1), best);
  consider_corner<Scalar>(x, 2, 0, 1, Scalar(-1), best);
  consider_corner<Scalar>(x, 3, 0, 1, Scalar(-1), best);
  if (PairOffset<Scalar> middle; parallel && middle_of_parallel<Scalar>(x, middle)) {
    const Scalar slack = Scalar(64) * eps;
    if (middle.square <= best.square * (Scalar(1) + slack) + slack * slack * e.squaredNorm())
      return middle;
  }
  return best;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
