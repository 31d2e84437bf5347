#include "clothctl/linalg/block_symmetric.hpp"

#include "math/assertion.hpp"
#include "support/allocations.hpp"
#include "support/block_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl_test;

TEST_CASE("A pattern drops repeated pairs, self-couplings and the order of a pair") {
  const BlockSymmetric<double> matrix(4, {{0, 2}, {2, 0}, {1, 1}, {3, 0}, {2, 1}, {0, 3}});
  CHECK(matrix.rows() == 4);
  CHECK(matrix.lower_count() == 3);
  CHECK(matrix.find(0, 2) >= 0);
  CHECK(matrix.find(0, 2) == matrix.find(2, 0));
  CHECK(matrix.find(0, 1) == -1);
  CHECK(matrix.find(3, 2) == -1);
  for (Index i = 0; i < 4; ++i) {
    for (int s = matrix.row_begin(i); s < matrix.row_begin(i + 1); ++s) {
      CHECK(matrix.column(s) < i);
      CHECK(matrix.find(static_cast<int>(i), static_cast<int>(matrix.column(s))) == s);
    }
  }
}

TEST_CASE("Matrices of no row and of one row work") {
  BlockSymmetric<float> none;
  Lanes<float, 4> empty(4, 0), out(4, 0);
  none.multiply(empty, out);
  CHECK(none.rows() == 0);
  BlockSymmetric<double> one(1, {});
  one.diagonal(0) << 2, 1, 0, 1, 3, 0, 0, 0, 4;
  Lanes<double, 1> x(1, 3), y(1, 3);
  x << 1, 2, 3;
  one.multiply(x, y);
  CHECK(y(0) == 4);
  CHECK(y(1) == 7);
  CHECK(y(2) == 12);
}

namespace {

template <class Scalar, int kLanes>
void check_product(const Graph& graph, std::mt19937& random, double tolerance) {
  const BlockSymmetric<Scalar> matrix = random_spd<Scalar>(graph, random);
  const Lanes<Scalar, kLanes> x = Lanes<Scalar, kLanes>::Random(kLanes, 3 * graph.size());
  Lanes<Scalar, kLanes> y = Lanes<Scalar, kLanes>::Constant(kLanes, 3 * graph.size(), Scalar(7));
  const long before = allocations();
  matrix.multiply(x, y);
  const long after = allocations();
  if (allocation_counting_works()) CHECK(after == before);
  const Eigen::MatrixXd given = x.template cast<double>();
  const Eigen::MatrixXd expected = given * dense(matrix);
  CHECK((y.template cast<double>() - expected).norm() <= tolerance * (1.0 + expected.norm()));
}

}  // namespace

TEST_CASE("Products agree with the dense matrix and overwrite y") {
  std::mt19937 random(11);
  for (const Graph& graph : {sheet_graph(5, 7, true), rope_graph(9), random_graph(20, 60, random),
                             random_graph(3, 0, random)}) {
    check_product<double, 1>(graph, random, 1e-14);
    check_product<double, 3>(graph, random, 1e-14);
    check_product<double, 4>(graph, random, 1e-14);
    check_product<double, 8>(graph, random, 1e-14);
    check_product<double, 16>(graph, random, 1e-14);
    check_product<float, 1>(graph, random, 1e-6);
    check_product<float, 4>(graph, random, 1e-6);
    check_product<float, 13>(graph, random, 1e-6);
    check_product<float, 16>(graph, random, 1e-6);
  }
}

TEST_CASE("Setting zero and adding matrices of one pattern work") {
  std::mt19937 random(12);
  const Graph graph = sheet_graph(4, 4, true);
  BlockSymmetric<double> a = random_spd<double>(graph, random);
  const BlockSymmetric<double> b = random_spd<double>(graph, random);
  const Eigen::MatrixXd expected = dense(a) - 0.5 * dense(b);
  a.add_scaled(b, -0.5);
  CHECK((dense(a) - expected).norm() < 1e-13 * expected.norm());
  a.set_zero();
  CHECK(dense(a).norm() == 0.0);
}

TEST_CASE("Bad indices and vectors of another size stop at an assert") {
  const BlockSymmetric<double> matrix(3, {{0, 1}, {2, 1}});
  CHECK(is_let_through([] { BlockSymmetric<double>(3, {{2, 0}}); }));
  CHECK(is_stopped([] { BlockSymmetric<double>(3, {{3, 0}}); }));
  CHECK(is_stopped([] { BlockSymmetric<double>(3, {{0, 3}}); }));
  CHECK(is_stopped([] { BlockSymmetric<double>(3, {{-1, 2}}); }));
  CHECK(is_stopped([] { BlockSymmetric<double>(-1, {}); }));
  CHECK(matrix.find(1, 1) == -1);
  CHECK(is_stopped([&] { matrix.find(0, 3); }));
  CHECK(is_stopped([&] { matrix.find(-1, 0); }));
  Lanes<double, 4> x = Lanes<double, 4>::Zero(4, 9), y = x, shorter = Lanes<double, 4>::Zero(4, 6);
  CHECK(is_let_through([&] { matrix.multiply(x, y); }));
  CHECK(is_stopped([&] { matrix.multiply(shorter, y); }));
  CHECK(is_stopped([&] { matrix.multiply(x, shorter); }));
  CHECK(is_stopped([&] { matrix.multiply(x, x); }));
  BlockSymmetric<double> sum = matrix;
  CHECK(is_stopped([&] { sum.add_scaled(BlockSymmetric<double>(3, {{0, 1}}), 1.0); }));
}

TEST_CASE("A matrix in another scalar has the same pattern and rounded values") {
  std::mt19937 random(9);
  const BlockSymmetric<double> matrix = random_spd<double>(sheet_graph(4, 3, true), random);
  BlockSymmetric<float> single = matrix.cast<float>();
  CHECK(single.rows() == matrix.rows());
  CHECK(single.lower_count() == matrix.lower_count());
  CHECK((dense(single) - dense(matrix)).norm() <= 1e-6 * dense(matrix).norm());
  const long before = allocations();
  single.set_zero();
  single.assign(matrix);
  const long made = allocations() - before;
  if (allocation_counting_works()) CHECK(made == 0);
  CHECK((dense(single) - dense(matrix)).norm() <= 1e-6 * dense(matrix).norm());
}
