// The archetype satisfies its concept, has nothing else, and every algorithm that takes a feature
// map runs with it.

#include "archetypes/feature_map.hpp"

#include <type_traits>

#include "laws/feature_laws.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::FeatureMapArchetype;

static_assert(FeatureMap<FeatureMapArchetype<float>, float> &&
              FeatureMap<FeatureMapArchetype<double>, double>);
static_assert(!std::is_copy_constructible_v<FeatureMapArchetype<double>> &&
              !std::is_default_constructible_v<FeatureMapArchetype<double>>);
static_assert(!FeatureMap<int> && !FeatureMap<void (*)()>);

TEMPLATE_TEST_CASE("the archetype of a feature map is validated and evaluated", "[archetypes]",
                   float, double) {
  const FeatureMapArchetype<TestType> map(3);
  clothctl_test::check_feature_laws<TestType>(map, 4);
  CHECK(validate_features<TestType>(map, 3).find("feature 2 uses vertex 3") != std::string::npos);
}
