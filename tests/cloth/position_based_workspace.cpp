#include "clothctl/cloth/detail/position_based_workspace.hpp"

#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// Points x y z w one after the other, in the opposite order of the vertices.
struct Sheet {
  static constexpr std::size_t kStride = 1;
  struct Scratch {
    VectorX<double> points = VectorX<double>::Constant(8, 7), start = points;
  };
  std::size_t offset(int v) const { return 4 * static_cast<std::size_t>(1 - v); }
};

}  // namespace

TEST_CASE("state is written to the buffers of a sheet and read back", "[cloth]") {
  Points<double> x(3, 2), v(3, 2), y(3, 2), u(3, 2);
  x << 1, 4, 2, 5, 3, 6;
  v << 10, 0, 0, -20, 0, 30;
  Sheet::Scratch memory;
  detail::write_points(Sheet{}, memory, x, v, 0.5);
  CHECK(memory.points[4] == 1);      // x of vertex 0
  CHECK(memory.start[4] == 1 - 5);   // where it was half a second before
  CHECK(memory.start[1] == 5 + 10);  // y of vertex 1
  CHECK(memory.points[3] == 7);      // inverse masses stay
  detail::read_points(Sheet{}, memory, 0.5, y, u);
  CHECK(y == x);
  CHECK(u == v);
}

TEST_CASE("held vertices end a step with the velocities that they were told", "[cloth]") {
  PositionBasedWorkspace<double> ws;
  ws.velocities = Points<double>::Constant(3, 4, 7);
  ws.held.reserve(3);
  for (const int v : {0, 2, 3}) ws.held.push_back(v);  // pinned, driven, carried
  ws.carried.vertices = {3};
  ws.carried.velocities = Points<double>::Constant(3, 1, 2);
  ws.carried.impulses = Points<double>::Constant(3, 1, 9);
  ws.held_impulses.reserve(3);
  ws.held_impulses.begin(ws.held, VectorX<double>::Constant(4, 0.1));
  ClothInput<double> input;
  input.driven_vertices = {2};
  input.driven_positions = Points<double>::Constant(3, 1, 1.5);
  const Points<double> before = Points<double>::Constant(3, 4, 1);
  detail::end_held({0}, before, input, 0.25, ws);
  CHECK(ws.velocities.col(0) == Vector3<double>(0, 0, 0));
  CHECK(ws.velocities.col(1) == Vector3<double>(7, 7, 7));  // free
  CHECK(ws.velocities.col(2) == Vector3<double>(2, 2, 2));
  CHECK(ws.velocities.col(3) == Vector3<double>(2, 2, 2));
  CHECK(ws.carried.impulses.col(0) == Vector3<double>(0, 0, 0));  // no constraint pulled
}
