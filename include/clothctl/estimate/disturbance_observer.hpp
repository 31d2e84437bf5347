#pragma once

// Forces on the whole sheet that its model does not know: gusts, a wrong weight, a sheet that
// sticks to something. A model of the sheet takes the step that the sheet took, with the same input
// and the disturbance that is known so far; what the free vertices then lack in velocity is new:
//
//   a ← a + gain Σ m (v - v_model) / (h Σ m),      f_i = m_i a
//
// The sums are over the vertices that nobody drives. Each step corrects what the last estimate
// missed, so a constant disturbance is found exactly, also where driven vertices bear part of it.
// Along a taut sheet they bear most of it, and little is left to see: that part takes longer.

#include <string>
#include <utility>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/step_input.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a DisturbanceObserver.
template <RealScalar Scalar>
struct DisturbanceSettings {
  /// Share of the acceleration that was missed in a step which the estimate takes over, above 0 and
  /// at most 1. Small values average over noise, large ones follow gusts.
  Scalar gain = Scalar(0.3);
  /// Largest length of the estimated acceleration, m/s².
  Scalar largest = Scalar(10);

  /// Returns an empty string, or a line that names the bad setting and its value.
  std::string validate() const {
    if (!is_finite(gain) || !(Scalar(0) < gain) || Scalar(1) < gain)
      return "gain is " + number_text(gain) + ", must be above 0 and at most 1";
    if (!is_finite(largest) || !(Scalar(0) < largest))
      return "largest is " + number_text(largest) + ", must be positive and finite";
    return {};
  }
};

/// Estimates one acceleration of the whole sheet from what its model misses.
template <class Model, RealScalar S = typename Model::Scalar>
requires ClothModel<Model, S>
class DisturbanceObserver {
 public:
  /// The scalar type.
  using Scalar = S;

  /// Makes an observer with a model of the sheet and the `mass` of its vertices (n, kg). Returns an
  /// error that names what is wrong. Allocates.
  static Result<DisturbanceObserver> create(Model model, const VectorX<Scalar>& mass,
                                            DisturbanceSettings<Scalar> settings = {}) {
    std::string problem = settings.validate();
    const Index n = cloth_traits<Model>::vertex_count(model);
    if (problem.empty() && mass.size() != n)
      problem = "there are " + std::to_string(mass.size()) + " masses for " + std::to_string(n) +
                " vertices";
    for (Index i = 0; problem.empty() && i < n; ++i) {
      if (!is_finite(mass[i]) || !(Scalar(0) < mass[i]))
        problem = "the mass of vertex " + std::to_string(i) + " is " + number_text(mass[i]) +
                  ", must be positive and finite";
    }
    if (!problem.empty()) return Error{problem};
    return DisturbanceObserver(std::move(model), mass, settings);
  }

  /// Learns from a step of the sheet: its state before, the input that acted on it for `dt` (s) and
  /// the velocities after (3×n, m/s). Returns false and changes nothing when `check_input` finds a
  /// fault, all vertices are driven, or the model cannot take the step. Allocates when the input
  /// has another size than the one before.
  [[nodiscard]] bool observe(const ClothState<Scalar>& before, const ClothInput<Scalar>& input,
                             Scalar dt, const PointsView<Scalar>& velocities) {
    if (!fits(velocities)) return false;
    state_ = before;
    load(input);
    if (!cloth_traits<Model>::step(model_, state_, input_, dt, workspace_).advanced) return false;
    Scalar total = Scalar(0);
    Vector3<Scalar> missed = Vector3<Scalar>::Zero();
    for (Index i = 0; i < count(); ++i) free_[i] = mass_[i];
    for (const int vertex : input.driven_vertices) free_[vertex] = Scalar(0);
    for (Index i = 0; i < count(); ++i) {
      total += free_[i];
      missed += free_[i] * (velocities.col(i) - state_.velocities.col(i));
    }
    if (!(Scalar(0) < total)) return false;
    const Vector3<Scalar> next = acceleration_ + settings_.gain / (total * dt) * missed;
    if (!all_finite(next)) return false;
    const Scalar length = next.norm();
    set(length > settings_.largest ? Vector3<Scalar>(next * (settings_.largest / length)) : next);
    return true;
  }

  /// Returns an empty string, or a line that says why `observe` would refuse its input. Allocates.
  std::string check_input(const ClothState<Scalar>& before, const ClothInput<Scalar>& input,
                          Scalar dt, const PointsView<Scalar>& velocities) const {
    std::string problem = check_step_input(before, input, dt, count());
    if (!problem.empty()) return problem;
    if (velocities.cols() != count())
      return "there are " + std::to_string(velocities.cols()) + " velocities after the step for " +
             std::to_string(count()) + " vertices";
    return fits(velocities) ? std::string() : "a velocity after the step is not finite";
  }

  /// Returns the estimated acceleration, m/s².
  const Vector3<Scalar>& acceleration() const { return acceleration_; }
  /// Returns the forces that it means, 3×n, N; for `Planner::set_outer_force`.
  const Points<Scalar>& force() const { return force_; }
  /// Forgets the disturbance.
  void reset() { set(Vector3<Scalar>::Zero()); }

 private:
  DisturbanceObserver(Model model, const VectorX<Scalar>& mass,
                      const DisturbanceSettings<Scalar>& settings)
      : model_(std::move(model)),
        settings_(settings),
        workspace_(cloth_traits<Model>::make_workspace(model_)),
        state_(cloth_traits<Model>::rest_state(model_)),
        mass_(mass),
        free_(mass) {
    force_.setZero(3, count());
    load({});
  }

  Index count() const { return mass_.size(); }

  bool fits(const PointsView<Scalar>& velocities) const {
    return velocities.cols() == count() && all_finite(velocities);
  }

  /// Copies an input and adds the forces of the disturbance.
  void load(const ClothInput<Scalar>& input) {
    const Index forces = input.forces.cols();
    input_.force_vertices = input.force_vertices;
    for (Index i = 0; i < count(); ++i) input_.force_vertices.push_back(static_cast<int>(i));
    input_.forces.resize(3, forces + count());
    input_.forces.leftCols(forces) = input.forces;
    input_.forces.rightCols(count()) = force_;
    input_.driven_vertices = input.driven_vertices;
    input_.driven_positions = input.driven_positions;
    input_.wind = input.wind;
    input_.attached_vertices = input.attached_vertices;
    input_.attached_positions = input.attached_positions;
    input_.attachment_stiffness = input.attachment_stiffness;
  }

  void set(const Vector3<Scalar>& acceleration) {
    acceleration_ = acceleration;
    for (Index i = 0; i < count(); ++i) force_.col(i) = mass_[i] * acceleration;
  }

  Model model_;
  DisturbanceSettings<Scalar> settings_;
  decltype(cloth_traits<Model>::make_workspace(std::declval<const Model&>())) workspace_;
  ClothState<Scalar> state_;
  ClothInput<Scalar> input_;
  VectorX<Scalar> mass_, free_;
  Vector3<Scalar> acceleration_ = Vector3<Scalar>::Zero();
  Points<Scalar> force_;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
