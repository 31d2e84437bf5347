#pragma once

// Planned poses of a window as B-splines: u_k = Σ_n S_kn z_n with fewer control points z than
// frames. Degree 0 is move blocking: the inputs of an interval are equal. For higher degrees the
// first frame is at the first knot, the last at the last one. All S_kn >= 0 and Σ_n S_kn = 1, so
// bounds that hold for the control points hold for the inputs. The first input is the first control
// point.

#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Returns S, frames × control points, for intervals of `lengths` frames; without lengths, the
/// identity. Allocates.
template <RealScalar Scalar>
MatrixX<Scalar> spline_weights(const std::vector<Index>& lengths, int degree, Index frames) {
  if (lengths.empty()) return MatrixX<Scalar>::Identity(frames, frames);
  const Index intervals = static_cast<Index>(lengths.size()), count = intervals + degree;
  std::vector<Scalar> knots(static_cast<std::size_t>(degree), Scalar(0));  // clamped at both ends
  Index sum = 0;
  for (Index i = 0; i <= intervals; ++i) {
    knots.push_back(Scalar(static_cast<double>(sum)));
    if (i < intervals) sum += lengths[static_cast<std::size_t>(i)];
  }
  knots.insert(knots.end(), static_cast<std::size_t>(degree), knots.back());
  const auto knot = [&](Index i) { return knots[static_cast<std::size_t>(i)]; };
  MatrixX<Scalar> S = MatrixX<Scalar>::Zero(frames, count);
  VectorX<Scalar> basis(count + degree);
  for (Index k = 0; k < frames; ++k) {
    // The first frame is at the start of the window, the last at its end.
    const Scalar t =
        degree == 0 || frames < 2
            ? Scalar(static_cast<double>(k))
            : knots.back() * Scalar(static_cast<double>(k) / static_cast<double>(frames - 1));
    basis.setZero();
    Index at = degree;
    while (at + 1 < count && !(t < knot(at + 1))) ++at;
    basis[at] = Scalar(1);
    for (int d = 1; d <= degree; ++d) {  // Cox-de Boor
      for (Index i = at - d; i <= at; ++i) {
        Scalar value = Scalar(0);
        const Scalar left = knot(i + d) - knot(i), right = knot(i + d + 1) - knot(i + 1);
        if (Scalar(0) < left) value += (t - knot(i)) / left * basis[i];
        if (Scalar(0) < right && i < at) value += (knot(i + d + 1) - t) / right * basis[i + 1];
        basis[i] = value;
      }
    }
    S.row(k) = basis.head(count).transpose();
  }
  return S;
}

/// The inputs of a window as splines. With one control point a frame it does nothing.
template <RealScalar Scalar>
class InputSplines {
 public:
  /// Makes room for `unknowns` unknowns of a frame. Allocates.
  template <class Settings>
  void reserve(const Settings& settings, Index unknowns) {
    weights_ =
        spline_weights<Scalar>(settings.input_intervals, settings.input_degree, settings.horizon);
    p_ = unknowns;
    used_ = !settings.input_intervals.empty();
    const Index size = used_ ? p_ * settings.horizon : 0;
    hessian_.setZero(size, size);
    half_.setZero(size, p_ * count());
    gradient_.setZero(size);
    lower_.setZero(size);
    upper_.setZero(size);
  }

  /// Returns true when there are other control points than frames.
  bool used() const { return used_; }
  /// Number of control points of each unknown.
  Index count() const { return weights_.cols(); }

  /// Where the QP of all frames is built: here, or in the given one if nothing is to be done.
  MatrixX<Scalar>& hessian(MatrixX<Scalar>& direct) { return used_ ? hessian_ : direct; }
  VectorX<Scalar>& gradient(VectorX<Scalar>& direct) { return used_ ? gradient_ : direct; }
  VectorX<Scalar>& lower(VectorX<Scalar>& direct) { return used_ ? lower_ : direct; }
  VectorX<Scalar>& upper(VectorX<Scalar>& direct) { return used_ ? upper_ : direct; }

  /// Turns the QP that was built here into that of the control points: Sᵀ H S, Sᵀ g, and bounds
  /// that keep those of each frame, if they do not exclude each other. Never allocates.
  void contract(MatrixX<Scalar>& hessian, VectorX<Scalar>& gradient, VectorX<Scalar>& lower,
                VectorX<Scalar>& upper) {
    if (!used_) return;
    half_.setZero();
    hessian.setZero();
    gradient.setZero();
    lower.setConstant(-scalar_traits<Scalar>::infinity());
    upper.setConstant(scalar_traits<Scalar>::infinity());
    for_each_weight([&](Index k, Index n, const Scalar& weight) {
      half_.middleCols(n * p_, p_) += weight * hessian_.middleCols(k * p_, p_);
      gradient.segment(n * p_, p_) += weight * gradient_.segment(k * p_, p_);
      for (Index i = 0; i < p_; ++i) {
        // Where bounds of frames exclude each other, the earlier frame counts: it is sent first.
        Scalar &least = lower[n * p_ + i], &most = upper[n * p_ + i];
        const Scalar &from = lower_[k * p_ + i], &to = upper_[k * p_ + i];
        if (least < from) least = most < from ? most : from;
        if (to < most) most = to < least ? least : to;
      }
    });
    for_each_weight([&](Index k, Index n, const Scalar& weight) {
      hessian.middleRows(n * p_, p_) += weight * half_.middleRows(k * p_, p_);
    });
  }

  /// Writes the inputs of all frames, u = S z. Never allocates.
  template <class Control>
  void expand(const Control& control, VectorX<Scalar>& inputs) const {
    inputs.setZero();
    for_each_weight([&](Index k, Index n, const Scalar& weight) {
      inputs.segment(k * p_, p_) += weight * control.segment(n * p_, p_);
    });
  }

 private:
  template <class Take>
  void for_each_weight(const Take& take) const {
    for (Index k = 0; k < weights_.rows(); ++k) {
      for (Index n = 0; n < weights_.cols(); ++n) {
        if (Scalar(0) < weights_(k, n)) take(k, n, weights_(k, n));
      }
    }
  }

  MatrixX<Scalar> weights_, hessian_, half_;
  VectorX<Scalar> gradient_, lower_, upper_;
  Index p_ = 0;
  bool used_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
