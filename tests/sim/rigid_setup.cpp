// Set-up of rigid bodies: what is refused, and groups.

#include "clothctl/sim/rigid_setup.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("settings name what is out of range") {
  RigidBodiesSettings<double> s;
  CHECK(s.validate().empty());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (double* number : {&s.stiffness, &s.relaxation, &s.push_speed, &s.bounce_speed,
                         &s.sleep_speed, &s.sleep_time, &s.velocity_tolerance, &s.gravity[1]}) {
    const double good = *number;
    *number = nan;
    CHECK(!s.validate().empty());
    *number = good;
  }
  s.stiffness = 0;
  CHECK(s.validate().find("stiffness") != std::string::npos);
  s = {};
  s.newton_contacts = 1000;
  CHECK(s.validate().find("1000") != std::string::npos);
  s = {};
  s.sweeps = 0;
  CHECK(!s.validate().empty());
  s.sweeps = 2000000000;
  CHECK(s.validate() == "2000000000 sweeps; 1 to 100000 are possible");
  s = {};
  s.gravity[2] = nan;
  CHECK(s.validate() == "the gravity with the coordinate 2 = nan, must be finite");
}

TEST_CASE("set-up of bodies") {
  RigidBodySetup<double> setup{ConvexShape<double>::sphere(1).value()};
  CHECK(setup.validate().empty());
  setup.friction = std::numeric_limits<double>::infinity();
  CHECK(setup.validate().find("friction") != std::string::npos);
  setup.friction = 0.5;
  setup.density = 0;
  CHECK(!setup.validate().empty());
  setup.kind = BodyKind::Pinned;
  CHECK(setup.validate().empty());
}

TEST_CASE("groups meet when each looks for one of the other") {
  CHECK(CollisionGroups{}.meets({}));
  CHECK(!CollisionGroups{1, 2}.meets({1, 1}));
  CHECK(CollisionGroups{1, 2}.meets({2, 1}));
  CHECK(!CollisionGroups{1, 2}.meets({2, 4}));
  CHECK(CollisionGroups{3, 4}.meets({4, 2}));
}
