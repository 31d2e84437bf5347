#pragma once

// A sheet of any model that touches obstacles: what a user's loop does in a step.

#include <array>
#include <cmath>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/collision/shapes.hpp"
#include "clothctl/contact/obstacle_contacts.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

namespace clothctl_test {

/// A level square sheet of `n`×`n` vertices and 0.3 m, at the height z, its middle at x = y = 0.
template <class S>
clothctl::SpringNetwork<S> level_sheet(int n, double z = 0) {
  const auto grid = clothctl::make_grid<double>(n, n, 0.3, 0.3).value();
  clothctl::Points<double> x = grid.positions;
  const clothctl::Points<double> hanging = x;
  x.row(0) = hanging.row(0).array() - hanging.row(0).mean();
  x.row(1) = hanging.row(2).array() - hanging.row(2).mean();
  x.row(2).setConstant(z);
  return clothctl::sheet_network<S>(x.cast<S>(), grid.triangles, clothctl::Material<S>()).value();
}

/// The sheet, its obstacles and all memory.
template <class Model>
struct SheetOnObstacles {
  using S = typename Model::Scalar;

  explicit SheetOnObstacles(Model m, const clothctl::ObstacleContactSettings<S>& settings = {})
      : model(std::move(m)),
        state(model.rest_state()),
        finder(make_finder(model.network(), settings)),
        contacts(clothctl::ObstacleContacts<S>::create(kRoom, settings).value()),
        ws(model.make_workspace(kRoom)) {}

  static clothctl::SheetContactFinder<S> make_finder(
      const clothctl::SpringNetwork<S>& network,
      const clothctl::ObstacleContactSettings<S>& settings) {
    clothctl::SheetContactSettings<S> inside;
    inside.smooth_gain = settings.thickness;
    return clothctl::SheetContactFinder<S>::create(network.rest_positions, network.triangles, {},
                                                   inside)
        .value();
  }

  /// Lists the contacts and makes a step. Returns false where something refuses.
  bool try_advance(double h) {
    return finder.update(state.positions) == clothctl::QueryStatus::Answered &&
           contacts.update(obstacles, state.velocities, S(h), finder) ==
               clothctl::QueryStatus::Answered &&
           contacts.complete() && model.step(state, input, contacts, S(h), ws).advanced;
  }
  /// The same; the test ends where something refuses.
  void advance(double h) {
    const bool advanced = try_advance(h);
    if (!advanced) REQUIRE(advanced);
  }

  /// Sum of the impulses on the sheet in the last step, N s.
  clothctl::Vector3<double> impulse() const {
    clothctl::Vector3<double> sum = clothctl::Vector3<double>::Zero();
    for (const auto& c : contacts.contacts()) sum += c.impulse.template cast<double>();
    return sum;
  }
  /// Momentum of the sheet, N s.
  clothctl::Vector3<double> momentum() const {
    return (state.velocities * model.network().mass).template cast<double>();
  }

  static constexpr clothctl::Index kRoom = 4000;
  Model model;
  clothctl::ClothState<S> state;
  clothctl::SheetContactFinder<S> finder;
  clothctl::ObstacleContacts<S> contacts;
  typename Model::Workspace ws;
  clothctl::ClothInput<S> input;
  std::vector<clothctl::ColliderRef<S>> obstacles;
};

/// A slope through the origin that falls along +x by the angle.
template <class S>
clothctl::PlaneCollider<S> slope(double angle, double friction) {
  const clothctl::Vector3<S> normal(S(std::sin(angle)), S(0), S(std::cos(angle)));
  return clothctl::PlaneCollider<S>::create(clothctl::Vector3<S>::Zero(), normal, {S(friction), 0})
      .value();
}

}  // namespace clothctl_test
