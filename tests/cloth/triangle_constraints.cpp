// Triangle elements of position-based sheets: the constraints, and sheets made of them.

#include "clothctl/cloth/detail/triangle_constraints.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Geometry>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/network/triangle_elements.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"

using namespace clothctl;
using namespace clothctl::detail;

namespace {

using Corners = std::array<Triple<double>, 3>;
using Plane = DenseMatrix<double, 2, 2>;

struct Numbers {
  std::mt19937 random{7};
  std::normal_distribution<double> normal;
  double operator()() { return normal(random); }
};

Corners corners(const Eigen::Matrix3d& m) { return {column(m, 0), column(m, 1), column(m, 2)}; }

Plane edges(double a, double b, double c, double d) {
  Plane out;
  out << a, b, c, d;
  return out;
}

TriangleElement<double> element(const Plane& rest, double stiffness = 10.0) {
  TriangleElement<double> out;
  out.vertex = {0, 1, 2};
  REQUIRE(out.set_rest(rest));
  out.warp = out.weft = out.shear = out.area = stiffness;
  return out;
}

// Triangles in the plane z = 0 with the corners at rest in columns, and as an item.
struct Case {
  Plane rest;
  TriangleItem<double> item;
  explicit Case(const Plane& shape)
      : rest(shape), item(list_triangles<double>({element(shape)})[0]) {}
  Eigen::Matrix3d flat() const {
    Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
    m.block<2, 2>(0, 1) = rest;
    return m;
  }
};

std::vector<Case> cases() {
  return {Case(edges(1, 0, 0, 1)), Case(edges(0.2, 0.1, -0.1, 0.3)), Case(edges(2, -1, 0.5, 3))};
}

// A network of triangles without springs, of `density` kg/m²; at rest in the plane z = 0.
SpringNetwork<double> membrane(int rows, int cols, double width, double height, double density,
                               const MembraneStiffness<double>& stiffness, double uneven = 0) {
  const GridMesh<double> grid = make_grid<double>(rows, cols, width, height).value();
  Material<double> material;
  SpringNetwork<double> network = sheet_network<double>(grid, material).value();
  network.springs.clear();
  network.bends.clear();
  Numbers noise;
  Points<double>& x = network.rest_positions;
  const Vector3<double> low = x.rowwise().minCoeff();
  const int up = low[1] < x.row(1).maxCoeff() ? 1 : 2;
  for (Index v = 0; v < x.cols(); ++v) {
    const Vector3<double> p = x.col(v);
    x.col(v) << p[0] - low[0], p[up] - low[up], 0;
  }
  for (int i = 1; i + 1 < rows; ++i) {
    for (int j = 1; j + 1 < cols; ++j) {
      x(0, i * cols + j) += uneven * width / cols * std::clamp(noise(), -1.0, 1.0);
      x(1, i * cols + j) += uneven * height / rows * std::clamp(noise(), -1.0, 1.0);
    }
  }
  network.mass.setZero();
  for (std::array<int, 3>& t : network.triangles) {
    const Vector3<double> a = x.col(t[1]) - x.col(t[0]), b = x.col(t[2]) - x.col(t[0]);
    const double twice = a[0] * b[1] - a[1] * b[0];
    if (twice < 0) std::swap(t[1], t[2]);
    for (const int v : t) network.mass[v] += density * std::abs(twice) / 6;
  }
  const MaterialPoints<double> flat = x.topRows(2);
  return add_flat_triangle_elements<double>(network, flat, stiffness).value();
}

PositionBased<double> model_of(const SpringNetwork<double>& network,
                               PositionBasedSettings<double> settings) {
  auto made = PositionBased<double>::create(network, std::move(settings));
  INFO((made ? std::string() : made.error()));
  REQUIRE(made);
  return std::move(made).value();
}

PositionBasedSettings<double> weightless(double drag, int iterations) {
  PositionBasedSettings<double> settings;
  settings.gravity.setZero();
  settings.drag = drag;
  settings.iterations = iterations;
  return settings;
}

double total_area(const SpringNetwork<double>& network, const Points<double>& x) {
  double sum = 0;
  for (const auto& t : network.triangles) {
    const Eigen::Vector3d a = x.col(t[1]) - x.col(t[0]), b = x.col(t[2]) - x.col(t[0]);
    sum += 0.5 * a.cross(b).norm();
  }
  return sum;
}

// The least and the largest elongation along warp and weft of all triangles.
struct Strains {
  double low_u = 1, high_u = -1, low_v = 1, high_v = -1;
};
Strains strains(const SpringNetwork<double>& network, const Points<double>& x) {
  Strains out;
  for (const TriangleItem<double>& t : list_triangles(network.elements)) {
    const Corners p{column(x, t.vertex[0]), column(x, t.vertex[1]), column(x, t.vertex[2])};
    const double u = triangle_constraint(t, kWarp, p).value;
    const double v = triangle_constraint(t, kWeft, p).value;
    out.low_u = std::min(out.low_u, u);
    out.high_u = std::max(out.high_u, u);
    out.low_v = std::min(out.low_v, v);
    out.high_v = std::max(out.high_v, v);
  }
  return out;
}

}  // namespace

TEST_CASE("the gradients of triangle constraints are their differences", "[cloth]") {
  Numbers noise;
  for (const Case& c : cases()) {
    for (int trial = 0; trial < 20; ++trial) {
      const Eigen::Matrix3d p = Eigen::Matrix3d::NullaryExpr([&](Index, Index) { return noise(); });
      for (std::size_t kind = 0; kind < kTriangleConstraints; ++kind) {
        const TriangleConstraint<double> at = triangle_constraint(c.item, kind, corners(p));
        Eigen::Vector3d force = Eigen::Vector3d::Zero(), moment = force;
        double size = 0;
        for (std::size_t i = 0; i < 3; ++i) {
          const Triple<double>& gi = at.gradient[i];
          const Eigen::Vector3d g(gi.x, gi.y, gi.z);
          force += g;
          moment += p.col(Index(i)).cross(g);
          size += g.norm() * (1 + p.col(Index(i)).norm());
          for (Index k = 0; k < 3; ++k) {
            const double step = 1e-6;
            Eigen::Matrix3d up = p, down = p;
            up(k, Index(i)) += step;
            down(k, Index(i)) -= step;
            const double slope = (triangle_constraint(c.item, kind, corners(up)).value -
                                  triangle_constraint(c.item, kind, corners(down)).value) /
                                 (2 * step);
            CHECK(std::abs(slope - g[k]) < 1e-5 * (1 + size));
          }
        }
        // Neither a translation nor a rotation changes a constraint.
        CHECK(force.norm() < 1e-13 * size);
        CHECK(moment.norm() < 1e-13 * size);
      }
    }
  }
}

TEST_CASE("known strains of a triangle", "[cloth]") {
  Numbers noise;
  for (const Case& c : cases()) {
    const auto values = [&](const Eigen::Matrix3d& map) {
      std::array<double, kTriangleConstraints> out{};
      const Corners p = corners(map * c.flat());
      for (std::size_t kind = 0; kind < out.size(); ++kind)
        out[kind] = triangle_constraint(c.item, kind, p).value;
      return out;
    };
    for (int trial = 0; trial < 10; ++trial) {
      const Eigen::Matrix3d R =
          Eigen::Quaterniond(noise(), noise(), noise(), noise()).normalized().toRotationMatrix();
      for (const double value : values(R)) CHECK(std::abs(value) < 1e-13);
      Eigen::Matrix3d F = Eigen::Matrix3d::Identity();
      F(0, 0) = 1.25;
      F(1, 1) = 0.8;
      const auto stretched = values(R * F);
      CHECK(stretched[kWarp] == Approx(0.25));
      CHECK(stretched[kWeft] == Approx(-0.2));
      CHECK(std::abs(stretched[kShear]) < 1e-12);
      CHECK(std::abs(stretched[kArea]) < 1e-12);
      F = Eigen::Matrix3d::Identity();
      F(0, 1) = 0.3;  // simple shear keeps the area
      const auto sheared = values(R * F);
      CHECK(std::abs(sheared[kWarp]) < 1e-12);
      CHECK(sheared[kWeft] == Approx(std::sqrt(1.09) - 1));
      CHECK(sheared[kShear] == Approx(0.3));
      CHECK(std::abs(sheared[kArea]) < 1e-12);
    }
  }
}

TEST_CASE("a sheet of elements at rest stays, wherever it is", "[cloth]") {
  const auto network = membrane(5, 6, 0.5, 0.4, 0.2, {500, 300, 200, 100}, 0.2);
  PositionBasedSettings<double> settings;
  settings.gravity.setZero();
  const auto model = model_of(network, settings);
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  const Eigen::Matrix3d R = Eigen::AngleAxisd(1.1, Eigen::Vector3d(1, 2, 3).normalized()).matrix();
  state.positions = (R * state.positions).colwise() + Eigen::Vector3d(1, -2, 3);
  state.velocities.colwise() = Eigen::Vector3d(0.3, 0.2, -0.1);
  const Points<double> start = state.positions;
  for (int i = 0; i < 20; ++i) REQUIRE(model.step(state, {}, 0.02, ws).advanced);
  const Points<double> moved = start.colwise() + Eigen::Vector3d(0.3, 0.2, -0.1) * 0.4;
  CHECK((state.positions - moved).cwiseAbs().maxCoeff() < 1e-11);
}

TEST_CASE("a strip under load is strained by load over stiffness and width", "[cloth]") {
  const double width = 0.2, height = 0.4, stiffness = 40.0, load = 0.08;
  const int rows = 7, cols = 4;
  const double poisson = GENERATE(0.0, 0.3);
  const auto network = membrane(rows, cols, width, height, 0.2,
                                MembraneStiffness<double>::isotropic(stiffness, poisson), 0.25);
  const auto model = model_of(network, weightless(8, 10));
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  ClothInput<double> input;  // both ends are pulled, so that they can contract
  input.forces.setZero(3, 2 * cols);
  for (int end = 0; end < 2; ++end) {
    for (int j = 0; j < cols; ++j) {
      const double share = (j == 0 || j == cols - 1 ? 0.5 : 1.0) / (cols - 1);
      input.force_vertices.push_back(end == 0 ? j : (rows - 1) * cols + j);
      const bool below = network.rest_positions(1, input.force_vertices.back()) < height / 2;
      input.forces(1, end * cols + j) = (below ? -1 : 1) * load * share;
    }
  }
  for (int i = 0; i < 400; ++i) REQUIRE(model.step(state, input, 0.02, ws).advanced);
  const Strains strain = strains(network, state.positions);
  const double expected = load / (stiffness * width);  // 1 %
  INFO(strain.low_v << " to " << strain.high_v << ", " << strain.low_u << " to " << strain.high_u);
  CHECK(std::abs(strain.low_v / expected - 1) < 0.02);
  CHECK(std::abs(strain.high_v / expected - 1) < 0.02);
  // Second-order terms of the energy are of the size of the strain, 1 %.
  CHECK(std::abs(strain.low_u / expected + poisson) < 0.02);
  CHECK(std::abs(strain.high_u / expected + poisson) < 0.02);
  if (poisson == 0.0) CHECK(std::abs(strain.high_v / expected - 1) < 1e-4);
}

TEST_CASE("elements of area alone keep the area and nothing else", "[cloth]") {
  const double side = 0.3;
  const int n = 4;
  const auto network = membrane(n, n, side, side, 0.2, {0, 0, 0, 2000});
  const auto model = model_of(network, weightless(3, 20));
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  for (int i = 1; i <= 50; ++i) {  // the ends of the sheet are driven apart by a tenth
    ClothInput<double> input;
    for (Index v = 0; v < network.vertex_count(); ++v) {
      const double y = network.rest_positions(1, v);
      if (y > 0.01 * side && y < 0.99 * side) continue;
      input.driven_vertices.push_back(static_cast<int>(v));
    }
    input.driven_positions.resize(3, static_cast<Index>(input.driven_vertices.size()));
    for (Index k = 0; k < input.driven_positions.cols(); ++k) {
      const int v = input.driven_vertices[static_cast<std::size_t>(k)];
      input.driven_positions.col(k) = network.rest_positions.col(v);
      if (network.rest_positions(1, v) > 0.5 * side) {
        input.driven_positions(0, k) += 0.002 * side * i;
        input.driven_positions(1, k) += 0.002 * side * i;
      }
    }
    REQUIRE(model.step(state, input, 0.02, ws).advanced);
  }
  CHECK(total_area(network, state.positions) == Approx(side * side).epsilon(0.01));
  CHECK(strains(network, state.positions).high_v > 0.05);
}

TEST_CASE("a free sheet of elements keeps its momentum", "[cloth]") {
  const auto network = membrane(5, 5, 0.3, 0.3, 0.2, {200, 150, 80, 50}, 0.2);
  PositionBasedSettings<double> settings;
  settings.gravity.setZero();
  const auto angular = [&](const ClothState<double>& s) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (Index v = 0; v < network.vertex_count(); ++v)
      sum += network.mass[v] *
             Eigen::Vector3d(s.positions.col(v)).cross(Eigen::Vector3d(s.velocities.col(v)));
    return sum;
  };
  // A correction has no moment about the corrected positions, but one of order h about those at the
  // start of the substep, as with springs.
  std::vector<double> lost;
  for (const int substeps : {20, 80}) {
    settings.substeps = substeps;
    const auto model = model_of(network, settings);
    auto ws = model.make_workspace();
    ClothState<double> state = model.rest_state();
    Numbers noise;
    for (Index k = 0; k < state.velocities.size(); ++k) state.velocities.data()[k] = 0.1 * noise();
    const Eigen::Vector3d linear = state.velocities * network.mass, before = angular(state);
    for (int i = 0; i < 20; ++i) REQUIRE(model.step(state, {}, 0.02, ws).advanced);
    CHECK((state.velocities * network.mass - linear).norm() < 1e-12);
    lost.push_back((angular(state) - before).norm() / before.norm());
  }
  INFO(lost[0] << ", " << lost[1]);
  CHECK(lost[0] < 0.02);
  CHECK(lost[1] < 0.4 * lost[0]);
}

TEST_CASE("a hanging sheet of elements sinks as a rod does at any resolution", "[cloth]") {
  const double side = 0.3, density = 0.2, stiffness = 30.0;
  const double expected = density * 9.81 * side * side / (2 * stiffness);
  for (const int n : {5, 9, 17}) {
    const auto network = membrane(n, n, side, side, density, {stiffness, stiffness, 15, 0});
    PositionBasedSettings<double> settings;
    settings.gravity = Vector3<double>(0, -9.81, 0);
    settings.drag = 8;
    settings.substeps = 10;
    settings.iterations = n;
    double top = network.rest_positions.row(1).maxCoeff();
    Index lowest = 0;
    for (Index v = 0; v < network.vertex_count(); ++v) {
      if (network.rest_positions(1, v) > top - 1e-9) settings.pinned.push_back(static_cast<int>(v));
      if (network.rest_positions(1, v) < 1e-9) lowest = v;
    }
    const auto model = model_of(network, settings);
    auto ws = model.make_workspace();
    ClothState<double> state = model.rest_state();
    for (int i = 0; i < 150; ++i) REQUIRE(model.step(state, {}, 0.02, ws).advanced);
    const double sunk = -state.positions(1, lowest);
    INFO(n << ": " << sunk << " m, " << expected);
    CHECK(sunk == Approx(expected).epsilon(0.02));
  }
}

TEST_CASE("collapsed triangles stay finite", "[cloth]") {
  const auto network = membrane(5, 5, 0.3, 0.3, 0.2, {1e6, 1e6, 1e6, 1e6});
  for (const bool limited : {false, true}) {
    PositionBasedSettings<double> settings;
    if (limited) settings.stretch_limit = 0.02;
    const auto model = model_of(network, settings);
    auto ws = model.make_workspace();
    for (const int shape : {0, 1, 2}) {
      ClothState<double> state = model.rest_state();
      if (shape == 0) state.positions.setZero();
      if (shape == 1) state.positions.bottomRows(2).setZero();  // on a line
      if (shape == 2) state.positions.col(7) = state.positions.col(8);
      for (int i = 0; i < 20; ++i) REQUIRE(model.step(state, {}, 0.02, ws).advanced);
      CHECK(all_finite(state.positions));
      CHECK(all_finite(state.velocities));
    }
  }
}

TEST_CASE("a constraint without a gradient keeps its multipliers", "[cloth]") {
  const Case c(edges(1, 0, 0, 1));
  const std::vector<TriangleItem<double>> items{c.item};
  std::vector<TriangleMultipliers<double>> multipliers{{0, 0, 0, 0}};
  VectorX<double> points = VectorX<double>::Zero(12);
  for (const Index v : {0, 1, 2}) points[4 * v + 3] = 1;
  for (int sweep = 0; sweep < 5; ++sweep) {  // all corners at one place: only λ could change
    sweep_triangles<double>(items, 0.1, multipliers, points.data(),
                            SweepPlaces(SweepOrder::Forward, 0, items.size()));
    for (const double multiplier : multipliers[0]) CHECK(multiplier == 0);
  }
  // Opened again within the substep, the element is pulled as if the sweeps had not been.
  VectorX<double> fresh = points;
  for (VectorX<double>* list : {&points, &fresh}) {
    (*list)[4] = 1.3;
    (*list)[9] = 0.8;
  }
  std::vector<TriangleMultipliers<double>> none{{0, 0, 0, 0}};
  sweep_triangles<double>(items, 0.1, multipliers, points.data(),
                          SweepPlaces(SweepOrder::Forward, 0, items.size()));
  sweep_triangles<double>(items, 0.1, none, fresh.data(),
                          SweepPlaces(SweepOrder::Forward, 0, items.size()));
  CHECK(points == fresh);
}

TEST_CASE("with drag, an element acts like an attachment of its stiffness", "[cloth]") {
  // Two corners are pinned, the third one moves along the warp: C = x - 1, so k A_0 (x - 1) is the
  // force, as that of a spring to the point at rest.
  const double stiffness = 12.0, drag = GENERATE(0.0, 3.0, 40.0), h = 0.02;
  SpringNetwork<double> network;
  network.rest_positions.setZero(3, 3);
  network.rest_positions(0, 1) = network.rest_positions(1, 2) = 1;
  network.mass = Eigen::Vector3d(0.1, 0.02, 0.1);
  const SpringNetwork<double> plain = network;
  TriangleElement<double> warp = element(edges(1, 0, 0, 1), 0.0);
  warp.warp = stiffness;
  network.elements.push_back(warp);
  ClothInput<double> attached;
  attached.attached_vertices = {1};
  attached.attached_positions = network.rest_positions.col(1);
  attached.attachment_stiffness = VectorX<double>::Constant(1, stiffness * 0.5);
  for (const bool verlet : {false, true}) {
    PositionBasedSettings<double> settings =
        verlet ? PositionBasedSettings<double>::verlet() : PositionBasedSettings<double>();
    settings.verlet_damping = 0;
    settings.gravity.setZero();
    settings.drag = drag;
    settings.substeps = 1;
    settings.pinned = {0, 2};
    const auto run = [&](const SpringNetwork<double>& body, const ClothInput<double>& input) {
      const auto model = model_of(body, settings);
      auto ws = model.make_workspace();
      ClothState<double> state = model.rest_state();
      state.positions(0, 1) = 1.3;
      for (int i = 0; i < 10; ++i) REQUIRE(model.step(state, input, h, ws).advanced);
      return state;
    };
    INFO("verlet " << verlet << ", drag " << drag);
    const ClothState<double> a = run(network, {}), b = run(plain, attached);
    CHECK((a.positions - b.positions).norm() < 1e-14);
    CHECK((a.velocities - b.velocities).norm() < 1e-12);
    // And both as implicit Euler says.
    double x = 1.3, v = 0;
    for (int i = 0; i < 10; ++i) {
      const double k = stiffness * 0.5, m = network.mass[1];
      v = (m * v - h * k * (x - 1)) / (m * (1 + h * drag) + h * h * k);
      x += h * v;
    }
    CHECK(a.positions(0, 1) == Approx(x).epsilon(1e-12));
  }
}

TEST_CASE("elements without stiffness change nothing, others do without allocation", "[cloth]") {
  auto network =
      sheet_network<double>(make_grid<double>(6, 6, 0.3, 0.3).value(), Material<double>()).value();
  const Eigen::Vector3d warp(1, 0, 0);
  const auto empty =
      add_triangle_elements<double>(network, warp, MembraneStiffness<double>{}).value();
  const auto elastic = add_triangle_elements<double>(network, warp, {100, 100, 50, 20}).value();
  for (const bool verlet : {false, true}) {
    PositionBasedSettings<double> settings =
        verlet ? PositionBasedSettings<double>::verlet() : PositionBasedSettings<double>();
    settings.pinned = {0};
    const auto run = [&](const SpringNetwork<double>& n) {
      const auto model = model_of(n, settings);
      auto ws = model.make_workspace();
      ClothState<double> state = model.rest_state();
      const long before = clothctl_test::allocations();
      bool advanced = true;
      for (int i = 0; i < 10; ++i) advanced = model.step(state, {}, 0.02, ws).advanced && advanced;
      const long during = clothctl_test::allocations() - before;
      CHECK(advanced);
      if (clothctl_test::allocation_counting_works()) CHECK(during == 0);
      return state;
    };
    CHECK(run(empty) == run(network));
    CHECK_FALSE(run(elastic) == run(network));
    CHECK(run(elastic) == run(elastic));
  }
}

TEST_CASE("a limit of stretch holds a sheet with elements", "[cloth]") {
  auto network =
      sheet_network<double>(make_grid<double>(12, 12, 0.5, 0.5).value(), Material<double>())
          .value();
  network = add_triangle_elements<double>(network, Vector3<double>(1, 0, 0), {300, 300, 100, 100})
                .value();
  PositionBasedSettings<double> settings;
  settings.stretch_limit = 0.03;
  settings.pinned = {0, 11};
  const auto model = model_of(network, settings);
  auto ws = model.make_workspace();
  ClothState<double> state = model.rest_state();
  for (int i = 0; i < 100; ++i) {
    const auto report = model.step(state, {}, 1.0 / 60, ws);
    REQUIRE(report.advanced);
    CHECK(report.residual <= 0.03);
  }
}

TEST_CASE("the mass-spring model refuses triangle elements by name", "[cloth]") {
  const auto network = membrane(3, 3, 0.3, 0.3, 0.2, {10, 10, 10, 10});
  const auto made = MassSpring<double>::create(network);
  REQUIRE_FALSE(made);
  CHECK(made.error() ==
        "the network has 8 triangle elements, which MassSpring does not simulate; use "
        "PositionBased");
}
