// Springs between vertices and points of the input, in both models.

#include "clothctl/cloth/detail/attachments.hpp"

#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/rope.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

constexpr double kGravity = 9.81;

template <class S>
void attach(ClothInput<S>& input, int vertex, const Vector3<double>& point, double stiffness) {
  const Index k = static_cast<Index>(input.attached_vertices.size());
  input.attached_vertices.push_back(vertex);
  input.attached_positions.conservativeResize(3, k + 1);
  input.attached_positions.col(k) = point.cast<S>();
  input.attachment_stiffness.conservativeResize(k + 1);
  input.attachment_stiffness[k] = S(stiffness);
}

template <class S>
SpringNetwork<S> particle(double mass) {
  SpringNetwork<S> network;
  network.rest_positions.setZero(3, 1);
  network.mass.setConstant(1, S(mass));
  return network;
}

SpringNetwork<double> sheet(int n) {
  return sheet_network<double>(make_grid<double>(n, n, 0.3, 0.3).value(), Material<double>())
      .value();
}

// An undamped sheet so soft that sweeps converge.
SpringNetwork<double> soft_sheet(int n) {
  SpringNetwork<double> network = sheet(n);
  for (Spring<double>& s : network.springs) {
    s.stiffness *= 0.02;
    s.damping = 0;
  }
  return network;
}

MassSpring<double> mass_spring(const SpringNetwork<double>& network,
                               MassSpringSettings<double> settings = {}) {
  return MassSpring<double>::create(network, std::move(settings)).value();
}

PositionBased<double> position_based(const SpringNetwork<double>& network,
                                     PositionBasedSettings<double> settings = {}) {
  return PositionBased<double>::create(network, std::move(settings)).value();
}

// XPBD that solves the equations of implicit Euler.
PositionBasedSettings<double> converged_settings(int sweeps = 2000) {
  PositionBasedSettings<double> settings;
  settings.substeps = 1;
  settings.iterations = sweeps;
  return settings;
}

template <class Model>
ClothState<typename Model::Scalar> run(const Model& model,
                                       const ClothInput<typename Model::Scalar>& input, int steps,
                                       double dt) {
  using S = typename Model::Scalar;
  auto ws = model.make_workspace();
  ClothState<S> state = model.rest_state();
  for (int i = 0; i < steps; ++i) REQUIRE(model.step(state, input, S(dt), ws).advanced);
  return state;
}

// The same while the first point moves by `motion` before each step; calls `after(state, input)`
// after it.
template <class Model, class After>
ClothState<double> run_moving(const Model& model, ClothInput<double> input,
                              const Eigen::Vector3d& motion, int steps, double dt, After after) {
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  for (int i = 0; i < steps; ++i) {
    input.attached_positions.col(0) += motion;
    REQUIRE(model.step(state, input, dt, ws).advanced);
    after(state, input);
  }
  return state;
}

double distance(const ClothState<double>& a, const ClothState<double>& b) {
  return (a.positions - b.positions).cwiseAbs().maxCoeff();
}

double speed_difference(const ClothState<double>& a, const ClothState<double>& b) {
  return (a.velocities - b.velocities).cwiseAbs().maxCoeff();
}

// Sum of the forces that the points exert at positions x.
Eigen::Vector3d pull(const ClothInput<double>& input, const Points<double>& x) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::size_t j = 0; j < input.attached_vertices.size(); ++j) {
    const Index i = static_cast<Index>(j);
    sum += input.attachment_stiffness[i] *
           (input.attached_positions.col(i) - x.col(input.attached_vertices[j]));
  }
  return sum;
}

double elastic_energy(const SpringNetwork<double>& network, const Points<double>& x) {
  double sum = 0;
  for (const Spring<double>& s : network.springs) {
    const double stretch = (x.col(s.a) - x.col(s.b)).norm() - s.rest_length;
    sum += 0.5 * s.stiffness * stretch * stretch;
  }
  for (const BendStencil<double>& b : network.bends) {
    Eigen::Vector3d bend = Eigen::Vector3d::Zero();
    for (int i = 0; i < b.count; ++i)
      bend += b.weight[static_cast<std::size_t>(i)] * x.col(b.vertex[static_cast<std::size_t>(i)]);
    sum += 0.5 * b.stiffness * bend.squaredNorm();
  }
  return sum;
}

double kinetic_energy(const SpringNetwork<double>& network, const Points<double>& v) {
  return 0.5 * v.colwise().squaredNorm().dot(network.mass.transpose());
}

double attachment_energy(const ClothInput<double>& input, const Points<double>& x) {
  double sum = 0;
  for (std::size_t j = 0; j < input.attached_vertices.size(); ++j) {
    const Index i = static_cast<Index>(j);
    sum += 0.5 * input.attachment_stiffness[i] *
           (input.attached_positions.col(i) - x.col(input.attached_vertices[j])).squaredNorm();
  }
  return sum;
}

}  // namespace

TEST_CASE("the springs of a vertex act like one spring at their mean point", "[cloth]") {
  ClothInput<double> input;
  attach(input, 2, {1, 0, 0}, 1.0);
  attach(input, 0, {5, 5, 5}, 7.0);
  attach(input, 2, {0, 1, 0}, 3.0);
  attach(input, 1, {9, 9, 9}, 2.0);
  detail::Attachments<double> attachments;
  CHECK_FALSE(attachments.fits(4));
  attachments.reserve(4);
  REQUIRE(attachments.fits(4));
  CHECK_FALSE(attachments.fits(3));
  const long before = clothctl_test::allocations();
  for (int repeat = 0; repeat < 2; ++repeat) attachments.load(input, [](int v) { return v == 1; });
  const long during = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(during == 0);
  REQUIRE(attachments.items.size() == 2);
  const Points<double> x = Points<double>::Random(3, 4);
  Points<double> forces = Points<double>::Zero(3, 4);
  attachments.add_forces(x, forces);
  Points<double> expected = Points<double>::Zero(3, 4);
  for (const int j : {0, 1, 2})
    expected.col(input.attached_vertices[static_cast<std::size_t>(j)]) +=
        input.attachment_stiffness[j] *
        (input.attached_positions.col(j) -
         x.col(input.attached_vertices[static_cast<std::size_t>(j)]));
  CHECK((forces - expected).cwiseAbs().maxCoeff() < 1e-14 * expected.cwiseAbs().maxCoeff());

  // The energy is that of the springs but for a constant, and the force its gradient.
  const auto energy = [&](const Points<double>& at) {
    double size = 0;
    return attachments.energy(at, size);
  };
  ClothInput<double> acting = input;
  acting.attached_vertices.pop_back();
  const Points<double> y = Points<double>::Random(3, 4);
  CHECK(std::abs(energy(x) - energy(y) - attachment_energy(acting, x) +
                 attachment_energy(acting, y)) < 1e-12);
  Points<double> moved = x;
  moved(1, 2) += 1e-5;
  CHECK(std::abs((energy(moved) - energy(x)) / 1e-5 + forces(1, 2)) < 1e-4);
}

TEMPLATE_TEST_CASE("a particle on a spring hangs by its weight over the stiffness", "[cloth]",
                   float, double) {
  using S = TestType;
  const double mass = 0.02, stiffness = 15.0;
  ClothInput<S> input;
  attach(input, 0, {0.1, -0.2, 0.3}, stiffness);
  const Vector3<S> expected(S(0.1), S(-0.2), S(0.3 - mass * kGravity / stiffness));
  const auto hangs = [&](const ClothState<S>& state) {
    const S error = (state.positions.col(0) - expected).cwiseAbs().maxCoeff();
    // In float, a substep's motion of h² k/m times 30 μm is below the spacing of the coordinates.
    CHECK(error < (std::is_same_v<S, float> ? S(6e-5) : S(2e-6)));
  };
  MassSpringSettings<S> implicit;
  implicit.drag = S(20);
  implicit.velocity_tolerance = S(1e-6);
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    for (const LinearSolver solver : {LinearSolver::Factor, LinearSolver::ConjugateGradient}) {
      implicit.integration = integration;
      implicit.linear_solver = solver;
      hangs(run(MassSpring<S>::create(particle<S>(mass), implicit).value(), input, 300, 0.02));
    }
  }
  PositionBasedSettings<S> settings;
  settings.drag = S(20);
  hangs(run(PositionBased<S>::create(particle<S>(mass), settings).value(), input, 300, 0.02));
  settings.stretch_limit = S(0.02);
  hangs(run(PositionBased<S>::create(particle<S>(mass), settings).value(), input, 300, 0.02));
  PositionBasedSettings<S> verlet = PositionBasedSettings<S>::verlet();
  verlet.verlet_damping = S(0.1);
  verlet.drag = S(5);
  hangs(run(PositionBased<S>::create(particle<S>(mass), verlet).value(), input, 300, 0.02));
}

TEST_CASE("a particle moves as implicit Euler says", "[cloth]") {
  const double mass = 0.02, stiffness = 15.0, dt = 0.01, drag = 3.0;
  ClothInput<double> input;
  attach(input, 0, {0.1, -0.2, 0.3}, stiffness);
  Eigen::Vector3d x = Eigen::Vector3d::Zero(), v = x;
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d force =
        stiffness * (input.attached_positions.col(0) - x) + Eigen::Vector3d(0, 0, -mass * kGravity);
    v = (mass * v + dt * force) / (mass * (1 + dt * drag) + dt * dt * stiffness);
    x += dt * v;
  }
  MassSpringSettings<double> settings;
  settings.drag = drag;
  PositionBasedSettings<double> xpbd = converged_settings(1);
  xpbd.drag = drag;
  for (const ClothState<double>& state :
       {run(mass_spring(particle<double>(mass), settings), input, 50, dt),
        run(position_based(particle<double>(mass), xpbd), input, 50, dt)}) {
    CHECK((state.positions.col(0) - x).norm() < 1e-12);
    CHECK((state.velocities.col(0) - v).norm() < 1e-11);
  }
}

TEST_CASE("the springs that hold a sheet carry its weight", "[cloth]") {
  const int n = GENERATE(5, 9);  // batches and lanes
  const SpringNetwork<double> network = sheet(n);
  const double weight = network.mass.sum() * kGravity;
  ClothInput<double> input;
  for (const int v : {0, n - 1, n * n - n, n * n - 1})
    attach(input, v, network.rest_positions.col(v), 20.0);
  // tolerance: part of the weight; offset: distance by which a vertex may be off, m.
  const auto carried = [&](const ClothState<double>& state, double tolerance, double offset = 0) {
    const Eigen::Vector3d force = pull(input, state.positions);
    INFO(n << ": " << force.transpose() << ", weight " << weight);
    CHECK((force - Eigen::Vector3d(0, 0, weight)).norm() <
          tolerance * weight + offset * input.attachment_stiffness.sum());
  };
  MassSpringSettings<double> implicit;
  implicit.drag = 5;
  carried(run(mass_spring(network, implicit), input, 500, 0.02), 1e-4);
  PositionBasedSettings<double> settings;
  settings.drag = 5;
  carried(run(position_based(network, settings), input, 500, 0.02), 1e-3);
  PositionBasedSettings<double> verlet = PositionBasedSettings<double>::verlet();
  verlet.verlet_damping = 0.1;
  carried(run(position_based(network, verlet), input, 500, 0.02), 1e-3);
  settings.stretch_limit = 0.02;
  // The limit is kept after the last pull, so that the vertices have moved on.
  carried(run(position_based(network, settings), input, 500, 0.02), 0.01, 3e-4);
}

TEST_CASE("the momentum of a sheet changes by gravity and the pull of its points", "[cloth]") {
  const SpringNetwork<double> network = sheet(5);
  const double dt = 0.01;
  ClothInput<double> start;
  attach(start, 3, network.rest_positions.col(3), 30.0);
  attach(start, 20, network.rest_positions.col(20), 8.0);
  const auto holds = [&](const auto& model, double tolerance) {
    Eigen::Vector3d before = Eigen::Vector3d::Zero();
    const auto balanced = [&](const ClothState<double>& state, const ClothInput<double>& input) {
      const Eigen::Vector3d momentum = state.velocities * network.mass;
      const Eigen::Vector3d force = (momentum - before) / dt;
      const Eigen::Vector3d weight(0, 0, -kGravity * network.mass.sum());
      CHECK((force - weight - pull(input, state.positions)).norm() < tolerance);
      before = momentum;
    };
    run_moving(model, start, {0.004, 0.0, 0.003}, 20, dt, balanced);
  };
  MassSpringSettings<double> newton;
  newton.integration = Integration::Newton;
  holds(mass_spring(network, newton), 1e-5);
  newton.integration = Integration::LinearlyImplicit;
  holds(mass_spring(network, newton), 1e-9);
  holds(position_based(network, converged_settings(500)), 1e-6);
}

TEST_CASE("both models pull a sheet alike", "[cloth]") {
  const SpringNetwork<double> network = soft_sheet(5);
  const double dt = 1e-3;
  ClothInput<double> start;
  attach(start, 12, network.rest_positions.col(12), 25.0);
  attach(start, 0, network.rest_positions.col(0), 1e4);
  const auto pulled = [&](const auto& model) {
    return run_moving(model, start, {0.0, 1e-4, 5e-4}, 60, dt, [](const auto&, const auto&) {});
  };
  MassSpringSettings<double> newton;
  newton.integration = Integration::Newton;
  newton.velocity_tolerance = 1e-9;
  const ClothState<double> implicit = pulled(mass_spring(network, newton));
  const ClothState<double> xpbd = pulled(position_based(network, converged_settings(1000)));
  // XPBD adds up impulses along edges that turn while it sweeps, an error of order h.
  CHECK(distance(implicit, xpbd) < 2e-5);
  CHECK(speed_difference(implicit, xpbd) < 2e-3);
  newton.integration = Integration::LinearlyImplicit;
  CHECK(distance(implicit, pulled(mass_spring(network, newton))) < 1e-3);
}

TEST_CASE("a very stiff spring does what driving the vertex does", "[cloth]") {
  SpringNetwork<double> network = sheet(5);
  const double dt = 0.01;
  const double stiffness = GENERATE(1e8, 1e12, 1e20, 1e60);
  const auto compare = [&](const auto& model, double tolerance) {
    auto ws = model.make_workspace();
    ClothState<double> attached = model.rest_state(), driven = attached;
    for (int i = 1; i <= 30; ++i) {
      const Eigen::Vector3d end =
          network.rest_positions.col(4) + Eigen::Vector3d(0.001, -0.002, 0.002) * i;
      ClothInput<double> soft, hard;
      attach(soft, 4, end, stiffness);
      attach(soft, 20, network.rest_positions.col(20), stiffness);
      hard.driven_vertices = {4, 20};
      hard.driven_positions.resize(3, 2);
      hard.driven_positions << end, network.rest_positions.col(20);
      REQUIRE(model.step(attached, soft, dt, ws).advanced);
      REQUIRE(model.step(driven, hard, dt, ws).advanced);
    }
    INFO("stiffness " << stiffness);
    CHECK(distance(attached, driven) < tolerance);
  };
  MassSpringSettings<double> settings;
  settings.limit_energy =
      false;  // it counts the work of a hand in another way than that of a spring
  compare(mass_spring(network, settings), 1e-6);
  settings.integration = Integration::Newton;
  settings.velocity_tolerance = 1e-9;
  compare(mass_spring(network, settings), 1e-6);
  network.springs.clear();  // stencils are linear, so sweeps over them converge to one result
  compare(position_based(network, converged_settings(1000)), 1e-6);
}

TEST_CASE("attached sheets gain no energy beyond the work of their points", "[cloth]") {
  SpringNetwork<double> network = sheet(6);
  for (Spring<double>& s : network.springs) s.damping = 0;
  const bool newton = GENERATE(false, true);
  const double stiffness = GENERATE(0.5, 50.0, 1e5);
  MassSpringSettings<double> settings;
  settings.gravity.setZero();
  if (newton) settings.integration = Integration::Newton;
  const MassSpring<double> model = mass_spring(network, settings);
  auto ws = model.make_workspace();
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  ClothState<double> state = model.rest_state();
  for (Index k = 0; k < state.velocities.size(); ++k) state.velocities.data()[k] = normal(random);
  ClothInput<double> input;
  for (const int v : {0, 17, 35}) attach(input, v, network.rest_positions.col(v), stiffness);
  const auto energy = [&] {
    return elastic_energy(network, state.positions) + kinetic_energy(network, state.velocities);
  };
  for (int i = 0; i < 200; ++i) {
    const Points<double> start = state.positions;
    const bool moving = i % 20 < 10;
    for (Index k = 0; moving && k < 9; ++k)
      input.attached_positions.data()[k] += 0.01 * normal(random);
    const double before = energy(), stored = attachment_energy(input, start);
    REQUIRE(model.step(state, input, 0.02, ws).advanced);
    double work = 0;
    for (Index j = 0; j < 3; ++j) {
      const int v = input.attached_vertices[static_cast<std::size_t>(j)];
      work += stiffness * (input.attached_positions.col(j) - state.positions.col(v))
                              .dot(state.positions.col(v) - start.col(v));
    }
    const double allowed = 1e-5 * (1e-3 + before + energy());
    CHECK(energy() - before < work + allowed);
    // Which bounds the energy with that of the springs as well.
    CHECK(energy() + attachment_energy(input, state.positions) < before + stored + allowed);
  }
}

TEST_CASE("a spring on a held vertex has no effect", "[cloth]") {
  const SpringNetwork<double> network = sheet(9);
  const auto compare = [&](const auto& model) {
    ClothInput<double> plain;
    plain.driven_vertices = {8};
    plain.driven_positions = network.rest_positions.col(8);
    ClothInput<double> attached = plain;
    attach(attached, 0, {1, 2, 3}, 100.0);
    attach(attached, 8, {1, 2, 3}, 1e300);
    const ClothState<double> a = run(model, plain, 20, 0.02), b = run(model, attached, 20, 0.02);
    CHECK(a == b);
  };
  MassSpringSettings<double> implicit;
  implicit.pinned = {0};
  compare(mass_spring(network, implicit));
  PositionBasedSettings<double> settings;
  settings.pinned = {0};
  compare(position_based(network, settings));
}

TEST_CASE("a workspace forgets the attachments of the step before", "[cloth]") {
  const SpringNetwork<double> network = sheet(9);
  const auto compare = [&](const auto& model) {
    auto used = model.make_workspace(), fresh = model.make_workspace();
    ClothInput<double> attached, plain;
    attach(attached, 0, {1, 2, 3}, 100.0);
    attach(attached, 0, {1, 2, 4}, 10.0);
    ClothState<double> a = model.rest_state(), b = a;
    REQUIRE(model.step(a, attached, 0.02, used).advanced);
    a = b;
    REQUIRE(model.step(a, plain, 0.02, used).advanced);
    REQUIRE(model.step(b, plain, 0.02, fresh).advanced);
    CHECK(a == b);
  };
  compare(mass_spring(network));
  compare(position_based(network));
}

TEST_CASE("an attached step does not allocate", "[cloth]") {
  if (!clothctl_test::allocation_counting_works()) return;
  const SpringNetwork<double> network = sheet(9);
  ClothInput<double> input;
  for (int i = 0; i < 300; ++i) attach(input, i % 7, {0, 0, 0.01 * i}, 1.0 + i);
  const auto count = [&](const auto& model) {
    auto ws = model.make_workspace();
    ClothState<double> state = model.rest_state();
    const long before = clothctl_test::allocations();
    const bool advanced = model.step(state, input, 0.02, ws).advanced;
    const long during = clothctl_test::allocations() - before;
    CHECK(advanced);
    CHECK(during == 0);
  };
  MassSpringSettings<double> newton;
  newton.integration = Integration::Newton;
  count(mass_spring(network));
  count(mass_spring(network, newton));
  count(position_based(network));
}

TEST_CASE("bad attachments are refused by name", "[cloth]") {
  const SpringNetwork<double> network = sheet(5);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const auto refused = [&](auto spoil) {
    ClothInput<double> input;
    attach(input, 3, {0, 0, 0}, 5.0);
    attach(input, 4, {0, 0, 0}, 5.0);
    spoil(input);
    std::string line;
    const auto refuses = [&](const auto& model) {
      auto ws = model.make_workspace();
      ClothState<double> state = model.rest_state();
      const ClothState<double> before = state;
      CHECK(model.step(state, input, 0.02, ws).status == StepStatus::InvalidInput);
      CHECK(state == before);
      line = model.check_input(state, input, 0.02, ws);
    };
    refuses(mass_spring(network));
    refuses(position_based(network));
    return line;
  };
  using Input = ClothInput<double>;
  CHECK(refused([](Input& i) { i.attached_vertices[1] = 25; }) ==
        "attached vertex 1: vertex 25 is off the mesh of 25 vertices");
  CHECK(refused([](Input& i) { i.attached_vertices[0] = -1; }) ==
        "attached vertex 0: vertex -1 is off the mesh of 25 vertices");
  CHECK(refused([&](Input& i) { i.attached_positions(1, 1) = nan; }) ==
        "attached position 1: y is nan");
  CHECK(refused([&](Input& i) { i.attached_positions(2, 0) = -infinity; }) ==
        "attached position 0: z is -inf");
  CHECK(refused([](Input& i) { i.attachment_stiffness[1] = 0; }) ==
        "stiffness of attachment 1 must be positive and finite, got 0 N/m");
  CHECK(refused([](Input& i) { i.attachment_stiffness[0] = -2.5; }) ==
        "stiffness of attachment 0 must be positive and finite, got -2.5 N/m");
  CHECK(refused([&](Input& i) { i.attachment_stiffness[1] = nan; }) ==
        "stiffness of attachment 1 must be positive and finite, got nan N/m");
  CHECK(refused([&](Input& i) { i.attachment_stiffness[1] = infinity; }) ==
        "stiffness of attachment 1 must be positive and finite, got inf N/m");
  CHECK(refused([](Input& i) { i.attached_vertices.pop_back(); }) ==
        "2 attached positions for 1 attached vertices");
  CHECK(refused([](Input& i) { i.attachment_stiffness.resize(3); }) ==
        "3 attachment stiffnesses for 2 attached vertices");
  CHECK(refused([](Input& i) { i.attached_positions.resize(3, 0); }) ==
        "0 attached positions for 2 attached vertices");
}

TEST_CASE("stiffness beyond all numbers fails cleanly or holds the vertex", "[cloth]") {
  const SpringNetwork<double> network = sheet(5);
  const double stiffness = GENERATE(1e-300, 1e150, 1e300, std::numeric_limits<double>::max());
  const auto survives = [&](const auto& model) {
    auto ws = model.make_workspace();
    ClothState<double> state = model.rest_state();
    ClothInput<double> input;
    attach(input, 7, {0.5, 0, 1}, stiffness);
    attach(input, 7, {0.5, 0, 1}, stiffness);
    for (int i = 0; i < 5; ++i) {
      const ClothState<double> before = state;
      const auto report = model.step(state, input, 0.02, ws);
      if (!report.advanced) CHECK(state == before);
      CHECK(all_finite(state.positions));
      CHECK(all_finite(state.velocities));
    }
  };
  survives(mass_spring(network));
  MassSpringSettings<double> newton;
  newton.integration = Integration::Newton;
  survives(mass_spring(network, newton));
  survives(position_based(network));
}
