// The foreign types of examples/bring_your_own obey the laws of their concepts.

#include "../../examples/bring_your_own/cloth_plant.hpp"
#include "../../examples/bring_your_own/contact_model.hpp"
#include "../../examples/bring_your_own/qp_solver.hpp"
#include "../../examples/bring_your_own/robot.hpp"
#include "../../examples/bring_your_own/rollout_model.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "laws/articulated_laws.hpp"
#include "laws/cloth_rollout_laws.hpp"
#include "laws/contact_laws.hpp"
#include "laws/plant_laws.hpp"
#include "laws/qp_solver_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;

static_assert(ContactModel<gripper::RibbedPad> && ClothRollout<lab::Cloth>);
static_assert(QpSolver<splitting::Admm> && ArticulatedModel<workshop::Arm>);
static_assert(ClothPlant<game::Cloth>);

TEST_CASE("the contact model of examples/bring_your_own obeys the laws of contacts", "[concepts]") {
  clothctl_test::check_contact_laws<double>(gripper::RibbedPad{}, 1e-12);
  gripper::RibbedPad slanted;
  slanted.ribs = {0.3, -0.2, 2.0};
  clothctl_test::check_contact_laws<double>(slanted, 1e-12);
}

TEST_CASE("the plant of examples/bring_your_own obeys the laws of plants", "[concepts]") {
  const GridMesh<double> grid = make_grid<double>(4, 4, 0.3, 0.3).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  clothctl_test::check_plant_laws<double>(
      [&] { return game::make_cloth(network, network.rest_positions); }, 0.01);
}

TEST_CASE("the cloth of examples/bring_your_own obeys the laws of rollouts", "[concepts]") {
  const GridMesh<double> grid = make_grid<double>(5, 5, 0.4, 0.4).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  const Points<double>& x = network.rest_positions;
  const lab::Cloth cloth{network.springs, lab::Numbers(x.data(), x.data() + x.size()),
                         lab::Numbers(network.mass.begin(), network.mass.end()), 0.5};
  ClothState<double> state = cloth_traits<lab::Cloth>::rest_state(cloth);
  for (Index i = 0; i < state.positions.cols(); ++i) {
    state.positions(1, i) = 0.01 * std::sin(3.0 * static_cast<double>(i));
    state.velocities(2, i) = 0.1 * std::cos(2.0 * static_cast<double>(i));
  }
  clothctl_test::ClothRolloutLaws<double> laws;
  laws.tolerance = 1e-7;
  clothctl_test::check_cloth_rollout_laws(cloth, state, {20, 24}, laws);
}

TEST_CASE("results that the solver of examples/bring_your_own calls solved are solutions",
          "[concepts]") {
  std::mt19937 random(7);
  for (int trial = 0; trial < 5; ++trial) {
    const clothctl_test::KnownQp<double> q = clothctl_test::draw_qp<double>({.n = 8}, random);
    clothctl_test::QpSession<double, splitting::Admm> session;
    session.solver.most_iterations = 20000;
    REQUIRE(session.set(q) == QpStatus::Solved);
    CHECK(clothctl_test::qp_law_solved(session, q, 1e-4) == "");
  }
}

TEST_CASE("the robot of examples/bring_your_own obeys the laws of robots", "[concepts]") {
  VectorX<double> q(3), other(3), qd(3);
  q << 0.4, -1.1, 0.3;
  other << -2.0, 0.7, 1.0;
  qd << 0.5, -0.8, 0.2;
  clothctl_test::check_articulated_laws(workshop::Arm(), q, other, qd, 3, 1e-12);
}
