#pragma once

// The steady state of a Kalman filter for a point of unknown acceleration that is measured once in
// every interval T, in one coordinate:
//
//   x⁺ = x + T v + T²/2 a,   v⁺ = v + T a,   z = x + e,   a ~ N(0, σ_a²),   e ~ N(0, σ²)
//
// Its gains α for x and β/T for v depend on the tracking index alone:
//
//   Λ = σ_a T² / σ,   g = (√(Λ (8 + Λ)) - Λ) / 4,   α = g (2 - g),   β = 2 g²
//
// The covariances before a measurement are p of x, and c of x and v: α = p/(p + σ²), β/T = c/(p +
// σ²). Reference: Kalata, The tracking index: a generalized parameter for α-β and α-β-γ target
// trackers, IEEE Trans. Aerospace and Electronic Systems 20 (1984).

#include <cmath>

#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Covariances of the error of a prediction.
template <RealScalar Scalar>
struct SteadyCovariance {
  /// Variance of the position, m².
  Scalar position;
  /// Covariance of position and velocity, m²/s.
  Scalar cross;

  /// Computes them from the standard deviations of the acceleration (m/s²) and of a measurement (m,
  /// positive), and the time between measurements (s).
  SteadyCovariance(const Scalar& acceleration, const Scalar& noise, const Scalar& interval) {
    using std::sqrt;
    const Scalar index = acceleration * interval * interval / noise;
    const Scalar g = (sqrt(index * (Scalar(8) + index)) - index) / Scalar(4);
    const Scalar rest = (Scalar(1) - g) * (Scalar(1) - g);  // 1 - α
    position = noise * noise * g * (Scalar(2) - g) / rest;
    cross = noise * noise * Scalar(2) * g * g / (interval * rest);
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
