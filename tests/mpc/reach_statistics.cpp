// The parts of which reachability collects its figures.

#include "clothctl/mpc/detail/reach_statistics.hpp"

#include <cmath>

#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("a root of a mean square", "[mpc]") {
  detail::MeanSquare<double> mean;
  CHECK(mean.root() == 0);
  mean.add(3);
  CHECK(mean.root() == Approx(3));
  mean.add(-4);
  CHECK(mean.root() == Approx(std::sqrt(12.5)));
}

TEST_CASE("three frames give speed and acceleration of a parabola", "[mpc]") {
  detail::ThreeFrames<double> frames;
  frames.reserve(2);
  const auto place = [](double t) { return Vector3<double>(1 + 2 * t, 3 * t * t, -t * t); };
  for (const double t : {0.7, 0.8, 0.9, 1.0}) {
    frames.shift();
    frames.after.col(0) = place(t);
    frames.after.col(1) = place(t + 1);
  }
  CHECK((frames.velocity(0, 0.1) - Vector3<double>(2, 5.4, -1.8)).norm() < 1e-12);
  CHECK((frames.acceleration(1, 0.1) - Vector3<double>(0, 6, -2)).norm() < 1e-11);
}

TEST_CASE("frames of a curve are counted with both ends", "[mpc]") {
  Index frames = 0;
  CHECK(detail::count_reach_frames(0.0, 0.3, 0.1, frames)
            .empty());  // 0.3 is 3.0000000000000004 · 0.1
  CHECK(frames == 4);
  CHECK(detail::count_reach_frames(1.0, 1.05, 0.1, frames).empty());
  CHECK(frames == 1);
  CHECK(!detail::count_reach_frames(1.0, 1.0, 0.1, frames).empty());
  CHECK(!detail::count_reach_frames(0.0, 1e9, 0.1, frames).empty());
}
