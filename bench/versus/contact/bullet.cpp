// Bullet's soft body in a btSoftRigidDynamicsWorld: links and contacts are swept over positions.

#include "bullet.hpp"

#include <BulletSoftBody/btSoftBodyInternals.h>
#include <BulletSoftBody/btSoftRigidDynamicsWorld.h>

namespace versus {

namespace {

/// Friction of the sheet; on itself that is all, on obstacles theirs is a factor.
constexpr double kFriction = 0.3;

/// A world in which sheets meet themselves by clusters. In 3.24 the flags CL_SS | CL_SELF select no
/// case of btSoftBody::defaultCollisionHandler, so alone they do nothing; this is the case that
/// they are meant for.
class SelfMeetingWorld final : public btSoftRigidDynamicsWorld {
 public:
  using btSoftRigidDynamicsWorld::btSoftRigidDynamicsWorld;

 protected:
  void internalSingleStepSimulation(btScalar dt) override {
    btSoftRigidDynamicsWorld::internalSingleStepSimulation(dt);
    for (int i = 0; i < getSoftBodyArray().size(); ++i) {
      btSoftBody* const body = getSoftBodyArray()[i];
      if ((body->m_cfg.collisions & btSoftBody::fCollision::CL_SELF) == 0) continue;
      btSoftColliders::CollideCL_SS collide;
      collide.ProcessSoftSoft(body, body);
    }
  }
};

/// A world with a soft body and an obstacle. Stiffness 1, no damping, no air.
class Soft final : public BulletEngine<SelfMeetingWorld> {
 public:
  explicit Soft(const BulletSetting& setting) : BulletEngine(setting) {}

  ~Soft() override {
    if (body_ != nullptr) world_.removeSoftBody(body_.get());
    if (obstacle_ != nullptr) world_.removeRigidBody(obstacle_->body());
    body_.reset();  // before the world
    obstacle_.reset();
  }

  std::string load(const Scene& scene) override {
    substeps_ = scene.substeps * setting_.substeps;
    world_.setGravity(btVector3(0, 0, real(-kGravity)));
    body_ = make_body(scene, setting_, world_.getWorldInfo());
    body_->m_materials[0]->m_kLST = 1;
    body_->m_cfg.piterations = setting_.sweeps;
    body_->m_cfg.kDF = real(kFriction);
    body_->m_cfg.collisions = btSoftBody::fCollision::SDF_RS;
    if (scene.self) {
      body_->m_cfg.collisions |= btSoftBody::fCollision::CL_SS | btSoftBody::fCollision::CL_SELF;
      body_->m_cfg.citerations = setting_.sweeps;
      body_->generateClusters(setting_.clusters);
    }
    world_.addSoftBody(body_.get());
    add_obstacle(scene.obstacle, kFriction);
    return {};
  }

 private:
  SelfMeetingWorld& world() override { return world_; }

  btSequentialImpulseConstraintSolver solver_;
  SelfMeetingWorld world_{&dispatcher_, &broad_phase_, &solver_, &configuration_};
};

Variant soft(const char* name, const BulletSetting& s, Use use = Use::Always, bool extra = false) {
  return {name, s.margin, use, extra, [s] { return std::make_unique<Soft>(s); }};
}

Variant deformable(const char* name, const BulletSetting& s, bool extra = false) {
  return {name, s.margin, Use::Always, extra, [s] { return make_deformable(s); }};
}

/// Names: sweeps x substeps for soft bodies, spring stiffness in N/m x substeps for deformable
/// ones; the gap in mm and the hardness where they are not 1; voxels in mm; faces: a cluster for
/// each triangle.
std::vector<Variant> variants() {
  return {
      soft("soft-10", {.sweeps = 10}),
      soft("soft-40", {.sweeps = 40}),
      soft("soft-160", {.sweeps = 160}),
      soft("soft-40x4", {.sweeps = 40, .substeps = 4}),
      soft("soft-40-gap-10", {.sweeps = 40, .margin = 0.01}),
      soft("soft-40x4-gap-5", {.sweeps = 40, .margin = 5e-3, .substeps = 4}),
      soft("soft-20x2-gap-10-hard-0.1",
           {.sweeps = 20, .margin = 0.01, .hardness = 0.1, .substeps = 2}),
      soft("soft-40x4-gap-5-hard-0.1",
           {.sweeps = 40, .margin = 5e-3, .hardness = 0.1, .substeps = 4}),
      soft("soft-40-gap-5-faces", {.sweeps = 40, .margin = 5e-3, .clusters = 0}, Use::OnlySelf),
      soft("soft-10x4-gap-5-faces", {.sweeps = 10, .margin = 5e-3, .clusters = 0, .substeps = 4},
           Use::OnlySelf),
      soft("soft-20x2-gap-10", {.sweeps = 20, .margin = 0.01, .substeps = 2}, Use::Always, true),
      soft("soft-10-gap-10-faces", {.sweeps = 10, .margin = 0.01, .clusters = 0}, Use::OnlySelf,
           true),
      soft("soft-40-gap-10-faces", {.sweeps = 40, .margin = 0.01, .clusters = 0}, Use::OnlySelf,
           true),
      soft("soft-10x2-gap-5-faces", {.sweeps = 10, .margin = 5e-3, .clusters = 0, .substeps = 2},
           Use::OnlySelf, true),
      soft("soft-40-hard-0.1", {.sweeps = 40, .hardness = 0.1}, Use::Always, true),
      soft("soft-40-gap-10-hard-0.1", {.sweeps = 40, .margin = 0.01, .hardness = 0.1}, Use::Always,
           true),
      soft("soft-10x4-gap-5-faces-hard-0.1",
           {.sweeps = 10, .margin = 5e-3, .hardness = 0.1, .clusters = 0, .substeps = 4},
           Use::OnlySelf, true),
      soft("soft-40-voxel-50", {.sweeps = 40, .voxel = 0.05}, Use::Always, true),
      soft("soft-40-voxel-250", {.sweeps = 40, .voxel = 0.25}, Use::Always, true),
      soft("soft-40-clusters-64", {.sweeps = 40, .clusters = 64}, Use::OnlySelf, true),
      deformable("deformable-10x8",
                 {.voxel = 0.005, .stiffness = 10, .damping = 0.1, .substeps = 8}),
      deformable("deformable-40x16",
                 {.voxel = 0.005, .stiffness = 40, .damping = 0.1, .substeps = 16}, true),
      deformable("deformable-10x8-contact-faces",
                 {.voxel = 0.005, .stiffness = 10, .damping = 0.02, .faces = true, .substeps = 8},
                 true),
      deformable("deformable-100x4-implicit",
                 {.voxel = 0.005, .stiffness = 100, .damping = 1, .implicit = true, .substeps = 4},
                 true),
  };
}

}  // namespace

}  // namespace versus

VERSUS_MODULE("bullet", VERSUS_BULLET_VERSION, versus::variants())
