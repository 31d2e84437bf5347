// The energy balance of a step: of a free body against long double, of one with folds, attachments
// and hands against long double, of bodies that hands hold throughout, and of hands that do the
// work.

#include "clothctl/cloth/detail/energy_balance.hpp"

#include <cmath>

#include "clothctl/cloth/mass_spring.hpp"
#include "support/catch.hpp"
#include "support/square_sheets.hpp"

using namespace clothctl;
using clothctl_test::noise;
using clothctl_test::square_sheet;

namespace {

/// `square_sheet` with a hinge at each edge between two triangles.
template <class S>
SpringNetwork<S> hinged_sheet(int n) {
  const GridMesh<S> grid = make_grid<S>(n, n, S(0.3), S(0.3)).value();
  return sheet_network<S>(grid.positions, grid.triangles, Material<S>()).value();
}

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

namespace {

using Long = Vector3<long double>;

/// Folds half of the hinges, holds some vertices and attaches others, one of them to a far point.
template <class S>
void add_folds_and_hands(Step<S>& step) {
  unsigned number = 0;
  for (BendStencil<S>& b : step.network.bends) {
    if (b.count == 4 && ++number % 2 == 0) b.rest_fold = S(0.3 * (number % 7) - 1);
  }
  REQUIRE(number > 20);
  REQUIRE(step.network.validate() == "");
  for (const std::size_t i : {0u, 1u, 8u, 23u, 24u, 40u}) step.ws.held[i] = 1;
  step.ws.attachments.reserve(step.network.vertex_count());
  const detail::Triple<S> zero{S(0), S(0), S(0)};
  step.ws.attachments.items.push_back({12, {S(0.1), S(0.2), S(-0.1)}, S(3), zero});
  step.ws.attachments.items.push_back({30, {S(-1e5), S(2), S(0)}, S(1e-5), zero});
}

Long force_of(const BendStencil<long double>& b, const Points<long double>& x, int i) {
  // Minus the derivative of the energy, by the sixth-order central difference.
  Long out;
  Points<long double> y = x;
  const Index v = b.vertex[static_cast<std::size_t>(i)];
  for (Index c = 0; c < 3; ++c) {
    long double sum = 0;
    const std::array<long double, 3> weight{45.0L, -9.0L, 1.0L};
    for (int k = 1; k <= 3; ++k) {
      for (const int sign : {-1, 1}) {
        y(c, v) = x(c, v) + sign * k * 2e-4L * 0.05L;
        const auto e = detail::bending_error<long double>(b, y);
        sum += sign * weight[static_cast<std::size_t>(k - 1)] * detail::squared_norm(e);
      }
    }
    y(c, v) = x(c, v);
    out[c] = -0.5L * b.stiffness * sum / (60 * 2e-4L * 0.05L);
  }
  return out;
}

}  // namespace

TEMPLATE_TEST_CASE("the balance with folds, hands and attachments is that in long double",
                   "[cloth]", float, double) {
  using S = TestType;
  Step<S> step(hinged_sheet<S>(7), 0.01);
  add_folds_and_hands(step);
  step.network.springs.clear();  // another test has them
  const detail::EnergyBalance<S> balance = step.balance(0);
  const auto network = step.network.template cast<long double>();
  const Points<long double> x0 = step.state.positions.template cast<long double>(),
                            x1 = step.ws.position.template cast<long double>();
  const auto held = [&](int v) { return step.ws.is_held(v); };
  // With the forces at the end of the step; the work of the hands by mean forces may be larger.
  long double end = 0, mean = 0;
  for (const BendStencil<long double>& b : network.bends) {
    int hands = 0;
    for (const int v : b.vertex) hands += held(v) ? 1 : 0;
    if (hands == 4) continue;
    const auto e0 = detail::bending_error<long double>(b, x0),
               e1 = detail::bending_error<long double>(b, x1);
    long double change = 0.5L * b.stiffness * (detail::squared_norm(e1) - detail::squared_norm(e0));
    end += change;
    mean += change;
    const detail::FoldedHinge<long double> start(b, x0), last(b, x1);
    for (int i = 0; i < 4; ++i) {
      const int v = b.vertex[static_cast<std::size_t>(i)];
      if (!held(v)) continue;
      const Long moved = x1.col(v) - x0.col(v);
      end += force_of(b, x1, i).dot(moved);
      const auto pull = b.is_folded() ? start.mean_share(last, i, e0 + e1)
                                      : (e0 + e1) * b.weight[static_cast<std::size_t>(i)];
      mean -= 0.5L * b.stiffness * (pull.x * moved[0] + pull.y * moved[1] + pull.z * moved[2]);
    }
  }
  long double rest = 0;
  for (Index i = 0; i < x0.cols(); ++i) {
    const Long v = step.ws.velocity.col(i).template cast<long double>(),
               v0 = step.state.velocities.col(i).template cast<long double>();
    const long double m = network.mass[i];
    if (held(static_cast<int>(i))) {
      rest -= 0.5L * m * (v - v0).squaredNorm();
      continue;
    }
    rest += 0.5L * m * (v.squaredNorm() - v0.squaredNorm());
    rest -= step.ws.outer.col(i).template cast<long double>().dot(x1.col(i) - x0.col(i));
  }
  for (const auto& item : step.ws.attachments.items) {
    const Long p(item.point.x, item.point.y, item.point.z);
    rest -= static_cast<long double>(item.stiffness) *
            (p - x1.col(item.vertex)).dot(x1.col(item.vertex) - x0.col(item.vertex));
  }
  CHECK(std::abs(mean - end) > 1e-9L);
  const long double expected = rest + std::min(mean, end);
  CHECK(std::abs(balance.created - expected) <= 1e-13L * balance.size);
}

TEST_CASE("the size of a balance bounds the rounding of an attachment to a far point", "[cloth]") {
  Step<double> step(square_sheet<double>(3), 0.01);
  step.network.springs.clear();
  step.network.bends.clear();
  step.ws.attachments.reserve(9);
  for (unsigned seed = 0; seed < 50; ++seed) {
    const double stiffness = 1e6, reach = 1e6;
    step.state = {noise<double>(seed, 9, 1e-9), Points<double>::Zero(3, 9)};
    step.ws.velocity = noise<double>(seed + 100, 9, 1e-3);
    step.ws.outer.setZero();
    step.ws.attachments.items.clear();
    const Points<double> p = noise<double>(seed + 200, 1, reach);
    step.ws.attachments.items.push_back({4, detail::column(p, 0), stiffness, {0, 0, 0}});
    const detail::EnergyBalance<double> balance = step.balance(0);
    const Long x0 = step.state.positions.col(4).cast<long double>(),
               x1 = step.ws.position.col(4).cast<long double>();
    long double expected = -stiffness * (p.col(0).cast<long double>() - x1).dot(x1 - x0);
    for (Index i = 0; i < 9; ++i)
      expected +=
          0.5L * step.network.mass[i] * step.ws.velocity.col(i).cast<long double>().squaredNorm();
    const long double error = std::abs(balance.created - expected);
    CHECK(error <= 2 * scalar_traits<double>::epsilon() * static_cast<long double>(balance.size));
    CHECK(balance.size >= stiffness * p.norm() * 1e-12);
  }
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
