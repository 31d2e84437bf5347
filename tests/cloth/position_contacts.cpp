// Contacts with obstacles in the substeps of a position-based sheet: one particle.

#include "clothctl/cloth/detail/position_contacts.hpp"

#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "clothctl/collision/moving_collider.hpp"
#include "clothctl/collision/shapes.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

constexpr double kH = 0.001, kThickness = 1e-3;

/// A particle of 10 g (with two others out of the way) over an obstacle.
template <class C>
struct Particle {
  explicit Particle(C c, const Vector3<double>& x) : obstacle(std::move(c)) {
    now.resize(3, 3);
    now << x[0], 10, 10, x[1], 10, 10.1, x[2], 10, 10;
    before = now;
    const std::vector<std::array<int, 3>> triangles{{0, 1, 2}};
    SheetContactSettings<double> vertices_only;
    vertices_only.inside = false;
    auto finder = SheetContactFinder<double>::create(now, triangles, {}, vertices_only).value();
    list.emplace_back(obstacle);
    (void)contacts.update(list, Points<double>::Zero(3, 3), 0.01, finder);
    planes.reserve(10);
    REQUIRE(contacts.contacts().size() == 1);
    solver.emplace(contacts, planes, inverse_mass);
  }
  /// A substep that ends `time` s after the start of the step, in which the particle moves by
  /// `way`.
  void substep(const Vector3<double>& way, double time = kH) {
    before = now;
    now.col(0) += way;
    const auto at = [this](int v) { return now.data() + 3 * v; };
    const auto start = [this](int v) { return before.data() + 3 * v; };
    solver->begin_substep(kH, time, at, start);
    solver->settle(at, solver->correct(at, 0.0), 0.0);
    solver->end_substep(at, start);
  }
  const ObstacleContact<double>& contact() const { return contacts.contacts()[0]; }

  C obstacle;
  Points<double> now, before;
  VectorX<double> inverse_mass = VectorX<double>::Constant(3, 100);
  std::vector<ColliderRef<double>> list;
  ObstacleContacts<double> contacts = ObstacleContacts<double>::create(10).value();
  detail::ContactPlaneList<double> planes;
  std::optional<detail::PositionContacts<double, 1>> solver;
};

PlaneCollider<double> floor_of(double friction) {
  return PlaneCollider<double>::create(Vector3<double>(0, 0, 0), Vector3<double>(0, 0, 1),
                                       {friction, 0})
      .value();
}

}  // namespace

TEST_CASE("a particle stops on the floor with the impulse of its fall", "[cloth]") {
  Particle<PlaneCollider<double>> p(floor_of(0.5), Vector3<double>(0, 0, kThickness));
  p.substep(Vector3<double>(0, 0, -2e-3));
  CHECK(std::abs(p.now(2, 0) - kThickness) < 1e-15);
  CHECK((p.now - p.before).norm() < 1e-15);  // no velocity
  CHECK(std::abs(p.contact().impulse[2] - 0.01 * 2e-3 / kH) < 1e-15);
  CHECK(p.contact().state == ContactState::Stick);
}

TEST_CASE("pushing out is slow and gives no velocity", "[cloth]") {
  Particle<PlaneCollider<double>> p(floor_of(0.5), Vector3<double>(0, 0, -0.01));
  p.substep(Vector3<double>(0, 0, 0));
  CHECK(std::abs(p.now(2, 0) + 0.01 - 0.5 * kH) < 1e-15);
  CHECK(std::abs(p.now(2, 0) - p.before(2, 0)) < 1e-15);
  CHECK(p.contact().impulse.norm() < 1e-15);
}

TEST_CASE("a particle sticks below the cone and slips on it", "[cloth]") {
  for (const double ratio : {0.49, 0.51, 2.0}) {
    Particle<PlaneCollider<double>> p(floor_of(0.5), Vector3<double>(0, 0, kThickness));
    p.substep(Vector3<double>(ratio * 1e-3, 0, -1e-3));
    const double expected = ratio < 0.5 ? 0 : (ratio - 0.5) * 1e-3;
    CHECK(std::abs(p.now(0, 0) - expected) < 1e-15);
    const Vector3<double> impulse = p.contact().impulse;
    CHECK(std::abs(-impulse[0] - std::min(ratio, 0.5) * impulse[2]) < 1e-15);
    CHECK(p.contact().state == (ratio < 0.5 ? ContactState::Stick : ContactState::Slip));
  }
}

TEST_CASE("what drifts while it does not touch is brought back", "[cloth]") {
  Particle<PlaneCollider<double>> p(floor_of(0.5), Vector3<double>(0, 0, kThickness));
  p.substep(Vector3<double>(0, 0, -1e-4));
  p.substep(Vector3<double>(1e-5, 0, 1e-6));  // loose, drifting
  CHECK(p.now(0, 0) == 1e-5);
  p.substep(Vector3<double>(0, 0, -1e-4));
  CHECK(std::abs(p.now(0, 0)) < 1e-15);
}

TEST_CASE("a moving surface takes a particle along", "[cloth]") {
  RigidMotion<double> motion;
  motion.velocity = Vector3<double>(0.2, 0, 0.1);
  auto floor =
      MovingCollider<double, PlaneCollider<double>>::create(floor_of(0.5), motion, {0.5, 0})
          .value();
  Particle<MovingCollider<double, PlaneCollider<double>>> p(floor,
                                                            Vector3<double>(0, 0, kThickness));
  for (int i = 1; i <= 5; ++i) p.substep(Vector3<double>(0, 0, -1e-3), kH * i);
  CHECK((p.now.col(0) - Vector3<double>(0.2 * 5 * kH, 0, kThickness + 0.1 * 5 * kH)).norm() <
        1e-15);
}

TEST_CASE("a particle that has passed a thin plate is brought back", "[cloth]") {
  const auto plate =
      BoxCollider<double>::create(Vector3<double>(0, 0, 0), Vector3<double>(0.1, 0.1, 0.0002))
          .value();
  Particle<BoxCollider<double>> p(plate, Vector3<double>(0, 0, 0.0015));
  p.substep(Vector3<double>(0, 0, -0.004));
  CHECK(p.now(2, 0) > 0);
  CHECK(std::abs(p.now(2, 0) - 0.0012) < 1e-12);
}

TEST_CASE("held vertices are left alone", "[cloth]") {
  Particle<PlaneCollider<double>> p(floor_of(0.5), Vector3<double>(0, 0, kThickness));
  p.inverse_mass.setZero();
  p.solver.emplace(p.contacts, p.planes, p.inverse_mass);
  p.substep(Vector3<double>(0, 0, -0.002));
  CHECK(p.now(2, 0) == kThickness - 0.002);
}

TEST_CASE("sweeps that move the start of a substep change no velocity at a contact", "[cloth]") {
  // Sweeps for a limit lift a particle that lies on the floor, and the start of the substep alike.
  Particle<PlaneCollider<double>> p(floor_of(0.5), Vector3<double>(0, 0, kThickness));
  p.before = p.now;
  const auto at = [&](int v) { return p.now.data() + 3 * v; };
  const auto start = [&](int v) { return p.before.data() + 3 * v; };
  p.now(2, 0) -= 2e-5;
  p.solver->begin_substep(kH, kH, at, start);
  p.solver->settle(at, p.solver->correct(at, 0.0), 0.0);
  p.now(2, 0) += 1e-5;
  p.before(2, 0) += 1e-5;
  p.solver->end_substep(at, start);
  CHECK(std::abs(p.now(2, 0) - p.before(2, 0)) < 1e-15);
}

TEST_CASE("a contact brings back what sweeps without effect on velocities moved", "[cloth]") {
  // It lies on the floor and sticks. Then a sweep for a limit moves it across; a quarter of that
  // goes into its velocity, and so does a quarter of the way back.
  Particle<PlaneCollider<double>> p(floor_of(0.5), Vector3<double>(0, 0, kThickness));
  p.before = p.now;
  const auto at = [&](int v) { return p.now.data() + 3 * v; };
  const auto start = [&](int v) { return p.before.data() + 3 * v; };
  const double still = 0.75;
  p.now(2, 0) -= 2e-5;
  p.solver->begin_substep(kH, kH, at, start);
  CHECK(p.solver->correct(at, 0.0) > 0);
  const Vector3<double> moved(6e-6, 0, 0), settled = p.now.col(0);
  p.now.col(0) += moved;
  p.before.col(0) += still * moved;
  const Points<double> reached = p.now;
  CHECK(p.solver->correct(at, still) == 0);
  p.before += still * (p.now - reached);
  p.solver->end_substep(at, start);
  CHECK((p.now.col(0) - settled).norm() < 1e-16);
  CHECK((p.now - p.before).col(0).norm() < 1e-16);
  CHECK(p.contact().state == ContactState::Stick);
  const Vector3<double> impulse = p.contact().impulse * kH / 0.01;
  CHECK((impulse - Vector3<double>(-0.25 * 6e-6, 0, 2e-5)).norm() < 1e-15);
}

TEST_CASE("a contact that sweeps for a limit release or press tells what it did, and never pulls",
          "[cloth]") {
  const double still = 0.95;
  for (const double lifted : {1e-5, 5e-5, -5e-5}) {
    for (const double in : {2e-5, -5e-5}) {  // it comes in, or is deep and on its way out
      CAPTURE(lifted, in);
      Particle<PlaneCollider<double>> p(floor_of(0.5),
                                        Vector3<double>(0, 0, kThickness - (in < 0 ? 1e-4 : 0.0)));
      p.before = p.now;
      const auto at = [&](int v) { return p.now.data() + 3 * v; };
      const auto start = [&](int v) { return p.before.data() + 3 * v; };
      p.now.col(0) += Vector3<double>(1e-5, 0, -in);
      const Vector3<double> way = (p.now - p.before).col(0);
      p.solver->begin_substep(kH, kH, at, start);
      (void)p.solver->correct(at, 0.0);
      p.now(2, 0) += lifted;
      p.before(2, 0) += still * lifted;
      Points<double> reached = p.now;
      (void)p.solver->correct(at, still);
      p.before += still * (p.now - reached);
      p.solver->end_substep(at, start);
      // The sweep itself counts by 1 - still.
      const Vector3<double> swept(0, 0, (1 - still) * lifted);
      const Vector3<double> changed = (p.now - p.before).col(0) - way - swept;
      const Vector3<double> impulse = p.contact().impulse * kH / 0.01;
      CHECK((impulse - changed).norm() < 1e-18);
      CHECK(impulse[2] >= -1e-18);
      CHECK(impulse.head<2>().norm() <= 0.5 * impulse[2] + 1e-18);
    }
  }
}

TEST_CASE("a point inside an obstacle is lifted to its surface, one above is left alone",
          "[cloth]") {
  Particle<PlaneCollider<double>> p(floor_of(0.5), Vector3<double>(0, 0, kThickness));
  p.before = p.now;
  const auto at = [&](int v) { return p.now.data() + 3 * v; };
  const auto start = [&](int v) { return p.before.data() + 3 * v; };
  p.solver->begin_substep(kH, kH, at, start);
  p.now(2, 0) = 0.2e-3;
  p.solver->lift(at, 0.25);
  CHECK(p.now(2, 0) == 0.2e-3);
  p.now(2, 0) = -3e-3;
  p.solver->lift(at, 0.25);  // a quarter of the way in and back is velocity
  CHECK(std::abs(p.now(2, 0)) < 1e-15);
  p.solver->end_substep(at, start);
  CHECK(std::abs(p.contact().impulse[2] - 0.01 * 0.25 * 3e-3 / kH) < 1e-12);
}
