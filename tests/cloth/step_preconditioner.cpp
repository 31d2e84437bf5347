// Preconditioners: the kept factor in lower precision, the incomplete one, and their refusals.

#include "clothctl/cloth/detail/step_preconditioner.hpp"

#include <random>

#include <Eigen/Cholesky>

#include "clothctl/linalg/nested_dissection.hpp"
#include "support/allocations.hpp"
#include "support/block_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using namespace clothctl_test;

static_assert(std::is_same_v<FactorScalar<double>, float>);
static_assert(std::is_same_v<FactorScalar<float>, float>);
static_assert(std::is_same_v<FactorScalar<long double>, long double>);

namespace {

using Row = Lanes<double, 1>;

}  // namespace

TEST_CASE("the kept factor solves to its precision, at any size of the right-hand side",
          "[cloth]") {
  std::mt19937 random(1);
  const Graph graph = sheet_graph(5, 6, true);
  const BlockSymmetric<double> matrix = random_spd<double>(graph, random);
  StepPreconditioner<double> kept(matrix, nested_dissection<double>(matrix, graph.positions));
  CHECK_FALSE(kept.is_incomplete());
  std::vector<unsigned char> held(30, 0);
  held[7] = 1;
  Eigen::MatrixXd a = dense(matrix);
  a.middleRows<3>(21).setZero();
  a.middleCols<3>(21).setZero();
  a.block<3, 3>(21, 21).setIdentity();
  for (const double size : {1e-200, 1.0, 1e200}) {
    Row r = Row::NullaryExpr(1, 90, [&] { return double(random()) / 4294967296.0 - 0.5; }) * size;
    r.segment<3>(21).setZero();
    Row z = r;
    const long before = allocations();
    REQUIRE(kept.factorize(matrix, held));
    kept.apply(r, z);
    const long made = allocations() - before;
    if (allocation_counting_works()) CHECK(made == 0);
    const Eigen::VectorXd expected = a.llt().solve(Eigen::VectorXd(r.transpose()));
    CHECK((z.transpose() - expected).norm() <= 1e-4 * expected.norm());
    CHECK(z.segment<3>(21).norm() == 0.0);
  }
  Row zero = Row::Zero(1, 90), out = Row::Ones(1, 90);
  kept.apply(zero, out);
  CHECK(out.norm() == 0.0);
}

TEST_CASE("a matrix that is not definite in the kept precision is refused", "[cloth]") {
  std::mt19937 random(2);
  const Graph graph = sheet_graph(3, 3, false);
  BlockSymmetric<double> matrix = random_spd<double>(graph, random);
  const std::vector<unsigned char> held(9, 0);
  const EliminationTree tree = nested_dissection<double>(matrix, graph.positions);
  StepPreconditioner<double> kept(matrix, tree), incomplete(matrix);
  matrix.diagonal(4) *= 1e60;  // beyond the range of float
  CHECK_FALSE(kept.factorize(matrix, held));
  CHECK(incomplete.is_incomplete());
  CHECK(incomplete.factorize(matrix, held));
  matrix.diagonal(4) *= -1.0;
  CHECK_FALSE(kept.factorize(matrix, held));
  CHECK_FALSE(incomplete.factorize(matrix, held));
}

TEST_CASE("the incomplete preconditioner applies its factor and the coarse correction", "[cloth]") {
  std::mt19937 random(3);
  for (const int n : {4, 16}) {
    const Graph graph = sheet_graph(n, n, true);
    const BlockSymmetric<double> matrix = random_spd<double>(graph, random);
    const std::vector<unsigned char> held(static_cast<std::size_t>(n * n), 0);
    std::vector<SurfaceEdge<>> sides;
    for (const auto& [i, j] : graph.pairs) sides.push_back({i, j, 0.1});
    StepPreconditioner<double> incomplete(matrix, sides, graph.positions);
    IncompleteCholesky<double> factor(matrix);
    CoarseCorrection<double> coarse(matrix, sides, graph.positions);
    CHECK((0 < coarse.size()) == (n == 16));
    REQUIRE((incomplete.factorize(matrix, held) && factor.factorize(matrix, held)));
    REQUIRE(coarse.factorize(matrix, held));
    const Row r = Row::Ones(1, 3 * n * n);
    Row z = r, expected = r;
    incomplete.apply(r, z);
    factor.solve(expected);
    coarse.add(r, expected);
    CHECK(z == expected);
  }
}
