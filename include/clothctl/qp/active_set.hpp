#pragma once

// Convex QP with bounds and two-sided rows. The outer loop is a proximal method of multipliers:
// each step minimises the augmented Lagrangian plus a proximal term over the bounds,
//
//   x_{k+1} = argmin over lb ≤ x ≤ ub of f(x) + ρ/2 |x - x_k|² + 1/(2μ) dist²(Ax - μ y_k, [rl, ru])
//   y_{k+1} = y(x_{k+1})
//
// The inner loop is an active-set method on the free unknowns and the violated rows. Both are in
// detail/proximal_method.hpp. This header adds the interface: it checks and keeps the caller's
// data, manages warm starts, and returns results and certificates in the caller's units. Reference:
// R. T. Rockafellar, Augmented Lagrangians and applications of the proximal point algorithm in
// convex programming, Math. Oper. Res. 1 (1976).

#include <algorithm>
#include <span>
#include <string_view>
#include <vector>

#include "clothctl/linalg/vector_kernels.hpp"
#include "clothctl/qp/detail/problem_data.hpp"
#include "clothctl/qp/detail/proximal_method.hpp"
#include "clothctl/qp/detail/special/closest_point.hpp"
#include "clothctl/qp/detail/special/structured_box.hpp"
#include "clothctl/qp/detail/termination.hpp"
#include "clothctl/qp/kkt.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Solves convex QPs with bounds and two-sided rows, warm from its last iterate and active set.
template <RealScalar Scalar>
class ActiveSet {
 public:
  /// The number type.
  using scalar_type = Scalar;
  /// What `solve` fills.
  using result_type = QpResult<Scalar>;
  /// A read-only view of a vector.
  using VectorView = Eigen::Ref<const VectorX<Scalar>>;
  /// A read-only view of a matrix.
  using MatrixView = Eigen::Ref<const MatrixX<Scalar>>;

  /// Takes settings. Solves answer InvalidData with the text of `settings.validate()` when that is
  /// not empty.
  explicit ActiveSet(QpSettings<Scalar> settings = {})
      : settings_(settings), method_(settings), settings_error_(settings.validate()) {}

  /// Makes room for up to n unknowns and m rows and forgets both matrices. Afterwards no member
  /// function allocates up to those sizes; a result sizes itself at its first solve. Returns
  /// Solved, or InvalidData for a negative size: `refusal()` then names it, and nothing has
  /// changed. Allocates.
  QpStatus reserve(Index n, Index m);

  /// Takes H (n×n, symmetric, positive semidefinite; zero for a linear program) and keeps a copy.
  /// When n changes the rows must be set again. Allocates only beyond the reserved size. Fails
  /// when: an entry is not finite or not symmetric (InvalidData), a diagonal entry is negative or
  /// h_ij² > h_ii h_jj (NonConvex); `refusal()` says where, and the solver stays as it was.
  /// Complexity: O(n²).
  [[nodiscard]] QpStatus set_hessian(const MatrixView& H);

  /// Takes A (m×n; m may be 0) and keeps a copy; call after `set_hessian`. Allocates only beyond
  /// the reserved size. Fails when: A has not n columns or an entry is not finite (InvalidData);
  /// `refusal()` says where, and the solver stays as it was. Complexity: O(mn).
  [[nodiscard]] QpStatus set_rows(const MatrixView& A);

  /// What the last call of `reserve`, `set_hessian` or `set_rows` refused.
  const QpRefusal& refusal() const { return data_.refusal(); }

  /// Solves for gradient g, bounds lb, ub (n each) and row bounds rl, ru (m each), warm from the
  /// last iterate and active set. Never allocates once `result` has seen this size. Fails when:
  /// sizes differ, an entry is NaN, or a lower bound lies above its upper one (InvalidData; nothing
  /// is changed).
  [[nodiscard]] QpStatus solve(const VectorView& g, const VectorView& lb, const VectorView& ub,
                               const VectorView& rl, const VectorView& ru, result_type& result);

  /// Makes the next solve start from x (n): unknowns at a bound are active, those strictly inside
  /// are free. Returns false, and changes nothing, when x has another size or an entry that is not
  /// finite.
  [[nodiscard]] bool warm_start(const VectorView& x);

  /// Makes the next solve start from an active set, one side for each unknown and each row: that of
  /// a result, or the caller's own guess. Where it is the optimal one, x and the multipliers follow
  /// from one factorisation. Sides that a bound does not offer count as Between. Returns false, and
  /// changes nothing, for another size or a value that is no side.
  [[nodiscard]] bool warm_start(std::span<const QpSide> bounds, std::span<const QpSide> rows);

  /// Makes the next solve start from an active set, and from x (n) for the unknowns that are
  /// Between.
  [[nodiscard]] bool warm_start(const VectorView& x, std::span<const QpSide> bounds,
                                std::span<const QpSide> rows);

  /// Receding horizon: unknown i takes value and active-set status of unknown i + unknowns, row i
  /// those of row i + rows; the tails repeat their last blocks.
  void shift(Index unknowns, Index rows);

  /// Forgets the active set: the next solve is cold.
  void reset();

 private:
  using Method = detail::ProximalMethod<Scalar>;
  using State = typename Method::State;
  using Start = typename Method::Start;

  State& state(Index i) { return method_.problem().state[static_cast<std::size_t>(i)]; }

  std::span<const QpSide> sides() const {
    return {sides_of_unknowns_.data(), static_cast<std::size_t>(n_)};
  }

  /// Sizes everything but the data to the room that the data have.
  void reserve_work();

  /// Takes over what the structured method found, for solves that it cannot do.
  void follow(const result_type& result);

  /// Scales H and A afresh after either changed.
  void prepare();

  /// State of an unknown from where it stands.
  void place(Index i);

  /// Puts x, its states and y where the start says, and loads the method.
  void take_start();

  /// Runs from the start that is set, and fills the result.
  void attempt(const detail::Budget& budget, const VectorView& lb, const VectorView& ub,
               const VectorView& rl, const VectorView& ru, result_type& result);

  /// Gives row i a multiplier that shows the side it was given: the sign is what counts, in the
  /// caller's units and scaled.
  void take_side(Index i);

  /// Hands a proof to the result in the caller's units.
  void write_certificate(result_type& result) const;

  /// After PrimalInfeasible: goes to the closest feasible point, and from there to the least
  /// objective among the closest points. The proof in the result stays.
  void approach(const detail::Budget& budget, result_type& result);

  /// What ran out of budget goes on in the next solve.
  void stay_at_last();

  /// Fills the result in the caller's units; the definition has the last word on "Solved".
  void report(const VectorView& lb, const VectorView& ub, const VectorView& rl,
              const VectorView& ru, result_type& result);

  QpSettings<Scalar> settings_;
  detail::ProblemData<Scalar> data_;
  Method method_;
  detail::StructuredBox<Scalar> structured_;
  detail::ClosestPoint<Scalar> closest_;
  std::vector<QpSide> sides_of_unknowns_, sides_of_rows_;
  VectorX<Scalar> x_, hx_, aty_, z_;
  VectorX<Scalar> y_, ax_;
  Index n_ = 0, m_ = 0;
  Start start_ = Start::Cold;
  std::string_view settings_error_;  // of the settings, static text
  bool prepared_ = false, unfinished_ = false;
  bool answered_ = false;  // the general way's iterate solves what was loaded last
};

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/qp/detail/active_set_impl.hpp"
