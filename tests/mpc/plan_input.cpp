// What a frame of planning takes and refuses, and that both of its checks agree.

#include "clothctl/mpc/detail/plan_input.hpp"

#include <limits>

#include "mpc/small_window.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::kWindow;
using clothctl_test::SmallWindow;
using V = Vector3<double>;

namespace {

constexpr double kStart = 1.5;

// The arguments of a frame, each of which a test may spoil.
struct Input {
  SmallWindow window{GripInput::Force};
  detail::WindowCost<double> cost;
  Points<double> x, v;
  double t = kStart;
  double bad_target_time = 1e9, bad_wind_time = 1e9;
  V bad = V(0.0, std::numeric_limits<double>::infinity(), 0.0);

  Input() {
    cost.reserve(window.problem, std::vector<HandAnchor<double>>(2, {{0.5, 0.5}, V::Zero(), 0.0}));
    x = window.sheet.state.positions;
    v = Points<double>::Random(3, x.cols());
  }
  auto target() const {
    return [this](Index i, double time) {
      return time > bad_target_time ? bad : V(time, static_cast<double>(i), 0.0);
    };
  }
  auto wind() const {
    return [this](double time) { return time > bad_wind_time ? bad : V(time, 0.0, 0.0); };
  }
  bool take() {
    return detail::take_plan_input<double>(window.problem, cost, 25, x, v, t, target(), wind());
  }
  std::string check() const {
    return detail::check_plan_input<double>(window.problem, cost, 25, x, v, t, target(), wind());
  }
};

}  // namespace

TEST_CASE("a frame keeps the wind of its starts and what the held vertices do", "[mpc]") {
  Input input;
  const long before = clothctl_test::allocations();
  const bool taken = input.take();
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  REQUIRE(taken);
  CHECK(input.check() == "");
  const auto& problem = input.window.problem;
  for (Index k = 0; k < kWindow; ++k) {
    CHECK(problem.request.wind(0, k) == kStart + static_cast<double>(k) * 0.02);
    CHECK(detail::frame_time(problem, kStart, k) == problem.request.wind(0, k));
  }
  for (std::size_t j = 0; j < problem.request.held.size(); ++j) {
    const int vertex = problem.request.held[j];
    CHECK(problem.motion.position.col(static_cast<Index>(j)) == input.x.col(vertex));
    CHECK(problem.motion.velocity.col(static_cast<Index>(j)) == input.v.col(vertex));
  }
}

TEST_CASE("what is refused is named, and what is named is refused", "[mpc]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double end = kStart + static_cast<double>(kWindow) * 0.02;
  const auto refused = [&](auto spoil, const std::string& words) {
    Input input;
    spoil(input);
    CHECK_FALSE(input.take());
    CHECK_THAT(input.check(), Catch::StartsWith(words));
  };
  refused([&](Input& i) { i.t = nan; }, "the time is nan");
  refused([&](Input& i) { i.x.conservativeResize(3, 24); },
          "there are 24 columns of position for 25 vertices");
  refused([&](Input& i) { i.v.conservativeResize(3, 26); },
          "there are 26 columns of velocity for 25 vertices");
  refused([&](Input& i) { i.x(2, 24) = nan; }, "the position of vertex 24 is (");
  refused([&](Input& i) { i.v(0, 0) = nan; }, "the velocity of vertex 0 is (nan, ");
  // Only the last frame, which starts 0.02 s before the window's end.
  refused([&](Input& i) { i.bad_wind_time = end - 0.021; }, "the wind at 1.56 s is (0, inf, 0)");
  refused([&](Input& i) { i.bad_target_time = end - 0.001; },
          "the target of feature 0 at 1.58 s is (0, inf, 0), must be finite and within 1e+06 m");
  refused(
      [&](Input& i) {
        i.bad_target_time = end - 0.001;
        i.bad = V(-1.1e6, 0.0, 0.0);
      },
      "the target of feature 0 at 1.58 s is (-1100000, 0, 0)");
}

TEST_CASE("wind and targets after the window are not looked at", "[mpc]") {
  const double end = kStart + static_cast<double>(kWindow) * 0.02;
  Input input;
  input.bad_target_time = end + 1e-6;
  input.bad_wind_time = end - 0.019;  // the window's last frame starts before
  CHECK(input.take());
  CHECK(input.check() == "");
}
