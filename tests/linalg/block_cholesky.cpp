#include "clothctl/linalg/block_cholesky.hpp"

#include <Eigen/Cholesky>
#include <limits>
#include <random>
#include <type_traits>

#include "support/allocations.hpp"
#include "support/block_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

namespace {

template <class Scalar>
constexpr int native_lanes_of = detail::native_lanes<Scalar>();

/// Largest relative error over the lanes, compared with a dense solve in double.
template <int kLanes, class Scalar>
double solve_error(BlockCholesky<Scalar>& factor, const Eigen::MatrixXd& full) {
  Lanes<Scalar, kLanes> x = Lanes<Scalar, kLanes>::Random(kLanes, full.rows());
  const Eigen::MatrixXd expected =
      full.llt().solve(Eigen::MatrixXd(x.transpose().template cast<double>()));
  factor.template solve<kLanes>(x);
  return (x.transpose().template cast<double>() - expected).norm() / expected.norm();
}

template <class Scalar>
void check_solves(const Graph& graph, int leaf, std::mt19937& random, double tolerance) {
  const BlockSymmetric<Scalar> matrix = random_spd<Scalar>(graph, random, 1.0);
  BlockCholesky<Scalar> factor(matrix, tree_of(graph, leaf));
  REQUIRE(factor.factorize(matrix));
  const Eigen::MatrixXd full = dense(matrix);
  CHECK(solve_error<1>(factor, full) < tolerance);
  CHECK(solve_error<4>(factor, full) < tolerance);
  if constexpr (native_lanes_of < Scalar >> 1) {
    CHECK(solve_error<13>(factor, full) < tolerance);
    CHECK(solve_error<16>(factor, full) < tolerance);
  }
  if constexpr (std::is_same_v<Scalar, double>) CHECK(solve_error<35>(factor, full) < tolerance);
}

}  // namespace

TEST_CASE("Solves agree with a dense factorisation") {
  std::mt19937 random(51);
  for (const Graph& graph : graphs(random)) {
    for (const int leaf : {1, 5, 12}) {
      check_solves<double>(graph, leaf, random, 1e-12);
      check_solves<float>(graph, leaf, random, 1e-4);
      if (leaf == 5)
        check_solves<long double>(graph, leaf, random, 1e-12);  // a scalar without vector registers
    }
  }
}

TEST_CASE("A matrix without rows is factored and solved") {
  BlockCholesky<double> none;
  CHECK(none.factorize(BlockSymmetric<double>()));
  Lanes<double, 4> x(4, 0);
  none.solve(x);
  CHECK(none.factor_entries() == 0);
}

TEST_CASE("Solves with held vertices solve the rest and return held entries bit for bit") {
  std::mt19937 random(52);
  std::bernoulli_distribution coin(0.3);
  for (const Graph& graph : graphs(random)) {
    const BlockSymmetric<double> matrix = random_spd<double>(graph, random);
    const Eigen::MatrixXd full = dense(matrix);
    BlockCholesky<double> factor(matrix, tree_of(graph, 6));
    // One object with many masks: none, all, some, others, none again.
    for (int trial = 0; trial < 6; ++trial) {
      std::vector<unsigned char> held(static_cast<std::size_t>(graph.size()), trial == 1 ? 1 : 0);
      if (trial > 1 && trial < 5) {
        for (auto& h : held) h = coin(random);
      }
      REQUIRE(factor.factorize(matrix, held));
      const Lanes<double, 16> b = Lanes<double, 16>::Random(16, 3 * graph.size());
      Lanes<double, 16> x = b;
      Lanes<double, 1> single = b.row(3);
      factor.solve(x);
      factor.solve(single);
      std::vector<Index> free;
      bool same = true;
      for (int i = 0; i < graph.size(); ++i) {
        for (int c = 0; c < 3; ++c) {
          if (held[static_cast<std::size_t>(i)] == 0) {
            free.push_back(3 * i + c);
          } else {
            same = same && x.col(3 * i + c) == b.col(3 * i + c) &&
                   single(3 * i + c) == b(3, 3 * i + c);
          }
        }
      }
      CHECK(same);
      if (free.empty()) continue;
      const Eigen::MatrixXd reduced = full(free, free);
      const Eigen::MatrixXd expected =
          reduced.llt().solve(Eigen::MatrixXd(b(Eigen::all, free).transpose()));
      CHECK((Eigen::MatrixXd(x(Eigen::all, free).transpose()) - expected).norm() <
            1e-12 * expected.norm());
      CHECK((Eigen::VectorXd(single(free).transpose()) - expected.col(3)).norm() <
            1e-12 * expected.norm());
    }
  }
}

TEST_CASE("A held vertex may hide an error of the matrix") {
  std::mt19937 random(53);
  const Graph graph = sheet_graph(6, 6, true);
  BlockSymmetric<double> matrix = random_spd<double>(graph, random);
  matrix.diagonal(7)(0, 0) = -1.0;
  BlockCholesky<double> factor(matrix, tree_of(graph, 4));
  CHECK_FALSE(factor.factorize(matrix));
  std::vector<unsigned char> held(36, 0);
  held[7] = 1;
  CHECK(factor.factorize(matrix, held));
}

TEST_CASE(
    "Matrices that are not positive definite or not finite are refused, and the factor recovers") {
  std::mt19937 random(54);
  const Graph graph = sheet_graph(8, 5, true);
  const BlockSymmetric<float> good = random_spd<float>(graph, random);
  BlockCholesky<float> factor(good, tree_of(graph, 6));
  const float bad[] = {-10.0f, std::numeric_limits<float>::quiet_NaN(),
                       std::numeric_limits<float>::infinity(),
                       -std::numeric_limits<float>::infinity()};
  for (const float value : bad) {
    for (int i = 0; i < graph.size(); i += 3) {
      BlockSymmetric<float> matrix = good;
      matrix.diagonal(i)(2, 2) = value;
      CHECK_FALSE(factor.factorize(matrix));
      if (is_finite(value) || i == 0) continue;
      matrix = good;
      matrix.lower(matrix.row_begin(i + 1) - 1)(1, 2) = value;
      CHECK_FALSE(factor.factorize(matrix));
    }
  }
  // A number that is not finite is detected at any place, also above the diagonal of diagonal
  // blocks.
  for (const float value : {bad[1], bad[2], bad[3]}) {
    for (Index r = 0; r < 3; ++r) {
      for (Index c = 0; c < 3; ++c) {
        CAPTURE(r, c);
        BlockSymmetric<float> matrix = good;
        matrix.diagonal(17)(r, c) = value;
        CHECK_FALSE(factor.factorize(matrix));
        std::vector<unsigned char> held(40, 0);
        held[17] = 1;
        CHECK(factor.factorize(matrix, held));
        for (const int slot : {matrix.row_begin(17), matrix.row_begin(18) - 1}) {
          matrix = good;
          matrix.lower(slot)(r, c) = value;
          CHECK_FALSE(factor.factorize(matrix));
          CHECK(factor.factorize(matrix, held));
        }
      }
    }
  }
  // Semidefinite: a row and column of zeros.
  BlockSymmetric<float> singular(2, {{0, 1}});
  singular.diagonal(0).setIdentity();
  BlockCholesky<float> small(singular, tree_of(rope_graph(2), 1));
  CHECK_FALSE(small.factorize(singular));
  // Values left by a failure have no effect.
  REQUIRE(factor.factorize(good));
  CHECK(solve_error<16>(factor, dense(good)) < 1e-3);
  CHECK(solve_error<1>(factor, dense(good)) < 1e-3);
}

TEST_CASE("Factorising and solving do not allocate and repeat bit for bit") {
  std::mt19937 random(55);
  const Graph graph = sheet_graph(17, 17, true);
  const BlockSymmetric<double> matrix = random_spd<double>(graph, random);
  const EliminationTree tree = tree_of(graph, 12);
  BlockCholesky<double> factor(matrix, tree);
  std::vector<unsigned char> held(289, 0);
  held[0] = held[16] = 1;
  const Lanes<double, 13> b = Lanes<double, 13>::Random(13, 867);
  Lanes<double, 13> x = b;
  Lanes<double, 1> single = b.row(0);
  Lanes<double, 16> wide = Lanes<double, 16>::Random(16, 867);
  const long before = allocations();
  const bool positive = factor.factorize(matrix, held);
  factor.solve(x);
  factor.solve(single);
  factor.solve(wide);
  const long after = allocations();
  if (allocation_counting_works()) CHECK(after == before);
  CHECK(positive);
  BlockCholesky<double> again(matrix, tree);
  REQUIRE(again.factorize(matrix, held));
  Lanes<double, 13> y = b;
  again.solve(y);
  CHECK(x == y);
  // A copy is independent.
  BlockCholesky<double> copy = factor;
  REQUIRE(factor.factorize(matrix));
  y = b;
  copy.solve(y);
  CHECK(x == y);
}

TEST_CASE("One object serves many factors of its pattern") {
  std::mt19937 random(61);
  const Graph graph = graphs(random).back();
  const BlockSymmetric<double> first = random_spd<double>(graph, random, 1.0);
  const BlockSymmetric<double> second = random_spd<double>(graph, random, 1.0);
  BlockCholesky<double> factor(first, tree_of(graph, 5));
  VectorX<double> kept;
  REQUIRE(factor.factorize(first));
  factor.exchange(kept);
  REQUIRE(factor.factorize(second));
  CHECK(solve_error<1>(factor, dense(second)) < 1e-12);
  factor.exchange(kept);
  CHECK(solve_error<1>(factor, dense(first)) < 1e-12);
  factor.exchange(kept);
  CHECK(solve_error<1>(factor, dense(second)) < 1e-12);
}

TEST_CASE("The entries of a factor are counted") {
  const Graph graph = rope_graph(4);
  const BlockSymmetric<double> pattern(4, graph.pairs);
  // One dense front of 12 rows; then leaves {0}, {3} and the middle above both.
  CHECK(BlockCholesky<double>(pattern, {{0, 1, 2, 3}, {0, 4}, {-1}}).factor_entries() == 78);
  BlockSymmetric<double> chain(4, {{0, 1}, {1, 2}, {2, 3}});
  const EliminationTree tree{{0, 3, 1, 2}, {0, 1, 2, 4}, {2, 2, -1}};
  CHECK(BlockCholesky<double>(chain, tree).factor_entries() == (6 + 9) + (6 + 9) + 21);
}
