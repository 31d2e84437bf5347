#pragma once

// The memory of a mass-spring step, and the hash by which a step tells its own memory from that of
// another model.

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "clothctl/cloth/detail/attachments.hpp"
#include "clothctl/cloth/detail/conjugate_gradient.hpp"
#include "clothctl/cloth/detail/contact_springs.hpp"
#include "clothctl/cloth/detail/factor_changes.hpp"
#include "clothctl/cloth/detail/find_grid.hpp"
#include "clothctl/cloth/detail/step_input.hpp"
#include "clothctl/cloth/detail/step_preconditioner.hpp"
#include "clothctl/linalg/block_cholesky.hpp"
#include "clothctl/network/spring_network.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// All memory of a step of MassSpring.
template <RealScalar Scalar>
struct MassSpringWorkspace {
  /// Hash of the structure (pattern and order of elimination) that the workspace was made for.
  std::uint64_t structure = 0;
  /// The step matrix, and the part of it that is constant over a step: inertia, drag, dampers, air
  /// and bending.
  BlockSymmetric<Scalar> matrix, frozen;
  /// The factor of `matrix`; without memory when the model solves by conjugate gradients.
  BlockCholesky<Scalar> factor;
  /// The preconditioner of conjugate gradients, and their vectors.
  StepPreconditioner<Scalar> preconditioner;
  ConjugateGradientMemory<Scalar> cg;
  /// 1 for driven and pinned vertices, else 0.
  std::vector<unsigned char> held;
  /// Springs between vertices and points of the input.
  Attachments<Scalar> attachments;
  /// Room for the contacts of a step, and those of the step at hand; null without.
  ContactSpringList<Scalar> contact_springs;
  ContactSprings<Scalar>* contacts = nullptr;
  /// The impulses at vertices that MassSpringImpulses expects in the steps to come, N s, and
  /// whether it does: it will ask for the factor then.
  Points<Scalar> expected;
  bool expects = false;
  /// True when the state of the last step holds them.
  bool holds_expected = false;
  /// Unit vectors of the springs at the start of the step.
  Points<Scalar> direction;
  /// Forces that are constant over the step (gravity, input, C w), velocities at the end of the
  /// step, trial velocities of the line search, positions at the end of the step, and the gradient
  /// of the energy.
  Points<Scalar> outer, velocity, trial, position, gradient;
  /// Air matrices C_t, one for each triangle; empty without air.
  std::vector<Matrix3<Scalar>> air;
  /// Right-hand side of the linear system, and the product of the step matrix and a vector.
  Lanes<Scalar, 1> rhs, product;
  /// Length of the last step, s; 0 before the first.
  Scalar dt = Scalar(0);
  /// After a step, free vertices have the velocity drift + kept (velocity - drift).
  Scalar kept = Scalar(1);
  /// See `kept`, m/s.
  Triple<Scalar> drift{Scalar(0), Scalar(0), Scalar(0)};
  /// True when the last step was a single linear solve; its matrix is in `matrix`.
  bool linear = false;
  /// True when `factor` is that of this matrix, apart from `factor_changes`.
  bool factor_is_current = false;
  FactorChanges<Scalar> factor_changes;
  /// True when the last step advanced a state.
  bool advanced = false;

  /// Makes room for a network whose step matrix has the sparsity pattern of `pattern`. `air_count`:
  /// number of air matrices. A `tree` without vertices means that no complete factor is made.
  /// Allocates.
  void reserve(const SpringNetwork<Scalar>& network, const BlockSymmetric<Scalar>& pattern,
               const EliminationTree& tree, std::size_t air_count) {
    const Index n = network.vertex_count();
    matrix = pattern;
    frozen = pattern;
    if (tree.permutation.empty()) {
      if constexpr (HasLevels<Scalar>) {
        preconditioner = StepPreconditioner<Scalar>(pattern, surface_sides(network),
                                                    network.rest_positions.template cast<double>());
      } else {
        preconditioner = StepPreconditioner<Scalar>(pattern);
      }
    } else {
      factor = BlockCholesky<Scalar>(pattern, tree);
      preconditioner = StepPreconditioner<Scalar>(pattern, tree);
    }
    cg.reserve(n);
    held.assign(static_cast<std::size_t>(n), 0);
    attachments.reserve(n);
    direction.setZero(3, static_cast<Index>(network.springs.size()));
    for (Points<Scalar>* p : {&expected, &outer, &velocity, &trial, &position, &gradient})
      p->setZero(3, n);
    air.assign(air_count, Matrix3<Scalar>::Zero());
    rhs.setZero(1, 3 * n);
    product.setZero(1, 3 * n);
  }

  /// Returns true when the matrices and vectors have the sizes that `reserve` with these arguments
  /// gives them. `held`, which each step resizes, and `factor` are not compared.
  bool fits(const SpringNetwork<Scalar>& network, const BlockSymmetric<Scalar>& pattern,
            std::size_t air_count) const {
    const Index n = network.vertex_count();
    bool good = true;
    for (const BlockSymmetric<Scalar>* m : {&matrix, &frozen})
      good = good && m->rows() == n && m->lower_count() == pattern.lower_count();
    for (const Points<Scalar>* p : {&expected, &outer, &velocity, &trial, &position, &gradient})
      good = good && p->cols() == n;
    good = good && cg.solution.cols() == 3 * n && attachments.fits(n);
    return good && direction.cols() == static_cast<Index>(network.springs.size()) &&
           air.size() == air_count && rhs.cols() == 3 * n && product.cols() == 3 * n;
  }

  /// Returns true when vertex `i` is driven or pinned in this step.
  bool is_held(Index i) const { return held[static_cast<std::size_t>(i)] != 0; }
};

/// Returns the hash of a pattern and an order of elimination; without one (conjugate gradients), of
/// what places the coarse vertices instead: rest lengths along sides of triangles, and rest
/// positions. Apart from these and from sizes, a workspace does not depend on the model.
/// Complexity: O(blocks of the pattern).
template <RealScalar Scalar>
std::uint64_t hash_structure(const BlockSymmetric<Scalar>& pattern, const EliminationTree& tree,
                             const SpringNetwork<Scalar>& network) {
  StructureHash hash;
  hash.add(pattern.rows());
  for (Index i = 0; i < pattern.rows(); ++i) hash.add(pattern.row_begin(i));
  for (Index slot = 0; slot < pattern.lower_count(); ++slot) hash.add(pattern.column(slot));
  for (const std::vector<int>* list : {&tree.permutation, &tree.node_begin, &tree.parent}) {
    for (const int value : *list) hash.add(value);
  }
  if constexpr (HasLevels<Scalar>) {
    if (!tree.permutation.empty()) return hash.value;
    const auto add_number = [&](double number) { hash.add(std::bit_cast<std::int64_t>(number)); };
    for (const SurfaceEdge<>& side : surface_sides(network)) {
      hash.add(side.a);
      hash.add(side.b);
      add_number(side.length);
    }
    for (Index k = 0; k < network.rest_positions.size(); ++k)
      add_number(static_cast<double>(network.rest_positions.data()[k]));
  }
  return hash.value;
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
