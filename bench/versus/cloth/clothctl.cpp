#include "clothctl.hpp"

#include <optional>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/position_based.hpp"

namespace versus {

namespace {

using clothctl::Index;

/// The network of a sheet: its masses, and a spring without damping on every edge.
template <class Scalar>
clothctl::SpringNetwork<Scalar> network_of(const Sheet& sheet, double stiffness) {
  clothctl::SpringNetwork<Scalar> network;
  network.rest_positions.resize(3, sheet.n());
  network.mass.resize(sheet.n());
  for (Index i = 0; i < sheet.n(); ++i) {
    for (Index c = 0; c < 3; ++c) {
      const double x = sheet.positions[static_cast<std::size_t>(3 * i + c)];
      network.rest_positions(c, i) = static_cast<Scalar>(x);
    }
    network.mass[i] = static_cast<Scalar>(sheet.mass[static_cast<std::size_t>(i)]);
  }
  for (const Edge& e : sheet.edges) {
    network.springs.push_back(
        {e.a, e.b, static_cast<Scalar>(e.length), static_cast<Scalar>(stiffness), Scalar(0),
         e.diagonal ? clothctl::SpringKind::Shear : clothctl::SpringKind::Structural});
  }
  network.triangles = sheet.triangles;
  return network;
}

/// What both models share: a model, its workspace and its state.
template <class Model, class Scalar>
class Ours : public Engine {
 public:
  void read(double* positions, double* velocities) override {
    for (Index k = 0; k < state_.positions.size(); ++k) {
      positions[k] = static_cast<double>(state_.positions.data()[k]);
      velocities[k] = static_cast<double>(state_.velocities.data()[k]);
    }
  }

  void scale_velocities(double factor) override {
    state_.velocities *= static_cast<Scalar>(factor);
  }

 protected:
  template <class Settings>
  std::string make(clothctl::SpringNetwork<Scalar> network, Settings settings) {
    auto model = Model::create(std::move(network), std::move(settings));
    if (!model) return model.error();
    model_.emplace(std::move(model).value());
    workspace_.emplace(model_->make_workspace());
    state_ = model_->rest_state();
    input_.clear();
    return {};
  }

  void advance(double dt) {
    if (!model_->step(state_, input_, static_cast<Scalar>(dt), *workspace_).advanced)
      state_.positions.setConstant(std::numeric_limits<Scalar>::quiet_NaN());
  }

 private:
  std::optional<Model> model_;
  std::optional<typename Model::Workspace> workspace_;
  clothctl::ClothState<Scalar> state_;
  clothctl::ClothInput<Scalar> input_;
};

/// XPBD with springs of 1 MN/m, which are rigid here: the whole sheet pulls with 2 N.
class Positions final : public Ours<clothctl::PositionBased<float>, float> {
 public:
  explicit Positions(double cap) : cap_(cap) {}

  std::string load(const Sheet& sheet, const Setting& setting) override {
    clothctl::PositionBasedSettings<float> settings;
    settings.substeps = setting.substeps;
    settings.iterations = setting.sweeps;
    settings.pinned = sheet.pinned;
    settings.stretch_limit = static_cast<float>(cap_);
    return make(network_of<float>(sheet, 1e6), settings);
  }

  void frame(double dt) override { advance(dt); }

 private:
  double cap_;
};

class Implicit final : public Ours<clothctl::MassSpring<double>, double> {
 public:
  std::string load(const Sheet& sheet, const Setting& setting) override {
    substeps_ = setting.substeps;
    clothctl::MassSpringSettings<double> settings;
    settings.integration = clothctl::Integration::Newton;
    settings.pinned = sheet.pinned;
    return make(network_of<double>(sheet, 1e4), settings);
  }

  void frame(double dt) override {
    for (int part = 0; part < substeps_; ++part) advance(dt / substeps_);
  }

 private:
  int substeps_ = 1;
};

std::unique_ptr<Engine> plain() { return std::make_unique<Positions>(0); }
std::unique_ptr<Engine> capped() { return std::make_unique<Positions>(0.02); }
std::unique_ptr<Engine> implicit() { return std::make_unique<Implicit>(); }

}  // namespace

Entry clothctl_entry() {
  return {"clothctl",
          CLOTHCTL_VERSION_STRING,
          {{"substeps", true, 2, 5, {64, 1}, plain}, {"cap", true, 2, 4, {0, 0}, capped}}};
}

Entry reference_entry() {
  return {"implicit", CLOTHCTL_VERSION_STRING, {{"newton", true, 1, 16, {0, 0}, implicit}}};
}

}  // namespace versus
