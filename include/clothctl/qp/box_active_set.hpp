#pragma once

// Bound-constrained QP with a dense Hessian: box_method.hpp on the caller's data, and an independent judge of what it finds.
// Cost per round O(f² + n f); factor updates O(f²) an unknown, or f³/3 in tiles when many change. With few active bounds a
// round of the active-set mode is O(n a), and O(a²) a bound that changes.

#include <span>
#include <string_view>

#include "clothctl/qp/box_method.hpp"
#include "clothctl/qp/kkt.hpp"
#include "clothctl/qp/problem_data.hpp"
#include "clothctl/qp/verdict.hpp"

namespace clothctl {

/// Solves bound-constrained convex QPs, warm from its last active set. Fast where few unknowns are free or few bounds active.
template <RealScalar Scalar>
class BoxActiveSet {
 public:
  /// The number type.
  using scalar_type = Scalar;
  /// What `solve` fills.
  using result_type = QpResult<Scalar>;
  /// A read-only view of a vector.
  using VectorView = Eigen::Ref<const VectorX<Scalar>>;

  /// Takes settings. Solves answer InvalidData with the text of `settings.check()` when that is not empty.
  explicit BoxActiveSet(QpSettings<Scalar> settings = {}) : settings_(settings), fault_(settings.check()) {}

  /// Makes room for up to n unknowns and forgets the Hessian; afterwards nothing here allocates for up to n unknowns
  /// (results size themselves at their first solve). Allocates.
  void reserve(Index n) {
    data_.reserve(n, 0);
    method_.curvature().reserve(n);
    method_.reserve(n);
    product_.setZero(n);
    zeros_.setZero(n);
  }

  /// Takes H (n×n, symmetric, positive semidefinite) and keeps a copy. The active set is kept while n stays. Allocates
  /// only when n exceeds the reserved size. Fails when: an entry is not finite or not symmetric (InvalidData), a diagonal entry
  /// is negative or h_ij² > h_ii h_jj (NonConvex); `refusal()` says where, and the solver stays as it was. Complexity: O(n²).
  [[nodiscard]] QpStatus set_hessian(const Eigen::Ref<const MatrixX<Scalar>>& H) {
    if (data_.judge(H) != QpStatus::Solved) return data_.refusal().status;
    if (H.rows() > data_.capacity_n()) reserve(H.rows());
    data_.take(H);
    method_.curvature().attach(data_.H());
    method_.renew();
    return QpStatus::Solved;
  }

  /// What the last call of `set_hessian` refused.
  const QpRefusal& refusal() const { return data_.refusal(); }

  /// Solves for gradient g and bounds lb, ub (n each), warm from the last active set. Never allocates once `result` has
  /// seen this size. Fails when: sizes differ, g or a bound is NaN, or lb > ub (InvalidData; nothing is changed).
  [[nodiscard]] QpStatus solve(const VectorView& g, const VectorView& lb, const VectorView& ub, result_type& result) {
    const VectorX<Scalar> none;
    if (!data_.load(fault_, g, lb, ub, none, none, result)) return result.status;
    method_.curvature().attach(data_.H());
    const typename Method::Data data{data_.g(), data_.lo(), data_.hi()};
    const detail::Budget budget(settings_, data_.n());
    result.status = method_.solve(data, settings_.stationarity_tolerance, budget, result.iterations);
    report(data, lb, ub, result);
    return result.status;
  }

  /// Makes the next solve start from x (n): unknowns at a bound are active, those strictly inside are free. Answers false, and
  /// changes nothing, when x has another size or an entry that is not finite.
  [[nodiscard]] bool warm_start(const VectorView& x) {
    if (data_.n() == 0 || x.size() != data_.n() || !all_finite(x)) return false;
    method_.warm_start(x);
    return true;
  }

  /// Makes the next solve start from an active set, one side for each unknown: that of a result, or the caller's own guess.
  /// Sides that a bound does not offer count as Between. Answers false, and changes nothing, for another size or a value that
  /// is no side.
  [[nodiscard]] bool warm_start(std::span<const QpSide> bounds) {
    if (data_.n() == 0 || static_cast<Index>(bounds.size()) != data_.n() || !detail::are_sides(bounds)) return false;
    method_.warm_start_sides([&](Index i) { return bounds[static_cast<std::size_t>(i)]; });
    return true;
  }

  /// Makes the next solve start from an active set, and from x (n) for the unknowns that are Between.
  [[nodiscard]] bool warm_start(const VectorView& x, std::span<const QpSide> bounds) {
    if (static_cast<Index>(bounds.size()) != data_.n() || !detail::are_sides(bounds) || !warm_start(x)) return false;
    return warm_start(bounds);
  }

  /// Receding horizon: unknown i takes value and active-set status of unknown i + unknowns; the tail repeats the last block.
  void shift(Index unknowns) { method_.shift(unknowns); }

  /// Forgets the active set: the next solve is cold.
  void reset() { method_.reset(); }

  /// Number of free unknowns after the last solve.
  Index free_count() const { return method_.free_count(); }

 private:
  using Method = detail::BoxMethod<Scalar, detail::DenseCurvature<Scalar>>;

  /// Fills the result from x and a fresh gradient, and lets the definition have the last word on "Solved".
  void report(const typename Method::Data& data, const VectorView& lb, const VectorView& ub, result_type& result) {
    const Index n = data_.n();
    if (method_.give_up_broken(data)) result.status = QpStatus::IterationLimit;
    method_.refresh(data);
    const VectorX<Scalar>&x = method_.x(), &q = method_.gradient();
    result.x = x.head(n);
    for (Index i = 0; i < n; ++i) result.bound_multipliers[i] = detail::bound_multiplier(q[i], x[i], data.lo[i], data.hi[i]);
    product_.head(n) = q.head(n) - data.g.head(n);
    const VectorX<Scalar>& none = result.row_multipliers;
    const KktResiduals<Scalar> r = detail::kkt_from_products<Scalar>(
        product_.head(n), none, zeros_.head(n), data.g.head(n), none, none, lb, ub, result.x, none, result.bound_multipliers);
    detail::conclude(r, settings_, result);
    if (result.status == QpStatus::DualInfeasible) {
      result.ray = method_.ray().head(n);
    } else {
      result.ray.setConstant(Scalar(0));
      detail::note_sides<Scalar>(data.lo, data.hi, none, none, result);
    }
  }

  QpSettings<Scalar> settings_;
  detail::ProblemData<Scalar> data_;
  Method method_;
  VectorX<Scalar> product_, zeros_;
  std::string_view fault_;  // of the settings, static text
};

}  // namespace clothctl
