// Meshes, hulls and grids: the laws, distances and signs against all triangles in long double, what
// a hull must satisfy, the stated error of a grid, and what is refused.

#include "clothctl/collision/mesh_collider.hpp"

#include <cmath>
#include <limits>
#include <random>
#include <string>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/math/rotation.hpp"
#include "laws/collider_laws.hpp"
#include "support/catch.hpp"
#include "support/solids.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::box_mesh;
using clothctl_test::brute_distance;
using clothctl_test::exact_laws;
using clothctl_test::icosphere;
using clothctl_test::PlainMesh;
using clothctl_test::torus_mesh;
using clothctl_test::uniform;
using clothctl_test::law_detail::one_closest;
using clothctl_test::law_detail::one_distance;

static_assert(Collider<MeshCollider<float>, float> && Collider<HullCollider<double>> &&
              Collider<GridCollider<double>>);

namespace {

template <class S>
MeshCollider<S> mesh_collider(const PlainMesh& mesh) {
  const Points<S> x = mesh.positions.cast<S>();
  return MeshCollider<S>::create(x, mesh.triangles).value();
}

template <class S>
HullCollider<S> hull_collider(const Points<double>& points) {
  const Points<S> x = points.cast<S>();
  return HullCollider<S>::create(x).value();
}

/// Returns random points in the box of a mesh, grown by a fifth; every third is close to a vertex
/// or the middle of an edge, where the sign is difficult.
Points<double> difficult_points(const PlainMesh& mesh, int count, std::mt19937& random) {
  const Vector3<double> low = mesh.positions.rowwise().minCoeff();
  const Vector3<double> size = mesh.positions.rowwise().maxCoeff() - low;
  Points<double> x(3, count);
  for (Index i = 0; i < count; ++i) {
    for (int c = 0; c < 3; ++c) x(c, i) = low[c] + uniform(random, -0.2, 1.2) * size[c];
    if (i % 3 != 0) continue;
    const auto& t = mesh.triangles[random() % mesh.triangles.size()];
    const double share = i % 2 == 0 ? 0.0 : 0.5;
    x.col(i) = (1 - share) * mesh.positions.col(t[0]) + share * mesh.positions.col(t[1]);
    const double off = std::pow(10.0, uniform(random, -9, -2)) * size.norm();
    for (int c = 0; c < 3; ++c) x(c, i) += off * uniform(random, -1, 1);
  }
  return x;
}

struct Errors {
  double distance = 0;
  int wrong_signs = 0;
};

template <class S>
Errors compare(const PlainMesh& mesh, int count) {
  const auto collider = mesh_collider<S>(mesh);
  // The oracle sees the vertices that the collider has.
  PlainMesh rounded = mesh;
  rounded.positions = mesh.positions.cast<S>().template cast<double>();
  std::mt19937 random(31);
  const Points<double> x = difficult_points(mesh, count, random);
  Errors errors;
  const double size =
      (mesh.positions.rowwise().maxCoeff() - mesh.positions.rowwise().minCoeff()).norm();
  for (Index i = 0; i < x.cols(); ++i) {
    const Vector3<S> at = x.col(i).cast<S>();
    const double exact = static_cast<double>(brute_distance(rounded, at.template cast<double>()));
    const double found = static_cast<double>(one_distance<S>(collider, at));
    errors.distance = std::max(errors.distance, std::abs(std::abs(found) - std::abs(exact)) / size);
    // At rounding there is no sign.
    const double noise = 16 * static_cast<double>(std::numeric_limits<S>::epsilon()) * size;
    if (std::abs(exact) > noise && (found < 0) != (exact < 0)) ++errors.wrong_signs;
  }
  return errors;
}

}  // namespace

TEMPLATE_TEST_CASE("meshes and hulls obey the laws", "[contact]", float, double) {
  using S = TestType;
  auto laws = exact_laws<S>(S(0.8));
  // A step that is short beside a triangle.
  laws.difference = std::is_same_v<S, float> ? S(2e-4) : S(1e-6);
  laws.gradient_tolerance = std::is_same_v<S, float> ? S(5e-3) : S(1e-6);
  check_collider_laws<S>(mesh_collider<S>(icosphere(2, 0.5)), laws);
  check_collider_laws<S>(mesh_collider<S>(torus_mesh(20, 10, 0.4, 0.15)), laws);
  check_collider_laws<S>(mesh_collider<S>(box_mesh({0.5, 0.3, 0.2})), laws);
  check_collider_laws<S>(hull_collider<S>(icosphere(1, 0.5).positions), laws);
  check_collider_laws<S>(hull_collider<S>(box_mesh({0.2, 0.5, 0.3}).positions), laws);
}

TEMPLATE_TEST_CASE("distances and signs of a mesh are those of all its triangles", "[contact]",
                   float, double) {
  using S = TestType;
  const double tolerance = 4 * static_cast<double>(std::numeric_limits<S>::epsilon());
  const int count = clothctl_test::trials(600, 20000, 100);
  for (const PlainMesh& mesh : {icosphere(2, 0.5), torus_mesh(24, 12, 0.4, 0.15),
                                torus_mesh(40, 5, 1.0, 0.01), box_mesh({0.5, 0.3, 0.001})}) {
    const Errors errors = compare<S>(mesh, count);
    CHECK(errors.distance <= tolerance);
    CHECK(errors.wrong_signs == 0);
  }
}

TEST_CASE("distances of scanned and modelled meshes are exact", "[contact]") {
  for (const char* name : {"bunny_uniform.obj", "spot.obj", "mh_body_quad.obj"}) {
    const PlainMesh mesh = clothctl_test::shared_mesh(name);
    if (mesh.triangles.empty()) {
      WARN("skipped: no ../shared/data/meshes/" << name);
      continue;
    }
    CAPTURE(name);
    const auto made = MeshCollider<double>::create(mesh.positions, mesh.triangles);
    if (!made) {
      WARN(name << ": " << made.error());
      continue;
    }
    const Errors errors = compare<double>(mesh, clothctl_test::trials(60, 2000, 4));
    CHECK(errors.distance <= 1e-15);
    CHECK(errors.wrong_signs == 0);
  }
}

TEST_CASE("a vertex with an obtuse fan has the right sign", "[contact]") {
  // A thin spike with many faces on one side: the mean of face normals points the wrong way there.
  PlainMesh mesh = torus_mesh(6, 30, 0.5, 0.2);
  for (Index v = 0; v < 30; ++v) mesh.positions.col(v) *= 1.8;
  const Errors errors = compare<double>(mesh, clothctl_test::trials(2000, 20000, 100));
  CHECK(errors.distance <= 1e-15);
  CHECK(errors.wrong_signs == 0);
}

TEST_CASE("nothing flies through a thin mesh", "[contact]") {
  const PlainMesh mesh = box_mesh({0.5, 0.5, 1e-7});
  const auto plate = mesh_collider<double>(mesh);
  std::mt19937 random(32);
  int missed = 0;
  for (int i = 0; i < 1000; ++i) {
    const Vector3<double> direction(uniform(random, -1, 1), uniform(random, -1, 1),
                                    uniform(random, 0.05, 1));
    // Every other one through the diagonal between two triangles.
    const double u = uniform(random, -0.49, 0.49);
    const Vector3<double> through(u, i % 2 == 0 ? u : uniform(random, -0.49, 0.49), 0);
    Points<double> from = through - uniform(random, 0.1, 5) * direction;
    Points<double> to = through + uniform(random, 0.1, 5) * direction;
    VectorX<double> t(1);
    CHECK(plate.sweep(from, to, 0, 0, t) == QueryStatus::Answered);
    if (t[0] > 1) ++missed;
  }
  CHECK(missed == 0);
}

TEST_CASE("nothing flies through a mesh whose corners are far from the path", "[contact]") {
  // Distances from triangles with corners 1 km away have errors above the rounding of the path.
  PlainMesh mesh = box_mesh({1000, 700, 1e-3});
  const Matrix3<double> R = rotation_exp<double>(Vector3<double>(0.3, -0.2, 0.5));
  mesh.positions = R * mesh.positions;
  const auto plate = mesh_collider<double>(mesh);
  std::mt19937 random(36);
  int missed = 0;
  double wrong = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vector3<double> way(uniform(random, -1, 1), uniform(random, -1, 1),
                              uniform(random, 0.05, 1));
    const Vector3<double> through(uniform(random, -0.05, 0.05), uniform(random, -0.05, 0.05), 1e-3);
    const double before = uniform(random, 0.1, 1), after = uniform(random, 0.1, 1);
    const Points<double> from = R * (through + before * way), to = R * (through - after * way);
    VectorX<double> t(1);
    CHECK(plate.sweep(from, to, 0, 0, t) == QueryStatus::Answered);
    if (t[0] > 1)
      ++missed;
    else
      wrong = std::max(wrong, std::abs(t[0] * (before + after) - before) * way[2]);
  }
  CHECK(missed == 0);
  CHECK(wrong <= 64 * 1000 * std::numeric_limits<double>::epsilon());
}

TEMPLATE_TEST_CASE("points at any distance from a mesh have sound answers", "[contact]", float,
                   double) {
  using S = TestType;
  using Limits = std::numeric_limits<S>;
  // From far away, both sides of the plate have the same distance to rounding.
  const auto plate = mesh_collider<S>(box_mesh({1, 0.5, 1e-3}));
  const auto mesh = mesh_collider<S>(torus_mesh(12, 8, 0.7, 0.3));
  std::mt19937 random(37);
  int unsound = 0;
  for (int i = 0; i < 500; ++i) {
    const double size = std::pow(10.0, uniform(random, 0.5, Limits::max_exponent10 - 1));
    Vector3<S> x;
    for (int k = 0; k < 3; ++k) x[k] = S(uniform(random, -1, 1) * size);
    const double length = static_cast<double>(x.template cast<long double>().stableNorm());
    if (length < 2) continue;
    const auto s = one_closest<S>(mesh, x);
    const double d = static_cast<double>(s.distance);
    unsound += !(length * (1 - 1e-6) - 1.1 <= d && d <= length * (1 + 1e-6)) ||
               !is_finite(s.point.norm()) || std::abs(s.normal.norm() - S(1)) > S(1e-5);
    unsound += !(one_distance<S>(plate, x) > S(0));
  }
  CHECK(unsound == 0);
  // A ball from one end of the range to the other.
  const S far_away = std::numeric_limits<S>::max() / S(4);
  const Points<S> from = Vector3<S>(-far_away, S(0.7), S(0)), to = -from;
  VectorX<S> t(1);
  CHECK(mesh.sweep(from, to, S(0), S(0), t) == QueryStatus::Answered);
  CHECK(t[0] <= S(0.500001));
}

TEMPLATE_TEST_CASE("a hull with slivers has the right signs", "[contact]", float, double) {
  using S = TestType;
  // Points on common planes and edges; rounding turns them into slivers.
  std::mt19937 random(38);
  double worst = 0;
  int made_hulls = 0;
  for (int trial = 0; trial < clothctl_test::trials(100, 2000, 20); ++trial) {
    Points<double> draw(3, 4 + static_cast<Index>(random() % 40));
    for (Index i = 0; i < draw.size(); ++i) draw(i) = std::round(2 * uniform(random, -1, 1)) / 2;
    const Vector3<double> turn(uniform(random, -2, 2), uniform(random, -2, 2),
                               uniform(random, -2, 2));
    const Points<S> points = (rotation_exp<double>(turn) * draw).cast<S>();
    const auto made = HullCollider<S>::create(points);
    if (!made) continue;
    ++made_hulls;
    const PlainMesh hull{made->vertices().template cast<double>(), made->triangles()};
    for (int i = 0; i < 60; ++i) {
      Vector3<double> x(uniform(random, -1.5, 1.5), uniform(random, -1.5, 1.5),
                        uniform(random, -1.5, 1.5));
      if (i % 2 == 0) {  // near a line between two points
        const Index p = static_cast<Index>(random()) % points.cols(),
                    q = static_cast<Index>(random()) % points.cols();
        const double share = uniform(random, 0, 1);
        x *= std::pow(10.0, uniform(random, -5, -1));
        x += ((1 - share) * points.col(p).template cast<double>() +
              share * points.col(q).template cast<double>());
      }
      const Vector3<S> at = x.cast<S>();
      const double exact = static_cast<double>(brute_distance(hull, at.template cast<double>()));
      worst = std::max(worst, std::abs(static_cast<double>(one_distance<S>(*made, at)) - exact));
    }
  }
  CHECK(made_hulls > 10);
  // Rounding to the lattice of 1e-8 of the extent may hide a sliver; otherwise rounding of S.
  CHECK(worst <= std::max(3e-8, 8 * static_cast<double>(std::numeric_limits<S>::epsilon())));
}

TEST_CASE("a hull holds its points, and a plane through each closest point supports it",
          "[contact]") {
  std::mt19937 random(33);
  for (int trial = 0; trial < clothctl_test::trials(30, 1000, 5); ++trial) {
    const int n = 4 + static_cast<int>(random() % 60);
    Points<double> points(3, n);
    for (Index i = 0; i < points.size(); ++i) {
      points(i) = uniform(random, -1, 1);
      // Many on common planes, lines and corners.
      if (trial % 2 == 0) points(i) = std::round(2 * points(i)) / 2;
    }
    if (trial % 4 == 0) points = rotation_exp<double>(Vector3<double>(0.3, 1, -2)) * points;
    const auto made = HullCollider<double>::create(points);
    if (!made) {
      CHECK(made.error().find("flat") != std::string::npos);
      continue;
    }
    CAPTURE(trial, n);
    double outside = 0, behind = 0, other = 0;
    for (Index i = 0; i < n; ++i)
      outside = std::max(outside, one_distance<double>(*made, Vector3<double>(points.col(i))));
    for (int i = 0; i < 40; ++i) {
      const Vector3<double> x(uniform(random, -2, 2), uniform(random, -2, 2),
                              uniform(random, -2, 2));
      const auto s = one_closest<double>(*made, x);
      const VectorX<double> heights = points.transpose() * s.normal;
      // Rounding to the lattice moves a plane by its steps.
      behind = std::max(behind, heights.maxCoeff() - s.normal.dot(s.point));
      if (s.distance > 0) continue;
      for (int k = 0; k < 50; ++k) {  // no other direction is a shorter way out
        const Vector3<double> n_k =
            Vector3<double>(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1))
                .normalized();
        const VectorX<double> along = points.transpose() * n_k;
        other = std::max(other, -s.distance - (along.maxCoeff() - n_k.dot(x)));
      }
    }
    CHECK(outside <= 2e-8);
    CHECK(behind <= 1e-7);
    CHECK(other <= 1e-7);
  }
}

TEST_CASE("the hull of a lattice of points is the box around them", "[contact]") {
  Points<double> points(3, 5 * 5 * 5);
  for (int i = 0; i < 125; ++i)
    points.col(i) << 0.1 * (i % 5) - 0.2, 0.05 * (i / 5 % 5) - 0.1, 0.075 * (i / 25) - 0.15;
  const auto hull = HullCollider<double>::create(points).value();
  CHECK(hull.vertices().cols() == 8);
  CHECK(hull.triangles().size() == 12);
  const auto box =
      BoxCollider<double>::create(Vector3<double>::Zero(), Vector3<double>(0.2, 0.1, 0.15)).value();
  std::mt19937 random(34);
  double worst = 0;
  for (int i = 0; i < 500; ++i) {
    const Vector3<double> x(uniform(random, -0.4, 0.4), uniform(random, -0.4, 0.4),
                            uniform(random, -0.4, 0.4));
    worst = std::max(worst, std::abs(one_distance<double>(hull, x) - one_distance<double>(box, x)));
  }
  CHECK(worst <= 1e-15);
}

TEMPLATE_TEST_CASE("a grid keeps its stated error", "[contact]", float, double) {
  using S = TestType;
  const auto mesh = mesh_collider<S>(torus_mesh(24, 12, 0.4, 0.15));
  const auto grid = GridCollider<S>::create(mesh, 24, S(0.1)).value();
  CHECK(grid.error_bound() == Approx(0.866 * static_cast<double>(grid.spacing())).epsilon(1e-3));
  auto laws = exact_laws<S>(S(0.7));
  laws.tolerance = grid.error_bound();
  laws.early = grid.error_bound();  // the mesh answers
  laws.lipschitz = S(1.8);
  laws.gradient_tolerance = S(1);  // the normal has length one, the slope has not
  check_collider_laws<S>(grid, laws);
  std::mt19937 random(35);
  double worst = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vector3<S> x(S(uniform(random, -0.6, 0.6)), S(uniform(random, -0.6, 0.6)),
                       S(uniform(random, -0.2, 0.2)));
    worst = std::max(
        worst, static_cast<double>(std::abs(one_distance<S>(grid, x) - one_distance<S>(mesh, x))));
    CHECK(one_closest<S>(grid, x).distance == one_distance<S>(grid, x));
  }
  CHECK(worst <= static_cast<double>(grid.error_bound()));
  CHECK(worst > 0);
  const Vector3<S> outside(S(3), S(1), S(2));
  CHECK(one_distance<S>(grid, outside) == one_distance<S>(mesh, outside));
}

TEST_CASE("meshes that bound no solid are refused by item and value", "[contact]") {
  const PlainMesh box = box_mesh({1, 1, 1});
  const auto error = [](const PlainMesh& mesh) {
    const auto made = MeshCollider<double>::create(mesh.positions, mesh.triangles);
    return made ? std::string("accepted") : made.error();
  };
  CHECK(error(box) == "accepted");
  PlainMesh bad = box;
  bad.triangles.pop_back();
  CHECK(error(bad) == "the mesh bounds no solid: it is open: edge 1-5 belongs to triangle 4 alone");
  bad = box;
  std::swap(bad.triangles[11][0], bad.triangles[11][1]);
  CHECK(error(bad) == "the mesh bounds no solid: triangle 11 is flipped against triangle 4");
  bad = box;
  for (auto& t : bad.triangles) std::swap(t[0], t[1]);
  CHECK(error(bad).find("the mesh bounds no solid: it is inverted: its volume is -") == 0);
  bad = box;
  bad.positions.col(1) = bad.positions.col(0);
  CHECK(error(bad).find("is degenerate: its area is 0 m^2") != std::string::npos);
  bad = box;
  bad.positions(2, 5) = std::numeric_limits<double>::quiet_NaN();
  CHECK(error(bad) ==
        "the mesh bounds no solid: it has vertex 5 with the coordinate 2 = nan, "
        "must be finite");
  bad = box;
  bad.triangles.push_back({0, 2, 4});
  CHECK(error(bad).find("is shared by 3 triangles") != std::string::npos);
  bad = box;
  bad.triangles[3][1] = 8;
  CHECK(error(bad) ==
        "the mesh is no surface: triangle 3 holds vertex 8 off the mesh of 8 vertices");
  CHECK(error({box.positions, {}}) == "the mesh bounds no solid: it has no triangles");
  // Two boxes that share a corner.
  bad = box;
  bad.positions.conservativeResize(3, 15);
  for (int i = 1; i < 8; ++i)
    bad.positions.col(7 + i) = box.positions.col(i) + Vector3<double>(2, 2, 2);
  for (const auto& t : box.triangles) {
    std::array<int, 3> moved{};
    for (std::size_t i = 0; i < 3; ++i) moved[i] = t[i] == 0 ? 7 : t[i] + 7;
    bad.triangles.push_back(moved);
  }
  CHECK(error(bad) ==
        "the mesh bounds no solid: vertex 7 joins two parts that share no edge there");
  CHECK(MeshCollider<double>::create(box.positions, box.triangles, {-1, 0}).error() ==
        "the mesh has the friction coefficient -1, must be finite and not negative");
}

TEST_CASE("points without a hull are refused by count and thickness", "[contact]") {
  const PlainMesh box = box_mesh({1, 1, 1});
  CHECK(HullCollider<double>::create(box.positions.leftCols(3)).error() ==
        "the hull is no solid: there are 3 points, must be at least 4");
  Points<double> x = box.positions;
  x.row(1).setConstant(0.5);
  CHECK(HullCollider<double>::create(x).error() ==
        "the hull is no solid: the 8 points are flat: all lie within 0 m of a plane, and extend "
        "over 2.8284271247461903 m");
  x.setConstant(1);
  CHECK(HullCollider<double>::create(x).error().find("are flat") != std::string::npos);
  x = box.positions;
  x(0, 3) = std::numeric_limits<double>::infinity();
  CHECK(HullCollider<double>::create(x).error() ==
        "the hull is no solid: there is the point 3 with the coordinate 0 = inf, must be finite");
}

TEST_CASE("a grid refuses sizes out of range", "[contact]") {
  const auto mesh = mesh_collider<double>(box_mesh({1, 1, 1}));
  CHECK(GridCollider<double>::create(mesh, 1, 0).error() ==
        "the grid has 1 cells, must be 2 to 512");
  CHECK(GridCollider<double>::create(mesh, 8, -0.5).error() ==
        "the grid has the margin -0.5 m, must be 0 to ten times the longest side of the mesh, 2 m");
  CHECK(GridCollider<double>::create(mesh, 512, 20).error() ==
        "the grid has 1243684141064 nodes, must be at most 268435456");
}
