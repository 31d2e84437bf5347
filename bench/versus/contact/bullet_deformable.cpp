// Bullet's deformable world: springs and contacts change velocities.

#include <BulletSoftBody/btDeformableBodySolver.h>
#include <BulletSoftBody/btDeformableMultiBodyConstraintSolver.h>
#include <BulletSoftBody/btDeformableMultiBodyDynamicsWorld.h>

#include <cmath>

#include "bullet.hpp"

namespace versus {

namespace {

/// Friction of the sheet; on itself its square counts, on obstacles theirs is a factor.
const double kFriction = std::sqrt(0.3);

/// A deformable world with a sheet and an obstacle.
class Deformable final : public BulletEngine<btDeformableMultiBodyDynamicsWorld> {
 public:
  explicit Deformable(const BulletSetting& setting) : BulletEngine(setting) {
    solver_.setDeformableSolver(&deformable_);
  }

  ~Deformable() override {
    if (body_ != nullptr) {
      world_.removeSoftBodyForce(body_.get());
      world_.removeSoftBody(body_.get());
    }
    if (obstacle_ != nullptr) world_.removeRigidBody(obstacle_->body());
    body_.reset();  // before the world
    obstacle_.reset();
  }

  std::string load(const Scene& scene) override {
    using Collision = btSoftBody::fCollision;
    substeps_ = scene.substeps * setting_.substeps;
    const btVector3 gravity(0, 0, real(-kGravity));
    world_.setGravity(gravity);
    body_ = make_body(scene, setting_, world_.getWorldInfo());
    body_->m_cfg.kDF = real(kFriction);
    body_->m_cfg.collisions = Collision::SDF_RD | Collision::SDF_RDN;
    if (setting_.faces) body_->m_cfg.collisions |= Collision::SDF_RDF;
    if (scene.self) body_->m_cfg.collisions |= Collision::VF_DD;
    world_.addSoftBody(body_.get());
    body_->setSelfCollision(scene.self);
    body_->setSpringStiffness(real(setting_.stiffness));
    springs_ = std::make_unique<btDeformableMassSpringForce>(real(setting_.stiffness),
                                                             real(setting_.damping), true);
    world_.addForce(body_.get(), springs_.get());
    gravity_ = std::make_unique<btDeformableGravityForce>(gravity);
    world_.addForce(body_.get(), gravity_.get());
    world_.setImplicit(setting_.implicit);
    world_.setUseProjection(true);
    add_obstacle(scene.obstacle, kFriction);
    return {};
  }

 private:
  btDeformableMultiBodyDynamicsWorld& world() override { return world_; }

  btDeformableBodySolver deformable_;
  btDeformableMultiBodyConstraintSolver solver_;
  btDeformableMultiBodyDynamicsWorld world_{&dispatcher_, &broad_phase_, &solver_, &configuration_,
                                            &deformable_};
  std::unique_ptr<btDeformableMassSpringForce> springs_;
  std::unique_ptr<btDeformableGravityForce> gravity_;
};

}  // namespace

std::unique_ptr<Engine> make_deformable(const BulletSetting& setting) {
  return std::make_unique<Deformable>(setting);
}

}  // namespace versus
