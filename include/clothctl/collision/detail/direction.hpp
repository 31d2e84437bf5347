#pragma once

// The length and the direction of a vector, also where the square of its length would be beyond the
// range of the scalar. In float that happens outside of 1e-19 to 1e19 m; lengths below 1e-19 m are
// common where a point rests on the centre or the axis of a shape up to rounding.

#include <cmath>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A vector as its length times a unit vector.
template <RealScalar Scalar>
struct Direction {
  Scalar length;
  Vector3<Scalar> unit;
};

/// Returns length and direction of v. The zero vector has the direction `otherwise`.
template <RealScalar Scalar>
Direction<Scalar> direction_of(const Vector3<Scalar>& v, const Vector3<Scalar>& otherwise) {
  using std::abs;
  using std::sqrt;
  const Scalar square = v.squaredNorm();
  if (Scalar(1e-28) < square && square < Scalar(1e36)) {
    const Scalar length = sqrt(square);
    return {length, v / length};
  }
  Scalar most(0);
  for (int i = 0; i < 3; ++i) {
    if (most < abs(v[i])) most = abs(v[i]);
  }
  if (!(Scalar(0) < most)) return {Scalar(0), otherwise};
  const Vector3<Scalar> scaled = v / most;
  const Scalar length = sqrt(scaled.squaredNorm());
  return {most * length, scaled / length};
}

/// Returns the length of v.
template <RealScalar Scalar>
Scalar length_of(const Vector3<Scalar>& v) {
  return direction_of<Scalar>(v, v).length;
}

/// Returns v of length one, or v itself where it is zero.
template <RealScalar Scalar>
Vector3<Scalar> unit_or_zero(const Vector3<Scalar>& v) {
  return direction_of<Scalar>(v, v).unit;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
