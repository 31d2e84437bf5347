#include "clothctl/mesh/tetrahedra.hpp"

#include <cmath>
#include <limits>
#include <map>

#include "clothctl/mesh/topology.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

/// Volume inside an outward-facing surface: Σ det(a, b, c) / 6.
template <class S>
double enclosed_volume(const TetMesh<S>& mesh) {
  double sum = 0;
  for (const auto& t : surface_triangles(mesh)) {
    Eigen::Matrix3d m;
    for (int i = 0; i < 3; ++i)
      m.col(i) = mesh.positions.col(t[static_cast<std::size_t>(i)]).template cast<double>();
    sum += (m(0, 0) * (m(1, 1) * m(2, 2) - m(2, 1) * m(1, 2)) -
            m(0, 1) * (m(1, 0) * m(2, 2) - m(2, 0) * m(1, 2)) +
            m(0, 2) * (m(1, 0) * m(2, 1) - m(2, 0) * m(1, 1))) /
           6.0;
  }
  return sum;
}

/// Checks that every face belongs to one or two tetrahedra, and that the surface is closed,
/// oriented and a topological sphere.
template <class S>
void check_conforming(const TetMesh<S>& mesh) {
  std::map<std::array<int, 3>, int> faces;
  for (const auto& t : mesh.tetrahedra) {
    for (std::size_t skip = 0; skip < 4; ++skip) {
      std::array<int, 3> face{t[(skip + 1) % 4], t[(skip + 2) % 4], t[(skip + 3) % 4]};
      std::sort(face.begin(), face.end());
      ++faces[face];
    }
  }
  std::size_t outer = 0;
  for (const auto& face : faces) {
    CHECK((face.second == 1 || face.second == 2));
    if (face.second == 1) ++outer;
  }
  const auto surface = surface_triangles(mesh);
  CHECK(surface.size() == outer);
  const auto topology = make_topology(static_cast<int>(mesh.positions.cols()), surface);
  REQUIRE(topology);
  CHECK(topology->boundary_edges.empty());
  CHECK(topology->consistently_oriented);
  // Euler characteristic of the ball: V - E + F - T = 1.
  CHECK(static_cast<long>(mesh.positions.cols()) -
            static_cast<long>(tetrahedron_edges(mesh).size()) + static_cast<long>(faces.size()) -
            static_cast<long>(mesh.tetrahedra.size()) ==
        1);
}

}  // namespace

TEMPLATE_TEST_CASE("a ball is a conforming mesh with its surface on the sphere", "[mesh]", float,
                   double) {
  using S = TestType;
  const double loose = std::is_same_v<S, float> ? 1e-5 : 1e-13;
  const Vector3<S> centre(S(0.3), S(-0.2), S(1.0));
  double short_of_ball = 1.0;
  for (int resolution : {1, 2, 3, 5, 8}) {
    const auto made = make_ball<S>(S(0.05), resolution, centre);
    REQUIRE(made);
    const TetMesh<S>& mesh = made.value();
    CHECK(mesh.validate().empty());
    CHECK(mesh.tetrahedra.size() ==
          8u * static_cast<std::size_t>(resolution * resolution * resolution));
    check_conforming(mesh);
    const VectorX<S> volumes = tetrahedron_volumes(mesh);
    CHECK(volumes.minCoeff() > S(0));
    // No slivers at any resolution.
    CHECK(volumes.minCoeff() > S(0.15) * volumes.maxCoeff());
    std::vector<bool> outer(static_cast<std::size_t>(mesh.positions.cols()), false);
    for (const auto& t : surface_triangles(mesh)) {
      for (int v : t) outer[static_cast<std::size_t>(v)] = true;
    }
    for (Index v = 0; v < mesh.positions.cols(); ++v) {
      const double r = static_cast<double>((mesh.positions.col(v) - centre).norm());
      if (outer[static_cast<std::size_t>(v)]) {
        CHECK(r == Approx(0.05).epsilon(loose));
      } else {
        CHECK(r < 0.05 * (1.0 - 0.5 / resolution));
      }
    }
    const double volume = static_cast<double>(volumes.sum());
    CHECK(enclosed_volume(mesh) == Approx(volume).epsilon(std::is_same_v<S, float> ? 1e-2 : 1e-9));
    const double missing = 1.0 - volume / (4.0 / 3.0 * 3.14159265358979 * 0.05 * 0.05 * 0.05);
    CHECK(missing > 0.0);
    CHECK(missing < short_of_ball);
    short_of_ball = missing;
  }
  CHECK(short_of_ball < 0.025);
}

TEMPLATE_TEST_CASE("a ball's poles and centre are where documented", "[mesh]", float, double) {
  using S = TestType;
  const auto made = make_ball<S>(S(0.1), 4, Vector3<S>::Zero());
  REQUIRE(made);
  const Index last = made->positions.cols() - 1;
  const S near = scalar_traits<S>::epsilon();
  CHECK((made->positions.col(0) - Vector3<S>(S(0), S(0), S(-0.1))).norm() <= near);
  CHECK((made->positions.col(last) - Vector3<S>(S(0), S(0), S(0.1))).norm() <= near);
  CHECK(made->positions.col(last / 2) == Vector3<S>::Zero());
}

TEMPLATE_TEST_CASE("a box is a conforming mesh of equal tetrahedra", "[mesh]", float, double) {
  using S = TestType;
  const auto made = make_box<S>(2, 3, 4, Vector3<S>(S(1), S(1.5), S(0.8)));
  REQUIRE(made);
  CHECK(made->validate().empty());
  CHECK(made->positions.cols() == 60);
  CHECK(made->tetrahedra.size() == 144);
  check_conforming(made.value());
  const VectorX<S> volumes = tetrahedron_volumes(made.value());
  CHECK(volumes.minCoeff() == Approx(static_cast<double>(volumes.maxCoeff())).epsilon(1e-5));
  CHECK(static_cast<double>(volumes.sum()) == Approx(1.2).epsilon(1e-5));
  CHECK(enclosed_volume(made.value()) == Approx(1.2).epsilon(1e-5));
  CHECK(surface_triangles(made.value()).size() == 2 * 2 * (2 * 3 + 3 * 4 + 2 * 4));
  CHECK(made->positions.rowwise().maxCoeff() == Vector3<S>(S(0.5), S(0.75), S(0.4)));
  CHECK(made->positions.rowwise().minCoeff() == Vector3<S>(S(-0.5), S(-0.75), S(-0.4)));
}

TEMPLATE_TEST_CASE("bad tetrahedral meshes and sizes are refused with a message", "[mesh]", float,
                   double) {
  using S = TestType;
  const Vector3<S> zero = Vector3<S>::Zero(), one = Vector3<S>::Ones();
  CHECK(make_ball<S>(S(0.1), 0, zero).error() == "ball resolution must be 1 to 100, got 0");
  CHECK(make_ball<S>(S(-1), 2, zero).error() == "ball radius must be positive, got -1");
  CHECK(make_ball<S>(S(1), 2, Vector3<S>::Constant(std::numeric_limits<S>::quiet_NaN())).error() ==
        "ball centre is not finite");
  CHECK(make_box<S>(1, 0, 1, one).error() == "box needs at least 1 cell along y, got 0");
  CHECK(make_box<S>(1, 1, 1, Vector3<S>(S(1), S(1), S(0))).error() ==
        "box size along z must be positive, got 0");
  CHECK(make_box<S>(100000, 100000, 100000, one).error().find("too large") != std::string::npos);
  const S tiny = std::is_same_v<S, float> ? S(1e-20) : S(1e-150),
          huge = std::is_same_v<S, float> ? S(1e20) : S(1e150);
  CHECK(make_box<S>(1, 1, 1, Vector3<S>::Constant(tiny)).error() ==
        "box: tetrahedron 0 has no positive volume, got 0 m^3");
  CHECK(make_box<S>(2, 1, 1, Vector3<S>::Constant(huge))
            .error()
            .find("box: tetrahedron 0 has no positive volume") == 0);
  CHECK(make_ball<S>(tiny, 1, zero).error().find("ball: tetrahedron 0 has no positive volume") ==
        0);
  CHECK(make_ball<S>(huge, 1, zero).error().find("ball: tetrahedron 0 has no positive volume") ==
        0);

  auto made = make_box<S>(1, 1, 1, one);
  REQUIRE(made);
  TetMesh<S> mesh = made.value();
  std::swap(mesh.tetrahedra[4][0], mesh.tetrahedra[4][1]);
  CHECK(mesh.validate().find("tetrahedron 4 has no positive volume") == 0);
  mesh = made.value();
  mesh.tetrahedra[2][3] = 8;
  CHECK(mesh.validate() == "tetrahedron 2 holds vertex 8 off the mesh of 8 vertices");
  mesh = made.value();
  mesh.positions(1, 5) = std::numeric_limits<S>::quiet_NaN();
  CHECK(mesh.validate() == "position of vertex 5 is not finite");
  mesh = made.value();
  mesh.positions.conservativeResize(3, 9);
  mesh.positions.col(8).setZero();
  CHECK(mesh.validate() == "vertex 8 belongs to no tetrahedron");
  CHECK_FALSE(TetMesh<S>().validate().empty());
}
