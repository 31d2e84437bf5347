#pragma once

// The direction that an unknown i opens when it depends on the free ones:
//
//   p_i = ±1,  p_F = ∓H_FF⁻¹ H_Fi        so that  H_F p = 0
//
// Its curvature pᵀHp is the pivot that was refused: zero but for rounding, so the direction is refined towards H_F p = 0 before
// it is walked. Where H p = 0 in every row and no bound of p is near or far, it is a ray: the problem has no least value.

#include <algorithm>
#include <cmath>
#include <vector>

#include "clothctl/qp/accurate_sum.hpp"
#include "clothctl/qp/certificate.hpp"
#include "clothctl/qp/dense_curvature.hpp"

namespace clothctl::detail {

/// Builds, refines and proves flat directions. All memory comes from `reserve`.
template <RealScalar Scalar>
class FlatDirection {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) {
    for (Vector* v : {&product_, &size_, &correction_, &ray_}) v->setZero(n);
  }

  /// Writes the direction in which unknown i moves by `sign` to p, at the places that `moving` then lists. Answers how many.
  Index open(DenseCurvature<Scalar>& curvature, Index i, const Scalar& sign, std::vector<Index>& moving, Vector& p) {
    FreeSetFactor<Scalar>& factor = curvature.factor();
    const Index f = factor.size();
    factor.append(curvature.H(), i, Scalar(0), Scalar(2));  // always refused: leaves L⁻¹ H_Fi behind
    correction_.head(f) = factor.column().head(f);
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

  /// Tells whether the direction p over moving[0 … count-1] is flat in every row of H, to the rounding of the product, falls
  /// along g, and leaves no bound; if so leaves it in `ray()`. Entries below a threshold, coarse at first, count as zero: alone
  /// in a row they would never cancel. The part in the factor is refined towards H p = 0.
  bool is_ray(DenseCurvature<Scalar>& curvature, const std::vector<Index>& moving, Index count, const Vector& p,
              const Vector& g, const Vector& lo, const Vector& hi) {
    using std::abs;
    const Index n = curvature.unknowns();
    const Vector none;
    Scalar largest(0);
    for (Index k = 0; k < count; ++k) largest = (std::max)(largest, Scalar(abs(p[moving[static_cast<std::size_t>(k)]])));
    if (!(largest > Scalar(0)) || !is_finite(largest)) return false;
    Scalar threshold = coarsest_trace<Scalar>();
    for (int level = 0; level < kTraceLevels; ++level, threshold *= threshold) {
      ray_.head(n).setConstant(Scalar(0));
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
        const ProofCheck<Scalar> check = check_ray<Scalar>(ray_.head(n), product_.head(n), none, size_.head(n), none, g.head(n),
                                                           none, none, lo.head(n), hi.head(n));
        if (check.proven) return true;
        if (!check.promising) break;
        nearly = check.error < Scalar(kNearly);
        refine(curvature.factor(), ray_);
      }
    }
    return false;
  }

  /// What `is_ray` proved, n entries in use.
  const Vector& ray() const { return ray_; }

 private:
  /// H v and the sizes of its terms, for v over moving[0 … count-1].
  void multiply(const DenseCurvature<Scalar>& curvature, const std::vector<Index>& moving, Index count, const Vector& v) {
    using std::abs;
    const Index n = curvature.unknowns();
    product_.head(n).setConstant(Scalar(0));
    size_.head(n).setConstant(Scalar(0));
    for (Index k = 0; k < count; ++k) {
      const Index i = moving[static_cast<std::size_t>(k)];
      product_.head(n) += v[i] * curvature.H().col(i);
      size_.head(n) += abs(v[i]) * curvature.H().col(i).cwiseAbs();
    }
  }

  /// H v as if summed in twice the precision.
  void sharpen(const DenseCurvature<Scalar>& curvature, const std::vector<Index>& moving, Index count, const Vector& v) {
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
  void refine(const FreeSetFactor<Scalar>& factor, Vector& v) {
    for (Index k = 0; k < factor.size(); ++k) correction_[k] = product_[factor.order(k)];
    factor.solve_lower(correction_);
    factor.solve_upper(correction_);
    for (Index k = 0; k < factor.size(); ++k) v[factor.order(k)] -= correction_[k];
  }

  Vector product_, size_, correction_, ray_;
};

}  // namespace clothctl::detail
