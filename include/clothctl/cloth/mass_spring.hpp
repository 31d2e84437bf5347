#pragma once

// A mass-spring body stepped by implicit Euler with h = dt. Driven vertices have a prescribed
// velocity. Two integrations:
//
//   LinearlyImplicit, one linear solve (Baraff-Witkin):
//     A v⁺ = M v + h ( f(x0) + f_g + f_u + C w ),        x⁺ = x0 + h v⁺
//     A    = (1 + h α) M + h (D + C) + h² K(x0)
//   Newton, iterated to convergence:
//     v⁺ = argmin  ½ (v - v0)ᵀM(v - v0) + U(x0 + h v) - h (M g + f_u)ᵀ v
//                  + ½ h α vᵀM v + ½ h vᵀD v + ½ h (w - v)ᵀC (w - v)
//
// x0, v0 state at the start of the step, M masses, f and U forces and energy of the springs, f_g
// gravity, f_u input forces, α drag, K stiffness, w wind. The dampers D and the air matrices C are
// frozen at the start of the step.
//
// The single solve uses the projection of K onto the positive semidefinite matrices. A Newton step
// uses as much of the exact K as leaves A positive definite: the factor γ on the compression part
// (detail/spring_forces.hpp) starts at 1. It is halved whenever the factorisation fails (values
// below ¼ become 0, the projection), and doubled again after every third iteration, to at least ¼
// and at most 1. So every step is a descent direction; and near a minimum, where the exact A is
// positive definite, convergence is quadratic; it is linear with hinges that are folded at rest,
// whose part of A is the Gauss-Newton matrix at the start of the step. A sheet that buckles needs a
// fifth of the iterations of the projected method. An Armijo backtracking line search on the energy
// gives global convergence. References: Baraff & Witkin, Large Steps in Cloth Simulation (1998);
// [Bai 2016], eq. 4-6.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/mass_spring_workspace.hpp"
#include "clothctl/cloth/detail/spring_forces.hpp"
#include "clothctl/cloth/detail/step_input.hpp"
#include "clothctl/cloth/detail/step_solver.hpp"
#include "clothctl/cloth/mass_spring_impulses.hpp"
#include "clothctl/cloth/mass_spring_settings.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/linalg/block_cholesky.hpp"
#include "clothctl/linalg/nested_dissection.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// A network of masses and springs under implicit Euler. Satisfies the concept ClothModel. A step
/// does not change the model, so one model serves many threads, each with its own state and
/// workspace.
template <RealScalar S>
class MassSpring {
 public:
  /// The scalar type.
  using Scalar = S;
  /// The state of a step.
  using State = ClothState<Scalar>;

  /// All memory of a step, made by `make_workspace`. A step refuses one that was made for
  /// another structure.
  using Workspace = detail::MassSpringWorkspace<Scalar>;

  /// How a sheet of this model answers to impulses after its step.
  using Impulses = MassSpringImpulses<Scalar>;

  /// Makes a model of a network and analyses the step matrix once. Allocates. Fails when:
  /// `network.validate()` or `settings.validate()` finds a fault, a pinned vertex is off the mesh,
  /// or the network has triangle elements.
  static Result<MassSpring> create(SpringNetwork<Scalar> network,
                                   MassSpringSettings<Scalar> settings = {});

  /// Returns the masses and springs.
  const SpringNetwork<Scalar>& network() const { return network_; }
  /// Returns the settings.
  const MassSpringSettings<Scalar>& settings() const { return settings_; }
  /// Changes how a step is solved.
  void set_integration(Integration integration) { settings_.integration = integration; }
  /// Changes the mass-proportional drag α (1/s), for example while a sheet settles. Returns false
  /// and changes nothing when `drag` is negative or not finite.
  bool set_drag(Scalar drag);
  /// Returns the upward force (3-vector, N) that holds the body at rest: minus the acceleration of
  /// gravity times the sum of the masses. PlannerSettings::gravity_load takes it.
  Vector3<Scalar> gravity_load() const {
    return detail::gravity_load(settings_.gravity, network_.mass);
  }
  /// Returns the number of vertices.
  Index vertex_count() const { return network_.vertex_count(); }

  /// Returns the state of the undeformed body at rest. Allocates.
  State rest_state() const;

  /// Makes the memory of a step of this model, with room for a number of contacts. Allocates.
  Workspace make_workspace(Index contacts = 0) const;

  /// Returns why `step` would refuse these arguments: one line that names the item, its index and
  /// the bad value. Returns an empty string when they are good. Allocates. Complexity: O(vertices).
  std::string check_input(const State& state, const ClothInput<Scalar>& input, Scalar dt,
                          const Workspace& ws) const;

  /// Advances `state` by `dt` (s) under `input`. The iterations of the report are linear solves; of
  /// a step that is one solve by conjugate gradients, their iterations. Never allocates. Fails
  /// when: see StepStatus; the state is then bitwise unchanged, and `check_input` says why.
  /// Complexity: O(n^1.5) a factorisation on a sheet of n vertices, one for a single linear solve
  /// and a few for Newton; conjugate gradients O(n) an iteration.
  [[nodiscard]] StepReport<Scalar> step(State& state, const ClothInput<Scalar>& input, Scalar dt,
                                        Workspace& ws) const {
    return step_with(nullptr, state, input, dt, ws);
  }

  /// The same with contacts that were listed for `state` and `dt`. They act as implicitly as all
  /// other forces (detail/contact_springs.hpp). Writes their impulses, states and report. `ws` must
  /// have room for them. The status is also IterationLimit when their forces have not settled: the
  /// report says how far. InvalidInput: another step length than theirs, or a vertex off the mesh.
  /// InvalidWorkspace: no room. Complexity: a single linear solve takes a few solves with its
  /// factor more while states of contacts change.
  [[nodiscard]] StepReport<Scalar> step(State& state, const ClothInput<Scalar>& input,
                                        ObstacleContacts<Scalar>& contacts, Scalar dt,
                                        Workspace& ws) const {
    return step_with(&contacts, state, input, dt, ws);
  }

  /// Writes the forces that made `vertices` follow their prescribed motion in the last step with
  /// this workspace, 3×vertices.size(), N: the force that a hand must exert on each. Every vertex
  /// must have been driven or pinned in that step. Input forces on the vertices are already
  /// subtracted. The error is that of the step's residual. Never allocates. Returns false, and
  /// writes nothing, when the workspace was made by another model or has seen no step, a vertex is
  /// off the mesh, or `forces` has another number of columns.
  bool holding_forces(std::span<const int> vertices, Workspace& ws,
                      Eigen::Ref<Points<Scalar>> forces) const;

  /// Makes `ws.factor` with `ws.factor_changes` that of the step matrix of the last step with this
  /// workspace, whose end is `state`: at its start after a single linear solve, at its end (the
  /// projection where that is not definite) after Newton's method. What answers to impulses within
  /// the step needs it (MassSpringImpulses). Never allocates. Returns Converged, or InvalidState
  /// (another size), InvalidWorkspace (another model's, its last step did not advance, no factor
  /// because the model solves by conjugate gradients) or NumericalFailure (not definite).
  [[nodiscard]] StepStatus factorize_step(const State& state, Workspace& ws) const;

  /// Advances `state` by `dt` (s) with at most `newton_steps` Newton steps that start from the end
  /// velocities `guess` (3×n, m/s), whatever integration the settings name. Use it to repeat a
  /// rollout after a small change of its plan. It uses the projected Hessian, whose first step is
  /// the most cautious. `limit_energy` has no effect on it. It ends early when a Newton step
  /// changes every velocity coordinate by less than `step_tolerance`, m/s. Never allocates. Fails
  /// as `step` does, and with InvalidInput when `guess` has another size or is not finite.
  [[nodiscard]] StepReport<Scalar> step_from(const PointsView<Scalar>& guess, int newton_steps,
                                             State& state, const ClothInput<Scalar>& input,
                                             Scalar dt, Workspace& ws,
                                             Scalar step_tolerance = Scalar(0)) const;

 private:
  friend struct detail::StepParts<Scalar>;
  friend class MassSpringImpulses<Scalar>;

  /// A step with contacts, unless they are null.
  StepReport<Scalar> step_with(ObstacleContacts<Scalar>* contacts, State& state,
                               const ClothInput<Scalar>& input, Scalar dt, Workspace& ws) const;
  /// Solves a step that `prepare` has prepared.
  StepReport<Scalar> solve_step(State& state, const ClothInput<Scalar>& input, Scalar dt,
                                Workspace& ws) const;

  /// Returns true when this model, or one of the same structure, made the workspace.
  bool fits(const Workspace& ws) const;

  /// Returns the status that refuses the arguments of a step, or Converged; marks driven vertices.
  StepStatus refuse(const State& state, const ClothInput<Scalar>& input, Scalar dt,
                    Workspace& ws) const;

  /// Moves the state to the end of the step unless the solve failed.
  StepReport<Scalar> finish(State& state, const ClothInput<Scalar>& input, Scalar dt,
                            StepReport<Scalar> report, Workspace& ws) const;

  MassSpring(SpringNetwork<Scalar> network, MassSpringSettings<Scalar> settings);

  std::size_t air_count() const { return settings_.air.enabled() ? network_.triangles.size() : 0; }

  /// Computes what is constant over a step: directions of the dampers, air matrices, outer forces
  /// and ws.frozen. Sets ws.velocity = v, with held vertices at their prescribed velocity.
  void prepare(const State& state, const ClothInput<Scalar>& input, Scalar dt, Workspace& ws) const;

  /// Returns the solver of a step that `prepare` has prepared.
  detail::StepSolver<Scalar> solver(const State& state, Scalar dt, Workspace& ws) const {
    return {network_, settings_, pattern_, total_stiffness_, state, dt, ws};
  }

  Scalar velocity_tolerance() const {
    using std::cbrt;
    const Scalar given = settings_.velocity_tolerance;
    return Scalar(0) < given ? given : Scalar(2) * cbrt(scalar_traits<Scalar>::epsilon());
  }

  SpringNetwork<Scalar> network_;
  MassSpringSettings<Scalar> settings_;
  detail::SpringPattern<Scalar> pattern_;
  EliminationTree tree_;
  Scalar total_stiffness_ = Scalar(0);
  std::uint64_t structure_ = 0;
};

template <RealScalar S>
auto MassSpring<S>::create(SpringNetwork<Scalar> network, MassSpringSettings<Scalar> settings)
    -> Result<MassSpring> {
  std::string problem = network.validate();
  if (problem.empty()) problem = settings.validate();
  if (problem.empty() && !network.elements.empty())
    problem = "the network has " + std::to_string(network.elements.size()) +
              " triangle elements, which MassSpring does not simulate; use PositionBased";
  for (int v : settings.pinned) {
    if (problem.empty() && (v < 0 || v >= network.vertex_count()))
      problem = "pinned vertex " + std::to_string(v) + " is off the mesh of " +
                std::to_string(network.vertex_count()) + " vertices";
  }
  if (!problem.empty()) return Error{problem};
  return MassSpring(std::move(network), std::move(settings));
}

template <RealScalar S>
bool MassSpring<S>::set_drag(Scalar drag) {
  if (!is_finite(drag) || drag < Scalar(0)) return false;
  settings_.drag = drag;
  return true;
}

template <RealScalar S>
auto MassSpring<S>::rest_state() const -> State {
  return {network_.rest_positions, Points<Scalar>::Zero(3, vertex_count())};
}

template <RealScalar S>
auto MassSpring<S>::make_workspace(Index contacts) const -> Workspace {
  Workspace ws;
  ws.contact_springs.reserve(static_cast<std::size_t>(contacts));
  ws.structure = structure_;
  ws.reserve(network_, pattern_.matrix(), tree_, air_count());
  return ws;
}

template <RealScalar S>
std::string MassSpring<S>::check_input(const State& state, const ClothInput<Scalar>& input,
                                       Scalar dt, const Workspace& ws) const {
  if (!fits(ws)) return detail::foreign_workspace_line();
  return check_step_input(state, input, dt, vertex_count());
}

template <RealScalar S>
auto MassSpring<S>::step_with(ObstacleContacts<Scalar>* contacts, State& state,
                              const ClothInput<Scalar>& input, Scalar dt, Workspace& ws) const
    -> StepReport<Scalar> {
  StepStatus refused = refuse(state, input, dt, ws);
  if (refused == StepStatus::Converged && contacts != nullptr)
    refused = detail::check_contacts(*contacts, dt, vertex_count(), ws.contact_springs.capacity());
  if (refused != StepStatus::Converged) return {refused, false, Scalar(0), 0};
  prepare(state, input, dt, ws);
  if (contacts == nullptr || contacts->contacts().empty()) return solve_step(state, input, dt, ws);
  detail::ContactSprings<Scalar> springs(*contacts, ws.contact_springs, network_.mass, ws.held, dt);
  ws.contacts = &springs;
  const StepReport<Scalar> report = solve_step(state, input, dt, ws);
  ws.contacts = nullptr;
  if (report.advanced) springs.store(ws.velocity, contacts->report());
  return report;
}

template <RealScalar S>
auto MassSpring<S>::solve_step(State& state, const ClothInput<Scalar>& input, Scalar dt,
                               Workspace& ws) const -> StepReport<Scalar> {
  detail::StepSolver<Scalar> steps = solver(state, dt, ws);
  const detail::NewtonLimits<Scalar> limits{velocity_tolerance(), settings_.max_iterations,
                                            Scalar(1), Scalar(0)};
  const bool newton = settings_.integration == Integration::Newton;
  StepReport<Scalar> report = newton ? steps.newton(limits) : steps.solve_linear(limits.tolerance);
  const bool advances = report.status != StepStatus::NumericalFailure;
  const bool bounds = settings_.limit_energy && advances;
  detail::EnergyBalance<Scalar> balance;
  if (bounds && !newton) {
    balance = steps.energy_balance();
    if (detail::creates_energy(balance, ws)) report = steps.bound_energy(limits);
  }
  if (advances && !ws.linear) steps.close_contacts();
  if (bounds) {
    if (!ws.linear) balance = steps.energy_balance();
    detail::remove_energy(balance, network_.mass, ws);
  }
  return finish(state, input, dt, report, ws);
}

template <RealScalar S>
bool MassSpring<S>::holding_forces(std::span<const int> vertices, Workspace& ws,
                                   Eigen::Ref<Points<Scalar>> forces) const {
  if (!fits(ws) || !(Scalar(0) < ws.dt)) return false;
  if (static_cast<Index>(vertices.size()) != forces.cols()) return false;
  for (const int i : vertices) {
    if (i < 0 || i >= vertex_count()) return false;
  }
  if (ws.linear) {
    detail::as_points(ws.rhs) = ws.velocity;
    ws.matrix.multiply(ws.rhs, ws.product);
  }
  for (std::size_t j = 0; j < vertices.size(); ++j) {
    const Index i = vertices[j];
    const detail::Triple<Scalar> g = detail::column(ws.gradient, i);
    detail::Triple<Scalar> force = g / ws.dt;
    if (ws.linear) {
      const detail::Triple<Scalar> before = detail::column(ws.trial, i) * network_.mass[i];
      force = (detail::point(ws.product, i) - before) / ws.dt - g;
    }
    forces(0, static_cast<Index>(j)) = force.x;
    forces(1, static_cast<Index>(j)) = force.y;
    forces(2, static_cast<Index>(j)) = force.z;
  }
  return true;
}

template <RealScalar S>
StepStatus MassSpring<S>::factorize_step(const State& state, Workspace& ws) const {
  const Index n = vertex_count();
  if (!fits(ws) || !ws.advanced || settings_.linear_solver != LinearSolver::Factor)
    return StepStatus::InvalidWorkspace;
  if (state.positions.cols() != n || state.velocities.cols() != n) return StepStatus::InvalidState;
  if (ws.linear) {
    if (!ws.factor_is_current) {
      ws.factor_changes.clear();
      ws.factor_is_current = ws.factor.factorize(ws.matrix, ws.held);
    }
    return ws.factor_is_current ? StepStatus::Converged : StepStatus::NumericalFailure;
  }
  for (const Scalar& compression : {Scalar(1), Scalar(0)}) {
    if (solver(state, ws.dt, ws).factorize_at(state.positions, compression))
      return StepStatus::Converged;
  }
  return StepStatus::NumericalFailure;
}

template <RealScalar S>
auto MassSpring<S>::step_from(const PointsView<Scalar>& guess, int newton_steps, State& state,
                              const ClothInput<Scalar>& input, Scalar dt, Workspace& ws,
                              Scalar step_tolerance) const -> StepReport<Scalar> {
  const StepStatus refused = refuse(state, input, dt, ws);
  if (refused != StepStatus::Converged) return {refused, false, Scalar(0), 0};
  if (guess.cols() != vertex_count() || !all_finite(guess))
    return {StepStatus::InvalidInput, false, Scalar(0), 0};
  prepare(state, input, dt, ws);
  for (Index i = 0; i < vertex_count(); ++i) {
    if (!ws.is_held(i)) detail::set_column(ws.velocity, i, detail::column(guess, i));
  }
  const detail::NewtonLimits<Scalar> limits{velocity_tolerance(), newton_steps, Scalar(0),
                                            step_tolerance};
  return finish(state, input, dt, solver(state, dt, ws).newton_from_guess(limits), ws);
}

template <RealScalar S>
bool MassSpring<S>::fits(const Workspace& ws) const {
  return ws.structure == structure_ && ws.fits(network_, pattern_.matrix(), air_count());
}

template <RealScalar S>
StepStatus MassSpring<S>::refuse(const State& state, const ClothInput<Scalar>& input, Scalar dt,
                                 Workspace& ws) const {
  if (!fits(ws)) return StepStatus::InvalidWorkspace;
  return detail::check_step(state, input, dt, vertex_count(), ws.held);
}

template <RealScalar S>
auto MassSpring<S>::finish(State& state, const ClothInput<Scalar>& input, Scalar dt,
                           StepReport<Scalar> report, Workspace& ws) const -> StepReport<Scalar> {
  if (report.status != StepStatus::Converged && report.status != StepStatus::IterationLimit)
    return report;
  detail::move_along(state.positions, dt, ws.velocity, ws.position);
  for (int v : settings_.pinned)
    detail::set_column(ws.position, v, detail::column(state.positions, v));
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
    detail::set_column(ws.position, input.driven_vertices[i],  // exact, not x + h v
                       detail::column(input.driven_positions, static_cast<Index>(i)));
  }
  if (!all_finite(ws.velocity) || !all_finite(ws.position)) {
    return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
  }
  state.velocities = ws.velocity;
  state.positions = ws.position;
  for (Index i = 0; ws.kept < Scalar(1) && i < vertex_count(); ++i) {
    if (ws.is_held(i)) continue;
    const detail::Triple<Scalar> v = detail::column(ws.velocity, i) - ws.drift;
    detail::set_column(state.velocities, i, ws.drift + v * ws.kept);
  }
  report.advanced = ws.advanced = true;
  return report;
}

template <RealScalar S>
MassSpring<S>::MassSpring(SpringNetwork<Scalar> network, MassSpringSettings<Scalar> settings)
    : network_(std::move(network)),
      settings_(std::move(settings)),
      pattern_(network_, detail::BendingBlocks::All, settings_.air.enabled()),
      tree_(settings_.linear_solver == LinearSolver::Factor
                ? nested_dissection<Scalar>(pattern_.matrix(), network_.rest_positions)
                : EliminationTree()) {
  for (const Spring<Scalar>& s : network_.springs) total_stiffness_ += s.stiffness;
  structure_ = detail::hash_structure(pattern_.matrix(), tree_, network_);
}

template <RealScalar S>
void MassSpring<S>::prepare(const State& state, const ClothInput<Scalar>& input, Scalar dt,
                            Workspace& ws) const {
  const Points<Scalar>& x = state.positions;
  for (int v : settings_.pinned) ws.held[static_cast<std::size_t>(v)] = 1;
  detail::spring_directions<Scalar>(network_, x, ws.direction);
  const detail::Triple<Scalar> g = detail::triple(settings_.gravity);
  for (Index i = 0; i < vertex_count(); ++i) detail::set_column(ws.outer, i, g * network_.mass[i]);
  for (std::size_t i = 0; i < input.force_vertices.size(); ++i)
    detail::add_to_column(ws.outer, input.force_vertices[i],
                          detail::column(input.forces, static_cast<Index>(i)));
  detail::freeze_air<Scalar>(network_, x, state.velocities, input.wind, settings_.air, ws.air,
                             ws.outer);
  for (Index i = 0; ws.expects && i < vertex_count(); ++i) {
    if (!ws.is_held(i)) detail::add_to_column(ws.outer, i, detail::column(ws.expected, i) / dt);
  }
  ws.holds_expected = ws.expects;
  ws.dt = dt;
  ws.advanced = false;
  ws.kept = Scalar(1);
  ws.frozen.set_zero();
  pattern_.add_bending(network_, x, dt * dt, ws.frozen);
  pattern_.add_frozen(network_, ws.direction, ws.air, dt, ws.frozen);
  const Scalar inertia = Scalar(1) + dt * settings_.drag;
  for (Index i = 0; i < vertex_count(); ++i) {
    detail::add_to_diagonal(ws.frozen.diagonal(i), Scalar(inertia * network_.mass[i]));
  }
  ws.attachments.load(input, [&](int v) { return ws.is_held(v); });
  for (const auto& item : ws.attachments.items)
    detail::add_to_diagonal(ws.frozen.diagonal(item.vertex), Scalar(dt * dt * item.stiffness));
  ws.velocity = state.velocities;
  const detail::Triple<Scalar> zero{Scalar(0), Scalar(0), Scalar(0)};
  for (int v : settings_.pinned) detail::set_column(ws.velocity, v, zero);
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
    const int v = input.driven_vertices[i];
    const detail::Triple<Scalar> end =
        detail::column(input.driven_positions, static_cast<Index>(i));
    detail::set_column(ws.velocity, v, (end - detail::column(x, v)) / dt);
  }
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class MassSpring<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
