// Which parts of a world may touch.

#include "clothctl/sim/detail/world_parts.hpp"

#include "support/catch.hpp"
#include "support/pads.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("pads touch only the sheets of their carrier's groups", "[sim]") {
  World<double> world;
  WorldSheetSetup<double> setup;
  setup.groups.groups = 2;
  setup.groups.collides_with = 2;
  const Vector3<double> at = add_hanging_sheet(world, 5, Vector3<double>(0, 0, -9.81), setup);
  for (const unsigned group : {1u, 2u}) {
    CollisionGroups groups;
    groups.groups = groups.collides_with = group;
    RigidMotion<double> motion;
    motion.position = at;
    const int carrier = world.add_obstacle(pad_ball(), motion, {}, groups).value();
    (void)world.add_pad(carrier, pad_samples()).value();
  }
  REQUIRE(world.step(0.01).advanced);
  CHECK(world.pad_contacts(0).empty());
  CHECK(world.pad_contacts(1).size() == 4);
}
