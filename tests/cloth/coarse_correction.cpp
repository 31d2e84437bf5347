// The coarse correction: its weights, its matrix beside a dense one, held vertices, bodies without
// coarse vertices, and what it does for conjugate gradients.

#include "clothctl/cloth/detail/coarse_correction.hpp"

#include <random>

#include <Eigen/Cholesky>
#include <Eigen/QR>

#include "clothctl/cloth/detail/conjugate_gradient.hpp"
#include "clothctl/cloth/detail/incomplete_cholesky.hpp"
#include "support/allocations.hpp"
#include "support/block_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using namespace clothctl_test;

namespace {

using Row = Lanes<double, 1>;

std::vector<unsigned char> none_held(const BlockSymmetric<double>& matrix) {
  return std::vector<unsigned char>(static_cast<std::size_t>(matrix.rows()), 0);
}

// W A_c⁻¹ Wᵀ as a dense matrix.
Eigen::MatrixXd correction_of(CoarseCorrection<double>& coarse, Index rows) {
  Eigen::MatrixXd out(3 * rows, 3 * rows);
  for (Index k = 0; k < 3 * rows; ++k) {
    Row r = Row::Zero(1, 3 * rows), z = r;
    r[k] = 1.0;
    coarse.add(r, z);
    out.col(k) = z.transpose();
  }
  return out;
}

// A sheet whose springs lie in its plane, stiff beside its masses, as in a step of 1/60 s.
BlockSymmetric<double> stretched_sheet(int n, double stiffness) {
  const Graph graph = sheet_graph(n, n, false);
  BlockSymmetric<double> matrix(graph.size(), graph.pairs);
  for (Index i = 0; i < matrix.rows(); ++i) matrix.diagonal(i).setIdentity();
  for (const auto& [i, j] : graph.pairs) {
    const Eigen::Vector3d along = (graph.positions.col(i) - graph.positions.col(j)).normalized();
    const Eigen::Matrix3d spring = stiffness * along * along.transpose();
    matrix.diagonal(i) += spring;
    matrix.diagonal(j) += spring;
    matrix.lower(matrix.find(i, j)) -= spring;
  }
  return matrix;
}

}  // namespace

TEST_CASE("the coarse correction is the inverse of the matrix on its corrections", "[cloth]") {
  std::mt19937 random(1);
  const Graph graph = sheet_graph(15, 16, true);
  const BlockSymmetric<double> matrix = random_spd<double>(graph, random);
  CoarseCorrection<double> coarse(matrix, graph.positions);
  const Index m = coarse.size();
  CHECK((4 <= m && m <= 40));
  std::vector<unsigned char> held = none_held(matrix);
  held[0] = held[17] = 1;
  const long before = allocations();
  REQUIRE(coarse.factorize(matrix, held));
  const long made = allocations() - before;
  if (allocation_counting_works()) CHECK(made == 0);
  const Eigen::MatrixXd c = correction_of(coarse, 240);
  CHECK((c - c.transpose()).norm() <= 1e-10 * c.norm());
  // Held vertices get nothing and give nothing.
  for (const Index v : {0, 17}) {
    CHECK(c.middleRows<3>(3 * v).norm() == 0.0);
    CHECK(c.middleCols<3>(3 * v).norm() <= 1e-10 * c.norm());
  }
  // C A C = C: a projection onto corrections of rank 3m, whatever the weights.
  Eigen::MatrixXd a = dense(matrix);
  for (const Index v : {0, 17}) {
    a.middleRows<3>(3 * v).setZero();
    a.middleCols<3>(3 * v).setZero();
  }
  CHECK((c * a * c - c).norm() <= 1e-6 * c.norm());
  CHECK(Eigen::ColPivHouseholderQR<Eigen::MatrixXd>(c).setThreshold(1e-9).rank() == 3 * m);
}

TEST_CASE("without held vertices a translation is a coarse correction", "[cloth]") {
  const BlockSymmetric<double> matrix = stretched_sheet(20, 1e4);
  CoarseCorrection<double> coarse(matrix, sheet_graph(20, 20, false).positions);
  REQUIRE(coarse.factorize(matrix, none_held(matrix)));
  // Springs do not resist it, so A t = t, and C A t = t.
  Row t = Row::Zero(1, 1200), z = t;
  for (Index i = 0; i < 400; ++i) t[3 * i + 1] = 2.0;
  coarse.add(t, z);
  CHECK((z - t).cwiseAbs().maxCoeff() <= 1e-6);
}

TEST_CASE("small bodies, many pieces and indefinite matrices are not corrected", "[cloth]") {
  std::mt19937 random(2);
  const Graph small = sheet_graph(9, 9, true);
  CHECK(CoarseCorrection<double>(random_spd<double>(small, random), small.positions).size() == 0);
  Graph pieces;
  pieces.positions.setZero(3, 600);
  for (int i = 0; i < 600; i += 2) pieces.pairs.push_back({i, i + 1});
  for (Index i = 0; i < 600; ++i) pieces.positions(0, i) = 0.1 * double(i);
  const BlockSymmetric<double> apart = random_spd<double>(pieces, random);
  CoarseCorrection<double> none(apart, pieces.positions);
  CHECK(none.size() == 0);
  CHECK(none.factorize(apart, none_held(apart)));
  const Graph graph = sheet_graph(15, 15, false);
  BlockSymmetric<double> matrix = random_spd<double>(graph, random);
  CoarseCorrection<double> coarse(matrix, graph.positions);
  CHECK(0 < coarse.size());
  for (Index i = 0; i < matrix.rows(); ++i) matrix.diagonal(i) *= -1.0;
  CHECK_FALSE(coarse.factorize(matrix, none_held(matrix)));
  Row r = Row::Ones(1, 675), z = Row::Zero(1, 675);
  coarse.add(r, z);
  CHECK(z.norm() == 0.0);
}

TEST_CASE("vertices all at one place, and all but a few held, leave the correction finite",
          "[cloth]") {
  std::mt19937 random(3);
  const Graph graph = sheet_graph(15, 15, false);
  const BlockSymmetric<double> matrix = random_spd<double>(graph, random);
  const CoarseCorrection<double> collapsed(matrix, Points<double>::Zero(3, 225));
  CHECK(collapsed.size() < 75);
  CoarseCorrection<double> coarse(matrix, graph.positions);
  std::vector<unsigned char> held(225, 1);
  held[112] = held[113] = 0;
  REQUIRE(coarse.factorize(matrix, held));
  Row r = Row::Zero(1, 675), z = r;
  r.segment<6>(336).setOnes();
  coarse.add(r, z);
  CHECK(z.norm() < 100.0);
  CHECK(z.leftCols(336).norm() == 0.0);
}

TEST_CASE("with the coarse correction, the iterations of stiff sheets do not grow with their size",
          "[cloth]") {
  for (const int n : {20, 40}) {
    const BlockSymmetric<double> matrix = stretched_sheet(n, 1e5);
    const std::vector<unsigned char> held = none_held(matrix);
    const Index count = matrix.rows();
    IncompleteCholesky<double> factor(matrix);
    CoarseCorrection<double> coarse(matrix, sheet_graph(n, n, false).positions);
    REQUIRE((factor.factorize(matrix, held) && coarse.factorize(matrix, held)));
    ConjugateGradientMemory<double> memory;
    memory.reserve(count);
    std::mt19937 random(4);
    const Row right =
        Row::NullaryExpr(1, 3 * count, [&] { return double(random()) / 4294967296.0 - 0.5; });
    const VectorX<double> mass = VectorX<double>::Ones(count);
    const auto iterations = [&](bool corrected) {
      const ConjugateGradientReport report = conjugate_gradient<double>(
          matrix, right, mass, held, {0.0, 1e-7, 2000},
          [&](const Row& r, Row& z) {
            z = r;
            factor.solve(z);
            if (corrected) coarse.add(r, z);
          },
          memory);
      CHECK(report.converged);
      return report.iterations;
    };
    const int alone = iterations(false), both = iterations(true);
    CAPTURE(n, alone, both);
    CHECK(both < 60);
    CHECK(2 * both < alone);
  }
}
