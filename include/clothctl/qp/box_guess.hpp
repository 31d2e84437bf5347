#pragma once

// Where a minimiser on an active set is cheap, primal-dual rounds (primal_dual_rounds.hpp) guess x and the set that the box
// method starts from; mostly it finds them optimal. With a low-rank Hessian it is cheap always. With a dense one where few
// bounds are active: the active-set mode (active_bounds.hpp), whose inverse is made once the Hessian proves to be kept.

#include "clothctl/qp/dense_curvature.hpp"
#include "clothctl/qp/primal_dual_rounds.hpp"

namespace clothctl::detail {

/// Guesses for the box method on a curvature. All memory comes from `reserve`.
template <RealScalar Scalar, class Curvature>
class BoxGuess {
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

  /// A solve with this Hessian, cold or warm, ended well or not, with so many active bounds. Empties the curvature's factor
  /// where it gets the active-set mode ready.
  void end_solve(Curvature& curvature, bool warm, bool well, Index active) {
    ++uses_;
    if constexpr (!Curvature::kDefinite) {
      const Index n = curvature.unknowns();
      if (!warm && well && lasting_ && n <= kEager && ActiveBounds<Scalar>::suits(active, n)) prepare(curvature);
    }
  }

  /// The guess came to nothing and took the whole budget: the next solve does without.
  void skip_next() { skip_ = true; }

  /// Looks for a guess from the active set side_of(i), so many of them active. Answers false when there is none.
  template <class SideOf>
  bool find(Curvature& curvature, bool warm, Index active, const Vector& g, const Vector& lo, const Vector& hi, SideOf side_of,
            const Scalar& tolerance, const Budget& budget, int& iterations) {
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
  const PrimalDualRounds<Scalar>& rounds() const { return rounds_; }

  /// One more Newton step of the active-set mode, p from gradient q, for what rounding left in a guess. Answers false where the
  /// factor of the box method does as well.
  bool refine(Curvature& curvature, const Vector& q, Vector& p) {
    if constexpr (!Curvature::kDefinite) curvature.active_bounds().newton(q, p);
    return !Curvature::kDefinite;
  }

 private:
  static constexpr Index kEager = 200;  // up to here a cold solve makes ready for warm ones: about a millisecond
  static constexpr int kLasting = 8;    // solves after which a Hessian counts as one that is kept

  /// Makes the active-set mode ready, with the memory of the free-set factor.
  static void prepare(Curvature& curvature) {
    ActiveBounds<Scalar>& mode = curvature.active_bounds();
    if (!mode.ready()) mode.prepare(curvature.H(), curvature.factor().lend());
  }

  PrimalDualRounds<Scalar> rounds_;
  int uses_ = 0;         // solves with this Hessian
  bool lasting_ = true;  // the Hessian before was kept, or there was none
  bool skip_ = false;
};

}  // namespace clothctl::detail
