#pragma once

// One frame of control on any plant: plan from what is measured, apply the first input of the plan,
// let the plant move, and measure how far the features are from their target.

#include <cassert>
#include <cmath>
#include <string>
#include <string_view>
#include <type_traits>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/mpc/plan_types.hpp"
#include "clothctl/mpc/planner_settings.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// How a control frame ended.
enum class FrameStatus {
  /// The plan was applied and the plant moved. Go on.
  Advanced,
  /// Planner and plant disagree on the number of vertices, the time step or the gravity load;
  /// nothing was done. `check_plant` says why.
  PlantMismatch,
  /// The planner refused its input or failed; the plant was left as it was. Look at the report's
  /// `plan`; `Planner::check_input` names what was refused.
  NotPlanned,
  /// The plan was applied, but the plant did not advance. Look at the report's `step`.
  NotAdvanced
};

/// Returns the name of a status.
constexpr std::string_view to_string(FrameStatus status) {
  switch (status) {
    case FrameStatus::Advanced: return "advanced";
    case FrameStatus::PlantMismatch: return "plant_mismatch";
    case FrameStatus::NotPlanned: return "not_planned";
    case FrameStatus::NotAdvanced: return "not_advanced";
  }
  return "unknown";
}

/// What one frame of control did.
template <RealScalar Scalar>
struct FrameReport {
  /// How the frame ended.
  FrameStatus status = FrameStatus::NotPlanned;
  /// How the planner ended.
  PlanStatus plan = PlanStatus::Failed;
  /// True when the loop is losing its targets (PlanResult::losing), whatever the plan's status.
  bool losing = false;
  /// How the plant's step ended.
  StepReport<Scalar> step = {};
  /// Distance of the features from their targets at the end of the frame, m: mean and largest.
  Scalar mean_error = Scalar(0), max_error = Scalar(0);

  /// Returns true when the plant moved as planned.
  bool advanced() const { return status == FrameStatus::Advanced; }
};

/// Returns an empty string, or a line that says where a planner's settings and a plant disagree:
/// the number of vertices, the time step of a plant that has only one, and the gravity load where
/// forces are planned, within 1 %, unless the planner's is zero (plans then start without force).
/// Allocates only for the message.
template <class AnyPlanner, class Plant>
requires ClothPlant<Plant, typename AnyPlanner::Scalar> std::string check_plant(
    const AnyPlanner& planner, const Plant& plant) {
  using std::sqrt;
  using Scalar = typename AnyPlanner::Scalar;
  using Traits = plant_traits<Plant>;
  const PlannerSettings<Scalar>& settings = planner.settings();
  if (const Index n = Traits::vertex_count(plant); n != planner.vertex_count()) {
    return "the plant has " + std::to_string(n) + " vertices, the planner was made for " +
           std::to_string(planner.vertex_count());
  }
  if constexpr (requires { Traits::time_step(plant); }) {
    const Scalar step = Traits::time_step(plant), difference = step - settings.dt;
    if (!(difference * difference <= Scalar(1e-12) * settings.dt * settings.dt)) {
      return "the plant steps by " + number_text(step) + " s, the planner's dt is " +
             number_text(settings.dt) + " s";
    }
  }
  if constexpr (requires { Traits::gravity_load(plant); }) {
    const Vector3<Scalar> load = Traits::gravity_load(plant);
    const Vector3<Scalar> difference = load - settings.gravity_load;
    if (settings.input == GripInput::Force && Scalar(0) < settings.gravity_load.squaredNorm() &&
        !(difference.squaredNorm() <= Scalar(1e-4) * load.squaredNorm())) {
      return "the plant weighs " + number_text(sqrt(load.squaredNorm())) +
             " N, the planner's gravity_load is " +
             number_text(sqrt(settings.gravity_load.squaredNorm())) + " N";
    }
  }
  return {};
}

/// Runs the frame that starts at time `t` (s): plans, applies the input with the air that moves at
/// `wind(t)`, advances the plant by the planner's dt, and measures. `target(feature, time)` is in
/// m, `result` comes from `planner.make_result()`. Allocates only what the plant does.
template <class AnyPlanner, class Plant, class Target, class Wind>
requires ClothPlant<Plant, typename AnyPlanner::Scalar>
[[nodiscard]] FrameReport<typename AnyPlanner::Scalar> run_frame(
    AnyPlanner& planner, Plant& plant, typename AnyPlanner::Scalar t, const Target& target,
    const Wind& wind, PlanResult<typename AnyPlanner::Scalar>& result) {
  using std::sqrt;
  using Scalar = typename AnyPlanner::Scalar;
  using Traits = plant_traits<Plant>;
  FrameReport<Scalar> report;
  if (!check_plant(planner, plant).empty()) {
    report.status = FrameStatus::PlantMismatch;
    return report;
  }
  report.plan =
      planner.plan(Traits::positions(plant), Traits::velocities(plant), t, target, wind, result);
  report.losing = report.plan != PlanStatus::InvalidInput && result.losing;
  if (!can_apply(report.plan)) return report;
  result.input.wind = wind(t);
  Traits::apply(plant, result.input);
  const Scalar dt = planner.settings().dt;
  report.step = Traits::advance(plant, dt);
  report.status = report.step.advanced ? FrameStatus::Advanced : FrameStatus::NotAdvanced;
  const auto& features = planner.setup().features;
  using Map = std::remove_cvref_t<decltype(features)>;
  decltype(auto) measured = Traits::positions(plant);  // a plant may return it by value
  const PointsView<Scalar> x = measured;
  const Index count = feature_traits<Map>::count(features);
  for (Index i = 0; i < count; ++i) {
    const Vector3<Scalar> wanted = target(i, t + dt);
    Vector3<Scalar> gap = -wanted;
    feature_traits<Map>::for_each_term(
        features, i, [&](int vertex, const Scalar& weight) { gap += weight * x.col(vertex); });
    const Scalar error = sqrt(gap.squaredNorm());
    report.mean_error += error / Scalar(static_cast<double>(count));
    if (is_finite(report.max_error) && !(error <= report.max_error)) report.max_error = error;
  }
  return report;
}

/// The same in still air.
template <class AnyPlanner, class Plant, class Target>
requires ClothPlant<Plant, typename AnyPlanner::Scalar>
[[nodiscard]] FrameReport<typename AnyPlanner::Scalar> run_frame(
    AnyPlanner& planner, Plant& plant, typename AnyPlanner::Scalar t, const Target& target,
    PlanResult<typename AnyPlanner::Scalar>& result) {
  using Scalar = typename AnyPlanner::Scalar;
  return run_frame(
      planner, plant, t, target,
      [](const Scalar&) { return Vector3<Scalar>(Vector3<Scalar>::Zero()); }, result);
}

}  // namespace clothctl::inline CLOTHCTL_ABI
