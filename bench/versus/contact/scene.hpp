#pragma once

// The scene of the comparison: 1 m × 1 m of cotton, level, 5 cm above a sphere or a cube.

#include <string>

#include "clothctl/network/spring_network.hpp"
#include "engine.hpp"

namespace versus {

/// Height of the sheet above the obstacle at the start (m).
inline constexpr double kDrop = 0.05;

/// Our network of the scene's sheet: the others have its masses, edges and triangles.
template <class Scalar>
clothctl::SpringNetwork<Scalar> cotton_network(int side, double height);

/// Makes a scene with N × N vertices.
Scene make_scene(int side, const Obstacle& obstacle, bool self, int substeps);

/// Height of the sheet at the start (m).
inline double start_height(const Obstacle& obstacle) { return obstacle.size + kDrop; }

}  // namespace versus
