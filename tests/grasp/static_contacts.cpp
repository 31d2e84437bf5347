#include "clothctl/grasp/static_contacts.hpp"

#include <algorithm>
#include <vector>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/pads.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

using Vec = Vector3<double>;

std::vector<int> vertices(const StaticContacts<double>& contacts, int segment) {
  std::vector<int> out;
  for (const auto& held : contacts.held(segment)) out.push_back(held.vertex);
  return out;
}

std::vector<int> sticking(const World<double>& world, int obstacle) {
  std::vector<int> out;
  add_static_contacts(world, 0, obstacle, out);
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace

TEST_CASE("vertices that a gripper holds join after some steps and leave after some", "[grasp]") {
  GrippedSheet held(17, 3);
  StaticContactSettings settings;
  settings.join_after = 3;
  settings.leave_after = 5;
  auto contacts = StaticContacts<double>::create(held.world, 0, {0, 1}, settings).value();
  std::vector<int> before, other_before;
  int first = -1;
  for (int i = 0; i < 40; ++i) {
    REQUIRE(held.world.step(0.02).advanced);
    contacts.update(held.world);
    const std::vector<int> now = vertices(contacts, 0);
    const std::vector<int> other = vertices(contacts, 1);
    CHECK(contacts.changed() == (now != before || other != other_before));
    other_before = other;
    if (!now.empty() && first < 0) first = i;
    before = now;
  }
  CHECK(first >= 2);  // not before the third step
  REQUIRE_FALSE(before.empty());
  CHECK(before == sticking(held.world, 0));
  CHECK(std::is_sorted(before.begin(), before.end()));
  CHECK_FALSE(contacts.changed());

  // The place in the segment's frame is that of the vertex: the gripper holds it.
  for (int segment : {0, 1}) {
    const RigidMotion<double>& frame = held.world.motion(contacts.obstacle(segment));
    for (const auto& h : contacts.held(segment)) {
      const Vec x = held.world.state(0).positions.col(h.vertex);
      CHECK((frame.R_world_body * h.local + frame.position - x).norm() < 3e-3);
      CHECK(h.missed == 0);
    }
  }

  // It opens: all leave, together, after five steps.
  held.world.drive(0).torque = Eigen::Vector3d(0, -3, -3);
  int gone = 0, steps = 0;
  while (!vertices(contacts, 0).empty() && steps < 50) {
    REQUIRE(held.world.step(0.02).advanced);
    contacts.update(held.world);
    if (sticking(held.world, 0).empty()) ++gone;
    ++steps;
  }
  CHECK(gone == 5);
  CHECK(contacts.changed());
}

TEST_CASE("what is forgotten joins again, and an update never allocates", "[grasp]") {
  GrippedSheet held(17, 3);
  auto contacts = StaticContacts<double>::create(held.world, 0, {1, 0}).value();
  CHECK(contacts.segment_count() == 2);
  for (int i = 0; i < 20; ++i) {
    REQUIRE(held.world.step(0.02).advanced);
    contacts.update(held.world);
  }
  const std::vector<int> before = vertices(contacts, 1);
  REQUIRE_FALSE(before.empty());
  contacts.clear();
  CHECK(contacts.changed());
  CHECK(contacts.held(1).empty());
  long allocated = 0;
  for (int i = 0; i < 5; ++i) {
    REQUIRE(held.world.step(0.02).advanced);
    const long count = allocations();
    contacts.update(held.world);
    allocated += allocations() - count;
  }
  CHECK(vertices(contacts, 1) == sticking(held.world, contacts.obstacle(1)));
  if (allocation_counting_works()) CHECK(allocated == 0);
}

TEST_CASE("sheets and segments that are not there are refused by name", "[grasp]") {
  GrippedSheet held(5, 3);
  const auto refused = [&](int sheet, std::vector<int> segments, StaticContactSettings s = {}) {
    const auto made = StaticContacts<double>::create(held.world, sheet, std::move(segments), s);
    return made ? std::string() : made.error();
  };
  CHECK(refused(1, {0}) == "there is no sheet 1");
  CHECK(refused(-1, {0}) == "there is no sheet -1");
  CHECK(refused(0, {0, 7}) == "segment 1: there is no obstacle 7");
  CHECK(refused(0, {-1}) == "segment 0: there is no obstacle -1");
  CHECK(refused(0, {1, 0, 1}) == "segment 2 is obstacle 1, as segment 0 is");
  CHECK(refused(0, {0}, {0, 4}) == "join_after is 0, expected 1 or more");
  CHECK(refused(0, {0}, {2, -1}) == "leave_after is -1, expected 1 or more");
  CHECK(refused(0, {}).empty());
}
