#include "clothctl/cloth/mass_spring.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <limits>
#include <random>
#include <sstream>
#include <string>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include "clothctl/concepts/cloth.hpp"
#include "clothctl/network/rope.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/network/solid.hpp"
#include "laws/cloth_laws.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/shared_data.hpp"

using namespace clothctl;
using namespace clothctl::detail;

static_assert(ClothModel<MassSpring<double>> && ClothModel<MassSpring<float>, float>);
static_assert(!ClothModel<MassSpring<float>, double>);

namespace {

template <class S>
MassSpring<S> make(const SpringNetwork<S>& network, const MassSpringSettings<S>& settings = {}) {
  Result<MassSpring<S>> made = MassSpring<S>::create(network, settings);
  INFO((made ? std::string() : made.error()));
  REQUIRE(made);
  return std::move(made).value();
}

template <class S>
SpringNetwork<S> sheet(int n = 6, double size = 0.3) {
  return sheet_network<S>(make_grid<S>(n, n, S(size), S(size)).value(), Material<S>()).value();
}

template <class S>
SpringNetwork<S> ball() {
  const auto mesh = make_ball<S>(S(0.05), 2, Vector3<S>::Zero());
  return solid_network<S>(mesh.value(), SolidSettings<S>()).value();
}

template <class S>
void undamp(SpringNetwork<S>& network) {
  for (Spring<S>& s : network.springs) s.damping = S(0);
}

Points<double> noise(unsigned seed, Index n, double size) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, size);
  return Points<double>::NullaryExpr(3, n, [&] { return normal(random); });
}

template <class S>
bool same_bits(const ClothState<S>& a, const ClothState<S>& b) {
  const auto same = [](const Points<S>& p, const Points<S>& q) {
    return p.cols() == q.cols() &&
           std::memcmp(p.data(), q.data(), sizeof(S) * static_cast<std::size_t>(p.size())) == 0;
  };
  return same(a.positions, b.positions) && same(a.velocities, b.velocities);
}

// Forces of springs and stencils, written again from the header's formulas.
Points<double> elastic_forces(const SpringNetwork<double>& network, const Points<double>& x) {
  Points<double> f = Points<double>::Zero(3, x.cols());
  for (const Spring<double>& s : network.springs) {
    const Eigen::Vector3d d = x.col(s.a) - x.col(s.b);
    const Eigen::Vector3d pull = s.stiffness * (d.norm() - s.rest_length) * d.normalized();
    f.col(s.a) -= pull;
    f.col(s.b) += pull;
  }
  for (const BendStencil<double>& b : network.bends) {
    Eigen::Vector3d c = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i)
      c += b.weight[i] * x.col(b.vertex[i]);
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i)
      f.col(b.vertex[i]) -= b.stiffness * b.weight[i] * c;
  }
  return f;
}

// All forces at positions x and velocities v, with dampers and air matrices of x0 and v0.
Points<double> all_forces(const MassSpring<double>& model, const Points<double>& x,
                          const Points<double>& v, const Points<double>& x0,
                          const Points<double>& v0, const ClothInput<double>& input) {
  const SpringNetwork<double>& network = model.network();
  Points<double> f =
      elastic_forces(network, x) + model.settings().gravity * network.mass.transpose();
  for (const Spring<double>& s : network.springs) {
    const Eigen::Vector3d n = (x0.col(s.a) - x0.col(s.b)).normalized();
    const Eigen::Vector3d pull = s.damping * n.dot(v.col(s.a) - v.col(s.b)) * n;
    f.col(s.a) -= pull;
    f.col(s.b) += pull;
  }
  for (const std::array<int, 3>& t : network.triangles) {
    const Eigen::Vector3d mean0 = (v0.col(t[0]) + v0.col(t[1]) + v0.col(t[2])) / 3;
    const Eigen::Vector3d mean = (v.col(t[0]) + v.col(t[1]) + v.col(t[2])) / 3;
    const Eigen::Matrix3d c = air_drag_matrix<double>(x0.col(t[0]), x0.col(t[1]), x0.col(t[2]),
                                                      mean0, input.wind, model.settings().air);
    for (int i : t) f.col(i) += c * (input.wind - mean) / 3;
  }
  for (Index i = 0; i < x.cols(); ++i)
    f.col(i) -= model.settings().drag * network.mass[i] * v.col(i);
  for (std::size_t i = 0; i < input.force_vertices.size(); ++i)
    f.col(input.force_vertices[i]) += input.forces.col(static_cast<Index>(i));
  return f;
}

double energy(const MassSpring<double>& model, const ClothState<double>& state) {
  const SpringNetwork<double>& network = model.network();
  double sum = spring_energy<double>(network, state.positions);
  for (Index i = 0; i < network.vertex_count(); ++i) {
    sum += network.mass[i] * (0.5 * state.velocities.col(i).squaredNorm() -
                              model.settings().gravity.dot(state.positions.col(i)));
  }
  return sum;
}

// A crumpled, moving sheet with a pin and one driven vertex, in wind and under forces.
struct Scene {
  MassSpringSettings<double> settings;
  SpringNetwork<double> network = sheet<double>();
  ClothState<double> state;
  ClothInput<double> input;
  double dt = 0.02;

  Scene() {
    settings.drag = 0.7;
    settings.air.normal_coefficient = 1.1;
    settings.air.tangent_coefficient = 0.1;
    settings.pinned = {30};
    state = {network.rest_positions + noise(1, 36, 0.003), noise(2, 36, 0.2)};
    input.wind = {0.5, 2.0, -0.3};
    input.force_vertices = {3, 17, 3};
    input.forces = noise(3, 3, 0.02);
    input.driven_vertices = {35};
    input.driven_positions = state.positions.col(35) + Eigen::Vector3d(0.004, -0.002, 0.003);
  }
};

std::vector<std::vector<double>> read_numbers(const std::string& path) {
  std::vector<std::vector<double>> rows;
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);  // header
  while (std::getline(file, line)) {
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream in(line);
    rows.emplace_back();
    for (double value; in >> value;) rows.back().push_back(value);
  }
  return rows;
}

}  // namespace

TEMPLATE_TEST_CASE("sheets, ropes and solids obey the laws of cloth with one solve and with Newton",
                   "[cloth]", float, double) {
  using S = TestType;
  const std::vector<SpringNetwork<S>> networks{sheet<S>(), rope_network(RopeSettings<S>()).value(),
                                               ball<S>()};
  for (std::size_t which = 0; which < networks.size(); ++which) {
    for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
      for (const bool held : {false, true}) {
        CAPTURE(which, integration, held);
        MassSpringSettings<S> settings;
        settings.integration = integration;
        settings.drag = held ? S(0.5) : S(0);
        if (held) settings.pinned = {0, 2};
        if (held) settings.air.normal_coefficient = S(1);
        // Newton converges far below the tolerance of the laws: to rounding in double, to the
        // rounding of forces in float.
        settings.velocity_tolerance = std::is_same_v<S, float> ? S(1e-4) : S(1e-11);
        clothctl_test::ClothLaws<S> laws;
        laws.mass = networks[which].mass;
        laws.drag = settings.drag;
        laws.pinned = settings.pinned;
        laws.momentum_known = !held;
        if (std::is_same_v<S, float>)
          laws.tolerance = S(3e-3);  // k ε |x| h / m: the rounding of a spring's force
        clothctl_test::check_cloth_laws(make(networks[which], settings), laws);
      }
    }
  }
}

TEST_CASE("a step with one solve solves the header's linear system", "[cloth]") {
  const Scene scene;
  const MassSpring<double> model = make(scene.network, scene.settings);
  auto ws = model.make_workspace();
  ClothState<double> state = scene.state;
  const StepReport<double> report = model.step(state, scene.input, scene.dt, ws);
  CHECK(report.status == StepStatus::Converged);
  CHECK(report.iterations == 1);

  // A = (1 + h α) M + h (D + C) + h² K, dense, from the formulas.
  const Points<double>&x = scene.state.positions, &v = scene.state.velocities;
  const Index n = x.cols();
  const double h = scene.dt;
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(3 * n, 3 * n);
  const auto add = [&](int i, int j, const Eigen::Matrix3d& block) {
    a.block<3, 3>(3 * i, 3 * j) += block;
  };
  for (const Spring<double>& s : scene.network.springs) {
    const Eigen::Vector3d d = x.col(s.a) - x.col(s.b);
    const Eigen::Matrix3d along = d * d.transpose() / d.squaredNorm();
    const double tension = std::max(0.0, 1 - s.rest_length / d.norm());
    const Eigen::Matrix3d block =
        (h * h * s.stiffness + h * s.damping) * along +
        h * h * s.stiffness * tension * (Eigen::Matrix3d::Identity() - along);
    add(s.a, s.a, block);
    add(s.b, s.b, block);
    add(s.a, s.b, -block);
    add(s.b, s.a, -block);
  }
  for (const BendStencil<double>& b : scene.network.bends) {
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) {
        add(b.vertex[i], b.vertex[j],
            h * h * b.stiffness * b.weight[i] * b.weight[j] * Eigen::Matrix3d::Identity());
      }
    }
  }
  for (const std::array<int, 3>& t : scene.network.triangles) {
    const Eigen::Vector3d mean = (v.col(t[0]) + v.col(t[1]) + v.col(t[2])) / 3;
    const Eigen::Matrix3d c = air_drag_matrix<double>(x.col(t[0]), x.col(t[1]), x.col(t[2]), mean,
                                                      scene.input.wind, scene.settings.air);
    for (int i : t) {
      for (int j : t) add(i, j, h / 9 * c);
    }
  }
  for (Index i = 0; i < n; ++i)
    a.diagonal().segment<3>(3 * i).array() += (1 + h * scene.settings.drag) * scene.network.mass[i];
  // Forces without dampers, drag and air's dependence on v: those are in A.
  const Points<double> still = Points<double>::Zero(3, n);
  Points<double> b = h * all_forces(model, x, still, x, v, scene.input);
  for (Index i = 0; i < n; ++i) b.col(i) += scene.network.mass[i] * v.col(i);
  // Pin and driven vertex are eliminated.
  Eigen::VectorXd rhs = b.reshaped();
  const Eigen::Vector3d driven = (scene.input.driven_positions.col(0) - x.col(35)) / h;
  rhs -= a.middleCols<3>(3 * 35) * driven;
  for (int held : {30, 35}) {
    a.middleCols<3>(3 * held).setZero();
    a.middleRows<3>(3 * held).setZero();
    a.block<3, 3>(3 * held, 3 * held).setIdentity();
    rhs.segment<3>(3 * held) = held == 35 ? driven : Eigen::Vector3d(0, 0, 0);
  }
  const Eigen::VectorXd expected = a.llt().solve(rhs);
  CHECK((state.velocities.reshaped() - expected).cwiseAbs().maxCoeff() <=
        1e-11 * expected.cwiseAbs().maxCoeff());
  CHECK((state.positions - x - h * state.velocities).cwiseAbs().maxCoeff() <= 1e-15);
}

TEST_CASE("a Newton step satisfies M (v - v0) = h f(x0 + h v, v) to its tolerance", "[cloth]") {
  for (const double tolerance : {0.0, 1e-9}) {
    for (const double size : {0.001, 0.01}) {  // slightly and badly crumpled
      Scene scene;
      scene.state.positions = scene.network.rest_positions + noise(4, 36, size);
      scene.input.driven_positions =
          scene.state.positions.col(35) + Eigen::Vector3d(0.004, -0.002, 0.003);
      scene.settings.integration = Integration::Newton;
      scene.settings.velocity_tolerance = tolerance;
      const MassSpring<double> model = make(scene.network, scene.settings);
      auto ws = model.make_workspace();
      ClothState<double> state = scene.state;
      const StepReport<double> report = model.step(state, scene.input, scene.dt, ws);
      REQUIRE(report.status == StepStatus::Converged);
      CHECK(report.iterations > 1);
      const Points<double> f =
          all_forces(model, scene.state.positions + scene.dt * state.velocities, state.velocities,
                     scene.state.positions, scene.state.velocities, scene.input);
      const double allowed =
          0 < tolerance ? tolerance : 2 * std::cbrt(std::numeric_limits<double>::epsilon());
      double worst = 0;
      for (Index i = 0; i < 36; ++i) {
        if (i == 30 || i == 35) continue;
        const Eigen::Vector3d residual =
            scene.network.mass[i] * (state.velocities.col(i) - scene.state.velocities.col(i)) -
            scene.dt * f.col(i);
        CHECK(residual.cwiseAbs().maxCoeff() <= 1.01 * allowed * scene.network.mass[i]);
        worst = std::max(worst, residual.cwiseAbs().maxCoeff());
      }
      CHECK(report.residual == Approx(worst).margin(1e-14));
    }
  }
}

// The sum of the magnitudes that internal forces add up from, N.
double force_magnitudes(const SpringNetwork<double>& network, const Points<double>& x) {
  double sum = 0;
  for (const Spring<double>& s : network.springs)
    sum += 2 * s.stiffness * std::abs((x.col(s.a) - x.col(s.b)).norm() - s.rest_length);
  for (const BendStencil<double>& b : network.bends) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(b.count); ++i)
      for (std::size_t j = 0; j < static_cast<std::size_t>(b.count); ++j)
        sum += b.stiffness * std::abs(b.weight[i] * b.weight[j]) * x.col(b.vertex[j]).norm();
  }
  return sum;
}

TEST_CASE(
    "Newton steps conserve linear momentum, and change angular momentum as implicit Euler does",
    "[cloth]") {
  // Internal forces add up to zero, and so do their torques x⁺ × f(x⁺). So with the residual
  // r = m (v⁺ - v0) - h f of each vertex, linear momentum changes by Σ r and Σ m x⁺ × (v⁺ - v0) is
  // Σ x⁺ × r; the change of Σ m x × v is h Σ m v⁺ × v0 more. Newton ends when each entry of r is
  // less than m times the tolerance, or, at the lower one here, when rounding stops it. Then r is
  // the rounding of what it adds up from; no sum here has more than 36 terms.
  SpringNetwork<double> network = sheet<double>();
  undamp(network);
  MassSpringSettings<double> settings;
  settings.gravity.setZero();
  settings.integration = Integration::Newton;
  const double dt = 0.01, rounding = 36 * std::numeric_limits<double>::epsilon();
  for (const bool tight : {false, true}) {
    settings.velocity_tolerance = tight ? 1e-13 : 1e-10;
    const double allowed = tight ? 0 : std::sqrt(3.0) * settings.velocity_tolerance;
    const MassSpring<double> model = make(network, settings);
    auto ws = model.make_workspace();
    ClothState<double> state{network.rest_positions + noise(5, 36, 0.002), noise(6, 36, 0.1)};
    for (Index i = 0; i < 36; ++i)
      state.velocities.col(i) += Eigen::Vector3d(1, 3, -2).cross(state.positions.col(i));
    const auto angular = [&](const ClothState<double>& s) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (Index i = 0; i < 36; ++i)
        sum += network.mass[i] * s.positions.col(i).cross(s.velocities.col(i));
      return sum;
    };
    const Eigen::Vector3d linear = state.velocities * network.mass;
    double bound = 0;
    for (int k = 0; k < 20; ++k) {
      const ClothState<double> before = state;
      REQUIRE(model.step(state, {}, dt, ws).status == StepStatus::Converged);
      const double momenta = network.mass.dot(before.velocities.colwise().norm()) +
                             network.mass.dot(state.velocities.colwise().norm());
      const double far = state.positions.colwise().norm().maxCoeff();
      const double change = allowed * network.mass.sum() +
                            rounding * (momenta + dt * force_magnitudes(network, state.positions));
      bound += change;
      CHECK((state.velocities * network.mass - linear).norm() <= bound);
      Eigen::Vector3d loss = Eigen::Vector3d::Zero();
      for (Index i = 0; i < 36; ++i)
        loss += network.mass[i] * dt * state.velocities.col(i).cross(before.velocities.col(i));
      CHECK((angular(state) - angular(before) - loss).norm() <= far * change);
    }
  }
}

TEST_CASE("without input, the energy of a swinging rope or sheet never grows under Newton",
          "[cloth]") {
  RopeSettings<double> rope;
  rope.segments = 12;
  for (SpringNetwork<double> network : {rope_network(rope).value(), sheet<double>()}) {
    for (const bool damped : {false, true}) {
      if (!damped) undamp(network);
      const int n = static_cast<int>(network.vertex_count());
      MassSpringSettings<double> settings;
      settings.integration = Integration::Newton;
      settings.velocity_tolerance = 1e-9;
      settings.pinned = n == 13 ? std::vector<int>{0} : std::vector<int>{30, 35};
      const MassSpring<double> model = make(network, settings);
      auto ws = model.make_workspace();
      ClothState<double> state = model.rest_state();
      // Starts horizontally, so that it swings down.
      for (Index i = 0; i < n; ++i)
        state.positions.col(i) = Eigen::Vector3d(state.positions(0, i), -state.positions(2, i), 0);
      double last = energy(model, state);
      const double first = last;
      for (int k = 0; k < 100; ++k) {
        REQUIRE(model.step(state, {}, 0.01, ws).status == StepStatus::Converged);
        const double now = energy(model, state);
        CHECK(now <= last + 1e-9 * std::abs(first - last) + 1e-10);
        last = now;
      }
      CHECK(last < first - 1e-3);
    }
  }
}

TEST_CASE("both integrations converge to the motion of a chain with order one", "[cloth]") {
  RopeSettings<double> rope;
  rope.segments = 5;
  rope.stretch = 3.0;  // soft, so that the steps resolve its oscillations
  rope.bending = 1e-5;
  const SpringNetwork<double> network = rope_network(rope).value();
  MassSpringSettings<double> settings;
  settings.pinned = {0};
  settings.drag = 0.3;
  settings.velocity_tolerance = 1e-10;
  MassSpring<double> model = make(network, settings);
  ClothState<double> start = model.rest_state();
  for (Index i = 0; i < 6; ++i)
    start.positions.col(i) =
        1.05 * Eigen::Vector3d(-start.positions(2, i), 0, 0.3 * start.positions(2, i));

  // The classical fourth-order Runge-Kutta method for ẍ = f/m, with dampers along the current
  // directions.
  const double time = 0.4;
  ClothState<double> truth = start;
  const auto rate = [&](const ClothState<double>& s) {
    Points<double> a = all_forces(model, s.positions, s.velocities, s.positions, s.velocities, {});
    for (Index i = 0; i < 6; ++i) a.col(i) /= network.mass[i];
    a.col(0).setZero();
    return ClothState<double>{s.velocities, a};
  };
  const auto moved = [](const ClothState<double>& s, const ClothState<double>& r, double h) {
    return ClothState<double>{s.positions + h * r.positions, s.velocities + h * r.velocities};
  };
  const int fine = 8000;
  for (int k = 0; k < fine; ++k) {
    const double h = time / fine;
    const ClothState<double> a = rate(truth), b = rate(moved(truth, a, h / 2)),
                             c = rate(moved(truth, b, h / 2)), d = rate(moved(truth, c, h));
    truth = moved(moved(moved(moved(truth, a, h / 6), b, h / 3), c, h / 3), d, h / 6);
  }
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    CAPTURE(integration);
    model.set_integration(integration);
    auto ws = model.make_workspace();
    std::vector<double> error;
    for (const int steps : {1000, 2000, 4000}) {
      ClothState<double> state = start;
      for (int k = 0; k < steps; ++k)
        REQUIRE(model.step(state, {}, time / steps, ws).status == StepStatus::Converged);
      error.push_back((state.positions - truth.positions).norm());
    }
    CHECK(error[2] <= 2e-3);
    CHECK(error[0] / error[1] == Approx(2.0).epsilon(0.1));
    CHECK(error[1] / error[2] == Approx(2.0).epsilon(0.05));
  }
}

TEST_CASE("one solve and Newton settle at the same equilibrium, where all forces vanish",
          "[cloth]") {
  SpringNetwork<double> network = sheet<double>();
  MassSpringSettings<double> settings;
  settings.pinned = {30, 31, 32,
                     33, 34, 35};  // a taut upper edge, so that there is one equilibrium
  settings.drag = 10.0;
  std::vector<ClothState<double>> rest;
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    settings.integration = integration;
    settings.velocity_tolerance = 1e-12;
    const MassSpring<double> model = make(network, settings);
    auto ws = model.make_workspace();
    ClothState<double> state = model.rest_state();
    state.positions += noise(7, 36, 1e-4);
    for (int v : settings.pinned) state.positions.col(v) = network.rest_positions.col(v);
    for (int k = 0; k < 3000; ++k) REQUIRE(model.step(state, {}, 0.02, ws).advanced);
    const Points<double> f =
        all_forces(model, state.positions, state.velocities, state.positions, state.velocities, {});
    CHECK(f.leftCols(30).cwiseAbs().maxCoeff() <= 1e-9);
    rest.push_back(state);
  }
  CHECK((rest[0].positions - rest[1].positions).cwiseAbs().maxCoeff() <= 1e-7);
  CHECK(rest[0].positions(2, 0) < network.rest_positions(2, 0));  // stretched by its weight
}

TEST_CASE("a free sheet falls at the terminal speed of its drag and drifts with the wind",
          "[cloth]") {
  const SpringNetwork<double> network = sheet<double>();
  MassSpringSettings<double> settings;
  settings.drag = 2.0;
  const MassSpring<double> model = make(network, settings);
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  for (int k = 0; k < 1000; ++k) REQUIRE(model.step(state, {}, 0.02, ws).advanced);
  const Eigen::Vector3d fall = state.velocities * network.mass / network.mass.sum();
  CHECK((fall - Eigen::Vector3d(0, 0, -9.81 / 2.0)).norm() <= 1e-6);

  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    MassSpringSettings<double> airy;
    airy.integration = integration;
    airy.gravity.setZero();
    airy.air.normal_coefficient = 1.2;
    airy.air.tangent_coefficient =
        1.2;  // equal coefficients: the force depends only on w - v, which falls like 1/t
    const MassSpring<double> kite = make(network, airy);
    auto kite_ws = kite.make_workspace();
    ClothState<double> s = kite.rest_state();
    ClothInput<double> input;
    input.wind = {0.0, 3.0, 0.0};
    // Flat in the wind, all vertices equal: m v' = ½ ρ A c r² with r = w - v, so 1/r = 1/w + t ρ A
    // c / (2 m).
    const double rate = 0.5 * 1.2 * 1.2 / Material<double>().area_density;
    double r = 3.0;
    for (int k = 0; k < 300; ++k) {
      REQUIRE(kite.step(s, input, 0.02, kite_ws).advanced);
      r = r / (1 + 0.02 * rate *
                       r);  // the same equation, stepped with C frozen at the start of the step
    }
    const Eigen::Vector3d drift = s.velocities * network.mass / network.mass.sum();
    CHECK(drift.y() == Approx(3.0 - r).epsilon(0.05));
    CHECK(std::abs(drift.x()) + std::abs(drift.z()) <= 0.05);
    CHECK(drift.y() < 3.0);
  }
}

TEST_CASE("driven vertices end exactly at their targets and pins stay, in both integrations",
          "[cloth]") {
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    Scene scene;
    scene.settings.integration = integration;
    scene.state.positions(0, 30) = -0.0;  // even the sign of zero must stay
    const MassSpring<double> model = make(scene.network, scene.settings);
    auto ws = model.make_workspace();
    ClothState<double> state = scene.state;
    for (int k = 0; k < 10; ++k) {
      scene.input.driven_positions.col(0) =
          state.positions.col(35) + 0.003 * Eigen::Vector3d(std::sin(k), std::cos(k), 0.5);
      const Eigen::Vector3d from = state.positions.col(35),
                            to = scene.input.driven_positions.col(0);
      REQUIRE(model.step(state, scene.input, scene.dt, ws).advanced);
      CHECK(std::memcmp(state.positions.col(35).data(), to.data(), sizeof(double) * 3) == 0);
      CHECK(std::memcmp(state.positions.col(30).data(), scene.state.positions.col(30).data(),
                        sizeof(double) * 3) == 0);
      CHECK(state.velocities.col(30) == Eigen::Vector3d(0, 0, 0));
      CHECK((state.velocities.col(35) - (to - from) / scene.dt).norm() <= 1e-12);
    }
    // A pin can be driven.
    scene.input.driven_vertices = {30};
    scene.input.driven_positions = state.positions.col(30) + Eigen::Vector3d(0.001, 0, 0);
    REQUIRE(model.step(state, scene.input, scene.dt, ws).advanced);
    CHECK(state.positions.col(30) == scene.input.driven_positions.col(0));
  }
}

TEST_CASE("forces on a held vertex change no bit", "[cloth]") {
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    Scene scene;
    scene.settings.integration = integration;
    const MassSpring<double> model = make(scene.network, scene.settings);
    auto ws = model.make_workspace();
    ClothState<double> quiet = scene.state, pushed = scene.state;
    REQUIRE(model.step(quiet, scene.input, scene.dt, ws).advanced);
    scene.input.force_vertices = {3, 17, 3, 30, 35};
    scene.input.forces.conservativeResize(3, 5);
    scene.input.forces.rightCols(2).setConstant(1e8);
    REQUIRE(model.step(pushed, scene.input, scene.dt, ws).advanced);
    CHECK(same_bits(quiet, pushed));
  }
}

TEST_CASE("a step from a guess ends where the full Newton solve ends", "[cloth]") {
  Scene scene;
  scene.settings.integration = Integration::Newton;
  scene.settings.velocity_tolerance = 1e-10;
  const MassSpring<double> model = make(scene.network, scene.settings);
  auto ws = model.make_workspace();
  ClothState<double> full = scene.state;
  const StepReport<double> whole = model.step(full, scene.input, scene.dt, ws);
  REQUIRE(whole.status == StepStatus::Converged);

  ClothState<double> state = scene.state;
  StepReport<double> report = model.step_from(full.velocities, 5, state, scene.input, scene.dt, ws);
  CHECK(report.status == StepStatus::Converged);
  CHECK(report.iterations == 0);  // a guess at the solution needs no solve
  CHECK((state.positions - full.positions).cwiseAbs().maxCoeff() <= 1e-14);

  const Points<double> near = full.velocities + noise(8, 36, 1e-3);
  double last = (near - full.velocities).cwiseAbs().maxCoeff();
  for (const int steps : {1, 4, 16}) {
    state = scene.state;
    report = model.step_from(near, steps, state, scene.input, scene.dt, ws);
    CHECK(report.advanced);
    CHECK(report.iterations <= steps);
    const double error = (state.velocities - full.velocities).cwiseAbs().maxCoeff();
    CHECK(error < 0.7 * last);
    last = error;
  }
  CHECK(last < 1e-4);

  // One step advances too and reports that it did not converge. The guess of held vertices is
  // ignored.
  Points<double> odd = near;
  odd.col(30).setConstant(50);
  odd.col(35).setConstant(-50);
  ClothState<double> one = scene.state, other = scene.state;
  CHECK(model.step_from(near, 1, one, scene.input, scene.dt, ws).advanced);
  CHECK(model.step_from(odd, 1, other, scene.input, scene.dt, ws).iterations == 1);
  CHECK(same_bits(one, other));
  state = scene.state;
  report = model.step_from(near, 0, state, scene.input, scene.dt, ws);
  CHECK(report.status == StepStatus::IterationLimit);
  CHECK(report.advanced);
  CHECK((state.velocities.col(2) - near.col(2)).norm() == 0.0);

  // An invalid guess is invalid input.
  Points<double> bad = near;
  bad(1, 4) = std::numeric_limits<double>::quiet_NaN();
  state = scene.state;
  CHECK(model.step_from(bad, 3, state, scene.input, scene.dt, ws).status ==
        StepStatus::InvalidInput);
  CHECK(model.step_from(near.leftCols(35), 3, state, scene.input, scene.dt, ws).status ==
        StepStatus::InvalidInput);
  CHECK(model.step_from(near, 3, state, scene.input, -1.0, ws).status == StepStatus::InvalidInput);
  CHECK(same_bits(state, scene.state));
}

TEST_CASE("when iterations run out the step advances and reports it", "[cloth]") {
  Scene scene;
  scene.settings.integration = Integration::Newton;
  scene.settings.max_iterations = 1;
  scene.settings.velocity_tolerance = 1e-13;
  const MassSpring<double> model = make(scene.network, scene.settings);
  auto ws = model.make_workspace();
  ClothState<double> state = scene.state;
  const StepReport<double> report = model.step(state, scene.input, scene.dt, ws);
  CHECK(report.status == StepStatus::IterationLimit);
  CHECK(report.advanced);
  CHECK(report.iterations == 2);
  CHECK(report.residual > 0);
}

TEMPLATE_TEST_CASE("coincident vertices give finite numbers", "[cloth]", float, double) {
  using S = TestType;
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    MassSpringSettings<S> settings;
    settings.integration = integration;
    settings.air.normal_coefficient = S(1);
    const SpringNetwork<S> network = sheet<S>();
    const MassSpring<S> model = make(network, settings);
    auto ws = model.make_workspace();
    for (const bool all : {false, true}) {
      ClothState<S> state = model.rest_state();
      if (all) {
        state.positions.setConstant(S(0.1));  // the whole sheet in one point
      } else {
        state.positions.col(8) = state.positions.col(7);
      }
      for (int k = 0; k < 3; ++k) {
        const StepReport<S> report = model.step(state, {}, S(0.01), ws);
        CHECK(report.advanced);
        CHECK(all_finite(state.positions));
        CHECK(all_finite(state.velocities));
      }
    }
  }
}

TEMPLATE_TEST_CASE("steps that overflow leave the state's bits unchanged", "[cloth]", float,
                   double) {
  using S = TestType;
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    MassSpringSettings<S> settings;
    settings.integration = integration;
    const MassSpring<S> model = make(sheet<S>(), settings);
    auto ws = model.make_workspace();
    const S huge = std::numeric_limits<S>::max() / S(4);
    const auto refused = [&](const ClothState<S>& start, const ClothInput<S>& input, S dt) {
      ClothState<S> state = start;
      const StepReport<S> report = model.step(state, input, dt, ws);
      CHECK(report.status == StepStatus::NumericalFailure);
      CHECK_FALSE(report.advanced);
      CHECK(same_bits(state, start));
    };
    ClothInput<S> push;
    push.force_vertices = {4};
    push.forces = Points<S>::Constant(3, 1, huge);
    refused(model.rest_state(), push, S(100));
    ClothInput<S> drive;
    drive.driven_vertices = {4};
    drive.driven_positions = Points<S>::Constant(3, 1, huge);
    refused(model.rest_state(), drive, S(1e-6));
    ClothState<S> fast = model.rest_state();
    fast.velocities.setConstant(huge);
    refused(fast, {}, S(100));  // finite velocities, but positions overflow
    // The workspace still works.
    ClothState<S> state = model.rest_state();
    CHECK(model.step(state, {}, S(0.01), ws).status == StepStatus::Converged);
  }
}

TEST_CASE("bad data for create are refused with a message that names the item", "[cloth]") {
  const auto error =
      [](const std::function<void(SpringNetwork<double>&, MassSpringSettings<double>&)>& spoil) {
        SpringNetwork<double> network = sheet<double>(3);
        MassSpringSettings<double> settings;
        spoil(network, settings);
        const Result<MassSpring<double>> made = MassSpring<double>::create(network, settings);
        return made ? std::string("accepted") : made.error();
      };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  using N = SpringNetwork<double>;
  using Set = MassSpringSettings<double>;
  CHECK(error([](N&, Set&) {}) == "accepted");
  CHECK(error([](N& n, Set&) { n.mass[4] = -1; }) == "mass of vertex 4 is not positive: -1 kg");
  CHECK(error([](N& n, Set&) {
          n.bends[1].vertex[2] = n.bends[1].vertex[0];
        }).find("bending stencil 1 holds vertex") == 0);
  CHECK(error([](N& n, Set&) { n.triangles[2] = {3, 4, 3}; }) == "triangle 2 holds vertex 3 twice");
  CHECK(error([&](N&, Set& s) { s.gravity[1] = nan; }) == "gravity y is not finite: nan");
  CHECK(error([](N&, Set& s) {
          s.pinned = {0, 9};
        }) == "pinned vertex 9 is off the mesh of 9 vertices");
  CHECK(error([](N&, Set& s) { s.pinned = {-1}; }) ==
        "pinned vertex -1 is off the mesh of 9 vertices");
}

TEMPLATE_TEST_CASE(
    "an independent implementation of one solve per step agrees to its printed digits", "[cloth]",
    float, double) {
  using S = TestType;
  // Its system (M - dt D - dt² K) dv = dt (f + dt K v) has blocks of the opposite sign, and its f
  // contains the dampers. With dv = v⁺ - v and the dampers' force -D v, it becomes the header's A
  // v⁺ = M v + h f_springs.
  const std::string path = clothctl_test::shared_path("data/cloth/ref/e_bw_traj.csv");
  if (path.empty()) {
    WARN("reference data not found; skipped");
    return;
  }
  SpringNetwork<double> network;
  network.rest_positions.resize(3, 64);
  network.mass = Eigen::VectorXd::Constant(64, 0.01);
  const auto id = [](int i, int j) { return j * 8 + i; };
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 8; ++i) network.rest_positions.col(id(i, j)) << 0.1 * i, 0.1 * j, 0.0;
  }
  const auto add = [&](int a, int b, double k, double d) {
    const double length = (network.rest_positions.col(a) - network.rest_positions.col(b)).norm();
    network.springs.push_back({a, b, length, k, d});
  };
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 8; ++i) {
      if (i + 1 < 8) add(id(i, j), id(i + 1, j), 200, 0.5);
      if (j + 1 < 8) add(id(i, j), id(i, j + 1), 200, 0.5);
      if (i + 1 < 8 && j + 1 < 8) add(id(i, j), id(i + 1, j + 1), 100, 0.25);
      if (i + 1 < 8 && j + 1 < 8) add(id(i + 1, j), id(i, j + 1), 100, 0.25);
      if (i + 2 < 8) add(id(i, j), id(i + 2, j), 20, 0.05);
      if (j + 2 < 8) add(id(i, j), id(i, j + 2), 20, 0.05);
    }
  }
  REQUIRE(network.springs.size() == 306);
  MassSpringSettings<S> settings;
  settings.limit_energy = false;  // the reference has no such bound
  settings.pinned = {56, 63};
  const MassSpring<S> model = make(network.template cast<S>(), settings);
  auto ws = model.make_workspace();
  ClothState<S> state = model.rest_state();
  const auto rows = read_numbers(path);
  REQUIRE(rows.size() > 1000);
  int step = 0;
  double worst = 0;
  for (const std::vector<double>& row : rows) {
    REQUIRE(row.size() == 5);
    for (; step < static_cast<int>(row[0]); ++step)
      REQUIRE(model.step(state, {}, S(1.0 / 60.0), ws).advanced);
    const Eigen::Vector3d x =
        state.positions.col(static_cast<Index>(row[1])).template cast<double>();
    worst = std::max(worst, (x - Eigen::Vector3d(row[2], row[3], row[4])).norm());
  }
  CHECK(step >= 30);
  CHECK(worst <= (std::is_same_v<S, float> ? 1e-3 : 1e-9));
}

TEST_CASE("the recorded sheet rests at the start of its record and follows its hands", "[cloth]") {
  const std::string folder = clothctl_test::shared_path("data/trajectories/splines");
  if (folder.empty()) {
    WARN("recorded trajectories not found; skipped");
    return;
  }
  const GridMesh<double> grid = make_grid<double>(17, 17, 0.5, 0.5).value();
  const Material<double> material = material_preset<double>("handkerchief").value();
  MassSpringSettings<double> settings;
  settings.integration = Integration::Newton;
  settings.drag = 3.0;
  MassSpring<double> model = make(sheet_network<double>(grid, material).value(), settings);
  auto ws = model.make_workspace();

  // The record starts after settling for 2.4 s from a bowed sheet whose columns were pushed
  // together by a tenth. From that start the sheet buckles violently into one of many folds, and
  // the unfinished first Newton step decides which. With max_iterations 30 the result is 0.1 mm
  // from the record; with 10 or 100 it ends in other folds, 6 mm away. The rest can be compared:
  // released from the record, the sheet moves by the 0.3 mm that it had left to settle.
  ClothInput<double> input;
  input.driven_vertices = {grid.vertex(16, 0), grid.vertex(16, 16)};
  input.driven_positions.resize(3, 2);
  input.driven_positions << -0.225, 0.225, 0.0, 0.0, 0.0, 0.0;
  ClothState<double> start = model.rest_state();
  for (const std::vector<double>& row : read_numbers(folder + "/initial_pose_17x17.csv")) {
    start.positions.col(grid.vertex(static_cast<int>(row[0]), static_cast<int>(row[1]))) << row[2],
        row[3], row[4];
  }
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector3d hand =
        start.positions.col(input.driven_vertices[static_cast<std::size_t>(i)]);
    CHECK((hand - input.driven_positions.col(i)).norm() <= 1e-6);
  }
  ClothState<double> state = start;
  for (int k = 0; k < 200; ++k) REQUIRE(model.step(state, input, 0.02, ws).advanced);
  CHECK((state.positions - start.positions).colwise().norm().maxCoeff() <= 4e-4);
  for (int col : {0, 16})
    CHECK((state.positions - start.positions).col(grid.vertex(0, col)).norm() <= 3e-4);

  model.set_drag(material.drag);
  const auto hands = read_numbers(folder + "/known_1_hands.csv"),
             corners = read_numbers(folder + "/known_1.csv");
  REQUIRE(hands.size() == 251);
  REQUIRE(corners.size() == 251);
  state = start;
  double sum = 0;
  int solves = 0;
  for (std::size_t k = 1; k < hands.size(); ++k) {
    input.driven_positions << hands[k][1], hands[k][4], hands[k][2], hands[k][5], hands[k][3],
        hands[k][6];
    const StepReport<double> report = model.step(state, input, 0.02, ws);
    REQUIRE(report.status == StepStatus::Converged);
    solves += report.iterations;
    const Eigen::Vector3d left(corners[k][1], corners[k][2], corners[k][3]),
        right(corners[k][4], corners[k][5], corners[k][6]);
    sum += (state.positions.col(grid.vertex(0, 0)) - left).norm() +
           (state.positions.col(grid.vertex(0, 16)) - right).norm();
  }
  CHECK(sum / 500 <= 5e-5);
  CHECK(solves <= 8 * 250);  // with the projected Hessian, a step takes 21 solves here
}

TEST_CASE("holding forces, applied instead of driving vertices, give the same step", "[cloth]") {
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    MassSpringSettings<double> settings;
    settings.integration = integration;
    settings.drag = 0.5;
    settings.velocity_tolerance = 1e-11;
    settings.air = {1.2, 1.0, 0.2};
    const MassSpring<double> model = make(sheet<double>(7), settings);
    auto ws = model.make_workspace();
    ClothState<double> start = model.rest_state();
    ClothInput<double> driven;
    driven.driven_vertices = {42, 48};
    driven.driven_positions.resize(3, 2);
    for (Index j = 0; j < 2; ++j)
      driven.driven_positions.col(j) =
          start.positions.col(driven.driven_vertices[static_cast<std::size_t>(j)]);
    driven.forces.resize(3, 0);
    driven.wind = Vector3<double>(0.5, 1.0, 0.0);
    // Hanging, the sheet has one stable shape; a slack sheet may buckle into either of two.
    for (int k = 0; k < 100; ++k) REQUIRE(model.step(start, driven, 0.02, ws).advanced);
    driven.driven_positions.row(0) *= 1.001;
    driven.driven_positions += noise(3, 2, 0.001);
    ClothState<double> told = start;
    REQUIRE(model.step(told, driven, 0.02, ws).status == StepStatus::Converged);
    ClothInput<double> pushed;
    pushed.force_vertices = driven.driven_vertices;
    pushed.forces.setZero(3, 2);
    pushed.wind = driven.wind;
    const long before = clothctl_test::allocations();
    model.holding_forces(driven.driven_vertices, ws, pushed.forces);
    const long made = clothctl_test::allocations() - before;
    if (clothctl_test::allocation_counting_works()) CHECK(made == 0);
    pushed.driven_positions.resize(3, 0);
    CHECK(pushed.forces.norm() > 0.01);
    ClothState<double> free = start;
    REQUIRE(model.step(free, pushed, 0.02, ws).status == StepStatus::Converged);
    CAPTURE(integration == Integration::Newton);
    CHECK((free.positions - told.positions).cwiseAbs().maxCoeff() < 1e-9);
    CHECK((free.velocities - told.velocities).cwiseAbs().maxCoeff() < 1e-7);
  }
}

TEST_CASE("pins of a sheet at rest hold its weight", "[cloth]") {
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    MassSpringSettings<double> settings;
    settings.integration = integration;
    settings.drag = 5.0;
    const std::vector<int> pins{30, 35};
    settings.pinned = pins;
    const MassSpring<double> model = make(sheet<double>(6), settings);
    auto ws = model.make_workspace();
    ClothState<double> state = model.rest_state();
    ClothInput<double> none;
    none.forces.resize(3, 0);
    none.driven_positions.resize(3, 0);
    for (int i = 0; i < 600; ++i) REQUIRE(model.step(state, none, 0.02, ws).advanced);
    Points<double> forces(3, 2);
    model.holding_forces(pins, ws, forces);
    const Vector3<double> sum = forces.rowwise().sum();
    const double weight = 9.81 * model.network().mass.sum();
    CHECK((sum - Vector3<double>(0.0, 0.0, weight)).norm() < 1e-4 * weight);
  }
}

namespace {

MassSpring<double> sheet_of(int rows, int cols, double width = 0.3, bool air = false) {
  const GridMesh<double> grid = make_grid<double>(rows, cols, width, 0.3).value();
  const Material<double> material;
  return MassSpring<double>::create(sheet_network<double>(grid, material).value(),
                                    MassSpringSettings<double>::of(material, air))
      .value();
}

}  // namespace

TEST_CASE("a workspace of another model is refused with a message", "[cloth]") {
  const MassSpring<double> model = sheet_of(6, 6);
  ClothState<double> state = model.rest_state();
  const ClothState<double> before = state;
  const ClothInput<double> input;
  Points<double> forces = Points<double>::Constant(3, 1, 7.0);
  const std::vector<int> first{0};
  // Models with fewer or more vertices, another pattern or air; and a workspace of no model.
  std::vector<MassSpring<double>::Workspace> wrong{sheet_of(3, 3).make_workspace(),
                                                   sheet_of(9, 9).make_workspace(),
                                                   sheet_of(4, 9).make_workspace(),
                                                   sheet_of(6, 6, 0.3, true).make_workspace(),
                                                   {}};
  wrong.push_back(model.make_workspace());
  wrong.back().trial.resize(3, 2);
  for (MassSpring<double>::Workspace& ws : wrong) {
    const StepReport<double> report = model.step(state, input, 0.02, ws);
    CHECK(report.status == StepStatus::InvalidWorkspace);
    CHECK_FALSE(report.advanced);
    CHECK(model.step_from(state.velocities, 2, state, input, 0.02, ws).status ==
          StepStatus::InvalidWorkspace);
    CHECK(state == before);
    CHECK(model.check_input(state, input, 0.02, ws) ==
          "the workspace was made by another model; use make_workspace() of the model that steps");
    CHECK_FALSE(model.holding_forces(first, ws, forces));
    CHECK(forces == Points<double>::Constant(3, 1, 7.0));
  }
  // Equal structure suffices: models with other settings and copies share workspaces.
  MassSpring<double> copy = model;
  CHECK(copy.set_drag(2.0));
  auto ws = model.make_workspace();
  CHECK(copy.step(state, input, 0.02, ws).advanced);
}

TEST_CASE("check_input says why a mass-spring step is refused", "[cloth]") {
  const MassSpring<double> model = sheet_of(4, 4);
  ClothState<double> state = model.rest_state();
  auto ws = model.make_workspace();
  ClothInput<double> input;
  CHECK(model.check_input(state, input, 0.02, ws).empty());
  CHECK(model.check_input(state, input, std::nan(""), ws) ==
        "step length dt must be positive and finite, got nan s");
  for (const double dt : {std::nan(""), -0.02, 0.0, std::numeric_limits<double>::infinity()})
    CHECK(model.step(state, input, dt, ws).status == StepStatus::InvalidInput);
  input.force_vertices = {16};
  input.forces.setZero(3, 1);
  CHECK(model.check_input(state, input, 0.02, ws) ==
        "force 0: vertex 16 is off the mesh of 16 vertices");
}

TEST_CASE("holding_forces and set_drag refuse bad arguments", "[cloth]") {
  MassSpring<double> model = sheet_of(4, 4);
  ClothState<double> state = model.rest_state();
  auto ws = model.make_workspace();
  Points<double> forces = Points<double>::Zero(3, 1);
  const std::vector<int> one{0}, off{16}, negative{-1}, two{0, 1};
  CHECK_FALSE(model.holding_forces(one, ws, forces));  // before any step
  REQUIRE(model.step(state, {}, 0.02, ws).advanced);
  CHECK(model.holding_forces(one, ws, forces));
  for (const std::vector<int>* bad : {&off, &negative, &two})
    CHECK_FALSE(model.holding_forces(*bad, ws, forces));
  const double drag = model.settings().drag;
  for (const double bad : {-1.0, std::nan(""), std::numeric_limits<double>::infinity()})
    CHECK_FALSE(model.set_drag(bad));
  CHECK(model.settings().drag == drag);
}

TEST_CASE("the gravity load of a mass-spring sheet is minus its weight", "[cloth]") {
  const GridMesh<double> grid = make_grid<double>(4, 4, 0.3, 0.3).value();
  const SpringNetwork<double> network = sheet_network<double>(grid, Material<double>()).value();
  MassSpringSettings<double> settings;
  settings.gravity = {1.0, -2.0, -3.5};
  const auto model = MassSpring<double>::create(network, settings).value();
  CHECK((model.gravity_load() + settings.gravity * network.mass.sum()).norm() < 1e-15);
}
