#include "clothctl/mesh/pattern_mesh.hpp"

#include <limits>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

PatternMesh square() {
  PatternMesh mesh;
  mesh.positions.resize(3, 4);
  mesh.positions << 0, 2, 2, 0, 0, 0, 2, 2, 5, 5, 5, 5;
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  mesh.pattern.resize(2, 4);
  mesh.pattern << 0, 1, 1, 0, 0, 0, 1, 1;
  mesh.pattern_triangles = mesh.triangles;
  return mesh;
}

}  // namespace

TEST_CASE("a mesh with or without a pattern is valid; areas are those of the pattern", "[mesh]") {
  PatternMesh mesh = square();
  CHECK(mesh.validate().empty());
  CHECK(mesh.pattern_area(0) == Approx(0.5));
  std::swap(mesh.pattern_triangles[0][0], mesh.pattern_triangles[0][1]);
  CHECK(mesh.pattern_area(0) == Approx(-0.5));
  mesh.pattern_triangles.clear();
  CHECK_FALSE(mesh.has_pattern());
  CHECK(mesh.validate().empty());
}

TEST_CASE("faults of a mesh are named", "[mesh]") {
  CHECK(PatternMesh().validate() == "mesh is empty");
  PatternMesh mesh = square();
  mesh.positions(2, 3) = std::numeric_limits<double>::infinity();
  CHECK(mesh.validate() == "vertex 3 is not finite");
  mesh = square();
  mesh.triangles[1][2] = 4;
  CHECK(mesh.validate() == "triangle 1 holds vertex 4 of 4");
  mesh = square();
  mesh.pattern_triangles[0][1] = -1;
  CHECK(mesh.validate() == "triangle 0 holds pattern point -1 of 4");
  mesh = square();
  mesh.pattern(0, 2) = std::numeric_limits<double>::quiet_NaN();
  CHECK(mesh.validate() == "pattern point 2 is not finite");
  mesh = square();
  mesh.pattern_triangles.pop_back();
  CHECK(mesh.validate() == "pattern has 1 triangles, the mesh 2");
}
