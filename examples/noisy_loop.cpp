// The camera is late, sees a few markers only, and is a few millimetres wrong; commands act a frame
// late; and from time to time a plan is not ready. An estimator plans ahead of all that.
//
//   noisy_loop                                    the run without faults, and with the default ones
//   noisy_loop --noise 2 --delay 2 --latency 1 --markers 3 --late 10 --seed 1 --cloth 17

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <string>
#include <utility>
#include <vector>

#include "clothctl/clothctl.hpp"
#include "support/marker_camera.hpp"

using namespace clothctl;
using Model = MassSpringRollout<double>;
using Linearised = LinearisedPredictor<MassSpringResponse<float>>;
using Predicting = RolloutPredictor<Model, Linearised>;

// What is wrong with the loop.
struct Faults {
  int noise = 2;    // standard deviation of a coordinate, mm
  int delay = 2;    // frames from a picture to its arrival
  int latency = 0;  // frames from a command to its effect
  int markers = 3;  // along a side
  int late = 0;     // every how many frames a plan is not ready in time; 0: always ready
  int seed = 1;
  int cloth = 9;  // vertices a side
};

// Runs the loop for four seconds and returns the mean distance of the corners from their target, m.
double follow(const Faults& faults) {
  const int last = faults.cloth - 1;
  const auto grid = make_grid<double>(faults.cloth, faults.cloth, 0.5, 0.5).value();
  const auto network = sheet_network(grid, Material<double>{}).value();
  MassSpringSettings<double> converged;
  converged.integration = Integration::Newton;
  converged.drag = 0.5;
  const auto springs = MassSpring<double>::create(network, converged).value();
  ModelPlant<MassSpring<double>> plant(springs);
  ClothState<double> state = plant.state();
  for (Index i = 0; i < state.positions.cols(); ++i)
    state.positions(1, i) = -0.05 * std::cos(6.28 * state.positions(0, i));
  state.positions.row(0) *= 0.9;
  plant.set_state(state);
  const std::vector<int> held{grid.vertex(last, 0), grid.vertex(last, last)};
  if (!settle(plant, held, 0.02, 4.0).advanced) std::exit(1);
  const Points<double> start = plant.positions();

  PlannerSetup<double> setup;
  setup.triangles = network.triangles;
  for (int col : {0, last}) setup.features.add_point(grid.vertex(0, col));
  for (int hand : held) setup.grips.push_back(make_pinch<double>({hand}, 0.5, 20.0));
  PlannerSettings<double> settings = PlannerSettings<double>::rollout(0.05);
  settings.input = GripInput::Pose;
  auto planner = Planner<Predicting>::create(
                     setup, settings,
                     Predicting(Model(springs), Linearised(MassSpringResponse<float>(springs)),
                                RolloutSettings{1}),
                     start)
                     .value();
  PlanResult<double> plan = planner.make_result();
  const auto target = [&](Index corner, double t) -> Vector3<double> {
    const double ramp = t > 0 ? 1 - std::exp(-t * t) : 0, lag = corner == 0 ? 0 : 0.4;
    return start.col(grid.vertex(0, corner == 0 ? 0 : last)) +
           ramp * Vector3<double>(0.05 * std::sin(2 * t), 0.1 * std::sin(3 * t - lag),
                                  0.06 * (1 - std::cos(2 * t - lag)));
  };

  ClothInput<double> hold;
  hold.driven_vertices = held;
  hold.driven_positions = start(Eigen::all, held);
  EstimatorSettings<double> estimating;
  estimating.noise = 0.001 * std::max(1, faults.noise);
  estimating.latency = faults.latency;
  estimating.history = faults.delay + faults.latency + 1;
  const PointFeatures<double> markers = program::spread_markers(grid, faults.markers);
  program::MarkerCamera camera(markers, 0.001 * faults.noise, faults.delay,
                               static_cast<std::uint64_t>(faults.seed));
  auto estimator =
      StateEstimator<Model>::create(Model(springs), markers, plant.state(), hold, estimating)
          .value();
  MarkerMeasurement<double> picture;
  CommandWindow<double> commands(planner.settings(), plan);
  std::deque<ClothInput<double>> sent(static_cast<std::size_t>(faults.latency), hold);
  double sum = 0;
  for (int frame = 0; frame < 200; ++frame) {
    if (camera.look(frame, plant.positions(), picture)) (void)estimator.correct(picture);
    // A late plan is made all the same, but the frame gets what the last plan meant for it.
    const PlanStatus status =
        planner.plan(estimator.positions(), estimator.velocities(), estimator.time(), target, plan);
    const bool late = faults.late > 0 && frame % faults.late == faults.late - 1;
    if (!late && can_apply(status)) commands.keep(plan);
    const ClothInput<double>& input = commands.next();
    estimator.apply(input);
    sent.push_back(input);
    plant.apply(sent.front());
    sent.pop_front();
    if (!estimator.advance(0.02).advanced || !plant.advance(0.02).advanced) return 1;
    for (int corner : {0, 1})
      sum += (plant.positions().col(grid.vertex(0, corner * last)) -
              target(corner, 0.02 * (frame + 1)))
                 .norm();
  }
  return sum / 400;
}

int main(int argc, char** argv) {
  Faults faults;
  const std::pair<const char*, int*> options[] = {
      {"--noise", &faults.noise},     {"--delay", &faults.delay}, {"--latency", &faults.latency},
      {"--markers", &faults.markers}, {"--late", &faults.late},   {"--seed", &faults.seed},
      {"--cloth", &faults.cloth}};
  bool good = argc % 2 == 1;
  for (int i = 1; i + 1 < argc; i += 2) {
    int* value = nullptr;
    for (const auto& [name, place] : options) {
      if (std::strcmp(argv[i], name) == 0) value = place;
    }
    const std::string text = argv[i + 1];
    good = good && value != nullptr && !text.empty() && text.size() < 4 &&
           text.find_first_not_of("0123456789") == std::string::npos;
    if (good) *value = std::atoi(text.c_str());
  }
  good = good && faults.cloth >= 5 && faults.cloth <= 33 && faults.markers >= 2 &&
         faults.markers <= faults.cloth && faults.delay + faults.latency <= 20;
  if (!good) {
    std::fprintf(stderr,
                 "usage: noisy_loop [--noise MM] [--delay FRAMES] [--latency FRAMES] "
                 "[--markers N] [--late FRAMES] [--seed N] [--cloth 5 to 33]\n");
    return 2;
  }
  Faults none;
  none.noise = none.delay = none.latency = none.late = 0;
  none.markers = none.cloth = faults.cloth;
  std::printf("mean error of the corners without faults %.1f mm\n", 1000 * follow(none));
  std::printf("mean error of the corners with them      %.1f mm\n", 1000 * follow(faults));
}
