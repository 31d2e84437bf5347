#pragma once

// Position-based sheet: positions are predicted, then corrected constraint after constraint. A step dt is cut into equal
// substeps h; in each, with a = g + f/m constant over the step and w = 1/m,
//
//   air      acts on v (air.hpp)
//
//   predict  v <- (θ v + h a)/(1 + h α),  p = x + h v;  driven vertices (w = 0) go a straight line to where they are told,
//            pinned ones stay
//
//   correct  `iterations` sweeps over the constraints of position_based_constraints.hpp: springs, then bending stencils
//
//   update   v = (p - x)/h,  x = p
//
// Verlet (paper 004, eq. 1-4): θ = 1 - d, so p = x + (1 - d)(x - x_old) + a h² with x_old = x - h v; distances are rigid.
// XPBD: θ = 1; springs have the compliance 1/k and their damper, stencils the compliance 1/kb; drag slows their impulses
// too, so they meet the inverse mass w/(1 + h α). With many sweeps a substep tends to one of implicit Euler,
// (1 + h α) M v+ = M v + h f(x+, v+); with few, the sheet is softer than its network says.
// References: paper 004, ch. 2.3; Macklin, Müller, Chentanez, "XPBD", 2016; Macklin et al., "Small steps", 2019.

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/air.hpp"
#include "clothctl/cloth/position_based_constraints.hpp"
#include "clothctl/cloth/position_based_settings.hpp"
#include "clothctl/cloth/spring_network.hpp"
#include "clothctl/cloth/step_input.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/result.hpp"

namespace clothctl {

/// All memory of a step of `PositionBased`; made by `PositionBased::make_workspace`. Carries nothing from step to step.
template <RealScalar Scalar>
struct PositionBasedWorkspace {
  /// 1 for driven vertices.
  std::vector<unsigned char> held;
  /// Inverse masses, 0 for driven and pinned vertices, n, 1/kg.
  VectorX<Scalar> inverse_mass;
  /// Inverse masses over 1 + h α, which the compliant constraints meet, n, 1/kg.
  VectorX<Scalar> slowed_inverse_mass;
  /// Acceleration g + f/m, 3×n, m/s².
  Points<Scalar> acceleration;
  /// Positions being corrected, 3×n, m.
  Points<Scalar> positions;
  /// Positions at the start of the substep, 3×n, m.
  Points<Scalar> start;
  /// Velocities, 3×n, m/s.
  Points<Scalar> velocities;
  /// Scratch of the rigid springs.
  typename detail::RigidDistances<Scalar>::Scratch rigid;
  /// Scratch of the compliant springs.
  typename detail::CompliantDistances<Scalar>::Scratch compliant;
  /// Scratch of the stencils of up to three vertices.
  typename detail::BendConstraints<Scalar, 3>::Scratch bends3;
  /// Scratch of the stencils of four vertices.
  typename detail::BendConstraints<Scalar, 4>::Scratch bends4;
};

/// A cloth model (concept ClothModel) by position-based dynamics. Const and free of state: one model serves many threads.
template <RealScalar S>
class PositionBased {
 public:
  /// The scalar type.
  using Scalar = S;
  /// The state of a step.
  using State = ClothState<Scalar>;
  /// The scratch memory of a step.
  using Workspace = PositionBasedWorkspace<Scalar>;

  /// Makes a model of a network. Allocates.
  /// Fails when: the network or the settings do not pass their check.
  static Result<PositionBased> create(SpringNetwork<Scalar> network, PositionBasedSettings<Scalar> settings = {}) {
    if (std::string problem = network.check(); !problem.empty()) return Error{std::move(problem)};
    if (std::string problem = settings.check(network); !problem.empty()) return Error{std::move(problem)};
    return PositionBased(std::move(network), std::move(settings));
  }

  /// Number of vertices.
  Index vertex_count() const { return network_.vertex_count(); }

  /// The network that the model was made of.
  const SpringNetwork<Scalar>& network() const { return network_; }

  /// The settings that the model was made with.
  const PositionBasedSettings<Scalar>& settings() const { return settings_; }

  /// The undeformed sheet at rest. Allocates.
  State rest_state() const { return {network_.rest_positions, Points<Scalar>(Points<Scalar>::Zero(3, vertex_count()))}; }

  /// All scratch memory of a step. Allocates.
  Workspace make_workspace() const {
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

  /// Advances `state` by `dt` (s) under `input`. The report's iterations are sweeps; its residual is 0, since no equation
  /// is solved to a tolerance. Never allocates. Complexity: O(substeps × iterations × constraints).
  /// Fails when: see StepStatus; the state is then bitwise as it was.
  StepReport<Scalar> step(State& state, const ClothInput<Scalar>& input, Scalar dt, Workspace& ws) const {
    StepReport<Scalar> report;
    report.status = check_step(state, input, dt, vertex_count(), ws.held);
    if (report.status != StepStatus::Converged) return report;

    const Scalar h = dt / Scalar(static_cast<double>(settings_.substeps));
    load(state, input, h, ws);
    for (int part = 1; part <= settings_.substeps; ++part) {
      apply_air_impulses(network_.triangles, ws.positions, ws.inverse_mass, input.wind, h, settings_.air, ws.velocities);
      predict(state, input, part, h, ws);
      correct(ws);
      ws.velocities = (ws.positions - ws.start) / h;
    }
    for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
      const Index vertex = input.driven_vertices[i];
      ws.velocities.col(vertex) = (input.driven_positions.col(static_cast<Index>(i)) - state.positions.col(vertex)) / dt;
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

 private:
  PositionBased(SpringNetwork<Scalar> network, PositionBasedSettings<Scalar> settings)
      : network_(std::move(network)), settings_(std::move(settings)), inverse_mass_(network_.mass.cwiseInverse()) {
    if (settings_.scheme == PositionScheme::Verlet) {
      rigid_ = detail::RigidDistances<Scalar>(network_, settings_.spring_relaxation);
    } else {
      compliant_ = detail::CompliantDistances<Scalar>(network_);
    }
    bends3_ = detail::BendConstraints<Scalar, 3>(network_, 2);
    bends4_ = detail::BendConstraints<Scalar, 4>(network_, 4);
  }

  /// Copies the state and computes all that is constant over the step.
  void load(const State& state, const ClothInput<Scalar>& input, const Scalar& h, Workspace& ws) const {
    ws.positions = state.positions;
    ws.velocities = state.velocities;
    ws.inverse_mass = inverse_mass_;
    for (int vertex : settings_.pinned) {
      ws.inverse_mass[vertex] = Scalar(0);
      ws.velocities.col(vertex).setZero();
    }
    for (int vertex : input.driven_vertices) ws.inverse_mass[vertex] = Scalar(0);
    ws.acceleration.colwise() = settings_.gravity;
    for (std::size_t i = 0; i < input.force_vertices.size(); ++i) {
      const Index vertex = input.force_vertices[i];
      ws.acceleration.col(vertex) += ws.inverse_mass[vertex] * input.forces.col(static_cast<Index>(i));
    }
    if (settings_.scheme == PositionScheme::Verlet) {
      rigid_.prepare(ws.inverse_mass, ws.rigid);
      bends3_.prepare_rigid(ws.inverse_mass, settings_.bend_relaxation, ws.bends3);
      bends4_.prepare_rigid(ws.inverse_mass, settings_.bend_relaxation, ws.bends4);
    } else {
      ws.slowed_inverse_mass = ws.inverse_mass / (Scalar(1) + h * settings_.drag);
      compliant_.prepare(ws.slowed_inverse_mass, h, ws.compliant);
      bends3_.prepare_compliant(ws.slowed_inverse_mass, h, ws.bends3);
      bends4_.prepare_compliant(ws.slowed_inverse_mass, h, ws.bends4);
    }
  }

  void predict(const State& state, const ClothInput<Scalar>& input, int part, const Scalar& h, Workspace& ws) const {
    const bool verlet = settings_.scheme == PositionScheme::Verlet;
    const Scalar keep = verlet ? Scalar(1) - settings_.verlet_damping : Scalar(1);
    const Scalar scale = Scalar(1) / (Scalar(1) + h * settings_.drag);
    ws.start = ws.positions;
    ws.velocities = scale * (keep * ws.velocities + h * ws.acceleration);
    ws.positions += h * ws.velocities;
    for (int vertex : settings_.pinned) ws.positions.col(vertex) = ws.start.col(vertex);
    const Scalar done = Scalar(static_cast<double>(part)) / Scalar(static_cast<double>(settings_.substeps));
    for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
      const Index vertex = input.driven_vertices[i];
      const Index column = static_cast<Index>(i);
      if (part == settings_.substeps) {
        ws.positions.col(vertex) = input.driven_positions.col(column);
      } else {
        ws.positions.col(vertex) =
            state.positions.col(vertex) + done * (input.driven_positions.col(column) - state.positions.col(vertex));
      }
    }
  }

  void correct(Workspace& ws) const {
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

  SpringNetwork<Scalar> network_;
  PositionBasedSettings<Scalar> settings_;
  VectorX<Scalar> inverse_mass_;
  detail::RigidDistances<Scalar> rigid_;
  detail::CompliantDistances<Scalar> compliant_;
  detail::BendConstraints<Scalar, 3> bends3_;
  detail::BendConstraints<Scalar, 4> bends4_;
};

}  // namespace clothctl
