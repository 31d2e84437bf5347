#include "clothctl/linalg/detail/inverse_block.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <span>
#include <type_traits>
#include <vector>

#include "clothctl/linalg/block_cholesky.hpp"
#include "support/allocations.hpp"
#include "support/block_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEMPLATE_TEST_CASE("Blocks of the inverse agree with a dense inverse", "", float, double,
                   long double) {
  using S = TestType;
  std::mt19937 random(57);
  for (const Graph& graph : graphs(random)) {
    const BlockSymmetric<S> matrix = random_spd<S>(graph, random, 1.0);
    BlockCholesky<S> factor(matrix, tree_of(graph, 5));
    std::vector<unsigned char> held(static_cast<std::size_t>(graph.size()), 0);
    held[static_cast<std::size_t>(graph.size() / 2)] = 1;
    std::vector<int> order(static_cast<std::size_t>(graph.size()));
    std::iota(order.begin(), order.end(), 0);
    auto memory = factor.make_inverse_block_memory(graph.size());
    for (const bool with_held : {false, true}) {
      REQUIRE(factor.factorize(matrix, with_held ? held : std::vector<unsigned char>()));
      Eigen::MatrixXd full = dense(matrix);
      for (int v = 0; with_held && v < graph.size(); ++v) {
        if (held[static_cast<std::size_t>(v)] == 0) continue;
        full.middleCols(3 * v, 3).setZero();
        full.middleRows(3 * v, 3).setZero();
        full.block<3, 3>(3 * v, 3 * v).setIdentity();
      }
      const Eigen::MatrixXd inverse = full.inverse();
      for (const int count : {0, 1, 2, 7, 23, graph.size()}) {
        if (count > graph.size()) continue;
        std::shuffle(order.begin(), order.end(), random);
        MatrixX<S> block(3 * count, 3 * count);
        REQUIRE(factor.inverse_block(std::span<const int>(order).first(std::size_t(count)), memory,
                                     block));
        double worst = 0;
        for (int i = 0; i < 3 * count; ++i) {
          for (int j = 0; j < 3 * count; ++j) {
            const Index row = 3 * order[std::size_t(i / 3)] + i % 3;
            const Index col = 3 * order[std::size_t(j / 3)] + j % 3;
            worst = std::max(worst, std::abs(static_cast<double>(block(i, j)) - inverse(row, col)));
          }
        }
        CHECK(block == block.transpose());
        CHECK(worst < (std::is_same_v<S, float> ? 1e-5 : 1e-13) * inverse.cwiseAbs().maxCoeff());
      }
    }
  }
}

TEST_CASE("Blocks of the inverse refuse what does not fit and do not allocate") {
  std::mt19937 random(58);
  const Graph graph = sheet_graph(9, 9, false), other = sheet_graph(5, 5, false);
  const BlockSymmetric<double> matrix = random_spd<double>(graph, random);
  BlockCholesky<double> factor(matrix, tree_of(graph, 5));
  REQUIRE(factor.factorize(matrix));
  auto memory = factor.make_inverse_block_memory(3);
  const BlockSymmetric<double> small = random_spd<double>(other, random);
  auto foreign = BlockCholesky<double>(small, tree_of(other, 5)).make_inverse_block_memory(3);
  MatrixX<double> block = MatrixX<double>::Constant(9, 9, 7.0), four(12, 12);
  const std::vector<int> list{80, 3, 41};
  CHECK_FALSE(factor.inverse_block(list, foreign, block));
  CHECK_FALSE(factor.inverse_block(list, memory, four));
  CHECK_FALSE(factor.inverse_block(std::vector<int>{1, 2, 3, 4}, memory, four));
  CHECK_FALSE(factor.inverse_block(std::vector<int>{1, 2, 81}, memory, block));
  CHECK_FALSE(factor.inverse_block(std::vector<int>{-1, 2, 3}, memory, block));
  CHECK((block.array() == 7.0).all());
  REQUIRE(factor.inverse_block(list, memory, block));
  const MatrixX<double> first = block;
  block.setZero();
  const long before = allocations();
  const bool again = factor.inverse_block(list, memory, block);
  const long after = allocations();
  CHECK(again);
  if (allocation_counting_works()) CHECK(after == before);
  CHECK(block == first);
}
