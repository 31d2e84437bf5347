// First, because every other header of Jolt needs it.
#include <Jolt/Jolt.h>
// The order of the others does not matter.
#include <Jolt/Core/Factory.h>
#include <Jolt/Core/JobSystemSingleThreaded.h>
#include <Jolt/Core/TempAllocator.h>
#include <Jolt/Physics/Body/BodyInterface.h>
#include <Jolt/Physics/PhysicsSystem.h>
#include <Jolt/Physics/SoftBody/SoftBodyCreationSettings.h>
#include <Jolt/Physics/SoftBody/SoftBodyMotionProperties.h>
#include <Jolt/Physics/SoftBody/SoftBodySharedSettings.h>
#include <Jolt/RegisterTypes.h>

#include <algorithm>
#include <cmath>

#include "engine.hpp"

namespace {

using namespace versus;

/// The library's global state, made once and kept.
void start_jolt() {
  if (JPH::Factory::sInstance != nullptr) return;
  JPH::RegisterDefaultAllocator();
  JPH::Factory::sInstance = new JPH::Factory();
  JPH::RegisterTypes();
}

/// The compliance (m/N) with which Jolt comes closest on 32 × 32 vertices, of 0 and powers of ten.
/// It is that of the implicit reference. Without compliance, sheets gain energy from 40 substeps
/// on.
constexpr float kCompliance = 1e-4f;

/// One soft body in a world of its own, on one thread. Each of Jolt's iterations is a substep with
/// one sweep. Linear damping and the vertex radius are zero, and the body never sleeps. With
/// tethers, each vertex has a long range attachment to each pinned one; on a flat convex sheet the
/// geodesic distance is the straight one.
class Jolt final : public Engine {
 public:
  Jolt(float compliance, bool tethers) : compliance_(compliance), tethers_(tethers) {}

  std::string load(const Sheet& sheet, const Setting& setting) override {
    if (setting.sweeps != 1) return "Jolt makes one sweep in a substep";
    start_jolt();
    allocator_ = std::make_unique<JPH::TempAllocatorImpl>(16 * 1024 * 1024);
    jobs_ = std::make_unique<JPH::JobSystemSingleThreaded>(JPH::cMaxPhysicsJobs);
    world_ = std::make_unique<JPH::PhysicsSystem>();
    world_->Init(1, 0, 1, 1, broad_phase_, layer_against_broad_phase_, layers_);
    world_->SetGravity(JPH::Vec3(0, 0, static_cast<float>(-kGravity)));
    JPH::SoftBodyCreationSettings body(shared(sheet), JPH::RVec3::sZero(), JPH::Quat::sIdentity(),
                                       0);
    body.mNumIterations = static_cast<JPH::uint32>(setting.substeps);
    body.mLinearDamping = 0;
    body.mMaxLinearVelocity = 1e6f;
    body.mUpdatePosition = false;
    body.mAllowSleeping = false;
    JPH::BodyInterface& bodies = world_->GetBodyInterfaceNoLock();
    const JPH::BodyID id = bodies.CreateAndAddSoftBody(body, JPH::EActivation::Activate);
    if (id.IsInvalid()) return "Jolt cannot create the body";
    JPH::Body* const made = world_->GetBodyLockInterfaceNoLock().TryGetBody(id);
    motion_ = static_cast<JPH::SoftBodyMotionProperties*>(made->GetMotionProperties());
    return {};
  }

  void frame(double dt) override {
    world_->Update(static_cast<float>(dt), 1, allocator_.get(), jobs_.get());
  }

  void read(double* positions, double* velocities) override {
    for (const JPH::SoftBodyVertex& v : motion_->GetVertices()) {
      for (JPH::uint c = 0; c < 3; ++c) {
        *positions++ = static_cast<double>(v.mPosition[c]);
        *velocities++ = static_cast<double>(v.mVelocity[c]);
      }
    }
  }

  void scale_velocities(double factor) override {
    for (JPH::SoftBodyVertex& v : motion_->GetVertices()) {
      v.mVelocity *= static_cast<float>(factor);
    }
  }

 private:
  /// Nothing collides: all bodies are in one layer.
  class BroadPhase final : public JPH::BroadPhaseLayerInterface {
    JPH::uint GetNumBroadPhaseLayers() const override { return 1; }
    JPH::BroadPhaseLayer GetBroadPhaseLayer(JPH::ObjectLayer) const override {
      return JPH::BroadPhaseLayer(0);
    }
#if defined(JPH_EXTERNAL_PROFILE) || defined(JPH_PROFILE_ENABLED)
    const char* GetBroadPhaseLayerName(JPH::BroadPhaseLayer) const override { return "all"; }
#endif
  };

  JPH::Ref<JPH::SoftBodySharedSettings> shared(const Sheet& sheet) const {
    JPH::Ref<JPH::SoftBodySharedSettings> out = new JPH::SoftBodySharedSettings;
    for (int i = 0; i < sheet.n(); ++i) {
      const bool held = std::count(sheet.pinned.begin(), sheet.pinned.end(), i) > 0;
      const double* p = sheet.positions.data() + 3 * i;
      const double mass = sheet.mass[static_cast<std::size_t>(i)];
      out->mVertices.emplace_back(
          JPH::Float3(static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])),
          JPH::Float3(0, 0, 0), held ? 0.0f : static_cast<float>(1 / mass));
    }
    const auto u = [](int i) { return static_cast<JPH::uint32>(i); };
    for (const std::array<int, 3>& t : sheet.triangles)
      out->AddFace(JPH::SoftBodySharedSettings::Face(u(t[0]), u(t[1]), u(t[2])));
    for (const Edge& e : sheet.edges)
      out->mEdgeConstraints.push_back(
          JPH::SoftBodySharedSettings::Edge(u(e.a), u(e.b), compliance_));
    out->CalculateEdgeLengths();
    if (tethers_) {
      for (const int pin : sheet.pinned) {
        for (int i = 0; i < sheet.n(); ++i) {
          if (out->mVertices[u(i)].mInvMass > 0.0f)
            out->mLRAConstraints.push_back(JPH::SoftBodySharedSettings::LRA(u(pin), u(i), 0.0f));
        }
      }
      out->CalculateLRALengths();
    }
    out->Optimize();
    return out;
  }

  float compliance_;
  bool tethers_;
  BroadPhase broad_phase_;
  JPH::ObjectVsBroadPhaseLayerFilter layer_against_broad_phase_;
  JPH::ObjectLayerPairFilter layers_;
  std::unique_ptr<JPH::TempAllocatorImpl> allocator_;
  std::unique_ptr<JPH::JobSystemSingleThreaded> jobs_;
  std::unique_ptr<JPH::PhysicsSystem> world_;
  JPH::SoftBodyMotionProperties* motion_ = nullptr;
};

std::string version() {
  return std::to_string(JPH_VERSION_MAJOR) + "." + std::to_string(JPH_VERSION_MINOR) + "." +
         std::to_string(JPH_VERSION_PATCH);
}

template <bool kCompliant, bool kTethers>
std::unique_ptr<Engine> make() {
  return std::make_unique<Jolt>(kCompliant ? kCompliance : 0.0f, kTethers);
}

}  // namespace

VERSUS_MODULE("jolt", version(),
              {{"rigid", true, 1, 5, {64, 1}, make<false, false>},
               {"compliant", true, 1, 5, {0, 0}, make<true, false>},
               {"tethers", true, 1, 5, {0, 0}, make<true, true>}})
