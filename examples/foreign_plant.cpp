// Plans for a cloth that does not know clothctl, here that of a typical game engine, through the
// trait in bring_your_own/cloth_plant.hpp. The planner predicts with its own model of the same
// springs, which is close to the engine's cloth but not equal.
//
//   foreign_plant              9 vertices a side, 12 s
//   foreign_plant 17 600       17 vertices a side, ten minutes
//   foreign_plant 17 600 identified   the model's tension identified from four seconds of motion
//   foreign_plant 13 60 --variant 3   another stiffness, damping, drag and substeps of the cloth

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "bring_your_own/cloth_plant.hpp"
#include "clothctl/clothctl.hpp"
#include "support/command_line.hpp"
#include "support/foreign_cloth.hpp"
#include "support/options.hpp"

namespace {

using namespace clothctl;
using program::ForeignVariant;
using Traits = plant_traits<game::Cloth>;
using Predicting = LinearisedPredictor<MassSpringResponse<float>>;

/// What the user asks for.
struct Request {
  int side = 9, seconds = 12;
  std::string profile = "nominal";
  ForeignVariant variant;
};

Request read_request(int argc, char** argv) {
  Request r;
  std::uint64_t seed = 0;
  CLI::App app{"Two hands move a game engine's cloth so that its lower corners swing."};
  app.add_option("side", r.side, "Vertices along a side")
      ->check(CLI::Range(5, 17))
      ->capture_default_str();
  app.add_option("seconds", r.seconds, "Length of the run, s")
      ->check(CLI::Range(5, 3600))
      ->capture_default_str();
  app.add_option("profile", r.profile,
                 "nominal: predict with the springs that the cloth was made from; identified: from "
                 "what a copy of the cloth does, too")
      ->check(CLI::IsMember({"nominal", "identified"}))
      ->capture_default_str();
  CLI::Option* variant =
      app.add_option("--variant", seed,
                     "Seed of another stiffness, damping, drag and number of substeps of the "
                     "cloth, which the planner does not know")
          ->check(program::seed_number());
  program::parse(app, argc, argv);
  if (variant->count() > 0) r.variant = program::draw_variant(seed);
  return r;
}

/// What a copy of the cloth tells about its effective tension, while its corners sway.
LoosePlantProfile<double> identified(game::Cloth cloth, const MassSpring<double>& model,
                                     const PlannerSetup<double>& setup) {
  const std::vector<std::vector<int>> hands{setup.grips[0].vertices(), setup.grips[1].vertices()};
  const auto record = program::must(record_motion<game::Cloth, double>(cloth, hands));
  const auto found = program::must(identify_response<double>(model, record, setup.features));
  std::printf(
      "identified tension %.2f, axial stiffness %.2f, measured force %.2f of nominal; "
      "windows wrong by %.0f %%, before %.0f %%\n",
      static_cast<double>(found.response.scale.geometric),
      static_cast<double>(found.response.scale.axial), found.predictor.measured_force,
      100 * found.error, 100 * found.nominal_error);
  return loose_plant(found);
}

}  // namespace

int main(int argc, char** argv) {
  const Request r = read_request(argc, argv);
  const int last = r.side - 1;
  const GridMesh<double> grid = make_grid<double>(r.side, r.side, 0.5, 0.5).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  game::Cloth cloth = program::hanging_foreign_cloth(grid, network, r.variant);
  const Points<double> start = Traits::positions(cloth);

  PlannerSetup<double> setup;
  setup.triangles = network.triangles;
  for (int col : {0, last}) {
    setup.features.add_point(grid.vertex(0, col));
    setup.grips.push_back(make_pinch<double>({grid.vertex(last, col)}, 0.5, 20.0));
  }
  // The plant differs from the predictor and is hardly damped, so the hands must move calmly and
  // stay near their anchors.
  MassSpringSettings<double> same;
  same.drag = 0.2;
  const auto model = MassSpring<double>::create(network, same).value();
  const LoosePlantProfile<double> profile =
      r.profile == "identified" ? identified(cloth, model, setup) : loose_plant<double>();
  auto planner =
      Planner<Predicting>::create(
          setup, profile.planner,
          Predicting(MassSpringResponse<float>(model, profile.response), profile.predictor), start)
          .value();
  PlanResult<double> plan = planner.make_result();

  // The lower corners swing and rise. The planner reaches the engine's cloth through the trait
  // alone.
  const auto target = [&](Index corner, double t) -> Vector3<double> {
    const double ramp = t > 0 ? 1 - std::exp(-t * t) : 0;
    return start.col(grid.vertex(0, corner == 0 ? 0 : last)) +
           ramp * Vector3<double>(0.02 * std::sin(2 * t), 0.06 * std::sin(3 * t),
                                  0.04 * (1 - std::cos(2 * t)));
  };
  program::LongRun run;
  for (int frame = 0; frame < 50 * r.seconds; ++frame) {
    const FrameReport<double> report = run_frame(planner, cloth, 0.02 * frame, target, plan);
    if (!report.advanced()) return 1;
    run.add(0.02 * (frame + 1), report.mean_error, report.max_error, plan.losing);
  }
  run.print();
}
