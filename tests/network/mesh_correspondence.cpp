// Where a changed mesh lies in the old one: by hand on a rectangle and a grid, and against
// positions on random meshes.

#include "clothctl/network/detail/mesh_correspondence.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::uniform;

namespace {

/// A network, a change of its mesh, and the correspondence between the two.
template <class Scalar>
struct Changed {
  SpringNetwork<Scalar> network;
  Topology before, after;
  MeshChange<Scalar> change;
  std::optional<detail::OldNetwork<Scalar>> old;
  std::optional<detail::MeshCorrespondence<Scalar>> mesh;

  /// `edit` changes the mesh by a `MeshEditor`.
  template <class Edit>
  Changed(const Points<Scalar>& x, std::vector<std::array<int, 3>> triangles, Edit edit) {
    auto editor = MeshEditor<Scalar>::create(x, triangles).value();
    edit(editor);
    network.rest_positions = x;
    network.mass = VectorX<Scalar>::Ones(x.cols());
    network.triangles = std::move(triangles);
    change = editor.change();
    before = make_topology(x.cols(), network.triangles).value();
    after = make_topology(change.remap.vertex_count(), change.triangles).value();
    old.emplace(network, before);
    mesh.emplace(*old, change, after);
  }
  Changed(const Changed&) = delete;

  /// Returns the index of the edge a-b of the changed mesh.
  std::size_t edge(int a, int b) const {
    for (std::size_t e = 0; e < after.edges.size(); ++e) {
      if (after.edges[e].a == a && after.edges[e].b == b) return e;
    }
    FAIL("no edge " << a << "-" << b);
    return 0;
  }
  /// Returns the copy of vertex 5 that is joined to `vertex`.
  int copy_at(int vertex) const {
    for (const int copy : change.remap.copies(5)) {
      const auto around = after.neighbours(vertex);
      if (std::find(around.begin(), around.end(), copy) != around.end()) return copy;
    }
    return -1;
  }
};

/// A rectangle of 4 m × 3 m: the triangles 0 1 2 and 0 2 3, counter-clockwise.
template <class Scalar, class Edit>
Changed<Scalar> rectangle(Edit edit) {
  Points<Scalar> x(3, 4);
  x << Scalar(0), Scalar(4), Scalar(4), Scalar(0),  //
      Scalar(0), Scalar(0), Scalar(3), Scalar(3),   //
      Scalar(0), Scalar(0), Scalar(0), Scalar(0);
  return Changed<Scalar>(x, {{0, 1, 2}, {0, 2, 3}}, edit);
}

/// The vertices 0 to 8 in three rows of three, with diagonals from 4 to all corners.
template <class Edit>
Changed<double> grid(Edit edit) {
  const GridMesh<double> mesh = make_grid<double>(3, 3, 2.0, 2.0).value();
  return Changed<double>(mesh.positions, mesh.triangles, edit);
}

using Rows = std::vector<std::array<int, 3>>;

}  // namespace

TEMPLATE_TEST_CASE("sides of a divided triangle lie on its edges or inside it", "[network]", float,
                   double) {
  using Scalar = TestType;
  const auto changed = rectangle<Scalar>(
      [](auto& editor) { CHECK(editor.insert_on_edge(1, 2, Scalar(0.25)).value() == 4); });
  const auto& mesh = *changed.mesh;
  const auto side = [&](int a, int b, int parent) {
    for (const auto& s : mesh.sides(changed.edge(a, b))) {
      if (s.triangle >= 0 && mesh.parent(s.triangle) == parent) return s;
    }
    FAIL("no side");
    return mesh.sides(0)[0];
  };
  // The edge 1-2 of 3 m has become 1-4 and 2-4, of which the second runs against it.
  CHECK(side(1, 4, 0).old_edge == changed.old->find_edge(1, 2));
  CHECK(side(1, 4, 0).length == Approx(0.75));
  CHECK(side(1, 4, 0).forward);
  CHECK_FALSE(side(1, 4, 0).undivided);
  CHECK(side(2, 4, 0).old_edge == changed.old->find_edge(1, 2));
  CHECK(side(2, 4, 0).length == Approx(2.25));
  CHECK_FALSE(side(2, 4, 0).forward);
  CHECK_FALSE(side(2, 4, 0).undivided);
  // 0-4 is new and has a side in each part of the triangle.
  for (const auto& s : mesh.sides(changed.edge(0, 4))) {
    CHECK(s.old_edge == -1);
    CHECK_FALSE(s.undivided);
    CHECK(mesh.parent(s.triangle) == 0);
    CHECK(s.length == Approx(std::hypot(4.0, 0.75)));
  }
  // The diagonal is undivided, but only the side in the second triangle is that of a whole one.
  for (const int parent : {0, 1}) {
    CHECK(side(0, 2, parent).undivided);
    CHECK(side(0, 2, parent).forward);
    CHECK(side(0, 2, parent).length == Approx(5));
    CHECK(mesh.whole(side(0, 2, parent).triangle) == (parent == 1));
  }
  CHECK(mesh.sides(changed.edge(0, 3))[1].triangle == -1);
  const auto kept = [&](int a, int b) { return mesh.kept(changed.edge(a, b)); };
  CHECK((kept(0, 3) && kept(2, 3)));
  CHECK_FALSE((kept(0, 1) || kept(0, 2) || kept(0, 4) || kept(1, 4) || kept(2, 4)));
  // Areas and angles of the parts, 0 1 4 and 0 4 2.
  const int lower = side(1, 4, 0).triangle, upper = side(2, 4, 0).triangle;
  CHECK(mesh.area(lower) == Approx(1.5));
  CHECK(mesh.area(upper) == Approx(4.5));
  CHECK(mesh.area(side(0, 3, 1).triangle) == Approx(6));
  CHECK(mesh.cotangent(lower, 0) == Approx(4 / 0.75));
  CHECK(mesh.cotangent(lower, 1) == Approx(0).margin(1e-6));
  CHECK(mesh.cotangent(lower, 4) == Approx(0.75 / 4));
  CHECK(mesh.cotangent(upper, 4) == Approx(-0.75 / 4));  // obtuse
  // Rows end at the divided edge, and the hinge is gone with its triangle.
  CHECK(mesh.rows_through(1, 0, 3) == Rows{{1, 0, 3}});
  CHECK(mesh.rows_through(3, 0, 1) == Rows{{3, 0, 1}});
  CHECK(mesh.rows_through(0, 1, 2).empty());
  CHECK_FALSE(mesh.living_hinge(changed.old->find_edge(0, 2)).has_value());
}

TEST_CASE("a part without area up to rounding has no angles", "[network]") {
  for (const double thin : {1e-300, 1e-30, 1e-17, 1e-12, 1e-3}) {
    const auto changed = rectangle<double>([thin](auto& editor) {
      CHECK(editor.insert_in_triangle(0, {1.0, thin, 1.0}));
    });
    const auto& mesh = *changed.mesh;
    int flat = 0;
    for (int t = 0; t < 4; ++t) {  // 4 lies beside the middle of the diagonal 0-2
      const bool on_diagonal = mesh.parent(t) == 0 && mesh.area(t) < 0.1;
      CHECK(mesh.has_area(t) == (!on_diagonal || thin > 1e-15));
      if (mesh.has_area(t)) continue;
      ++flat;
      for (const int v : mesh.triangle(t)) CHECK(mesh.cotangent(t, v) == 0);
    }
    CHECK(flat == (thin < 1e-15 ? 1 : 0));
  }
}

TEST_CASE("in a mesh that does not change each edge lies on itself", "[network]") {
  const auto same = grid([](auto&) {});
  const auto& mesh = *same.mesh;
  for (std::size_t e = 0; e < same.after.edges.size(); ++e) {
    const MeshEdge& edge = same.after.edges[e];
    CHECK(mesh.kept(e));
    for (const auto& side : mesh.sides(e)) {
      if (side.triangle < 0) continue;
      CHECK(side.old_edge == static_cast<int>(e));
      CHECK((side.undivided && side.forward));
    }
    const auto hinge = mesh.living_hinge(static_cast<int>(e));
    REQUIRE(hinge.has_value() == !edge.is_boundary());
    if (hinge) CHECK(*hinge == edge.opposite);
    for (int v = 0; v < 9; ++v) CHECK(mesh.kept_vertex(e, v) == v);
  }
  CHECK(mesh.rows_through(3, 4, 5) == Rows{{3, 4, 5}});
}

TEST_CASE("an opened edge has a row on each side, a hinge on none", "[network]") {
  const auto slit = grid([](auto& editor) {
    CHECK(editor.mark(4, 5));
    CHECK(editor.open_marked() == 1);  // 5 is doubled, the tip 4 is not
  });
  const auto& mesh = *slit.mesh;
  // The rows along the slit share its tip.
  const Rows rows = mesh.rows_through(3, 4, 5);
  REQUIRE(rows.size() == 2);
  CHECK((rows[0][0] == 3 && rows[0][1] == 4 && rows[1][0] == 3 && rows[1][1] == 4));
  CHECK(rows[0][2] + rows[1][2] == 5 + 9);
  CHECK(rows[0][2] != rows[1][2]);
  for (const auto& row : rows) CHECK(mesh.share(rows, row) == 0.5);
  CHECK(mesh.rows_through(1, 4, 7) == Rows{{1, 4, 7}});
  CHECK(mesh.rows_through(2, 5, 8).empty());  // 2 and 8 are at different copies of 5
  // No hinge is left at the slit; the one over 2-4 has the copy of 5 that lies on its side.
  CHECK_FALSE(mesh.living_hinge(slit.old->find_edge(4, 5)).has_value());
  CHECK_FALSE(mesh.living_hinge(slit.old->find_edge(0, 1)).has_value());  // border
  for (const auto& [spoke, beside] : {std::array<int, 2>{2, 1}, std::array<int, 2>{8, 7}}) {
    const int copy = slit.copy_at(spoke);
    auto ends = mesh.living_hinge(slit.old->find_edge(spoke, 4)).value();
    std::sort(ends.begin(), ends.end());
    CHECK(ends == std::array<int, 2>{(std::min)(beside, copy), (std::max)(beside, copy)});
    const std::size_t border = slit.edge(4, copy);
    CHECK(slit.after.edges[border].is_boundary());
    CHECK_FALSE(mesh.kept(border));
    CHECK(mesh.kept_vertex(border, 5) == copy);
    CHECK(mesh.kept_vertex(border, 0) == 0);
  }

  const auto halves = grid([](auto& editor) {
    CHECK((editor.mark(3, 4) && editor.mark(4, 5)));
    CHECK(editor.open_marked() == 3);
  });
  const Rows both = halves.mesh->rows_through(3, 4, 5);
  REQUIRE(both.size() == 2);
  CHECK(both[0][1] != both[1][1]);
  for (const auto& row : both) CHECK(halves.mesh->share(both, row) == 1.0);
  CHECK(halves.mesh->rows_through(1, 4, 7).empty());
}

TEST_CASE("on random meshes sides lie where the positions say", "[network]") {
  std::mt19937 random(31);
  int divided = 0, living = 0, gone = 0;
  for (int trial = 0; trial < clothctl_test::trials(60, 2000); ++trial) {
    const auto plain = clothctl_test::irregular_mesh(5, 5, random, trial % 2 == 0 ? 0.0 : 0.2);
    const Changed<double> changed(plain.positions, plain.triangles, [&](auto& editor) {
      for (int i = 0; i < 6; ++i) {
        const auto t = editor.triangles()[random() % editor.triangles().size()];
        if (i % 3 == 0) editor.mark(t[0], t[1]);
        if (i % 3 == 1) CHECK(editor.insert_on_edge(t[1], t[2], uniform(random, 0.2, 0.8)));
        if (i % 3 == 2) editor.mark_across(t[2], {uniform(random, -1, 1), 0, 0.3});
      }
      editor.open_marked();
    });
    const auto& mesh = *changed.mesh;
    const Points<double> x = changed.change.remap.interpolate(plain.positions);
    for (std::size_t e = 0; e < changed.after.edges.size(); ++e) {
      const MeshEdge& edge = changed.after.edges[e];
      for (const auto& side : mesh.sides(e)) {
        if (side.triangle < 0) continue;
        const Vector3<double> a = x.col(edge.a), b = x.col(edge.b);
        CHECK(side.length == Approx((b - a).norm()));
        // The old edge on which both ends lie, by distance.
        int found = -1;
        const auto& corner = mesh.parent_corners(side.triangle);
        for (std::size_t k = 0; k < 3; ++k) {
          const int old_edge = changed.old->find_edge(corner[k], corner[(k + 1) % 3]);
          const MeshEdge& other = changed.before.edges[static_cast<std::size_t>(old_edge)];
          const Vector3<double> p = plain.positions.col(other.a), q = plain.positions.col(other.b);
          const Vector3<double> u = (q - p).normalized();
          if ((a - p).cross(u).norm() > 1e-9 || (b - p).cross(u).norm() > 1e-9) continue;
          found = old_edge;
          CHECK(side.forward == ((b - a).dot(u) > 0));
          CHECK(side.undivided == (std::abs((b - a).norm() - (q - p).norm()) < 1e-9));
        }
        CHECK(side.old_edge == found);
        if (found >= 0 && !side.undivided) ++divided;
      }
    }
    double area = 0;
    for (int t = 0; t < static_cast<int>(changed.change.triangles.size()); ++t)
      area += mesh.area(t);
    CHECK(area == Approx(clothctl_test::total_area(plain.positions, plain.triangles)));
    // A hinge lives if and only if an edge of the new mesh lies between its two whole triangles.
    for (std::size_t e = 0; e < changed.before.edges.size(); ++e) {
      const MeshEdge& old_edge = changed.before.edges[e];
      if (old_edge.is_boundary()) continue;
      std::optional<std::array<int, 2>> expected;
      for (const MeshEdge& edge : changed.after.edges) {
        if (edge.is_boundary()) continue;
        const auto [s, t] = edge.triangle;
        if (!mesh.whole(s) || !mesh.whole(t)) continue;
        if (mesh.parent(s) == old_edge.triangle[0] && mesh.parent(t) == old_edge.triangle[1])
          expected = edge.opposite;
        if (mesh.parent(t) == old_edge.triangle[0] && mesh.parent(s) == old_edge.triangle[1])
          expected = {edge.opposite[1], edge.opposite[0]};
      }
      CHECK(mesh.living_hinge(static_cast<int>(e)) == expected);
      ++(expected ? living : gone);
    }
  }
  CHECK(divided > 100);
  CHECK(living > 100);
  CHECK(gone > 100);
}
