#pragma once

// Which way an edge that pierces a triangle must move against it, so that the curve in which the
// sheets cut each other becomes shorter. With the direction e of the edge, the normal n of the
// triangle, and for each triangle at the edge the direction r in which the curve goes on from the
// edge inside of it,
//
//   g = Σ_r ( r - n (e·r)/(e·n) )
//
// is the rate at which the curve becomes shorter when the edge's triangles move: the end of the
// curve on the edge moves by δ - e (n·δ)/(e·n) for a translation by δ. No side has to be known,
// and a corner that went through a sheet comes back over its border. Where the curve runs straight
// through the edge, g is zero. Where only the tip at a vertex is through, g hardly points back: it
// goes back along the normal of the triangle. Reference: Volino, Magnenat-Thalmann, Resolving
// surface collisions through intersection contour minimization, 2006.

#include <array>
#include <cmath>
#include <cstddef>

#include "clothctl/contact/detail/pair_rows.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns v with length one, or zero if it is zero.
template <RealScalar Scalar>
Vector3<Scalar> of_length_one(const Vector3<Scalar>& v) {
  using std::sqrt;
  const Scalar square = v.squaredNorm();
  return Scalar(0) < square ? Vector3<Scalar>(v / sqrt(square)) : v;
}

/// Returns the row of an edge that pierces a triangle: its weights are those of the crossing, its
/// normal is g, shortened to a length below one. `opposite` are the third vertices of the triangles
/// at the edge, -1 for none.
template <RealScalar Scalar>
PairRow<Scalar> contour_row(const Points<Scalar>& x, const std::array<int, 2>& edge,
                            const std::array<int, 3>& triangle,
                            const std::array<int, 2>& opposite) {
  using std::abs;
  using std::sqrt;
  const Vector3<Scalar> p = x.col(edge[0]), q = x.col(edge[1]), a = x.col(triangle[0]);
  const Vector3<Scalar> ab = x.col(triangle[1]) - a, ac = x.col(triangle[2]) - a;
  const Vector3<Scalar> m = ab.cross(ac), n = of_length_one<Scalar>(m);
  const Vector3<Scalar> e = of_length_one<Scalar>(Vector3<Scalar>(q - p));
  PairRow<Scalar> row;
  row.vertex = {edge[0], edge[1], triangle[0], triangle[1]};
  row.gap = row.pushed = Scalar(0);
  const Scalar before = abs(n.dot(Vector3<Scalar>(a - p)));
  const Scalar after = abs(n.dot(Vector3<Scalar>(q - a))), length = before + after;
  const Scalar s = Scalar(0) < length ? Scalar(before / length) : Scalar(0.5);
  Scalar slope = e.dot(n);
  if (abs(slope) < Scalar(0.1)) slope = slope < Scalar(0) ? Scalar(-0.1) : Scalar(0.1);
  Vector3<Scalar> g = Vector3<Scalar>::Constant(Scalar(0));
  for (const int o : opposite) {
    if (o < 0) continue;
    const Vector3<Scalar> way = x.col(o) - p, inward = way - e.dot(way) * e;
    Vector3<Scalar> r = of_length_one<Scalar>(n.cross(Vector3<Scalar>(e.cross(way))));
    if (r.dot(inward) < Scalar(0)) r = -r;
    g += r - (e.dot(r) / slope) * n;
  }
  row.normal = g / sqrt(Scalar(1) + g.squaredNorm());
  row.weight = {Scalar(1) - s, s, Scalar(-0.5), Scalar(-0.5)};
  return row;
}

/// Returns the row of a vertex `tip` that an edge from `other` took through a triangle: its normal
/// is that of the triangle, towards the side of `other`.
template <RealScalar Scalar>
PairRow<Scalar> tip_row(const Points<Scalar>& x, int tip, int other,
                        const std::array<int, 3>& triangle) {
  const Vector3<Scalar> a = x.col(triangle[0]);
  const Vector3<Scalar> ab = x.col(triangle[1]) - a, ac = x.col(triangle[2]) - a;
  const Vector3<Scalar> back = x.col(other) - x.col(tip);
  PairRow<Scalar> row;
  row.vertex = {tip, triangle[0], triangle[1], triangle[2]};
  const Scalar third = Scalar(-1) / Scalar(3);
  row.weight = {Scalar(1), third, third, Scalar(-1) - third - third};
  row.gap = row.pushed = Scalar(0);
  row.normal = of_length_one<Scalar>(Vector3<Scalar>(ab.cross(ac)));
  if (row.normal.dot(back) < Scalar(0)) row.normal = -row.normal;
  return row;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
