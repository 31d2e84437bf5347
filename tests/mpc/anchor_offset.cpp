// Hand anchors take up constant errors of the features, keep out of swings, and give the offsets
// back.

#include "clothctl/mpc/detail/anchor_offset.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

// Two hands over two features, half a metre above them. The features hang beside their targets by
// what the anchors have not taken up of `error`.
struct Hanging {
  std::vector<HandAnchor<double>> anchors;
  detail::AnchorOffset<double> offset;
  Points<double> wanted = Points<double>::Zero(3, 2), measured = wanted, error = wanted;
  Points<double> start{{0, 0.5}, {0, 0}, {0.5, 0.5}};

  Hanging() {
    wanted(0, 1) = 0.5;
    anchors = make_anchors<double>(wanted, start);
    offset.reserve(2, 2);
  }
  Vector3<double> learned(std::size_t g) const { return offset.learned(g); }
  void run(int frames) {
    for (int k = 0; k < frames; ++k) {
      for (Index i = 0; i < 2; ++i) {
        measured.col(i) = wanted.col(i) + error.col(i) + learned(static_cast<std::size_t>(i));
      }
      offset.learn(0.02, 5.0, wanted, measured, anchors);
    }
  }
};

}  // namespace

TEST_CASE("anchors take up a constant error of their own feature", "[mpc]") {
  Hanging sheet;
  sheet.error.col(0) << 0.004, -0.015, 0.002;
  sheet.run(250);
  CHECK((sheet.learned(0) + sheet.error.col(0)).norm() < 0.5 * sheet.error.col(0).norm());
  sheet.run(2000);
  CHECK((sheet.learned(0) + sheet.error.col(0)).norm() < 1e-6);
  CHECK(sheet.learned(1).norm() == 0);
  sheet.offset.reset();
  CHECK(sheet.learned(0).norm() < 1e-14);
  sheet.error.setZero();
  sheet.run(10);
  CHECK(sheet.learned(0).norm() < 1e-14);  // the slow error is forgotten, too
}

TEST_CASE("anchors learn a tenth of the hanging length at most", "[mpc]") {
  Hanging sheet;
  sheet.error.setConstant(0.3);
  sheet.run(5000);
  for (const std::size_t g : {0u, 1u})
    CHECK((sheet.learned(g).array() + 0.05).abs().maxCoeff() < 1e-12);
}

TEST_CASE("a swing moves the anchors by a hundredth of its size", "[mpc]") {
  Hanging sheet;
  double least = 1, most = -1;
  for (int k = 0; k < 3000; ++k) {
    sheet.measured = sheet.wanted;
    sheet.measured.row(1).array() += 0.05 * std::sin(4.4 * 0.02 * k);
    sheet.offset.learn(0.02, 5.0, sheet.wanted, sheet.measured, sheet.anchors);
    if (k < 1500) continue;
    least = std::min(least, sheet.learned(0)[1]);
    most = std::max(most, sheet.learned(0)[1]);
  }
  CHECK(most - least < 0.01 * 2 * 0.05);
}

TEST_CASE("learning never allocates, and a frame longer than the times is no overshoot", "[mpc]") {
  Hanging sheet;
  sheet.error.setConstant(0.01);
  if (clothctl_test::allocation_counting_works()) {
    const long before = clothctl_test::allocations();
    sheet.run(3);
    CHECK(clothctl_test::allocations() == before);
  }
  sheet.run(1);
  for (Index i = 0; i < 2; ++i) sheet.measured.col(i) = sheet.wanted.col(i) + sheet.error.col(i);
  Hanging slow;
  slow.offset.learn(10.0, 5.0, slow.wanted, sheet.measured, slow.anchors);
  CHECK((slow.learned(0).array() + 0.01).abs().maxCoeff() < 1e-14);
}
