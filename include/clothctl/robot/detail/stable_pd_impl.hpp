#pragma once

// Members of StablePd (clothctl/robot/stable_pd.hpp).

#include "clothctl/robot/stable_pd.hpp"

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/robot/kinematic_tree_model.hpp"
#endif

namespace clothctl::inline CLOTHCTL_ABI {

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
auto StablePd<Model, Scalar>::create(const Model& model, StablePdSettings<Scalar> settings)
    -> Result<StablePd> {
  if (std::string fault = settings.validate(articulated_traits<Model>::nv(model)); !fault.empty()) {
    return Error{std::move(fault)};
  }
  if (settings.limit_torques) {
    const Index n = articulated_traits<Model>::nv(model);
    const VectorX<Scalar> limits = articulated_traits<Model>::effort_limits(model);
    if (limits.size() != n)
      return Error{"the robot gives " + std::to_string(limits.size()) + " effort limits for " +
                   std::to_string(n) + " velocities"};
  }
  return StablePd(model, std::move(settings));
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
auto StablePd<Model, Scalar>::create(const Model& model, StablePdSettings<Scalar> settings,
                                     const View& q) -> Result<StablePd> {
  if (q.size() != articulated_traits<Model>::nq(model))
    return Error{"q has " + std::to_string(q.size()) + " entries, the robot has " +
                 std::to_string(articulated_traits<Model>::nq(model)) + " positions"};
  if (!all_finite(q)) return Error{"q holds NaN or an infinity"};
  Result<StablePd> made = create(model, std::move(settings));
  if (!made) return made;
  Workspace work = articulated_traits<Model>::make_workspace(model);
  const Result<std::vector<Index>> unstable = made->unstable_at(model, q, work);
  if (!unstable) return Error{unstable.error()};
  if (unstable->empty()) return made;
  const Index first = unstable->front();
  return Error{
      "kd of coordinate " + std::to_string(first) +
      " is too low for its kp and the time step: " + number_text(made->settings().kd[first]) +
      " (coordinates with that fault: " + std::to_string(unstable->size()) + ")"};
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
auto StablePd<Model, Scalar>::unstable_at(const Model& model, const View& q, Workspace& work) const
    -> Result<std::vector<Index>> {
  std::vector<Index> found;
  if (settings_.form == PdForm::Implicit) return found;
  using Traits = articulated_traits<Model>;
  const Index n = Traits::nv(model);
  if (n != n_ || q.size() != Traits::nq(model))
    return Error{"q or the robot is not of the size that the controller was made for"};
  if (!detail::workspace_fits(model, work))
    return Error{"the workspace was made for another robot"};
  const VectorX<Scalar> rest = VectorX<Scalar>::Constant(n, Scalar(0));
  VectorX<Scalar> held = rest, push = rest, one = rest;
  MatrixX<Scalar> S(n, n);
  Traits::forward_kinematics(model, q, work);
  Traits::inverse_dynamics(model, rest, rest, work, held);
  const Scalar h = settings_.dt;
  for (Index i = 0; i < n; ++i) {
    one[i] = Scalar(1);
    Traits::inverse_dynamics(model, rest, one, work, push);
    one[i] = Scalar(0);
    S.col(i) = (Scalar(2) / h) * (push - held);
  }
  S.diagonal() += settings_.kd - Scalar(1.5) * h * settings_.kp;
  // Elimination. A coordinate without a positive pivot is reported and left out.
  for (Index j = 0; j < n; ++j) {
    if (!(S(j, j) > Scalar(0))) {
      found.push_back(j);
      continue;
    }
    for (Index k = j + 1; k < n; ++k) {
      const Scalar share = S(j, k) / S(j, j);
      S.col(k).tail(n - j - 1) -= share * S.col(j).tail(n - j - 1);
    }
  }
  return found;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> PdReport StablePd<Model, Scalar>::solve(
    const Model& model, const View& q, const View& qd, const View& target,
    const View& target_velocity, const View& external, Workspace& work,
    Eigen::Ref<VectorX<Scalar>> torques, Eigen::Ref<VectorX<Scalar>> qdd) {
  using Traits = articulated_traits<Model>;
  PdReport report;
  const bool fits = Traits::nv(model) == n_ && torques.size() == n_ && qdd.size() == n_;
  report.status = fits ? check_input(model, q, qd, target, target_velocity, external, work)
                       : PdStatus::WrongSize;
  if (report.status != PdStatus::Solved) return report;
  prepare(model, q, qd, target, target_velocity, work);
  push_ = spring_;
  if (external.size() > 0) push_ += external;
  for (;;) {
    const Index missing = Traits::forward_dynamics(model, qd, push_, diagonal_, work, qdd);
    ++report.solves;
    if (missing >= 0) {
      report.status = PdStatus::NoInertia;
      report.coordinate = missing;
      return report;
    }
    const bool last = report.solves > kRounds;
    int beyond = 0;
    for (Index i = 0; i < n_; ++i) {
      if (held_[static_cast<std::size_t>(i)] != 0) continue;
      torques[i] = spring_[i] - stiff_[i] * qdd[i];
      const Scalar limit = limits_[i];
      if (!(torques[i] > limit) && !(torques[i] < -limit)) continue;
      ++beyond;
      torques[i] = torques[i] > Scalar(0) ? limit : Scalar(-limit);
      held_[static_cast<std::size_t>(i)] = 1;
      diagonal_[i] = Scalar(0);
      push_[i] = external.size() > 0 ? Scalar(torques[i] + external[i]) : torques[i];
    }
    report.saturated += beyond;
    if (beyond == 0) break;
    if (last) {
      report.status = PdStatus::Clipped;
      return report;
    }
  }
  // Inverse dynamics gives the same torques, and more digits for light joints: the difference of
  // spring and damper above cancels there.
  Traits::inverse_dynamics(model, qd, qdd, work, push_);
  for (Index i = 0; i < n_; ++i) {
    if (held_[static_cast<std::size_t>(i)] != 0) continue;
    torques[i] = external.size() > 0 ? Scalar(push_[i] - external[i]) : push_[i];
  }
  return report;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> PdStatus StablePd<Model, Scalar>::check_input(
    const Model& model, const View& q, const View& qd, const View& target,
    const View& target_velocity, const View& external, const Workspace& work)
const {
  const Index positions = articulated_traits<Model>::nq(model);
  const bool fits = q.size() == positions && target.size() == positions && qd.size() == n_ &&
                    (target_velocity.size() == 0 || target_velocity.size() == n_) &&
                    (external.size() == 0 || external.size() == n_);
  if (!fits) return PdStatus::WrongSize;
  if (!detail::workspace_fits(model, work)) return PdStatus::OtherWorkspace;
  const bool finite = all_finite(q) && all_finite(qd) && all_finite(target) &&
                      all_finite(target_velocity) && all_finite(external);
  return finite ? PdStatus::Solved : PdStatus::InvalidInput;
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar>
void StablePd<Model, Scalar>::prepare(const Model& model, const View& q, const View& qd,
                                      const View& target, const View& target_velocity,
                                      Workspace& work) {
  using Traits = articulated_traits<Model>;
  Traits::forward_kinematics(model, q, work);
  spring_.setConstant(Scalar(0));
  if (settings_.feed_gravity) Traits::inverse_dynamics(model, spring_, spring_, work, gravity_);
  Traits::difference(model, q, target, spring_);
  const Scalar h = settings_.dt;
  spring_ = settings_.kp.cwiseProduct(spring_ - h * qd) - settings_.kd.cwiseProduct(qd) + gravity_;
  if (settings_.feed_velocity && target_velocity.size() > 0)
    spring_ += settings_.kd.cwiseProduct(target_velocity);
  stiff_ = h * settings_.kd;
  if (settings_.form == PdForm::Implicit) stiff_ += (h * h) * settings_.kp;
  diagonal_ = stiff_;
  std::fill(held_.begin(), held_.end(), char(0));
}

template <class Model, RealScalar Scalar>
requires ArticulatedDynamics<Model, Scalar> StablePd<Model, Scalar>::StablePd(
    const Model& model, StablePdSettings<Scalar> settings)
    : settings_(std::move(settings)), n_(articulated_traits<Model>::nv(model)) {
  for (VectorX<Scalar>* v : {&spring_, &stiff_, &push_, &diagonal_, &gravity_}) v->setZero(n_);
  limits_ = VectorX<Scalar>::Constant(n_, scalar_traits<Scalar>::infinity());
  if (settings_.limit_torques) limits_ = articulated_traits<Model>::effort_limits(model);
  held_.assign(static_cast<std::size_t>(n_), 0);
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class StablePd<KinematicTree<double>, double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
