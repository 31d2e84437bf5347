#pragma once

// The step of a mass-spring sheet for predictions: a quasi-Newton step in single precision where
// MassSpring takes Newton steps in double precision. With the symbols of mass_spring.hpp, from
// velocities v near those at the end of the step:
//
//   y = x0 + h v
//   g = M (v - v0) + h α M v + h D v - h ( f(y) + f_g + f_u + C (w - v) )
//   B (v⁺ - v) = -g on the free vertices,   B = (1 + h α) M + h (D + C) + h² ( K(y) + L )
//
// K is the projected stiffness of the springs. L stands for the stiffness of bending, whose blocks
// reach to the vertices after the next ones and would double the cost of the factor: it has the
// blocks of neighbours alone (BendingBlocks in detail/spring_forces.hpp). Twice L bounds the
// stiffness of bending from above, so the error of a step shrinks, but slowly where bending is
// stiff on a fine mesh. With `bending_in_matrix`, L is the stiffness of bending.
//
// D has the directions of the springs at x0, in g and in B: a damper that B turned along with its
// spring would be missing in a direction in which little but the mass resists.
//
// A full step overshoots where springs turn far. If a step moves a vertex by more than a quarter of
// the shortest spring, and the slope of the energy along it has turned from s0 < 0 to s1 > -s0, it
// is cut to s0/(s0 - s1) of its length.
//
// Under Integration::LinearlyImplicit, springs enter g and B as linearised at x0: f(x0) - h K v for
// f(y), K(x0) for K(y). With `bending_in_matrix` a single step is then the linearly implicit step
// of mass_spring.hpp (without `limit_energy`), else a few are; only hinges that are folded at rest
// are still taken at y.
//
// A coarse sheet that stands for a fine one resists compression and shear more than the fine one
// does, which wrinkles between the coarse vertices; CoarseFactors make it softer.

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/spring_batches.hpp"
#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/mass_spring_derivative.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Settings of a MassSpringRollout.
struct RolloutModelSettings {
  /// Factors for a coarse sheet.
  CoarseFactors factors = {};
  /// If true, the matrix has the stiffness of bending. Its factor then takes twice the time.
  bool bending_in_matrix = false;
  /// Largest number of quasi-Newton steps of `step`, which starts from the velocities before it.
  int first_steps = 8;
  /// Which equations a step solves.
  Integration integration = Integration::Newton;

  /// Returns an empty string, or a line that names the first bad setting and its value.
  std::string validate() const {
    if (first_steps < 1)
      return "first_steps is " + std::to_string(first_steps) + ", must be at least 1";
    return factors.validate();
  }
};

namespace detail {

/// The memory of a step of MassSpringRollout.
template <RealScalar Scalar>
struct RolloutWorkspace {
  BlockCholesky<Scalar> factor;
  BlockSymmetric<Scalar> matrix;
  Lanes<Scalar, 1> change;
  Points<Scalar> start, start_velocity, position, velocity, outer, gradient, direction;
  std::vector<Matrix3<Scalar>> air;
  std::vector<unsigned char> held;
  Scalar dt = Scalar(0);
  bool advanced = false;
  std::uint64_t structure = 0;
  Points<Scalar> lift;  // of supported vertices from where they were, at the start of the step

  bool is_held(Index i) const { return held[static_cast<std::size_t>(i)] != 0; }
};

}  // namespace detail

/// A mass-spring sheet that a RolloutPredictor simulates fast. Satisfies the concepts ClothModel
/// and ClothRollout. `S` is the scalar type of states and inputs, `Inner` that of the step.
/// Attachments of an input are refused. Reference: docs/planner.md, section 1.1.
template <RealScalar S = double, RealScalar Inner = float>
class MassSpringRollout {
 public:
  /// The scalar type of states and inputs.
  using Scalar = S;
  /// All memory of a step, made by `make_workspace`.
  using Workspace = detail::RolloutWorkspace<Inner>;

  /// Copies the network and the dynamics (gravity, drag, air, pinned vertices) of a model, but not
  /// its integration. Allocates. Fails when the settings are not valid (assert).
  template <RealScalar Other>
  explicit MassSpringRollout(const MassSpring<Other>& model, RolloutModelSettings settings = {});

  /// Returns the number of vertices.
  Index vertex_count() const { return network_.vertex_count(); }

  /// Returns the state of the undeformed body at rest. Allocates.
  ClothState<Scalar> rest_state() const;

  /// Takes what carries vertices of a sheet at `x` (3×n, m) in the steps to come, each vertex once.
  /// Their forces must come with the inputs; this makes them fall as the vertices lift, and end.
  /// Supports of vertices off the mesh, or all of them when `x` has another size, do nothing. Never
  /// allocates.
  void set_supports(std::span<const VertexSupport<Scalar>> supports, const PointsView<Scalar>& x);

  /// Makes the memory of a step of this model. Allocates.
  Workspace make_workspace() const;

  /// Advances `state` by `dt` (s) with up to `first_steps` quasi-Newton steps from its velocities;
  /// one that changes no velocity by 1 mm/s is the last. Never allocates. Fails when: see
  /// StepStatus; the state is then bitwise unchanged.
  [[nodiscard]] StepReport<Scalar> step(ClothState<Scalar>& state, const ClothInput<Scalar>& input,
                                        Scalar dt, Workspace& ws) const {
    const StepStatus refused = prepare(state, input, dt, ws);
    if (refused != StepStatus::Converged) return {refused, false, Scalar(0), 0};
    return solve(settings_.first_steps, Scalar(1e-3), state, input, dt, ws);
  }

  /// The same with at most `newton_steps` quasi-Newton steps from the end velocities `guess` (3×n,
  /// m/s). One that changes no velocity by `tolerance` (m/s) is the last.
  [[nodiscard]] StepReport<Scalar> step_from(const PointsView<Scalar>& guess, int newton_steps,
                                             ClothState<Scalar>& state,
                                             const ClothInput<Scalar>& input, Scalar dt,
                                             Workspace& ws, Scalar tolerance) const {
    StepStatus refused = prepare(state, input, dt, ws);
    if (refused == StepStatus::Converged && (guess.cols() != vertex_count() || !all_finite(guess)))
      refused = StepStatus::InvalidInput;
    if (refused != StepStatus::Converged) return {refused, false, Scalar(0), 0};
    for (Index i = 0; i < vertex_count(); ++i) {
      if (!ws.is_held(i)) ws.velocity.col(i) = guess.col(i).template cast<Inner>();
    }
    return solve(newton_steps, tolerance, state, input, dt, ws);
  }

  /// Makes the derivative of this model's steps, as if they had converged, with `driven` vertices
  /// moved in every step. Its bending has the blocks of the step's matrix, and supports are
  /// constant forces. Allocates. Fails when a vertex is off the mesh (assert).
  MassSpringDerivative<Inner> make_derivative(std::vector<int> driven) const {
    return MassSpringDerivative<Inner>({network_, drag_, air_, pinned_, pattern_, springs_, tree_},
                                       std::move(driven));
  }

  /// Writes the forces that made `vertices` follow their prescribed motion in the last step with
  /// this workspace, 3×vertices.size(), N. Never allocates. Returns false, and writes nothing, when
  /// the workspace was made by another model or its last step did not advance, a vertex is off the
  /// mesh, or `forces` has another number of columns.
  bool holding_forces(std::span<const int> vertices, Workspace& ws,
                      Eigen::Ref<Points<Scalar>> forces) const;

 private:
  /// Checks the arguments and computes what is constant over the step. Sets ws.velocity to v0, with
  /// held vertices at their prescribed velocity.
  StepStatus prepare(const ClothState<Scalar>& state, const ClothInput<Scalar>& input, Scalar dt,
                     Workspace& ws) const;

  /// Quasi-Newton steps from ws.velocity, then the end of the step.
  StepReport<Scalar> solve(int steps, Scalar tolerance, ClothState<Scalar>& state,
                           const ClothInput<Scalar>& input, Scalar dt, Workspace& ws) const;

  /// One of them. Returns the largest change of a velocity coordinate, m/s, infinite when the
  /// matrix is not definite or the change is not finite.
  Inner improve(Workspace& ws) const;

  /// Sets ws.position to y, and ws.gradient to g without the springs' part.
  void load_gradient(Workspace& ws) const;

  /// What carries a vertex.
  struct Ground {
    int vertex = 0;
    Vector3<Scalar> place = Vector3<Scalar>::Zero();
    Vector3<Inner> normal = Vector3<Inner>::Zero(), force = Vector3<Inner>::Zero();
    Inner release = Inner(0), stiffness = Inner(0);
  };
  /// Where forces and stiffness of the springs are evaluated.
  const Points<Inner>& spring_positions(const Workspace& ws) const {
    return is_linear() ? ws.start : ws.position;
  }
  bool is_linear() const { return settings_.integration == Integration::LinearlyImplicit; }
  std::span<const Ground> grounds() const { return {grounds_.data(), ground_count_}; }

  /// How far the vertex of a ground lifts off at the velocities of the workspace, m.
  static Inner lift_of(const Ground& g, const Workspace& ws) {
    const Vector3<Inner> way = ws.lift.col(g.vertex) + ws.dt * ws.velocity.col(g.vertex);
    return way.dot(g.normal);
  }

  SpringNetwork<Inner> network_;
  RolloutModelSettings settings_;
  AirSettings<Inner> air_;
  Vector3<Inner> gravity_;
  Inner drag_, longest_move_;  // m
  std::vector<int> pinned_;
  std::vector<Ground> grounds_;  // the first ground_count_ are there; copies keep the room
  std::size_t ground_count_ = 0;
  detail::SpringPattern<Inner> pattern_;
  EliminationTree tree_;
  detail::SpringBatches<Inner> springs_;
  std::uint64_t structure_ = 0;
};

template <RealScalar S, RealScalar Inner>
template <RealScalar Other>
MassSpringRollout<S, Inner>::MassSpringRollout(const MassSpring<Other>& model,
                                               RolloutModelSettings settings)
    : network_(model.network().template cast<Inner>()),
      settings_(settings),
      air_(model.settings().air.template cast<Inner>()),
      gravity_(model.settings().gravity.template cast<Inner>()),
      drag_(static_cast<Inner>(model.settings().drag) * Inner(settings.factors.drag)),
      longest_move_(Inner(0)),
      pinned_(model.settings().pinned) {
  assert(settings.validate().empty());
  const CoarseFactors& factors = settings_.factors;
  for (Spring<Inner>& s : network_.springs) {
    const bool shear = s.kind == SpringKind::Shear;
    s.stiffness = s.stiffness * Inner(shear ? factors.shear : factors.stretch);
    const Inner quarter = Inner(0.25) * s.rest_length;
    if (!(Inner(0) < longest_move_) || quarter < longest_move_) longest_move_ = quarter;
  }
  for (BendStencil<Inner>& b : network_.bends) b.stiffness = b.stiffness * Inner(factors.bending);
  pattern_ = detail::SpringPattern<Inner>(
      network_,
      settings_.bending_in_matrix ? detail::BendingBlocks::All : detail::BendingBlocks::Neighbours,
      air_.enabled());
  tree_ = nested_dissection<Inner>(pattern_.matrix(), network_.rest_positions);
  springs_ = detail::SpringBatches<Inner>(network_, pattern_.matrix(), [&](const Spring<Inner>& s) {
    return Inner(s.kind == SpringKind::Shear ? factors.compressed_shear
                                             : factors.compressed_stretch);
  });
  structure_ = detail::hash_structure(pattern_.matrix(), tree_, network_);
  grounds_.resize(static_cast<std::size_t>(vertex_count()));
}

template <RealScalar S, RealScalar Inner>
auto MassSpringRollout<S, Inner>::rest_state() const -> ClothState<Scalar> {
  return {network_.rest_positions.template cast<Scalar>(), Points<Scalar>::Zero(3, vertex_count())};
}

template <RealScalar S, RealScalar Inner>
void MassSpringRollout<S, Inner>::set_supports(std::span<const VertexSupport<Scalar>> supports,
                                               const PointsView<Scalar>& x) {
  ground_count_ = 0;
  if (x.cols() != vertex_count()) return;
  for (const VertexSupport<Scalar>& support : supports) {
    if (support.vertex < 0 || vertex_count() <= support.vertex || ground_count_ == grounds_.size())
      continue;
    Ground& g = grounds_[ground_count_++];
    g.vertex = support.vertex;
    g.place = x.col(support.vertex);
    g.normal = support.normal.template cast<Inner>();
    g.force = support.force.template cast<Inner>();
    g.release = static_cast<Inner>(support.release);
    g.stiffness = static_cast<Inner>(support.stiffness());
  }
}

template <RealScalar S, RealScalar Inner>
auto MassSpringRollout<S, Inner>::make_workspace() const -> Workspace {
  Workspace ws;
  ws.factor = BlockCholesky<Inner>(pattern_.matrix(), tree_);
  ws.matrix = pattern_.matrix();
  ws.change.setZero(1, 3 * vertex_count());
  for (Points<Inner>* p : {&ws.start, &ws.start_velocity, &ws.position, &ws.velocity, &ws.outer,
                           &ws.gradient, &ws.lift})
    p->setZero(3, vertex_count());
  ws.direction.setZero(3, springs_.direction_columns());
  ws.air.assign(air_.enabled() ? network_.triangles.size() : 0, Matrix3<Inner>::Zero());
  ws.held.assign(static_cast<std::size_t>(vertex_count()), 0);
  ws.structure = structure_;
  return ws;
}

template <RealScalar S, RealScalar Inner>
bool MassSpringRollout<S, Inner>::holding_forces(std::span<const int> vertices, Workspace& ws,
                                                 Eigen::Ref<Points<Scalar>> forces) const {
  if (ws.structure != structure_ || !ws.advanced) return false;
  if (static_cast<Index>(vertices.size()) != forces.cols()) return false;
  for (const int v : vertices) {
    if (v < 0 || v >= vertex_count()) return false;
  }
  load_gradient(ws);
  springs_.add_gradient(is_linear(), spring_positions(ws), ws.velocity, ws.direction, ws.dt,
                        ws.gradient);
  for (std::size_t j = 0; j < vertices.size(); ++j) {
    for (Index c = 0; c < 3; ++c)
      forces(c, static_cast<Index>(j)) = static_cast<Scalar>(ws.gradient(c, vertices[j]) / ws.dt);
  }
  return true;
}

template <RealScalar S, RealScalar Inner>
StepStatus MassSpringRollout<S, Inner>::prepare(const ClothState<Scalar>& state,
                                                const ClothInput<Scalar>& input, Scalar dt,
                                                Workspace& ws) const {
  if (ws.structure != structure_) return StepStatus::InvalidWorkspace;
  ws.advanced = false;
  const StepStatus refused = detail::check_step(state, input, dt, vertex_count(), ws.held);
  if (refused != StepStatus::Converged) return refused;
  if (!input.attached_vertices.empty()) return StepStatus::InvalidInput;
  ws.dt = static_cast<Inner>(dt);
  const Vector3<Scalar> origin = state.positions.col(0);  // single precision for the shape alone
  for (Index i = 0; i < vertex_count(); ++i) {
    const Vector3<Scalar> local = state.positions.col(i) - origin;
    ws.start.col(i) = local.template cast<Inner>();
    ws.start_velocity.col(i) = state.velocities.col(i).template cast<Inner>();
    ws.outer.col(i) = network_.mass[i] * gravity_;
  }
  for (std::size_t i = 0; i < input.force_vertices.size(); ++i)
    ws.outer.col(input.force_vertices[i]) +=
        input.forces.col(static_cast<Index>(i)).template cast<Inner>();
  for (const Ground& g : grounds()) {
    const Vector3<Scalar> lift = state.positions.col(g.vertex) - g.place;
    ws.lift.col(g.vertex) = lift.template cast<Inner>();
  }
  const Vector3<Inner> wind = input.wind.template cast<Inner>();
  detail::freeze_air<Inner>(network_, ws.start, ws.start_velocity, wind, air_, ws.air, ws.outer);
  springs_.set_directions(ws.start, ws.direction);
  ws.velocity = ws.start_velocity;
  for (const int v : pinned_) {
    ws.held[static_cast<std::size_t>(v)] = 1;
    ws.velocity.col(v).setZero();
  }
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i) {
    const int v = input.driven_vertices[i];
    const Vector3<Scalar> way =
        input.driven_positions.col(static_cast<Index>(i)) - state.positions.col(v);
    ws.velocity.col(v) = (way / dt).template cast<Inner>();
  }
  return StepStatus::Converged;
}

template <RealScalar S, RealScalar Inner>
void MassSpringRollout<S, Inner>::load_gradient(Workspace& ws) const {
  const Inner h = ws.dt, inertia = Inner(1) + h * drag_;
  detail::move_along(ws.start, h, ws.velocity, ws.position);
  ws.gradient = ws.outer;
  (void)detail::add_bending_forces<Inner>(network_, ws.position, Inner(0), ws.gradient);
  for (const Ground& g : grounds()) {
    const Inner lift = lift_of(g, ws);
    ws.gradient.col(g.vertex) -=
        lift < g.release ? Vector3<Inner>((g.stiffness * lift) * g.normal) : g.force;
  }
  for (Index k = 0; k < ws.gradient.size(); ++k) {
    const Inner v = ws.velocity.data()[k], v0 = ws.start_velocity.data()[k];
    Inner& g = ws.gradient.data()[k];
    g = network_.mass[k / 3] * (inertia * v - v0) - h * g;
  }
  (void)detail::add_air_gradient<Inner>(network_, ws.air, ws.velocity, h, Inner(0), ws.gradient);
}

template <RealScalar S, RealScalar Inner>
Inner MassSpringRollout<S, Inner>::improve(Workspace& ws) const {
  const Inner h = ws.dt;
  load_gradient(ws);
  ws.matrix.set_zero();
  for (Index i = 0; i < vertex_count(); ++i)
    detail::add_to_diagonal(ws.matrix.diagonal(i),
                            Inner((Inner(1) + h * drag_) * network_.mass[i]));
  for (const Ground& g : grounds()) {
    if (lift_of(g, ws) < g.release)
      ws.matrix.diagonal(g.vertex) += (h * h * g.stiffness) * g.normal * g.normal.transpose();
  }
  pattern_.add_bending(network_, ws.position, h * h, ws.matrix);
  pattern_.add_air(network_, ws.air, h, ws.matrix);
  springs_.add_step(is_linear(), spring_positions(ws), ws.velocity, ws.direction, h, ws.gradient,
                    ws.matrix);
  if (!ws.factor.factorize(ws.matrix, ws.held)) return scalar_traits<Inner>::infinity();
  for (Index k = 0; k < ws.change.cols(); ++k)
    ws.change[k] = ws.is_held(k / 3) ? Inner(0) : Inner(Inner(0) - ws.gradient.data()[k]);
  ws.factor.template solve<1>(ws.change);
  const auto slope = [&] {
    Inner sum = Inner(0);
    for (Index k = 0; k < ws.change.cols(); ++k) sum += ws.change[k] * ws.gradient.data()[k];
    return sum;
  };
  const Inner before = slope();
  detail::move_along(ws.velocity, Inner(1), ws.change, ws.velocity);
  const Inner change = detail::largest_magnitude(ws.change);
  if (!all_finite(ws.change)) return scalar_traits<Inner>::infinity();
  if (is_linear() || h * change < longest_move_) return change;
  load_gradient(ws);
  springs_.add_gradient(false, ws.position, ws.velocity, ws.direction, h, ws.gradient);
  const Inner after = slope();
  if (!is_finite(after)) return after;
  if (!(Inner(0) - before < after)) return change;
  const Inner kept = before / (before - after);
  detail::move_along(ws.velocity, Inner(kept - Inner(1)), ws.change, ws.velocity);
  return kept * change;
}

template <RealScalar S, RealScalar Inner>
auto MassSpringRollout<S, Inner>::solve(int steps, Scalar tolerance, ClothState<Scalar>& state,
                                        const ClothInput<Scalar>& input, Scalar dt,
                                        Workspace& ws) const -> StepReport<Scalar> {
  StepReport<Scalar> report{StepStatus::IterationLimit, false, Scalar(0), 0};
  for (int k = 0; k < steps; ++k) {
    const Inner change = improve(ws);
    ++report.iterations;
    if (!is_finite(change))
      return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
    if (static_cast<Scalar>(change) < tolerance) {
      report.status = StepStatus::Converged;
      break;
    }
  }
  state.velocities = ws.velocity.template cast<Scalar>();
  state.positions += dt * state.velocities;
  for (std::size_t i = 0; i < input.driven_vertices.size(); ++i)
    state.positions.col(input.driven_vertices[i]) =
        input.driven_positions.col(static_cast<Index>(i));
  report.advanced = ws.advanced = true;
  return report;
}

// Compiled once where CLOTHCTL_PRECOMPILED is defined (config.hpp).
CLOTHCTL_INSTANTIATE(class MassSpringRollout<double, float>);
CLOTHCTL_INSTANTIATE(MassSpringRollout<double, float>::MassSpringRollout(const MassSpring<double>&,
                                                                         RolloutModelSettings));

}  // namespace clothctl::inline CLOTHCTL_ABI
