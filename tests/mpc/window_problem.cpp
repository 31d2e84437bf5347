// The request to the predictor, made from grips and features. The parts of a planner share it.

#include "clothctl/mpc/detail/window_problem.hpp"

#include "support/catch.hpp"

using namespace clothctl;

namespace {

detail::WindowProblem<double> problem_of(GripInput input) {
  PlannerSettings<double> settings;
  settings.horizon = 7;
  settings.dt = 0.03;
  settings.input = input;
  settings.gravity_load = {0.0, 0.0, 6.0};
  PointFeatures<double> features;
  features.add_point(9);
  features.add_centroid({0, 1});
  detail::GripBasis<double> basis(
      {make_pinch<double>({3, 2}, 0.5, 4.0), make_pinch<double>({5}, 0.5, 4.0)}, {}, input);
  return {settings, std::move(basis), features};
}

}  // namespace

TEST_CASE("a request predicts the features and then the held vertices", "[mpc]") {
  for (const GripInput input : {GripInput::Force, GripInput::Pose}) {
    const detail::WindowProblem<double> problem = problem_of(input);
    const WindowRequest<double>& request = problem.request;
    CHECK(request.kind == input);
    CHECK(request.horizon == 7);
    CHECK(request.dt == 0.03);
    CHECK(request.held == std::vector<int>{2, 3, 5});
    CHECK(problem.feature_count == 2);
    CHECK(request.held_outputs == 2);
    REQUIRE(request.outputs.count() == 5);
    for (Index j = 0; j < 3; ++j) {
      request.outputs.for_each_term(2 + j, [&](int vertex, double weight) {
        CHECK(vertex == request.held[static_cast<std::size_t>(j)]);
        CHECK(weight == 1.0);
      });
    }
    CHECK((request.plan.rows() == 9 && request.plan.cols() == 7));
    CHECK((request.path.rows() == 9 && request.path.cols() == 7));
    CHECK(request.applied.size() == 9);
    CHECK(request.wind.cols() == 7);
    CHECK_FALSE((request.has_path || request.has_applied));
    CHECK(problem.motion.last_velocity.cols() == 3);
    REQUIRE(problem.patches.size() == 2);
    CHECK(problem.patches[0].held_slots == std::vector<Index>{0, 1});
  }
}

TEST_CASE("the gravity load of planned forces is divided among the held vertices", "[mpc]") {
  CHECK(problem_of(GripInput::Force).force_share == Vector3<double>(0.0, 0.0, 2.0));
  CHECK(problem_of(GripInput::Pose).force_share == Vector3<double>::Zero());
}

TEST_CASE("a response of another size does not fit its request", "[mpc]") {
  detail::WindowProblem<double> problem = problem_of(GripInput::Force);
  CHECK_FALSE(detail::response_fits(problem));  // there is none yet
  const auto& q = problem.request;
  problem.response.impulse_response.setZero(q.output_rows(), q.inputs() * q.horizon);
  problem.response.free_response.setZero(q.output_rows(), q.horizon);
  problem.response.plan.setZero(q.inputs(), q.horizon);
  CHECK(detail::response_fits(problem));
  problem.response.plan.setZero(q.inputs(), q.horizon + 1);
  CHECK_FALSE(detail::response_fits(problem));
  problem.response.plan.setZero(q.inputs(), q.horizon);
  problem.response.free_response.setZero(q.output_rows() - 3, q.horizon);
  CHECK_FALSE(detail::response_fits(problem));
}
