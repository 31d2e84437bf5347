#include "clothctl/prediction/window_jacobian.hpp"

#include <limits>

#include "clothctl/cloth/mass_spring_rollout.hpp"
#include "support/allocations.hpp"
#include "support/catch.hpp"
#include "support/sheets.hpp"
#include "support/square_sheets.hpp"

using namespace clothctl;
using clothctl_test::noise;

namespace {

constexpr double kStep = 0.02;  // s
constexpr Index kVertices = 36;

// A 6×6 sheet held at `held`, that moves in each frame by its row of `plan`.
struct Window {
  SpringNetwork<double> network = clothctl_test::square_sheet<double>(6);
  MassSpring<double> model;
  WindowRequest<double> request;
  ClothState<double> start{network.rest_positions + noise<double>(1, kVertices, 0.002),
                           noise<double>(2, kVertices, 0.1)};

  Window(std::vector<int> held, const std::vector<int>& features, Index horizon)
      : model(MassSpring<double>::create(network, settings()).value()) {
    request.horizon = horizon;
    request.dt = kStep;
    request.kind = GripInput::Pose;
    request.held = std::move(held);
    for (const int v : features) request.outputs.add_point(v);
    request.outputs.add_sum({{2, 0.25}, {9, 0.75}});
    request.held_outputs = request.outputs.count();
    for (const int v : request.held) request.outputs.add_point(v);
    request.wind.setZero(3, horizon);
    request.plan = 0.1 * noise<double>(3, request.inputs() * horizon, 1.0)
                             .topRows(1)
                             .reshaped(request.inputs(), horizon);
  }

  static MassSpringSettings<double> settings() {
    MassSpringSettings<double> s;
    s.integration = Integration::Newton;
    s.drag = 0.5;
    s.limit_energy = false;
    s.velocity_tolerance = 1e-12;
    return s;
  }

  // The states along a plan.
  std::vector<ClothState<double>> roll_out(const MatrixX<double>& plan) const {
    std::vector<ClothState<double>> states{start};
    auto ws = model.make_workspace();
    ClothInput<double> input;
    input.driven_vertices = request.held;
    input.driven_positions.resize(3, static_cast<Index>(request.held.size()));
    for (Index k = 0; k < request.horizon; ++k) {
      states.push_back(states.back());
      for (std::size_t j = 0; j < request.held.size(); ++j)
        input.driven_positions.col(static_cast<Index>(j)) =
            states.back().positions.col(request.held[j]) +
            kStep * plan.block<3, 1>(3 * static_cast<Index>(j), k);
      REQUIRE(model.step(states.back(), input, kStep, ws).advanced);
    }
    return states;
  }

  // The features along a plan, frame by frame.
  VectorX<double> features(const MatrixX<double>& plan) const {
    const auto states = roll_out(plan);
    MatrixX<double> out(request.output_rows(), request.horizon);
    for (Index k = 0; k < request.horizon; ++k)
      request.write_outputs(states[static_cast<std::size_t>(k) + 1].positions, k, out);
    return out.topRows(3 * request.held_outputs).reshaped();
  }

  MatrixX<double> empty() const {
    return MatrixX<double>::Zero(3 * request.held_outputs * request.horizon,
                                 request.inputs() * request.horizon);
  }

  MatrixX<double> jacobian(Index stride = 1) const {
    auto derivative = MassSpringDerivative<double>::create(model, request.held).value();
    WindowJacobian<MassSpringDerivative<double>, double> window(std::move(derivative), request,
                                                                stride);
    MatrixX<double> out = empty();
    REQUIRE(window.evaluate(roll_out(request.plan), request, {}, out));
    return out;
  }
};

}  // namespace

TEST_CASE("the Jacobian of a window is the limit of differences of rollouts", "[prediction]") {
  // As many inputs as outputs, more, and less; an even and an odd number of frames, and one alone.
  const std::vector<int> corners{0, 5};
  for (const Window& w : {Window({30, 35}, corners, 6), Window({30, 31, 34, 35, 28}, {}, 7),
                          Window({35}, {0, 1, 2, 3, 4, 35}, 5), Window({30, 35}, corners, 1)}) {
    const MatrixX<double> J = w.jacobian();
    for (unsigned seed = 0; seed < 4; ++seed) {
      const MatrixX<double> way = noise<double>(10 + seed, w.request.plan.size(), 1.0)
                                      .topRows(1)
                                      .reshaped(w.request.inputs(), w.request.horizon);
      const double e = 1e-6;
      const VectorX<double> ahead = w.features(w.request.plan + e * way);
      const VectorX<double> expected = (ahead - w.features(w.request.plan - e * way)) / (2 * e);
      const VectorX<double> found = J * way.reshaped();
      CHECK((found - expected).norm() < 1e-5 * expected.norm());
    }
    const Index p = 3 * w.request.held_outputs, m = w.request.inputs();
    for (Index k = 0; k < w.request.horizon; ++k)
      CHECK(J.block(p * k, 0, p, J.cols()).rightCols(m * (w.request.horizon - k - 1)).isZero(0));
  }
}

TEST_CASE("a moved Jacobian is that of the next window where they overlap", "[prediction]") {
  const Index frames = 5;
  Window w({30, 35}, {0, 5}, frames);
  MatrixX<double> moved = w.jacobian();
  shift_jacobian(frames, moved);
  Window next = w;
  next.start = w.roll_out(w.request.plan)[1];
  for (Index k = 0; k + 1 < frames; ++k) next.request.plan.col(k) = w.request.plan.col(k + 1);
  const MatrixX<double> expected = next.jacobian();
  const Index rows = expected.rows() / frames * (frames - 1),
              columns = expected.cols() / frames * (frames - 1);
  CHECK((moved - expected).topLeftCorner(rows, columns).norm() < 1e-9 * expected.norm());
}

TEST_CASE("a derivation by steps of several frames is close to the exact one", "[prediction]") {
  // The last step has as many frames as the others, or fewer; one step is longer than the window.
  for (const Index frames : {12, 11, 3}) {
    Window w({30, 35}, {0, 5}, frames);
    w.start.positions = 1.02 * w.network.rest_positions;  // calm and taut
    w.start.velocities.setZero();
    w.request.plan *= 0.1;
    const MatrixX<double> exact = w.jacobian();
    const Index p = 3 * w.request.held_outputs, m = w.request.inputs();
    double last = 0.0;
    for (const Index stride : {1, 2, 4}) {
      const MatrixX<double> found = w.jacobian(stride);
      const double error = (found - exact).norm() / exact.norm();
      CAPTURE(frames, stride, error, last);
      CHECK(error < 0.12 * static_cast<double>(stride));
      CHECK((stride == 1 ? error == 0.0 : error > last));
      last = error;
      for (Index k = 0; k < frames; ++k)
        CHECK(found.block(p * k, 0, p, found.cols()).rightCols(m * (frames - k - 1)).isZero(0));
    }
  }
}

TEST_CASE("a held vertex follows its input wherever steps of several frames end", "[prediction]") {
  Window w({30, 35}, {30}, 10);
  const MatrixX<double> found = w.jacobian(3);
  const Index p = 3 * w.request.held_outputs, m = w.request.inputs();
  for (Index k = 2; k < 10; k = k + 3) {  // ends of steps; inputs up to the middle of the last one
    for (Index j = 0; j + 1 < k; ++j)
      CHECK((found.block(p * k, m * j, 3, 3) - kStep * Matrix3<double>::Identity()).norm() < 1e-15);
  }
}

TEST_CASE("a rollout that is not finite has no Jacobian", "[prediction]") {
  const Window w({30, 35}, {0, 5}, 4);
  auto states = w.roll_out(w.request.plan);
  WindowJacobian<MassSpringDerivative<double>, double> window(
      MassSpringDerivative<double>::create(w.model, w.request.held).value(), w.request);
  MatrixX<double> out = w.empty();
  states[3].velocities(1, 7) = std::numeric_limits<double>::infinity();
  CHECK(!window.evaluate(states, w.request, {}, out));
}

TEST_CASE("single precision and blocks of neighbours are close to the exact Jacobian",
          "[prediction]") {
  const Window w({30, 35}, {0, 5}, 10);
  const MassSpringRollout<double> model(w.model);
  WindowJacobian<MassSpringDerivative<float>, double> window(model.make_derivative(w.request.held),
                                                             w.request);
  MatrixX<double> out = w.empty();
  const auto states = w.roll_out(w.request.plan);
  const long allocations = clothctl_test::allocations();
  const bool derived = window.evaluate(states, w.request, {}, out);  // also the first time
  CHECK(
      (clothctl_test::allocations() == allocations || !clothctl_test::allocation_counting_works()));
  REQUIRE(derived);
  const MatrixX<double> expected = w.jacobian(), before = out;
  CHECK((out - expected).norm() < 0.05 * expected.norm());
  CHECK(window.evaluate(states, w.request, {}, out));
  CHECK(out == before);
}
