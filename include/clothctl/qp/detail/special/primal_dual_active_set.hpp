#pragma once

// Primal-dual active set for bounds: from a set A of active ones,
//
//   x minimises ½ xᵀHx + gᵀx with x_A at its bounds,   z = Hx + g
//   bounds that x leaves join A, those whose multiplier z has the wrong sign part: all at once
//
// until nothing changes; x is then the minimiser. From a good start a few rounds do, fewer than a
// method that keeps x within its bounds needs; but they need not end. So they stop once the number
// of changes no longer falls, and what they found is a guess that another method starts from and
// judges. How x and z follow from A is the minimiser's business (active_bounds.hpp,
// low_rank_curvature.hpp). Reference: Hintermüller, Ito, Kunisch, SIAM J. Optim. 13 (2002).

#include <algorithm>
#include <vector>

#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/budget.hpp"
#include "clothctl/qp/problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// The rounds, on a minimiser with minimise(g, lo, hi, side, tolerance, x, z): x (n) and, where
/// side(i) is not Between, z on a set; false when it cannot. An x that is outside its bounds by
/// rounding alone is to be put there, and a z that is below `tolerance`, relative to its terms, to
/// be 0: else the same problem would change sets again. All memory comes from `reserve`.
template <RealScalar Scalar>
class PrimalDualActiveSet {
 public:
  using Vector = VectorX<Scalar>;

  /// Makes room for n unknowns. Allocates.
  void reserve(Index n) {
    set_zero<Scalar>({&x_, &z_}, n);
    side_.assign(static_cast<std::size_t>(n), QpSide::Between);
  }

  /// Goes from the active set side_of(i) of n unknowns; of g, lo and hi n entries are read. Adds
  /// rounds that change the set to `iterations`. Returns false where the minimiser could not go on
  /// or numbers broke; else `x()`, within the bounds, and `side()` are the guess, exact but for
  /// rounding where the rounds came to an end. Never allocates.
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

  /// Returns true when the rounds of the last `find` came to an end.
  bool ended() const { return ended_; }
  /// The guess of the last `find`.
  const Vector& x() const { return x_; }
  /// Its active set.
  QpSide side(Index i) const { return side_[static_cast<std::size_t>(i)]; }

 private:
  static constexpr int kMostIdle = 2;

  QpSide& at(Index i) { return side_[static_cast<std::size_t>(i)]; }

  /// Lets bounds join and part. Returns how many did.
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
