#pragma once

// The laws that every CollidingCloth must obey, in addition to those of ClothModel
// (cloth_laws.hpp). Call check_colliding_cloth_laws(model, laws) inside a TEST_CASE. The sheet
// starts at rest, free, above a rough floor that it falls on.
//
//   free      a step with no contacts ends as that of the ClothModel does
//   momentum  besides gravity, the momentum of the sheet changes by the impulses that are told
//   push      an impulse pushes out of the obstacle and lies within the cone of friction
//   floor     the sheet ends no deeper in the floor than the tolerance
//   refusal   a step that does not report `advanced` leaves the state bitwise as it was
//   memory    a step does not allocate

#include <array>
#include <limits>
#include <vector>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/collision/sheet_contacts.hpp"
#include "clothctl/concepts/colliding_cloth.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// The properties of a model, and the tolerances of the laws.
template <class Scalar>
struct CollidingClothLaws {
  /// Step length, s, and number of steps.
  Scalar dt = Scalar(0.01);
  int steps = 40;
  /// Friction of the floor.
  Scalar friction = Scalar(0.4);
  /// How far the floor is below the lowest vertex at rest, m, and the sheet's way along it in a
  /// second, m/s.
  Scalar height = Scalar(0.02), speed = Scalar(0.3);
  /// Largest error of the momentum, as a part of the sheet's weight times dt.
  Scalar momentum = Scalar(1e-9);
  /// Largest depth below the thickness at the end, m.
  Scalar depth = Scalar(1e-4);
  /// Largest difference of velocities in the law `free`, m/s.
  Scalar tolerance = Scalar(1e-9);
};

/// Checks all laws of this file. A failed CHECK names the law. `gravity` is that of the model.
template <class Model, class Scalar>
void check_colliding_cloth_laws(const Model& model, const CollidingClothLaws<Scalar>& laws,
                                const clothctl::Vector3<Scalar>& gravity) {
  using namespace clothctl;
  static_assert(CollidingCloth<Model, ObstacleContacts<Scalar>, Scalar>);
  using Traits = cloth_traits<Model>;
  using Colliding = colliding_cloth_traits<Model>;
  const Index n = Traits::vertex_count(model), room = 20 * n;
  const VectorX<Scalar> mass(Colliding::masses(model));
  const std::vector<std::array<int, 3>> triangles(Colliding::triangles(model));
  REQUIRE(mass.size() == n);
  REQUIRE(Scalar(0) < mass.minCoeff());

  const ClothState<Scalar> rest = Traits::rest_state(model);
  auto ws = Colliding::make_workspace(model, room);
  auto finder = SheetContactFinder<Scalar>::create(rest.positions, triangles).value();
  auto contacts = ObstacleContacts<Scalar>::create(room).value();
  ClothInput<Scalar> input;
  input.clear();
  {
    INFO("law: free");
    ClothState<Scalar> expected = rest, got = rest;
    auto plain = Traits::make_workspace(model);
    REQUIRE(Traits::step(model, expected, input, laws.dt, plain).advanced);
    REQUIRE(contacts.update({}, got.velocities, laws.dt, finder) == QueryStatus::Answered);
    REQUIRE(Colliding::step(model, got, input, contacts, laws.dt, ws).advanced);
    CHECK((got.velocities - expected.velocities).cwiseAbs().maxCoeff() <= laws.tolerance);
  }
  const Scalar floor = rest.positions.row(2).minCoeff() - laws.height;
  const auto plane = PlaneCollider<Scalar>::create({Scalar(0), Scalar(0), floor},
                                                   Vector3<Scalar>::UnitZ(), {laws.friction})
                         .value();
  const std::vector<ColliderRef<Scalar>> obstacles{ColliderRef<Scalar>(plane)};
  ClothState<Scalar> state = rest;
  state.velocities.row(0).setConstant(laws.speed);
  const Scalar weight = mass.sum() * gravity.norm();
  Scalar pushed(0);
  for (int k = 0; k < laws.steps; ++k) {
    CAPTURE(k);
    const Vector3<Scalar> before = state.velocities * mass;
    const long allocated = allocations();
    REQUIRE(finder.update(state.positions) == QueryStatus::Answered);
    REQUIRE(contacts.update(obstacles, state.velocities, laws.dt, finder) == QueryStatus::Answered);
    const StepReport<Scalar> report = Colliding::step(model, state, input, contacts, laws.dt, ws);
    const long made = allocations() - allocated;
    REQUIRE(report.advanced);
    INFO("law: memory");
    if (allocation_counting_works()) CHECK(made == 0);
    Vector3<Scalar> impulse = Vector3<Scalar>::Zero();
    for (const ObstacleContact<Scalar>& c : contacts.contacts()) {
      INFO("law: push");
      const Scalar slack = laws.momentum * weight * laws.dt;
      CHECK(c.impulse[2] >= -slack);
      CHECK(c.impulse.template head<2>().norm() <= laws.friction * c.impulse[2] + slack);
      if (c.state == ContactState::Open) CHECK(c.impulse.isZero());
      impulse += c.impulse;
    }
    pushed += impulse[2];
    INFO("law: momentum");
    const Vector3<Scalar> expected = before + impulse + mass.sum() * laws.dt * gravity;
    CHECK((state.velocities * mass - expected).norm() <= laws.momentum * weight * laws.dt);
  }
  {
    INFO("law: floor");
    CHECK(Scalar(0) < pushed);  // it did reach the floor
    const Scalar level = floor + contacts.settings().thickness;
    CHECK(state.positions.row(2).minCoeff() >= level - laws.depth);
  }
  {
    INFO("law: refusal");
    ClothState<Scalar> same = state;
    const Scalar nan = std::numeric_limits<Scalar>::quiet_NaN();
    for (const Scalar dt : {Scalar(0), -laws.dt, nan})
      CHECK_FALSE(Colliding::step(model, same, input, contacts, dt, ws).advanced);
    CHECK(same == state);
  }
}

}  // namespace clothctl_test
