// A ball hangs from a rope, whose top moves so that the ball follows a drawn curve. The ball is a
// tetrahedral mass-spring solid, the rope a chain of springs. [Bai 2016], figure 10.
//
//   rope_ball --out out          then open out/player.html

#include "clothctl/network/rope.hpp"
#include "clothctl/network/solid.hpp"
#include "support/command_line.hpp"
#include "support/identified_plant.hpp"
#include "support/loop.hpp"

namespace {

using namespace program;

/// A figure of eight in the vertical plane, drawn twice, which grows to its size in the first
/// second; with a slower swing across it.
Task make_task(const std::string& name, double size, const Vec& start) {
  Task task;
  task.names = {"Ball"};
  task.duration = 5;
  const Index rows = static_cast<Index>(std::lround(task.duration / 0.02)) + 1;
  clothctl::VectorX<double> times(rows);
  Points points(3, rows);
  const double pi = 3.14159265358979323846;
  for (Index i = 0; i < rows; ++i) {
    const double t = times[i] = 0.02 * static_cast<double>(i), u = std::min(t, 1.0);
    const double open = size * u * u * u * (10 - 15 * u + 6 * u * u), angle = 2 * pi * t / 2.5;
    const Vec eight(0.4 * std::sin(angle), 0.12 * std::sin(0.5 * angle),
                    0.16 * std::sin(2 * angle) + 0.08 * (1 - std::cos(angle)));
    const Vec circle(0.25 * std::cos(angle), 0.25 * std::sin(angle), 0.1);
    points.col(i) = start + open * (name == "circle" ? circle : eight);
  }
  task.curves.push_back(must(clothctl::CubicBSpline<double>::interpolate(times, points)));
  return task;
}

/// The ball at the rope's end.
struct Ball {
  double radius = 0.04;
  int resolution = 3;
};

Options read_options(int argc, char** argv, Ball& ball) {
  Options o;
  o.cloth = 21;
  o.material = "rope";
  CLI::App app{
      "A ball on a rope, moved from the rope's top so that the ball follows a drawn curve."};
  o.task = "draw";
  add_common(app, o, {"draw", "circle"},
             "Built-in curve, instead of --targets; draw: a figure of eight");
  app.add_option("--cloth", o.cloth, "Vertices along the rope")
      ->check(between(2, 1000))
      ->capture_default_str();
  app.add_option("--size", o.size, "Length of the rope, m")
      ->check(between(0.01, 100))
      ->capture_default_str();
  app.add_option("--material", o.material, "rope: 0.04 kg/m, 500 N, a foam ball of 300 kg/m³")
      ->check(CLI::IsMember({"rope"}))
      ->capture_default_str();
  app.add_option("--patch", o.patch, "Patch motion: soft or hard")
      ->check(CLI::IsMember({"soft", "hard"}))
      ->capture_default_str();
  app.add_option("--radius", ball.radius, "Radius of the ball, m")
      ->check(between(1e-3, 10))
      ->capture_default_str();
  app.add_option("--resolution", ball.resolution, "Cells from the ball's centre to its surface")
      ->check(between(1, 20))
      ->capture_default_str();
  parse(app, o, argc, argv);
  return o;
}

/// Makes body, grip, feature and settings.
Scene make_scene(const Options& o, const clothctl::RopeBall<double>& body) {
  Scene scene;
  scene.title = "Rope with a ball";
  scene.material = o.material;
  scene.body.network = body.network;
  scene.body.drag = 0.5;
  for (int i = 0; i + 1 < o.cloth; ++i) scene.segments.push_back({i, i + 1});
  scene.setup.grips.push_back(clothctl::make_pinch<double>(
      {body.grip}, o.friction_given ? o.friction : 0.5, o.limit, o.generators));
  scene.setup.features.add_centroid(body.ball);
  scene.settings = planner_settings(o, 9.81 * body.network.mass.sum());
  scene.settings.heavy_chain_axes = clothctl::HeavyChainAxes::Horizontal;
  check_scene(scene);
  return scene;
}

}  // namespace

int main(int argc, char** argv) {
  Ball ball;
  Options o = read_options(argc, argv, ball);
  // No rollout predicts a rope better.
  if (o.predictor == "auto") o.predictor = "linearised";
  clothctl::RopeSettings<double> rope;
  rope.length = o.size;
  rope.segments = o.cloth - 1;
  clothctl::RopeBall<double> body = must(clothctl::rope_ball_network<double>(
      rope, ball.radius, ball.resolution, clothctl::SolidSettings<double>{}));
  Scene scene = make_scene(o, body);
  clothctl::ClothState<double> state{body.network.rest_positions,
                                     Points::Zero(3, body.network.vertex_count())};
  state = settle(o, scene.body, std::move(state), {body.grip}, 4.8);
  Points centre(3, 1);
  clothctl::evaluate_features<double>(scene.setup.features, state.positions, centre);
  if (o.targets.empty()) {
    scene.task = make_task(o.task, o.size, centre.col(0));
  } else {
    scene.task = read_task(o);
    if (scene.task.curves.size() != 1)
      refuse(o.targets + ": has " + std::to_string(scene.task.curves.size()) +
             " curves for 1 feature");
    scene.task.curves[0].translate(centre.col(0) - scene.task.curves[0].position(0));
  }
  const auto identified = identify_plant(scene, o, scene.body, state);
  return run(scene, o, plant_in_state(o.plant, scene.body, state),
             make_predictor(o, scene.body, scene.settings, identified));
}
