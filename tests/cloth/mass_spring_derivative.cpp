#include "clothctl/cloth/mass_spring_derivative.hpp"

#include <limits>

#include "clothctl/network/rope.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"
#include "support/square_sheets.hpp"

using namespace clothctl;
using clothctl_test::noise;

namespace {

using Derivative = MassSpringDerivative<double>;
using Row = Derivative::Row;
constexpr double kStep = 0.02;  // s

MassSpringSettings<double> exact_settings() {
  MassSpringSettings<double> settings;
  settings.integration = Integration::Newton;
  settings.drag = 0.7;
  settings.limit_energy = false;
  settings.velocity_tolerance = 1e-12;  // differences of steps must not see where Newton ended
  return settings;
}

// A sheet in motion, between tension and compression, with corners that are moved.
struct MovingSheet {
  SpringNetwork<double> network = clothctl_test::square_sheet<double>(6);
  MassSpring<double> model = MassSpring<double>::create(network, exact_settings()).value();
  std::vector<int> driven{30, 35};
  MassSpring<double>::Workspace ws = model.make_workspace();
  ClothState<double> start{network.rest_positions + noise<double>(1, 36, 0.003),
                           noise<double>(2, 36, 0.2)};
  Points<double> moved = noise<double>(3, 2, 0.004);

  // The step from `state`, with the corners moved to `moved + dp` from where the sheet started.
  ClothState<double> step(ClothState<double> state, const Points<double>& dp) {
    ClothInput<double> input;
    input.driven_vertices = driven;
    input.driven_positions = moved + dp;
    for (Index j = 0; j < 2; ++j)
      input.driven_positions.col(j) += start.positions.col(driven[static_cast<std::size_t>(j)]);
    REQUIRE(model.step(state, input, kStep, ws).advanced);
    return state;
  }
};

Row row(const Points<double>& points) {
  return Eigen::Map<const Row>(points.data(), 1, points.size());
}

}  // namespace

TEST_CASE("the derivative of a step is the limit of differences of steps", "[cloth]") {
  MovingSheet sheet;
  const Points<double> none = Points<double>::Zero(3, 2);
  const ClothState<double> after = sheet.step(sheet.start, none);
  Derivative derivative = Derivative::create(sheet.model, sheet.driven).value();
  Derivative::Step step;
  Derivative::Memory<1> memory = derivative.make_memory();
  REQUIRE(derivative.linearise(sheet.start, after, kStep, step, memory));
  REQUIRE(step.compression == 1.0);
  for (unsigned seed = 0; seed < 6; ++seed) {
    // Positions, velocities and driven positions change alone, then together.
    const Points<double> dx = noise<double>(10 + seed, 36, seed == 1 || seed == 2 ? 0.0 : 1.0);
    const Points<double> dv = noise<double>(20 + seed, 36, seed == 0 || seed == 2 ? 0.0 : 20.0);
    const Points<double> dp = noise<double>(30 + seed, 2, seed < 2 ? 0.0 : 1.0);
    const double e = 1e-7;
    ClothState<double> ahead = sheet.start, behind = sheet.start;
    ahead.positions += e * dx;
    ahead.velocities += e * dv;
    behind.positions -= e * dx;
    behind.velocities -= e * dv;
    ahead = sheet.step(ahead, e * dp);
    behind = sheet.step(behind, -e * dp);
    Row x = row(dx), v = row(dv);
    derivative.push(step, memory, row(dp), x, v);
    const Points<double> expected_x = (ahead.positions - behind.positions) / (2 * e);
    const Points<double> expected_v = (ahead.velocities - behind.velocities) / (2 * e);
    CHECK((x - row(expected_x)).norm() < 1e-6 * row(expected_x).norm());
    CHECK((v - row(expected_v)).norm() < 1e-6 * row(expected_v).norm());
  }
}

TEST_CASE("pull is the transpose of push", "[cloth]") {
  MovingSheet sheet;
  const ClothState<double> after = sheet.step(sheet.start, Points<double>::Zero(3, 2));
  Derivative derivative = Derivative::create(sheet.model, sheet.driven).value();
  Derivative::Step step;
  Derivative::Memory<1> memory = derivative.make_memory();
  REQUIRE(derivative.linearise(sheet.start, after, kStep, step, memory));
  for (unsigned seed = 0; seed < 5; ++seed) {
    if (seed == 4) {  // also where it is not exact
      REQUIRE(derivative.linearise(sheet.start, after, kStep, step, memory, 0.5));
      REQUIRE(step.compression == 0.5);
    }
    const Row dx = row(noise<double>(seed, 36, 1.0)), dv = row(noise<double>(40 + seed, 36, 1.0));
    const Row dp = row(noise<double>(60 + seed, 2, 1.0));
    const Row wx = row(noise<double>(80 + seed, 36, 1.0)), wv = row(noise<double>(seed, 36, 1.0));
    Row x = dx, v = dv, gx = wx, gv = wv;
    Row gp(1, 6);
    const long before = clothctl_test::allocations();
    derivative.push(step, memory, dp, x, v);
    derivative.pull(step, memory, gx, gv, gp);
    CHECK((clothctl_test::allocations() == before || !clothctl_test::allocation_counting_works()));
    const double pushed = wx.dot(x) + wv.dot(v);
    const double pulled = gx.dot(dx) + gv.dot(dv) + gp.dot(dp);
    CHECK(pulled == Approx(pushed).epsilon(1e-11));
  }
}

TEST_CASE("changes side by side are pushed and pulled as alone", "[cloth]") {
  MovingSheet sheet;
  const ClothState<double> after = sheet.step(sheet.start, Points<double>::Zero(3, 2));
  const Derivative derivative = Derivative::create(sheet.model, sheet.driven).value();
  Derivative::Step step;
  Derivative::Memory<1> memory = derivative.make_memory();
  Derivative::Memory<16> wide = derivative.make_memory<16>();
  REQUIRE(derivative.linearise(sheet.start, after, kStep, step, wide));
  Lanes<double, 16> x(16, 108), v(16, 108), p(16, 6);
  for (unsigned l = 0; l < 16; ++l) {
    x.row(l) = row(noise<double>(l, 36, 1.0));
    v.row(l) = row(noise<double>(100 + l, 36, 1.0));
    p.row(l) = row(noise<double>(200 + l, 2, 1.0));
  }
  const Lanes<double, 16> x0 = x, v0 = v, p0 = p;
  derivative.push(step, wide, p, x, v);
  Lanes<double, 16> gx = x0, gv = v0, gp = p0;
  derivative.pull(step, wide, gx, gv, gp);
  for (Index l = 0; l < 16; ++l) {
    Row dx = x0.row(l), dv = v0.row(l), dp = p0.row(l);
    derivative.push(step, memory, dp, dx, dv);
    CHECK((x.row(l) - dx).norm() < 1e-12 * dx.norm());
    CHECK((v.row(l) - dv).norm() < 1e-12 * dv.norm());
    dx = x0.row(l), dv = v0.row(l);
    derivative.pull(step, memory, dx, dv, dp);
    CHECK((gx.row(l) - dx).norm() < 1e-12 * dx.norm());
    CHECK((gv.row(l) - dv).norm() < 1e-12 * dv.norm());
    CHECK((gp.row(l) - dp).norm() < 1e-12 * dp.norm());
  }
}

TEST_CASE("one derivative serves many steps", "[cloth]") {
  MovingSheet sheet;
  const Points<double> none = Points<double>::Zero(3, 2);
  const ClothState<double> middle = sheet.step(sheet.start, none);
  const ClothState<double> end = sheet.step(middle, none);
  Derivative derivative = Derivative::create(sheet.model, sheet.driven).value();
  Derivative alone = Derivative::create(sheet.model, sheet.driven).value();
  Derivative::Step first, second, same;
  Derivative::Memory<1> memory = derivative.make_memory(), other = alone.make_memory();
  REQUIRE(derivative.linearise(sheet.start, middle, kStep, first, memory));
  REQUIRE(derivative.linearise(middle, end, kStep, second, memory));
  REQUIRE(alone.linearise(sheet.start, middle, kStep, same, other));
  Row x = row(noise<double>(1, 36, 1.0)), v = row(noise<double>(2, 36, 1.0)), y = x, w = v;
  derivative.push(first, memory, row(none), x, v);
  alone.push(same, other, row(none), y, w);
  CHECK(x == y);
  CHECK(v == w);
}

TEST_CASE("derivatives refuse what has none", "[cloth]") {
  MovingSheet sheet;
  const auto error = [&](const MassSpringSettings<double>& settings, std::vector<int> driven) {
    const auto model = MassSpring<double>::create(sheet.network, settings).value();
    const auto made = Derivative::create(model, std::move(driven));
    return made ? std::string() : made.error();
  };
  MassSpringSettings<double> linear = exact_settings(), windy = linear, pinned = linear;
  linear.integration = Integration::LinearlyImplicit;
  windy.air.normal_coefficient = 1;
  pinned.pinned = {3};
  CHECK(error(linear, {0}).find("not Newton") != std::string::npos);
  CHECK(error(windy, {0}).find("air") != std::string::npos);
  CHECK(error(pinned, {3}) == "held vertex 3 is pinned");
  CHECK(error(exact_settings(), {36}).find("off the mesh") != std::string::npos);
  CHECK(error(exact_settings(), {4, 4}).find("already") != std::string::npos);

  Derivative derivative = Derivative::create(sheet.model, sheet.driven).value();
  Derivative::Step step;
  Derivative::Memory<1> memory = derivative.make_memory();
  ClothState<double> broken = sheet.start;
  broken.velocities(1, 7) = std::numeric_limits<double>::quiet_NaN();
  CHECK(!derivative.linearise(sheet.start, broken, kStep, step, memory));
  CHECK(!derivative.linearise(broken, sheet.start, kStep, step, memory));
  CHECK(!derivative.linearise(sheet.start, sheet.start, 0.0, step, memory));
  CHECK(!derivative.linearise({}, sheet.start, kStep, step, memory));
}
