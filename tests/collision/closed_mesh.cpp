// Pseudonormals of closed meshes, and the fans of their vertices.

#include "clothctl/collision/detail/closed_mesh.hpp"

#include <cmath>

#include "support/catch.hpp"
#include "support/solids.hpp"

using namespace clothctl;

TEST_CASE("the pseudonormals of a cube point along its diagonals", "[contact]") {
  const auto mesh = clothctl_test::box_mesh({1, 1, 1});
  const Topology topology = make_topology(8, mesh.triangles).value();
  CHECK(detail::validate_closed(mesh.triangles, topology).empty());
  CHECK(detail::validate_solid<double>(mesh.positions, mesh.triangles).empty());
  const auto normals = detail::pseudonormals<double>(mesh.positions, mesh.triangles, topology);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    CHECK(normals[t].face.cwiseAbs().maxCoeff() == 1.0);
    for (std::size_t i = 0; i < 3; ++i) {
      const Vector3<double> a = mesh.positions.col(mesh.triangles[t][i]);
      const Vector3<double> b = mesh.positions.col(mesh.triangles[t][(i + 1) % 3]);
      // However the faces are divided, the angles weight them equally.
      CHECK((normals[t].corner[i] - a.normalized()).norm() <= 1e-15);
      // The middle of an edge of the cube, or of the diagonal of a face.
      CHECK((normals[t].edge[i] - (a + b).normalized()).norm() <= 1e-15);
    }
  }
}

TEST_CASE("closed meshes pass, and a volume is measured from outside", "[contact]") {
  for (const auto& mesh : {clothctl_test::icosphere(2, 3), clothctl_test::torus_mesh(7, 5, 2, 1)}) {
    const Topology topology = make_topology(mesh.positions.cols(), mesh.triangles).value();
    CHECK(detail::validate_closed(mesh.triangles, topology).empty());
    // Far from the origin, too.
    Points<double> x = mesh.positions;
    x.colwise() += Vector3<double>(1e5, -2e5, 3e5);
    CHECK(detail::validate_solid<double>(x, mesh.triangles).empty());
  }
}
