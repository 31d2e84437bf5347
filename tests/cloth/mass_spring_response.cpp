#include "clothctl/cloth/mass_spring_response.hpp"

#include <cmath>
#include <limits>
#include <random>

#include "clothctl/concepts/prediction.hpp"
#include "clothctl/network/rope.hpp"
#include "clothctl/network/sheet.hpp"
#include "laws/step_response_laws.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;
using clothctl_test::multiply;

static_assert(StepResponse<MassSpringResponse<float>> && StepResponse<MassSpringResponse<double>>);

namespace {

template <class S>
Points<S> noise(unsigned seed, Index n, double size) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, size);
  return Points<S>::NullaryExpr(3, n, [&] { return static_cast<S>(normal(random)); });
}

template <class S>
struct Scene {
  SpringNetwork<S> network =
      sheet_network<S>(make_grid<S>(6, 6, S(0.3), S(0.3)).value(), Material<S>()).value();
  MassSpringSettings<S> settings;
  Points<S> x = network.rest_positions + noise<S>(1, 36, 0.003);
  Points<S> v = noise<S>(2, 36, 0.2);
  Vector3<S> wind{S(0.5), S(2), S(-0.3)};
  S dt = S(0.02);
  std::vector<int> driven{35, 3};

  Scene() {
    settings.drag = S(0.7);
    settings.air.normal_coefficient = S(1.1);
    settings.air.tangent_coefficient = S(0.1);
    settings.pinned = {30};
  }
  MassSpring<S> model() const { return MassSpring<S>::create(network, settings).value(); }
};

template <class S>
Lanes<S, 8> lanes(unsigned seed, Index n) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  return Lanes<S, 8>::NullaryExpr(8, 3 * n, [&] { return static_cast<S>(normal(random)); });
}

}  // namespace

TEMPLATE_TEST_CASE("a spring network's response obeys the laws of step responses", "[cloth]", float,
                   double) {
  using S = TestType;
  const Scene<S> scene;
  const S tolerance = std::is_same_v<S, float> ? S(3e-4) : S(1e-11);
  for (const bool bending : {true, false}) {
    ResponseSettings<S> settings;
    settings.bending_in_matrix = bending;
    MassSpringResponse<S> response(scene.model(), settings);
    clothctl_test::check_step_response_laws(response, scene.x, scene.v, scene.wind, scene.dt,
                                            scene.driven, tolerance);
    clothctl_test::check_step_response_laws(response, scene.x, scene.v, scene.wind, scene.dt, {},
                                            tolerance);
  }
  SpringNetwork<S> rope = rope_network(RopeSettings<S>()).value();
  MassSpringResponse<S> response(MassSpring<S>::create(rope).value());
  const Points<S> hanging = S(1.01) * rope.rest_positions;
  clothctl_test::check_step_response_laws(response, hanging, Points<S>(S(0) * hanging), scene.wind,
                                          scene.dt, {0}, tolerance);
}

TEST_CASE(
    "the response predicts a step with one solve, with forces, wind, pins and driven vertices",
    "[cloth]") {
  for (unsigned seed = 0; seed < 20; ++seed) {
    Scene<double> scene;
    scene.x = scene.network.rest_positions + noise<double>(10 + seed, 36, 1e-3 * (1 + seed));
    const MassSpring<double> model = scene.model();
    MassSpringResponse<double> response(model);
    ClothInput<double> input;
    input.wind = scene.wind;
    input.force_vertices = {7, 20};
    input.forces = noise<double>(40 + seed, 2, 0.05);
    input.driven_vertices = scene.driven;
    input.driven_positions.resize(3, 2);
    for (Index i = 0; i < 2; ++i) {
      input.driven_positions.col(i) = scene.x.col(scene.driven[static_cast<std::size_t>(i)]) +
                                      noise<double>(60 + seed, 1, 0.004);
    }
    ClothState<double> state{scene.x, scene.v};
    auto ws = model.make_workspace();
    REQUIRE(model.step(state, input, scene.dt, ws).advanced);

    REQUIRE(response.linearise(scene.x, scene.v, scene.wind, scene.dt, scene.driven));
    CHECK(response.drag() == scene.settings.drag);
    CHECK(response.mass() == scene.network.mass);
    // A (v⁺ - v̂) = M v + h (f + u) - A v̂ with v̂ = v, prescribed where held.
    Points<double> v_hat = scene.v;
    v_hat.col(30).setZero();
    for (Index i = 0; i < 2; ++i) {
      const int held = scene.driven[static_cast<std::size_t>(i)];
      v_hat.col(held) = (input.driven_positions.col(i) - scene.x.col(held)) / scene.dt;
    }
    Points<double> force = response.force();
    for (Index i = 0; i < 2; ++i)
      force.col(input.force_vertices[static_cast<std::size_t>(i)]) += input.forces.col(i);
    Lanes<double, 1> w(1, 108), stiff = w, coupled = w;
    stiff.setZero();
    coupled.setZero();
    Eigen::Map<Points<double>>(w.data(), 3, 36) = v_hat;
    response.multiply(w, stiff, coupled);
    const double inertia = 1 + scene.dt * response.drag();
    for (Index i = 0; i < 36; ++i) {
      const bool held = response.held()[static_cast<std::size_t>(i)] != 0;
      for (Index c = 0; c < 3; ++c) {
        const double m = response.mass()[i];
        const double rhs = m * scene.v(c, i) + scene.dt * force(c, i) - inertia * m * v_hat(c, i) -
                           coupled(0, 3 * i + c);
        w(0, 3 * i + c) = held ? 0.0 : rhs;
      }
    }
    response.solve(w);
    const Points<double> predicted = v_hat + Eigen::Map<const Points<double>>(w.data(), 3, 36);
    CHECK((predicted - state.velocities).cwiseAbs().maxCoeff() <=
          1e-12 * state.velocities.cwiseAbs().maxCoeff());
  }
}

TEST_CASE(
    "where all springs are stretched, K is minus the derivative of the force and R that of a "
    "step's forces",
    "[cloth]") {
  Scene<double> scene;
  scene.x = 1.1 * scene.network.rest_positions + noise<double>(3, 36, 2e-5);
  MassSpringResponse<double> response(scene.model());
  REQUIRE(response.linearise(scene.x, scene.v, scene.wind, scene.dt, {}));
  const Lanes<double, 8> direction = lanes<double>(4, 36);
  const auto [stiff, coupled] = multiply<8>(response, direction);
  const double eps = 1e-6;
  for (Index lane = 0; lane < 8; ++lane) {
    const Eigen::VectorXd row = direction.row(lane).transpose();
    const Points<double> d = Eigen::Map<const Points<double>>(row.data(), 3, 36);
    Points<double> ahead = Points<double>::Zero(3, 36), behind = ahead;
    (void)add_spring_forces<double>(scene.network, scene.x + eps * d, ahead);
    (void)add_spring_forces<double>(scene.network, scene.x - eps * d, behind);
    const Eigen::VectorXd slope = (behind - ahead).reshaped() / (2 * eps);
    CHECK((stiff.row(lane).transpose() - slope).cwiseAbs().maxCoeff() <=
          1e-6 * slope.cwiseAbs().maxCoeff());

    // R w = h (D + C) w + h² K w, where dampers and air forces are linear in w.
    Points<double> slowing = Points<double>::Zero(3, 36);
    for (const Spring<double>& s : scene.network.springs) {
      const Eigen::Vector3d n = (scene.x.col(s.a) - scene.x.col(s.b)).normalized();
      const Eigen::Vector3d f = s.damping * n.dot(d.col(s.a) - d.col(s.b)) * n;
      slowing.col(s.a) += f;
      slowing.col(s.b) -= f;
    }
    for (const std::array<int, 3>& t : scene.network.triangles) {
      const Eigen::Vector3d mean = (scene.v.col(t[0]) + scene.v.col(t[1]) + scene.v.col(t[2])) / 3;
      const Eigen::Matrix3d c =
          air_drag_matrix<double>(scene.x.col(t[0]), scene.x.col(t[1]), scene.x.col(t[2]), mean,
                                  scene.wind, scene.settings.air);
      const Eigen::Vector3d f = c * (d.col(t[0]) + d.col(t[1]) + d.col(t[2])) / 9;
      for (int i : t) slowing.col(i) += f;
    }
    const Eigen::VectorXd expected =
        scene.dt * slowing.reshaped() + scene.dt * scene.dt * stiff.row(lane).transpose();
    CHECK((coupled.row(lane).transpose() - expected).cwiseAbs().maxCoeff() <=
          1e-12 * expected.cwiseAbs().maxCoeff());
  }
}

TEST_CASE("factors and the bending switch change the matrices and not the force", "[cloth]") {
  const Scene<double> scene;
  const Lanes<double, 8> direction = lanes<double>(5, 36);
  const auto stiffness = [&](const ResponseSettings<double>& settings, Points<double>& force) {
    MassSpringResponse<double> response(scene.model(), settings);
    REQUIRE(response.linearise(scene.x, scene.v, scene.wind, scene.dt, scene.driven));
    force = response.force();
    return multiply<8>(response, direction).first;
  };
  Points<double> whole, bare, soft;
  ResponseSettings<double> settings;
  const Lanes<double, 8> plain = stiffness(settings, whole);
  settings.bending_in_matrix = false;
  const Lanes<double, 8> without = stiffness(settings, bare);
  settings.bending_in_matrix = true;
  settings.scale.bending = 0.0;
  const Lanes<double, 8> zero = stiffness(settings, soft);
  CHECK((without - zero).cwiseAbs().maxCoeff() <= 1e-12 * plain.cwiseAbs().maxCoeff());
  CHECK((without - plain).norm() > 1e-6 * plain.norm());
  CHECK(whole == bare);
  CHECK(whole == soft);
  settings.scale = {0.5, 0.5, 0.5};
  CHECK((stiffness(settings, soft) - 0.5 * plain).cwiseAbs().maxCoeff() <=
        1e-12 * plain.cwiseAbs().maxCoeff());
}

TEST_CASE("a response reports whether translations cause no force", "[cloth]") {
  Scene<double> scene;
  MassSpringResponse<double> free(scene.model());
  CHECK(free.translation_free());
  CHECK(MassSpringResponse<float>(scene.model()).translation_free());
  REQUIRE(free.linearise(scene.x, scene.v, scene.wind, scene.dt, {}));
  Lanes<double, 1> w = Lanes<double, 1>::Ones(1, 108);
  CHECK(multiply<1>(free, w).first.cwiseAbs().maxCoeff() <= 1e-10);
  scene.network.bends[5].weight[1] = -1.9;
  MassSpringResponse<double> tied(scene.model());
  CHECK_FALSE(tied.translation_free());
}

TEST_CASE("a change of wind adds the force of the frozen air matrices", "[cloth]") {
  const Scene<double> scene;
  MassSpringResponse<double> response(scene.model());
  REQUIRE(response.linearise(scene.x, scene.v, scene.wind, scene.dt, {}));
  // The force C w is linear in w. Added for the wind itself, it is all of the air force at rest.
  Points<double> push = Points<double>::Zero(3, 36), inner = push;
  response.add_wind_force(scene.wind, push);
  (void)add_spring_forces<double>(scene.network, scene.x, inner);
  const Points<double> weight = scene.settings.gravity * scene.network.mass.transpose();
  CHECK((response.force() - inner - weight - push).cwiseAbs().maxCoeff() <= 1e-12);
  Points<double> twice = push;
  response.add_wind_force(scene.wind, twice);
  CHECK((twice - 2 * push).cwiseAbs().maxCoeff() <= 1e-15);
}

TEST_CASE("a single-precision response of a double model is close to the double one", "[cloth]") {
  const Scene<double> scene;
  const MassSpring<double> model = scene.model();
  MassSpringResponse<double> fine(model);
  MassSpringResponse<float> coarse(model);
  REQUIRE(fine.linearise(scene.x, scene.v, scene.wind, scene.dt, scene.driven));
  REQUIRE(coarse.linearise(scene.x.cast<float>(), scene.v.cast<float>(), scene.wind.cast<float>(),
                           0.02f, scene.driven));
  CHECK(fine.held() == coarse.held());
  CHECK((coarse.force().cast<double>() - fine.force()).cwiseAbs().maxCoeff() <=
        1e-3 * fine.force().cwiseAbs().maxCoeff());
  Lanes<double, 8> a = lanes<double>(6, 36);
  for (Index i = 0; i < 36; ++i) {
    if (fine.held()[static_cast<std::size_t>(i)] != 0) a.middleCols<3>(3 * i).setZero();
  }
  Lanes<float, 8> b = a.cast<float>();
  fine.solve(a);
  coarse.solve(b);
  CHECK((b.cast<double>() - a).cwiseAbs().maxCoeff() <= 1e-3 * a.cwiseAbs().maxCoeff());
}

TEMPLATE_TEST_CASE(
    "a response refuses a state that is not finite, accepts the next good one, and does not "
    "allocate",
    "[cloth]", float, double) {
  using S = TestType;
  const Scene<S> scene;
  MassSpringResponse<S> response(scene.model());
  Lanes<S, 8> w = lanes<S>(7, 36), stiff = w, coupled = w;
  for (const S bad : {std::numeric_limits<S>::quiet_NaN(), std::numeric_limits<S>::infinity()}) {
    Points<S> x = scene.x;
    x(1, 14) = bad;
    CHECK_FALSE(response.linearise(x, scene.v, scene.wind, scene.dt, scene.driven));
  }
  for (const S bad : {S(0), S(-0.01), std::numeric_limits<S>::quiet_NaN()}) {
    CHECK_FALSE(response.linearise(scene.x, scene.v, scene.wind, bad, scene.driven));
    CHECK_FALSE(response.linearise(scene.x, scene.v,
                                   {S(0), std::numeric_limits<S>::infinity(), S(0)}, scene.dt, {}));
  }
  Points<S> crushed = scene.x;
  crushed.setConstant(S(0.3));  // no spring has a direction
  CHECK(response.linearise(crushed, scene.v, scene.wind, scene.dt, scene.driven));
  CHECK(all_finite(response.force()));
  const long before = clothctl_test::allocations();
  const bool definite = response.linearise(scene.x, scene.v, scene.wind, scene.dt, scene.driven);
  response.multiply(w, stiff, coupled);
  response.solve(w);
  const long during = clothctl_test::allocations() - before;
  CHECK(definite);
  if (clothctl_test::allocation_counting_works()) CHECK(during == 0);
}

TEST_CASE("a response refuses blocks of another size", "[cloth]") {
  const Scene<double> scene;
  MassSpringResponse<double> response(scene.model());
  REQUIRE(response.linearise(scene.x, scene.v, scene.wind, scene.dt, scene.driven));
  for (const double dt : {-0.02, 0.0, std::nan("")})
    CHECK_FALSE(response.linearise(scene.x, scene.v, scene.wind, dt, scene.driven));
  REQUIRE(response.linearise(scene.x, scene.v, scene.wind, scene.dt, scene.driven));
  for (const Index n : {Index(0), Index(35), Index(37)}) {
    Lanes<double, 8> right = Lanes<double, 8>::Zero(8, 3 * 36), a = right, b = right;
    Lanes<double, 8> wrong = Lanes<double, 8>::Constant(8, 3 * n, 2.0);
    const Lanes<double, 8> before = wrong;
    CHECK_FALSE(response.solve(wrong));
    CHECK_FALSE(response.multiply(wrong, a, b));
    CHECK_FALSE(response.multiply(right, wrong, b));
    CHECK_FALSE(response.multiply(right, a, wrong));
    CHECK(wrong == before);
    CHECK_FALSE(response.multiply(right, right, b));
    CHECK_FALSE(response.multiply(right, a, a));
    CHECK(response.multiply(right, a, b));
    Points<double> out = Points<double>::Zero(3, n);
    CHECK_FALSE(response.add_wind_force({1.0, 0.0, 0.0}, out));
    CHECK(out.isZero(0.0));
  }
}
