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
// (detail/spring_forces.hpp) starts at 1, is halved whenever the factorisation fails (below ¼ it
// becomes 0, the projection), and is doubled again after every third iteration. So every direction
// descends; and near a minimum, where the exact A is positive definite, convergence is quadratic. A
// sheet that buckles needs a fifth of the iterations of the projected method. An Armijo
// backtracking line search on the energy gives global convergence. References: Baraff & Witkin,
// Large Steps in Cloth Simulation (1998); [Bai 2016], eq. 4-6.

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/cloth/detail/spring_forces.hpp"
#include "clothctl/cloth/detail/step_input.hpp"
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

  /// All memory of a step. `make_workspace` makes it; a step refuses any other.
  struct Workspace {
    /// Hash of the structure (pattern and order of elimination) that the workspace was made for.
    std::uint64_t structure = 0;
    /// The step matrix, and the part of it that is constant over a step: inertia, drag, dampers,
    /// air and bending.
    BlockSymmetric<Scalar> matrix, frozen;
    /// The factor of `matrix`.
    BlockCholesky<Scalar> factor;
    /// 1 for driven and pinned vertices, else 0.
    std::vector<unsigned char> held;
    /// Unit vectors of the springs at the start of the step.
    Points<Scalar> direction;
    /// Forces that are constant over the step (gravity, input, C w), velocities at its end, trial
    /// velocities of the line search, positions at its end, and the gradient of the energy.
    Points<Scalar> outer, velocity, trial, position, gradient;
    /// Air matrices C_t, one for each triangle; empty without air.
    std::vector<Matrix3<Scalar>> air;
    /// Right-hand side of the linear system, and a product of the step matrix.
    Lanes<Scalar, 1> rhs, product;
    /// Length of the last step, s; 0 before the first.
    Scalar dt = Scalar(0);
    /// True when the last step was a single linear solve.
    bool linear = false;
  };

  /// Makes a model of a network and analyses the step matrix once. Allocates. Fails when:
  /// `network.validate()` or `settings.validate()` finds a fault, or a pinned vertex is off the
  /// mesh.
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

  /// Makes the memory of a step of this model. Allocates.
  Workspace make_workspace() const;

  /// Returns why `step` would refuse these arguments: one line that names the item, its index and
  /// the bad value. Returns an empty string when they are good. Allocates. Complexity: O(vertices).
  std::string check_input(const State& state, const ClothInput<Scalar>& input, Scalar dt,
                          const Workspace& ws) const;

  /// Advances `state` by `dt` (s) under `input`. Never allocates. Fails when: see StepStatus; the
  /// state is then bitwise unchanged, and `check_input` says why. Complexity: every linear solve
  /// takes one factorisation of the step matrix, O(n^1.5) on a sheet of n vertices.
  [[nodiscard]] StepReport<Scalar> step(State& state, const ClothInput<Scalar>& input, Scalar dt,
                                        Workspace& ws) const;

  /// Writes the forces that made `vertices` follow their prescribed motion in the last step with
  /// this workspace, 3×vertices.size(), N: the force that a hand must exert on each. The vertices
  /// were driven or pinned in that step. Input forces on them are already subtracted. The error is
  /// that of the step's residual. Never allocates. Returns false, and writes nothing, when the
  /// workspace was made by another model or has seen no step, a vertex is off the mesh, or `forces`
  /// has another number of columns.
  bool holding_forces(std::span<const int> vertices, Workspace& ws,
                      Eigen::Ref<Points<Scalar>> forces) const;

  /// Advances `state` by `dt` (s) with at most `newton_steps` Newton steps that start from the end
  /// velocities `guess` (3×n, m/s), whatever integration the settings name. Use it to roll out a
  /// plan again that has hardly changed. It takes the projected Hessian, whose first step is the
  /// most cautious. It ends sooner when a Newton step changes no coordinate of a velocity by more
  /// than `step_tolerance`, m/s. Never allocates. Fails as `step` does, and with InvalidInput when
  /// `guess` has another size or is not finite.
  [[nodiscard]] StepReport<Scalar> step_from(const PointsView<Scalar>& guess, int newton_steps,
                                             State& state, const ClothInput<Scalar>& input,
                                             Scalar dt, Workspace& ws,
                                             Scalar step_tolerance = Scalar(0)) const;

 private:
  static constexpr int kMaxHalvings = 30;

  /// Returns true when this model, or one of the same structure, made the workspace.
  bool fits(const Workspace& ws) const;

  /// Returns the status that refuses the arguments of a step, or Converged; marks driven vertices.
  StepStatus refuse(const State& state, const ClothInput<Scalar>& input, Scalar dt,
                    Workspace& ws) const;

  /// Hash of pattern and order of elimination. Nothing else of a workspace depends on the model.
  std::uint64_t structure_hash() const;

  /// Moves the state to the end of the step unless the solve failed.
  StepReport<Scalar> finish(State& state, const ClothInput<Scalar>& input, Scalar dt,
                            StepReport<Scalar> report, Workspace& ws) const;

  MassSpring(SpringNetwork<Scalar> network, MassSpringSettings<Scalar> settings);

  bool air() const { return settings_.air.enabled(); }

  /// Computes what is constant over a step: directions of the dampers, air matrices, outer forces
  /// and ws.frozen. Sets ws.velocity = v, with held vertices at their prescribed velocity.
  void prepare(const State& state, const ClothInput<Scalar>& input, Scalar dt, Workspace& ws) const;

  /// Factorises A at `x`: the frozen part plus h² K, with the factor `compression` on the
  /// indefinite part of K. Returns false when A is not positive definite.
  bool factorize(const Points<Scalar>& x, Scalar dt, Scalar compression, Workspace& ws) const;

  /// The single linear solve: A (v⁺ - v̂) = M v + h f - A v̂ on the free rows. v̂ is the velocity
  /// at the start, with the prescribed one on held rows.
  StepReport<Scalar> solve_linear(const State& state, Scalar dt, Workspace& ws) const;

  /// The energy of a step (J), and a bound on its rounding error divided by ε.
  struct Energy {
    Scalar value, size;
  };

  /// Runs Newton's method from ws.velocity and leaves the best velocities there. `solves` counts
  /// the linear solves so far. `compression` is the first γ; with 0 it stays at the projection. A
  /// step shorter than `step_tolerance` is the last.
  StepReport<Scalar> iterate(const State& state, Scalar dt, int max_iterations, int solves,
                             Scalar compression, Scalar step_tolerance, Workspace& ws) const;

  Scalar velocity_tolerance() const {
    using std::cbrt;
    const Scalar given = settings_.velocity_tolerance;
    return Scalar(0) < given ? given : Scalar(2) * cbrt(scalar_traits<Scalar>::epsilon());
  }

  /// Sets ws.rhs to minus the gradient on the free vertices, and `largest` to its largest entry.
  /// Returns true when every vertex meets the tolerance.
  bool load_residual(Scalar tolerance, Scalar& largest, Workspace& ws) const {
    bool converged = true;
    largest = Scalar(0);
    for (Index i = 0; i < vertex_count(); ++i) {
      if (held(ws, i)) {
        set_point(ws.rhs, i, {Scalar(0), Scalar(0), Scalar(0)});
        continue;
      }
      const detail::Triple<Scalar> g = detail::column(ws.gradient, i);
      set_point(ws.rhs, i, {-g.x, -g.y, -g.z});
      Scalar size = Scalar(0);
      for (const Scalar& entry : {g.x, g.y, g.z}) {
        const Scalar magnitude = entry < Scalar(0) ? -entry : entry;
        if (!(magnitude <= size)) size = magnitude;  // keeps a NaN
        if (!is_finite(size)) break;
      }
      if (is_finite(largest) && !(size <= largest)) largest = size;
      if (!(size < tolerance * network_.mass[i])) converged = false;
    }
    return converged;
  }

  /// Returns the energy of the step at velocities `v`. Writes its gradient to ws.gradient and x0 +
  /// h v to ws.position. On a held vertex the gradient is the impulse that holds it.
  Energy objective(const State& state, const Points<Scalar>& v, Scalar dt, Workspace& ws) const;

  bool held(const Workspace& ws, Index i) const {
    return ws.held[static_cast<std::size_t>(i)] != 0;
  }
  static Eigen::Map<Points<Scalar>> as_points(Lanes<Scalar, 1>& row) {
    return {row.data(), 3, row.cols() / 3};
  }
  static detail::Triple<Scalar> point(const Lanes<Scalar, 1>& row, Index i) {
    return {row[3 * i], row[3 * i + 1], row[3 * i + 2]};
  }
  static void set_point(Lanes<Scalar, 1>& row, Index i, const detail::Triple<Scalar>& v) {
    row[3 * i] = v.x;
    row[3 * i + 1] = v.y;
    row[3 * i + 2] = v.z;
  }
  /// out = a + factor · b, entry by entry; `out` may be `a`.
  template <class Other>
  static void add_scaled(const Points<Scalar>& a, const Scalar& factor, const Other& b,
                         Points<Scalar>& out) {
    for (Index k = 0; k < out.size(); ++k) out.data()[k] = a.data()[k] + factor * b.data()[k];
  }
  /// Returns the largest magnitude of an entry; it ignores NaN.
  template <class Matrix>
  static Scalar largest_entry(const Matrix& matrix) {
    Scalar largest = Scalar(0);
    for (Index k = 0; k < matrix.size(); ++k) {
      const Scalar& entry = matrix.data()[k];
      const Scalar magnitude = entry < Scalar(0) ? -entry : entry;
      if (largest < magnitude) largest = magnitude;
    }
    return largest;
  }

  SpringNetwork<Scalar> network_;
  MassSpringSettings<Scalar> settings_;
  detail::SpringPattern<Scalar> pattern_;
  EliminationTree tree_;
  Scalar total_stiffness_ = Scalar(0);
  std::uint64_t structure_ = 0;
};

}  // namespace clothctl::inline CLOTHCTL_ABI

#include "clothctl/cloth/detail/mass_spring_impl.hpp"
