// Sweeps over pairs: momentum, energy, the cone, and layers that come to rest.

#include "clothctl/contact/detail/pair_rows.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "support/catch.hpp"
#include "support/meshes.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::uniform;
using Row = detail::PairRow<double>;

namespace {

struct Scene {
  Points<double> x, y;
  VectorX<double> inverse_mass;
  std::vector<Row> rows;

  double energy() const {
    double sum = 0;
    for (Index i = 0; i < x.cols(); ++i) {
      if (inverse_mass[i] > 0) sum += 0.5 * (y.col(i) - x.col(i)).squaredNorm() / inverse_mass[i];
    }
    return sum;
  }
  Vector3<double> momentum() const {
    Vector3<double> sum = Vector3<double>::Zero();
    for (Index i = 0; i < x.cols(); ++i) sum += (y.col(i) - x.col(i)) / inverse_mass[i];
    return sum;
  }
};

/// Random vertices and random pairs that are at their gaps at the start.
Scene random_scene(std::mt19937& random, int vertices, int rows) {
  Scene s;
  s.x = s.y = Points<double>(3, vertices);
  s.inverse_mass.resize(vertices);
  for (Index i = 0; i < s.x.size(); ++i) {
    s.x(i) = uniform(random, -1, 1);
    s.y(i) = s.x(i) + uniform(random, -0.1, 0.1);
  }
  for (Index i = 0; i < vertices; ++i) s.inverse_mass[i] = std::pow(10.0, uniform(random, 1, 4));
  for (int k = 0; k < rows; ++k) {
    Row row;
    const int first = static_cast<int>(random() % static_cast<unsigned>(vertices - 3));
    row.vertex = {first, first + 1, first + 2, first + 3};
    const double a = uniform(random, 0, 1), b = uniform(random, 0, 1);
    row.weight = {1 - a, a, b - 1, -b};
    row.normal = Vector3<double>(uniform(random, -1, 1), uniform(random, -1, 1), 1).normalized();
    row.gap = row.normal.dot(row.way(s.x));
    row.pushed = row.gap + 0.01;
    REQUIRE(detail::weigh<double>(s.inverse_mass, row));
    s.rows.push_back(row);
  }
  return s;
}

}  // namespace

TEST_CASE("sweeps keep momentum, never raise energy, and stay in the cone", "[self_contact]") {
  std::mt19937 random(51);
  for (int trial = 0; trial < clothctl_test::trials(50, 2000, 10); ++trial) {
    Scene s = random_scene(random, 12, 20);
    const double mu = uniform(random, 0, 1);
    const Vector3<double> before = s.momentum();
    double energy = s.energy();
    for (int k = 0; k < 30; ++k) {
      detail::sweep_rows<double>(s.rows, s.x, mu, s.y);
      // Every gap is met at the start, so each row is the projection of the motion.
      CHECK(s.energy() <= energy * (1 + 1e-12));
      energy = s.energy();
    }
    CHECK((s.momentum() - before).norm() <= 1e-14);
    for (const Row& row : s.rows) {
      CHECK(row.impulse >= 0);
      CHECK(std::abs(row.friction.dot(row.normal)) <= 1e-12);
    }
  }
}

TEST_CASE("a vertex that falls on a held triangle stops, slides or sticks", "[self_contact]") {
  Scene s;
  s.x = Points<double>(3, 4);
  s.x << 0.2, 0, 1, 0, 0.2, 0, 0, 1, 0.01, 0, 0, 0;
  s.inverse_mass = VectorX<double>::Zero(4);
  s.inverse_mass[0] = 100;
  Row row;
  row.vertex = {0, 1, 2, 3};
  row.weight = {1, -0.6, -0.2, -0.2};
  row.normal = {0, 0, 1};
  row.gap = row.pushed = 0.002;
  REQUIRE(detail::weigh<double>(s.inverse_mass, row));
  for (const double mu : {0.0, 0.5, 5.0}) {
    s.rows = {row};
    s.y = s.x;
    s.y.col(0) += Vector3<double>(0.01, 0, -0.018);
    detail::sweep_rows<double>(s.rows, s.x, mu, s.y);
    CHECK(s.y(2, 0) == Approx(0.002));
    // The normal stops 10 mm: friction takes up to μ of that.
    CHECK(s.y(0, 0) - 0.2 == Approx(std::max(0.0, 0.01 - mu * 0.01)).margin(1e-15));
  }
  // Nothing pulls a vertex that goes away.
  s.rows = {row};
  s.y = s.x;
  s.y(2, 0) = 0.5;
  CHECK(detail::sweep_rows<double>(s.rows, s.x, 1.0, s.y) == 0);
  CHECK(s.y(2, 0) == 0.5);
}

TEST_CASE("a push opens pairs to its distance and keeps the centre", "[self_contact]") {
  std::mt19937 random(52);
  Scene s = random_scene(random, 8, 1);
  s.y = s.x;
  const Vector3<double> before = s.momentum();
  detail::push_rows<double>(s.rows, s.y);
  CHECK(s.rows[0].normal.dot(s.rows[0].way(s.y)) == Approx(s.rows[0].pushed));
  CHECK((s.momentum() - before).norm() <= 1e-15);
}

TEST_CASE("a row that nothing can move is refused", "[self_contact]") {
  Row row;
  row.vertex = {0, 1, 2, 3};
  row.weight = {1, -1, 0, 0};
  VectorX<double> inverse_mass = VectorX<double>::Zero(4);
  CHECK_FALSE(detail::weigh<double>(inverse_mass, row));
  inverse_mass[3] = 1;  // has no weight
  CHECK_FALSE(detail::weigh<double>(inverse_mass, row));
}
