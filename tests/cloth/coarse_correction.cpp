// The coarse correction: a projection, held vertices, bodies without coarse vertices, layers,
// knots, copies, and what it does for conjugate gradients.

#include "clothctl/cloth/detail/coarse_correction.hpp"

#include <cmath>
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

// The couplings of a graph with their lengths, as sides of triangles.
std::vector<SurfaceEdge<>> sides_of(const Graph& graph) {
  std::vector<SurfaceEdge<>> sides;
  for (const auto& [i, j] : graph.pairs)
    sides.push_back({i, j, (graph.positions.col(i) - graph.positions.col(j)).norm()});
  return sides;
}

CoarseCorrection<double> make(const BlockSymmetric<double>& matrix, const Graph& graph) {
  return {matrix, sides_of(graph), graph.positions};
}

// W A_c⁻¹ Wᵀ as a dense matrix.
Eigen::MatrixXd correction_of(CoarseCorrection<double>& coarse, Index rows) {
  return dense_map(rows, [&](Row& x) {
    const Row r = x;
    x.setZero();
    coarse.add(r, x);
  });
}

// Unit masses and springs along the couplings of a graph, stiff as in a step of 1/60 s.
BlockSymmetric<double> spring_matrix(const Graph& graph, double stiffness) {
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

BlockSymmetric<double> stretched_sheet(int n, double stiffness) {
  return spring_matrix(sheet_graph(n, n, false), stiffness);
}

// Iterations of conjugate gradients with the incomplete factor alone, and with both.
struct Counts {
  int alone = 0, both = 0;
};

Counts iterations(const BlockSymmetric<double>& matrix, CoarseCorrection<double> coarse) {
  const std::vector<unsigned char> held = none_held(matrix);
  const Index count = matrix.rows();
  IncompleteCholesky<double> factor(matrix);
  REQUIRE((factor.factorize(matrix, held) && coarse.factorize(matrix, held)));
  CHECK(0 < coarse.size());
  ConjugateGradientMemory<double> memory;
  memory.reserve(count);
  std::mt19937 random(4);
  const Row right =
      Row::NullaryExpr(1, 3 * count, [&] { return double(random()) / 4294967296.0 - 0.5; });
  const VectorX<double> mass = VectorX<double>::Ones(count);
  const auto run = [&](bool corrected) {
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
  return {run(false), run(true)};
}

}  // namespace

TEST_CASE("the coarse correction is the inverse of the matrix on its corrections", "[cloth]") {
  std::mt19937 random(1);
  const Graph graph = sheet_graph(15, 16, true);
  const BlockSymmetric<double> matrix = random_spd<double>(graph, random);
  CoarseCorrection<double> coarse = make(matrix, graph);
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
  CoarseCorrection<double> coarse = make(matrix, sheet_graph(20, 20, false));
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
  CHECK(make(random_spd<double>(small, random), small).size() == 0);
  Graph pieces;
  pieces.positions.setZero(3, 600);
  for (int i = 0; i < 600; i += 2) pieces.pairs.push_back({i, i + 1});
  for (Index i = 0; i < 600; ++i) pieces.positions(0, i) = 0.1 * double(i);
  const BlockSymmetric<double> apart = random_spd<double>(pieces, random);
  CoarseCorrection<double> none = make(apart, pieces);
  CHECK(none.size() == 0);
  CHECK(none.factorize(apart, none_held(apart)));
  const Graph graph = sheet_graph(15, 15, false);
  BlockSymmetric<double> matrix = random_spd<double>(graph, random);
  CoarseCorrection<double> coarse = make(matrix, graph);
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
  Graph flat = graph;
  flat.positions.setZero();
  CHECK(make(matrix, flat).size() == 0);
  CoarseCorrection<double> coarse = make(matrix, graph);
  std::vector<unsigned char> held(225, 1);
  held[112] = held[113] = 0;
  REQUIRE(coarse.factorize(matrix, held));
  Row r = Row::Zero(1, 675), z = r;
  r.segment<6>(336).setOnes();
  coarse.add(r, z);
  // Two of the 225 vertices are free: the correction is no larger than the solution of their block.
  const Eigen::MatrixXd block = dense(matrix).block<6, 6>(336, 336);
  const Eigen::VectorXd right = Eigen::VectorXd::Ones(6), exact = block.llt().solve(right);
  CHECK(z.segment<6>(336).dot(right.transpose()) <= exact.dot(right) * (1 + 1e-6));
  CHECK(z.segment<6>(336).dot(right.transpose()) > 0.0);
  CHECK(z.leftCols(336).norm() == 0.0);
}

TEST_CASE("with the coarse correction, the iterations of stiff sheets do not grow with their size",
          "[cloth]") {
  int first = 0;
  for (const int n : {20, 40, 80}) {
    const BlockSymmetric<double> matrix = stretched_sheet(n, 1e5);
    const Counts count = iterations(matrix, make(matrix, sheet_graph(n, n, false)));
    CAPTURE(n, count.alone, count.both);
    if (n == 20) first = count.both;
    CHECK(count.both <= first + 8);
    CHECK(2 * count.both < count.alone);
  }
}

TEST_CASE("linked layers of cloth keep corrections of their own", "[cloth]") {
  // Two sheets, every vertex joined to its twin by a spring across the gap; sides of triangles lie
  // within the sheets.
  const int n = 24, layer = n * n;
  const Graph sheet = sheet_graph(n, n, false);
  Graph graph;
  graph.positions.resize(3, 2 * layer);
  graph.positions << sheet.positions, sheet.positions;
  graph.positions.rightCols(layer).row(1).setConstant(0.05);
  for (const auto& [i, j] : sheet.pairs) {
    graph.pairs.push_back({i, j});
    graph.pairs.push_back({layer + i, layer + j});
  }
  const std::vector<SurfaceEdge<>> sides = sides_of(graph);
  for (int i = 0; i < layer; ++i) graph.pairs.push_back({i, layer + i});
  const BlockSymmetric<double> matrix = spring_matrix(graph, 1e5);
  const Counts count = iterations(matrix, {matrix, sides, graph.positions});
  CAPTURE(count.alone, count.both);
  CHECK(3 * count.both < 2 * count.alone);
  CHECK(count.alone < 100);  // the links are exact in the factor, which needs no compensation
}

TEST_CASE("a knot of many threads costs no more than its vertices", "[cloth]") {
  // 200 threads of ten vertices that start at one vertex: all are near each other.
  std::mt19937 random(7);
  Graph knot;
  knot.positions.setZero(3, 2001);
  for (int thread = 0; thread < 200; ++thread) {
    for (int k = 0; k < 10; ++k) {
      const int v = 1 + 10 * thread + k;
      knot.positions.col(v) << 0.1 * (k + 1) * std::cos(0.1 * thread),
          0.1 * (k + 1) * std::sin(0.1 * thread), 0.01 * thread;
      knot.pairs.push_back({k == 0 ? 0 : v - 1, v});
    }
  }
  std::vector<SurfaceEdge<>> sides;
  for (const auto& [i, j] : knot.pairs) sides.push_back({i, j, 0.1});
  const BlockSymmetric<double> matrix = random_spd<double>(knot, random);
  CoarseCorrection<double> coarse(matrix, sides, knot.positions);
  CHECK(coarse.factor_entries() <= 216 * 2001);
  CHECK(coarse.factorize(matrix, none_held(matrix)));
}

TEST_CASE("a copy of the coarse correction factorises without allocation", "[cloth]") {
  const BlockSymmetric<double> matrix = stretched_sheet(15, 10.0);
  const CoarseCorrection<double> made = make(matrix, sheet_graph(15, 15, false));
  CoarseCorrection<double> copy = made;
  const std::vector<unsigned char> held = none_held(matrix);
  const long before = allocations();
  REQUIRE(copy.factorize(matrix, held));
  const long count = allocations() - before;
  if (allocation_counting_works()) CHECK(count == 0);
}

TEST_CASE("sides of triangles have the rest lengths of the springs along them", "[cloth]") {
  SpringNetwork<double> network;
  network.triangles = {{0, 1, 2}};
  network.springs = {{1, 0, 0.5, 10.0, 0.0}, {2, 1, 0.25, 10.0, 0.0}, {2, 3, 1.0, 10.0, 0.0}};
  const std::vector<SurfaceEdge<>> sides = surface_sides(network);
  REQUIRE(sides.size() == 2);
  CHECK((sides[0].a == 1 && sides[0].b == 0 && sides[0].length == 0.5));
  CHECK((sides[1].a == 2 && sides[1].b == 1 && sides[1].length == 0.25));
}
