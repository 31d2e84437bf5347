// Layers that stay layers: free vertices and mass-spring sheets, momentum and energy, fast motion,
// forced crossings, tangles, memory and refusals.

#include "clothctl/contact/sheet_impacts.hpp"

#include <cmath>
#include <limits>
#include <random>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/folded_sheets.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::uniform;

namespace {

constexpr double kStep = 0.01;

/// Vertices that fly freely, the pass over their steps, and what it must keep.
template <class S>
struct Flight {
  clothctl_test::PlainMesh mesh;
  Points<S> rest;
  ClothState<S> state;
  VectorX<S> inverse_mass;
  SheetImpacts<S> impacts;

  Flight(const clothctl_test::PlainMesh& m, const Points<double>& rest_shape,
         const SheetImpactSettings<S>& settings)
      : mesh(m),
        rest(rest_shape.cast<S>()),
        state{m.positions.cast<S>(), Points<S>::Zero(3, m.positions.cols())},
        inverse_mass(VectorX<S>::Constant(m.positions.cols(), S(1000))),
        impacts(SheetImpacts<S>::create(rest, m.triangles, settings).value()) {
    impacts.reserve(1000 * rest.cols());
  }
  SheetImpactReport step(S dt = S(kStep)) {
    const Points<S> before = state.positions;
    state.positions += dt * state.velocities;
    return impacts.resolve(before, inverse_mass, dt, state);
  }
  int crossings() const {
    auto finder = SelfContactFinder<S>::create(rest, mesh.triangles).value();
    return finder.count_crossings(state.positions);
  }
  double energy() const {
    double sum = 0;
    for (Index v = 0; v < rest.cols(); ++v) {
      if (inverse_mass[v] > S(0))
        sum += 0.5 * static_cast<double>(state.velocities.col(v).squaredNorm() / inverse_mass[v]);
    }
    return sum;
  }
  Vector3<double> momentum() const {
    Vector3<double> sum = Vector3<double>::Zero();
    for (Index v = 0; v < rest.cols(); ++v)
      sum += state.velocities.col(v).template cast<double>() / static_cast<double>(inverse_mass[v]);
    return sum;
  }
};

/// Two n×n layers of 0.1 m, `gap` apart, shifted a little, whose rest shapes are far apart.
template <class S>
Flight<S> two_layers(int n, double gap, const SheetImpactSettings<S>& settings) {
  auto upper = clothctl_test::layer(n, 0.1, gap);
  upper.positions.row(0).array() += 0.0031;
  upper.positions.row(1).array() += 0.0017;
  const auto both = clothctl_test::together(clothctl_test::layer(n, 0.1), upper);
  Points<double> rest = both.positions;
  rest.rightCols(n * n).row(2).array() += 1;
  return Flight<S>(both, rest, settings);
}

/// A crumpling motion: each vertex flies towards a random place near the centre.
void crumple(Flight<double>& flight, std::mt19937& random, double speed) {
  const Vector3<double> centre = flight.state.positions.rowwise().mean();
  for (Index v = 0; v < flight.rest.cols(); ++v) {
    for (int k = 0; k < 3; ++k) {
      flight.state.velocities(k, v) =
          speed * (10 * (centre[k] - flight.state.positions(k, v)) + uniform(random, -0.3, 0.3));
    }
  }
}

SheetImpactSettings<double> settings_of(double thickness, double friction = 0.3) {
  SheetImpactSettings<double> settings;
  settings.thickness = thickness;
  settings.friction = friction;
  return settings;
}

}  // namespace

TEMPLATE_TEST_CASE("layers that fly into each other stop and keep their momentum", "[self_contact]",
                   float, double) {
  using S = TestType;
  for (const double speed : {0.1, 2.0, 100.0}) {
    SheetImpactSettings<S> settings;
    settings.thickness = S(0.002);
    settings.push_speed = S(0);
    auto flight = two_layers<S>(6, 0.02, settings);
    flight.state.velocities.rightCols(36).row(2).array() = static_cast<S>(-speed);
    flight.state.velocities.rightCols(36).row(0).array() = static_cast<S>(0.3 * speed);
    const Vector3<double> before = flight.momentum();
    double energy = flight.energy();
    const double eps = static_cast<double>(scalar_traits<S>::epsilon());
    for (int k = 0; k < 30; ++k) {
      const SheetImpactReport report = flight.step();
      CHECK(report.status == StepStatus::Converged);
      CHECK(flight.energy() <= energy * (1 + 1000 * eps));
      energy = flight.energy();
    }
    CHECK(flight.crossings() == 0);
    CHECK((flight.momentum() - before).norm() <= 1e4 * eps * before.norm());
    // The layers move on together along the normal.
    const S lower = flight.state.velocities.leftCols(36).row(2).mean();
    const S upper = flight.state.velocities.rightCols(36).row(2).mean();
    CHECK(std::abs(lower - upper) <= S(0.2 * speed));
  }
}

TEST_CASE("rigid zones keep layers apart and momentum, too", "[self_contact]") {
  std::mt19937 random(71);
  SheetImpactSettings<double> settings = settings_of(0.002);
  settings.sweeps = 1;
  settings.rounds = 1;
  int zones = 0;
  for (int trial = 0; trial < clothctl_test::trials(10, 300, 3); ++trial) {
    Flight<double> flight(clothctl_test::layer(8, 0.1), clothctl_test::layer(8, 0.1).positions,
                          settings);
    for (int k = 0; k < 10; ++k) {
      crumple(flight, random, 3);
      const Vector3<double> before = flight.momentum();
      const SheetImpactReport report = flight.step();
      zones += report.zones;
      CHECK(report.status == StepStatus::Converged);
      CHECK((flight.momentum() - before).norm() <= 1e-12);
    }
    CHECK(flight.crossings() == 0);
  }
  CHECK(zones > 5);
}

TEST_CASE("crumpled sheets never cross", "[self_contact]") {
  std::mt19937 random(72);
  for (int trial = 0; trial < clothctl_test::trials(12, 10000, 2); ++trial) {
    Flight<double> flight(clothctl_test::layer(9, 0.1), clothctl_test::layer(9, 0.1).positions,
                          settings_of(trial % 2 == 0 ? 0.001 : 0.004));
    for (int k = 0; k < 8; ++k) {
      crumple(flight, random, std::pow(10.0, uniform(random, -1, 2)));
      const SheetImpactReport report = flight.step();
      REQUIRE(report.complete);
      CHECK(report.crossings_left == 0);
      REQUIRE(flight.state.positions.allFinite());
    }
    CHECK(flight.crossings() == 0);
  }
}

TEST_CASE("what does not touch keeps its bits", "[self_contact]") {
  auto flight = two_layers<double>(5, 0.01, settings_of(0.002));
  ClothState<double> start = flight.state;
  SheetImpactReport report = flight.step();
  CHECK(report.status == StepStatus::Converged);
  CHECK(report.contacts == 0);
  CHECK(flight.state == start);
  flight.state.velocities.row(1).array() = 100;
  start = flight.state;
  start.positions += kStep * start.velocities;
  report = flight.step();
  CHECK(flight.state == start);
  CHECK(report.impacts == 0);
}

TEST_CASE("friction between layers is Coulomb's", "[self_contact]") {
  for (const double mu : {0.0, 0.3}) {
    auto flight = two_layers<double>(6, 0.002, settings_of(0.002, mu));
    flight.inverse_mass.head(36).setZero();
    flight.state.velocities.rightCols(36).row(0).array() = 0.2;
    for (int k = 0; k < 5; ++k) {
      flight.state.velocities.rightCols(36).row(2).array() -= 9.81 * 1e-3;
      flight.step(1e-3);
    }
    // Two borders of the upper layer lie over nothing.
    const double speed = flight.state.velocities.rightCols(36).row(0).mean();
    const double expected = 0.2 - mu * 9.81 * 5e-3;
    CHECK(speed == Approx(expected).epsilon(0.02));
    CHECK(flight.state.positions.rightCols(36).row(2).minCoeff() >= 0.0018);
  }
}

TEST_CASE("layers that start too close move apart slowly", "[self_contact]") {
  auto flight = two_layers<double>(5, 0.0005, settings_of(0.004));
  for (int k = 0; k < 20; ++k) {
    const Points<double> before = flight.state.positions;
    flight.step(1e-3);
    CHECK((flight.state.positions - before).colwise().norm().maxCoeff() <= 0.1 * 1e-3 * 1.5);
  }
  CHECK(flight.state.velocities.norm() <= 1e-12);
  // 20 steps of at most 0.1 mm.
  const double gap = flight.state.positions.rightCols(25).row(2).mean() -
                     flight.state.positions.leftCols(25).row(2).mean();
  CHECK(gap >= 0.0015);
  CHECK(gap <= 0.003);
}

TEST_CASE("a driven layer takes a free one along", "[self_contact]") {
  auto flight = two_layers<double>(5, 0.01, settings_of(0.002));
  flight.inverse_mass.tail(25).setZero();
  for (int k = 0; k < 30; ++k) {
    flight.state.velocities.rightCols(25).row(2).array() = -1;
    const Points<double> driven =
        flight.state.positions.rightCols(25) + kStep * flight.state.velocities.rightCols(25);
    const SheetImpactReport report = flight.step();
    CHECK(report.crossings_left == 0);
    CHECK(flight.state.positions.rightCols(25) == driven);
  }
  CHECK(flight.crossings() == 0);
}

TEST_CASE("a crossing that driven vertices force is told and stays finite", "[self_contact]") {
  auto flight = two_layers<double>(5, 0.01, settings_of(0.002));
  flight.inverse_mass.setZero();
  // One free vertex between.
  flight.inverse_mass[12] = 1000;
  bool told = false;
  for (int k = 0; k < 10; ++k) {
    flight.state.velocities.rightCols(25).row(2).array() = -1;
    flight.state.velocities(0, 37) = 0.3;
    flight.state.velocities(2, 37) = -3;
    const SheetImpactReport report = flight.step();
    told = told || report.crossings_left > 0;
    if (report.crossings_left > 0) CHECK(report.status == StepStatus::IterationLimit);
    CHECK(report.crossings_left == flight.crossings());
    CHECK(flight.state.velocities.allFinite());
    CHECK(flight.state.velocities.col(12).norm() <= 20);
  }
  CHECK(told);
}

TEST_CASE("coincident layers and vertices do no harm", "[self_contact]") {
  auto flight = two_layers<double>(4, 0, settings_of(0.002));
  flight.state.positions.rightCols(16) = flight.state.positions.leftCols(16);
  std::mt19937 random(73);
  for (int k = 0; k < 10; ++k) {
    for (Index i = 0; i < flight.state.velocities.size(); ++i)
      flight.state.velocities(i) += uniform(random, -0.1, 0.1);
    const double before = flight.energy();
    flight.step();
    CHECK(flight.state.positions.allFinite());
    CHECK(flight.energy() <= 2 * before + 1e-3);
  }
}

TEST_CASE("two sheets fall on each other and come to rest as layers", "[self_contact]") {
  const int n = clothctl_test::trials(9, 33, 5);
  auto upper = clothctl_test::layer(n, 0.3, 0.03);
  upper.positions.row(0).array() += 0.0041;
  const auto both = clothctl_test::together(clothctl_test::layer(n, 0.3), upper);
  Points<double> rest = both.positions;
  rest.rightCols(n * n).row(2).array() += 1;
  const auto network = sheet_network<double>(rest, both.triangles, Material<double>{}).value();
  MassSpringSettings<double> springs;
  springs.drag = 0.5;
  for (int r = 0; r < n; ++r) {
    springs.pinned.push_back(r * n);
    springs.pinned.push_back(r * n + n - 1);
  }
  VectorX<double> inverse_mass = network.mass.cwiseInverse();
  for (const int v : springs.pinned) inverse_mass[v] = 0;
  const auto model = MassSpring<double>::create(network, springs).value();
  auto ws = model.make_workspace();
  ClothState<double> state{both.positions, Points<double>::Zero(3, 2 * n * n)};
  auto impacts = SheetImpacts<double>::create(rest, network.triangles, settings_of(0.002)).value();
  int contacts = 0;
  for (int k = 0; k < 60; ++k) {
    const Points<double> before = state.positions;
    REQUIRE(model.step(state, {}, kStep, ws).advanced);
    const SheetImpactReport report = impacts.resolve(before, inverse_mass, kStep, state);
    CHECK(report.status == StepStatus::Converged);
    contacts = report.contacts;
  }
  auto finder = SelfContactFinder<double>::create(rest, network.triangles).value();
  CHECK(finder.count_crossings(state.positions) == 0);
  CHECK(contacts > n * n / 2);
  CHECK(state.velocities.colwise().norm().maxCoeff() <= 0.3);
}

TEST_CASE("a sheet folded in four is pulled open without a crossing", "[self_contact]") {
  const int n = clothctl_test::trials(13, 65, 7);
  const double size = 0.5, h = 0.002;
  const auto mesh = clothctl_test::layer(n, size);
  const auto network =
      sheet_network<double>(mesh.positions, mesh.triangles, Material<double>{}).value();
  MassSpringSettings<double> springs;
  springs.drag = 1;
  const auto model = MassSpring<double>::create(network, springs).value();
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  // Coarse sheets need more room in their folds.
  state.positions = clothctl_test::fold_in_four(mesh.positions, size, 0.0325);
  auto finder = SelfContactFinder<double>::create(mesh.positions, mesh.triangles).value();
  REQUIRE(finder.count_crossings(state.positions) == 0);
  auto impacts =
      SheetImpacts<double>::create(mesh.positions, mesh.triangles, settings_of(h)).value();
  impacts.reserve(200 * n * n);
  const int top = n * n - 1, bottom = 0;
  VectorX<double> inverse_mass = network.mass.cwiseInverse();
  inverse_mass[top] = inverse_mass[bottom] = 0;
  ClothInput<double> input;
  input.driven_vertices = {bottom, top};
  input.driven_positions.resize(3, 2);
  const Points<double> start = state.positions;
  for (int k = 0; k < 100; ++k) {
    const double share = std::min(1.0, 0.0125 * k);
    input.driven_positions.col(0) = start.col(bottom);
    input.driven_positions.col(1) =
        (1 - share) * start.col(top) + share * Vector3<double>(0.5, 0.5, 0.3);
    const Points<double> before = state.positions;
    REQUIRE(model.step(state, input, kStep, ws).advanced);
    const SheetImpactReport report = impacts.resolve(before, inverse_mass, kStep, state);
    CHECK(report.crossings_left == 0);
    CHECK(finder.count_crossings(state.positions) == 0);
  }
}

TEST_CASE("a corner that is through a sheet comes back", "[self_contact]") {
  auto flight = two_layers<double>(12, 0.004, settings_of(0.001));
  flight.inverse_mass.head(144).setZero();
  // The corner of the upper layer is bent down through the lower one.
  Points<double>& x = flight.state.positions;
  for (Index v = 144; v < 288; ++v) {
    x.col(v) += Vector3<double>(0.03, 0.03, 0);
    const double deep = std::max(0.0, 0.1 - x(0, v) - x(1, v));
    x(2, v) -= 0.5 * deep;
  }
  const int start = flight.crossings();
  REQUIRE(start > 3);
  int last = start;
  for (int k = 0; k < 200 && last > 0; ++k) {
    // Nothing but the pass moves it: a tangle that is left alone.
    flight.state.velocities *= 0;
    last = flight.step().crossings_left;

    REQUIRE(last <= 2 * start);
  }
  CHECK(last == 0);
}

TEST_CASE("layers of a position-based sheet are pushed apart in its substeps", "[self_contact]") {
  auto flight = two_layers<double>(6, 0.003, settings_of(0.002));
  Points<double> y = flight.state.positions;
  CHECK(flight.impacts.find_layers(y, 0.004, flight.inverse_mass) > 30);
  y.rightCols(36).row(2).array() -= 0.002;
  for (int k = 0; k < 20; ++k) flight.impacts.push_apart(y);
  const double gap = y.rightCols(36).row(2).mean() - y.leftCols(36).row(2).mean();
  CHECK(gap >= 0.0015);
  CHECK(flight.impacts.find_layers(y.leftCols(3), 0.004, flight.inverse_mass) == -1);
  CHECK(flight.impacts.find_layers(y, -1, flight.inverse_mass) == -1);
}

TEST_CASE("the pass allocates nothing and repeats its bits", "[self_contact]") {
  std::mt19937 random(74);
  const auto mesh = clothctl_test::layer(9, 0.1);
  Flight<double> one(mesh, mesh.positions, settings_of(0.003));
  for (int k = 0; k < 3; ++k) {
    crumple(one, random, 10);
    one.step();
  }
  crumple(one, random, 10);
  // The other pass has not seen what came before.
  Flight<double> two(mesh, mesh.positions, settings_of(0.003));
  two.state = one.state;
  const Points<double> before = one.state.positions;
  one.state.positions += kStep * one.state.velocities;
  two.state = one.state;
  const long made = clothctl_test::allocations();
  const SheetImpactReport report = one.impacts.resolve(before, one.inverse_mass, kStep, one.state);
  const long after = clothctl_test::allocations();
  if (clothctl_test::allocation_counting_works()) CHECK(after == made);
  CHECK(report.contacts > 0);
  CHECK(report.impacts > 0);
  two.impacts.resolve(before, two.inverse_mass, kStep, two.state);
  CHECK(two.state == one.state);
}

TEST_CASE("the pass refuses what is no state and no number", "[self_contact]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  auto flight = two_layers<double>(3, 0.001, settings_of(0.002));
  const ClothState<double> good = flight.state;
  const auto status = [&](const Points<double>& before, const VectorX<double>& inverse_mass,
                          double dt, ClothState<double> state) {
    const ClothState<double> kept = state;
    const StepStatus out = flight.impacts.resolve(before, inverse_mass, dt, state).status;
    if (kept == kept) CHECK(state == kept);
    return out;
  };
  const Points<double>& x = good.positions;
  ClothState<double> bad = good;
  bad.velocities(1, 1) = nan;
  CHECK(status(x, flight.inverse_mass, kStep, bad) == StepStatus::InvalidState);
  CHECK(status(bad.velocities, flight.inverse_mass, kStep, good) == StepStatus::InvalidState);
  CHECK(status(x.leftCols(2), flight.inverse_mass, kStep, good) == StepStatus::InvalidState);
  CHECK(status(x, flight.inverse_mass.head(3), kStep, good) == StepStatus::InvalidInput);
  CHECK(status(x, -flight.inverse_mass, kStep, good) == StepStatus::InvalidInput);
  CHECK(status(x, nan * flight.inverse_mass, kStep, good) == StepStatus::InvalidInput);
  CHECK(status(x, flight.inverse_mass, 0, good) == StepStatus::InvalidInput);
  CHECK(status(x, flight.inverse_mass, nan, good) == StepStatus::InvalidInput);

  const auto refuse = [&](SheetImpactSettings<double> settings) {
    return SheetImpacts<double>::create(flight.rest, flight.mesh.triangles, settings).error();
  };
  SheetImpactSettings<double> settings;
  settings.thickness = 0;
  CHECK(refuse(settings) == "sheet impacts have the thickness 0 m, must be finite and positive");
  settings = {};
  settings.friction = -1;
  CHECK(refuse(settings) == "sheet impacts have the friction -1, must be finite and not negative");
  settings = {};
  settings.push_speed = nan;
  CHECK(refuse(settings) ==
        "sheet impacts have the push speed nan m/s, must be finite and not negative");
  settings = {};
  settings.sweeps = 0;
  CHECK(refuse(settings) == "sheet impacts have sweeps 0, must be at least 1");
  settings = {};
  settings.joined = {{0, 99}};
  CHECK(refuse(settings) == "joined pair 0 holds vertex 99 off the sheet of 18 vertices");
}
