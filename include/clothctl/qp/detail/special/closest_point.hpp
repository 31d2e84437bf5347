#pragma once

// The closest feasible point of rows that contradict each other or the bounds:
//
//   s = argmin |s|²  over  rl ≤ A x + s ≤ ru,  lb ≤ x ≤ ub
//
// that is x minimising ½ dist²(Ax, [rl, ru]) over the box, s = Π(Ax) - Ax. The shifts s are unique;
// x is any minimiser. The proximal problem without H and g, with μ = 1 and y_k = 0, is one proximal
// step of this least-squares problem; a few of them with a falling weight ρ converge, however the
// rows depend on each other.

#include <algorithm>

#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/proximal_problem.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Moves the iterate of a proximal problem to a closest point. All memory comes from `reserve`.
template <RealScalar Scalar>
class ClosestPoint {
 public:
  using Vector = VectorX<Scalar>;
  using Problem = ProximalProblem<Scalar>;

  /// Makes room for n unknowns and m rows. Allocates.
  void reserve(Index n, Index m) {
    slope_.setZero(n);
    shifts_.setZero(m);
  }

  /// The shifts s, in the units of the rows of the problem.
  const Vector& shifts() const { return shifts_; }

  /// Minimises the distance from the present x, which must be finite, over the rows and bounds in
  /// `problem`. H, g, the weights and the multipliers of the problem are overwritten. Returns false
  /// when the budget or rounding ended it: the shifts are then those of the point reached. Never
  /// allocates.
  bool find(Problem& problem, const Budget& budget, int& iterations) {
    const Index n = problem.unknowns(), m = problem.rows();
    std::fill_n(problem.H().data(), n * n, Scalar(0));
    problem.index();
    Scalar steepest(0);
    for (Index j = 0; j < n; ++j) {
      const Scalar* column = problem.A().data() + j * m;
      steepest = (std::max)(steepest, dot_product(m, column, column));
    }
    if (!(steepest > Scalar(0))) steepest = Scalar(1);
    using std::sqrt;
    std::fill_n(problem.g.data(), n, Scalar(0));
    std::fill_n(problem.y.data(), m, Scalar(0));
    std::fill_n(problem.yk.data(), m, Scalar(0));
    problem.mu = Scalar(1);
    problem.rho = Scalar(8) * sqrt(scalar_traits<Scalar>::epsilon()) * steepest;
    problem.rho_ceiling = steepest;
    problem.factor.clear();
    const Scalar least_rho = Scalar(64) * scalar_traits<Scalar>::epsilon() * steepest;
    bool done = false;
    for (int step = 0; step < kSteps; ++step) {
      std::copy_n(problem.x.data(), n, problem.xk.data());
      problem.refresh_products();
      const Scalar wanted =
          (std::max)(tolerance() * size(problem, false),
                     Scalar(4) * scalar_traits<Scalar>::epsilon() * size(problem, true));
      const typename Problem::Outcome outcome = problem.minimise(wanted, iterations, budget);
      problem.refresh_products();
      if (outcome != Problem::Outcome::Minimised) break;
      problem.update_multipliers();
      done = steepest_way_down(problem) <= Scalar(4) * wanted;
      if (done) break;
      problem.rho = (std::max)(least_rho, Scalar(0.25) * problem.rho);
      problem.factor.clear();
    }
    for (Index i = 0; i < m; ++i) {
      const Scalar below = problem.rl[i] - problem.ax[i], above = problem.ru[i] - problem.ax[i];
      shifts_[i] = below > Scalar(0) ? below : above < Scalar(0) ? above : Scalar(0);
    }
    pull_ = size(problem, false);
    problem.reduced_gradient(slope_);
    return done;
  }

  /// After `find`: shrinks the bounds of `problem`, whose row i is E_i times as long as it was
  /// then, to the closest points. Rows that are apart become equalities at their shift and unknowns
  /// that the distance presses on a bound stay there, as at every closest point: left as
  /// inequalities they would leave a set without interior, whose multipliers have no bound.
  void hold(Problem& problem, const Vector& E) const {
    using std::abs;
    using std::sqrt;
    const Scalar part = sqrt(scalar_traits<Scalar>::epsilon());  // below it, what `find` leaves
    const Index n = problem.unknowns(), m = problem.rows();
    Scalar farthest(0);
    for (Index i = 0; i < m; ++i) farthest = (std::max)(farthest, Scalar(abs(shifts_[i])));
    for (Index i = 0; i < m; ++i) {
      const Scalar shift = shifts_[i] * E[i];
      if (has_bound(problem.rl[i])) problem.rl[i] -= shift;
      if (has_bound(problem.ru[i])) problem.ru[i] -= shift;
      if (!(abs(shifts_[i]) > part * farthest)) continue;
      (shift > Scalar(0) ? problem.ru[i] : problem.rl[i]) =
          shift > Scalar(0) ? problem.rl[i] : problem.ru[i];
    }
    for (Index j = 0; j < n; ++j) {
      if (!(abs(slope_[j]) > part * pull_)) continue;
      const bool at_lower = !(problem.x[j] > problem.lo[j]),
                 at_upper = !(problem.x[j] < problem.hi[j]);
      if (at_lower && slope_[j] > Scalar(0)) problem.hi[j] = problem.lo[j];
      if (at_upper && slope_[j] < Scalar(0)) problem.lo[j] = problem.hi[j];
    }
  }

 private:
  static constexpr int kSteps = 60;

  /// What counts as no slope, over |A|ᵀ|Π(Ax) - Ax|.
  static Scalar tolerance() {
    using std::sqrt;
    return Scalar(1e-3) * sqrt(scalar_traits<Scalar>::epsilon());
  }

  /// Largest entry of |A|ᵀ|v|, v the distances Π(Ax) - Ax, or A x and those: the rounding of the
  /// distances is that of A x.
  Scalar size(const Problem& problem, bool with_rows) {
    using std::abs;
    const Index n = problem.unknowns();
    std::fill_n(slope_.data(), n, Scalar(0));
    for (Index i = 0; i < problem.rows(); ++i) {
      const Scalar below = problem.rl[i] - problem.ax[i], above = problem.ax[i] - problem.ru[i];
      const Scalar distance = (std::max)(Scalar(0), (std::max)(below, above));
      problem.columns_of_At().add_size(
          i, with_rows ? Scalar(distance + abs(problem.ax[i])) : distance, slope_);
    }
    Scalar largest(0);
    for (Index j = 0; j < n; ++j) largest = (std::max)(largest, slope_[j]);
    return largest;
  }

  /// Largest slope of ½ dist² that the bounds do not hold.
  Scalar steepest_way_down(const Problem& problem) {
    using std::abs;
    Scalar most(0);
    problem.reduced_gradient(slope_);
    for (Index j = 0; j < problem.unknowns(); ++j) {
      const Scalar held = bound_multiplier(slope_[j], problem.x[j], problem.lo[j], problem.hi[j]);
      most = (std::max)(most, Scalar(abs(slope_[j] - held)));
    }
    return most;
  }

  Vector slope_, shifts_;
  Scalar pull_ = Scalar(0);  // largest sum of the terms of a slope
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
