#include "clothctl/network/triangle_elements.hpp"

#include <cmath>
#include <limits>
#include <string>

#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Network = SpringNetwork<double>;
using Stiffness = MembraneStiffness<double>;

const double kNan = std::numeric_limits<double>::quiet_NaN();
const double kInfinity = std::numeric_limits<double>::infinity();

Network sheet() {
  return sheet_network<double>(make_grid<double>(4, 5, 0.5, 0.3).value(), Material<double>())
      .value();
}

// Coordinates of the grid in its own plane.
MaterialPoints<double> coordinates(const Network& network) {
  MaterialPoints<double> out(2, network.vertex_count());
  const Vector3<double> origin = network.rest_positions.col(0);
  const Vector3<double> along = (network.rest_positions.col(1) - origin).normalized();
  const Vector3<double> up = (network.rest_positions.col(5) - origin).normalized();
  for (Index v = 0; v < out.cols(); ++v) {
    const Vector3<double> d = network.rest_positions.col(v) - origin;
    out(0, v) = along.dot(d);
    out(1, v) = up.dot(d);
  }
  return out;
}

double area_of(const Network& network) {
  double sum = 0;
  for (const auto& e : network.elements) sum += e.rest_area();
  return sum;
}

}  // namespace

TEST_CASE("elements take their rest shape from coordinates or from the sheet", "[network]") {
  const Network plain = sheet();
  const Stiffness stiffness{1, 2, 3, 4};
  auto flat = add_flat_triangle_elements<double>(plain, coordinates(plain), stiffness);
  INFO((flat ? std::string() : flat.error()));
  REQUIRE(flat);
  REQUIRE(flat->elements.size() == plain.triangles.size());
  CHECK(area_of(*flat) == Approx(0.15));
  CHECK(flat->springs.size() == plain.springs.size());
  const Vector3<double> warp = plain.rest_positions.col(1) - plain.rest_positions.col(0);
  const auto placed = add_triangle_elements<double>(plain, Vector3<double>(5 * warp), stiffness);
  REQUIRE(placed);
  for (std::size_t e = 0; e < flat->elements.size(); ++e) {
    const auto &a = flat->elements[e], &b = placed->elements[e];
    CHECK(a.vertex == plain.triangles[e]);
    CHECK(b.vertex == a.vertex);
    CHECK((a.rest_inverse - b.rest_inverse).norm() < 1e-12 * a.rest_inverse.norm());
    CHECK((b.warp == 1 && b.weft == 2 && b.shear == 3 && b.area == 4));
  }
  const auto low = flat->cast<float>();
  REQUIRE(low.elements.size() == flat->elements.size());
  CHECK(low.validate().empty());
  CHECK(low.elements[3].rest_area() == Approx(flat->elements[3].rest_area()));
  CHECK(low.elements[3].weft == 2.0f);
}

TEST_CASE("on a curved sheet each triangle has its own shape", "[network]") {
  Network network = sheet();
  double area = 0;
  for (Index v = 0; v < network.vertex_count(); ++v) {
    const double x = network.rest_positions(0, v);
    network.rest_positions.col(v) += Vector3<double>(0, x * x, 0.3 * std::sin(5 * x));
  }
  for (const auto& t : network.triangles) {
    const Vector3<double> a = network.rest_positions.col(t[1]) - network.rest_positions.col(t[0]);
    const Vector3<double> b = network.rest_positions.col(t[2]) - network.rest_positions.col(t[0]);
    area += 0.5 * a.cross(b).norm();
  }
  const auto made =
      add_triangle_elements<double>(network, Vector3<double>(1, 0.1, 0.2), Stiffness{1, 1, 1, 1});
  REQUIRE(made);
  CHECK(area_of(*made) == Approx(area));
  for (const auto& e : made->elements) {  // B times the edges in the plane has the right lengths
    const DenseMatrix<double, 2, 2> rest = e.rest_inverse.inverse();
    for (Index c = 0; c < 2; ++c) {
      const int other = e.vertex[static_cast<std::size_t>(c) + 1];
      const Vector3<double> edge =
          network.rest_positions.col(other) - network.rest_positions.col(e.vertex[0]);
      CHECK(rest.col(c).norm() == Approx(edge.norm()));
    }
  }
}

TEST_CASE("bad elements are refused by name", "[network]") {
  const Network plain = sheet();
  const MaterialPoints<double> flat = coordinates(plain);
  const Stiffness good{1, 1, 1, 1};
  const auto with = [&](const MaterialPoints<double>& at, const Stiffness& stiffness) {
    const auto made = add_flat_triangle_elements<double>(plain, at, stiffness);
    return made ? std::string() : made.error();
  };
  CHECK(with(flat, good).empty());
  CHECK(with(flat, {-1, 1, 1, 1}) ==
        "triangle element 0 has a negative or non-finite warp stiffness: -1 N/m");
  CHECK(with(flat, {1, kNan, 1, 1}) ==
        "triangle element 0 has a negative or non-finite weft stiffness: nan N/m");
  CHECK(with(flat, {1, 1, kInfinity, 1}) ==
        "triangle element 0 has a negative or non-finite shear stiffness: inf N/m");
  CHECK(with(flat, {1, 1, 1, -kInfinity}) ==
        "triangle element 0 has a negative or non-finite area stiffness: -inf N/m");
  CHECK(with(flat.leftCols(3), good) == "3 material coordinates for 20 vertices");
  MaterialPoints<double> bad = flat;
  bad(1, 7) = kNan;
  CHECK(with(bad, good) == "material coordinate of vertex 7: weft is nan");
  bad = flat;
  bad.row(0) *= -1;
  CHECK(with(bad, good).find("triangle 0 is degenerate or inverted at rest: area -") == 0);
  CHECK(with(MaterialPoints<double>::Zero(2, 20), good) ==
        "triangle 0 is degenerate or inverted at rest: area 0 m²");
  const auto along = [&](const Vector3<double>& warp) {
    const auto made = add_triangle_elements<double>(plain, warp, good);
    return made ? std::string() : made.error();
  };
  const Vector3<double> a = plain.rest_positions.col(1) - plain.rest_positions.col(0);
  const Vector3<double> b = plain.rest_positions.col(5) - plain.rest_positions.col(0);
  CHECK(along(a.cross(b)) == "the warp direction is normal to triangle 0");
  CHECK(along({0, 0, 0}) == "the warp direction is zero");
  for (const double size : {1e-300, 1e-5, 1e300}) {
    CHECK(along({size, 0, 0}).empty());
    CHECK(along(a.cross(b).normalized() * size) == "the warp direction is normal to triangle 0");
  }
  CHECK(along({kNan, 0, 0}) == "the warp direction is not finite");
  // One triangle normal to the direction, or without area, among others that are neither.
  const std::array<int, 3> first = plain.triangles[0], last = plain.triangles.back();
  Network tilted = plain;
  tilted.rest_positions.row(1).setLinSpaced(0, 0.1);  // no triangle is normal to the third axis
  const auto made_along = [&](const Vector3<double>& warp) {
    const auto out = add_triangle_elements<double>(tilted, warp, good);
    return out ? std::string() : out.error();
  };
  const auto normal = [&](const std::array<int, 3>& t) {
    const Vector3<double> o = tilted.rest_positions.col(t[0]);
    return Vector3<double>((tilted.rest_positions.col(t[1]) - o)
                               .cross(Vector3<double>(tilted.rest_positions.col(t[2]) - o)));
  };
  CHECK(made_along(a).empty());
  tilted.rest_positions.col(last[0])[1] += 0.3;  // the last triangle lies in no other's plane
  const std::string name = std::to_string(plain.triangles.size() - 1);
  CHECK(made_along(normal(last)) == "the warp direction is normal to triangle " + name);
  CHECK(made_along(1e9 * normal(last)) == "the warp direction is normal to triangle " + name);
  CHECK(made_along(a).empty());
  tilted.rest_positions.col(first[0]) =
      0.5 * (tilted.rest_positions.col(first[1]) + tilted.rest_positions.col(first[2]));
  CHECK(made_along(a).find("triangle 0 is degenerate or inverted at rest: area ") == 0);
  tilted.rest_positions.col(first[0]) = tilted.rest_positions.col(first[1]);
  CHECK(made_along(a) == "triangle 0 is degenerate or inverted at rest: area 0 m²");
  Network bare = plain;
  bare.triangles.clear();
  const auto none = add_triangle_elements<double>(bare, a, good);
  CHECK(none.error() == "the network has no triangles to make elements of");

  Network made = add_flat_triangle_elements<double>(plain, flat, good).value();
  const auto spoilt = [&](auto change) {
    Network network = made;
    change(network.elements[2]);
    return network.validate();
  };
  using Element = TriangleElement<double>;
  CHECK(spoilt([](Element& e) { e.vertex[1] = 20; }) ==
        "triangle element 2 holds vertex 20 off the mesh");
  CHECK(spoilt([](Element& e) { e.vertex[1] = -3; }) ==
        "triangle element 2 holds vertex -3 off the mesh");
  CHECK(spoilt([](Element& e) {
          e.vertex = {4, 7, 4};
        }) == "triangle element 2 holds vertex 4 twice");
  CHECK(spoilt([](Element& e) { e.rest_inverse.setZero(); }) ==
        "triangle element 2 has a degenerate or inverted rest shape");
  CHECK(spoilt([](Element& e) { e.rest_inverse.row(0) *= -1; }) ==
        "triangle element 2 has a degenerate or inverted rest shape");
  CHECK(spoilt([](Element& e) { e.rest_inverse(0, 1) = kInfinity; }) ==
        "triangle element 2 has a degenerate or inverted rest shape");
}

TEST_CASE("the rest shape of an element is set or refused as a whole", "[network]") {
  TriangleElement<double> element;
  const auto set = [&](double a, double b, double c, double d) {
    DenseMatrix<double, 2, 2> edges;
    edges << a, b, c, d;
    return element.set_rest(edges);
  };
  CHECK(set(2, 0, 0, 3));
  CHECK(element.rest_area() == Approx(3.0));
  const DenseMatrix<double, 2, 2> before = element.rest_inverse;
  CHECK_FALSE(set(1, 2, 1, 2));
  CHECK_FALSE(set(0, 1, 1, 0));
  CHECK_FALSE(set(0, 0, 0, 0));
  CHECK_FALSE(set(kNan, 0, 0, 1));
  CHECK_FALSE(set(kInfinity, 0, 0, 1));
  CHECK_FALSE(set(1e300, 0, 0, 1e300));
  CHECK_FALSE(set(1e-300, 0, 0, 1e-300));
  CHECK(element.rest_inverse == before);
  CHECK(set(1e-6, 0, 0, 1e-6));
}

TEST_CASE("moduli of an isotropic sheet are those of plane stress", "[network]") {
  const double tensile = 50, poisson = 0.3;
  const auto k = MembraneStiffness<double>::isotropic(tensile, poisson);
  const double eu = 0.01, ev = -poisson * eu;  // uniaxial
  CHECK(k.warp * eu + k.area * (eu + ev) == Approx(tensile * eu));
  CHECK(std::abs(k.weft * ev + k.area * (eu + ev)) < 1e-12);
  CHECK(k.shear == Approx(tensile / (2 * (1 + poisson))));
}
