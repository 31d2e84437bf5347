// Limits of grips and features: their cost, and planners that keep to them.

#include "clothctl/mpc/detail/window_limits.hpp"

#include <cmath>
#include <limits>

#include "clothctl/mpc/run_frame.hpp"
#include "mpc/planner_loops.hpp"
#include "mpc/small_window.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::FrozenPlanner;
using clothctl_test::HangingSheet;
using clothctl_test::kFrame;
using clothctl_test::kWindow;
using clothctl_test::SmallWindow;

namespace {

using Limit = GripLimit<double>;
using Vec = Vector3<double>;

const HangingSheet& sheet() {
  static const HangingSheet made = clothctl_test::hanging_sheet(9);
  return made;
}

/// Both lower corners go along x by 0.3 m in a second, wait for a second and come back.
struct OutAndBack {
  Points<double> start = sheet().state.positions(Eigen::all, clothctl_test::corners(sheet()));
  Vec operator()(Index i, double t) const {
    const auto ramp = [](double s) { return s <= 0 ? 0.0 : s >= 1 ? 1.0 : s * s * (3 - 2 * s); };
    return Vec(start.col(i)) + Vec(0.3 * (ramp(t) - ramp(t - 2)), 0, 0);
  }
};

/// The largest x of the grips' centroids, m, and the errors of the features at the end.
struct Run {
  double farthest = 0, excess = 0, last_error = 0;
};

Run run(GripInput input, const std::vector<Limit>& limits) {
  FrozenPlanner planner =
      clothctl_test::frozen_planner(sheet(), clothctl_test::corner_setup(sheet()),
                                    clothctl_test::corner_settings(sheet(), input, 12));
  auto plant = clothctl_test::sheet_plant(sheet(), Integration::LinearlyImplicit);
  REQUIRE(planner.set_limits(limits).empty());
  auto result = planner.make_result();
  Run out;
  out.farthest = -1;
  const int left = sheet().upper_left(), right = sheet().upper_right();
  for (int k = 0; k < 250; ++k) {
    const auto report = run_frame(planner, plant, kFrame * k, OutAndBack(), result);
    REQUIRE(report.advanced());
    const auto& x = plant.positions();
    out.farthest = std::max({out.farthest, x(0, left) - sheet().state.positions(0, left),
                             x(0, right) - sheet().state.positions(0, right)});
    out.excess = std::max(out.excess, result.limit_excess);
    out.last_error = report.mean_error;
  }
  return out;
}

}  // namespace

TEST_CASE("the cost of a limit is the square of what is beyond it", "[mpc]") {
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    PlannerSettings<double> settings = clothctl_test::small_settings(input);
    settings.max_acceleration = 1000;  // of random responses of about 1 m in frames of 0.02 s
    const SmallWindow window(settings);
    const auto& problem = window.problem;
    const Index size = problem.request.inputs() * kWindow;
    const std::vector<Limit> limits{{0, -1, Vec(0.6, 0, 0.8), 0.1}, {1, 0, Vec(0, 1, 0), -0.2}};
    const std::vector<FeatureLimit<double>> features{{1, Vec(0, 0, -1), 0.05}};
    detail::WindowLimits<double> cost;
    cost.reserve(problem);
    REQUIRE(cost.set(problem, limits, features).empty());
    const MatrixX<double> still = MatrixX<double>::Zero(problem.request.output_rows(), kWindow);
    MatrixX<double> H = MatrixX<double>::Zero(size, size);
    VectorX<double> g = VectorX<double>::Zero(size);
    cost.add(problem, H, g);
    CHECK(H.isZero(0));  // no frame counts before the first solution
    CHECK(cost.update(problem, still));
    CHECK_FALSE(cost.update(problem, still));

    // The same by hand, at some change of the inputs.
    std::srand(3);
    const VectorX<double> delta = VectorX<double>::Random(size);
    const auto output = [&](Index o, Index k, bool moved) {
      const Index m = problem.request.inputs();
      Vec y = problem.response.free_response.block<3, 1>(3 * o, k);
      for (Index l = 0; moved && l <= k; ++l)
        y += problem.response.impulse_response.block(3 * o, (k - l) * m, 3, m) *
             delta.segment(l * m, m);
      return y;
    };
    const auto centroid = [&](int grip, Index k, bool moved) {
      const auto& held = problem.basis.held();
      Vec sum = Vec::Zero();
      const std::size_t first = held.grip_begin(static_cast<std::size_t>(grip)),
                        end = held.grip_begin(static_cast<std::size_t>(grip) + 1);
      for (std::size_t j = first; j < end; ++j) {
        const Index slot = static_cast<Index>(j);
        if (k >= 0) {
          sum += output(problem.feature_count + slot, k, moved);
        } else {
          sum += problem.motion.position.col(slot) +
                 static_cast<double>(k + 1) * settings.dt * problem.motion.velocity.col(slot);
        }
      }
      return Vec(sum / static_cast<double>(end - first));
    };
    double expected = 0, largest = 0;
    int counted = 0, rates = 0;
    const auto count = [&](const auto& beyond, bool is_place) {
      if (!(beyond(false) > 0)) return;
      ++counted;
      if (is_place) largest = std::max(largest, beyond(false));
      expected += 0.5 * problem.settings.weights.limit *
                  (beyond(true) * beyond(true) - beyond(false) * beyond(false));
    };
    for (Index k = 0; k < kWindow; ++k) {
      for (const Limit& limit : limits) {
        const auto beyond = [&](bool moved) {
          Vec way = centroid(limit.grip, k, moved);
          if (limit.other >= 0) way -= centroid(limit.other, k, moved);
          return limit.normal.dot(way) - limit.most;
        };
        count(beyond, true);
      }
      count([&](bool moved) { return -output(1, k, moved)[2] - 0.05; }, true);
      const int places = counted;
      for (int axis = 0; axis < 12; ++axis) {
        const auto beyond = [&](bool moved) {
          const int grip = axis / 6;
          const Vec change = centroid(grip, k, moved) - 2 * centroid(grip, k - 1, moved) +
                             centroid(grip, k - 2, moved);
          const double along = (axis % 2 == 0 ? 1 : -1) * change[axis % 6 / 2];
          return kWindow * (along - 1000 * 0.02 * 0.02);
        };
        count(beyond, false);
      }
      rates += counted - places;
    }
    CHECK(rates > 3);
    CHECK(cost.largest() == Approx(largest).margin(1e-12));
    REQUIRE(largest > 0);
    const long before = clothctl_test::allocations();
    cost.add(problem, H, g);
    const long taken = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    CHECK(0.5 * delta.dot(H * delta) + g.dot(delta) == Approx(expected).epsilon(1e-9));
  }
}

TEST_CASE("hands stop at what they reach, and come back at once", "[mpc]") {
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    const Points<double> x = sheet().state.positions;
    const double reach = 0.1;  // m beyond the start; the target goes 0.3 m
    std::vector<Limit> limits;
    for (const int grip : {0, 1}) {
      const int v = grip == 0 ? sheet().upper_left() : sheet().upper_right();
      limits.push_back({grip, -1, Vec(1, 0, 0), x(0, v) + reach});
    }
    const Run free = run(input, {}), kept = run(input, limits);
    INFO("without limits " << free.farthest << ", with " << kept.farthest << ", beyond by "
                           << kept.excess);
    CHECK(free.farthest > 0.25);
    CHECK(free.excess == 0);
    CHECK(kept.farthest > 0.09);
    CHECK(kept.farthest < reach + 0.01);
    CHECK(kept.excess < 0.01);
    CHECK(kept.last_error < 2 * free.last_error + 2e-3);
    if (clothctl_test::kSanitized) break;  // the outcome is that of other builds
    const Run again = run(input, limits);
    CHECK(again.farthest == kept.farthest);
  }
}

TEST_CASE("hands that hold patches stop at what they reach", "[mpc]") {
  const HangingSheet patched = clothctl_test::hanging_sheet(9, 2, 120);
  const PlannerSetup<double> setup = clothctl_test::corner_setup(patched, 2);
  const double reach = 0.05;
  const auto farthest = [&](bool limited) {
    FrozenPlanner planner = clothctl_test::frozen_planner(
        patched, setup, clothctl_test::corner_settings(patched, GripInput::Pose, 12));
    auto plant = clothctl_test::sheet_plant(patched, Integration::LinearlyImplicit);
    const std::vector<int> held = setup.grips[0].vertices();
    const auto place = [&] {
      double sum = 0;
      for (const int v : held) sum += plant.positions()(0, v) / static_cast<double>(held.size());
      return sum;
    };
    const double start = place();
    if (limited)
      REQUIRE(planner.set_limits(std::vector<Limit>{{0, -1, Vec(1, 0, 0), start + reach}}).empty());
    Points<double> from(3, 2);
    evaluate_features<double>(setup.features, plant.positions(), from);
    auto result = planner.make_result();
    double most = 0;
    for (int k = 0; k < 60; ++k) {
      const auto target = [&](Index i, double t) -> Vec {
        return Vec(from.col(i)) + Vec(0.15 * std::min(t, 1.0), 0, 0);
      };
      REQUIRE(run_frame(planner, plant, kFrame * k, target, result).advanced());
      most = std::max(most, place() - start);
    }
    return most;
  };
  CHECK(farthest(false) > 0.1);
  const double kept = farthest(true);
  CHECK(kept > 0.9 * reach);
  CHECK(kept < reach + 0.005);
}

TEST_CASE("two grips part no more than they can", "[mpc]") {
  // Features that part by 0.1 m pull the hands apart.
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    const auto widest = [&](bool limited) {
      FrozenPlanner planner =
          clothctl_test::frozen_planner(sheet(), clothctl_test::corner_setup(sheet()),
                                        clothctl_test::corner_settings(sheet(), input, 12));
      auto plant = clothctl_test::sheet_plant(sheet(), Integration::LinearlyImplicit);
      const int left = sheet().upper_left(), right = sheet().upper_right();
      const Vec across = sheet().state.positions.col(right) - sheet().state.positions.col(left);
      if (limited)
        REQUIRE(planner.set_limits(std::vector<Limit>{{1, 0, across.normalized(), across.norm()}})
                    .empty());
      auto result = planner.make_result();
      const OutAndBack start;
      double most = 0;
      for (int k = 0; k < 100; ++k) {
        const auto target = [&](Index i, double t) -> Vec {
          const double part = 0.05 * std::min(t, 1.0);
          return Vec(start.start.col(i)) + (i == 0 ? -part : part) * across.normalized();
        };
        REQUIRE(run_frame(planner, plant, kFrame * k, target, result).advanced());
        const Vec way = plant.positions().col(right) - plant.positions().col(left);
        most = std::max(most, way.dot(across.normalized()) - across.norm());
      }
      return most;
    };
    CHECK(widest(false) > 0.015);
    CHECK(widest(true) < 0.005);
  }
}

TEST_CASE("features stay out of a half-space that their targets enter", "[mpc]") {
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    const auto lowest = [&](bool limited) {
      FrozenPlanner planner =
          clothctl_test::frozen_planner(sheet(), clothctl_test::corner_setup(sheet()),
                                        clothctl_test::corner_settings(sheet(), input, 12));
      auto plant = clothctl_test::sheet_plant(sheet(), Integration::LinearlyImplicit);
      const OutAndBack start;
      const double table = start.start(2, 0) - 0.03;
      if (limited) {
        const std::vector<FeatureLimit<double>> above{{0, Vec(0, 0, -1), -table},
                                                      {1, Vec(0, 0, -1), -table}};
        REQUIRE(planner.set_limits({}, above).empty());
      }
      auto result = planner.make_result();
      double least = 1;
      for (int k = 0; k < 100; ++k) {  // 10 cm down in a second
        const auto target = [&](Index i, double t) -> Vec {
          return Vec(start.start.col(i)) - Vec(0, 0, 0.1 * std::clamp(t, 0.0, 1.0));
        };
        REQUIRE(run_frame(planner, plant, kFrame * k, target, result).advanced());
        for (const int v : clothctl_test::corners(sheet()))
          least = std::min(least, plant.positions()(2, v) - table);
      }
      return least;
    };
    CHECK(lowest(false) < -0.05);
    CHECK(lowest(true) > -0.003);
  }
}

TEST_CASE("planning at a limit does not allocate", "[mpc]") {
  FrozenPlanner planner =
      clothctl_test::frozen_planner(sheet(), clothctl_test::corner_setup(sheet()),
                                    clothctl_test::corner_settings(sheet(), GripInput::Force, 12));
  const std::vector<Limit> limits{{0, -1, Vec(1, 0, 0), -1.0}, {1, 0, Vec(1, 0, 0), 0.0}};
  REQUIRE(planner.set_limits(limits).empty());
  auto result = planner.make_result();
  const auto& state = sheet().state;
  const OutAndBack target;
  for (int k = 0; k < 3; ++k) {
    const long before = clothctl_test::allocations();
    const PlanStatus status = planner.plan(state.positions, state.velocities, 0.0, target, result);
    const std::string bad = planner.set_limits(limits);
    const long taken = clothctl_test::allocations() - before;
    CHECK(can_apply(status));
    CHECK(bad.empty());
    CHECK(result.limit_excess > 0.005);  // limits are a cost, and here far away
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
  }
}

TEST_CASE("bad limits are refused, and limits of grips that are gone are dropped", "[mpc]") {
  FrozenPlanner planner =
      clothctl_test::frozen_planner(sheet(), clothctl_test::corner_setup(sheet()),
                                    clothctl_test::corner_settings(sheet(), GripInput::Force, 4));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refusal = [&](const Limit& limit) {
    return planner.set_limits(std::vector<Limit>{Limit(), limit});
  };
  CHECK(refusal({2, -1, Vec(1, 0, 0), 0}) == "limit 1 is for grip 2");
  CHECK(refusal({-1, -1, Vec(1, 0, 0), 0}) == "limit 1 is for grip -1");
  CHECK(refusal({0, 0, Vec(1, 0, 0), 0}) == "limit 1 is measured from grip 0");
  CHECK(refusal({0, 5, Vec(1, 0, 0), 0}) == "limit 1 is measured from grip 5");
  CHECK(refusal({0, -1, Vec(1, 1, 0), 0}) == "limit 1 has a normal that is not a unit vector");
  CHECK(refusal({0, -1, Vec(nan, 0, 0), 0}) == "limit 1 has a normal that is not a unit vector");
  CHECK(refusal({0, -1, Vec(1, 0, 0), nan}) == "limit 1 is nan m, must be finite");

  const auto feature_refusal = [&](const FeatureLimit<double>& limit) {
    return planner.set_limits({}, std::vector<FeatureLimit<double>>{limit});
  };
  CHECK(feature_refusal({2, Vec(1, 0, 0), 0}) == "feature limit 0 is for feature 2");
  CHECK(feature_refusal({-1, Vec(1, 0, 0), 0}) == "feature limit 0 is for feature -1");
  CHECK(feature_refusal({0, Vec(1, 0, 0), nan}) == "feature limit 0 is nan m, must be finite");

  REQUIRE(planner.set_limits(std::vector<Limit>{{1, -1, Vec(0, 0, 1), -5}}).empty());
  auto result = planner.make_result();
  const auto& state = sheet().state;
  REQUIRE(can_apply(planner.plan(state.positions, state.velocities, 0.0, OutAndBack(), result)));
  CHECK(result.limit_excess > 1);
  std::vector<Grip<double>> one{planner.grips()[0]};
  REQUIRE(planner.set_grips(one, state.positions).empty());
  result = planner.make_result();
  REQUIRE(can_apply(planner.plan(state.positions, state.velocities, 0.0, OutAndBack(), result)));
  CHECK(result.limit_excess == 0);
}
