#pragma once

// Provides a start for the box method by a primal-dual active-set method
// (special/primal_dual_active_set.hpp), when a minimiser on a given active set is cheap. The start
// is mostly optimal already. It is always cheap with a low-rank Hessian. With a dense one it needs
// the inverse K = H⁻¹ (special/active_bounds.hpp), which is made once the same Hessian has been
// used for several solves.

#include "clothctl/qp/detail/dense_curvature.hpp"
#include "clothctl/qp/detail/special/primal_dual_active_set.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Guesses for the box method on a curvature. All memory comes from `reserve`.
template <RealScalar Scalar, class Curvature>
class BoxWarmStart {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns; the curvature is reserved by its owner. Allocates.
  void reserve(Index n) {
    rounds_.reserve(n);
    uses_ = 0;
    lasting_ = true;
    skip_ = false;
  }

  /// The Hessian changed.
  void forget(Curvature& curvature) {
    if (uses_ > 0) lasting_ = uses_ >= kLasting;
    uses_ = 0;
    skip_ = false;
    if constexpr (!Curvature::kDefinite) curvature.active_bounds().forget();
  }

  /// A solve with this Hessian, cold or warm, ended well or not, with so many active bounds.
  /// Empties the curvature's factor where it gets the active-set mode ready.
  void end_solve(Curvature& curvature, bool warm, bool well, Index active) {
    ++uses_;
    if constexpr (!Curvature::kDefinite) {
      const Index n = curvature.unknowns();
      if (!warm && well && lasting_ && n <= kEager && ActiveBounds<Scalar>::suits(active, n))
        prepare(curvature);
    }
  }

  /// The guess came to nothing and took the whole budget: the next solve does without.
  void skip_next() { skip_ = true; }

  /// Looks for a guess from the active set side_of(i), so many of them active. Returns false when
  /// there is none.
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

  /// The guess, and whether its rounds came to an end.
  const PrimalDualActiveSet<Scalar>& rounds() const { return rounds_; }

  /// One more Newton step of the active-set mode, p from gradient q, for what rounding left in a
  /// guess. Returns false where the factor of the box method does as well.
  bool refine(Curvature& curvature, const Vector& q, Vector& p) {
    if constexpr (!Curvature::kDefinite) curvature.active_bounds().newton(q, p);
    return !Curvature::kDefinite;
  }

 private:
  static constexpr Index kEager =
      200;  // up to here a cold solve makes ready for warm ones: about a millisecond
  static constexpr int kLasting = 8;  // solves after which a Hessian counts as one that is kept

  /// Makes the active-set mode ready, with the memory of the free-set factor.
  static void prepare(Curvature& curvature) {
    ActiveBounds<Scalar>& mode = curvature.active_bounds();
    if (!mode.ready()) mode.prepare(curvature.H(), curvature.factor().lend());
  }

  PrimalDualActiveSet<Scalar> rounds_;
  int uses_ = 0;         // solves with this Hessian
  bool lasting_ = true;  // the Hessian before was kept, or there was none
  bool skip_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
