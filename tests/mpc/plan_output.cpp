// What a planning frame sends to the plant, and the sizes of its result.

#include "clothctl/mpc/detail/plan_output.hpp"

#include <Eigen/Geometry>

#include "mpc/small_window.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using clothctl_test::kWindow;
using clothctl_test::small_settings;
using clothctl_test::SmallWindow;
using V = Vector3<double>;

namespace {

PlannerSettings<double> planned_position() {
  PlannerSettings<double> settings = small_settings(GripInput::Force);
  settings.command = PlantCommand::Position;
  return settings;
}

}  // namespace

TEST_CASE("a result has room for what is sent, and fits its own kind of problem alone", "[mpc]") {
  const SmallWindow force(small_settings(GripInput::Force)), position(planned_position()),
      pose(small_settings(GripInput::Pose));
  const SmallWindow* all[] = {&force, &position, &pose};
  CHECK(detail::sends_forces(force.problem.settings));
  CHECK_FALSE(detail::sends_forces(position.problem.settings));
  CHECK_FALSE(detail::sends_forces(pose.problem.settings));
  for (const SmallWindow* a : all) {
    const PlanResult<double> result = detail::make_plan_result(a->problem);
    const bool forces = a == &force;
    CHECK(result.input.force_vertices.size() == (forces ? 8u : 0u));
    CHECK(result.input.driven_vertices.size() == (forces ? 0u : 8u));
    CHECK(result.input.forces.cols() == (forces ? 8 : 0));
    CHECK(result.input.driven_positions.cols() == (forces ? 0 : 8));
    for (const SmallWindow* b : all) CHECK(detail::fits(b->problem, result) == (a == b));
    PlanResult<double> cut = result;
    cut.plan.conservativeResize(cut.plan.rows(), kWindow - 1);
    CHECK_FALSE(detail::fits(a->problem, cut));
    cut = result;
    cut.predicted.conservativeResize(3, kWindow);
    CHECK_FALSE(detail::fits(a->problem, cut));
    CHECK_FALSE(detail::fits(a->problem, PlanResult<double>()));
  }
}

TEST_CASE("each vertex gets the sum of its fingers' forces", "[mpc]") {
  SmallWindow window(GripInput::Force);
  PlanResult<double> result = detail::make_plan_result(window.problem);
  std::vector<FingerForce<double>> forces(result.finger_forces.size());
  const auto& basis = window.problem.basis;
  basis.finger_forces(VectorX<double>::LinSpaced(basis.unknowns(), 0.1, 0.9), forces);
  result.input.forces.setConstant(7.0);  // a frame before
  const long before = clothctl_test::allocations();
  detail::send_forces(window.problem, forces, result);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  Points<double> expected = Points<double>::Zero(3, 8);
  for (const FingerForce<double>& f : forces) {
    const std::size_t slot = basis.held().slot(static_cast<std::size_t>(f.grip), f.vertex);
    expected.col(static_cast<Index>(slot)) += f.force;
  }
  CHECK((result.input.forces - expected).norm() <= 1e-14);
  CHECK(expected.norm() > 0.1);
  REQUIRE(result.finger_forces.size() == forces.size());
  for (std::size_t i = 0; i < forces.size(); ++i)
    CHECK(result.finger_forces[i].force == forces[i].force);
}

TEST_CASE("a path is the velocities that the outputs promise, and is sent one frame of it",
          "[mpc]") {
  SmallWindow window(planned_position());
  auto& problem = window.problem;
  PlanResult<double> result = detail::make_plan_result(problem);
  detail::send_path(problem, result);
  CHECK(result.input.driven_positions == problem.motion.position);  // no path yet: stay
  // Held vertices move by a different step in every frame; two of them too far.
  const auto step = [](Index j, Index k) {
    return V(j == 3 ? 0.3 : 0.001 * static_cast<double>(j), 0.002 * static_cast<double>(k),
             j == 5 ? -0.2 : 0.01);
  };
  for (Index j = 0; j < 8; ++j) {
    V at = problem.motion.position.col(j);
    for (Index k = 0; k < kWindow; ++k) {
      at += step(j, k);
      problem.response.free_response.block<3, 1>(3 * (problem.feature_count + j), k) = at;
    }
  }
  detail::take_path(problem);
  CHECK(problem.request.has_path);
  for (Index j = 0; j < 8; ++j) {
    for (Index k = 0; k < kWindow; ++k) {
      const V velocity = problem.request.path.block<3, 1>(3 * j, k);
      CHECK((velocity - step(j, k) / 0.02).norm() <= 1e-12);
    }
  }
  detail::send_path(problem, result);
  for (Index j = 0; j < 8; ++j) {
    V sent = step(j, 0);
    if (j == 3) sent[0] = problem.settings.max_step;
    if (j == 5) sent[2] = -problem.settings.max_step;
    CHECK((result.input.driven_positions.col(j) - problem.motion.position.col(j) - sent).norm() <=
          1e-13);
  }
}

TEST_CASE("grips are sent as rigid bodies", "[mpc]") {
  SmallWindow window(GripInput::Pose);
  const auto& problem = window.problem;
  PlanResult<double> result = detail::make_plan_result(problem);
  // Each grip translates by its own velocity; the second also rotates about its centroid.
  const V turn(0.0, 0.0, 0.5);
  for (Index j = 0; j < 8; ++j) {
    const V arm =
        problem.motion.position.col(j) - problem.motion.position.rightCols(4).rowwise().mean();
    result.plan.col(0).segment<3>(3 * j) = j < 4 ? V(1.0, 0.0, 0.0) : V(turn.cross(arm));
  }
  result.plan.rightCols(kWindow - 1).setConstant(1e3);  // later frames are not sent
  detail::send_poses(problem, result);
  const Points<double> moved = result.input.driven_positions - problem.motion.position;
  CHECK((moved.leftCols(4).colwise() - V(0.02, 0.0, 0.0)).norm() <= 1e-13);
  const V centre = problem.motion.position.rightCols(4).rowwise().mean();
  const Matrix3<double> rotation = Eigen::AngleAxisd(0.02 * 0.5, V::UnitZ()).matrix();
  for (Index j = 4; j < 8; ++j) {
    const V end = centre + rotation * (problem.motion.position.col(j) - centre);
    CHECK((result.input.driven_positions.col(j) - end).norm() <= 1e-13);
    CHECK(moved.col(j).norm() > 1e-5);
  }
}

TEST_CASE("affine motion of a patch leaves no residual, and any other its largest part", "[mpc]") {
  SmallWindow window(GripInput::Force);
  auto& problem = window.problem;
  std::vector<detail::OutputTerm<double>> point;
  point.reserve(8);
  Matrix3<double> map;
  map << 1.1, 0.2, 0.0, -0.3, 0.9, 0.1, 0.05, 0.0, 1.2;
  for (Index k = 0; k < kWindow; ++k) {
    for (Index j = 0; j < 8; ++j)
      problem.response.free_response.block<3, 1>(3 * (problem.feature_count + j), k) =
          map * problem.motion.position.col(j) + V::Constant(0.01 * static_cast<double>(k));
  }
  CHECK(detail::largest_non_affine(problem, point) <= 1e-12);
  problem.response.free_response(3 * (problem.feature_count + 2) + 1, kWindow - 1) += 0.01;
  const double residual = detail::largest_non_affine(problem, point);
  CHECK(residual > 1e-3);
  CHECK(residual < 0.0101);
}
