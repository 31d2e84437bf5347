#pragma once

// Position-based sheet: positions are predicted, then corrected by one constraint after the other.
// A step dt is divided into equal substeps h. With a = g + f/m constant over the step and w = 1/m,
// each substep has four parts:
//
//   air      acts on v (detail/air_forces.hpp)
//   predict  v <- (θ v + h a)/(1 + h α),  p = x + h v.  Driven vertices (w = 0) move on a straight
//            line to their prescribed position; pinned ones stay
//   correct  `iterations` sweeps over the constraints of detail/position_based_constraints.hpp:
//            springs first, then bending stencils
//   update   v = (p - x)/h,  x = p
//
// x positions, p corrected positions, v velocities, g gravity, f input forces, m masses, α drag.
// Two schemes:
//
// Verlet ([Toh 2011], eq. 1-4): θ = 1 - d with the damping d; without drag
// p = x + (1 - d)(x - x_old) + a h² with x_old = x - h v. The distances are rigid. XPBD: θ = 1; a
// spring has the compliance 1/k and its damper, a stencil the compliance 1/kb. Drag also slows the
// motion that constraints cause, so the compliant constraints use the inverse mass w/(1 + h α).
// With many sweeps a substep converges to one of implicit Euler,
// (1 + h α) M v⁺ = M v + h f(x⁺, v⁺). With few, the sheet is softer than its network. References:
// [Toh 2011], ch. 2.3; Macklin, Müller, Chentanez, "XPBD", 2016; Macklin et al., "Small steps",
// 2019.

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/air_forces.hpp"
#include "clothctl/cloth/detail/position_based_constraints.hpp"
#include "clothctl/cloth/detail/step_input.hpp"
#include "clothctl/cloth/position_based_settings.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// All memory of a step of `PositionBased`. `PositionBased::make_workspace` makes it; a step
/// refuses one of another size. A workspace carries nothing from step to step.
template <RealScalar Scalar>
struct PositionBasedWorkspace {
  /// 1 for driven vertices.
  std::vector<unsigned char> held;
  /// Inverse masses, 0 for driven and pinned vertices, n, 1/kg.
  VectorX<Scalar> inverse_mass;
  /// Inverse masses divided by 1 + h α, for the compliant constraints, n, 1/kg.
  VectorX<Scalar> slowed_inverse_mass;
  /// Acceleration g + f/m, 3×n, m/s².
  Points<Scalar> acceleration;
  /// Positions being corrected, 3×n, m.
  Points<Scalar> positions;
  /// Positions at the start of the substep, 3×n, m.
  Points<Scalar> start;
  /// Velocities, 3×n, m/s.
  Points<Scalar> velocities;
  /// Data of the rigid springs.
  typename detail::RigidDistances<Scalar>::Scratch rigid;
  /// Data of the compliant springs.
  typename detail::CompliantDistances<Scalar>::Scratch compliant;
  /// Data of the stencils of up to three vertices.
  typename detail::BendConstraints<Scalar, 3>::Scratch bends3;
  /// Data of the stencils of four vertices.
  typename detail::BendConstraints<Scalar, 4>::Scratch bends4;
};

/// A spring network moved by position-based dynamics. Satisfies the concept ClothModel. A step does
/// not change the model, so one model serves many threads, each with its own state and workspace.
template <RealScalar S>
class PositionBased {
 public:
  /// The scalar type.
  using Scalar = S;
  /// The state of a step.
  using State = ClothState<Scalar>;
  /// The memory of a step.
  using Workspace = PositionBasedWorkspace<Scalar>;

  /// Makes a model of a network. Allocates. Fails when: `network.validate()` or
  /// `settings.validate(network)` finds a fault.
  static Result<PositionBased> create(SpringNetwork<Scalar> network,
                                      PositionBasedSettings<Scalar> settings = {});

  /// Returns the number of vertices.
  Index vertex_count() const { return network_.vertex_count(); }

  /// Returns the network that the model was made of.
  const SpringNetwork<Scalar>& network() const { return network_; }

  /// Returns the settings that the model was made with.
  const PositionBasedSettings<Scalar>& settings() const { return settings_; }

  /// Returns the upward force (3-vector, N) that holds the sheet at rest: minus the acceleration of
  /// gravity times the sum of the masses. PlannerSettings::gravity_load takes it.
  Vector3<Scalar> gravity_load() const {
    return detail::gravity_load(settings_.gravity, network_.mass);
  }

  /// Returns the state of the undeformed sheet at rest. Allocates.
  State rest_state() const;

  /// Makes the memory of a step of this model. Allocates.
  Workspace make_workspace() const;

  /// Returns why `step` would refuse these arguments: one line that names the item, its index and
  /// the bad value. Returns an empty string when they are good. Allocates. Complexity: O(vertices).
  std::string check_input(const State& state, const ClothInput<Scalar>& input, Scalar dt,
                          const Workspace& ws) const;

  /// Advances `state` by `dt` (s) under `input`. The iterations of the report are sweeps. Its
  /// residual is 0, since no equation is solved to a tolerance. Never allocates. Fails when: see
  /// StepStatus; the state is then bitwise unchanged, and `check_input` says why. Complexity:
  /// O(substeps × iterations × constraints).
  [[nodiscard]] StepReport<Scalar> step(State& state, const ClothInput<Scalar>& input, Scalar dt,
                                        Workspace& ws) const;

 private:
  using Triple = detail::Triple<Scalar>;

  /// Returns true when the workspace has the sizes of this model. A step writes all that it reads
  /// from a workspace, so nothing else must agree.
  bool fits(const Workspace& ws) const;

  PositionBased(SpringNetwork<Scalar> network, PositionBasedSettings<Scalar> settings);

  /// Copies the state and computes what is constant over the step.
  void load(const State& state, const ClothInput<Scalar>& input, const Scalar& h,
            Workspace& ws) const;

  void predict(const State& state, const ClothInput<Scalar>& input, int part, const Scalar& h,
               Workspace& ws) const;

  void correct(Workspace& ws) const;

  SpringNetwork<Scalar> network_;
  PositionBasedSettings<Scalar> settings_;
  VectorX<Scalar> inverse_mass_;
  detail::RigidDistances<Scalar> rigid_;
  detail::CompliantDistances<Scalar> compliant_;
  detail::BendConstraints<Scalar, 3> bends3_;
  detail::BendConstraints<Scalar, 4> bends4_;
};

template <RealScalar S>
auto PositionBased<S>::create(SpringNetwork<Scalar> network, PositionBasedSettings<Scalar> settings)
    -> Result<PositionBased> {
  if (std::string problem = network.validate(); !problem.empty()) return Error{std::move(problem)};
  if (std::string problem = settings.validate(network); !problem.empty())
    return Error{std::move(problem)};
  return PositionBased(std::move(network), std::move(settings));
}

template <RealScalar S>
auto PositionBased<S>::rest_state() const -> State {
  return {network_.rest_positions, Points<Scalar>(Points<Scalar>::Zero(3, vertex_count()))};
}

template <RealScalar S>
auto PositionBased<S>::make_workspace() const -> Workspace {
  const Index n = vertex_count();
  Workspace ws;
  ws.held.assign(static_cast<std::size_t>(n), 0);
  ws.inverse_mass = inverse_mass_;
  ws.slowed_inverse_mass = inverse_mass_;
  ws.acceleration.setZero(3, n);
  ws.positions.setZero(3, n);
  ws.start.setZero(3, n);
  ws.velocities.setZero(3, n);
  ws.rigid = rigid_.make_scratch();
  ws.compliant = compliant_.make_scratch();
  ws.bends3 = bends3_.make_scratch();
  ws.bends4 = bends4_.make_scratch();
  return ws;
}

template <RealScalar S>
std::string PositionBased<S>::check_input(const State& state, const ClothInput<Scalar>& input,
                                          Scalar dt, const Workspace& ws) const {
  if (!fits(ws)) return detail::foreign_workspace_line();
  return check_step_input(state, input, dt, vertex_count());
}

template <RealScalar S>
auto PositionBased<S>::step(State& state, const ClothInput<Scalar>& input, Scalar dt,
                            Workspace& ws) const -> StepReport<Scalar> {
  StepReport<Scalar> report;
  report.status = fits(ws) ? detail::check_step(state, input, dt, vertex_count(), ws.held)
                           : StepStatus::InvalidWorkspace;
  if (report.status != StepStatus::Converged) return report;

  const Scalar h = dt / Scalar(static_cast<double>(settings_.substeps));
  load(state, input, h, ws);
  for (int part = 1; part <= settings_.substeps; ++part) {
    detail::apply_air_impulses(network_.triangles, ws.positions, ws.inverse_mass, input.wind, h,
                               settings_.air, ws.velocities);
    predict(state, input, part, h, ws);
    correct(ws);
    for (Index k = 0; k < ws.velocities.size(); ++k)
      ws.velocities.data()[k] = (ws.positions.data()[k] - ws.start.data()[k]) / h;
  }
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
    const Index vertex = input.driven_vertices[i];
    const Triple end = detail::column(input.driven_positions, static_cast<Index>(i));
    detail::set_column(ws.velocities, vertex, (end - detail::column(state.positions, vertex)) / dt);
  }
  report.iterations = settings_.substeps * settings_.iterations;
  if (!all_finite(ws.positions) || !all_finite(ws.velocities)) {
    report.status = StepStatus::NumericalFailure;
    return report;
  }
  state.positions = ws.positions;
  state.velocities = ws.velocities;
  report.advanced = true;
  return report;
}

template <RealScalar S>
bool PositionBased<S>::fits(const Workspace& ws) const {
  const Index n = vertex_count();
  bool good = ws.inverse_mass.size() == n && ws.slowed_inverse_mass.size() == n;
  for (const Points<Scalar>* p : {&ws.acceleration, &ws.positions, &ws.start, &ws.velocities})
    good = good && p->cols() == n;
  return good && rigid_.fits(ws.rigid) && compliant_.fits(ws.compliant) &&
         bends3_.fits(ws.bends3) && bends4_.fits(ws.bends4);
}

template <RealScalar S>
PositionBased<S>::PositionBased(SpringNetwork<Scalar> network,
                                PositionBasedSettings<Scalar> settings)
    : network_(std::move(network)), settings_(std::move(settings)), inverse_mass_(network_.mass) {
  for (Index i = 0; i < inverse_mass_.size(); ++i) inverse_mass_[i] = Scalar(1) / inverse_mass_[i];
  if (settings_.scheme == PositionScheme::Verlet) {
    rigid_ = detail::RigidDistances<Scalar>(network_, settings_.spring_relaxation);
  } else {
    compliant_ = detail::CompliantDistances<Scalar>(network_);
  }
  bends3_ = detail::BendConstraints<Scalar, 3>(network_, 2);
  bends4_ = detail::BendConstraints<Scalar, 4>(network_, 4);
}

template <RealScalar S>
void PositionBased<S>::load(const State& state, const ClothInput<Scalar>& input, const Scalar& h,
                            Workspace& ws) const {
  ws.positions = state.positions;
  ws.velocities = state.velocities;
  ws.inverse_mass = inverse_mass_;
  for (int vertex : settings_.pinned) {
    ws.inverse_mass[vertex] = Scalar(0);
    detail::set_column(ws.velocities, vertex, Triple{Scalar(0), Scalar(0), Scalar(0)});
  }
  for (int vertex : input.driven_vertices) ws.inverse_mass[vertex] = Scalar(0);
  const Triple gravity = detail::triple(settings_.gravity);
  for (Index i = 0; i < vertex_count(); ++i) detail::set_column(ws.acceleration, i, gravity);
  for (std::size_t i = 0; i < input.force_vertices.size(); ++i) {
    const Index vertex = input.force_vertices[i];
    const Triple force = detail::column(input.forces, static_cast<Index>(i));
    detail::add_to_column(ws.acceleration, vertex, force * ws.inverse_mass[vertex]);
  }
  if (settings_.scheme == PositionScheme::Verlet) {
    rigid_.prepare(ws.inverse_mass, ws.rigid);
    bends3_.prepare_rigid(ws.inverse_mass, settings_.bend_relaxation, ws.bends3);
    bends4_.prepare_rigid(ws.inverse_mass, settings_.bend_relaxation, ws.bends4);
  } else {
    const Scalar slowing = Scalar(1) + h * settings_.drag;
    for (Index i = 0; i < vertex_count(); ++i)
      ws.slowed_inverse_mass[i] = ws.inverse_mass[i] / slowing;
    compliant_.prepare(ws.slowed_inverse_mass, h, ws.compliant);
    bends3_.prepare_compliant(ws.slowed_inverse_mass, h, ws.bends3);
    bends4_.prepare_compliant(ws.slowed_inverse_mass, h, ws.bends4);
  }
}

template <RealScalar S>
void PositionBased<S>::predict(const State& state, const ClothInput<Scalar>& input, int part,
                               const Scalar& h, Workspace& ws) const {
  const bool verlet = settings_.scheme == PositionScheme::Verlet;
  const Scalar keep = verlet ? Scalar(1) - settings_.verlet_damping : Scalar(1);
  const Scalar scale = Scalar(1) / (Scalar(1) + h * settings_.drag);
  ws.start = ws.positions;
  Scalar* v = ws.velocities.data();
  for (Index k = 0; k < ws.velocities.size(); ++k) {
    v[k] = scale * (keep * v[k] + h * ws.acceleration.data()[k]);
    ws.positions.data()[k] = ws.positions.data()[k] + h * v[k];
  }
  for (int vertex : settings_.pinned)
    detail::set_column(ws.positions, vertex, detail::column(ws.start, vertex));
  const Scalar done =
      Scalar(static_cast<double>(part)) / Scalar(static_cast<double>(settings_.substeps));
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
    const Index vertex = input.driven_vertices[i];
    const Index column = static_cast<Index>(i);
    const Triple end = detail::column(input.driven_positions, column);
    const Triple begin = detail::column(state.positions, vertex);
    const bool last = part == settings_.substeps;
    detail::set_column(ws.positions, vertex, last ? end : begin + (end - begin) * done);
  }
}

template <RealScalar S>
void PositionBased<S>::correct(Workspace& ws) const {
  if (settings_.scheme == PositionScheme::Verlet) {
    for (int sweep = 0; sweep < settings_.iterations; ++sweep) {
      rigid_.sweep(ws.positions, ws.rigid);
      bends3_.template sweep<true>(ws.positions, ws.bends3);
      bends4_.template sweep<true>(ws.positions, ws.bends4);
    }
    return;
  }
  compliant_.begin_substep(ws.compliant);
  bends3_.begin_substep(ws.bends3);
  bends4_.begin_substep(ws.bends4);
  for (int sweep = 0; sweep < settings_.iterations; ++sweep) {
    compliant_.sweep(ws.positions, ws.start, ws.compliant);
    bends3_.template sweep<false>(ws.positions, ws.bends3);
    bends4_.template sweep<false>(ws.positions, ws.bends4);
  }
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class PositionBased<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
