// The laws of the estimate: exact where model and measurements are, convergent where the start is
// wrong, less noisy than what is measured; late, hidden and false markers; refusals.

#include "clothctl/estimate/state_estimator.hpp"

#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <utility>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/mass_spring_rollout.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Estimator = StateEstimator<MassSpring<double>>;
using Measurement = MarkerMeasurement<double>;
using P = Points<double>;

static_assert(ClothPlant<Estimator>);
static_assert(ClothPlant<StateEstimator<MassSpringRollout<double>>>);

// A sheet that hangs from two hands, which sway.
struct Swaying {
  GridMesh<double> grid = make_grid<double>(5, 5, 0.4, 0.4).value();
  MassSpring<double> model;
  ModelPlant<MassSpring<double>> plant;
  PointFeatures<double> markers;
  ClothInput<double> hold;
  Measurement measurement;
  int frame = 0;

  Swaying() : model(make_model(grid)), plant(model) {
    for (const int v : {0, 2, 4, 10, 12, 14}) markers.add_point(v);
    hold.driven_vertices = {20, 24};
    hold.driven_positions = grid.positions(Eigen::all, hold.driven_vertices);
    measurement.reserve(markers.count());
  }
  static MassSpring<double> make_model(const GridMesh<double>& grid) {
    Material<double> material;
    MassSpringSettings<double> settings;
    settings.drag = 1;
    settings.limit_energy = false;
    return MassSpring<double>::create(sheet_network(grid, material).value(), settings).value();
  }
  // With the model's own steps.
  static EstimatorSettings<double> plain() {
    EstimatorSettings<double> settings;
    settings.newton_steps = settings.first_newton_steps = 0;
    return settings;
  }
  Estimator estimator(EstimatorSettings<double> settings = {}) const {
    return Estimator::create(model, markers, plant.state(), hold, settings).value();
  }
  ClothInput<double> input(int at) const {
    ClothInput<double> moved = hold;
    moved.driven_positions.row(1).array() += 0.05 * std::sin(0.1 * at) * (1 - std::exp(-0.1 * at));
    return moved;
  }
  const Measurement& look() {
    measurement.frame = frame;
    evaluate_features<double>(markers, plant.positions(), measurement.positions);
    measurement.see_finite();
    return measurement;
  }
  void go_on() {
    plant.apply(input(frame++));
    REQUIRE(plant.advance(0.02).advanced);
  }
};

// A model whose steps fail when asked to.
struct Fragile : MassSpring<double> {
  const bool* fails;

  Fragile(MassSpring<double> model, const bool& asked)
      : MassSpring<double>(std::move(model)), fails(&asked) {}
  StepReport<double> step(ClothState<double>& state, const ClothInput<double>& input, double dt,
                          Workspace& workspace) const {
    if (*fails) return {StepStatus::InvalidInput, false, 0, 0};
    return MassSpring<double>::step(state, input, dt, workspace);
  }
};

double rms(const P& difference) {
  return std::sqrt(difference.squaredNorm() / static_cast<double>(difference.size()));
}

void go_on(Estimator& estimator, const Swaying& sheet) {
  estimator.apply(sheet.input(static_cast<int>(estimator.frame())));
  REQUIRE(estimator.advance(0.02).advanced);
}

}  // namespace

TEST_CASE("estimator: of its own model it is exact, ahead of delay and latency", "[estimate]") {
  Swaying sheet;
  EstimatorSettings<double> settings = Swaying::plain();
  settings.latency = 1;
  Estimator estimator = sheet.estimator(settings);
  REQUIRE(estimator.frame() == 1);
  std::vector<Measurement> seen;
  std::vector<P> x, v;
  std::vector<ClothInput<double>> sent{sheet.hold};
  for (int frame = 0; frame < 20; ++frame) {
    seen.push_back(sheet.look());
    if (frame >= 3) {
      const auto report = estimator.correct(seen[static_cast<std::size_t>(frame - 3)]);
      REQUIRE(report.status == EstimateStatus::Corrected);
      CHECK(report.seen == 6);
      CHECK(report.outliers == 0);
      CHECK(report.innovation < 1e-15);
    }
    x.push_back(estimator.positions());
    v.push_back(estimator.velocities());
    sent.push_back(sheet.input(frame));
    estimator.apply(sent.back());
    REQUIRE(estimator.advance(0.02).advanced);
    sheet.plant.apply(sent[static_cast<std::size_t>(frame)]);
    REQUIRE(sheet.plant.advance(0.02).advanced);
    ++sheet.frame;
    CHECK(rms(sheet.plant.positions() - x.back()) < 1e-14);  // planned from a frame ahead
    CHECK(rms(sheet.plant.velocities() - v.back()) < 1e-12);
  }
}

TEST_CASE("estimator: a wrong start is forgotten, with and without delay", "[estimate]") {
  for (const int delay : {0, 3}) {
    Swaying sheet;
    EstimatorSettings<double> settings = Swaying::plain();
    settings.acceleration = 1;
    ClothState<double> wrong = sheet.plant.state();
    for (Index i = 0; i < 20; ++i) wrong.positions(1, i) += 0.02 * std::cos(0.7 * double(i % 5));
    Estimator estimator =
        Estimator::create(sheet.model, sheet.markers, wrong, sheet.hold, settings).value();
    std::vector<Measurement> seen;
    const double before = rms(estimator.positions() - sheet.plant.positions());
    for (int frame = 0; frame < 60; ++frame) {
      seen.push_back(sheet.look());
      if (frame >= delay)
        REQUIRE(estimator.correct(seen[static_cast<std::size_t>(frame - delay)]).status ==
                EstimateStatus::Corrected);
      go_on(estimator, sheet);
      sheet.go_on();
    }
    CHECK(before > 0.005);
    CHECK(rms(estimator.positions() - sheet.plant.positions()) < 0.05 * before);
  }
}

TEST_CASE("estimator: less noisy than the measurements and their differences", "[estimate]") {
  Swaying sheet;
  EstimatorSettings<double> settings;
  settings.acceleration = 0.5;
  Estimator estimator = sheet.estimator(settings);
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal(0, 0.002);
  double position = 0, velocity = 0, raw = 0;
  P last = P::Zero(3, 6), marked(3, 6), moved(3, 6);
  for (int frame = 0; frame < 100; ++frame) {
    Measurement seen = sheet.look();
    for (Index i = 0; i < seen.positions.size(); ++i) seen.positions.data()[i] += normal(random);
    REQUIRE(estimator.correct(seen).status == EstimateStatus::Corrected);
    evaluate_features<double>(sheet.markers, estimator.velocities() - sheet.plant.velocities(),
                              moved);
    evaluate_features<double>(sheet.markers, sheet.plant.velocities(), marked);
    if (frame > 20) {
      position += rms(estimator.positions() - sheet.plant.positions());
      velocity += rms(moved);
      raw += rms((seen.positions - last) / 0.02 - marked);
    }
    last = seen.positions;
    go_on(estimator, sheet);
    sheet.go_on();
  }
  CHECK(position / 79 < 0.001);  // measured to 0.002
  CHECK(velocity < 0.2 * raw);
}

TEST_CASE("estimator: hidden and false markers", "[estimate]") {
  Swaying sheet, other;
  Estimator estimator = sheet.estimator(), plain = sheet.estimator();
  Measurement seen = sheet.look();
  seen.positions.array() += 0.001;
  seen.seen[3] = 0;
  seen.positions.col(3).setConstant(std::numeric_limits<double>::quiet_NaN());
  CHECK(estimator.check_input(seen).empty());
  REQUIRE(plain.correct(seen).seen == 5);
  seen.seen[3] = 1;
  seen.positions.col(3).setConstant(0.7);
  const auto report = estimator.correct(seen);
  CHECK(report.status == EstimateStatus::Corrected);
  CHECK(report.seen == 6);
  CHECK(report.outliers == 1);
  CHECK(estimator.positions() == plain.positions());
  for (int i = 0; i < 3; ++i) REQUIRE(estimator.correct(seen).outliers == 1);
  CHECK(rms(estimator.positions() - plain.positions()) > 1e-4);  // after a while it is believed
  CHECK(rms(estimator.positions() - plain.positions()) < 0.01);
  seen.seen.assign(6, 0);
  CHECK(estimator.correct(seen).status == EstimateStatus::NothingSeen);
}

TEST_CASE("estimator: refusals change nothing", "[estimate]") {
  Swaying sheet;
  EstimatorSettings<double> settings;
  settings.history = 2;
  Estimator estimator = sheet.estimator(settings);
  std::vector<Measurement> seen{sheet.look()};
  for (int frame = 0; frame < 3; ++frame) {
    go_on(estimator, sheet);
    sheet.go_on();
    seen.push_back(sheet.look());
  }
  REQUIRE(estimator.oldest() == 1);
  const P x = estimator.positions(), v = estimator.velocities();
  Measurement bad = seen[3];
  bad.positions(2, 1) = std::numeric_limits<double>::infinity();
  CHECK(estimator.correct(bad).status == EstimateStatus::InvalidInput);
  CHECK(estimator.check_input(bad) == "marker 1 is seen, but its z is inf");
  bad = seen[3];
  bad.seen.pop_back();
  CHECK(estimator.correct(bad).status == EstimateStatus::InvalidInput);
  CHECK(estimator.correct(seen[0]).status == EstimateStatus::TooOld);
  CHECK(estimator.check_input(seen[0]) ==
        "the measurement is of frame 0, the estimate has frames 1 to 3");
  bad = seen[3];
  bad.frame = 4;
  CHECK(estimator.correct(bad).status == EstimateStatus::NotReached);
  CHECK(estimator.advance(0.01).status == StepStatus::InvalidInput);
  ClothInput<double> off = sheet.hold;
  off.driven_vertices[0] = 25;
  estimator.apply(off);
  CHECK_FALSE(estimator.advance(0.02).advanced);
  CHECK(estimator.frame() == 3);
  CHECK(estimator.positions() == x);
  CHECK(estimator.velocities() == v);
  REQUIRE(estimator.correct(seen[2]).status == EstimateStatus::Corrected);
  CHECK(estimator.correct(seen[1]).status == EstimateStatus::TooOld);  // behind the last one
  CHECK(to_string(EstimateStatus::NotAdvanced) == "not_advanced");
}

TEST_CASE("estimator: a correction that the model cannot step changes nothing", "[estimate]") {
  Swaying sheet;
  bool fails = false;
  const auto make = [&] {
    return StateEstimator<Fragile>::create(Fragile(sheet.model, fails), sheet.markers,
                                           sheet.plant.state(), sheet.hold, Swaying::plain())
        .value();
  };
  auto tried = make(), spared = make();
  for (auto* each : {&tried, &spared}) {
    each->apply(sheet.input(0));
    REQUIRE(each->advance(0.02).advanced);
  }
  sheet.go_on();
  Measurement seen = sheet.look();
  seen.positions.col(3).setConstant(0.7);  // an outlier
  fails = true;
  for (int i = 0; i < 6; ++i) CHECK(tried.correct(seen).status == EstimateStatus::NotAdvanced);
  CHECK(tried.positions() == spared.positions());
  fails = false;
  for (auto* each : {&tried, &spared})
    CHECK(each->correct(seen).status == EstimateStatus::Corrected);
  CHECK(tried.positions() == spared.positions());  // it is not believed for its failures
}

TEST_CASE("estimator: create says what is wrong", "[estimate]") {
  const Swaying sheet;
  const auto line = [&](const PointFeatures<double>& markers, const ClothState<double>& start,
                        const ClothInput<double>& hold, EstimatorSettings<double> settings) {
    const auto made = Estimator::create(sheet.model, markers, start, hold, settings);
    return made ? std::string() : std::string(made.error());
  };
  const ClothState<double> start = sheet.plant.state();
  CHECK(line(sheet.markers, start, sheet.hold, {}).empty());
  EstimatorSettings<double> settings;
  settings.noise = 0;
  CHECK(line(sheet.markers, start, sheet.hold, settings) ==
        "noise is 0, must be positive and finite");
  PointFeatures<double> off;
  off.add_point(25);
  CHECK(line(off, start, sheet.hold, {}) ==
        "markers: feature 0 uses vertex 25, off a mesh of 25 vertices");
  ClothState<double> small{P::Zero(3, 4), P::Zero(3, 25)};
  CHECK(line(sheet.markers, small, sheet.hold, {}) ==
        "4 positions in the state for 25 vertices of the model");
  ClothInput<double> hold = sheet.hold;
  hold.driven_vertices[1] = -1;
  CHECK(line(sheet.markers, start, hold, {}) ==
        "driven vertex 1: vertex -1 is off the mesh of 25 vertices");
}

TEST_CASE("estimator: a model that rolls out, without allocation, the same bits", "[estimate]") {
  Swaying sheet;
  using Rolled = StateEstimator<MassSpringRollout<double>>;
  const auto make = [&] {
    return Rolled::create(MassSpringRollout<double>(sheet.model), sheet.markers,
                          sheet.plant.state(), sheet.hold)
        .value();
  };
  Rolled estimator = make(), twin = make();
  std::vector<Measurement> seen;
  for (int frame = 0; frame < 25; ++frame) {
    seen.push_back(sheet.look());
    const ClothInput<double> input = sheet.input(frame);
    const long before = clothctl_test::allocations();
    bool good = true;
    if (frame >= 2) {
      Measurement& late = seen[static_cast<std::size_t>(frame - 2)];
      late.seen[static_cast<std::size_t>(frame) % 6] = 0;
      good = estimator.correct(late).status == EstimateStatus::Corrected;
    }
    estimator.apply(input);
    good = good && estimator.advance(0.02).advanced;
    const long made = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
    REQUIRE(good);
    if (frame >= 2)
      REQUIRE(twin.correct(seen[static_cast<std::size_t>(frame - 2)]).status ==
              EstimateStatus::Corrected);
    twin.apply(input);
    REQUIRE(twin.advance(0.02).advanced);
    sheet.go_on();
  }
  CHECK(estimator.positions() == twin.positions());
  CHECK(estimator.velocities() == twin.velocities());
  CHECK(rms(estimator.positions() - sheet.plant.positions()) < 1e-3);
}
