#pragma once

// Members of BoxActiveSet (clothctl/qp/box_active_set.hpp).

#include "clothctl/qp/box_active_set.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

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
