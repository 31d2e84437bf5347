#include <Simulation/Simulation.h>
#include <Simulation/SimulationModel.h>
#include <Simulation/TimeManager.h>
#include <Simulation/TimeStepController.h>
#include <Utils/Logger.h>
#include <Utils/Timing.h>

#include <algorithm>
#include <type_traits>

#include "engine.hpp"

// The library leaves these to the program.
INIT_LOGGING
INIT_TIMING

namespace {

using namespace versus;

/// Distance constraints of stiffness 1, coloured by the library; first-order velocity update; no
/// sweeps over velocities. The library is compiled without OpenMP.
class Pbd final : public Engine {
 public:
  std::string load(const Sheet& sheet, const Setting& setting) override {
    PBD::Simulation* const simulation = PBD::Simulation::getCurrent();
    Real gravity[3] = {0, 0, static_cast<Real>(-kGravity)};
    simulation->setVecValue<Real>(PBD::Simulation::GRAVITATION, gravity);
    model_.init();
    PBD::ParticleData& particles = model_.getParticles();
    for (int i = 0; i < sheet.n(); ++i) {
      const Eigen::Vector3d place(sheet.positions[static_cast<std::size_t>(3 * i)],
                                  sheet.positions[static_cast<std::size_t>(3 * i + 1)],
                                  sheet.positions[static_cast<std::size_t>(3 * i + 2)]);
      const bool held = std::count(sheet.pinned.begin(), sheet.pinned.end(), i) > 0;
      particles.addVertex(place.cast<Real>());
      const double mass = held ? 0.0 : sheet.mass[static_cast<std::size_t>(i)];
      particles.setMass(static_cast<unsigned>(i), static_cast<Real>(mass));
    }
    for (const Edge& e : sheet.edges)
      model_.addDistanceConstraint(static_cast<unsigned>(e.a), static_cast<unsigned>(e.b), Real(1));
    stepper_.init();
    const auto set = [this](int id, int value) {
      stepper_.setValue<unsigned>(id, static_cast<unsigned>(value));
    };
    set(PBD::TimeStepController::NUM_SUB_STEPS, setting.substeps);
    set(PBD::TimeStepController::MAX_ITERATIONS, setting.sweeps);
    set(PBD::TimeStepController::MAX_ITERATIONS_V, 0);
    return {};
  }

  void frame(double dt) override {
    PBD::TimeManager::getCurrent()->setTimeStepSize(static_cast<Real>(dt));
    stepper_.step(model_);
  }

  void read(double* positions, double* velocities) override {
    const PBD::ParticleData& particles = model_.getParticles();
    for (unsigned i = 0; i < particles.size(); ++i) {
      for (Eigen::Index c = 0; c < 3; ++c) {
        *positions++ = static_cast<double>(particles.getPosition(i)[c]);
        *velocities++ = static_cast<double>(particles.getVelocity(i)[c]);
      }
    }
  }

  void scale_velocities(double factor) override {
    PBD::ParticleData& particles = model_.getParticles();
    for (unsigned i = 0; i < particles.size(); ++i)
      particles.getVelocity(i) *= static_cast<Real>(factor);
  }

 private:
  PBD::SimulationModel model_;
  PBD::TimeStepController stepper_;
};

static_assert(std::is_same_v<Real, float>, "compile the library with USE_DOUBLE_PRECISION=OFF");

std::unique_ptr<Engine> make() { return std::make_unique<Pbd>(); }

}  // namespace

VERSUS_MODULE("pbd", VERSUS_PBD_VERSION,
              {{"substeps", true, 1, 5, {0, 0}, make}, {"sweeps", false, 1, 5, {1, 64}, make}})
