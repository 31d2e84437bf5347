#pragma once

// The receding-horizon planner. In each frame it rebuilds the contact generators at the measured
// state, predicts the window at the previous plan moved on by a frame, stacks the cost
// (planner_settings.hpp), condenses it to a QP in the unknowns of detail/grip_basis.hpp, solves it
// from the last active set (detail/window_qp.hpp), and returns the input of the first frame.
// Reference: [Bai 2016], section 4.1.

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/result.hpp"
#include "clothctl/mpc/detail/agreement.hpp"
#include "clothctl/mpc/detail/anchor_schedule.hpp"
#include "clothctl/mpc/detail/finger_plan.hpp"
#include "clothctl/mpc/detail/grip_change.hpp"
#include "clothctl/mpc/detail/plan_change.hpp"
#include "clothctl/mpc/detail/plan_input.hpp"
#include "clothctl/mpc/detail/plan_output.hpp"
#include "clothctl/mpc/detail/step_damping.hpp"
#include "clothctl/mpc/detail/window_cost.hpp"
#include "clothctl/mpc/detail/window_limits.hpp"
#include "clothctl/mpc/detail/window_qp.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"

#ifdef CLOTHCTL_PRECOMPILED
#include "clothctl/prediction/rollout_predictor.hpp"  // what is compiled once
#endif

namespace clothctl::inline CLOTHCTL_ABI {

/// Plans contact forces or grip poses over a receding horizon ([Bai 2016], section 4.1).
///
/// `P` models Predictor. `Setup` is a PlannerSetup: it fixes the contact model of the fingers and
/// the feature map. The solvers model BoxQpSolver and QpSolver and can be made without arguments,
/// or from QpSettings.
template <WindowPredictor P, class Setup = PlannerSetup<PredictorScalar<P>>,
          BoxQpSolver<PredictorScalar<P>> BoxSolver = BoxActiveSet<PredictorScalar<P>>,
          QpSolver<PredictorScalar<P>> RowSolver = ActiveSet<PredictorScalar<P>>>
class Planner {
 public:
  /// The scalar type.
  using Scalar = PredictorScalar<P>;
  /// The contact model of the fingers.
  using Contact = typename Setup::contact_type;

  /// Makes a planner for a sheet that stands at `start` (3×n, m). Returns an error that names what
  /// is wrong with set-up, settings or predictor. Allocates.
  static Result<Planner> create(Setup setup, PlannerSettings<Scalar> settings, P predictor,
                                const PointsView<Scalar>& start);

  /// Returns the settings.
  const PlannerSettings<Scalar>& settings() const { return problem_.settings; }
  /// Returns the held vertices, grip by grip.
  const std::vector<int>& held() const { return problem_.request.held; }
  /// Returns the grips.
  const std::vector<Grip<Scalar, Contact>>& grips() const { return problem_.basis.grips(); }
  /// Returns the set-up.
  const Setup& setup() const { return setup_; }
  /// Returns the number of vertices of the sheet.
  Index vertex_count() const { return vertex_count_; }
  /// Returns the predictor.
  P& predictor() { return predictor_; }

  /// Makes a result with room for every frame. Allocates.
  PlanResult<Scalar> make_result() const;

  /// Plans from measured positions `x` (m) and velocities `v` (m/s), 3×n each, at time `t` (s).
  /// `target(feature, time)` is the wanted position of a feature (m), `wind(time)` the velocity of
  /// the air (m/s). `result` comes from `make_result`. Never allocates. On InvalidInput planner and
  /// result stay as they were, and `check_input` says why.
  template <class Target, class Wind>
  [[nodiscard]] PlanStatus plan(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t,
                                const Target& target, const Wind& wind, PlanResult<Scalar>& result);

  /// Plans in still air.
  template <class Target>
  [[nodiscard]] PlanStatus plan(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t,
                                const Target& target, PlanResult<Scalar>& result) {
    return plan(x, v, t, target, still_air, result);
  }

  /// Returns an empty string, or a line that names the first argument that `plan` would refuse, and
  /// its value. Allocates.
  template <class Target, class Wind>
  std::string check_input(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t,
                          const Target& target, const Wind& wind,
                          const PlanResult<Scalar>& result) const;

  /// The same in still air.
  template <class Target>
  std::string check_input(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t,
                          const Target& target, const PlanResult<Scalar>& result) const {
    return check_input(x, v, t, target, still_air, result);
  }

  /// Limits grips and features from the next frame on, by a cost on what is planned beyond. Limits
  /// are for grips by index: set them again after `set_grips`, which drops those of grips that are
  /// gone. Returns an empty string, or what is wrong, and then changes nothing. Allocates when
  /// there are more than before.
  [[nodiscard]] std::string set_limits(std::span<const GripLimit<Scalar>> limits,
                                       std::span<const FeatureLimit<Scalar>> of_features = {}) {
    return limits_.set(problem_, limits, of_features);
  }

  /// Sets known constant forces on the vertices for the next windows (a gust; what carries the
  /// sheet goes to `set_supports`), 3×n, N; no columns: none. Returns false and changes nothing
  /// when the number of columns is wrong or a force is not finite. Allocates when the size changes.
  [[nodiscard]] bool set_outer_force(const PointsView<Scalar>& force);

  /// Sets what carries vertices at the start of the next windows, such as a table, each vertex once
  /// (`contact_supports` reads it from a World). Their forces are part of the prediction;
  /// rollouts of models that have the hook end them where vertices lift off. Returns an empty
  /// string, or what is wrong, and then changes nothing. Allocates.
  [[nodiscard]] std::string set_supports(std::span<const VertexSupport<Scalar>> supports) {
    return detail::take_supports(supports, vertex_count_, problem_.request);
  }

  /// Goes on with other grips (vertices, fingers, limits, number of grips) from the next frame on,
  /// on a sheet that stands at `x` (3×n, m). Returns an empty string, or what is wrong, and then
  /// changes nothing. A grip goes on from the one that shares most vertices with it, else from that
  /// of its index. What it does not concern is kept: the plan (vertices that join a grip share its
  /// planned force, or move with it), path, finger forces, active set, hand velocities, anchors
  /// (moved by as much as the grip's centroid jumps; a new grip gets one at `x`), memory of the
  /// last prediction, outer forces and, as far as `reserve` keeps it, the predictor's state. With
  /// the same vertices and generators nothing but the grips' parameters changes. Else call
  /// `make_result` afterwards. Allocates; `plan` does not.
  [[nodiscard]] std::string set_grips(std::vector<Grip<Scalar, Contact>> grips,
                                      const PointsView<Scalar>& x);

  /// Forgets plan, active set and measurements. Call it after the plant jumped.
  void reset();

 private:
  static constexpr int kMostRounds = 6;  // with other frames at limits of the grips

  using Traits = predictor_traits<P>;
  using Basis = detail::GripBasis<Scalar, Contact>;
  using Problem = detail::WindowProblem<Scalar, Contact>;

  Planner(Setup setup, PlannerSettings<Scalar> settings, P predictor,
          const PointsView<Scalar>& start);

  /// Returns the features as weighted sums of vertices.
  template <class Features>
  static PointFeatures<Scalar> point_features(const Features& features);

  static Vector3<Scalar> still_air(const Scalar&) { return Vector3<Scalar>::Zero(); }
  static constexpr const char* wrong_response() {
    return "the predictor's reserve sized its response for another window";
  }

  /// Makes room for the parts that work on the problem, but for the QP.
  void reserve(std::vector<HandAnchor<Scalar>> anchors);

  /// Goes on with a problem of other grips, for which the predictor has made room.
  void take_over(Problem next, const PointsView<Scalar>& x);

  /// Sets the plan before the first frame: the gravity load for forces, rest for poses.
  void start_plan();

  /// Plans the frame, once input and targets have been taken.
  PlanStatus plan_frame(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                        PlanResult<Scalar>& result);

  /// Moves the plan on by one frame; its last frame is repeated.
  void shift_plan();

  /// Turns the solution into the plan, the prediction and the input of the first frame.
  void extract(PlanStatus status, PlanResult<Scalar>& result);

  /// Fills the input with the first frame of the plan and remembers it as applied.
  void send(PlanResult<Scalar>& result);

  /// Fills the result with the previous plan, moved on by a frame; if there is none, with zero
  /// forces and no motion.
  PlanStatus fail(PlanResult<Scalar>& result);

  Setup setup_;
  P predictor_;
  Problem problem_;
  Index vertex_count_;
  detail::WindowCost<Scalar, Contact> cost_;
  detail::WindowQp<Scalar, Contact, BoxSolver, RowSolver> qp_;
  detail::WindowLimits<Scalar> limits_;
  std::vector<detail::OutputTerm<Scalar>> point_;
  detail::PlanChange<Scalar> change_;
  detail::FingerPlan<Scalar> finger_plan_;
  detail::PredictionAgreement<Scalar> agreement_;
  detail::AnchorSchedule<Scalar> schedule_;
  Points<Scalar> last_velocity_;  // of all vertices, measured in the last frame
  detail::StepDamping<Scalar> damping_;
  bool has_last_ = false;
  bool has_plan_ = false;
};

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
auto Planner<P, Setup, BoxSolver, RowSolver>::create(Setup setup, PlannerSettings<Scalar> settings,
                                                     P predictor, const PointsView<Scalar>& start)
    -> Result<Planner> {
  std::string problem = settings.validate();
  if (problem.empty() && !all_finite(start)) problem = "the start positions are not finite";
  if (problem.empty()) problem = setup.validate(start.cols());
  if (problem.empty()) problem = detail::check_predictor(predictor, settings.input, start.cols());
  if (!problem.empty()) return Error{problem};
  Planner planner(std::move(setup), std::move(settings), std::move(predictor), start);
  if (!detail::response_fits(planner.problem_)) return Error{wrong_response()};
  return planner;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
auto Planner<P, Setup, BoxSolver, RowSolver>::make_result() const -> PlanResult<Scalar> {
  return detail::make_plan_result(problem_);
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
template <class Target, class Wind>
PlanStatus Planner<P, Setup, BoxSolver, RowSolver>::plan(const PointsView<Scalar>& x,
                                                         const PointsView<Scalar>& v, Scalar t,
                                                         const Target& target, const Wind& wind,
                                                         PlanResult<Scalar>& result) {
  if (!detail::fits(problem_, result) ||
      !detail::take_plan_input(problem_, cost_, vertex_count_, x, v, t, target, wind))
    return PlanStatus::InvalidInput;
  last_velocity_ = v;
  if (!has_last_) problem_.motion.last_velocity = problem_.motion.velocity;
  return plan_frame(x, v, result);
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
template <class Target, class Wind>
std::string Planner<P, Setup, BoxSolver, RowSolver>::check_input(
    const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t, const Target& target,
    const Wind& wind, const PlanResult<Scalar>& result) const {
  if (!detail::fits(problem_, result))
    return "the result was not made by make_result of this planner";
  return detail::check_plan_input(problem_, cost_, vertex_count_, x, v, t, target, wind);
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
std::string Planner<P, Setup, BoxSolver, RowSolver>::set_grips(
    std::vector<Grip<Scalar, Contact>> grips, const PointsView<Scalar>& x) {
  if (x.cols() != vertex_count_) {
    return "there are " + std::to_string(x.cols()) + " columns of position for " +
           std::to_string(vertex_count_) + " vertices";
  }
  if (!all_finite(x)) return "the positions are not finite";
  std::string problem = validate_grips(grips, vertex_count_);
  if (!problem.empty()) return problem;
  if (!problem_.basis.replace(grips)) {
    Problem next(problem_.settings,
                 Basis(std::move(grips), setup_.triangles, problem_.settings.input),
                 point_features(setup_.features));
    Traits::reserve(predictor_, next.request, next.response);
    if (!detail::response_fits(next)) {
      Traits::reserve(predictor_, problem_.request, problem_.response);
      return wrong_response();
    }
    take_over(std::move(next), x);
  }
  setup_.grips = problem_.basis.grips();
  return {};
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::reset() {
  has_last_ = false;
  has_plan_ = false;
  problem_.request.has_path = false;
  problem_.request.has_applied = false;
  damping_.reset();
  schedule_.reset();
  cost_.reset();
  limits_.reset();
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
      problem_(settings, Basis(setup_.grips, setup_.triangles, settings.input),
               point_features(setup_.features)),
      vertex_count_(start.cols()) {
  Traits::reserve(predictor_, problem_.request, problem_.response);
  Traits::reset(predictor_);
  reserve(setup_.anchors.empty() ? detail::anchors_at(problem_.basis, setup_.features, start)
                                 : setup_.anchors);
  qp_.reserve(problem_);
  agreement_.reserve(problem_.feature_count);
  schedule_.reserve(problem_.feature_count, settings.horizon);
  last_velocity_.setZero(3, vertex_count_);
  start_plan();
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::reserve(std::vector<HandAnchor<Scalar>> anchors) {
  problem_.response.plan = problem_.request.plan;
  cost_.reserve(problem_, std::move(anchors));
  point_.reserve(held().size());
  limits_.reserve(problem_);
  change_.reserve(problem_);
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::take_over(Problem next, const PointsView<Scalar>& x) {
  next.basis.update(x);
  const detail::GripChange<Scalar, Contact> change(problem_.basis, next.basis, x);
  std::vector<HandAnchor<Scalar>> anchors = detail::anchors_at(next.basis, setup_.features, x);
  for (std::size_t g = 0; g < anchors.size(); ++g) {
    if (change.grip(g) < 0) continue;
    const Vector3<Scalar> across = anchors[g].across;
    const std::size_t from = static_cast<std::size_t>(change.grip(g));
    anchors[g] = cost_.anchors()[from];
    detail::move_hand<Scalar>(anchors[g], across, change.jump(g) + cost_.learned(from));
  }
  if (setup_.anchors.empty()) {
    detail::measure_hand_gap<Scalar>(anchors);
  } else {
    setup_.anchors = anchors;
  }
  change.carry_request(problem_, last_velocity_, next);
  finger_plan_.carry(next.basis, change.weights());
  if (next.settings.input == GripInput::Force) finger_plan_.sum(next.basis, next.request.plan);
  problem_ = std::move(next);
  reserve(std::move(anchors));
  qp_.carry(problem_, change.unknowns());
  if (!has_plan_) start_plan();
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
void Planner<P, Setup, BoxSolver, RowSolver>::start_plan() {
  finger_plan_.reset(problem_.basis, problem_.settings.horizon);
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
  agreement_.measure(setup_.features, x, has_last_, result);
  schedule_.measure(problem_.settings, agreement_.measured(), result);
  cost_.learn(problem_.settings, agreement_.measured());
  result.qp_iterations = 0;
  result.qp_status = QpStatus::Solved;
  result.used_rows = false;
  shift_plan();
  problem_.basis.update(x);
  for (detail::HeldPatch<Scalar>& patch : problem_.patches) patch.update(problem_.motion.position);
  problem_.response.plan = problem_.request.plan;
  if (!Traits::predict(predictor_, x, v, problem_.request, problem_.response) ||
      !detail::response_fits(problem_))
    return fail(result);
  PlanStatus status = PlanStatus::Failed;
  damping_.start(problem_.settings.weights.step, has_plan_);
  for (int round = 0;;) {
    qp_.assemble(problem_, cost_.stack(problem_, damping_.weight(), result.anchor_weight), limits_,
                 x);
    status = qp_.solve(problem_, result);
    if (status == PlanStatus::Failed) return fail(result);
    change_.take(problem_, qp_, has_plan_, result);
    const bool spent = qp_.spent(problem_, result);
    const bool beyond = limits_.update(problem_, change_.outputs());
    if (beyond && !spent && ++round < kMostRounds) continue;
    const bool large = change_.too_large(problem_, has_plan_);
    if (large && !spent && damping_.raise()) continue;
    if (spent && (beyond || large) && status == PlanStatus::Planned)
      status = PlanStatus::Suboptimal;
    break;
  }
  result.limit_excess = limits_.largest();
  extract(status, result);
  problem_.motion.last_velocity = problem_.motion.velocity;
  has_last_ = true;
  return status;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::shift_plan() {
  if (!has_plan_) return;
  for (Index k = 0; k + 1 < problem_.settings.horizon; ++k) {
    problem_.request.plan.col(k) = problem_.request.plan.col(k + 1);
    problem_.request.path.col(k) = problem_.request.path.col(k + 1);
  }
  finger_plan_.shift();
  limits_.shift(problem_.settings.horizon);
  qp_.shift(problem_.basis.unknowns());
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::extract(PlanStatus status,
                                                      PlanResult<Scalar>& result) {
  const Index p = problem_.basis.unknowns(), horizon = problem_.settings.horizon;
  problem_.response.free_response += change_.outputs();
  result.predicted = problem_.response.free_response.topRows(3 * problem_.feature_count);
  agreement_.predict(result.predicted);
  schedule_.predict(result.predicted);
  result.patch_residual = detail::largest_non_affine(problem_, point_);
  problem_.request.plan = result.plan;
  has_plan_ = true;
  detail::take_path(problem_);
  if (problem_.settings.input == GripInput::Force) {
    for (Index k = 0; k < horizon; ++k)
      problem_.basis.finger_forces(qp_.frame(k, p), finger_plan_.frame(k));
  }
  send(result);
  result.status = status;
}

template <WindowPredictor P, class Setup, BoxQpSolver<PredictorScalar<P>> BoxSolver,
          QpSolver<PredictorScalar<P>> RowSolver>
void Planner<P, Setup, BoxSolver, RowSolver>::send(PlanResult<Scalar>& result) {
  problem_.request.applied = result.plan.col(0);
  problem_.request.has_applied =
      problem_.settings.input != GripInput::Force || detail::sends_forces(problem_.settings);
  if (problem_.settings.input == GripInput::Force) {
    detail::send_forces(problem_, finger_plan_.frame(0), result);
    detail::send_path(problem_, result);
  } else {
    detail::send_poses(problem_, result);
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
      result.predicted.template block<3, 1>(3 * i, k) = agreement_.measured().col(i);
  }
  result.patch_residual = result.limit_excess = Scalar(0);
  send(result);
  has_last_ = false;
  schedule_.forget();
  qp_.reset();
  return PlanStatus::Failed;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp): planners of the mass-spring
// sheet, with both predictors.
CLOTHCTL_INSTANTIATE(class Planner<LinearisedPredictor<MassSpringResponse<float>, double>>);
CLOTHCTL_INSTANTIATE(
    class Planner<RolloutPredictor<MassSpringRollout<double>,
                                   LinearisedPredictor<MassSpringResponse<float>, double>>>);

}  // namespace clothctl::inline CLOTHCTL_ABI
