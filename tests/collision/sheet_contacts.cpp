// Contacts of sheets: vertices, and points inside edges and triangles, against dense samples of the
// sheet; the broad phase against all boxes; memory, repetition and refusals.

#include "clothctl/collision/sheet_contacts.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "archetypes/collider.hpp"
#include "clothctl/collision/collider_union.hpp"
#include "clothctl/collision/mesh_collider.hpp"
#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/collision/shapes.hpp"
#include "clothctl/mesh/grid.hpp"
#include "laws/collider_laws.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/solids.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::uniform;
using clothctl_test::law_detail::one_distance;
using Triangles = std::vector<std::array<int, 3>>;

namespace {

/// A flat n×n sheet of 1 m at z = 0.
clothctl_test::PlainMesh flat_sheet(int n) {
  clothctl_test::PlainMesh mesh{Points<double>(3, n * n), {}};
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < n; ++c) {
      mesh.positions.col(r * n + c) << double(c) / (n - 1) - 0.5, double(r) / (n - 1) - 0.5, 0;
      if (r + 1 == n || c + 1 == n) continue;
      const int a = r * n + c;
      mesh.triangles.push_back({a, a + 1, a + n});
      mesh.triangles.push_back({a + 1, a + n + 1, a + n});
    }
  }
  return mesh;
}

/// The least distance of many points of a triangle from a collider.
template <class C>
double sampled_depth(const C& collider, const Points<double>& x, int steps) {
  Points<double> points(3, (steps + 1) * (steps + 2) / 2);
  Index k = 0;
  for (int i = 0; i <= steps; ++i) {
    for (int j = 0; i + j <= steps; ++j) {
      const double s = double(i) / steps, t = double(j) / steps;
      points.col(k++) = (1 - s - t) * x.col(0) + s * x.col(1) + t * x.col(2);
    }
  }
  VectorX<double> d(k);
  CHECK(collider_traits<C>::distance(collider, points, d) == QueryStatus::Answered);
  return d.minCoeff();
}

template <class S>
S deepest(const SheetContactFinder<S>& finder) {
  S best(10);
  for (const auto& c : finder.contacts()) best = std::min(best, c.surface.distance);
  return best;
}

/// Random triangles near the origin: the deepest contact must be as deep as the deepest sample, to
/// `slack`, and as deep as it says.
template <class C>
void check_depths(const C& collider, double size, int trials, double slack) {
  std::mt19937 random(61);
  const double gain = 1e-5;
  double missed = 0, wrong = 0, off_sheet = 0;
  int inside = 0;
  for (int i = 0; i < trials; ++i) {
    Points<double> x(3, 3);
    for (Index k = 0; k < 9; ++k) x(k) = uniform(random, -size, size);
    auto finder =
        SheetContactFinder<double>::create(x, Triangles{{0, 1, 2}}, {}, {gain, 1e-7}).value();
    const double margin = 0.02;
    CHECK(finder.find(collider, margin, 0) == QueryStatus::Answered);
    const double sampled = sampled_depth(collider, x, 60), found = deepest(finder);
    if (sampled <= margin - gain - slack) missed = std::max(missed, found - sampled);
    for (const auto& c : finder.contacts()) {
      if (c.vertex_count() == 3) ++inside;
      Vector3<double> place = Vector3<double>::Zero();
      for (int k = 0; k < c.vertex_count(); ++k)
        place += c.weight[k] * x.col(c.vertex[static_cast<std::size_t>(k)]);
      off_sheet = std::max(off_sheet, (place - c.position).norm());
      off_sheet = std::max({off_sheet, -c.weight.minCoeff(), std::abs(c.weight.sum() - 1)});
      const double there = one_distance<double>(collider, c.position);
      // Where parts overlap, the part that a contact belongs to need not be the deepest.
      const bool parts = ColliderRef<double>(collider).part_count() > 0;
      wrong = std::max(wrong,
                       parts ? there - c.surface.distance : std::abs(there - c.surface.distance));
      CHECK(c.surface.distance <= margin);
    }
  }
  CHECK(missed <= gain + slack);
  CHECK(wrong <= 1e-15);
  CHECK(off_sheet <= 1e-15);
  CHECK(inside > trials / 50);
}

}  // namespace

TEMPLATE_TEST_CASE("a ball between the vertices of a coarse sheet is found", "[contact]", float,
                   double) {
  using S = TestType;
  const auto mesh = flat_sheet(3);
  const Points<S> x = mesh.positions.cast<S>();
  auto finder = SheetContactFinder<S>::create(x, mesh.triangles).value();
  // 2 cm inside the first triangle's plane, far from all vertices.
  const auto ball =
      SphereCollider<S>::create(Vector3<S>(S(-0.35), S(-0.32), S(-0.03)), S(0.05), {S(0.4), 7})
          .value();
  CHECK(finder.find(ball, S(0.001), S(0)) == QueryStatus::Answered);
  REQUIRE(finder.contacts().size() == 1);
  const SheetContact<S>& c = finder.contacts()[0];
  CHECK(c.vertex == std::array<int, 3>{0, 1, 3});
  CHECK(std::abs(c.surface.distance - S(-0.02)) <= S(2e-6));
  CHECK((c.position - Vector3<S>(S(-0.35), S(-0.32), S(0))).norm() <= S(1e-3));
  CHECK((c.surface.normal - Vector3<S>::UnitZ()).norm() <= S(0.03));
  CHECK(c.surface.body == 7);
  CHECK(c.surface.friction == S(0.4));
  // Below the middle of an edge.
  const auto under =
      SphereCollider<S>::create(Vector3<S>(S(-0.25), S(-0.5), S(-0.03)), S(0.05)).value();
  CHECK(finder.find(under, S(0.001), S(0)) == QueryStatus::Answered);
  REQUIRE(finder.contacts().size() == 1);
  CHECK(finder.contacts()[0].vertex == std::array<int, 3>{0, 1, -1});
  CHECK(finder.contacts()[0].vertex_count() == 2);
  CHECK(std::abs(finder.contacts()[0].weight[0] - S(0.5)) <= S(1e-3));
}

TEST_CASE("on a plane the vertices suffice", "[contact]") {
  const auto mesh = flat_sheet(9);
  auto finder = SheetContactFinder<double>::create(mesh.positions, mesh.triangles).value();
  const auto floor =
      PlaneCollider<double>::create(Vector3<double>::Zero(), Vector3<double>(0, 0, 1)).value();
  CHECK(finder.find(floor, 0.001, 0) == QueryStatus::Answered);
  CHECK(finder.contacts().size() == 81);
  Points<double> x = mesh.positions;
  std::mt19937 random(62);
  for (Index i = 0; i < x.cols(); ++i) x(2, i) = uniform(random, -0.01, 0.01);
  CHECK(finder.update(x) == QueryStatus::Answered);
  CHECK(finder.find(floor, 0.0, 0) == QueryStatus::Answered);
  CHECK(static_cast<Index>(finder.contacts().size()) == (x.row(2).array() <= 0.0).count());
}

TEST_CASE("the deepest point of a triangle is that of dense samples", "[contact]") {
  using V = Vector3<double>;
  const int trials = clothctl_test::trials(150, 5000, 30);
  // Samples 60 to a side of up to 1 m lie up to half of 1/60 of it from the deepest point.
  check_depths(*SphereCollider<double>::create(V(0, 0, 0), 0.2), 0.5, trials, 1e-6);
  check_depths(*CapsuleCollider<double>::create(V(-0.5, 0, 0), V(0.5, 0.1, 0), 0.01), 0.5, trials,
               1e-6);
  check_depths(*BoxCollider<double>::create(V(0, 0, 0), V(0.2, 0.15, 0.1)), 0.5, trials, 1e-6);
  check_depths(*CylinderCollider<double>::create(V(0, 0, -0.1), V(0, 0.05, 0.1), 0.2), 0.5, trials,
               1e-6);
  const auto cloud = clothctl_test::icosphere(1, 0.25);
  check_depths(*HullCollider<double>::create(cloud.positions), 0.5, trials, 1e-6);
  using Ball = SphereCollider<double>;
  check_depths(*ColliderUnion<double, Ball>::create({Ball::create(V(0.1, 0, 0), 0.1).value(),
                                                     Ball::create(V(-0.1, 0, 0), 0.1).value()}),
               0.5, trials, 1e-6);
}

TEST_CASE("the deepest point against a mesh is near that of dense samples", "[contact]") {
  const auto torus = clothctl_test::torus_mesh(20, 10, 0.3, 0.1);
  const auto mesh = MeshCollider<double>::create(torus.positions, torus.triangles).value();
  // Not convex, but its features are larger than the default size.
  check_depths(mesh, 0.5, clothctl_test::trials(100, 2000, 20), 1e-3);
}

TEST_CASE("a sheet on a corner and on a thin rod touches it between its vertices", "[contact]") {
  using V = Vector3<double>;
  const auto mesh = flat_sheet(5);
  auto finder = SheetContactFinder<double>::create(mesh.positions, mesh.triangles).value();
  const auto table = BoxCollider<double>::create(V(-0.66, -0.6, -0.496), V(0.5, 0.5, 0.5)).value();
  CHECK(finder.find(table, 0.0, 0) == QueryStatus::Answered);
  // The corner at (-0.16, -0.1) lies inside a cell of 0.25 m; its top is 4 mm above the sheet.
  CHECK(deepest(finder) <= -0.0039);
  const auto rod = CapsuleCollider<double>::create(V(-1, -0.13, 0), V(1, -0.12, 0), 1e-4).value();
  CHECK(finder.find(rod, 0.0, 0) == QueryStatus::Answered);
  CHECK(finder.contacts().size() >= 4);
  for (const auto& c : finder.contacts()) CHECK(c.vertex_count() >= 2);
}

TEST_CASE("the broad phase finds what overlaps a box", "[contact]") {
  const auto mesh = flat_sheet(12);
  std::mt19937 random(63);
  Points<double> x = mesh.positions, y = mesh.positions;
  auto finder = SheetContactFinder<double>::create(x, mesh.triangles, {{0, 143}}).value();
  SheetOverlap out = finder.make_overlap();
  for (int trial = 0; trial < 40; ++trial) {
    for (Index i = 0; i < x.size(); ++i) {
      x(i) = mesh.positions(i) + uniform(random, -0.05, 0.05);
      y(i) = x(i) + uniform(random, -0.05, 0.05);
    }
    REQUIRE(finder.update(x, y) == QueryStatus::Answered);
    const Vector3<double> low(uniform(random, -0.6, 0.5), uniform(random, -0.6, 0.5),
                              uniform(random, -0.1, 0.1));
    const BoundingBox<double> box{low, low + Vector3<double>::Constant(uniform(random, 0, 0.3))};
    finder.overlaps(box, out);
    const auto overlaps = [&](std::initializer_list<int> vertices) {
      BoundingBox<double> around{x.col(*vertices.begin()), x.col(*vertices.begin())};
      for (const int v : vertices) {
        around.include(Vector3<double>(x.col(v)));
        around.include(Vector3<double>(y.col(v)));
      }
      return around.overlaps(box);
    };
    const auto holds = [](const std::vector<int>& list, int i) {
      return std::count(list.begin(), list.end(), i);
    };
    int missing = 0;
    for (int v = 0; v < 144; ++v) missing += overlaps({v}) && holds(out.vertices, v) != 1;
    for (int e = 0; e < static_cast<int>(finder.edges().size()); ++e) {
      const auto& ends = finder.edges()[static_cast<std::size_t>(e)];
      missing += overlaps({ends[0], ends[1]}) && holds(out.edges, e) != 1;
    }
    for (int t = 0; t < static_cast<int>(mesh.triangles.size()); ++t) {
      const auto& c = mesh.triangles[static_cast<std::size_t>(t)];
      missing += overlaps({c[0], c[1], c[2]}) && holds(out.triangles, t) != 1;
    }
    CHECK(missing == 0);
    // The search is not much coarser than the boxes.
    CHECK(out.triangles.size() <= mesh.triangles.size());
  }
  finder.overlaps({Vector3<double>(5, 5, 5), Vector3<double>(6, 6, 6)}, out);
  CHECK(out.vertices.empty());
  CHECK(out.edges.empty());
  CHECK(out.triangles.empty());
}

TEST_CASE("a rope and single vertices have contacts, too", "[contact]") {
  Points<double> x(3, 4);
  x << 0, 1, 2, 3, 0, 0, 0, 1, 0, 0, 0, 0;
  auto finder = SheetContactFinder<double>::create(x, {}, {{1, 0}, {1, 2}}).value();
  const auto ball = SphereCollider<double>::create(Vector3<double>(0.5, 0, -0.1), 0.15).value();
  CHECK(finder.find(ball, 0.0, 0) == QueryStatus::Answered);
  REQUIRE(finder.contacts().size() == 1);
  CHECK(finder.contacts()[0].vertex == std::array<int, 3>{0, 1, -1});
  CHECK(finder.contacts()[0].surface.distance == Approx(-0.05));
  const auto other = SphereCollider<double>::create(Vector3<double>(3, 1, 0), 0.15).value();
  CHECK(finder.find(other, 0.0, 0) == QueryStatus::Answered);
  REQUIRE(finder.contacts().size() == 1);
  CHECK(finder.contacts()[0].vertex == std::array<int, 3>{3, -1, -1});
}

TEST_CASE("a search allocates nothing and repeats its bits", "[contact]") {
  const auto mesh = flat_sheet(17);
  std::mt19937 random(64);
  Points<double> x = mesh.positions;
  for (Index i = 0; i < x.size(); ++i) x(i) += uniform(random, -0.02, 0.02);
  using Moving = MovingCollider<double, CapsuleCollider<double>>;
  RigidMotion<double> motion;
  motion.velocity = Vector3<double>(0.1, 0, 0.5);
  const auto rod =
      CapsuleCollider<double>::create(Vector3<double>(-0.2, 0, 0), Vector3<double>(0.2, 0, 0), 0.02)
          .value();
  const auto moving = Moving::create(rod, motion).value();
  const auto ball = SphereCollider<double>::create(Vector3<double>(0.2, 0.2, 0), 0.03).value();
  const auto hand =
      ColliderUnion<double>::create({ColliderRef<double>(moving), ColliderRef<double>(ball)})
          .value();
  auto finder = SheetContactFinder<double>::create(mesh.positions, mesh.triangles).value();
  SheetOverlap overlap = finder.make_overlap();
  const long before = clothctl_test::allocations();
  bool good = finder.update(x) == QueryStatus::Answered;
  good &= finder.find(hand, 0.002, 0.02) == QueryStatus::Answered;
  finder.overlaps(hand.bounds(0.02), overlap);
  good &= finder.find(hand, 0.002, 0.02) == QueryStatus::Answered;
  const long made = clothctl_test::allocations() - before;
  CHECK(good);
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(finder.complete());
  const auto first = finder.contacts();
  CHECK(first.size() > 10);
  CHECK(finder.find(hand, 0.002, 0.02) == QueryStatus::Answered);
  REQUIRE(finder.contacts().size() == first.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    CHECK(finder.contacts()[i].vertex == first[i].vertex);
    CHECK(finder.contacts()[i].weight == first[i].weight);
    CHECK(finder.contacts()[i].surface.distance == first[i].surface.distance);
  }
  // The velocity of the part arrives.
  CHECK(std::any_of(first.begin(), first.end(),
                    [](const auto& c) { return c.surface.velocity[2] == 0.5; }));
}

TEST_CASE("contacts beyond the room are counted out, not lost silently", "[contact]") {
  const auto mesh = flat_sheet(3);
  auto finder = SheetContactFinder<double>::create(mesh.positions, mesh.triangles).value();
  const auto floor =
      PlaneCollider<double>::create(Vector3<double>::Zero(), Vector3<double>(0, 0, 1)).value();
  std::vector<ColliderRef<double>> floors(5, ColliderRef<double>(floor));
  const auto many = ColliderUnion<double>::create(floors).value();
  CHECK(finder.find(many, 0.001, 0) == QueryStatus::Answered);
  CHECK_FALSE(finder.complete());
  finder.reserve(45);
  CHECK(finder.find(many, 0.001, 0) == QueryStatus::Answered);
  CHECK(finder.complete());
  CHECK(finder.contacts().size() == 45);
}

TEST_CASE("a finder needs no more from its collider than the concept names", "[contact]") {
  const auto mesh = flat_sheet(3);
  auto finder = SheetContactFinder<double>::create(mesh.positions, mesh.triangles).value();
  const clothctl_test::ColliderArchetype<double> ground(1);
  CHECK(finder.find(ground, 0.001, 0) == QueryStatus::Answered);
  CHECK(finder.contacts().size() == 9);
  CHECK(finder.contacts()[0].surface.body == 3);
}

TEST_CASE("a finder refuses what is no sheet and no number", "[contact]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto mesh = flat_sheet(2);
  using Finder = SheetContactFinder<double>;
  Points<double> x = mesh.positions;
  x(1, 2) = nan;
  CHECK(Finder::create(x, mesh.triangles).error() == "vertex 2 of the sheet is not finite");
  CHECK(Finder::create(mesh.positions, {{0, 1, 4}}).error() ==
        "triangle 0 holds vertex 4 off the mesh of 4 vertices");
  CHECK(Finder::create(mesh.positions, {}, {{0, 9}}).error() ==
        "thread 0 holds vertex 9 off the sheet of 4 vertices");
  CHECK(Finder::create(mesh.positions, {}, {{0, 1}, {2, 2}}).error() ==
        "thread 1 holds vertex 2 twice");
  CHECK(Finder::create(mesh.positions, mesh.triangles, {}, {-1, 1e-6}).error() ==
        "the contact finder has the gain -1 m, must be finite and not negative");
  CHECK(Finder::create(mesh.positions, mesh.triangles, {}, {0, 0}).error() ==
        "the contact finder has the tolerance 0 m, must be finite and positive");
  CHECK(Finder::create(mesh.positions, mesh.triangles, {}, {0, 1e-6, true, nan}).error() ==
        "the contact finder has the feature size nan m, must be finite and positive");
  auto finder = Finder::create(mesh.positions, mesh.triangles).value();
  const auto floor =
      PlaneCollider<double>::create(Vector3<double>::Zero(), Vector3<double>(0, 0, 1)).value();
  CHECK(finder.update(x) == QueryStatus::InvalidPoint);
  CHECK(finder.update(x.leftCols(3)) == QueryStatus::InvalidArgument);
  CHECK(finder.find(floor, 0.001, 0) == QueryStatus::Answered);
  CHECK(finder.contacts().size() == 4);  // at the last good positions
  CHECK(finder.find(floor, nan, 0) == QueryStatus::InvalidArgument);
  CHECK(finder.contacts().empty());
  CHECK(finder.find(floor, 0.001, -1) == QueryStatus::InvalidArgument);
}
