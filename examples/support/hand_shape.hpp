#pragma once

// A mesh for robots without shapes: every body is the convex hull of balls at its joints and at the
// ends of its links,
//
//   x(d) = c + r d,   (c, r) the ball that reaches furthest along d: max c·d + r
//
// for the directions d of a globe whose axis is the body's longest extent. Two balls make a tapered
// bone, more balls a palm.

#include <array>
#include <vector>

#include "clothctl/robot/forward_kinematics.hpp"

namespace program {

/// Triangles whose vertices are fixed to bodies.
struct HandShape {
  /// The triangles, facing outwards.
  std::vector<std::array<int, 3>> triangles;
  /// The body of each vertex; -1 for the world.
  std::vector<int> bodies;
  /// The vertices in their bodies' frames (3 × vertices, m).
  Eigen::Matrix3Xd vertices;
};

/// Makes the shape of a robot. `start` holds its poses in the first frame.
HandShape make_hand_shape(const clothctl::KinematicTree<double>& tree,
                          const clothctl::BodyPoses<double>& start);

/// Writes the positions of the vertices (3 × vertices, m, world).
void place_hand(const HandShape& shape, const clothctl::BodyPoses<double>& body_poses,
                Eigen::Matrix3Xd& vertices);

}  // namespace program
