// The stacked rows of a window, compared with the cost in planner_settings.hpp at plans near the
// predicted one.

#include "clothctl/mpc/detail/window_cost.hpp"

#include <limits>
#include <vector>

#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"

using namespace clothctl;

namespace {

using V = Vector3<double>;

constexpr Index kHorizon = 5, kFeatures = 2;

/// Two features.
PointFeatures<double> two_features() {
  PointFeatures<double> features;
  for (int v = 0; v < kFeatures; ++v) features.add_point(v);
  return features;
}

PlannerSettings<double> window_settings() {
  PlannerSettings<double> settings;
  settings.horizon = kHorizon;
  settings.heavy_chain_axes = HeavyChainAxes::Off;
  settings.weights = {
      .feature = 3.0, .smooth = 0.7, .shape = 0.4, .anchor = 1.3, .patch = 2.1, .jerk = 0.2};
  return settings;
}

/// Two grips of four vertices each on a small sheet, and random data for everything that the
/// window's cost depends on.
struct Window {
  clothctl_test::HangingSheet sheet = clothctl_test::hanging_sheet(5, 2, 5);
  detail::WindowProblem<double> problem;
  PlannerSettings<double>& settings;
  WindowResponse<double>& response;
  detail::HeldMotion<double>& motion;
  std::vector<HandAnchor<double>> anchors;

  Window()
      : problem(window_settings(),
                {{make_pinch<double>(sheet.corner_patch(0, 2), 0.5, 1.0),
                  make_pinch<double>(sheet.corner_patch(1, 2), 0.5, 1.0)},
                 sheet.network.triangles,
                 GripInput::Force},
                two_features()),
        settings(problem.settings),
        response(problem.response),
        motion(problem.motion) {
    std::srand(5);
    const std::vector<int>& held_vertices = problem.request.held;
    const Index held = static_cast<Index>(held_vertices.size()), inputs = problem.basis.inputs();
    response.impulse_response = MatrixX<double>::Random(3 * (kFeatures + held), inputs * kHorizon);
    response.free_response = MatrixX<double>::Random(3 * (kFeatures + held), kHorizon);
    response.plan = MatrixX<double>::Random(inputs, kHorizon);
    for (Index j = 0; j < held; ++j)
      motion.position.col(j) =
          sheet.state.positions.col(held_vertices[static_cast<std::size_t>(j)]);
    motion.velocity = Points<double>::Random(3, held);
    motion.last_velocity = Points<double>::Random(3, held);
    for (detail::HeldPatch<double>& patch : problem.patches) patch.update(motion.position);
    anchors.assign(2, HandAnchor<double>{{0.3, 0.7}, V(0.1, -0.2, 0.5), 0.0});
  }
  Window(const Window&) = delete;

  /// Start time of the window, s.
  static constexpr double start = 0.37;

  static V target(Index feature, double t) {
    return {std::sin(3 * t + double(feature)), t, 0.2 * t * t};
  }

  /// The outputs after the plan changes by `change` (inputs × K): 3·outputs × K.
  MatrixX<double> outputs(const MatrixX<double>& change) const {
    MatrixX<double> y = response.free_response;
    for (Index k = 0; k < kHorizon; ++k) {
      for (Index j = 0; j <= k; ++j)
        y.col(k) += response.impulse_response.middleCols((k - j) * problem.basis.inputs(),
                                                         problem.basis.inputs()) *
                    change.col(j);
    }
    return y;
  }

  /// The cost without effort, by its definition.
  double cost(const MatrixX<double>& change, double step_weight) const {
    const PlannerWeights<double>& w = settings.weights;
    const double h = settings.dt;
    const MatrixX<double> y = outputs(change);
    double sum = 0;
    const auto point = [&](Index output, Index k) { return V(y.block<3, 1>(3 * output, k)); };
    for (Index k = 0; k < kHorizon; ++k) {
      for (Index i = 0; i < kFeatures; ++i)
        sum += w.feature * (point(i, k) - target(i, start + double(k + 1) * h)).squaredNorm();
    }
    for (Index g = 0; g < 2; ++g) {
      // Centroids from three frames before the window to its end.
      std::vector<V> c(3, V::Zero()), planned;
      c.resize(3 + kHorizon, V::Zero());
      planned.resize(3 + kHorizon, V::Zero());
      for (Index j = 4 * g; j < 4 * g + 4; ++j) {
        c[2] += 0.25 * motion.position.col(j);
        c[1] += 0.25 * (motion.position.col(j) - h * motion.velocity.col(j));
        c[0] += 0.25 * (motion.position.col(j) - h * motion.velocity.col(j) -
                        h * motion.last_velocity.col(j));
        for (Index k = 0; k < kHorizon; ++k) {
          c[std::size_t(3 + k)] += 0.25 * point(kFeatures + j, k);
          planned[std::size_t(3 + k)] +=
              0.25 * response.free_response.block<3, 1>(3 * (kFeatures + j), k);
        }
      }
      planned[2] = c[2];
      for (Index k = 0; k < kHorizon; ++k) {
        const std::size_t n = std::size_t(3 + k);
        const double t = start + double(k + 1) * h;
        const V hand = 0.3 * target(0, t) + 0.7 * target(1, t) + V(0.1, -0.2, 0.5);
        const V v = (c[n] - c[n - 1]) / h, before = (c[n - 1] - c[n - 2]) / h,
                earlier = (c[n - 2] - c[n - 3]) / h;
        sum += w.anchor * (c[n] - hand).squaredNorm() + w.smooth * (v - before).squaredNorm() +
               w.jerk * (v - 2 * before + earlier).squaredNorm() +
               step_weight * (v - (planned[n] - planned[n - 1]) / h).squaredNorm();
      }
    }
    for (const detail::HeldPatch<double>& patch : problem.patches) {
      const Index first = 3 * (kFeatures + patch.held_slots.front());
      const auto at = [&](Index k) {
        Points<double> p = patch.reference;
        for (Index j = 0; j < 4 && k >= 0; ++j) p.col(j) = y.block<3, 1>(first + 3 * j, k);
        return p;
      };
      for (Index k = 0; k < kHorizon; ++k) {
        sum += w.shape * ((at(k) - at(k - 1)) * patch.affine.map().transpose()).squaredNorm();
        for (Index i = 0; i < patch.affine.non_affine_count(); ++i)
          sum += w.patch * (at(k) * patch.affine.non_affine(i).transpose()).squaredNorm();
      }
    }
    return sum;
  }
};

/// The sum of squares of the stacked rows after the plan changes.
double stacked(const detail::TermStack<double>& stack, const MatrixX<double>& change) {
  MatrixX<double> rows = stack.residual();
  for (Index k = 0; k < kHorizon; ++k) {
    for (Index j = 0; j <= k; ++j)
      rows.col(k) +=
          stack.blocks().middleCols((k - j) * change.rows(), change.rows()) * change.col(j);
  }
  return rows.squaredNorm();
}

}  // namespace

TEST_CASE("the stacked rows give the cost of the settings", "[mpc][window_cost]") {
  Window window;
  detail::WindowCost<double> cost;
  cost.reserve(window.problem, window.anchors);
  const long before = clothctl_test::allocations();
  const bool sampled = cost.sample(window.problem, Window::start, Window::target);
  const detail::TermStack<double>& stack =
      cost.stack(window.problem, 0.9, window.settings.weights.anchor);
  const long made = clothctl_test::allocations() - before;
  REQUIRE(sampled);
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  const MatrixX<double> none = MatrixX<double>::Zero(window.problem.basis.inputs(), kHorizon);
  CHECK(stacked(stack, none) == Approx(window.cost(none, 0.9)).epsilon(1e-12));
  for (int trial = 0; trial < 4; ++trial) {
    const MatrixX<double> change = MatrixX<double>::Random(window.problem.basis.inputs(), kHorizon);
    CHECK(stacked(stack, change) == Approx(window.cost(change, 0.9)).epsilon(1e-12));
  }
}

TEST_CASE("each weight of the cost has its own rows", "[mpc][window_cost]") {
  Window window;
  const MatrixX<double> change = MatrixX<double>::Random(window.problem.basis.inputs(), kHorizon);
  const PlannerWeights<double> zero{
      .feature = 0, .smooth = 0, .shape = 0, .anchor = 0, .patch = 0, .jerk = 0};
  const auto check = [&](PlannerWeights<double> weights, double step_weight, Index rows) {
    window.settings.weights = weights;
    detail::WindowCost<double> cost;
    cost.reserve(window.problem, window.anchors);
    REQUIRE(cost.sample(window.problem, Window::start, Window::target));
    const detail::TermStack<double>& stack =
        cost.stack(window.problem, step_weight, weights.anchor);
    CHECK(stack.rows() == rows);
    CHECK(stacked(stack, change) == Approx(window.cost(change, step_weight)).epsilon(1e-12));
  };
  PlannerWeights<double> w = zero;
  check(w, 0.0, 0);
  check(w, 2.0, 6);
  (w = zero).feature = 2.0;
  check(w, 0.0, 6);
  (w = zero).smooth = 2.0;
  check(w, 0.0, 6);
  (w = zero).anchor = 2.0;
  check(w, 0.0, 6);
  (w = zero).jerk = 2.0;
  check(w, 0.0, 6);
  (w = zero).shape = 2.0;
  check(w, 0.0, 18);
  (w = zero).patch = 2.0;
  check(w, 0.0, 2 * 3 * window.problem.patches[0].affine.non_affine_count());
  // Rows of a hard patch are not part of the cost, and a commanded pose keeps its patch rigid
  // anyway.
  window.settings.patch = PatchMode::Hard;
  const auto rows = [&] {
    detail::WindowCost<double> cost;
    cost.reserve(window.problem, window.anchors);
    return cost.stack(window.problem, 0.0, window.settings.weights.anchor).rows();
  };
  CHECK(rows() == 0);
  window.settings.patch = PatchMode::Soft;
  CHECK(rows() > 0);
  window.settings.input = GripInput::Pose;
  CHECK(rows() == 0);
}

TEST_CASE("a target that is not finite is reported for any feature or anchor",
          "[mpc][window_cost]") {
  Window window;
  detail::WindowCost<double> cost;
  cost.reserve(window.problem, window.anchors);
  const double end = double(kHorizon) * window.settings.dt;
  const auto broken_after = [](double limit) {
    return [limit](Index i, double t) {
      return t > limit ? V(0, std::numeric_limits<double>::infinity(), 0) : Window::target(i, t);
    };
  };
  CHECK(cost.sample(window.problem, 0.0, broken_after(1.001 * end)));
  CHECK_FALSE(cost.sample(window.problem, 0.0, broken_after(0.999 * end)));
  // So is a target that no sheet can reach.
  for (double far_away : {1.1e6, -1e30, 1e300}) {
    const auto away = [&](Index, double t) { return V(0, t, far_away); };
    CHECK_FALSE(cost.sample(window.problem, 0.0, away));
  }
  // An anchor of a swinging sheet looks further ahead than the window.
  window.settings.heavy_chain_axes = HeavyChainAxes::Horizontal;
  for (HandAnchor<double>& anchor : window.anchors) anchor.hanging_length = 0.5;
  cost.reserve(window.problem, window.anchors);
  CHECK_FALSE(cost.sample(window.problem, 0.0, broken_after(1.001 * end)));
}

TEST_CASE("hands lead by what the air does to the sheet", "[mpc][window_cost]") {
  Window window;
  for (HandAnchor<double>& anchor : window.anchors) anchor.hanging_length = 0.4;
  window.settings.heavy_chain_axes = HeavyChainAxes::Horizontal;
  const double step = 0.9, weight = 1.3;
  detail::WindowCost<double> cost;
  cost.reserve(window.problem, window.anchors);
  REQUIRE(cost.sample(window.problem, Window::start, Window::target));
  const MatrixX<double> still = cost.stack(window.problem, step, weight).residual();
  window.response.air = Points<double>::Random(3, kHorizon) * 5.0;
  const MatrixX<double> windy = cost.stack(window.problem, step, weight).residual();
  REQUIRE(still.rows() == windy.rows());
  int changed = 0;
  for (Index r = 0; r < still.rows(); ++r) {
    if (still.row(r) == windy.row(r)) continue;
    const Index c = changed++ % 3;  // rows come in threes, one for each coordinate
    for (Index k = 0; k < kHorizon; ++k) {
      const V lead = air_lead(window.anchors[0], HeavyChainAxes::Horizontal,
                              window.settings.gravity, V(0, 0, 0), V(window.response.air.col(k)));
      CHECK(still(r, k) - windy(r, k) == Approx(std::sqrt(weight) * lead[c]));
    }
  }
  CHECK(changed == 6);
}

TEST_CASE("the request's drift is the velocity of the targets", "[mpc][window_cost]") {
  Window window;
  detail::WindowCost<double> cost;
  cost.reserve(window.problem, window.anchors);
  const V velocity(0.3, -0.2, 1.5);
  const auto target = [&](Index i, double t) { return V(V(0.1 * double(i), 2, 3) + t * velocity); };
  REQUIRE(cost.sample(window.problem, Window::start, target));
  for (Index k = 0; k < kHorizon; ++k)
    CHECK((window.problem.request.drift.col(k) - velocity).norm() < 1e-12);
  // Without anchors nobody asks for it, nor for targets before the window.
  window.settings.weights.anchor = 0;
  const auto later = [&](Index i, double t) {
    return t <= Window::start ? V(0, std::numeric_limits<double>::quiet_NaN(), 0) : target(i, t);
  };
  CHECK(cost.sample(window.problem, Window::start, later));
  window.settings.weights.anchor = 1;
  CHECK_FALSE(cost.sample(window.problem, Window::start, later));
}
