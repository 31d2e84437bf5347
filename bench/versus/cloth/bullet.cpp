#include <BulletSoftBody/btSoftBody.h>
#include <BulletSoftBody/btSoftBodyRigidBodyCollisionConfiguration.h>
#include <BulletSoftBody/btSoftRigidDynamicsWorld.h>
#include <btBulletDynamicsCommon.h>

#include <algorithm>

#include "../support/coloured.hpp"
#include "engine.hpp"

namespace {

using namespace versus;

/// One soft body in a world of its own, with one step of the world for each substep. Stiffness 1,
/// no damping, no air, no collisions, no faces.
class Bullet final : public Engine {
 public:
  ~Bullet() override {
    if (body_ != nullptr) world_.removeSoftBody(body_.get());
  }

  std::string load(const Sheet& sheet, const Setting& setting) override {
    substeps_ = setting.substeps;
    const auto real = [](double x) { return static_cast<btScalar>(x); };
    const btVector3 gravity(0, 0, real(-kGravity));
    world_.setGravity(gravity);
    btSoftBodyWorldInfo& info = world_.getWorldInfo();
    info.m_gravity = gravity;
    info.air_density = 0;
    info.water_density = 0;
    std::vector<btVector3> places;
    std::vector<btScalar> masses;
    for (int i = 0; i < sheet.n(); ++i) {
      const double* p = sheet.positions.data() + 3 * i;
      const bool held = std::count(sheet.pinned.begin(), sheet.pinned.end(), i) > 0;
      places.emplace_back(real(p[0]), real(p[1]), real(p[2]));
      masses.push_back(held ? btScalar(0) : real(sheet.mass[static_cast<std::size_t>(i)]));
    }
    body_ = std::make_unique<btSoftBody>(&info, sheet.n(), places.data(), masses.data());
    // With rows of edges in their own order, Bullet's substeps gain energy and its sweeps wait for
    // the vertex just written: less than half as fast.
    for (const Edge& e : coloured(sheet.edges)) body_->appendLink(e.a, e.b);
    body_->m_materials[0]->m_kLST = 1;
    body_->m_cfg.piterations = setting.sweeps;
    body_->m_cfg.kDP = 0;
    body_->m_cfg.collisions = 0;
    body_->setActivationState(DISABLE_DEACTIVATION);
    world_.addSoftBody(body_.get());
    return {};
  }

  void frame(double dt) override {
    const btScalar h = static_cast<btScalar>(dt / substeps_);
    for (int part = 0; part < substeps_; ++part) world_.stepSimulation(h, 0);
  }

  void read(double* positions, double* velocities) override {
    for (int i = 0; i < body_->m_nodes.size(); ++i) {
      for (int c = 0; c < 3; ++c) {
        *positions++ = static_cast<double>(body_->m_nodes[i].m_x[c]);
        *velocities++ = static_cast<double>(body_->m_nodes[i].m_v[c]);
      }
    }
  }

  void scale_velocities(double factor) override {
    for (int i = 0; i < body_->m_nodes.size(); ++i)
      body_->m_nodes[i].m_v *= static_cast<btScalar>(factor);
  }

 private:
  btSoftBodyRigidBodyCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btDbvtBroadphase broad_phase_;
  btSequentialImpulseConstraintSolver solver_;
  btSoftRigidDynamicsWorld world_{&dispatcher_, &broad_phase_, &solver_, &configuration_};
  std::unique_ptr<btSoftBody> body_;
  int substeps_ = 1;
};

std::unique_ptr<Engine> make() { return std::make_unique<Bullet>(); }

}  // namespace

VERSUS_MODULE("bullet", VERSUS_BULLET_VERSION,
              {{"substeps", true, 1, 5, {0, 0}, make}, {"sweeps", false, 1, 5, {1, 64}, make}})
