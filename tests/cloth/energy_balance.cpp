// The energy balance of a step: of a free body against long double, of bodies that hands hold
// throughout, and of hands that do the work.

#include "clothctl/cloth/detail/energy_balance.hpp"

#include <cmath>

#include "clothctl/cloth/mass_spring.hpp"
#include "support/catch.hpp"
#include "support/square_sheets.hpp"

using namespace clothctl;
using clothctl_test::noise;
using clothctl_test::square_sheet;

namespace {

/// A step with given velocities at its end.
template <class S>
struct Step {
  SpringNetwork<S> network;
  ClothState<S> state;
  detail::MassSpringWorkspace<S> ws;

  Step(const SpringNetwork<S>& body, double dt) : network(body) {
    const Index n = network.vertex_count();
    state = {network.rest_positions + noise<S>(1, n, 0.02), noise<S>(2, n, 0.5)};
    ws.dt = S(dt);
    ws.held.assign(static_cast<std::size_t>(n), 0);
    ws.direction.setZero(3, static_cast<Index>(network.springs.size()));
    detail::spring_directions<S>(network, state.positions, ws.direction);
    ws.outer = noise<S>(3, n, 0.01);
    ws.velocity = noise<S>(4, n, 0.5);
    ws.position = state.positions;
  }
  detail::EnergyBalance<S> balance(double drag) {
    detail::move_along(state.positions, ws.dt, ws.velocity, ws.position);
    return detail::EnergyBalancer<S>(network, S(drag), state, ws).balance();
  }
};

}  // namespace

TEMPLATE_TEST_CASE("the balance of a free body is its energy less the work of the outer forces",
                   "[cloth]", float, double, long double) {
  using S = TestType;
  Step<S> step(square_sheet<S>(7), 0.01);
  const detail::EnergyBalance<S> balance = step.balance(0.5);
  const auto energy = [&](const Points<S>& x, const Points<S>& v) {
    long double sum = 0;
    for (const Spring<S>& s : step.network.springs) {
      const Vector3<long double> d =
          x.col(s.a).template cast<long double>() - x.col(s.b).template cast<long double>();
      const long double stretch = std::sqrt(d.squaredNorm()) - s.rest_length;
      sum += 0.5L * s.stiffness * stretch * stretch;
    }
    for (const BendStencil<S>& b : step.network.bends) {
      Vector3<long double> c = Vector3<long double>::Zero();
      for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i)
        c += b.weight[i] * x.col(b.vertex[i]).template cast<long double>();
      sum += 0.5L * b.stiffness * c.squaredNorm();
    }
    for (Index i = 0; i < v.cols(); ++i)
      sum += 0.5L * step.network.mass[i] * v.col(i).template cast<long double>().squaredNorm();
    return sum;
  };
  const Points<long double> moved = step.ws.position.template cast<long double>() -
                                    step.state.positions.template cast<long double>();
  const long double work = step.ws.outer.template cast<long double>().cwiseProduct(moved).sum();
  const long double expected = energy(step.ws.position, step.ws.velocity) -
                               energy(step.state.positions, step.state.velocities) - work;
  CHECK(std::abs(balance.created - expected) <= 1e-13L * balance.size);
  CHECK(0 < balance.tension);
}

TEMPLATE_TEST_CASE("hands that move every vertex create no energy", "[cloth]", float, double) {
  using S = TestType;
  Step<S> step(square_sheet<S>(5), 0.05);
  step.ws.held.assign(25, 1);
  // Of ΔE remain the losses: half the square of the change of velocity, the drag, the dampers.
  double lost = 0;
  for (Index i = 0; i < 25; ++i) {
    const Vector3<double> v = step.ws.velocity.col(i).template cast<double>();
    const Vector3<double> v0 = step.state.velocities.col(i).template cast<double>();
    const double m = static_cast<double>(step.network.mass[i]);
    lost += m * (0.5 * (v - v0).squaredNorm() + 0.05 * 2 * v.squaredNorm());
  }
  for (std::size_t e = 0; e < step.network.springs.size(); ++e) {
    const Spring<S>& s = step.network.springs[e];
    const Vector3<double> n = step.ws.direction.col(static_cast<Index>(e)).template cast<double>();
    const Vector3<double> v =
        (step.ws.velocity.col(s.a) - step.ws.velocity.col(s.b)).template cast<double>();
    lost += 0.05 * static_cast<double>(s.damping) * n.dot(v) * n.dot(v);
  }
  const detail::EnergyBalance<S> balance = step.balance(2);
  CHECK(static_cast<double>(balance.created) ==
        Approx(-lost).epsilon(std::is_same_v<S, float> ? 1e-5 : 1e-12));
  CHECK_FALSE(0 < balance.kinetic);
}

TEST_CASE("the work of a hand is the larger one of the two", "[cloth]") {
  // One spring along x, k = 100 N/m and 1 m long. One end is held, the other is free and at rest.
  SpringNetwork<double> network;
  network.mass = VectorX<double>::Ones(2);
  network.rest_positions = Points<double>::Zero(3, 2);
  network.rest_positions(0, 1) = 1;
  network.springs = {{0, 1, 1.0, 100.0, 0.0}};
  const Points<double> rest = network.rest_positions;
  int sideways = 0;
  for (const Vector3<double>& push :
       {Vector3<double>(0.1, 0, 0), Vector3<double>(-0.1, 0, 0), Vector3<double>(0, 0.1, 0)}) {
    CAPTURE(push.transpose());
    Step<double> step(network, 1);
    step.state = {rest, Points<double>::Zero(3, 2)};
    step.state.positions(0, 1) = 0.8;  // compressed
    step.ws.outer.setZero();
    step.ws.velocity.setZero();
    step.ws.velocity.col(0) = push;
    step.ws.held = {1, 0};
    const Vector3<double> d = push - step.state.positions.col(1);
    const double l = d.norm(), gain = 50 * ((l - 1) * (l - 1) - 0.2 * 0.2);
    const double end = (100 * (l - 1) / l * d).dot(push);
    if (end < gain) ++sideways;  // the force falls as the spring turns
    // ΔE: what the spring takes up, less the work and the hand's loss ½ m v².
    CHECK(step.balance(0).created == Approx(gain - std::max(gain, end) - 0.005));
  }
  CHECK(sideways == 1);
}
