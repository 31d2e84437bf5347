#pragma once

// How much the measurement of a few markers changes all vertices of a sheet: the Kalman gain of
// vertices that the model would move exactly, but for an unknown acceleration field. The field is
// new in each frame, independent in the three coordinates, and correlated over the sheet by
//
//   k(d) = (1 + √3 d/l) exp(-√3 d/l),   d: distance in the undeformed sheet
//
// and zero at vertices whose motion is known: K ← K - K_h K_hh⁻¹ K_hᵀ. With the markers C x and the
// eigenvalues C K Cᵀ = U diag(λ) Uᵀ, the steady state of the filter falls apart into a filter of
// one coordinate for each column of U, whose acceleration is √λ σ_a (steady_covariance.hpp: p, c):
//
//   P_z = U diag(p) Uᵀ        covariance of the predicted markers
//   P_x = K Cᵀ U diag(p/λ) Uᵀ,   P_v = K Cᵀ U diag(c/λ) Uᵀ        ... with all vertices
//   δx = P_x w,   δv = P_v w,   (P_z + σ² I) w = z - C x        on the markers that are used
//
// With all markers, this is the steady state; without some of them, it is one step from it.

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "clothctl/core/types.hpp"
#include "clothctl/estimate/detail/steady_covariance.hpp"
#include "clothctl/estimate/estimator_settings.hpp"
#include "clothctl/linalg/updatable_cholesky.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/math/symmetric_eigen.hpp"
#include "clothctl/prediction/features.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Eigenvalues and eigenvectors (the columns of `vectors`) of the symmetric matrix `a`, which
/// becomes diagonal, by cyclic Jacobi rotations. Allocates. Complexity: usually 6 to 10 sweeps of
/// 6 n³ operations.
template <RealScalar Scalar>
void diagonalise(MatrixX<Scalar>& a, MatrixX<Scalar>& vectors) {
  using std::abs;
  const Index n = a.rows();
  vectors.setIdentity(n, n);
  Scalar trace = Scalar(0);
  for (Index i = 0; i < n; ++i) trace += abs(a(i, i));
  const Scalar negligible = scalar_traits<Scalar>::epsilon() * trace * Scalar(1e-3);
  for (int sweep = 0; sweep < 30; ++sweep) {
    if (jacobi_sweep(a, vectors, negligible)) return;
  }
}

/// The gain of the markers on all vertices.
template <RealScalar Scalar>
class FieldGain {
 public:
  /// Computes the gain for vertices at `places` in the undeformed sheet (3×n, m), of which those in
  /// `known` are known. Allocates. Complexity: O(markers³ + markers² n).
  void reserve(const Points<Scalar>& places, const PointFeatures<Scalar>& markers,
               const std::vector<int>& known, const EstimatorSettings<Scalar>& settings) {
    const Index n = places.cols(), m = markers.count();
    noise_ = settings.noise;
    MatrixX<Scalar> field(n, m);
    for (Index j = 0; j < m; ++j) {
      for (Index i = 0; i < n; ++i) {
        Scalar sum = Scalar(0);
        markers.for_each_term(j, [&](int v, const Scalar& weight) {
          sum += weight * correlation(places, i, v, settings.correlation);
        });
        field(i, j) = sum;
      }
    }
    subtract_known(places, known, settings.correlation, field);
    MatrixX<Scalar> seen(m, m), vectors;
    evaluate(markers, field, seen);
    for (Index j = 0; j < m; ++j) {
      for (Index i = 0; i < j; ++i) seen(i, j) = seen(j, i);
    }
    diagonalise(seen, vectors);
    combine(field, seen.diagonal(), vectors, settings);
    factor_.reserve(m);
    used_.reserve(static_cast<std::size_t>(m));
    for (VectorX<Scalar>& w : work_) w.setZero(m);
  }

  /// Returns the standard deviation that is expected of a coordinate of marker j minus its
  /// prediction, m.
  Scalar expected(Index j) const {
    using std::sqrt;
    return sqrt(prior_(j, j) + noise_ * noise_);
  }

  /// Adds the correction that the differences `gap` (measured minus predicted, 3×markers, m) of the
  /// markers `used` make to positions and velocities (3×n). Never allocates.
  void correct(const std::vector<Index>& used, const Points<Scalar>& gap, Points<Scalar>& x,
               Points<Scalar>& v) {
    if (used != used_) {
      used_ = used;
      factor_.rebuild(prior_, used_, static_cast<Index>(used_.size()), noise_ * noise_, Scalar(0));
    }
    for (Index c = 0; c < 3; ++c) {
      VectorX<Scalar>& w = work_[static_cast<std::size_t>(c)];
      for (Index k = 0; k < factor_.size(); ++k) w[k] = gap(c, factor_.order(k));
      factor_.solve_lower(w);
      factor_.solve_upper(w);
    }
    for (Index k = 0; k < factor_.size(); ++k) {
      const Index j = factor_.order(k);
      const Vector3<Scalar> w(work_[0][k], work_[1][k], work_[2][k]);
      for (Index i = 0; i < x.cols(); ++i) {
        for (Index c = 0; c < 3; ++c) {
          x(c, i) += position_(i, j) * w[c];
          v(c, i) += velocity_(i, j) * w[c];
        }
      }
    }
  }

 private:
  static Scalar correlation(const Points<Scalar>& places, Index i, Index j, const Scalar& length) {
    using std::exp;
    using std::sqrt;
    const Vector3<Scalar> apart = places.col(i) - places.col(j);
    const Scalar d = sqrt(Scalar(3) * apart.squaredNorm()) / length;
    return (Scalar(1) + d) * exp(-d);
  }

  /// Replaces columns of vertices by those of markers. from: n×m, to: markers×m.
  static void evaluate(const PointFeatures<Scalar>& markers, const MatrixX<Scalar>& from,
                       MatrixX<Scalar>& to) {
    to.setZero();
    for (Index j = 0; j < markers.count(); ++j) {
      markers.for_each_term(j, [&](int v, const Scalar& weight) {
        for (Index k = 0; k < from.cols(); ++k) to(j, k) += weight * from(v, k);
      });
    }
  }

  /// Conditions the columns of `field` on known vertices.
  static void subtract_known(const Points<Scalar>& places, const std::vector<int>& known,
                             const Scalar& length, MatrixX<Scalar>& field) {
    const Index h = static_cast<Index>(known.size());
    if (h == 0) return;
    MatrixX<Scalar> among(h, h);
    std::vector<Index> all;
    const auto vertex = [&](Index a) { return known[static_cast<std::size_t>(a)]; };
    for (Index a = 0; a < h; ++a) {
      all.push_back(a);
      for (Index b = 0; b < h; ++b) among(a, b) = correlation(places, vertex(a), vertex(b), length);
    }
    UpdatableCholesky<Scalar> factor;
    factor.reserve(h);
    factor.rebuild(among, all, h, Scalar(0), Scalar(1e-9));  // equal places count once
    VectorX<Scalar> w(h);
    for (Index j = 0; j < field.cols(); ++j) {
      for (Index k = 0; k < factor.size(); ++k) w[k] = field(vertex(factor.order(k)), j);
      factor.solve_lower(w);
      factor.solve_upper(w);
      for (Index i = 0; i < field.rows(); ++i) {
        for (Index k = 0; k < factor.size(); ++k)
          field(i, j) -= w[k] * correlation(places, i, vertex(factor.order(k)), length);
      }
      for (const int v : known) field(v, j) = Scalar(0);
    }
  }

  /// Sets the covariances from K Cᵀ, the eigenvalues of C K Cᵀ and their vectors.
  void combine(const MatrixX<Scalar>& field, const VectorX<Scalar>& values,
               const MatrixX<Scalar>& vectors, const EstimatorSettings<Scalar>& settings) {
    using std::sqrt;
    const Index n = field.rows(), m = field.cols();
    const Scalar interval = settings.dt * Scalar(static_cast<double>(settings.interval));
    prior_.setZero(m, m);
    position_.setZero(n, m);
    velocity_.setZero(n, m);
    VectorX<Scalar> along(n);
    const Scalar least = Scalar(1e-6) * (m > 0 ? values.maxCoeff() : Scalar(0));
    for (Index k = 0; k < m; ++k) {
      if (!(least < values[k])) continue;  // the markers of this vector hardly move
      const SteadyCovariance<Scalar> steady(sqrt(values[k]) * settings.acceleration, noise_,
                                            interval);
      along.setZero();
      for (Index j = 0; j < m; ++j) add_scaled(n, vectors(j, k), &field(0, j), along.data());
      for (Index j = 0; j < m; ++j) {
        const Scalar part = vectors(j, k) / values[k];
        add_scaled(n, Scalar(part * steady.position), along.data(), &position_(0, j));
        add_scaled(n, Scalar(part * steady.cross), along.data(), &velocity_(0, j));
        add_scaled(m, Scalar(vectors(j, k) * steady.position), &vectors(0, k), &prior_(0, j));
      }
    }
  }

  Scalar noise_ = Scalar(1);
  MatrixX<Scalar> prior_, position_, velocity_;
  UpdatableCholesky<Scalar> factor_;
  std::vector<Index> used_;
  std::array<VectorX<Scalar>, 3> work_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
