#include "clothctl/cloth/mass_spring_impulses.hpp"

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "laws/impulse_response_laws.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheet_on_obstacles.hpp"

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

TEMPLATE_TEST_CASE("what is expected of the impulses does not change the answer", "[cloth]", float,
                   double) {
  using S = TestType;
  const Scene<S> scene;
  const MassSpring<S> model = scene.model();
  const VectorX<S> p = impulses(scene, 1e-3);
  ClothState<S> states[2] = {scene.start, scene.start};
  VectorX<S> velocities[2];
  for (const bool expects : {false, true}) {
    auto ws = model.make_workspace();
    ClothState<S>& state = states[expects ? 1 : 0];
    auto response = MassSpringImpulses<S>::create(model, 7).value();
    // Twice at vertex 8, once at the driven vertex 48.
    const std::vector<int> at{8, 41, 8, 48};
    if (expects) REQUIRE(response.expect(at, noise<S>(5, 4, 1e-3), ws));
    REQUIRE(model.step(state, scene.input, scene.dt, ws).advanced);
    REQUIRE(response.attach(scene.touched, state, ws) == StepStatus::Converged);
    VectorX<S>& u = velocities[expects ? 1 : 0];
    u.setZero(3 * response.point_count());
    response.velocities(u);
    // In two parts: only the first takes the place of what was expected.
    response.apply(S(0.25) * p);
    response.apply(S(0.75) * p);
  }
  const S tolerance = std::is_same_v<S, float> ? S(1e-4) : S(1e-12);
  const S size = states[0].velocities.cwiseAbs().maxCoeff();
  CHECK((velocities[1] - velocities[0]).cwiseAbs().maxCoeff() < tolerance * size);
  CHECK((states[1].velocities - states[0].velocities).cwiseAbs().maxCoeff() < tolerance * size);
  CHECK((states[1].positions - states[0].positions).cwiseAbs().maxCoeff() <
        tolerance * size * scene.dt);
}

TEST_CASE("what cannot be expected is refused, and what was expected elsewhere", "[cloth]") {
  const Scene<double> scene;
  const MassSpring<double> model = scene.model();
  auto ws = model.make_workspace();
  auto response = MassSpringImpulses<double>::create(model, 7).value();
  const Points<double> one = Points<double>::Constant(3, 1, 1e-3);
  CHECK_FALSE(response.expect(std::vector<int>{49}, one, ws));
  CHECK_FALSE(response.expect(std::vector<int>{-1}, one, ws));
  CHECK_FALSE(response.expect(std::vector<int>{3, 4}, one, ws));
  CHECK_FALSE(response.expect(std::vector<int>{3}, Points<double>(one * std::nan("")), ws));
  ClothState<double> state = scene.start, other = scene.start;
  auto fresh = model.make_workspace();
  REQUIRE(model.step(state, scene.input, scene.dt, ws).advanced);
  REQUIRE(model.step(other, scene.input, scene.dt, fresh).advanced);
  CHECK(state.velocities == other.velocities);
  REQUIRE(response.expect(std::vector<int>{3}, one, ws));
  REQUIRE(model.step(state, scene.input, scene.dt, ws).advanced);
  REQUIRE(model.step(other, scene.input, scene.dt, fresh).advanced);
  CHECK(response.attach(std::vector<int>{4}, state, ws) == StepStatus::InvalidInput);
  // The state holds the impulse until it is replaced, however often one attaches.
  CHECK(response.attach(std::vector<int>{3}, state, ws) == StepStatus::Converged);
  CHECK(response.attach(std::vector<int>{3, 4}, state, ws) == StepStatus::Converged);
  response.apply(VectorX<double>::Zero(6));
  CHECK((state.velocities - other.velocities).cwiseAbs().maxCoeff() < 1e-12);
  CHECK(response.attach(std::vector<int>{4}, state, ws) == StepStatus::Converged);
  // What was refused is not expected of the next step.
  REQUIRE(response.expect(std::vector<int>{3}, one, ws));
  CHECK(response.attach(std::vector<int>{99}, state, ws) == StepStatus::InvalidInput);
  state = other;
  REQUIRE(model.step(state, scene.input, scene.dt, ws).advanced);
  REQUIRE(model.step(other, scene.input, scene.dt, fresh).advanced);
  CHECK(state.velocities == other.velocities);
  Scene<double> larger;
  larger.network.springs.pop_back();
  const MassSpring<double> foreign = larger.model();
  auto theirs = foreign.make_workspace();
  CHECK_FALSE(response.expect(std::vector<int>{3}, one, theirs));
}

TEST_CASE("contacts that change within a step change the mobility, as another factor would",
          "[cloth]") {
  // A sheet that falls on a ball and slides: contacts open, close and slip.
  using Rig = clothctl_test::SheetOnObstacles<MassSpring<double>>;
  auto settings = MassSpringSettings<double>::of(Material<double>());
  settings.limit_energy = false;
  const auto network = clothctl_test::level_sheet<double>(9, 0.0005);
  const auto model = MassSpring<double>::create(network, settings).value();
  const auto ball =
      SphereCollider<double>::create(Vector3<double>(0.05, 0.01, -0.05), 0.05, {0.2, 0}).value();
  Rig with(model), without(model);
  for (Rig* rig : {&with, &without}) rig->obstacles = {ColliderRef<double>(ball)};
  auto answer = MassSpringImpulses<double>::create(model, 7).value();
  auto other = MassSpringImpulses<double>::create(model, 7).value();
  const std::vector<int> touched{8, 41, 40, 25, 48};
  const VectorX<double> p = VectorX<double>::LinSpaced(15, -2e-4, 3e-4);
  const Points<double> noisy = noise<double>(8, 5, 1e-4);
  std::size_t changes = 0;
  long allocated = 0;
  double mobility = 0, velocity = 0, contacts = 0;
  for (int i = 0; i < 60; ++i) {
    REQUIRE(answer.expect(touched, noisy, with.ws));
    with.advance(0.01);
    // The same end of the step, with another factor.
    without.ws = with.ws;
    without.ws.factor_is_current = false;
    without.state = with.state;
    long before_all = clothctl_test::allocations();
    const StepStatus attached = answer.attach(touched, with.state, with.ws);
    allocated += clothctl_test::allocations() - before_all;
    REQUIRE(attached == StepStatus::Converged);
    REQUIRE(other.attach(touched, without.state, without.ws) == StepStatus::Converged);
    VectorX<double> u = VectorX<double>::Zero(15), u_other = u;
    answer.velocities(u);
    other.velocities(u_other);
    velocity = std::max(velocity, (u - u_other).norm() / u.norm());
    changes += with.ws.factor_changes.list().size();
    MatrixX<double> W = MatrixX<double>::Zero(15, 15), expected = W;
    answer.add_mobility(W);
    other.add_mobility(expected);
    mobility = std::max(mobility, (W - expected).norm() / expected.norm());
    const Points<double> before = with.state.velocities;
    const Vector3<double> held = with.impulse(), momentum = with.momentum();
    before_all = clothctl_test::allocations();
    answer.apply(p);
    allocated += clothctl_test::allocations() - before_all;
    other.apply(p);
    const Points<double> by = without.state.velocities - before;
    velocity = std::max(velocity, (with.state.velocities - before - by).norm() / by.norm());
    // What keeps sheets out of thin obstacles adds contacts after the step.
    SheetContact<double> further;
    further.vertex = {i, -1, -1};
    further.weight = Vector3<double>(1, 0, 0);
    REQUIRE(with.contacts.add(further, 0, Vector3<double>::Zero()));
    answer.update_contacts(with.contacts, [](std::size_t, const Vector3<double>&) {});
    Vector3<double> pushed = Vector3<double>::Zero();
    for (Index k = 0; k < 5; ++k) pushed += p.segment<3>(3 * k) - noisy.col(k);
    const double drag = 1 + 0.01 * settings.drag;
    const Vector3<double> lost =
        drag * (with.momentum() - momentum) - pushed - (with.impulse() - held);
    contacts = std::max(contacts, lost.norm() / pushed.norm());
  }
  CHECK(changes > 30);
  CHECK(mobility < 1e-9);
  CHECK(velocity < 1e-9);
  CHECK(contacts < 1e-9);
  if (clothctl_test::allocation_counting_works()) CHECK(allocated == 0);
}
