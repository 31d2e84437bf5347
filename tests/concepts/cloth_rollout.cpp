// A foreign model satisfies ClothRollout by traits alone, and the library's simulators obey its
// laws. For other types the concept is false instead of a compile error.

#include <span>
#include <string>
#include <vector>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/concepts/cloth.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/network/sheet.hpp"
#include "laws/cloth_rollout_laws.hpp"
#include "support/catch.hpp"

namespace other_engine {

// Beads on springs to fixed points, stepped implicitly. Plain vectors of x y z of each bead.
struct Beads {
  int n = 3;
  double mass = 0.02, stiffness = 3;
};
struct Log {
  std::vector<double> needed;  // force missing on each bead in the last step
};

}  // namespace other_engine

namespace clothctl {

template <>
struct cloth_traits<other_engine::Beads> {
  using Beads = other_engine::Beads;
  using Log = other_engine::Log;
  static Index vertex_count(const Beads& beads) { return beads.n; }
  static ClothState<double> rest_state(const Beads& beads) {
    return {Points<double>::Zero(3, beads.n), Points<double>::Zero(3, beads.n)};
  }
  static Log make_workspace(const Beads& beads) {
    return {std::vector<double>(static_cast<std::size_t>(3 * beads.n), 0.0)};
  }
  static StepReport<double> step(const Beads& beads, ClothState<double>& state,
                                 const ClothInput<double>& input, double h, Log& log) {
    if (!(h > 0)) return {StepStatus::InvalidInput, false, 0.0, 0};
    const double k = beads.stiffness, m = beads.mass;
    for (Index i = 0; i < beads.n; ++i) {
      Vector3<double> push(0, 0, -9.81 * m), v = state.velocities.col(i);
      for (std::size_t j = 0; j < input.force_vertices.size(); ++j)
        if (input.force_vertices[j] == i) push += input.forces.col(static_cast<Index>(j));
      const Vector3<double> x = state.positions.col(i), before = v;
      v = (m * v + h * (push - k * x)) / (m + h * h * k);
      for (std::size_t j = 0; j < input.driven_vertices.size(); ++j)
        if (input.driven_vertices[j] == i)
          v = (input.driven_positions.col(static_cast<Index>(j)) - x) / h;
      const Vector3<double> needed = m * (v - before) / h - push + k * (x + h * v);
      for (Index c = 0; c < 3; ++c) log.needed[static_cast<std::size_t>(3 * i + c)] = needed[c];
      state.velocities.col(i) = v;
      state.positions.col(i) = x + h * v;
    }
    return {StepStatus::Converged, true, 0.0, 1};
  }
  static Vector3<double> gravity_load(const Beads& beads) {
    return {0, 0, 9.81 * beads.mass * static_cast<double>(beads.n)};
  }
};

template <>
struct cloth_rollout_traits<other_engine::Beads> {
  using Beads = other_engine::Beads;
  static StepReport<double> step_from(const Beads& beads, const Points<double>&, int,
                                      ClothState<double>& state, const ClothInput<double>& input,
                                      double h, other_engine::Log& log, double) {
    return cloth_traits<Beads>::step(beads, state, input, h, log);
  }
  static void holding_forces(const Beads&, std::span<const int> vertices,
                             const other_engine::Log& log, Points<double>& forces) {
    for (std::size_t j = 0; j < vertices.size(); ++j)
      for (std::size_t c = 0; c < 3; ++c)
        forces(static_cast<Index>(c), static_cast<Index>(j)) =
            log.needed[3 * static_cast<std::size_t>(vertices[j]) + c];
  }
};

}  // namespace clothctl

using namespace clothctl;

namespace {

// A model that cannot start from a guess.
struct Stubborn {
  Index vertex_count() const { return 1; }
  ClothState<double> rest_state() const { return {}; }
  int make_workspace() const { return 0; }
  StepReport<double> step(ClothState<double>&, const ClothInput<double>&, double, int&) const {
    return {};
  }
};
// A model that starts from a guess but does not report the holding forces.
struct Silent : Stubborn {
  StepReport<double> step_from(const Points<double>&, int, ClothState<double>&,
                               const ClothInput<double>&, double, int&, double) const {
    return {};
  }
};

}  // namespace

static_assert(ClothRollout<other_engine::Beads> && !ClothRollout<other_engine::Beads, float>);
static_assert(ClothRollout<MassSpring<float>, float> && ClothRollout<MassSpring<double>>);
static_assert(ClothModel<Stubborn> && !ClothRollout<Stubborn> && !ClothRollout<Silent>);
static_assert(ClothModel<PositionBased<double>> && !ClothRollout<PositionBased<double>>);
static_assert(!ClothRollout<int> && !ClothRollout<std::string>);

TEST_CASE("a plant made of a foreign model passes on the gravity load of its trait", "[concepts]") {
  const other_engine::Beads beads;
  const ModelPlant<other_engine::Beads, double> plant(beads);
  CHECK(plant_traits<ModelPlant<other_engine::Beads, double>>::gravity_load(plant)[2] ==
        9.81 * beads.mass * static_cast<double>(beads.n));
}

TEST_CASE("foreign beads obey the laws of rollouts", "[concepts]") {
  const other_engine::Beads beads;
  ClothState<double> state = cloth_traits<other_engine::Beads>::rest_state(beads);
  state.positions << 0.1, 0.2, 0.3, 0.0, -0.1, 0.0, 0.5, 0.4, 0.3;
  state.velocities << 0.0, 1.0, 0.0, 0.3, 0.2, -0.5, 0.0, 0.0, 0.1;
  clothctl_test::ClothRolloutLaws<double> laws;
  laws.tolerance = 1e-12;
  clothctl_test::check_cloth_rollout_laws(beads, state, {2, 0}, laws);
}

TEST_CASE("converged mass-spring steps obey the laws of rollouts", "[concepts]") {
  const GridMesh<double> grid = make_grid<double>(5, 5, 0.4, 0.4).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  MassSpringSettings<double> settings;
  settings.integration = Integration::Newton;
  const auto model = MassSpring<double>::create(network, settings).value();
  ClothState<double> state = model.rest_state();
  auto workspace = model.make_workspace();
  ClothInput<double> hang;
  hang.driven_vertices = {grid.vertex(4, 0), grid.vertex(4, 4)};
  hang.driven_positions.resize(3, 2);
  for (Index j = 0; j < 2; ++j)
    hang.driven_positions.col(j) =
        state.positions.col(hang.driven_vertices[static_cast<std::size_t>(j)]);
  for (int k = 0; k < 20; ++k) REQUIRE(model.step(state, hang, 0.02, workspace).advanced);
  clothctl_test::ClothRolloutLaws<double> laws;
  laws.move = 0.001;
  laws.tolerance = 1e-4;  // steps converge to the tolerance of the settings, not to rounding
  clothctl_test::check_cloth_rollout_laws(model, state, hang.driven_vertices, laws);
}
