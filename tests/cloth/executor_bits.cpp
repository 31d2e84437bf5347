// A step has the same bits with any executor and any number of threads.

#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/network/triangle_elements.hpp"
#include "support/catch.hpp"
#include "support/sweeps.hpp"
#include "support/thread_executor.hpp"
#include "support/tier.hpp"

using namespace clothctl;
using clothctl_test::BackwardExecutor;
using clothctl_test::ThreadExecutor;

namespace {

template <class Scalar>
struct Case {
  std::string name;
  SpringNetwork<Scalar> network;
  PositionBasedSettings<Scalar> settings;
};

/// Sheets large enough for several bands or parts, with and without a limit and pins.
template <class Scalar>
std::vector<Case<Scalar>> large_sheets() {
  const auto grid = make_grid<double>(129, 128, 1.28, 1.28).value();
  const auto mesh = clothctl_test::irregular_sheet(56, 56, 0.01, 0.2, 4);
  Material<double> material;
  material.damping_time = 0.01;
  const auto wide = sheet_network<double>(grid, material).value();
  const auto irregular = sheet_network<double>(mesh.positions, mesh.triangles, material).value();
  MembraneStiffness<double> stiffness;
  stiffness.warp = stiffness.weft = stiffness.shear = stiffness.area = 50.0;
  const auto woven =
      add_triangle_elements<double>(irregular, Vector3<double>(1, 0, 0), stiffness).value();
  std::vector<Case<Scalar>> cases;
  using Named = std::pair<std::string, SpringNetwork<double>>;
  for (const auto& [name, network] :
       std::vector<Named>{{"grid", wide}, {"triangles", irregular}, {"elements", woven}}) {
    for (const double limit : {0.0, 0.03}) {
      for (const bool pinned : {true, false}) {
        if (!pinned && !(limit > 0)) continue;  // nothing that the other cases have not
        PositionBasedSettings<Scalar> settings;
        settings.substeps = 2;
        settings.stretch_limit = Scalar(limit);
        if (pinned) settings.pinned = {0, 127};
        cases.push_back(
            {std::string(name) + (limit > 0 ? ", limited" : "") + (pinned ? ", pinned" : ""),
             network.template cast<Scalar>(), settings});
      }
    }
  }
  return cases;
}

template <class Scalar>
struct Run {
  ClothState<Scalar> state;
  StepReport<Scalar> report;
  bool operator==(const Run& other) const {
    return state.positions == other.state.positions && state.velocities == other.state.velocities &&
           report.residual == other.report.residual &&
           report.iterations == other.report.iterations && report.status == other.report.status;
  }
};

template <class Scalar, class... Executor>
Run<Scalar> run(const Case<Scalar>& sheet, Executor&... executor) {
  auto made = PositionBased<Scalar>::create(sheet.network, sheet.settings);
  if (!made) FAIL(made.error());
  const auto model = std::move(made).value();
  auto workspace = model.make_workspace();
  Run<Scalar> run{model.rest_state(), {}};
  clothctl_test::Numbers random(8);
  for (Index i = 0; i < run.state.positions.size(); ++i) {
    run.state.positions(i) += Scalar(random(-1e-3, 1e-3));
    run.state.velocities(i) = Scalar(random(-1, 1));
  }
  for (int k = 0; k < 2; ++k) {
    run.report = model.step(run.state, {}, Scalar(0.02), workspace, executor...);
    REQUIRE(run.report.advanced);
  }
  return run;
}

}  // namespace

TEMPLATE_TEST_CASE("a step has the same bits on 1, 2 and 4 threads, and on none", "[executor_bits]",
                   float, double) {
  for (const Case<TestType>& sheet : large_sheets<TestType>()) {
    if (clothctl_test::kSanitized && std::is_same_v<TestType, float> && sheet.name[0] == 'g')
      continue;  // the grid, the largest case
    INFO(sheet.name);
    const Run<TestType> serial = run(sheet);
    BackwardExecutor backward;
    CHECK(run(sheet, backward) == serial);
    for (const int threads : {1, 2, 4}) {
      if (clothctl_test::kSanitized && threads < 4) continue;
      ThreadExecutor team{threads};
      CHECK(run(sheet, team) == serial);
      CHECK(team.loops >= 20);
    }
  }
}

TEST_CASE("of a sheet swept in listed order only the prediction is divided", "[executor_bits]") {
  const auto mesh = clothctl_test::irregular_sheet(60, 60, 0.01, 0.2, 4);
  const Case<double> sheet{
      "Verlet", sheet_network<double>(mesh.positions, mesh.triangles, Material<double>()).value(),
      PositionBasedSettings<double>::verlet()};
  ThreadExecutor team;
  CHECK(run(sheet, team) == run(sheet));
  CHECK(team.loops == 2);  // two steps of one substep
}
