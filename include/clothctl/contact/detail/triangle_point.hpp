#pragma once

// The point of a triangle that is closest to a point x.
//
// With the unit normal n and the inward normals m_i = n × e_i/|e_i| of the sides e_i from corner
// c_i, the foot of x on the plane lies inside when m_i·(x - c_i) > 0 for all i; the height n·(x -
// c_0) is then the distance. Otherwise the closest point lies on a side that x is beyond. Each
// m_i·(x - c_i) is a length with an error of rounding, so a wrong decision changes the distance by
// rounding only. (The usual test by barycentric coordinates loses digits where x is far from a thin
// triangle: 1e-4 m in float in 1 m.) A triangle that is thinner than rounding counts as its sides.

#include <array>
#include <cmath>
#include <cstddef>

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

/// A triangle, prepared for queries.
template <RealScalar Scalar>
class PreparedTriangle {
 public:
  /// Prepares the triangle a, b, c.
  PreparedTriangle(const Vector3<Scalar>& a, const Vector3<Scalar>& b, const Vector3<Scalar>& c)
      : corner_{a, b, c} {
    using std::sqrt;
    const Scalar zero(0);
    side_ = {b - a, c - b, a - c};
    normal_ = side_[0].cross(Vector3<Scalar>(c - a));
    const Scalar doubled_area = sqrt(normal_.squaredNorm());
    Scalar longest(0);
    for (std::size_t i = 0; i < 3; ++i) {
      const Scalar square = side_[i].squaredNorm();
      if (longest < square) longest = square;
      inverse_square_[i] = zero < square ? Scalar(Scalar(1) / square) : zero;
      inward_[i] = Vector3<Scalar>::Constant(zero);
    }
    const bool flat = Scalar(64) * scalar_traits<Scalar>::epsilon() * longest < doubled_area;
    normal_ *= flat ? Scalar(Scalar(1) / doubled_area) : zero;
    if (!flat) return;
    for (std::size_t i = 0; i < 3; ++i)
      inward_[i] = normal_.cross(side_[i]) * sqrt(inverse_square_[i]);
  }

  /// The first corner.
  const Vector3<Scalar>& corner() const { return corner_[0]; }

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
  Vector3<Scalar> normal_;
  std::array<Vector3<Scalar>, 3> corner_, side_;
  /// Unit normals of the sides in the plane; zero if the triangle counts as its sides.
  std::array<Vector3<Scalar>, 3> inward_;
  std::array<Scalar, 3> inverse_square_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
