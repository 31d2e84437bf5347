#include "clothctl/robot/detail/hand34_parts.hpp"

#include <cmath>
#include <numbers>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("a capsule's inertia matches a sum over slices", "[robot][hand34]") {
  const detail::Bone bone{0.044, 0.009};
  const Inertia<double> inertia = detail::capsule_body<double>(bone);
  double mass = 0, moment_x = 0, along = 0, across = 0;
  constexpr int kSlices = 20000;
  const double L = bone.length, r = bone.radius, step = (L + 2 * r) / kSlices;
  for (int k = 0; k < kSlices; ++k) {
    const double x = -r + (k + 0.5) * step;
    const double out = x < 0 ? x : x > L ? x - L : 0.0;  // beyond the cylinder
    const double square = r * r - out * out;
    const double slice = detail::kDensity * std::numbers::pi * square * step;
    mass += slice;
    moment_x += slice * x;
    along += slice * square / 2;
    across += slice * (square / 4 + (x - L / 2) * (x - L / 2));
  }
  CHECK(inertia.mass == Approx(mass).epsilon(1e-6));
  CHECK(inertia.com[0] == Approx(moment_x / mass).epsilon(1e-6));
  CHECK(inertia.about_com(0, 0) == Approx(along).epsilon(1e-6));
  CHECK(inertia.about_com(1, 1) == Approx(across).epsilon(1e-6));
  CHECK(inertia.about_com(2, 2) == Approx(across).epsilon(1e-6));
}

TEST_CASE("a box's inertia matches the textbook formula", "[robot][hand34]") {
  const Inertia<double> box =
      detail::box_body<double>(12.0, Vector3<double>(1, 2, 3), Vector3<double>(0.1, 0, 0));
  CHECK(box.mass == 12.0);
  CHECK(box.about_com.diagonal() == Vector3<double>(13, 10, 5));
  CHECK(box.com == Vector3<double>(0.1, 0, 0));
}

TEST_CASE("the arguments of a pose are yaw, pitch and roll, applied in this order",
          "[robot][hand34]") {
  const Pose<double> pose = detail::at<double>(1, 2, 3, 0.1, 0.2, 0.3);
  CHECK(pose.p == Vector3<double>(1, 2, 3));
  CHECK(pose.R == rotation_from_roll_pitch_yaw<double>(0.3, 0.2, 0.1));
}

TEST_CASE("the contact point of a pad is on the palm's side", "[robot][hand34]") {
  CHECK(detail::point_of<double>(detail::Pad{0.02, 0.007}) == Vector3<double>(0.02, 0, -0.007));
  for (const detail::FingerPart& finger : detail::kFingers)
    CHECK(finger.pad.depth < finger.bones[3].radius);
}
