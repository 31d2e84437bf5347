#pragma once

// An elimination tree with supernodes: the order in which a sparse Cholesky factorisation
// eliminates the vertices of a matrix, and which vertices it eliminates together.
//
// Node k eliminates a set of vertices, its pivots. Their elimination changes only entries between
// vertices that are coupled to a pivot, and all these vertices belong to ancestors of node k.
// Subtrees without a common node are therefore independent of each other. Reference: J. W. H. Liu,
// The role of elimination trees in sparse factorization, SIAM J. Matrix Anal. Appl. 11 (1990).

#include <vector>

#include "clothctl/config.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// An elimination tree for the vertices of a BlockSymmetric. `nested_dissection` makes one.
struct EliminationTree {
  /// The vertex at each position of the elimination order, one entry for each vertex.
  std::vector<int> permutation;
  /// Node k eliminates the vertices at positions node_begin[k] to node_begin[k+1] - 1. There is one
  /// entry more than there are nodes.
  std::vector<int> node_begin;
  /// The parent of each node, or -1 for a root. A child has a smaller number than its parent. Two
  /// coupled vertices must belong to the same node, or the node of one must be an ancestor of the
  /// node of the other.
  std::vector<int> parent;
};

}  // namespace clothctl::inline CLOTHCTL_ABI
