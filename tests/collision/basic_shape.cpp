// What basic shapes share: checks of sizes, points and rotations, and orthogonal directions.

#include "clothctl/collision/detail/basic_shape.hpp"

#include <limits>
#include <random>

#include "clothctl/math/rotation.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using V = Vector3<double>;

TEST_CASE("sizes, points and rotations are checked", "[contact]") {
  const double inf = std::numeric_limits<double>::infinity();
  CHECK(detail::validate_size("radius", 0.1).empty());
  CHECK(detail::validate_size("radius", 1e25) ==
        "the radius 1e+25 m, must be finite and positive, at most 1e20");
  CHECK(detail::validate_size("radius", -0.0) == "the radius -0 m, must be finite and positive");
  CHECK(detail::validate_point<double>("centre", V(1, 2, 3)).empty());
  CHECK(detail::validate_point<double>("centre", V(1, 2, -inf)) ==
        "the centre with the coordinate 2 = -inf, must be finite");
  CHECK(detail::validate_point<double>("centre", V(1, 1e30, 3)) ==
        "the centre with the coordinate 1 = 1e+30, must be finite, at most 1e20");
  const Matrix3<double> R = rotation_exp<double>(V(1, -2, 0.5));
  CHECK(detail::validate_rotation<double>("pose", R).empty());
  CHECK(detail::validate_rotation<float>("pose", R.cast<float>()).empty());
  CHECK(detail::validate_rotation<double>("pose", -R) ==
        "the pose of a reflection, must be a rotation");
  CHECK(detail::validate_rotation<double>("pose", 2 * Matrix3<double>::Identity()) ==
        "the pose with columns that are off by 3, must be a rotation");
  Matrix3<double> bad = R;
  bad(1, 2) = inf;
  CHECK(detail::validate_rotation<double>("pose", bad) ==
        "the pose with the entry (1, 2) = inf, must be finite");
}

TEST_CASE("a rotation from single precision is made orthonormal", "[contact]") {
  const Matrix3<double> R = rotation_exp<float>(Vector3<float>(1, -2, 0.5f)).cast<double>();
  const Matrix3<double> clean = detail::orthonormal_rotation<double>(R);
  CHECK(detail::validate_rotation<double>("pose", R).empty());
  CHECK((clean - R).cwiseAbs().maxCoeff() <= 1e-6);
  CHECK((clean.transpose() * clean - Matrix3<double>::Identity()).cwiseAbs().maxCoeff() <= 1e-15);
  CHECK(detail::orthonormal_rotation<double>(Matrix3<double>::Identity()) ==
        Matrix3<double>::Identity());
}

TEST_CASE("orthogonal and unit vectors are so for every direction", "[contact]") {
  std::mt19937 random(71);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i) {
    const V u = V(normal(random), normal(random), i % 5 == 0 ? 0.0 : normal(random)).normalized();
    const V side = detail::unit_orthogonal<double>(u);
    CHECK(std::abs(side.dot(u)) <= 1e-15);
    CHECK(std::abs(side.norm() - 1) <= 1e-15);
  }
}
