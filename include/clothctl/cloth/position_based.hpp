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
// x positions, v velocities, g gravity, f input forces, m masses, α drag. Two schemes:
//
// Verlet ([Toh 2011], eq. 1-4): θ = 1 - d, so p = x + (1 - d)(x - x_old) + a h² with x_old = x - h
// v; the distances are rigid. XPBD: θ = 1; a spring has the compliance 1/k and its damper, a
// stencil the compliance 1/kb. Drag also slows the motion that constraints cause, so they use the
// inverse mass w/(1 + h α). With many sweeps a substep tends to one of implicit Euler, (1 + h α) M
// v+ = M v + h f(x+, v+). With few, the sheet is softer than its network says. References: [Toh
// 2011], ch. 2.3; Macklin, Müller, Chentanez, "XPBD", 2016; Macklin et al., "Small steps", 2019.

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/air_forces.hpp"
#include "clothctl/cloth/detail/position_based_constraints.hpp"
#include "clothctl/cloth/detail/step_input.hpp"
#include "clothctl/cloth/position_based_settings.hpp"
#include "clothctl/cloth/spring_network.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/step_input.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// All memory of a step of `PositionBased`. `PositionBased::make_workspace` makes it; a step
/// refuses one of another size. It carries nothing from step to step.
template <RealScalar Scalar>
struct PositionBasedWorkspace {
  /// 1 for driven vertices.
  std::vector<unsigned char> held;
  /// Inverse masses, 0 for driven and pinned vertices, n, 1/kg.
  VectorX<Scalar> inverse_mass;
  /// Inverse masses over 1 + h α, which the compliant constraints use, n, 1/kg.
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

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/cloth/detail/position_based_impl.hpp"
