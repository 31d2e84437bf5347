#pragma once

// Bound-constrained convex QP with a dense Hessian,
//
//   min ½ xᵀHx + gᵀx   subject to   lb ≤ x ≤ ub
//
// by the primal active-set method of detail/box_method.hpp. This header adds the interface: it
// checks and keeps the caller's data, and it checks each answer against the optimality conditions
// before it returns Solved. With f free unknowns a round costs O(f² + n f), and a change of the
// free set O(f²) for each unknown that changes, or f³/3 when many change.

#include <algorithm>
#include <span>
#include <string_view>

#include "clothctl/linalg/accurate_sum.hpp"
#include "clothctl/qp/detail/box_method.hpp"
#include "clothctl/qp/detail/problem_data.hpp"
#include "clothctl/qp/detail/termination.hpp"
#include "clothctl/qp/kkt.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Solves bound-constrained convex QPs. Each solve starts from the last active set. Fast when few
/// unknowns are free or few bounds are active.
template <RealScalar Scalar>
class BoxActiveSet {
 public:
  /// The number type.
  using scalar_type = Scalar;
  /// What `solve` fills.
  using result_type = QpResult<Scalar>;
  /// A read-only view of a vector.
  using VectorView = Eigen::Ref<const VectorX<Scalar>>;

  /// Keeps the settings. When the text of `settings.validate()` is not empty, every solve returns
  /// InvalidData with that text as its message.
  explicit BoxActiveSet(QpSettings<Scalar> settings = {})
      : settings_(settings), settings_error_(settings.validate()) {}

  /// Makes room for up to n unknowns and forgets the Hessian. Afterwards no member function
  /// allocates for up to n unknowns, except that a result is sized at its first solve. Returns
  /// Solved, or InvalidData for a negative size: `refusal()` then names this size, and the solver
  /// is unchanged. Allocates.
  QpStatus reserve(Index n);

  /// Takes H (n×n, symmetric, positive semidefinite) and keeps a copy. The active set stays if n is
  /// unchanged. Allocates only when n exceeds the reserved size. Fails when: an entry is not finite
  /// or not symmetric (InvalidData), a diagonal entry is negative or h_ij² > h_ii h_jj (NonConvex);
  /// `refusal()` says where, and the solver is unchanged. Complexity: O(n²).
  [[nodiscard]] QpStatus set_hessian(const Eigen::Ref<const MatrixX<Scalar>>& H);

  /// What the last call of `reserve` or `set_hessian` refused.
  const QpRefusal& refusal() const { return data_.refusal(); }

  /// Solves for gradient g and bounds lb, ub (n each), warm from the last active set. Never
  /// allocates once `result` has seen this size. Fails when: sizes differ, an entry of g is not
  /// finite, a bound is NaN, or lb > ub (InvalidData; the solver is unchanged).
  [[nodiscard]] QpStatus solve(const VectorView& g, const VectorView& lb, const VectorView& ub,
                               result_type& result);

  /// Makes the next solve start from x (n): unknowns at a bound are active, those strictly inside
  /// are free. Returns false, and changes nothing, when x has another size or an entry that is not
  /// finite.
  [[nodiscard]] bool warm_start(const VectorView& x);

  /// Makes the next solve start from an active set, one side for each unknown: that of a result, or
  /// the caller's own guess. A side whose bound is infinite counts as Between. Returns false, and
  /// changes nothing, for another size or a value that is no side.
  [[nodiscard]] bool warm_start(std::span<const QpSide> bounds);

  /// Makes the next solve start from an active set, and from x (n) for the unknowns that are
  /// Between.
  [[nodiscard]] bool warm_start(const VectorView& x, std::span<const QpSide> bounds);

  /// Receding horizon: unknown i takes the value and active-set status of unknown i + unknowns; the
  /// last `unknowns` unknowns keep theirs.
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

  /// Fills the result from x and a gradient computed from scratch. The residuals of the caller's
  /// problem decide whether the status is Solved.
  void report(const typename Method::Data& data, const VectorView& lb, const VectorView& ub,
              result_type& result);

  /// Takes Newton steps from accurate gradients while the residuals exceed the tolerances and each
  /// step halves them.
  void correct(const typename Method::Data& data, const VectorView& lb, const VectorView& ub,
               result_type& result, KktResiduals<Scalar>& r);

  /// Copies x and the multipliers to the result. Returns the residuals that follow from product_
  /// and gradient_.
  KktResiduals<Scalar> measure_residuals(const typename Method::Data& data, const VectorView& lb,
                                         const VectorView& ub, result_type& result) const;

  /// Returns true when the rounding error of H x could exceed the stationarity tolerance, because
  /// its terms cancel.
  bool rounding_counts(const typename Method::Data& data) const;

  /// Computes H x and the gradient as if in twice the precision.
  void accurate_gradient(const typename Method::Data& data);

  QpSettings<Scalar> settings_;
  detail::ProblemData<Scalar> data_;
  Method method_;
  VectorX<Scalar> product_, gradient_, zeros_;
  std::string_view settings_error_;  // of the settings, static text
  bool answered_ = false;            // the iterate solves the data loaded last
};

template <RealScalar Scalar>
QpStatus BoxActiveSet<Scalar>::reserve(Index n) {
  if (!data_.may_reserve(n, 0)) return data_.refusal().status;
  data_.reserve(n, 0);
  method_.curvature().reserve(n);
  method_.reserve(n);
  product_.setZero(n);
  gradient_.setZero(n);
  zeros_.setZero(n);
  return QpStatus::Solved;
}

template <RealScalar Scalar>
QpStatus BoxActiveSet<Scalar>::set_hessian(const Eigen::Ref<const MatrixX<Scalar>>& H) {
  if (data_.validate_hessian(H) != QpStatus::Solved) return data_.refusal().status;
  if (H.rows() > data_.capacity_n()) reserve(H.rows());
  data_.take(H);
  method_.curvature().attach(data_.H());
  method_.renew();
  return QpStatus::Solved;
}

template <RealScalar Scalar>
QpStatus BoxActiveSet<Scalar>::solve(const VectorView& g, const VectorView& lb,
                                     const VectorView& ub, result_type& result) {
  const VectorX<Scalar> none;
  if (!data_.load(settings_error_, g, lb, ub, none, none, result)) return result.status;
  method_.curvature().attach(data_.H());
  const typename Method::Data data{data_.g(), data_.lo(), data_.hi()};
  if (answered_ && data_.repeated()) {
    result.status = QpStatus::Solved;
  } else {
    const detail::Budget budget(settings_, data_.n());
    result.status =
        method_.solve(data, settings_.stationarity_tolerance, budget, result.iterations);
  }
  report(data, lb, ub, result);
  answered_ = result.status == QpStatus::Solved;
  return result.status;
}

template <RealScalar Scalar>
bool BoxActiveSet<Scalar>::warm_start(const VectorView& x) {
  if (data_.n() == 0 || x.size() != data_.n() || !all_finite(x)) return false;
  method_.warm_start(x);
  answered_ = false;
  return true;
}

template <RealScalar Scalar>
bool BoxActiveSet<Scalar>::warm_start(std::span<const QpSide> bounds) {
  if (data_.n() == 0 || static_cast<Index>(bounds.size()) != data_.n() ||
      !detail::are_sides(bounds))
    return false;
  method_.warm_start_sides([&](Index i) { return bounds[static_cast<std::size_t>(i)]; });
  answered_ = false;
  return true;
}

template <RealScalar Scalar>
bool BoxActiveSet<Scalar>::warm_start(const VectorView& x, std::span<const QpSide> bounds) {
  if (static_cast<Index>(bounds.size()) != data_.n() || !detail::are_sides(bounds) ||
      !warm_start(x))
    return false;
  return warm_start(bounds);
}

template <RealScalar Scalar>
void BoxActiveSet<Scalar>::report(const typename Method::Data& data, const VectorView& lb,
                                  const VectorView& ub, result_type& result) {
  const Index n = data_.n();
  if (method_.replace_nonfinite(data)) result.status = QpStatus::IterationLimit;
  method_.refresh(data);
  std::copy_n(method_.gradient().data(), n, gradient_.data());
  for (Index i = 0; i < n; ++i) product_[i] = gradient_[i] - data.g[i];
  const bool hidden = rounding_counts(data), seen = hidden && has_accurate_sums<Scalar>();
  if (seen) accurate_gradient(data);
  KktResiduals<Scalar> r = measure_residuals(data, lb, ub, result);
  if (seen && result.status == QpStatus::Solved) correct(data, lb, ub, result, r);
  detail::conclude(r, settings_, result);
  if (result.status == QpStatus::Solved && hidden && !seen)
    result.status = QpStatus::SolvedInaccurate;
  if (result.status == QpStatus::DualInfeasible) {
    std::copy_n(method_.ray().data(), n, result.ray.data());
  } else {
    result.ray.setConstant(Scalar(0));
    const VectorX<Scalar>& none = result.row_multipliers;
    detail::write_active_set<Scalar>(data.lo, data.hi, none, none, result);
  }
}

template <RealScalar Scalar>
void BoxActiveSet<Scalar>::correct(const typename Method::Data& data, const VectorView& lb,
                                   const VectorView& ub, result_type& result,
                                   KktResiduals<Scalar>& r) {
  for (Scalar last = scalar_traits<Scalar>::infinity();;) {
    const Scalar away = detail::residual_ratio(r, settings_);
    if (!(away > Scalar(1)) || !(away < Scalar(0.5) * last)) return;
    method_.correct(data, gradient_);
    accurate_gradient(data);
    r = measure_residuals(data, lb, ub, result);
    last = away;
  }
}

template <RealScalar Scalar>
auto BoxActiveSet<Scalar>::measure_residuals(const typename Method::Data& data,
                                             const VectorView& lb, const VectorView& ub,
                                             result_type& result) const -> KktResiduals<Scalar> {
  const Index n = data_.n();
  std::copy_n(method_.x().data(), n, result.x.data());
  for (Index i = 0; i < n; ++i) {
    result.bound_multipliers[i] =
        detail::bound_multiplier(gradient_[i], result.x[i], data.lo[i], data.hi[i]);
  }
  const VectorX<Scalar>& none = result.row_multipliers;
  return detail::kkt_from_products<Scalar>(product_.head(n), none, zeros_.head(n), data.g.head(n),
                                           none, none, lb, ub, result.x, none,
                                           result.bound_multipliers);
}

template <RealScalar Scalar>
bool BoxActiveSet<Scalar>::rounding_counts(const typename Method::Data& data) const {
  const Index n = data_.n();
  if (n == 0) return false;
  using std::abs;
  Scalar slope(0), bend(0);
  for (Index i = 0; i < n; ++i) {
    slope = (std::max)(slope, Scalar(abs(data.g[i])));
    bend = (std::max)(bend, Scalar(abs(product_[i])));
  }
  const Scalar scale = (std::max)(Scalar(1), (std::max)(slope, bend));
  const Scalar rounding = scalar_traits<Scalar>::epsilon() * (slope + method_.largest_terms());
  return !(rounding <= settings_.stationarity_tolerance * scale);
}

template <RealScalar Scalar>
void BoxActiveSet<Scalar>::accurate_gradient(const typename Method::Data& data) {
  for (Index j = 0; j < data_.n(); ++j) {
    AccurateSum<Scalar> sum;
    for (Index i = 0; i < data_.n(); ++i) sum.add_product(data_.H()(i, j), method_.x()[i]);
    product_[j] = sum.value();
    sum.add(data.g[j]);
    gradient_[j] = sum.value();
  }
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class BoxActiveSet<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
