// The list of contacts of a sheet with obstacles, and its memory.

#include "clothctl/contact/obstacle_contacts.hpp"

#include <array>
#include <limits>
#include <string>
#include <vector>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/mesh/grid.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

const double kNan = std::numeric_limits<double>::quiet_NaN();

GridMesh<double> level_grid(int n) {
  GridMesh<double> mesh = make_grid<double>(n, n, 0.3, 0.3).value();
  const Points<double> hanging = mesh.positions;
  mesh.positions.row(1) = hanging.row(2);
  mesh.positions.row(2).setZero();
  return mesh;
}

PlaneCollider<double> floor_at(double z) {
  return PlaneCollider<double>::create(Vector3<double>(0, 0, z), Vector3<double>(0, 0, 1)).value();
}

struct Rig {
  GridMesh<double> mesh = level_grid(5);
  SheetContactFinder<double> finder =
      SheetContactFinder<double>::create(mesh.positions, mesh.triangles).value();
  ObstacleContacts<double> contacts = ObstacleContacts<double>::create(100).value();
  Points<double> rest = Points<double>::Zero(3, 25);
};

}  // namespace

TEST_CASE("bad settings of obstacle contacts are named", "[contact]") {
  const auto error = [](const ObstacleContactSettings<double>& s) {
    return ObstacleContacts<double>::create(1, s).error();
  };
  CHECK(error({-1, 1, 1}).find("thickness -1 m") != std::string::npos);
  CHECK(error({kNan, 1, 1}).find("thickness nan m") != std::string::npos);
  CHECK(error({0.1, 0.1, 1}).find("reach 0.1 m") != std::string::npos);
  CHECK(error({0.1, 1, 0}).find("push-out speed 0 m/s") != std::string::npos);
  CHECK(ObstacleContacts<double>::create(-1).error().find("-1") != std::string::npos);
}

TEST_CASE("the margin follows the speeds", "[contact]") {
  Rig rig;
  const auto floor = floor_at(-0.05);
  const std::vector<ColliderRef<double>> list{ColliderRef<double>(floor)};
  CHECK(rig.contacts.update(list, rig.rest, 0.01, rig.finder) == QueryStatus::Answered);
  CHECK(rig.contacts.contacts().empty());
  Points<double> falling = rig.rest;
  falling.row(2).setConstant(-3);
  CHECK(rig.contacts.update(list, falling, 0.01, rig.finder) == QueryStatus::Answered);
  CHECK(rig.contacts.contacts().size() == 25);
  CHECK(rig.contacts.step_length() == 0.01);
  // Never beyond the reach.
  falling.row(2).setConstant(-1e6);
  const auto deep = floor_at(-0.3);
  const std::vector<ColliderRef<double>> other{ColliderRef<double>(deep)};
  CHECK(rig.contacts.update(other, falling, 0.01, rig.finder) == QueryStatus::Answered);
  CHECK(rig.contacts.contacts().empty());
}

TEST_CASE("closed contacts are remembered by obstacle and vertices, as forces", "[contact]") {
  Rig rig;
  const auto floor = floor_at(-0.0005), side = floor_at(-1);
  const std::vector<ColliderRef<double>> list{ColliderRef<double>(side),
                                              ColliderRef<double>(floor)};
  CHECK(rig.contacts.update(list, rig.rest, 0.01, rig.finder) == QueryStatus::Answered);
  REQUIRE(rig.contacts.contacts().size() == 25);
  CHECK(!rig.contacts.any_closed());
  auto& one = rig.contacts.contacts()[7];
  CHECK(one.obstacle == 1);
  one.impulse = Vector3<double>(1, 2, 3);
  one.offset = Vector3<double>(1e-4, 0, 0);
  one.state = ContactState::Slip;
  one.age = 4;
  const int vertex = one.point.vertex[0];
  CHECK(rig.contacts.update(list, rig.rest, 0.02, rig.finder) == QueryStatus::Answered);
  CHECK(rig.contacts.any_closed());
  for (const ObstacleContact<double>& c : rig.contacts.contacts()) {
    const bool same = c.point.vertex[0] == vertex;
    CHECK(c.impulse == (same ? Vector3<double>(2, 4, 6) : Vector3<double>(0, 0, 0)));
    CHECK(c.offset[0] == (same ? 1e-4 : 0));
    CHECK(c.age == (same ? 4 : 0));
  }
  // Another obstacle at the same place in the list is another contact.
  const std::vector<ColliderRef<double>> swapped{ColliderRef<double>(floor)};
  CHECK(rig.contacts.update(swapped, rig.rest, 0.02, rig.finder) == QueryStatus::Answered);
  for (const ObstacleContact<double>& c : rig.contacts.contacts()) CHECK(c.impulse.norm() == 0);
  rig.contacts.clear();
  CHECK(rig.contacts.contacts().empty());
}

TEST_CASE("bad input of an update leaves no contacts", "[contact]") {
  Rig rig;
  const auto floor = floor_at(0);
  const std::vector<ColliderRef<double>> list{ColliderRef<double>(floor)};
  for (const double dt : {0.0, -0.01, kNan, std::numeric_limits<double>::infinity()}) {
    REQUIRE(rig.contacts.update(list, rig.rest, 0.01, rig.finder) == QueryStatus::Answered);
    CHECK(rig.contacts.update(list, rig.rest, dt, rig.finder) == QueryStatus::InvalidArgument);
    CHECK(rig.contacts.contacts().empty());
  }
  CHECK(rig.contacts.update(list, Points<double>::Zero(3, 24), 0.01, rig.finder) ==
        QueryStatus::InvalidArgument);
  Points<double> bad = rig.rest;
  bad(1, 3) = kNan;
  CHECK(rig.contacts.update(list, bad, 0.01, rig.finder) == QueryStatus::InvalidPoint);
  CHECK(rig.contacts.contacts().empty());
}

TEST_CASE("a full list says so and allocates nothing", "[contact]") {
  Rig rig;
  auto few = ObstacleContacts<double>::create(10).value();
  const auto floor = floor_at(0);
  const std::vector<ColliderRef<double>> list{ColliderRef<double>(floor)};
  const long before = allocations();
  bool answered = true;
  for (int i = 0; i < 3; ++i)
    answered &= few.update(list, rig.rest, 0.01, rig.finder) == QueryStatus::Answered;
  const long after = allocations();
  CHECK(answered);
  if (allocation_counting_works()) CHECK(after == before);
  CHECK(!few.complete());
  CHECK(few.contacts().size() == 10);
}

TEST_CASE("surface_at asks the collider of a contact", "[contact]") {
  Rig rig;
  const auto floor = floor_at(-0.0005);
  const std::vector<ColliderRef<double>> list{ColliderRef<double>(floor)};
  REQUIRE(rig.contacts.update(list, rig.rest, 0.01, rig.finder) == QueryStatus::Answered);
  const auto there =
      rig.contacts.surface_at(rig.contacts.contacts()[0], Vector3<double>(0, 0, 0.2995));
  CHECK(std::abs(there.distance - 0.3) < 1e-15);
}
