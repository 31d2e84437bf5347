#include "clothctl/core/types.hpp"

#include <limits>
#include <type_traits>

#include "support/catch.hpp"

using namespace clothctl;

TEMPLATE_TEST_CASE("all_finite detects a bad coefficient at any position", "[types]", float,
                   double) {
  Points<TestType> points = Points<TestType>::Constant(3, 7, TestType(2));
  CHECK(all_finite(points));
  for (const TestType bad :
       {std::numeric_limits<TestType>::infinity(), std::numeric_limits<TestType>::quiet_NaN()}) {
    for (Index k = 0; k < points.size(); ++k) {
      Points<TestType> broken = points;
      broken.data()[k] = bad;
      CAPTURE(k);
      CHECK_FALSE(all_finite(broken));
      CHECK(all_finite(broken.leftCols(k / 3)));
    }
  }
}

TEST_CASE("all_finite accepts expressions, views and empty matrices", "[types]") {
  CHECK(all_finite(MatrixX<double>(0, 3)));
  MatrixX<double> a = MatrixX<double>::Identity(3, 3);
  CHECK(all_finite(a * 2.0));
  CHECK(all_finite(a.row(1)));
  a(2, 0) = std::numeric_limits<double>::infinity();
  CHECK_FALSE(all_finite(a.col(0)));
  CHECK(all_finite(a.col(1)));
}

TEST_CASE("a points view refers to columns without copying them", "[types]") {
  const Points<double> points = Points<double>::Constant(3, 5, 1.5);
  const PointsView<double> all(points);
  CHECK(all.data() == points.data());
  const PointsView<double> middle(points.middleCols(1, 3));
  CHECK(middle.data() == points.col(1).data());
  CHECK(middle.cols() == 3);
}

TEST_CASE("lanes are adjacent in memory", "[types]") {
  Lanes<float, 4> lanes = Lanes<float, 4>::Zero(4, 3);
  CHECK(&lanes(1, 2) == &lanes(0, 2) + 1);
  CHECK(&lanes(0, 2) == &lanes(0, 1) + 4);
}

TEST_CASE("the matrix types do not depend on Eigen's default storage order", "[types]") {
  static_assert(!MatrixX<double>::IsRowMajor && !Points<double>::IsRowMajor);
  static_assert(!Matrix3<float>::IsRowMajor && !VectorX<float>::IsRowMajor);
  static_assert(!Lanes<double, 4>::IsRowMajor && !DenseMatrix<double, 6, 6>::IsRowMajor);
  static_assert(bool(Lanes<double, 1>::IsRowMajor));
  static_assert(bool(DenseMatrix<double, 1, 3>::IsRowMajor));
  static_assert(!DenseMatrix<double, 1, 1>::IsRowMajor);
  // They are Eigen's own types if its default order is unchanged.
  static_assert(std::is_same_v<MatrixX<double>, Eigen::MatrixXd>);
  static_assert(std::is_same_v<Vector3<float>, Eigen::Vector3f>);
  SUCCEED();
}

TEST_CASE("a unit vector has length 1 to within a hundredth", "[types]") {
  const Vector3<double> axis(0.6, 0, -0.8);
  CHECK(is_unit(axis));
  CHECK(is_unit(1.005 * axis));
  CHECK_FALSE(is_unit(1.02 * axis));
  CHECK_FALSE(is_unit(0.98 * axis));
  CHECK_FALSE(is_unit(Vector3<double>(std::numeric_limits<double>::quiet_NaN(), 1, 0)));
  CHECK_FALSE(is_unit(Vector3<double>(std::numeric_limits<double>::infinity(), 0, 0)));
}
