// Plans for a cloth that does not know clothctl, here that of a typical game engine, through the
// trait in bring_your_own/cloth_plant.hpp. The planner predicts with its own model of the same
// springs, which is close to the engine's cloth but not equal.
//
//   foreign_plant              9 vertices a side, 12 s
//   foreign_plant 17 600       17 vertices a side, ten minutes
//   foreign_plant 17 600 identified   the model's tension identified from four seconds of motion

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string_view>
#include <vector>

#include "bring_your_own/cloth_plant.hpp"
#include "clothctl/clothctl.hpp"

using namespace clothctl;
using Traits = plant_traits<game::Cloth>;
using Predicting = LinearisedPredictor<MassSpringResponse<float>>;

// The engine's sheet, hanging at rest from its upper corners. The hands are closer together than in
// the flat sheet, and the sheet starts bent, so that it folds to one side.
game::Cloth hanging_cloth(const GridMesh<double>& grid, const SpringNetwork<double>& network) {
  Points<double> x = grid.positions;
  for (Index i = 0; i < x.cols(); ++i) x(1, i) = -0.03 * std::cos(6.28 * x(0, i));
  x.row(0) *= 0.95;
  game::Cloth cloth = game::make_cloth(network, x);
  const int side = grid.cols, last = side - 1;
  cloth.substeps = side <= 9 ? 400 : side <= 13 ? 600 : 1000;
  cloth.drag = 4;
  if (!settle(cloth, {grid.vertex(last, 0), grid.vertex(last, last)}, 0.02, 6.0, 1e-3).advanced)
    std::exit(1);
  cloth.drag = 0.2f;
  return cloth;
}

// What a copy of the cloth tells about its effective tension, while its corners sway.
LoosePlantProfile<double> identified(game::Cloth cloth, const MassSpring<double>& model,
                                     const PlannerSetup<double>& setup) {
  const std::vector<std::vector<int>> hands{setup.grips[0].vertices(), setup.grips[1].vertices()};
  const auto record = record_motion<game::Cloth, double>(cloth, hands).value();
  const auto found = identify_response<double>(model, record, setup.features).value();
  std::printf(
      "identified tension %.2f, axial stiffness %.2f, measured force %.2f of nominal; "
      "windows wrong by %.0f %%, before %.0f %%\n",
      static_cast<double>(found.response.scale.geometric),
      static_cast<double>(found.response.scale.axial), found.predictor.measured_force,
      100 * found.error, 100 * found.nominal_error);
  return loose_plant(found);
}

int main(int argc, char** argv) {
  const int side = argc > 1 ? std::atoi(argv[1]) : 9;
  const int frames = 50 * (argc > 2 ? std::atoi(argv[2]) : 12);
  const bool identify = argc == 4 && std::string_view(argv[3]) == "identified";
  if (argc > (identify ? 4 : 3) || side < 5 || side > 17 || frames < 250 || frames > 180000) {
    std::fprintf(stderr,
                 "usage: foreign_plant [vertices a side, 5 to 17 [seconds, 5 to 3600 "
                 "[identified]]]\n");
    return 2;
  }
  const int last = side - 1;
  const GridMesh<double> grid = make_grid<double>(side, side, 0.5, 0.5).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  game::Cloth cloth = hanging_cloth(grid, network);
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
      identify ? identified(cloth, model, setup) : loose_plant<double>();
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
  double sum = 0, worst = 0, first = 0, part = 0, worst_part = 0;  // parts of 5 s
  for (int frame = 0; frame < frames; ++frame) {
    const FrameReport<double> report = run_frame(planner, cloth, 0.02 * frame, target, plan);
    if (!report.advanced()) return 1;
    sum += report.mean_error;
    worst = std::max(worst, report.max_error);
    part += report.mean_error / 250;
    if (frame % 250 != 249) continue;
    if (frame == 249) first = part;
    worst_part = std::max(worst_part, part);
    part = 0;
  }
  std::printf("the corners follow for %d frames with a mean error of %.1f mm, worst %.1f mm\n",
              frames, 1000 * sum / frames, 1000 * worst);
  std::printf("mean error of the first 5 s %.1f mm, of the worst 5 s %.1f mm\n", 1000 * first,
              1000 * worst_part);
}
