#pragma once

// A mass-spring body stepped by implicit Euler, h = dt, driven vertices (index h) prescribed:
//
//   one linear solve (Baraff-Witkin):  A v⁺ = M v + h ( f(x0) + f_g + f_u + C w ),              x⁺ = x0 + h v⁺
//                                      A = (1 + h α) M + h (D + C) + h² K(x0)
//   Newton to convergence:             v⁺ = argmin ½(v - v0)ᵀM(v - v0) + U(x0 + h v) - h (M g + f_u)ᵀ v
//                                           + ½ h α vᵀM v + ½ h vᵀD v + ½ h (w - v)ᵀC (w - v)
//
// D and C are frozen at the start of the step. The one solve takes K's SPD projection. A Newton step takes as much of the
// exact K as leaves A positive definite: the factor γ on its compression part (spring_forces.hpp) starts at 1, halves whenever
// the factorisation fails (0 below ¼: the projection) and doubles again after a few good steps. So every direction descends,
// and near a minimum, where the exact A is positive definite, convergence is quadratic: a sheet that buckles takes a fifth of
// the iterations of the projected method. An Armijo backtracking line search on the energy makes it globally convergent.
// Reference: Baraff & Witkin, Large Steps in Cloth Simulation (1998); paper 000, eq. 4-6.

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/mass_spring_settings.hpp"
#include "clothctl/cloth/spring_forces.hpp"
#include "clothctl/cloth/step_input.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/math/block_cholesky.hpp"
#include "clothctl/mesh/ordering.hpp"

namespace clothctl {

/// A network of masses and springs under implicit Euler; models ClothModel. Const in use: one model serves many threads.
template <RealScalar S>
class MassSpring {
 public:
  /// The scalar type.
  using Scalar = S;
  /// The state of a step.
  using State = ClothState<Scalar>;

  /// All memory of a step. Made by `make_workspace`.
  struct Workspace {
    /// The step matrix, and the part of it that a step keeps: inertia, drag, dampers, air and bending.
    BlockSymmetric<Scalar> matrix, frozen;
    /// Its factor.
    BlockCholesky<Scalar> factor;
    /// Flags of driven and pinned vertices.
    std::vector<unsigned char> held;
    /// Unit vectors of the springs at the start of the step.
    Points<Scalar> direction;
    /// Forces that stay over the step (gravity, input, C w), end velocities, trial velocities, end positions, energy gradient.
    Points<Scalar> outer, velocity, trial, position, gradient;
    /// Air matrices of the triangles, one after the other.
    std::vector<Matrix3<Scalar>> air;
    /// A right-hand side and a product.
    Lanes<Scalar, 1> rhs, product;
    /// Length of the last step, s.
    Scalar dt = Scalar(0);
    /// Whether one linear solve was all of it.
    bool linear = false;
  };

  /// Checks and keeps network and settings, and analyses the step matrix once. Allocates. Fails when: network or settings do
  /// not pass their check, or a pin is off the mesh.
  static Result<MassSpring> create(SpringNetwork<Scalar> network, MassSpringSettings<Scalar> settings = {}) {
    std::string problem = network.check();
    if (problem.empty()) problem = settings.check();
    for (int v : settings.pinned) {
      if (problem.empty() && (v < 0 || v >= network.vertex_count()))
        problem = "pinned vertex " + std::to_string(v) + " is off the mesh";
    }
    if (!problem.empty()) return Error{problem};
    return MassSpring(std::move(network), std::move(settings));
  }

  /// The masses and springs.
  const SpringNetwork<Scalar>& network() const { return network_; }
  /// The settings.
  const MassSpringSettings<Scalar>& settings() const { return settings_; }
  /// Changes how a step is solved; everything else stays.
  void set_integration(Integration integration) { settings_.integration = integration; }
  /// Changes the mass-proportional drag α (1/s), as for settling; negative or non-finite values are a caller's bug.
  void set_drag(Scalar drag) {
    assert(is_finite(drag) && !(drag < Scalar(0)));
    settings_.drag = drag;
  }
  /// Number of vertices.
  Index vertex_count() const { return network_.vertex_count(); }

  /// The undeformed body at rest. Allocates.
  State rest_state() const { return {network_.rest_positions, Points<Scalar>::Zero(3, vertex_count())}; }

  /// Makes the memory of a step. Allocates.
  Workspace make_workspace() const {
    const Index n = vertex_count();
    Workspace ws;
    ws.matrix = pattern_.matrix();
    ws.frozen = pattern_.matrix();
    ws.factor = BlockCholesky<Scalar>(pattern_.matrix(), tree_);
    ws.held.assign(static_cast<std::size_t>(n), 0);
    ws.direction.setZero(3, static_cast<Index>(network_.springs.size()));
    for (Points<Scalar>* p : {&ws.outer, &ws.velocity, &ws.trial, &ws.position, &ws.gradient}) p->setZero(3, n);
    ws.air.assign(air() ? network_.triangles.size() : 0, Matrix3<Scalar>::Zero());
    ws.rhs.setZero(1, 3 * n);
    ws.product.setZero(1, 3 * n);
    return ws;
  }

  /// Advances `state` by `dt` seconds under `input`. Never allocates. On any failure the state is left as it was.
  /// Complexity: one factorisation of the step matrix (O(n^1.5) on a sheet of n vertices) a linear solve.
  [[nodiscard]] StepReport<Scalar> step(State& state, const ClothInput<Scalar>& input, Scalar dt, Workspace& ws) const {
    const StepStatus checked = check_step(state, input, dt, vertex_count(), ws.held);
    if (checked != StepStatus::Converged) return {checked, false, Scalar(0), 0};
    prepare(state, input, dt, ws);
    StepReport<Scalar> report = solve_linear(state, dt, ws);
    if (report.status == StepStatus::Converged && settings_.integration == Integration::Newton) {
      report = iterate(state, dt, settings_.max_iterations, report.iterations, Scalar(1), Scalar(0), ws);
    }
    return finish(state, input, dt, report, ws);
  }

  /// Writes the forces that moved `vertices` (driven or pinned in the last step that ended with this workspace) as they were
  /// told to move, 3×vertices.size(), N: what a hand that holds them feels, with the sign of what it gives. Forces of the input
  /// on those vertices count as given already. As exact as the step's residual. Never allocates.
  void holding_forces(std::span<const int> vertices, Workspace& ws, Eigen::Ref<Points<Scalar>> forces) const {
    assert(static_cast<Index>(vertices.size()) == forces.cols());
    if (ws.linear) {
      as_points(ws.rhs) = ws.velocity;
      ws.matrix.multiply(ws.rhs, ws.product);
    }
    for (std::size_t j = 0; j < vertices.size(); ++j) {
      const Index i = vertices[j];
      Vector3<Scalar> force = ws.gradient.col(i) / ws.dt;
      if (ws.linear) force = (point(ws.product, i) - network_.mass[i] * ws.trial.col(i)) / ws.dt - ws.gradient.col(i);
      forces.col(static_cast<Index>(j)) = force;
    }
  }

  /// Advances `state` by at most `newton_steps` Newton steps from the end velocities `guess` (3×n, m/s), whatever the settings
  /// say, with the projected Hessian, whose first step is the tamest: for rolling a plan out again that has hardly changed.
  /// Ends sooner when a Newton step changes no coordinate of a velocity by more than `step_tolerance`, m/s. Never allocates. On
  /// any failure the state is left as it was.
  [[nodiscard]] StepReport<Scalar> step_from(const PointsView<Scalar>& guess, int newton_steps, State& state,
                                             const ClothInput<Scalar>& input, Scalar dt, Workspace& ws,
                                             Scalar step_tolerance = Scalar(0)) const {
    const StepStatus checked = check_step(state, input, dt, vertex_count(), ws.held);
    if (checked != StepStatus::Converged) return {checked, false, Scalar(0), 0};
    if (guess.cols() != vertex_count() || !all_finite(guess)) return {StepStatus::InvalidInput, false, Scalar(0), 0};
    prepare(state, input, dt, ws);
    for (Index i = 0; i < vertex_count(); ++i) {
      if (!held(ws, i)) ws.velocity.col(i) = guess.col(i);
    }
    return finish(state, input, dt, iterate(state, dt, newton_steps, 0, Scalar(0), step_tolerance, ws), ws);
  }

 private:
  static constexpr int kMaxHalvings = 30;

  /// Moves the state to the end of the step unless the solve failed.
  StepReport<Scalar> finish(State& state, const ClothInput<Scalar>& input, Scalar dt, StepReport<Scalar> report,
                            Workspace& ws) const {
    if (report.status != StepStatus::Converged && report.status != StepStatus::IterationLimit) return report;
    ws.position = state.positions + dt * ws.velocity;
    for (int v : settings_.pinned) ws.position.col(v) = state.positions.col(v);
    for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
      ws.position.col(input.driven_vertices[i]) = input.driven_positions.col(static_cast<Index>(i));  // exact, not x + h v
    }
    if (!all_finite(ws.velocity) || !all_finite(ws.position)) {
      return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
    }
    state.velocities = ws.velocity;
    state.positions = ws.position;
    report.advanced = true;
    return report;
  }

  MassSpring(SpringNetwork<Scalar> network, MassSpringSettings<Scalar> settings)
      : network_(std::move(network)),
        settings_(std::move(settings)),
        pattern_(network_, true, settings_.air.enabled()),
        tree_(nested_dissection<Scalar>(pattern_.matrix(), network_.rest_positions)) {
    for (const Spring<Scalar>& s : network_.springs) total_stiffness_ += s.stiffness;
  }

  bool air() const { return settings_.air.enabled(); }

  /// Freezes what a step keeps fixed: directions of the dampers, air matrices, outer forces, ws.frozen; ws.velocity = v with
  /// the held vertices at their prescribed velocity.
  void prepare(const State& state, const ClothInput<Scalar>& input, Scalar dt, Workspace& ws) const {
    const Points<Scalar>& x = state.positions;
    for (int v : settings_.pinned) ws.held[static_cast<std::size_t>(v)] = 1;
    spring_directions<Scalar>(network_, x, ws.direction);
    ws.outer.noalias() = settings_.gravity * network_.mass.transpose();
    for (std::size_t i = 0; i < input.force_vertices.size(); ++i) {
      ws.outer.col(input.force_vertices[i]) += input.forces.col(static_cast<Index>(i));
    }
    freeze_air<Scalar>(network_, x, state.velocities, input.wind, settings_.air, ws.air, ws.outer);
    ws.dt = dt;
    ws.frozen.set_zero();
    pattern_.add_bending(network_, dt * dt, ws.frozen);
    pattern_.add_frozen(network_, ws.direction, ws.air, dt, ws.frozen);
    const Scalar inertia = Scalar(1) + dt * settings_.drag;
    for (Index i = 0; i < vertex_count(); ++i) {
      ws.frozen.diagonal(i).diagonal().array() += inertia * network_.mass[i];
    }
    ws.velocity = state.velocities;
    for (int v : settings_.pinned) ws.velocity.col(v).setZero();
    for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
      const int v = input.driven_vertices[i];
      ws.velocity.col(v) = (input.driven_positions.col(static_cast<Index>(i)) - x.col(v)) / dt;
    }
  }

  /// Factorises A at `x`: the frozen part and h² K with the factor `compression` on its indefinite part.
  bool factorize(const Points<Scalar>& x, Scalar dt, Scalar compression, Workspace& ws) const {
    StiffnessScale<Scalar> scale;
    scale.compression = compression;
    ws.matrix = ws.frozen;
    pattern_.add_springs(network_, x, scale, dt * dt, ws.matrix);
    return ws.factor.factorize(ws.matrix, ws.held);
  }

  /// One linear solve: A (v⁺ - v̂) = M v + h f - A v̂ on the free rows, v̂ the start velocity with held rows prescribed.
  StepReport<Scalar> solve_linear(const State& state, Scalar dt, Workspace& ws) const {
    if (!factorize(state.positions, dt, Scalar(0), ws)) return {StepStatus::NumericalFailure, false, Scalar(0), 1};
    ws.gradient = ws.outer;
    add_spring_forces<Scalar>(network_, state.positions, ws.gradient);
    as_points(ws.rhs) = ws.velocity;
    ws.matrix.multiply(ws.rhs, ws.product);
    for (Index i = 0; i < vertex_count(); ++i) {
      if (held(ws, i)) {
        point(ws.rhs, i).setZero();
      } else {
        point(ws.rhs, i) = network_.mass[i] * state.velocities.col(i) + dt * ws.gradient.col(i) - point(ws.product, i);
      }
    }
    ws.factor.template solve<1>(ws.rhs);
    ws.velocity += as_points(ws.rhs);
    ws.trial = state.velocities;  // for holding_forces
    ws.linear = true;
    return {StepStatus::Converged, false, Scalar(0), 1};
  }

  /// The step's energy (kg m²/s²), and a bound on its rounding over ε.
  struct Energy {
    Scalar value, size;
  };

  /// Newton from ws.velocity, with `solves` linear solves spent before. Leaves the best velocities there. `compression` is the
  /// γ to start from; 0 stays with the projection. A shorter step than `step_tolerance` is the last.
  StepReport<Scalar> iterate(const State& state, Scalar dt, int max_iterations, int solves, Scalar compression,
                             Scalar step_tolerance, Workspace& ws) const {
    const Scalar epsilon = scalar_traits<Scalar>::epsilon();
    StepReport<Scalar> report{StepStatus::IterationLimit, false, Scalar(0), solves};
    ws.linear = false;
    const Scalar tolerance = velocity_tolerance();
    Energy energy = objective(state, ws.velocity, dt, ws);
    const bool projected = !(Scalar(0) < compression);
    bool small_step = false;  // the last step was a full one and shorter than the tolerance
    bool enough = false;      // it was shorter than step_tolerance
    for (int iteration = 0; iteration <= max_iterations; ++iteration) {
      const Scalar last = report.residual;
      const bool converged =
          load_residual(tolerance, report.residual, ws) || (small_step && !(report.residual < Scalar(0.5) * last));
      if (!is_finite(report.residual) || !is_finite(energy.value)) {
        return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
      }
      if (converged) report.status = StepStatus::Converged;
      if (converged || enough || iteration == max_iterations) break;
      while (!factorize(ws.position, dt, compression, ws)) {
        if (!(Scalar(0) < compression)) return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
        compression = Scalar(0.25) < compression ? Scalar(0.5) * compression : Scalar(0);
      }
      ws.factor.template solve<1>(ws.rhs);
      ++report.iterations;
      if (!projected && iteration % 3 == 2)
        compression = (std::min)(Scalar(1), (std::max)(Scalar(0.25), Scalar(2) * compression));
      const Scalar slope = as_points(ws.rhs).cwiseProduct(ws.gradient).sum();  // negative: A is SPD
      const Scalar noise = Scalar(4) * epsilon * energy.size;
      const auto descends = [&](Scalar length) {
        ws.trial = ws.velocity + length * as_points(ws.rhs);
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
      const Scalar change = as_points(ws.rhs).cwiseAbs().maxCoeff();
      small_step = halvings == 0 && change < tolerance;
      enough = length * change < step_tolerance;
      ws.velocity.swap(ws.trial);
    }
    return report;
  }

  Scalar velocity_tolerance() const {
    using std::cbrt;
    const Scalar given = settings_.velocity_tolerance;
    return Scalar(0) < given ? given : Scalar(2) * cbrt(scalar_traits<Scalar>::epsilon());
  }

  /// ws.rhs = minus the gradient on the free vertices; its largest entry goes to `largest`. Returns true when every vertex
  /// meets the tolerance.
  bool load_residual(Scalar tolerance, Scalar& largest, Workspace& ws) const {
    bool converged = true;
    largest = Scalar(0);
    for (Index i = 0; i < vertex_count(); ++i) {
      if (held(ws, i)) {
        point(ws.rhs, i).setZero();
        continue;
      }
      point(ws.rhs, i) = -ws.gradient.col(i);
      const Scalar size = ws.gradient.col(i).cwiseAbs().maxCoeff();
      if (largest < size) largest = size;
      if (!(size < tolerance * network_.mass[i])) converged = false;
    }
    return converged;
  }

  /// The step's energy at velocities `v`; leaves its gradient in ws.gradient and x0 + h v in ws.position. On a held vertex the
  /// gradient is the impulse that holds it.
  Energy objective(const State& state, const Points<Scalar>& v, Scalar dt, Workspace& ws) const {
    using std::sqrt;
    const Scalar half = Scalar(0.5);
    const Scalar drag = dt * settings_.drag;
    ws.position = state.positions + dt * v;
    ws.gradient = ws.outer;
    Scalar energy = add_spring_forces<Scalar>(network_, ws.position, ws.gradient);
    // Positions round by ε |x|, the energy of a spring by k |l - l0| ε |x|: summed, at most √(2 U Σk) ε |x|.
    Scalar size = sqrt(Scalar(2) * energy * total_stiffness_) * ws.position.cwiseAbs().maxCoeff();
    Scalar work = Scalar(0);
    for (Index i = 0; i < vertex_count(); ++i) {
      const Vector3<Scalar> dv = v.col(i) - state.velocities.col(i);
      const Scalar m = network_.mass[i];
      ws.gradient.col(i) = m * (dv + drag * v.col(i)) - dt * ws.gradient.col(i);
      if (held(ws, i)) continue;  // a constant part of the energy
      const Scalar gain = dt * ws.outer.col(i).dot(v.col(i));
      energy += half * m * (dv.squaredNorm() + drag * v.col(i).squaredNorm());
      work += gain;
      size += gain < Scalar(0) ? -gain : gain;
    }
    for (std::size_t e = 0; e < network_.springs.size(); ++e) {
      const Spring<Scalar>& s = network_.springs[e];
      if (!(Scalar(0) < s.damping)) continue;
      const Index k = static_cast<Index>(e);
      const Scalar rate = ws.direction.col(k).dot(v.col(s.a) - v.col(s.b));
      const Vector3<Scalar> push = ws.direction.col(k) * (dt * s.damping * rate);
      energy += half * dt * s.damping * rate * rate;
      ws.gradient.col(s.a) += push;
      ws.gradient.col(s.b) -= push;
    }
    const Scalar third = Scalar(1) / Scalar(3);
    for (std::size_t e = 0; e < ws.air.size(); ++e) {
      const std::array<int, 3>& t = network_.triangles[e];
      const Vector3<Scalar> mean = (v.col(t[0]) + v.col(t[1]) + v.col(t[2])) * third;
      const Vector3<Scalar> push = ws.air[e] * mean;
      energy += half * dt * mean.dot(push);
      for (int vertex : t) ws.gradient.col(vertex) += push * (dt * third);
    }
    return {energy - work, energy + size};
  }

  bool held(const Workspace& ws, Index i) const { return ws.held[static_cast<std::size_t>(i)] != 0; }
  static Eigen::Map<Points<Scalar>> as_points(Lanes<Scalar, 1>& row) { return {row.data(), 3, row.cols() / 3}; }
  static Eigen::Map<Vector3<Scalar>> point(Lanes<Scalar, 1>& row, Index i) {
    return Eigen::Map<Vector3<Scalar>>(row.data() + 3 * i);
  }

  SpringNetwork<Scalar> network_;
  MassSpringSettings<Scalar> settings_;
  SpringPattern<Scalar> pattern_;
  EliminationTree tree_;
  Scalar total_stiffness_ = Scalar(0);
};

}  // namespace clothctl
