#pragma once

// A sheet that hangs in y = 0, and soft pads that pinch it from both sides.

#include <cmath>
#include <utility>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/collision/shapes.hpp"
#include "clothctl/math/rotation.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/robot/kinematic_tree_builder.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "clothctl/sim/world.hpp"
#include "support/allocations.hpp"

namespace clothctl_test {

/// Four samples on a radius of 5 mm around `centre`, with the normal `side` y.
inline std::vector<clothctl::PadSample<double>> pad_samples(
    double side = 1, const clothctl::Vector3<double>& centre = clothctl::Vector3<double>::Zero()) {
  std::vector<clothctl::PadSample<double>> out;
  for (const double a : {0.25, 0.75, 1.25, 1.75}) {
    const double angle = a * std::acos(-1.0);
    out.push_back({centre + 0.005 * clothctl::Vector3<double>(std::cos(angle), 0, std::sin(angle)),
                   clothctl::Vector3<double>(0, side, 0)});
  }
  return out;
}

/// A square mass-spring sheet of n×n vertices and 0.3 m in y = 0.
inline clothctl::MassSpring<double> hanging_sheet(
    int n, const clothctl::Vector3<double>& gravity = clothctl::Vector3<double>(0, 0, -9.81)) {
  const auto grid = clothctl::make_grid<double>(n, n, 0.3, 0.3).value();
  auto settings = clothctl::MassSpringSettings<double>::of(clothctl::Material<double>());
  settings.gravity = gravity;
  if (gravity.isZero()) settings.drag = 0;  // nothing changes its momentum
  return clothctl::MassSpring<double>::create(
             clothctl::sheet_network(grid, clothctl::Material<double>()).value(), settings)
      .value();
}

/// The same sheet, position-based, with edges that stretch by at most 2 %.
inline clothctl::PositionBased<double> limited_sheet(
    int n, const clothctl::Vector3<double>& gravity = clothctl::Vector3<double>(0, 0, -9.81)) {
  auto settings = clothctl::PositionBasedSettings<double>::of(clothctl::Material<double>());
  settings.gravity = gravity;
  settings.stretch_limit = 0.02;
  if (gravity.isZero()) settings.drag = 0;
  return clothctl::PositionBased<double>::create(hanging_sheet(n).network(), settings).value();
}

/// Adds the sheet to a world and returns a place near its upper left corner.
inline clothctl::Vector3<double> add_hanging_sheet(
    clothctl::World<double>& world, int n,
    const clothctl::Vector3<double>& gravity = clothctl::Vector3<double>(0, 0, -9.81),
    const clothctl::WorldSheetSetup<double>& setup = {}, bool position_based = false) {
  clothctl::ClothState<double> state = hanging_sheet(n, gravity).rest_state();
  const clothctl::Points<double>& x = state.positions;
  const clothctl::Vector3<double> corner(x.row(0).minCoeff() + 0.02, 0, x.row(2).maxCoeff() - 0.02);
  if (position_based) {
    (void)world.add_sheet(limited_sheet(n, gravity), std::move(state), setup).value();
  } else {
    (void)world.add_sheet(hanging_sheet(n, gravity), std::move(state), setup).value();
  }
  return corner;
}

/// A small ball that carries a pad.
inline clothctl::SphereCollider<double> pad_ball() {
  return clothctl::SphereCollider<double>::create(clothctl::Vector3<double>::Zero(), 0.004).value();
}

/// Adds a ball with a pad on the `side` of `at`, where they press on a sheet in y = 0.
inline void add_ball_with_pad(clothctl::World<double>& world, double side,
                              const clothctl::Vector3<double>& at,
                              clothctl::RigidBodySetup<double> ball) {
  const clothctl::Vector3<double> y(0, side, 0);
  ball.motion.position = at - 0.0095 * y;
  const int body = world.add_body(ball).value();
  (void)world.add_pad(-1 - body, pad_samples(side, 0.01 * y)).value();
}

/// A rail along x and two fingers on it that close along y, with their frames at the origin.
inline clothctl::KinematicTree<double> two_fingers() {
  clothctl::KinematicTreeBuilder<double> robot;
  clothctl::Inertia<double> body;
  body.mass = 0.05;
  body.about_com.diagonal().setConstant(1e-5);
  robot.add_link("world");
  const auto add = [&](const char* name, const char* parent, const char* child,
                       const clothctl::Vector3<double>& axis) {
    clothctl::Joint<double> joint;
    joint.name = name;
    joint.type = clothctl::JointType::Prismatic;
    joint.parent = parent;
    joint.child = child;
    joint.axis = axis;
    joint.limits = {-10, 10, 100, 1e4};
    robot.add_link(child, body).add_joint(joint);
  };
  add("rail", "world", "palm", clothctl::Vector3<double>(1, 0, 0));
  add("back", "palm", "back_finger", clothctl::Vector3<double>(0, 1, 0));
  add("front", "palm", "front_finger", clothctl::Vector3<double>(0, -1, 0));
  return robot.build().value();
}

/// A world whose gripper holds the sheet with a force (N); the gripper is hand 0, its pads are 0
/// and 1.
struct GrippedSheet {
  clothctl::World<double> world;
  clothctl::Vector3<double> at;

  explicit GrippedSheet(int n, double force, double friction = 0.6,
                        const clothctl::WorldSheetSetup<double>& setup = {},
                        bool position_based = false) {
    const clothctl::Vector3<double> gravity(0, 0, -9.81);
    at = add_hanging_sheet(world, n, gravity, setup, position_based);
    clothctl::HandSetup<double> hand;
    hand.positions = Eigen::Vector3d::Zero();
    hand.control.kp = Eigen::Vector3d(1e4, 0, 0);
    hand.control.kd = Eigen::Vector3d(1e3, 5, 5);
    const clothctl::KinematicTree<double> tree = two_fingers();
    (void)world.add_hand(tree, hand).value();
    world.drive(0).torque = Eigen::Vector3d(0, force, force);
    clothctl::PadSettings<double> pad;
    pad.friction = friction;
    for (const double side : {1.0, -1.0}) {
      const int frame = tree.find_link(side > 0 ? "back_finger" : "front_finger");
      const int carrier = world.add_link_shape(0, frame, pad_ball()).value();
      (void)world.add_pad(carrier, pad_samples(side, at), pad).value();
    }
  }

  /// Moves the rail for a second. Returns the number of allocations, or -1 when a step failed.
  long drag() {
    if (!world.step(0.02).advanced) return -1;
    const long before = allocations();
    for (int i = 0; i < 50; ++i) {
      world.drive(0).target[0] = 0.001 * i;
      if (!world.step(0.02).advanced) return -1;
    }
    return allocations() - before;
  }
  /// The sum of the impulses of the pads on the sheet, N s.
  clothctl::Vector3<double> impulse() const {
    clothctl::Vector3<double> sum = clothctl::Vector3<double>::Zero();
    for (int pad = 0; pad < 2; ++pad) {
      for (const auto& c : world.pad_contacts(pad)) sum += c.impulse;
    }
    return sum;
  }
};

}  // namespace clothctl_test
