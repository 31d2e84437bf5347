#include "clothctl/cloth/position_based.hpp"

#include <cmath>
#include <fstream>
#include <random>
#include <sstream>
#include <type_traits>

#include <Eigen/Geometry>

#include "clothctl/cloth/position_based_settings.hpp"
#include "clothctl/concepts/cloth.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/rope.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/network/solid.hpp"
#include "laws/cloth_laws.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/shared_data.hpp"

using namespace clothctl;

static_assert(ClothModel<PositionBased<double>, double>);
static_assert(ClothModel<PositionBased<float>, float>);

namespace {

template <class Scalar>
void link(SpringNetwork<Scalar>& network, int a, int b, double stiffness, double damping = 0) {
  const Vector3<Scalar> d = network.rest_positions.col(a) - network.rest_positions.col(b);
  network.springs.push_back({a, b, d.norm(), Scalar(stiffness), Scalar(damping)});
}

template <class Scalar>
void second_difference(SpringNetwork<Scalar>& network, int a, int b, int c, double stiffness) {
  BendStencil<Scalar> stencil;
  stencil.vertex = {a, b, c, 0};
  stencil.weight = {Scalar(1), Scalar(-2), Scalar(1), Scalar(0)};
  stencil.stiffness = Scalar(stiffness);
  stencil.count = 3;
  network.bends.push_back(stencil);
}

/// Vertices in a row along -z, `spacing` apart.
template <class Scalar>
SpringNetwork<Scalar> chain(int count, double spacing, double mass, double stiffness,
                            double damping) {
  SpringNetwork<Scalar> network;
  network.rest_positions.setZero(3, count);
  network.mass.setConstant(count, Scalar(mass));
  for (int i = 0; i < count; ++i) network.rest_positions(2, i) = Scalar(-spacing * i);
  for (int i = 0; i + 1 < count; ++i) link(network, i, i + 1, stiffness, damping);
  return network;
}

/// A horizontal n×n sheet: edges, diagonals, stencils along rows and columns, triangles.
template <class Scalar>
SpringNetwork<Scalar> level_sheet(int n, double size, double mass, double stiffness,
                                  double bending) {
  SpringNetwork<Scalar> network;
  network.rest_positions.setZero(3, n * n);
  network.mass.setConstant(n * n, Scalar(mass / (n * n)));
  const auto at = [n](int i, int j) { return j * n + i; };
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      network.rest_positions(0, at(i, j)) = Scalar(size * i / (n - 1));
      network.rest_positions(1, at(i, j)) = Scalar(size * j / (n - 1));
    }
  }
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      if (i + 1 < n) link(network, at(i, j), at(i + 1, j), stiffness, 0.002 * stiffness);
      if (j + 1 < n) link(network, at(i, j), at(i, j + 1), stiffness, 0.002 * stiffness);
      if (i + 2 < n) second_difference(network, at(i, j), at(i + 1, j), at(i + 2, j), bending);
      if (j + 2 < n) second_difference(network, at(i, j), at(i, j + 1), at(i, j + 2), bending);
      if (i + 1 == n || j + 1 == n) continue;
      link(network, at(i, j), at(i + 1, j + 1), 0.2 * stiffness);
      link(network, at(i + 1, j), at(i, j + 1), 0.2 * stiffness);
      network.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      network.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return network;
}

template <class Scalar>
PositionBased<Scalar> make(SpringNetwork<Scalar> network,
                           PositionBasedSettings<Scalar> settings = {}) {
  Result<PositionBased<Scalar>> made =
      PositionBased<Scalar>::create(std::move(network), std::move(settings));
  if (!made) FAIL(made.error());
  return std::move(made).value();
}

template <class Scalar>
PositionBasedSettings<Scalar> weightless(int substeps, int iterations) {
  PositionBasedSettings<Scalar> settings;
  settings.substeps = substeps;
  settings.iterations = iterations;
  settings.gravity.setZero();
  return settings;
}

/// Holds vertices at their positions in `state`.
template <class Scalar>
ClothInput<Scalar> hold(const ClothState<Scalar>& state, std::vector<int> vertices) {
  ClothInput<Scalar> input;
  input.driven_positions.resize(3, static_cast<Index>(vertices.size()));
  for (std::size_t i = 0; i < vertices.size(); ++i)
    input.driven_positions.col(static_cast<Index>(i)) = state.positions.col(vertices[i]);
  input.driven_vertices = std::move(vertices);
  return input;
}

template <class Scalar>
void run(const PositionBased<Scalar>& model, ClothState<Scalar>& state,
         const ClothInput<Scalar>& input, Scalar dt, int steps) {
  auto workspace = model.make_workspace();
  for (int i = 0; i < steps; ++i) REQUIRE(model.step(state, input, dt, workspace).advanced);
}

/// Kinetic, spring and bending energy.
double energy(const SpringNetwork<double>& network, const ClothState<double>& state) {
  double sum = 0;
  for (Index i = 0; i < network.vertex_count(); ++i)
    sum += 0.5 * network.mass[i] * state.velocities.col(i).squaredNorm();
  for (const Spring<double>& s : network.springs) {
    const double stretch =
        (state.positions.col(s.a) - state.positions.col(s.b)).norm() - s.rest_length;
    sum += 0.5 * s.stiffness * stretch * stretch;
  }
  for (const BendStencil<double>& s : network.bends) {
    Vector3<double> error = Vector3<double>::Zero();
    for (std::size_t i = 0; i < static_cast<std::size_t>(s.count); ++i)
      error += s.weight[i] * state.positions.col(s.vertex[i]);
    sum += 0.5 * s.stiffness * error.squaredNorm();
  }
  return sum;
}

Points<double> random_points(std::mt19937& random, Index n, double scale) {
  std::uniform_real_distribution<double> uniform(-scale, scale);
  return Points<double>::NullaryExpr(3, n, [&]() { return uniform(random); });
}

/// Displacement of one end of a stretched two-mass spring after `time`, divided by its first value.
double oscillator(double damping, double time, int substeps) {
  const PositionBased<double> model =
      make(chain<double>(2, 1.0, 0.5, 100.0, damping), weightless<double>(substeps, 1));
  ClothState<double> state = model.rest_state();
  state.positions(2, 1) -= 0.02;
  auto workspace = model.make_workspace();
  REQUIRE(model.step(state, {}, time, workspace).advanced);
  return (state.positions(2, 0) - state.positions(2, 1) - 1.0) / 0.02;
}

}  // namespace

TEMPLATE_TEST_CASE("Verlet reproduces the reference trajectory vertex by vertex",
                   "[position_based]", float, double, long double) {
  using Scalar = TestType;
  const std::string path = clothctl_test::shared_path("data/cloth/ref/d_pbd_traj.csv");
  if (path.empty()) {
    WARN("skipped: data/cloth/ref/d_pbd_traj.csv is not there");
    return;
  }
  const int n = 8;
  SpringNetwork<Scalar> network;
  network.rest_positions.setZero(3, n * n);
  network.mass.setOnes(n * n);
  const auto at = [](int i, int j) { return j * n + i; };
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i)
      network.rest_positions.col(at(i, j)) << Scalar(0.1 * i), Scalar(0.1 * j), Scalar(0);
  }
  PositionBasedSettings<Scalar> settings = PositionBasedSettings<Scalar>::verlet();
  const auto stick = [&](int a, int b, double relaxation) {
    link(network, a, b, 1.0);
    settings.spring_relaxation.push_back(Scalar(relaxation));
  };
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i + 1 < n; ++i) stick(at(i, j), at(i + 1, j), 1.0);
  }
  for (int j = 0; j + 1 < n; ++j) {
    for (int i = 0; i < n; ++i) stick(at(i, j), at(i, j + 1), 1.0);
  }
  for (int j = 0; j + 1 < n; ++j) {
    for (int i = 0; i + 1 < n; ++i) {
      stick(at(i, j), at(i + 1, j + 1), 0.8);
      stick(at(i + 1, j), at(i, j + 1), 0.8);
    }
  }
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i + 2 < n; ++i) stick(at(i, j), at(i + 2, j), 0.2);
  }
  for (int j = 0; j + 2 < n; ++j) {
    for (int i = 0; i < n; ++i) stick(at(i, j), at(i, j + 2), 0.2);
  }
  REQUIRE(network.springs.size() == 306);
  settings.pinned = {56, 63};
  const PositionBased<Scalar> model = make(network, settings);

  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  ClothState<Scalar> state = model.rest_state();
  auto workspace = model.make_workspace();
  int reached = 0, compared = 0;
  double worst = 0;
  while (std::getline(file, line)) {
    std::istringstream cells(line);
    int step = 0, node = 0;
    double x = 0, y = 0, z = 0;
    char comma = 0;
    cells >> step >> comma >> node >> comma >> x >> comma >> y >> comma >> z;
    REQUIRE(cells);
    for (; reached < step; ++reached)
      REQUIRE(model.step(state, {}, Scalar(1.0 / 60.0), workspace).advanced);
    worst = std::max(
        worst,
        (state.positions.col(node).template cast<double>() - Vector3<double>(x, y, z)).norm());
    ++compared;
  }
  CHECK(reached == 60);
  CHECK(compared > 1000);
  INFO("largest distance " << worst);
  CHECK(worst < (std::is_same_v<Scalar, float> ? 1e-3 : 2e-12));
}

TEST_CASE("XPBD with many substeps converges to the spring's own oscillation with order one",
          "[position_based]") {
  // omega² = k (1/m + 1/m) = 400, and for the damper: delta = d (1/m + 1/m)/2.
  const double omega = 20, time = 0.9 * 2 * 3.14159265358979 / omega;
  CHECK(std::abs(oscillator(0, time, 100000) - std::cos(omega * time)) < 2e-4);
  const double delta = 0.8 * 2, damped = std::sqrt(omega * omega - delta * delta);
  const double exact = std::exp(-delta * time) *
                       (std::cos(damped * time) + delta / damped * std::sin(damped * time));
  CHECK(std::abs(oscillator(0.8, time, 100000) - exact) < 2e-4);
  for (const auto& [damping, value] :
       {std::pair{0.0, std::cos(omega * time)}, std::pair{0.8, exact}}) {
    const double coarse = oscillator(damping, time, 2000) - value;
    const double fine = oscillator(damping, time, 4000) - value;
    CHECK(coarse / fine == Approx(2).margin(0.05));
  }
}

TEMPLATE_TEST_CASE("a hanging weight stretches its springs by weight divided by stiffness",
                   "[position_based]", float, double) {
  using Scalar = TestType;
  const double mass = 0.1, stiffness = 200;
  const int count = 4;
  PositionBasedSettings<Scalar> settings;
  settings.iterations = 60;
  settings.substeps = 5;
  const PositionBased<Scalar> model =
      make(chain<Scalar>(count, 0.1, mass, stiffness, 2.0), settings);
  ClothState<Scalar> state = model.rest_state();
  run(model, state, hold(state, {0}), Scalar(0.02), 500);
  for (int i = 0; i + 1 < count; ++i) {
    const double length =
        static_cast<double>((state.positions.col(i) - state.positions.col(i + 1)).norm());
    const double expected = (count - 1 - i) * mass * 9.81 / stiffness;
    CHECK(length - 0.1 == Approx(expected).epsilon(std::is_same_v<Scalar, float> ? 1e-3 : 1e-9));
  }
  CHECK(state.velocities.cwiseAbs().maxCoeff() < Scalar(1e-3));
}

TEST_CASE("a bending stencil deflects by weight divided by stiffness", "[position_based]") {
  SpringNetwork<double> network;
  network.rest_positions.setZero(3, 4);
  network.rest_positions.row(0) << 0, 0.1, 0.2, 0.3;
  network.mass.setConstant(4, 0.01);
  SECTION("three vertices") {
    second_difference(network, 0, 1, 2, 5.0);
    network.rest_positions.col(3).setZero();
  }
  SECTION("four vertices") {
    BendStencil<double> stencil;
    stencil.vertex = {0, 1, 3, 2};
    stencil.weight = {-1, 2, 1, -2};
    stencil.stiffness = 5.0;
    stencil.count = 4;
    network.bends.push_back(stencil);
    network.rest_positions.row(0) << 0, 0.1, 0.0, 0.2;
    network.rest_positions(0, 2) = 0.2;
    network.rest_positions(0, 3) = 0.2;
  }
  const Index free = network.bends[0].count == 3 ? 2 : 3;
  PositionBasedSettings<double> settings;
  settings.drag = 10;
  settings.pinned =
      network.bends[0].count == 3 ? std::vector<int>{0, 1, 3} : std::vector<int>{0, 1, 2};
  const PositionBased<double> model = make(network, settings);
  ClothState<double> state = model.rest_state();
  run(model, state, {}, 0.02, 300);
  CHECK(state.positions(2, free) == Approx(-0.01 * 9.81 / 5.0));
}

TEST_CASE("a weightless sheet at rest does not move", "[position_based]") {
  const SpringNetwork<double> network = level_sheet<double>(6, 0.3, 0.02, 1000, 0.1);
  PositionBasedSettings<double> verlet = PositionBasedSettings<double>::verlet();
  verlet.gravity.setZero();
  for (const PositionBasedSettings<double>& settings : {weightless<double>(20, 2), verlet}) {
    const PositionBased<double> model = make(network, settings);
    ClothState<double> state = model.rest_state();
    run(model, state, {}, 0.02, 20);
    CHECK((state.positions - network.rest_positions).cwiseAbs().maxCoeff() < 1e-13);
  }
}

TEST_CASE("XPBD conserves momentum and gains no energy without input", "[position_based]") {
  std::mt19937 random(11);
  SpringNetwork<double> network = level_sheet<double>(7, 0.3, 0.02, 1000, 0.1);
  for (Index i = 0; i < network.mass.size(); ++i)
    network.mass[i] *= 0.5 + 0.1 * static_cast<double>(i % 10);
  // Converged substeps lose energy in each step. With few sweeps, errors come and go but do not
  // accumulate.
  for (const auto& [sweeps, slack] : {std::pair{100, 1e-9}, std::pair{2, 0.3}}) {
    const PositionBased<double> model = make(network, weightless<double>(20, sweeps));
    auto workspace = model.make_workspace();
    ClothState<double> state = model.rest_state();
    state.velocities = random_points(random, model.vertex_count(), 1.0);
    const Vector3<double> momentum = state.velocities * network.mass;
    const double first = energy(network, state);
    double before = first;
    for (int step = 0; step < 100; ++step) {
      REQUIRE(model.step(state, {}, 0.02, workspace).advanced);
      const double after = energy(network, state);
      CHECK(after <= before * (1 + slack));
      CHECK(after <= first);
      before = after;
    }
    CHECK((state.velocities * network.mass - momentum).norm() < 1e-11);
    CHECK(before < 0.5 * first);
  }
}

TEST_CASE("Verlet conserves momentum up to its damping and keeps lengths", "[position_based]") {
  std::mt19937 random(12);
  const SpringNetwork<double> network = level_sheet<double>(7, 0.3, 0.02, 1000, 0.1);
  PositionBasedSettings<double> settings = PositionBasedSettings<double>::verlet();
  settings.gravity.setZero();
  settings.iterations = 40;
  const PositionBased<double> model = make(network, settings);
  ClothState<double> state = model.rest_state();
  state.velocities = random_points(random, model.vertex_count(), 0.2);
  const Vector3<double> momentum = state.velocities * network.mass;
  run(model, state, {}, 0.01, 50);
  CHECK((state.velocities * network.mass - std::pow(0.99, 50) * momentum).norm() < 1e-15);
  for (const Spring<double>& s : network.springs) {
    const double length = (state.positions.col(s.a) - state.positions.col(s.b)).norm();
    CHECK(length == Approx(s.rest_length).epsilon(0.01));
  }
}

TEST_CASE("a step does not depend on the sheet's position and orientation", "[position_based]") {
  std::mt19937 random(13);
  const SpringNetwork<double> network = level_sheet<double>(5, 0.3, 0.02, 1000, 0.1);
  PositionBasedSettings<double> settings = weightless<double>(10, 3);
  settings.air.normal_coefficient = 1.2;
  settings.air.tangent_coefficient = 0.1;
  PositionBasedSettings<double> verlet = settings;
  verlet.scheme = PositionScheme::Verlet;
  for (const PositionBasedSettings<double>& chosen : {settings, verlet}) {
    const PositionBased<double> model = make(network, chosen);
    ClothState<double> state = model.rest_state();
    state.positions += random_points(random, model.vertex_count(), 0.01);
    state.velocities = random_points(random, model.vertex_count(), 0.5);
    ClothInput<double> input = hold(state, {0});
    input.driven_positions.col(0).array() += 0.01;
    input.force_vertices = {24, 7, 24};
    input.forces = random_points(random, 3, 0.05);
    input.wind = Vector3<double>(1, -2, 0.5);
    const Matrix3<double> R =
        Eigen::Quaterniond(0.3, -0.8, 0.2, 0.5).normalized().toRotationMatrix();
    const Vector3<double> shift(3, -2, 1);

    ClothState<double> moved{(R * state.positions).colwise() + shift, R * state.velocities};
    ClothInput<double> moved_input = input;
    moved_input.driven_positions = (R * input.driven_positions).colwise() + shift;
    moved_input.forces = R * input.forces;
    moved_input.wind = R * input.wind;
    run(model, state, input, 0.02, 1);
    run(model, moved, moved_input, 0.02, 1);
    CHECK((moved.positions - ((R * state.positions).colwise() + shift)).norm() < 1e-12);
    CHECK((moved.velocities - R * state.velocities).norm() < 1e-9);
  }
}

TEST_CASE("free fall and drag follow their formulas", "[position_based]") {
  SpringNetwork<double> network;
  network.rest_positions.setZero(3, 1);
  network.mass.setConstant(1, 2.0);
  PositionBasedSettings<double> settings;
  settings.substeps = 8;
  settings.drag = 0.7;
  const PositionBased<double> model = make(network, settings);
  ClothState<double> state = model.rest_state();
  state.velocities.col(0) << 1, 0, 0;
  ClothInput<double> input;
  input.force_vertices = {0, 0};
  input.forces = Points<double>::Zero(3, 2);
  input.forces.row(1) << 3.0, 5.0;
  run(model, state, input, 0.02, 50);
  const double h = 0.02 / 8, decay = std::pow(1 + h * 0.7, -400);
  CHECK(state.velocities(0, 0) == Approx(decay));
  CHECK(state.velocities(1, 0) == Approx(4.0 / 0.7 * (1 - decay)));
  CHECK(state.velocities(2, 0) == Approx(-9.81 / 0.7 * (1 - decay)));
}

TEST_CASE("a falling triangle reaches the speed at which drag balances its weight",
          "[position_based]") {
  SpringNetwork<double> network;
  network.rest_positions.setZero(3, 3);
  network.rest_positions.col(1) << 0.5, 0, 0;
  network.rest_positions.col(2) << 0, 0.5, 0;
  network.mass.setConstant(3, 0.01);
  network.triangles.push_back({0, 1, 2});
  for (int i = 0; i < 3; ++i) link(network, i, (i + 1) % 3, 1000);
  PositionBasedSettings<double> settings;
  settings.air.normal_coefficient = 1.2;
  settings.air.tangent_coefficient = 0.1;
  for (const auto& chosen : {settings, PositionBasedSettings<double>::verlet()}) {
    settings.scheme = chosen.scheme;
    settings.verlet_damping = 0;
    const PositionBased<double> model = make(network, settings);
    ClothState<double> state = model.rest_state();
    ClothInput<double> input;
    input.wind = Vector3<double>(1.0, 0, 2.0);
    run(model, state, input, 0.02, 1500);
    const double through = std::sqrt(2 * 0.03 * 9.81 / (1.2 * 1.2 * 0.125));
    for (Index i = 0; i < 3; ++i) {
      // Weight and air act one after the other in a substep, so the speed may be off by its share
      // of g h.
      CHECK(state.velocities(2, i) == Approx(2.0 - through).margin(0.6 * 9.81 * 0.001));
      CHECK(state.velocities(0, i) == Approx(1.0).epsilon(0.15));
    }
  }
}

TEMPLATE_TEST_CASE("driven vertices end exactly at their targets", "[position_based]", float,
                   double) {
  using Scalar = TestType;
  PositionBasedSettings<Scalar> verlet = PositionBasedSettings<Scalar>::verlet();
  verlet.substeps = 3;
  PositionBasedSettings<Scalar> pinned;
  pinned.pinned = {0, 24};
  for (const PositionBasedSettings<Scalar>& settings :
       {PositionBasedSettings<Scalar>(), verlet, pinned}) {
    const PositionBased<Scalar> model =
        make(level_sheet<Scalar>(5, 0.3, 0.02, 1000, 0.1), settings);
    ClothState<Scalar> state = model.rest_state();
    state.velocities.setConstant(Scalar(0.3));
    const ClothState<Scalar> start = state;
    ClothInput<Scalar> input;
    input.driven_vertices = {24, 3};
    input.driven_positions.resize(3, 2);
    input.driven_positions << Scalar(0.31), Scalar(0.21), Scalar(0.29), Scalar(0.01), Scalar(0.013),
        Scalar(-0.02);
    input.force_vertices = {24};
    input.forces = Points<Scalar>::Constant(3, 1, Scalar(1e4));
    auto workspace = model.make_workspace();
    const StepReport<Scalar> report = model.step(state, input, Scalar(0.02), workspace);
    CHECK(report.status == StepStatus::Converged);
    CHECK(report.advanced);
    CHECK(report.iterations == settings.substeps * settings.iterations);
    CHECK(state.positions.col(24) == input.driven_positions.col(0));
    CHECK(state.positions.col(3) == input.driven_positions.col(1));
    const Vector3<Scalar> velocity =
        (input.driven_positions.col(0) - start.positions.col(24)) / Scalar(0.02);
    CHECK((state.velocities.col(24) - velocity).norm() <= Scalar(1e-5) * velocity.norm());
    CHECK(state.positions.cwiseAbs().maxCoeff() < Scalar(1));
    if (!settings.pinned.empty()) {
      CHECK(state.positions.col(0) == start.positions.col(0));
      CHECK(state.velocities.col(0).isZero(Scalar(0)));
    }
  }
}

TEST_CASE("forces on light corners leave them in bounds", "[position_based]") {
  SpringNetwork<double> network = level_sheet<double>(9, 0.5, 0.05, 1000, 0.02);
  network.mass[0] *= 1e-2;
  network.mass[8] *= 1e-2;
  PositionBasedSettings<double> settings;
  settings.drag = 0.5;
  const PositionBased<double> model = make(network, settings);
  ClothState<double> state = model.rest_state();
  auto workspace = model.make_workspace();
  ClothInput<double> input = hold(state, {72, 80});
  input.force_vertices = {0, 8};
  input.forces.setZero(3, 2);
  for (int step = 0; step < 400; ++step) {
    // A force of several times the sheet's weight that changes direction every few steps.
    input.forces.col(0) << (step / 7 % 2 == 0 ? 3.0 : -3.0), 0, 1;
    input.forces.col(1) << 0, (step / 5 % 2 == 0 ? 3.0 : -3.0), 1;
    REQUIRE(model.step(state, input, 0.02, workspace).advanced);
    REQUIRE(state.positions.cwiseAbs().maxCoeff() < 2.0);
    REQUIRE(state.velocities.cwiseAbs().maxCoeff() < 100.0);
  }
  input.force_vertices.clear();
  input.forces.resize(3, 0);
  for (int step = 0; step < 600; ++step)
    REQUIRE(model.step(state, input, 0.02, workspace).advanced);
  CHECK(state.velocities.cwiseAbs().maxCoeff() < 0.5);
}

TEST_CASE("springs and stencils without stiffness have no effect", "[position_based]") {
  SpringNetwork<double> network = chain<double>(3, 0.1, 0.01, 0.0, 0.0);
  second_difference(network, 0, 1, 2, 0.0);
  PositionBasedSettings<double> verlet = PositionBasedSettings<double>::verlet();
  verlet.verlet_damping = 0;
  for (const PositionBasedSettings<double>& settings : {PositionBasedSettings<double>(), verlet}) {
    const PositionBased<double> model = make(network, settings);
    ClothState<double> state = model.rest_state();
    run(model, state, hold(state, {0}), 0.01, 1);
    CHECK(state.velocities(2, 1) == Approx(-0.0981));
    CHECK(state.velocities(2, 2) == Approx(-0.0981));
  }
}

TEST_CASE("huge stiffness and coincident vertices give finite states", "[position_based]") {
  PositionBasedSettings<double> verlet = PositionBasedSettings<double>::verlet();
  for (const PositionBasedSettings<double>& settings : {PositionBasedSettings<double>(), verlet}) {
    const PositionBased<double> model = make(chain<double>(5, 0.1, 0.01, 1e30, 0.0), settings);
    ClothState<double> state = model.rest_state();
    state.positions.setZero();
    run(model, state, hold(state, {0}), 0.01, 20);
    CHECK(state.positions.cwiseAbs().maxCoeff() < 1);
    state = model.rest_state();
    run(model, state, hold(state, {0}), 0.01, 100);
    for (int i = 0; i < 4; ++i)
      CHECK((state.positions.col(i) - state.positions.col(i + 1)).norm() ==
            Approx(0.1).epsilon(0.02));
  }
}

TEMPLATE_TEST_CASE("equal input gives equal bits, whatever the workspace was used for before",
                   "[position_based]", float, double) {
  using Scalar = TestType;
  PositionBasedSettings<Scalar> settings;
  settings.air.normal_coefficient = Scalar(1);
  for (const auto& chosen : {settings, PositionBasedSettings<Scalar>::verlet()}) {
    const PositionBased<Scalar> model = make(level_sheet<Scalar>(6, 0.3, 0.02, 1000, 0.1), chosen);
    ClothState<Scalar> first = model.rest_state(), second = first, other = first;
    const ClothInput<Scalar> input = hold(first, {0, 5});
    ClothInput<Scalar> windy = hold(first, {2});
    windy.wind = Vector3<Scalar>(Scalar(3), Scalar(1), Scalar(2));
    auto clean = model.make_workspace(), used = model.make_workspace();
    for (int step = 0; step < 20; ++step) {
      REQUIRE(model.step(first, input, Scalar(0.02), clean).advanced);
      REQUIRE(model.step(other, windy, Scalar(0.01), used).advanced);
      REQUIRE(model.step(second, input, Scalar(0.02), used).advanced);
    }
    CHECK(first == second);
    CHECK_FALSE(first == other);
  }
}

TEST_CASE("a position-based step does not allocate", "[position_based]") {
  if (!clothctl_test::allocation_counting_works()) {
    WARN("skipped: allocations cannot be counted here");
    return;
  }
  PositionBasedSettings<double> settings;
  settings.air.normal_coefficient = 1;
  settings.pinned = {3};
  for (const auto& chosen : {settings, PositionBasedSettings<double>::verlet()}) {
    const PositionBased<double> model = make(level_sheet<double>(12, 0.3, 0.02, 1000, 0.1), chosen);
    ClothState<double> state = model.rest_state();
    ClothInput<double> input = hold(state, {0, 11});
    input.force_vertices = {140};
    input.forces = Points<double>::Constant(3, 1, 0.01);
    auto workspace = model.make_workspace();
    const long before = clothctl_test::allocations();
    for (int step = 0; step < 3; ++step) {
      const StepReport<double> report = model.step(state, input, 0.02, workspace);
      if (!report.advanced) break;
    }
    CHECK(clothctl_test::allocations() == before);
  }
}

TEMPLATE_TEST_CASE("bad input and bad states leave the state unchanged", "[position_based]", float,
                   double) {
  using Scalar = TestType;
  const Scalar infinity = scalar_traits<Scalar>::infinity();
  const Scalar nan = std::numeric_limits<Scalar>::quiet_NaN();
  for (const auto& settings :
       {PositionBasedSettings<Scalar>(), PositionBasedSettings<Scalar>::verlet()}) {
    const PositionBased<Scalar> model =
        make(level_sheet<Scalar>(4, 0.3, 0.02, 1000, 0.1), settings);
    auto workspace = model.make_workspace();
    ClothState<Scalar> good = model.rest_state();
    ClothInput<Scalar> fine = hold(good, {0, 3});
    fine.force_vertices = {7};
    fine.forces = Points<Scalar>::Constant(3, 1, Scalar(0.01));

    const auto refused = [&](ClothInput<Scalar> input, Scalar dt, StepStatus expected) {
      ClothState<Scalar> state = good;
      const StepReport<Scalar> report = model.step(state, input, dt, workspace);
      CHECK(report.status == expected);
      CHECK_FALSE(report.advanced);
      CHECK(state == good);
    };
    const Scalar dt = Scalar(0.02);
    for (Scalar bad : {Scalar(0), Scalar(-0.01), infinity, nan})
      refused(fine, bad, StepStatus::InvalidInput);
    ClothInput<Scalar> input = fine;
    input.forces(1, 0) = nan;
    refused(input, dt, StepStatus::InvalidInput);
    input = fine;
    input.driven_positions(2, 1) = infinity;
    refused(input, dt, StepStatus::InvalidInput);
    input = fine;
    input.wind[0] = nan;
    refused(input, dt, StepStatus::InvalidInput);
    for (int vertex : {-1, 16}) {
      input = fine;
      input.force_vertices[0] = vertex;
      refused(input, dt, StepStatus::InvalidInput);
      input = fine;
      input.driven_vertices[1] = vertex;
      refused(input, dt, StepStatus::InvalidInput);
    }
    input = fine;
    input.driven_vertices[1] = 0;
    refused(input, dt, StepStatus::InvalidInput);
    input = fine;
    input.forces.resize(3, 0);
    refused(input, dt, StepStatus::InvalidInput);
    input = fine;
    input.driven_vertices.pop_back();
    refused(input, dt, StepStatus::InvalidInput);
    // Finite, but the step overflows.
    input = fine;
    input.forces.setConstant(std::numeric_limits<Scalar>::max());
    refused(input, Scalar(10), StepStatus::NumericalFailure);

    for (Scalar bad : {nan, infinity}) {
      for (const bool position : {true, false}) {
        ClothState<Scalar> state = good;
        (position ? state.positions : state.velocities)(1, 5) = bad;
        CHECK(model.step(state, fine, dt, workspace).status == StepStatus::InvalidState);
        (position ? state.positions : state.velocities)(1, 5) =
            (position ? good.positions : good.velocities)(1, 5);
        CHECK(state == good);
      }
    }
    ClothState<Scalar> state = good;
    CHECK(model.step(state, fine, dt, workspace).advanced);
  }
}

TEST_CASE("bad set-up data are refused with the item's name", "[position_based]") {
  using Settings = PositionBasedSettings<double>;
  const SpringNetwork<double> network = level_sheet<double>(3, 0.2, 0.02, 1000, 0.1);
  const auto message = [&](auto change) {
    SpringNetwork<double> changed = network;
    Settings settings;
    change(changed, settings);
    const Result<PositionBased<double>> made = PositionBased<double>::create(changed, settings);
    return made ? std::string("accepted") : made.error();
  };
  using Network = SpringNetwork<double>;
  CHECK(message([](Network&, Settings&) {}) == "accepted");
  CHECK(message([](Network& n, Settings&) { n.mass[4] = 0; }) ==
        "mass of vertex 4 is not positive: 0 kg");
  CHECK(message([](Network& n, Settings&) { n.springs[2].b = 9; }) ==
        "spring 2 joins vertex 9 off the mesh");
  CHECK(message([](Network& n, Settings&) { n.bends[1].vertex[2] = n.bends[1].vertex[0]; }) ==
        "bending stencil 1 holds vertex 0 twice");
  CHECK(message([](Network&, Settings& s) { s.substeps = 0; }) ==
        "substeps is 0, must be 1 to 1000000");
  CHECK(message([](Network&, Settings& s) {
          s.pinned = {0, 9};
        }) == "pinned vertex 9 is off the mesh of 9 vertices");
}

TEMPLATE_TEST_CASE("sheets, ropes and solids obey the laws of cloth in both schemes",
                   "[position_based]", float, double) {
  using Scalar = TestType;
  const GridMesh<Scalar> grid = make_grid<Scalar>(5, 4, Scalar(0.3), Scalar(0.4)).value();
  const TetMesh<Scalar> box =
      make_box<Scalar>(2, 2, 3, Vector3<Scalar>(Scalar(0.1), Scalar(0.1), Scalar(0.15))).value();
  const int which = GENERATE(0, 1, 2);
  CAPTURE(which);
  const SpringNetwork<Scalar> network = which == 0 ? sheet_network(grid, Material<Scalar>()).value()
                                        : which == 1
                                            ? rope_network(RopeSettings<Scalar>()).value()
                                            : solid_network(box, SolidSettings<Scalar>()).value();
  clothctl_test::ClothLaws<Scalar> laws;
  laws.mass = network.mass;
  if (std::is_same_v<Scalar, float>)
    laws.tolerance = Scalar(2e-3);  // velocities are differences of positions divided by h
  PositionBasedSettings<Scalar> settings;
  SECTION("XPBD") {}
  SECTION("XPBD with drag") { settings.drag = laws.drag = Scalar(0.5); }
  SECTION("XPBD with pins and air") {
    laws.pinned = settings.pinned = {16, 18};
    settings.air.normal_coefficient = settings.air.tangent_coefficient = Scalar(1);
    laws.momentum_known = false;
  }
  SECTION("Verlet") {
    settings = PositionBasedSettings<Scalar>::verlet();
    settings.verlet_damping = Scalar(0);
  }
  SECTION("Verlet with damping and air") {
    settings = PositionBasedSettings<Scalar>::verlet();
    settings.air.normal_coefficient = Scalar(1);
    laws.momentum_known = false;
  }
  laws.substeps = settings.substeps;
  laws.gravity = settings.gravity;
  clothctl_test::check_cloth_laws(make(network, settings), laws);
}

TEST_CASE("a material's sheet hangs still at its own length, softer because of unfinished sweeps",
          "[position_based]") {
  const Result<GridMesh<double>> grid = make_grid<double>(9, 9, 0.5, 0.5);
  const Material<double> material;
  const Result<SpringNetwork<double>> network = sheet_network(grid.value(), material);
  double few = 0, many = 0;
  for (const auto& [sweeps, lowest] : {std::pair{2, &few}, std::pair{60, &many}}) {
    PositionBasedSettings<double> settings;
    settings.iterations = sweeps;
    settings.drag = 2.0;
    settings.pinned = {72, 73, 74, 75, 76, 77, 78, 79, 80};
    const PositionBased<double> model = make(network.value(), settings);
    ClothState<double> state = model.rest_state();
    run(model, state, {}, 0.02, 200);
    CHECK(state.velocities.cwiseAbs().maxCoeff() < 1e-3);
    *lowest = state.positions.row(2).minCoeff();
  }
  // Held at the top edge, the strain at height z is the weight below divided by stretch, so the
  // bottom sinks by ρ g H² / (2 stretch).
  const double sink = 0.2 * 9.81 * 0.25 / (2 * 1000);
  CHECK(-0.5 - many == Approx(sink).epsilon(0.2));
  CHECK(few <= many);
  CHECK(few > -0.5 - 20 * sink);
}

namespace {

PositionBased<double> sheet_of(int rows, int cols, bool verlet = false) {
  const GridMesh<double> grid = make_grid<double>(rows, cols, 0.3, 0.3).value();
  return PositionBased<double>::create(
             sheet_network<double>(grid, Material<double>()).value(),
             verlet ? PositionBasedSettings<double>::verlet() : PositionBasedSettings<double>())
      .value();
}

}  // namespace

TEST_CASE("a damped sheet of stiff springs comes to rest with 80 substeps", "[position_based]") {
  // In lanes, and a hair off a grid in batches. Sweeps in one direction only would drive this sheet
  // at more than 0.05 m/s.
  constexpr int kSide = 32;
  for (const double off : {0.0, 1e-4}) {
    SpringNetwork<double> network;
    network.rest_positions = make_grid<double>(kSide, kSide, 1.0, 1.0).value().positions;
    network.rest_positions.row(1).swap(network.rest_positions.row(2));
    for (int v = 0; v < kSide * kSide; ++v)
      network.rest_positions(0, v) += off * std::sin(17.0 * v);
    network.mass.setConstant(kSide * kSide, 0.2 / (kSide * kSide));
    for (int row = 0; row < kSide; ++row) {
      for (int col = 0; col < kSide; ++col) {
        const int v = row * kSide + col;
        if (col + 1 < kSide) link(network, v, v + 1, 1e6);
        if (row + 1 < kSide) link(network, v, v + kSide, 1e6);
        if (col + 1 < kSide && row + 1 < kSide) link(network, v, v + kSide + 1, 1e6);
      }
    }
    PositionBasedSettings<double> settings;
    settings.substeps = 80;
    settings.pinned = {kSide * kSide - kSide, kSide * kSide - 1};
    const auto model = PositionBased<double>::create(network, settings).value();
    auto ws = model.make_workspace();
    ClothState<double> state = model.rest_state();
    for (int frame = 0; frame < 240; ++frame) {
      REQUIRE(model.step(state, {}, 1.0 / 60, ws).advanced);
      state.velocities *= 0.9;
    }
    CAPTURE(off);
    CHECK(std::sqrt(state.velocities.colwise().squaredNorm().mean()) < 2e-3);
  }
}

TEST_CASE("a position-based step refuses a workspace of another model", "[position_based]") {
  for (const bool verlet : {false, true}) {
    const PositionBased<double> model = sheet_of(6, 6, verlet);
    ClothState<double> state = model.rest_state();
    const ClothState<double> before = state;
    const ClothInput<double> input;
    std::vector<PositionBased<double>::Workspace> wrong{sheet_of(3, 3, verlet).make_workspace(),
                                                        sheet_of(9, 9, verlet).make_workspace(),
                                                        sheet_of(4, 9, verlet).make_workspace(),
                                                        sheet_of(6, 6, !verlet).make_workspace(),
                                                        {}};
    for (PositionBased<double>::Workspace& ws : wrong) {
      const StepReport<double> report = model.step(state, input, 0.02, ws);
      CHECK(report.status == StepStatus::InvalidWorkspace);
      CHECK_FALSE(report.advanced);
      CHECK(state == before);
      CHECK(model.check_input(state, input, 0.02, ws) ==
            "the workspace was made by another model; use make_workspace() of the model that "
            "steps");
    }
  }
}

TEST_CASE("check_input says why a position-based step is refused", "[position_based]") {
  const PositionBased<double> model = sheet_of(4, 4);
  ClothState<double> state = model.rest_state();
  auto ws = model.make_workspace();
  ClothInput<double> input;
  CHECK(model.check_input(state, input, 0.02, ws).empty());
  for (const double dt : {std::nan(""), -0.02, 0.0}) {
    CHECK(model.step(state, input, dt, ws).status == StepStatus::InvalidInput);
    CHECK(model.check_input(state, input, dt, ws).find("step length dt") == 0);
  }
  state.velocities(1, 3) = std::nan("");
  CHECK(model.step(state, input, 0.02, ws).status == StepStatus::InvalidState);
  CHECK(model.check_input(state, input, 0.02, ws) == "velocity of vertex 3: y is nan");
}
