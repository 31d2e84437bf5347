// The gain of a field of markers: against the Riccati recursion of the whole filter, with known
// vertices, and with hidden markers.

#include "clothctl/estimate/detail/field_gain.hpp"

#include <cmath>

#include "clothctl/mesh/grid.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

#include <Eigen/LU>

using namespace clothctl;

namespace {

using Matrix = MatrixX<double>;

// Five vertices on a line; the first one is known, markers are at 1, 4 and between 2 and 3.
struct Line {
  Points<double> places = Points<double>::Zero(3, 5);
  PointFeatures<double> markers;
  EstimatorSettings<double> settings;
  detail::FieldGain<double> gain;

  Line() {
    for (Index i = 0; i < 5; ++i) places(0, i) = 0.1 * static_cast<double>(i);
    markers.add_point(1);
    markers.add_point(4);
    markers.add_sum({{2, 0.5}, {3, 0.5}});
    settings.acceleration = 5;
    settings.correlation = 0.15;
    gain.reserve(places, markers, {0}, settings);
  }
  // The covariance of the acceleration, and the markers as a matrix.
  Matrix field() const {
    Matrix k(5, 5);
    for (Index i = 0; i < 5; ++i) {
      for (Index j = 0; j < 5; ++j) {
        const double d = std::sqrt(3.0) * std::abs(places(0, i) - places(0, j)) / 0.15;
        k(i, j) = (1 + d) * std::exp(-d);
      }
    }
    return k - k.col(0) * k.row(0) / k(0, 0);
  }
  static Matrix map() {
    Matrix c = Matrix::Zero(3, 5);
    c(0, 1) = c(1, 4) = 1;
    c(2, 2) = c(2, 3) = 0.5;
    return c;
  }
};

}  // namespace

TEST_CASE("field gain: with all markers it is the steady state of the filter", "[estimate]") {
  Line line;
  const double t = line.settings.dt, r = line.settings.noise * line.settings.noise;
  const Matrix k = line.field(), c = Line::map();
  Matrix f = Matrix::Identity(10, 10), q(10, 10), h = Matrix::Zero(3, 10);
  f.topRightCorner(5, 5) = t * Matrix::Identity(5, 5);
  const double a = line.settings.acceleration * line.settings.acceleration;
  q << t * t * t * t / 4 * k, t * t * t / 2 * k, t * t * t / 2 * k, t * t * k;
  h.leftCols(5) = c;
  // Vertices that no marker tells anything of drift without bound, so the recursion starts small.
  Matrix p = a * q, best;
  for (int i = 0; i < 4000; ++i) {
    const Matrix s = h * p * h.transpose() + r * Matrix::Identity(3, 3);
    best = p * h.transpose() * s.inverse();
    p = f * (p - best * h * p) * f.transpose() + a * q;
  }
  for (Index j = 0; j < 3; ++j) {
    Points<double> gap = Points<double>::Zero(3, 3), x = Points<double>::Zero(3, 5), v = x;
    gap(1, j) = 1;
    line.gain.correct({0, 1, 2}, gap, x, v);
    for (Index i = 0; i < 5; ++i) {
      CHECK(std::abs(x(1, i) - best(i, j)) < 1e-6);
      CHECK(std::abs(v(1, i) - best(5 + i, j)) < 1e-4);
      CHECK(x(0, i) == 0);
    }
    CHECK(x(1, 0) == 0);  // known
    CHECK(v(1, 0) == 0);
  }
}

TEST_CASE("field gain: a hidden marker takes no part, and nothing allocates", "[estimate]") {
  Line line;
  Points<double> gap = Points<double>::Constant(3, 3, 0.01), x = Points<double>::Zero(3, 5);
  Points<double> v = x, other_x = x, other_v = x;
  const std::vector<Index> used{0, 2};
  const long before = clothctl_test::allocations();
  line.gain.correct(used, gap, x, v);
  gap.col(1).setConstant(1e6);
  line.gain.correct(used, gap, other_x, other_v);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK(x == other_x);
  CHECK(v == other_v);
  CHECK(x(0, 1) > 0.001);
  CHECK(x(0, 1) < 0.01);
  CHECK(x(0, 4) > 0);  // follows its neighbours
  CHECK(line.gain.expected(0) > line.settings.noise);
}

TEST_CASE("field gain: markers on known vertices alone change nothing", "[estimate]") {
  Line line;
  PointFeatures<double> markers;
  markers.add_point(0);
  line.gain.reserve(line.places, markers, {0, 0}, line.settings);
  Points<double> x = Points<double>::Zero(3, 5), v = x;
  line.gain.correct({0}, Points<double>::Ones(3, 1), x, v);
  CHECK(x == Points<double>::Zero(3, 5));
  CHECK(v == Points<double>::Zero(3, 5));
}

TEST_CASE("field gain: Jacobi rotations diagonalise", "[estimate]") {
  const Index n = 7;
  Matrix a(n, n), vectors;
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) a(i, j) = std::sin(static_cast<double>((i + 1) * (j + 1)));
  }
  const Matrix given = a;
  detail::diagonalise(a, vectors);
  CHECK((vectors.transpose() * vectors - Matrix::Identity(n, n)).cwiseAbs().maxCoeff() < 1e-13);
  const Matrix back = vectors * a.diagonal().asDiagonal() * vectors.transpose();
  CHECK((back - given).cwiseAbs().maxCoeff() < 1e-13);
}
