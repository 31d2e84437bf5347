// The moving average of the hand anchor, for motions whose average is known.

#include "clothctl/mpc/hand_anchor.hpp"

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

#include <Eigen/Geometry>

using namespace clothctl;

namespace {

using V = Vector3<double>;

HandAnchor<double> anchor_of(std::vector<double> weights, const V& offset) {
  HandAnchor<double> anchor;
  anchor.feature_weights = std::move(weights);
  anchor.offset = offset;
  anchor.hanging_length = offset[2];
  return anchor;
}

// Two features on a line along x that move together.
template <class Motion>
auto line(const Motion& motion) {
  return [motion](Index i, double t) { return V(V(i == 0 ? -0.25 : 0.25, 0.0, 0.0) + motion(t)); };
}

}  // namespace

TEST_CASE("a constant target gives a constant hand", "[mpc]") {
  const HandAnchor<double> anchor = anchor_of({1.0, 0.0}, V(0.02, 0.1, 0.5));
  for (const HeavyChainAxes heavy_chain_axes :
       {HeavyChainAxes::Off, HeavyChainAxes::SheetNormal, HeavyChainAxes::Horizontal}) {
    const auto target = line([](double) { return V(0.3, -0.2, 1.0); });
    const V p = anchor_position(anchor, heavy_chain_axes, 9.81, target, 0.7);
    CHECK((p - V(0.07, -0.1, 1.5)).norm() < 1e-14);
  }
}

TEST_CASE("a steady motion of the target gives a steady motion of the hand", "[mpc]") {
  const HandAnchor<double> anchor = anchor_of({0.5, 0.5}, V(0.0, 0.0, 0.5));
  const V velocity(0.2, -0.4, 0.1);
  for (const HeavyChainAxes heavy_chain_axes :
       {HeavyChainAxes::Off, HeavyChainAxes::SheetNormal, HeavyChainAxes::Horizontal}) {
    const V p = anchor_position(anchor, heavy_chain_axes, 9.81,
                                line([&](double t) { return V(t * velocity); }), 1.3);
    CHECK((p - V(1.3 * velocity + anchor.offset)).norm() < 1e-13);
  }
}

TEST_CASE("under constant acceleration the hand leads as a hanging chain requires", "[mpc]") {
  // The mean of (t + τ sin a)² is t² + τ²/2. For ȳ = ½ b t², the hand is therefore b τ²/4 = b L/g
  // ahead, and tan(angle) = b/g.
  const HandAnchor<double> anchor = anchor_of({0.5, 0.5}, V(0.0, 0.0, 0.4));
  const double b = 1.7;
  const V p = anchor_position(anchor, HeavyChainAxes::SheetNormal, 9.81,
                              line([&](double t) { return V(0.0, 0.5 * b * t * t, 0.0); }), 0.9);
  CHECK(p[1] == Approx(0.5 * b * 0.81 + b * 0.4 / 9.81).epsilon(1e-13));
  CHECK(p[0] == Approx(0.0).margin(1e-14));
  CHECK(p[2] == Approx(0.4));
}

TEST_CASE("a sinusoid is attenuated by the Bessel function of its frequency", "[mpc]") {
  const HandAnchor<double> anchor = anchor_of({0.5, 0.5}, V(0.0, 0.0, 0.5));
  const double tau = 2.0 * std::sqrt(0.5 / 9.81);
  for (const double omega : {1.0, 4.0, 9.0, 20.0}) {
    for (const double t : {0.0, 0.4}) {
      const V p =
          anchor_position(anchor, HeavyChainAxes::SheetNormal, 9.81,
                          line([&](double s) { return V(0.0, std::cos(omega * s), 0.0); }), t);
      double j0 = 0.0, term = 1.0;  // power series of J0
      for (int m = 1; m < 60; ++m) {
        j0 += term;
        term *= -(omega * tau) * (omega * tau) / (4.0 * m * m);
      }
      CHECK(p[1] == Approx(j0 * std::cos(omega * t)).margin(1e-12));
    }
  }
}

TEST_CASE("only directions in which the sheet swings are averaged", "[mpc]") {
  const HandAnchor<double> anchor = anchor_of({0.5, 0.5}, V(0.0, 0.0, 0.5));
  const auto motion = [](double t) {
    return V(std::sin(5.0 * t), std::sin(5.0 * t), std::sin(5.0 * t));
  };
  const double t = 0.3, now = std::sin(5.0 * t);
  const V none = anchor_position(anchor, HeavyChainAxes::Off, 9.81, line(motion), t);
  const V sheet = anchor_position(anchor, HeavyChainAxes::SheetNormal, 9.81, line(motion), t);
  const V pendulum = anchor_position(anchor, HeavyChainAxes::Horizontal, 9.81, line(motion), t);
  CHECK((none - V(now, now, now + 0.5)).norm() < 1e-14);
  CHECK(sheet[0] == Approx(now).epsilon(1e-13));
  CHECK(std::abs(sheet[1] - now) > 0.1);
  CHECK(sheet[2] == Approx(now + 0.5));
  CHECK(pendulum[0] == Approx(pendulum[1]));
  CHECK(pendulum[1] == Approx(sheet[1]));
  CHECK(pendulum[2] == Approx(now + 0.5));

  // There is no average if nothing hangs below the hand, or if the features form no line.
  HandAnchor<double> flat = anchor;
  flat.hanging_length = 0.0;
  CHECK((anchor_position(flat, HeavyChainAxes::Horizontal, 9.81, line(motion), t) - none).norm() <
        1e-14);
  const auto together = [&](Index, double s) { return motion(s); };
  CHECK((anchor_position(anchor, HeavyChainAxes::SheetNormal, 9.81, together, t) - none).norm() <
        1e-14);

  // With a single feature there is no line: the sheet swings in both directions.
  const HandAnchor<double> single = anchor_of({1.0}, V(0.0, 0.0, 0.5));
  CHECK((anchor_position(single, HeavyChainAxes::SheetNormal, 9.81, together, t) -
         anchor_position(single, HeavyChainAxes::Horizontal, 9.81, together, t))
            .norm() < 1e-14);
}

TEST_CASE("the average rotates with the line between the features", "[mpc]") {
  // The same motion across the line, rotated about the vertical.
  const HandAnchor<double> anchor = anchor_of({0.5, 0.5}, V(0.0, 0.0, 0.5));
  const double angle = 0.6;
  const V along(std::cos(angle), std::sin(angle), 0.0),
      across(-std::sin(angle), std::cos(angle), 0.0);
  const auto turned = [&](Index i, double t) {
    return V((i == 0 ? -0.25 : 0.25) * along + std::sin(5.0 * t) * across);
  };
  const auto straight = line([](double t) { return V(0.0, std::sin(5.0 * t), 0.0); });
  const V p = anchor_position(anchor, HeavyChainAxes::SheetNormal, 9.81, turned, 0.2);
  const V q = anchor_position(anchor, HeavyChainAxes::SheetNormal, 9.81, straight, 0.2);
  CHECK(p.dot(across) == Approx(q[1]));
  CHECK(p.dot(along) == Approx(0.0).margin(1e-14));
}

TEST_CASE("a hand anchor does not allocate", "[mpc]") {
  const HandAnchor<double> anchor = anchor_of({0.5, 0.5}, V(0.0, 0.0, 0.5));
  const auto target = line([](double t) { return V(t, t * t, 0.0); });
  const long before = clothctl_test::allocations();
  const V p = anchor_position(anchor, HeavyChainAxes::Horizontal, 9.81, target, 0.2);
  const long made = clothctl_test::allocations() - before;
  CHECK(all_finite(p));
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
}

TEST_CASE("anchors made from a start leave the hands there", "[mpc]") {
  Points<double> features(3, 2), hands(3, 2);
  features << -0.2, 0.2, 0.0, 0.01, 0.1, 0.12;
  hands << -0.25, 0.24, 0.02, 0.0, 0.6, 0.05;
  const auto still = [](const Points<double>& y) {
    return [y](Index i, double) { return V(y.col(i)); };
  };
  for (const Index hand_count : {1, 2}) {
    const Points<double> held = hands.leftCols(hand_count);
    const std::vector<HandAnchor<double>> anchors = make_anchors(features, held);
    REQUIRE(anchors.size() == static_cast<std::size_t>(hand_count));
    for (Index g = 0; g < hand_count; ++g) {
      const HandAnchor<double>& anchor = anchors[static_cast<std::size_t>(g)];
      CHECK((anchor_position(anchor, HeavyChainAxes::SheetNormal, 9.81, still(features), 0.0) -
             held.col(g))
                .norm() < 1e-14);
      CHECK(anchor.hanging_length ==
            std::max(0.0, anchor.offset[2]));  // nothing hangs from a hand below its feature
    }
  }
  CHECK(make_anchors(features, hands)[1].feature_weights == std::vector<double>{0.0, 1.0});
  CHECK(make_anchors(Points<double>(3, 0), hands)[1].feature_weights.empty());
  CHECK(make_anchors(features, Points<double>(hands.leftCols(1)))[0].feature_weights ==
        std::vector<double>{0.5, 0.5});
}

TEST_CASE("anchors turn with the features as a rigid body", "[mpc]") {
  Points<double> features(3, 2), hands(3, 2);
  features << -0.24, 0.25, 0.01, -0.02, 0.1, 0.13;
  hands << -0.22, 0.23, 0.05, 0.04, 0.6, 0.62;
  const std::vector<HandAnchor<double>> anchors = make_anchors(features, hands);
  for (const V& angles : {V(0, 0, 0.9), V(0, 0.4, 0), V(0, -0.5, 2.7), V(0, 0.3, -1.2)}) {
    // A turn about the vertical of the start, and a tilt in the plane of the features and z.
    const V way = features.col(1) - features.col(0), up(0, 0, 1);
    const V level = V(way[0], way[1], 0).normalized();
    const Matrix3<double> turn =
        (Eigen::AngleAxisd(angles[2], up) * Eigen::AngleAxisd(angles[1], up.cross(level)))
            .toRotationMatrix();
    const V middle = features.rowwise().mean(), shift(0.3, -0.2, 0.1);
    const auto turned = [&](Index i, double) {
      return V(middle + shift + turn * (features.col(i) - middle));
    };
    for (Index g = 0; g < 2; ++g) {
      const V p = anchor_position(anchors[static_cast<std::size_t>(g)], HeavyChainAxes::Off, 9.81,
                                  turned, 0.0);
      CHECK((p - middle - shift - turn * (hands.col(g) - middle)).norm() < 1e-14);
    }
  }
}

TEST_CASE("a sheet whose hand is raised hangs where its anchors say", "[mpc]") {
  const clothctl_test::HangingSheet sheet = clothctl_test::hanging_sheet(9);
  const Points<double>& x = sheet.state.positions;
  const int corners[4] = {sheet.lower_left(), sheet.lower_right(), sheet.upper_left(),
                          sheet.upper_right()};
  Points<double> features(3, 2), hands(3, 2);
  for (Index i = 0; i < 2; ++i) {
    features.col(i) = x.col(corners[i]);
    hands.col(i) = x.col(corners[2 + i]);
  }
  std::vector<HandAnchor<double>> anchors = make_anchors(features, hands);
  for (HandAnchor<double>& anchor : anchors) anchor.hand_gap = 0.0;
  MassSpring<double> model = sheet.model(Integration::Newton);
  auto workspace = model.make_workspace();
  ClothState<double> state = sheet.state;
  const double width = (hands.col(1) - hands.col(0)).norm(), angle = 0.3;
  const V middle = hands.rowwise().mean();
  ClothInput<double> input;
  input.driven_vertices = {corners[2], corners[3]};
  input.driven_positions.setZero(3, 2);
  for (int frame = 1; frame <= 400; ++frame) {
    const double now = angle * std::min(1.0, 0.01 * frame);
    const V half = 0.5 * width * V(std::cos(now), 0, std::sin(now));
    input.driven_positions.col(0) = middle - half;
    input.driven_positions.col(1) = middle + half;
    REQUIRE(model.step(state, input, 0.02, workspace).advanced);
  }
  const auto still = [&](Index i, double) { return V(state.positions.col(corners[i])); };
  // Folds decide how wide the features are; the middle of the hands does not depend on them.
  const auto middle_of_anchors = [&] {
    V sum = V::Zero();
    for (const HandAnchor<double>& anchor : anchors)
      sum += anchor_position(anchor, HeavyChainAxes::SheetNormal, 9.81, still, 0.0);
    return V(sum / 2);
  };
  CHECK((middle_of_anchors() - middle).norm() < 0.03);
  for (HandAnchor<double>& anchor : anchors) anchor.across.setZero();  // offsets that do not turn
  CHECK((middle_of_anchors() - middle).norm() > 0.12);
}

TEST_CASE("hands come together more than the features, and no wider than the sheet", "[mpc]") {
  Points<double> features(3, 2), hands(3, 2);
  features << -0.24, 0.24, 0, 0, 0, 0;
  hands << -0.2, 0.2, 0, 0, 0.5, 0.5;
  std::vector<HandAnchor<double>> anchors = make_anchors(features, hands);
  const auto gap_of_hands = [&](double gap) {
    const auto target = [&](Index i, double) { return V(i == 0 ? -gap / 2 : gap / 2, 0, 0); };
    const V left = anchor_position(anchors[0], HeavyChainAxes::Off, 9.81, target, 0.0);
    const V right = anchor_position(anchors[1], HeavyChainAxes::Off, 9.81, target, 0.0);
    CHECK((left + right - V(0, 0, 1)).norm() < 1e-14);
    return right[0] - left[0];
  };
  CHECK(gap_of_hands(0.48) == Approx(0.4));
  CHECK(gap_of_hands(0.44) == Approx(0.4 * std::exp(-0.2)));
  CHECK(gap_of_hands(0.5) == Approx(0.4 * std::exp(0.1)));
  CHECK(gap_of_hands(0.6) == Approx(0.48));
  CHECK(gap_of_hands(1e4) == Approx(0.48));
  CHECK(gap_of_hands(1e-6) == Approx(0.4 * std::exp(-2.4)).epsilon(1e-3));
  for (HandAnchor<double>& anchor : anchors) anchor.gather = 0.0;
  CHECK(gap_of_hands(0.3) == Approx(0.4));
  for (HandAnchor<double>& anchor : anchors) anchor.hand_gap = 0.0;  // follow their own feature
  CHECK(gap_of_hands(0.3) == Approx(0.22));
}

TEST_CASE("anchors move continuously where the features stand on top of each other", "[mpc]") {
  Points<double> features(3, 2), hands(3, 2);
  features << -0.25, 0.25, 0, 0, 0, 0;
  hands << -0.25, 0.25, 0.02, 0.02, 0.5, 0.5;
  const HandAnchor<double> anchor = make_anchors(features, hands)[0];
  V last = hands.col(0);
  const int steps = 4000;
  for (int k = 0; k <= steps; ++k) {
    const double angle = 3.14 * k / steps;
    const auto target = [&](Index i, double) {
      return V((i == 0 ? -0.25 : 0.25) * V(std::cos(angle), 1e-3, std::sin(angle)));
    };
    const V p = anchor_position(anchor, HeavyChainAxes::Off, 9.81, target, 0.0);
    CHECK((p - last).norm() < 0.01);
    last = p;
  }
  // Vertical, or in one point: the hand keeps its offset.
  for (const V& way : {V(0, 0, 0.25), V(0, 0, 0)}) {
    const auto target = [&](Index i, double) { return V(i == 0 ? -way : way); };
    const V p = anchor_position(anchor, HeavyChainAxes::Off, 9.81, target, 0.0);
    CHECK((p + way - anchor.offset).norm() < 1e-14);
  }
}

TEST_CASE("a jump of the hand moves its anchor by as much, however the features lie", "[mpc]") {
  Points<double> features(3, 2), hands(3, 2);
  features << -0.24, 0.25, 0.01, -0.02, 0.1, 0.13;
  hands << -0.22, 0.23, 0.05, 0.04, 0.6, 0.62;
  HandAnchor<double> anchor = make_anchors(features, hands)[1];
  anchor.hand_gap = 0.0;
  const V way(0.3, 0.35, 0.12), jump(0.01, -0.02, 0.03);
  const auto target = [&](Index i, double) { return V(i == 0 ? V(0, 0, 0) : way); };
  const V before = anchor_position(anchor, HeavyChainAxes::Off, 9.81, target, 0.0);
  detail::move_hand(anchor, way, jump);
  const V after = anchor_position(anchor, HeavyChainAxes::Off, 9.81, target, 0.0);
  CHECK((after - before - jump).norm() < 1e-14);
  CHECK(anchor.along != make_anchors(features, hands)[1].along);
}

TEST_CASE("in moving air the sheet hangs along gravity and air together", "[mpc]") {
  const HandAnchor<double> anchor = anchor_of({0.5, 0.5}, V(0.0, 0.0, 0.4));
  const V across(0.3, 0.4, 0.1), normal(-0.8, 0.6, 0.0), up(0, 0, 1);
  for (const V& air : {V(3, -2, 1), V(-40, 5, -8), V(0, 0, 4), V(1e-3, 0, 0)}) {
    const V lead = air_lead(anchor, HeavyChainAxes::Horizontal, 9.81, across, air);
    const V hang = lead + 0.4 * up;  // from the features to the hand
    CHECK(hang.norm() == Approx(0.4));
    CHECK(hang.cross(9.81 * up - air).norm() < 1e-12 * air.norm());
    CHECK(hang.dot(9.81 * up - air) > 0);
    const V sheet = air_lead(anchor, HeavyChainAxes::SheetNormal, 9.81, across, air);
    const V swing = normal * normal.dot(air) + up * air[2];
    CHECK((sheet - air_lead(anchor, HeavyChainAxes::Horizontal, 9.81, across, swing)).norm() <
          1e-14);
    CHECK(air_lead(anchor, HeavyChainAxes::Off, 9.81, across, air).norm() == 0);
  }
  CHECK(air_lead(anchor, HeavyChainAxes::Horizontal, 9.81, across, V(0, 0, 0)).norm() < 1e-15);
  // Where air and gravity cancel, and where nothing hangs, there is no lead.
  CHECK(air_lead(anchor, HeavyChainAxes::Horizontal, 9.81, across, V(0, 0, 9.81)).norm() == 0);
  CHECK(
      air_lead(anchor_of({1.0}, V(0.1, 0, 0)), HeavyChainAxes::Horizontal, 9.81, across, V(3, 0, 0))
          .norm() == 0);
  // Features in one place make no line.
  const V still = air_lead(anchor, HeavyChainAxes::SheetNormal, 9.81, V(0, 0, 0), V(5, 5, 0));
  CHECK(still.norm() < 1e-15);
}
