#pragma once

// A point closest to satisfying rows that contradict each other or the bounds:
//
//   s = argmin |s|²  over  rl ≤ A x + s ≤ ru,  lb ≤ x ≤ ub
//
// x minimises ½ dist²(Ax, [rl, ru]) over the box, and s = Π(Ax) - Ax, where Π projects onto [rl,
// ru]. The shifts s are unique; x need not be. The proximal problem with H = 0, g = 0, μ = 1 and
// y_k = 0 is one proximal step for this least-squares problem. A few steps with a decreasing weight
// ρ converge, even if rows are linearly dependent (Rockafellar 1976).

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

  /// Minimises the distance to the rows of `problem` within its bounds, starting from its x, which
  /// must be finite. Overwrites H, g, the weights and the multipliers of the problem. Returns false
  /// when the budget ended, or rounding errors prevented progress; the shifts then belong to the
  /// last point. Never allocates.
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
      done = projected_gradient_norm(problem) <= Scalar(4) * wanted;
      if (done) break;
      problem.rho = (std::max)(least_rho, Scalar(0.25) * problem.rho);
      problem.factor.clear();
    }
    for (Index i = 0; i < m; ++i) {
      const Scalar below = problem.rl[i] - problem.ax[i], above = problem.ru[i] - problem.ax[i];
      shifts_[i] = below > Scalar(0) ? below : above < Scalar(0) ? above : Scalar(0);
    }
    slope_size_ = size(problem, false);
    problem.reduced_gradient(slope_);
    return done;
  }

  /// After `find`: tightens the bounds of `problem`, whose rows are now scaled by E, until only
  /// closest points remain. A row with a shift becomes an equality. An unknown becomes fixed at its
  /// bound if the distance has a nonzero slope there. Every closest point satisfies these
  /// equations. The inequalities that they replace would describe a set without interior, where
  /// multipliers are unbounded.
  void tighten_bounds(Problem& problem, const Vector& E) const {
    using std::abs;
    using std::sqrt;
    // Shifts and slopes below this, relative to the largest, are errors of `find`.
    const Scalar relative_zero = sqrt(scalar_traits<Scalar>::epsilon());
    const Index n = problem.unknowns(), m = problem.rows();
    Scalar farthest(0);
    for (Index i = 0; i < m; ++i) farthest = (std::max)(farthest, Scalar(abs(shifts_[i])));
    for (Index i = 0; i < m; ++i) {
      const Scalar shift = shifts_[i] * E[i];
      if (has_bound(problem.rl[i])) problem.rl[i] -= shift;
      if (has_bound(problem.ru[i])) problem.ru[i] -= shift;
      if (!(abs(shifts_[i]) > relative_zero * farthest)) continue;
      (shift > Scalar(0) ? problem.ru[i] : problem.rl[i]) =
          shift > Scalar(0) ? problem.rl[i] : problem.ru[i];
    }
    for (Index j = 0; j < n; ++j) {
      if (!(abs(slope_[j]) > relative_zero * slope_size_)) continue;
      const bool at_lower = !(problem.x[j] > problem.lo[j]),
                 at_upper = !(problem.x[j] < problem.hi[j]);
      if (at_lower && slope_[j] > Scalar(0)) problem.hi[j] = problem.lo[j];
      if (at_upper && slope_[j] < Scalar(0)) problem.lo[j] = problem.hi[j];
    }
  }

 private:
  static constexpr int kSteps = 60;

  /// Tolerance of the projected gradient, relative to |A|ᵀ|Π(Ax) - Ax|.
  static Scalar tolerance() {
    using std::sqrt;
    return Scalar(1e-3) * sqrt(scalar_traits<Scalar>::epsilon());
  }

  /// Returns the largest entry of |A|ᵀ|Π(Ax) - Ax|. If `with_rows` is true, that of |A|ᵀ(|Π(Ax) -
  /// Ax| + |Ax|), because the rounding error of the distances is that of A x.
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

  /// Returns the largest entry of the gradient of ½ dist² after projection on the bounds.
  Scalar projected_gradient_norm(const Problem& problem) {
    using std::abs;
    Scalar most(0);
    problem.reduced_gradient(slope_);
    for (Index j = 0; j < problem.unknowns(); ++j) {
      const Scalar z = bound_multiplier(slope_[j], problem.x[j], problem.lo[j], problem.hi[j]);
      most = (std::max)(most, Scalar(abs(slope_[j] - z)));
    }
    return most;
  }

  Vector slope_, shifts_;
  Scalar slope_size_ = Scalar(0);  // largest entry of |A|ᵀ|s|
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
