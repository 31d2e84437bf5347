#pragma once

// A hinge that is folded at rest (spring_network.hpp). With K = Σ w_i x_i, c = cos θ0/2, s = sin
// θ0/2 and the edge E = x_1 - x_0 of direction u = E/|E|:
//
//   e    = c K - s u × D,      D = Σ d_i x_i,  d = (w_2 - w_3, 0, -w_2, w_3)
//   U    = ½ kb |e|²
//   f_i  = -kb J_iᵀ e,         J_i = c w_i I - s (d_i [u]× - ε_i [D]× P / |E|)
//   K_ij = kb J_iᵀ J_j         the Gauss-Newton part of the stiffness, positive semidefinite
//
// where P = I - u uᵀ, ε = (-1, 1, 0, 0) are the coefficients of E, and [a]× b = a × b. An edge
// shorter than |D|/1000 counts as that long: in general u = E/r with r² = max(|E|², δ|D|²), δ =
// 10⁻⁶. Where the edge is so short, D turns u instead,
//
//   J_i = c w_i I - s (d_i [u]× (I - D Dᵀ/|D|²) - ε_i [D]× / r)
//
// The forces are minus the gradient of U in both cases. Their sum is 0 since w, d and ε each sum to
// 0; their torque is 0 since U does not change under rotations. At rest (e = 0), K is exact as
// well.
//
// From one place to another, with bars over the means of both and Δ before the changes,
//
//   Δe = Σ J̄_i Δx_i,   J̄_i = c w_i I - s (d_i [ū]× - [D̄]× Q_i)
//   Q_i = (ε_i I - ū (τ ε_i Ē + (1 - τ) δ d_i D̄)ᵀ / r̄) / r̄
//
// exactly: Δu = (ΔE - ū Δr)/r̄ and r̄ Δr = τ Ē·ΔE + (1 - τ) δ D̄·ΔD. With q = |E|² - δ|D|², τ = Δ
// max(q, 0) / Δq is 1 for edges that are long enough at both places, and 0 for short ones.

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
  FoldedHinge(const BendStencil<Scalar>& b, const PointsView<Scalar>& x)
      : FoldedHinge(b, {column(x, b.vertex[0]), column(x, b.vertex[1]), column(x, b.vertex[2]),
                        column(x, b.vertex[3])}) {}

  /// Measures a stencil with its vertices at `p`, m.
  FoldedHinge(const BendStencil<Scalar>& b, const std::array<Triple<Scalar>, 4>& p)
      : weight_(b.weight) {
    using std::sqrt;
    const auto half = half_rest_angle(b);
    cosine_ = half[0];
    sine_ = half[1];
    edge_ = p[1] - p[0];
    span_ = (p[3] - p[0]) * weight_[3] - (p[2] - p[0]) * weight_[2];
    const Scalar least = shortest() * squared_norm(span_), squared = squared_norm(edge_);
    excess_ = squared - least;
    const Scalar used = is_short() ? least : squared;
    inverse_ = Scalar(0) < used ? Scalar(1) / sqrt(used) : Scalar(0);
    along_ = edge_ * inverse_;
    Triple<Scalar> curvature{Scalar(0), Scalar(0), Scalar(0)};
    for (std::size_t i = 0; i < 4; ++i) curvature = curvature + p[i] * weight_[i];
    error_ = curvature * cosine_ - cross(along_, span_) * sine_;
  }

  /// Returns e, m.
  const Triple<Scalar>& error() const { return error_; }

  /// Returns J_iᵀ a.
  Triple<Scalar> share(int i, const Triple<Scalar>& a) const {
    const Triple<Scalar> turned = turned_span(cross(a, along_)) * span_weight(i) +
                                  across(cross(span_, a)) * (edge_weight(i) * inverse_);
    return a * (cosine_ * weight_[static_cast<std::size_t>(i)]) - turned * sine_;
  }

  /// Returns J_i a.
  Triple<Scalar> change(int i, const Triple<Scalar>& a) const {
    const Triple<Scalar> turned = cross(along_, turned_span(a)) * span_weight(i) +
                                  cross(across(a), span_) * (edge_weight(i) * inverse_);
    return a * (cosine_ * weight_[static_cast<std::size_t>(i)]) - turned * sine_;
  }

  /// Returns J̄_iᵀ a from this place to `end` of the same stencil.
  Triple<Scalar> mean_share(const FoldedHinge& end, int i, const Triple<Scalar>& a) const {
    const Scalar zero = Scalar(0), one = Scalar(1), two = Scalar(2), half = Scalar(0.5);
    const bool sized = zero < inverse_ && zero < end.inverse_;
    const Scalar inverse = sized ? two * inverse_ / (one + inverse_ / end.inverse_)
                                 : two * (inverse_ + end.inverse_);  // 1/r̄
    const Triple<Scalar> u = (along_ + end.along_) * half, d = (span_ + end.span_) * half;
    const Scalar tau = share_of_edge(end), epsilon = edge_weight(i), weight = span_weight(i);
    const Triple<Scalar> radial =
        (edge_ + end.edge_) * (half * tau * epsilon) + d * ((one - tau) * shortest() * weight);
    const Triple<Scalar> across_span = cross(d, a);
    const Triple<Scalar> turned =
        cross(a, u) * weight +
        (across_span * epsilon - radial * (dot(u, across_span) * inverse)) * inverse;
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
  /// δ.
  static Scalar shortest() { return Scalar(1e-6); }
  /// True when D decides on r.
  bool is_short() const { return !(Scalar(0) < excess_); }
  /// τ of the change to `end`.
  Scalar share_of_edge(const FoldedHinge& end) const {
    if (is_short() == end.is_short()) return is_short() ? Scalar(0) : Scalar(1);
    return is_short() ? end.excess_ / (end.excess_ - excess_) : excess_ / (excess_ - end.excess_);
  }
  /// d_i.
  Scalar span_weight(int i) const {
    return i == 0   ? Scalar(weight_[2] - weight_[3])
           : i == 1 ? Scalar(0)
           : i == 2 ? Scalar(Scalar(0) - weight_[2])
                    : weight_[3];
  }
  /// ε_i.
  static Scalar edge_weight(int i) { return Scalar(i == 0 ? -1 : i == 1 ? 1 : 0); }
  /// P a, or a where D decides on r.
  Triple<Scalar> across(const Triple<Scalar>& a) const {
    return is_short() ? a : a - along_ * dot(along_, a);
  }
  /// (I - D Dᵀ/|D|²) a where D decides on r, else a.
  Triple<Scalar> turned_span(const Triple<Scalar>& a) const {
    if (!is_short() || !(Scalar(0) < inverse_)) return a;
    const Triple<Scalar> d = span_ * inverse_;  // |d|² = 1/δ
    return a - d * (shortest() * dot(d, a));
  }

  std::array<Scalar, 4> weight_;
  /// cos θ0/2, sin θ0/2, 1/r and |E|² - δ|D|².
  Scalar cosine_, sine_, inverse_, excess_;
  /// E, u, D and e.
  Triple<Scalar> edge_, along_, span_, error_;
};

/// Returns the vector whose square is the energy of a stencil over ½ kb, m: e of a folded hinge,
/// else Σ w_i x_i.
template <RealScalar Scalar>
Triple<Scalar> bending_error(const BendStencil<Scalar>& b, const PointsView<Scalar>& x) {
  return b.is_folded() ? FoldedHinge<Scalar>(b, x).error() : stencil_curvature<Scalar>(b, x);
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
