#include "clothctl/linalg/detail/solve_kernels.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <random>

#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

/// An eliminated and packed random front with its dense factor: L (pivots×pivots) above V
/// (border×pivots).
struct Sample {
  Index pivots, border;
  VectorX<double> packed;
  Eigen::MatrixXd l, v;

  Sample(Index pivot_rows, Index border_rows, std::mt19937& random)
      : pivots(pivot_rows), border(border_rows) {
    constexpr Index lanes = native_lanes<double>();
    const Index n = pivots + border;
    const Index ld = (n + lanes - 1) / lanes * lanes, ldu = (border + lanes - 1) / lanes * lanes;
    std::normal_distribution<double> normal;
    Eigen::MatrixXd a(n, n);
    for (Index i = 0; i < a.size(); ++i) a(i) = normal(random);
    a = (a * a.transpose()).eval() + static_cast<double>(n) * Eigen::MatrixXd::Identity(n, n);
    MatrixX<double> f = MatrixX<double>::Zero(ld, pivots + 1);
    f.topLeftCorner(n, pivots) = a.leftCols(pivots);
    MatrixX<double> u = MatrixX<double>::Zero(ldu, border + 1);
    REQUIRE(eliminate_front(f.data(), ld, pivots, border, u.data(), ldu, true));
    packed.resize(packed_size(pivots, border));
    pack_front(f.data(), ld, pivots, border, packed.data());
    l = a.topLeftCorner(pivots, pivots).llt().matrixL();
    v.resize(border, pivots);
    // With no right-hand sides, Eigen's triangular solve binds a reference to a null pointer.
    if (border > 0) {
      v = l.triangularView<Eigen::Lower>()
              .solve(Eigen::MatrixXd(a.bottomLeftCorner(border, pivots).transpose()))
              .transpose();
    }
  }
};

template <int kLanes>
void check_passes(const Sample& s) {
  // Rows of right-hand sides, kLanes wide: the pivots, then the border.
  Lanes<double, kLanes> x = Lanes<double, kLanes>::Random(kLanes, s.pivots + s.border);
  const Eigen::MatrixXd start = x.transpose();
  double* below = x.data() + s.pivots * kLanes;
  solve_front_forward<kLanes>(
      s.packed.data(), s.pivots, s.border, x.data(),
      [&]<int kRows>(Index row, const RowBlock<double, kRows, kLanes>& products) {
        RowBlock<double, kRows, kLanes> rows;
        rows.load(below + row * kLanes);
        rows.subtract(products);
        rows.store(below + row * kLanes);
      });
  const Eigen::MatrixXd top = s.l.triangularView<Eigen::Lower>().solve(start.topRows(s.pivots));
  const Eigen::MatrixXd bottom = start.bottomRows(s.border) - s.v * top;
  Eigen::MatrixXd result = x.transpose();
  CHECK((result.topRows(s.pivots) - top).norm() < 1e-12 * top.norm());
  CHECK((result.bottomRows(s.border) - bottom).norm() <= 1e-12 * (1.0 + bottom.norm()));

  solve_front_backward<kLanes>(s.packed.data(), s.pivots, s.border, x.data(),
                               [&]<int kRows>(Index row, RowBlock<double, kRows, kLanes>& rows) {
                                 rows.load(below + row * kLanes);
                               });
  const Eigen::MatrixXd rest = top - s.v.transpose() * bottom;
  const Eigen::MatrixXd solved = s.l.transpose().triangularView<Eigen::Upper>().solve(rest);
  result = x.transpose();
  CHECK((result.topRows(s.pivots) - solved).norm() < 1e-12 * solved.norm());
}

}  // namespace

TEST_CASE("Passes over a front agree with dense triangular solves") {
  std::mt19937 random(31);
  for (const Index pivots : {3, 6, 9, 12, 15, 36, 51}) {
    for (const Index border : {0, 3, 12, 21, 48}) {
      const Sample sample(pivots, border, random);
      check_passes<1>(sample);
      check_passes<4>(sample);
      check_passes<8>(sample);
      check_passes<16>(sample);
    }
  }
}
