#pragma once

// A primal-dual active-set method for bounds. One round, for a set A of active bounds, is
//
//   x minimises ½ xᵀHx + gᵀx with x_A at its bounds,   z = Hx + g
//   bounds that x violates enter A, bounds whose multiplier z has the wrong sign leave A
//
// When A does not change, x is the minimiser. From a good start the method needs few rounds, fewer
// than a method that keeps x within its bounds. But the method may cycle, so it stops when the
// number of changes no longer decreases. Its result is a guess: another method starts from the
// guess and checks it. The minimiser class computes x and z for a given A (active_bounds.hpp,
// low_rank_curvature.hpp). Reference: Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002).

#include <algorithm>
#include <vector>

#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/budget.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The method for a class with a function minimise(g, lo, hi, side, tolerance, x, z). This function
/// computes x (n) and, where side(i) is not Between, the multipliers z_i; it returns false when it
/// cannot. When x_i violates a bound by no more than rounding, it must set x_i to this bound; when
/// |z_i| is below `tolerance` relative to its terms, it must set z_i to zero. Otherwise rounding
/// errors would change the set. All memory comes from `reserve`.
template <RealScalar Scalar>
class PrimalDualActiveSet {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) {
    set_zero<Scalar>({&x_, &z_}, n);
    side_.assign(static_cast<std::size_t>(n), QpSide::Between);
  }

  /// Starts from the active set side_of(i) of n unknowns. Reads n entries of g, lo and hi. Adds the
  /// rounds that change the set to `iterations`. Returns false when the minimiser fails or x is not
  /// finite. Otherwise `x()`, within the bounds, and `side()` are the guess. If the method
  /// converged, x is the minimiser to rounding. Never allocates.
  template <class Minimiser, class SideOf>
  bool find(Minimiser& minimiser, Index n, const Vector& g, const Vector& lo, const Vector& hi,
            SideOf side_of, const Scalar& tolerance, const Budget& budget, int& iterations) {
    for (Index i = 0; i < n; ++i) at(i) = side_of(i);
    const auto side = [this](Index i) { return this->side(i); };
    Index least = n + 1;
    int idle = 0;
    ended_ = false;
    for (;;) {
      if (!minimiser.minimise(g, lo, hi, side, tolerance, x_, z_)) return false;
      const Index changes = change(n, lo, hi);
      ended_ = changes == 0;
      if (ended_ || (changes >= least && ++idle > kMostIdle)) break;
      least = (std::min)(least, changes);
      if (budget.after(++iterations) != QpStatus::Solved) break;
    }
    if (!all_finite(x_.head(n))) return false;
    for (Index i = 0; i < n; ++i) {
      x_[i] = side(i) == QpSide::Lower   ? lo[i]
              : side(i) == QpSide::Upper ? hi[i]
                                         : (std::min)((std::max)(x_[i], lo[i]), hi[i]);
    }
    return true;
  }

  /// Returns true when the last `find` converged: no bound changed in its last round.
  bool ended() const { return ended_; }
  /// The guess of the last `find`.
  const Vector& x() const { return x_; }
  /// The side of unknown i in the guess of the last `find`.
  QpSide side(Index i) const { return side_[static_cast<std::size_t>(i)]; }

 private:
  static constexpr int kMostIdle = 2;

  QpSide& at(Index i) { return side_[static_cast<std::size_t>(i)]; }

  /// Updates the active set. Returns the number of changes.
  Index change(Index n, const Vector& lo, const Vector& hi) {
    Index changes = 0;
    for (Index i = 0; i < n; ++i) {
      const QpSide old = side(i);
      if (old == QpSide::Between) {
        at(i) = x_[i] < lo[i] ? QpSide::Lower : x_[i] > hi[i] ? QpSide::Upper : QpSide::Between;
      } else if (lo[i] < hi[i] && (old == QpSide::Lower ? z_[i] < Scalar(0) : z_[i] > Scalar(0))) {
        at(i) = QpSide::Between;
      }
      changes += side(i) != old ? 1 : 0;
    }
    return changes;
  }

  Vector x_, z_;
  std::vector<QpSide> side_;
  bool ended_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
