#pragma once

// How a step matrix differs from the one that was factored: contacts that have opened, closed or
// slipped since,
//
//   A' = A + Σ GᵀD G,     G u = Σ w_k u_k over the up to three vertices of a contact
//
// with symmetric 3×3 blocks D. Each adds a symmetric matrix of rank three to A, so that the inverse
// between a few points, W = E A⁻¹ Eᵀ, follows from one of A that has the points of the contacts,
// too (Sherman, Morrison and Woodbury):
//
//   W ← W - (G W)ᵀ (I + D G W Gᵀ)⁻¹ D (G W)
//
// one contact after the other. Every sum on the way is a step matrix with some contacts as they
// were and some as they are, so it is positive definite like A and A'.

#include <array>
#include <cstddef>
#include <span>

#include "clothctl/core/types.hpp"

#include <Eigen/LU>

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The part of one contact.
template <RealScalar Scalar>
struct FactorChange {
  /// Its vertices, -1 after the last, and their weights.
  std::array<int, 3> vertex{-1, -1, -1};
  Vector3<Scalar> weight = Vector3<Scalar>::Constant(Scalar(0));
  /// D, kg.
  Matrix3<Scalar> block = Matrix3<Scalar>::Constant(Scalar(0));
};

/// A few changes.
template <RealScalar Scalar>
class FactorChanges {
 public:
  /// More than these cost as much as another factor.
  static constexpr std::size_t kMost = 16;

  void clear() { count_ = 0; }
  bool full() const { return count_ == kMost; }
  void add(const FactorChange<Scalar>& change) { changes_[count_++] = change; }
  std::span<const FactorChange<Scalar>> list() const { return {changes_.data(), count_}; }

 private:
  std::array<FactorChange<Scalar>, kMost> changes_;
  std::size_t count_ = 0;
};

/// Returns G u of a change, for the velocities `u` of points; `point(vertex)` is a vertex' number
/// among them.
template <RealScalar Scalar, class Vector, class Point>
Vector3<Scalar> at_contact(const FactorChange<Scalar>& change, const Vector& u, Point point) {
  Vector3<Scalar> sum = Vector3<Scalar>::Constant(Scalar(0));
  for (std::size_t k = 0; k < 3 && change.vertex[k] >= 0; ++k)
    sum +=
        change.weight[static_cast<Index>(k)] * u.template segment<3>(3 * point(change.vertex[k]));
  return sum;
}

/// Replaces W (3n×3n, 1/kg), the inverse between points, by that of the matrix with a change.
/// `rows` (3×3n or wider): memory. Returns false where numbers are not finite. Never allocates.
template <RealScalar Scalar, class Point>
bool add_change(const FactorChange<Scalar>& change, Point point, Eigen::Ref<MatrixX<Scalar>> W,
                Points<Scalar>& rows) {
  const Index n = W.cols();
  for (Index j = 0; j < n; ++j) rows.col(j) = at_contact(change, W.col(j), point);  // G W
  Matrix3<Scalar> between = Matrix3<Scalar>::Constant(Scalar(0));                   // G W Gᵀ
  for (std::size_t k = 0; k < 3 && change.vertex[k] >= 0; ++k)
    between += change.weight[static_cast<Index>(k)] *
               rows.template middleCols<3>(3 * point(change.vertex[k]));
  const Matrix3<Scalar> sum = Matrix3<Scalar>(Matrix3<Scalar>::Identity() + change.block * between);
  const Matrix3<Scalar> answer = sum.inverse() * change.block;
  if (!all_finite(answer)) return false;
  for (Index j = 0; j < n; ++j) {
    const Vector3<Scalar> force = answer * rows.col(j);
    for (Index i = 0; i < n; ++i) W(i, j) -= rows.col(i).dot(force);
  }
  return true;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
