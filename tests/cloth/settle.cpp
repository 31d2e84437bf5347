// Settling: the result hangs still, the held vertices stay held, when it stops, and what it
// refuses.

#include "clothctl/cloth/settle.hpp"

#include <algorithm>
#include <limits>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
ModelPlant<MassSpring<S>> sheet_with_drag(S drag) {
  const GridMesh<S> grid = make_grid<S>(5, 5, S(0.2), S(0.2)).value();
  MassSpringSettings<S> settings;
  settings.integration = Integration::Newton;
  settings.drag = drag;
  return ModelPlant<MassSpring<S>>(
      MassSpring<S>::create(sheet_network<S>(grid, Material<S>()).value(), settings).value());
}

// A plant that returns by value, like one that converts its numbers. It counts frames and inputs.
struct Counting {
  ModelPlant<MassSpring<double>> inner = sheet_with_drag<double>(5.0);
  int frames = 0, inputs = 0;
  Index vertex_count() const { return inner.vertex_count(); }
  Points<double> positions() const { return inner.positions(); }
  Points<double> velocities() const { return inner.velocities(); }
  void apply(const ClothInput<double>& input) {
    ++inputs;
    inner.apply(input);
  }
  StepReport<double> advance(double dt) {
    ++frames;
    return inner.advance(dt);
  }
};

// A plant of three vertices. The second moves at the given speeds.
struct Scripted {
  std::vector<double> speeds;
  std::size_t frames = 0;
  Index vertex_count() const { return 3; }
  Points<double> positions() const { return Points<double>::Zero(3, 3); }
  Points<double> velocities() const {
    Points<double> v = Points<double>::Zero(3, 3);
    v(1, 1) = speeds[std::min(frames, speeds.size()) - 1];
    return v;
  }
  void apply(const ClothInput<double>&) {}
  StepReport<double> advance(double) {
    ++frames;
    return {StepStatus::Converged, true, 0.0, 1};
  }
};

}  // namespace

TEMPLATE_TEST_CASE("a settled sheet hangs from the held vertices and stays", "[settle]", float,
                   double) {
  using S = TestType;
  ModelPlant<MassSpring<S>> plant = sheet_with_drag<S>(S(5));
  const Points<S> start = plant.positions();
  const std::vector<int> held{20, 24};
  const SettleReport<S> report = settle(plant, held, S(0.02), S(12), S(1e-3));
  CHECK(report.advanced);
  CHECK(report.speed < S(1e-3));
  for (int v : held) CHECK(plant.positions().col(v) == start.col(v));
  CHECK(plant.positions().row(2).minCoeff() < start.row(2).minCoeff());
  // The held vertices are still held, so it stays.
  const Points<S> settled = plant.positions();
  for (int k = 0; k < 20; ++k) REQUIRE(plant.advance(S(0.02)).advanced);
  CHECK((plant.positions() - settled).cwiseAbs().maxCoeff() < S(1e-3));
}

TEST_CASE("settling ends when its time is over or after ten slow frames", "[settle]") {
  Counting all, some;
  CHECK(settle(all, {20, 24}, 0.02, 3.0).advanced);
  CHECK(all.frames == 150);
  const SettleReport<double> report = settle(some, {20, 24}, 0.02, 30.0, 0.01);
  CHECK(report.speed < 0.01);
  CHECK(some.frames < 1500);
  const int before = some.frames;
  CHECK(settle(some, {20, 24}, 0.02, 30.0, 0.01).advanced);  // at rest from the start
  CHECK(some.frames == before + 10);
}

TEST_CASE("only ten slow frames in a row end it, and a velocity that is not finite fails",
          "[settle]") {
  Scripted plant{{0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0}};
  CHECK(settle(plant, {0}, 0.02, 10.0, 0.5).advanced);
  CHECK(plant.frames == 20);
  Scripted brief{{1}};
  CHECK(settle(brief, {0}, 0.02, 0.001).advanced);
  CHECK(brief.frames == 1);  // at least one frame
  Scripted exact{{1}};
  CHECK(settle(exact, {0}, 0.001, 60.0).advanced);
  CHECK(exact.frames == 60000);
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    Scripted broken{{0, 0, bad}};
    const SettleReport<double> report = settle(broken, {0}, 0.02, 10.0, 0.5);
    CHECK_FALSE(report.advanced);
    CHECK(report.status == StepStatus::NumericalFailure);
    CHECK(broken.frames == 3);
  }
}

TEST_CASE("settle refuses bad arguments and moves nothing", "[settle]") {
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               inf = std::numeric_limits<double>::infinity();
  Counting plant;
  const auto refused = [&](const std::vector<int>& held, double dt, double seconds,
                           double rest_speed) {
    const SettleReport<double> report = settle(plant, held, dt, seconds, rest_speed);
    return !report.advanced && report.status == StepStatus::InvalidInput && plant.frames == 0 &&
           plant.inputs == 0;
  };
  for (const double bad : {nan, inf, -inf, 0.0, -0.02}) {
    CHECK(refused({20}, bad, 1.0, 0.0));
    CHECK(refused({20}, 0.02, bad, 0.0));
    if (!(bad == 0.0)) CHECK(refused({20}, 0.02, 1.0, bad));
  }
  CHECK(refused({20}, 1e-9, 1e9, 0.0));  // too many frames
  CHECK(refused({25}, 0.02, 1.0, 0.0));
  CHECK(refused({-1}, 0.02, 1.0, 0.0));
  // The plant's refusal is passed on: a vertex is driven twice.
  const SettleReport<double> twice = settle(plant, {20, 20}, 0.02, 1.0);
  CHECK_FALSE(twice.advanced);
  CHECK(twice.status == StepStatus::InvalidInput);
  CHECK(plant.frames == 1);
}
