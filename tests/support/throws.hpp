#pragma once

// Throws: a thin obstacle and a sheet that meet at random, and a judge that knows nothing of the
// library's contacts. The obstacle's skeleton is the axis of a capsule, or the middle of a plate.
// Nothing passes if no vertex, edge or triangle of the sheet meets one of the skeleton on the
// straight way from one step to the next.

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/math/rotation.hpp"
#include "support/meshes.hpp"

namespace clothctl_test {

using Vec3 = clothctl::Vector3<double>;

/// What is thrown.
enum class Thrown { Finger, Needle, Plate };

/// The middle of an obstacle.
struct Skeleton {
  clothctl::Points<double> points;
  std::vector<std::array<int, 2>> edges;
  Triangles triangles;
};

/// Returns the skeleton of a capsule of half the length `half` along z, or of a plate y-z.
inline Skeleton make_skeleton(Thrown what, double half) {
  Skeleton s;
  if (what != Thrown::Plate) {
    s.points.resize(3, 2);
    s.points.col(0) = Vec3(0, 0, -half);
    s.points.col(1) = Vec3(0, 0, half);
    s.edges = {{0, 1}};
    return s;
  }
  s.points.resize(3, 4);
  for (int k = 0; k < 4; ++k)
    s.points.col(k) = half * Vec3(0, k == 1 || k == 2 ? 1 : -1, k > 1 ? 1 : -1);
  s.edges = {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 2}};
  s.triangles = {{0, 1, 2}, {0, 2, 3}};
  return s;
}

/// The times in [0, 1], ascending, at which four points on straight ways are in a plane. Calls
/// visit(t) until it returns true; returns whether it did.
template <class Visit>
bool for_each_coplanar(const std::array<Vec3, 4>& from, const std::array<Vec3, 4>& to,
                       Visit visit) {
  const auto volume = [&](double t) {
    std::array<Vec3, 4> p;
    for (std::size_t k = 0; k < 4; ++k) p[k] = from[k] + t * (to[k] - from[k]);
    return (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]);
  };
  // The cubic by its values at four times, and the extremes that divide it into monotone parts.
  const double v0 = volume(0), v1 = volume(1.0 / 3), v2 = volume(2.0 / 3), v3 = volume(1);
  const double a = 4.5 * (v3 - 3 * v2 + 3 * v1 - v0), b = 4.5 * (2 * v0 - 5 * v1 + 4 * v2 - v3);
  const double c = v3 - v0 - a - b;
  std::array<double, 4> cut{0, 1, 1, 1};
  std::size_t cuts = 1;
  const double root = b * b - 3 * a * c;
  if (root > 0) {
    const double q = -(b + (b < 0 ? -1 : 1) * std::sqrt(root));
    std::array<double, 2> t{q / (3 * a), q == 0 ? -1 : c / q};
    if (t[1] < t[0]) std::swap(t[0], t[1]);
    for (const double x : t) {
      if (x > 0 && x < 1) cut[cuts++] = x;
    }
  }
  cut[cuts++] = 1;
  for (std::size_t k = 0; k + 1 < cuts; ++k) {
    double low = cut[k], high = cut[k + 1];
    const double at_low = volume(low);
    if ((at_low < 0) == (volume(high) < 0)) continue;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      ((volume(middle) < 0) == (at_low < 0) ? low : high) = middle;
    }
    if (visit(0.5 * (low + high))) return true;
  }
  return false;
}

/// Returns whether a point (first) passes a triangle (the others).
inline bool passes_triangle(const std::array<Vec3, 4>& from, const std::array<Vec3, 4>& to) {
  return for_each_coplanar(from, to, [&](double t) {
    std::array<Vec3, 4> p;
    for (std::size_t k = 0; k < 4; ++k) p[k] = from[k] + t * (to[k] - from[k]);
    const Vec3 n = (p[2] - p[1]).cross(p[3] - p[1]);
    for (std::size_t k = 1; k < 4; ++k) {
      const Vec3 side = p[k % 3 + 1] - p[k];
      if (side.cross(p[0] - p[k]).dot(n) < 0) return false;
    }
    return true;
  });
}

/// Returns whether two edges (the first two, the others) pass each other.
inline bool edges_pass(const std::array<Vec3, 4>& from, const std::array<Vec3, 4>& to) {
  return for_each_coplanar(from, to, [&](double t) {
    std::array<Vec3, 4> p;
    for (std::size_t k = 0; k < 4; ++k) p[k] = from[k] + t * (to[k] - from[k]);
    const Vec3 u = p[1] - p[0], v = p[3] - p[2], n = u.cross(v);
    const double square = n.squaredNorm();
    if (!(square > 0)) return false;
    const double s = (p[2] - p[0]).cross(v).dot(n) / square;
    const double r = (p[2] - p[0]).cross(u).dot(n) / square;
    return s >= 0 && s <= 1 && r >= 0 && r <= 1;
  });
}

/// Returns whether the skeleton passes through the sheet, both on straight ways.
inline bool passes(const Skeleton& s, const clothctl::Points<double>& s_from,
                   const clothctl::Points<double>& s_to, const Triangles& triangles,
                   const clothctl::Points<double>& from, const clothctl::Points<double>& to) {
  const Vec3 low = s_from.rowwise().minCoeff().cwiseMin(s_to.rowwise().minCoeff());
  const Vec3 high = s_from.rowwise().maxCoeff().cwiseMax(s_to.rowwise().maxCoeff());
  const auto far = [&](const std::array<int, 3>& t) {
    Vec3 a = from.col(t[0]), b = a;
    for (const int v : t) {
      a = a.cwiseMin(Vec3(from.col(v))).cwiseMin(Vec3(to.col(v)));
      b = b.cwiseMax(Vec3(from.col(v))).cwiseMax(Vec3(to.col(v)));
    }
    return (a.array() > high.array()).any() || (b.array() < low.array()).any();
  };
  for (const std::array<int, 3>& t : triangles) {
    if (far(t)) continue;
    for (clothctl::Index k = 0; k < s.points.cols(); ++k) {
      if (passes_triangle({s_from.col(k), from.col(t[0]), from.col(t[1]), from.col(t[2])},
                          {s_to.col(k), to.col(t[0]), to.col(t[1]), to.col(t[2])}))
        return true;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const int a = t[k], b = t[(k + 1) % 3];
      for (const auto& e : s.edges) {
        if (edges_pass({s_from.col(e[0]), s_from.col(e[1]), from.col(a), from.col(b)},
                       {s_to.col(e[0]), s_to.col(e[1]), to.col(a), to.col(b)}))
          return true;
      }
      for (const auto& f : s.triangles) {
        if (passes_triangle({from.col(a), s_from.col(f[0]), s_from.col(f[1]), s_from.col(f[2])},
                            {to.col(a), s_to.col(f[0]), s_to.col(f[1]), s_to.col(f[2])}))
          return true;
      }
    }
  }
  return false;
}

/// A throw: the obstacle's shape and motion, and the velocity of the sheet, which lies flat at
/// z = 0, 0.3 m wide, with its middle at the origin.
struct Throw {
  Thrown what;
  double radius, half, friction;
  Skeleton skeleton;
  clothctl::RigidMotion<double> motion;
  Vec3 sheet_velocity, gravity;
};

/// Returns a unit vector of any direction.
inline Vec3 any_direction(std::mt19937& random) {
  while (true) {
    Vec3 x;  // one draw after the other: compilers order arguments as they like
    for (clothctl::Index i = 3; i-- > 0;) x[i] = uniform(random, -1, 1);
    if (x.norm() > 0.1 && x.norm() < 1) return x.normalized();
  }
}

/// Returns a random throw at up to `speed` m/s: the obstacle comes from above, in any attitude, and
/// hits the sheet at any place; a plate moves in its own plane. It flies, or the sheet does.
inline Throw random_throw(std::mt19937& random, Thrown what, double speed) {
  Throw out;
  out.what = what;
  out.radius = what == Thrown::Finger ? 8e-3 : 0.5e-3;
  out.half = what == Thrown::Finger ? 0.04 : 0.1;
  out.friction = uniform(random, 0, 0.8);
  out.skeleton = make_skeleton(what, what == Thrown::Plate ? out.half - out.radius : out.half);
  const double angle = uniform(random, 0, 3.1);
  const Vec3 turn = angle * any_direction(random);
  const clothctl::Matrix3<double> R = clothctl::rotation_exp<double>(turn);
  Vec3 way(0, 0, -1);
  way[1] = uniform(random, -1, 1);
  way[0] = uniform(random, -1, 1);
  if (what == Thrown::Plate) way -= way.dot(R.col(0)) * R.col(0);
  if (way[2] > -0.2) way[2] = -0.2;
  if (what == Thrown::Plate) way -= way.dot(R.col(0)) * R.col(0);
  way *= uniform(random, 0.25, 1) * speed / way.norm();
  // The lowest point of the skeleton meets the sheet at a random place.
  const clothctl::Points<double> turned = R * out.skeleton.points;
  clothctl::Index lowest = 0;
  turned.row(2).minCoeff(&lowest);
  const double gap = uniform(random, 0.01, 0.05) + 1.5 * out.radius;
  Vec3 aim(0, 0, gap);
  aim[1] = uniform(random, -0.13, 0.13);
  aim[0] = uniform(random, -0.13, 0.13);
  const double lead = way[2] < -0.05 * speed ? gap / -way[2] : 0;
  out.motion.R_world_body = R;
  out.motion.position = aim - Vec3(way[0], way[1], 0) * lead - Vec3(turned.col(lowest));
  out.sheet_velocity.setZero();
  if (random() % 2 == 0) {
    out.sheet_velocity = -way;
  } else {
    out.motion.velocity = way;
    if (random() % 2 == 0) out.motion.angular_velocity = any_direction(random) * 3;
  }
  out.gravity = 9.81 * any_direction(random);
  return out;
}

/// Returns the skeleton's points as the obstacle is now.
inline clothctl::Points<double> placed(const Throw& thrown,
                                       const clothctl::RigidMotion<double>& now) {
  clothctl::Points<double> out = now.R_world_body * thrown.skeleton.points;
  out.colwise() += now.position;
  return out;
}

}  // namespace clothctl_test
