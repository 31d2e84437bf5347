#pragma once

// Whether what a hand gives a sheet is what the sheet takes from the hand.

#include "clothctl/grasp/hand_geometry.hpp"
#include "clothctl/robot/kinematic_tree_model.hpp"
#include "clothctl/sim/world.hpp"

namespace program {

/// Whether the first three joints of a robot slide along x, y and z.
bool base_slides(const clothctl::KinematicTree<double>& tree);

/// Momentum of a hand whose base slides that neither its joints nor the sheet account for in the
/// last step, of `dt` s, as a share of the largest force of a contact, at least 1 N. `before`: its
/// state before the step, which the world did not divide.
double momentum_residual(clothctl::World<double>& world, const clothctl::HandInWorld& parts,
                         const clothctl::KinematicTree<double>& tree,
                         const clothctl::HandState<double>& before, double dt);

}  // namespace program
