// The archetypes satisfy their concepts and have nothing else. The algorithms that take a plant or
// a model compile and run with them.

#include "archetypes/cloth.hpp"

#include <type_traits>

#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/core/result.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::ModelArchetype;
using clothctl_test::PlantArchetype;

static_assert(ClothPlant<PlantArchetype<float>, float> &&
              ClothPlant<PlantArchetype<double>, double>);
static_assert(ClothModel<ModelArchetype<float>, float> &&
              ClothModel<ModelArchetype<double>, double>);
static_assert(!ClothModel<PlantArchetype<double>> && !ClothPlant<ModelArchetype<double>>);
static_assert(!std::is_copy_constructible_v<PlantArchetype<double>> &&
              !std::is_copy_constructible_v<ModelArchetype<double>>);
static_assert(!std::is_default_constructible_v<ModelArchetype<double>>);
static_assert(!std::is_copy_constructible_v<ModelArchetype<double>::Scratch>);

TEMPLATE_TEST_CASE("ModelPlant accepts the archetype of a model", "[archetypes]", float, double) {
  using Plant = ModelPlant<ModelArchetype<TestType>, TestType>;
  static_assert(ClothPlant<Plant, TestType>);
  Plant plant(ModelArchetype<TestType>(3));
  CHECK(plant.vertex_count() == 3);
  plant.apply(ClothInput<TestType>{});
  const StepReport<TestType> report = plant.advance(TestType(0.01));
  CHECK_FALSE(report.advanced);
  CHECK(plant.positions() == Points<TestType>::Zero(3, 3));
}

TEST_CASE("a Result holds the archetype of a model", "[archetypes]") {
  Result<ModelArchetype<double>> made(ModelArchetype<double>(4));
  REQUIRE(made.has_value());
  const ModelArchetype<double> taken = std::move(made).value();
  CHECK(taken.vertex_count() == 4);
}
