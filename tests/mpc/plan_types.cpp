// Validation of a planner's setup, and the result of a frame that was not planned yet.

#include "clothctl/mpc/plan_types.hpp"

#include <limits>
#include <string>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

constexpr Index kVertices = 9;

/// A 3×3 sheet. Its lower corners follow targets, its upper ones are held.
template <class S>
PlannerSetup<S> setup() {
  PlannerSetup<S> out;
  out.features.add_point(0);
  out.features.add_point(2);
  out.grips = {make_pinch<S>({6}, S(0.5), S(20)), make_pinch<S>({8}, S(0.5), S(20))};
  out.triangles = {{0, 1, 4}, {0, 4, 3}, {4, 5, 8}};
  return out;
}

template <class S>
PlannerSetup<S> anchored() {
  PlannerSetup<S> out = setup<S>();
  out.anchors.resize(2);
  for (HandAnchor<S>& anchor : out.anchors) anchor.feature_weights = {S(0.5), S(0.5)};
  return out;
}

}  // namespace

TEMPLATE_TEST_CASE("a setup that fits its sheet is valid with or without triangles and anchors",
                   "[mpc][plan_types]", float, double) {
  using S = TestType;
  CHECK(setup<S>().validate(kVertices) == "");
  CHECK(setup<S>().validate(kVertices + 1) == "");
  CHECK(anchored<S>().validate(kVertices) == "");
  PlannerSetup<S> rope = setup<S>();
  rope.triangles.clear();
  CHECK(rope.validate(kVertices) == "");
}

TEMPLATE_TEST_CASE("features and grips that do not fit the sheet are refused with a message",
                   "[mpc][plan_types]", float, double) {
  using S = TestType;
  PlannerSetup<S> s = setup<S>();
  s.features.add_point(9);
  CHECK(s.validate(kVertices) == "feature 2 uses vertex 9, off a mesh of 9 vertices");
  CHECK(s.validate(kVertices + 1) == "");
  s = setup<S>();
  s.features = {};
  CHECK(s.validate(kVertices) == "there are no features");
  s = setup<S>();
  s.grips.clear();
  CHECK(s.validate(kVertices) == "there are no grips");
  s = setup<S>();
  s.grips[1] = s.grips[0];
  CHECK(s.validate(kVertices) == "grip 1 finger 0 holds vertex 6, which grip 0 holds already");
  CHECK(setup<S>().validate(8) == "grip 1 finger 0 holds vertex 8, off a mesh of 8 vertices");
  CHECK(setup<S>().validate(0) == "feature 0 uses vertex 0, off a mesh of 0 vertices");
}

TEMPLATE_TEST_CASE("the first triangle off the mesh is named with its vertex", "[mpc][plan_types]",
                   float, double) {
  using S = TestType;
  for (const int off : {9, -1, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()}) {
    for (std::size_t corner = 0; corner < 3; ++corner) {
      PlannerSetup<S> s = setup<S>();
      s.triangles[1][corner] = off;
      s.triangles.push_back({77, 78, 79});
      CHECK(s.validate(kVertices) ==
            "triangle 1 holds vertex " + std::to_string(off) + " off the mesh");
    }
  }
  PlannerSetup<S> s = setup<S>();
  s.triangles[2] = {4, 78, -2};  // names the first of several wrong vertices
  CHECK(s.validate(kVertices) == "triangle 2 holds vertex 78 off the mesh");
  s.triangles[0] = {77, 78, 79};
  CHECK(s.validate(kVertices) == "triangle 0 holds vertex 77 off the mesh");
}

TEMPLATE_TEST_CASE("the number of anchors is zero or that of the grips", "[mpc][plan_types]", float,
                   double) {
  using S = TestType;
  PlannerSetup<S> s = anchored<S>();
  s.anchors.pop_back();
  CHECK(s.validate(kVertices) == "there are 1 anchors for 2 grips");
  s = anchored<S>();
  s.anchors.push_back(s.anchors[0]);
  CHECK(s.validate(kVertices) == "there are 3 anchors for 2 grips");
  s.grips.pop_back();
  CHECK(s.validate(kVertices) == "there are 3 anchors for 1 grips");
}

TEMPLATE_TEST_CASE("the first wrong anchor is named with its error", "[mpc][plan_types]", float,
                   double) {
  using S = TestType;
  for (std::size_t i = 0; i < 2; ++i) {
    const auto refusal = [i](const auto& spoil) {
      PlannerSetup<S> s = anchored<S>();
      s.anchors[1].hanging_length = S(-7);
      spoil(s.anchors[i]);
      return s.validate(kVertices);
    };
    const std::string anchor = "anchor " + std::to_string(i);
    CHECK(refusal([](HandAnchor<S>& a) { a.feature_weights.clear(); }) ==
          anchor + " has 0 weights for 2 features");
    CHECK(refusal([](HandAnchor<S>& a) { a.feature_weights.push_back(S(0)); }) ==
          anchor + " has 3 weights for 2 features");
    for (const S bad : {std::numeric_limits<S>::quiet_NaN(), std::numeric_limits<S>::infinity()}) {
      CHECK(refusal([&](HandAnchor<S>& a) { a.feature_weights[1] = bad; }) ==
            anchor + " has the weight " + number_text(bad));
      CHECK(refusal([&](HandAnchor<S>& a) { a.offset[2] = bad; }) ==
            anchor + " has an offset that is not finite");
      CHECK(refusal([&](HandAnchor<S>& a) { a.across[0] = bad; }) ==
            anchor + " has a way across that is not finite");
      CHECK(refusal([&](HandAnchor<S>& a) { a.along = bad; }) ==
            anchor + " has the place " + number_text(bad) + " along the features");
      CHECK(refusal([&](HandAnchor<S>& a) { a.gather = bad; }) ==
            anchor + " has the factor of gathering " + number_text(bad) +
                ", must be finite and not negative");
      CHECK(refusal([&](HandAnchor<S>& a) { a.hanging_length = bad; }) ==
            anchor + " has the hanging length " + number_text(bad) +
                ", must be finite and not negative");
    }
    CHECK(refusal([](HandAnchor<S>& a) { a.hanging_length = S(-0.5); }) ==
          anchor + " has the hanging length -0.5, must be finite and not negative");
    CHECK(refusal([](HandAnchor<S>& a) { a.hand_gap = S(-0.5); }) ==
          anchor + " has the distance of the hands -0.5, must be finite and not negative");
    CHECK(refusal([](HandAnchor<S>& a) { a.gather = S(-2); }) ==
          anchor + " has the factor of gathering -2, must be finite and not negative");
  }
  PlannerSetup<S> low = anchored<S>();
  low.anchors[0].hanging_length = S(0);
  low.anchors[1].offset << S(0.1), S(-2), S(-3);
  CHECK(low.validate(kVertices) == "");
  // There is a weight for each feature, not for each grip.
  low.features.add_centroid({3, 4, 5});
  CHECK(low.validate(kVertices) == "anchor 0 has 2 weights for 3 features");
}

TEST_CASE("of several errors the first is named, in the order features, grips, triangles, anchors",
          "[mpc][plan_types]") {
  PlannerSetup<double> s = anchored<double>();
  s.anchors[1].feature_weights.clear();
  CHECK(s.validate(kVertices) == "anchor 1 has 0 weights for 2 features");
  s.anchors.pop_back();
  CHECK(s.validate(kVertices) == "there are 1 anchors for 2 grips");
  s.triangles[2][0] = 9;
  CHECK(s.validate(kVertices) == "triangle 2 holds vertex 9 off the mesh");
  s.grips[0].fingers.clear();
  CHECK(s.validate(kVertices) == "grip 0 has no fingers");
  s.features.add_point(-1);
  CHECK(s.validate(kVertices) == "feature 2 uses vertex -1, off a mesh of 9 vertices");
}

TEMPLATE_TEST_CASE("the result of a frame that was not planned says so and reports no error",
                   "[mpc][plan_types]", float, double) {
  using S = TestType;
  const PlanResult<S> result;
  CHECK(result.status == PlanStatus::Failed);
  CHECK_FALSE(can_apply(result.status));
  CHECK(result.finger_forces.empty());
  CHECK(result.plan.size() == 0);
  CHECK(result.predicted.size() == 0);
  CHECK(result.prediction_error == S(0));
  CHECK(result.agreement == S(1));
  CHECK(result.patch_residual == S(0));
  CHECK(result.qp_iterations == 0);
  CHECK(result.qp_status == QpStatus::Solved);
  CHECK_FALSE(result.used_rows);
}
