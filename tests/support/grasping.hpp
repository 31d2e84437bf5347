#pragma once

// hand34 beside the upper left corner of a hanging sheet, ready to pinch it.

#include <array>
#include <utility>
#include <vector>

#include "clothctl/grasp/fingertip_tracker.hpp"
#include "clothctl/grasp/grasp_controller.hpp"
#include "clothctl/grasp/hand_geometry.hpp"
#include "clothctl/robot/hand34.hpp"
#include "support/pads.hpp"

namespace clothctl_test {

using Hand34 = clothctl::KinematicTree<double>;

/// The world: sheet 0, hand 0 and its controller. Thumb and index are fingers 0 and 1 of the grasp.
struct PinchingHand {
  clothctl::World<double> world;
  Hand34 tree = clothctl::hand34<double>();
  clothctl::HandGeometry<double> geometry = clothctl::hand34_geometry(tree);
  clothctl::Vector3<double> at;
  clothctl::GraspPoses<double> poses;
  clothctl::HandInWorld in;
  clothctl::Grasp<double> grasp;
  double dt;

  explicit PinchingHand(int n, double step = 0.02, double friction = 0.6) : dt(step) {
    using Vec = clothctl::Vector3<double>;
    at = add_hanging_sheet(world, n);
    auto& input = world.input(0);
    input.driven_vertices = {n * (n - 1), n * n - 1};
    input.driven_positions = clothctl::Points<double>(3, 2);
    for (int k = 0; k < 2; ++k) {
      const int v = input.driven_vertices[static_cast<std::size_t>(k)];
      input.driven_positions.col(k) = world.state(0).positions.col(v);
    }
    const clothctl::VectorX<double> grip =
        clothctl::hand34_pinch_at<double>(tree, at, Vec(0, 1, 0), Vec(0, 0, -1));
    const std::vector<clothctl::FingerPad<double>> two{geometry.fingers[0], geometry.fingers[1]};
    const Vec y(0, 1, 0);
    const std::vector<clothctl::GraspContact<double>> places{{at, y}, {at, -y}};
    poses = clothctl::find_grasp_poses<Hand34, double>(tree, two, places, grip, grip);
    clothctl::HandSetup<double> setup;
    setup.positions = poses.wait;
    setup.control = clothctl::StablePdSettings<double>::uniform(tree.nv());
    const int hand = world.add_hand(tree, setup).value();
    clothctl::HandSurface<double> surface;
    surface.pad.friction = friction;
    surface.with_pads = {0, 1};
    in = clothctl::add_hand_geometry<double>(world, hand, geometry, surface).value();
    grasp.fingers = {{0, places[0].press}, {1, places[1].press}};
    grasp.keyframes = {poses.touch};
  }

  clothctl::GraspController<Hand34> controller(
      const clothctl::GraspSettings<double>& settings = {}) const {
    return clothctl::GraspController<Hand34>::create(tree, geometry.fingers, poses.wait, settings)
        .value();
  }
  std::array<clothctl::PadTouch<double>, 2> touches() const {
    return {clothctl::pad_touch(world, in.pads[0], dt), clothctl::pad_touch(world, in.pads[1], dt)};
  }
  /// One step of controller and world.
  clothctl::GraspReport<double> step(clothctl::GraspController<Hand34>& controller) {
    const auto felt = touches();
    const auto report = controller.update(dt, world.hand(0), felt, world.drive(0));
    advanced = world.step(dt).advanced && advanced;
    return report;
  }
  bool advanced = true;
};

}  // namespace clothctl_test
