#include "clothctl/grasp/held_grips.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "clothctl/mesh/grid.hpp"
#include "support/catch.hpp"
#include "support/pads.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("what fingers hold becomes a grip of opposed fingers on the same vertices", "[grasp]") {
  using Vec = Vector3<double>;
  GrippedSheet held(17, 3);
  auto contacts = StaticContacts<double>::create(held.world, 0, {0, 1}).value();
  const auto triangles = hanging_sheet(17).network().triangles;
  const auto& x = held.world.state(0).positions;
  const std::vector<HoldingFinger<double>> fingers{{0, Vec(0, 1, 0), 0.4, 7},
                                                   {1, Vec(0, -1, 0), 0.4, 5}};
  CHECK(make_held_grip<double>(contacts, fingers, x, triangles).error() ==
        "no finger holds a vertex of the sheet");
  for (int i = 0; i < 20; ++i) {
    REQUIRE(held.world.step(0.02).advanced);
    contacts.update(held.world);
  }
  const auto grip = make_held_grip<double>(contacts, fingers, x, triangles);
  REQUIRE(grip);
  REQUIRE(grip->fingers.size() == 2);
  CHECK(validate_grips(std::vector<Grip<double>>{*grip}, x.cols()) == "");
  // They press from opposite sides; the front of this sheet faces -y or +y for all triangles.
  CHECK(grip->fingers[0].side == -grip->fingers[1].side);
  const auto& t = triangles.front();
  const Vec front = Vec(x.col(t[1]) - x.col(t[0])).cross(Vec(x.col(t[2]) - x.col(t[0])));
  CHECK((front.y() > 0 ? 1 : -1) == grip->fingers[0].side);
  CHECK(grip->fingers[0].max_normal_force == 7);
  CHECK(grip->fingers[1].contact.friction == 0.4);
  for (int f = 0; f < 2; ++f) {
    std::vector<int> vertices;
    for (const auto& h : contacts.held(f)) vertices.push_back(h.vertex);
    CHECK(grip->fingers[static_cast<std::size_t>(f)].vertices == vertices);
  }

  // Without triangles, or where they cancel, the fallback normal says where the front is.
  auto both = triangles;
  for (const auto& face : triangles) both.push_back({face[0], face[2], face[1]});
  for (const auto& faces : {std::vector<std::array<int, 3>>(), both}) {
    const auto rope = make_held_grip<double>(contacts, fingers, x, faces);
    REQUIRE(rope);
    CHECK(rope->fingers[0].side == 1);
    CHECK(rope->fingers[1].side == -1);
  }

  auto bad = fingers;
  bad[1].segment = 2;
  CHECK(make_held_grip<double>(contacts, bad, x, triangles).error() ==
        "finger 1: there is no segment 2");
  bad = fingers;
  bad[0].press[2] = std::nan("");
  CHECK(make_held_grip<double>(contacts, bad, x, triangles).error() ==
        "finger 0 has a direction that is not finite");
  bad = fingers;
  bad[1].friction = -1;
  CHECK(make_held_grip<double>(contacts, bad, x, triangles).error() ==
        "finger 1 has the friction coefficient -1, must be finite and not negative");
  bad[1].friction = std::nan("");
  CHECK(make_held_grip<double>(contacts, bad, x, triangles).error() ==
        "finger 1 has the friction coefficient nan, must be finite and not negative");
  bad = fingers;
  bad[0].max_normal_force = 0;
  CHECK(make_held_grip<double>(contacts, bad, x, triangles).error() ==
        "finger 0 has the largest normal force 0, must be finite and positive");

  const int first = grip->fingers[0].vertices[0];
  std::vector<std::array<int, 3>> broken{{first, 9999, 4}};
  CHECK(make_held_grip<double>(contacts, fingers, x, broken).error() ==
        "a triangle has vertex 9999 off a mesh of 289 vertices");
  Points<double> spoilt = x;
  spoilt(1, first) = std::nan("");
  for (const auto& faces : {triangles, std::vector<std::array<int, 3>>()})
    CHECK(make_held_grip<double>(contacts, fingers, spoilt, faces).error() ==
          "finger 0 holds vertex " + std::to_string(first) + ", which is not finite");
  // A corner beside what is held.
  std::set<int> taken;
  for (const auto& f : grip->fingers) taken.insert(f.vertices.begin(), f.vertices.end());
  spoilt = x;
  for (const auto& face : triangles) {
    if (std::find(face.begin(), face.end(), first) == face.end()) continue;
    for (const int corner : face) {
      if (!taken.count(corner)) spoilt(1, corner) = std::nan("");
    }
  }
  CHECK(make_held_grip<double>(contacts, fingers, spoilt, triangles).error() ==
        "finger 0 holds the sheet where it is not finite");
}

TEST_CASE("of a grip the vertex in its middle is kept, by all its fingers", "[grasp]") {
  Points<double> x(3, 6);
  x << 0, 1, 2, 0.9, 5, 5, 0, 0, 0, 0.2, 5, 5, 0, 0, 0, 0, 5, 5;
  Grip<double> grip;
  grip.fingers.push_back({{0, 1, 2}, 1, {}, 7});
  grip.fingers.push_back({{1, 2, 3}, -1, {}, 5});
  keep_middle<double>(grip, x);  // of 0, 1, 2, 3: (0.975, 0.05, 0)
  CHECK(grip.vertices() == std::vector<int>{1});
  REQUIRE(grip.fingers.size() == 2);
  for (const auto& f : grip.fingers) CHECK(f.vertices == std::vector<int>{1});
  CHECK(grip.fingers[0].max_normal_force == 7);
  CHECK(grip.fingers[1].side == -1);
  grip.fingers.push_back({{}, 1, {}, 5});
  keep_middle<double>(grip, x);
  CHECK(grip.fingers[2].vertices.empty());  // it holds nothing
  Grip<double> none;
  keep_middle<double>(none, x);
  CHECK(none.fingers.empty());
}
