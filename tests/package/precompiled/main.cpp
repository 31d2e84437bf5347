// Uses something of every folder that clothctl::precompiled compiles.

#include <clothctl/clothctl.hpp>
#include <cstdio>

using namespace clothctl;

int main() {
  const GridMesh<double> grid = make_grid<double>(5, 5, 0.3, 0.3).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  const HornResult<double> fit = horn<double>(grid.positions, grid.positions);
  if (fit.status != HornStatus::Unique) return 1;

  ModelPlant<PositionBased<double>> xpbd(PositionBased<double>::create(network).value());
  const MassSpring<double> model = MassSpring<double>::create(network).value();
  ModelPlant<MassSpring<double>> plant(model);
  if (!xpbd.advance(0.02).advanced) return 2;

  PlannerSetup<double> setup;
  setup.triangles = network.triangles;
  setup.features.add_point(0);
  setup.grips.push_back(make_pinch<double>({24}, 0.5, 20.0));
  const auto target = [&](Index, double) -> Vector3<double> { return grid.positions.col(0); };
  using Predictor = LinearisedPredictor<MassSpringResponse<float>>;
  Predictor predictor{MassSpringResponse<float>(model)};
  using Sheets = Planner<Predictor>;
  Sheets planner =
      Sheets::create(setup, PlannerSettings<double>{}, predictor, plant.positions()).value();
  PlanResult<double> plan = planner.make_result();
  if (!can_apply(planner.plan(plant.positions(), plant.velocities(), 0.0, target, plan))) return 3;
  plant.apply(plan.input);
  if (!plant.advance(0.02).advanced) return 4;

  using Tree = KinematicTree<double>;
  const Tree hand = hand34<double>();
  KinematicTreeWorkspace<double> work(hand);
  VectorX<double> q = hand.neutral();
  if (forward_kinematics<double>(hand, q, work.body_poses) != TreeStatus::Done) return 5;
  const int tip = hand.find_link("index_tip");
  const Vector3<double> place = link_pose(hand, work.body_poses, tip).p;
  const std::vector<IkTask<double>> tasks = {
      IkTask<double>::position(tip, Vector3<double>::Zero(), place)};
  InverseKinematics<Tree> ik(hand, 1);
  if (ik.solve(hand, tasks, VectorX<double>(), q).status != IkStatus::Reached) return 6;
  const std::vector<FingerPad<double>> fingers = hand34_geometry(hand).fingers;
  const auto controller = GraspController<Tree>::create(hand, fingers, hand.neutral());
  if (!controller || controller->phase() != GraspPhase::Free) return 7;
  std::printf("clothctl %s\n", CLOTHCTL_VERSION_STRING);
  return 0;
}
