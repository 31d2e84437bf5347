#pragma once

// What both worlds of Bullet share.

#include <BulletSoftBody/btSoftBody.h>
#include <BulletSoftBody/btSoftBodyRigidBodyCollisionConfiguration.h>
#include <btBulletDynamicsCommon.h>

#include <memory>
#include <vector>

#include "../support/coloured.hpp"
#include "engine.hpp"

namespace versus {

inline btScalar real(double x) { return static_cast<btScalar>(x); }

/// Settings of Bullet's sheets.
struct BulletSetting {
  /// Sweeps over links and contacts (position world).
  int sweeps = 10;
  /// Margin of the sheet, at which it rests (m).
  double margin = 1e-3;
  /// Share of a depth below fixed obstacles that a sweep removes; Bullet's default is 0.1.
  double hardness = 1;
  /// Cells of the obstacle's distance field (m). Bullet's default, 0.25, is too coarse for an
  /// obstacle of 0.3 m; smaller cells than these gain little.
  double voxel = 0.02;
  /// Clusters for contact with itself (position world); 0: one for each triangle.
  int clusters = 256;
  /// Spring stiffness (N/m) and damping (N s/m) (deformable world).
  double stiffness = 0, damping = 0;
  /// Whether springs are implicit, and faces meet obstacles too (deformable world).
  bool implicit = false, faces = false;
  /// More parts of a step.
  int substeps = 1;
};

/// An obstacle that never moves; its friction times `share` is that of the scene.
class BulletObstacle {
 public:
  BulletObstacle(const Obstacle& obstacle, double share) {
    const btScalar size = real(obstacle.size);
    if (obstacle.box) {
      shape_ = std::make_unique<btBoxShape>(btVector3(size, size, size));
      shape_->setMargin(real(1e-3));  // edges are rounded by it
    } else {
      shape_ = std::make_unique<btSphereShape>(size);
    }
    body_ = std::make_unique<btRigidBody>(
        btRigidBody::btRigidBodyConstructionInfo(0, nullptr, shape_.get()));
    body_->setFriction(real(obstacle.friction / share));
  }

  btRigidBody* body() { return body_.get(); }

 private:
  std::unique_ptr<btCollisionShape> shape_;
  std::unique_ptr<btRigidBody> body_;
};

/// What both engines have: a sheet and an obstacle in a world that they own.
template <class World>
class BulletEngine : public Engine {
 public:
  explicit BulletEngine(const BulletSetting& setting) : setting_(setting) {}

  void frame(double dt) override {
    const btScalar h = real(dt / substeps_);
    for (int part = 0; part < substeps_; ++part) world().stepSimulation(h, 0);
  }
  void read(double* positions) override {
    for (int i = 0; i < body_->m_nodes.size(); ++i) {
      for (int c = 0; c < 3; ++c) *positions++ = static_cast<double>(body_->m_nodes[i].m_x[c]);
    }
  }

 protected:
  virtual World& world() = 0;
  void add_obstacle(const Obstacle& obstacle, double share) {
    obstacle_ = std::make_unique<BulletObstacle>(obstacle, share);
    world().addRigidBody(obstacle_->body());
  }

  BulletSetting setting_;
  int substeps_ = 1;
  btSoftBodyRigidBodyCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btDbvtBroadphase broad_phase_;
  std::unique_ptr<btSoftBody> body_;
  std::unique_ptr<BulletObstacle> obstacle_;
};

/// An engine of the deformable world.
std::unique_ptr<Engine> make_deformable(const BulletSetting& setting);

/// Makes the nodes, links and faces of a sheet, and sets the world's gravity and distance field.
inline std::unique_ptr<btSoftBody> make_body(const Scene& scene, const BulletSetting& setting,
                                             btSoftBodyWorldInfo& info) {
  info.m_gravity = btVector3(0, 0, real(-kGravity));
  info.air_density = 0;
  info.water_density = 0;
  info.m_sparsesdf.setDefaultVoxelsz(real(setting.voxel));
  info.m_sparsesdf.Reset();
  std::vector<btVector3> places;
  std::vector<btScalar> masses;
  for (int i = 0; i < scene.n(); ++i) {
    const double* p = scene.positions.data() + 3 * i;
    places.emplace_back(real(p[0]), real(p[1]), real(p[2]));
    masses.push_back(real(scene.mass[static_cast<std::size_t>(i)]));
  }
  auto body = std::make_unique<btSoftBody>(&info, scene.n(), places.data(), masses.data());
  for (const Edge& e : coloured(scene.edges)) body->appendLink(e.a, e.b);
  for (const auto& t : scene.triangles) body->appendFace(t[0], t[1], t[2]);
  body->getCollisionShape()->setMargin(real(setting.margin));
  body->m_cfg.kKHR = real(setting.hardness);
  body->setActivationState(DISABLE_DEACTIVATION);
  return body;
}

}  // namespace versus
