#pragma once

// A sheet for a hand to grasp: it hangs from its upper corners, or lies on a table with an edge
// over that of the table.

#include <memory>
#include <string>
#include <vector>

#include "clothctl/collision/shapes.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/materials.hpp"
#include "support/hand_grasp.hpp"

namespace program {

/// The sheet and its world.
struct HandScene {
  clothctl::World<double> world;
  clothctl::GridMesh<double> grid;
  std::unique_ptr<clothctl::BoxCollider<double>> table;  ///< none where the sheet hangs
  GraspPlace place;                                      ///< where to grasp it

  /// What is in the way of a hand beside the sheet.
  std::vector<clothctl::ColliderRef<double>> obstacles() const {
    std::vector<clothctl::ColliderRef<double>> out;
    if (table) out.emplace_back(*table);
    return out;
  }
  /// The corners of the triangles of the table, for a page.
  clothctl::Points<double> solids() const;
};

/// Makes a square sheet of `side` × `side` vertices and `size` m that hangs, or lies on a table if
/// `flat`; it has come to rest.
std::unique_ptr<HandScene> make_hand_scene(int side, double size,
                                           const clothctl::Material<double>& material, bool flat,
                                           double dt);

}  // namespace program
