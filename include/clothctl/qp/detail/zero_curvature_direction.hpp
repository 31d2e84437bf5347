#pragma once

// The direction of zero curvature of an unknown i that makes H singular on F together with i:
//
//   p_i = ±1,  p_F = ∓H_FF⁻¹ H_Fi        so that  H_F p = 0
//
// Its curvature pᵀHp is the pivot that the factorisation refused, zero up to rounding. Before use,
// the direction is refined towards H_F p = 0. When H p = 0 in every row and no bound blocks p, p is
// a certificate that the problem is unbounded.

#include <algorithm>
#include <cmath>
#include <vector>

#include "clothctl/linalg/accurate_sum.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/dense_curvature.hpp"
#include "clothctl/qp/detail/scaled_certificate.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Computes directions of zero curvature and checks them as rays. All memory comes from `reserve`.
template <RealScalar Scalar>
class ZeroCurvatureDirection {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) { set_zero<Scalar>({&product_, &size_, &correction_, &ray_}, n); }

  /// Computes the direction p in which unknown i moves by `sign`. Writes only the entries of p that
  /// are not zero, and lists them in `moving`. Returns their number.
  Index open(DenseCurvature<Scalar>& curvature, Index i, const Scalar& sign,
             std::vector<Index>& moving, Vector& p) {
    UpdatableCholesky<Scalar>& factor = curvature.factor();
    const Index f = factor.size();
    // No pivot passes a tolerance of 2, so this only computes the column L⁻¹ H_Fi.
    factor.append(curvature.H(), i, Scalar(0), Scalar(2));
    std::copy_n(factor.column().data(), f, correction_.data());
    factor.solve_upper(correction_);
    for (Index k = 0; k < f; ++k) {
      moving[static_cast<std::size_t>(k)] = factor.order(k);
      p[factor.order(k)] = -sign * correction_[k];
    }
    moving[static_cast<std::size_t>(f)] = i;
    p[i] = sign;
    constexpr int kSteps = 2;
    for (int step = 0; step < kSteps && f > 0; ++step) {
      multiply(curvature, moving, f + 1, p);
      refine(factor, p);
    }
    return f + 1;
  }

  /// Returns true when the direction p over moving[0 … count-1] leads to a ray: H p = 0 up to
  /// rounding, gᵀp < 0, and no bound blocks p. Stores the ray in `ray()`. Entries below a drop
  /// tolerance count as zero, because nothing cancels an entry that is the only term of a row.
  /// Several drop tolerances are tried, the largest first. The entries in the factor are refined
  /// towards H p = 0.
  bool is_ray(DenseCurvature<Scalar>& curvature, const std::vector<Index>& moving, Index count,
              const Vector& p, const Vector& g, const Vector& lo, const Vector& hi) {
    using std::abs;
    const Index n = curvature.unknowns();
    const Vector none;
    Scalar largest(0);
    for (Index k = 0; k < count; ++k)
      largest = (std::max)(largest, Scalar(abs(p[moving[static_cast<std::size_t>(k)]])));
    if (!(largest > Scalar(0)) || !is_finite(largest)) return false;
    Scalar threshold = largest_drop_tolerance<Scalar>();
    for (int level = 0; level < kDropLevels; ++level, threshold *= threshold) {
      std::fill_n(ray_.data(), n, Scalar(0));
      for (Index k = 0; k < count; ++k) {
        const Index i = moving[static_cast<std::size_t>(k)];
        ray_[i] = p[i] / largest;
      }
      constexpr int kSteps = 4, kUseAccurateSums = 1000;
      bool accurate = false;  // near the end, rounding of plain products limits the refinement
      for (int step = 0; step < kSteps; ++step) {
        for (Index j = 0; j < n; ++j) {
          if (abs(ray_[j]) < threshold) ray_[j] = Scalar(0);
        }
        multiply(curvature, moving, count, ray_);
        if (accurate) multiply_accurately(curvature, moving, count, ray_);
        const CertificateCheck<Scalar> certificate =
            check_ray<Scalar>(ray_.head(n), product_.head(n), none, size_.head(n), none, g.head(n),
                              none, none, lo.head(n), hi.head(n));
        if (certificate.holds) return true;
        if (!certificate.promising) break;
        accurate = certificate.error < Scalar(kUseAccurateSums);
        refine(curvature.factor(), ray_);
      }
    }
    return false;
  }

  /// The ray that `is_ray` found, n entries in use.
  const Vector& ray() const { return ray_; }

 private:
  /// Computes H v and |H||v|, for v over moving[0 … count-1].
  void multiply(const DenseCurvature<Scalar>& curvature, const std::vector<Index>& moving,
                Index count, const Vector& v) {
    using std::abs;
    const Index n = curvature.unknowns();
    std::fill_n(product_.data(), n, Scalar(0));
    std::fill_n(size_.data(), n, Scalar(0));
    for (Index k = 0; k < count; ++k) {
      const Index i = moving[static_cast<std::size_t>(k)];
      for (Index j = 0; j < n; ++j) {
        product_[j] += v[i] * curvature.H()(j, i);
        size_[j] += abs(v[i]) * abs(curvature.H()(j, i));
      }
    }
  }

  /// Computes H v as if in twice the precision.
  void multiply_accurately(const DenseCurvature<Scalar>& curvature,
                           const std::vector<Index>& moving, Index count, const Vector& v) {
    for (Index j = 0; j < curvature.unknowns(); ++j) {
      AccurateSum<Scalar> sum;
      for (Index k = 0; k < count; ++k) {
        const Index i = moving[static_cast<std::size_t>(k)];
        sum.add_product(curvature.H()(i, j), v[i]);
      }
      product_[j] = sum.value();
    }
  }

  /// v_F -= H_FF⁻¹ (H v)_F.
  void refine(const UpdatableCholesky<Scalar>& factor, Vector& v) {
    for (Index k = 0; k < factor.size(); ++k) correction_[k] = product_[factor.order(k)];
    factor.solve_lower(correction_);
    factor.solve_upper(correction_);
    for (Index k = 0; k < factor.size(); ++k) v[factor.order(k)] -= correction_[k];
  }

  Vector product_, size_, correction_, ray_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
