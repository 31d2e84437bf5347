// Disturbances that are known are found: on the model's own sheet exactly, with any grips.

#include "clothctl/estimate/disturbance_observer.hpp"

#include <limits>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

using namespace clothctl;
using V = Vector3<double>;
using clothctl_test::HangingSheet;
using Observer = DisturbanceObserver<MassSpring<double>>;

namespace {

const HangingSheet& sheet() {
  static const HangingSheet made = clothctl_test::hanging_sheet(6);
  return made;
}

Observer observer(DisturbanceSettings<double> settings = {}) {
  return Observer::create(sheet().model(Integration::LinearlyImplicit), sheet().network.mass,
                          settings)
      .value();
}

// Held by its upper corners, or only by forces there.
ClothInput<double> hold(bool driven) {
  ClothInput<double> input;
  const std::vector<int> corners{sheet().upper_left(), sheet().upper_right()};
  if (driven) {
    input.driven_vertices = corners;
    input.driven_positions.resize(3, 2);
    for (Index j : {0, 1})
      input.driven_positions.col(j) =
          sheet().state.positions.col(corners[static_cast<std::size_t>(j)]);
  } else {
    input.force_vertices = corners;
    input.forces = (0.5 * sheet().gravity_load()).replicate(1, 2);
  }
  return input;
}

// The sheet's step under an input and an acceleration of all vertices.
ClothState<double> stepped(const ClothState<double>& from, ClothInput<double> input,
                           const V& acceleration) {
  const MassSpring<double> model = sheet().model(Integration::LinearlyImplicit);
  auto workspace = model.make_workspace();
  ClothState<double> state = from;
  const Index forces = input.forces.cols(), n = state.positions.cols();
  Points<double> all(3, forces + n);
  if (forces > 0) all.leftCols(forces) = input.forces;
  for (Index i = 0; i < n; ++i) {
    input.force_vertices.push_back(static_cast<int>(i));
    all.col(forces + i) = sheet().network.mass[i] * acceleration;
  }
  input.forces = all;
  REQUIRE(model.step(state, input, 0.02, workspace).advanced);
  return state;
}

}  // namespace

TEST_CASE("a constant disturbance is found, whoever holds the sheet", "[estimate]") {
  const V gust(0.4, -1.9, 0.3);
  for (const bool driven : {false, true}) {
    Observer seen = observer();
    ClothState<double> state = sheet().state;
    double last = gust.norm();
    for (int k = 0; k < 60; ++k) {
      const ClothInput<double> input = hold(driven);
      const ClothState<double> next = stepped(state, input, gust);
      REQUIRE(seen.observe(state, input, 0.02, next.velocities));
      state = next;
      const double off = (seen.acceleration() - gust).norm();
      CAPTURE(driven, k, off);
      if (k < 15) CHECK(off < last);
      last = off;
    }
    // Driven vertices bear most of what acts along the taut sheet: there it takes longer.
    CHECK(last < (driven ? 0.02 : 1e-6) * gust.norm());
    CHECK(seen.acceleration()[1] == Approx(gust[1]).epsilon(0.01));
    for (Index i = 0; i < state.positions.cols(); ++i)
      CHECK((seen.force().col(i) - sheet().network.mass[i] * seen.acceleration()).norm() < 1e-15);
    seen.reset();
    CHECK(seen.acceleration().norm() == 0);
    CHECK(seen.force().norm() == 0);
  }
}

TEST_CASE("a sheet that does what the model says has no disturbance", "[estimate]") {
  Observer seen = observer();
  ClothState<double> state = clothctl_test::shaken(sheet().state, 3, 0.001, 0.2);
  ClothInput<double> input = hold(true);
  for (int k = 0; k < 10; ++k) {
    input.driven_positions.row(1).array() += 0.004;
    const ClothState<double> next = stepped(state, input, V::Zero());
    REQUIRE(seen.observe(state, input, 0.02, next.velocities));
    state = next;
  }
  CHECK(seen.acceleration().norm() < 1e-9);
}

TEST_CASE("a disturbance is at most as large as allowed", "[estimate]") {
  DisturbanceSettings<double> settings;
  settings.gain = 1;
  settings.largest = 0.5;
  Observer seen = observer(settings);
  const ClothInput<double> input = hold(false);
  const auto next = stepped(sheet().state, input, V(3, 0, 0));
  REQUIRE(seen.observe(sheet().state, input, 0.02, next.velocities));
  CHECK(seen.acceleration().norm() == Approx(0.5));
}

TEST_CASE("what cannot be a step is refused, and nothing changes", "[estimate]") {
  Observer seen = observer();
  const ClothInput<double> good = hold(false);
  const ClothState<double>& state = sheet().state;
  const Points<double> after = stepped(state, good, V(1, 0, 0)).velocities;
  REQUIRE(seen.observe(state, good, 0.02, after));
  const V before = seen.acceleration();
  const auto refused = [&](const ClothState<double>& from, const ClothInput<double>& input,
                           double dt, const Points<double>& v, const std::string& word) {
    CHECK_FALSE(seen.observe(from, input, dt, v));
    CHECK(seen.check_input(from, input, dt, v).find(word) != std::string::npos);
    CHECK(seen.acceleration() == before);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Points<double> broken = after;
  broken(1, 7) = nan;
  refused(state, good, 0.02, broken, "after the step is not finite");
  refused(state, good, 0.02, Points<double>::Zero(3, 5), "5 velocities");
  refused(state, good, 0.0, after, "step");
  ClothInput<double> off = good;
  off.force_vertices[1] = 36;
  refused(state, off, 0.02, after, "36");
  ClothState<double> lost = state;
  lost.positions(0, 3) = nan;
  refused(lost, good, 0.02, after, "nan");
  // If all vertices are driven, nothing tells a disturbance.
  ClothInput<double> all;
  for (int i = 0; i < 36; ++i) all.driven_vertices.push_back(i);
  all.driven_positions = state.positions;
  CHECK_FALSE(seen.observe(state, all, 0.02, after));
  CHECK(seen.acceleration() == before);
  const auto error = [&](const VectorX<double>& mass, double gain, double largest) {
    DisturbanceSettings<double> settings;
    settings.gain = gain, settings.largest = largest;
    const auto made =
        Observer::create(sheet().model(Integration::LinearlyImplicit), mass, settings);
    return made.has_value() ? std::string() : made.error();
  };
  VectorX<double> mass = sheet().network.mass;
  CHECK(error(mass, 0, 1).find("gain is 0") == 0);
  CHECK(error(mass, 1.5, 1).find("gain is 1.5") == 0);
  CHECK(error(mass, 0.5, nan).find("largest is nan") == 0);
  CHECK(error(VectorX<double>(mass.head(4)), 0.5, 1) == "there are 4 masses for 36 vertices");
  mass[2] = 0;
  CHECK(error(mass, 0.5, 1).find("the mass of vertex 2 is 0") == 0);
}

TEST_CASE("observing does not allocate", "[estimate]") {
  Observer seen = observer();
  const ClothInput<double> input = hold(false);
  const ClothState<double> next = stepped(sheet().state, input, V(1, 0, 0));
  REQUIRE(seen.observe(sheet().state, input, 0.02, next.velocities));
  const long before = clothctl_test::allocations();
  const bool took = seen.observe(sheet().state, input, 0.02, next.velocities);
  const long made = clothctl_test::allocations() - before;
  CHECK(took);
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
}
