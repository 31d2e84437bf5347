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
#include <numeric>
#include <random>
#include <utility>

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

/// How a sheet is given to Jolt.
struct Use {
  float compliance = 0;
  /// A long range attachment of each vertex to each pinned one; on a flat convex sheet the geodesic
  /// distance is the straight one.
  bool tethers = false;
  /// Random vertex numbers. Jolt takes edges in the order of these. With numbers in rows its sheets
  /// gain more energy, and each edge waits for the vertex just written: 104 instead of 140 M solves
  /// a second.
  bool shuffled = false;
};

/// Returns the number of each vertex in Jolt.
std::vector<std::size_t> numbers_of(int count, bool shuffled) {
  std::vector<std::size_t> numbers(static_cast<std::size_t>(count));
  std::iota(numbers.begin(), numbers.end(), std::size_t(0));
  std::mt19937 engine(1);
  for (std::size_t i = numbers.size(); shuffled && i > 1; --i)
    std::swap(numbers[i - 1], numbers[engine() % i]);
  return numbers;
}

/// The sheet with other vertex numbers.
Sheet renumbered(const Sheet& sheet, const std::vector<std::size_t>& numbers) {
  Sheet out = sheet;
  const auto to = [&](int i) { return static_cast<int>(numbers[static_cast<std::size_t>(i)]); };
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    out.mass[numbers[i]] = sheet.mass[i];
    for (std::size_t c = 0; c < 3; ++c)
      out.positions[3 * numbers[i] + c] = sheet.positions[3 * i + c];
  }
  for (int& pin : out.pinned) pin = to(pin);
  for (Edge& e : out.edges) {
    e.a = to(e.a);
    e.b = to(e.b);
  }
  for (std::array<int, 3>& t : out.triangles) {
    for (int& corner : t) corner = to(corner);
  }
  return out;
}

/// One soft body in a world of its own, on one thread. Each of Jolt's iterations is a substep with
/// one sweep. Linear damping and the vertex radius are zero, and the body never sleeps.
class Jolt final : public Engine {
 public:
  explicit Jolt(const Use& use) : use_(use) {}

  std::string load(const Sheet& sheet, const Setting& setting) override {
    if (setting.sweeps != 1) return "Jolt makes one sweep in a substep";
    start_jolt();
    numbers_ = numbers_of(sheet.n(), use_.shuffled);
    allocator_ = std::make_unique<JPH::TempAllocatorImpl>(16 * 1024 * 1024);
    jobs_ = std::make_unique<JPH::JobSystemSingleThreaded>(JPH::cMaxPhysicsJobs);
    world_ = std::make_unique<JPH::PhysicsSystem>();
    world_->Init(1, 0, 1, 1, broad_phase_, layer_against_broad_phase_, layers_);
    world_->SetGravity(JPH::Vec3(0, 0, static_cast<float>(-kGravity)));
    JPH::SoftBodyCreationSettings body(shared(renumbered(sheet, numbers_)), JPH::RVec3::sZero(),
                                       JPH::Quat::sIdentity(), 0);
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
    for (const std::size_t number : numbers_) {
      const JPH::SoftBodyVertex& v = motion_->GetVertices()[number];
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
          JPH::SoftBodySharedSettings::Edge(u(e.a), u(e.b), use_.compliance));
    out->CalculateEdgeLengths();
    if (use_.tethers) {
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

  Use use_;
  std::vector<std::size_t> numbers_;
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

std::unique_ptr<Engine> rows() { return std::make_unique<Jolt>(Use{}); }
std::unique_ptr<Engine> rigid() { return std::make_unique<Jolt>(Use{0, false, true}); }
std::unique_ptr<Engine> compliant() {
  return std::make_unique<Jolt>(Use{kCompliance, false, true});
}
std::unique_ptr<Engine> tethers() { return std::make_unique<Jolt>(Use{kCompliance, true, true}); }

}  // namespace

VERSUS_MODULE("jolt", version(),
              {{"rows", true, 1, 5, {64, 1}, rows},
               {"rigid", true, 1, 5, {64, 1}, rigid},
               {"compliant", true, 1, 5, {0, 0}, compliant},
               {"tethers", true, 1, 5, {0, 0}, tethers}})
