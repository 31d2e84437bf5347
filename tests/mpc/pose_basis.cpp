// The unknowns of planned grip poses: rigid motions of the held vertices, and their bounds.

#include "clothctl/mpc/detail/pose_basis.hpp"

#include "support/catch.hpp"

using namespace clothctl;

namespace {

struct Fixture {
  detail::HeldVertices<double> held;
  std::vector<std::pair<Index, Index>> columns;
  Points<double> x = Points<double>::Zero(3, 4);
  MatrixX<double> B;

  Fixture() {
    x << 0.0, 0.3, 0.1, 0.5, 0.2, 0.0, 0.1, 0.0, 0.1, 0.0, -0.2, 0.4;
    held.add_grip({0, 1, 2});
    held.add_grip({3});
    detail::PoseBasis<double>::reserve(held, columns);
    B.setZero(12, static_cast<Index>(columns.size()));
    detail::PoseBasis<double>::update(held, x, B);
  }
};

}  // namespace

TEST_CASE("a grip has six unknowns, or three if it holds one vertex", "[mpc]") {
  const Fixture f;
  REQUIRE(f.columns.size() == 9);
  CHECK(f.columns[0] == std::pair<Index, Index>(0, 9));
  CHECK(f.columns[8] == std::pair<Index, Index>(9, 3));
}

TEST_CASE("the columns of a pose are v + ω × r", "[mpc]") {
  const Fixture f;
  VectorX<double> u(9);
  u << 0.3, -0.1, 0.2, 0.7, 1.1, -0.4, 5.0, 6.0, 7.0;
  const VectorX<double> r = f.B * u;
  const Vector3<double> centre = f.held.centroid(f.x, 0);
  const Vector3<double> v = u.head<3>(), omega = u.segment<3>(3);
  for (Index j = 0; j < 3; ++j) {
    const Vector3<double> arm = f.x.col(j) - centre;
    CHECK((r.segment<3>(3 * j) - (v + omega.cross(arm))).norm() <= 1e-15);
  }
  CHECK((r.tail<3>() - u.tail<3>()).norm() == 0.0);
}

TEST_CASE("rotation moves no held vertex further than the bound of a step", "[mpc]") {
  const Fixture f;
  VectorX<double> upper(9);
  detail::PoseBasis<double>::upper_bounds(f.held, f.x, 0.01, 0.02, upper);
  CHECK((upper.head<3>().array() - 0.5).abs().maxCoeff() <= 1e-15);
  CHECK((upper.tail<3>().array() - 0.5).abs().maxCoeff() <= 1e-15);
  for (int corner = 0; corner < 8; ++corner) {
    VectorX<double> u = VectorX<double>::Zero(9);
    for (int i = 0; i < 3; ++i) u[3 + i] = ((corner >> i) & 1) != 0 ? -upper[3 + i] : upper[3 + i];
    CHECK((0.02 * (f.B * u)).cwiseAbs().maxCoeff() <= 0.01 * (1 + 1e-12));
  }
  // Vertices at one point cannot rotate.
  Points<double> together = f.x;
  together.leftCols(3).setZero();
  detail::PoseBasis<double>::upper_bounds(f.held, together, 0.01, 0.02, upper);
  CHECK(upper.segment<3>(3).norm() == 0.0);
}
