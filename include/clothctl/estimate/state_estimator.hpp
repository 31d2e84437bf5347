#pragma once

// The state of a sheet from late, noisy and partial measurements. A model of the sheet is stepped
// with the inputs that the sheet gets. When the markers of an earlier frame m arrive, the model's
// state at that frame is corrected, and stepped again to the frame e in which the next input acts:
//
//   x_m ← x_m + P_x w,   v_m ← v_m + P_v w,   (P_z + σ² I) w = z - C x_m   (detail/field_gain.hpp)
//   (x, v)_{j+1} = step((x, v)_j, u_j)        for j = m … e-1
//
// So neither the delay of the measurements nor the latency of the inputs is in the loop of the
// correction, and with a linear model both are compensated exactly. docs/estimate.md has the maths.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/estimate/detail/field_gain.hpp"
#include "clothctl/estimate/estimator_settings.hpp"
#include "clothctl/estimate/marker_measurement.hpp"
#include "clothctl/prediction/features.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a correction ended.
enum class EstimateStatus {
  /// The state was corrected. Go on.
  Corrected,
  /// No marker was seen; the state is that of the model alone. Go on for a short while.
  NothingSeen,
  /// The measurement has another number of markers, or a seen marker that is not finite; nothing
  /// changed. `StateEstimator::check_input` says what is wrong.
  InvalidInput,
  /// The measurement is older than what is kept, or than the last one that was used; nothing
  /// changed. Drop it, or keep a longer history.
  TooOld,
  /// The measurement is of a frame that the estimate has not reached; nothing changed. Send the
  /// inputs first.
  NotReached,
  /// The model could not be stepped from the corrected state; nothing changed. Look at the report's
  /// `step`.
  NotAdvanced
};

/// Returns the name of a status.
constexpr std::string_view to_string(EstimateStatus status) {
  switch (status) {
    case EstimateStatus::Corrected: return "corrected";
    case EstimateStatus::NothingSeen: return "nothing_seen";
    case EstimateStatus::InvalidInput: return "invalid_input";
    case EstimateStatus::TooOld: return "too_old";
    case EstimateStatus::NotReached: return "not_reached";
    case EstimateStatus::NotAdvanced: return "not_advanced";
  }
  return "unknown";
}

/// What a correction did.
template <RealScalar Scalar>
struct EstimateReport {
  /// How it ended.
  EstimateStatus status = EstimateStatus::NothingSeen;
  /// Number of markers that were seen, and of those that were left out as outliers.
  Index seen = 0, outliers = 0;
  /// Root mean square difference of a coordinate of the used markers from what the model predicted,
  /// m. Much above the noise: the model is wrong, or the acceleration of the settings too small.
  Scalar innovation = Scalar(0);
  /// The last step of the model.
  StepReport<Scalar> step = {};
};

/// Estimates positions and velocities of all vertices. Models ClothPlant: a planner plans for it,
/// `run_frame` drives it, and the caller sends the same input to the real plant.
///
/// `Model` models ClothModel. If it models ClothRollout too, steps start from the velocities that
/// were found for the same frame before, which saves most of their time (MassSpringRollout).
template <class Model, RealScalar S = typename Model::Scalar>
requires ClothModel<Model, S>
class StateEstimator {
 public:
  /// The scalar type.
  using Scalar = S;

  /// Makes an estimator for a sheet whose state at frame 0 is about `start`, and which the input
  /// `hold` acts on until the first input from `apply` does. The vertices that `hold` drives are
  /// taken as known: measurements do not move them. Returns an error that names what is wrong.
  /// Allocates.
  static Result<StateEstimator> create(Model model, PointFeatures<Scalar> markers,
                                       const ClothState<Scalar>& start,
                                       const ClothInput<Scalar>& hold,
                                       EstimatorSettings<Scalar> settings = {});

  /// Returns the settings.
  const EstimatorSettings<Scalar>& settings() const { return settings_; }
  /// Returns the markers.
  const PointFeatures<Scalar>& markers() const { return markers_; }
  /// Returns the number of vertices.
  Index vertex_count() const { return cloth_traits<Model>::vertex_count(model_); }
  /// Returns the length of a frame, s.
  Scalar time_step() const { return settings_.dt; }
  /// Returns the frame that the estimate is for, and in which the next input acts.
  Index frame() const { return last_; }
  /// Returns the start of that frame, s.
  Scalar time() const { return settings_.dt * Scalar(static_cast<double>(last_)); }
  /// Returns the oldest frame of which a measurement can be used.
  Index oldest() const { return (std::max)(first_, measured_); }
  /// Returns the estimated positions, 3×n, m, at the start of `frame()`.
  const Points<Scalar>& positions() const { return at(last_).state.positions; }
  /// Returns the estimated velocities, 3×n, m/s.
  const Points<Scalar>& velocities() const { return at(last_).state.velocities; }

  /// Sets the input of `frame()`. Allocates when it has more entries than those before.
  void apply(const ClothInput<Scalar>& input) { at(last_).input = input; }

  /// Goes on to the next frame. An input goes on acting until there is another one. Never
  /// allocates. Fails when: `dt` (s) is not that of the settings (InvalidInput), or the step of the
  /// model fails; nothing changes then.
  [[nodiscard]] StepReport<Scalar> advance(Scalar dt);

  /// Corrects the estimate by a measurement of a frame from `oldest()` to `frame()`. Never
  /// allocates. Complexity: `frame()` minus the measured frame steps of the model.
  [[nodiscard]] EstimateReport<Scalar> correct(const MarkerMeasurement<Scalar>& measurement);

  /// Returns an empty string, or a line that says why `correct` would refuse a measurement.
  /// Allocates.
  std::string check_input(const MarkerMeasurement<Scalar>& measurement) const;

 private:
  struct Frame {
    ClothState<Scalar> state;  // at its start
    ClothInput<Scalar> input;
  };

  StateEstimator(Model model, PointFeatures<Scalar> markers, const ClothState<Scalar>& start,
                 const ClothInput<Scalar>& hold, EstimatorSettings<Scalar> settings);

  std::size_t slot(Index frame) const { return static_cast<std::size_t>(frame) % frames_.size(); }
  Frame& at(Index frame) { return frames_[slot(frame)]; }
  const Frame& at(Index frame) const { return frames_[slot(frame)]; }

  /// Steps `state` through a frame, from velocities `guess` at its end.
  StepReport<Scalar> step(const Points<Scalar>& guess, int newton_steps,
                          const ClothInput<Scalar>& input, ClothState<Scalar>& state);

  /// Writes the positions at the start of a frame when `shift_` moves them through the step before.
  StepReport<Scalar> push(Index frame, Points<Scalar>& positions);

  /// Computes the differences of the seen markers from the estimate at a frame, and chooses those
  /// to use.
  void choose(const MarkerMeasurement<Scalar>& measurement, EstimateReport<Scalar>& report);

  Model model_;
  PointFeatures<Scalar> markers_;
  EstimatorSettings<Scalar> settings_;
  decltype(cloth_traits<Model>::make_workspace(std::declval<const Model&>())) workspace_;
  detail::FieldGain<Scalar> gain_;
  std::vector<Frame> frames_;                // by frame modulo their number
  std::vector<ClothState<Scalar>> changed_;  // the same after a correction
  Index first_ = 0, last_ = 0, measured_ = 0;
  Points<Scalar> gap_;    // of markers: measured minus predicted
  Points<Scalar> shift_;  // of vertices, by the gain
  ClothState<Scalar> pushed_;
  std::vector<Index> used_;  // markers
  // Of each marker, for how many measurements it has been an outlier; the same after a correction.
  std::vector<int> beyond_, next_beyond_;
};

template <class Model, RealScalar S>
requires ClothModel<Model, S>
auto StateEstimator<Model, S>::create(Model model, PointFeatures<Scalar> markers,
                                      const ClothState<Scalar>& start,
                                      const ClothInput<Scalar>& hold,
                                      EstimatorSettings<Scalar> settings)
    -> Result<StateEstimator> {
  const Index n = cloth_traits<Model>::vertex_count(model);
  std::string problem = settings.validate();
  if (problem.empty()) problem = check_step_input(start, hold, settings.dt, n);
  if (problem.empty()) {
    problem = validate_features<Scalar>(markers, n);
    if (!problem.empty()) problem = "markers: " + problem;
  }
  if (!problem.empty()) return Error{problem};
  const Index latency = settings.latency;
  StateEstimator estimator(std::move(model), std::move(markers), start, hold, std::move(settings));
  for (Index i = 0; i < latency; ++i) {
    const StepReport<Scalar> report = estimator.advance(estimator.settings_.dt);
    if (!report.advanced)
      return Error{"the model does not step from the start: " +
                   std::string(to_string(report.status))};
  }
  return estimator;
}

template <class Model, RealScalar S>
requires ClothModel<Model, S> StateEstimator<Model, S>::StateEstimator(
    Model model, PointFeatures<Scalar> markers, const ClothState<Scalar>& start,
    const ClothInput<Scalar>& hold, EstimatorSettings<Scalar> settings)
    : model_(std::move(model)),
      markers_(std::move(markers)),
      settings_(std::move(settings)),
      workspace_(cloth_traits<Model>::make_workspace(model_)),
      frames_(static_cast<std::size_t>(settings_.history) + 1, Frame{start, hold}),
      changed_(frames_.size(), start) {
  const ClothState<Scalar> rest = cloth_traits<Model>::rest_state(model_);
  gain_.reserve(rest.positions, markers_, hold.driven_vertices, settings_);
  gap_.setZero(3, markers_.count());
  shift_.setZero(3, vertex_count());
  pushed_ = start;
  used_.reserve(static_cast<std::size_t>(markers_.count()));
  beyond_.assign(static_cast<std::size_t>(markers_.count()), 0);
  next_beyond_ = beyond_;
}

template <class Model, RealScalar S>
requires ClothModel<Model, S>
auto StateEstimator<Model, S>::step(const Points<Scalar>& guess, int newton_steps,
                                    const ClothInput<Scalar>& input, ClothState<Scalar>& state)
    -> StepReport<Scalar> {
  if constexpr (ClothRollout<Model, Scalar>) {
    if (newton_steps > 0)
      return cloth_rollout_traits<Model>::step_from(model_, guess, newton_steps, state, input,
                                                    settings_.dt, workspace_,
                                                    settings_.step_tolerance);
  }
  return cloth_traits<Model>::step(model_, state, input, settings_.dt, workspace_);
}

template <class Model, RealScalar S>
requires ClothModel<Model, S>
auto StateEstimator<Model, S>::advance(Scalar dt) -> StepReport<Scalar> {
  const Scalar difference = dt - settings_.dt;
  if (!(difference * difference <= Scalar(1e-12) * settings_.dt * settings_.dt))
    return {StepStatus::InvalidInput, false, Scalar(0), 0};
  ClothState<Scalar>& next = changed_[slot(last_ + 1)];
  next = at(last_).state;
  const StepReport<Scalar> report =
      step(at(last_).state.velocities, settings_.first_newton_steps, at(last_).input, next);
  if (!report.advanced) return report;
  std::swap(at(last_ + 1).state, next);
  at(last_ + 1).input = at(last_).input;
  ++last_;
  first_ = (std::max)(first_, last_ - settings_.history);
  return report;
}

template <class Model, RealScalar S>
requires ClothModel<Model, S>
auto StateEstimator<Model, S>::correct(const MarkerMeasurement<Scalar>& measurement)
    -> EstimateReport<Scalar> {
  EstimateReport<Scalar> report;
  report.status = EstimateStatus::InvalidInput;
  if (measurement.positions.cols() != markers_.count() ||
      static_cast<Index>(measurement.seen.size()) != markers_.count())
    return report;
  for (Index i = 0; i < markers_.count(); ++i) {
    if (measurement.is_seen(i) && !all_finite(measurement.positions.col(i))) return report;
  }
  const Index from = measurement.frame;
  report.status = from < oldest() ? EstimateStatus::TooOld : EstimateStatus::NotReached;
  if (from < oldest() || last_ < from) return report;
  choose(measurement, report);
  report.status = EstimateStatus::NothingSeen;
  if (used_.empty()) {
    beyond_ = next_beyond_;
    return report;
  }
  report.status = EstimateStatus::NotAdvanced;
  shift_.setZero();
  ClothState<Scalar>& corrected = changed_[slot(from)];
  corrected.velocities = at(from).state.velocities;
  gain_.correct(used_, gap_, shift_, corrected.velocities);
  report.step = push(from, corrected.positions);
  if (!report.step.advanced) return report;
  for (Index j = from; j < last_; ++j) {
    ClothState<Scalar>& next = changed_[slot(j + 1)];
    next = changed_[slot(j)];
    report.step = step(at(j + 1).state.velocities, settings_.newton_steps, at(j).input, next);
    if (!report.step.advanced) return report;
  }
  for (Index j = from; j <= last_; ++j) std::swap(at(j).state, changed_[slot(j)]);
  beyond_.swap(next_beyond_);
  measured_ = from;
  report.status = EstimateStatus::Corrected;
  return report;
}

template <class Model, RealScalar S>
requires ClothModel<Model, S>
auto StateEstimator<Model, S>::push(Index frame, Points<Scalar>& positions) -> StepReport<Scalar> {
  if (frame == first_) {  // no step before it is known
    positions = at(frame).state.positions;
    positions += shift_;
    return {StepStatus::Converged, true, Scalar(0), 0};
  }
  pushed_ = at(frame - 1).state;
  pushed_.velocities += shift_ / settings_.dt;
  const StepReport<Scalar> report =
      step(at(frame).state.velocities, settings_.newton_steps, at(frame - 1).input, pushed_);
  positions = pushed_.positions;
  return report;
}

template <class Model, RealScalar S>
requires ClothModel<Model, S>
void StateEstimator<Model, S>::choose(const MarkerMeasurement<Scalar>& measurement,
                                      EstimateReport<Scalar>& report) {
  using std::sqrt;
  const Points<Scalar>& x = at(measurement.frame).state.positions;
  evaluate_features<Scalar>(markers_, x, gap_);
  used_.clear();
  next_beyond_ = beyond_;
  const auto excess = [&](Index i) {  // of the gap over the gate, as a quotient
    return sqrt(gap_.col(i).squaredNorm()) / (settings_.gate * gain_.expected(i));
  };
  Index beyond = 0;
  for (Index i = 0; i < markers_.count(); ++i) {
    if (!measurement.is_seen(i)) continue;
    ++report.seen;
    gap_.col(i) = measurement.positions.col(i) - gap_.col(i);
    if (!(excess(i) <= Scalar(1))) ++beyond;
  }
  const bool lost = report.seen < 2 * beyond;
  for (Index i = 0; i < markers_.count(); ++i) {
    if (!measurement.is_seen(i)) continue;
    int& times = next_beyond_[static_cast<std::size_t>(i)];
    const Scalar quotient = excess(i);
    times = lost || quotient <= Scalar(1) ? 0 : (std::min)(times + 1, settings_.patience + 1);
    if (times > 0) ++report.outliers;
    if (0 < times && times <= settings_.patience) continue;
    if (times > 0) gap_.col(i) /= quotient;
    used_.push_back(i);
  }
  Scalar sum = Scalar(0);
  for (const Index i : used_) sum += gap_.col(i).squaredNorm();
  const double count = 3 * static_cast<double>((std::max)(used_.size(), std::size_t(1)));
  report.innovation = sqrt(sum / Scalar(count));
}

template <class Model, RealScalar S>
requires ClothModel<Model, S> std::string StateEstimator<Model, S>::check_input(
    const MarkerMeasurement<Scalar>& measurement)
const {
  std::string problem = measurement.validate(markers_.count());
  if (!problem.empty()) return problem;
  if (oldest() <= measurement.frame && measurement.frame <= last_) return {};
  return "the measurement is of frame " + std::to_string(measurement.frame) +
         ", the estimate has frames " + std::to_string(oldest()) + " to " + std::to_string(last_);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
