// Contacts with obstacles inside an implicit step.

#include "clothctl/cloth/detail/contact_springs.hpp"

#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/mesh/grid.hpp"
#include "support/block_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

constexpr double kStep = 0.01;

/// One triangle with two corners on a slope, a thickness too deep.
struct Fixture {
  Fixture() {
    x.resize(3, 3);
    x << 0, 0.1, 0, 0, 0, 0.1, 0, 0, 0;
    mass << 0.01, 0.02, 0.03;
    const std::vector<std::array<int, 3>> triangles{{0, 1, 2}};
    auto finder = SheetContactFinder<double>::create(x, triangles).value();
    floor.emplace(PlaneCollider<double>::create(Vector3<double>(0, 0, 0),
                                                Vector3<double>(0.6, 0, 0.8), {0.4, 0})
                      .value());
    list.emplace_back(*floor);
    (void)contacts.update(list, Points<double>::Zero(3, 3), kStep, finder);
    springs.reserve(10);
  }
  detail::ContactSprings<double> make() { return {contacts, springs, mass, held, kStep}; }

  Points<double> x;
  VectorX<double> mass{3};
  std::vector<unsigned char> held{0, 0, 0};
  std::optional<PlaneCollider<double>> floor;
  std::vector<ColliderRef<double>> list;
  ObstacleContacts<double> contacts = ObstacleContacts<double>::create(10).value();
  detail::ContactSpringList<double> springs;
};

Points<double> velocities(double a, double b, double c) {
  Points<double> v(3, 3);
  v << a, b, c, 0.1 * b, 0.2 * a, 0.3 * c, -0.3 * a, -0.2, -0.5 * b;
  return v;
}

}  // namespace

TEST_CASE("the gradient of the contacts' energy is that of differences", "[cloth]") {
  Fixture f;
  REQUIRE(f.contacts.contacts().size() == 2);
  f.contacts.contacts()[1].impulse = Vector3<double>(0.004, 0.001, 0.006);
  auto springs = f.make();
  const Points<double> v = velocities(0.2, -0.1, 0.4);
  springs.freeze(v);
  Points<double> gradient = Points<double>::Zero(3, 3), unused = gradient;
  springs.add_energy(v, gradient);
  CHECK(gradient.norm() > 1e-3);
  const double e = 1e-6;
  for (Index k = 0; k < 9; ++k) {
    Points<double> more = v, less = v;
    more.data()[k] += e;
    less.data()[k] -= e;
    const double slope =
        (springs.add_energy(more, unused) - springs.add_energy(less, unused)) / (2 * e);
    CHECK(std::abs(slope - gradient.data()[k]) < 1e-7 * gradient.norm());
  }
}

TEST_CASE("the blocks of contacts are the derivative of their forces", "[cloth]") {
  Fixture f;
  f.contacts.contacts()[1].impulse = Vector3<double>(0.004, 0.001, 0.006);
  auto springs = f.make();
  const Points<double> v = velocities(0.2, -0.1, 0.4);
  springs.update(v);
  BlockSymmetric<double> matrix(3, {{0, 1}, {1, 2}, {0, 2}});
  springs.add_blocks(matrix);
  const Eigen::MatrixXd H = dense(matrix);
  CHECK(H.norm() > 0);
  // Forces are linear in v while states and shares stay.
  const auto impulse = [&](const Points<double>& w) {
    springs.take(w);
    Points<double> sum = Points<double>::Zero(3, 3);
    springs.for_each_force([&](int vertex, const detail::Triple<double>& force) {
      sum.col(vertex) += kStep * Vector3<double>(force.x, force.y, force.z);
    });
    return sum;
  };
  const Points<double> base = impulse(v);
  for (Index k = 0; k < 9; ++k) {
    Points<double> more = v;
    more.data()[k] += 1;
    const Points<double> change = impulse(more) - base;
    for (Index r = 0; r < 9; ++r) CHECK(std::abs(change.data()[r] + H(r, k)) < 1e-12 * H.norm());
  }
}

TEST_CASE("the blocks of contacts are replaced as states change", "[cloth]") {
  using Pairs = std::vector<std::pair<int, int>>;
  for (const Pairs& pairs : {Pairs{{0, 1}, {1, 2}, {0, 2}}, Pairs{{0, 1}, {1, 2}}}) {
    Fixture f;
    ObstacleContact<double>& inner = f.contacts.contacts()[1];
    inner.impulse = Vector3<double>(0.004, 0.001, 0.006);
    inner.point.vertex = {0, 1, 2};
    inner.point.weight = Vector3<double>(0.5, 0.3, 0.2);
    auto springs = f.make();
    Points<double> v = Points<double>::Zero(3, 3);
    v.row(1).setConstant(100);  // both slip, along y
    springs.update(v);
    for (const std::size_t i : {0u, 1u}) REQUIRE(f.springs[i].share < 1);
    BlockSymmetric<double> matrix(3, pairs), again(3, pairs);
    springs.add_blocks(matrix);
    const Eigen::MatrixXd slipping = dense(matrix);
    v.row(1).setConstant(0);
    springs.update(v);
    springs.replace_blocks(matrix);
    const Eigen::MatrixXd sticking = dense(matrix);
    CHECK((sticking - slipping).norm() > 0.1 * sticking.norm());
    springs.add_blocks(again);
    CHECK((sticking - dense(again)).norm() < 1e-12 * sticking.norm());
    // Off the slope, nothing is left.
    v.colwise() = Vector3<double>(6, 0, 8);
    springs.update(v);
    springs.replace_blocks(matrix);
    CHECK(dense(matrix).norm() < 1e-12 * sticking.norm());
  }
}

TEST_CASE("forces of contacts obey Coulomb's law and start from the last ones", "[cloth]") {
  Fixture f;
  const Vector3<double> n(0.6, 0, 0.8);
  f.contacts.contacts()[0].impulse = 0.01 * n;
  f.contacts.contacts()[0].carried = 0.01 / kStep;
  auto springs = f.make();
  ObstacleContactReport<double> report;
  // At rest, with the gap closed: the remembered force stays as it is.
  for (auto& s : f.springs) s.gap = 0;
  f.springs[1].gap = 1e-6;
  springs.update(Points<double>::Zero(3, 3));
  springs.take(Points<double>::Zero(3, 3));
  springs.store(Points<double>::Zero(3, 3), report);
  CHECK((f.contacts.contacts()[0].impulse - 0.01 * n).norm() < 1e-15);
  CHECK(f.contacts.contacts()[0].carried == Approx(0.01 / kStep));
  CHECK(f.contacts.contacts()[0].state == ContactState::Stick);
  CHECK(f.contacts.contacts()[1].state == ContactState::Open);
  CHECK(report.closed == 1);
  CHECK(report.penetration > 9e-4);  // the true gap is told
  // Sliding: on the cone, against the motion. Leaving: nothing.
  const Vector3<double> down(0.8, 0, -0.6);
  Points<double> slide(3, 3);
  slide.colwise() = Vector3<double>(10 * down);
  springs.update(slide);
  springs.take(slide);
  springs.store(slide, report);
  const Vector3<double> p = f.contacts.contacts()[0].impulse;
  CHECK(std::abs(p.dot(n) - 0.01) < 1e-12);
  CHECK(std::abs(p.dot(down) + 0.4 * 0.01) < 1e-12);
  CHECK(report.slipping == 1);
  Points<double> leave(3, 3);
  leave.colwise() = Vector3<double>(10 * n);
  springs.update(leave);
  springs.take(leave);
  springs.store(leave, report);
  CHECK(report.closed == 0);
  CHECK(f.contacts.contacts()[0].impulse.norm() == 0);
}

TEST_CASE("points of held vertices have no force, however deep", "[cloth]") {
  Fixture f;
  f.held = {1, 0, 1};
  for (auto& c : f.contacts.contacts()) c.impulse = Vector3<double>(0.006, 0, 0.008);
  ObstacleContactReport<double> report;
  auto springs = f.make();
  springs.update(Points<double>::Zero(3, 3));
  springs.take(Points<double>::Zero(3, 3));
  springs.store(Points<double>::Zero(3, 3), report);
  CHECK(report.closed == 0);
  CHECK(is_finite(report.velocity_residual));
  for (const auto& c : f.contacts.contacts()) CHECK(c.impulse.norm() == 0);
}

TEST_CASE("contacts that may only open do so where they pull", "[cloth]") {
  Fixture f;
  const Vector3<double> n(0.6, 0, 0.8);
  auto springs = f.make();
  Points<double> v = Points<double>::Zero(3, 3);
  v.row(1).setConstant(10);  // both slip
  springs.update(v);
  REQUIRE(f.springs[0].closed);
  REQUIRE(f.springs[1].closed);
  CHECK(f.springs[1].share < 1);
  v.row(1).setZero();
  v.col(f.contacts.contacts()[0].point.vertex[0]) = 10 * n;  // leaves
  springs.update(v, true);
  CHECK(!f.springs[0].closed);
  CHECK(f.springs[1].closed);
  CHECK(f.springs[1].share == 1);
  v.setZero();
  springs.update(v, true);
  CHECK(!f.springs[0].closed);
  springs.update(v);
  CHECK(f.springs[0].closed);
}
