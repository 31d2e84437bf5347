// The order of the held vertices, and the sizes of the grips that hold them.

#include "clothctl/mpc/detail/held_vertices.hpp"

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("held vertices are ordered by grip", "[mpc]") {
  detail::HeldVertices<double> held;
  CHECK(held.grip_count() == 0);
  held.add_grip({2, 5, 7});
  held.add_grip({1});
  CHECK(held.grip_count() == 2);
  CHECK(held.vertices() == std::vector<int>{2, 5, 7, 1});
  CHECK(held.grip_begin(0) == 0);
  CHECK(held.grip_begin(1) == 3);
  CHECK(held.grip_begin(2) == 4);
  CHECK(held.grip_size(0) == 3);
  CHECK(held.slot(0, 7) == 2);
  CHECK(held.slot(1, 1) == 3);
  CHECK(held.vertex_share(1) == Approx(1.0 / 3));
  CHECK(held.vertex_share(3) == 1.0);
}

TEST_CASE("a grip has a centroid and a radius", "[mpc]") {
  detail::HeldVertices<double> held;
  held.add_grip({0, 2});
  held.add_grip({1});
  Points<double> x(3, 3);
  x << 0.0, 9.0, 4.0, 1.0, 8.0, 1.0, 0.0, 7.0, 3.0;
  CHECK((held.centroid(x, 0) - Vector3<double>(2.0, 1.0, 1.5)).norm() <= 1e-15);
  CHECK(held.centroid(x, 1) == x.col(1));
  CHECK(held.radius(x, 0) == Approx(2.5));
  CHECK(held.radius(x, 1) == 0.0);
}
