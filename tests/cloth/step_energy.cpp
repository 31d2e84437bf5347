// The energy of a Newton step: its gradient by differences, its value against the formula, and the
// residual that ends the iterations.

#include "clothctl/cloth/detail/step_energy.hpp"

#include <limits>
#include <random>

#include "clothctl/linalg/nested_dissection.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

constexpr double kDt = 0.01, kDrag = 0.7;

// A small damped sheet in the air, with random positions, velocities and outer forces.
struct Step {
  SpringNetwork<double> network;
  ClothState<double> state;
  Points<double> v;
  MassSpringWorkspace<double> ws;
  double stiffness = 0.0;

  Step() {
    network = sheet_network<double>(make_grid<double>(4, 3, 0.2, 0.3).value(), Material<double>())
                  .value();
    for (Spring<double>& s : network.springs) s.damping = 0.02;
    const SpringPattern<double> pattern(network, BendingBlocks::All, true);
    const EliminationTree tree =
        nested_dissection<double>(pattern.matrix(), network.rest_positions);
    ws.reserve(network, pattern.matrix(), tree, network.triangles.size());
    std::mt19937 random(4);
    std::normal_distribution<double> normal;
    const auto noise = [&](double size) -> Points<double> {
      return Points<double>::NullaryExpr(3, network.vertex_count(),
                                         [&] { return size * normal(random); });
    };
    state.positions = network.rest_positions + noise(0.01);
    state.velocities = noise(0.2);
    v = noise(0.2);
    ws.outer = noise(0.05);
    spring_directions<double>(network, state.positions, ws.direction);
    for (Matrix3<double>& C : ws.air) {
      const Matrix3<double> m =
          Matrix3<double>::NullaryExpr([&](Index, Index) { return 0.1 * normal(random); });
      C = m * m.transpose();
    }
    for (const Spring<double>& s : network.springs) stiffness += s.stiffness;
  }

  StepEnergy<double> at(const Points<double>& velocity) {
    return step_energy(network, kDrag, stiffness, state, velocity, kDt, ws);
  }
};

}  // namespace

TEST_CASE("the gradient of a step's energy is that of its value", "[cloth]") {
  Step step;
  step.at(step.v);
  const Points<double> gradient = step.ws.gradient;
  CHECK((step.ws.position - (step.state.positions + kDt * step.v)).norm() <= 1e-15);
  for (Index k = 0; k < gradient.size(); ++k) {
    const double h = 1e-5;
    Points<double> more = step.v, less = step.v;
    more.data()[k] += h;
    less.data()[k] -= h;
    const double slope = (step.at(more).value - step.at(less).value) / (2.0 * h);
    CHECK(gradient.data()[k] == Approx(slope).epsilon(1e-6).margin(1e-9));
  }
}

TEST_CASE("a step's energy is the sum of its terms", "[cloth]") {
  Step step;
  const double value = step.at(step.v).value;
  const Points<double> x = step.state.positions + kDt * step.v;
  Points<double> force = Points<double>::Zero(3, x.cols());
  double expected = add_spring_forces<double>(step.network, x, force);
  for (Index i = 0; i < x.cols(); ++i) {
    const double m = step.network.mass[i];
    expected += 0.5 * m * (step.v - step.state.velocities).col(i).squaredNorm();
    expected += 0.5 * kDt * kDrag * m * step.v.col(i).squaredNorm();
    expected -= kDt * step.ws.outer.col(i).dot(step.v.col(i));
  }
  for (std::size_t e = 0; e < step.network.springs.size(); ++e) {
    const Spring<double>& s = step.network.springs[e];
    const Vector3<double> difference = step.v.col(s.a) - step.v.col(s.b);
    const double rate = step.ws.direction.col(static_cast<Index>(e)).dot(difference);
    expected += 0.5 * kDt * s.damping * rate * rate;
  }
  for (std::size_t t = 0; t < step.network.triangles.size(); ++t) {
    const auto& triangle = step.network.triangles[t];
    const Vector3<double> mean =
        (step.v.col(triangle[0]) + step.v.col(triangle[1]) + step.v.col(triangle[2])) / 3.0;
    expected += 0.5 * kDt * mean.dot(step.ws.air[t] * mean);
  }
  CHECK(value == Approx(expected).epsilon(1e-13));
}

TEST_CASE("held vertices add no kinetic energy, and their gradient is the impulse on them",
          "[cloth]") {
  Step step;
  const double free = step.at(step.v).value;
  const Points<double> gradient = step.ws.gradient;
  step.ws.held[2] = 1;
  const double held = step.at(step.v).value;
  const double m = step.network.mass[2];
  const double part = 0.5 * m * (step.v - step.state.velocities).col(2).squaredNorm() +
                      0.5 * kDt * kDrag * m * step.v.col(2).squaredNorm() -
                      kDt * step.ws.outer.col(2).dot(step.v.col(2));
  CHECK(free - held == Approx(part).epsilon(1e-10));
  CHECK(step.ws.gradient == gradient);
}

TEST_CASE("the residual is minus the gradient on free vertices and sees each entry", "[cloth]") {
  Step step;
  step.at(step.v);
  step.ws.held[1] = 1;
  const double m = step.network.mass[4];
  double largest = 0.0;
  CHECK_FALSE(load_residual(step.network, 1e-6, largest, step.ws));
  Points<double> expected = -step.ws.gradient;
  expected.col(1).setZero();
  CHECK(as_points(step.ws.rhs) == expected);
  CHECK(largest == expected.cwiseAbs().maxCoeff());
  for (Index c = 0; c < 3; ++c) {
    step.ws.gradient.setZero();
    step.ws.gradient.col(1).setConstant(1e9);  // held: it does not count
    step.ws.gradient(c, 4) = -0.999e-6 * m;
    CHECK(load_residual(step.network, 1e-6, largest, step.ws));
    step.ws.gradient(c, 4) = -1.001e-6 * m;
    CHECK_FALSE(load_residual(step.network, 1e-6, largest, step.ws));
    step.ws.gradient(c, 4) = std::numeric_limits<double>::quiet_NaN();
    CHECK_FALSE(load_residual(step.network, 1e-6, largest, step.ws));
    CHECK(std::isnan(largest));
  }
}

TEST_CASE("a step's energy is computed without allocating, with a bound on its rounding",
          "[cloth]") {
  Step step;
  const long before = clothctl_test::allocations();
  const StepEnergy<double> energy = step.at(step.v);
  double largest = 0.0;
  load_residual(step.network, 1e-6, largest, step.ws);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  // All terms by magnitude, and what the rounding of positions does to the springs.
  const Points<double> x = step.state.positions + kDt * step.v;
  Points<double> force = Points<double>::Zero(3, x.cols());
  const double springs = add_spring_forces<double>(step.network, x, force);
  double work = 0.0, gains = 0.0;
  for (Index i = 0; i < x.cols(); ++i) {
    const double gain = kDt * step.ws.outer.col(i).dot(step.v.col(i));
    work += gain;
    gains += std::abs(gain);
  }
  const double rounding = std::sqrt(2.0 * springs * step.stiffness) * x.cwiseAbs().maxCoeff();
  CHECK(gains > 1.5 * std::abs(work));
  CHECK(rounding > 0.1 * gains);
  CHECK(energy.size == Approx(energy.value + work + gains + rounding).epsilon(1e-12));
}
