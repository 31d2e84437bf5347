// Random bodies, materials, steps and motions of the pins: no step of MassSpring gives a number
// that is not finite, explodes, or creates energy.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "clothctl/cloth/mass_spring.hpp"
#include "support/catch.hpp"
#include "support/random_bodies.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::Trial;

namespace {

struct Outcome {
  bool finite = true, bounded = true;
  int refused = 0;
  double gain = 0;       // largest share of the energy put in by which the energy exceeds it
  double step_gain = 0;  // the same in one step that leaves the free vertices in motion
};

template <class S>
double elastic(const SpringNetwork<double>& network, const ClothState<S>& state) {
  const Points<double> x = state.positions.template cast<double>();
  return detail::spring_energy<double>(network, x);
}

/// The same as below for a folded hinge.
void add_fold(const BendStencil<double>& b, const std::vector<bool>& is_held, bool mean,
              const Points<double>& x0, const Points<double>& x1, Points<double>& forces) {
  const detail::FoldedHinge<double> start(b, x0), end(b, x1);
  bool all = true;
  for (const int v : b.vertex) all = all && is_held[static_cast<std::size_t>(v)];
  for (int i = 0; i < 4; ++i) {
    const int v = b.vertex[static_cast<std::size_t>(i)];
    const auto push = mean || all ? start.mean_share(end, i, (start.error() + end.error()) * 0.5)
                                  : end.share(i, end.error());
    forces.col(v) -= b.stiffness * Vector3<double>(push.x, push.y, push.z);
  }
}

/// Adds the forces of the springs on the vertices over a step from x0 to x1, N: with `mean`, those
/// that do the work by which the energy of each spring falls, else those at the end of the step.
/// Springs and stencils between held vertices have their mean force.
void add_forces(const SpringNetwork<double>& network, const std::vector<bool>& is_held, bool mean,
                const Points<double>& x0, const Points<double>& x1, Points<double>& forces) {
  for (const Spring<double>& s : network.springs) {
    const Vector3<double> d0 = x0.col(s.a) - x0.col(s.b), d1 = x1.col(s.a) - x1.col(s.b);
    const bool both =
        is_held[static_cast<std::size_t>(s.a)] && is_held[static_cast<std::size_t>(s.b)];
    const double length = mean || both ? 0.5 * (d0.norm() + d1.norm()) : d1.norm();
    const Vector3<double> d = mean || both ? Vector3<double>(0.5 * (d0 + d1)) : d1;
    const Vector3<double> f = s.stiffness * (1 - s.rest_length / length) * d;
    forces.col(s.a) -= f;
    forces.col(s.b) += f;
  }
  for (const BendStencil<double>& b : network.bends) {
    if (b.is_folded()) {
      add_fold(b, is_held, mean, x0, x1, forces);
      continue;
    }
    Vector3<double> start = Vector3<double>::Zero(), end = start;
    bool all = true;
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i) {
      start += b.weight[i] * x0.col(b.vertex[i]);
      end += b.weight[i] * x1.col(b.vertex[i]);
      all = all && is_held[static_cast<std::size_t>(b.vertex[i])];
    }
    const Vector3<double> curvature = mean || all ? Vector3<double>(0.5 * (start + end)) : end;
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i)
      forces.col(b.vertex[i]) -= b.stiffness * b.weight[i] * curvature;
  }
}

/// Returns the work of the hands over a step from `before` to positions `x` with velocities `v`, J.
/// How the forces of the springs change during a step is not known: the work is the larger one of
/// those with the forces at the end and with the mean forces. (The first alone is no bound: two
/// hands that push a spring together do less work by it than the spring takes up, whatever the
/// solver.)
double hand_work(const Trial& trial, const SpringNetwork<double>& network,
                 const std::vector<int>& held, const ClothState<double>& before,
                 const Points<double>& x, const Points<double>& v) {
  std::vector<bool> is_held(static_cast<std::size_t>(x.cols()), false);
  for (const int i : held) is_held[static_cast<std::size_t>(i)] = true;
  const Points<double> step = x - before.positions;
  Points<double> dampers = Points<double>::Zero(3, x.cols());
  for (const Spring<double>& s : network.springs) {
    const Vector3<double> n = (before.positions.col(s.a) - before.positions.col(s.b)).normalized();
    const Vector3<double> f = s.damping * n.dot(v.col(s.a) - v.col(s.b)) * n;
    dampers.col(s.a) -= f;
    dampers.col(s.b) += f;
  }
  double work[2] = {0, 0};
  for (const bool mean : {false, true}) {
    Points<double> forces = dampers;
    add_forces(network, is_held, mean, before.positions, x, forces);
    for (const int i : held) {
      const Vector3<double> gained = (v.col(i) - before.velocities.col(i)) / trial.dt;
      const Vector3<double> own = gained + trial.drag * v.col(i) - trial.gravity;
      work[mean ? 1 : 0] += (network.mass[i] * own - forces.col(i)).dot(step.col(i));
    }
  }
  return std::max(work[0], work[1]);
}

/// Returns the work of the springs to points over a step to positions `x`, J: with their forces at
/// the end of the step, and what their energies lose, which is more. MassSpring aims at the former,
/// which is out of reach where more than the kinetic energy would have to go.
template <class S>
std::array<double, 2> point_work(const ClothInput<S>& input, const std::vector<int>& held,
                                 const Points<double>& x, const Points<double>& step) {
  std::array<double, 2> sum{0, 0};
  for (std::size_t j = 0; j < input.attached_vertices.size(); ++j) {
    const int v = input.attached_vertices[j];
    if (std::find(held.begin(), held.end(), v) != held.end()) continue;
    const Index i = static_cast<Index>(j);
    const Vector3<double> p = input.attached_positions.col(i).template cast<double>();
    const double k = static_cast<double>(input.attachment_stiffness[i]);
    sum[0] += k * (p - x.col(v)).dot(step.col(v));
    sum[1] += k * (p - x.col(v) + 0.5 * step.col(v)).dot(step.col(v));
  }
  return sum;
}

/// Runs a trial. Energies and work are those of the states, computed in double.
template <class S>
Outcome run(const Trial& trial, Integration integration, int steps) {
  MassSpringSettings<S> settings;
  settings.integration = integration;
  settings.gravity = trial.gravity.cast<S>();
  settings.drag = S(trial.drag);
  settings.pinned = trial.pinned;
  const auto model = MassSpring<S>::create(trial.network.template cast<S>(), settings).value();
  auto ws = model.make_workspace();
  ClothState<S> state = trial.state<S>();
  const SpringNetwork<double> network = model.network().template cast<double>();
  const VectorX<double>& mass = network.mass;
  const auto kinetic = [&](const ClothState<S>& s) {
    return 0.5 * mass.dot(s.velocities.template cast<double>().colwise().squaredNorm());
  };
  Outcome out;
  std::vector<int> held = trial.driven;
  held.insert(held.end(), settings.pinned.begin(), settings.pinned.end());
  const double start = kinetic(state) + elastic(network, state);
  double work = 0, moved = 0, last = start;
  for (int k = 0; k < steps; ++k) {
    const ClothInput<S> input = trial.input<S>(k);
    const ClothState<double> before{state.positions.template cast<double>(),
                                    state.velocities.template cast<double>()};
    if (!model.step(state, input, S(trial.dt), ws).advanced) {
      ++out.refused;
      break;
    }
    if (!all_finite(state.positions) || !all_finite(state.velocities)) out.finite = false;
    if (!out.finite) break;
    const Points<double> x = state.positions.template cast<double>();
    const Points<double> step = x - before.positions;
    const std::array<double, 2> points = point_work(input, held, x, step);
    const double done =
        settings.gravity.template cast<double>().dot(step * mass) +
        hand_work(trial, network, held, before, x, ws.velocity.template cast<double>()) + points[0];
    work += done + points[1] - points[0];
    moved += std::abs(done) + points[1] - points[0];
    const double energy = kinetic(state) + elastic(network, state);
    out.gain = std::max(out.gain, (energy - start - work) / (start + moved));
    if (S(0) < ws.kept)
      out.step_gain = std::max(out.step_gain, (energy - last - done) / (start + moved));
    last = energy;
    const double reach = step.cwiseAbs().maxCoeff();
    const double fastest = std::sqrt(2.0 * (start + moved) / mass.minCoeff());
    if (!(reach <= 1.1 * fastest * trial.dt + 1e-6)) out.bounded = false;
  }
  return out;
}

/// h² k / m of the lightest vertex: float factors step matrices up to about 1e5.
double stiffness_ratio(const Trial& trial) {
  double stiffest = 0;
  for (const Spring<double>& s : trial.network.springs) stiffest = std::max(stiffest, s.stiffness);
  for (const BendStencil<double>& b : trial.network.bends) {
    double square = 0;
    for (const double w : b.weight) square += w * w;
    stiffest = std::max(stiffest, b.stiffness * square);
  }
  return trial.dt * trial.dt * stiffest / trial.network.mass.minCoeff();
}

/// A known failure of the full tier: hands may take energy out of a body in a step, by their forces
/// at the end of it, more than its whole kinetic energy can pay. So of 10⁶ bodies in double 2 gain
/// more than one percent with single linear solves, of 640,000 with Newton 9 (the worst 180 %; the
/// first is seed 28447).
template <class S>
void run_all(int trials, int steps, double allowed, double stiffest, bool folded = false) {
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    int failed = 0;
    double worst = 0;
    for (int seed = 0; seed < trials; ++seed) {
      Trial trial(static_cast<std::uint64_t>(seed), folded);
      if (folded) trial.add_folds(static_cast<std::uint64_t>(seed));
      if (stiffest < stiffness_ratio(trial)) continue;
      const Outcome out = run<S>(trial, integration, steps);
      const double gain = folded ? std::max(out.gain, out.step_gain) : out.gain;
      worst = std::max(worst, gain);
      const bool good = out.finite && out.bounded && out.refused == 0 && gain <= allowed;
      if (good) continue;
      CAPTURE(seed, integration, out.finite, out.bounded, out.refused, gain);
      if (++failed < 10) CHECK(good);
    }
    CAPTURE(integration, worst, trials);
    CHECK(failed == 0);
  }
}

}  // namespace

TEST_CASE("random bodies never explode and never create energy, in double", "[cloth]") {
  run_all<double>(clothctl_test::trials(1500, 1000000, 100), 40, 0.01, 1e300);
}

TEST_CASE("random bodies never explode and never create energy, in float", "[cloth]") {
  run_all<float>(clothctl_test::trials(500, 200000, 30), 40, 0.01, 1e5);
}

TEST_CASE("folded and attached bodies never explode and never create energy, in double",
          "[cloth]") {
  run_all<double>(clothctl_test::trials(1000, 200000, 60), 40, 1e-6, 1e300, true);
}

TEST_CASE("folded and attached bodies never explode and never create energy, in float", "[cloth]") {
  run_all<float>(clothctl_test::trials(500, 100000, 30), 40, 1e-6, 1e5, true);
}

TEST_CASE("a step in float that advances without the limit of energy advances with it", "[cloth]") {
  // Step matrices that float can hardly factor: Newton steps of the limit may fail.
  const int count = clothctl_test::trials(600, 20000, 40);
  int hard = 0;
  for (int seed = 0; seed < count; ++seed) {
    Trial trial(static_cast<std::uint64_t>(seed), true);
    const bool iterative = seed % 2 == 0;
    trial.network.mass *= seed % 6 < 2 ? 1.0 : seed % 6 < 4 ? 1e-2 : 1e-4;
    if (!(1e4 < stiffness_ratio(trial))) continue;
    ++hard;
    std::array<bool, 2> advanced{false, false};
    MassSpringSettings<float> settings;
    settings.gravity = trial.gravity.cast<float>();
    settings.pinned = trial.pinned;
    settings.max_linear_iterations = 200;
    settings.max_iterations = 20;
    if (iterative) settings.linear_solver = LinearSolver::ConjugateGradient;
    for (const bool limited : {false, true}) {
      settings.limit_energy = limited;
      const auto model = MassSpring<float>::create(trial.network.cast<float>(), settings).value();
      auto ws = model.make_workspace();
      ClothState<float> state = trial.state<float>();
      const StepReport<float> report = model.step(state, {}, static_cast<float>(trial.dt), ws);
      advanced[limited ? 1 : 0] = report.advanced;
      CHECK(all_finite(state.positions));
      // The single solve counts as one; each Newton step as one.
      if (limited && !iterative) CHECK(report.iterations <= 1 + settings.max_iterations);
    }
    INFO(seed);
    if (advanced[0]) CHECK(advanced[1]);
  }
  CHECK(hard > count / 12);
}
