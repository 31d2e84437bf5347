#pragma once

// The patches of a set of grips: the distinct sets of vertices that fingers hold.

#include <algorithm>
#include <utility>
#include <vector>

#include "clothctl/contact/affine_patch.hpp"
#include "clothctl/mpc/detail/grip_basis.hpp"
#include "clothctl/mpc/detail/term_stack.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// A patch of held vertices.
template <RealScalar Scalar>
struct HeldPatch {
  /// Slots of its vertices.
  std::vector<Index> held_slots;
  /// Basis of its affine motion about the measured state.
  AffinePatchBasis<Scalar> affine;
  /// Its vertices at the last update, 3×count, m.
  Points<Scalar> reference = {};

  /// Computes the basis about the positions of the held vertices (3×held, m). Never allocates for a
  /// patch that `find_patches` made.
  void update(const PointsView<Scalar>& held) {
    for (std::size_t j = 0; j < held_slots.size(); ++j)
      reference.col(static_cast<Index>(j)) = held.col(held_slots[j]);
    affine.update(reference);
  }
};

/// Returns the distinct patches of the grips of `basis`. Allocates.
template <RealScalar Scalar, class Contact>
std::vector<HeldPatch<Scalar>> find_patches(const GripBasis<Scalar, Contact>& basis) {
  const HeldVertices<Scalar>& held = basis.held();
  std::vector<HeldPatch<Scalar>> patches;
  for (std::size_t g = 0; g < basis.grips().size(); ++g) {
    std::vector<std::vector<int>> seen;
    for (const Finger<Scalar, Contact>& f : basis.grips()[g].fingers) {
      std::vector<int> vertices = f.vertices;
      std::sort(vertices.begin(), vertices.end());
      if (std::find(seen.begin(), seen.end(), vertices) != seen.end()) continue;
      seen.push_back(vertices);
      std::vector<Index> held_slots;
      for (std::size_t s = held.grip_begin(g); s < held.grip_begin(g + 1); ++s) {
        if (std::binary_search(vertices.begin(), vertices.end(), held.vertices()[s]))
          held_slots.push_back(static_cast<Index>(s));
      }
      const Index size = static_cast<Index>(held_slots.size());
      patches.push_back(
          {std::move(held_slots), AffinePatchBasis<Scalar>(size), Points<Scalar>(3, size)});
    }
  }
  return patches;
}

/// Writes mode `i` of the non-affine motion to `point` as a weighted sum of outputs. `first`: index
/// of the output that is the first held vertex. Allocates only when `point` grows.
template <RealScalar Scalar>
void take_non_affine(const HeldPatch<Scalar>& patch, Index i, Index first,
                     std::vector<OutputTerm<Scalar>>& point) {
  point.clear();
  for (Index j = 0; j < patch.affine.count(); ++j) {
    point.push_back(
        {first + patch.held_slots[static_cast<std::size_t>(j)], patch.affine.non_affine(i)[j]});
  }
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
