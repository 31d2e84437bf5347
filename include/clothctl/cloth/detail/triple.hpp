#pragma once

// Three numbers with the few operations that hot loops over springs and triangles need. Eigen's
// expression templates compute the same, but each new expression costs compile time, and these
// loops hold dozens of them. Sums of three products are added in the order of Eigen's reductions,
// so both give the same bits.

#include <type_traits>

#include "clothctl/config.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A vector in space.
template <class Scalar>
struct Triple {
  Scalar x, y, z;
};

template <class Scalar>
CLOTHCTL_FORCE_INLINE Triple<Scalar> operator+(const Triple<Scalar>& a, const Triple<Scalar>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class Scalar>
CLOTHCTL_FORCE_INLINE Triple<Scalar> operator-(const Triple<Scalar>& a, const Triple<Scalar>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class Scalar>
CLOTHCTL_FORCE_INLINE Triple<Scalar> operator*(const Triple<Scalar>& a,
                                               const std::type_identity_t<Scalar>& factor) {
  return {a.x * factor, a.y * factor, a.z * factor};
}
template <class Scalar>
CLOTHCTL_FORCE_INLINE Triple<Scalar> operator/(const Triple<Scalar>& a,
                                               const std::type_identity_t<Scalar>& divisor) {
  return {a.x / divisor, a.y / divisor, a.z / divisor};
}

/// a·b.
template <class Scalar>
CLOTHCTL_FORCE_INLINE Scalar dot(const Triple<Scalar>& a, const Triple<Scalar>& b) {
  if constexpr (std::is_same_v<Scalar, double>) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
  } else {
    return a.x * b.x + (a.y * b.y + a.z * b.z);
  }
}

/// |a|².
template <class Scalar>
CLOTHCTL_FORCE_INLINE Scalar squared_norm(const Triple<Scalar>& a) {
  return dot(a, a);
}

/// a × b.
template <class Scalar>
CLOTHCTL_FORCE_INLINE Triple<Scalar> cross(const Triple<Scalar>& a, const Triple<Scalar>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// M a for a 3×3 matrix.
template <class Scalar>
CLOTHCTL_FORCE_INLINE Triple<Scalar> product(const Matrix3<Scalar>& m, const Triple<Scalar>& a) {
  const Vector3<Scalar> out = m * Vector3<Scalar>(a.x, a.y, a.z);
  return {out[0], out[1], out[2]};
}

/// Reads column i of a 3×n matrix.
template <class Matrix>
CLOTHCTL_FORCE_INLINE Triple<typename Matrix::Scalar> column(const Matrix& matrix, Index i) {
  return {matrix(0, i), matrix(1, i), matrix(2, i)};
}

/// Reads a vector of three.
template <class Scalar>
CLOTHCTL_FORCE_INLINE Triple<Scalar> triple(const Vector3<Scalar>& v) {
  return {v[0], v[1], v[2]};
}

/// Writes column i of a 3×n matrix.
template <class Scalar>
CLOTHCTL_FORCE_INLINE void set_column(Points<Scalar>& matrix, Index i, const Triple<Scalar>& v) {
  matrix(0, i) = v.x;
  matrix(1, i) = v.y;
  matrix(2, i) = v.z;
}

/// Adds to column i of a 3×n matrix.
template <class Scalar>
CLOTHCTL_FORCE_INLINE void add_to_column(Points<Scalar>& matrix, Index i, const Triple<Scalar>& v) {
  matrix(0, i) = matrix(0, i) + v.x;
  matrix(1, i) = matrix(1, i) + v.y;
  matrix(2, i) = matrix(2, i) + v.z;
}

/// Subtracts from column i of a 3×n matrix.
template <class Scalar>
CLOTHCTL_FORCE_INLINE void subtract_from_column(Points<Scalar>& matrix, Index i,
                                                const Triple<Scalar>& v) {
  matrix(0, i) = matrix(0, i) - v.x;
  matrix(1, i) = matrix(1, i) - v.y;
  matrix(2, i) = matrix(2, i) - v.z;
}

/// Reads point i of a row of coordinates x0 y0 z0 x1 ...
template <class Scalar>
CLOTHCTL_FORCE_INLINE Triple<Scalar> point(const Lanes<Scalar, 1>& row, Index i) {
  return {row[3 * i], row[3 * i + 1], row[3 * i + 2]};
}

/// Writes point i of a row of coordinates.
template <class Scalar>
CLOTHCTL_FORCE_INLINE void set_point(Lanes<Scalar, 1>& row, Index i, const Triple<Scalar>& v) {
  row[3 * i] = v.x;
  row[3 * i + 1] = v.y;
  row[3 * i + 2] = v.z;
}

/// Returns a row of coordinates as a 3×n matrix over the same memory.
template <class Scalar>
Eigen::Map<Points<Scalar>> as_points(Lanes<Scalar, 1>& row) {
  return {row.data(), 3, row.cols() / 3};
}

/// Writes a + factor · b to `out`, entry by entry; the sizes are equal, and `out` may be `a`.
template <class Scalar, class Other>
void move_along(const Points<Scalar>& a, const std::type_identity_t<Scalar>& factor, const Other& b,
                Points<Scalar>& out) {
  for (Index k = 0; k < out.size(); ++k) out.data()[k] = a.data()[k] + factor * b.data()[k];
}

/// Returns the largest magnitude of an entry. NaN entries are ignored.
template <class Matrix>
typename Matrix::Scalar largest_magnitude(const Matrix& matrix) {
  using Scalar = typename Matrix::Scalar;
  Scalar largest = Scalar(0);
  for (Index k = 0; k < matrix.size(); ++k) {
    const Scalar& entry = matrix.data()[k];
    const Scalar magnitude = entry < Scalar(0) ? -entry : entry;
    if (largest < magnitude) largest = magnitude;
  }
  return largest;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
