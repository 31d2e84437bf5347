// Inputs as splines: their weights, the contracted QP, and planners that use them.

#include "clothctl/mpc/detail/input_splines.hpp"

#include <algorithm>
#include <cmath>

#include "clothctl/mpc/run_frame.hpp"
#include "mpc/planner_loops.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

#include <Eigen/QR>

using namespace clothctl;
using clothctl_test::FrozenPlanner;
using clothctl_test::HangingSheet;
using clothctl_test::kFrame;

namespace {

const HangingSheet& sheet() {
  static const HangingSheet made = clothctl_test::hanging_sheet(9);
  return made;
}

PlannerSettings<double> splined(std::vector<Index> intervals, int degree) {
  PlannerSettings<double> s = clothctl_test::corner_settings(sheet(), GripInput::Pose, 20);
  s.input_intervals = std::move(intervals);
  s.input_degree = degree;
  return s;
}

struct Run {
  double mean_error = 0;
  MatrixX<double> last_plan;
};

Run run(const PlannerSettings<double>& settings) {
  FrozenPlanner planner =
      clothctl_test::frozen_planner(sheet(), clothctl_test::corner_setup(sheet()), settings);
  auto plant = clothctl_test::sheet_plant(sheet(), Integration::LinearlyImplicit);
  auto result = planner.make_result();
  const clothctl_test::AsyncTarget target(sheet(), 2.0);
  Run out;
  for (int k = 0; k < 100; ++k) {
    const long before = clothctl_test::allocations();
    const PlanStatus status =
        planner.plan(plant.positions(), plant.velocities(), k * kFrame, target, result);
    const long taken = clothctl_test::allocations() - before;
    REQUIRE(status == PlanStatus::Planned);
    if (clothctl_test::allocation_counting_works()) CHECK(taken == 0);
    plant.apply(result.input);
    REQUIRE(plant.advance(kFrame).advanced);
    for (const int i : {0, 1}) {
      const int v = clothctl_test::corners(sheet())[static_cast<std::size_t>(i)];
      const Vector3<double> wanted = target(i, (k + 1) * kFrame);
      out.mean_error += 0.005 * (plant.positions().col(v) - wanted).norm();
    }
  }
  out.last_plan = result.plan;
  return out;
}

}  // namespace

TEST_CASE("weights of splines are a partition of unity with full rank", "[mpc]") {
  const std::vector<std::vector<Index>> all{{20},         {1, 1, 2, 4, 12}, {1, 2, 3, 4, 10},
                                            {5, 5, 5, 5}, {2, 18},          {1, 1, 1, 1, 16}};
  for (const std::vector<Index>& lengths : all) {
    for (int degree = 0; degree <= 3; ++degree) {
      const MatrixX<double> S = detail::spline_weights<double>(lengths, degree, 20);
      CAPTURE(lengths.size(), degree);
      REQUIRE(S.cols() == static_cast<Index>(lengths.size()) + degree);
      CHECK(S.minCoeff() >= -1e-15);
      CHECK((S.rowwise().sum().array() - 1).abs().maxCoeff() < 1e-14);
      CHECK(S(0, 0) == Approx(1));
      CHECK(S(19, S.cols() - 1) == Approx(1));
      CHECK(Eigen::ColPivHouseholderQR<MatrixX<double>>(S).rank() == S.cols());
    }
  }
  const MatrixX<double> blocks = detail::spline_weights<double>({1, 3}, 0, 4);
  MatrixX<double> expected(4, 2);
  expected << 1, 0, 0, 1, 0, 1, 0, 1;
  CHECK(blocks == expected);
  CHECK(detail::spline_weights<double>({}, 2, 3) == MatrixX<double>::Identity(3, 3));
}

TEST_CASE("splines of degree d can be any polynomial of that degree", "[mpc]") {
  for (int degree = 1; degree <= 3; ++degree) {
    const MatrixX<double> S = detail::spline_weights<double>({1, 2, 5, 12}, degree, 20);
    VectorX<double> wanted(20);
    for (Index k = 0; k < 20; ++k) wanted[k] = std::pow(0.1 * static_cast<double>(k) - 1, degree);
    const VectorX<double> z = Eigen::ColPivHouseholderQR<MatrixX<double>>(S).solve(wanted);
    CHECK((S * z - wanted).norm() < 1e-12);
  }
}

TEST_CASE("the contracted QP is that of the control points", "[mpc]") {
  std::srand(4);
  PlannerSettings<double> settings;
  settings.horizon = 6;
  settings.input_intervals = {1, 2, 3};
  settings.input_degree = 1;
  detail::InputSplines<double> splines;
  const Index p = 2, full = 12;
  splines.reserve(settings, p);
  const Index size = p * splines.count();
  REQUIRE(size == 8);
  MatrixX<double> H(size, size), direct;
  VectorX<double> g(size), lower(size), upper(size), none;
  const MatrixX<double> root = MatrixX<double>::Random(full, full);
  splines.hessian(direct) = root * root.transpose();
  splines.gradient(none) = VectorX<double>::Random(full);
  splines.lower(none) = VectorX<double>::Random(full).array() - 2;
  splines.upper(none) = VectorX<double>::Random(full).array() + 2;
  splines.contract(H, g, lower, upper);
  for (int trial = 0; trial < 20; ++trial) {
    VectorX<double> z = VectorX<double>::Random(size), u(full);
    splines.expand(z, u);
    const double value = 0.5 * u.dot(splines.hessian(direct) * u) + splines.gradient(none).dot(u);
    CHECK(0.5 * z.dot(H * z) + g.dot(z) == Approx(value));
    for (Index i = 0; i < size; ++i) z[i] = z[i] < 0 ? lower[i] : upper[i];
    splines.expand(z, u);
    CHECK((u.array() >= splines.lower(none).array() - 1e-12).all());
    CHECK((u.array() <= splines.upper(none).array() + 1e-12).all());
  }
}

TEST_CASE("intervals of one frame change nothing", "[mpc]") {
  for (const int patch : {1, 2}) {
    const auto planner_for = [&](std::vector<Index> intervals) {
      return clothctl_test::frozen_planner(sheet(), clothctl_test::corner_setup(sheet(), patch),
                                           splined(std::move(intervals), 0));
    };
    FrozenPlanner free = planner_for({}), single = planner_for(std::vector<Index>(20, 1));
    auto plant = clothctl_test::sheet_plant(sheet(), Integration::LinearlyImplicit);
    PlanResult<double> a = free.make_result(), b = single.make_result();
    const clothctl_test::AsyncTarget target(sheet(), 2.0);
    for (int k = 0; k < 40; ++k) {
      const auto plan = [&](FrozenPlanner& planner, PlanResult<double>& result) {
        return planner.plan(plant.positions(), plant.velocities(), k * kFrame, target, result);
      };
      REQUIRE(plan(free, a) == PlanStatus::Planned);
      REQUIRE(plan(single, b) == PlanStatus::Planned);
      CHECK((a.plan - b.plan).norm() < 1e-8 * a.plan.norm());
      plant.apply(a.input);
      REQUIRE(plant.advance(kFrame).advanced);
    }
  }
}

TEST_CASE("planners with splines for poses follow nearly as well", "[mpc]") {
  const Run free = run(splined({}, 0));
  const Run blocks = run(splined({1, 1, 2, 4, 12}, 0));
  const Run cubic = run(splined({1, 1, 2, 4, 12}, 3));
  INFO("free " << free.mean_error << ", blocks " << blocks.mean_error << ", cubic "
               << cubic.mean_error);
  CHECK(blocks.mean_error < 1.05 * free.mean_error);
  CHECK(cubic.mean_error < 1.05 * free.mean_error);
  // The last block is one velocity.
  CHECK((blocks.last_plan.rightCols(12).colwise() - blocks.last_plan.col(8)).norm() < 1e-12);
}

TEST_CASE("bad intervals are refused", "[mpc]") {
  PlannerSettings<double> s = splined({10, 9}, 0);
  CHECK(s.validate() == "input_intervals sums to 19 frames, the horizon is 20");
  s.input_intervals = {21, -1};
  CHECK(s.validate() == "input_intervals holds 21, must be 1 to 20");
  s.input_intervals = {20, 0};
  CHECK(s.validate() == "input_intervals holds 0, must be 1 to 20");
  s.input_intervals = {10, 10};
  s.input_degree = 4;
  CHECK(s.validate() == "input_degree is 4, must be 0 to 3");
  s.input_degree = 3;
  CHECK(s.validate().empty());
  s.input = GripInput::Force;
  CHECK(s.validate() == "input_intervals is for poses; forces must balance in every frame");
  s.input = GripInput::Pose;
  s.input_intervals.assign(20, 1);
  CHECK(s.validate() == "splines of degree 3 have 23 control points for 20 frames");
}
