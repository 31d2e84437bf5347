#include "clothctl/linalg/detail/dense_kernels.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <random>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

Eigen::MatrixXd random_spd_dense(Index n, std::mt19937& random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd a(n, n);
  for (Index i = 0; i < a.size(); ++i) a(i) = normal(random);
  return a * a.transpose() + 0.5 * static_cast<double>(n) * Eigen::MatrixXd::Identity(n, n);
}

Index padded(Index rows, Index lanes) { return (rows + lanes - 1) / lanes * lanes; }

/// Eliminates a random front and compares L, V and the Schur complement with a dense factorisation.
template <class Scalar>
void check_front(Index pivots, Index border, bool fresh, std::mt19937& random, double tolerance) {
  constexpr Index lanes = native_lanes<Scalar>();
  const Index n = pivots + border, ld = padded(n, lanes), ldu = padded(border, lanes);
  Eigen::MatrixXd a = random_spd_dense(n, random);
  if (fresh) a.bottomRightCorner(border, border).setZero();
  MatrixX<Scalar> f =
      MatrixX<Scalar>::Zero(ld, pivots + 1);  // a spare column, since the kernels may read padding
  f.topLeftCorner(n, pivots) = a.leftCols(pivots).cast<Scalar>();
  f.topLeftCorner(pivots, pivots)
      .template triangularView<Eigen::StrictlyUpper>()
      .setConstant(Scalar(99));
  MatrixX<Scalar> u = MatrixX<Scalar>::Constant(ldu, border + 1, Scalar(99));
  if (!fresh) u.topLeftCorner(border, border) = a.bottomRightCorner(border, border).cast<Scalar>();
  REQUIRE(eliminate_front(f.data(), ld, pivots, border, u.data(), ldu, fresh));

  const Eigen::MatrixXd l = a.topLeftCorner(pivots, pivots).llt().matrixL();
  Eigen::MatrixXd v(border, pivots);
  // With no right-hand sides, Eigen's triangular solve binds a reference to a null pointer.
  if (border > 0) {
    v = l.triangularView<Eigen::Lower>()
            .solve(Eigen::MatrixXd(a.bottomLeftCorner(border, pivots).transpose()))
            .transpose();
  }
  const Eigen::MatrixXd schur = a.bottomRightCorner(border, border) - v * v.transpose();
  const double scale = tolerance * a.norm();
  CHECK((f.block(pivots, 0, border, pivots).template cast<double>() - v).norm() <= scale);
  const Eigen::MatrixXd difference =
      u.topLeftCorner(border, border).template cast<double>() - schur;
  CHECK(Eigen::MatrixXd(difference.triangularView<Eigen::Lower>()).norm() <= scale);
  // Off the diagonal panels there is L, on them its inverse with zeros above.
  const Panels panels(pivots);
  for (int p = 0; p < panels.count; ++p) {
    const Index first = panels.begin(p), width = panels.begin(p + 1) - first, below = first + width;
    const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(width, width);
    const Eigen::MatrixXd inverse =
        l.block(first, first, width, width).triangularView<Eigen::Lower>().solve(identity);
    CHECK((f.block(first, first, width, width).template cast<double>() - inverse).norm() <=
          tolerance * inverse.norm());
    CHECK((f.block(below, first, pivots - below, width).template cast<double>() -
           l.block(below, first, pivots - below, width))
              .norm() <= scale);
  }
}

}  // namespace

TEST_CASE("Panels cover the columns in nearly equal multiples of three") {
  for (int columns = 0; columns <= 120; columns += 3) {
    const Panels panels(columns);
    CHECK(panels.begin(0) == 0);
    CHECK(panels.begin(panels.count) == columns);
    for (int p = 0; p < panels.count; ++p) {
      const int width = panels.begin(p + 1) - panels.begin(p);
      CHECK(width % 3 == 0);
      CHECK(width > 0);
      CHECK(width <= kPanel);
      CHECK(width >= columns / panels.count - 3);
    }
  }
}

TEST_CASE("An eliminated front holds the factor and the Schur complement") {
  std::mt19937 random(21);
  for (const bool fresh : {false, true}) {
    for (const Index pivots : {3, 6, 9, 12, 15, 36, 51}) {
      for (const Index border : {0, 3, 12, 15, 48, 66}) {
        check_front<double>(pivots, border, fresh, random, 1e-13);
        check_front<float>(pivots, border, fresh, random, 1e-5);
      }
    }
  }
  check_front<long double>(15, 21, false, random, 1e-13);
}

TEST_CASE("Packing keeps the columns of each row panel up to its diagonal") {
  for (const Index pivots : {3, 15, 36}) {
    for (const Index border : {0, 6, 27}) {
      const Index ld = pivots + border;
      MatrixX<double> f(ld, pivots);
      for (Index i = 0; i < f.size(); ++i) f(i) = static_cast<double>(i + 1);
      VectorX<double> packed = VectorX<double>::Zero(packed_size(pivots, border));
      pack_front(f.data(), ld, pivots, border, packed.data());
      Index at = 0;
      const auto check_rows = [&](Index first, Index width, Index columns) {
        for (Index k = 0; k < columns; ++k) {
          for (Index r = 0; r < width; ++r) CHECK(packed(at++) == f(first + r, k));
        }
      };
      const Panels own(pivots), below(border);
      for (int p = 0; p < own.count; ++p)
        check_rows(own.begin(p), own.begin(p + 1) - own.begin(p), own.begin(p + 1));
      for (int p = 0; p < below.count; ++p) {
        check_rows(pivots + below.begin(p), below.begin(p + 1) - below.begin(p), pivots);
      }
      CHECK(at == packed.size());
    }
  }
}

TEST_CASE("A front that is not positive definite is refused") {
  constexpr Index lanes = native_lanes<double>();
  const Index n = 24, ld = padded(n, lanes);
  const double bad[] = {0.0, -1.0, std::numeric_limits<double>::quiet_NaN(),
                        std::numeric_limits<double>::infinity()};
  for (const double value : bad) {
    for (const Index at : {Index(0), Index(11), Index(12), Index(23)}) {
      MatrixX<double> f = MatrixX<double>::Zero(ld, n + 1);
      f.topRows(n).leftCols(n).setIdentity();
      f(at, at) = value;
      double none = 0.0;
      CHECK_FALSE(eliminate_front(f.data(), ld, n, Index(0), &none, Index(0), true));
    }
  }
}

TEST_CASE("Runs of rows are added one by one") {
  for (Index count = 0; count < 40; ++count) {
    std::vector<float> target(static_cast<std::size_t>(count + 1), 1.0f),
        source(static_cast<std::size_t>(count + 1), 2.0f);
    add_run(target.data(), source.data(), count);
    for (Index i = 0; i < count; ++i) CHECK(target[static_cast<std::size_t>(i)] == 3.0f);
    CHECK(target.back() == 1.0f);
  }
}
