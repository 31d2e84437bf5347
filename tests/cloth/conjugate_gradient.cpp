// Conjugate gradients: solutions against a dense factor, the tests that end a solve, indefinite
// matrices, held vertices.

#include "clothctl/cloth/detail/conjugate_gradient.hpp"

#include <limits>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "support/allocations.hpp"
#include "support/block_matrices.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using namespace clothctl_test;

namespace {

using Row = Lanes<double, 1>;

// A random system of 12 vertices; vertex 4 is held.
struct System {
  BlockSymmetric<double> matrix;
  Row right;
  VectorX<double> mass = VectorX<double>::Constant(12, 0.5);
  std::vector<unsigned char> held = std::vector<unsigned char>(12, 0);
  ConjugateGradientMemory<double> memory;

  System() {
    std::mt19937 random(7);
    matrix = random_spd<double>(sheet_graph(3, 4, false), random);
    right = Row::NullaryExpr(1, 36, [&] { return random_number(random); });
    held[4] = 1;
    right.segment<3>(12).setZero();
    memory.reserve(12);
  }
  static double random_number(std::mt19937& random) {
    return static_cast<double>(random()) / 4294967296.0 - 0.5;
  }
  template <class Apply>
  ConjugateGradientReport solve(const ConjugateGradientLimits<double>& limits, Apply apply) {
    return conjugate_gradient<double>(matrix, right, mass, held, limits, apply, memory);
  }
  // The matrix with rows and columns of the held vertex of the identity.
  Eigen::MatrixXd reduced() const {
    Eigen::MatrixXd a = dense(matrix);
    a.middleRows<3>(12).setZero();
    a.middleCols<3>(12).setZero();
    a.block<3, 3>(12, 12).setIdentity();
    return a;
  }
};

const auto copy = [](const Row& r, Row& z) { z = r; };

}  // namespace

TEST_CASE("conjugate gradients solve to the tolerance, and exactly with an exact preconditioner",
          "[cloth]") {
  System system;
  const Eigen::MatrixXd a = system.reduced();
  const Eigen::VectorXd expected = a.llt().solve(system.right.transpose());
  const long before = allocations();
  const ConjugateGradientReport report = system.solve({0.0, 1e-12, 200}, copy);
  const long made = allocations() - before;
  if (allocation_counting_works()) CHECK(made == 0);
  CHECK((report.converged && report.finite && !report.indefinite));
  CHECK((system.memory.solution.transpose() - expected).norm() <= 1e-10 * expected.norm());
  CHECK(system.memory.solution.segment<3>(12).norm() == 0.0);
  CHECK(is_small<double>(system.memory.residual, system.mass, 1e-12));

  const Eigen::MatrixXd inverse = a.inverse();
  const ConjugateGradientReport once =
      system.solve({0.0, 1e-9, 200}, [&](const Row& r, Row& z) { z = r * inverse; });
  CHECK(once.iterations == 1);
  CHECK(once.converged);
}

TEST_CASE("the forcing term and the limit end a solve early, with less energy", "[cloth]") {
  System system;
  const Eigen::MatrixXd a = system.reduced();
  double last = 0.0;
  int iterations = 0;
  for (const double forcing : {0.9, 0.1, 1e-3, 1e-9}) {
    const ConjugateGradientReport report = system.solve({forcing, 0.0, 200}, copy);
    CHECK(report.converged);
    CHECK(report.iterations >= iterations);
    iterations = report.iterations;
    const Eigen::VectorXd d = system.memory.solution.transpose();
    const double energy = 0.5 * d.dot(a * d) - system.right.dot(d.transpose());
    CHECK(energy <= last);
    last = energy;
  }
  CHECK(iterations > 4);
  const ConjugateGradientReport stopped = system.solve({0.0, 1e-12, 3}, copy);
  CHECK((stopped.iterations == 3 && !stopped.converged && stopped.finite));
  system.right.setZero();
  const ConjugateGradientReport nothing = system.solve({0.1, 1e-9, 3}, copy);
  CHECK((nothing.iterations == 0 && nothing.converged));
  CHECK(system.memory.solution.norm() == 0.0);
}

TEST_CASE("an indefinite matrix gives a direction of descent", "[cloth]") {
  System system;
  for (const double shift : {1e4, 0.02}) {
    System shifted;
    for (Index i = 0; i < 12; ++i)
      shifted.matrix.diagonal(i) -= (i % 3 == 0 ? shift : 0.0) * Matrix3<double>::Identity();
    const ConjugateGradientReport report = shifted.solve({1e-9, 1e-12, 200}, copy);
    CAPTURE(shift);
    CHECK(report.finite);
    if (shift > 1.0) CHECK(report.indefinite);
    CHECK(shifted.right.dot(shifted.memory.solution) > 0.0);
  }
}

TEST_CASE("numbers that are not finite are reported", "[cloth]") {
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    System system;
    system.right[5] = bad;
    CHECK_FALSE(system.solve({0.1, 1e-9, 50}, copy).finite);
    System other;
    other.matrix.diagonal(2)(0, 0) = bad;
    CHECK_FALSE(other.solve({0.1, 1e-9, 50}, copy).finite);
  }
}
