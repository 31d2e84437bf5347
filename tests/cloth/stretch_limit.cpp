// Position-based sheets with a limit of stretch.

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mesh/garment_patterns.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/garment.hpp"
#include "clothctl/network/materials.hpp"
#include "clothctl/network/sheet.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sweeps.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::irregular_sheet;
using clothctl_test::Numbers;

namespace {

constexpr double kFrame = 0.02;

/// A network with its two upper corners.
template <class Scalar>
struct Sheet {
  std::string name;
  SpringNetwork<Scalar> network;
  std::vector<int> corners;
};

template <class Scalar>
Sheet<Scalar> grid_sheet(int rows, int cols, double side = 0.5) {
  const GridMesh<double> mesh =
      make_grid<double>(rows, cols, side, side * (rows - 1) / (cols - 1)).value();
  return {std::to_string(rows) + " × " + std::to_string(cols),
          sheet_network<double>(mesh, Material<double>()).value().cast<Scalar>(),
          {(rows - 1) * cols, rows * cols - 1}};
}

template <class Scalar>
Sheet<Scalar> triangle_sheet(int rows, int cols, unsigned seed) {
  const double spacing = 0.017;
  auto mesh = irregular_sheet(rows, cols, spacing, 0.2, seed);
  Sheet<Scalar> sheet{"triangles " + std::to_string(rows) + " × " + std::to_string(cols), {}, {}};
  for (const double x : {0.0, spacing * (cols - 1)}) {
    Index best = 0;
    (mesh.positions.colwise() - Vector3<double>(x, spacing * (rows - 1), 0))
        .colwise()
        .norm()
        .minCoeff(&best);
    sheet.corners.push_back(static_cast<int>(best));
  }
  sheet.network = sheet_network<double>(mesh.positions, mesh.triangles, Material<double>())
                      .value()
                      .template cast<Scalar>();
  return sheet;
}

template <class Scalar>
double largest_stretch(const SpringNetwork<Scalar>& network, const Points<Scalar>& positions) {
  double most = -1.0;
  for (const Spring<Scalar>& s : network.springs) {
    if (!(Scalar(0) < s.stiffness) || s.kind == SpringKind::Bend) continue;
    const double length = static_cast<double>((positions.col(s.a) - positions.col(s.b)).norm());
    most = std::max(most, length / static_cast<double>(s.rest_length) - 1.0);
  }
  return most;
}

template <class Scalar>
PositionBased<Scalar> make(const Sheet<Scalar>& sheet, PositionBasedSettings<Scalar> settings) {
  Result<PositionBased<Scalar>> made =
      PositionBased<Scalar>::create(sheet.network, std::move(settings));
  if (!made) FAIL(made.error());
  return std::move(made).value();
}

template <class Scalar>
PositionBasedSettings<Scalar> limited(double limit, int substeps, std::vector<int> pinned) {
  PositionBasedSettings<Scalar> settings;
  settings.stretch_limit = Scalar(limit);
  settings.substeps = substeps;
  settings.drag = Scalar(0.1);
  settings.pinned = std::move(pinned);
  return settings;
}

/// The sheet lies flat in the x-y plane.
template <class Scalar>
ClothState<Scalar> level_state(const PositionBased<Scalar>& model) {
  ClothState<Scalar> state = model.rest_state();
  for (Index v = 0; v < state.positions.cols(); ++v) {
    if (!(state.positions(2, v) < Scalar(0))) continue;
    state.positions(1, v) = state.positions(2, v);
    state.positions(2, v) = Scalar(0);
  }
  return state;
}

/// What happened in some frames.
struct Run {
  int over = 0, refused = 0, wrong_reports = 0;
  double worst = 0.0, furthest = 0.0;
};

/// Runs frames; `input(k)` gives the input of frame k.
template <class Scalar, class Input>
Run run(const PositionBased<Scalar>& model, ClothState<Scalar>& state, int frames, Input input) {
  Run out;
  auto workspace = model.make_workspace();
  const double limit = static_cast<double>(model.settings().stretch_limit);
  for (int k = 0; k < frames; ++k) {
    const StepReport<Scalar> report = model.step(state, input(k), Scalar(kFrame), workspace);
    REQUIRE(report.advanced);
    const double stretch = largest_stretch(model.network(), state.positions),
                 residual = static_cast<double>(report.residual);
    out.worst = std::max(out.worst, stretch);
    if (stretch > limit) ++out.over;
    const bool above = residual > limit * (1.0 + 1e-5), below = residual < limit * (1.0 - 1e-5);
    if (above && report.status != StepStatus::IterationLimit) ++out.wrong_reports;
    if (below && report.status != StepStatus::Converged) ++out.wrong_reports;
    // The last sweep met each edge shortly before the end; after that it may have become shorter.
    if (std::max(residual, stretch) > 0.5 * limit &&
        (residual < 0.4 * stretch || stretch < 0.2 * residual))
      ++out.wrong_reports;
    out.furthest =
        std::max(out.furthest, static_cast<double>(state.positions.cwiseAbs().maxCoeff()));
  }
  return out;
}

const auto kNoInput = [](int) { return ClothInput<double>(); };

/// Σ m v and Σ m x × v.
template <class Scalar>
std::array<Vector3<double>, 2> momentum(const SpringNetwork<Scalar>& network,
                                        const ClothState<Scalar>& state) {
  std::array<Vector3<double>, 2> sum{Vector3<double>::Zero(), Vector3<double>::Zero()};
  for (Index v = 0; v < network.vertex_count(); ++v) {
    const Vector3<double> x = state.positions.col(v).template cast<double>(),
                          p = static_cast<double>(network.mass[v]) *
                              state.velocities.col(v).template cast<double>();
    sum[0] += p;
    sum[1] += Vector3<double>(x[1] * p[2] - x[2] * p[1], x[2] * p[0] - x[0] * p[2],
                              x[0] * p[1] - x[1] * p[0]);
  }
  return sum;
}

}  // namespace

TEST_CASE("sheets of any size that drop from two corners keep the limit", "[stretch_limit]") {
  std::vector<Sheet<double>> sheets;
  for (const auto& [rows, cols] : std::vector<std::array<int, 2>>{
           {33, 33}, {24, 17}, {9, 9}, {13, 13}, {17, 17}, {31, 31}, {9, 40}, {40, 15}, {20, 60}})
    sheets.push_back(grid_sheet<double>(rows, cols));
  for (const auto& [rows, cols] : std::vector<std::array<int, 2>>{{33, 30}, {12, 12}, {20, 20}})
    sheets.push_back(triangle_sheet<double>(rows, cols, 3));
  for (const Sheet<double>& sheet : sheets) {
    for (const int substeps : {20, 10}) {
      const PositionBased<double> model =
          make(sheet, limited<double>(0.02, substeps, sheet.corners));
      ClothState<double> state = level_state(model);
      const Run result = run(model, state, 75, kNoInput);
      INFO(sheet.name << ", " << substeps << " substeps: largest stretch " << result.worst);
      CHECK(result.over <= 3);
      CHECK(result.worst < 0.03);
      CHECK(result.wrong_reports == 0);
      CHECK(result.furthest < 3.0);
      CHECK(state.positions.row(2).minCoeff() < -0.05);  // it has dropped
      for (int v : sheet.corners) CHECK(state.velocities.col(v).isZero(0.0));
    }
  }
}

TEST_CASE("without a limit the same sheets stretch more, and the report says nothing",
          "[stretch_limit]") {
  const Sheet<double> sheet = grid_sheet<double>(33, 33);
  const PositionBased<double> model = make(sheet, limited<double>(0.0, 10, sheet.corners));
  ClothState<double> state = level_state(model);
  auto workspace = model.make_workspace();
  double worst = 0;
  for (int k = 0; k < 50; ++k) {
    const StepReport<double> report = model.step(state, {}, kFrame, workspace);
    REQUIRE(report.status == StepStatus::Converged);
    CHECK(report.residual == 0.0);
    worst = std::max(worst, largest_stretch(sheet.network, state.positions));
  }
  CHECK(worst > 0.1);
}

TEST_CASE("a larger limit leaves a soft sheet softer", "[stretch_limit]") {
  Sheet<double> sheet = grid_sheet<double>(25, 25);
  for (Spring<double>& s : sheet.network.springs) s.stiffness *= 0.02;
  std::vector<double> worst;
  for (const double limit : {0.02, 0.1}) {
    const PositionBased<double> model = make(sheet, limited<double>(limit, 20, sheet.corners));
    ClothState<double> state = level_state(model);
    const Run result = run(model, state, 75, kNoInput);
    CHECK(result.over <= 3);
    CHECK(result.wrong_reports == 0);
    worst.push_back(largest_stretch(sheet.network, state.positions));
  }
  CHECK(worst[1] > 1.5 * worst[0]);
  CHECK(worst[1] > 0.02);
}

TEMPLATE_TEST_CASE("the limit is kept while pins move", "[stretch_limit]", float, double) {
  using Scalar = TestType;
  for (const Sheet<Scalar>& sheet : {grid_sheet<Scalar>(33, 33), grid_sheet<Scalar>(24, 17),
                                     triangle_sheet<Scalar>(30, 28, 5)}) {
    const PositionBased<Scalar> model = make(sheet, limited<Scalar>(0.02, 20, {}));
    ClothState<Scalar> state = model.rest_state();
    const Points<Scalar> rest = state.positions;
    const auto target = [&](int vertex, int frame) {
      const double t = kFrame * (frame + 1);
      const Vector3<double> swing(0.0, 0.15 * std::sin(4.0 * t), 0.05 * (1.0 - std::cos(6.0 * t)));
      return Vector3<Scalar>(rest.col(vertex) + swing.template cast<Scalar>());
    };
    const Run result = run(model, state, 75, [&](int k) {
      ClothInput<Scalar> input;
      input.driven_vertices = sheet.corners;
      input.driven_positions.resize(3, 2);
      for (Index c = 0; c < 2; ++c)
        input.driven_positions.col(c) = target(sheet.corners[static_cast<std::size_t>(c)], k);
      return input;
    });
    INFO(sheet.name << ": largest stretch " << result.worst);
    CHECK(result.over <= 3);
    CHECK(result.worst < 0.04);
    CHECK(result.wrong_reports == 0);
    for (int v : sheet.corners) CHECK(state.positions.col(v) == target(v, 74));
  }
}

TEST_CASE("a shirt with a limit comes to rest on its pins", "[stretch_limit]") {
  const Garment garment = make_garment(*tshirt_pattern(), 0.03).value();
  const SewnGarment sewn = weld_seams(garment).value();
  const Material<double> material = material_preset<double>("cotton").value();
  Sheet<double> shirt{"shirt", pattern_network(sewn.mesh, material).value(), {}};
  for (std::size_t side : {3U, 5U}) {  // the shoulders
    const std::vector<int>& seam = garment.panels[0].sides[side];
    shirt.corners.push_back(sewn.vertex_of[static_cast<std::size_t>(seam[seam.size() / 2])]);
  }
  PositionBasedSettings<double> settings = limited<double>(0.03, 10, shirt.corners);
  settings.drag = 3.0;
  const PositionBased<double> model = make(shirt, settings);
  auto workspace = model.make_workspace();
  ClothState<double> state = model.rest_state();
  for (int k = 0; k < 300; ++k) REQUIRE(model.step(state, {}, kFrame, workspace).advanced);
  CHECK(largest_stretch(shirt.network, state.positions) < 0.03);
  const Points<double> before = state.positions;
  for (int k = 0; k < 25; ++k) REQUIRE(model.step(state, {}, kFrame, workspace).advanced);
  const double moved = (state.positions - before).colwise().norm().maxCoeff();
  const double fastest = state.velocities.colwise().norm().maxCoeff();
  CAPTURE(moved, fastest);
  CHECK(moved < 3e-3);
  CHECK(fastest < 0.08);
}

TEST_CASE("sheets with a limit come to rest between two corners", "[stretch_limit]") {
  // Displacements and reported velocities. Without slow_motion.hpp the velocities of the triangles
  // are 8 mm/s. A grid whose edges resist every compression rests at 0.5 mm/s.
  const int n = clothctl_test::kSanitized ? 17 : 65, cells = clothctl_test::kSanitized ? 15 : 40;
  constexpr float kStep = 1.0F / 60.0F;
  for (const Sheet<float>& sheet :
       {grid_sheet<float>(n, n, 1.0), triangle_sheet<float>(cells, cells, 3)}) {
    SpringNetwork<float> network = sheet.network;
    network.bends.clear();
    auto settings = limited<float>(0.02, 5, sheet.corners);
    settings.drag = 0;
    const auto model = PositionBased<float>::create(network, settings).value();
    auto workspace = model.make_workspace();
    ClothState<float> state = level_state(model);
    double moved = 0, fast = 0;
    for (int k = 0; k < 1000; ++k) {
      const Points<float> before = state.positions;
      REQUIRE(model.step(state, {}, kStep, workspace).advanced);
      if (k >= 950) moved += static_cast<double>((state.positions - before).squaredNorm());
      if (k >= 950) fast += static_cast<double>(state.velocities.squaredNorm());
      if (k >= 600) state.velocities *= 1.0F - 5.0F * kStep;
    }
    const double count = 50.0 * static_cast<double>(network.vertex_count());
    const double speed = 60.0 * std::sqrt(moved / count), reported = std::sqrt(fast / count);
    CAPTURE(sheet.name, speed, reported);
    CHECK(speed < 3e-4);
    CHECK(reported < 3e-4);
  }
}

TEST_CASE("a state beyond the limit gets little speed from its stretch", "[stretch_limit]") {
  // 1 m/s if the first substep removes it.
  for (const Sheet<double>& sheet :
       {grid_sheet<double>(17, 17), triangle_sheet<double>(15, 15, 2)}) {
    PositionBasedSettings<double> settings = limited<double>(0.02, 10, {});
    settings.gravity.setZero();
    const PositionBased<double> model = make(sheet, settings);
    auto workspace = model.make_workspace();
    ClothState<double> state = model.rest_state();
    state.positions *= 1.2;
    for (int k = 0; k < 5; ++k) REQUIRE(model.step(state, {}, kFrame, workspace).advanced);
    const double speed =
        std::sqrt(state.velocities.squaredNorm() / static_cast<double>(state.velocities.cols()));
    CAPTURE(sheet.name, speed);
    CHECK(speed < 0.2);
    CHECK(largest_stretch(sheet.network, state.positions) < 0.02);
  }
}

TEST_CASE("hands that pull too far apart show in the report", "[stretch_limit]") {
  const Sheet<double> sheet = grid_sheet<double>(17, 17);
  const PositionBased<double> model = make(sheet, limited<double>(0.02, 20, {}));
  ClothState<double> state = model.rest_state();
  auto workspace = model.make_workspace();
  ClothInput<double> input;
  input.driven_vertices = sheet.corners;
  input.driven_positions.resize(3, 2);
  StepReport<double> report;
  for (int k = 0; k < 50; ++k) {
    for (Index c = 0; c < 2; ++c) {
      input.driven_positions.col(c) =
          sheet.network.rest_positions.col(sheet.corners[static_cast<std::size_t>(c)]);
      input.driven_positions(0, c) *= 1.0 + 0.004 * (k + 1);  // 20 % in the end
    }
    report = model.step(state, input, kFrame, workspace);
    REQUIRE(report.advanced);
  }
  CHECK(report.status == StepStatus::IterationLimit);
  CHECK(report.residual > 0.15);
  CHECK(state.positions.cwiseAbs().maxCoeff() < 1.0);
}

TEMPLATE_TEST_CASE("a free sheet keeps its momentum", "[stretch_limit]", float, double) {
  using Scalar = TestType;
  for (const Sheet<Scalar>& sheet : {grid_sheet<Scalar>(33, 33), grid_sheet<Scalar>(24, 17),
                                     triangle_sheet<Scalar>(30, 28, 6)}) {
    PositionBasedSettings<Scalar> settings = limited<Scalar>(0.02, 20, {});
    settings.drag = Scalar(0);
    settings.gravity.setZero();
    const PositionBased<Scalar> model = make(sheet, settings);
    ClothState<Scalar> state = model.rest_state();
    Numbers random(7);
    const Vector3<double> turn(2.0, -1.0, 3.0);
    for (Index v = 0; v < state.positions.cols(); ++v) {
      const Vector3<double> x = state.positions.col(v).template cast<double>();
      Vector3<double> speed(turn[1] * x[2] - turn[2] * x[1], turn[2] * x[0] - turn[0] * x[2],
                            turn[0] * x[1] - turn[1] * x[0]);
      for (Index c = 0; c < 3; ++c) speed[c] += 0.3 + random(-0.5, 0.5);
      state.velocities.col(v) = speed.template cast<Scalar>();
    }
    const auto before = momentum(sheet.network, state);
    auto workspace = model.make_workspace();
    for (int k = 0; k < 50; ++k) REQUIRE(model.step(state, {}, Scalar(kFrame), workspace).advanced);
    const auto after = momentum(sheet.network, state);
    INFO(sheet.name);
    const double small = std::is_same_v<Scalar, float> ? 5e-3 : 1e-9;
    CHECK((after[0] - before[0]).norm() < small * before[0].norm());
    // The angular momentum is kept up to the turn within a substep.
    CHECK((after[1] - before[1]).norm() < 0.05 * before[1].norm());
  }
}

TEST_CASE("with a limit, a sheet that nothing stretches flies as if it had no springs",
          "[stretch_limit]") {
  const Sheet<double> sheet = triangle_sheet<double>(5, 5, 8);
  SpringNetwork<double> network = sheet.network;
  network.bends.clear();
  PositionBasedSettings<double> settings = limited<double>(0.02, 5, {});
  settings.gravity.setZero();
  const auto model = PositionBased<double>::create(network, settings).value();
  network.springs.clear();
  settings.stretch_limit = 0;
  const auto plain = PositionBased<double>::create(network, settings).value();
  auto ws = model.make_workspace(), other = plain.make_workspace();
  ClothState<double> state = model.rest_state();
  state.positions *= 0.95;  // within the free compression
  state.velocities.colwise() = Vector3<double>(7.3, -4.1, 1.7);
  ClothState<double> expected = state;
  for (int k = 0; k < 3; ++k) {
    REQUIRE(model.step(state, {}, kFrame, ws).advanced);
    REQUIRE(plain.step(expected, {}, kFrame, other).advanced);
    CHECK(state == expected);
  }
}

TEMPLATE_TEST_CASE("with a limit: equal bits again, no allocation, scratch checked",
                   "[stretch_limit]", float, double, long double) {
  using Scalar = TestType;
  for (const Sheet<Scalar>& sheet :
       {grid_sheet<Scalar>(33, 20), triangle_sheet<Scalar>(20, 18, 8)}) {
    const PositionBased<Scalar> model = make(sheet, limited<Scalar>(0.02, 5, sheet.corners));
    ClothState<Scalar> first = level_state(model), second = first, other = first;
    auto clean = model.make_workspace(), used = model.make_workspace();
    ClothInput<Scalar> windy;
    windy.driven_vertices = {3};
    windy.driven_positions = other.positions.col(3);
    const long before = clothctl_test::allocations();
    bool good = true;
    for (int k = 0; k < 5; ++k) {
      good = model.step(first, {}, Scalar(kFrame), clean).advanced && good;
      good = model.step(other, windy, Scalar(0.01), used).advanced && good;
      good = model.step(second, {}, Scalar(kFrame), used).advanced && good;
    }
    const long allocated = clothctl_test::allocations() - before;
    CHECK(good);
    if (clothctl_test::allocation_counting_works()) CHECK(allocated == 0);
    CHECK(first == second);
    CHECK_FALSE(first == other);
    auto foreign = make(sheet, PositionBasedSettings<Scalar>()).make_workspace();
    CHECK(model.step(first, {}, Scalar(kFrame), foreign).status == StepStatus::InvalidWorkspace);
    CHECK(first == second);
  }
}
