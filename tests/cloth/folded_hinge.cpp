#include "clothctl/cloth/detail/folded_hinge.hpp"

#include <cmath>
#include <random>
#include <utility>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>

#include "clothctl/cloth/detail/spring_forces.hpp"
#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/network/rest_folds.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

constexpr double kPi = 3.14159265358979323846;
using Network = SpringNetwork<double>;

/// Two triangles at the edge 0-1 with the feet and heights of their vertices 2 and 3, folded by
/// `angle` as in the drawing of BendStencil.
Points<double> hinge_at(double angle, double length, double left = 0.3, double right = 0.8,
                        double wide = 0.9) {
  Points<double> x(3, 4);
  const double c = std::cos(angle / 2), s = std::sin(angle / 2);
  x << 0, 0, -c, wide * c,     //
      0, length, left, right,  //
      0, 0, -s, -wide * s;
  return x;
}

/// The network of those triangles with the rest angle `rest` and no springs.
Network hinge_network(double length, double rest) {
  Network network =
      sheet_network<double>(hinge_at(0, length), {{0, 1, 2}, {1, 0, 3}}, Material<double>())
          .value();
  network.springs.clear();
  REQUIRE(network.bends.size() == 1);
  REQUIRE(network.bends[0].vertex == std::array<int, 4>{0, 1, 2, 3});
  network.bends[0].rest_fold = std::tan(rest / 2);
  network.bends[0].stiffness = 0.7;
  REQUIRE(network.validate().empty());
  return network;
}

Points<double> forces(const Network& network, const Points<double>& x) {
  Points<double> f = Points<double>::Zero(3, x.cols());
  (void)add_spring_forces<double>(network, x, f);
  return f;
}

Points<double> noise(std::mt19937& random, Index n, double size) {
  std::normal_distribution<double> normal(0.0, size);
  return Points<double>::NullaryExpr(3, n, [&] { return normal(random); });
}

/// Returns the bending stiffness matrix.
Eigen::MatrixXd stiffness(const Network& network, const Points<double>& x) {
  const SpringPattern<double> pattern(network, BendingBlocks::All, false);
  BlockSymmetric<double> k = pattern.matrix();
  pattern.add_bending(network, x, 1.0, k);
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(x.size(), x.size());
  for (Index i = 0; i < k.rows(); ++i) {
    out.block<3, 3>(3 * i, 3 * i) = k.diagonal(i);
    for (int s = k.row_begin(i); s < k.row_begin(i + 1); ++s) {
      out.block<3, 3>(3 * i, 3 * k.column(s)) = k.lower(s);
      out.block<3, 3>(3 * k.column(s), 3 * i) = k.lower(s).transpose();
    }
  }
  return out;
}

}  // namespace

TEST_CASE(
    "folded hinge: at lengths of rest the energy is kb l² (1 - cos(θ - θ0)), round the circle",
    "[folded_hinge]") {
  for (const double rest : {-2.5, -0.4, 1e-9, 0.7, kPi / 2, 3.0}) {
    const double length = 1.3;
    const Network network = hinge_network(length, rest);
    for (double angle = -4; angle < 7; angle += 0.37) {
      const double expected = 0.7 * length * length * (1 - std::cos(angle - rest));
      CHECK(spring_energy<double>(network, hinge_at(angle, length)) ==
            Approx(expected).margin(1e-12));
    }
    const Points<double> at_rest = hinge_at(rest, length);
    CHECK(forces(network, at_rest).cwiseAbs().maxCoeff() < 1e-14);
    // One that is flat starts to fold to the side of its rest angle: vertices 2 and 3 go down.
    const Points<double> push = forces(network, hinge_at(0, length));
    CHECK(std::copysign(1.0, -push(2, 2)) == std::copysign(1.0, rest));
    CHECK(std::copysign(1.0, -push(2, 3)) == std::copysign(1.0, rest));
  }
}

TEST_CASE("folded hinge: forces are minus the gradient of the energy anywhere", "[folded_hinge]") {
  std::mt19937 random(1);
  for (int trial = 0; trial < 50; ++trial) {
    const double rest = std::uniform_real_distribution<double>(-3, 3)(random);
    const Network network = hinge_network(1.1, rest);
    Points<double> x = hinge_at(rest + 2, 1.1) + noise(random, 4, trial % 2 == 0 ? 0.05 : 1.0);
    const Points<double> f = forces(network, x);
    Points<double> slope(3, 4);
    for (Index i = 0; i < x.size(); ++i) {
      const double here = x.data()[i], step = 1e-5;
      x.data()[i] = here + step;
      const double ahead = spring_energy<double>(network, x);
      x.data()[i] = here - step;
      slope.data()[i] = (ahead - spring_energy<double>(network, x)) / (2 * step);
      x.data()[i] = here;
    }
    const double edge = (x.col(1) - x.col(0)).norm(), size = 1 + 1 / (edge * edge);
    CHECK((f + slope).cwiseAbs().maxCoeff() <= 1e-6 * size * (1 + f.norm()));
    Points<double> added = Points<double>::Zero(3, 4);
    CHECK(add_spring_forces<double>(network, x, added) == spring_energy<double>(network, x));
    // Linear and angular momentum; the mirror image.
    CHECK(f.rowwise().sum().norm() <= 1e-12 * (1 + f.norm()));
    Eigen::Vector3d torque = Eigen::Vector3d::Zero();
    for (Index i = 0; i < 4; ++i) torque += x.col(i).cross(f.col(i));
    CHECK(torque.norm() <= 1e-11 * (1 + f.norm()));
    Points<double> mirrored = x, mirrored_forces = f;
    mirrored.row(2) *= -1;
    mirrored_forces.row(2) *= -1;
    CHECK((forces(hinge_network(1.1, -rest), mirrored) - mirrored_forces).norm() <=
          1e-12 * (1 + f.norm()));
  }
}

TEST_CASE("folded hinge: forces are minus the gradient where the edge is short", "[folded_hinge]") {
  std::mt19937 random(4);
  for (int trial = 0; trial < 30; ++trial) {
    const double rest = std::uniform_real_distribution<double>(-3, 3)(random);
    const Network network = hinge_network(1.1, rest);
    Points<double> x = hinge_at(rest + 2, 1.1) + noise(random, 4, 0.3);
    x.col(1) = x.col(0) + noise(random, 1, 1e-4);  // |D| is about 1
    const Points<double> f = forces(network, x);
    const double start = spring_energy<double>(network, x);
    const Points<double> way = noise(random, 4, 1.0);
    const auto slope = [&](double step) {
      const Points<double> ahead = x + step * way, behind = x - step * way;
      return (spring_energy<double>(network, ahead) - spring_energy<double>(network, behind)) /
             (2 * step);
    };
    CHECK(f.cwiseProduct(way).sum() == Approx(-slope(1e-7)).epsilon(1e-5).margin(1e-5 * start));
    CHECK(f.rowwise().sum().norm() <= 1e-12 * f.norm());
    Eigen::Vector3d torque = Eigen::Vector3d::Zero();
    for (Index i = 0; i < 4; ++i) torque += x.col(i).cross(f.col(i));
    CHECK(torque.norm() <= 1e-11 * f.norm());
  }
}

TEST_CASE("folded hinge: the mean derivative gives the change of e exactly", "[folded_hinge]") {
  std::mt19937 random(5);
  const std::array<double, 5> edges{1.0, 1e-2, 1e-4, 1e-6, 0.0};
  for (int trial = 0; trial < 200; ++trial) {
    const BendStencil<double> b =
        hinge_network(1.1, std::uniform_real_distribution<double>(-3, 3)(random)).bends[0];
    std::array<Points<double>, 2> x;
    for (Points<double>& place : x) {
      place = noise(random, 4, 1.0);
      const double edge = edges[static_cast<std::size_t>(random() % 5)];
      place.col(1) = place.col(0) + edge * noise(random, 1, 1.0);
      if (random() % 20 == 0) place.setZero();
    }
    if (trial % 10 == 0) x[1] = x[0];
    const FoldedHinge<double> start(b, x[0]), end(b, x[1]);
    const Triple<double> a{0.3, -1.1, 0.7};
    double sum = 0, size = 0;
    for (int i = 0; i < 4; ++i) {
      const Triple<double> share = start.mean_share(end, i, a);
      const double part = dot(share, column(x[1], i) - column(x[0], i));
      sum += part;
      size += std::abs(part);
      if (trial % 10 != 0) continue;  // the derivative itself
      const Triple<double> off = share - start.share(i, a);
      CHECK(std::sqrt(squared_norm(off)) <= 1e-12 * (1 + std::sqrt(squared_norm(share))));
    }
    CHECK(std::abs(sum - dot(a, end.error() - start.error())) <= 1e-11 * (1 + size));
  }
}

TEST_CASE(
    "folded hinge: the stiffness is positive semidefinite, and the derivative of the forces "
    "at rest",
    "[folded_hinge]") {
  std::mt19937 random(2);
  for (const double rest : {-2.5, -0.4, 0.7, kPi / 2, 3.0}) {
    Network network = hinge_network(1.3, rest);
    // Any numbering of the vertices; blocks above the diagonal are transposed.
    const std::array<int, 4> number{2, 0, 3, 1};
    Network shuffled = network;
    for (std::size_t i = 0; i < 4; ++i) shuffled.bends[0].vertex[i] = number[i];
    for (const double size : {0.0, 0.3}) {
      const Points<double> x = hinge_at(rest, 1.3) + noise(random, 4, size);
      const Eigen::MatrixXd k = stiffness(network, x);
      Points<double> moved(3, 4);
      for (Index i = 0; i < 4; ++i) moved.col(number[static_cast<std::size_t>(i)]) = x.col(i);
      const Eigen::MatrixXd other = stiffness(shuffled, moved);
      for (Index i = 0; i < 4; ++i) {
        for (Index j = 0; j < 4; ++j) {
          const Eigen::Matrix3d block = other.block<3, 3>(3 * number[static_cast<std::size_t>(i)],
                                                          3 * number[static_cast<std::size_t>(j)]);
          CHECK((k.block<3, 3>(3 * i, 3 * j) - block).norm() <= 1e-14 * k.norm());
        }
      }
      const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(k, Eigen::EigenvaluesOnly);
      CHECK(eigen.eigenvalues().minCoeff() >= -1e-13 * k.norm());
      if (size > 0.0) continue;
      for (Index i = 0; i < x.size(); ++i) {
        Points<double> y = x;
        y.data()[i] += 1e-6;
        const Points<double> ahead = forces(network, y);
        y.data()[i] -= 2e-6;
        const Points<double> change = forces(network, y) - ahead;
        CHECK((k.col(i) - change.reshaped() / 2e-6).norm() <= 1e-7 * k.norm());
      }
    }
  }
}

TEST_CASE("folded hinge: a collapsed edge or triangle gives finite forces", "[folded_hinge]") {
  const Network network = hinge_network(1.0, 1.2);
  for (const double size : {0.0, 1e-300, 1e-12, 1e-4}) {
    Points<double> x = size * hinge_at(0.5, 1.0);
    CHECK(forces(network, x).allFinite());
    CHECK(stiffness(network, x).allFinite());
    x = hinge_at(0.5, 1.0);
    x.col(1) = x.col(0) + size * Eigen::Vector3d(0.3, 0.2, -0.5);
    CHECK(forces(network, x).allFinite());
    CHECK(forces(network, x).norm() < 1e3);
    CHECK(stiffness(network, x).allFinite());
    const Eigen::Vector3d sum = forces(network, x).rowwise().sum();
    CHECK(sum.norm() < 1e-11);
  }
}

namespace {

/// A strip of two cells whose middle edge has the rest angle `rest`; its left cell is clamped.
Network strip_network(double rest) {
  Points<double> x(3, 6);
  x << 0, 0, -0.1, -0.1, 0.1, 0.1,  //
      0, 0.1, 0, 0.1, 0, 0.1,       //
      0, 0, 0, 0, 0, 0;
  Material<double> material;
  material.bending_warp = material.bending_weft = 1e-3;
  Network network =
      sheet_network<double>(x, {{0, 1, 2}, {1, 3, 2}, {0, 4, 1}, {1, 4, 5}}, material).value();
  for (BendStencil<double>& b : network.bends) {
    if (b.vertex[0] == 0 && b.vertex[1] == 1) b.rest_fold = std::tan(rest / 2);
  }
  return network;
}

/// The strip with its right cell turned by `angle` about the middle edge.
Points<double> strip_at(const Network& network, double angle) {
  Points<double> x = network.rest_positions;
  for (const Index v : {4, 5}) {
    x(0, v) = 0.1 * std::cos(angle);
    x(2, v) = -0.1 * std::sin(angle);
  }
  return x;
}

/// The angle of the strip after it has come to rest.
template <class Model>
double settled(const Model& model, Points<double> start) {
  auto workspace = model.make_workspace();
  ClothState<double> state = model.rest_state();
  state.positions = start;
  bool advanced = true;
  for (int step = 0; step < 250; ++step)
    advanced = model.step(state, ClothInput<double>(), 0.01, workspace).advanced && advanced;
  CHECK(advanced);
  CHECK(state.velocities.norm() < 1e-3);
  const Eigen::Vector3d side = state.positions.col(4);
  return std::atan2(-side[2], side[0]);
}

/// Damps the motion of a strip whose first triangles are held.
template <class Settings>
Settings clamped(Settings settings) {
  settings.gravity.setZero();
  settings.drag = 10;
  settings.pinned = {0, 1, 2, 3};
  return settings;
}

std::vector<double> settled_by_all(const Network& network, const Points<double>& start) {
  std::vector<double> angles;
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    auto settings = clamped(MassSpringSettings<double>());
    settings.integration = integration;
    angles.push_back(settled(MassSpring<double>::create(network, settings).value(), start));
  }
  for (const PositionScheme scheme : {PositionScheme::Xpbd, PositionScheme::Verlet}) {
    auto settings = clamped(PositionBasedSettings<double>());
    settings.scheme = scheme;
    angles.push_back(settled(PositionBased<double>::create(network, settings).value(), start));
  }
  return angles;
}

}  // namespace

TEST_CASE("folded hinge: a clamped strip folds to its rest angle from both sides in all models",
          "[folded_hinge]") {
  for (const double rest : {-2.0, 0.3, 1.5707963}) {
    const Network network = strip_network(rest);
    // Half a turn away is the unstable equilibrium; from beyond 180° it takes the shorter way.
    for (const double start : {0.0, rest - 0.8, rest + 0.8, rest + 2.8, rest - 2.8}) {
      INFO("rest " << rest << " start " << start);
      for (const double angle : settled_by_all(network, strip_at(network, start)))
        CHECK(angle == Approx(rest).margin(1e-4));
    }
  }
}

TEST_CASE("folded hinge: strips under a load bend alike in all models, and mirror images",
          "[folded_hinge]") {
  // The weight of the free cell turns the hinge away from its rest angle. Its two vertices hang at
  // the distance a from the edge: m g a cos θ = torque of the hinge.
  for (const double rest : {-0.9, 0.9}) {
    const Network network = strip_network(rest);
    std::vector<double> angles;
    for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
      MassSpringSettings<double> settings;
      settings.integration = integration;
      settings.gravity = {0, 0, -3};
      settings.drag = 10;
      settings.pinned = {0, 1, 2, 3};
      angles.push_back(
          settled(MassSpring<double>::create(network, settings).value(), strip_at(network, rest)));
    }
    PositionBasedSettings<double> settings;
    settings.gravity = {0, 0, -3};
    settings.drag = 10;
    settings.pinned = {0, 1, 2, 3};
    settings.iterations = 10;
    angles.push_back(
        settled(PositionBased<double>::create(network, settings).value(), strip_at(network, rest)));
    CHECK(angles[0] > rest + 0.05);
    CHECK(angles[1] == Approx(angles[0]).margin(1e-6));
    CHECK(angles[2] == Approx(angles[0]).margin(1e-3));
  }
}

namespace {

/// A free arch of 8×5 cells over half a turn, whose hinges rest as they are.
Network arch_network() {
  const GridMesh<double> grid = make_grid<double>(6, 9, 0.3, 0.2).value();
  Points<double> x = grid.positions;
  for (int row = 0; row < grid.rows; ++row) {
    for (int col = 0; col < grid.cols; ++col) {
      const double turn = kPi * col / (grid.cols - 1);
      x.col(grid.vertex(row, col)) << 0.1 * std::cos(turn), 0.1 * std::sin(turn), 0.04 * row;
    }
  }
  Network network = sheet_network<double>(x, grid.triangles, Material<double>()).value();
  REQUIRE(set_rest_folds<double>(network, x).empty());
  return network;
}

/// The arch turned, moved and set in motion like a rigid body.
ClothState<double> tumbling(const Network& network, const Eigen::Vector3d& spin) {
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(0.9, Eigen::Vector3d(1, -2, 3).normalized()).toRotationMatrix();
  ClothState<double> state;
  state.positions = turn * network.rest_positions;
  state.positions.colwise() += Eigen::Vector3d(0.3, -0.2, 0.1);
  const Eigen::Vector3d centre = state.positions * network.mass / network.mass.sum();
  state.velocities = state.positions.colwise() - centre;
  for (Index v = 0; v < state.velocities.cols(); ++v)
    state.velocities.col(v) = spin.cross(Eigen::Vector3d(state.velocities.col(v)));
  return state;
}

/// The largest change of a distance to vertex 0 or 8 against the rest positions.
double deformation(const Network& network, const Points<double>& x) {
  double most = 0;
  for (Index v = 0; v < x.cols(); ++v) {
    for (const Index base : {Index(0), Index(8)}) {
      const double before =
          (network.rest_positions.col(v) - network.rest_positions.col(base)).norm();
      most = std::max(most, std::abs((x.col(v) - x.col(base)).norm() - before));
    }
  }
  return most;
}

}  // namespace

TEST_CASE("folded hinge: a free arch keeps its shape and place in all models", "[folded_hinge]") {
  const Network network = arch_network();
  const ClothState<double> rest = tumbling(network, Eigen::Vector3d::Zero());
  CHECK(spring_energy<double>(network, rest.positions) < 1e-28);
  CHECK(forces(network, rest.positions).cwiseAbs().maxCoeff() < 1e-11);
  const auto check = [&](const auto& model, double tolerance) {
    auto workspace = model.make_workspace();
    ClothState<double> state = rest;
    for (int step = 0; step < 60; ++step)
      REQUIRE(model.step(state, ClothInput<double>(), 1.0 / 60, workspace).advanced);
    CHECK((state.positions - rest.positions).cwiseAbs().maxCoeff() < tolerance);
    // Pushed in, it springs back; a flat sheet would not.
    for (Index v = 0; v < state.positions.cols(); v += 9)
      state.positions.col(v) += Eigen::Vector3d(0.004, -0.005, 0.002);
    for (int step = 0; step < 400; ++step)
      REQUIRE(model.step(state, ClothInput<double>(), 1.0 / 60, workspace).advanced);
    CHECK(deformation(network, state.positions) < 1e-4);
  };
  for (const Integration integration : {Integration::LinearlyImplicit, Integration::Newton}) {
    MassSpringSettings<double> settings;
    settings.integration = integration;
    settings.gravity.setZero();
    settings.drag = 2;
    check(MassSpring<double>::create(network, settings).value(), 1e-9);
  }
  PositionBasedSettings<double> settings;
  settings.gravity.setZero();
  settings.drag = 2;
  check(PositionBased<double>::create(network, settings).value(), 1e-9);
}

TEST_CASE("folded hinge: a tumbling arch keeps its momentum and gains no energy",
          "[folded_hinge]") {
  const Network network = arch_network();
  const auto spin_of = [&](const ClothState<double>& state) {
    const Eigen::Vector3d centre = state.positions * network.mass / network.mass.sum();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (Index v = 0; v < state.positions.cols(); ++v)
      sum += network.mass[v] * (state.positions.col(v) - centre).cross(state.velocities.col(v));
    return sum;
  };
  const auto kinetic_of = [&](const ClothState<double>& state) {
    return 0.5 * network.mass.dot(state.velocities.colwise().squaredNorm());
  };
  const auto energy_of = [&](const ClothState<double>& state) {
    return spring_energy<double>(network, state.positions) + kinetic_of(state);
  };
  const ClothState<double> start = tumbling(network, {2.0, -1.0, 1.5});
  // The energy may exceed its start by the share `wander` on the way.
  const auto tumble = [&](const auto& model, int steps, double seconds, double wander) {
    auto workspace = model.make_workspace();
    ClothState<double> state = start;
    for (int step = 0; step < steps; ++step) {
      REQUIRE(model.step(state, ClothInput<double>(), seconds / steps, workspace).advanced);
      REQUIRE(kinetic_of(state) < 1.001 * energy_of(start));
      REQUIRE(energy_of(state) < (1.0 + wander) * energy_of(start));
    }
    CHECK((state.velocities * network.mass).norm() < 1e-10);
    return state;
  };
  MassSpringSettings<double> settings;
  settings.gravity.setZero();
  settings.integration = Integration::Newton;
  const auto spin_lost = [&](const ClothState<double>& state) {
    return (spin_of(state) - spin_of(start)).norm() / spin_of(start).norm();
  };
  // Implicit Euler slows rotations, to first order in h; the forces have no torque.
  const auto model = MassSpring<double>::create(network, settings).value();
  const double coarse = spin_lost(tumble(model, 100, 0.5, 0.001)),
               fine = spin_lost(tumble(model, 400, 0.5, 0.001));
  CHECK(coarse < 0.15);
  CHECK(fine < 0.35 * coarse);
  PositionBasedSettings<double> positions;
  positions.gravity.setZero();
  // Springs that two sweeps leave stretched store energy for a while; it falls in the long run.
  const auto sweeps = PositionBased<double>::create(network, positions).value();
  CHECK(spin_lost(tumble(sweeps, 100, 0.5, 0.005)) < 0.02);
  CHECK(energy_of(tumble(sweeps, 800, 4.0, 0.02)) < 0.97 * energy_of(start));
}
