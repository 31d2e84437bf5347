#pragma once

// Position-based sheet: positions are predicted, then corrected by one constraint after the other.
// A step dt is divided into equal substeps h. With a = g + f/m constant over the step and w = 1/m,
// each substep has four parts:
//
//   air      acts on v (detail/air_forces.hpp)
//   predict  p = x + h v⁺,  v⁺ = (θ v + h a)/(1 + h α),  v = (x - x_start)/h with x_start the
//            position at the start of the substep before. Driven vertices (w = 0) move on a
//            straight line to their prescribed position; pinned ones stay
//   correct  sweeps over the springs (detail/edge_rules.hpp), triangle elements
//            (detail/triangle_constraints.hpp), bending stencils (detail/bend_batches.hpp) and
//            attachments (detail/attachments.hpp)
//   update   x = p
//
// x positions, p corrected positions, v velocities, g gravity, f input forces, m masses, α drag.
// Two schemes:
//
// Verlet ([Toh 2011], eq. 1-4): θ = 1 - d with the damping d; without drag
// p = x + (1 - d)(x - x_old) + a h². The distances are rigid; constraints are corrected in the
// order of the network; elements and attachments are compliant. XPBD: θ = 1; a spring has the
// compliance 1/k and its damper, a stencil the compliance 1/kb. Drag also slows the motion that
// constraints cause, so the compliant constraints use the inverse mass w/(1 + h α). With many
// sweeps a substep converges to one of implicit Euler, (1 + h α) M v⁺ = M v + h f(x⁺, v⁺). With
// few, the sheet is softer than its network.
//
// A limit of stretch (XPBD) needs other sweeps: detail/limited_sweeps.hpp.
//
// A network that is a grid is laid out in vector lanes (detail/lane_grid.hpp), any other in batches
// (detail/edge_batches.hpp). References: [Toh 2011], ch. 2.3; Macklin, Müller, Chentanez, "XPBD",
// 2016; Macklin et al., "Small steps", 2019.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/carried_vertices.hpp"
#include "clothctl/cloth/detail/air_forces.hpp"
#include "clothctl/cloth/detail/attachments.hpp"
#include "clothctl/cloth/detail/batch_sheet.hpp"
#include "clothctl/cloth/detail/held_impulses.hpp"
#include "clothctl/cloth/detail/lane_sheet.hpp"
#include "clothctl/cloth/detail/limited_sweeps.hpp"
#include "clothctl/cloth/detail/plain_sweeps.hpp"
#include "clothctl/cloth/detail/position_based_workspace.hpp"
#include "clothctl/cloth/detail/position_contacts.hpp"
#include "clothctl/cloth/detail/slow_motion.hpp"
#include "clothctl/cloth/detail/step_input.hpp"
#include "clothctl/cloth/position_based_settings.hpp"
#include "clothctl/concepts/executor.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/step_input.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

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

  /// Makes the memory of a step of this model, with room for a number of contacts. Allocates.
  Workspace make_workspace(Index contacts = 0) const;

  /// Returns why `step` would refuse these arguments: one line that names the item, its index and
  /// the bad value. Returns an empty string when they are good. Allocates. Complexity: O(vertices).
  std::string check_input(const State& state, const ClothInput<Scalar>& input, Scalar dt,
                          const Workspace& ws) const;

  /// Advances `state` by `dt` (s) under `input`. The iterations of the report are sweeps. Without a
  /// limit of stretch the residual is 0, since no equation is solved to a tolerance. With one, it
  /// is the largest stretch (length over rest length, minus 1) that the last sweep met, and the
  /// status is IterationLimit when that is above the limit. Never allocates. Fails when: see
  /// StepStatus; the state is then bitwise unchanged, and `check_input` says why. Complexity:
  /// O(substeps × iterations × constraints).
  [[nodiscard]] StepReport<Scalar> step(State& state, const ClothInput<Scalar>& input, Scalar dt,
                                        Workspace& ws) const {
    return step_with({}, nullptr, state, input, dt, ws);
  }

  /// The same with the threads of `executor`, and the same bits. Parts of the sheet run at the same
  /// time: 2, 4, 8 or 16 from 3,000, 6,000, 12,000 or 24,000 vertices on; on a grid in lanes, bands
  /// of at least 64 columns along its shorter side. Verlet, the air and the set-up of a step run on
  /// the calling thread.
  template <Executor E>
  [[nodiscard]] StepReport<Scalar> step(State& state, const ClothInput<Scalar>& input, Scalar dt,
                                        Workspace& ws, E& executor) const {
    return step_with(ExecutorRef(executor), nullptr, state, input, dt, ws);
  }

  /// A step with contacts that were listed for `state` and `dt`: each substep ends with them
  /// (detail/position_contacts.hpp). Writes their impulses, states and report. `ws` must have room
  /// for them. InvalidInput: another step length than theirs, or a vertex off the mesh.
  /// InvalidWorkspace: no room. NumericalFailure: the contacts are forgotten.
  [[nodiscard]] StepReport<Scalar> step(State& state, const ClothInput<Scalar>& input,
                                        ObstacleContacts<Scalar>& contacts, Scalar dt,
                                        Workspace& ws) const {
    return step_with({}, &contacts, state, input, dt, ws);
  }
  /// The same with the threads of `executor`; the contacts run on the calling thread.
  template <Executor E>
  [[nodiscard]] StepReport<Scalar> step(State& state, const ClothInput<Scalar>& input,
                                        ObstacleContacts<Scalar>& contacts, Scalar dt,
                                        Workspace& ws, E& executor) const {
    return step_with(ExecutorRef(executor), &contacts, state, input, dt, ws);
  }

 private:
  using Triple = detail::Triple<Scalar>;

  /// True when the sizes are those of this model; a step reads only what it has written.
  bool fits(const Workspace& ws) const;

  PositionBased(SpringNetwork<Scalar> network, PositionBasedSettings<Scalar> settings);

  /// Contacts may be null.
  using Contacts = ObstacleContacts<Scalar>;
  StepReport<Scalar> step_with(const ExecutorRef& executor, Contacts* contacts, State& state,
                               const ClothInput<Scalar>& input, Scalar dt, Workspace& ws) const;

  /// A step on one of the two layouts.
  template <class Sheet>
  StepReport<Scalar> advance(const Sheet& sheet, typename Sheet::Scratch& memory,
                             Contacts* contacts, State& state, const ClothInput<Scalar>& input,
                             const Scalar& dt, Workspace& ws) const;

  /// Copies the state and computes what is constant over the step.
  template <class Sheet>
  void load(const Sheet& sheet, typename Sheet::Scratch& memory, const State& state,
            const ClothInput<Scalar>& input, const Scalar& h, Workspace& ws) const;

  /// Lets the air act on the velocities, i.e. on the positions at the start of the substep before.
  template <class Sheet>
  void blow(const Sheet& sheet, typename Sheet::Scratch& memory, const ClothInput<Scalar>& input,
            const Scalar& h, Workspace& ws) const;

  template <class Sheet>
  void predict(const Sheet& sheet, typename Sheet::Scratch& memory, const State& state,
               const ClothInput<Scalar>& input, int part, const Scalar& h, Workspace& ws) const;

  /// Corrects the points of substep `part`, from 1 on.
  template <class Sheet, class Touching>
  void correct(const Sheet& sheet, typename Sheet::Scratch& memory, Touching& touching, int part,
               const Scalar& h, Workspace& ws, StepReport<Scalar>& report) const;
  /// Its sweeps. `touch()` corrects the points of contact. Returns the share of the last sweeps
  /// that has no effect on velocities.
  template <class Sheet, class Touch, class Lift>
  Scalar sweep(const Sheet& sheet, typename Sheet::Scratch& memory, int part, const Scalar& h,
               Touch touch, Lift lift, Workspace& ws, StepReport<Scalar>& report) const;
  bool limited() const { return Scalar(0) < settings_.stretch_limit; }
  static Index carried_count(const Workspace& ws) {
    return static_cast<Index>(ws.carried.vertices.size());
  }

  SpringNetwork<Scalar> network_;
  PositionBasedSettings<Scalar> settings_;
  VectorX<Scalar> inverse_mass_;
  bool in_lanes_ = false;
  detail::LaneSheet<Scalar> lanes_;
  detail::BatchSheet<Scalar> batches_;
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
auto PositionBased<S>::make_workspace(Index contacts) const -> Workspace {
  const Index n = vertex_count();
  Workspace ws;
  ws.contacts.reserve(static_cast<std::size_t>(contacts));
  ws.driven.assign(static_cast<std::size_t>(n), 0);
  ws.held.reserve(static_cast<std::size_t>(n));
  ws.held_impulses.reserve(static_cast<std::size_t>(n));
  ws.carried.vertices.reserve(static_cast<std::size_t>(n));
  ws.carried.velocities.setZero(3, n);
  ws.carried.impulses.setZero(3, n);
  ws.attachments.reserve(n);
  ws.inverse_mass = inverse_mass_;
  for (Points<Scalar>* points : {&ws.positions, &ws.velocities}) points->setZero(3, n);
  if (in_lanes_) {
    ws.lanes = lanes_.make_scratch();
    ws.lanes.held.reserve(static_cast<std::size_t>(n));
  } else {
    ws.batches = batches_.make_scratch();
  }
  return ws;
}

template <RealScalar S>
std::string PositionBased<S>::check_input(const State& state, const ClothInput<Scalar>& input,
                                          Scalar dt, const Workspace& ws) const {
  if (!fits(ws)) return detail::foreign_workspace_line();
  return check_step_input(state, input, dt, vertex_count());
}

template <RealScalar S>
auto PositionBased<S>::step_with(const ExecutorRef& executor, Contacts* contacts, State& state,
                                 const ClothInput<Scalar>& input, Scalar dt, Workspace& ws) const
    -> StepReport<Scalar> {
  ws.lanes.executor = ws.batches.executor = executor;
  StepReport<Scalar> report;
  report.status = fits(ws) ? detail::check_step(state, input, dt, vertex_count(), ws.driven)
                           : StepStatus::InvalidWorkspace;
  if (report.status == StepStatus::Converged &&
      !detail::mark_carried(ws.carried, settings_.pinned, ws.driven))
    report.status = StepStatus::InvalidInput;
  if (report.status == StepStatus::Converged && contacts != nullptr)
    report.status = detail::check_contacts(*contacts, dt, vertex_count(), ws.contacts.capacity());
  if (report.status != StepStatus::Converged) return report;
  return in_lanes_ ? advance(lanes_, ws.lanes, contacts, state, input, dt, ws)
                   : advance(batches_, ws.batches, contacts, state, input, dt, ws);
}

template <RealScalar S>
bool PositionBased<S>::fits(const Workspace& ws) const {
  const Index n = vertex_count();
  return ws.inverse_mass.size() == n && ws.positions.cols() == n && ws.velocities.cols() == n &&
         ws.driven.size() == static_cast<std::size_t>(n) &&
         ws.held.capacity() >= static_cast<std::size_t>(n) &&
         ws.held_impulses.capacity() >= static_cast<std::size_t>(n) &&
         ws.carried.velocities.cols() == n && ws.carried.impulses.cols() == n &&
         ws.attachments.fits(n) && (in_lanes_ ? lanes_.fits(ws.lanes) : batches_.fits(ws.batches));
}

template <RealScalar S>
PositionBased<S>::PositionBased(SpringNetwork<Scalar> network,
                                PositionBasedSettings<Scalar> settings)
    : network_(std::move(network)), settings_(std::move(settings)), inverse_mass_(network_.mass) {
  for (Index i = 0; i < inverse_mass_.size(); ++i) inverse_mass_[i] = Scalar(1) / inverse_mass_[i];
  const bool verlet = settings_.scheme == PositionScheme::Verlet;
  if (!verlet) {
    const auto grid = network_.elements.empty() ? detail::find_grid(network_) : std::nullopt;
    bool regular = true;
    if constexpr (detail::HasLevels<Scalar>)
      regular = grid && (!limited() || detail::is_regular(network_, *grid));
    if (grid && regular) {
      in_lanes_ = true;
      lanes_ = detail::LaneSheet<Scalar>(network_, *grid, limited());
      return;
    }
  }
  detail::BatchSheetSetup<Scalar> setup;
  setup.rigid = verlet;
  setup.relaxation = settings_.spring_relaxation;
  setup.bend_relaxation = settings_.bend_relaxation;
  setup.listed_order = verlet;
  setup.limited = limited();
  setup.tethered = settings_.pinned;
  batches_ = detail::BatchSheet<Scalar>(network_, setup);
}

template <RealScalar S>
template <class Sheet>
auto PositionBased<S>::advance(const Sheet& sheet, typename Sheet::Scratch& memory,
                               Contacts* contacts, State& state, const ClothInput<Scalar>& input,
                               const Scalar& dt, Workspace& ws) const -> StepReport<Scalar> {
  StepReport<Scalar> report;
  report.status = StepStatus::Converged;
  const Scalar h = dt / Scalar(static_cast<double>(settings_.substeps));
  load(sheet, memory, state, input, h, ws);
  const bool rests = !ws.held.empty() || (contacts != nullptr && contacts->any_closed());
  if (limited()) {
    const Vector3<Scalar> carried =
        dt * ws.carried.velocities.leftCols(carried_count(ws)).rowwise().sum();
    ws.slow = detail::slow_motion(state, input, ws.held.size(), carried, settings_.gravity, h, dt);
    ws.levels_alternate = !rests || detail::moves(ws.slow, state, ws.inverse_mass);
    detail::pull_within_limit(sheet, memory, settings_, report);
  }
  std::optional<detail::PositionContacts<Scalar, Sheet::kStride>> touching;
  if (contacts != nullptr) touching.emplace(*contacts, ws.contacts, ws.inverse_mass);
  for (int part = 1; part <= settings_.substeps; ++part) {
    if (settings_.air.enabled()) blow(sheet, memory, input, h, ws);
    predict(sheet, memory, state, input, part, h, ws);
    correct(sheet, memory, touching, part, h, ws, report);
  }
  detail::read_points(sheet, memory, h, ws.positions, ws.velocities);
  if (limited() && rests) {
    const auto calm = [&] {
      detail::calm_slow_vertices(ws.slow, state.positions, ws.positions, ws.velocities);
    };
    ws.held_impulses.account(
        calm, [&](Index v) { return detail::column(ws.velocities, v); }, network_.mass,
        ws.inverse_mass);
  }
  detail::end_held(settings_.pinned, state.positions, input, dt, ws);
  if (!all_finite(ws.positions) || !all_finite(ws.velocities)) {
    report.status = StepStatus::NumericalFailure;
    if (contacts != nullptr) contacts->clear();
    return report;
  }
  if (touching) touching->finish(contacts->report());
  state.positions = ws.positions;
  state.velocities = ws.velocities;
  report.advanced = true;
  return report;
}

template <RealScalar S>
template <class Sheet>
void PositionBased<S>::load(const Sheet& sheet, typename Sheet::Scratch& memory, const State& state,
                            const ClothInput<Scalar>& input, const Scalar& h, Workspace& ws) const {
  ws.inverse_mass = inverse_mass_;
  ws.held.clear();
  const auto hold = [&](int vertex) {
    if (!(Scalar(0) < ws.inverse_mass[vertex])) return;  // pinned and driven, or pinned twice
    ws.inverse_mass[vertex] = Scalar(0);
    ws.held.push_back(vertex);
  };
  for (int vertex : settings_.pinned) hold(vertex);
  for (int vertex : input.driven_vertices) hold(vertex);
  for (int vertex : ws.carried.vertices) hold(vertex);
  ws.held_impulses.begin(ws.carried.vertices.empty() ? ws.carried.vertices : ws.held,
                         network_.mass);
  ws.attachments.load(input, [&](int v) { return !(Scalar(0) < ws.inverse_mass[v]); });
  // Drag slows the motion that compliant constraints cause.
  const bool verlet = settings_.scheme == PositionScheme::Verlet;
  const Scalar slowing = verlet ? Scalar(1) : Scalar(1) + h * settings_.drag;
  detail::write_points(sheet, memory, state.positions, state.velocities, h);
  for (Index v = 0; v < vertex_count(); ++v) {
    const std::size_t w = sheet.offset(static_cast<int>(v)) + 3 * Sheet::kStride;
    memory.points.data()[w] = memory.start.data()[w] = ws.inverse_mass[v] / slowing;
  }
  sheet.prepare(h, limited(), ws.held, memory);
}

template <RealScalar S>
template <class Sheet>
void PositionBased<S>::blow(const Sheet& sheet, typename Sheet::Scratch& memory,
                            const ClothInput<Scalar>& input, const Scalar& h, Workspace& ws) const {
  detail::read_points(sheet, memory, h, ws.positions, ws.velocities);
  detail::apply_air_impulses(network_.triangles, ws.positions, ws.inverse_mass, input.wind, h,
                             settings_.air, ws.velocities);
  detail::write_points(sheet, memory, ws.positions, ws.velocities, h);
}

template <RealScalar S>
template <class Sheet>
void PositionBased<S>::predict(const Sheet& sheet, typename Sheet::Scratch& memory,
                               const State& state, const ClothInput<Scalar>& input, int part,
                               const Scalar& h, Workspace& ws) const {
  const bool verlet = settings_.scheme == PositionScheme::Verlet;
  const Scalar scale = Scalar(1) / (Scalar(1) + h * settings_.drag);
  const Scalar keep = verlet ? scale * (Scalar(1) - settings_.verlet_damping) : scale;
  const Scalar share = scale * h * h;
  sheet.predict(keep, Vector3<Scalar>(settings_.gravity * share), memory);
  for (std::size_t i = 0; i < input.force_vertices.size(); ++i) {
    const int vertex = input.force_vertices[i];
    Scalar* x = memory.points.data() + sheet.offset(vertex);
    const Scalar push = share * ws.inverse_mass[vertex];
    for (Index c = 0; c < 3; ++c) {
      Scalar& coordinate = x[static_cast<std::size_t>(c) * Sheet::kStride];
      coordinate = coordinate + push * input.forces(c, static_cast<Index>(i));
    }
  }
  const auto real = [](int count) { return Scalar(static_cast<double>(count)); };
  const Scalar done = real(part) / real(settings_.substeps);
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
    const int vertex = input.driven_vertices[i];
    Scalar* x = memory.points.data() + sheet.offset(vertex);
    for (Index c = 0; c < 3; ++c) {
      const Scalar begin = state.positions(c, vertex),
                   end = input.driven_positions(c, static_cast<Index>(i));
      x[static_cast<std::size_t>(c) * Sheet::kStride] =
          part == settings_.substeps ? end : begin + (end - begin) * done;
    }
  }
  detail::move_carried(sheet, memory, ws.carried, state.positions, Scalar(h * real(part)));
}

template <RealScalar S>
template <class Sheet, class Touching>
void PositionBased<S>::correct(const Sheet& sheet, typename Sheet::Scratch& memory,
                               Touching& touching, int part, const Scalar& h, Workspace& ws,
                               StepReport<Scalar>& report) const {
  const auto points = [&](int v) { return memory.points.data() + sheet.offset(v); };
  const auto start = [&](int v) { return memory.start.data() + sheet.offset(v); };
  const Scalar time = h * Scalar(static_cast<double>(part));
  if (touching) touching->begin_substep(h, time, points, start);
  Scalar pressed = Scalar(0);
  const auto touch = [&] {
    if (touching) pressed = touching->correct(points, Scalar(0));
  };
  const auto lift = [&](const Scalar& counted) {
    if (touching) touching->lift(points, counted);
  };
  const Scalar still = sweep(sheet, memory, part, h, touch, lift, ws, report);
  if (!touching) return;
  detail::with_start(sheet, memory, still, [&] {
    // Under a limit the springs come after the contacts.
    touching->settle(points, limited() ? touching->correct(points, still) : pressed, still);
  });
  touching->end_substep(points, start);
}

template <RealScalar S>
template <class Sheet, class Touch, class Lift>
S PositionBased<S>::sweep(const Sheet& sheet, typename Sheet::Scratch& memory, int part,
                          const Scalar& h, Touch touch, Lift lift, Workspace& ws,
                          StepReport<Scalar>& report) const {
  const Scalar slowing = Scalar(1) + h * settings_.drag;
  const auto attach = [&] {
    ws.attachments.correct(
        h, Sheet::kStride, [&](int v) { return memory.points.data() + sheet.offset(v); },
        [&](int v) { return Scalar(ws.inverse_mass[v] / slowing); });
    touch();
  };
  const bool verlet = settings_.scheme == PositionScheme::Verlet;
  using std::sqrt;  // h² k/(1 + h α) with w moves an element as h² k with w/(1 + h α) does
  const Scalar pace = verlet ? h / sqrt(slowing) : h;
  const auto strain = [&](detail::SweepOrder order) { sheet.sweep_triangles(pace, order, memory); };
  sheet.begin_triangles(memory);
  ws.attachments.begin_substep();
  if (limited()) {
    const auto frame = detail::substep_frame(sheet, memory, settings_, h, ws.held);
    const auto by_levels = [&] {
      detail::correct_on_levels(sheet, memory, settings_, part, ws.levels_alternate, frame);
    };
    const auto velocity = [&](Index v) {
      return detail::way_in_substep(sheet, memory, static_cast<int>(v)) / h;
    };
    ws.held_impulses.account(by_levels, velocity, network_.mass, ws.inverse_mass);
  }
  ws.held_impulses.begin_sweeps(sheet, memory);
  const int sweeps = settings_.iterations;
  Scalar still = Scalar(0);
  if (limited()) {
    still =
        detail::sweep_within_limit(sheet, memory, settings_, part, strain, attach, lift, report);
  } else {
    report.iterations += sweeps;
    if (verlet)
      detail::sweep_rigidly<Scalar>(sheet, memory, sweeps, strain, attach);
    else
      detail::sweep_compliantly<Scalar>(sheet, memory, sweeps, strain, attach);
  }
  ws.held_impulses.end_sweeps(h, sheet, memory);
  return still;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class PositionBased<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
