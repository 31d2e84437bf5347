// The sheet with a thickness: the laws, distances against all triangles in long double, sweeps
// against dense sampling, sheets that move against new ones, and what is refused.

#include "clothctl/collision/sheet_collider.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "clothctl/grasp/robot_clearance.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/robot/kinematic_tree_builder.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "laws/collider_laws.hpp"
#include "static/explicit_scalar.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/meshes.hpp"
#include "support/solids.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::exact_laws;
using clothctl_test::icosphere;
using clothctl_test::irregular_mesh;
using clothctl_test::PlainMesh;
using clothctl_test::uniform;
using clothctl_test::law_detail::one_closest;
using clothctl_test::law_detail::one_distance;

static_assert(Collider<SheetCollider<float>, float> && Collider<SheetCollider<double>>);
static_assert(
    Collider<SheetCollider<clothctl_test::ExplicitDouble>, clothctl_test::ExplicitDouble>);
template class clothctl::SheetCollider<clothctl_test::ExplicitDouble>;

namespace {

using Vec = Vector3<double>;

/// The distance of x from the triangles less half the thickness, by all of them.
double brute_sheet(const PlainMesh& mesh, double thickness, const Vec& x) {
  return static_cast<double>(clothctl_test::brute_triangles(mesh, x) -
                             0.5L * static_cast<long double>(thickness));
}

template <class S>
SheetCollider<S> sheet_of(const PlainMesh& mesh, double thickness) {
  const Points<S> x = mesh.positions.cast<S>();
  return SheetCollider<S>::create(x, mesh.triangles, S(thickness), {S(0.4), 7}).value();
}

/// A curved sheet with holes; one that is flat; a Möbius strip; three sheets that share an edge.
std::vector<PlainMesh> sheets(std::mt19937& random) {
  std::vector<PlainMesh> out{irregular_mesh(14, 14, random, 0.25, true),
                             irregular_mesh(6, 9, random)};
  PlainMesh strip{Points<double>(3, 60), {}};
  for (int i = 0; i < 30; ++i) {
    const double u = 2 * std::acos(-1.0) * i / 30;
    for (int j = 0; j < 2; ++j) {
      const double v = j == 0 ? -0.12 : 0.12, out_by = 0.5 + v * std::cos(u / 2);
      strip.positions.col(2 * i + j) << out_by * std::cos(u), out_by * std::sin(u),
          v * std::sin(u / 2);
    }
    const int a = 2 * i, b = a + 1, c = i < 29 ? a + 2 : 1, d = i < 29 ? a + 3 : 0;
    strip.triangles.push_back({a, b, c});
    strip.triangles.push_back({b, d, c});
  }
  out.push_back(strip);
  PlainMesh book{Points<double>(3, 5), {{0, 1, 2}, {0, 1, 3}, {1, 0, 4}}};
  book.positions << 0, 0, 0.6, -0.4, -0.5, 0, 0.5, 0.2, 0.3, 0.1, 0, 0, 0, 0.5, -0.4;
  out.push_back(book);
  return out;
}

Vec anywhere(std::mt19937& random, double size) {
  return Vec(uniform(random, -size, size), uniform(random, -size, size),
             uniform(random, -size, size));
}

}  // namespace

TEMPLATE_TEST_CASE("sheets obey the laws", "[contact]", float, double) {
  using S = TestType;
  std::mt19937 random(61);
  for (const PlainMesh& mesh : sheets(random)) {
    auto laws = exact_laws<S>(S(0.9));
    laws.difference = std::is_same_v<S, float> ? S(2e-4) : S(1e-6);
    laws.gradient_tolerance = std::is_same_v<S, float> ? S(1e-2) : S(1e-6);
    laws.exact_inside = false;
    check_collider_laws<S>(sheet_of<S>(mesh, 0.06), laws);
  }
}

TEMPLATE_TEST_CASE("distances from a sheet are those of all its triangles", "[contact]", float,
                   double) {
  using S = TestType;
  const double epsilon = static_cast<double>(std::numeric_limits<S>::epsilon());
  std::mt19937 random(62);
  for (PlainMesh mesh : sheets(random)) {
    const auto sheet = sheet_of<S>(mesh, 0.02);
    mesh.positions = mesh.positions.cast<S>().template cast<double>();
    double worst = 0, off = 0;
    int turned = 0;
    for (int i = 0; i < clothctl_test::trials(400, 10000, 100); ++i) {
      Vec x = anywhere(random, 1.2);
      if (i % 2 == 0) {  // close to a triangle, a side or a corner
        const auto& t = mesh.triangles[random() % mesh.triangles.size()];
        double u = uniform(random, 0, 1), v = i % 4 == 0 ? 0 : uniform(random, 0, 1 - u);
        if (i % 8 == 0) u = 0;
        x = (1 - u - v) * mesh.positions.col(t[0]) + u * mesh.positions.col(t[1]) +
            v * mesh.positions.col(t[2]) + std::pow(10, uniform(random, -9, -1)) * x;
      }
      const Vector3<S> at = x.cast<S>();
      const auto s = one_closest<S>(sheet, at);
      const double exact = brute_sheet(mesh, 0.02, at.template cast<double>());
      worst = std::max(worst, std::abs(static_cast<double>(s.distance) - exact));
      // The foot m = q - (w/2) n is on the sheet, on the far side of the normal.
      const Vec n = s.normal.template cast<double>(), q = s.point.template cast<double>();
      off = std::max(off, brute_sheet(mesh, 0, q - 0.01 * n));
      if (!((at.template cast<double>() - (q - 0.01 * n)).dot(n) >= -10 * epsilon)) ++turned;
      if (s.friction != S(0.4) || s.body != 7 || !s.velocity.isZero(S(0))) ++turned;
    }
    CHECK(worst <= std::max(1e-15, 8 * epsilon));
    CHECK(off <= 16 * epsilon);
    CHECK(turned == 0);
  }
}

TEST_CASE("a sheet has two sides, and its normal is that of the side of the point", "[contact]") {
  PlainMesh mesh{Points<double>(3, 3), {{0, 1, 2}}};
  mesh.positions << 0, 1, 0, 0, 0, 1, 0, 0, 0;
  const auto sheet = sheet_of<double>(mesh, 0.01);
  CHECK(sheet.thickness() == 0.01);
  for (const double z : {0.3, 1e-3, 1e-9, -1e-9, -1e-3, -0.3}) {
    const auto s = one_closest<double>(sheet, Vec(0.25, 0.25, z));
    CHECK(s.distance == Approx(std::abs(z) - 0.005).margin(1e-16));
    CHECK((s.normal - Vec(0, 0, z > 0 ? 1 : -1)).norm() <= 1e-15);
    CHECK((s.point - Vec(0.25, 0.25, z > 0 ? 0.005 : -0.005)).norm() <= 1e-15);
  }
  // In the middle either side will do, beyond a side or a corner the way from there.
  CHECK(std::abs(one_closest<double>(sheet, Vec(0.25, 0.25, 0)).normal[2]) == 1);
  CHECK(std::abs(one_closest<double>(sheet, Vec(0.5, 0, 0)).normal.norm() - 1) <= 1e-15);
  CHECK((one_closest<double>(sheet, Vec(0.5, -0.2, 0)).point - Vec(0.5, -0.005, 0)).norm() <=
        1e-15);
  CHECK(one_distance<double>(sheet, Vec(-3, -4, 0)) == Approx(5 - 0.005));
}

TEST_CASE("triangles without area are threads and beads", "[contact]") {
  Points<double> x(3, 6);
  x << 0, 1, 2, 2, 5, 5, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0, 0;
  // Three corners on a line; a side twice; a point.
  const auto sheet =
      SheetCollider<double>::create(x, {{0, 1, 2}, {2, 3, 3}, {4, 5, 4}}, 0.2).value();
  CHECK(one_distance<double>(sheet, Vec(1.5, -1, 0)) == Approx(0.9));
  CHECK(one_distance<double>(sheet, Vec(3, 2, 0)) == Approx(0.9));
  CHECK(one_distance<double>(sheet, Vec(5, 0, -2)) == Approx(1.9));
  for (const Vec& on : {Vec(0.5, 0, 0), Vec(2, 1.5, 0), Vec(5, 0, 0)}) {
    const auto s = one_closest<double>(sheet, on);
    CHECK(s.distance == Approx(-0.1));
    CHECK(std::abs(s.normal.norm() - 1) <= 1e-15);
    CHECK((s.point - on).norm() == Approx(0.1));
  }
  CHECK(std::abs(one_closest<double>(sheet, Vec(0.5, 0, 0)).normal[0]) <= 1e-15);
}

TEST_CASE("the distance from a sheet changes by no more than the way", "[contact]") {
  std::mt19937 random(63);
  for (const PlainMesh& mesh : sheets(random)) {
    const auto sheet = sheet_of<double>(mesh, 0.01);
    double most = 0;
    for (int i = 0; i < 2000; ++i) {
      const Vec x = anywhere(random, 1);
      const Vec y = x + std::pow(10, uniform(random, -6, 0)) * anywhere(random, 1);
      most =
          std::max(most, std::abs(one_distance<double>(sheet, x) - one_distance<double>(sheet, y)) -
                             (x - y).norm());
    }
    CHECK(most <= 1e-15);
  }
}

TEST_CASE("sweeps meet a sheet where dense samples of the path do", "[contact]") {
  std::mt19937 random(64);
  for (const PlainMesh& mesh : sheets(random)) {
    const double thickness = 0.004;
    const auto sheet = sheet_of<double>(mesh, thickness);
    int hits = 0, misses = 0, from_both_sides = 0;
    double late = 0, gap = 0;
    for (int i = 0; i < clothctl_test::trials(60, 1000, 20); ++i) {
      const Points<double> from = anywhere(random, 1);
      Points<double> to = anywhere(random, 1);
      if (i % 3 == 0) {  // through a triangle
        const auto& t = mesh.triangles[random() % mesh.triangles.size()];
        to = 0.7 * mesh.positions.col(t[0]) + 0.2 * mesh.positions.col(t[1]) +
             0.1 * mesh.positions.col(t[2]);
        to += 0.5 * (to - from);
      }
      const double radius = i % 2 == 0 ? 0.0 : 0.03;
      VectorX<double> t(1), back(1);
      CHECK(sheet.sweep(from, to, radius, 0, t) == QueryStatus::Answered);
      CHECK(sheet.sweep(to, from, radius, 0, back) == QueryStatus::Answered);
      if ((t[0] <= 1) == (back[0] <= 1)) ++from_both_sides;
      const double end = std::min(t[0], 1.0);
      for (int k = 0; k < 200; k += clothctl_test::trials(1, 1, 20)) {
        const Vec x = from + (end * k / 200) * (to - from);
        if (0 < end) late = std::max(late, radius - brute_sheet(mesh, thickness, x));
      }
      ++(t[0] <= 1 ? hits : misses);
      if (t[0] <= 1 && 0 < t[0])
        gap = std::max(gap,
                       std::abs(brute_sheet(mesh, thickness, from + t[0] * (to - from)) - radius));
    }
    CHECK(late <= 1e-12);
    CHECK(gap <= 1e-12);
    CHECK(hits > 5);
    CHECK(misses > 5);
    CHECK(from_both_sides == hits + misses);
  }
}

TEST_CASE("nothing flies through a thin sheet", "[contact]") {
  std::mt19937 random(65);
  const PlainMesh mesh = irregular_mesh(8, 8, random, 0.2);
  const auto sheet = sheet_of<double>(mesh, 1e-9);
  int missed = 0;
  for (int i = 0; i < 1000; ++i) {
    const auto& t = mesh.triangles[random() % mesh.triangles.size()];
    // Every other one through a side.
    const double u = uniform(random, 0, 1), v = i % 2 == 0 ? 0 : uniform(random, 0, 1 - u);
    const Vec through = (1 - u - v) * mesh.positions.col(t[0]) + u * mesh.positions.col(t[1]) +
                        v * mesh.positions.col(t[2]);
    const Vec way = anywhere(random, 1) + Vec(0, 1.5, 0);
    const Points<double> from = through - uniform(random, 0.1, 5) * way;
    const Points<double> to = through + uniform(random, 0.1, 5) * way;
    VectorX<double> time(1);
    CHECK(sheet.sweep(from, to, 0, 0, time) == QueryStatus::Answered);
    if (time[0] > 1) ++missed;
  }
  CHECK(missed == 0);
}

TEST_CASE("a sheet that was moved answers as one that is made there", "[contact]") {
  std::mt19937 random(66);
  for (PlainMesh mesh : sheets(random)) {
    auto moved = sheet_of<double>(mesh, 0.02);
    for (int step = 0; step < 3; ++step) {
      // Crumpled, turned and carried away, so that the tree of the first shape fits badly.
      const Matrix3<double> R = rotation_exp<double>(Vec(0.5 * step, 1, -0.3));
      for (Index v = 0; v < mesh.positions.cols(); ++v)
        mesh.positions.col(v) = R * mesh.positions.col(v) + anywhere(random, 0.1 * step);
      CHECK(moved.update(mesh.positions).empty());
      const auto fresh = sheet_of<double>(mesh, 0.02);
      CHECK(moved.bounds(0).lower == fresh.bounds(0).lower);
      CHECK(moved.bounds(0).upper == fresh.bounds(0).upper);
      double distance = 0, point = 0, time = 0, exact = 0;
      for (int i = 0; i < 200; ++i) {
        const Vec x = anywhere(random, 1.5), y = anywhere(random, 1.5);
        const auto a = one_closest<double>(moved, x), b = one_closest<double>(fresh, x);
        distance = std::max(distance, std::abs(a.distance - b.distance));
        point = std::max({point, (a.point - b.point).norm(), (a.normal - b.normal).norm()});
        time =
            std::max(time, std::abs(moved.sweep_at(x, y, 0.01, 0) - fresh.sweep_at(x, y, 0.01, 0)));
        if (i < 50) exact = std::max(exact, std::abs(a.distance - brute_sheet(mesh, 0.02, x)));
      }
      CHECK(distance <= 1e-15);
      CHECK(point <= 1e-12);
      CHECK(time <= 1e-12);
      CHECK(exact <= 1e-14);
    }
  }
}

TEST_CASE("moving a sheet allocates nothing, and bad positions change nothing", "[contact]") {
  std::mt19937 random(67);
  const PlainMesh mesh = irregular_mesh(20, 20, random, 0.2);
  auto sheet = sheet_of<double>(mesh, 0.01);
  const Points<double> there = mesh.positions.array() + 0.3;
  std::string bad;
  const long before = clothctl_test::allocations();
  bad = sheet.update(there);
  const long made = clothctl_test::allocations() - before;
  CHECK(bad.empty());
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  const Vec x(0.2, 0.5, 0.4);
  const double known = one_distance<double>(sheet, x);
  CHECK(known != one_distance<double>(sheet_of<double>(mesh, 0.01), x));
  Points<double> wrong = mesh.positions;
  wrong(1, 17) = std::numeric_limits<double>::quiet_NaN();
  CHECK(sheet.update(wrong) ==
        "the sheet has vertex 17 with the coordinate 1 = nan, must be finite");
  wrong(1, 17) = 1e25;
  CHECK(sheet.update(wrong) ==
        "the sheet has vertex 17 with the coordinate 1 = 1e+25, must be finite, at most 1e20");
  CHECK(sheet.update(mesh.positions.leftCols(399)) ==
        "the sheet has 400 vertices, and got positions of 399");
  CHECK(one_distance<double>(sheet, x) == known);
  // A copy has its own vertices.
  const SheetCollider<double> copy = sheet;
  CHECK(sheet.update(mesh.positions).empty());
  CHECK(one_distance<double>(copy, x) == known);
  CHECK(one_distance<double>(sheet, x) != known);
}

TEMPLATE_TEST_CASE("points at any distance from a sheet have sound answers", "[contact]", float,
                   double) {
  using S = TestType;
  using Limits = std::numeric_limits<S>;
  std::mt19937 random(68);
  const auto sheet = sheet_of<S>(irregular_mesh(5, 5, random, 0.2), 0.01);
  int unsound = 0;
  for (int i = 0; i < 500; ++i) {
    const double size = std::pow(10.0, uniform(random, 0.5, Limits::max_exponent10 - 1));
    Vector3<S> x;
    for (int k = 0; k < 3; ++k) x[k] = S(uniform(random, -1, 1) * size);
    const double length = static_cast<double>(x.template cast<long double>().stableNorm());
    const auto s = one_closest<S>(sheet, x);
    const double d = static_cast<double>(s.distance);
    unsound += !(length * (1 - 1e-6) - 2 <= d && d <= length * (1 + 1e-6) + 2) ||
               !all_finite(s.point) || std::abs(s.normal.norm() - S(1)) > S(1e-5);
  }
  CHECK(unsound == 0);
}

TEST_CASE("the clearance of a robot beside a sheet is that of its capsule", "[contact]") {
  KinematicTreeBuilder<double> builder;
  builder.add_link("base").add_link("tool");
  Joint<double> slide;
  slide.name = "slide", slide.parent = "base", slide.child = "tool";
  slide.type = JointType::Prismatic, slide.axis = Vec(0, 1, 0);
  slide.limits.lower = -1, slide.limits.upper = 1;
  builder.add_joint(slide);
  const KinematicTree<double> tree = builder.build().value();
  const double radius = 0.02, thickness = 0.004;
  const Vec from(0.3, 0, 0.3), to(0.6, 0.1, 0.5);
  auto clearance = RobotClearance<KinematicTree<double>>::create(
                       tree, {{tree.find_link("tool"), from, to, radius}}, 1e-5)
                       .value();
  std::mt19937 random(69);
  PlainMesh mesh = irregular_mesh(12, 12, random, 0.05);
  auto sheet = sheet_of<double>(mesh, thickness);
  clearance.set_obstacles(std::vector<ColliderRef<double>>{ColliderRef<double>(sheet)});
  int touching = 0;
  for (int k = 0; k < 20; ++k) {
    // The sheet passes the robot, and the reference follows it.
    const VectorX<double> q = VectorX<double>::Constant(1, 0.02 * k - 0.2);
    CHECK(sheet.update(mesh.positions).empty());
    const int samples = clothctl_test::trials(400, 400, 40);
    double sampled = 1;
    for (int s = 0; s <= samples; ++s) {
      const Vec x = from + static_cast<double>(s) / samples * (to - from) + Vec(0, q[0], 0);
      sampled = std::min(sampled, brute_sheet(mesh, thickness, x) - radius);
    }
    const ClosestPart<double> told = clearance.closest(q);
    CHECK(told.obstacle == 0);
    CHECK(told.distance <= sampled);
    CHECK(sampled - 0.4 / samples <= told.distance);
    if (told.distance < 0) ++touching;
    mesh.positions.row(1).array() -= 0.005;
  }
  CHECK(touching > 0);
  CHECK(touching < 20);
}

TEST_CASE("sheets that cannot be are refused by item and value", "[contact]") {
  std::mt19937 random(70);
  const PlainMesh good = irregular_mesh(3, 3, random);
  const auto error = [&](const PlainMesh& mesh, double thickness = 0.01, double friction = 0.5) {
    const auto made =
        SheetCollider<double>::create(mesh.positions, mesh.triangles, thickness, {friction, 0});
    return made ? std::string("accepted") : made.error();
  };
  CHECK(error(good) == "accepted");
  PlainMesh bad = good;
  bad.positions(2, 4) = std::numeric_limits<double>::quiet_NaN();
  CHECK(error(bad) == "the sheet has vertex 4 with the coordinate 2 = nan, must be finite");
  bad.positions(2, 4) = -std::numeric_limits<double>::infinity();
  CHECK(error(bad) == "the sheet has vertex 4 with the coordinate 2 = -inf, must be finite");
  bad = good;
  bad.triangles[5][2] = 9;
  CHECK(error(bad) == "the sheet has triangle 5 with no vertex 9 (there are 9)");
  bad.triangles[5][2] = -1;
  CHECK(error(bad) == "the sheet has triangle 5 with no vertex -1 (there are 9)");
  CHECK(error({good.positions, {}}) == "the sheet has no triangles");
  CHECK(error(good, 0) == "the sheet has the thickness 0 m, must be finite and positive");
  CHECK(error(good, -1) == "the sheet has the thickness -1 m, must be finite and positive");
  CHECK(error(good, std::numeric_limits<double>::quiet_NaN()) ==
        "the sheet has the thickness nan m, must be finite and positive");
  CHECK(error(good, 0.01, -2) ==
        "the sheet has the friction coefficient -2, must be finite and not negative");
}
