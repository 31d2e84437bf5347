#include <cstdio>

#include "clothctl/clothctl.hpp"

using namespace clothctl;
using Vec = Vector3<double>;
using Hand = KinematicTree<double>;

int main() {
  // A handkerchief hangs from its upper corners, on pins.
  const double dt = 0.02;
  const GridMesh<double> grid = make_grid<double>(17, 17, 0.5, 0.5).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  MassSpring<double> model = MassSpring<double>::create(network).value();
  World<double> world;
  const int sheet = world.add_sheet(model, model.rest_state()).value();
  const int pins[] = {grid.vertex(16, 0), grid.vertex(16, 16)};
  world.input(sheet).driven_vertices = {pins[0], pins[1]};
  world.input(sheet).driven_positions = grid.positions(Eigen::all, pins);

  // A hand of 34 joints waits above the left one. Its thumb and index shall pinch the sheet there.
  const Hand hand = hand34<double>();
  const HandGeometry<double> shape = hand34_geometry(hand);
  const Vec place = grid.positions.col(grid.vertex(15, 1)), out_of_sheet(0, 1, 0);
  const std::vector<GraspContact<double>> places{{place, out_of_sheet}, {place, -out_of_sheet}};
  const std::vector<FingerPad<double>> fingers(shape.fingers.begin(), shape.fingers.begin() + 2);
  const VectorX<double> pinch = hand34_pinch_at<double>(hand, place, out_of_sheet, Vec(0, 0, -1));
  const auto poses = find_grasp_poses<Hand, double>(hand, fingers, places, pinch, pinch);
  if (poses.status != GraspPoseStatus::Found) return std::puts(poses.message.c_str()), 1;
  HandSetup<double> start;
  start.positions = poses.wait;
  start.control = StablePdSettings<double>::uniform(hand.nv());
  const int number = world.add_hand(hand, start).value();
  HandSurface<double> surface;
  surface.with_pads = {0, 1};
  const HandInWorld parts = add_hand_geometry<double>(world, number, shape, surface).value();

  // One step: what the fingertips feel drives the hand, and the world moves.
  auto controller = GraspController<Hand>::create(hand, fingers, poses.wait).value();
  auto contacts =
      StaticContacts<double>::create(world, sheet, {parts.segments[0], parts.segments[1]}).value();
  GraspReport<double> report;
  const auto step = [&] {
    const PadTouch<double> felt[] = {pad_touch(world, parts.pads[0], dt),
                                     pad_touch(world, parts.pads[1], dt)};
    report = controller.update(dt, world.hand(number), felt, world.drive(number));
    const bool advanced = world.step(dt).advanced;
    contacts.update(world);
    return advanced && report.phase != GraspPhase::Failed;
  };

  // Grasp. Once the grip is firm, take the sheet off its pins and let it come to rest.
  Grasp<double> grasp;
  grasp.fingers = {{0, out_of_sheet}, {1, -out_of_sheet}};
  grasp.keyframes = {poses.touch};
  if (const std::string bad = controller.begin(grasp); !bad.empty())
    return std::puts(bad.c_str()), 1;
  while (controller.phase() != GraspPhase::Hold)
    if (!step()) return std::puts(controller.describe(report).c_str()), 1;
  world.input(sheet).clear();
  const ClothState<double>& cloth = world.state(sheet);
  for (double t = 0; t < 10; t += dt)
    if (!step()) return std::puts(controller.describe(report).c_str()), 1;

  // Plan the forces of the fingers such that the lowest corner follows a curve; each frame, the
  // rigid motion nearest to the planned one of what they hold moves the hand.
  PlannerSetup<double> setup;
  setup.triangles = network.triangles;
  setup.features.add_point(grid.vertex(0, 16));
  const std::vector<HoldingFinger<double>> two{{0, out_of_sheet}, {1, -out_of_sheet}};
  setup.grips = {make_held_grip<double>(contacts, two, cloth.positions, network.triangles).value()};
  PlannerSettings<double> settings;
  settings.dt = dt, settings.horizon = std::lround(0.4 / dt);
  settings.max_step = 0.75 * dt, settings.weights.jerk = 0.03;  // slow and smooth, for a hand
  settings.command = PlantCommand::Position;
  settings.gravity_load = Vec(0, 0, 9.81 * network.mass.sum());
  const Vec rest = cloth.positions.col(grid.vertex(0, 16));
  const auto target = [&](Index, double t) {
    return Vec(rest + Vec(0.1 - 0.1 * std::cos(2 * t), 0.1 * std::sin(2 * t), 0.02 * t));
  };
  LinearisedPredictor<MassSpringResponse<float>> predictor{MassSpringResponse<float>(model)};
  auto planner =
      Planner<decltype(predictor)>::create(setup, settings, predictor, cloth.positions).value();
  PlanResult<double> plan = planner.make_result();
  double error = 0, force = 0;
  for (int frame = 0; frame < 250; ++frame) {
    const double t = dt * frame;
    if (!can_apply(planner.plan(cloth.positions, cloth.velocities, t, target, plan))) return 1;
    const Points<double> now = cloth.positions(Eigen::all, plan.input.driven_vertices);
    const auto moved = rectify<double>(now, plan.input.driven_positions, VectorX<double>(),
                                       Matrix3<double>::Identity());
    if (moved.found()) (void)controller.move_by(moved.R_world_frame, moved.position);
    if (!step()) return std::puts(controller.describe(report).c_str()), 1;
    error += (cloth.positions.col(grid.vertex(0, 16)) - target(0, t + dt)).norm() / 250;
    force += report.mean_force / 250;
  }
  std::printf("5 s: the corner is %.1f mm from its curve (mean); fingers press with %.1f N\n",
              1000 * error, force);
}
