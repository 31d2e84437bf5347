#pragma once

// Provides a start for the box method by a primal-dual active-set method
// (special/primal_dual_active_set.hpp). In most cases the start is already optimal. This saves time
// only if the minimiser on a given active set is cheap. With a low-rank Hessian it always is. With
// a dense Hessian the minimiser needs the inverse K = H⁻¹ (special/active_bounds.hpp), which is
// computed after several solves with the same Hessian.

#include "clothctl/qp/detail/dense_curvature.hpp"
#include "clothctl/qp/detail/special/primal_dual_active_set.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Finds starts ("guesses") for the box method. All memory comes from `reserve`.
template <RealScalar Scalar, class Curvature>
class BoxWarmStart {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns. The caller reserves the curvature
  /// object itself. Allocates.
  void reserve(Index n) {
    rounds_.reserve(n);
    uses_ = 0;
    lasting_ = true;
    skip_ = false;
  }

  /// Call this after a change of the Hessian.
  void forget(Curvature& curvature) {
    if (uses_ > 0) lasting_ = uses_ >= kLasting;
    uses_ = 0;
    skip_ = false;
    if constexpr (!Curvature::kDefinite) curvature.active_bounds().forget();
  }

  /// Call this after each solve: it counts the uses of the Hessian. After a successful cold solve
  /// with few `active` bounds, it may compute the inverse for the next solves; this clears the
  /// curvature's factor.
  void end_solve(Curvature& curvature, bool warm, bool solved, Index active) {
    ++uses_;
    if constexpr (!Curvature::kDefinite) {
      const Index n = curvature.unknowns();
      if (!warm && solved && lasting_ && n <= kEager && ActiveBounds<Scalar>::suits(active, n))
        prepare(curvature);
    }
  }

  /// Makes the next solve start without a guess. Call this when the search used up the budget and
  /// gave no useful guess.
  void skip_next() { skip_ = true; }

  /// Searches for a guess, starting from the active set side_of(i) with `active` active bounds.
  /// Returns false when it finds none.
  template <class SideOf>
  bool find(Curvature& curvature, bool warm, Index active, const Vector& g, const Vector& lo,
            const Vector& hi, SideOf side_of, const Scalar& tolerance, const Budget& budget,
            int& iterations) {
    const Index n = curvature.unknowns();
    if (skip_) return skip_ = false;
    const auto go = [&](auto& minimiser) {
      minimiser.start_rounds(g);
      return rounds_.find(minimiser, n, g, lo, hi, side_of, tolerance, budget, iterations);
    };
    if constexpr (Curvature::kDefinite) {
      return go(curvature);
    } else {
      if (!warm || !ActiveBounds<Scalar>::suits(active, n)) return false;
      if (uses_ >= kLasting + n / 10) prepare(curvature);
      return curvature.active_bounds().known() && go(curvature.active_bounds());
    }
  }

  /// The guess, and whether the rounds that led to it converged.
  const PrimalDualActiveSet<Scalar>& rounds() const { return rounds_; }

  /// Computes one more Newton step p from the gradient q, which removes most of the rounding error
  /// of a guess. Returns false for a low-rank Hessian: the factor of the box method is as accurate
  /// there.
  bool refine(Curvature& curvature, const Vector& q, Vector& p) {
    if constexpr (!Curvature::kDefinite) curvature.active_bounds().newton(q, p);
    return !Curvature::kDefinite;
  }

 private:
  /// Up to this size a cold solve prepares the inverse at once; this takes about a millisecond.
  static constexpr Index kEager = 200;
  /// After this many solves with one Hessian it is likely that more will follow.
  static constexpr int kLasting = 8;

  /// Computes K in the memory of the free-set factor.
  static void prepare(Curvature& curvature) {
    ActiveBounds<Scalar>& mode = curvature.active_bounds();
    if (!mode.ready()) mode.prepare(curvature.H(), curvature.factor().lend());
  }

  PrimalDualActiveSet<Scalar> rounds_;
  int uses_ = 0;         // solves with this Hessian
  bool lasting_ = true;  // the previous Hessian, if any, was used for kLasting solves
  bool skip_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
