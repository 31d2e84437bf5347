// A sheet falls over a ball that stands still, then a lighter ball falls on it and rolls down.

#include <cstdio>

#include "clothctl/clothctl.hpp"

using namespace clothctl;

int main() {
  // A level sheet of cotton, 0.8 m wide, 33 × 33 vertices. (Grids hang; this one is laid down.)
  const GridMesh<double> grid = make_grid<double>(33, 33, 0.8, 0.8).value();
  Points<double> positions = grid.positions;
  positions.row(0).array() -= grid.positions.row(0).mean();
  positions.row(1) = grid.positions.row(2).array() - grid.positions.row(2).mean();
  positions.row(2).setConstant(0.25);
  const Material<double> cotton = material_preset<double>("cotton").value();
  const SpringNetwork<double> network =
      sheet_network<double>(positions, grid.triangles, cotton).value();
  const MassSpring<double> model = MassSpring<double>::create(network).value();

  World<double> world;
  ColliderSurface<double> surface;
  surface.friction = 0.5;
  world.add_obstacle(SphereCollider<double>::create({0, 0, 0}, 0.2).value(), {}, surface).value();
  world.add_obstacle(PlaneCollider<double>::create({0, 0, -0.5}, {0, 0, 1}).value()).value();
  WorldSheetSetup<double> setup;
  setup.meets_sheets = true;  // the sheet does not pass through itself
  const int sheet = world.add_sheet(model, model.rest_state(), setup).value();
  RigidBodySetup<double> ball{ConvexShape<double>::sphere(0.03).value()};
  ball.motion.position = {0.05, 0, 0.9};
  ball.mass = 0.05;
  const int body = world.add_body(ball).value();

  const double dt = 1.0 / 60;
  for (int frame = 1; frame <= 180; ++frame) {
    const WorldReport<double> report = world.step(dt);
    if (!report.advanced) {
      std::printf("%s: %s\n", to_string(report.status).data(), world.check_input(dt).c_str());
      return 1;
    }
    if (frame % 30 == 0)
      std::printf("%.1f s: %3d contacts, the middle of the sheet at %.3f m, the ball at %.3f m\n",
                  frame * dt, static_cast<int>(report.contacts),
                  world.state(sheet).positions(2, 16 * 33 + 16),
                  world.bodies().motion(body).position[2]);
  }
}
