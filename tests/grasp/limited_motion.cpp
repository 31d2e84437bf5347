#include "clothctl/grasp/detail/limited_motion.hpp"

#include <cmath>
#include <random>

#include <Eigen/Geometry>

#include "support/catch.hpp"

using namespace clothctl;

namespace {
using Vec = Vector3<double>;
using Mat = Matrix3<double>;
}  // namespace

TEST_CASE("a motion goes straight to where it shall be, at most at its speeds", "[grasp]") {
  detail::LimitedMotion<double> motion;
  const Vec middle(0.3, -0.2, 0.5), axis(0.6, 0, 0.8);
  const Mat R = rotation_exp<double>(1.0 * axis);
  const Vec goal(0.5, -0.2, 0.4);
  REQUIRE(motion.move_to(R, goal - R * middle));
  Vec last = middle;
  Mat R_last = Mat::Identity();
  int steps = 0;
  while ((motion.at(middle) - goal).norm() > 1e-12 || (motion.R() - R).norm() > 1e-12) {
    motion.advance(middle, 0.01, 0.03);
    const Vec now = motion.at(middle);
    CHECK((now - last).norm() <= 0.01 + 1e-14);
    CHECK(rotation_log<double>(motion.R() * R_last.transpose()).norm() <= 0.03 + 1e-12);
    CHECK((now - middle).cross(goal - middle).norm() < 1e-15 * 1e2);     // on the line
    CHECK(rotation_log<double>(motion.R()).cross(axis).norm() < 1e-12);  // about the axis
    CHECK(is_rotation<double>(motion.R(), 1e-12));
    last = now;
    R_last = motion.R();
    REQUIRE(++steps < 100);
  }
  CHECK(steps == 34);  // 1 rad at 0.03 takes longer than 0.22 m at 0.01
  CHECK(!motion.move_to(R, Vec(1e200, 0, 0)));
  motion.reset();
  CHECK(motion.at(middle) == middle);
}

TEST_CASE("motions by steps are those of the product, and stay rotations", "[grasp]") {
  detail::LimitedMotion<double> motion;
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  Mat R = Mat::Identity();
  Vec t = Vec::Zero();
  const Vec middle(0.1, 0.2, 0.3), other(-0.2, 0, 0.1);
  for (int i = 0; i < 20000; ++i) {
    const Mat turn =
        rotation_exp<double>(0.02 * Vec(normal(random), normal(random), normal(random)));
    const Vec way = 0.01 * Vec(normal(random), normal(random), normal(random));
    REQUIRE(motion.move_by(turn, way));
    motion.advance(middle, 10, 10);
    t = turn * t + way;
    R = turn * R;
    if (i < 100) CHECK((motion.at(other) - (R * other + t)).norm() < 1e-12);
  }
  CHECK(is_rotation<double>(motion.R(), 1e-14));
}

TEST_CASE("a step counts from where the motion is, not from where it shall be", "[grasp]") {
  detail::LimitedMotion<double> motion;
  REQUIRE(motion.move_to(Mat::Identity(), Vec(1, 0, 0)));
  motion.advance(Vec::Zero(), 0.25, 1);
  REQUIRE(motion.move_by(Mat::Identity(), Vec(0, 0.1, 0)));
  for (int i = 0; i < 10; ++i) motion.advance(Vec::Zero(), 0.25, 1);
  CHECK((motion.at(Vec::Zero()) - Vec(0.25, 0.1, 0)).norm() < 1e-15);
}

TEST_CASE("what is no motion is refused and changes nothing", "[grasp]") {
  detail::LimitedMotion<double> motion;
  REQUIRE(motion.move_to(Mat::Identity(), Vec(1, 0, 0)));
  const double nan = std::nan("");
  Mat mirrored = Mat::Identity();
  mirrored(2, 2) = -1;
  for (const Mat& R : {Mat(2 * Mat::Identity()), mirrored, Mat(Mat::Constant(nan))}) {
    CHECK_FALSE(motion.move_to(R, Vec::Zero()));
    CHECK_FALSE(motion.move_by(R, Vec::Zero()));
  }
  CHECK_FALSE(motion.move_to(Mat::Identity(), Vec(0, nan, 0)));
  CHECK_FALSE(motion.move_by(Mat::Identity(), Vec(0, nan, 0)));
  motion.advance(Vec::Zero(), 10, 10);
  CHECK(motion.at(Vec::Zero()) == Vec(1, 0, 0));
}
