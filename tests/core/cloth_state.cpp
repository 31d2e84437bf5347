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

TEST_CASE("supports of one direction add up to one of that direction", "[cloth_state]") {
  using V = Vector3<double>;
  const V up(0, 0.6, 0.8);
  SupportSum<double> sum;
  CHECK(sum.empty());
  sum.add({1, up, 2 * up + V(0.3, 0, 0), 0.004}, 0.5);
  sum.add({2, up, 3 * up, 0.001}, 1.0);
  CHECK_FALSE(sum.empty());
  const VertexSupport<double> support = sum.of(7);
  CHECK(support.vertex == 7);
  CHECK((support.force - (4 * up + V(0.15, 0, 0))).norm() < 1e-15);
  CHECK((support.normal - up).norm() < 1e-15);
  CHECK(support.stiffness() == Approx(0.5 * 2 / 0.004 + 3 / 0.001));
  CHECK(4 / support.stiffness() == Approx(support.release));
}

TEST_CASE("what is held from both sides cannot leave, and keeps its force", "[cloth_state]") {
  using V = Vector3<double>;
  for (const double other : {1.0, 1.0001, 2.5}) {
    SupportSum<double> sum;
    sum.add({0, V(0, 1, 0), V(0, 1, 0.1), 0.001}, 1.0);
    sum.add({0, V(0, -1, 0), V(0, -other, 0.1), 0.001}, 1.0);
    const VertexSupport<double> support = sum.of(0);
    CHECK((support.force - V(0, 1 - other, 0.2)).norm() < 1e-15);
    CHECK(is_unbounded(support.release));
    CHECK(support.stiffness() == 0);
    CHECK(is_unit(support.normal));
  }
  // What hardly presses from the other side does not hold it.
  SupportSum<double> sum;
  sum.add({0, V(0, 1, 0), V(0, 1, 0), 0.001}, 1.0);
  sum.add({0, V(0, -1, 0), V(0, -0.1, 0), 0.001}, 1.0);
  CHECK_FALSE(is_unbounded(sum.of(0).release));
  // Nor does what pulls, or rubs.
  SupportSum<double> pulled;
  pulled.add({0, V(0, 0, 1), V(0.1, 0, -1), 0.001}, 1.0);
  CHECK(is_unbounded(pulled.of(0).release));
  CHECK((pulled.of(0).force - V(0.1, 0, -1)).norm() == 0);
}
