#include "clothctl/contact/affine_patch.hpp"

#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include <Eigen/Geometry>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;

namespace {

template <class S>
struct Random {
  std::mt19937 engine;
  std::normal_distribution<double> normal;
  explicit Random(unsigned seed) : engine(seed) {}
  Points<S> points(Index rows, Index n) {
    Points<S> out = Points<S>::Zero(3, n);
    for (Index i = 0; i < n; ++i) {
      for (Index c = 0; c < rows; ++c) out(c, i) = S(normal(engine));
    }
    return out;
  }
  Matrix3<S> map() {
    return Matrix3<S>::NullaryExpr([this] { return S(normal(engine)); });
  }
  Matrix3<S> turn() {
    const Eigen::Matrix3d q =
        Eigen::Quaterniond(normal(engine), normal(engine), normal(engine), normal(engine))
            .normalized()
            .toRotationMatrix();
    return q.cast<S>();
  }
};

// A cloud of n points whose offsets span `rank` dimensions, rotated and moved.
template <class S>
Points<S> shape(Random<S>& random, int rank, Index n, S size) {
  Points<S> x = size * (random.turn() * random.points(rank, n));
  const Vector3<S> place = random.points(3, 1).col(0);
  x.colwise() += place;
  return x;
}

template <class S>
Vector3<S> mean(const Points<S>& x) {
  return x.rowwise().sum() / S(static_cast<double>(x.cols()));
}

}  // namespace

TEMPLATE_TEST_CASE("rank and number of modes are right for points, lines, flat and solid patches",
                   "[contact]", float, double) {
  using S = TestType;
  Random<S> random(5);
  for (int rank = 0; rank <= 3; ++rank) {
    for (Index n = rank + 1; n <= 25; n += (n < 8 ? 1 : 5)) {
      for (int trial = 0; trial < clothctl_test::trials(10, 300); ++trial) {
        AffinePatchBasis<S> modes(n);
        modes.update(shape<S>(random, rank, n, S(0.05)));
        CAPTURE(rank, n);
        // Three random points may be nearly collinear. The rank may then be one less, but never
        // more.
        CHECK(modes.rank() <= rank);
        if (n >= rank + 4) CHECK(modes.rank() == rank);
        CHECK(modes.count() == n);
        CHECK(modes.non_affine_count() == n - 1 - modes.rank());
      }
    }
  }
}

TEMPLATE_TEST_CASE("non-affine rows are orthonormal and zero for every affine motion", "[contact]",
                   float, double) {
  using S = TestType;
  Random<S> random(6);
  const S near = S(200) * scalar_traits<S>::epsilon();
  for (int trial = 0; trial < clothctl_test::trials(60, 2000); ++trial) {
    const int rank = trial % 4;
    const Index n = 5 + trial % 21;
    CAPTURE(rank, n);
    const Points<S> reference = shape<S>(random, rank, n, S(0.05));
    AffinePatchBasis<S> modes(n);
    modes.update(reference);
    MatrixX<S> rows(modes.non_affine_count(), n);
    for (Index i = 0; i < rows.rows(); ++i) rows.row(i) = modes.non_affine(i);
    CHECK((rows * rows.transpose() - MatrixX<S>::Identity(rows.rows(), rows.rows()))
              .cwiseAbs()
              .maxCoeff() <= near);
    // First an affine motion about the patch's own centre, then any.
    const Matrix3<S> map = random.map();
    const Vector3<S> centre = mean(reference), shift = random.points(3, 1).col(0);
    Points<S> moved = map * (reference.colwise() - centre);
    CHECK((moved * rows.transpose()).cwiseAbs().maxCoeff() <=
          near * S(0.05) * map.norm() + S(8) * scalar_traits<S>::epsilon());
    moved.colwise() += shift;
    CHECK((moved * rows.transpose()).cwiseAbs().maxCoeff() <= S(4) * near);
    // The modes contain all of the rest: its size in the modes is its distance from the nearest
    // affine motion.
    const Points<S> free = random.points(3, n);
    Points<S> nearest = Points<S>::Zero(3, n);
    Matrix3<S> best = Matrix3<S>::Zero();
    for (Index j = 0; j < n; ++j) best += free.col(j) * modes.map().col(j).transpose();
    nearest = best * (reference.colwise() - centre);
    nearest.colwise() += mean(free);
    CHECK(std::abs((free * rows.transpose()).norm() - (free - nearest).norm()) <=
          S(10) * near * free.norm());
  }
}

TEMPLATE_TEST_CASE("the linear map is recovered within the patch's own directions", "[contact]",
                   float, double) {
  using S = TestType;
  Random<S> random(7);
  const S near = S(5000) * scalar_traits<S>::epsilon();
  for (int trial = 0; trial < clothctl_test::trials(60, 2000); ++trial) {
    const int rank = 1 + trial % 3;
    const Index n = 8 + trial % 9;
    CAPTURE(rank, n);
    const Points<S> reference = shape<S>(random, rank, n, S(1));
    AffinePatchBasis<S> modes(n);
    modes.update(reference);
    const Matrix3<S> map = random.map();
    const Vector3<S> centre = mean(reference), shift = random.points(3, 1).col(0);
    const Points<S> offsets = reference.colwise() - centre;
    Points<S> moved = map * offsets;
    moved.colwise() += shift;
    Matrix3<S> found = Matrix3<S>::Zero();
    for (Index j = 0; j < n; ++j) found += moved.col(j) * modes.map().col(j).transpose();
    CHECK((found * offsets - map * offsets).cwiseAbs().maxCoeff() <= near * (S(1) + map.norm()));
    if (rank == 3) CHECK((found - map).cwiseAbs().maxCoeff() <= S(20) * near * (S(1) + map.norm()));
  }
}

TEMPLATE_TEST_CASE("scaling a patch scales its map and leaves the span of the modes", "[contact]",
                   float, double) {
  using S = TestType;
  Random<S> random(8);
  for (const double size : {1e-4, 1e-2, 1.0, 1e3}) {
    const Points<S> unit = random.turn() * random.points(2, 9);
    AffinePatchBasis<S> plain(9), scaled(9);
    plain.update(unit);
    scaled.update(S(size) * unit);
    CHECK(scaled.rank() == 2);
    CHECK((S(size) * scaled.map() - plain.map()).cwiseAbs().maxCoeff() <=
          S(1000) * scalar_traits<S>::epsilon());
    MatrixX<S> a = MatrixX<S>::Zero(9, 9), b = a;
    for (Index i = 0; i < 6; ++i) {
      a += plain.non_affine(i).transpose() * plain.non_affine(i);
      b += scaled.non_affine(i).transpose() * scaled.non_affine(i);
    }
    CHECK((a - b).cwiseAbs().maxCoeff() <= S(1000) * scalar_traits<S>::epsilon());
  }
}

TEMPLATE_TEST_CASE("patches thinner than a thousandth of their width count as flat", "[contact]",
                   float, double) {
  using S = TestType;
  AffinePatchBasis<S> modes(8);
  for (const auto& [thickness, rank] : {std::pair<double, int>(1e-4, 2), {0.05, 3}}) {
    Points<S> box(3, 8);
    for (int i = 0; i < 8; ++i) {
      box.col(i) << S(i & 1 ? 1 : -1), S(i & 2 ? 0.7 : -0.7), S((i & 4 ? 1 : -1) * thickness);
    }
    modes.update(box);
    CHECK(modes.rank() == rank);
    CHECK(modes.non_affine_count() == 7 - rank);
  }
}

TEMPLATE_TEST_CASE("update does not allocate, and accepts a single vertex or NaN", "[contact]",
                   float, double) {
  using S = TestType;
  Random<S> random(9);
  AffinePatchBasis<S> one(1), modes(12);
  Points<S> x = shape<S>(random, 3, 12, S(0.1));
  const long before = clothctl_test::allocations();
  modes.update(x);
  one.update(x.leftCols(1));
  const long during = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(during == 0);
  CHECK(one.rank() == 0);
  CHECK(one.non_affine_count() == 0);
  CHECK(one.map().isZero());
  x(1, 3) = std::numeric_limits<S>::quiet_NaN();
  modes.update(x);
  CHECK(modes.rank() == 0);
  x = shape<S>(random, 3, 12, S(0.1));
  modes.update(x);
  CHECK(modes.rank() == 3);
}
