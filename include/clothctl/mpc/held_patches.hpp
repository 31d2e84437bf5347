#pragma once

// The patches of a set of grips: each set of vertices that a finger (or several alike) holds, with its affine modes.

#include <algorithm>
#include <utility>
#include <vector>

#include "clothctl/contact/patch.hpp"
#include "clothctl/mpc/grip_basis.hpp"
#include "clothctl/mpc/term_stack.hpp"

namespace clothctl {

/// A patch of held vertices.
template <RealScalar Scalar>
struct HeldPatch {
  /// Indices of its vertices among the held ones.
  std::vector<Index> slots;
  /// How its motion splits into affine and other modes about the measured state.
  PatchModes<Scalar> modes;
  /// Its vertices at the last update, 3×count, m.
  Points<Scalar> reference = {};

  /// Splits the motion anew about the `held` positions (3×held, m). Never allocates for a patch of find_patches.
  void update(const PointsView<Scalar>& held) {
    for (std::size_t j = 0; j < slots.size(); ++j) reference.col(static_cast<Index>(j)) = held.col(slots[j]);
    modes.update(reference);
  }
};

/// Finds the distinct patches of the grips of `basis`. Allocates.
template <RealScalar Scalar>
std::vector<HeldPatch<Scalar>> find_patches(const GripBasis<Scalar>& basis) {
  std::vector<HeldPatch<Scalar>> patches;
  for (std::size_t g = 0; g < basis.grips().size(); ++g) {
    std::vector<std::vector<int>> seen;
    for (const Finger<Scalar>& f : basis.grips()[g].fingers) {
      std::vector<int> vertices = f.vertices;
      std::sort(vertices.begin(), vertices.end());
      if (std::find(seen.begin(), seen.end(), vertices) != seen.end()) continue;
      seen.push_back(vertices);
      std::vector<Index> slots;
      for (std::size_t s = basis.grip_begin(g); s < basis.grip_begin(g + 1); ++s) {
        if (std::binary_search(vertices.begin(), vertices.end(), basis.held()[s])) slots.push_back(static_cast<Index>(s));
      }
      const Index size = static_cast<Index>(slots.size());
      patches.push_back({std::move(slots), PatchModes<Scalar>(size), Points<Scalar>(3, size)});
    }
  }
  return patches;
}

/// The weighted sum of outputs that is mode `i` of the patch's non-affine motion; `first` is the output of the first held
/// vertex. Allocates only when `point` grows.
template <RealScalar Scalar>
void take_non_affine(const HeldPatch<Scalar>& patch, Index i, Index first, std::vector<OutputTerm<Scalar>>& point) {
  point.clear();
  for (Index j = 0; j < patch.modes.count(); ++j) {
    point.push_back({first + patch.slots[static_cast<std::size_t>(j)], patch.modes.non_affine(i)[j]});
  }
}

}  // namespace clothctl
