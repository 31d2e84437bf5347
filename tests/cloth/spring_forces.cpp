#include "clothctl/cloth/detail/spring_forces.hpp"

#include <cmath>
#include <random>

#include <Eigen/Eigenvalues>

#include "clothctl/network/rope.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/network/solid.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

using Network = SpringNetwork<double>;

Network sheet() {
  return sheet_network<double>(make_grid<double>(5, 4, 0.3, 0.4).value(), Material<double>())
      .value();
}
Network triangle_sheet() {
  const GridMesh<double> grid = make_grid<double>(5, 4, 0.3, 0.4).value();
  return sheet_network<double>(grid.positions, grid.triangles, Material<double>())
      .value();  // hinges of four vertices
}
Network ball() {
  return solid_network(make_ball<double>(0.05, 2, Eigen::Vector3d::Zero()).value(),
                       SolidSettings<double>())
      .value();
}
std::vector<Network> networks() {
  return {sheet(), triangle_sheet(), rope_network(RopeSettings<double>()).value(), ball()};
}

Points<double> noise(std::mt19937& random, Index n, double size) {
  std::normal_distribution<double> normal(0.0, size);
  return Points<double>::NullaryExpr(3, n, [&] { return normal(random); });
}

// Returns a step matrix as a dense matrix.
template <class S>
Eigen::MatrixXd dense(const BlockSymmetric<S>& a) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(3 * a.rows(), 3 * a.rows());
  for (Index i = 0; i < a.rows(); ++i) {
    out.block<3, 3>(3 * i, 3 * i) = a.diagonal(i).template cast<double>();
    for (int s = a.row_begin(i); s < a.row_begin(i + 1); ++s) {
      out.block<3, 3>(3 * i, 3 * a.column(s)) = a.lower(s).template cast<double>();
      out.block<3, 3>(3 * a.column(s), 3 * i) = a.lower(s).transpose().template cast<double>();
    }
  }
  return out;
}

Eigen::MatrixXd stiffness(const Network& network, const Points<double>& x,
                          const StiffnessScale<double>& scale = {}) {
  const SpringPattern<double> pattern(network, BendingBlocks::All, false);
  BlockSymmetric<double> k = pattern.matrix();
  pattern.add_springs(network, x, scale, 1.0, k);
  pattern.add_bending(network, x, scale.bending, k);
  return dense(k);
}

Points<double> forces(const Network& network, const Points<double>& x) {
  Points<double> f = Points<double>::Zero(3, x.cols());
  (void)add_spring_forces<double>(network, x, f);
  return f;
}

// Returns -dF/dx by central differences.
Eigen::MatrixXd stiffness_by_differences(const Network& network, Points<double> x, double step) {
  Eigen::MatrixXd k(x.size(), x.size());
  for (Index i = 0; i < x.size(); ++i) {
    const double here = x.data()[i];
    x.data()[i] = here + step;
    const Points<double> ahead = forces(network, x);
    x.data()[i] = here - step;
    const Points<double> behind = forces(network, x);
    x.data()[i] = here;
    k.col(i) = (behind - ahead).reshaped() / (2 * step);
  }
  return k;
}

}  // namespace

TEST_CASE("forces are minus the derivative of the energy, to second order in the difference step",
          "[cloth]") {
  std::mt19937 random(1);
  for (const Network& network : networks()) {
    const Points<double> x = network.rest_positions + noise(random, network.vertex_count(), 0.004);
    const Points<double> f = forces(network, x);
    Points<double> carry = Points<double>::Ones(3, x.cols());
    CHECK(add_spring_forces<double>(network, x, carry) ==
          Approx(spring_energy<double>(network, x)).epsilon(1e-14));
    CHECK((carry - f - Points<double>::Ones(3, x.cols())).cwiseAbs().maxCoeff() <=
          1e-12 * (1 + f.norm()));  // forces are added to the output
    const auto error = [&](double step) {
      double worst = 0;
      Points<double> y = x;
      for (Index i = 0; i < x.size(); ++i) {
        y.data()[i] = x.data()[i] + step;
        const double ahead = spring_energy<double>(network, y);
        y.data()[i] = x.data()[i] - step;
        const double behind = spring_energy<double>(network, y);
        y.data()[i] = x.data()[i];
        worst = std::max(worst, std::abs(f.data()[i] + (ahead - behind) / (2 * step)));
      }
      return worst;
    };
    const double coarse = error(2e-4), fine = error(1e-4);
    CHECK(fine <= 2e-3 * f.cwiseAbs().maxCoeff());
    CHECK(coarse / fine == Approx(4.0).epsilon(0.1));
  }
}

TEST_CASE("internal forces have zero sum and zero torque, and do not depend on position",
          "[cloth]") {
  std::mt19937 random(2);
  for (const Network& network : networks()) {
    const Points<double> x = network.rest_positions + noise(random, network.vertex_count(), 0.005);
    const Points<double> f = forces(network, x);
    const double size = f.cwiseAbs().sum();
    CHECK(f.rowwise().sum().cwiseAbs().maxCoeff() <= 1e-12 * size);
    Eigen::Vector3d torque = Eigen::Vector3d::Zero();
    for (Index i = 0; i < x.cols(); ++i) torque += x.col(i).cross(f.col(i));
    CHECK(torque.cwiseAbs().maxCoeff() <= 1e-12 * size);
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(0.9, Eigen::Vector3d(1, -2, 3).normalized()).toRotationMatrix();
    Points<double> moved = turn * x;
    moved.colwise() += Eigen::Vector3d(0.3, -0.2, 0.7);
    CHECK((forces(network, moved) - turn * f).cwiseAbs().maxCoeff() <= 1e-10 * size);
    // At rest only hinges that are not flat bend, and here all are flat.
    CHECK(forces(network, network.rest_positions).cwiseAbs().maxCoeff() <= 1e-10);
  }
}

TEST_CASE(
    "the stiffness is -dF/dx: with the compression part anywhere, without it if all springs are "
    "stretched",
    "[cloth]") {
  std::mt19937 random(3);
  StiffnessScale<double> exact;
  exact.compression = 1.0;
  for (const Network& network : networks()) {
    const Points<double> crumpled =
        network.rest_positions + noise(random, network.vertex_count(), 0.004);
    const Eigen::MatrixXd k = stiffness(network, crumpled, exact);
    CHECK((k - k.transpose()).cwiseAbs().maxCoeff() <= 1e-15 * k.cwiseAbs().maxCoeff());
    CHECK((k - stiffness_by_differences(network, crumpled, 1e-6)).cwiseAbs().maxCoeff() <=
          1e-6 * k.cwiseAbs().maxCoeff());

    const Points<double> stretched =
        1.1 * network.rest_positions + noise(random, network.vertex_count(), 2e-5);
    for (const Spring<double>& s : network.springs) {
      REQUIRE((stretched.col(s.a) - stretched.col(s.b)).norm() > s.rest_length);
    }
    const Eigen::MatrixXd projected = stiffness(network, stretched);
    CHECK((projected - stiffness(network, stretched, exact)).cwiseAbs().maxCoeff() == 0.0);
    CHECK((projected - stiffness_by_differences(network, stretched, 1e-6)).cwiseAbs().maxCoeff() <=
          1e-6 * projected.cwiseAbs().maxCoeff());
  }
}

TEST_CASE(
    "the projected stiffness has no negative eigenvalue in a crumpled state; the exact one has",
    "[cloth]") {
  std::mt19937 random(4);
  StiffnessScale<double> exact;
  exact.compression = 1.0;
  for (const Network& network : networks()) {
    for (const double size : {0.003, 0.05, 1.0}) {
      const Points<double> x =
          0.7 * network.rest_positions + noise(random, network.vertex_count(), size);
      const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(stiffness(network, x),
                                                                 Eigen::EigenvaluesOnly);
      CHECK(eigen.eigenvalues().minCoeff() >= -1e-11 * eigen.eigenvalues().maxCoeff());
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(
        stiffness(network, 0.7 * network.rest_positions, exact));
    CHECK(eigen.eigenvalues().minCoeff() < -1e-3 * eigen.eigenvalues().maxCoeff());
  }
}

TEST_CASE("each factor scales its own part of the stiffness", "[cloth]") {
  std::mt19937 random(5);
  const Network network = sheet();
  const Points<double> x = network.rest_positions + noise(random, network.vertex_count(), 0.01);
  const auto part = [&](double axial, double geometric, double bending, double compression) {
    StiffnessScale<double> scale;
    scale.axial = axial;
    scale.geometric = geometric;
    scale.bending = bending;
    scale.compression = compression;
    return stiffness(network, x, scale);
  };
  const Eigen::MatrixXd a = part(1, 0, 0, 0), g = part(0, 1, 0, 0), b = part(0, 0, 1, 0),
                        c = part(0, 0, 0, 1);
  for (const Eigen::MatrixXd& m : {a, g, b, c}) CHECK(m.norm() > 0);
  const double near = 1e-12 * a.norm();
  CHECK((a + g + b - stiffness(network, x)).norm() <= near);
  CHECK((0.3 * a + 2.0 * g + 0.1 * b + 0.5 * c - part(0.3, 2.0, 0.1, 0.5)).norm() <= near);
}

TEST_CASE("bending stencils have constant stiffness and no force in their null space", "[cloth]") {
  std::mt19937 random(6);
  Network row;
  row.rest_positions = Points<double>::Zero(3, 4);
  row.rest_positions.row(0) << 0.0, 0.1, 0.2, 0.3;
  row.mass = Eigen::VectorXd::Ones(4);
  BendStencil<double> three;
  three.vertex = {0, 1, 2, 0};
  three.weight = {1.0, -2.0, 1.0, 0.0};
  three.stiffness = 3.0;
  three.count = 3;
  BendStencil<double> four;
  four.vertex = {3, 0, 2, 1};
  four.weight = {0.5, 0.7, -0.9, -0.3};
  four.stiffness = 2.0;
  four.count = 4;
  BendStencil<double> two;
  two.vertex = {1, 3, 0, 0};
  two.weight = {1.0, -1.0, 0.0, 0.0};
  two.stiffness = 5.0;
  two.count = 2;
  row.bends = {three, four, two};
  REQUIRE(row.validate().empty());

  const Points<double> x = noise(random, 4, 1.0);
  Eigen::MatrixXd w = Eigen::MatrixXd::Zero(3, 4);  // a row for each stencil
  w.row(0) << 1.0, -2.0, 1.0, 0.0;
  w.row(1) << 0.7, -0.3, -0.9, 0.5;
  w.row(2) << 0.0, 1.0, 0.0, -1.0;
  const Eigen::MatrixXd small = w.transpose() * Eigen::Vector3d(3.0, 2.0, 5.0).asDiagonal() * w;
  CHECK((forces(row, x) + x * small).cwiseAbs().maxCoeff() <= 1e-13);
  CHECK(spring_energy<double>(row, x) == Approx(0.5 * (x * small * x.transpose()).trace()));
  const Eigen::MatrixXd k = stiffness(row, x);
  for (Index i = 0; i < 4; ++i) {
    for (Index j = 0; j < 4; ++j) {
      const Eigen::Matrix3d block = k.block<3, 3>(3 * i, 3 * j);
      CHECK((block - small(i, j) * Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() <= 1e-14);
    }
  }
  // Without bending in the pattern, nothing is added.
  const SpringPattern<double> bare(row, BendingBlocks::Absent, false);
  BlockSymmetric<double> none = bare.matrix();
  bare.add_bending(row, x, 1.0, none);
  CHECK(dense(none).isZero());
}

TEST_CASE("twice the bending of neighbours bounds bending from above", "[cloth]") {
  std::mt19937 random(8);
  const Network network = sheet();
  const Points<double> x = network.rest_positions + noise(random, network.vertex_count(), 0.01);
  const auto bending = [&](BendingBlocks blocks) {
    const SpringPattern<double> pattern(network, blocks, false);
    BlockSymmetric<double> k = pattern.matrix();
    pattern.add_bending(network, x, 2.0, k);
    return dense(k);
  };
  const Eigen::MatrixXd exact = bending(BendingBlocks::All),
                        ties = bending(BendingBlocks::Neighbours);
  CHECK(bending(BendingBlocks::Absent).isZero());
  REQUIRE(exact.norm() > 0);
  const auto least = [](const Eigen::MatrixXd& m) {
    return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(m).eigenvalues().minCoeff();
  };
  CHECK(least(2 * ties - exact) > -1e-12 * exact.norm());
  CHECK(least(ties - exact) < -1e-3 * exact.norm());  // once is not enough
  // A translation costs nothing. On a grid, neighbours are springs: no block is added.
  for (Index c = 0; c < 3; ++c) {
    Eigen::VectorXd shift = Eigen::VectorXd::Zero(ties.rows());
    for (Index i = c; i < shift.size(); i += 3) shift[i] = 1;
    CHECK((ties * shift).norm() < 1e-12 * ties.norm());
  }
  CHECK(SpringPattern<double>(network, BendingBlocks::Neighbours, false).matrix().lower_count() ==
        SpringPattern<double>(network, BendingBlocks::Absent, false).matrix().lower_count());
}

TEST_CASE(
    "the frozen part has dampers along the given directions and a ninth of the air force in nine "
    "blocks",
    "[cloth]") {
  std::mt19937 random(7);
  Network network = sheet();
  const Index n = network.vertex_count();
  for (std::size_t e = 0; e < network.springs.size(); e += 3) network.springs[e].damping = 0.0;
  const Points<double> x = network.rest_positions + noise(random, n, 0.01),
                       v = noise(random, n, 0.5);
  const Eigen::Vector3d wind(1.0, -2.0, 0.5);
  AirSettings<double> settings;
  settings.normal_coefficient = 1.2;
  settings.tangent_coefficient = 0.1;
  Points<double> direction = Points<double>::Zero(3, static_cast<Index>(network.springs.size()));
  std::vector<Eigen::Matrix3d> air(network.triangles.size());
  Points<double> push = Points<double>::Zero(3, n);
  spring_directions<double>(network, x, direction);
  freeze_air<double>(network, x, v, wind, settings, air, push);
  const SpringPattern<double> pattern(network, BendingBlocks::All, true);
  BlockSymmetric<double> frozen = pattern.matrix();
  const double dt = 0.02;
  pattern.add_frozen(network, direction, air, dt, frozen);
  const Eigen::MatrixXd r = dense(frozen);

  // h (D + C) v, spring by spring and triangle by triangle.
  Points<double> damping = Points<double>::Zero(3, n);
  for (const Spring<double>& s : network.springs) {
    const Eigen::Vector3d unit = (x.col(s.a) - x.col(s.b)).normalized();
    const Eigen::Vector3d f = s.damping * unit.dot(v.col(s.a) - v.col(s.b)) * unit;
    damping.col(s.a) += f;
    damping.col(s.b) -= f;
  }
  Points<double> drag = Points<double>::Zero(3, n);
  add_air_forces<double>(network.triangles, x, v, wind, settings, drag);
  const Points<double> product =
      Eigen::Map<const Points<double>>(Eigen::VectorXd(r * v.reshaped()).data(), 3, n);
  CHECK((product - dt * (damping + push - drag)).cwiseAbs().maxCoeff() <=
        1e-13);  // C v = C w - F(v)
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(r, Eigen::EigenvaluesOnly);
  CHECK(eigen.eigenvalues().minCoeff() >= -1e-14);
}

TEMPLATE_TEST_CASE("coincident ends give no force, no direction and a definite block", "[cloth]",
                   float, double) {
  using S = TestType;
  SpringNetwork<S> pair;
  pair.rest_positions = Points<S>::Zero(3, 2);
  pair.rest_positions(0, 1) = S(0.1);
  pair.mass = VectorX<S>::Ones(2);
  pair.springs = {{0, 1, S(0.1), S(50), S(1)}};
  for (const double gap : {0.0, 1e-9, 1e-30}) {
    Points<S> x = Points<S>::Constant(3, 2, S(0.25));
    x(1, 1) += S(gap);
    Points<S> f = Points<S>::Zero(3, 2), direction = Points<S>::Ones(3, 1);
    const S energy = add_spring_forces<S>(pair, x, f);
    CHECK(f.isZero());
    CHECK(static_cast<double>(energy) == Approx(0.5 * 50 * 0.01).epsilon(1e-5));
    spring_directions<S>(pair, x, direction);
    CHECK(direction.isZero());
    const SpringPattern<S> pattern(pair, BendingBlocks::All, false);
    BlockSymmetric<S> k = pattern.matrix();
    pattern.add_springs(pair, x, {}, S(1), k);
    CHECK(k.diagonal(0) == Matrix3<S>(S(50) * Matrix3<S>::Identity()));
    CHECK(k.lower(0) == Matrix3<S>(S(-50) * Matrix3<S>::Identity()));
  }
}

TEST_CASE("forces and assembly do not allocate", "[cloth]") {
  const Network network = triangle_sheet();
  const Points<double> x = 1.01 * network.rest_positions;
  Points<double> f = Points<double>::Zero(3, x.cols());
  Points<double> direction = Points<double>::Zero(3, static_cast<Index>(network.springs.size()));
  std::vector<Eigen::Matrix3d> air(network.triangles.size());
  const SpringPattern<double> pattern(network, BendingBlocks::All, true);
  BlockSymmetric<double> a = pattern.matrix();
  const long before = clothctl_test::allocations();
  (void)add_spring_forces<double>(network, x, f);
  (void)spring_energy<double>(network, x);
  spring_directions<double>(network, x, direction);
  freeze_air<double>(network, x, x, Eigen::Vector3d::UnitY(), AirSettings<double>(), air, f);
  pattern.add_springs(network, x, {}, 1.0, a);
  pattern.add_bending(network, x, 1.0, a);
  pattern.add_frozen(network, direction, air, 1.0, a);
  const long during = clothctl_test::allocations() - before;
  if (clothctl_test::allocation_counting_works()) CHECK(during == 0);
}
