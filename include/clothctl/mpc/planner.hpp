#pragma once

// The receding-horizon planner. In each frame it rebuilds the contact generators at the measured
// state, predicts the window at the previous plan moved on by a frame, stacks the cost
// (planner_settings.hpp), condenses it to a QP in the unknowns of detail/grip_basis.hpp, solves it
// from the last active set (detail/window_qp.hpp), and returns the input of the first frame.
// Reference: [Bai 2016], section 4.1.

#include <string>
#include <utility>
#include <vector>

#include "clothctl/core/result.hpp"
#include "clothctl/mpc/detail/window_cost.hpp"
#include "clothctl/mpc/detail/window_qp.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/qp/active_set.hpp"
#include "clothctl/qp/box_active_set.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Plans contact forces or grip poses over a receding horizon. Reference: [Bai 2016], section 4.1.
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
                                const Target& target, PlanResult<Scalar>& result);

  /// Returns an empty string, or a line that names the first argument that `plan` would refuse, and
  /// its value. Allocates.
  template <class Target, class Wind>
  std::string check_input(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t,
                          const Target& target, const Wind& wind,
                          const PlanResult<Scalar>& result) const;

  /// The same in still air.
  template <class Target>
  std::string check_input(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t,
                          const Target& target, const PlanResult<Scalar>& result) const;

  /// Sets known constant forces on the vertices for the next windows (a table that supports the
  /// sheet), 3×n, N; no columns: none. Returns false and changes nothing when the number of columns
  /// is wrong or a force is not finite. Allocates when the size changes.
  [[nodiscard]] bool set_outer_force(const PointsView<Scalar>& force);

  /// Forgets plan, active set and measurements. Call it after the plant jumped.
  void reset();

 private:
  static constexpr int kMostAttempts = 4;

  using Traits = predictor_traits<P>;

  Planner(Setup setup, PlannerSettings<Scalar> settings, P predictor,
          const PointsView<Scalar>& start);

  /// Returns the features as weighted sums of vertices.
  template <class Features>
  static PointFeatures<Scalar> point_features(const Features& features);

  /// Returns true when the predictor's response has the size of the request.
  bool response_fits() const;

  /// Returns the step weight from which damping grows when none is asked for, s²/m².
  static Scalar least_step_weight() { return Scalar(1e-4); }
  static Vector3<Scalar> still_air(const Scalar&) { return Vector3<Scalar>::Zero(); }
  static std::string text_of(const Vector3<Scalar>& p) {
    return " is (" + number_text(p[0]) + ", " + number_text(p[1]) + ", " + number_text(p[2]) + ")";
  }
  static std::string within() {
    return ", must be finite and within " + number_text(detail::largest_target<Scalar>()) + " m";
  }
  static Scalar count_of(Index n) { return Scalar(static_cast<double>(n)); }
  std::size_t grip_count() const { return problem_.basis.grips().size(); }

  std::vector<HandAnchor<Scalar>> anchors_for(const PointsView<Scalar>& start) const;

  /// Sets all finger forces of the plan to zero.
  void make_finger_plan();

  /// Sets the plan before the first frame: the gravity load for forces, rest for poses.
  void start_plan();

  /// Plans the frame, once input and targets have been taken.
  PlanStatus plan_frame(const PointsView<Scalar>& x, const PointsView<Scalar>& v,
                        PlanResult<Scalar>& result);

  /// Returns true when a result was made by this planner or one of the same size.
  bool fits(const PlanResult<Scalar>& result) const;

  template <class Target, class Wind>
  bool take_input(const PointsView<Scalar>& x, const PointsView<Scalar>& v, Scalar t,
                  const Target& target, const Wind& wind);

  void measure_agreement(const PointsView<Scalar>& x, PlanResult<Scalar>& result);

  /// Moves the plan on by one frame; its last frame is repeated.
  void shift_plan();

  /// Writes the raw inputs of the solution and the change of the outputs that they cause. Scales
  /// velocities back to max_change.
  void take_change(PlanResult<Scalar>& result);

  /// Returns true when planned forces change the velocity of a held vertex by more than max_change
  /// in a frame. Such a plan cannot be scaled back, because the previous plan need not lie inside
  /// of this frame's friction cones.
  bool changes_too_much() const;

  void extract(PlanStatus status, PlanResult<Scalar>& result);

  /// Fills the input with the first frame of the plan and remembers it as applied.
  void send(PlanResult<Scalar>& result);

  /// Keeps the velocities of the held vertices that the plan promises.
  void take_path();

  /// Sends the first frame of the finger forces; each vertex gets the sum over its fingers.
  void send_forces(PlanResult<Scalar>& result) const;

  /// Sends the positions of the held vertices after the first frame, at most max_step from the
  /// measured ones along each axis.
  void send_path(PlanResult<Scalar>& result) const;

  /// Sends the first frame of the plan as a rigid motion of each grip.
  void command_poses(PlanResult<Scalar>& result);

  /// Fills the result with the previous plan, moved on by a frame; without one, with no force and
  /// no motion.
  PlanStatus fail(PlanResult<Scalar>& result);

  Setup setup_;
  P predictor_;
  detail::WindowProblem<Scalar, Contact> problem_;
  Index vertex_count_;
  detail::WindowCost<Scalar, Contact> cost_;
  detail::WindowQp<Scalar, Contact, BoxSolver, RowSolver> qp_;
  std::vector<detail::OutputTerm<Scalar>> point_;
  MatrixX<Scalar> change_;
  VectorX<Scalar> column_;
  Points<Scalar> grip_velocity_, features_, last_features_, promised_;
  std::vector<std::vector<FingerForce<Scalar>>> finger_plan_;
  Scalar step_weight_ = Scalar(0);  // grows where forces would change the hands' path too much
  bool has_last_ = false;
  bool has_plan_ = false;
};

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/mpc/detail/planner_impl.hpp"
