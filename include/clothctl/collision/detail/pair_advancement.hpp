#pragma once

// When the two sides of a pair first come closer than a gap g, while their vertices move straight
// from x to x + u in the time 0 to 1: conservative advancement. A step is safe when
//
//   no vertex of A can come closer to a vertex of B than the distance allows:
//     δ <= (d - g)/(max_A |u| + max_B |u|),      u without the mean of the four
//   or the plane between the closest points still separates the sides by g:
//     min over i in A, j in B of  n·(x_i - x_j) + δ n·(u_i - u_j)  >=  g
//
// The second lets layers slide on each other without small steps. The advancement stops at t when
// the distance is at most 2 g, so it never passes an impact, at which the distance would be zero,
// and its direction n is always defined there. No equation is solved, so no root can be lost.
// Reference: Li, Kaufman, Jiang, Codimensional incremental potential contact, 2021, §5 (the first
// bound); Mirtich, 1996 (the second).

#include <array>
#include <cmath>
#include <cstddef>

#include "clothctl/collision/detail/pair_distance.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns the closest points of a pair of edges or of a vertex and a triangle.
template <RealScalar Scalar>
PairOffset<Scalar> pair_offset(bool edges, const PairPoints<Scalar>& x) {
  return edges ? edge_edge<Scalar>(x) : vertex_triangle<Scalar>(x);
}

/// Returns how much closer (m) the sides of a pair can come during a motion by u: the largest way
/// on side A and that on side B, without the mean motion.
template <RealScalar Scalar>
Scalar approach_bound(bool edges, const PairPoints<Scalar>& u) {
  using std::sqrt;
  const Vector3<Scalar> mean = (u[0] + u[1] + u[2] + u[3]) / Scalar(4);
  std::array<Scalar, 2> most{Scalar(0), Scalar(0)};
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t side = i < (edges ? 2u : 1u) ? 0 : 1;
    const Scalar square = Vector3<Scalar>(u[i] - mean).squaredNorm();
    if (most[side] < square) most[side] = square;
  }
  return sqrt(most[0]) + sqrt(most[1]);
}

/// Returns the distance of the sides along m, times |m|: the least of side A less the largest of
/// side B.
template <RealScalar Scalar>
Scalar room_along(bool edges, const PairPoints<Scalar>& x, const Vector3<Scalar>& m) {
  // From the last vertex on, so that the position in space costs no digits.
  Scalar low = m.dot(Vector3<Scalar>(x[0] - x[3])), high(0);
  const Scalar second = m.dot(Vector3<Scalar>(x[1] - x[3]));
  const Scalar third = m.dot(Vector3<Scalar>(x[2] - x[3]));
  if (edges && second < low) low = second;
  if (!edges && high < second) high = second;
  if (high < third) high = third;
  return low - high;
}

/// Returns true when the plane across the line between the middles of the sides shows that they
/// are never closer than `gap` (m) on their way from x to y; no roots and divisions. (The distance
/// along a fixed direction is a concave function of time, so both ends suffice.)
template <RealScalar Scalar>
bool stay_apart(bool edges, const PairPoints<Scalar>& x, const PairPoints<Scalar>& y,
                const Scalar& gap) {
  const Vector3<Scalar> m = edges ? Vector3<Scalar>(x[0] + x[1] - x[2] - x[3])
                                  : Vector3<Scalar>(Scalar(3) * x[0] - x[1] - x[2] - x[3]);
  const Scalar limit = gap * gap * m.squaredNorm();
  const Scalar start = room_along<Scalar>(edges, x, m);
  if (!(Scalar(0) < start) || !(limit < start * start)) return false;
  const Scalar end = room_along<Scalar>(edges, y, m);
  return Scalar(0) < end && limit < end * end;
}

/// An impact of a pair: the share of the motion, and the closest points there.
template <RealScalar Scalar>
struct PairImpact {
  /// From 0 to 1, or more than 1 when there is no impact.
  Scalar time = Scalar(2);
  /// The closest points at that time.
  PairOffset<Scalar> at;
};

/// Returns for how long the plane with normal n keeps the sides apart by `gap`, from the positions
/// x with velocities u.
template <RealScalar Scalar>
Scalar separated_time(bool edges, const PairPoints<Scalar>& x, const PairPoints<Scalar>& u,
                      const Vector3<Scalar>& n, const Scalar& gap) {
  const std::size_t split = edges ? 2 : 1;
  Scalar time(4);
  for (std::size_t i = 0; i < split; ++i) {
    for (std::size_t j = split; j < 4; ++j) {
      const Scalar room = n.dot(Vector3<Scalar>(x[i] - x[j])) - gap;
      const Scalar rate = n.dot(Vector3<Scalar>(u[i] - u[j]));
      // Rounding has turned the plane.
      if (!(Scalar(0) < room)) return Scalar(0);
      if (room < -time * rate) time = room / -rate;
    }
  }
  return time;
}

/// Returns the first impact of a pair that moves from `x` to `y` (m): when its distance falls to
/// between `gap` and 2 `gap` (m, positive). A pair that starts closer than 2 `gap` has an impact at
/// 0 if its sides approach. A gap below rounding is raised to it. After 100 steps (about one of
/// 10⁴ random pairs) the time reached so far is returned as an impact, which is early.
template <RealScalar Scalar>
PairImpact<Scalar> advance_pair(bool edges, const PairPoints<Scalar>& x,
                                const PairPoints<Scalar>& y, Scalar gap) {
  using std::sqrt;
  constexpr int kMostSteps = 100;
  PairPoints<Scalar> u, from;
  const Vector3<Scalar> mean = (y[0] - x[0] + y[1] - x[1] + y[2] - x[2] + y[3] - x[3]) / Scalar(4);
  Scalar extent(0);
  for (std::size_t i = 0; i < 4; ++i) {
    u[i] = y[i] - x[i] - mean;
    from[i] = x[i] - x[0];
    extent += from[i].squaredNorm();
  }
  PairPoints<Scalar> at = from;
  const Scalar bound = approach_bound<Scalar>(edges, u);
  PairImpact<Scalar> out;
  if (!(Scalar(0) < bound)) return out;
  const Scalar rounding = Scalar(16) * scalar_traits<Scalar>::epsilon() * (sqrt(extent) + bound);
  if (gap < rounding) gap = rounding;
  Scalar time(0);
  for (int step = 0; step < kMostSteps; ++step) {
    const PairOffset<Scalar> closest = pair_offset<Scalar>(edges, at);
    const Scalar distance = sqrt(closest.square);
    Scalar advance = (distance - gap) / bound;
    if (Scalar(0) < distance) {
      const Vector3<Scalar> n = closest.offset / distance;
      const Scalar apart = separated_time<Scalar>(edges, at, u, n, gap);
      if (advance < apart) advance = apart;
    }
    if (Scalar(1) <= time + advance) return out;
    const bool close = !(Scalar(2) * gap < distance);
    if (close || step + 1 == kMostSteps) {
      out.time = time;
      out.at = closest;
      return out;
    }
    time += advance;
    for (std::size_t i = 0; i < 4; ++i) at[i] = from[i] + time * u[i];
  }
  return out;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
