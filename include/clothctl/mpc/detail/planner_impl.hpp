#pragma once

// Members of Planner (clothctl/mpc/planner.hpp).

#include <algorithm>
#include <cmath>

#include "clothctl/core/number_text.hpp"
#include "clothctl/mpc/detail/rigid_motion.hpp"
#include "clothctl/mpc/planner.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
auto Planner<P, Setup, BoxSolver, RowSolver>::create(Setup setup, PlannerSettings<Scalar> settings,
                                                     P predictor, const PointsView<Scalar>& start)
    -> Result<Planner> {
  std::string problem = settings.validate();
  if (problem.empty() && !all_finite(start)) problem = "the start positions are not finite";
  if (problem.empty()) problem = setup.validate(start.cols());
  if constexpr (requires { Traits::vertex_count(predictor); }) {
    if (problem.empty() && Traits::vertex_count(predictor) != start.cols()) {
      problem = "the predictor is made for " + std::to_string(Traits::vertex_count(predictor)) +
                " vertices, the start positions have " + std::to_string(start.cols());
    }
  }
  if (!problem.empty()) return Error{problem};
  Planner planner(std::move(setup), std::move(settings), std::move(predictor), start);
  if (!planner.response_fits())
    return Error{"the predictor's reserve sized its response for another window"};
  return planner;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
auto Planner<P, Setup, BoxSolver, RowSolver>::make_result() const -> PlanResult<Scalar> {
  PlanResult<Scalar> result;
  const Index held_count = static_cast<Index>(problem_.request.held.size());
  if (problem_.settings.input == GripInput::Force &&
      problem_.settings.command == PlantCommand::Force) {
    result.input.force_vertices = problem_.request.held;
    result.input.forces.setZero(3, held_count);
    result.input.driven_positions.setZero(3, 0);
  } else {
    result.input.driven_vertices = problem_.request.held;
    result.input.driven_positions.setZero(3, held_count);
    result.input.forces.setZero(3, 0);
  }
  result.finger_forces.resize(static_cast<std::size_t>(problem_.basis.force_count()));
  result.plan.setZero(problem_.basis.inputs(), problem_.settings.horizon);
  result.predicted.setZero(3 * problem_.feature_count, problem_.settings.horizon);
  return result;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
template <class Target, class Wind>
PlanStatus Planner<P, Setup, BoxSolver, RowSolver>::plan(const PointsView<Scalar>& x,
                                                         const PointsView<Scalar>& v, Scalar t,
                                                         const Target& target, const Wind& wind,
                                                         PlanResult<Scalar>& result) {
  if (!fits(result) || !take_input(x, v, t, target, wind)) return PlanStatus::InvalidInput;
  return plan_frame(x, v, result);
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
template <class Target>
PlanStatus Planner<P, Setup, BoxSolver, RowSolver>::plan(const PointsView<Scalar>& x,
                                                         const PointsView<Scalar>& v, Scalar t,
                                                         const Target& target,
                                                         PlanResult<Scalar>& result) {
  return plan(x, v, t, target, still_air, result);
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
template <class Target, class Wind>
std::string Planner<P, Setup, BoxSolver, RowSolver>::check_input(
    const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target,
    const Wind& wind, const PlanResult<Scalar>& result) const {
  if (!fits(result)) return "the result was not made by make_result of this planner";
  if (!is_finite(t)) return "the time is " + number_text(t);
  for (const auto& [name, points] :
       {std::pair<const char*, const PointsView<Scalar>*>{"position", &x}, {"velocity", &v}}) {
    if (points->cols() != vertex_count_) {
      return "there are " + std::to_string(points->cols()) + " columns of " + name + " for " +
             std::to_string(vertex_count_) + " vertices";
    }
    for (Index i = 0; i < points->cols(); ++i) {
      if (!all_finite(points->col(i)))
        return "the " + std::string(name) + " of vertex " + std::to_string(i) +
               text_of(points->col(i));
    }
  }
  for (Index k = 0; k < problem_.settings.horizon; ++k) {
    const Scalar start = t + count_of(k) * problem_.settings.dt,
                 end = t + count_of(k + 1) * problem_.settings.dt;
    const Vector3<Scalar> air = wind(start);
    if (!all_finite(air)) return "the wind at " + number_text(start) + " s" + text_of(air);
    for (Index i = 0; i < problem_.feature_count; ++i) {
      const Vector3<Scalar> wanted = target(i, end);
      if (!detail::within_reach(wanted)) {
        return "the target of feature " + std::to_string(i) + " at " + number_text(end) + " s" +
               text_of(wanted) + within();
      }
    }
  }
  for (Index k = 0; Scalar(0) < problem_.settings.weights.anchor && k < problem_.settings.horizon;
       ++k) {
    const Scalar end = t + count_of(k + 1) * problem_.settings.dt;
    for (std::size_t g = 0; g < grip_count(); ++g) {
      const Vector3<Scalar> wanted = cost_.hand(problem_.settings, g, end, target);
      if (!detail::within_reach(wanted)) {
        return "where grip " + std::to_string(g) + " belongs at " + number_text(end) +
               " s, by the target at times around it," + text_of(wanted) + within();
      }
    }
  }
  return {};
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
template <class Target>
std::string Planner<P, Setup, BoxSolver, RowSolver>::check_input(
    const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target,
    const PlanResult<Scalar>& result) const {
  return check_input(x, v, t, target, still_air, result);
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
bool Planner<P, Setup, BoxSolver, RowSolver>::set_outer_force(const PointsView<Scalar>& force) {
  if ((force.cols() != 0 && force.cols() != vertex_count_) || !all_finite(force)) return false;
  problem_.request.outer_force = force;
  return true;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::reset() {
  has_last_ = false;
  has_plan_ = false;
  problem_.request.has_path = false;
  problem_.request.has_applied = false;
  step_weight_ = Scalar(0);
  start_plan();
  Traits::reset(predictor_);
  qp_.reset();
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
Planner<P, Setup, BoxSolver, RowSolver>::Planner(Setup setup, PlannerSettings<Scalar> settings,
                                                 P predictor, const PointsView<Scalar>& start)
    : setup_(std::move(setup)),
      predictor_(std::move(predictor)),
      problem_(settings,
               detail::GripBasis<Scalar, Contact>(setup_.grips, setup_.triangles, settings.input),
               point_features(setup_.features)),
      vertex_count_(start.cols()) {
  const Index held_count = static_cast<Index>(held().size());
  Traits::reserve(predictor_, problem_.request, problem_.response);
  problem_.response.plan = problem_.request.plan;
  cost_.reserve(problem_, anchors_for(start));
  qp_.reserve(problem_);
  point_.reserve(held().size());
  column_.setZero(problem_.request.inputs());
  change_.setZero(problem_.request.output_rows(), problem_.settings.horizon);
  grip_velocity_.setZero(3, held_count);
  features_.setZero(3, problem_.feature_count);
  last_features_ = features_;
  promised_ = features_;
  start_plan();
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
template <class Features>
auto Planner<P, Setup, BoxSolver, RowSolver>::point_features(const Features& features)
    -> PointFeatures<Scalar> {
  PointFeatures<Scalar> points;
  points.add_map(features);
  return points;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
bool Planner<P, Setup, BoxSolver, RowSolver>::response_fits() const {
  const WindowRequest<Scalar>& q = problem_.request;
  const WindowResponse<Scalar>& r = problem_.response;
  return r.impulse_response.rows() == q.output_rows() &&
         r.impulse_response.cols() == q.inputs() * q.horizon && r.plan.rows() == q.inputs() &&
         r.plan.cols() == q.horizon && r.free_response.rows() == q.output_rows() &&
         r.free_response.cols() == q.horizon;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
auto Planner<P, Setup, BoxSolver, RowSolver>::anchors_for(const PointsView<Scalar>& start) const
    -> std::vector<HandAnchor<Scalar>> {
  if (!setup_.anchors.empty()) return setup_.anchors;
  Points<Scalar> features(3, problem_.feature_count), hands(3, static_cast<Index>(grip_count()));
  evaluate_features<Scalar>(setup_.features, start, features);
  for (std::size_t g = 0; g < grip_count(); ++g)
    hands.col(static_cast<Index>(g)) = problem_.basis.held().centroid(start, g);
  return make_anchors(features, hands);
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::make_finger_plan() {
  std::vector<FingerForce<Scalar>> none(static_cast<std::size_t>(problem_.basis.force_count()));
  for (const auto& columns : problem_.basis.fingers()) {
    for (std::size_t j = 0; j < columns.held_slots.size(); ++j) {
      FingerForce<Scalar>& f = none[static_cast<std::size_t>(columns.first_force) + j];
      f.grip = columns.grip;
      f.finger = columns.finger;
      f.vertex = held()[static_cast<std::size_t>(columns.held_slots[j])];
    }
  }
  finger_plan_.assign(static_cast<std::size_t>(problem_.settings.horizon), none);
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::start_plan() {
  make_finger_plan();
  for (Index k = 0; k < problem_.settings.horizon; ++k) {
    for (Index j = 0; j < static_cast<Index>(problem_.request.held.size()); ++j)
      problem_.request.plan.template block<3, 1>(3 * j, k) = problem_.force_share;
  }
  problem_.request.applied = problem_.request.plan.col(0);
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
PlanStatus Planner<P, Setup, BoxSolver, RowSolver>::plan_frame(const PointsView<Scalar>& x,
                                                               const PointsView<Scalar>& v,
                                                               PlanResult<Scalar>& result) {
  measure_agreement(x, result);
  result.qp_iterations = 0;
  result.qp_status = QpStatus::Solved;
  result.used_rows = false;
  shift_plan();
  problem_.basis.update(x);
  for (detail::HeldPatch<Scalar>& patch : problem_.patches) patch.update(problem_.motion.position);
  problem_.response.plan = problem_.request.plan;
  if (!Traits::predict(predictor_, x, v, problem_.request, problem_.response) || !response_fits())
    return fail(result);
  PlanStatus status = PlanStatus::Failed;
  step_weight_ *= Scalar(0.5);
  if (step_weight_ < least_step_weight() || step_weight_ < problem_.settings.weights.step)
    step_weight_ = problem_.settings.weights.step;
  if (!has_plan_) step_weight_ = Scalar(0);  // nothing to keep to
  for (int attempt = 0;; ++attempt) {
    qp_.assemble(problem_, cost_.stack(problem_, step_weight_), x);
    status = qp_.solve(problem_, result);
    if (status == PlanStatus::Failed) return fail(result);
    take_change(result);
    if (attempt == kMostAttempts || !changes_too_much()) break;
    step_weight_ *= Scalar(4);
    if (step_weight_ < least_step_weight()) step_weight_ = least_step_weight();
  }
  extract(status, result);
  problem_.motion.last_velocity = problem_.motion.velocity;
  has_last_ = true;
  return status;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
bool Planner<P, Setup, BoxSolver, RowSolver>::fits(const PlanResult<Scalar>& result) const {
  const Index held_count = static_cast<Index>(problem_.request.held.size());
  const bool forces = problem_.settings.input == GripInput::Force &&
                      problem_.settings.command == PlantCommand::Force;
  return result.finger_forces.size() == static_cast<std::size_t>(problem_.basis.force_count()) &&
         result.plan.rows() == problem_.basis.inputs() &&
         result.plan.cols() == problem_.settings.horizon &&
         result.predicted.rows() == 3 * problem_.feature_count &&
         result.predicted.cols() == problem_.settings.horizon &&
         (forces ? result.input.forces.cols() : result.input.driven_positions.cols()) == held_count;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
template <class Target, class Wind>
bool Planner<P, Setup, BoxSolver, RowSolver>::take_input(const PointsView<Scalar>& x,
                                                         const PointsView<Scalar>& v, Scalar t,
                                                         const Target& target, const Wind& wind) {
  if (x.cols() != vertex_count_ || v.cols() != vertex_count_) return false;
  if (!is_finite(t) || !all_finite(x) || !all_finite(v)) return false;
  for (Index k = 0; k < problem_.settings.horizon;
       ++k) {  // the air that acts during a frame is that of its start
    const Vector3<Scalar> air = wind(t + count_of(k) * problem_.settings.dt);
    problem_.request.wind.col(k) = air;
  }
  if (!all_finite(problem_.request.wind) || !cost_.sample(problem_, t, target)) return false;
  for (std::size_t j = 0; j < problem_.request.held.size(); ++j) {
    problem_.motion.position.col(static_cast<Index>(j)) = x.col(problem_.request.held[j]);
    problem_.motion.velocity.col(static_cast<Index>(j)) = v.col(problem_.request.held[j]);
  }
  if (!has_last_) problem_.motion.last_velocity = problem_.motion.velocity;
  return true;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::measure_agreement(const PointsView<Scalar>& x,
                                                                PlanResult<Scalar>& result) {
  using std::sqrt;
  last_features_.swap(features_);
  evaluate_features<Scalar>(setup_.features, x, features_);
  result.prediction_error = Scalar(0);
  result.agreement = Scalar(1);
  if (!has_last_) return;
  const Scalar number = count_of(problem_.feature_count);
  result.prediction_error = sqrt((features_ - promised_).squaredNorm() / number);
  Scalar moved = sqrt((features_ - last_features_).squaredNorm() / number);
  if (moved < Scalar(1e-3)) moved = Scalar(1e-3);
  result.agreement = Scalar(1) - result.prediction_error / moved;
  if (result.agreement < Scalar(0)) result.agreement = Scalar(0);
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::shift_plan() {
  if (!has_plan_) return;
  for (Index k = 0; k + 1 < problem_.settings.horizon; ++k) {
    problem_.request.plan.col(k) = problem_.request.plan.col(k + 1);
    problem_.request.path.col(k) = problem_.request.path.col(k + 1);
  }
  for (std::size_t k = 0; k + 1 < finger_plan_.size(); ++k)
    finger_plan_[k].swap(finger_plan_[k + 1]);
  if (finger_plan_.size() > 1) finger_plan_.back() = finger_plan_[finger_plan_.size() - 2];
  qp_.shift(problem_.basis.unknowns());
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::take_change(PlanResult<Scalar>& result) {
  using std::abs;
  const Index p = problem_.basis.unknowns(), m = problem_.request.inputs(),
              horizon = problem_.settings.horizon;
  Scalar scale = Scalar(1);
  for (Index k = 0; k < horizon; ++k) {
    result.plan.col(k).noalias() = problem_.basis.matrix() * qp_.frame(k, p);
    result.plan.col(k) += problem_.basis.offset();
    if (!(Scalar(0) < problem_.settings.max_change) ||
        problem_.settings.input == GripInput::Force || !has_plan_)
      continue;
    for (Index i = 0; i < m; ++i) {
      const Scalar change = abs(result.plan(i, k) - problem_.response.plan(i, k));
      if (problem_.settings.max_change < scale * change)
        scale = problem_.settings.max_change / change;
    }
  }
  if (scale < Scalar(1))
    result.plan = problem_.response.plan + scale * (result.plan - problem_.response.plan);
  change_.setZero();
  for (Index k = 0; k < horizon; ++k) {
    for (Index j = 0; j <= k; ++j) {
      column_ = result.plan.col(j) - problem_.response.plan.col(j);
      change_.col(k).noalias() +=
          problem_.response.impulse_response.middleCols((k - j) * m, m) * column_;
    }
  }
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
bool Planner<P, Setup, BoxSolver, RowSolver>::changes_too_much() const {
  using std::abs;
  if (problem_.settings.input != GripInput::Force || !(Scalar(0) < problem_.settings.max_change) ||
      !has_plan_)
    return false;
  const Scalar most = problem_.settings.max_change * problem_.settings.dt;
  for (Index i = 3 * problem_.feature_count; i < change_.rows(); ++i) {
    if (most < abs(change_(i, 0))) return true;
    for (Index k = 1; k < problem_.settings.horizon; ++k) {
      if (most < abs(change_(i, k) - change_(i, k - 1))) return true;
    }
  }
  return false;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::extract(PlanStatus status,
                                                      PlanResult<Scalar>& result) {
  const Index p = problem_.basis.unknowns(), horizon = problem_.settings.horizon;
  problem_.response.free_response += change_;
  result.predicted = problem_.response.free_response.topRows(3 * problem_.feature_count);
  for (Index i = 0; i < problem_.feature_count; ++i)
    promised_.col(i) = result.predicted.template block<3, 1>(3 * i, 0);
  result.patch_residual = Scalar(0);
  for (const detail::HeldPatch<Scalar>& patch : problem_.patches) {
    for (Index i = 0; i < patch.affine.non_affine_count(); ++i) {
      detail::take_non_affine(patch, i, problem_.feature_count, point_);
      for (Index k = 0; k < horizon; ++k) {
        Vector3<Scalar> sum = Vector3<Scalar>::Zero();
        for (const detail::OutputTerm<Scalar>& t : point_)
          sum += t.weight * problem_.response.free_response.template block<3, 1>(3 * t.output, k);
        const Scalar size = sum.cwiseAbs().maxCoeff();
        if (result.patch_residual < size) result.patch_residual = size;
      }
    }
  }
  problem_.request.plan = result.plan;
  has_plan_ = true;
  take_path();
  if (problem_.settings.input == GripInput::Force) {
    for (Index k = 0; k < horizon; ++k)
      problem_.basis.finger_forces(qp_.frame(k, p), finger_plan_[static_cast<std::size_t>(k)]);
  }
  send(result);
  result.status = status;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::send(PlanResult<Scalar>& result) {
  problem_.request.applied = result.plan.col(0);
  problem_.request.has_applied = problem_.settings.input != GripInput::Force ||
                                 problem_.settings.command == PlantCommand::Force;
  if (problem_.settings.input == GripInput::Force) {
    send_forces(result);
    send_path(result);
  } else {
    command_poses(result);
  }
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::take_path() {
  for (std::size_t j = 0; j < problem_.request.held.size(); ++j) {
    const Index row = 3 * (problem_.feature_count + static_cast<Index>(j));
    Vector3<Scalar> before = problem_.motion.position.col(static_cast<Index>(j));
    for (Index k = 0; k < problem_.settings.horizon; ++k) {
      const Vector3<Scalar> after = problem_.response.free_response.template block<3, 1>(row, k);
      problem_.request.path.template block<3, 1>(3 * static_cast<Index>(j), k) =
          (after - before) / problem_.settings.dt;
      before = after;
    }
  }
  problem_.request.has_path = true;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::send_forces(PlanResult<Scalar>& result) const {
  result.finger_forces = finger_plan_.front();
  result.input.forces.setZero();
  if (problem_.settings.command != PlantCommand::Force) return;
  for (const auto& columns : problem_.basis.fingers()) {
    for (std::size_t j = 0; j < columns.held_slots.size(); ++j) {
      result.input.forces.col(columns.held_slots[j]) +=
          result.finger_forces[static_cast<std::size_t>(columns.first_force) + j].force;
    }
  }
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::send_path(PlanResult<Scalar>& result) const {
  for (Index j = 0; j < result.input.driven_positions.cols(); ++j) {
    Vector3<Scalar> step = Vector3<Scalar>::Zero();
    if (problem_.request.has_path)
      step = problem_.settings.dt * problem_.request.path.template block<3, 1>(3 * j, 0);
    for (Index c = 0; c < 3; ++c) {
      if (problem_.settings.max_step < step[c]) step[c] = problem_.settings.max_step;
      if (step[c] < -problem_.settings.max_step) step[c] = -problem_.settings.max_step;
    }
    result.input.driven_positions.col(j) = problem_.motion.position.col(j) + step;
  }
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::command_poses(PlanResult<Scalar>& result) {
  for (std::size_t g = 0; g < grip_count(); ++g) {
    const Index begin = static_cast<Index>(problem_.basis.held().grip_begin(g)),
                end = static_cast<Index>(problem_.basis.held().grip_begin(g + 1));
    for (Index j = begin; j < end; ++j)
      grip_velocity_.col(j) = result.plan.template block<3, 1>(3 * j, 0);
    detail::move_rigidly<Scalar>(problem_.motion.position.middleCols(begin, end - begin),
                                 grip_velocity_.middleCols(begin, end - begin),
                                 problem_.settings.dt,
                                 result.input.driven_positions.middleCols(begin, end - begin));
  }
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
PlanStatus Planner<P, Setup, BoxSolver, RowSolver>::fail(PlanResult<Scalar>& result) {
  result.status = PlanStatus::Failed;
  if (has_plan_) {
    result.plan = problem_.request.plan;
  } else {
    result.plan.setZero();
  }
  for (Index k = 0; k < problem_.settings.horizon; ++k) {
    for (Index i = 0; i < problem_.feature_count; ++i)
      result.predicted.template block<3, 1>(3 * i, k) = features_.col(i);
  }
  result.patch_residual = Scalar(0);
  send(result);
  has_last_ = false;
  qp_.reset();
  return PlanStatus::Failed;
}

}  // namespace clothctl::inline CLOTHCTL_ABI

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/mpc/detail/precompiled.hpp"
#endif
