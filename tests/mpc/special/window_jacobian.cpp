// A planner whose predictor says frame by frame how the features respond: where that is what the
// impulse response says, it plans the same.

#include "clothctl/mpc/planner.hpp"

#include "mpc/planner_loops.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::HangingSheet;
using clothctl_test::kFrame;

namespace {

// Writes the features' part of the inner impulse response as a Jacobian, and then spoils the
// former, which nothing may read.
struct Expanded {
  using Scalar = double;
  clothctl_test::FrozenPredictor inner;

  void reserve(const WindowRequest<double>& q, WindowResponse<double>& r) {
    inner.reserve(q, r);
    r.jacobian.setZero(3 * q.held_outputs * q.horizon, q.inputs() * q.horizon);
  }
  bool predict(const PointsView<double>& x, const PointsView<double>& v,
               const WindowRequest<double>& q, WindowResponse<double>& r) {
    if (!inner.predict(x, v, q, r)) return false;
    const Index p = 3 * q.held_outputs, m = q.inputs();
    for (Index k = 0; k < q.horizon; ++k) {
      for (Index j = 0; j <= k; ++j)
        r.jacobian.block(k * p, j * m, p, m) = r.impulse_response.block(0, (k - j) * m, p, m);
    }
    r.impulse_response.topRows(p).setConstant(1e9);
    return r.has_jacobian = true;
  }
  void reset() { inner.reset(); }
};

struct Sway {
  Points<double> start;
  Vector3<double> operator()(Index i, double t) const {
    const double s = std::sin(4 * t);
    return Vector3<double>(start.col(i)) + Vector3<double>(0.05 * s, 0.1 * s * s, 0.04 * s);
  }
};

}  // namespace

TEST_CASE("a Jacobian that is the impulse response plans the same", "[mpc]") {
  struct Case {
    GripInput input;
    int patch;
  };
  for (const Case& c :
       {Case{GripInput::Force, 1}, Case{GripInput::Pose, 1}, Case{GripInput::Pose, 2}}) {
    CAPTURE(c.patch);
    const HangingSheet sheet = clothctl_test::hanging_sheet(7, c.patch);
    const Sway target{sheet.state.positions(Eigen::all, clothctl_test::corners(sheet))};
    const auto settings = clothctl_test::corner_settings(sheet, c.input, 8);
    const auto setup = clothctl_test::corner_setup(sheet, c.patch);
    auto plain = clothctl_test::frozen_planner(sheet, setup, settings);
    auto expanded = Planner<Expanded>::create(setup, settings, Expanded{plain.predictor()},
                                              sheet.state.positions)
                        .value();
    // The first feature may not rise as far as its target does.
    const std::vector<FeatureLimit<double>> limits{
        {0, {0, 0, 1}, sheet.state.positions(2, sheet.lower_left()) + 0.01}};
    REQUIRE(plain.set_limits({}, limits).empty());
    REQUIRE(expanded.set_limits({}, limits).empty());
    auto plant = clothctl_test::sheet_plant(sheet, Integration::LinearlyImplicit);
    auto a = plain.make_result(), b = expanded.make_result();
    double limited = 0;
    for (int k = 0; k < 40; ++k) {
      const double t = kFrame * k;
      REQUIRE(can_apply(plain.plan(plant.positions(), plant.velocities(), t, target, a)));
      const long before = clothctl_test::allocations();
      REQUIRE(can_apply(expanded.plan(plant.positions(), plant.velocities(), t, target, b)));
      CHECK(
          (clothctl_test::allocations() == before || !clothctl_test::allocation_counting_works()));
      CHECK((a.plan - b.plan).norm() < 1e-7 * (1 + a.plan.norm()));
      CHECK((a.predicted - b.predicted).cwiseAbs().maxCoeff() < 1e-8);
      limited = std::max(limited, a.limit_excess);
      plant.apply(a.input);
      REQUIRE(plant.advance(kFrame).advanced);
    }
    CHECK(limited > 0);  // the limit took part
  }
}

TEST_CASE("a Jacobian of the wrong size is refused", "[mpc]") {
  struct Short : Expanded {
    bool predict(const PointsView<double>& x, const PointsView<double>& v,
                 const WindowRequest<double>& q, WindowResponse<double>& r) {
      if (!Expanded::predict(x, v, q, r)) return false;
      r.jacobian.conservativeResize(r.jacobian.rows() - 1, Eigen::NoChange);
      return true;
    }
  };
  const HangingSheet sheet = clothctl_test::hanging_sheet(5);
  const Sway target{sheet.state.positions(Eigen::all, clothctl_test::corners(sheet))};
  const auto settings = clothctl_test::corner_settings(sheet, GripInput::Pose, 5);
  auto plain = clothctl_test::frozen_planner(sheet, clothctl_test::corner_setup(sheet), settings);
  auto planner = Planner<Short>::create(clothctl_test::corner_setup(sheet), settings,
                                        Short{{plain.predictor()}}, sheet.state.positions)
                     .value();
  auto result = planner.make_result();
  CHECK(planner.plan(sheet.state.positions, sheet.state.velocities, 0.0, target, result) ==
        PlanStatus::Failed);
}
