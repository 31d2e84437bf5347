#pragma once

// The point of a triangle that is closest to a point x.
//
// With the unit normal n and the inward normals m_i = n × e_i/|e_i| of the sides e_i from corner
// c_i, the foot of x on the plane lies inside when m_i·(x - c_i) > 0 for all i; the height n·(x -
// c_0) is then the distance. Otherwise the closest point lies on a side that x is beyond. Each
// m_i·(x - c_i) is a length with an error of rounding, so a wrong decision changes the distance by
// rounding only. (The usual test by barycentric coordinates loses digits where x is far from a thin
// triangle: 1e-4 m in float in 1 m.) A triangle that is thinner than rounding counts as its sides.
//
// Rounding turns the normal of a thin triangle, of the height h over its longest side L, about that
// side by the angle ε L/h, and n·(x - c_0) is wrong by half of the angle's square. Where that could
// be seen, the way is x - c less its parts along L and, limited to 0 to h, across L.

#include <array>
#include <cmath>
#include <cstddef>

#include "clothctl/collision/detail/direction.hpp"
#include "clothctl/core/types.hpp"

#include <Eigen/Geometry>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The part of a triangle on which a point lies. Side i goes from corner i to the next.
enum class TriangleFeature { Corner0, Corner1, Corner2, Side0, Side1, Side2, Face };

/// The way from the closest point of a triangle to x, its squared length, and the feature.
template <RealScalar Scalar>
struct TriangleOffset {
  Vector3<Scalar> offset;
  Scalar square;
  TriangleFeature feature;
};

/// Directions of a triangle.
template <RealScalar Scalar>
struct TriangleFrame {
  /// The longest side goes from this corner to the next.
  std::size_t longest = 0;
  /// Its length, and the height of the opposite corner over it, m.
  Scalar length, height;
  /// Unit vectors: from the longest side to the opposite corner in the plane, and the normal. Zero
  /// if the triangle has no height.
  Vector3<Scalar> across, normal;

  /// True when n·(x - c_0) is not accurate enough as the distance from the plane.
  bool thin() const {
    using std::sqrt;
    return height <= Scalar(16) * sqrt(scalar_traits<Scalar>::epsilon()) * length;
  }
};

/// Returns the directions of the triangle a, b, c.
template <RealScalar Scalar>
TriangleFrame<Scalar> triangle_frame(const Vector3<Scalar>& a, const Vector3<Scalar>& b,
                                     const Vector3<Scalar>& c) {
  const std::array<Vector3<Scalar>, 3> side{b - a, c - b, a - c};
  TriangleFrame<Scalar> out;
  for (std::size_t i = 1; i < 3; ++i) {
    if (side[out.longest].squaredNorm() < side[i].squaredNorm()) out.longest = i;
  }
  const Vector3<Scalar> zero = Vector3<Scalar>::Constant(Scalar(0));
  const Direction<Scalar> along = direction_of<Scalar>(side[out.longest], zero);
  Vector3<Scalar> up = -side[(out.longest + 2) % 3];
  // The first difference leaves rounding along the side.
  for (int k = 0; k < 2; ++k) up -= along.unit.dot(up) * along.unit;
  const Direction<Scalar> across = direction_of<Scalar>(up, zero);
  out.length = along.length;
  out.height = across.length;
  out.across = across.unit;
  // The cross product of two sides is exact for triangles in a coordinate plane, but its rounding
  // tilts the normal of a thin triangle along the longest side, too.
  out.normal = Scalar(0.1) * out.length < out.height
                   ? unit_or_zero<Scalar>(side[0].cross(Vector3<Scalar>(c - a)))
                   : Vector3<Scalar>(along.unit.cross(across.unit));
  return out;
}

/// A triangle, prepared for queries.
template <RealScalar Scalar>
class PreparedTriangle {
 public:
  /// Prepares the triangle a, b, c.
  PreparedTriangle(const Vector3<Scalar>& a, const Vector3<Scalar>& b, const Vector3<Scalar>& c)
      : corner_{a, b, c} {
    side_ = {b - a, c - b, a - c};
    const TriangleFrame<Scalar> frame = triangle_frame<Scalar>(a, b, c);
    longest_ = frame.longest;
    height_ = frame.height;
    thin_ = frame.thin();
    const bool flat = Scalar(64) * scalar_traits<Scalar>::epsilon() * frame.length < height_;
    normal_ = flat ? frame.normal : Vector3<Scalar>::Constant(Scalar(0));
    for (std::size_t i = 0; i < 3; ++i) {
      const Scalar square = side_[i].squaredNorm();
      inverse_square_[i] = Scalar(0) < square ? Scalar(Scalar(1) / square) : Scalar(0);
      inward_[i] = normal_.cross(unit_or_zero<Scalar>(side_[i]));
    }
    if (flat && thin_) inward_[longest_] = frame.across;
  }

  /// The first corner.
  const Vector3<Scalar>& corner() const { return corner_[0]; }
  /// True when the height over the plane is not accurate enough as a distance.
  bool thin() const { return thin_; }

  /// Returns the squared distance of x from the triangle's plane: no point of the triangle is
  /// closer. 0 for a triangle that counts as its sides.
  Scalar plane_square(const Vector3<Scalar>& x) const {
    const Scalar height = normal_.dot(Vector3<Scalar>(x - corner_[0]));
    return height * height;
  }
  /// Returns the way to x from the closest point of the triangle.
  TriangleOffset<Scalar> closest(const Vector3<Scalar>& x) const {
    const std::array<Vector3<Scalar>, 3> p{x - corner_[0], x - corner_[1], x - corner_[2]};
    std::array<bool, 3> beyond{};
    for (std::size_t i = 0; i < 3; ++i) beyond[i] = !(Scalar(0) < inward_[i].dot(p[i]));
    if (!beyond[0] && !beyond[1] && !beyond[2]) {
      if (thin_) return closest_on_thin(p[longest_]);
      const Scalar height = normal_.dot(p[0]);
      return {height * normal_, height * height, TriangleFeature::Face};
    }
    TriangleOffset<Scalar> best{p[0], p[0].squaredNorm(), TriangleFeature::Corner0};
    for (std::size_t i = 0; i < 3; ++i) {
      if (!beyond[i]) continue;
      const Scalar share = side_[i].dot(p[i]) * inverse_square_[i];
      const bool first = !(Scalar(0) < share), second = Scalar(1) <= share;
      const std::size_t next = (i + 1) % 3;
      Vector3<Scalar> offset = first ? p[i] : p[next];
      if (!first && !second) offset = p[i] - share * side_[i];
      const Scalar square = offset.squaredNorm();
      if (!(square < best.square)) continue;
      const std::size_t feature = first ? i : (second ? next : i + 3);
      best = {offset, square, static_cast<TriangleFeature>(feature)};
    }
    return best;
  }

 private:
  /// As `closest` for a point over the inside; `p` is the way to it from the first corner of the
  /// longest side.
  TriangleOffset<Scalar> closest_on_thin(const Vector3<Scalar>& p) const {
    const Scalar share = side_[longest_].dot(p) * inverse_square_[longest_];
    Scalar across = inward_[longest_].dot(p);
    if (height_ < across) across = height_;
    const Vector3<Scalar> offset = p - share * side_[longest_] - across * inward_[longest_];
    return {offset, offset.squaredNorm(), TriangleFeature::Face};
  }

  Vector3<Scalar> normal_;
  std::array<Vector3<Scalar>, 3> corner_, side_;
  /// Unit normals of the sides in the plane; zero if the triangle counts as its sides.
  std::array<Vector3<Scalar>, 3> inward_;
  std::array<Scalar, 3> inverse_square_;
  std::size_t longest_;
  /// Height over the longest side.
  Scalar height_;
  bool thin_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
