#include "clothctl/core/cloth_state.hpp"

#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

template <class Scalar>
ClothState<Scalar> sample_state() {
  ClothState<Scalar> state;
  state.positions = Points<Scalar>::Constant(3, 4, Scalar(0.25));
  state.velocities = Points<Scalar>::Constant(3, 4, Scalar(-1));
  return state;
}

}  // namespace

TEMPLATE_TEST_CASE("a state is a value: it copies and compares", "[cloth_state]", float, double) {
  const ClothState<TestType> state = sample_state<TestType>();
  ClothState<TestType> copy = state;
  CHECK(copy == state);
  copy.positions(1, 2) += TestType(1e-3);
  CHECK_FALSE(copy == state);
  CHECK(state.positions(1, 2) == TestType(0.25));
  copy = state;
  copy.velocities(0, 3) = TestType(0);
  CHECK_FALSE(copy == state);
}

TEST_CASE("states of different sizes compare as different without reading beyond their memory",
          "[cloth_state]") {
  const ClothState<double> state = sample_state<double>();
  ClothState<double> shorter = state;
  shorter.positions.conservativeResize(3, 3);
  CHECK_FALSE(shorter == state);
  shorter.velocities.conservativeResize(3, 3);
  CHECK_FALSE(shorter == state);
  CHECK_FALSE(state == ClothState<double>{});
  CHECK(ClothState<double>{} == ClothState<double>{});
}

TEST_CASE("a default input has no effect", "[cloth_state]") {
  const ClothInput<double> input;
  CHECK(input.force_vertices.empty());
  CHECK(input.driven_vertices.empty());
  CHECK(input.forces.cols() == 0);
  CHECK(input.driven_positions.cols() == 0);
  CHECK(input.wind == Vector3<double>::Zero());
  CHECK(input.attached_vertices.empty());
  CHECK(input.attached_positions.cols() == 0);
  CHECK(input.attachment_stiffness.size() == 0);
}

TEMPLATE_TEST_CASE("clear empties an input and keeps the memory of its lists", "[cloth_state]",
                   float, double) {
  ClothInput<TestType> input;
  input.force_vertices = {1, 1, 3};
  input.forces = Points<TestType>::Ones(3, 3);
  input.driven_vertices = {0, 2};
  input.driven_positions = Points<TestType>::Ones(3, 2);
  input.wind = Vector3<TestType>::Ones();
  input.attached_vertices = {1, 2};
  input.attached_positions = Points<TestType>::Ones(3, 2);
  input.attachment_stiffness = VectorX<TestType>::Ones(2);
  const std::size_t capacity = input.force_vertices.capacity();
  input.clear();
  CHECK(input.force_vertices.empty());
  CHECK(input.driven_vertices.empty());
  CHECK(input.forces.cols() == 0);
  CHECK(input.driven_positions.cols() == 0);
  CHECK(input.wind == Vector3<TestType>::Zero());
  CHECK(input.force_vertices.capacity() == capacity);
}

TEST_CASE("assigning a state of equal size does not allocate", "[cloth_state]") {
  if (!clothctl_test::allocation_counting_works()) {
    WARN("allocations cannot be counted in this build");
    return;
  }
  const ClothState<double> state = sample_state<double>();
  ClothState<double> copy = state;
  copy.positions.setZero();
  const long before = clothctl_test::allocations();
  copy = state;
  const bool same = copy == state;
  const long during = clothctl_test::allocations() - before;
  CHECK(during == 0);
  CHECK(same);
}
