#include "clothctl/math/symmetric_eigen.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <Eigen/LU>

#include "clothctl/math/rotation.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
Matrix3<S> with_eigenvalues(const Vector3<double>& values, std::mt19937& random) {
  std::normal_distribution<double> normal;
  const Matrix3<double> R =
      rotation_exp<double>(Vector3<double>(normal(random), normal(random), normal(random)));
  const Matrix3<double> A = R * values.asDiagonal() * R.transpose();
  return Matrix3<double>(0.5 * (A + A.transpose())).template cast<S>();
}

template <class S>
Vector3<double> sorted(const Vector3<S>& values) {
  Vector3<double> v = values.template cast<double>();
  std::sort(v.data(), v.data() + 3);
  return v;
}

}  // namespace

TEMPLATE_TEST_CASE("values and vectors give the matrix, and vectors are orthonormal",
                   "[symmetric_eigen]", float, double) {
  using S = TestType;
  const double eps = static_cast<double>(scalar_traits<S>::epsilon());
  std::mt19937 random(1);
  const Vector3<double> spectra[] = {{1, 2, 3},    {1, 1, 2},          {5, 5, 5},
                                     {0, 0, 0},    {1, 0, 0},          {1, 1e-9, 1e-9},
                                     {-1, 2, -3},  {1e10, 1e10, 1e-3}, {1e-12, 3e-12, 2e-12},
                                     {1, -1, 1e-3}};
  for (const Vector3<double>& spectrum : spectra) {
    for (int k = 0; k < 20; ++k) {
      const Matrix3<S> A = with_eigenvalues<S>(spectrum, random);
      const SymmetricEigen<S> eigen = symmetric_eigen<S>(A);
      const double size = spectrum.cwiseAbs().maxCoeff();
      const Matrix3<S> back = eigen.vectors * eigen.values.asDiagonal() * eigen.vectors.transpose();
      CHECK(static_cast<double>((back - A).norm()) <= 32 * eps * size);
      CHECK(static_cast<double>(
                (eigen.vectors.transpose() * eigen.vectors - Matrix3<S>::Identity()).norm()) <
            32 * eps);
      CHECK((sorted<S>(eigen.values) - sorted<double>(spectrum)).norm() <= 32 * eps * size);
    }
  }
}

TEST_CASE("small eigenvalues of a graded matrix are accurate", "[symmetric_eigen]") {
  // D M D with M well conditioned: the entries determine each eigenvalue to rounding.
  const Vector3<double> d(1.0, 1e-5, 1e-10);
  Matrix3<double> M;
  M << 1, 0.3, 0.2, 0.3, 1, 0.4, 0.2, 0.4, 1;
  const Matrix3<double> A = d.asDiagonal() * M * d.asDiagonal();
  const double determinant = M.determinant() * 1e-30;
  const Vector3<double> values = symmetric_eigen<double>(A).values;
  CHECK(std::abs(values.prod() / determinant - 1.0) < 1e-14);
}

TEST_CASE("a diagonal matrix stays unchanged", "[symmetric_eigen]") {
  const SymmetricEigen<double> eigen =
      symmetric_eigen<double>(Vector3<double>(3, 1, 2).asDiagonal());
  CHECK(eigen.values == Vector3<double>(3, 1, 2));
  CHECK(eigen.vectors == Matrix3<double>::Identity());
}

TEST_CASE(
    "a Jacobi rotation makes two columns orthogonal and rotates by at most an eighth of a turn",
    "[symmetric_eigen]") {
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  for (int k = 0; k < 100; ++k) {
    const double scale = k % 3 == 0 ? 1e-6 : 1.0;
    Vector3<double> a(normal(random), normal(random), normal(random)),
        b(normal(random), normal(random), normal(random));
    b *= scale;
    const auto [c, s] = jacobi_rotation<double>(a.squaredNorm(), b.squaredNorm(), a.dot(b));
    const Vector3<double> x = c * a - s * b, y = s * a + c * b;
    CHECK(std::abs(x.dot(y)) < 1e-14 * (x.norm() * y.norm() + 1e-6 * scale));
    CHECK(c >= std::sqrt(0.5) - 1e-15);
    CHECK(std::abs(c * c + s * s - 1.0) < 1e-15);
  }
}

TEMPLATE_TEST_CASE("eigenvalues are right near the ends of the scalar's range", "[symmetric_eigen]",
                   float, double) {
  using S = TestType;
  const bool single = std::is_same_v<S, float>;
  for (const S size : {S(single ? 1e-18 : 1e-160), S(single ? 1e-15 : 1e-100), S(1),
                       S(single ? 1e20 : 1e160), S(single ? 1e30 : 1e290)}) {
    CAPTURE(size);
    Matrix3<S> A;
    A << S(2), S(1), S(0), S(1), S(2), S(0), S(0), S(0), S(1);
    const Vector3<S> values = symmetric_eigen<S>(size * A).values / size;
    const Vector3<double> v = sorted<S>(values);
    CHECK(v[0] == Approx(1.0));
    CHECK(v[1] == Approx(1.0));
    CHECK(v[2] == Approx(3.0));
  }
}

TEST_CASE("NaN in the matrix ends the iteration with NaN, and nothing allocates",
          "[symmetric_eigen]") {
  Matrix3<double> A = Matrix3<double>::Identity();
  A(0, 1) = A(1, 0) = std::numeric_limits<double>::quiet_NaN();
  const SymmetricEigen<double> eigen = symmetric_eigen<double>(A);
  CHECK(!(all_finite(eigen.values) && all_finite(eigen.vectors)));
  const long before = clothctl_test::allocations();
  const Matrix3<double> B = Matrix3<double>::Constant(0.5) + Matrix3<double>::Identity();
  const double largest = symmetric_eigen<double>(B).values.maxCoeff();
  const long taken = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
  CHECK(largest == Approx(2.5));
}
