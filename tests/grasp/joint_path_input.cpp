// What is refused before a search, and the box of random postures.

#include "clothctl/grasp/detail/joint_path_input.hpp"

#include <limits>
#include <string>

#include "support/catch.hpp"

using clothctl::VectorX;

namespace {

template <class Scalar>
VectorX<Scalar> vector(double a, double b) {
  VectorX<Scalar> v(2);
  v << static_cast<Scalar>(a), static_cast<Scalar>(b);
  return v;
}

}  // namespace

TEMPLATE_TEST_CASE("messages name the first bad joint and its value", "[joint_path_input]", float,
                   double) {
  using Scalar = TestType;
  using V = VectorX<Scalar>;
  const Scalar nan = std::numeric_limits<Scalar>::quiet_NaN();
  const Scalar infinite = std::numeric_limits<Scalar>::infinity();
  struct Input {
    V from, to, lower, upper, reach;
  };
  const Input good{vector<Scalar>(0, 1), vector<Scalar>(1, 0), vector<Scalar>(-2, -2),
                   vector<Scalar>(2, 2), vector<Scalar>(1, 0.5)};
  const auto message = [&good](auto change) {
    Input in = good;
    change(in);
    return clothctl::detail::bad_joint_input(in.from, in.to, in.lower, in.upper, in.reach);
  };
  CHECK(message([](Input&) {}).empty());
  CHECK(message([&](Input& in) {
          in.lower.setConstant(-infinite);
          in.upper.setConstant(infinite);
          in.reach[0] = Scalar(0);
        }).empty());
  CHECK(message([](Input& in) { in.to.resize(3); }) == "to: expected 2 values as in from, found 3");
  CHECK(message([](Input& in) { in.lower.resize(0); }) ==
        "lower: expected 2 values as in from, found 0");
  CHECK(message([](Input& in) { in.upper.resize(1); }) ==
        "upper: expected 2 values as in from, found 1");
  CHECK(message([](Input& in) { in.reach.resize(1); }) ==
        "reach: expected 2 values as in from, found 1");
  CHECK(message([&](Input& in) { in.from[1] = nan; }) == "joint 1: the start is nan");
  CHECK(message([&](Input& in) { in.to[0] = infinite; }) == "joint 0: the goal is inf");
  CHECK(message([&](Input& in) { in.lower[0] = nan; }) == "joint 0: the lower limit is nan");
  CHECK(message([&](Input& in) { in.upper[1] = nan; }) == "joint 1: the upper limit is nan");
  CHECK(message([](Input& in) { in.lower[1] = Scalar(3); }) ==
        "joint 1: the lower limit 3 is above the upper limit 2");
  for (const Scalar bad : {Scalar(-1), nan, infinite}) {
    CHECK(message([&](Input& in) { in.reach[1] = bad; }) ==
          "joint 1: the reach is " + clothctl::number_text(bad) +
              " m, expected a finite number that is not negative");
  }
  CHECK(message([](Input& in) {
          in.from[0] = std::numeric_limits<Scalar>::max();
          in.to[0] = -in.from[0];
        }) == "the way from start to goal overflows");
}

TEST_CASE("a posture beyond a limit is named with joint, value and limit", "[joint_path_input]") {
  using clothctl::detail::beyond_limit;
  const VectorX<double> lower = vector<double>(-1, -2), upper = vector<double>(1, 2);
  CHECK(beyond_limit("goal", lower, lower, upper).empty());
  CHECK(beyond_limit("goal", upper, lower, upper).empty());
  CHECK(beyond_limit("goal", vector<double>(0, 2.5), lower, upper) ==
        "joint 1: the goal 2.5 is above the upper limit 2");
  CHECK(beyond_limit("start", vector<double>(-1.5, 2.5), lower, upper) ==
        "joint 0: the start -1.5 is below the lower limit -1");
}

TEST_CASE("random postures lie within limits, or around start and goal", "[joint_path_input]") {
  const double infinite = std::numeric_limits<double>::infinity();
  const VectorX<double> from = vector<double>(1, 3), to = vector<double>(0, 5);
  const VectorX<double> reach = vector<double>(2, 0.5);  // a way of 3 m
  const auto limited = clothctl::detail::sampling_box<double>(from, to, vector<double>(-9, -8),
                                                              vector<double>(9, 8), reach);
  CHECK(limited.lower == vector<double>(-9, -8));
  CHECK(limited.upper == vector<double>(9, 8));
  const auto open = clothctl::detail::sampling_box<double>(from, to, vector<double>(-infinite, 2),
                                                           vector<double>(1e30, infinite), reach);
  CHECK(open.lower == vector<double>(-1.5, 2));
  CHECK(open.upper == vector<double>(2.5, 11));
  const auto unmoving = clothctl::detail::sampling_box<double>(
      from, to, vector<double>(-infinite, 2), vector<double>(infinite, 7), vector<double>(0, 1));
  CHECK(unmoving.lower == vector<double>(0, 2));
  CHECK(unmoving.upper == vector<double>(1, 7));
}

TEST_CASE("a broken clearance is named with its posture", "[joint_path_input]") {
  CHECK(clothctl::detail::broken_clearance(vector<double>(0.5, -1)) ==
        "the clearance is nan at (0.5, -1)");
  CHECK(clothctl::detail::broken_clearance(VectorX<float>()) == "the clearance is nan at ()");
}
