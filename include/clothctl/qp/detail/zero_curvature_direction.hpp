#pragma once

// The direction of zero curvature that belongs to an unknown i which depends on the free ones:
//
//   p_i = ±1,  p_F = ∓H_FF⁻¹ H_Fi        so that  H_F p = 0
//
// Its curvature pᵀHp is the pivot that was refused, which is zero except for rounding. So the
// direction is refined towards H_F p = 0 before it is used. When H p = 0 in every row and p runs
// into no bound, it is a certificate that the problem is unbounded.

#include <algorithm>
#include <cmath>
#include <vector>

#include "clothctl/linalg/accurate_sum.hpp"
#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/dense_curvature.hpp"
#include "clothctl/qp/detail/scaled_certificate.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Builds, refines and proves flat directions. All memory comes from `reserve`.
template <RealScalar Scalar>
class ZeroCurvatureDirection {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) { set_zero<Scalar>({&product_, &size_, &correction_, &ray_}, n); }

  /// Writes the direction in which unknown i moves by `sign` to p, at the places that `moving` then
  /// lists. Returns how many.
  Index open(DenseCurvature<Scalar>& curvature, Index i, const Scalar& sign,
             std::vector<Index>& moving, Vector& p) {
    UpdatableCholesky<Scalar>& factor = curvature.factor();
    const Index f = factor.size();
    factor.append(curvature.H(), i, Scalar(0),
                  Scalar(2));  // always refused: leaves L⁻¹ H_Fi behind
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

  /// Returns true when the direction p over moving[0 … count-1] is flat in every row of H, to the
  /// rounding of the product, falls along g, and leaves no bound; if so leaves it in `ray()`.
  /// Entries below a threshold, coarse at first, count as zero: alone in a row they would never
  /// cancel. The part in the factor is refined towards H p = 0.
  bool is_ray(DenseCurvature<Scalar>& curvature, const std::vector<Index>& moving, Index count,
              const Vector& p, const Vector& g, const Vector& lo, const Vector& hi) {
    using std::abs;
    const Index n = curvature.unknowns();
    const Vector none;
    Scalar largest(0);
    for (Index k = 0; k < count; ++k)
      largest = (std::max)(largest, Scalar(abs(p[moving[static_cast<std::size_t>(k)]])));
    if (!(largest > Scalar(0)) || !is_finite(largest)) return false;
    Scalar threshold = coarsest_trace<Scalar>();
    for (int level = 0; level < kTraceLevels; ++level, threshold *= threshold) {
      std::fill_n(ray_.data(), n, Scalar(0));
      for (Index k = 0; k < count; ++k) {
        const Index i = moving[static_cast<std::size_t>(k)];
        ray_[i] = p[i] / largest;
      }
      constexpr int kSteps = 4, kNearly = 1000;
      bool nearly = false;  // where the rounding of plain products is what refinement runs into
      for (int step = 0; step < kSteps; ++step) {
        for (Index j = 0; j < n; ++j) {
          if (abs(ray_[j]) < threshold) ray_[j] = Scalar(0);
        }
        multiply(curvature, moving, count, ray_);
        if (nearly) sharpen(curvature, moving, count, ray_);
        const ProofCheck<Scalar> proof =
            check_ray<Scalar>(ray_.head(n), product_.head(n), none, size_.head(n), none, g.head(n),
                              none, none, lo.head(n), hi.head(n));
        if (proof.proven) return true;
        if (!proof.promising) break;
        nearly = proof.error < Scalar(kNearly);
        refine(curvature.factor(), ray_);
      }
    }
    return false;
  }

  /// What `is_ray` proved, n entries in use.
  const Vector& ray() const { return ray_; }

 private:
  /// H v and the sizes of its terms, for v over moving[0 … count-1].
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

  /// H v as if summed in twice the precision.
  void sharpen(const DenseCurvature<Scalar>& curvature, const std::vector<Index>& moving,
               Index count, const Vector& v) {
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
