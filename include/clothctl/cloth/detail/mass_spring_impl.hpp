#pragma once

// Members of MassSpring (clothctl/cloth/mass_spring.hpp).

#include "clothctl/cloth/mass_spring.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

template <RealScalar S>
auto MassSpring<S>::create(SpringNetwork<Scalar> network, MassSpringSettings<Scalar> settings)
    -> Result<MassSpring> {
  std::string problem = network.validate();
  if (problem.empty()) problem = settings.validate();
  for (int v : settings.pinned) {
    if (problem.empty() && (v < 0 || v >= network.vertex_count()))
      problem = "pinned vertex " + std::to_string(v) + " is off the mesh";
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
auto MassSpring<S>::make_workspace() const -> Workspace {
  const Index n = vertex_count();
  Workspace ws;
  ws.structure = structure_;
  ws.matrix = pattern_.matrix();
  ws.frozen = pattern_.matrix();
  ws.factor = BlockCholesky<Scalar>(pattern_.matrix(), tree_);
  ws.held.assign(static_cast<std::size_t>(n), 0);
  ws.direction.setZero(3, static_cast<Index>(network_.springs.size()));
  for (Points<Scalar>* p : {&ws.outer, &ws.velocity, &ws.trial, &ws.position, &ws.gradient})
    p->setZero(3, n);
  ws.air.assign(air() ? network_.triangles.size() : 0, Matrix3<Scalar>::Zero());
  ws.rhs.setZero(1, 3 * n);
  ws.product.setZero(1, 3 * n);
  return ws;
}

template <RealScalar S>
std::string MassSpring<S>::check_input(const State& state, const ClothInput<Scalar>& input,
                                       Scalar dt, const Workspace& ws) const {
  if (!fits(ws)) return detail::foreign_workspace_line();
  return check_step_input(state, input, dt, vertex_count());
}

template <RealScalar S>
auto MassSpring<S>::step(State& state, const ClothInput<Scalar>& input, Scalar dt,
                         Workspace& ws) const -> StepReport<Scalar> {
  const StepStatus refused = refuse(state, input, dt, ws);
  if (refused != StepStatus::Converged) return {refused, false, Scalar(0), 0};
  prepare(state, input, dt, ws);
  StepReport<Scalar> report = solve_linear(state, dt, ws);
  if (report.status == StepStatus::Converged && settings_.integration == Integration::Newton) {
    report =
        iterate(state, dt, settings_.max_iterations, report.iterations, Scalar(1), Scalar(0), ws);
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
    as_points(ws.rhs) = ws.velocity;
    ws.matrix.multiply(ws.rhs, ws.product);
  }
  for (std::size_t j = 0; j < vertices.size(); ++j) {
    const Index i = vertices[j];
    const detail::Triple<Scalar> g = detail::column(ws.gradient, i);
    detail::Triple<Scalar> force = g / ws.dt;
    if (ws.linear) {
      const detail::Triple<Scalar> before = detail::column(ws.trial, i) * network_.mass[i];
      force = (point(ws.product, i) - before) / ws.dt - g;
    }
    forces(0, static_cast<Index>(j)) = force.x;
    forces(1, static_cast<Index>(j)) = force.y;
    forces(2, static_cast<Index>(j)) = force.z;
  }
  return true;
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
    if (!held(ws, i)) detail::set_column(ws.velocity, i, detail::column(guess, i));
  }
  return finish(state, input, dt,
                iterate(state, dt, newton_steps, 0, Scalar(0), step_tolerance, ws), ws);
}

template <RealScalar S>
bool MassSpring<S>::fits(const Workspace& ws) const {
  const Index n = vertex_count();
  bool good = ws.structure == structure_;
  for (const BlockSymmetric<Scalar>* m : {&ws.matrix, &ws.frozen})
    good = good && m->rows() == n && m->lower_count() == pattern_.matrix().lower_count();
  for (const Points<Scalar>* p : {&ws.outer, &ws.velocity, &ws.trial, &ws.position, &ws.gradient})
    good = good && p->cols() == n;
  return good && ws.direction.cols() == static_cast<Index>(network_.springs.size()) &&
         ws.air.size() == (air() ? network_.triangles.size() : 0) && ws.rhs.cols() == 3 * n &&
         ws.product.cols() == 3 * n;
}

template <RealScalar S>
StepStatus MassSpring<S>::refuse(const State& state, const ClothInput<Scalar>& input, Scalar dt,
                                 Workspace& ws) const {
  if (!fits(ws)) return StepStatus::InvalidWorkspace;
  return detail::check_step(state, input, dt, vertex_count(), ws.held);
}

template <RealScalar S>
auto MassSpring<S>::structure_hash() const -> std::uint64_t {
  detail::StructureHash hash;
  hash.add(vertex_count());
  for (Index i = 0; i < vertex_count(); ++i) hash.add(pattern_.matrix().row_begin(i));
  for (Index slot = 0; slot < pattern_.matrix().lower_count(); ++slot)
    hash.add(pattern_.matrix().column(slot));
  for (const std::vector<int>* list : {&tree_.permutation, &tree_.node_begin, &tree_.parent}) {
    for (const int value : *list) hash.add(value);
  }
  return hash.value;
}

template <RealScalar S>
auto MassSpring<S>::finish(State& state, const ClothInput<Scalar>& input, Scalar dt,
                           StepReport<Scalar> report, Workspace& ws) const -> StepReport<Scalar> {
  if (report.status != StepStatus::Converged && report.status != StepStatus::IterationLimit)
    return report;
  add_scaled(state.positions, dt, ws.velocity, ws.position);
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
  report.advanced = true;
  return report;
}

template <RealScalar S>
MassSpring<S>::MassSpring(SpringNetwork<Scalar> network, MassSpringSettings<Scalar> settings)
    : network_(std::move(network)),
      settings_(std::move(settings)),
      pattern_(network_, true, settings_.air.enabled()),
      tree_(nested_dissection<Scalar>(pattern_.matrix(), network_.rest_positions)) {
  for (const Spring<Scalar>& s : network_.springs) total_stiffness_ += s.stiffness;
  structure_ = structure_hash();
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
  ws.dt = dt;
  ws.frozen.set_zero();
  pattern_.add_bending(network_, dt * dt, ws.frozen);
  pattern_.add_frozen(network_, ws.direction, ws.air, dt, ws.frozen);
  const Scalar inertia = Scalar(1) + dt * settings_.drag;
  for (Index i = 0; i < vertex_count(); ++i) {
    detail::add_to_diagonal(ws.frozen.diagonal(i), Scalar(inertia * network_.mass[i]));
  }
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

template <RealScalar S>
bool MassSpring<S>::factorize(const Points<Scalar>& x, Scalar dt, Scalar compression,
                              Workspace& ws) const {
  StiffnessScale<Scalar> scale;
  scale.compression = compression;
  ws.matrix = ws.frozen;
  pattern_.add_springs(network_, x, scale, dt * dt, ws.matrix);
  return ws.factor.factorize(ws.matrix, ws.held);
}

template <RealScalar S>
auto MassSpring<S>::solve_linear(const State& state, Scalar dt, Workspace& ws) const
    -> StepReport<Scalar> {
  if (!factorize(state.positions, dt, Scalar(0), ws))
    return {StepStatus::NumericalFailure, false, Scalar(0), 1};
  ws.gradient = ws.outer;
  detail::add_spring_forces<Scalar>(network_, state.positions, ws.gradient);
  as_points(ws.rhs) = ws.velocity;
  ws.matrix.multiply(ws.rhs, ws.product);
  for (Index i = 0; i < vertex_count(); ++i) {
    if (held(ws, i)) {
      set_point(ws.rhs, i, {Scalar(0), Scalar(0), Scalar(0)});
    } else {
      set_point(ws.rhs, i,
                detail::column(state.velocities, i) * network_.mass[i] +
                    detail::column(ws.gradient, i) * dt - point(ws.product, i));
    }
  }
  ws.factor.template solve<1>(ws.rhs);
  add_scaled(ws.velocity, Scalar(1), ws.rhs, ws.velocity);
  ws.trial = state.velocities;  // for holding_forces
  ws.linear = true;
  return {StepStatus::Converged, false, Scalar(0), 1};
}

template <RealScalar S>
auto MassSpring<S>::iterate(const State& state, Scalar dt, int max_iterations, int solves,
                            Scalar compression, Scalar step_tolerance, Workspace& ws) const
    -> StepReport<Scalar> {
  const Scalar epsilon = scalar_traits<Scalar>::epsilon();
  StepReport<Scalar> report{StepStatus::IterationLimit, false, Scalar(0), solves};
  ws.linear = false;
  const Scalar tolerance = velocity_tolerance();
  Energy energy = objective(state, ws.velocity, dt, ws);
  const bool projected = !(Scalar(0) < compression);
  bool small_step = false;  // the last step was full and shorter than the tolerance
  bool enough = false;      // the last step was shorter than step_tolerance
  for (int iteration = 0; iteration <= max_iterations; ++iteration) {
    const Scalar last = report.residual;
    const bool converged = load_residual(tolerance, report.residual, ws) ||
                           (small_step && !(report.residual < Scalar(0.5) * last));
    if (!is_finite(report.residual) || !is_finite(energy.value)) {
      return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
    }
    if (converged) report.status = StepStatus::Converged;
    if (converged || enough || iteration == max_iterations) break;
    while (!factorize(ws.position, dt, compression, ws)) {
      if (!(Scalar(0) < compression))
        return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
      compression = Scalar(0.25) < compression ? Scalar(0.5) * compression : Scalar(0);
    }
    ws.factor.template solve<1>(ws.rhs);
    ++report.iterations;
    if (!projected && iteration % 3 == 2)
      compression = (std::min)(Scalar(1), (std::max)(Scalar(0.25), Scalar(2) * compression));
    const Scalar slope = as_points(ws.rhs).cwiseProduct(ws.gradient).sum();  // negative: A is SPD
    const Scalar noise = Scalar(4) * epsilon * energy.size;
    const auto descends = [&](Scalar length) {
      add_scaled(ws.velocity, length, ws.rhs, ws.trial);
      const Energy next = objective(state, ws.trial, dt, ws);
      if (!(next.value < energy.value + Scalar(1e-4) * length * slope + noise)) return false;
      energy = next;
      return true;
    };
    Scalar length = Scalar(1);
    int halvings = 0;
    while (halvings < kMaxHalvings && !descends(length)) {
      length *= Scalar(0.5);
      ++halvings;
    }
    if (halvings == kMaxHalvings) break;  // rounding hides any descent
    const Scalar change = largest_entry(ws.rhs);
    small_step = halvings == 0 && change < tolerance;
    enough = length * change < step_tolerance;
    ws.velocity.swap(ws.trial);
  }
  return report;
}

template <RealScalar S>
auto MassSpring<S>::objective(const State& state, const Points<Scalar>& v, Scalar dt,
                              Workspace& ws) const -> Energy {
  using std::sqrt;
  using Triple = detail::Triple<Scalar>;
  const Scalar half = Scalar(0.5);
  const Scalar drag = dt * settings_.drag;
  add_scaled(state.positions, dt, v, ws.position);
  ws.gradient = ws.outer;
  Scalar energy = detail::add_spring_forces<Scalar>(network_, ws.position, ws.gradient);
  // The rounding error of a position is ε |x|, that of a spring's energy k |l - l0| ε |x|. Their
  // sum is at most √(2 U Σk) ε |x|.
  Scalar size = sqrt(Scalar(2) * energy * total_stiffness_) * largest_entry(ws.position);
  Scalar work = Scalar(0);
  for (Index i = 0; i < vertex_count(); ++i) {
    const Triple vi = detail::column(v, i);
    const Triple dv = vi - detail::column(state.velocities, i);
    const Scalar m = network_.mass[i];
    detail::set_column(ws.gradient, i, (dv + vi * drag) * m - detail::column(ws.gradient, i) * dt);
    if (held(ws, i)) continue;  // its part of the energy is constant
    const Scalar gain = dt * detail::dot(detail::column(ws.outer, i), vi);
    energy += half * m * (detail::squared_norm(dv) + drag * detail::squared_norm(vi));
    work += gain;
    size += gain < Scalar(0) ? -gain : gain;
  }
  for (std::size_t e = 0; e < network_.springs.size(); ++e) {
    const Spring<Scalar>& s = network_.springs[e];
    if (!(Scalar(0) < s.damping)) continue;
    const Index k = static_cast<Index>(e);
    const Triple direction = detail::column(ws.direction, k);
    const Scalar rate = detail::dot(direction, detail::column(v, s.a) - detail::column(v, s.b));
    const Triple push = direction * (dt * s.damping * rate);
    energy += half * dt * s.damping * rate * rate;
    detail::add_to_column(ws.gradient, s.a, push);
    detail::subtract_from_column(ws.gradient, s.b, push);
  }
  const Scalar third = Scalar(1) / Scalar(3);
  for (std::size_t e = 0; e < ws.air.size(); ++e) {
    const std::array<int, 3>& t = network_.triangles[e];
    const Triple mean =
        (detail::column(v, t[0]) + detail::column(v, t[1]) + detail::column(v, t[2])) * third;
    const Triple push = detail::product(ws.air[e], mean);
    energy += half * dt * detail::dot(mean, push);
    for (int vertex : t) detail::add_to_column(ws.gradient, vertex, push * (dt * third));
  }
  return {energy - work, energy + size};
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class MassSpring<double>);

}  // namespace clothctl::inline CLOTHCTL_ABI
