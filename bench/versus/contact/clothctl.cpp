// Our worlds. Sheets rest half of their thickness of 2 mm from obstacles.

#include "clothctl.hpp"

#include <limits>
#include <optional>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/collision/shapes.hpp"
#include "clothctl/sim/world.hpp"
#include "scene.hpp"

namespace versus {

namespace {

using clothctl::Index;

constexpr double kThickness = 2e-3;

/// A world with a sheet and an obstacle.
template <class Scalar>
class Ours : public Engine {
 public:
  void frame(double dt) override {
    if (!world_.step(static_cast<Scalar>(dt)).advanced) failed_ = true;
  }

  void read(double* positions) override {
    const auto& now = world_.state(0).positions;
    for (Index k = 0; k < now.size(); ++k) {
      positions[k] =
          failed_ ? std::numeric_limits<double>::quiet_NaN() : static_cast<double>(now.data()[k]);
    }
  }

 protected:
  template <class Model>
  std::string make(const Scene& scene, Model model) {
    clothctl::WorldSheetSetup<Scalar> setup;
    setup.thickness = static_cast<Scalar>(kThickness);
    setup.meets_sheets = scene.self;
    setup.substeps = scene.substeps;
    // Ample room: a list that is full would let points through.
    setup.contacts = 20 * model.vertex_count();
    clothctl::ClothState<Scalar> state = model.rest_state();
    const auto sheet = world_.add_sheet(std::move(model), std::move(state), setup);
    if (!sheet) return sheet.error();
    return add_obstacle(scene.obstacle);
  }

 private:
  std::string add_obstacle(const Obstacle& o) {
    using Vector = clothctl::Vector3<Scalar>;
    const clothctl::ColliderSurface<Scalar> surface{static_cast<Scalar>(o.friction), 0};
    const Scalar size = static_cast<Scalar>(o.size);
    const Vector centre = Vector::Zero(), half = Vector::Constant(size);
    const auto added =
        o.box ? world_.add_obstacle(clothctl::BoxCollider<Scalar>::create(centre, half).value(), {},
                                    surface)
              : world_.add_obstacle(clothctl::SphereCollider<Scalar>::create(centre, size).value(),
                                    {}, surface);
    return added ? "" : added.error();
  }

  clothctl::World<Scalar> world_;
  bool failed_ = false;
};

/// The implicit sheet, one solve a step.
class Implicit final : public Ours<double> {
 public:
  std::string load(const Scene& scene) override {
    const auto settings = clothctl::MassSpringSettings<double>::of(
        clothctl::material_preset<double>("cotton").value());
    auto model = clothctl::MassSpring<double>::create(
        cotton_network<double>(scene.side, start_height(scene.obstacle)), settings);
    return model ? make(scene, std::move(model).value()) : model.error();
  }
};

/// XPBD with numbers of substeps and of sweeps in each, and a limit of stretch or 0.
template <class Scalar>
class Positions final : public Ours<Scalar> {
 public:
  Positions(int substeps, int sweeps, double limit)
      : substeps_(substeps), sweeps_(sweeps), limit_(limit) {}

  std::string load(const Scene& scene) override {
    auto settings = clothctl::PositionBasedSettings<Scalar>::of(
        clothctl::material_preset<Scalar>("cotton").value());
    settings.substeps = substeps_;
    settings.iterations = sweeps_;
    settings.stretch_limit = static_cast<Scalar>(limit_);
    auto model = clothctl::PositionBased<Scalar>::create(
        cotton_network<Scalar>(scene.side, start_height(scene.obstacle)), settings);
    return model ? this->make(scene, std::move(model).value()) : model.error();
  }

 private:
  int substeps_, sweeps_;
  double limit_;
};

template <class Scalar>
Variant xpbd(const char* name, int substeps, int sweeps, double limit, bool extra = false) {
  return {name, 0.5 * kThickness, Use::Always, extra, [substeps, sweeps, limit] {
            return std::make_unique<Positions<Scalar>>(substeps, sweeps, limit);
          }};
}

}  // namespace

Entry clothctl_entry() {
  const auto implicit = [] { return std::make_unique<Implicit>(); };
  return {"clothctl",
          CLOTHCTL_VERSION_STRING,
          {{"mass-spring", 0.5 * kThickness, Use::Always, false, implicit},
           xpbd<double>("xpbd-20", 20, 2, 0),
           xpbd<double>("xpbd-20x1", 20, 1, 0),
           xpbd<double>("xpbd-5", 5, 2, 0),
           xpbd<float>("xpbd-20-float", 20, 2, 0, true),
           xpbd<double>("limit-4", 4, 2, 0.02)}};
}

}  // namespace versus
