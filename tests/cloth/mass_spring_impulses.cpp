#include "clothctl/cloth/mass_spring_impulses.hpp"

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "laws/impulse_response_laws.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

static_assert(ImpulseResponse<MassSpringImpulses<float>, float> &&
              ImpulseResponse<MassSpringImpulses<double>>);

namespace {

template <class S>
Points<S> noise(unsigned seed, Index n, double size) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, size);
  return Points<S>::NullaryExpr(3, n, [&] { return static_cast<S>(normal(random)); });
}

/// A crumpled sheet of 7×7 vertices with one pinned and one driven vertex.
template <class S>
struct Scene {
  SpringNetwork<S> network =
      sheet_network<S>(make_grid<S>(7, 7, S(0.3), S(0.3)).value(), Material<S>()).value();
  MassSpringSettings<S> settings;
  ClothState<S> start{network.rest_positions + noise<S>(1, 49, 0.003), noise<S>(2, 49, 0.2)};
  ClothInput<S> input;
  S dt = S(0.02);
  std::vector<int> touched{8, 41, 0, 25, 48, 7, 12};

  explicit Scene(Integration integration = Integration::LinearlyImplicit) {
    settings.integration = integration;
    settings.drag = S(0.7);
    settings.limit_energy = false;
    settings.pinned = {42};
    input.driven_vertices = {48};
    input.driven_positions = start.positions.col(48) + Vector3<S>(S(0.001), S(0), S(0.002));
  }
  MassSpring<S> model() const { return MassSpring<S>::create(network, settings).value(); }
};

/// Impulses at the touched vertices, N s.
template <class S>
VectorX<S> impulses(const Scene<S>& scene, double size) {
  const Points<S> p = noise<S>(3, static_cast<Index>(scene.touched.size()), size);
  return Eigen::Map<const VectorX<S>>(p.data(), p.size());
}

}  // namespace

TEMPLATE_TEST_CASE("a mass-spring sheet obeys the laws of impulse responses", "[cloth]", float,
                   double) {
  using S = TestType;
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    const Scene<S> scene(integration);
    const MassSpring<S> model = scene.model();
    auto ws = model.make_workspace();
    ClothState<S> state = scene.start;
    REQUIRE(model.step(state, scene.input, scene.dt, ws).advanced);
    auto response = MassSpringImpulses<S>::create(model, 10).value();
    REQUIRE(response.attach(scene.touched, state, ws) == StepStatus::Converged);
    clothctl_test::check_impulse_response_laws<S>(response,
                                                  std::is_same_v<S, float> ? S(1e-5) : S(1e-13));
  }
}

TEMPLATE_TEST_CASE("impulses within a single linear solve act like input forces", "[cloth]", float,
                   double) {
  using S = TestType;
  const Scene<S> scene;
  const MassSpring<S> model = scene.model();
  auto ws = model.make_workspace();
  const VectorX<S> p = impulses(scene, 1e-3);
  ClothState<S> expected = scene.start;
  ClothInput<S> pushed = scene.input;
  pushed.force_vertices = scene.touched;
  pushed.forces = Eigen::Map<const Points<S>>(p.data(), 3, p.size() / 3) / scene.dt;
  REQUIRE(model.step(expected, pushed, scene.dt, ws).advanced);
  Points<S> held_by(3, 2), held_after(3, 2);
  const std::vector<int> held{42, 48};
  REQUIRE(model.holding_forces(held, ws, held_by));

  ClothState<S> state = scene.start;
  REQUIRE(model.step(state, scene.input, scene.dt, ws).advanced);
  const ClothState<S> free = state;
  auto response = MassSpringImpulses<S>::create(model, 7).value();
  REQUIRE(response.attach(scene.touched, state, ws) == StepStatus::Converged);
  CHECK(response.point(41) == 1);
  CHECK(response.point(42) == -1);
  CHECK(response.point(-1) == -1);
  CHECK(response.point(49) == -1);
  response.apply(p);
  const S change = (expected.velocities - free.velocities).cwiseAbs().maxCoeff();
  const S tolerance = std::is_same_v<S, float> ? S(1e-4) : S(1e-12);
  CHECK(change > S(0.1));
  CHECK((state.velocities - expected.velocities).cwiseAbs().maxCoeff() < tolerance * change);
  CHECK((state.positions - expected.positions).cwiseAbs().maxCoeff() <
        tolerance * scene.dt * change);
  REQUIRE(model.holding_forces(held, ws, held_after));
  // Vertex 48 is driven: its input force is subtracted there, and has no effect here.
  held_by.col(1) += pushed.forces.col(4);
  CHECK((held_after - held_by).norm() < S(1e2) * tolerance * held_by.norm());
  CHECK(state.positions.col(42) == free.positions.col(42));  // pinned
  CHECK(state.positions.col(48) == free.positions.col(48));  // driven
}

TEST_CASE("after Newton's method the mobility is the derivative of the step", "[cloth]") {
  using S = double;
  Scene<S> scene(Integration::Newton);
  scene.settings.velocity_tolerance = 1e-12;
  scene.settings.max_iterations = 100;
  const MassSpring<S> model = scene.model();
  auto ws = model.make_workspace();
  ClothState<S> state = scene.start;
  REQUIRE(model.step(state, scene.input, scene.dt, ws).status == StepStatus::Converged);
  auto response = MassSpringImpulses<S>::create(model, 7).value();
  REQUIRE(response.attach(scene.touched, state, ws) == StepStatus::Converged);
  const VectorX<S> p = impulses(scene, 1e-7);
  VectorX<S> predicted = VectorX<S>::Zero(21);
  MatrixX<S> W = MatrixX<S>::Zero(21, 21);
  response.add_mobility(W);
  predicted = W * p;
  VectorX<S> found(21);
  for (const double sign : {1.0, -1.0}) {
    ClothState<S> moved = scene.start;
    ClothInput<S> pushed = scene.input;
    pushed.force_vertices = scene.touched;
    pushed.forces = sign / scene.dt * Eigen::Map<const Points<S>>(p.data(), 3, 7);
    auto other = model.make_workspace();
    REQUIRE(model.step(moved, pushed, scene.dt, other).status == StepStatus::Converged);
    for (Index i = 0; i < 7; ++i) {
      const Vector3<S> v = moved.velocities.col(scene.touched[static_cast<std::size_t>(i)]);
      if (sign > 0)
        found.segment<3>(3 * i) = v;
      else
        found.segment<3>(3 * i) = 0.5 * (found.segment<3>(3 * i) - v);
    }
  }
  CHECK((found - predicted).norm() < 1e-5 * found.norm());
}

TEST_CASE("impulses change the momentum of a free sheet by their sum", "[cloth]") {
  Scene<double> scene;
  scene.settings.pinned.clear();
  scene.settings.drag = 0;
  scene.input = {};
  const MassSpring<double> model = scene.model();
  auto ws = model.make_workspace();
  ClothState<double> state = scene.start;
  REQUIRE(model.step(state, scene.input, scene.dt, ws).advanced);
  const auto momentum = [&] { return Vector3<double>(state.velocities * scene.network.mass); };
  auto response = MassSpringImpulses<double>::create(model, 7).value();
  REQUIRE(response.attach(scene.touched, state, ws) == StepStatus::Converged);
  const Vector3<double> before = momentum();
  const VectorX<double> p = impulses(scene, 1e-3);
  response.apply(p);
  const Vector3<double> sum = Eigen::Map<const Points<double>>(p.data(), 3, 7).rowwise().sum();
  CHECK((momentum() - before - sum).norm() < 1e-13 * p.lpNorm<1>());
}

TEST_CASE("the velocities of a response are those of the positions", "[cloth]") {
  const Scene<double> scene;
  const MassSpring<double> model = scene.model();
  auto ws = model.make_workspace();
  ClothState<double> state = scene.start;
  REQUIRE(model.step(state, {}, scene.dt, ws).advanced);
  state.velocities *= 0.5;  // as a step does that takes energy out of the velocities afterwards
  auto response = MassSpringImpulses<double>::create(model, 7).value();
  REQUIRE(response.attach(scene.touched, state, ws) == StepStatus::Converged);
  response.apply(impulses(scene, 1e-3));
  VectorX<double> u(21);
  response.velocities(u);
  for (std::size_t i = 0; i < 7; ++i) {
    const int v = scene.touched[i];
    const Vector3<double> moved =
        (state.positions.col(v) - scene.start.positions.col(v)) / scene.dt;
    CHECK((u.segment<3>(3 * static_cast<Index>(i)) - moved).norm() < 1e-11);
  }
}

TEST_CASE("a response refuses what is not its step, and changes nothing", "[cloth]") {
  const Scene<double> scene;
  const MassSpring<double> model = scene.model();
  auto ws = model.make_workspace();
  ClothState<double> state = scene.start;
  auto response = MassSpringImpulses<double>::create(model, 3).value();
  CHECK(response.attach(std::vector<int>{1}, state, ws) == StepStatus::InvalidWorkspace);
  REQUIRE(model.step(state, scene.input, scene.dt, ws).advanced);
  const ClothState<double> before = state;
  CHECK(response.attach(std::vector<int>{1, 2, 3, 4}, state, ws) == StepStatus::InvalidInput);
  CHECK(response.attach(std::vector<int>{1, 49}, state, ws) == StepStatus::InvalidInput);
  CHECK(response.attach(std::vector<int>{-1}, state, ws) == StepStatus::InvalidInput);
  CHECK(response.attach(std::vector<int>{4, 5, 4}, state, ws) == StepStatus::InvalidInput);
  CHECK(response.point_count() == 0);
  CHECK(response.point(4) == -1);
  ClothState<double> small{Points<double>::Zero(3, 4), Points<double>::Zero(3, 4)};
  CHECK(response.attach(std::vector<int>{1}, small, ws) == StepStatus::InvalidState);
  ClothState<double> far = scene.start;
  ClothInput<double> absurd;
  absurd.force_vertices = {5};
  absurd.forces = Points<double>::Constant(3, 1, 1.7e308);
  auto failed = model.make_workspace();
  REQUIRE(model.step(far, scene.input, scene.dt, failed).advanced);
  REQUIRE_FALSE(model.step(far, absurd, scene.dt, failed).advanced);
  CHECK(response.attach(std::vector<int>{1}, far, failed) == StepStatus::InvalidWorkspace);
  MassSpring<double>::Workspace none;
  CHECK(response.attach(std::vector<int>{1}, state, none) == StepStatus::InvalidWorkspace);
  CHECK(state.positions == before.positions);
  CHECK(state.velocities == before.velocities);
  REQUIRE(response.attach({}, state, ws) == StepStatus::Converged);
  response.apply(VectorX<double>());
  CHECK(state.positions == before.positions);

  Scene<double> iterative;
  iterative.settings.linear_solver = LinearSolver::ConjugateGradient;
  CHECK(MassSpringImpulses<double>::create(iterative.model(), 3).error().find("conjugate") !=
        std::string::npos);
  CHECK_FALSE(MassSpringImpulses<double>::create(model, -1));
}
