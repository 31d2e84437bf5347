#pragma once

// A hinge that is folded at rest (spring_network.hpp). With K = Σ w_i x_i, c = cos θ0/2, s = sin
// θ0/2 and the edge E = x_1 - x_0 of direction u = E/|E|:
//
//   e    = c K - s u × D,      D = Σ d_i x_i,  d = (w_2 - w_3, 0, -w_2, w_3)
//   U    = ½ kb |e|²
//   f_i  = -kb J_iᵀ e,         J_i = c w_i I - s (d_i [u]× - ε_i [D]× P / |E|)
//   K_ij = kb J_iᵀ J_j         the Gauss-Newton part of the stiffness, positive semidefinite
//
// where P = I - u uᵀ, ε = (-1, 1, 0, 0) are the coefficients of E, and [a]× b = a × b. The forces
// are exact. Their sum is 0 since w, d and ε each sum to 0; their torque is 0 since U does not
// change under rotations. At rest (e = 0), K is exact as well. An edge shorter than |D|/1000 counts
// as that long.

#include <array>
#include <cmath>
#include <cstddef>

#include "clothctl/cloth/detail/triple.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns Σ w_i x_i of a stencil, m.
template <RealScalar Scalar>
Triple<Scalar> stencil_curvature(const BendStencil<Scalar>& b, const PointsView<Scalar>& x) {
  Triple<Scalar> sum{Scalar(0), Scalar(0), Scalar(0)};
  for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i)
    sum = sum + column(x, b.vertex[i]) * b.weight[i];
  return sum;
}

/// Returns cos θ0/2 and sin θ0/2 of a stencil.
template <RealScalar Scalar>
std::array<Scalar, 2> half_rest_angle(const BendStencil<Scalar>& b) {
  using std::sqrt;
  const Scalar cosine = Scalar(1) / sqrt(Scalar(1) + b.rest_fold * b.rest_fold);
  return {cosine, b.rest_fold * cosine};
}

/// A folded hinge at one place.
template <RealScalar Scalar>
class FoldedHinge {
 public:
  /// Measures a stencil of four vertices at positions `x` (3×n, m).
  FoldedHinge(const BendStencil<Scalar>& b, const PointsView<Scalar>& x) : weight_(b.weight) {
    using std::sqrt;
    const auto half = half_rest_angle(b);
    cosine_ = half[0];
    sine_ = half[1];
    const Triple<Scalar> origin = column(x, b.vertex[0]);
    const Triple<Scalar> edge = column(x, b.vertex[1]) - origin;
    span_ = (column(x, b.vertex[3]) - origin) * weight_[3] -
            (column(x, b.vertex[2]) - origin) * weight_[2];
    const Scalar least = Scalar(1e-6) * squared_norm(span_), squared = squared_norm(edge);
    const Scalar used = least < squared ? squared : least;
    inverse_ = Scalar(0) < used ? Scalar(1) / sqrt(used) : Scalar(0);
    along_ = edge * inverse_;
    error_ = stencil_curvature<Scalar>(b, x) * cosine_ - cross(along_, span_) * sine_;
  }

  /// Returns e, m.
  const Triple<Scalar>& error() const { return error_; }

  /// Returns J_iᵀ a.
  Triple<Scalar> share(int i, const Triple<Scalar>& a) const {
    const Triple<Scalar> turned =
        cross(a, along_) * span_weight(i) + across(cross(span_, a)) * (edge_weight(i) * inverse_);
    return a * (cosine_ * weight_[static_cast<std::size_t>(i)]) - turned * sine_;
  }

  /// Returns J_i a.
  Triple<Scalar> change(int i, const Triple<Scalar>& a) const {
    const Triple<Scalar> turned =
        cross(along_, a) * span_weight(i) + cross(across(a), span_) * (edge_weight(i) * inverse_);
    return a * (cosine_ * weight_[static_cast<std::size_t>(i)]) - turned * sine_;
  }

  /// Returns `stiffness` times J_iᵀ J_j.
  Matrix3<Scalar> stiffness_block(int i, int j, const Scalar& stiffness) const {
    Matrix3<Scalar> block;
    const Scalar zero = Scalar(0);
    for (Index c = 0; c < 3; ++c) {
      const Triple<Scalar> unit{c == 0 ? stiffness : zero, c == 1 ? stiffness : zero,
                                c == 2 ? stiffness : zero};
      const Triple<Scalar> entries = share(i, change(j, unit));
      block(0, c) = entries.x;
      block(1, c) = entries.y;
      block(2, c) = entries.z;
    }
    return block;
  }

 private:
  /// d_i.
  Scalar span_weight(int i) const {
    return i == 0   ? Scalar(weight_[2] - weight_[3])
           : i == 1 ? Scalar(0)
           : i == 2 ? Scalar(Scalar(0) - weight_[2])
                    : weight_[3];
  }
  /// ε_i.
  static Scalar edge_weight(int i) { return Scalar(i == 0 ? -1 : i == 1 ? 1 : 0); }
  /// P a.
  Triple<Scalar> across(const Triple<Scalar>& a) const { return a - along_ * dot(along_, a); }

  std::array<Scalar, 4> weight_;
  Scalar cosine_, sine_, inverse_;
  /// u, D and e.
  Triple<Scalar> along_, span_, error_;
};

/// Returns the vector whose square is the energy of a stencil over ½ kb, m: e of a folded hinge,
/// else Σ w_i x_i.
template <RealScalar Scalar>
Triple<Scalar> bending_error(const BendStencil<Scalar>& b, const PointsView<Scalar>& x) {
  return b.is_folded() ? FoldedHinge<Scalar>(b, x).error() : stencil_curvature<Scalar>(b, x);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
