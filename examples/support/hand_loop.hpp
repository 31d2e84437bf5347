#pragma once

// The handkerchief in simulated hands: two hands grasp the upper corners of the hanging sheet, and
// what they do follows the plan of contact forces.

#include <functional>

#include "clothctl/core/cloth_state.hpp"
#include "clothctl/mesh/grid.hpp"
#include "support/hand_model.hpp"
#include "support/scene.hpp"

namespace program {

/// Makes the task start where the features are: x, 3×n, m.
using FitTask = std::function<void(const Points& x, Scene& scene)>;

/// Runs the task with bare forces on the vertices of the scene's grips, and with two hands of a
/// kind that grasp beside its upper corners the sheet of a grid that hangs from those vertices in
/// `state`. Prints the figures of both, and writes the requested files. Returns the program's exit
/// code.
int run_hands(Scene scene, const Options& o, const clothctl::GridMesh<double>& grid,
              const clothctl::ClothState<double>& state, const FitTask& fit_task,
              const HandMaker& make_hand);

}  // namespace program
