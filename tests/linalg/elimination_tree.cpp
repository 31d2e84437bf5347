#include "clothctl/linalg/elimination_tree.hpp"

#include <utility>
#include <vector>

#include "clothctl/linalg/block_cholesky.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("an elimination tree written by hand works in a factorisation", "[linalg]") {
  // The path 0 - 1 - 2: both ends are leaves, the middle is the root.
  BlockSymmetric<double> matrix(3, {{0, 1}, {1, 2}});
  for (Index i = 0; i < 3; ++i) matrix.diagonal(i) = 4.0 * Matrix3<double>::Identity();
  for (Index slot = 0; slot < matrix.lower_count(); ++slot)
    matrix.lower(slot) = -Matrix3<double>::Identity();
  EliminationTree tree;
  tree.permutation = {0, 2, 1};
  tree.node_begin = {0, 1, 2, 3};
  tree.parent = {2, 2, -1};
  BlockCholesky<double> factor(matrix, tree);
  REQUIRE(factor.factorize(matrix));
  Lanes<double, 1> x(1, 9), right(1, 9);
  x.setLinSpaced(1.0, 9.0);
  matrix.multiply(x, right);
  factor.solve(right);
  CHECK((right - x).cwiseAbs().maxCoeff() < 1e-12);
}
