// Slow motion under a limit of stretch: what counts as slow, and what becomes of velocities that
// the motion does not show.

#include "clothctl/cloth/detail/slow_motion.hpp"

#include <cmath>

#include "clothctl/cloth/position_based.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

const Vector3<double> kGravity(0, 3, -4);  // 5 m/s²
constexpr double kSubstep = 0.01, kStep = 0.04;

/// Three vertices; the last two are held, one of them moves by 2 mm along x.
struct Hands {
  ClothState<double> state{Points<double>::Random(3, 3), Points<double>::Zero(3, 3)};
  ClothInput<double> input;
  Hands() {
    input.driven_vertices = {2};
    input.driven_positions = state.positions.col(2) + Vector3<double>(0.002, 0, 0);
  }
  SlowMotion<double> slow(std::size_t held = 2) const {
    return slow_motion(state, input, held, Vector3<double>(Vector3<double>::Zero()), kGravity,
                       kSubstep, kStep);
  }
};

/// A sheet of 0.5 m with a limit of stretch, without drag.
struct SheetRun {
  GridMesh<double> grid = make_grid<double>(9, 9, 0.5, 0.5).value();
  SpringNetwork<double> network = sheet_network(grid, Material<double>()).value();
  PositionBasedSettings<double> settings;
  explicit SheetRun(int substeps) {
    settings.stretch_limit = 0.02;
    settings.substeps = substeps;
  }
  PositionBased<double> model() const {
    return PositionBased<double>::create(network, settings).value();
  }
};

}  // namespace

TEST_CASE("slow motion is measured against the mean of the hands and gravity", "[slow_motion]") {
  Hands hands;
  const SlowMotion<double> slow = hands.slow();
  CHECK((slow.held - Vector3<double>(0.025, 0, 0)).norm() <= 1e-12);
  CHECK(slow.fall == Approx(0.5 * 5 * kStep));
  CHECK(slow.slow == Approx(0.2 * 5 * kSubstep));
  hands.input.clear();
  CHECK(hands.slow(1).held == Vector3<double>::Zero());
  CHECK(hands.slow(0).held == Vector3<double>::Zero());
}

TEST_CASE("a sheet moves if the speeds relative to the hands exceed g dt/2", "[slow_motion]") {
  Hands hands;
  const SlowMotion<double> slow = hands.slow();
  VectorX<double> inverse_mass(3);
  inverse_mass << 0.5, 2.0, 0.0;  // 2 kg, 0.5 kg, held
  // The mean square, weighted by the masses, is (2 a² + 0.5 b²)/2.5.
  const auto at = [&](double a, double b) {
    hands.state.velocities.col(0) = slow.held + Vector3<double>(0, a, 0);
    hands.state.velocities.col(1) = slow.held + Vector3<double>(0, 0, -b);
    hands.state.velocities.col(2).setConstant(100);
    return moves(slow, hands.state, inverse_mass);
  };
  const double bound = 0.5 * 5 * kStep;
  CHECK_FALSE(at(0.999 * bound, 0.999 * bound));
  CHECK(at(1.001 * bound, 1.001 * bound));
  CHECK_FALSE(at(0, 2.23 * bound));
  CHECK(at(0, 2.24 * bound));
}

TEST_CASE("slow vertices are no faster than the step has moved them", "[slow_motion]") {
  const SlowMotion<double> slow = Hands().slow();
  const Vector3<double> told(0.3, -0.2, 0.1);
  const double bound = 0.2 * 5 * kSubstep;
  Points<double> before = Points<double>::Random(3, 5), after = before, velocities(3, 5);
  const double seen[] = {0.0, 0.5 * bound, 0.999 * bound, 1.001 * bound, 0.5 * bound};
  for (Index v = 0; v < 5; ++v) {
    after.col(v) += kStep * (slow.held + Vector3<double>(0, 0, seen[v]));
    velocities.col(v) = slow.held + (v < 4 ? told : Vector3<double>(0, 0.4 * bound, 0));
  }
  const Points<double> same = velocities;
  calm_slow_vertices(slow, before, after, velocities);
  for (Index v = 0; v < 3; ++v) {
    const Vector3<double> left = velocities.col(v) - slow.held;
    CHECK((left - seen[v] / told.norm() * told).norm() <= 1e-12);
  }
  CHECK(velocities.rightCols(2) == same.rightCols(2));  // fast; slower than the step: same bits
}

TEST_CASE("without gravity nothing is slow", "[slow_motion]") {
  const Hands hands;
  const SlowMotion<double> slow = slow_motion(hands.state, hands.input, std::size_t(2),
                                              Vector3<double>(Vector3<double>::Zero()),
                                              Vector3<double>(0, 0, 0), kSubstep, kStep);
  Points<double> velocities = 1e-9 * Points<double>::Random(3, 3);
  const Points<double> same = velocities;
  calm_slow_vertices(slow, hands.state.positions, hands.state.positions, velocities);
  CHECK(velocities == same);
}

TEST_CASE("a pendulum of half a degree swings on under a limit of stretch", "[slow_motion]") {
  // A hanging sheet of length L swings at 0.191 √(g/L) Hz: at 0.85 Hz, 10 zeros in 6 s.
  for (const int substeps : {1, 5, 20}) {
    SheetRun run(substeps);
    run.settings.pinned = {72, 73, 74, 75, 76, 77, 78, 79, 80};
    const PositionBased<double> model = run.model();
    auto workspace = model.make_workspace();
    ClothState<double> state = model.rest_state();
    const double top = state.positions(2, 72), angle = 0.5 * 3.14159265358979 / 180;
    for (Index v = 0; v < 81; ++v) {
      const double depth = top - state.positions(2, v);
      state.positions(1, v) = depth * std::sin(angle);
      state.positions(2, v) = top - depth * std::cos(angle);
    }
    const double start = state.positions(1, 4);
    int crossings = 0;
    double last = start, late = 0;
    for (int k = 0; k < 360; ++k) {
      REQUIRE(model.step(state, {}, 1.0 / 60, workspace).advanced);
      const double now = state.positions(1, 4);
      if ((now < 0) != (last < 0)) ++crossings;
      if (k >= 300) late = std::max(late, std::abs(now));
      last = now;
    }
    CAPTURE(substeps, late / start);
    CHECK(std::abs(crossings - 10) <= 1);
    CHECK(late > (substeps == 1 ? 0.15 : 0.4) * start);
  }
}

TEST_CASE("a sheet follows hands at 3 mm/s under a limit of stretch", "[slow_motion]") {
  for (const int substeps : {1, 5, 20}) {
    SheetRun run(substeps);
    run.settings.drag = 2.0;
    const PositionBased<double> model = run.model();
    auto workspace = model.make_workspace();
    ClothState<double> state = model.rest_state();
    ClothInput<double> input;
    input.driven_vertices = {72, 80};
    const auto frame = [&](double shift) {
      input.driven_positions.resize(3, 2);
      for (Index i = 0; i < 2; ++i) {
        input.driven_positions.col(i) =
            run.grid.positions.col(input.driven_vertices[static_cast<std::size_t>(i)]) +
            Vector3<double>(0, shift, 0);
      }
      REQUIRE(model.step(state, input, 1.0 / 60, workspace).advanced);
    };
    for (int k = 0; k < 240; ++k) frame(0);
    const double before = state.positions.row(1).mean();
    for (int k = 1; k <= 300; ++k) frame(0.003 * k / 60);
    CAPTURE(substeps);
    CHECK(state.positions.row(1).mean() - before == Approx(0.015).margin(0.003));
  }
}

TEST_CASE("a slow body that nothing holds keeps its velocity", "[slow_motion]") {
  SheetRun run(5);
  const PositionBased<double> model = run.model();
  auto workspace = model.make_workspace();
  ClothState<double> state = model.rest_state();
  ClothInput<double> carried;  // forces balance the weight
  carried.forces.setZero(3, 81);
  for (int v = 0; v < 81; ++v) {
    carried.force_vertices.push_back(v);
    carried.forces(2, v) = 9.81 * run.network.mass[v];
  }
  const Vector3<double> drift(0.001, 0.0005, 0);
  state.velocities.colwise() = drift;
  for (int k = 0; k < 60; ++k) REQUIRE(model.step(state, carried, 1.0 / 60, workspace).advanced);
  const Vector3<double> mean = state.velocities * run.network.mass / run.network.mass.sum();
  CHECK((mean - drift).norm() <= 1e-9);
}
