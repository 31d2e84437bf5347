#include "clothctl/core/step_input.hpp"

#include <limits>
#include <string>

#include "support/catch.hpp"

using namespace clothctl;

namespace {

struct Step {
  ClothState<double> state{Points<double>::Zero(3, 4), Points<double>::Zero(3, 4)};
  ClothInput<double> input;
  double dt = 0.02;
  Step() {
    input.clear();
    input.force_vertices = {1, 1};
    input.forces = Points<double>::Ones(3, 2);
    input.driven_vertices = {0, 3};
    input.driven_positions = Points<double>::Ones(3, 2);
    input.attached_vertices = {2, 2};
    input.attached_positions = Points<double>::Ones(3, 2);
    input.attachment_stiffness = VectorX<double>::Ones(2);
  }
  std::string line() const { return check_step_input(state, input, dt, 4); }
};

const double kNan = std::numeric_limits<double>::quiet_NaN();
const double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

TEST_CASE("a good step has no error message", "[step_input]") {
  CHECK(Step().line().empty());
  Step empty;
  empty.input.clear();
  CHECK(empty.line().empty());
}

TEST_CASE("the message about a bad state names sizes, vertex and value", "[step_input]") {
  const ClothState<double> good = Step().state;
  CHECK(check_state(good, 4).empty());
  CHECK(check_state(good, 5) == "4 positions in the state for 5 vertices of the model");
  ClothState<double> bad = good;
  bad.velocities.setZero(3, 0);
  CHECK(check_state(bad, 4) == "0 velocities in the state for 4 vertices of the model");
  bad = good;
  bad.velocities(1, 2) = kNan;
  CHECK(check_state(bad, 4) == "velocity of vertex 2: y is nan");
  bad.positions(2, 3) = kInfinity;
  CHECK(check_state(bad, 4) == "position of vertex 3: z is inf");
}

TEST_CASE("the message about a bad step names item, index and value", "[step_input]") {
  const auto spoilt = [](auto change) {
    Step step;
    change(step);
    return step.line();
  };
  CHECK(spoilt([](Step& s) { s.dt = kNan; }) ==
        "step length dt must be positive and finite, got nan s");
  CHECK(spoilt([](Step& s) { s.dt = -0.02; }) ==
        "step length dt must be positive and finite, got -0.02 s");
  CHECK(spoilt([](Step& s) { s.dt = 0.0; }) ==
        "step length dt must be positive and finite, got 0 s");
  CHECK(spoilt([](Step& s) { s.state.positions.setZero(3, 5); }) ==
        "5 positions in the state for 4 vertices of the model");
  CHECK(spoilt([](Step& s) { s.state.velocities.setZero(3, 0); }) ==
        "0 velocities in the state for 4 vertices of the model");
  CHECK(spoilt([](Step& s) { s.state.positions(2, 3) = kInfinity; }) ==
        "position of vertex 3: z is inf");
  CHECK(spoilt([](Step& s) { s.state.velocities(0, 1) = kNan; }) ==
        "velocity of vertex 1: x is nan");
  CHECK(spoilt([](Step& s) { s.input.force_vertices[1] = 4; }) ==
        "force 1: vertex 4 is off the mesh of 4 vertices");
  CHECK(spoilt([](Step& s) { s.input.force_vertices[0] = -1; }) ==
        "force 0: vertex -1 is off the mesh of 4 vertices");
  CHECK(spoilt([](Step& s) { s.input.force_vertices.push_back(0); }) ==
        "2 forces for 3 force vertices");
  CHECK(spoilt([](Step& s) { s.input.forces(1, 0) = -kInfinity; }) == "force 0: y is -inf");
  CHECK(spoilt([](Step& s) { s.input.driven_vertices[1] = 9; }) ==
        "driven vertex 1: vertex 9 is off the mesh of 4 vertices");
  CHECK(spoilt([](Step& s) { s.input.driven_vertices[1] = 0; }) ==
        "driven vertex 1: vertex 0 is driven already by driven vertex 0");
  CHECK(spoilt([](Step& s) { s.input.driven_positions.setZero(3, 1); }) ==
        "1 driven positions for 2 driven vertices");
  CHECK(spoilt([](Step& s) { s.input.driven_positions(2, 1) = kNan; }) ==
        "driven position 1: z is nan");
  CHECK(spoilt([](Step& s) { s.input.wind[1] = kNan; }) == "wind: y is nan");
  CHECK(spoilt([](Step& s) { s.input.attached_vertices[1] = 4; }) ==
        "attached vertex 1: vertex 4 is off the mesh of 4 vertices");
  CHECK(spoilt([](Step& s) { s.input.attached_positions.setZero(3, 1); }) ==
        "1 attached positions for 2 attached vertices");
  CHECK(spoilt([](Step& s) { s.input.attached_positions(0, 1) = kInfinity; }) ==
        "attached position 1: x is inf");
  CHECK(spoilt([](Step& s) { s.input.attachment_stiffness.setOnes(1); }) ==
        "1 attachment stiffnesses for 2 attached vertices");
  CHECK(spoilt([](Step& s) { s.input.attachment_stiffness[1] = -1; }) ==
        "stiffness of attachment 1 must be positive and finite, got -1 N/m");
}
