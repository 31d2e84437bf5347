// How sheets in a world answer to the impulses of pads.

#include "clothctl/sim/detail/sheet_side.hpp"

#include <vector>

#include "clothctl/cloth/position_based.hpp"
#include "support/catch.hpp"
#include "support/pads.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("a position-based sheet answers with the masses of its vertices", "[sim]") {
  const SpringNetwork<double> network = hanging_sheet(4).network();
  const auto model = PositionBased<double>::create(network).value();
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  const ClothState<double> before = state;
  detail::SheetSide<PositionBased<double>, double> side;
  REQUIRE(side.create(model, 3).empty());
  const std::vector<int> touched{5, 2};
  const VectorX<double> masses = network.mass.cwiseInverse();
  REQUIRE(side.attach(touched, state, ws, masses) == StepStatus::Converged);
  CHECK(side.point(2) == 1);
  CHECK(side.point(3) == -1);
  REQUIRE(side.neighbours() != nullptr);  // pads hold patches of it
  CHECK(side.neighbours()->of(5).size() > 1);
  VectorX<double> p(6);
  p << 0, 0, 1e-3, 2e-3, 0, 0;
  side.side().apply(p);
  side.take(0.01, false, ws);
  const Vector3<double> gained = state.velocities * network.mass;
  CHECK((gained - Vector3<double>(2e-3, 0, 1e-3)).norm() < 1e-15);
  CHECK((state.positions - before.positions - 0.01 * state.velocities).norm() < 1e-12);
  CHECK(state.velocities.col(3).isZero());
}

TEST_CASE("a mass-spring sheet answers as its step would with the force", "[sim]") {
  const MassSpring<double> model = hanging_sheet(5);
  auto ws = model.make_workspace();
  ClothState<double> pushed = model.rest_state(), forced = pushed;
  ClothInput<double> none, force;
  none.clear();
  force.clear();
  REQUIRE(model.step(pushed, none, 0.01, ws).advanced);
  detail::SheetSide<MassSpring<double>, double> side;
  REQUIRE(side.create(model, 1).empty());
  CHECK(side.neighbours() == nullptr);
  const VectorX<double> masses = model.network().mass.cwiseInverse();
  const std::vector<int> touched{7};
  REQUIRE(side.attach(touched, pushed, ws, masses) == StepStatus::Converged);
  side.side().apply(Vector3<double>(0, 1e-8, 2e-8));
  side.take(0.01, false, ws);
  force.force_vertices = {7};
  force.forces = Vector3<double>(0, 1e-6, 2e-6);
  REQUIRE(model.step(forced, force, 0.01, ws).advanced);
  CHECK((pushed.positions - forced.positions).norm() < 1e-14);
}
