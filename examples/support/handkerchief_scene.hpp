#pragma once

// The sheet that is moved by its upper corners, at rest between two hands.

#include <functional>
#include <vector>

#include "clothctl/mesh/grid.hpp"
#include "support/scene.hpp"

namespace program {

using Grid = clothctl::GridMesh<double>;

/// The vertices at the lower corners of a sheet.
std::vector<int> lower_corners(const Grid& grid);

/// Makes body, grips, features and settings; the features are the vertices `features`.
Scene handkerchief_scene(const Options& o, const Grid& grid, const std::vector<int>& features,
                         const clothctl::Material<double>& material);

/// Lets the sheet hang from the hands. It starts in the vertical plane through the first targets of
/// the task (if there are any), left to right, slightly bent, with the hands `spread` apart.
/// `body`: that of the scene, or one of another material.
clothctl::ClothState<double> hang_handkerchief(const Options& o, const Grid& grid, const Task& task,
                                               const Scene& scene, const Body& body);

/// Moves the hands of a sheet that rests along their paths, with converged steps, and returns the
/// curves of its lower corners: the paths of the hands are a known solution.
Task follow_hands(const Grid& grid, const Scene& scene, const clothctl::ClothState<double>& rest,
                  const Task& hands);

/// Moves curves from a file so that they start at the features of the sheet at rest. x: its
/// positions, 3×n, m. Refuses or warns of curves that are further apart than the cloth is wide.
void fit_targets(const Options& o, const Grid& grid, const std::vector<int>& features,
                 const Points& x, Task& task);

/// Returns air that blows across the sheet at a mean speed (m/s) that it reaches within 2 s, with
/// gusts of at most 1.8 times that speed.
std::function<Vec(double)> gusts(double speed);

}  // namespace program
