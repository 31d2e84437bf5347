#include "clothctl/network/solid.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "network/network_checks.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::spring_energy;

TEMPLATE_TEST_CASE("a solid has the mass of its volume and a closed surface", "[cloth]", float,
                   double) {
  using S = TestType;
  const auto mesh = make_ball<S>(S(0.05), 4, Vector3<S>::Zero());
  REQUIRE(mesh);
  const SolidSettings<S> settings;
  const auto network = solid_network(mesh.value(), settings);
  REQUIRE(network);
  CHECK(network->validate().empty());
  CHECK(network->bends.empty());
  CHECK(network->springs.size() == tetrahedron_edges(mesh.value()).size());
  CHECK(network->triangles.size() == 8 * 16);
  const double volume = static_cast<double>(tetrahedron_volumes(mesh.value()).sum());
  CHECK(static_cast<double>(network->mass.sum()) == Approx(300.0 * volume).epsilon(1e-5));
  for (const Spring<S>& s : network->springs)
    CHECK(static_cast<double>(s.damping) ==
          Approx(0.002 * static_cast<double>(s.stiffness)).epsilon(1e-6));
}

TEMPLATE_TEST_CASE("a rigid motion costs a solid no energy", "[cloth]", float, double) {
  using S = TestType;
  const auto mesh = make_ball<S>(S(0.05), 3, Vector3<S>::Zero());
  REQUIRE(mesh);
  const auto network = solid_network(mesh.value(), SolidSettings<S>{});
  REQUIRE(network);
  const Points<double> x = network->rest_positions.template cast<double>();
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(0.9, Eigen::Vector3d(1, 2, -1).normalized()).toRotationMatrix();
  const Points<double> moved = (turn * x).colwise() + Eigen::Vector3d(0.5, 1.0, -2.0);
  const double loose = std::is_same_v<S, float> ? 1e-8 : 1e-24;
  const double scale = spring_energy(network.value(), 1.01 * x);
  CHECK(scale > 0.0);
  CHECK(spring_energy(network.value(), x) <= loose * scale);
  CHECK(spring_energy(network.value(), moved) <= loose * scale);
}

TEST_CASE("a solid's springs have the elastic energy of its Young's modulus", "[cloth]") {
  const SolidSettings<double> settings;
  const double E = settings.youngs_modulus, lame = 0.4 * E, small = 1e-5;
  for (int resolution : {1, 2, 4}) {
    const auto mesh = make_ball<double>(0.05, resolution, Eigen::Vector3d::Zero());
    REQUIRE(mesh);
    const auto network = solid_network(mesh.value(), settings);
    REQUIRE(network);
    const double volume = tetrahedron_volumes(mesh.value()).sum();
    const Points<double>& x = network->rest_positions;
    // Uniform expansion: ½ (9 λ + 6 μ) ε² V on any mesh, since Σ k l² = 6 E V.
    CHECK(spring_energy(network.value(), (1.0 + small) * x) ==
          Approx(0.5 * 15.0 * lame * small * small * volume).epsilon(1e-6));
    // Stretching: ½ (λ + 2 μ) ε² V, as the mean over the six diagonals of an icosahedron, which
    // averages fourth powers exactly.
    const double golden = 0.5 * (1.0 + std::sqrt(5.0));
    double mean = 0;
    for (int axis = 0; axis < 3; ++axis) {
      for (double sign : {1.0, -1.0}) {
        Eigen::Vector3d n = Eigen::Vector3d::Zero();
        n[axis] = 1.0;
        n[(axis + 1) % 3] = sign * golden;
        n.normalize();
        const Eigen::Matrix3d map = Eigen::Matrix3d::Identity() + small * n * n.transpose();
        mean += spring_energy(network.value(), map * x) / 6.0;
      }
    }
    CHECK(mean == Approx(0.5 * 3.0 * lame * small * small * volume).epsilon(1e-3));
  }
}

TEMPLATE_TEST_CASE("append shifts indices and positions and changes nothing else", "[cloth]", float,
                   double) {
  using S = TestType;
  const auto rope = rope_network(RopeSettings<S>{});
  const auto mesh = make_box<S>(1, 1, 1, Vector3<S>::Ones());
  REQUIRE(rope);
  REQUIRE(mesh);
  const auto box = solid_network(mesh.value(), SolidSettings<S>{});
  REQUIRE(box);
  SpringNetwork<S> both = rope.value();
  const Vector3<S> offset(S(1), S(2), S(3));
  const int first = append(both, box.value(), offset);
  CHECK(first == 21);
  CHECK(both.validate().empty());
  CHECK(both.vertex_count() == 29);
  CHECK(both.springs.size() == rope->springs.size() + box->springs.size());
  CHECK(both.bends.size() == rope->bends.size());
  CHECK(both.triangles.size() == box->triangles.size());
  CHECK(both.springs.back().a == box->springs.back().a + first);
  CHECK(both.triangles.back()[2] == box->triangles.back()[2] + first);
  CHECK(both.rest_positions.leftCols(21) == rope->rest_positions);
  CHECK((both.rest_positions.rightCols(8) - box->rest_positions)
            .colwise()
            .mean()
            .isApprox(Eigen::Matrix<S, 1, 8>::Constant(S(2))));
  CHECK(both.mass.tail(8) == box->mass);

  SpringNetwork<S> twice = rope.value();
  append(twice, twice, offset);
  CHECK(twice.validate().empty());
  CHECK(twice.vertex_count() == 42);
  CHECK(twice.bends.size() == 2 * rope->bends.size());
  CHECK(twice.bends.back().vertex[2] == 41);
}

TEST_CASE("join adds a spring at its rest length", "[cloth]") {
  const auto rope = rope_network(RopeSettings<double>{});
  REQUIRE(rope);
  SpringNetwork<double> network = rope.value();
  CHECK(join(network, 0, 20, 40.0, 0.01).empty());
  REQUIRE(network.springs.size() == 21);
  CHECK(network.springs.back().rest_length == Approx(0.5));
  CHECK(network.springs.back().stiffness == 40.0);
  CHECK(network.springs.back().damping == Approx(0.4));
  CHECK(join(network, 0, 21, 1.0, 0.0) == "join: vertex 21 is off the mesh of 21 vertices");
  CHECK(join(network, 3, 3, 1.0, 0.0) == "join: vertex 3 cannot be joined to itself");
  CHECK(join(network, 0, 1, -1.0, 0.0) ==
        "join: stiffness and damping time must not be negative, got -1 and 0");
  network.rest_positions.col(5) = network.rest_positions.col(2);
  CHECK(join(network, 2, 5, 1.0, 0.0) == "join: vertices 2 and 5 are at the same place; use weld");
  CHECK(network.springs.size() == 21);
}

TEMPLATE_TEST_CASE("weld merges two vertices and keeps mass and springs", "[cloth]", float,
                   double) {
  using S = TestType;
  RopeSettings<S> settings;
  settings.segments = 4;
  const auto rope = rope_network(settings);
  REQUIRE(rope);
  for (const auto& order : {std::pair<int, int>(4, 5), std::pair<int, int>(5, 4)}) {
    SpringNetwork<S> network = rope.value();
    const int first = append(network, rope.value(), Vector3<S>(rope->rest_positions.col(4)));
    REQUIRE(first == 5);
    const double before = static_cast<double>(network.mass.sum());
    CHECK(weld(network, order.first, order.second).empty());
    CHECK(network.validate().empty());
    CHECK(network.vertex_count() == 9);
    CHECK(static_cast<double>(network.mass.sum()) == Approx(before).epsilon(1e-6));
    CHECK(static_cast<double>(network.mass[4]) ==
          Approx(2.0 * static_cast<double>(rope->mass[4])).epsilon(1e-6));
    // The result is a rope of eight springs in a row, twice as long.
    REQUIRE(network.springs.size() == 8);
    for (int i = 0; i < 8; ++i) {
      CHECK(network.springs[static_cast<std::size_t>(i)].a == i);
      CHECK(network.springs[static_cast<std::size_t>(i)].b == i + 1);
    }
    CHECK(static_cast<double>(network.rest_positions(2, 8)) == Approx(-1.0).epsilon(1e-6));
    CHECK(network.bends.back().vertex[2] == 8);
  }
}

TEST_CASE("append and weld carry triangle elements", "[cloth]") {
  SpringNetwork<double> one;
  one.rest_positions.resize(3, 3);
  one.rest_positions << 0, 1, 0, 0, 0, 1, 0, 0, 0;
  one.mass.setOnes(3);
  TriangleElement<double> element;
  element.vertex = {0, 1, 2};
  element.rest_inverse.setIdentity();
  element.warp = 5.0;
  one.elements = {element};
  SpringNetwork<double> network = one;
  CHECK(append(network, one, Vector3<double>(2, 0, 0)) == 3);
  REQUIRE(network.elements.size() == 2);
  CHECK(network.elements[1].vertex == std::array<int, 3>{3, 4, 5});
  CHECK(network.elements[1].warp == 5.0);
  CHECK(network.validate().empty());
  CHECK(weld(network, 4, 5) == "weld: vertices 4 and 5 share element 1");
  CHECK(weld(network, 1, 3).empty());
  CHECK(network.elements[0].vertex == std::array<int, 3>{0, 1, 2});
  CHECK(network.elements[1].vertex == std::array<int, 3>{1, 3, 4});
  CHECK(network.validate().empty());
}

TEST_CASE("weld refuses to fold a spring, a stencil or a triangle onto itself", "[cloth]") {
  const auto rope = rope_network(RopeSettings<double>{});
  const auto mesh = make_grid<double>(3, 3, 1.0, 1.0);
  REQUIRE(rope);
  REQUIRE(mesh);
  SpringNetwork<double> network = rope.value();
  CHECK(weld(network, 3, 4) == "weld: vertices 3 and 4 share spring 3");
  CHECK(weld(network, 3, 5) == "weld: vertices 3 and 5 share bending stencil 3");
  CHECK(weld(network, 3, 3) == "weld: vertices 3 and 3 are the same");
  CHECK(weld(network, 3, 21) == "weld: vertex 21 is off the mesh of 21 vertices");
  CHECK(weld(network, -1, 2) == "weld: vertex -1 is off the mesh of 21 vertices");
  CHECK(network.vertex_count() == 21);
  const auto sheet = sheet_network(mesh.value(), Material<double>{});
  REQUIRE(sheet);
  network = sheet.value();
  network.springs.clear();
  network.bends.clear();
  CHECK(weld(network, 0, 4) == "weld: vertices 0 and 4 share triangle 0");
}

TEMPLATE_TEST_CASE("the ball hangs from the rope's lower end", "[cloth]", float, double) {
  using S = TestType;
  RopeSettings<S> rope;
  const SolidSettings<S> solid;
  const auto made = rope_ball_network(rope, S(0.05), 3, solid);
  REQUIRE(made);
  const RopeBall<S>& hung = made.value();
  CHECK(hung.network.validate().empty());
  CHECK(hung.grip == 0);
  CHECK(hung.joint == 20);
  CHECK(hung.ball.size() == 63);
  CHECK(hung.network.vertex_count() == 20 + 63);
  CHECK(hung.ball.front() == hung.joint);
  const Vector3<S> centre(S(0), S(0), S(-0.55));
  const double near = std::is_same_v<S, float> ? 1e-6 : 1e-14;
  CHECK(static_cast<double>((hung.network.rest_positions.col(hung.centre) - centre).norm()) < near);
  for (int v : hung.ball)
    CHECK(static_cast<double>((hung.network.rest_positions.col(v) - centre).norm()) < 0.05 + near);
  CHECK(static_cast<double>(hung.network.rest_positions.col(hung.grip).norm()) == 0.0);
  const auto mesh = make_ball<S>(S(0.05), 3, Vector3<S>::Zero());
  const double mass =
      0.04 * 0.5 + 300.0 * static_cast<double>(tetrahedron_volumes(mesh.value()).sum());
  CHECK(static_cast<double>(hung.network.mass.sum()) == Approx(mass).epsilon(1e-5));
  // At rest and connected: rope springs end at the joint where the ball's springs begin.
  bool above = false, below = false;
  for (const Spring<S>& s : hung.network.springs) {
    const double length = static_cast<double>(
        (hung.network.rest_positions.col(s.a) - hung.network.rest_positions.col(s.b)).norm());
    CHECK(length == Approx(static_cast<double>(s.rest_length)).epsilon(1e-4));
    if (s.a == hung.joint || s.b == hung.joint)
      (std::min(s.a, s.b) < hung.joint ? above : below) = true;
  }
  CHECK(above);
  CHECK(below);
}

TEMPLATE_TEST_CASE("bad solids are refused with a message", "[cloth]", float, double) {
  using S = TestType;
  const auto mesh = make_box<S>(1, 1, 1, Vector3<S>::Ones());
  REQUIRE(mesh);
  SolidSettings<S> settings;
  settings.density = S(0);
  CHECK(solid_network(mesh.value(), settings).error() == "solid density must be positive, got 0");
  settings = SolidSettings<S>();
  settings.youngs_modulus = std::numeric_limits<S>::infinity();
  CHECK(solid_network(mesh.value(), settings).error() ==
        "solid youngs_modulus is not a finite number");
  settings = SolidSettings<S>();
  settings.damping_time = S(-1);
  CHECK(rope_ball_network(RopeSettings<S>{}, S(0.05), 2, settings).error() ==
        "solid damping_time must not be negative, got -1");
  settings = SolidSettings<S>();
  TetMesh<S> turned = mesh.value();
  std::swap(turned.tetrahedra[1][0], turned.tetrahedra[1][1]);
  CHECK(solid_network(turned, settings).error().find("tetrahedron 1 has no positive volume") == 0);
  CHECK(rope_ball_network(RopeSettings<S>{}, S(0), 2, settings).error() ==
        "ball radius must be positive, got 0");
  RopeSettings<S> rope;
  rope.segments = -1;
  CHECK(rope_ball_network(rope, S(0.05), 2, settings).error() ==
        "rope needs at least 1 segment, got -1");
}
