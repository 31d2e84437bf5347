// Tests of the law suite itself: a small correct model passes, and each faulty variant of it fails.

#include "laws/cloth_laws.hpp"

#include <memory>

#include "clothctl/cloth/detail/step_input.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

enum class Fault {
  None,
  MovesOnBadInput,
  IgnoresBadState,
  RemembersLastStep,
  MissesDrivenTarget,
  LovesTheOrigin,
  LeansEast,
  LosesMomentum,
  FallsHalfway,
  MindsSpeed,
  Allocates
};

// Particles in a row, joined to their neighbours by springs. Implicit Euler, with the spring forces
// of the start of the step.
template <class Scalar>
class ParticleRow {
 public:
  struct Workspace {
    std::vector<unsigned char> held;
    Points<Scalar> velocity;
    Scalar memory = Scalar(0);
  };

  ParticleRow(Index n, Fault fault)
      : mass_(VectorX<Scalar>::LinSpaced(n, Scalar(0.01), Scalar(0.02))), fault_(fault) {}

  const VectorX<Scalar>& mass() const { return mass_; }
  Index vertex_count() const { return mass_.size(); }
  ClothState<Scalar> rest_state() const {
    ClothState<Scalar> state{Points<Scalar>::Zero(3, vertex_count()),
                             Points<Scalar>::Zero(3, vertex_count())};
    for (Index i = 0; i < vertex_count(); ++i)
      state.positions(0, i) = Scalar(0.1) * static_cast<Scalar>(i);
    return state;
  }
  Workspace make_workspace() const {
    const Points<Scalar> zero = Points<Scalar>::Zero(3, vertex_count());
    return {std::vector<unsigned char>(static_cast<std::size_t>(vertex_count())), zero};
  }

  StepReport<Scalar> step(ClothState<Scalar>& state, const ClothInput<Scalar>& input, Scalar dt,
                          Workspace& ws) const {
    const StepStatus checked = detail::check_step(state, input, dt, vertex_count(), ws.held);
    if (checked != StepStatus::Converged) {
      if (fault_ == Fault::MovesOnBadInput && state.positions.cols() == vertex_count())
        state.velocities(0, 0) += Scalar(1);
      if (fault_ == Fault::IgnoresBadState && checked == StepStatus::InvalidState)
        return {StepStatus::Converged, true, Scalar(0), 0};
      return {checked, false, Scalar(0), 0};
    }
    const Vector3<Scalar> gravity(Scalar(0), Scalar(0), Scalar(-9.81));
    ws.velocity = state.velocities;
    for (Index i = 0; i < vertex_count(); ++i) ws.velocity.col(i) += dt * gravity;
    for (std::size_t k = 0; k < input.force_vertices.size(); ++k) {
      const Index v = input.force_vertices[k];
      ws.velocity.col(v) += dt / mass_[v] * input.forces.col(static_cast<Index>(k));
    }
    for (Index i = 1; i < vertex_count(); ++i) {
      const Vector3<Scalar> d = state.positions.col(i) - state.positions.col(i - 1);
      const Vector3<Scalar> pull = dt * Scalar(2) * (Scalar(1) - Scalar(0.1) / d.norm()) * d;
      ws.velocity.col(i) -= pull / mass_[i];
      ws.velocity.col(i - 1) += pull / mass_[i - 1];
    }
    if (fault_ == Fault::LovesTheOrigin) ws.velocity -= dt * state.positions;
    if (fault_ == Fault::LeansEast) ws.velocity.row(0).array() += Scalar(0.1) * dt;
    if (fault_ == Fault::LosesMomentum) ws.velocity *= Scalar(0.999);
    if (fault_ == Fault::MindsSpeed)
      ws.velocity +=
          Scalar(1e-3) * dt * ws.velocity.squaredNorm() * gravity.replicate(1, vertex_count());
    if (fault_ == Fault::RemembersLastStep) {
      ws.velocity(2, 0) += ws.memory;
      ws.memory = Scalar(1e-6);
    }
    if (fault_ == Fault::Allocates) std::make_unique<Points<Scalar>>(ws.velocity)->setZero();
    for (std::size_t k = 0; k < input.driven_vertices.size(); ++k) {
      const Index v = input.driven_vertices[k];
      ws.velocity.col(v) =
          (input.driven_positions.col(static_cast<Index>(k)) - state.positions.col(v)) / dt;
    }
    state.velocities = ws.velocity;
    state.positions += (fault_ == Fault::FallsHalfway ? Scalar(0.5) : Scalar(1)) * dt * ws.velocity;
    for (std::size_t k = 0; k < input.driven_vertices.size() && fault_ != Fault::MissesDrivenTarget;
         ++k) {
      state.positions.col(input.driven_vertices[k]) =
          input.driven_positions.col(static_cast<Index>(k));
    }
    if (fault_ == Fault::MissesDrivenTarget && !input.driven_vertices.empty()) {
      state.positions.col(input.driven_vertices[0]).array() += Scalar(1e-7);
    }
    return {StepStatus::Converged, true, Scalar(0), 1};
  }

 private:
  VectorX<Scalar> mass_;
  Fault fault_;
};

template <class Scalar>
void judge(Fault fault) {
  const ParticleRow<Scalar> model(7, fault);
  clothctl_test::ClothLaws<Scalar> laws;
  laws.mass = model.mass();
  clothctl_test::check_cloth_laws(model, laws);
}

}  // namespace

TEMPLATE_TEST_CASE("a correct small model passes the laws of cloth", "[laws]", float, double) {
  judge<TestType>(Fault::None);
}

// Each of these must fail: with [!shouldfail] Catch counts a failure as a success and a pass as a
// failure.
TEST_CASE("the laws of cloth detect that bad input changes the state", "[laws][!shouldfail]") {
  judge<double>(Fault::MovesOnBadInput);
}
TEST_CASE("the laws of cloth detect that a bad state is accepted", "[laws][!shouldfail]") {
  judge<double>(Fault::IgnoresBadState);
}
TEST_CASE("the laws of cloth detect that the workspace affects the next step",
          "[laws][!shouldfail]") {
  judge<double>(Fault::RemembersLastStep);
}
TEST_CASE("the laws of cloth detect that a driven vertex misses its position",
          "[laws][!shouldfail]") {
  judge<double>(Fault::MissesDrivenTarget);
}
TEST_CASE("the laws of cloth detect a dependence on the distance from the origin",
          "[laws][!shouldfail]") {
  judge<double>(Fault::LovesTheOrigin);
}
TEST_CASE("the laws of cloth detect a dependence on direction", "[laws][!shouldfail]") {
  judge<double>(Fault::LeansEast);
}
TEST_CASE("the laws of cloth detect that momentum is lost", "[laws][!shouldfail]") {
  judge<double>(Fault::LosesMomentum);
}
TEST_CASE("the laws of cloth detect that positions lag behind velocities", "[laws][!shouldfail]") {
  judge<double>(Fault::FallsHalfway);
}
TEST_CASE("the laws of cloth detect a dependence on absolute speed", "[laws][!shouldfail]") {
  judge<double>(Fault::MindsSpeed);
}

TEST_CASE("the laws of cloth detect that a step allocates", "[laws][!shouldfail]") {
  judge<double>(Fault::Allocates);
  if (!clothctl_test::allocation_counting_works())
    FAIL("allocations cannot be counted in this build");
}
