#pragma once

// The solvers of a mass-spring step (equations and symbols: mass_spring.hpp).
//
// Newton's method has two forms. The direct one factorises the step matrix in every iteration. The
// truncated one keeps a factor P of an earlier matrix, in lower precision, and solves with the
// present matrix A by conjugate gradients preconditioned by P (conjugate_gradient.hpp). A solve
// with P takes a tenth of the time of a factorisation. The tolerance of the solves follows the
// progress of the residual: η = (residual / last residual)², between 10⁻³ and 0.3. P is replaced
// after a solve that took many iterations or met negative curvature. Where the truncated form
// cannot go on (P is not definite in its precision, a search finds no descent), the direct form
// continues from the best velocities. Reference: Nocedal and Wright, Numerical Optimization (2006),
// chapter 7.
//
// A single linear solve may end with more energy than it was given, where the forces change much
// within the step (energy_balance.hpp). Then Newton steps on the energy of the step follow until it
// no longer does. Where Newton's method ends so, which springs under compression allow, the
// velocities after the step are scaled down by the factor that takes the excess out of the kinetic
// energy of the free vertices. If none is held or attached, their mean velocity, and so the linear
// momentum, is kept.

#include <algorithm>
#include <cmath>

#include "clothctl/cloth/detail/energy_balance.hpp"
#include "clothctl/cloth/detail/mass_spring_workspace.hpp"
#include "clothctl/cloth/detail/spring_forces.hpp"
#include "clothctl/cloth/detail/step_energy.hpp"
#include "clothctl/cloth/mass_spring_settings.hpp"
#include "clothctl/core/cloth_state.hpp"
#include "clothctl/core/report.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What Newton's method is allowed to do.
template <RealScalar Scalar>
struct NewtonLimits {
  /// Newton stops when the residual of every vertex, divided by its mass, is below this, m/s.
  Scalar tolerance = Scalar(0);
  /// Largest number of Newton steps.
  int max_iterations = 0;
  /// The first γ of the direct form; with 0, all steps use the projected matrix.
  Scalar compression = Scalar(1);
  /// The first Newton step shorter than this is the last, m/s.
  Scalar step_tolerance = Scalar(0);
  /// Newton also stops when the step creates no energy.
  bool until_bounded = false;
};

/// A friend of MassSpring that the library does not define: benchmarks take a step apart with it.
template <RealScalar Scalar>
struct StepParts;

/// Solves one step. Refers to the model's data, to the state at the start of the step and to the
/// workspace, which `prepare` of the model has filled. Never allocates.
template <RealScalar S>
class StepSolver {
 public:
  /// The scalar type.
  using Scalar = S;

  /// The data of the model and of the step; `total_stiffness`: sum of k over the springs, N/m.
  StepSolver(const SpringNetwork<Scalar>& network, const MassSpringSettings<Scalar>& settings,
             const SpringPattern<Scalar>& pattern, Scalar total_stiffness,
             const ClothState<Scalar>& state, Scalar dt, MassSpringWorkspace<Scalar>& ws)
      : network_(network),
        settings_(settings),
        pattern_(pattern),
        total_stiffness_(total_stiffness),
        state_(state),
        dt_(dt),
        ws_(ws) {}

  /// The single linear solve: A (v⁺ - v̂) = M v0 + h f - A v̂ on the free rows, with f all forces
  /// at x0. v̂ is v0 with the prescribed velocities on the held rows. Adds the result to
  /// ws.velocity. `tolerance` (m/s) bounds the residual of a solve by conjugate gradients.
  StepReport<Scalar> solve_linear(Scalar tolerance);

  /// Assembles A in ws.matrix at `x`: the frozen part plus h² K, with the factor `compression` on
  /// the indefinite part of K.
  void assemble(const Points<Scalar>& x, Scalar compression) {
    StiffnessScale<Scalar> scale;
    scale.compression = compression;
    ws_.matrix = ws_.frozen;
    pattern_.add_springs(network_, x, scale, dt_ * dt_, ws_.matrix);
    if (ws_.contacts != nullptr) ws_.contacts->add_blocks(ws_.matrix);
  }

  /// Assembles A at `x` and factorises it. Returns false where it is not definite.
  [[nodiscard]] bool factorize_at(const Points<Scalar>& x, Scalar compression) {
    assemble(x, compression);
    ws_.factor_changes.clear();
    return ws_.factor.factorize(ws_.matrix, ws_.held);
  }

  /// Sets ws.rhs to the right-hand side of the single linear solve; ws.matrix must hold A. Leaves
  /// the forces at x0 in ws.gradient; with `again`, they are there.
  void load_linear(bool again = false);

  /// Returns the energy balance of the step from the state with velocities ws.velocity at its end.
  EnergyBalance<Scalar> energy_balance();
  /// Newton steps from the single linear solve in ws.velocity until the step creates no energy or
  /// Newton's method converges. Where a matrix has no factor, the status is IterationLimit:
  /// ws.velocity is as good as the linear solve at least.
  StepReport<Scalar> bound_energy(NewtonLimits<Scalar> limits) {
    limits.until_bounded = true;
    StepReport<Scalar> report = newton_truncated(limits, 1, true);
    if (report.status != StepStatus::NumericalFailure) return report;
    const bool usable = is_finite(energy_at(ws_.velocity).value) && all_finite(ws_.gradient);
    if (usable) report.status = StepStatus::IterationLimit;
    return report;
  }

  /// Takes the forces of the contacts where Newton's method has ended, and gives the sheet what its
  /// momentum lacks.
  void close_contacts() {
    if (ws_.contacts == nullptr) return;
    energy_with_contacts({});
    Scalar largest = Scalar(0);
    load_residual(network_, Scalar(0), largest, ws_);
    balance_momentum();
  }

  /// Newton's method from the end of a rough linear solve. Leaves the best velocities in
  /// ws.velocity.
  StepReport<Scalar> newton(const NewtonLimits<Scalar>& limits);

  /// Newton's method from ws.velocity, truncated where the preconditioner is incomplete, else
  /// direct.
  StepReport<Scalar> newton_from_guess(const NewtonLimits<Scalar>& limits) {
    if (!ws_.preconditioner.is_incomplete()) return newton_direct(limits, 0);
    return newton_truncated(limits, 0, true);
  }

 private:
  static constexpr int kMaxHalvings = 30;
  static constexpr int kManyIterations = 6;  // of conjugate gradients: then P is replaced
  static constexpr int kMostIterations = 12;
  static constexpr int kMostIncomplete = 300;
  static constexpr int kContactRounds = 8, kOpeningRounds = 4;
  static constexpr double kContactTolerance = 6e-5;  // m/s

  /// The truncated form, from ws.velocity. `solves` counts the linear solves so far; `renew` is set
  /// when there is no factor yet.
  StepReport<Scalar> newton_truncated(const NewtonLimits<Scalar>& limits, int solves, bool renew);

  /// The direct form, from ws.velocity.
  StepReport<Scalar> newton_direct(const NewtonLimits<Scalar>& limits, int solves);

  StepEnergy<Scalar> energy_at(const Points<Scalar>& v) {
    return step_energy(network_, settings_.drag, total_stiffness_, state_, v, dt_, ws_);
  }

  /// Factorises and solves for ws.velocity. Returns false where the matrix is not definite.
  bool solve_once(Scalar tolerance, StepReport<Scalar>& report);
  /// The same with contacts: by conjugate gradients, preconditioned by a factor of the matrix with
  /// predicted states, in rounds until solutions and states agree.
  bool solve_with_contacts(StepReport<Scalar>& report);
  /// Gives a sheet that nothing holds the momentum that the residual in ws.rhs lacks, so that it
  /// receives what the contacts tell, to rounding.
  void balance_momentum();
  /// Sets the first states of contacts.
  void predict_contacts() {
    if (ws_.contacts != nullptr) ws_.contacts->predict(ws_.velocity);
  }
  /// Freezes the bounds of friction at ws.velocity and returns the energy there.
  StepEnergy<Scalar> energy_with_contacts(const StepEnergy<Scalar>& energy) {
    if (ws_.contacts == nullptr) return energy;
    ws_.contacts->freeze(ws_.velocity);
    return energy_at(ws_.velocity);
  }

  /// Replaces P by a factor of A at the present positions, or of its projection where A is not
  /// definite. Leaves the exact A in ws.matrix.
  bool refresh();

  /// Solves A d = ws.rhs by conjugate gradients; with `exact`, preconditioned by ws.factor.
  ConjugateGradientReport solve_truncated(Scalar forcing, Scalar tolerance, int max_iterations,
                                          bool exact = false) {
    const ConjugateGradientLimits<Scalar> limits{forcing, tolerance, max_iterations};
    return conjugate_gradient<Scalar>(
        ws_.matrix, ws_.rhs, network_.mass, ws_.held, limits,
        [&](const Lanes<Scalar, 1>& r, Lanes<Scalar, 1>& z) {
          if (!exact) return ws_.preconditioner.apply(r, z);
          z = r;
          ws_.factor.template solve<1>(z);
        },
        ws_.cg);
  }

  /// Armijo's backtracking search from ws.velocity along `d`. Doubles a full step while the energy
  /// falls if `expand` is set. Leaves the new velocities in ws.trial and their energy in `energy`.
  /// Returns the step length, or 0 when there is no descent.
  Scalar search(const Lanes<Scalar, 1>& d, bool expand, StepEnergy<Scalar>& energy);

  const SpringNetwork<Scalar>& network_;
  const MassSpringSettings<Scalar>& settings_;
  const SpringPattern<Scalar>& pattern_;
  Scalar total_stiffness_;
  const ClothState<Scalar>& state_;
  Scalar dt_;
  MassSpringWorkspace<Scalar>& ws_;
};

template <RealScalar S>
void StepSolver<S>::load_linear(bool again) {
  if (!again) {
    ws_.gradient = ws_.outer;
    add_spring_forces<Scalar>(network_, state_.positions, ws_.gradient);
    ws_.attachments.add_forces(state_.positions, ws_.gradient);
  }
  as_points(ws_.rhs) = ws_.velocity;
  ws_.matrix.multiply(ws_.rhs, ws_.product);
  for (Index i = 0; i < network_.vertex_count(); ++i) {
    if (ws_.is_held(i)) {
      set_point(ws_.rhs, i, {Scalar(0), Scalar(0), Scalar(0)});
    } else {
      set_point(ws_.rhs, i,
                column(state_.velocities, i) * network_.mass[i] + column(ws_.gradient, i) * dt_ -
                    point(ws_.product, i));
    }
  }
  if (ws_.contacts == nullptr) return;
  ws_.contacts->for_each_constant_force([&](int v, const Triple<Scalar>& force) {
    if (!ws_.is_held(v)) set_point(ws_.rhs, v, point(ws_.rhs, v) + force * dt_);
  });
}

template <RealScalar S>
bool StepSolver<S>::solve_once(Scalar tolerance, StepReport<Scalar>& report) {
  const bool iterative = ws_.preconditioner.is_incomplete();
  assemble(state_.positions, Scalar(0));
  load_linear();
  if (!iterative) {
    if (!ws_.factor.factorize(ws_.matrix, ws_.held)) return false;
    ws_.factor_is_current = true;
    ws_.factor_changes.clear();
    report.iterations = 1;
    ws_.factor.template solve<1>(ws_.rhs);
    move_along(ws_.velocity, Scalar(1), ws_.rhs, ws_.velocity);
    return true;
  }
  if (!ws_.preconditioner.factorize(ws_.matrix, ws_.held)) return false;
  const ConjugateGradientReport cg =
      solve_truncated(Scalar(0), tolerance, settings_.max_linear_iterations);
  if (!cg.finite || cg.indefinite) return false;
  if (!cg.converged) report.status = StepStatus::IterationLimit;
  report.iterations = cg.iterations;
  report.residual = largest_magnitude(ws_.cg.residual);
  move_along(ws_.velocity, Scalar(1), ws_.cg.solution, ws_.velocity);
  return true;
}

template <RealScalar S>
bool StepSolver<S>::solve_with_contacts(StepReport<Scalar>& report) {
  // In single precision, rounding of the forces of stiff springs is more than the tolerance.
  const Scalar rounding = Scalar(4000) * scalar_traits<Scalar>::epsilon();
  const Scalar little = rounding < Scalar(kContactTolerance) ? Scalar(kContactTolerance) : rounding;
  predict_contacts();
  // Where the factor of the step is asked for after it, it takes the place of the preconditioner.
  const bool exact = ws_.expects && !ws_.preconditioner.is_incomplete();
  ws_.factor_is_current = false;
  // States that come back in turns never settle. After some rounds contacts may only open.
  const int last = kContactRounds + kOpeningRounds;
  for (int round = 0; round <= last; ++round) {
    if (round == 0)
      assemble(state_.positions, Scalar(0));
    else
      ws_.contacts->replace_blocks(ws_.matrix);
    load_linear(0 < round);
    if (0 < round && is_small(ws_.rhs, network_.mass, little)) break;
    const bool opens = kContactRounds <= round;
    if (opens) report.status = StepStatus::IterationLimit;
    if (round == last) break;
    if (round == 0) {
      if (!(exact ? ws_.factor.factorize(ws_.matrix, ws_.held)
                  : ws_.preconditioner.factorize(ws_.matrix, ws_.held)))
        return false;
      ws_.contacts->note_factor();
    }
    const ConjugateGradientReport cg =
        solve_truncated(opens ? Scalar(0) : Scalar(0.1), Scalar(0.1) * little,
                        opens ? kMostIncomplete : kMostIterations, exact);
    if (!cg.finite || cg.indefinite) return false;
    report.iterations += cg.iterations;
    move_along(ws_.velocity, Scalar(1), ws_.cg.solution, ws_.velocity);
    // What is closed after the last solve stays closed, and that is a good solve: the momentum that
    // is missing goes to the whole sheet.
    if (round + 1 < last)
      ws_.contacts->update(ws_.velocity, opens);
    else
      ws_.contacts->update_friction(ws_.velocity);
  }
  report.residual = largest_magnitude(ws_.rhs);
  if (exact) ws_.factor_is_current = ws_.contacts->list_changes(ws_.matrix, ws_.factor_changes);
  ws_.contacts->take(ws_.velocity);
  balance_momentum();
  ws_.contacts->for_each_constant_force([&](int v, const Triple<Scalar>& force) {
    add_to_column(ws_.gradient, v, force);  // for holding_forces
  });
  return true;
}

template <RealScalar S>
void StepSolver<S>::balance_momentum() {
  Triple<Scalar> missing{Scalar(0), Scalar(0), Scalar(0)};
  Scalar mass = Scalar(0);
  for (Index i = 0; i < network_.vertex_count(); ++i) {
    if (ws_.is_held(i)) return;
    missing = missing + point(ws_.rhs, i);
    mass += network_.mass[i];
  }
  missing = missing / ((Scalar(1) + dt_ * settings_.drag) * mass);
  for (Index i = 0; i < network_.vertex_count(); ++i) add_to_column(ws_.velocity, i, missing);
}

template <RealScalar S>
auto StepSolver<S>::solve_linear(Scalar tolerance) -> StepReport<Scalar> {
  StepReport<Scalar> report{StepStatus::Converged, false, Scalar(0), 0};
  const bool solved =
      ws_.contacts == nullptr ? solve_once(tolerance, report) : solve_with_contacts(report);
  if (!solved) return {StepStatus::NumericalFailure, false, Scalar(0), 1};
  ws_.trial = state_.velocities;  // for holding_forces
  ws_.linear = true;
  return report;
}

template <RealScalar S>
auto StepSolver<S>::energy_balance() -> EnergyBalance<Scalar> {
  move_along(state_.positions, dt_, ws_.velocity, ws_.position);
  return EnergyBalancer<Scalar>(network_, settings_.drag, state_, ws_).balance();
}

template <RealScalar S>
bool StepSolver<S>::refresh() {
  assemble(ws_.position, Scalar(1));
  if (ws_.preconditioner.factorize(ws_.matrix, ws_.held)) return true;
  assemble(ws_.position, Scalar(0));
  const bool definite = ws_.preconditioner.factorize(ws_.matrix, ws_.held);
  assemble(ws_.position, Scalar(1));
  return definite;
}

template <RealScalar S>
S StepSolver<S>::search(const Lanes<Scalar, 1>& d, bool expand, StepEnergy<Scalar>& energy) {
  Scalar slope = Scalar(0);  // negative: A is positive definite, or d a direction of descent
  for (Index k = 0; k < d.cols(); ++k) slope += d[k] * ws_.gradient.data()[k];
  const StepEnergy<Scalar> start = energy;
  const Scalar noise = Scalar(4) * scalar_traits<Scalar>::epsilon() * start.size;
  const auto move_to = [&](Scalar length) {
    move_along(ws_.velocity, length, d, ws_.trial);
    energy = energy_at(ws_.trial);
  };
  const auto descends = [&](Scalar length) {
    move_to(length);
    return energy.value < start.value + Scalar(1e-4) * length * slope + noise;
  };
  Scalar length = Scalar(1);
  int halvings = 0;
  while (halvings < kMaxHalvings && !descends(length)) {
    length *= Scalar(0.5);
    ++halvings;
  }
  if (halvings == kMaxHalvings) {
    energy = start;
    return Scalar(0);  // rounding hides any descent
  }
  while (expand && halvings == 0 && length < Scalar(64)) {
    const Scalar last = energy.value;
    move_to(Scalar(2) * length);
    if (!(energy.value < last)) {
      move_to(length);
      break;
    }
    length *= Scalar(2);
  }
  return length;
}

template <RealScalar S>
auto StepSolver<S>::newton(const NewtonLimits<Scalar>& limits) -> StepReport<Scalar> {
  ws_.linear = false;
  predict_contacts();
  assemble(state_.positions, Scalar(0));
  if (!ws_.preconditioner.factorize(ws_.matrix, ws_.held)) {
    const StepReport<Scalar> linear = solve_linear(limits.tolerance);
    if (linear.status == StepStatus::NumericalFailure) return linear;
    return newton_direct(limits, 1);
  }
  load_linear();
  if (ws_.preconditioner.is_incomplete()) {
    const ConjugateGradientReport cg =
        solve_truncated(Scalar(0.1), limits.tolerance, kMostIncomplete);
    if (!cg.finite) return {StepStatus::NumericalFailure, false, Scalar(0), 1};
  } else {
    ws_.preconditioner.apply(ws_.rhs, ws_.cg.solution);
  }
  move_along(ws_.velocity, Scalar(1), ws_.cg.solution, ws_.velocity);
  return newton_truncated(limits, 1, false);
}

template <RealScalar S>
auto StepSolver<S>::newton_truncated(const NewtonLimits<Scalar>& limits, int solves, bool renew)
    -> StepReport<Scalar> {
  StepReport<Scalar> report{StepStatus::IterationLimit, false, Scalar(0), solves};
  const bool incomplete = ws_.preconditioner.is_incomplete();
  const Scalar tight = Scalar(1e-3), loose = Scalar(0.3);
  ws_.linear = false;
  StepEnergy<Scalar> energy = energy_at(ws_.velocity);
  bool short_step = false;  // the last step was full and shorter than the tolerance
  bool exact = false;       // and its solve was tight
  bool enough = false;      // the last step was shorter than step_tolerance
  for (int iteration = 0; iteration <= limits.max_iterations; ++iteration) {
    energy = energy_with_contacts(energy);
    const Scalar last = report.residual;
    const bool balanced = load_residual(network_, limits.tolerance, report.residual, ws_);
    const bool falls = report.residual < Scalar(0.5) * last;
    if (!is_finite(report.residual) || !is_finite(energy.value))
      return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
    const bool bounded = limits.until_bounded && !creates_energy(energy_balance(), ws_);
    const bool converged = balanced || bounded || (exact && !falls);
    if (converged) report.status = StepStatus::Converged;
    if (converged || enough || iteration == limits.max_iterations) return report;
    NewtonLimits<Scalar> rest = limits;
    rest.max_iterations -= iteration;
    if (renew || incomplete) {
      if (!refresh()) {
        if (!incomplete) return newton_direct(rest, report.iterations);
        return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
      }
    } else {
      assemble(ws_.position, Scalar(1));
    }
    Scalar forcing = loose;
    if (0 < iteration && report.residual < last) {
      const Scalar ratio = report.residual / last;
      forcing = (std::min)(loose, (std::max)(tight, ratio * ratio));
    }
    if (short_step) forcing = tight;
    const ConjugateGradientReport cg = solve_truncated(
        forcing, Scalar(0.5) * limits.tolerance, incomplete ? kMostIncomplete : kMostIterations);
    renew = cg.indefinite || kManyIterations <= cg.iterations;
    const Scalar length = cg.finite ? search(ws_.cg.solution, cg.indefinite, energy) : Scalar(0);
    if (!(Scalar(0) < length)) {
      if (!incomplete) return newton_direct(rest, report.iterations);
      return report;
    }
    ++report.iterations;
    const Scalar change = largest_magnitude(ws_.cg.solution);
    const bool full = !(length < Scalar(1));
    short_step = full && change < limits.tolerance;
    exact = short_step && cg.converged && !(tight < forcing);
    enough = length * change < limits.step_tolerance;
    ws_.velocity.swap(ws_.trial);
  }
  return report;
}

template <RealScalar S>
auto StepSolver<S>::newton_direct(const NewtonLimits<Scalar>& limits, int solves)
    -> StepReport<Scalar> {
  StepReport<Scalar> report{StepStatus::IterationLimit, false, Scalar(0), solves};
  Scalar compression = limits.compression;
  const bool projected = !(Scalar(0) < compression);
  ws_.linear = false;
  StepEnergy<Scalar> energy = energy_at(ws_.velocity);
  bool small_step = false;  // the last step was full and shorter than the tolerance
  bool enough = false;      // the last step was shorter than step_tolerance
  for (int iteration = 0; iteration <= limits.max_iterations; ++iteration) {
    energy = energy_with_contacts(energy);
    const Scalar last = report.residual;
    const bool converged = load_residual(network_, limits.tolerance, report.residual, ws_) ||
                           (small_step && !(report.residual < Scalar(0.5) * last)) ||
                           (limits.until_bounded && !creates_energy(energy_balance(), ws_));
    if (!is_finite(report.residual) || !is_finite(energy.value))
      return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
    if (converged) report.status = StepStatus::Converged;
    if (converged || enough || iteration == limits.max_iterations) break;
    while (!factorize_at(ws_.position, compression)) {
      if (!(Scalar(0) < compression))
        return {StepStatus::NumericalFailure, false, report.residual, report.iterations};
      compression = Scalar(0.25) < compression ? Scalar(0.5) * compression : Scalar(0);
    }
    ws_.factor.template solve<1>(ws_.rhs);
    ++report.iterations;
    if (!projected && iteration % 3 == 2)
      compression = (std::min)(Scalar(1), (std::max)(Scalar(0.25), Scalar(2) * compression));
    const Scalar length = search(ws_.rhs, false, energy);
    if (!(Scalar(0) < length)) break;
    const Scalar change = largest_magnitude(ws_.rhs);
    small_step = !(length < Scalar(1)) && change < limits.tolerance;
    enough = length * change < limits.step_tolerance;
    ws_.velocity.swap(ws_.trial);
  }
  return report;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
