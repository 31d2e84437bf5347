#pragma once

// The parts of a world.

#include <memory>
#include <vector>

#include "clothctl/sim/detail/world_hand.hpp"
#include "clothctl/sim/detail/world_obstacle.hpp"
#include "clothctl/sim/detail/world_sheet.hpp"
#include "clothctl/sim/rigid_bodies.hpp"
#include "clothctl/sim/world_setup.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// What was added to a world, in the order of its numbers.
template <RealScalar Scalar>
struct WorldParts {
  explicit WorldParts(const RigidBodiesSettings<Scalar>& settings) : bodies(settings) {}

  std::vector<std::unique_ptr<WorldSheet<Scalar>>> sheets;
  std::vector<WorldSheetSetup<Scalar>> setups;
  std::vector<std::unique_ptr<WorldObstacle<Scalar>>> obstacles;
  std::vector<std::unique_ptr<WorldHand<Scalar>>> hands;
  RigidBodies<Scalar> bodies;
  std::vector<CollisionGroups> body_groups;

  /// Whether a sheet may touch an obstacle, or body b with `number` -1 - b.
  bool meet(std::size_t sheet, int number) const {
    const CollisionGroups& groups = number < 0
                                        ? body_groups[static_cast<std::size_t>(-1 - number)]
                                        : obstacles[static_cast<std::size_t>(number)]->groups;
    return groups.meets(setups[sheet].groups);
  }
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
