#include "clothctl/cloth/detail/step_input.hpp"

#include <functional>
#include <limits>

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class S>
struct Case {
  ClothState<S> state{Points<S>::Random(3, 4), Points<S>::Random(3, 4)};
  ClothInput<S> input;
  S dt = S(0.01);
  std::vector<unsigned char> held = std::vector<unsigned char>(4, 7);

  Case() {
    input.force_vertices = {1, 1, 3};
    input.forces = Points<S>::Random(3, 3);
    input.driven_vertices = {2, 0};
    input.driven_positions = Points<S>::Random(3, 2);
    input.attached_vertices = {3, 3};
    input.attached_positions = Points<S>::Random(3, 2);
    input.attachment_stiffness.setConstant(2, S(5));
  }
  StepStatus validate() { return detail::check_step(state, input, dt, Index(4), held); }
};

template <class S>
StepStatus verdict(const std::function<void(Case<S>&)>& spoil) {
  Case<S> c;
  spoil(c);
  return c.validate();
}

}  // namespace

TEMPLATE_TEST_CASE("a good input passes and marks the driven vertices", "[cloth]", float, double) {
  Case<TestType> c;
  const long before = clothctl_test::allocations();
  const StepStatus status = c.validate();
  const long during = clothctl_test::allocations() - before;
  CHECK(status == StepStatus::Converged);
  CHECK(c.held == std::vector<unsigned char>{1, 0, 1, 0});
  if (clothctl_test::allocation_counting_works()) CHECK(during == 0);
  c.input.clear();
  CHECK(c.validate() == StepStatus::Converged);
  CHECK(c.held == std::vector<unsigned char>{0, 0, 0, 0});
}

TEMPLATE_TEST_CASE("bad inputs and bad states have different statuses", "[cloth]", float, double) {
  using S = TestType;
  using C = Case<S>;
  const S nan = std::numeric_limits<S>::quiet_NaN();
  const S infinity = std::numeric_limits<S>::infinity();
  for (const S bad : {nan, infinity, -infinity}) {
    CHECK(verdict<S>([&](C& c) { c.dt = bad; }) == StepStatus::InvalidInput);
    CHECK(verdict<S>([&](C& c) { c.input.forces(2, 2) = bad; }) == StepStatus::InvalidInput);
    CHECK(verdict<S>([&](C& c) { c.input.driven_positions(0, 1) = bad; }) ==
          StepStatus::InvalidInput);
    CHECK(verdict<S>([&](C& c) { c.input.wind[1] = bad; }) == StepStatus::InvalidInput);
    CHECK(verdict<S>([&](C& c) { c.input.attached_positions(1, 0) = bad; }) ==
          StepStatus::InvalidInput);
    CHECK(verdict<S>([&](C& c) { c.input.attachment_stiffness[1] = bad; }) ==
          StepStatus::InvalidInput);
    CHECK(verdict<S>([&](C& c) { c.state.positions(2, 3) = bad; }) == StepStatus::InvalidState);
    CHECK(verdict<S>([&](C& c) { c.state.velocities(0, 0) = bad; }) == StepStatus::InvalidState);
  }
  CHECK(verdict<S>([](C& c) { c.dt = S(0); }) == StepStatus::InvalidInput);
  CHECK(verdict<S>([](C& c) { c.input.attachment_stiffness[0] = S(0); }) ==
        StepStatus::InvalidInput);
  CHECK(verdict<S>([](C& c) { c.input.attachment_stiffness.resize(1); }) ==
        StepStatus::InvalidInput);
  CHECK(verdict<S>([](C& c) { c.input.attached_vertices.pop_back(); }) == StepStatus::InvalidInput);
  CHECK(verdict<S>([](C& c) { c.dt = S(-0.01); }) == StepStatus::InvalidInput);
  for (const int off : {-1, 4, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()}) {
    CHECK(verdict<S>([&](C& c) { c.input.force_vertices[1] = off; }) == StepStatus::InvalidInput);
    CHECK(verdict<S>([&](C& c) { c.input.driven_vertices[1] = off; }) == StepStatus::InvalidInput);
    CHECK(verdict<S>([&](C& c) { c.input.attached_vertices[0] = off; }) ==
          StepStatus::InvalidInput);
  }
  CHECK(verdict<S>([](C& c) { c.input.driven_vertices[1] = 2; }) == StepStatus::InvalidInput);
  CHECK(verdict<S>([](C& c) { c.input.driven_vertices.push_back(1); }) == StepStatus::InvalidInput);
  CHECK(verdict<S>([](C& c) { c.input.force_vertices.pop_back(); }) == StepStatus::InvalidInput);
  CHECK(verdict<S>([](C& c) { c.state.positions.setZero(3, 5); }) == StepStatus::InvalidState);
  CHECK(verdict<S>([](C& c) { c.state.velocities.setZero(3, 3); }) == StepStatus::InvalidState);
}
