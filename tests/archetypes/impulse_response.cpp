// The archetype satisfies its concept, has nothing else, obeys the laws, and the solver takes it.

#include "archetypes/impulse_response.hpp"

#include <string>
#include <type_traits>
#include <vector>

#include "clothctl/contact/contact_solver.hpp"
#include "laws/impulse_response_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ImpulseResponseArchetype;

static_assert(ImpulseResponse<ImpulseResponseArchetype<float>, float> &&
              ImpulseResponse<ImpulseResponseArchetype<double>, double>);
static_assert(!ImpulseResponse<ImpulseResponseArchetype<float>, double>);
static_assert(!std::is_default_constructible_v<ImpulseResponseArchetype<double>> &&
              !std::is_copy_constructible_v<ImpulseResponseArchetype<double>>);
static_assert(!ImpulseResponse<int> && !ImpulseResponse<void*> && !ImpulseResponse<std::string> &&
              !ImpulseResponse<void>);

TEMPLATE_TEST_CASE("the archetype of an impulse response obeys the laws", "[archetypes]", float,
                   double) {
  ImpulseResponseArchetype<TestType> bead(1);
  clothctl_test::check_impulse_response_laws<TestType>(
      bead, TestType(8) * scalar_traits<TestType>::epsilon());
}

TEMPLATE_TEST_CASE("the contact solver takes the archetype", "[archetypes]", float, double) {
  using S = TestType;
  ImpulseResponseArchetype<S> bead(1);
  std::vector<ContactSample<S>> contacts(1);
  contacts[0].a.side = 0;
  contacts[0].a.point[0] = 0;
  contacts[0].normal = Vector3<S>(S(0), S(1), S(0));
  ContactSolver<S> solver;
  solver.reserve(1, 1);
  const ContactReport<S> report = solver.solve(contacts, S(0.01), bead);
  REQUIRE(report.status == ContactStatus::Solved);
  REQUIRE(solver.apply(contacts, bead) == ContactStatus::Solved);
  VectorX<S> u(3);
  bead.velocities(u);
  CHECK(u == Vector3<S>(S(1), S(0), S(0.5)));
}
