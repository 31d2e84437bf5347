// Vertices that something carries through a step of a position-based sheet.

#include "clothctl/cloth/carried_vertices.hpp"

#include <limits>
#include <utility>
#include <vector>

#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

/// A hanging sheet in y = 0. `irregular`: its springs are not those of a grid.
template <class Scalar>
SpringNetwork<Scalar> hanging_network(int n, bool irregular) {
  const auto grid = make_grid<Scalar>(n, n, Scalar(0.3), Scalar(0.3)).value();
  SpringNetwork<Scalar> network = sheet_network(grid, Material<Scalar>()).value();
  if (irregular) {
    Spring<Scalar> across = network.springs[0];
    across.a = 0;
    across.b = 2 * n + 1;
    across.rest_length =
        (network.rest_positions.col(0) - network.rest_positions.col(across.b)).norm();
    network.springs.push_back(across);
  }
  return network;
}

/// A sheet without drag.
template <class Scalar>
PositionBased<Scalar> hanging_sheet(int n, bool irregular, double limit) {
  auto settings = PositionBasedSettings<Scalar>::of(Material<Scalar>());
  settings.drag = 0;
  settings.substeps = 5;
  settings.stretch_limit = Scalar(limit);
  return PositionBased<Scalar>::create(hanging_network<Scalar>(n, irregular), settings).value();
}

template <class Scalar>
void carry(PositionBasedWorkspace<Scalar>& ws, const std::vector<int>& vertices,
           const Vector3<Scalar>& velocity) {
  ws.carried.vertices.assign(vertices.begin(), vertices.end());
  for (std::size_t i = 0; i < vertices.size(); ++i)
    ws.carried.velocities.col(static_cast<Index>(i)) = velocity;
}

}  // namespace

TEMPLATE_TEST_CASE("carried vertices give the sheet what its momentum gains", "[cloth]", float,
                   double) {
  using Scalar = TestType;
  const double tolerance = std::is_same_v<Scalar, float> ? 0.02 : 1e-9;
  for (const bool irregular : {false, true}) {
    for (const double limit : {0.0, 0.02}) {
      CAPTURE(irregular, limit);
      const auto model = hanging_sheet<Scalar>(17, irregular, limit);
      auto ws = model.make_workspace();
      ClothState<Scalar> state = model.rest_state();
      ClothInput<Scalar> input;
      input.clear();
      const std::vector<int> corner{16 * 17, 16 * 17 + 1, 15 * 17, 15 * 17 + 1};
      VectorX<Scalar> mass = model.network().mass;
      for (const int v : corner) mass[v] = 0;
      const Scalar dt = Scalar(0.01);
      Vector3<Scalar> mean = Vector3<Scalar>::Zero();
      double worst = 0;
      for (int i = 0; i < 400; ++i) {
        const Scalar swing = i < 100 ? Scalar(0.5) : Scalar(0);
        carry<Scalar>(ws, corner, {swing, 0, 0});
        const Vector3<Scalar> before = state.velocities * mass;
        REQUIRE(model.step(state, input, dt, ws).advanced);
        const Vector3<Scalar> given = ws.carried.impulses.leftCols(4).rowwise().sum();
        const Vector3<Scalar> gained = state.velocities * mass - before;
        const Vector3<Scalar> fallen = dt * mass.sum() * model.settings().gravity;
        const double error = double((gained - fallen - given).norm());
        worst = std::max(worst, error / double(fallen.norm() + given.norm()));
        if (i >= 300) mean += given / Scalar(100 * dt);
        for (const int v : corner) CHECK(state.velocities(0, v) == Approx(swing));
      }
      CHECK(worst < tolerance);
      const double weight = 9.81 * double(mass.sum());
      CHECK(double(mean.z()) == Approx(weight).epsilon(0.25));  // it still swings
    }
  }
}

TEST_CASE("carried vertices are where driven ones would be, and so is the rest", "[cloth]") {
  for (const double limit : {0.0, 0.02}) {
    CAPTURE(limit);
    const auto model = hanging_sheet<double>(9, false, limit);
    auto carrying = model.make_workspace(), driving = model.make_workspace();
    ClothState<double> carried = model.rest_state(), driven = carried;
    ClothInput<double> none, input;
    none.clear();
    input.clear();
    input.driven_vertices = {72, 80};
    input.driven_positions = driven.positions(Eigen::all, input.driven_vertices);
    const Vector3<double> velocity(0.2, 0.1, 0);
    for (int i = 0; i < 5; ++i) {
      carry<double>(carrying, {72, 80}, velocity);
      input.driven_positions.colwise() += 0.01 * velocity;
      REQUIRE(model.step(carried, none, 0.01, carrying).advanced);
      REQUIRE(model.step(driven, input, 0.01, driving).advanced);
      for (const int v : {72, 80})
        CHECK((carried.positions.col(v) - driven.positions.col(v)).norm() < 1e-12);
    }
    // Only the share 1e-4 of each correction at the corners differs.
    CHECK((carried.positions - driven.positions).cwiseAbs().maxCoeff() < 2e-4);
  }
}

TEST_CASE("a rope of two vertices hangs at its carried end with its weight", "[cloth]") {
  SpringNetwork<double> network;
  network.rest_positions.resize(3, 2);
  network.rest_positions << 0, 0, 0, 0, 0, -0.1;
  network.mass = Eigen::Vector2d(0.01, 0.02);
  Spring<double> spring;
  spring.a = 0;
  spring.b = 1;
  spring.rest_length = 0.1;
  spring.stiffness = 1e4;
  network.springs.push_back(spring);
  PositionBasedSettings<double> settings;
  settings.substeps = 10;
  settings.iterations = 20;
  const auto model = PositionBased<double>::create(network, settings).value();
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  ClothInput<double> input;
  input.clear();
  for (int i = 0; i < 2000; ++i) {
    carry<double>(ws, {0}, Vector3<double>::Zero());
    state.velocities *= 0.99;
    REQUIRE(model.step(state, input, 0.01, ws).advanced);
  }
  CHECK(ws.carried.impulses(2, 0) == Approx(0.02 * 9.81 * 0.01).epsilon(1e-3));
  CHECK(ws.carried.total == Approx(0.02 * 9.81 * 0.01).epsilon(1e-3));
}

TEST_CASE("bad lists of carried vertices are refused and change nothing", "[cloth]") {
  auto settings = PositionBasedSettings<double>::of(Material<double>());
  settings.pinned = {3};
  const auto model =
      PositionBased<double>::create(hanging_network<double>(5, false), settings).value();
  ClothInput<double> input;
  input.clear();
  input.driven_vertices = {7};
  const ClothState<double> start = model.rest_state();
  input.driven_positions = start.positions.col(7);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Vector3<double> still = Vector3<double>::Zero();
  const std::pair<std::vector<int>, Vector3<double>> cases[] = {
      {{-1}, still}, {{25}, still}, {{4, 4}, still},
      {{3}, still},  {{7}, still},  {{4}, Vector3<double>(nan, 0, 0)}};
  for (const auto& [vertices, velocity] : cases) {
    CAPTURE(vertices);
    auto ws = model.make_workspace();
    ClothState<double> state = start;
    carry<double>(ws, vertices, velocity);
    const StepReport<double> report = model.step(state, input, 0.01, ws);
    CHECK(report.status == StepStatus::InvalidInput);
    CHECK(!report.advanced);
    CHECK(state == start);
  }
}

TEST_CASE("a step that carries vertices does not allocate", "[cloth]") {
  const auto model = hanging_sheet<double>(17, false, 0.02);
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  ClothInput<double> input;
  input.clear();
  carry<double>(ws, {280, 281, 282}, Vector3<double>::Zero());
  const long before = allocations();
  for (int i = 0; i < 5; ++i) {
    if (!model.step(state, input, 0.01, ws).advanced) FAIL("step " << i);
  }
  const long made = allocations() - before;
  if (allocation_counting_works()) CHECK(made == 0);
}
