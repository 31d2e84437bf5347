// Moves a prediction from the zero plan to another plan.

#include "clothctl/prediction/window.hpp"

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

TEST_CASE("a plan is added as a convolution with the impulse response", "[mpc]") {
  const Index horizon = 9, inputs = 6, rows = 9;
  WindowResponse<double> response;
  response.impulse_response = MatrixX<double>::Random(rows, inputs * horizon);
  response.free_response = MatrixX<double>::Random(rows, horizon);
  const MatrixX<double> plan = MatrixX<double>::Random(inputs, horizon);
  MatrixX<double> expected = response.free_response;
  for (Index k = 0; k < horizon; ++k) {
    for (Index j = 0; j <= k; ++j) {
      for (Index r = 0; r < rows; ++r) {
        for (Index i = 0; i < inputs; ++i)
          expected(r, k) += response.impulse_response(r, (k - j) * inputs + i) * plan(i, j);
      }
    }
  }
  const long before = clothctl_test::allocations();
  add_plan(plan, response);
  const long made = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
  CHECK((response.free_response - expected).norm() < 1e-13 * expected.norm());
}

TEST_CASE("a request counts its inputs and outputs by coordinates", "[mpc]") {
  WindowRequest<float> request;
  request.held = {4, 2, 9};
  request.outputs.add_point(1);
  request.outputs.add_centroid({0, 1});
  CHECK(request.inputs() == 9);
  CHECK(request.output_rows() == 6);
}
