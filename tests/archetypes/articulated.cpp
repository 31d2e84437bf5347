// The archetype of a robot satisfies its concepts and obeys their laws, and every algorithm on
// robots runs with it.

#include "archetypes/articulated.hpp"

#include <type_traits>

#include "clothctl/qp/active_set.hpp"
#include "clothctl/robot/constrained_ik.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "clothctl/robot/prioritised_ik.hpp"
#include "clothctl/robot/stable_pd.hpp"
#include "laws/articulated_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::GantryArchetype;

static_assert(ArticulatedModel<GantryArchetype<double>>);
static_assert(ArticulatedDynamics<GantryArchetype<double>> &&
              ArticulatedDynamics<GantryArchetype<float>, float>);
static_assert(!std::is_copy_constructible_v<GantryArchetype<double>>);
static_assert(!std::is_copy_constructible_v<GantryArchetype<double>::workspace_type>);

TEMPLATE_TEST_CASE("the archetype of a robot obeys the laws", "[archetypes]", float, double) {
  using S = TestType;
  const GantryArchetype<S> gantry;
  VectorX<S> q(3), other(3), qd(3), qdd(3);
  q << S(0.25), S(-1), S(0.5);
  other << S(-0.75), S(1.5), S(0.125);
  qd << S(1), S(-0.5), S(0.25);
  qdd << S(3), S(2), S(-4);
  const S tolerance = std::is_same_v<S, float> ? S(1e-5) : S(1e-13);
  clothctl_test::check_articulated_laws(gantry, q, other, qd, 2, tolerance);
  clothctl_test::check_articulated_dynamics_laws(gantry, q, qd, qdd, tolerance);
}

TEST_CASE("inverse kinematics of every form and stable PD run on the archetype", "[archetypes]") {
  using Gantry = GantryArchetype<double>;
  const Gantry gantry;
  const std::vector<IkTask<double>> tasks = {
      IkTask<double>::position(1, Vector3<double>::Zero(), Vector3<double>(0.5, -1.0, 0.25)),
      IkTask<double>::position(0, Vector3<double>::Zero(), Vector3<double>(0.5, 1.0, 0.75))};
  const std::span<const IkTask<double>> all(tasks);
  const VectorX<double> none;
  VectorX<double> q = VectorX<double>::Zero(3);
  InverseKinematics<Gantry> ik(gantry, 2);
  CHECK(ik.solve(gantry, all.first(1), none, q).status == IkStatus::Reached);
  CHECK((q - Vector3<double>(0.5, -1.0, 0.75)).norm() < 1e-4);
  q.setZero();
  CHECK(ik.solve(gantry, all, none, q).status ==
        IkStatus::LocalMinimum);  // the tasks want y = -1 and y = 1
  CHECK(q[1] == Approx(0.0).margin(1e-4));

  PrioritisedIk<Gantry> ranked(gantry, 2, 2);
  const int levels[] = {1, 1};
  q.setZero();
  CHECK(ranked.solve(gantry, all, levels, none, q).status == IkStatus::Stalled);
  CHECK((q - Vector3<double>(0.5, -1.0, 0.75)).norm() < 1e-4);
  CHECK(ranked.level_error(0) < 1e-4);
  CHECK(ranked.level_error(1) == Approx(2.0).epsilon(1e-3));

  ConstrainedIk<Gantry, ActiveSet<double>> walled(gantry, 1, 1);
  HalfSpace<double> floor;
  floor.frame = 1;
  floor.offset = 0.4;
  q.setConstant(0.9);
  CHECK(walled.solve(gantry, all.first(1), std::span(&floor, 1), none, q).status ==
        IkStatus::LocalMinimum);
  CHECK((q - Vector3<double>(0.5, -1.0, 0.9)).norm() < 1e-4);

  auto pd = StablePd<Gantry>::create(gantry, StablePdSettings<double>::uniform(3)).value();
  auto work = gantry.make_workspace();
  VectorX<double> at = VectorX<double>::Zero(3), qd = at, torques = at, qdd = at;
  for (int k = 0; k < 500; ++k) {
    REQUIRE(pd.solve(gantry, at, qd, q, none, none, work, torques, qdd).status == PdStatus::Solved);
    for (Index i = 0; i < 3; ++i) CHECK(std::abs(torques[i]) <= gantry.effort_limits()[i]);
    qd += 0.02 * qdd;
    at += 0.02 * qd;
  }
  CHECK((at - q).norm() < 1e-6);
  CHECK(torques[2] == Approx(2 * 9.81));
}
