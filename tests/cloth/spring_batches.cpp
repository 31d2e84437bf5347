// Gradient and matrix of springs in batches, compared with those of the springs one by one.

#include "clothctl/cloth/detail/spring_batches.hpp"

#include <random>

#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

// 6 × 5 vertices have 99 springs, which is no multiple of a batch.
template <class S>
struct Scene {
  SpringNetwork<S> network =
      sheet_network<S>(make_grid<S>(6, 5, S(0.3), S(0.4)).value(), Material<S>()).value();
  SpringPattern<S> pattern{network, BendingBlocks::Absent, false};
  Points<S> start = network.rest_positions + noise(1, 0.004), end = start + noise(2, 0.004),
            velocity = noise(3, 0.3), direction, gradient;
  BlockSymmetric<S> matrix = pattern.matrix();
  S h = S(0.02);

  Points<S> noise(unsigned seed, double size) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0.0, size);
    return Points<S>::NullaryExpr(3, network.vertex_count(),
                                  [&] { return static_cast<S>(normal(random)); });
  }
  template <class Compressed>
  void evaluate(const Compressed& compressed) {
    const SpringBatches<S> batches(network, pattern.matrix(), compressed);
    direction.setZero(3, batches.direction_columns());
    batches.set_directions(start, direction);
    gradient.setZero(3, network.vertex_count());
    matrix.set_zero();
    batches.add_step(false, end, velocity, direction, h, gradient, matrix);
  }
};

template <class S>
S largest_difference(const BlockSymmetric<S>& a, const BlockSymmetric<S>& b) {
  S largest = S(0);
  for (Index i = 0; i < a.rows(); ++i)
    largest = std::max(largest, (a.diagonal(i) - b.diagonal(i)).cwiseAbs().maxCoeff());
  for (Index slot = 0; slot < a.lower_count(); ++slot)
    largest = std::max(largest, (a.lower(slot) - b.lower(slot)).cwiseAbs().maxCoeff());
  return largest;
}

}  // namespace

TEMPLATE_TEST_CASE("springs in batches add what they add one by one", "[cloth]", float, double) {
  using S = TestType;
  Scene<S> scene;
  scene.evaluate([](const Spring<S>&) { return S(1); });
  REQUIRE(scene.network.springs.size() % 16 != 0);

  Points<S> direction(3, static_cast<Index>(scene.network.springs.size()));
  spring_directions<S>(scene.network, scene.start, direction);
  BlockSymmetric<S> matrix = scene.pattern.matrix();
  scene.pattern.add_springs(scene.network, scene.end, {}, scene.h * scene.h, matrix);
  scene.pattern.add_frozen(scene.network, direction, {}, scene.h, matrix);
  scene.network.bends.clear();
  Points<S> forces = Points<S>::Zero(3, scene.network.vertex_count());
  add_spring_forces<S>(scene.network, scene.end, forces);
  Points<S> gradient = -scene.h * forces;
  for (std::size_t e = 0; e < scene.network.springs.size(); ++e) {
    const Spring<S>& s = scene.network.springs[e];
    const Vector3<S> n = direction.col(static_cast<Index>(e));
    const S rate = n.dot(scene.velocity.col(s.a) - scene.velocity.col(s.b));
    gradient.col(s.a) += scene.h * s.damping * rate * n;
    gradient.col(s.b) -= scene.h * s.damping * rate * n;
  }
  const S tolerance = std::is_same_v<S, float> ? S(3e-5) : S(1e-13);
  CHECK(largest_difference(scene.matrix, matrix) < tolerance);
  CHECK((scene.gradient - gradient).cwiseAbs().maxCoeff() < tolerance);

  const SpringBatches<S> batches(scene.network, scene.pattern.matrix(),
                                 [](const Spring<S>&) { return S(1); });
  Points<S> alone = Points<S>::Zero(3, scene.network.vertex_count());
  batches.add_gradient(false, scene.end, scene.velocity, scene.direction, scene.h, alone);
  CHECK(alone == scene.gradient);

  // Linearised: impulses without velocities, and the matrix times the velocities.
  const Index n = scene.network.vertex_count();
  const Points<S> zero = Points<S>::Zero(3, n);
  Points<S> still = zero, linear = zero, step = zero;
  batches.add_gradient(false, scene.end, zero, scene.direction, scene.h, still);
  batches.add_gradient(true, scene.end, scene.velocity, scene.direction, scene.h, linear);
  const Lanes<S, 1> v = scene.velocity.reshaped().transpose();
  Lanes<S, 1> product = Lanes<S, 1>::Zero(1, 3 * n);
  scene.matrix.template multiply<1>(v, product);
  CHECK((linear - still - product.reshaped(3, n)).cwiseAbs().maxCoeff() < tolerance);
  BlockSymmetric<S> again = scene.pattern.matrix();
  batches.add_step(true, scene.end, scene.velocity, scene.direction, scene.h, step, again);
  CHECK(step == linear);
  CHECK(largest_difference(again, scene.matrix) == S(0));
}

TEST_CASE("compressed springs keep the part of their stiffness that they are given", "[cloth]") {
  Scene<double> whole, half;
  for (Scene<double>* scene : {&whole, &half}) {
    for (Spring<double>& s : scene->network.springs) s.damping = 0;
    scene->end = 0.9 * scene->network.rest_positions;  // every spring is a tenth too short
  }
  whole.evaluate([](const Spring<double>&) { return 1.0; });
  half.evaluate([](const Spring<double>&) { return 0.5; });
  CHECK((half.gradient - 0.5 * whole.gradient).cwiseAbs().maxCoeff() < 1e-15);
  BlockSymmetric<double> scaled = whole.pattern.matrix();
  scaled.add_scaled(whole.matrix, 0.5);
  CHECK(largest_difference(half.matrix, scaled) < 1e-15);
  // Stretched, they have all of it.
  whole.end = half.end = 1.1 * whole.network.rest_positions;
  whole.evaluate([](const Spring<double>&) { return 1.0; });
  half.evaluate([](const Spring<double>&) { return 0.5; });
  CHECK(half.gradient == whole.gradient);
}

TEST_CASE("springs whose ends coincide stay finite", "[cloth]") {
  Scene<float> scene;
  scene.start.setZero();
  scene.end.setZero();
  scene.evaluate([](const Spring<float>&) { return 1.0f; });
  CHECK(all_finite(scene.gradient));
  for (Index i = 0; i < scene.matrix.rows(); ++i) CHECK(all_finite(scene.matrix.diagonal(i)));
}
