#include "clothctl/sim/detail/grip_patches.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using namespace clothctl_test;

namespace {

using Contact = GripContact<double>;
using Vec = Vector3<double>;

const auto none = [](int) { return false; };

/// Vertices 0 to n - 1, joined by `edges`.
VertexNeighbours<double> joined(int n, const std::vector<std::array<int, 2>>& edges) {
  SpringNetwork<double> network;
  network.rest_positions = Points<double>::Zero(3, n);
  network.mass = VectorX<double>::Ones(n);
  for (const auto& e : edges) {
    Spring<double> s;
    s.a = e[0];
    s.b = e[1];
    network.springs.push_back(s);
  }
  return VertexNeighbours<double>(network);
}

std::vector<int> vertices_of(const GripPatches<double>& grip, std::size_t k) {
  const GripPatch<double>& patch = grip.patches()[k];
  std::vector<int> out(grip.vertices().begin() + static_cast<std::ptrdiff_t>(patch.begin),
                       grip.vertices().begin() + static_cast<std::ptrdiff_t>(patch.end));
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace

TEST_CASE("contacts whose triangles share vertices hold one patch", "[sim]") {
  std::vector<Contact> contacts(4);
  contacts[0].vertex = {5, 6, 7};
  contacts[1].vertex = {1, 2, 3};
  contacts[2].vertex = {9, 8, -1};
  contacts[3].vertex = {3, 4, 7};  // joins the first two
  const VertexNeighbours<double> neighbours = joined(10, {});
  GripPatches<double> grip;
  grip.reserve(20, 10);
  grip.find(contacts, neighbours, none, none);
  REQUIRE(grip.patches().size() == 2);
  CHECK(vertices_of(grip, 0) == std::vector<int>{1, 2, 3, 4, 5, 6, 7});
  CHECK(vertices_of(grip, 1) == std::vector<int>{8, 9});

  // What is prescribed is on no patch and joins none.
  grip.find(
      contacts, neighbours, [](int v) { return v == 3 || v == 8 || v == 9; }, none);
  REQUIRE(grip.patches().size() == 2);
  CHECK(vertices_of(grip, 0) == std::vector<int>{4, 5, 6, 7});
  CHECK(vertices_of(grip, 1) == std::vector<int>{1, 2});

  grip.find({}, neighbours, none, none);
  CHECK(grip.vertices().empty());
}

TEST_CASE("a patch slides with the greater part of the force, and has the mean motion", "[sim]") {
  std::vector<Contact> contacts(3);
  for (Contact& c : contacts) c.vertex = {0, 1, 2};
  contacts[0].sticks = true;
  contacts[0].impulse = 2;
  contacts[1].impulse = contacts[2].impulse = 0.9;
  contacts[0].velocity = Vec(3, 0, 0);
  contacts[1].spin = Vec(0, 0, 6);
  const VertexNeighbours<double> neighbours = joined(10, {});
  GripPatches<double> grip;
  grip.reserve(20, 10);
  grip.find(contacts, neighbours, none, none);
  REQUIRE(grip.patches().size() == 1);
  CHECK(!grip.patches()[0].slides);
  CHECK((grip.patches()[0].velocity - Vec(3 * 2 / 3.8, 0, 0)).norm() < 1e-12);
  CHECK((grip.patches()[0].spin - Vec(0, 0, 6 * 0.9 / 3.8)).norm() < 1e-12);
  CHECK(!grip.patches()[0].opposed);
  contacts[1].impulse = 1.2;
  grip.find(contacts, neighbours, none, none);
  CHECK(grip.patches()[0].slides);
  // New contacts have no impulse yet: the patch keeps its own motion.
  for (Contact& c : contacts) c.impulse = 0;
  contacts[2].normal = Vec(0, 0, -1);
  grip.find(contacts, neighbours, none, none);
  CHECK(grip.patches()[0].slides);
  CHECK(grip.patches()[0].opposed);
  CHECK((grip.patches()[0].velocity - Vec(1, 0, 0)).norm() < 1e-12);
}

TEST_CASE("edges join patches, and hold none next to what is held otherwise", "[sim]") {
  const VertexNeighbours<double> neighbours = joined(12, {{2, 3}, {5, 6}, {9, 10}, {10, 11}});
  CHECK(neighbours.part_count() == 8);
  CHECK(neighbours.part(9) == neighbours.part(11));
  CHECK(neighbours.part(9) != neighbours.part(8));
  std::vector<Contact> contacts(3);
  contacts[0].vertex = {0, 1, 2};
  contacts[1].vertex = {3, 4, 5};
  contacts[2].vertex = {7, 8, 9};
  GripPatches<double> grip;
  grip.reserve(9, 12);
  grip.find(contacts, neighbours, none, none);
  REQUIRE(grip.patches().size() == 2);
  CHECK(vertices_of(grip, 0) == std::vector<int>{0, 1, 2, 3, 4, 5});
  grip.find(
      contacts, neighbours, [](int v) { return v == 6; }, none);  // next to 5
  REQUIRE(grip.patches().size() == 1);
  CHECK(vertices_of(grip, 0) == std::vector<int>{7, 8, 9});
  grip.find(contacts, neighbours, none, [](int v) { return v == 8; });
  REQUIRE(grip.patches().size() == 1);
  CHECK(vertices_of(grip, 0) == std::vector<int>{0, 1, 2, 3, 4, 5});
}

TEST_CASE("finding patches does not allocate where there is room", "[sim]") {
  std::vector<Contact> contacts(2);
  contacts[0].vertex = {0, 1, 2};
  contacts[1].vertex = {3, 4, 5};
  const VertexNeighbours<double> neighbours = joined(6, {});
  GripPatches<double> grip, other;
  grip.reserve(6, 6);
  other.reserve(6, 6);
  const long before = allocations();
  grip.find(contacts, neighbours, none, none);
  other.assign(grip);
  const long made = allocations() - before;
  if (allocation_counting_works()) CHECK(made == 0);
  CHECK(other.vertices() == grip.vertices());
}
