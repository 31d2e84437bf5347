// Five types that do not know clothctl join it, each by a trait in its own header: a cloth plant, a
// model for rollouts, a contact model, a QP solver and a robot. The planner moves the plant's cloth
// with the first four, and inverse kinematics moves the robot's tip to a point.

#include <cmath>
#include <cstdio>

#include "cloth_plant.hpp"
#include "clothctl/cloth/mass_spring_response.hpp"
#include "clothctl/cloth/settle.hpp"
#include "clothctl/mesh/grid.hpp"
#include "clothctl/mpc/loose_plant.hpp"
#include "clothctl/mpc/planner.hpp"
#include "clothctl/mpc/run_frame.hpp"
#include "clothctl/network/sheet.hpp"
#include "clothctl/prediction/rollout_predictor.hpp"
#include "clothctl/robot/inverse_kinematics.hpp"
#include "contact_model.hpp"
#include "qp_solver.hpp"
#include "robot.hpp"
#include "rollout_model.hpp"

using namespace clothctl;

static_assert(ClothPlant<game::Cloth> && ClothRollout<lab::Cloth>);
static_assert(ContactModel<gripper::RibbedPad> && ArticulatedModel<workshop::Arm>);
static_assert(BoxQpSolver<splitting::Admm> && QpSolver<splitting::Admm>);

using Inner = LinearisedPredictor<MassSpringResponse<float>>;
using Rolling = RolloutPredictor<lab::Cloth, Inner>;
using Setup = PlannerSetup<double, gripper::RibbedPad>;
using SheetPlanner = Planner<Rolling, Setup, splitting::Admm, splitting::Admm>;

// The largest violation of the pads' contact law by the planned forces, N.
double contact_violation(const SheetPlanner& planner, const PlanResult<double>& plan) {
  double worst = 0;
  for (const FingerForce<double>& f : plan.finger_forces) {
    const auto& finger = planner.grips()[std::size_t(f.grip)].fingers[std::size_t(f.finger)];
    worst =
        std::fmax(worst, contact_traits<gripper::RibbedPad>::violation(
                             finger.contact, f.normal, f.normal, f.force, finger.max_normal_force));
  }
  return worst;
}

// Predicts by rolling out the laboratory's model. A mass-spring model gives the response to small
// changes of the plan.
Rolling make_predictor(const SpringNetwork<double>& network, double drag) {
  const Points<double>& x = network.rest_positions;
  const lab::Cloth rolled{network.springs, lab::Numbers(x.data(), x.data() + x.size()),
                          lab::Numbers(network.mass.begin(), network.mass.end()), drag};
  MassSpringSettings<double> same;
  same.drag = drag;
  return {rolled,
          Inner(MassSpringResponse<float>(MassSpring<double>::create(network, same).value()))};
}

// Moves the lower corners of the game's cloth for 150 frames. Returns true on success.
bool move_cloth() {
  const GridMesh<double> grid = make_grid<double>(7, 7, 0.4, 0.4).value();
  const SpringNetwork<double> network = sheet_network(grid, Material<double>{}).value();
  Points<double> x = grid.positions;
  for (Index i = 0; i < x.cols(); ++i) x(1, i) = 0.02 * std::cos(7.8 * x(0, i));  // slightly bent
  x.row(0) *= 0.95;
  game::Cloth cloth = game::make_cloth(network, x);
  cloth.drag = 4;
  if (!settle(cloth, {grid.vertex(6, 0), grid.vertex(6, 6)}, 0.02, 6.0, 1e-3).advanced)
    return false;
  cloth.drag = 0.5f;
  const Points<double> start = plant_traits<game::Cloth>::positions(cloth);

  Setup setup;
  setup.triangles = network.triangles;
  for (int col : {0, 6}) {
    setup.features.add_point(grid.vertex(0, col));
    setup.grips.push_back(make_pinch<double>({grid.vertex(6, col)}, gripper::RibbedPad{}, 20.0));
  }
  PlannerSettings<double> settings = PlannerSettings<double>::rollout();
  settings.weights.smooth = loose_plant<double>().planner.weights.smooth;
  settings.weights.anchor = loose_plant<double>().planner.weights.anchor;
  settings.command = PlantCommand::Position;  // plan forces, send the resulting positions
  settings.gravity_load = plant_traits<game::Cloth>::gravity_load(cloth);
  auto planner = SheetPlanner::create(setup, settings, make_predictor(network, 0.5), start).value();
  PlanResult<double> plan = planner.make_result();
  const auto target = [&](Index corner, double t) -> Vector3<double> {
    const double ramp = t > 0 ? 1 - std::exp(-t * t) : 0;
    return start.col(grid.vertex(0, corner == 0 ? 0 : 6)) +
           ramp * Vector3<double>(0.02 * std::sin(2 * t), 0.05 * std::sin(3 * t), 0.0);
  };
  double sum = 0, violation = 0;
  const int frames = 150;
  for (int frame = 0; frame < frames; ++frame) {
    const FrameReport<double> report = run_frame(planner, cloth, 0.02 * frame, target, plan);
    if (!report.advanced()) return false;
    sum += report.mean_error;
    violation = std::fmax(violation, contact_violation(planner, plan));
  }
  const double mean = 1000 * sum / frames;
  std::printf(
      "the corners follow for %d frames with a mean error of %.1f mm; "
      "largest violation of the pads' contact law: %.1e N\n",
      frames, mean, violation);
  return mean < 5 && violation <= 1e-9;
}

// Moves the tip of the workshop's arm to a point.
bool reach() {
  const workshop::Arm arm;
  InverseKinematics<workshop::Arm> ik(arm, 1);
  VectorX<double> q(3);
  q << 0.2, 0.4, 0.3;
  const Vector3<double> goal(0.45, 0.0, 0.5);
  const std::vector<IkTask<double>> tasks{IkTask<double>::position(2, {0, 0, 0}, goal)};
  const IkReport<double> report = ik.solve(arm, tasks, VectorX<double>(), q);
  std::printf("the arm's tip ends %.1e mm from its goal\n", 1000 * report.error);
  return report.status == IkStatus::Reached;
}

int main() { return move_cloth() && reach() ? 0 : 1; }
