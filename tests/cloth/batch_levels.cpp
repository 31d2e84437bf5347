#include "clothctl/cloth/detail/batch_levels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Geometry>
#include <Eigen/SVD>

#include "support/catch.hpp"
#include "support/sweeps.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::irregular_sheet;
using clothctl_test::Numbers;
using clothctl_test::TriangleSheet;

namespace {

constexpr double kSpacing = 0.01;

/// A flat sheet with levels. Vertices are offered in the order: tethered, corners, boundary, rest.
template <class Scalar>
struct Sheet {
  LevelInput input;
  VectorX<Scalar> points;
  BatchLevels<Scalar> levels;
  typename BatchLevels<Scalar>::Scratch scratch;
  double width, height;

  Sheet(int rows, int cols, double jitter, unsigned seed, int tethered_corners)
      : width(kSpacing * (cols - 1)), height(kSpacing * (rows - 1)) {
    const TriangleSheet mesh = irregular_sheet(rows, cols, kSpacing, jitter, seed);
    input.rest = mesh.positions;
    input.triangles = mesh.triangles;
    std::set<std::pair<int, int>> pairs;
    for (const std::array<int, 3>& t : mesh.triangles) {
      for (std::size_t i = 0; i < 3; ++i) pairs.insert(std::minmax(t[i], t[(i + 1) % 3]));
    }
    for (const auto& [a, b] : pairs)
      input.edges.push_back({a, b, (mesh.positions.col(a) - mesh.positions.col(b)).norm()});
    Numbers random(seed + 50);
    const int n = rows * cols;
    std::vector<std::pair<int, int>> ranks;
    for (int v = 0; v < n; ++v) {
      input.mass.push_back(random(0.005, 0.02));
      ranks.push_back({3 - sides(v), v});
    }
    for (int c = 0; c < tethered_corners; ++c) input.tethered.push_back(corner(c));
    random.shuffle(ranks);
    std::stable_sort(ranks.begin(), ranks.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    for (int v : input.tethered) input.order.push_back(v);
    for (const auto& [rank, v] : ranks) input.order.push_back(v);
    levels = BatchLevels<Scalar>(input);
    scratch = levels.make_scratch();
    points.setZero(4 * (n + 2));
    place([](const Vector3<double>& x) -> Vector3<double> { return x; });
    for (Index v = 0; v < n; ++v)
      points[4 * v + 3] = Scalar(1.0 / input.mass[static_cast<std::size_t>(v)]);
  }
  int count() const { return static_cast<int>(input.mass.size()); }
  Vector3<double> rest(int v) const { return input.rest.col(v); }
  /// On how many sides of the sheet a vertex is.
  int sides(int v) const {
    const double x = input.rest(0, v), y = input.rest(1, v), small = 1e-3 * kSpacing;
    return (x < small || x > width - small ? 1 : 0) + (y < small || y > height - small ? 1 : 0);
  }
  int corner(int which) const {
    const Vector3<double> at(which % 2 == 0 ? 0.0 : width, which < 2 ? 0.0 : height, 0.0);
    Index best = 0;
    (input.rest.colwise() - at).colwise().norm().minCoeff(&best);
    return static_cast<int>(best);
  }
  Vector3<double> get(int v) const {
    return points.template segment<3>(4 * v).template cast<double>();
  }
  template <class Map>
  void place(Map map) {
    for (int v = 0; v < count(); ++v) {
      const Vector3<double> p = map(rest(v));
      for (Index c = 0; c < 3; ++c) points[4 * v + c] = Scalar(p[c]);
    }
  }
  void hold(const std::vector<int>& held) {
    for (int v : held) points[4 * v + 3] = Scalar(0);
    levels.prepare(held, scratch);
  }
  void correct(int sweeps, double slack) {
    levels.correct(sweeps, Scalar(slack), points.data(), scratch);
    levels.add(Scalar(1), points.data(), scratch);
  }
  double distance(const VectorX<Scalar>& other) const {
    double most = 0;
    for (int v = 0; v < count(); ++v)
      most = std::max(
          most, static_cast<double>(
                    (points.template segment<3>(4 * v) - other.template segment<3>(4 * v)).norm()));
    return most;
  }
};

Matrix3<double> some_rotation() {
  return Eigen::Quaterniond(0.3, -0.8, 0.2, 0.5).normalized().toRotationMatrix();
}

}  // namespace

TEST_CASE("batch levels: weights of parents sum to one and reproduce the vertex",
          "[batch_levels]") {
  Numbers random(1);
  for (int trial = 0; trial < 200; ++trial) {
    const Index k = 2 + random.below(3);
    Points<double> offsets(3, k);
    for (Index p = 0; p < k; ++p) offsets.col(p) << random(-0.02, 0.02), random(-0.02, 0.02), 0.0;
    const VectorX<double> w = parent_weights(offsets);
    CHECK(w.sum() == Approx(1.0).epsilon(1e-12));
    CHECK(w.cwiseAbs().maxCoeff() < 2.01);
    Points<double> curved = offsets;
    for (Index p = 0; p < k; ++p) curved(2, p) = random(-0.01, 0.01);
    if (k > 2) CHECK(parent_weights(curved).minCoeff() >= 0.0);
    // Parents all around the vertex.
    for (Index p = 0; p < k; ++p) {
      const double angle =
          6.283185307 * (static_cast<double>(p) + random(-0.2, 0.2)) / static_cast<double>(k);
      const double r = random(0.005, 0.02);
      offsets.col(p) =
          some_rotation() * Vector3<double>(r * std::cos(angle), r * std::sin(angle), 0);
    }
    if (k < 3) continue;
    CHECK((offsets * parent_weights(offsets)).norm() < 1e-4 * 0.02);
  }
  // Equal distances on both sides give halves, a parent nearby nearly all.
  Points<double> line(3, 2);
  line << -0.01, 0.01, 0, 0, 0, 0;
  CHECK(parent_weights(line)[0] == Approx(0.5));
  line(0, 1) = 0.03;
  CHECK(parent_weights(line)[0] == Approx(0.75).epsilon(1e-3));
}

TEST_CASE("batch levels: weights of parents do not depend on unit, place, or rounding",
          "[batch_levels]") {
  Numbers random(7);
  int outside = 0, linear = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const Index k = 3 + random.below(2);
    Points<double> flat(3, k);
    for (Index p = 0; p < k; ++p) flat.col(p) << random(-0.02, 0.02), random(-0.02, 0.02), 0.0;
    flat = (some_rotation() * flat).eval();
    const VectorX<double> w = parent_weights(flat);
    CHECK(w.sum() == Approx(1.0).epsilon(1e-12));
    CHECK(parent_weights(1048576.0 * flat) == w);
    CHECK((parent_weights(1e-7 * flat) - w).norm() < 1e-6);
    // Linear precision where the parents spread in two directions and none has to be far out.
    const double scale = flat.colwise().norm().maxCoeff();
    Eigen::MatrixXd rows(4, k);
    rows.row(0).setOnes();
    rows.bottomRows(3) = flat / scale;
    const Eigen::JacobiSVD<Eigen::MatrixXd> all(rows);
    const bool spread = 0.3 < all.singularValues()[2];
    if (spread && w.cwiseAbs().maxCoeff() < 1.9) {
      ++linear;
      CHECK((flat * w).norm() < 1e-3 * scale);
    }
    // Rounded coordinates far away, as of a float mesh, are still flat.
    const Points<double> far_away = (flat.array() + 0.7 * scale * 1024).matrix();
    const Vector3<float> vertex = Vector3<double>::Constant(0.7 * scale * 1024).cast<float>();
    Points<double> rounded = far_away.cast<float>().cast<double>();
    rounded.colwise() -= vertex.cast<double>();
    if (spread) CHECK((parent_weights(rounded) - w).norm() < 0.02);
    // From flat to curved there is no jump.
    if (w.minCoeff() < -0.1) ++outside;
    VectorX<double> last = w;
    const Vector3<double> normal = some_rotation().col(2);
    const auto curved = [&](double bend) {
      Points<double> offsets = flat;
      for (Index p = 0; p < k; ++p) offsets.col(p) += bend * scale * (p % 2 == 0 ? 1 : -1) * normal;
      return offsets;
    };
    for (double bend = 1e-6; bend < 3e-3; bend *= 1.2) {
      const VectorX<double> now = parent_weights(curved(bend));
      if (spread && w.cwiseAbs().maxCoeff() < 1.0) CHECK((now - last).norm() < 0.3);
      last = now;
    }
    if (spread) CHECK(parent_weights(curved(0.2)).minCoeff() >= 0);
  }
  CHECK(outside > 50);
  CHECK(linear > 50);
}

TEST_CASE("batch levels: there are levels until one is small", "[batch_levels]") {
  CHECK(Sheet<double>(7, 7, 0.1, 1, 1).levels.count() == 0);
  CHECK(Sheet<double>(35, 47, 0.2, 1, 1).levels.count() == 1);
  CHECK(Sheet<double>(70, 70, 0.2, 1, 1).levels.count() == 2);
  // Pieces that are too small for levels.
  LevelInput dust;
  dust.rest.setRandom(3, 3000);
  dust.mass.assign(3000, 1.0);
  for (int v = 0; v < 3000; v += 2) dust.edges.push_back({v, v + 1, 0.1});
  for (int v = 0; v < 3000; ++v) dust.order.push_back(v);
  CHECK(BatchLevels<double>(dust).count() <= 1);
}

TEMPLATE_TEST_CASE("batch levels: tethers pull a sheet that is scaled about a corner back to rest",
                   "[batch_levels]", float, double, long double) {
  // The displacements of the levels are then linear in the rest position, and interpolation must
  // reproduce them at every vertex.
  using Scalar = TestType;
  for (const auto& [jitter, small] : {std::pair{0.0, 2e-6}, std::pair{0.2, 5e-5}}) {
    for (unsigned seed = 0; seed < 3; ++seed) {
      Sheet<Scalar> sheet(35, 47, jitter, seed, 1);
      const int q = sheet.corner(0);
      const Vector3<double> pin = sheet.rest(q) + Vector3<double>(0.1, 0, 0);
      const auto scaled = [&](double scale) {
        return [&, scale](const Vector3<double>& x) -> Vector3<double> {
          return pin + scale * some_rotation() * (x - sheet.rest(q));
        };
      };
      sheet.hold({q});
      sheet.place(scaled(1.0));
      const VectorX<Scalar> expected = sheet.points;
      sheet.place(scaled(1.2));
      CHECK(sheet.distance(expected) > 0.1);
      sheet.correct(0, 0.0);
      CHECK(sheet.distance(expected) < small);
    }
  }
}

TEMPLATE_TEST_CASE("batch levels: nothing happens where nothing is stretched", "[batch_levels]",
                   float, double, long double) {
  using Scalar = TestType;
  const int tethered = GENERATE(0, 1, 2);
  Sheet<Scalar> sheet(35, 47, 0.2, 4, tethered);
  sheet.hold(sheet.input.tethered);
  for (const double scale : {1.0, 0.9}) {
    sheet.place([&](const Vector3<double>& x) -> Vector3<double> {
      return Vector3<double>(1, 2, -1) + scale * some_rotation() * x;
    });
    const VectorX<Scalar> before = sheet.points;
    sheet.correct(3, 0.0);
    const double small = std::is_same_v<Scalar, float> ? 2e-5 : 1e-12;
    CHECK(sheet.distance(before) < small);
  }
}

TEMPLATE_TEST_CASE("batch levels: held vertices that have no tether stretch nothing at rest",
                   "[batch_levels]", float, double) {
  using Scalar = TestType;
  Sheet<Scalar> sheet(35, 47, 0.2, 4, 1);
  sheet.hold({11, 700, 1500});
  const VectorX<Scalar> before = sheet.points;
  sheet.correct(3, 0.0);
  CHECK(sheet.distance(before) < (std::is_same_v<Scalar, float> ? 1e-5 : 1e-12));
}

TEMPLATE_TEST_CASE("batch levels: held vertices and inverse masses have the same bits afterwards",
                   "[batch_levels]", float, double) {
  using Scalar = TestType;
  Sheet<Scalar> sheet(35, 47, 0.2, 5, 2);
  std::vector<int> held{3, 70, 1201};
  for (int v : sheet.input.tethered) held.push_back(v);
  sheet.hold(held);
  Numbers random(2);
  sheet.place([&](const Vector3<double>& x) -> Vector3<double> {
    return 1.3 * x + Vector3<double>(random(-0.01, 0.01), random(-0.01, 0.01), random(-0.01, 0.01));
  });
  const VectorX<Scalar> before = sheet.points;
  sheet.correct(3, 0.0);
  CHECK(sheet.distance(before) > 0.01);
  for (int v : held) CHECK(sheet.points.segment(4 * v, 4) == before.segment(4 * v, 4));
  for (int v = 0; v < sheet.count() + 2; ++v) CHECK(sheet.points[4 * v + 3] == before[4 * v + 3]);
}

TEMPLATE_TEST_CASE("batch levels: a free sheet keeps its momentum, linear and angular",
                   "[batch_levels]", float, double, long double) {
  using Scalar = TestType;
  Sheet<Scalar> sheet(35, 47, 0.2, 6, 0);
  sheet.hold({});
  Numbers random(3);
  sheet.place([&](const Vector3<double>& x) -> Vector3<double> {
    return 1.1 * x + Vector3<double>(0.5 * x[1] * x[1], random(-1e-3, 1e-3), random(-1e-3, 1e-3));
  });
  const VectorX<Scalar> before = sheet.points;
  sheet.correct(3, 0.0);
  Vector3<double> linear = Vector3<double>::Zero(), angular = linear;
  double mass = 0;
  for (int v = 0; v < sheet.count(); ++v) {
    const double m = sheet.input.mass[static_cast<std::size_t>(v)];
    const Vector3<double> x = before.template segment<3>(4 * v).template cast<double>(),
                          d = sheet.get(v) - x;
    mass += m;
    linear += m * d;
    angular += m * x.cross(d);
  }
  CHECK(sheet.distance(before) > 1e-3);
  const double small = std::is_same_v<Scalar, float> ? 1e-6 : 1e-13;
  CHECK(linear.norm() / mass < small);
  CHECK(angular.norm() / mass < small);
}

TEMPLATE_TEST_CASE("batch levels: corrections shorten a stretched sheet", "[batch_levels]", float,
                   double) {
  using Scalar = TestType;
  for (const int tethered : {0, 2}) {  // the levels alone, and with tethers
    Sheet<Scalar> sheet(47, 35, 0.2, 7, tethered);
    sheet.hold({sheet.corner(0), sheet.corner(1)});
    sheet.place([](const Vector3<double>& x) -> Vector3<double> {
      return Vector3<double>(x[0], 1.2 * x[1], 0.0);
    });
    const auto height = [&]() {
      return (sheet.get(sheet.corner(2)) - sheet.get(sheet.corner(0))).norm();
    };
    for (int i = 0; i < 4; ++i) sheet.correct(3, 0.0);
    CHECK(height() < (tethered > 0 ? 1.05 : 1.15) * sheet.height);
    CHECK(height() > 0.9 * sheet.height);
  }
}

TEST_CASE("batch levels: pieces without connection do not pull on each other", "[batch_levels]") {
  Sheet<double> one(30, 30, 0.2, 8, 0);
  LevelInput two = one.input;
  const int n = one.count();
  two.rest.conservativeResize(3, 2 * n);
  two.rest.rightCols(n) = one.input.rest;
  for (int v = 0; v < n; ++v) {
    two.mass.push_back(two.mass[static_cast<std::size_t>(v)]);
    two.order.push_back(one.input.order[static_cast<std::size_t>(v)] + n);
  }
  for (const SurfaceEdge<>& e : one.input.edges) two.edges.push_back({e.a + n, e.b + n, e.length});
  for (const auto& t : one.input.triangles) two.triangles.push_back({t[0] + n, t[1] + n, t[2] + n});
  two.tethered = {one.corner(0)};
  const BatchLevels<double> levels(two);
  REQUIRE(levels.count() > 0);
  auto scratch = levels.make_scratch();
  VectorX<double> points = VectorX<double>::Zero(4 * (2 * n + 2));
  for (Index v = 0; v < 2 * n; ++v) {
    // The second piece far away; both at rest.
    points.segment<3>(4 * v) = two.rest.col(v) + Vector3<double>(v < n ? 0.0 : 5.0, 0, 0);
    points[4 * v + 3] = 100.0;
  }
  points[4 * two.tethered[0] + 3] = 0;
  levels.prepare(two.tethered, scratch);
  const VectorX<double> before = points;
  levels.correct(3, 0.0, points.data(), scratch);
  levels.add(1.0, points.data(), scratch);
  CHECK((points - before).cwiseAbs().maxCoeff() < 1e-12);
}

TEST_CASE("batch levels: scratch of another sheet does not fit", "[batch_levels]") {
  const Sheet<double> small(30, 30, 0.1, 1, 0), large(40, 50, 0.1, 1, 1);
  CHECK(small.levels.fits(small.scratch));
  CHECK_FALSE(small.levels.fits(large.scratch));
  CHECK_FALSE(large.levels.fits(small.scratch));
}
