#pragma once

// The convex hull of points, as triangles that face outwards.
//
// The points are rounded to a lattice of 2^29 steps across, about 2 nm in 1 m. There the side of a
// plane on which a point lies is an exact integer, so no input can confuse the construction: it is
// incremental. Of the hull so far, the triangles that see a new point strictly from outside are
// taken away, and the edges around the hole are joined to the point. Points that stand out of the
// hull so far by less than two steps are left out: rounding put them there, and they would give
// triangles like needles. Points far from the middle come first, since they are the corners.
// Complexity: O(points × faces).

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/collision/detail/basic_shape.hpp"
#include "clothctl/core/result.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A point of the lattice; coordinates from -2^28 to 2^28.
using HullLatticePoint = std::array<std::int64_t, 3>;

/// Returns the integer nearest to `x`, |x| <= 2^28, of any scalar type.
template <RealScalar Scalar>
std::int64_t to_lattice(const Scalar& x) {
  if constexpr (std::floating_point<Scalar>) {
    return std::llround(x);
  } else {
    // A type that only compares: one bit after the other.
    const Scalar shifted = x + Scalar(0.5);
    std::int64_t found = -(std::int64_t(1) << 29);
    for (std::int64_t bit = std::int64_t(1) << 30; bit > 0; bit /= 2) {
      if (!(shifted < Scalar(static_cast<double>(found + bit)))) found += bit;
    }
    return found;
  }
}

/// Returns the sign of det(b - a, c - a, p - a): positive when p lies on the side of the triangle
/// a, b, c from which it appears counter-clockwise. Exact.
inline int lattice_side(const HullLatticePoint& a, const HullLatticePoint& b,
                        const HullLatticePoint& c, const HullLatticePoint& p) {
  std::array<std::int64_t, 3> u{}, v{}, w{};
  for (std::size_t i = 0; i < 3; ++i) {
    u[i] = b[i] - a[i];
    v[i] = c[i] - a[i];
    w[i] = p[i] - a[i];
  }
  // Differences have 30 bits, minors 60; the products are summed in two halves of 31 bits.
  std::int64_t high = 0, low = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
    const std::int64_t minor = u[j] * v[k] - u[k] * v[j];
    const std::int64_t top = minor >> 31;
    high += top * w[i];
    low += (minor - top * (std::int64_t(1) << 31)) * w[i];
  }
  high += low >> 31;
  low -= (low >> 31) * (std::int64_t(1) << 31);
  if (high != 0) return high > 0 ? 1 : -1;
  return low > 0 ? 1 : 0;
}

/// The hull of some of the points.
struct HullTriangles {
  /// The points that are corners of the hull, ascending.
  std::vector<int> vertices;
  /// Triangles of positions in `vertices`, counter-clockwise from outside.
  std::vector<std::array<int, 3>> triangles;
  /// Their unit normals, 3×triangles, from the lattice: there they are good for slivers, too.
  Points<double> normals;
};

/// Adds the points one by one to a tetrahedron of four of them. Allocates.
class HullBuilder {
 public:
  /// Starts with a tetrahedron whose volume is not zero.
  HullBuilder(const std::vector<HullLatticePoint>& points, std::array<int, 4> first)
      : points_(points) {
    if (side({first[0], first[1], first[2]}, first[3]) > 0) std::swap(first[1], first[2]);
    faces_ = {{first[0], first[1], first[2]},
              {first[0], first[3], first[1]},
              {first[1], first[3], first[2]},
              {first[2], first[3], first[0]}};
  }

  /// Makes the hull hold point p, too.
  void add(int p) {
    bool out = false;
    for (std::size_t i = 0; i < faces_.size() && !out; ++i) out = kLeastHeight < height(i, p);
    if (!out) return;
    kept_.clear();
    ring_.clear();
    for (const std::array<int, 3>& face : faces_) {
      if (side(face, p) <= 0) {
        kept_.push_back(face);
        continue;
      }
      for (std::size_t i = 0; i < 3; ++i) ring_.push_back({face[i], face[(i + 1) % 3]});
    }
    std::sort(ring_.begin(), ring_.end());
    for (const std::array<int, 2>& edge : ring_) {
      const std::array<int, 2> back{edge[1], edge[0]};
      if (!std::binary_search(ring_.begin(), ring_.end(), back))
        kept_.push_back({edge[0], edge[1], p});
    }
    faces_.swap(kept_);
  }

  /// Returns the hull of all points added.
  HullTriangles finish() const {
    HullTriangles hull;
    for (const std::array<int, 3>& face : faces_)
      hull.vertices.insert(hull.vertices.end(), face.begin(), face.end());
    std::sort(hull.vertices.begin(), hull.vertices.end());
    hull.vertices.erase(std::unique(hull.vertices.begin(), hull.vertices.end()),
                        hull.vertices.end());
    hull.triangles = faces_;
    hull.normals.resize(3, static_cast<Index>(faces_.size()));
    for (std::size_t i = 0; i < faces_.size(); ++i)
      hull.normals.col(static_cast<Index>(i)) = area(faces_[i]).normalized();
    for (std::array<int, 3>& face : hull.triangles) {
      for (int& v : face) {
        const auto at = std::lower_bound(hull.vertices.begin(), hull.vertices.end(), v);
        v = static_cast<int>(at - hull.vertices.begin());
      }
    }
    return hull;
  }

 private:
  static constexpr double kLeastHeight = 2.0;

  /// Returns the way from one point to another.
  HullLatticePoint way(int from, int to) const {
    HullLatticePoint out{};
    for (std::size_t i = 0; i < 3; ++i)
      out[i] =
          points_[static_cast<std::size_t>(to)][i] - points_[static_cast<std::size_t>(from)][i];
    return out;
  }
  /// Returns the cross product of two sides of a triangle. Its components have 61 bits: integers
  /// lose no digits where they nearly cancel.
  Vector3<double> area(const std::array<int, 3>& face) const {
    const HullLatticePoint u = way(face[0], face[1]), v = way(face[0], face[2]);
    Vector3<double> out;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
      out[static_cast<Index>(i)] = static_cast<double>(u[j] * v[k] - u[k] * v[j]);
    }
    return out;
  }
  /// Returns the height of point p over a triangle, in steps of the lattice, to rounding.
  double height(std::size_t face, int p) const {
    const HullLatticePoint w = way(faces_[face][0], p);
    const Vector3<double> to_p(static_cast<double>(w[0]), static_cast<double>(w[1]),
                               static_cast<double>(w[2]));
    return area(faces_[face]).normalized().dot(to_p);
  }
  int side(const std::array<int, 3>& face, int p) const {
    return lattice_side(
        points_[static_cast<std::size_t>(face[0])], points_[static_cast<std::size_t>(face[1])],
        points_[static_cast<std::size_t>(face[2])], points_[static_cast<std::size_t>(p)]);
  }

  const std::vector<HullLatticePoint>& points_;
  std::vector<std::array<int, 3>> faces_, kept_;
  std::vector<std::array<int, 2>> ring_;
};

/// Returns the point for which `measure` is largest, the first of equal ones.
template <class Measure>
int farthest_point(int count, const Measure& measure) {
  int best = 0;
  for (int i = 1; i < count; ++i) {
    if (measure(best) < measure(i)) best = i;
  }
  return best;
}

/// Returns the triangles of the convex hull of the points (3×n, m). Allocates. Fails when: there
/// are fewer than 4 points, a coordinate is not finite, or the points lie within a millionth of
/// their extent of a plane.
template <RealScalar Scalar>
Result<HullTriangles> convex_hull(const PointsView<Scalar>& x) {
  using std::sqrt;
  const int count = static_cast<int>(x.cols());
  if (count < 4) return Error{"there are " + std::to_string(count) + " points, must be at least 4"};
  for (int i = 0; i < count; ++i) {
    const std::string name = "point " + std::to_string(i);
    if (std::string bad = validate_point<Scalar>(name.c_str(), x.col(i)); !bad.empty())
      return Error{"there is " + bad};
  }
  const auto at = [&x](int i) { return Vector3<Scalar>(x.col(i)); };
  const auto square = [&](int i, int j) { return Vector3<Scalar>(at(i) - at(j)).squaredNorm(); };
  const int a = farthest_point(count, [&](int i) { return square(i, 0); });
  const int b = farthest_point(count, [&](int i) { return square(i, a); });
  const Scalar length = sqrt(square(a, b));
  const Vector3<Scalar> along = unit_or_zero<Scalar>(at(b) - at(a));
  const int c = farthest_point(
      count, [&](int i) { return along.cross(Vector3<Scalar>(at(i) - at(a))).squaredNorm(); });
  const Vector3<Scalar> normal = unit_or_zero<Scalar>(along.cross(Vector3<Scalar>(at(c) - at(a))));
  const auto height = [&](int i) {
    const Scalar h = normal.dot(Vector3<Scalar>(at(i) - at(a)));
    return h < Scalar(0) ? Scalar(-h) : h;
  };
  const int d = farthest_point(count, height);
  if (!(Scalar(1e-6) * length < height(d)))
    return Error{"the " + std::to_string(count) + " points are flat: all lie within " +
                 number_text(Scalar(height(d))) + " m of a plane, and extend over " +
                 number_text(length) + " m"};
  const Scalar step = length / Scalar(268435456.0);  // 2^28
  std::vector<HullLatticePoint> lattice(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    for (int k = 0; k < 3; ++k)
      lattice[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)] =
          to_lattice<Scalar>((x(k, i) - x(k, a)) / step);
  }
  HullBuilder builder(lattice, {a, b, c, d});
  BoundingBox<Scalar> box{at(a), at(a)};
  for (int i = 0; i < count; ++i) box.include(at(i));
  const Vector3<Scalar> middle = Scalar(0.5) * (box.lower + box.upper);
  std::vector<Scalar> way(lattice.size());
  std::vector<int> order(lattice.size());
  for (int i = 0; i < count; ++i) {
    order[static_cast<std::size_t>(i)] = i;
    way[static_cast<std::size_t>(i)] = Vector3<Scalar>(at(i) - middle).squaredNorm();
  }
  std::stable_sort(order.begin(), order.end(), [&way](int i, int j) {
    return way[static_cast<std::size_t>(j)] < way[static_cast<std::size_t>(i)];
  });
  for (const int i : order) builder.add(i);
  return builder.finish();
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
