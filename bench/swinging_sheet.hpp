#pragma once

// A sheet that swings from two corners, which hands move back and forth so that no step is trivial.

#include <cmath>
#include <utility>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/network/sheet.hpp"

namespace clothctl_bench {

using namespace clothctl;

/// Returns an n×n sheet of 0.5 m that is pinned at the corners of its last row.
template <class Scalar>
Result<MassSpring<Scalar>> pinned_sheet(int n, MassSpringSettings<Scalar> settings) {
  const Result<GridMesh<Scalar>> grid = make_grid<Scalar>(n, n, Scalar(0.5), Scalar(0.5));
  if (!grid) return Error{grid.error()};
  const Material<Scalar> material;
  const Result<SpringNetwork<Scalar>> network = sheet_network(grid.value(), material);
  if (!network) return Error{network.error()};
  settings.drag = material.drag;
  settings.pinned = {n * n - n, n * n - 1};
  return MassSpring<Scalar>::create(network.value(), std::move(settings));
}

/// The hands of a pinned sheet of n×n vertices: the input of one frame after the other.
template <class Scalar>
class SwingingHands {
 public:
  explicit SwingingHands(const MassSpring<Scalar>& sheet) {
    const Points<Scalar>& rest = sheet.network().rest_positions;
    input_.driven_vertices = sheet.settings().pinned;
    home_.resize(3, 2);
    for (Index hand = 0; hand < 2; ++hand)
      home_.col(hand) = rest.col(input_.driven_vertices[static_cast<std::size_t>(hand)]);
    input_.driven_positions = home_;
  }

  /// Returns the input of the next frame.
  const ClothInput<Scalar>& next() {
    const Scalar sway = Scalar(0.05) * Scalar(std::sin(0.05 * frame_++));
    for (Index hand = 0; hand < 2; ++hand) input_.driven_positions(1, hand) = home_(1, hand) + sway;
    return input_;
  }

 private:
  ClothInput<Scalar> input_;
  Points<Scalar> home_;
  int frame_ = 0;
};

/// The length of a step, s.
inline constexpr double kStep = 0.02;

}  // namespace clothctl_bench
