#pragma once

// Plants and predictors chosen at run time: an interface with virtual functions to the library's
// templates.

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "clothctl/cloth/mass_spring.hpp"
#include "clothctl/cloth/mass_spring_rollout.hpp"
#include "clothctl/cloth/model_plant.hpp"
#include "clothctl/cloth/position_based.hpp"
#include "clothctl/mpc/planner_settings.hpp"
#include "clothctl/network/spring_network.hpp"
#include "clothctl/prediction/identify.hpp"
#include "clothctl/prediction/sheet_sampling.hpp"
#include "support/options.hpp"
#include "support/timing.hpp"

namespace program {

using clothctl::Index;
using Vec = clothctl::Vector3<double>;
using Points = clothctl::Points<double>;
using View = clothctl::PointsView<double>;

/// Any ClothPlant.
class AnyPlant {
 public:
  using Scalar = double;
  template <clothctl::ClothModel Model>
  explicit AnyPlant(Model model)
      : AnyPlant(Plant(), clothctl::ModelPlant<Model>(std::move(model))) {}
  /// Marks the constructor for plants that are not a model.
  struct Plant {};
  /// Holds a plant with `set_state`, whose positions and velocities are references.
  template <class Held>
  AnyPlant(Plant, Held plant) : plant_(std::make_unique<Holder<Held>>(std::move(plant))) {}
  Index vertex_count() const { return plant_->positions().cols(); }
  const Points& positions() const { return plant_->positions(); }
  const Points& velocities() const { return plant_->velocities(); }
  void set_state(const clothctl::ClothState<double>& state) { plant_->set_state(state); }
  void apply(const clothctl::ClothInput<double>& input) { plant_->apply(input); }
  clothctl::StepReport<double> advance(double dt) {
    const std::chrono::steady_clock::time_point before = std::chrono::steady_clock::now();
    const clothctl::StepReport<double> report = plant_->advance(dt);
    last_step_ms_ = milliseconds(before);
    return report;
  }
  /// Duration of the last step, ms.
  double last_step_ms() const { return last_step_ms_; }

 private:
  struct Base {
    virtual ~Base() = default;
    virtual const Points& positions() const = 0;
    virtual const Points& velocities() const = 0;
    virtual void set_state(const clothctl::ClothState<double>&) = 0;
    virtual void apply(const clothctl::ClothInput<double>&) = 0;
    virtual clothctl::StepReport<double> advance(double) = 0;
  };
  template <class Held>
  struct Holder final : Base {
    explicit Holder(Held held) : plant(std::move(held)) {}
    const Points& positions() const override { return plant.positions(); }
    const Points& velocities() const override { return plant.velocities(); }
    void set_state(const clothctl::ClothState<double>& state) override { plant.set_state(state); }
    void apply(const clothctl::ClothInput<double>& input) override { plant.apply(input); }
    clothctl::StepReport<double> advance(double dt) override { return plant.advance(dt); }
    Held plant;
  };
  std::unique_ptr<Base> plant_;
  double last_step_ms_ = 0;
};

/// Any predictor of the planner.
class AnyPredictor {
 public:
  using Scalar = double;
  using Request = clothctl::WindowRequest<double>;
  using Response = clothctl::WindowResponse<double>;
  template <class Predictor>
  requires(!std::same_as<Predictor, AnyPredictor>) explicit AnyPredictor(Predictor predictor)
      : predictor_(std::make_unique<Holder<Predictor>>(std::move(predictor))) {}
  void reserve(const Request& request, Response& response) {
    predictor_->reserve(request, response);
  }
  bool predict(const View& x, const View& v, const Request& request, Response& response) {
    return predictor_->predict(x, v, request, response);
  }
  bool predicts(clothctl::GripInput kind) const { return predictor_->predicts(kind); }
  void reset() { predictor_->reset(); }

 private:
  struct Base {
    virtual ~Base() = default;
    virtual bool predicts(clothctl::GripInput) const = 0;
    virtual void reserve(const Request&, Response&) = 0;
    virtual bool predict(const View&, const View&, const Request&, Response&) = 0;
    virtual void reset() = 0;
  };
  template <class Predictor>
  struct Holder final : Base {
    explicit Holder(Predictor p) : predictor(std::move(p)) {}
    bool predicts(clothctl::GripInput kind) const override {
      return clothctl::predicts_input(predictor, kind);
    }
    void reserve(const Request& request, Response& response) override {
      predictor.reserve(request, response);
    }
    bool predict(const View& x, const View& v, const Request& request,
                 Response& response) override {
      return predictor.predict(x, v, request, response);
    }
    void reset() override { predictor.reset(); }
    Predictor predictor;
  };
  std::unique_ptr<Base> predictor_;
};

/// A coarse sheet that predicts a finer one.
struct CoarseSheet {
  clothctl::SpringNetwork<double> network;
  clothctl::SheetSampling<double> sampling;
};

/// A body to simulate. Every plant and predictor of the programs is made from one.
struct Body {
  clothctl::SpringNetwork<double> network;
  double drag = 0;
  clothctl::AirSettings<double> air = {};
  std::optional<CoarseSheet> coarse = {};
};

inline bool is_implicit(const std::string& plant) {
  return plant == "linear-implicit" || plant == "newton";
}

inline bool is_position_based(const std::string& plant) {
  return plant == "pbd" || plant == "xpbd";
}

/// Makes the position-based sheet of a body called "pbd" (Verlet) or "xpbd".
clothctl::PositionBased<double> make_position_based(const std::string& name, const Body& body);

/// Makes a body's mass-spring sheet with the published step, which planners predict. `network`: the
/// body's, or that of its coarse sheet.
clothctl::MassSpring<double> make_mass_spring(const Body& body,
                                              const clothctl::SpringNetwork<double>& network,
                                              clothctl::Integration integration);

/// Returns the settings of a rollout of a sheet: with bending in the matrix on a fine mesh, where
/// one quasi-Newton step does not converge without it.
clothctl::RolloutModelSettings rollout_model_settings(Index vertices);

/// Makes the plant called `name`; `drag` replaces the body's drag (for settling). "explicit" is the
/// foreign cloth of bring_your_own: at most 9×9 vertices, or its substeps are too long.
AnyPlant make_plant(const std::string& name, const Body& body, double drag);

/// Makes a plant of the body as it is, in `state`.
AnyPlant plant_in_state(const std::string& name, const Body& body,
                        const clothctl::ClothState<double>& state);

/// Returns the predictor that --predictor names; auto means "linearised", "rollout" or "simulator".
std::string chosen_predictor(const Options& o);

/// Returns whether poses are planned although forces are sent (PushedPlant): on position-based
/// plants that are predicted by their own steps, and with patches on implicit plants that are
/// rolled out.
bool follows_poses(const Options& o);

/// Adjusts weights and predictor to a plant. Predicts by the coarse sheet if the body has one. In
/// position-based sheets, unconverged elongation and not tension carries the weight, so their
/// predictor scales the tension term and uses the measured net force, by factors set by hand, or
/// by those that --predictor identified found (support/identified_plant.hpp).
AnyPredictor make_predictor(
    const Options& o, const Body& body, clothctl::PlannerSettings<double>& settings,
    const std::optional<clothctl::IdentifiedResponse<double>>& identified = {});

}  // namespace program
