// The quasi-Newton step of rollouts, compared with the converged step of MassSpring.

#include "clothctl/cloth/mass_spring_rollout.hpp"

#include <limits>

#include "laws/cloth_laws.hpp"
#include "laws/cloth_rollout_laws.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"
#include "support/square_sheets.hpp"

using namespace clothctl;
using clothctl_test::HangingSheet;

static_assert(ClothRollout<MassSpringRollout<double, float>> &&
              ClothRollout<MassSpringRollout<double, double>> &&
              ClothRollout<MassSpringRollout<float, float>, float>);

namespace {

ClothInput<double> driven_corners(const HangingSheet& sheet, const Vector3<double>& way) {
  ClothInput<double> input;
  input.driven_vertices = {sheet.upper_left(), sheet.upper_right()};
  input.driven_positions.resize(3, 2);
  for (Index j = 0; j < 2; ++j) {
    input.driven_positions.col(j) =
        sheet.state.positions.col(input.driven_vertices[static_cast<std::size_t>(j)]) +
        (j == 0 ? 1.0 : 0.5) * way;
  }
  input.wind = Vector3<double>(0.3, 1.0, 0);
  return input;
}

}  // namespace

TEST_CASE("many quasi-Newton steps end where the converged step ends", "[cloth]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(9, 1, 60);
  const MassSpring<double> model = sheet.model(Integration::Newton, true);
  for (const bool bending : {false, true}) {
    CAPTURE(bending);
    RolloutModelSettings settings;
    settings.bending_in_matrix = bending;
    const MassSpringRollout<double, double> rollout(model, settings);
    auto workspace = rollout.make_workspace();
    auto exact_workspace = model.make_workspace();
    ClothState<double> exact = sheet.state, state = exact;
    const Points<double> guess = state.velocities;
    ClothInput<double> input = driven_corners(sheet, {0.004, 0.003, 0.002});
    input.force_vertices = {20};
    input.forces = Vector3<double>(0.01, 0, 0.02);
    REQUIRE(model.step(exact, input, 0.02, exact_workspace).advanced);
    const StepReport<double> report =
        rollout.step_from(guess, 300, state, input, 0.02, workspace, 1e-9);
    CHECK(report.status == StepStatus::Converged);
    CHECK((state.velocities - exact.velocities).cwiseAbs().maxCoeff() < 1e-4);
    CHECK((state.positions - exact.positions).cwiseAbs().maxCoeff() < 2e-6);
  }
}

TEST_CASE("springs that are linearised give the linearly implicit step", "[cloth]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(9, 1, 60);
  const MassSpring<double> model = sheet.model(Integration::LinearlyImplicit, true);
  for (const bool bending : {false, true}) {
    CAPTURE(bending);
    RolloutModelSettings settings;
    settings.integration = Integration::LinearlyImplicit;
    settings.bending_in_matrix = bending;
    const MassSpringRollout<double, double> rollout(model, settings);
    auto workspace = rollout.make_workspace();
    auto exact_workspace = model.make_workspace();
    ClothState<double> exact = sheet.state, state = exact;
    Points<double> forces(3, 2), exact_forces(3, 2);
    for (int k = 0; k < 5; ++k) {
      CAPTURE(k);
      ClothInput<double> input = driven_corners(sheet, (k + 1) * Vector3<double>(0.02, 0.01, 0.03));
      input.force_vertices = {20};
      input.forces = Vector3<double>(0.01, 0, 0.02);
      REQUIRE(model.step(exact, input, 0.02, exact_workspace).advanced);
      REQUIRE(model.holding_forces(input.driven_vertices, exact_workspace, exact_forces));
      const Points<double> guess =
          state.velocities + clothctl_test::noise<double>(static_cast<unsigned>(k), 81, 0.1);
      // What bends is in the matrix, so one solve is enough, from any guess.
      const int solves = bending ? 1 : 300;
      REQUIRE(rollout.step_from(guess, solves, state, input, 0.02, workspace, 1e-11).advanced);
      CHECK((state.velocities - exact.velocities).cwiseAbs().maxCoeff() < 1e-8);
      CHECK((state.positions - exact.positions).cwiseAbs().maxCoeff() < 1e-10);
      REQUIRE(rollout.holding_forces(input.driven_vertices, workspace, forces));
      CHECK((forces - exact_forces).cwiseAbs().maxCoeff() < 1e-7);
    }
  }
}

TEST_CASE("a support is a spring along its normal until its vertex leaves", "[cloth]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(9, 1, 60);
  const MassSpring<double> model = sheet.model(Integration::Newton);
  MassSpringRollout<double, double> rollout(model);
  auto workspace = rollout.make_workspace();
  auto exact_workspace = model.make_workspace();
  const int vertex = sheet.lower_left();
  const VertexSupport<double> support{vertex, Vector3<double>(0, 0, 1),
                                      Vector3<double>(0.001, 0, 0.01), 0.002};
  ClothState<double> exact = sheet.state, state = exact;
  rollout.set_supports(std::span(&support, 1), state.positions);
  const Vector3<double> place = state.positions.col(vertex);
  double highest = 0;
  for (int k = 0; k < 12; ++k) {  // the corner is lifted and leaves
    ClothInput<double> input = driven_corners(sheet, (k + 1) * Vector3<double>(0, 0, 0.0004));
    input.wind.setZero();
    input.force_vertices = {vertex};
    input.forces = support.force;
    const Points<double> guess = state.velocities;
    REQUIRE(rollout.step_from(guess, 300, state, input, 0.02, workspace, 1e-10).advanced);
    // The same with the force that the support had at the end of the step.
    const double lift = state.positions(2, vertex) - place.z();
    if (lift < support.release) {
      input.forces.col(0) -= 0.01 / support.release * lift * Vector3<double>(0, 0, 1);
    } else {
      input.forces.setZero();
    }
    REQUIRE(model.step(exact, input, 0.02, exact_workspace).advanced);
    CHECK((state.positions - exact.positions).cwiseAbs().maxCoeff() < 1e-5);
    highest = std::max(highest, lift);
    exact = state;
  }
  CHECK(highest > 1.5 * support.release);
  // A copy has room for as many supports.
  MassSpringRollout<double, double> copy(rollout);
  const std::vector<VertexSupport<double>> many(81, support);
  const long before = clothctl_test::allocations();
  copy.set_supports(std::span(many), state.positions);
  const long taken = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
  // Without supports, as if there had been none.
  MassSpringRollout<double, double> plain(model);
  auto plain_workspace = plain.make_workspace();
  rollout.set_supports({}, state.positions);
  ClothState<double> a = sheet.state, b = sheet.state;
  const ClothInput<double> input = driven_corners(sheet, {0.001, 0, 0});
  REQUIRE(rollout.step(a, input, 0.02, workspace).advanced);
  REQUIRE(plain.step(b, input, 0.02, plain_workspace).advanced);
  CHECK(a == b);
}

TEST_CASE("single precision costs micrometres", "[cloth]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(17, 1, 60);
  const MassSpring<double> model = sheet.model(Integration::Newton);
  const MassSpringRollout<double, float> fast(model);
  const MassSpringRollout<double, double> exact(model);
  auto fast_workspace = fast.make_workspace();
  auto exact_workspace = exact.make_workspace();
  ClothState<double> a = sheet.state, b = sheet.state;
  a.positions.colwise() += Vector3<double>(100, -50, 20);  // far from the origin
  b.positions = a.positions;
  ClothInput<double> input = driven_corners(sheet, {0.002, 0.001, 0.003});
  input.driven_positions.colwise() += Vector3<double>(100, -50, 20);
  REQUIRE(fast.step(a, input, 0.02, fast_workspace).advanced);
  REQUIRE(exact.step(b, input, 0.02, exact_workspace).advanced);
  CHECK((a.positions - b.positions).cwiseAbs().maxCoeff() < 2e-6);
}

TEST_CASE("the model of rollouts obeys the laws of models that can be rolled out", "[cloth]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 40);
  const MassSpringRollout<double, double> model(sheet.model(Integration::Newton, true));
  clothctl_test::ClothRolloutLaws<double> laws;
  laws.newton_steps = 200;
  laws.tolerance = 3e-3;  // `step` ends at changes of 1 mm/s
  clothctl_test::check_cloth_rollout_laws(model, sheet.state,
                                          {sheet.upper_left(), sheet.upper_right()}, laws);
}

TEST_CASE("steps of many quasi-Newton steps obey the laws of cloth models", "[cloth]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 0);
  RolloutModelSettings settings;
  settings.first_steps = 200;
  const MassSpring<double> source = sheet.model(Integration::Newton);
  clothctl_test::ClothLaws<double> laws;
  laws.mass = sheet.network.mass;
  laws.drag = sheet.material.drag;
  laws.tolerance = 2e-3;  // `step` ends at changes of 1 mm/s
  clothctl_test::check_cloth_laws(MassSpringRollout<double, double>(source, settings), laws);
}

TEST_CASE("the content of a workspace does not matter", "[cloth]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(6, 1, 40);
  const MassSpringRollout<double> model(sheet.model(Integration::Newton, true));
  CoarseFactors soft;
  soft.stretch = 0.5;
  soft.bending = 3;
  const MassSpringRollout<double> other(sheet.model(Integration::Newton, true), {soft});
  const ClothInput<double> input = driven_corners(sheet, {0.004, 0.003, 0.002});
  auto fresh = model.make_workspace(), used = model.make_workspace();
  ClothState<double> a = sheet.state, b = sheet.state, c = sheet.state;
  REQUIRE(other.step(c, input, 0.01, used).advanced);  // the same structure, other numbers
  REQUIRE(model.step(a, input, 0.02, fresh).advanced);
  REQUIRE(model.step(b, input, 0.02, used).advanced);
  CHECK(a == b);
  CHECK(!(a == c));
}

TEST_CASE("a step that would stretch the sheet far is cut", "[cloth]") {
  // A push along the normal of a flat sheet meets no stiffness: a whole step would move the light
  // corner by four metres, to where its springs are many times too long.
  const HangingSheet sheet = clothctl_test::hanging_sheet(9, 1, 0);
  const MassSpringRollout<double, double> model(sheet.model(Integration::Newton));
  auto workspace = model.make_workspace();
  const ClothState<double> flat = model.rest_state();
  ClothInput<double> input;
  input.driven_vertices = {sheet.upper_left(), sheet.upper_right()};
  input.driven_positions.resize(3, 2);
  for (Index j = 0; j < 2; ++j)
    input.driven_positions.col(j) =
        flat.positions.col(input.driven_vertices[static_cast<std::size_t>(j)]);
  input.force_vertices = {sheet.lower_left()};
  input.forces = Vector3<double>(0, 2, 0);
  const auto moved = [&](int steps) {
    ClothState<double> state = flat;
    REQUIRE(model.step_from(flat.velocities, steps, state, input, 0.02, workspace, 0.0).advanced);
    return (state.positions - flat.positions).colwise().norm().maxCoeff();
  };
  const double end = moved(200);
  CHECK(moved(1) < 2 * end);
  CHECK(moved(2) < 2 * end);
}

TEST_CASE("factors of coarse sheets change what they name", "[cloth]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(7, 1, 40);
  const MassSpring<double> model = sheet.model(Integration::Newton);
  const ClothInput<double> input = driven_corners(sheet, {0.004, -0.003, 0.002});
  const auto end = [&](const CoarseFactors& factors) {
    const MassSpringRollout<double, double> rollout(model, {factors});
    auto workspace = rollout.make_workspace();
    ClothState<double> state = clothctl_test::shaken(sheet.state, 3);
    REQUIRE(rollout.step(state, input, 0.02, workspace).advanced);
    return state;
  };
  const ClothState<double> plain = end({});
  for (double CoarseFactors::*factor :
       {&CoarseFactors::stretch, &CoarseFactors::shear, &CoarseFactors::compressed_stretch,
        &CoarseFactors::compressed_shear, &CoarseFactors::bending, &CoarseFactors::drag}) {
    CoarseFactors factors;
    factors.*factor = 0.5;
    CHECK((end(factors).positions - plain.positions).cwiseAbs().maxCoeff() > 1e-7);
  }
  CHECK(CoarseFactors::fitted().validate().empty());
  CoarseFactors bad;
  bad.shear = -1;
  CHECK(bad.validate() == "shear is -1, must be finite and not negative");
  bad.shear = std::numeric_limits<double>::quiet_NaN();
  CHECK(bad.validate() == "shear is nan, must be finite and not negative");
  CHECK(RolloutModelSettings{{}, false, 0}.validate() == "first_steps is 0, must be at least 1");
}

TEST_CASE("a refused step of a rollout changes nothing", "[cloth]") {
  const HangingSheet sheet = clothctl_test::hanging_sheet(5, 1, 20);
  const MassSpringRollout<double> model(sheet.model(Integration::Newton));
  auto workspace = model.make_workspace();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const ClothInput<double> good = driven_corners(sheet, {0, 0, 0});
  ClothState<double> state = sheet.state;
  Points<double> forces = Points<double>::Zero(3, 2);
  CHECK_FALSE(model.holding_forces(good.driven_vertices, workspace, forces));  // no step yet

  Points<double> guess = state.velocities;
  guess(0, 3) = nan;
  CHECK(model.step_from(guess, 1, state, good, 0.02, workspace, 0.0).status ==
        StepStatus::InvalidInput);
  guess.setZero(3, 2);
  CHECK(model.step_from(guess, 1, state, good, 0.02, workspace, 0.0).status ==
        StepStatus::InvalidInput);
  CHECK(model.step(state, good, nan, workspace).status == StepStatus::InvalidInput);
  ClothInput<double> attached = good;
  attached.attached_vertices = {2};
  attached.attached_positions = Vector3<double>::Zero();
  attached.attachment_stiffness = VectorX<double>::Ones(1);
  CHECK(model.step(state, attached, 0.02, workspace).status == StepStatus::InvalidInput);
  auto foreign =
      MassSpringRollout<double>(clothctl_test::hanging_sheet(6, 1, 20).model(Integration::Newton))
          .make_workspace();
  CHECK(model.step(state, good, 0.02, foreign).status == StepStatus::InvalidWorkspace);
  ClothInput<double> violent = good;  // overflows in single precision
  violent.driven_positions.setConstant(1e300);
  CHECK(model.step(state, violent, 0.02, workspace).status == StepStatus::NumericalFailure);
  CHECK_FALSE(model.holding_forces(good.driven_vertices, workspace, forces));
  CHECK(state == sheet.state);

  REQUIRE(model.step(state, good, 0.02, workspace).advanced);
  CHECK(model.holding_forces(good.driven_vertices, workspace, forces));
  const std::vector<int> off{0, 25};
  CHECK_FALSE(model.holding_forces(off, workspace, forces));
  CHECK_FALSE(model.holding_forces(good.driven_vertices, foreign, forces));
}
