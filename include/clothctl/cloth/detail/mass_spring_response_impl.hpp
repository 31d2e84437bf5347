#pragma once

// Members of MassSpringResponse (clothctl/cloth/mass_spring_response.hpp).

#include "clothctl/cloth/mass_spring_response.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

template <RealScalar S>
template <RealScalar Other>
MassSpringResponse<S>::MassSpringResponse(const MassSpring<Other>& model,
                                          ResponseSettings<Scalar> settings)
    : network_(model.network().template cast<Scalar>()),
      settings_(settings),
      gravity_(model.settings().gravity.template cast<Scalar>()),
      drag_(static_cast<Scalar>(model.settings().drag)),
      pinned_(model.settings().pinned) {
  air_settings_.density = static_cast<Scalar>(model.settings().air.density);
  air_settings_.normal_coefficient = static_cast<Scalar>(model.settings().air.normal_coefficient);
  air_settings_.tangent_coefficient = static_cast<Scalar>(model.settings().air.tangent_coefficient);
  pattern_ =
      detail::SpringPattern<Scalar>(network_, settings_.bending_in_matrix, air_settings_.enabled());
  factor_ = BlockCholesky<Scalar>(
      pattern_.matrix(), nested_dissection<Scalar>(pattern_.matrix(), network_.rest_positions));
  for (const BendStencil<Scalar>& b : network_.bends) {
    Scalar sum = Scalar(0), size = Scalar(0);
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i) {
      sum += b.weight[i];
      size += b.weight[i] < Scalar(0) ? -b.weight[i] : b.weight[i];
    }
    const Scalar rounding = Scalar(8) * scalar_traits<Scalar>::epsilon() * size;
    translation_free_ = translation_free_ && !(rounding < sum) && !(sum < -rounding);
  }
  stiffness_ = pattern_.matrix();
  coupling_ = pattern_.matrix();
  held_.assign(static_cast<std::size_t>(vertex_count()), 0);
  direction_.setZero(3, static_cast<Index>(network_.springs.size()));
  force_.setZero(3, vertex_count());
  diagonal_.assign(static_cast<std::size_t>(vertex_count()), Matrix3<Scalar>::Zero());
  air_.assign(air_settings_.enabled() ? network_.triangles.size() : 0, Matrix3<Scalar>::Zero());
}

template <RealScalar S>
bool MassSpringResponse<S>::linearise(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                                      const Vector3<Scalar>& wind, Scalar dt,
                                      const std::vector<int>& driven) {
  if (x.cols() != vertex_count() || v.cols() != vertex_count()) return false;
  for (int i : driven) {
    if (i < 0 || i >= vertex_count()) return false;
  }
  if (!all_finite(x) || !all_finite(v) || !all_finite(wind) || !is_finite(dt) || !(Scalar(0) < dt))
    return false;
  std::fill(held_.begin(), held_.end(), static_cast<unsigned char>(0));
  for (int i : pinned_) held_[static_cast<std::size_t>(i)] = 1;
  for (int i : driven) held_[static_cast<std::size_t>(i)] = 1;
  for (Index i = 0; i < vertex_count(); ++i)
    detail::set_column(force_, i, detail::triple(gravity_) * network_.mass[i]);
  detail::add_spring_forces<Scalar>(network_, x, force_);
  detail::spring_directions<Scalar>(network_, x, direction_);
  detail::freeze_air<Scalar>(network_, x, v, wind, air_settings_, air_, force_);
  stiffness_.set_zero();
  pattern_.add_springs(network_, x, settings_.scale, Scalar(1), stiffness_);
  pattern_.add_bending(network_, settings_.scale.bending, stiffness_);
  coupling_.set_zero();
  pattern_.add_frozen(network_, direction_, air_, dt, coupling_);
  coupling_.add_scaled(stiffness_, dt * dt);
  const Scalar inertia = Scalar(1) + dt * drag_;
  for (Index i = 0; i < vertex_count(); ++i) {
    diagonal_[static_cast<std::size_t>(i)] = coupling_.diagonal(i);
    detail::add_to_diagonal(coupling_.diagonal(i), Scalar(inertia * network_.mass[i]));
  }
  const bool definite = factor_.factorize(coupling_, held_);
  for (Index i = 0; i < vertex_count(); ++i)
    coupling_.diagonal(i) = diagonal_[static_cast<std::size_t>(i)];
  return definite;
}

template <RealScalar S>
template <int kLanes>
bool MassSpringResponse<S>::multiply(const Lanes<Scalar, kLanes>& w,
                                     Lanes<Scalar, kLanes>& stiffness,
                                     Lanes<Scalar, kLanes>& coupling) const {
  const Index columns = 3 * vertex_count();
  if (w.cols() != columns || stiffness.cols() != columns || coupling.cols() != columns)
    return false;
  if (&w == &stiffness || &w == &coupling || &stiffness == &coupling) return false;
  stiffness_.multiply(w, stiffness);
  coupling_.multiply(w, coupling);
  return true;
}

template <RealScalar S>
template <int kLanes>
bool MassSpringResponse<S>::solve(Lanes<Scalar, kLanes>& w) {
  if (w.cols() != 3 * vertex_count()) return false;
  factor_.template solve<kLanes>(w);
  return true;
}

template <RealScalar S>
bool MassSpringResponse<S>::add_wind_force(const Vector3<Scalar>& dw, Points<Scalar>& out) const {
  if (out.cols() != vertex_count()) return false;
  const Scalar third = Scalar(1) / Scalar(3);
  for (std::size_t e = 0; e < air_.size(); ++e) {
    const detail::Triple<Scalar> push = detail::product(air_[e], detail::triple(dw)) * third;
    for (int i : network_.triangles[e]) detail::add_to_column(out, i, push);
  }
  return true;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class MassSpringResponse<float>);
CLOTHCTL_INSTANTIATE(MassSpringResponse<float>::MassSpringResponse(const MassSpring<double>&,
                                                                   ResponseSettings<float>));

}  // namespace clothctl::inline CLOTHCTL_ABI
