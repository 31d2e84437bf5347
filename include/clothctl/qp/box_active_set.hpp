#pragma once

// Bound-constrained convex QP with a dense Hessian,
//
//   min ½ xᵀHx + gᵀx   subject to   lb ≤ x ≤ ub
//
// by the primal active-set method of detail/box_method.hpp. This header adds the interface: it
// checks and keeps the caller's data, and it checks each answer against the optimality conditions
// before it returns Solved. With f free unknowns a round costs O(f² + n f), a change of the free
// set O(f²) an unknown, or f³/3 when many unknowns change.

#include <algorithm>
#include <span>
#include <string_view>

#include "clothctl/linalg/accurate_sum.hpp"
#include "clothctl/qp/detail/box_method.hpp"
#include "clothctl/qp/detail/problem_data.hpp"
#include "clothctl/qp/detail/termination.hpp"
#include "clothctl/qp/kkt.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Solves bound-constrained convex QPs, warm from its last active set. Fast where few unknowns are
/// free or few bounds active.
template <RealScalar Scalar>
class BoxActiveSet {
 public:
  /// The number type.
  using scalar_type = Scalar;
  /// What `solve` fills.
  using result_type = QpResult<Scalar>;
  /// A read-only view of a vector.
  using VectorView = Eigen::Ref<const VectorX<Scalar>>;

  /// Takes settings. Solves answer InvalidData with the text of `settings.validate()` when that is
  /// not empty.
  explicit BoxActiveSet(QpSettings<Scalar> settings = {})
      : settings_(settings), settings_error_(settings.validate()) {}

  /// Makes room for up to n unknowns and forgets the Hessian. Afterwards no member function
  /// allocates for up to n unknowns; a result sizes itself at its first solve. Returns Solved, or
  /// InvalidData for a negative size: `refusal()` then names it, and nothing has changed.
  /// Allocates.
  QpStatus reserve(Index n);

  /// Takes H (n×n, symmetric, positive semidefinite) and keeps a copy. The active set is kept while
  /// n stays. Allocates only when n exceeds the reserved size. Fails when: an entry is not finite
  /// or not symmetric (InvalidData), a diagonal entry is negative or h_ij² > h_ii h_jj (NonConvex);
  /// `refusal()` says where, and the solver stays as it was. Complexity: O(n²).
  [[nodiscard]] QpStatus set_hessian(const Eigen::Ref<const MatrixX<Scalar>>& H);

  /// What the last call of `reserve` or `set_hessian` refused.
  const QpRefusal& refusal() const { return data_.refusal(); }

  /// Solves for gradient g and bounds lb, ub (n each), warm from the last active set. Never
  /// allocates once `result` has seen this size. Fails when: sizes differ, g or a bound is NaN, or
  /// lb > ub (InvalidData; nothing is changed).
  [[nodiscard]] QpStatus solve(const VectorView& g, const VectorView& lb, const VectorView& ub,
                               result_type& result);

  /// Makes the next solve start from x (n): unknowns at a bound are active, those strictly inside
  /// are free. Returns false, and changes nothing, when x has another size or an entry that is not
  /// finite.
  [[nodiscard]] bool warm_start(const VectorView& x);

  /// Makes the next solve start from an active set, one side for each unknown: that of a result, or
  /// the caller's own guess. Sides that a bound does not offer count as Between. Returns false, and
  /// changes nothing, for another size or a value that is no side.
  [[nodiscard]] bool warm_start(std::span<const QpSide> bounds);

  /// Makes the next solve start from an active set, and from x (n) for the unknowns that are
  /// Between.
  [[nodiscard]] bool warm_start(const VectorView& x, std::span<const QpSide> bounds);

  /// Receding horizon: unknown i takes value and active-set status of unknown i + unknowns; the
  /// tail repeats the last block.
  void shift(Index unknowns) {
    method_.shift(unknowns);
    answered_ = false;
  }

  /// Forgets the active set: the next solve is cold.
  void reset() {
    method_.reset();
    answered_ = false;
  }

  /// Number of free unknowns after the last solve.
  Index free_count() const { return method_.free_count(); }

 private:
  using Method = detail::BoxMethod<Scalar, detail::DenseCurvature<Scalar>>;

  /// Fills the result from x and a fresh gradient, and lets the definition have the last word on
  /// "Solved".
  void report(const typename Method::Data& data, const VectorView& lb, const VectorView& ub,
              result_type& result);

  /// Newton steps from accurate gradients while x is no solution yet and each halves the residuals.
  void correct(const typename Method::Data& data, const VectorView& lb, const VectorView& ub,
               result_type& result, KktResiduals<Scalar>& r);

  /// Takes x and multipliers into the result; residuals of product_ and gradient_.
  KktResiduals<Scalar> measure_residuals(const typename Method::Data& data, const VectorView& lb,
                                         const VectorView& ub, result_type& result) const;

  /// Returns true when rounding of H x could reach the tolerance of stationarity: its terms cancel
  /// that far.
  bool rounding_counts(const typename Method::Data& data) const;

  /// Product and gradient as if in twice the precision.
  void accurate_gradient(const typename Method::Data& data);

  QpSettings<Scalar> settings_;
  detail::ProblemData<Scalar> data_;
  Method method_;
  VectorX<Scalar> product_, gradient_, zeros_;
  std::string_view settings_error_;  // of the settings, static text
  bool answered_ = false;            // the iterate solves what was loaded last
};

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/qp/detail/box_active_set_impl.hpp"
