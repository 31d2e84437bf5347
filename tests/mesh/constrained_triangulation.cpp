#include "clothctl/mesh/detail/constrained_triangulation.hpp"

#include <random>

#include "support/catch.hpp"

using namespace clothctl;
using detail::ConstrainedTriangulation;
using detail::Face;
using detail::InsertOutcome;
using detail::LatticePoint;

namespace {

/// Checks neighbours and orientation of all faces, and Euler's formula.
void check_structure(const ConstrainedTriangulation& mesh) {
  const auto& faces = mesh.faces();
  // Three far corners on the hull: F = 2 V - 2 - 3.
  REQUIRE(faces.size() == 2 * mesh.points().size() - 5);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const Face& face = faces[f];
    REQUIRE(detail::orientation(mesh.point(face.vertex[0]), mesh.point(face.vertex[1]),
                                mesh.point(face.vertex[2])) > 0);
    for (std::size_t i = 0; i < 3; ++i) {
      if (face.next[i] < 0) {
        REQUIRE(face.vertex[(i + 1) % 3] < 3);
        REQUIRE(face.vertex[(i + 2) % 3] < 3);
        continue;
      }
      const Face& other = faces[static_cast<std::size_t>(face.next[i])];
      const std::size_t j = other.side(static_cast<int>(f));
      REQUIRE(other.next[j] == static_cast<int>(f));
      REQUIRE(other.vertex[(j + 1) % 3] == face.vertex[(i + 2) % 3]);
      REQUIRE(other.vertex[(j + 2) % 3] == face.vertex[(i + 1) % 3]);
      REQUIRE(other.fixed[j] == face.fixed[i]);
    }
    for (const int v : face.vertex) {
      const auto [at, i] = mesh.find_edge(v, face.vertex[(face.corner(v) + 1) % 3]);
      REQUIRE(at == static_cast<int>(f));
    }
  }
}

/// Returns the number of vertices inside the circle of a face (by brute force).
int inside_circle(const ConstrainedTriangulation& mesh, const Face& f) {
  int count = 0;
  for (const LatticePoint& p : mesh.points())
    count += detail::in_circle(mesh.point(f.vertex[0]), mesh.point(f.vertex[1]),
                               mesh.point(f.vertex[2]), p) > 0
                 ? 1
                 : 0;
  return count;
}

LatticePoint draw(std::mt19937_64& engine, std::int64_t limit) {
  const auto one = [&] {
    return static_cast<std::int64_t>(engine() % static_cast<std::uint64_t>(2 * limit + 1)) - limit;
  };
  const std::int64_t x = one();
  return {x, one()};
}

}  // namespace

TEST_CASE("inserted points are triangulated with empty circles", "[mesh]") {
  std::mt19937_64 engine(7);
  // A small lattice makes many points cocircular, collinear or equal.
  for (const std::int64_t limit : {ConstrainedTriangulation::kExtent, std::int64_t(6)}) {
    ConstrainedTriangulation mesh;
    for (int i = 0; i < 120; ++i) {
      const LatticePoint p = draw(engine, limit);
      bool there = false;
      for (std::size_t v = 3; v < mesh.points().size(); ++v) there = there || mesh.points()[v] == p;
      CHECK(mesh.insert(p) == (there ? InsertOutcome::Coincides : InsertOutcome::Inserted));
    }
    check_structure(mesh);
    for (const Face& f : mesh.faces()) CHECK(inside_circle(mesh, f) == 0);
  }
}

TEST_CASE("edges are forced, stay, and the rest is Delaunay within them", "[mesh]") {
  std::mt19937_64 engine(8);
  for (int trial = 0; trial < 20; ++trial) {
    ConstrainedTriangulation mesh;
    for (int i = 0; i < 60; ++i) {
      if (mesh.insert(draw(engine, 100000)) != InsertOutcome::Inserted) continue;
    }
    int forced = 0;
    std::vector<std::array<int, 2>> edges;
    for (int i = 0; i < 12; ++i) {
      const int count = static_cast<int>(mesh.points().size()) - 3;
      const int a = 3 + static_cast<int>(engine() % static_cast<std::uint64_t>(count)),
                b = 3 + static_cast<int>(engine() % static_cast<std::uint64_t>(count));
      if (a == b) continue;
      const bool was_there = mesh.find_edge(a, b).first >= 0;
      if (mesh.constrain(a, b) != InsertOutcome::Inserted) continue;
      forced += was_there ? 0 : 1;
      edges.push_back({a, b});
      check_structure(mesh);
    }
    CHECK(forced > 0);
    for (const auto& e : edges) {
      const auto [f, i] = mesh.find_edge(e[0], e[1]);
      REQUIRE(f >= 0);
      CHECK(mesh.faces()[static_cast<std::size_t>(f)].fixed[i]);
    }
    for (const Face& f : mesh.faces()) {
      for (std::size_t i = 0; i < 3; ++i) {
        if (f.fixed[i] || f.next[i] < 0) continue;
        const Face& g = mesh.faces()[static_cast<std::size_t>(f.next[i])];
        const int self = static_cast<int>(&f - mesh.faces().data());
        CHECK(detail::in_circle(mesh.point(f.vertex[0]), mesh.point(f.vertex[1]),
                                mesh.point(f.vertex[2]), mesh.point(g.vertex[g.side(self)])) <= 0);
      }
    }
  }
}

TEST_CASE("edges that cross an edge or meet a vertex are refused", "[mesh]") {
  ConstrainedTriangulation mesh;
  for (const LatticePoint& p : {LatticePoint{0, 0}, {10, 0}, {10, 10}, {0, 10}, {20, 0}})
    REQUIRE(mesh.insert(p) == InsertOutcome::Inserted);
  CHECK(mesh.constrain(3, 5) == InsertOutcome::Inserted);
  CHECK(mesh.constrain(4, 6) == InsertOutcome::Crosses);
  CHECK(mesh.constrain(3, 7) == InsertOutcome::Touches);
  CHECK(mesh.insert({5, 5}) == InsertOutcome::Coincides);
  check_structure(mesh);
}

TEST_CASE("faces behind an odd number of edges are inside, and pieces are counted", "[mesh]") {
  ConstrainedTriangulation mesh;
  const auto ring = [&](std::int64_t x, std::int64_t r) {
    const int first = static_cast<int>(mesh.points().size());
    for (const LatticePoint& p : {LatticePoint{x - r, -r}, {x + r, -r}, {x + r, r}, {x - r, r}})
      REQUIRE(mesh.insert(p) == InsertOutcome::Inserted);
    for (int i = 0; i < 4; ++i)
      REQUIRE(mesh.constrain(first + i, first + (i + 1) % 4) == InsertOutcome::Inserted);
  };
  const auto doubled_area = [&] {
    std::int64_t sum = 0;
    for (const Face& f : mesh.faces()) {
      if (f.inside)
        sum += detail::orientation(mesh.point(f.vertex[0]), mesh.point(f.vertex[1]),
                                   mesh.point(f.vertex[2]));
    }
    return sum;
  };
  ring(0, 100);
  CHECK(mesh.classify() == 1);
  CHECK(doubled_area() == 2 * 200 * 200);
  ring(0, 50);
  CHECK(mesh.classify() == 1);
  CHECK(doubled_area() == 2 * (200 * 200 - 100 * 100));
  ring(0, 10);
  CHECK(mesh.classify() == 2);
  ring(300, 20);
  CHECK(mesh.classify() == 3);
  CHECK(doubled_area() == 2 * (200 * 200 - 100 * 100 + 20 * 20 + 40 * 40));
}
