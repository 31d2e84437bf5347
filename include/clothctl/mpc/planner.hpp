#pragma once

// The receding-horizon planner. Each frame: rebuild friction cones and patch modes at the measured state, predict the window
// at the shifted previous plan, stack the cost (planner_settings.hpp), condense it to a QP in the unknowns of grip_basis.hpp,
// solve it warm (window_qp.hpp), and answer with the input of the first frame. Reference: paper 000, section 4.1.

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/rigid_command.hpp"
#include "clothctl/mpc/window_cost.hpp"
#include "clothctl/mpc/window_qp.hpp"
#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"

namespace clothctl {

/// Plans contact forces or grip poses over a receding horizon. Reference: paper 000, section 4.1.
///
/// `P` models Predictor; the solvers model BoxQpSolver and QpSolver and can be made without arguments.
template <class P, class BoxSolver = BoxActiveSet<typename P::Scalar>, class RowSolver = ActiveSet<typename P::Scalar>>
requires Predictor<P, WindowRequest<typename P::Scalar>, WindowResponse<typename P::Scalar>>
class Planner {
 public:
  /// The scalar type.
  using Scalar = typename P::Scalar;

  /// Checks everything and makes a planner for a sheet that stands at `start` (3×n, m). Allocates.
  static Result<Planner> create(PlannerSetup<Scalar> setup, PlannerSettings<Scalar> settings, P predictor,
                                const PointsView<Scalar>& start) {
    std::string problem = settings.check();
    if (problem.empty() && !all_finite(start)) problem = "the start positions are not finite";
    if (problem.empty()) problem = setup.check(start.cols());
    if constexpr (requires { predictor.vertex_count(); }) {
      if (problem.empty() && predictor.vertex_count() != start.cols()) {
        problem = "the predictor is made for " + std::to_string(predictor.vertex_count()) +
                  " vertices, the start positions have " + std::to_string(start.cols());
      }
    }
    if (!problem.empty()) return Error{problem};
    return Planner(std::move(setup), std::move(settings), std::move(predictor), start);
  }

  /// The settings.
  const PlannerSettings<Scalar>& settings() const { return settings_; }
  /// The held vertices, grip by grip.
  const std::vector<int>& held() const { return basis_.held(); }
  /// The grips.
  const std::vector<Grip<Scalar>>& grips() const { return basis_.grips(); }
  /// The predictor.
  P& predictor() { return predictor_; }

  /// Makes a result with room for every frame. Allocates.
  PlanResult<Scalar> make_result() const {
    PlanResult<Scalar> result;
    const Index held_count = static_cast<Index>(basis_.held().size());
    if (settings_.input == GripInput::Force && settings_.command == Command::Force) {
      result.input.force_vertices = basis_.held();
      result.input.forces.setZero(3, held_count);
      result.input.driven_positions.setZero(3, 0);
    } else {
      result.input.driven_vertices = basis_.held();
      result.input.driven_positions.setZero(3, held_count);
      result.input.forces.setZero(3, 0);
    }
    result.finger_forces.resize(basis_.contacts().size());
    result.plan.setZero(basis_.inputs(), settings_.horizon);
    result.predicted.setZero(3 * feature_count_, settings_.horizon);
    return result;
  }

  /// Plans from measured positions `x` and velocities `v` (3×n) at time `t` (s). `target(feature, time)` gives a feature's
  /// wanted position; `wind(time)` the air velocity. `result` comes from `make_result`. Never allocates. On InvalidInput
  /// planner and result stay as they were, and `check_input` says why.
  template <class Target, class Wind>
  [[nodiscard]] PlanStatus plan(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target,
                                const Wind& wind, PlanResult<Scalar>& result) {
    if (!fits(result) || !take_input(x, v, t, target, wind)) return PlanStatus::InvalidInput;
    return plan_frame(x, v, result);
  }

  /// Plans in still air.
  template <class Target>
  [[nodiscard]] PlanStatus plan(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target,
                                PlanResult<Scalar>& result) {
    return plan(x, v, t, target, still_air, result);
  }

  /// Returns an empty string, or a line that names what `plan` would not take of the same arguments, and its value. Allocates.
  template <class Target, class Wind>
  std::string check_input(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target,
                          const Wind& wind, const PlanResult<Scalar>& result) const {
    if (!fits(result)) return "the result was not made by make_result of this planner";
    if (!is_finite(t)) return "the time is " + number_text(t);
    for (const auto& [name, points] : {std::pair<const char*, const PointsView<Scalar>*>{"position", &x}, {"velocity", &v}}) {
      if (points->cols() != vertex_count_) {
        return "there are " + std::to_string(points->cols()) + " columns of " + name + " for " + std::to_string(vertex_count_) +
               " vertices";
      }
      for (Index i = 0; i < points->cols(); ++i) {
        if (!all_finite(points->col(i)))
          return "the " + std::string(name) + " of vertex " + std::to_string(i) + not_finite(points->col(i));
      }
    }
    for (Index k = 0; k < settings_.horizon; ++k) {
      const Scalar start = t + count_of(k) * settings_.dt, end = t + count_of(k + 1) * settings_.dt;
      const Vector3<Scalar> air = wind(start);
      if (!all_finite(air)) return "the wind at " + number_text(start) + " s" + not_finite(air);
      for (Index i = 0; i < feature_count_; ++i) {
        const Vector3<Scalar> wanted = target(i, end);
        if (!all_finite(wanted)) {
          return "the target of feature " + std::to_string(i) + " at " + number_text(end) + " s" + not_finite(wanted);
        }
      }
    }
    for (Index k = 0; Scalar(0) < settings_.weights.anchor && k < settings_.horizon; ++k) {
      const Scalar end = t + count_of(k + 1) * settings_.dt;
      for (std::size_t g = 0; g < grip_count(); ++g) {
        const Vector3<Scalar> wanted = cost_.hand(settings_, g, end, target);
        if (!all_finite(wanted)) {
          return "where grip " + std::to_string(g) + " belongs at " + number_text(end) +
                 " s, by the target at times about then," + not_finite(wanted);
        }
      }
    }
    return {};
  }

  /// The same in still air.
  template <class Target>
  std::string check_input(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target,
                          const PlanResult<Scalar>& result) const {
    return check_input(x, v, t, target, still_air, result);
  }

  /// Forces on vertices that the window takes as known and constant (a table's push), 3×n, N; no columns: none. Answers
  /// false, and changes nothing, when the number of columns is another or a force is not finite. Allocates on change of size.
  [[nodiscard]] bool set_outer_force(const PointsView<Scalar>& force) {
    if ((force.cols() != 0 && force.cols() != vertex_count_) || !all_finite(force)) return false;
    request_.outer_force = force;
    return true;
  }

  /// Forgets plan, active set and measurements, as after a jump of the plant.
  void reset() {
    has_last_ = false;
    has_plan_ = false;
    request_.has_path = false;
    request_.has_applied = false;
    step_weight_ = Scalar(0);
    start_plan();
    predictor_.reset();
    qp_.reset();
  }

 private:
  static constexpr int kMostAttempts = 4;

  Planner(PlannerSetup<Scalar> setup, PlannerSettings<Scalar> settings, P predictor, const PointsView<Scalar>& start)
      : setup_(std::move(setup)),
        settings_(std::move(settings)),
        predictor_(std::move(predictor)),
        basis_(setup_.grips, setup_.triangles, settings_.input),
        feature_count_(setup_.features.count()),
        vertex_count_(start.cols()) {
    const Index horizon = settings_.horizon;
    const Index held_count = static_cast<Index>(basis_.held().size());
    request_.horizon = horizon;
    request_.dt = settings_.dt;
    request_.kind = settings_.input == GripInput::Force ? InputKind::Force : InputKind::Velocity;
    request_.held = basis_.held();
    request_.outputs = setup_.features;
    request_.held_outputs = feature_count_;
    for (int vertex : basis_.held()) request_.outputs.add_point(vertex);
    request_.plan.setZero(request_.inputs(), horizon);
    request_.path.setZero(request_.inputs(), horizon);
    request_.applied.setZero(request_.inputs());
    request_.wind.setZero(3, horizon);
    predictor_.reserve(request_, window_);
    patches_ = find_patches(basis_);
    cost_.reserve(settings_, basis_, patches_, feature_count_, anchors_for(start));
    qp_.reserve(settings_, basis_, patches_);
    point_.reserve(basis_.held().size());
    column_.setZero(request_.inputs());
    change_.setZero(request_.output_rows(), horizon);
    for (Points<Scalar>* p : {&motion_.position, &motion_.velocity, &motion_.last_velocity, &grip_velocity_})
      p->setZero(3, held_count);
    features_.setZero(3, feature_count_);
    last_features_ = features_;
    promised_ = features_;
    if (settings_.input == GripInput::Force) share_ = settings_.supported / count_of(held_count);
    start_plan();
  }

  /// s²/m²: where damping starts if none is asked for.
  static Scalar least_step_weight() { return Scalar(1e-4); }
  static Vector3<Scalar> still_air(const Scalar&) { return Vector3<Scalar>::Zero(); }
  static std::string not_finite(const Vector3<Scalar>& p) {
    return " is (" + number_text(p[0]) + ", " + number_text(p[1]) + ", " + number_text(p[2]) + ")";
  }
  static Scalar count_of(Index n) { return Scalar(static_cast<double>(n)); }
  std::size_t grip_count() const { return basis_.grips().size(); }

  std::vector<HandAnchor<Scalar>> anchors_for(const PointsView<Scalar>& start) const {
    if (!setup_.anchors.empty()) return setup_.anchors;
    Points<Scalar> features(3, feature_count_), hands(3, static_cast<Index>(grip_count()));
    evaluate_features<Scalar>(setup_.features, start, features);
    for (std::size_t g = 0; g < grip_count(); ++g) hands.col(static_cast<Index>(g)) = basis_.centroid(start, g);
    return make_anchors(features, hands);
  }

  /// No force of any finger in any frame.
  void make_finger_plan() {
    std::vector<FingerForce<Scalar>> none(basis_.contacts().size());
    for (std::size_t i = 0; i < none.size(); ++i) {
      const typename GripBasis<Scalar>::Contact& c = basis_.contacts()[i];
      none[i].grip = c.grip;
      none[i].finger = c.finger;
      none[i].vertex = basis_.held()[static_cast<std::size_t>(c.slot)];
    }
    finger_plan_.assign(static_cast<std::size_t>(settings_.horizon), none);
  }

  /// The plan before the first frame: the share of the supported force, or standing still.
  void start_plan() {
    make_finger_plan();
    for (Index k = 0; k < settings_.horizon; ++k) {
      for (Index j = 0; j < static_cast<Index>(basis_.held().size()); ++j)
        request_.plan.template block<3, 1>(3 * j, k) = share_;
    }
    request_.applied = request_.plan.col(0);
  }

  /// The frame, once its targets are known.
  PlanStatus plan_frame(const PointsView<Scalar>& x, const PointsView<Scalar>& v, PlanResult<Scalar>& result) {
    measure_agreement(x, result);
    result.qp_iterations = 0;
    result.qp_status = QpStatus::Solved;
    result.used_rows = false;
    shift_plan();
    basis_.update(x);
    for (HeldPatch<Scalar>& patch : patches_) patch.update(motion_.position);
    window_.plan = request_.plan;
    if (!predictor_.predict(x, v, request_, window_)) return fail(result);
    PlanStatus status = PlanStatus::Failed;
    step_weight_ *= Scalar(0.5);
    if (step_weight_ < least_step_weight() || step_weight_ < settings_.weights.step) step_weight_ = settings_.weights.step;
    if (!has_plan_) step_weight_ = Scalar(0);  // nothing to keep to
    for (int attempt = 0;; ++attempt) {
      qp_.assemble(cost_.stack(window_, basis_, patches_, settings_, step_weight_, motion_), window_, basis_, settings_, share_,
                   x);
      status = qp_.solve(request_, window_, basis_, patches_, settings_, result);
      if (status == PlanStatus::Failed) return fail(result);
      take_change(result);
      if (attempt == kMostAttempts || !changes_too_much()) break;
      step_weight_ *= Scalar(4);
      if (step_weight_ < least_step_weight()) step_weight_ = least_step_weight();
    }
    extract(status, result);
    motion_.last_velocity = motion_.velocity;
    has_last_ = true;
    return status;
  }

  /// Whether a result was made by this planner, or one of the same size.
  bool fits(const PlanResult<Scalar>& result) const {
    const Index held_count = static_cast<Index>(basis_.held().size());
    const bool forces = settings_.input == GripInput::Force && settings_.command == Command::Force;
    return result.finger_forces.size() == basis_.contacts().size() && result.plan.rows() == basis_.inputs() &&
           result.plan.cols() == settings_.horizon && result.predicted.rows() == 3 * feature_count_ &&
           result.predicted.cols() == settings_.horizon &&
           (forces ? result.input.forces.cols() : result.input.driven_positions.cols()) == held_count;
  }

  template <class Target, class Wind>
  bool take_input(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target, const Wind& wind) {
    if (x.cols() != vertex_count_ || v.cols() != vertex_count_) return false;
    if (!is_finite(t) || !all_finite(x) || !all_finite(v)) return false;
    for (Index k = 0; k < settings_.horizon; ++k) {  // the air that acts during a frame is that of its start
      const Vector3<Scalar> air = wind(t + count_of(k) * settings_.dt);
      request_.wind.col(k) = air;
    }
    if (!all_finite(request_.wind) || !cost_.sample(settings_, t, target)) return false;
    for (std::size_t j = 0; j < basis_.held().size(); ++j) {
      motion_.position.col(static_cast<Index>(j)) = x.col(basis_.held()[j]);
      motion_.velocity.col(static_cast<Index>(j)) = v.col(basis_.held()[j]);
    }
    if (!has_last_) motion_.last_velocity = motion_.velocity;
    return true;
  }

  void measure_agreement(const PointsView<Scalar>& x, PlanResult<Scalar>& result) {
    using std::sqrt;
    last_features_.swap(features_);
    evaluate_features<Scalar>(setup_.features, x, features_);
    result.prediction_error = Scalar(0);
    result.agreement = Scalar(1);
    if (!has_last_) return;
    const Scalar number = count_of(feature_count_);
    result.prediction_error = sqrt((features_ - promised_).squaredNorm() / number);
    Scalar moved = sqrt((features_ - last_features_).squaredNorm() / number);
    if (moved < Scalar(1e-3)) moved = Scalar(1e-3);
    result.agreement = Scalar(1) - result.prediction_error / moved;
    if (result.agreement < Scalar(0)) result.agreement = Scalar(0);
  }

  /// Moves the plan one frame on; its last frame is repeated.
  void shift_plan() {
    if (!has_plan_) return;
    for (Index k = 0; k + 1 < settings_.horizon; ++k) {
      request_.plan.col(k) = request_.plan.col(k + 1);
      request_.path.col(k) = request_.path.col(k + 1);
    }
    for (std::size_t k = 0; k + 1 < finger_plan_.size(); ++k) finger_plan_[k].swap(finger_plan_[k + 1]);
    if (finger_plan_.size() > 1) finger_plan_.back() = finger_plan_[finger_plan_.size() - 2];
    qp_.shift(basis_.unknowns());
  }

  /// Raw inputs of the solution, and what they change in the outputs. Velocities are scaled back to max_change.
  void take_change(PlanResult<Scalar>& result) {
    using std::abs;
    const Index p = basis_.unknowns(), m = request_.inputs(), horizon = settings_.horizon;
    Scalar scale = Scalar(1);
    for (Index k = 0; k < horizon; ++k) {
      result.plan.col(k).noalias() = basis_.matrix() * qp_.frame(k, p);
      if (!(Scalar(0) < settings_.max_change) || settings_.input == GripInput::Force || !has_plan_) continue;
      for (Index i = 0; i < m; ++i) {
        const Scalar change = abs(result.plan(i, k) - window_.plan(i, k));
        if (settings_.max_change < scale * change) scale = settings_.max_change / change;
      }
    }
    if (scale < Scalar(1)) result.plan = window_.plan + scale * (result.plan - window_.plan);
    change_.setZero();
    for (Index k = 0; k < horizon; ++k) {
      for (Index j = 0; j <= k; ++j) {
        column_ = result.plan.col(j) - window_.plan.col(j);
        change_.col(k).noalias() += window_.impulse.middleCols((k - j) * m, m) * column_;
      }
    }
  }

  /// Whether planned forces change the velocity of a held vertex by more than max_change anywhere. They cannot be scaled back,
  /// since the plan before need not lie in this frame's cones.
  bool changes_too_much() const {
    using std::abs;
    if (settings_.input != GripInput::Force || !(Scalar(0) < settings_.max_change) || !has_plan_) return false;
    const Scalar most = settings_.max_change * settings_.dt;
    for (Index i = 3 * feature_count_; i < change_.rows(); ++i) {
      if (most < abs(change_(i, 0))) return true;
      for (Index k = 1; k < settings_.horizon; ++k) {
        if (most < abs(change_(i, k) - change_(i, k - 1))) return true;
      }
    }
    return false;
  }

  void extract(PlanStatus status, PlanResult<Scalar>& result) {
    const Index p = basis_.unknowns(), horizon = settings_.horizon;
    window_.free += change_;
    result.predicted = window_.free.topRows(3 * feature_count_);
    for (Index i = 0; i < feature_count_; ++i) promised_.col(i) = result.predicted.template block<3, 1>(3 * i, 0);
    result.patch_residual = Scalar(0);
    for (const HeldPatch<Scalar>& patch : patches_) {
      for (Index i = 0; i < patch.modes.non_affine_count(); ++i) {
        take_non_affine(patch, i, feature_count_, point_);
        for (Index k = 0; k < horizon; ++k) {
          Vector3<Scalar> sum = Vector3<Scalar>::Zero();
          for (const OutputTerm<Scalar>& t : point_) sum += t.weight * window_.free.template block<3, 1>(3 * t.output, k);
          const Scalar size = sum.cwiseAbs().maxCoeff();
          if (result.patch_residual < size) result.patch_residual = size;
        }
      }
    }
    request_.plan = result.plan;
    has_plan_ = true;
    take_path();
    if (settings_.input == GripInput::Force) {
      for (Index k = 0; k < horizon; ++k) basis_.finger_forces(qp_.frame(k, p), finger_plan_[static_cast<std::size_t>(k)]);
    }
    send(result);
    result.status = status;
  }

  /// Fills the input with the first frame of the plan, and notes it as applied.
  void send(PlanResult<Scalar>& result) {
    request_.applied = result.plan.col(0);
    request_.has_applied = settings_.input != GripInput::Force || settings_.command == Command::Force;
    if (settings_.input == GripInput::Force) {
      send_forces(result);
      send_path(result);
    } else {
      command_poses(result);
    }
  }

  /// The velocities of the held vertices that the plan promises.
  void take_path() {
    for (std::size_t j = 0; j < basis_.held().size(); ++j) {
      const Index row = 3 * (feature_count_ + static_cast<Index>(j));
      Vector3<Scalar> before = motion_.position.col(static_cast<Index>(j));
      for (Index k = 0; k < settings_.horizon; ++k) {
        const Vector3<Scalar> after = window_.free.template block<3, 1>(row, k);
        request_.path.template block<3, 1>(3 * static_cast<Index>(j), k) = (after - before) / settings_.dt;
        before = after;
      }
    }
    request_.has_path = true;
  }

  /// Sends the first frame of the finger plan; each vertex gets the sum of its fingers' forces.
  void send_forces(PlanResult<Scalar>& result) const {
    result.finger_forces = finger_plan_.front();
    result.input.forces.setZero();
    if (settings_.command != Command::Force) return;
    for (std::size_t i = 0; i < result.finger_forces.size(); ++i) {
      result.input.forces.col(basis_.contacts()[i].slot) += result.finger_forces[i].force;
    }
  }

  /// Sends where the held vertices shall be after the first frame, at most max_step from here along each axis.
  void send_path(PlanResult<Scalar>& result) const {
    for (Index j = 0; j < result.input.driven_positions.cols(); ++j) {
      Vector3<Scalar> step = Vector3<Scalar>::Zero();
      if (request_.has_path) step = settings_.dt * request_.path.template block<3, 1>(3 * j, 0);
      for (Index c = 0; c < 3; ++c) {
        if (settings_.max_step < step[c]) step[c] = settings_.max_step;
        if (step[c] < -settings_.max_step) step[c] = -settings_.max_step;
      }
      result.input.driven_positions.col(j) = motion_.position.col(j) + step;
    }
  }

  /// Moves each grip rigidly as the plan's first frame asks.
  void command_poses(PlanResult<Scalar>& result) {
    for (std::size_t g = 0; g < grip_count(); ++g) {
      const Index begin = static_cast<Index>(basis_.grip_begin(g)), end = static_cast<Index>(basis_.grip_begin(g + 1));
      for (Index j = begin; j < end; ++j) grip_velocity_.col(j) = result.plan.template block<3, 1>(3 * j, 0);
      move_rigidly<Scalar>(motion_.position.middleCols(begin, end - begin), grip_velocity_.middleCols(begin, end - begin),
                           settings_.dt, result.input.driven_positions.middleCols(begin, end - begin));
    }
  }

  /// Falls back on the previous plan, shifted by a frame; without one, on no force and no motion.
  PlanStatus fail(PlanResult<Scalar>& result) {
    result.status = PlanStatus::Failed;
    if (has_plan_) {
      result.plan = request_.plan;
    } else {
      result.plan.setZero();
    }
    for (Index k = 0; k < settings_.horizon; ++k) {
      for (Index i = 0; i < feature_count_; ++i) result.predicted.template block<3, 1>(3 * i, k) = features_.col(i);
    }
    result.patch_residual = Scalar(0);
    send(result);
    has_last_ = false;
    qp_.reset();
    return PlanStatus::Failed;
  }

  PlannerSetup<Scalar> setup_;
  PlannerSettings<Scalar> settings_;
  P predictor_;
  GripBasis<Scalar> basis_;
  Index feature_count_;
  Index vertex_count_;
  WindowRequest<Scalar> request_;
  WindowResponse<Scalar> window_;
  WindowCost<Scalar> cost_;
  WindowQp<Scalar, BoxSolver, RowSolver> qp_;
  std::vector<HeldPatch<Scalar>> patches_;
  std::vector<OutputTerm<Scalar>> point_;
  Vector3<Scalar> share_ = Vector3<Scalar>::Zero();
  MatrixX<Scalar> change_;
  VectorX<Scalar> column_;
  HeldMotion<Scalar> motion_;
  Points<Scalar> grip_velocity_, features_, last_features_, promised_;
  std::vector<std::vector<FingerForce<Scalar>>> finger_plan_;
  Scalar step_weight_ = Scalar(0);  // grows where forces would change the hands' path too much
  bool has_last_ = false;
  bool has_plan_ = false;
};

}  // namespace clothctl
