// The archetype satisfies its concept, has nothing else, and obeys the laws.

#include "archetypes/collider.hpp"

#include <string>
#include <type_traits>

#include "laws/collider_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ColliderArchetype;

static_assert(Collider<ColliderArchetype<float>, float> &&
              Collider<ColliderArchetype<double>, double>);
static_assert(!Collider<ColliderArchetype<float>, double>);
static_assert(!std::is_default_constructible_v<ColliderArchetype<double>> &&
              !std::is_copy_constructible_v<ColliderArchetype<double>>);
static_assert(!Collider<int> && !Collider<void*> && !Collider<std::string> && !Collider<void>);

TEMPLATE_TEST_CASE("the archetype of a collider obeys the laws", "[archetypes]", float, double) {
  clothctl_test::check_collider_laws<TestType>(ColliderArchetype<TestType>(1),
                                               clothctl_test::exact_laws<TestType>(TestType(1)));
}
